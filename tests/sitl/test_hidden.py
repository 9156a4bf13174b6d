"""Hidden effects: every part does what its physics says, the log tells nothing, and equal seeds hide alike.

What the catalogue has, too, is held against `planted`, which integrates the same equations written a second time.
"""

from __future__ import annotations

import itertools
import json
import math
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import planted
import pytest
from more_of_a_kind import thorough
from numpy.typing import NDArray
from scipy import signal
from scipy.spatial.transform import Rotation

from sitl.__main__ import main
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.hidden import NONE_SHARE, PLANTS, Hidden, draw, names, plant_one
from sitl.plants import make_plant
from sitl.plants.actuators import Each, Fading, Frame, Lag, Late, LazyLag, Mean, Ring, ThreeServos, Uneven
from sitl.plants.conditions import CONDITIONS
from sitl.plants.drivetrain import Drivetrain
from sitl.plants.forward import ForwardPlant
from sitl.plants.fuselages import FlexibleWing, HubMomentum, Now, TurnedInertia
from sitl.plants.hover import NOTHING_MISSING, Gusts, HoverPlant
from sitl.plants.rotorcraft import AIRFRAMES, NOMINAL_AIRSPEED, Parts, Rotorcraft
from sitl.plants.rotors import (
    InflowDisc,
    PittPetersDisc,
    RubberHub,
    StickingHinge,
    StiffeningHub,
    powers,
    spring_and_offset,
)
from sitl.plants.sensors import RotatedChip, SoftMount
from sitl.plants.table4 import TABLE_4
from sysid.model.effect import catalogue

DT = 0.002
STILL = Gusts(0.0, 0.0, 1.5)
Array = NDArray[np.float64]
Fly = Callable[[Any, float], list[str]]
Reader = Callable[[Path], list[Any]]

EVERY = [(plant, name) for plant in PLANTS for name in names(plant)]


def wiggle(seconds: float) -> Array:
    """Commands (n, 3) that move every axis at once and jump."""
    t = np.arange(round(seconds / DT)) * DT
    x = 0.1 * np.sin(7 * t) + 0.05 * np.sign(np.sin(3 * t))
    y = 0.12 * np.sin(13 * t + 1) - 0.04 * np.sign(np.sin(5 * t))
    return np.stack([x, y, 0.2 * np.sin(9 * t)], axis=1)


def quiet(plant: Rotorcraft) -> Rotorcraft:
    plant._gauss = lambda mean, deviation: 0.0  # type: ignore[method-assign, assignment]
    return plant


def respond(parts: Parts, plant: str, commands: Array, **signals: Array) -> Array:
    """Rates (n, 2) at the gyro, from rest, without gusts; `signals` overrule omega, r and airspeed."""
    flown = quiet(Rotorcraft(AIRFRAMES[plant], parts, STILL))
    rates = np.empty((len(commands), 2))
    for k, (x, y, e) in enumerate(commands.tolist()):
        for name in ("omega", "r", "airspeed"):
            if name in signals:
                setattr(flown, name, float(signals[name][k]))
        seen = (flown.p, flown.q, flown.r)
        for mount in parts.gyro:
            seen = mount.step(*seen)
        rates[k] = seen[:2]
        c, r = (float(signals[name][k]) if name in signals else usual for name, usual in (("c", 0.2), ("dr", 0.0)))
        flown.step(x, y, e, c, r)
    return rates


def relative(one: Array, other: Array) -> float:
    return float(np.max(np.linalg.norm(one - other, axis=0) / np.linalg.norm(other, axis=0)))


# ------------------------------------------------------------------------------------------------ the plant


@pytest.mark.parametrize("name", PLANTS)
def test_without_parts_it_is_the_plain_plant(name: str) -> None:
    plain: Any = ForwardPlant(STILL, 3) if name == "forward" else HoverPlant(NOTHING_MISSING, STILL, 3)
    built = Rotorcraft(AIRFRAMES[name], None, STILL, 3)
    plain._gauss = built._gauss = lambda mean, deviation: 0.0  # type: ignore[method-assign, assignment]
    for x, y, e in wiggle(1.0).tolist():
        plain.step(x, y, e, 0.2)
        built.step(x, y, e, 0.2)
        for field in ("p", "q", "a", "b", "phi", "theta", "omega", "airspeed", "ax", "ay", "az"):
            assert getattr(built, field) == pytest.approx(getattr(plain, field), abs=1e-12), field


EXPONENT = {"quadratic_damping": {"exponent": 2.0}}
"""Which the catalogue leaves open."""
TWINS = [(plant, name) for plant, name in EVERY if name in planted.PLANTED]
TWINS.remove(("forward", "second_order_flapping"))  # the independent one flies it at 1650 RPM only


@pytest.mark.parametrize(("plant", "name"), TWINS)
def test_it_answers_as_the_independent_integrator_does(plant: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    hidden = plant_one(name, 4, plant)
    commands = wiggle(1.2)
    if name == "servo_saturation":
        commands += planted.TRIM  # a limit counts from zero, the independent one's commands from the trim
    n, t = len(commands), np.arange(len(commands)) * DT
    wave = np.sin(2 * np.pi * 2 * t)
    ours: dict[str, Array] = {}
    theirs: dict[str, Array] = {}
    if name == "rotor_speed":
        omega = AIRFRAMES[plant].nominal_rpm * 2 * np.pi / 60 * (1 + 0.08 * (wave - wave.mean()))
        ours, theirs = {"omega": omega}, {"omega": omega}
    elif name == "airspeed_scaling":
        speed = NOMINAL_AIRSPEED * (1 + 0.2 * (wave - wave.mean()))
        ours, theirs = {"airspeed": speed}, {"airspeed": speed}
    elif name == "yaw_coupling":
        ours, theirs = {"r": 0.8 * wave}, {"r": 0.8 * wave}
    elif name == "input_coupling":
        ours = {"c": 0.2 + 0.1 * wave, "dr": 0.3 * wave[::-1].copy()}
        theirs = {"delta_c": ours["c"], "delta_r": ours["dr"]}
    given = wiggle(1.2)
    if name == "structural_mode":  # the tables' inertia holds the wing, the independent one's does not
        weights = {axis: 1 + hidden.sizes[f"kappa_{axis}"] for axis in ("roll", "pitch")}
        for table in ("TABLE_4", "TABLE_5"):
            changed = dict(getattr(planted, table))
            for one, axis in (
                ("L_b", "roll"),
                ("L_p", "roll"),
                ("M_a", "pitch"),
                ("M_q", "pitch"),
                ("M_elev", "pitch"),
            ):
                changed[one] = weights[axis] * changed.get(one, 0.0)
            monkeypatch.setattr(planted, table, changed)
    found = planted.respond(
        name, {**EXPONENT.get(name, {}), **hidden.sizes}, given, forward=plant == "forward", **theirs
    )
    expected = np.stack([found["p"], found["q"]], axis=1)
    monkeypatch.undo()
    base = planted.respond(None, {}, given, forward=plant == "forward")
    effect = float(np.linalg.norm(expected - np.stack([base["p"], base["q"]], axis=1)))
    assert effect > 0.004 * np.linalg.norm(expected), "the comparison shows nothing"
    measured = respond(hidden.build(), plant, commands, **ours)
    if name == "servo_saturation":
        measured -= respond(Parts(), plant, np.tile(planted.TRIM, (n, 1)))
    # 2 ms steps with the means of what moves within them, a turned chip in place of a small angle
    assert np.linalg.norm(measured - expected) < 0.01 * np.linalg.norm(expected)
    assert np.linalg.norm(measured - expected) < 0.2 * effect


# ------------------------------------------------------------------------------------------------ actuators


def test_a_lag_answers_a_step_as_theory_says() -> None:
    lag = Lag(0.03, DT)
    for k in range(1, 100):
        assert lag.step(1.0) == pytest.approx(1 - math.exp(-k * DT / 0.03))
    limited = Lag(0.0, DT, 4.0)
    assert [limited.step(1.0) for _ in range(3)] == pytest.approx([0.008, 0.016, 0.024])
    stage = Each(lambda: Lag(0.03, DT), moves=True)
    first = 1 - math.exp(-DT / 0.03)
    assert stage.step(1.0, -1.0, 0.5, 0.0) == pytest.approx((0.5 * first, -0.5 * first, 0.25 * first))


@pytest.mark.parametrize("delay_s", [0.002, 0.0071, 0.0139, 0.02])
def test_a_delay_of_any_length_is_late_by_it(delay_s: float) -> None:
    late = Late(delay_s, DT)
    answer = np.array([late.step(1.0 if k == 0 else 0.0) for k in range(20)])
    assert answer.sum() == pytest.approx(1.0)
    assert (answer * np.arange(20)).sum() * DT == pytest.approx(delay_s)
    assert np.count_nonzero(answer > 1e-12) <= 2


@pytest.mark.parametrize("rate_hz", [51.3, 71.0, 333.0])
def test_a_frame_is_half_a_period_late_on_average(rate_hz: float) -> None:
    frame = Frame(1 / rate_hz, DT, 0.3 / rate_hz)
    late = [k * DT - frame.step(k * DT) for k in range(20_000)][500:]
    assert np.mean(late) == pytest.approx(0.5 / rate_hz, abs=1e-4)
    held = [frame.step(float(k)) for k in range(1000)]
    assert len(set(held)) == pytest.approx(min(1000, 2 * 2 * rate_hz), rel=0.02)  # two values a pulse


def test_three_ideal_servos_give_back_what_was_asked_for() -> None:
    ideal = ThreeServos([Lag(0.0, DT) for _ in range(3)], Lag(0.0, DT))
    for x, y, e, c in itertools.product((-0.3, 0.1), (0.0, 0.2), (-0.5, 0.5), (-0.1, 0.0, 0.4)):
        assert ideal.step(x, y, e, c) == pytest.approx((x, y, e))


def test_three_equal_slow_servos_are_one_lag_on_each_axis_and_unequal_ones_couple() -> None:
    alike = ThreeServos([Mean(Lag(0.02, DT)) for _ in range(3)], Mean(Lag(0.02, DT)))
    each = Each(lambda: Lag(0.02, DT), moves=True)
    unlike = ThreeServos([Mean(Lag(tau, DT)) for tau in (0.01, 0.02, 0.03)], Mean(Lag(0.02, DT)))
    crossed = 0.0
    for _ in range(20):
        assert alike.step(0.1, 0.0, 0.1, 0.0) == pytest.approx(each.step(0.1, 0.0, 0.1, 0.0))
        crossed = max(crossed, abs(unlike.step(0.1, 0.0, 0.0, 0.0)[1]))
    assert 0.002 < crossed < 0.05


def test_a_ring_keeps_the_direction_and_a_soft_one_gives() -> None:
    x, y, e = Ring(0.1).step(0.3, -0.4, -0.2, 0.0)
    assert (math.hypot(x, y), y / x, e) == pytest.approx((0.1, -4 / 3, -0.1))
    assert Ring(0.1).step(0.03, 0.04, 0.05, 0.0) == (0.03, 0.04, 0.05)
    x, y, e = Ring(0.1, 0.2).step(0.3, -0.4, 0.6, 0.0)
    assert (math.hypot(x, y), e) == pytest.approx((0.1 + 0.2 * 0.4, 0.1 + 0.2 * 0.5))


def test_uneven_fading_and_lazy() -> None:
    assert Uneven(0.2).step(0.1, -0.1, 0.0, 0.0) == pytest.approx((0.12, -0.08, 0.0))
    fading = Fading(0.3, 1.0, DT)
    gains = [fading.step(1.0, 1.0, 1.0, 0.0)[0] for _ in range(501)]
    assert (gains[0], gains[500]) == pytest.approx((1.0, 0.7))

    def settled(size: float) -> float:
        servo = LazyLag(0.005, 0.1, 0.02, DT)
        return next(k for k in range(1000) if servo.step(size) > 0.5 * size) * DT

    assert settled(0.5) < 0.01
    assert settled(0.005) > 0.05


# ------------------------------------------------------------------------------------------------ rotor


def disc_rates(disc: Any, a: float, b: float, *own: float, x: float = 0.0, y: float = 0.0) -> tuple[float, ...]:
    disc.hold(x, y, 1650 * 2 * math.pi / 60, 0.0)
    return tuple(disc.rates([0.0, 0.0, 0.0, 0.0, a, b, *own]))


def test_a_stiffening_hub_doubles_at_its_knee_and_is_odd() -> None:
    hub = StiffeningHub(TABLE_4, 1650.0, 0.05)
    L, M, *_ = disc_rates(hub, 0.05, 0.05)
    assert pytest.approx((2 * TABLE_4.L_b * 0.05, 2 * TABLE_4.M_a * 0.05)) == (L, M)
    assert disc_rates(hub, -0.05, -0.05)[:2] == pytest.approx((-L, -M))
    assert disc_rates(hub, 0.001, 0.0)[1] == pytest.approx(TABLE_4.M_a * 0.001, rel=1e-3)


def test_a_rubber_hub_is_stiffer_for_the_quick() -> None:
    hub = RubberHub(TABLE_4, 1650.0, 0.5, 0.1)
    # held for long, z has died out; tilted at once, z is the tilt
    assert disc_rates(hub, 0.0, 0.02, 0.0, 0.0)[0] == pytest.approx(TABLE_4.L_b * 0.02)
    assert disc_rates(hub, 0.0, 0.02, 0.0, 0.02)[0] == pytest.approx(1.5 * TABLE_4.L_b * 0.02)
    assert disc_rates(hub, 0.0, 0.0, 0.0, 0.02)[5] == pytest.approx(-0.02 / 0.1)


def test_a_sticking_hinge_holds_until_the_cyclic_overcomes_it() -> None:
    table = TABLE_4._replace(A_b=0.0, B_a=0.0)
    for theta, tilt in ((0.002, 0.0), (0.02, 0.016)):
        hub = StickingHinge(table, 1650.0, 0.004)
        b = 0.0
        for _ in range(5000):
            b += 1e-4 * disc_rates(hub, 0.0, b, x=theta / table.B_lat)[3]
        assert b == pytest.approx(tilt, abs=7e-4)


def test_pitt_and_peters_inflow_is_near_the_catalogue_s_form_of_it() -> None:
    hidden = plant_one("inflow_in_wind_axes", 2)
    commands = wiggle(1.5)
    frame = AIRFRAMES["hover-ideal"]
    cause = respond(hidden.build(), "hover-ideal", commands)
    form = InflowDisc(frame.table, frame.nominal_rpm, hidden.expect["k_l"], hidden.expect["tau_l"])
    entry = respond(Parts(rotor=form), "hover-ideal", commands)
    base = respond(Parts(), "hover-ideal", commands)
    assert np.linalg.norm(cause - entry) < 0.45 * np.linalg.norm(cause - base)
    disc = PittPetersDisc(frame.table, frame.nominal_rpm, 0.06, 0.4)
    assert (disc.K, disc.time_s) == pytest.approx((0.417, 0.0218), rel=0.01)


def test_spring_and_offset_hinges_follow_the_speed_each_in_its_way() -> None:
    assert spring_and_offset(0.0)(1.1) == pytest.approx(powers(1.0, 0.0)(1.1))
    assert spring_and_offset(1.0)(1.1) == pytest.approx((1.1, 1.0, 1.21))


# ------------------------------------------------------------------------------------------------ fuselage


def test_a_free_flexible_body_keeps_momentum_and_energy_and_swings_faster_than_a_clamped_one() -> None:
    f, kappa = 6.0, 0.3
    wing = FlexibleWing((f, 0.0, kappa), (f, 0.0, kappa))
    w = 2 * math.pi * f
    s = np.array([0.1, 0, 0, 0, 0, 0, 0.0, -0.1 / kappa, 0.0, 0.0])  # fuselage and wing turn against each other

    def rates(s: Array) -> Array:
        L, M, *own = wing.moments(s.tolist(), 6)
        p_dot, q_dot = wing.accelerations(L, M, 0.0, 0.0, 0.0)
        return np.array([p_dot, q_dot, 0, 0, 0, 0, *own])

    def momentum(s: Array) -> float:
        return float(s[0] + kappa * s[7])

    def energy(s: Array) -> float:
        return float(0.5 * s[0] ** 2 + 0.5 * kappa * s[7] ** 2 + 0.5 * kappa * w**2 * s[6] ** 2)

    start, h, seen = energy(s), 1e-4, []
    assert momentum(s) == pytest.approx(0.0)
    for _ in range(10_000):
        k1 = rates(s)
        k2 = rates(s + h / 2 * k1)
        k3 = rates(s + h / 2 * k2)
        s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(s + h * k3))
        seen.append(s[0])
    assert momentum(s) == pytest.approx(0.0, abs=1e-9)
    assert energy(s) == pytest.approx(start, rel=1e-6)
    crossings = np.flatnonzero(np.diff(np.sign(seen)))
    found = (len(crossings) - 1) / 2 / ((crossings[-1] - crossings[0]) * h)
    assert found == pytest.approx(f * math.sqrt(1 + kappa), rel=1e-3)


def test_a_turned_body_is_euler_s() -> None:
    rng = np.random.default_rng(3)
    for angle in (0.0, 0.2, -0.1):
        body = TurnedInertia(0.641, 0.133, 0.7, angle)
        turn = Rotation.from_euler("z", angle).as_matrix()
        tensor = turn @ np.diag([0.641, 0.133, 0.7]) @ turn.T
        N, rates = rng.normal(size=2), rng.normal(size=3)
        torque = np.array([0.641 * N[0], 0.133 * N[1]]) - np.cross(rates, tensor @ rates)[:2]
        expected = np.linalg.solve(tensor[:2, :2], torque)
        assert body.accelerations(*N.tolist(), *rates.tolist()) == pytest.approx(expected.tolist())


def test_a_flywheel_does_no_work_and_a_thrust_line_follows_late() -> None:
    L, M = HubMomentum(0.4 / 0.641, 0.4 / 0.133).moments([0.3, -0.7], 0)
    assert pytest.approx(0.0) == 0.641 * L * 0.3 + 0.133 * M * -0.7
    hidden = plant_one("thrust_beside_the_centre", 1)
    (lines,) = hidden.build().loads
    lines.hold(Now(0.0, 0.1, 0.0, 0.0, 0.0))
    assert lines.moments([0.0] * 8, 6) == pytest.approx((0, 0, 0.1 / hidden.sizes["lag_s"], 0))
    settled = lines.moments([0.0] * 6 + [0.1, 0.0], 6)
    assert settled[:2] == pytest.approx((0.1 * hidden.expect["L_delta_c"], 0.1 * hidden.expect["M_delta_c"]))


# ------------------------------------------------------------------------------------------------ sensors, conditions


def test_a_turned_chip_shows_the_same_vector_in_its_own_axes() -> None:
    angles = (0.05, -0.1, 0.2)
    chip = RotatedChip(*angles)
    rates = (0.3, -0.5, 0.2)
    seen = chip.step(*rates)
    assert np.linalg.norm(seen) == pytest.approx(float(np.linalg.norm(rates)))
    assert seen == pytest.approx(Rotation.from_euler("XYZ", angles).inv().apply(rates).tolist())


@pytest.mark.parametrize("zeta", [None, 0.4])
def test_a_mount_is_the_filter_that_it_says(zeta: float | None) -> None:
    w, t = 2 * np.pi * 15, np.arange(300) * DT
    rates = np.interp(t, t[::7], np.random.default_rng(1).normal(size=t[::7].size))
    mount = SoftMount(w, zeta, DT)
    seen = [mount.step(value, -value, 0.0) for value in rates.tolist()]
    system = ([w], [1, w]) if zeta is None else ([w * w], [1, 2 * zeta * w, w * w])
    _, expected, _ = signal.lsim(system, np.concatenate([[0.0], rates]), np.arange(301) * DT)
    np.testing.assert_allclose([one[0] for one in seen], expected[1:], atol=1e-9)
    np.testing.assert_allclose([one[1] for one in seen], -expected[1:], atol=1e-9)


def test_the_rotor_sags_under_collective_and_comes_back() -> None:
    drive = Drivetrain((1650.0, 1650.0), 1650.0, "one", DT)
    start = drive.omega
    seen = []
    for _ in range(10_000):
        drive.step(1.3)
        seen.append(drive.omega / start)
    assert 0.96 < min(seen) < 0.995
    assert seen[-1] == pytest.approx(1.0, abs=0.002)
    drive = Drivetrain((1450.0, 1750.0), 1650.0, "two", DT)
    rpm = []
    for _ in range(60_000):
        drive.step(1.0)
        rpm.append(drive.omega * 60 / (2 * math.pi))
    assert 1430 < min(rpm) < 1500
    assert 1700 < max(rpm) < 1770


@pytest.mark.parametrize("plant", ["forward", *thorough(plant for plant in PLANTS if plant != "forward")])
def test_a_lively_flight_moves_everything_and_changes_no_answer(plant: str) -> None:
    vehicle = make_vehicle(plant, 3, condition="lively")
    seen = []
    for _ in range(30_000):
        vehicle.step()
        flown = vehicle.plant
        seen.append((flown.omega * 60 / (2 * math.pi), flown.r, vehicle.commands[3], vehicle.hands.yaw))
    assert vehicle.armed
    rpm, r, collective, yaw = np.array(seen).T
    assert np.ptp(rpm) > 150
    assert 0.2 < r.std() < 0.7
    assert 0.04 < collective.std() < 0.09
    assert 0.15 < yaw.std() < 0.4
    calm, lively = (
        quiet(Rotorcraft(AIRFRAMES[plant], None, STILL, 1, CONDITIONS[name])) for name in ("calm", "lively")
    )
    for x, y, e in wiggle(0.5).tolist():
        calm.step(x, y, e, 0.2)
        lively.step(x, y, e, 0.3, 0.3)
    assert (lively.p, lively.q) == pytest.approx((calm.p, calm.q), rel=1e-12)
    assert lively.omega != calm.omega


def test_a_calm_unhidden_vehicle_is_the_one_it_was() -> None:
    assert isinstance(make_vehicle("hover-ideal", 1).plant, HoverPlant)
    assert isinstance(make_vehicle("forward", 1).plant, ForwardPlant)
    stormy, calm = (make_plant("hover-ideal", 1, gust_scale=scale) for scale in (2.0, 1.0))
    for plant in (stormy, calm):
        plant.step(0.0, 0.0, 0.0, 0.2)
    assert stormy.p == pytest.approx(2 * calm.p)


# ------------------------------------------------------------------------------------------------ draws


def test_equal_seeds_hide_alike_and_every_vehicle_gets_its_own_parts(fly: Fly) -> None:
    for plant, name in EVERY:
        first, again, other = (plant_one(name, seed, plant) for seed in (5, 5, 6))
        assert first == again
        assert first == other if name == "none" else first.sizes != other.sizes
        assert all(math.isfinite(value) for value in first.sizes.values())
    for name in ("three_slow_servos", "worn_links", "rubber_mount", "structural_mode"):
        hidden, flown = plant_one(name, 3), []
        for _ in range(2):
            vehicle = make_vehicle("hover-ideal", 2, hidden=hidden)
            fly(vehicle, 1)
            flown.append((vehicle.gyro, vehicle.commands))
        assert flown[0] == flown[1]


@pytest.mark.parametrize("plant", PLANTS)
def test_random_draws_hide_everything_now_and_then(plant: str) -> None:
    drawn = [draw(seed, plant) for seed in range(600)]
    assert drawn[7] == draw(7, plant)
    counts = Counter(one.level for one in drawn)
    assert counts["none"] / 600 == pytest.approx(NONE_SHARE, abs=0.05)
    assert counts["below"] / 600 > 1 / 3 - 0.04
    assert counts["beyond"] > 50
    assert {one.id for one in drawn} == set(names(plant))
    assert {one.condition for one in drawn} == {"lively"}


def test_scale_makes_it_stronger() -> None:
    def half(name: str, size: str) -> float:
        return plant_one(name, 1, scale=0.5).sizes[size] / plant_one(name, 1).sizes[size]

    assert half("servo_lag", "tau_s") == pytest.approx(0.5)
    assert half("servo_rate_limit", "rate") == pytest.approx(2.0)
    assert half("structural_mode", "kappa_roll") == pytest.approx(0.5)
    assert half("structural_mode", "frequency_roll") == pytest.approx(1.0)


def test_answers_are_the_catalogue_s_and_plausible_there() -> None:
    entries = catalogue()
    for (plant, name), seed in itertools.product(EVERY, range(10)):
        hidden = plant_one(name, seed, plant)
        assert (hidden.answer is None) == (hidden.level in ("beyond", "none"))
        assert set(hidden.accepts) <= set(entries)
        if hidden.answer is None or hidden.answer == "attitude_stiffness":  # which no free flight has
            continue
        parameters = {one.name: one for one in entries[hidden.answer].parameters}
        for parameter, value in hidden.expect.items():
            if parameter in parameters:
                low, high = parameters[parameter].plausible
                assert low <= value <= high, (name, parameter, value)
            else:
                assert parameter == "Z_a", (name, parameter)  # what alpha itself needs


def test_what_cannot_be_hidden_is_said() -> None:
    with pytest.raises(ValueError, match="did you mean servo_lag"):
        plant_one("servo_lagg", 1)
    with pytest.raises(ValueError, match="there are servo_lag, "):
        plant_one("zzz", 1)
    with pytest.raises(ValueError, match="sideslip makes no sense on hover-ideal"):
        plant_one("sideslip", 1)
    with pytest.raises(ValueError, match="nothing can be hidden in hover, but in hover-ideal and forward"):
        plant_one("servo_lag", 1, "hover")
    with pytest.raises(ValueError, match="drawn for forward"):
        make_vehicle("hover-ideal", 1, hidden=plant_one("sideslip", 1, "forward"))
    with pytest.raises(ValueError, match="unknown condition"):
        make_vehicle("hover-ideal", 1, condition="wild")
    with pytest.raises(ValueError, match="hover flies as it is"):
        make_vehicle("hover", 1, condition="lively")


# ------------------------------------------------------------------------------------------------ secrecy


def log_of(hidden: Hidden | None, directory: Path, fly: Fly) -> tuple[Vehicle, Path]:
    directory.mkdir()
    vehicle = make_vehicle("hover-ideal", 4, directory=directory, hidden=hidden, condition="lively")
    fly(vehicle, 1.0)
    vehicle.close()
    (path,) = directory.glob("*.BIN")
    return vehicle, path


def test_the_log_tells_nothing(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    """Kinds, numbers and columns of messages, parameters and texts are those of a vehicle without anything."""

    def shape(path: Path) -> tuple[Any, ...]:
        log = read_log(path)
        kinds = Counter(m.get_type() for m in log)
        texts = [m.Message for m in log if m.get_type() == "MSG"]
        parameters = {m.Name: m.Value for m in log if m.get_type() == "PARM"}
        return kinds, texts, parameters

    clean, clean_path = log_of(None, tmp_path / "clean", fly)
    for name in ("three_slow_servos", "turned_body", "rubber_mount", "stiffening_hub", "offset_hinge"):
        hidden = plant_one(name, 1)
        vehicle, path = log_of(hidden, tmp_path / name, fly)
        assert shape(path) == shape(clean_path)
        for word in (name, hidden.answer, "hidden", *hidden.sizes):
            assert str(word).encode() not in path.read_bytes()
        assert list(vehicle.texts) == list(clean.texts)
        assert vehicle.gyro != clean.gyro


def test_as_a_process_it_seals_before_it_flies_and_overwrites_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight = ["--speed", "max", "--duration", "0.2", "--seed", "5", "-o", str(tmp_path)]
    command = [sys.executable, "-m", "sitl", *flight, "--hidden", "random"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True)
    ready = json.loads(done.stdout)
    assert ready["sealed"]["path"] == str(tmp_path / "answer")
    assert len(ready["sealed"]["sha256"]) == 64
    assert ready["plant"] == "hover-ideal"
    hidden = draw(5)
    for path in tmp_path.iterdir():
        for word in (hidden.id, hidden.answer or "hidden", "sizes"):
            assert word.encode() not in path.read_bytes()
    assert hidden.id not in done.stdout
    for words, said in (
        (["--hidden", "none"], "holds a sealed answer already"),
        (["--hidden", "servo_lga"], "did you mean servo_lag"),
        (["--hidden", "random", "--plant", "hover"], "hover-ideal and forward"),
        (["--condition", "lively", "--plant", "hover"], "flies as it is"),
    ):
        try:
            status = main([*flight, *words])
        except SystemExit as refused:  # argparse
            status = int(refused.code or 0)
        out, err = capsys.readouterr()
        assert (status, out) == (2, ""), words
        assert said in err
        assert "Traceback" not in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["answer", "vehicle-1.BIN"]
