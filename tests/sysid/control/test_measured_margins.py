"""Margins by measured responses, beside the exact ones of the vehicle that was measured."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from planted import TABLE_4
from swept_loops import SWEPT_HZ, sweeps

from sysid.control.judgement import Limits, judge
from sysid.control.measured_margins import NOTHING_MEASURED, MeasuredMargins, measured_margins, with_model
from sysid.control.regulator import Gains, lqr
from sysid.control.robustness import disk_sizes
from sysid.control.sampled import RateController
from sysid.control.stability import crossings_hz, from_rates, rates_per_command, unstable_poles
from sysid.data.record import Record
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model
from sysid.rate_loop.settings import AxisLoop
from sysid.response.flown import flown_responses
from sysid.response.values import Responses

LATE = compose("tpp", ["transport_delay"], TPP.inputs)
VEHICLE = Model(TPP, TPP.vector(dict(TABLE_4)))


def measured(gusts: float, seeds: int = 1, points: int = 40) -> list[Responses]:
    found = []
    for runs in sweeps(seeds, gusts=gusts):
        records = [
            Record(f"#{i}", run, maneuver="chirp", axis=axis, swept_band_hz=SWEPT_HZ)
            for i, (run, axis) in enumerate(zip(runs, ("roll", "pitch"), strict=True))
        ]
        found.append(flown_responses(records, SWEPT_HZ, points=points).responses)
    return found


def margins(gains: Gains, responses: Responses) -> MeasuredMargins:
    found = measured_margins(gains, responses)
    assert found is not None
    return found


@pytest.mark.parametrize("cost", [5.0, 1.0, 0.1])
def test_as_the_exact_margins_on_clean_sweeps(cost: float) -> None:
    gains = lqr(VEHICLE, cost)
    (responses,) = measured(0.0)
    found = margins(gains, responses)
    assert found.phase_deg is not None
    assert found.delay_ms is not None
    assert found.phase_deg.value == pytest.approx(gains.margins.phase_deg, abs=0.5)
    assert found.delay_ms.value == pytest.approx(gains.margins.delay_ms, rel=0.01)
    assert found.gain_db is None, "it is beyond 10 Hz, where nothing was swept"


def test_bounds_hold_in_gusts() -> None:
    gains = lqr(VEHICLE, 1.0)
    z = []
    for responses in measured(0.05, seeds=16, points=20):
        found = margins(gains, responses)
        assert found.phase_deg is not None
        z.append(1.96 * (found.phase_deg.value - gains.margins.phase_deg) / found.phase_deg.bound)
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_a_gain_margin_inside_the_band() -> None:
    """The same gains behind 60 ms more delay, put into what was measured."""
    gains = lqr(VEHICLE, 5.0)
    (responses,) = measured(0.0)
    late = np.exp(-2j * np.pi * responses.frequency_hz * 0.04)
    object.__setattr__(responses, "H", responses.H * late)
    found = margins(gains, responses)
    assert found.delay_ms is not None
    assert found.delay_ms.value == pytest.approx(gains.margins.delay_ms - 40, abs=0.5)
    assert found.gain_db is not None
    assert 0 < found.gain_db.value < gains.margins.gain_db


def test_what_the_model_crosses_beyond_the_band_is_to_be_swept_to() -> None:
    gains = lqr(VEHICLE, 5.0)
    (responses,) = measured(0.0)
    found = with_model(margins(gains, responses), gains, VEHICLE)
    assert found.gain_db is None
    late = Model(LATE, LATE.vector({**TABLE_4, "T_d": 0.0}))
    beyond = max(crossings_hz(gains, VEHICLE)[1])
    assert beyond > found.band_hz[1]
    assert found.sweep_to_hz == pytest.approx(1.25 * beyond, abs=1.0)
    assert found.sweep_to_hz >= 1.25 * beyond
    assert found.unstable_poles == 0
    assert with_model(margins(gains, responses), gains, late).sweep_to_hz == found.sweep_to_hz


def test_a_measured_disk_is_the_model_s_and_its_bound_holds_in_gusts() -> None:
    gains = lqr(VEHICLE, 1.0)
    (clean,) = measured(0.0)
    w = 2 * np.pi * clean.frequency_hz
    seen = margins(gains, clean)
    assert seen.band_hz is not None
    inside = (clean.frequency_hz >= seen.band_hz[0]) & (clean.frequency_hz <= seen.band_hz[1])
    L = from_rates(gains, 1j * w) @ rates_per_command(VEHICLE, 1j * w)
    truth = float(disk_sizes(L[inside]).min())
    assert seen.disk is not None
    assert seen.disk.value == pytest.approx(truth, rel=0.01)
    z = []
    for responses in measured(0.05, seeds=16, points=20):
        found = margins(gains, responses).disk
        assert found is not None
        f = np.array([found.frequency_hz])
        there = from_rates(gains, 2j * np.pi * f) @ rates_per_command(VEHICLE, 2j * np.pi * f)
        z.append(1.96 * (found.value - disk_sizes(there)[0]) / found.bound)
    assert 0.4 < np.sqrt(np.mean(np.square(z))) < 1.6


def test_rate_loops_are_measured_as_well() -> None:
    """ArduPilot's loops over the same sweeps, beside their discrete margins on the vehicle that was swept."""
    law = RateController((AxisLoop(p=0.3, i=0.3, d=0.0),) * 2, 0.0025)
    (responses,) = measured(0.0)
    found = measured_margins(law, responses)
    truth = law.edges(VEHICLE)
    assert found is not None
    assert found.phase_deg is not None
    assert found.phase_deg.value == pytest.approx(truth.margins.phase_deg, abs=1.0)
    assert found.phase_deg.frequency_hz == pytest.approx(truth.phase_hz, rel=0.02)
    with_it = with_model(found, law, VEHICLE)
    assert with_it.unstable_poles == 0
    assert set(with_it.missing) == {name for name in with_it.needed if getattr(found, name) is None}


def test_margins_that_are_needed_and_not_measured_are_a_verdict_of_their_own() -> None:
    gains = lqr(VEHICLE, 5.0)
    (responses,) = measured(0.0)
    limits = Limits(overshoot=9.0, coupling=9.0)
    found = with_model(margins(gains, responses), gains, VEHICLE)
    assert found.missing == ("gain_db",)
    judged = judge(gains, [("fit", VEHICLE)], limits, measured=found)
    assert judged.verdict == "not measured"
    assert judged.refused
    whole = replace(found, missing=())
    assert judge(gains, [("fit", VEHICLE)], limits, measured=whole).verdict == "holds"
    nothing = with_model(NOTHING_MEASURED, gains, VEHICLE)
    assert set(nothing.missing) == set(nothing.needed) == {"gain_db", "phase_deg", "delay_ms"}
    assert nothing.sweep_to_hz is None


def test_unstable_poles_are_those_of_vehicle_and_controller() -> None:
    """An observer that runs away, and a vehicle that does, counted by python-control."""
    gains = lqr(VEHICLE, 5.0)
    wild = replace(gains, K=-20 * gains.K)
    loose = Model(TPP, TPP.vector({**TABLE_4, "A_b": -TABLE_4["A_b"], "L_b": -TABLE_4["L_b"]}))
    for one, vehicle in ((gains, VEHICLE), (wild, VEHICLE), (gains, loose), (wild, loose)):
        A, B, C, D = (np.asarray(x, dtype=float) for x in vehicle.matrices)
        a, b, c, _ = (np.asarray(x, dtype=float) for x in one.model.matrices)
        inner = a - one.observer_gain @ c - b[:, :2] @ one.K
        loop = control.ss(inner, one.observer_gain, one.K, np.zeros((2, 2))) * control.ss(A, B[:, :2], C, D[:, :2])
        assert unstable_poles(one, vehicle) == np.count_nonzero(loop.poles().real > 0)
    assert unstable_poles(wild, VEHICLE) > 0
    assert unstable_poles(gains, loose) > 0


def test_a_measured_margin_that_is_thin_fails_whatever_the_model_says() -> None:
    gains = lqr(VEHICLE, 5.0)
    (responses,) = measured(0.0)
    late = np.exp(-2j * np.pi * responses.frequency_hz * (gains.margins.delay_s - 0.005))
    object.__setattr__(responses, "H", responses.H * late)
    found = margins(gains, responses)
    assert judge(gains, [("fit", VEHICLE)]).verdict == "poor"
    judged = judge(gains, [("fit", VEHICLE)], measured=found)
    assert judged.verdict == "fails"
    assert {"phase_deg", "delay_ms"} <= {one.quantity for one in judged.thin_measured}
    nowhere = MeasuredMargins(band_hz=(0.5, 1.0), phase_deg=None, delay_ms=None, gain_db=None)
    assert judge(gains, [("fit", VEHICLE)], measured=nowhere).verdict == "poor"


def test_nothing_is_said_of_what_was_not_measured_well() -> None:
    gains = lqr(VEHICLE, 5.0)
    (responses,) = measured(3.0)
    assert measured_margins(gains, responses) is None
