"""Margins by measured responses, beside the exact ones of the vehicle that was measured."""

from __future__ import annotations

import numpy as np
import pytest
from planted import TABLE_4
from swept_loops import SWEPT_HZ, sweeps

from sysid.control.measured_margins import MeasuredMargins, measured_margins
from sysid.control.regulator import Gains, lqr
from sysid.data.record import Record
from sysid.model.paper import TPP
from sysid.model.structure import Model
from sysid.response.flown import flown_responses
from sysid.response.values import Responses

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


def test_nothing_is_said_of_what_was_not_measured_well() -> None:
    gains = lqr(VEHICLE, 5.0)
    (responses,) = measured(3.0)
    assert measured_margins(gains, responses) is None
