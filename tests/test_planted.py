"""The independent integrator checked against itself, the matrix exponential, and answers known by hand."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import planted
import pytest
from numpy.typing import NDArray
from planted import DT, FORWARD, NULLS, PLANTED, TABLE_4, TABLE_5, TRIM, fly, fly_many, respond
from scipy.linalg import expm

Array = NDArray[np.float64]
KINDS = {
    *("dynamic_inflow", "elevator", "gyro_misalignment", "hub_gyroscopics", "quadratic_damping", "rotor_speed"),
    *("second_order_flapping", "servo_backlash", "servo_lag", "structural_mode", "transport_delay"),
}
"""Rotor, body, actuator, sensor: those that most tests fly."""
CHANNELS = {"t", "p", "q", "r", "delta_x", "delta_y", "delta_e", "delta_c", "delta_r", "omega", "phi", "theta"}


def of_each_kind(effects: Iterable[str]) -> list[Any]:
    return [pytest.param(effect, marks=() if effect in KINDS else pytest.mark.thorough) for effect in effects]


def difference(one: list[planted.Run], other: list[planted.Run]) -> float:
    """The larger of p's and q's, root mean square over root mean square."""
    return max(
        float(
            np.linalg.norm(np.concatenate([a[name] - b[name] for a, b in zip(one, other, strict=True)]))
            / np.linalg.norm(np.concatenate([b[name] for b in other]))
        )
        for name in "pq"
    )


def wiggle(seconds: float = 3.0) -> Array:
    """Commands (n, 3) that move every axis at once and jump."""
    t = np.arange(round(seconds / DT)) * DT
    x = 0.1 * np.sin(7 * t) + 0.05 * np.sign(np.sin(3 * t))
    y = 0.12 * np.sin(13 * t + 1) - 0.04 * np.sign(np.sin(5 * t))
    return np.stack([x, y, 0.2 * np.sin(9 * t)], axis=1)


def step_of(delta_x: float = 0.0, delta_y: float = 0.0, delta_e: float = 0.0, seconds: float = 8.0) -> Array:
    return np.repeat([[delta_x, delta_y, delta_e]], round(seconds / DT), axis=0)


def modes(A: Array) -> list[tuple[float, float]]:
    poles = sorted((pole for pole in np.linalg.eigvals(A) if pole.imag > 1e-6), key=abs)
    return [(abs(pole) / (2 * math.pi), -pole.real / abs(pole)) for pole in poles]


def linear_part(effect: str | None, forward: bool = False) -> tuple[list[str], Array, Array]:
    """States, A and B (x, y, e) of the rows, without the attitude."""
    rows = planted.equations(effect, PLANTED.get(effect or "", {}), forward).rows
    states = [name for name in rows if name not in ("phi", "theta")]
    A = np.array([[rows[row].get(name, 0.0) for name in states] for row in states])
    B = np.array([[rows[row].get(name, 0.0) for name in "xye"] for row in states])
    return states, A, B


def test_it_imports_none_of_what_it_judges() -> None:
    tree = ast.parse(Path(planted.__file__).read_text("utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    allowed = {"__future__", "math", "collections", "dataclasses", "types", "numpy", "scipy"}
    assert {name.split(".")[0] for name in names} == allowed


def test_the_base_has_the_paper_s_modes() -> None:
    assert modes(linear_part(None)[1]) == [
        pytest.approx((1.634, 0.390), abs=2e-3),
        pytest.approx((5.029, 0.221), abs=2e-3),
    ]
    forward = modes(linear_part(None, forward=True)[1])
    assert forward == [pytest.approx((1.762, 0.454), abs=2e-3), pytest.approx((4.622, 0.221), abs=2e-3)]


def test_exact_flapping_has_the_modes_worked_out_for_it() -> None:
    low, high = modes(linear_part("second_order_flapping")[1])[:2]
    assert low == pytest.approx((1.62, 0.425), rel=0.015)
    assert high == pytest.approx((4.87, 0.219), rel=0.015)


@pytest.mark.parametrize("effect", [None, "servo_second_order", "structural_mode", "dynamic_inflow", "sideslip"])
def test_linear_rows_are_integrated_as_the_matrix_exponential_has_them(effect: str | None) -> None:
    forward = effect in FORWARD
    states, A, B = linear_part(effect, forward)
    U = wiggle()
    block = np.zeros((len(A) + 3, len(A) + 3))
    block[: len(A), : len(A)], block[: len(A), len(A) :] = A * DT, B * DT
    power = expm(block)[: len(A)]
    x, exact = np.zeros(len(A)), np.empty((len(U), 2))
    for k, u in enumerate(U):
        exact[k] = x[[states.index("p"), states.index("q")]]
        x = power @ np.concatenate([x, u])
    found = respond(effect, PLANTED.get(effect or "", {}), U, forward=forward)
    np.testing.assert_allclose(np.stack([found["p"], found["q"]], axis=1), exact, atol=1e-7)


@pytest.mark.parametrize("effect", of_each_kind(sorted(NULLS)))
def test_at_its_null_an_effect_is_not_there(effect: str) -> None:
    forward = effect in FORWARD
    null = NULLS[effect]
    base = fly("elevator", {"M_elev": 0.0}, seed=1, duration_s=2.0, forward=True) if effect == "elevator" else None
    if base is None:
        base = fly(None, {}, seed=1, duration_s=2.0, forward=forward)
    assert difference(fly(effect, null, seed=1, duration_s=2.0, forward=forward), base) < 1e-7, (
        "steps are half as long where nothing is planted"
    )
    assert difference(fly(effect, PLANTED[effect], seed=1, duration_s=2.0, forward=forward), base) > 1e-3


def test_fast_lags_fade_into_the_base() -> None:
    base = fly(None, {}, seed=2, duration_s=2.0)
    for effect, slow, fast in (
        ("servo_lag", {"tau_s": 0.01}, {"tau_s": 0.001}),
        ("servo_second_order", {"frequency": 20.0, "zeta": 0.7}, {"frequency": 200.0, "zeta": 0.7}),
        ("gyro_lag", {"tau_g": 0.01}, {"tau_g": 0.001}),
    ):
        far, near = (difference(fly(effect, size, seed=2, duration_s=2.0), base) for size in (slow, fast))
        assert near < 0.15 * far < 0.1


@pytest.mark.parametrize("effect", [None, *of_each_kind(PLANTED)])
def test_half_the_step_changes_nothing(effect: str | None) -> None:
    """Open loop with jumping commands and everything else moving; Runge-Kutta converges far below any noise."""
    U = wiggle()
    t = np.arange(len(U)) * DT
    others = {
        "r": 0.8 * np.sin(4 * t),
        "omega": planted.NOMINAL_OMEGA * (1 + 0.05 * np.sin(t)),
        "airspeed": 18 + np.sin(t),
        "delta_c": 0.2 + 0.1 * np.sin(6 * t),
        "delta_r": 0.1 * np.sin(8 * t),
    }
    runs = [
        respond(effect, PLANTED.get(effect or "", {}), U, forward=effect in FORWARD, steps=steps, **others)
        for steps in (planted.STEPS, 2 * planted.STEPS)
    ]
    by_its_mean = effect in ("servo_rate_limit", "servo_acceleration_limit")  # over a step
    tolerance = 2e-5 if by_its_mean else 2e-7
    assert difference(runs[:1], runs[1:]) < tolerance


def test_the_base_settles_where_the_disc_is_level() -> None:
    """p_dot = q_dot = 0 asks for a = b = 0; the flapping rows leave p = theta_c/tau_f, q = theta_s/tau_f."""
    found = respond(None, {}, step_of(0.1, -0.05))
    tau = TABLE_4["tau_f"]
    assert found["p"][-1] == pytest.approx((TABLE_4["B_lat"] * 0.1 - TABLE_4["B_lon"] * 0.05) / tau, rel=1e-6)
    assert found["q"][-1] == pytest.approx((TABLE_4["A_lat"] * 0.1 - TABLE_4["A_lon"] * 0.05) / tau, rel=1e-6)
    assert found["state a"][-1] == pytest.approx(0.0, abs=1e-9)


def test_damping_is_carried_by_the_disc() -> None:
    size = PLANTED["angular_damping"]
    found = respond("angular_damping", size, step_of(0.1))
    assert TABLE_4["L_b"] * found["state b"][-1] == pytest.approx(-size["L_p"] * found["p"][-1], rel=1e-6)
    assert TABLE_4["M_a"] * found["state a"][-1] == pytest.approx(-size["M_q"] * found["q"][-1], rel=1e-6)
    found = respond("quadratic_damping", PLANTED["quadratic_damping"], step_of(0.1))
    p = found["p"][-1]
    assert TABLE_4["L_b"] * found["state b"][-1] == pytest.approx(3.0 * p * abs(p), rel=1e-6)


def test_the_elevator_pitches_by_the_rotor_s_resistance() -> None:
    """0 = M_q q + M_a a + M_elev e and 0 = L_p p + L_b b, with both flapping rows at rest."""
    found = respond(None, {}, step_of(delta_e=0.2), forward=True)
    p, q, a, b = (found[name][-1] for name in ("p", "q", "state a", "state b"))
    T = TABLE_5
    assert T["M_q"] * q + T["M_a"] * a == pytest.approx(-T["M_elev"] * 0.2, rel=1e-6)
    assert b == pytest.approx(-T["L_p"] * p / T["L_b"], rel=1e-6)
    assert q == pytest.approx((-a + T["A_b"] * b) / T["tau_f"], rel=1e-6)


def test_steady_states_of_the_states_that_effects_bring() -> None:
    size = PLANTED["dynamic_inflow"]
    found = respond("dynamic_inflow", size, step_of(0.1))
    theta_s = TABLE_4["A_lat"] * 0.1
    assert found["state l_s"][-1] == pytest.approx(size["k_l"] * theta_s, rel=1e-6)  # a is zero
    assert found["q"][-1] == pytest.approx((1 - size["k_l"]) * theta_s / TABLE_4["tau_f"], rel=1e-6)
    found = respond("structural_mode", PLANTED["structural_mode"], step_of(0.1))
    assert found["state e_p"][-1] == pytest.approx(0.0, abs=1e-7)
    found = respond("angle_of_attack", PLANTED["angle_of_attack"], step_of(0.0, 0.05), forward=True)
    assert found["state alpha"][-1] == pytest.approx(found["q"][-1] / 2.0, rel=1e-4)
    found = respond("gyro_misalignment", {"e": 0.1}, step_of(0.1))
    assert found["p"][-1] == pytest.approx(found["state p"][-1] + 0.1 * found["state q"][-1], rel=1e-12)


def test_coupling_by_inertia_solves_the_body_s_own_equation() -> None:
    """I p_dot with the product of inertia on the other side: p_dot - c_p q_dot is the uncoupled moment."""
    c_p = 0.05
    c_q = c_p * TABLE_4["M_a"] / TABLE_4["L_b"]
    coupled = planted.equations("inertia_coupling", {"c_p": c_p}, False).rows
    base = planted.equations(None, {}, False).rows
    for name in ("a", "b", "gust_p", "gust_q"):
        p, q = coupled["p"].get(name, 0.0), coupled["q"].get(name, 0.0)
        assert p - c_p * q == pytest.approx(base["p"].get(name, 0.0), abs=1e-9)
        assert q - c_q * p == pytest.approx(base["q"].get(name, 0.0), abs=1e-9)


def test_yaw_turns_the_rates() -> None:
    """Without rotor forces a planar body's p and q would turn at r; with them both axes feel the other one's rate."""
    U = step_of(0.1, seconds=6.0)
    r = np.full(len(U), 0.5)
    found = respond("yaw_coupling", {"k_p": -1.0, "k_q": 1.0}, U, r=r)
    p, q, a, b = (found[name][-1] for name in ("p", "q", "state a", "state b"))
    assert TABLE_4["L_b"] * b == pytest.approx(q * 0.5, rel=1e-5)
    assert TABLE_4["M_a"] * a == pytest.approx(-p * 0.5, rel=1e-5)


def test_rotor_speed_and_airspeed_change_the_steady_state_by_their_law() -> None:
    """Two speeds, half a flight each: the mean in between is the reference."""
    U = step_of(0.1, seconds=12.0)
    first = np.arange(len(U)) < len(U) // 2
    omega = np.where(first, 150.0, 190.0)
    found = respond("rotor_speed", {"k": 1.0, "n": 0.5}, U, omega=omega)
    for k, speed in ((len(U) // 2 - 1, 150.0), (-1, 190.0)):
        assert found["p"][k] == pytest.approx(TABLE_4["B_lat"] * 0.1 / TABLE_4["tau_f"] * speed / 170.0, rel=1e-5)
    U = step_of(0.0, 0.0, 0.2, seconds=12.0)
    found = respond("airspeed_scaling", {"m": 1.0}, U, forward=True, airspeed=np.where(first, 16.0, 20.0))
    for k, ratio in ((len(U) // 2 - 1, 16 / 18), (-1, 20 / 18)):
        moment = TABLE_5["M_q"] * ratio * found["q"][k] + TABLE_5["M_a"] * found["state a"][k]
        assert moment == pytest.approx(-TABLE_5["M_elev"] * ratio**2 * 0.2, rel=1e-5)


def test_actuators_do_to_a_command_what_their_sentence_says() -> None:
    def acting(effect: str, size: dict[str, float], commands: list[float]) -> list[float]:
        """The mean acting roll command of each sample."""
        actuator = planted._Actuators(effect, size, np.zeros((3, 1)))
        found = []
        for command in commands:
            pieces = actuator.pieces(np.array([[command], [0.0], [0.0]]), 4)
            assert sum(length for length, _ in pieces) == pytest.approx(DT)
            found.append(sum(length * float(value[0, 0]) for length, value in pieces) / DT)
        return found

    assert acting("servo_saturation", {"limit": 0.1}, [0.05, 0.3, -0.3]) == pytest.approx([0.05, 0.1, -0.1])
    assert acting("servo_deadband", {"width": 0.01}, [0.009, 0.02, 0.012, 0.005]) == pytest.approx(
        [0, 0.02, 0.02, 0.005]
    )
    assert acting("servo_backlash", {"half_width": 0.01}, [0.03, 0.02, 0.0, 0.03]) == pytest.approx(
        [0.02, 0.02, 0.01, 0.02]
    )
    assert acting("transport_delay", {"T_d": 0.005}, [1.0, 2.0, 3.0, 4.0]) == pytest.approx([0, 0, 0.5, 1.5])
    assert acting("transport_delay", {"T_d": 0.004}, [1.0, 2.0, 3.0]) == pytest.approx([0, 0, 1.0])
    # 0.01 a sample: half of it on average, and the second sample arrives half-way
    assert acting("servo_rate_limit", {"rate": 5.0}, [0.015, 0.015, 0.015]) == pytest.approx([0.005, 0.01375, 0.015])
    # from 0.16 the root falls by 0.02 a sample of 0.002 s: 0.38^2 and 0.36^2 are left
    braked = acting("servo_acceleration_limit", {"acceleration": 200.0}, [0.16, 0.16])
    assert braked == pytest.approx([0.16 - (0.4**3 - 0.38**3) / 0.06, 0.16 - (0.38**3 - 0.36**3) / 0.06], abs=1e-6)
    ring = planted._Actuators("servo_saturation", {"limit": 0.1}, np.zeros((3, 1)))
    (_, value), *_ = ring.pieces(np.array([[0.3], [0.4], [0.5]]), 4)
    assert value[:, 0] == pytest.approx([0.06, 0.08, 0.1])


@pytest.mark.parametrize("effect", [None, "rotor_speed", "airspeed_scaling"])
def test_blocks_of_samples_are_those_integrated_one_by_one(effect: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is nonlinear here; blocks end within the flight, and so do the parts that are in memory together."""
    monkeypatch.setattr(planted, "PART", 700)
    size, forward = PLANTED.get(effect or "", {}), effect in FORWARD
    together = fly(effect, size, seed=9, duration_s=1.0, forward=forward)
    monkeypatch.setattr(planted._Actuators, "pass_on", False)
    for one, other in zip(together, fly(effect, size, seed=9, duration_s=1.0, forward=forward), strict=True):
        for name, values in one.items():
            np.testing.assert_allclose(values, other[name], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("effect", [None, "yaw_coupling"])
def test_commands_end_at_their_stops(effect: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the loop, too: the bare vehicle answers what was logged as the flight did."""
    monkeypatch.setattr(planted, "SIZES", dict.fromkeys(planted.SIZES, 1.2))
    size = PLANTED.get(effect or "", {})
    for run in fly(effect, size, seed=6, gusts=0.0, noise=0.0, duration_s=2.0)[:2]:
        commands = np.stack([run[f"delta_{letter}"] for letter in "xye"], axis=1)
        assert np.abs(commands).max() == 1.0
        alone = respond(effect, size, commands - TRIM, r=run["r"])
        for name in "pq":
            np.testing.assert_allclose(run[name], alone[name], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("forward", [False, True])
def test_a_flight_holds_the_contract_s_channels_and_table_1_s_chirps(forward: bool) -> None:
    runs = fly(None, {}, seed=5, duration_s=6.0, forward=forward)
    excitations = [f"excitation_{letter}" for letter in "xye"]
    assert len(runs) == len(planted.axes(forward)) == (6 if forward else 4)
    for run, axis in zip(runs, planted.axes(forward), strict=True):
        assert set(run) == CHANNELS | set(excitations) | ({"airspeed"} if forward else set())
        assert all(values.shape == (4000,) and np.all(np.isfinite(values)) for values in run.values())
        np.testing.assert_allclose(np.diff(run["t"]), DT, atol=1e-12)
        power = {name: float(run[name].std()) for name in excitations}
        assert max(power, key=power.__getitem__) == "excitation_" + {"roll": "x", "pitch": "y", "elevator": "e"}[axis]
        assert not np.any(run["excitation_x"][:500])
        assert np.abs(run["p"]).max() < 3
        assert np.abs(run["phi"]).max() < 0.4
        assert run["delta_x"].mean() == pytest.approx(TRIM[0], abs=0.02)
    noise = runs[0]["excitation_y"][500:3500]
    assert noise.std() == pytest.approx(0.2 * 0.10 * 0.243, rel=0.1)
    wave = planted.chirp(0.1, 30.0)
    crossings = np.flatnonzero(np.diff(np.sign(wave))) * DT
    assert 0.5 / np.diff(crossings)[0] == pytest.approx(0.5, rel=0.03)
    assert 0.5 / np.diff(crossings)[-5:].mean() == pytest.approx(10.0, rel=0.03)


def test_noise_and_gusts_can_be_switched_off_and_seeds_differ() -> None:
    quiet, same, gusty = (fly(None, {}, seed=3, duration_s=2.0, noise=0.0, gusts=gusts) for gusts in (0.0, 0.0, 1.0))
    assert difference(quiet, same) == 0.0
    assert not np.any(quiet[0]["p"][:500])
    assert 0.005 < difference(gusty, quiet) < 0.5
    assert difference(fly(None, {}, seed=4, duration_s=2.0, noise=0.0, gusts=0.0), quiet) > 0.01


@pytest.mark.parametrize("effect", ["servo_backlash", "rotor_speed"])
def test_side_by_side_is_one_by_one(effect: str) -> None:
    together = fly_many(effect, PLANTED[effect], seeds=[7, 8], duration_s=2.0)
    for seed, flight in zip((7, 8), together, strict=True):
        alone = fly(effect, PLANTED[effect], seed=seed, duration_s=2.0)
        for one, other in zip(flight, alone, strict=True):
            for name, values in one.items():
                np.testing.assert_allclose(values, other[name], rtol=1e-9, atol=1e-12)


def test_vanes_are_logged_where_they_are_wanted() -> None:
    size = PLANTED["disc_incidence"]
    assert "alpha" in fly("disc_incidence", size, seed=1, duration_s=1.0, forward=True)[0]
    size = PLANTED["angle_of_attack"]
    assert "alpha" not in fly("angle_of_attack", size, seed=1, duration_s=1.0, forward=True)[0]
    assert "alpha" in fly("angle_of_attack", size, seed=1, duration_s=1.0, forward=True, vanes=True)[0]


def test_what_does_not_exist_is_refused() -> None:
    with pytest.raises(KeyError):
        fly("ghost", {}, seed=1)
    with pytest.raises(KeyError, match="k_l, tau_l"):
        fly("dynamic_inflow", {"k_l": 0.3}, seed=1)
