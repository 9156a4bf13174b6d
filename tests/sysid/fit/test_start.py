"""Where fits of a bare base begin: a valley that runs away is left for another where that leaves less."""

from __future__ import annotations

import numpy as np
import pytest
from strangers.asking import _Question as Question
from strangers.flights import fly

from sysid.data.dataset import dataset
from sysid.fit.estimate import estimate
from sysid.fit.start import START_THINNING, start
from sysid.model.paper import TPP

SLOW_GUSTS = 4011962
"""A helicopter of 90 kg that lacks nothing, in a strong loop and slow gusts of 3.4 times the usual."""


def test_a_beginning_that_runs_away_is_not_the_last() -> None:
    flown = fly(SLOW_GUSTS)
    _, _, runs, _, band_hz = Question.of(flown)
    bins = dataset(runs, band_hz, outputs=TPP.outputs).viewed(TPP.inputs)
    thinned = [group.thinned(START_THINNING) for group in bins.stacks]
    assert not start(TPP, thinned, thorough=False).stable
    assert start(TPP, thinned).stable
    found = estimate(TPP, bins)
    truth = flown.plan.vehicle.table
    errors = np.sqrt(np.diag(found.covariance))
    for name, error in zip(TPP.names, errors, strict=True):
        assert found.model[name] == pytest.approx(truth[name], abs=4 * error), name
    assert np.all(found.error.shares < 0.07), "0.16 in the valley that runs away"
