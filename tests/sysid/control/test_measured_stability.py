"""Gains in the loop with measured responses: what is cleared or refused, beside the vehicle's own eigenvalues."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from more_of_a_kind import thorough
from planted import DT, TABLE_4
from scipy.linalg import expm
from shadow_vehicles import Bank, Vehicle, bank, good, growth, swept, vehicle
from swept_loops import SWEPT_HZ, sweeps, truth

from sysid.control.judgement import Limits
from sysid.control.measured_stability import MeasuredStability, measured_stability, perron
from sysid.control.regulator import Gains, lqr
from sysid.control.stability import ClosedLoop
from sysid.data.record import Record
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model
from sysid.response.flown import flown_responses
from sysid.response.values import Responses

VEHICLE = Model(TPP, TPP.vector(dict(TABLE_4)))


def responses(runs: list[dict[str, Any]], band_hz: tuple[float, float] = SWEPT_HZ, without: str = "") -> Responses:
    records = [
        Record(
            f"#{k}",
            {name: run[name] for name in run if not (without and name.startswith(without))},
            maneuver="chirp",
            axis=axis,
            swept_band_hz=band_hz,
        )
        for k, (run, axis) in enumerate(zip(runs, ("roll", "pitch"), strict=False))
    ]
    return flown_responses(records, band_hz).responses


@pytest.fixture(scope="module")
def clean() -> Responses:
    return responses(sweeps(1)[0])


def judged(gains: Gains, measured: Responses, **changes: Any) -> MeasuredStability:
    return measured_stability(gains, VEHICLE, measured, Limits(**changes))


def late(measured: Responses, seconds: float) -> Responses:
    return replace(measured, H=measured.H * np.exp(-2j * np.pi * measured.frequency_hz * seconds))


def why(found: MeasuredStability) -> set[str]:
    return {one.why for one in found.not_measured}


def test_the_paper_s_gains_are_cleared_on_the_paper_s_sweeps(clean: Responses) -> None:
    found = judged(lqr(VEHICLE, 5.0), clean)
    assert (found.verdict, found.roots, found.unstable_poles) == ("cleared", 0, 0)
    assert found.disk is not None
    assert found.disk.low <= found.disk.margin.size <= found.disk.high
    document = found.to_json()
    assert document["verdict"] == "cleared"
    assert 0 <= document["bound"] < 1


@pytest.mark.parametrize(("delay_s", "roots"), [(0.015, 0), (0.045, 0), (0.052, 2), (0.080, 2)])
def test_roots_are_counted_where_a_delay_uses_up_the_margin(clean: Responses, delay_s: float, roots: int) -> None:
    """The exact delay margin is 48 ms; behind it one pair goes over."""
    gains = lqr(VEHICLE, 5.0)
    assert 0.046 < gains.margins.delay_s < 0.050
    found = judged(gains, late(clean, delay_s))
    assert found.roots == roots
    assert found.verdict == ("refused" if roots or delay_s > 0.02 else "cleared")


def test_an_open_loop_that_is_unstable_turns_as_often(clean: Responses) -> None:
    """A controller that runs away by itself and yet holds the vehicle, or not: by the eigenvalues of both together."""
    gains = lqr(VEHICLE, 5.0)
    A, B, C, _ = (np.asarray(x, dtype=float) for x in VEHICLE.matrices)
    seen = set()
    for times in (-20.0, -3.0, -0.5, 0.5, 3.0):
        one = replace(gains, K=times * gains.K)
        L, K = one.observer_gain, one.K
        whole = np.block([[A, -B @ K], [L @ C, A - L @ C - B @ K]])
        right = int(np.count_nonzero(np.linalg.eigvals(whole).real > 0))
        found = judged(one, clean)
        seen.add((found.unstable_poles > 0, right > 0))
        assert found.roots in (right, None)
        assert found.verdict != "cleared" or right == 0
        assert found.roots is not None or "edge" in why(found) or "low" in why(found)
    assert (True, True) in seen
    assert (False, False) in seen


def test_a_sweep_that_ends_too_early_is_asked_to_go_on() -> None:
    gains = lqr(VEHICLE, 0.3)
    runs = sweeps(1)[0]
    found = judged(gains, responses(runs, (0.5, 5.0)))
    assert found.verdict == "not measured"
    (edge,) = (one for one in found.not_measured if one.why == "edge")
    assert edge.sweep_to_hz is not None
    assert edge.sweep_to_hz > 5.0
    assert judged(lqr(VEHICLE, 100.0), responses(runs, (0.5, 8.0))).verdict == "cleared"


def test_noise_that_reaches_minus_one_clears_nothing(clean: Responses) -> None:
    found = judged(lqr(VEHICLE, 5.0), replace(clean, error=clean.error + 0.3 * np.abs(clean.H)))
    assert found.verdict == "not measured"
    assert "bound" in why(found) or "edge" in why(found)


def test_a_model_of_another_vehicle_does_not_stand_below_the_sweeps(clean: Responses) -> None:
    other = Model(TPP, TPP.vector({**TABLE_4, "A_lat": -TABLE_4["A_lat"], "B_lat": -3 * TABLE_4["B_lat"]}))
    found = measured_stability(lqr(VEHICLE, 2.0), other, clean, Limits())
    assert found.verdict == "not measured"
    assert "low" in why(found)


def test_one_axis_or_no_excitation_in_the_log_clears_nothing(clean: Responses) -> None:
    gains, runs = lqr(VEHICLE, 5.0), sweeps(1)[0]
    alone = judged(gains, responses(runs[:1]))
    assert (alone.verdict, why(alone), alone.loop) == ("not measured", {"axes"}, None)
    assert "excitation" in why(judged(gains, responses(runs, without="excitation")))
    assert judged(gains, replace(clean, outputs=("p", "r"))).verdict == "not measured"


def test_a_margin_less_than_asked_refuses_and_one_within_its_error_does_neither(clean: Responses) -> None:
    gains = lqr(VEHICLE, 5.0)
    phase = judged(gains, clean).margins
    assert phase is not None
    assert phase.phase_deg is not None
    value = phase.phase_deg.value
    assert judged(gains, clean, phase_deg=value + 5).verdict == "refused"
    noisy = replace(clean, error=clean.error + 0.03 * np.abs(clean.H))
    near = judged(gains, noisy, phase_deg=value + 0.5)
    assert (near.verdict, why(near)) == ("not measured", {"near"})


def test_of_the_delay_that_the_model_has_half_as_much_is_asked(clean: Responses) -> None:
    structure = compose("tpp", ["transport_delay"], TPP.inputs)
    slow = Model(structure, structure.vector({**TABLE_4, "T_d": 0.03}))
    found = measured_stability(lqr(VEHICLE, 5.0), slow, late(clean, 0.036), Limits(phase_deg=1.0, gain_db=0.1))
    assert {(one.quantity, one.limit) for one in found.thin} == {("delay_ms", 15.0)}


def test_perron_roots_bound_what_any_phases_make() -> None:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((200, 2, 2)) + 1j * rng.standard_normal((200, 2, 2))
    largest = np.max(np.abs(np.linalg.eigvals(x)), axis=1)
    assert np.all(largest <= perron(np.abs(x)) + 1e-12)
    np.testing.assert_allclose(perron(np.abs(x)), np.max(np.abs(np.linalg.eigvals(np.abs(x))), axis=1))


def of_bank(one: Bank) -> Gains:
    model = Model(TPP, TPP.vector(one.model))
    none = np.zeros(4)
    return Gains(
        model=model, K=one.K, observer_gain=one.L, prefilter=one.prefilter, poles=none, observer_poles=none,
        input_cost=1.0, loop=ClosedLoop(None),
    )  # fmt: skip


def verdicts(flies: Vehicle, rng: np.random.Generator, stop_hz: float, draws: int) -> Mapping[str, list[str]]:
    measured = responses(swept(flies, rng, stop_hz=stop_hz), (0.5, stop_hz))
    found: dict[str, list[str]] = {"destabilising": [], "good": []}
    for _ in range(draws):
        one = bank(flies.numbers, rng)
        kind = "destabilising" if growth(flies, one) >= 0 else "good" if good(flies, one) else ""
        if kind:
            gains = of_bank(one)
            found[kind].append(measured_stability(gains, gains.model, measured, Limits(), DT).verdict)
    return found


@pytest.mark.parametrize("late_by", ["delay and servo", *thorough(["delay", "servo", "second-order servo"])])
def test_on_late_vehicles_no_destabilising_set_is_cleared(late_by: str) -> None:
    """The study's question (`tests/study/study_shadow.py`) on a few."""
    rng = np.random.default_rng(31)
    found = verdicts(vehicle(rng, late_by), rng, 20.0, 24)
    assert found["destabilising"]
    assert found["good"]
    assert "cleared" not in found["destabilising"]
    assert "refused" in found["destabilising"]
    assert "refused" not in found["good"]
    assert "cleared" in found["good"]


def loops_on_board(gains: Gains, loop_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues of vehicle and controller over one loop, and of the controller alone, written out here."""
    A, B, C, _ = (np.asarray(x, dtype=float) for x in VEHICLE.matrices)

    def held(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n, m = b.shape
        power = expm(loop_s * np.block([[a, b], [np.zeros((m, n + m))]]))
        return power[:n, :n], power[:n, n:]

    L, K = gains.observer_gain, gains.K
    a, b = held(A - L @ C, np.hstack([B[:, :2], L]))
    Ad, Bd = held(A, B[:, :2])
    alone = a - b[:, :2] @ K
    return np.linalg.eigvals(np.block([[Ad, -Bd @ K], [b[:, 2:] @ C, alone]])), np.linalg.eigvals(alone)


@pytest.mark.parametrize("times", [1.0, 4.0])
def test_roots_are_those_of_the_loops_on_board(clean: Responses, times: float) -> None:
    """The same gains in slower and slower loops, until these no longer hold the vehicle."""
    gains = replace(lqr(VEHICLE, 5.0), K=times * lqr(VEHICLE, 5.0).K)
    exact = replace(clean, H=truth(clean.frequency_hz))
    seen = set()
    for loop_s in (0.002, 0.005, 0.01, 0.02, 0.03, 0.04):
        whole, alone = (np.abs(x) for x in loops_on_board(gains, loop_s))
        found = measured_stability(gains, VEHICLE, exact, Limits(gain_db=0.1, phase_deg=0.1, delay_ms=0.1), loop_s)
        assert found.unstable_poles == np.count_nonzero(alone > 1)
        assert found.roots in (np.count_nonzero(whole > 1), None)
        assert found.verdict != "cleared" or not np.any(whole > 1)
        seen.add((found.roots is not None, bool(np.any(whole > 1))))
    assert any(counted for counted, _ in seen)
    assert any(unstable for _, unstable in seen)
