"""The strangers that the blind study flies: each follows from its seed, holds, and shows what it hides as said."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import strangers
from planted import NOMINAL_OMEGA, SIGNALS, TABLE_4, Array, equations, in_numbers
from scipy.optimize import least_squares
from strangers import vehicles
from strangers.detect import DETECTABLE, _Beside
from strangers.flights import KINDS, Stranger, fly, ground_of, planned
from strangers.flying import flown
from strangers.hiding import CATALOGUE, FOREIGN, NEWER, NOTHING, Hidden, may_stand_together

CLEAN = 21
"""Seed of a short flight with nothing hidden."""
UNTOLD = 276
"""Seed of one whose log has every tenth sample of a loop of 500 Hz, and does not tell it."""


def test_only_the_question_knows_the_package() -> None:
    for path in Path(strangers.__file__).parent.glob("*.py"):
        tree = ast.parse(path.read_text("utf-8"))
        names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        known = {name.split(".")[0] for name in names} & {"sysid", "sitl", "gcs"}
        assert known == ({"sysid"} if path.stem == "asking" else set()), path.name


@pytest.mark.parametrize("seed", range(12))
def test_a_stranger_holds_by_itself_and_in_its_loop(seed: int) -> None:
    vehicle = planned(seed).vehicle
    E = equations(None, {}, False, vehicle.table)
    A, B, C = in_numbers(E)
    assert np.max(np.linalg.eigvals(A[:4, :4]).real) <= -vehicles.LEAST_DECAY
    states = list(E.rows)
    feedback = vehicle.rate_gain @ C
    feedback[:, [states.index("phi"), states.index("theta")]] += vehicle.attitude_gain
    assert np.max(np.linalg.eigvals(A - B[:, :2] @ feedback).real) < 0


def test_parameters_spread_over_a_decade() -> None:
    tables = [planned(seed).vehicle.table for seed in range(120)]
    for name in ("L_b", "M_a"):
        values = [table[name] for table in tables]
        assert max(values) > 10 * min(values)


def test_every_kind_comes_and_seven_in_ten_log_their_excitation() -> None:
    plans = [planned(seed) for seed in range(300)]
    assert {plan.kind for plan in plans} == set(KINDS)
    assert 0.6 < sum(plan.excitation_logged for plan in plans) / len(plans) < 0.8
    assert min(plan.log_hz for plan in plans) == 50
    assert max(plan.log_hz for plan in plans) == 1000
    lengths = sorted(plan.card[0].duration_s for plan in plans)
    assert lengths[0] >= 8
    assert lengths[-1] > 60
    assert lengths[len(lengths) // 2] < 30


def same(one: Stranger, other: Stranger) -> bool:
    return all(
        a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)
        for a, b in zip(one.runs, other.runs, strict=True)
    )


def test_the_same_seed_gives_the_same_flight() -> None:
    flight = fly(CLEAN, ("servo_lag",))
    assert same(flight, fly(CLEAN, ("servo_lag",)))
    assert flight.hidden == fly(CLEAN, ("servo_lag",)).hidden
    assert not same(flight, fly(CLEAN))


def test_a_size_is_as_detectable_as_was_asked_for() -> None:
    flight = fly(CLEAN, ("servo_lag",))
    assert flight.detectability == pytest.approx(flight.plan.targets[0], rel=0.3)


def test_what_the_base_makes_of_it_at_other_values_is_not_detectable() -> None:
    """A damping that moves the base far; against flights alone, without slopes, from another base than the truth."""
    plan = planned(CLEAN, ("angular_damping",))
    ground = ground_of(plan)
    hidden = Hidden(("angular_damping",), ({"L_p": -10.0, "M_q": -10.0},))
    effect = flown(plan.vehicle, hidden, ground.still, ground.loop)
    commanded = replace(ground.still, excitation=effect.commands - ground.loop.trim_of(effect.commands))

    def left(scales: Array) -> Array:
        table = dict(plan.vehicle.table) | {
            name: plan.vehicle.table[name] * scale for name, scale in zip(plan.vehicle.parameters, scales, strict=True)
        }
        base = flown(replace(plan.vehicle, table=table), NOTHING, commanded, replace(ground.loop, closed=False))
        wanted = (
            np.fft.rfft(effect.measured - base.measured, axis=0)[ground.bins] * np.sqrt(2 / ground.noise)[..., None]
        )
        return np.concatenate([wanted.real.ravel(), wanted.imag.ravel()])

    ones = np.ones(len(plan.vehicle.parameters))
    least = 2 * float(least_squares(left, 1.05 * ones).cost)
    assert ground.shown(hidden) == pytest.approx(least, rel=0.02)
    assert least < 0.5 * float(np.sum(left(ones) ** 2))


def test_of_two_that_make_the_same_neither_is_detectable_beside_the_other() -> None:
    ground = ground_of(planned(CLEAN, ("servo_lag",)))
    lag, late, coupled = (
        ("servo_lag", {"tau_s": 0.005}),
        ("gyro_lag", {"tau_g": 0.005}),
        ("inertia_coupling", {"c_p": 0.03}),
    )

    def hiding(*some: tuple[str, dict[str, float]]) -> Hidden:
        return Hidden(tuple(name for name, _ in some), tuple(size for _, size in some))

    for one, least, most in ((late, 0.0, 0.02), (coupled, 0.5, 2.0)):
        alone, beside = ground.chi_squared(hiding(one)), ground.shown_beside(hiding(lag), hiding(lag, one))
        assert least * alone <= beside < most * alone


def test_what_another_makes_of_it_at_a_size_far_from_its_own_is_not_detectable_beside_it() -> None:
    """Against flights alone, from another base and another size than the truth, and against slopes at the truth."""
    plan = planned(CLEAN, ("servo_lag",))
    ground = replace(ground_of(plan), untold_s=0.0)
    both = Hidden(("servo_lag", "transport_delay"), ({"tau_s": 0.01}, {"T_d": 0.03}))
    effect = flown(plan.vehicle, both, ground.still, ground.loop)
    commanded = replace(ground.still, excitation=effect.commands - ground.loop.trim_of(effect.commands))

    def left(scales: Array) -> Array:
        table = dict(plan.vehicle.table) | {
            name: plan.vehicle.table[name] * scale for name, scale in zip(plan.vehicle.parameters, scales, strict=False)
        }
        lag = Hidden(("servo_lag",), ({"tau_s": 0.01 * scales[-1]},))
        answer = flown(replace(plan.vehicle, table=table), lag, commanded, replace(ground.loop, closed=False))
        wanted = (
            np.fft.rfft(effect.measured - answer.measured, axis=0)[ground.bins] * np.sqrt(2 / ground.noise)[..., None]
        )
        return np.concatenate([wanted.real.ravel(), wanted.imag.ravel()])

    known = Hidden(("servo_lag",), ({"tau_s": 0.01},))
    ones = np.ones(1 + len(plan.vehicle.parameters))
    least = 2 * float(least_squares(left, np.append(1.05 * ones[1:], 3.0), diff_step=1e-4).cost)
    assert ground.shown_beside(known, both) == pytest.approx(least, rel=0.02)
    assert least < 0.1 * float(np.sum(left(ones) ** 2))


@pytest.mark.thorough
def test_slopes_beside_what_moves_otherwise_than_linearly_are_those_of_flights() -> None:
    plan = planned(CLEAN, ("quadratic_damping",))
    little = Hidden(("quadratic_damping",), ({"L_pp": -0.01, "M_qq": -0.01, "exponent": 2.0},))
    ground = replace(ground_of(plan), untold_s=1e-3)
    effect = flown(plan.vehicle, little, ground.still, ground.loop)
    commanded = replace(ground.still, excitation=effect.commands - ground.loop.trim_of(effect.commands))
    seen = np.fft.rfft(effect.measured, axis=0)[ground.bins]
    beside = _Beside(ground=ground, known=little, commanded=commanded, seen=seen)
    slopes, here, step = beside.slopes(beside.begin), beside.left(beside.begin), 1e-4
    for i, along in enumerate(np.eye(beside.begin.size)):
        flown_there = (beside.left(beside.begin + step * along) - here) / step
        assert np.linalg.norm(slopes[:, i] - flown_there) < 0.05 * np.linalg.norm(flown_there)


def test_lateness_that_an_untold_loop_leaves_open_is_not_detectable() -> None:
    plan = planned(UNTOLD, ("servo_lag",))
    assert (plan.loop_hz, plan.log_hz, plan.loop_told) == (500, 50, False)
    a_little, more = (Hidden(("servo_lag",), ({"tau_s": tau},)) for tau in (0.004, 0.03))
    untold, told = ground_of(plan), ground_of(replace(plan, loop_told=True))
    assert untold.shown(a_little) < 0.1 * told.shown(a_little)
    assert untold.shown(more) > 10 * DETECTABLE


def test_a_log_has_the_rate_and_the_channels_of_its_plan() -> None:
    flight = fly(CLEAN)
    for run, maneuver in zip(flight.runs, flight.plan.card, strict=True):
        assert 1 / np.median(np.diff(run["t"])) == pytest.approx(flight.plan.log_hz)
        assert run["t"][-1] == pytest.approx(maneuver.duration_s + 2, abs=0.1)
        assert ("excitation_x" in run) == flight.plan.excitation_logged


@pytest.mark.parametrize("name", [*CATALOGUE, *FOREIGN])
def test_what_is_hidden_changes_the_equations_or_the_actuators(name: str) -> None:
    vehicle = planned(0, (name,)).vehicle
    entry = CATALOGUE.get(name) or FOREIGN[name]
    hidden = Hidden((name,), (entry.sizes(vehicle, 1.0, np.full(8, 0.5)),))
    E, base = hidden.equations(vehicle), NOTHING.equations(vehicle)
    changed = E.rows != base.rows or E.measured != base.measured or E.nonlinear or E.varying
    assert changed or not hidden.actuators(np.zeros((3, 1)), 0.002).pass_on


def test_seeds_that_hide_an_older_entry_are_what_they_were() -> None:
    """Names as they were drawn before there were newer entries."""
    before = {
        1000: ("servo_rate_limit",), 1002: ("speed_stability",), 1003: ("lazy_servos",), 1004: (),
        1023: ("giving_links",), 1037: ("structural_mode",), 1039: ("speed_stability",),
    }  # fmt: skip
    assert {seed: planned(seed).names for seed in before} == before


def test_newer_entries_come_as_often_as_others() -> None:
    names = [name for seed in range(400) for name in planned(seed).names]
    assert set(NEWER) <= set(names)
    assert 0.1 < sum(name in NEWER for name in names) / len(names) < 0.3


def test_a_turned_swashplate_is_the_base_s_own_and_nothing_is_missing() -> None:
    flight = fly(CLEAN, ("swashplate_phase",))
    assert flight.detectability is None
    assert [(one["level"], one["answer"]) for one in flight.hidden.to_json()] == [("none", None)]
    base = equations(None, {}, False, flight.plan.vehicle.table)
    turned = flight.hidden.equations(flight.plan.vehicle)
    assert [turned.rows[tilt] == base.rows[tilt] for tilt in "ab"] == [False, False]
    assert ground_of(flight.plan).shown(flight.hidden) < 0.05 * DETECTABLE  # the window lets some through


def test_what_has_late_motors_is_a_quadrotor() -> None:
    plan = planned(CLEAN, ("motor_lag",))
    assert not plan.vehicle.flaps
    assert planned(CLEAN, ("servo_lag",)).vehicle.flaps
    E = Hidden(("motor_lag",), ({"tau_m": 0.05},)).equations(plan.vehicle)
    assert E.rows["v_x"] == {"x": 1 / 0.05, "v_x": -1 / 0.05}
    assert E.rows["p"]["v_x"] == plan.vehicle.table["L_lat"]
    assert "x" not in E.rows["p"]


def test_a_governor_lets_collective_slow_the_rotor_which_nobody_logs() -> None:
    plan = planned(CLEAN, ("governor",))
    assert "delta_c" in plan.logged
    assert "omega" not in plan.logged
    hidden, dt = Hidden(("governor",), ({"k_g": 0.5, "tau_o": 0.4},)), 0.002
    pulled = np.full((1000, 1), 0.2)
    speed = hidden.rotor_speed(np.zeros((1000, 1)), pulled, dt) / NOMINAL_OMEGA
    middle = (np.arange(1000) + 0.5) * dt
    assert speed[:, 0] == pytest.approx(1 - 0.5 * 0.2 * (1 - np.exp(-middle / 0.4)), abs=1e-6)


@pytest.mark.parametrize(
    ("pair", "may"),
    [
        (("gyro_filter", "servo_lag"), False),
        (("governor", "quadratic_damping"), False),
        (("stabiliser_bar", "servo_lag"), False),
        (("governor", "transport_delay"), True),
        (("lead_lag", "gyro_filter"), True),
        (("swashplate_phase", "hub_gyroscopics"), False),
    ],
)
def test_which_may_stand_together(pair: tuple[str, str], may: bool) -> None:
    assert may_stand_together(pair) == may


def test_two_at_once_are_both_there() -> None:
    vehicle = planned(0).vehicle
    pair = ("servo_lag", "hub_gyroscopics")
    assert may_stand_together(pair)
    assert not may_stand_together(("servo_lag", "gyro_lag"))
    sizes = tuple(CATALOGUE[name].sizes(vehicle, 1.0, np.full(8, 0.5)) for name in pair)
    both = Hidden(pair, sizes).equations(vehicle).rows
    lag, hub = (Hidden((name,), (size,)).equations(vehicle).rows for name, size in zip(pair, sizes, strict=True))
    assert both["v_x"] == lag["v_x"]
    assert both["p"]["q"] == pytest.approx(hub["p"]["q"])
    assert both["a"]["v_x"] == pytest.approx(lag["a"]["v_x"])
    assert both["a"].get("x", 0.0) == pytest.approx(0.0, abs=1e-12)


def test_the_paper_s_table_is_the_base_s_own() -> None:
    own, given = (in_numbers(equations(None, {}, False, table)) for table in (None, TABLE_4))
    assert all(np.array_equal(one, other) for one, other in zip(own, given, strict=True))
    assert own[1].shape[1] == len(SIGNALS)
