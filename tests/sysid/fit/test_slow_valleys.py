"""A hover's drift is found where the bare base went to what it lacks: its own numbers are then no place to begin."""

from __future__ import annotations

import numpy as np
import pytest
from strangers.asking import records
from strangers.flights import fly

from sysid.data.record import Record
from sysid.fit.identify import identify, on_runs

SEED = 4020851
"""A large helicopter that swings slowly: 10.9 s chirps logged at 100 Hz, in gusts of 3.9 times the usual size."""


@pytest.fixture(scope="module")
def flown() -> tuple[list[Record], dict[str, float]]:
    """The runs to be fitted, and the truth."""
    flight = fly(SEED)
    runs = records(flight)[: flight.plan.fitted]
    return runs, {**flight.plan.vehicle.table, **flight.hidden.sizes[0]}


def test_drift_is_found_from_a_base_that_was_fitted_above_it(flown: tuple[list[Record], dict[str, float]]) -> None:
    runs, truth = flown
    bare = identify(on_runs("tpp", (), runs, runs), runs, band_hz=(0.0, 6.0))
    assert abs(bare.model["L_b"] / truth["L_b"] - 1) > 0.5, "far off without it"
    fit = identify(on_runs("tpp", (), runs, runs), runs, band_hz=(0.0, 6.0), effects=["speed_stability"])
    errors = np.sqrt(np.diag(fit.covariance))
    for name, error in zip(fit.model.structure.names, errors, strict=True):
        assert fit.model[name] == pytest.approx(truth[name], abs=5 * error), name
    assert fit.model["L_b"] == pytest.approx(truth["L_b"], rel=0.1)
