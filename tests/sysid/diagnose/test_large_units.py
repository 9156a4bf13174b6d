"""Parameters of large units, and those without a slope, count as all others."""

from __future__ import annotations

import numpy as np
import planted
import pytest
from planted_fits import records
from strangers.asking import ask
from strangers.flights import fly

from sysid.data.dataset import dataset
from sysid.diagnose import evidence, likely
from sysid.diagnose.evidence import candidate
from sysid.fit.estimate import estimate
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import FloatArray

TWO_POLES_FAR_ABOVE = 4016270
"""A small helicopter in bursts whose servos have two poles at 161 Hz, of which a sweep sees that they are late."""


def test_the_width_of_a_dead_band_counts_as_a_number_that_was_fitted() -> None:
    on = dataset(records(planted.fly("servo_deadband", {"width": 0.02}, seed=31, duration_s=8.0)), (0.0, 15.0))
    parent = candidate(estimate(TPP, on.viewed(TPP.inputs)), (), on)
    composed = compose("tpp", ["servo_deadband"], on.available)
    both = candidate(estimate(composed, on.viewed(composed.inputs)), (), on)
    assert both.jumps == ("width",)
    assert len(both.J[0]) == len(parent.J[0])
    assert both.fitted == parent.fitted + 1


@pytest.mark.thorough
@pytest.mark.parametrize("scaled", [True, False])
def test_poles_far_above_the_sweep_are_not_told_from_a_lag(scaled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """In hertz a frequency far up has 10^-11 of the curvature of a time constant in seconds."""
    if not scaled:
        monkeypatch.setattr(evidence, "scaled_solve", as_it_stands)
    monkeypatch.setattr(likely, "LATE", ())  # forms that explain as much are one class without that
    told = ask(fly(TWO_POLES_FAR_ABOVE)).first
    assert told.effect == "gyro_lag"
    two_poles = {"servo_second_order", "gyro_filter"}  # the same equations
    assert bool(two_poles & set(told.indistinguishable)) == scaled


def as_it_stands(H: FloatArray, g: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(H, g, rcond=1e-10)[0])
