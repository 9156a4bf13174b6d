"""A hover's drift is found where the bare base went to what it lacks: its own numbers are then no place to begin."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from strangers.asking import fitted_runs
from strangers.flights import fly

from sysid.data.dataset import Dataset
from sysid.data.record import Record
from sysid.errors import FitError
from sysid.fit.identify import identify, on_runs

SEED = 4020851
"""A large helicopter that swings slowly: 10.9 s chirps logged at 100 Hz, in gusts of 3.9 times the usual size."""


@pytest.fixture(scope="module")
def flown() -> tuple[list[Record], dict[str, float]]:
    """The runs to be fitted, and the truth."""
    flight = fly(SEED)
    runs = fitted_runs(flight)
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


@pytest.mark.parametrize("high_hz", [0.95, 1.05])
def test_a_band_that_ends_where_slow_modes_do_has_no_base_above_them(
    high_hz: float, flown: tuple[list[Record], dict[str, float]]
) -> None:
    runs, _ = flown
    with contextlib.suppress(FitError):  # what so little tells is refused in words
        fit = identify(on_runs("tpp", (), runs, runs), runs, band_hz=(0.0, high_hz), effects=["attitude_stiffness"])
        assert np.all(np.isfinite(fit.model.values))


def test_bins_above_a_frequency_are_those_of_the_runs_that_have_any(
    flown: tuple[list[Record], dict[str, float]],
) -> None:
    (group,) = Dataset(records=tuple(flown[0]), band_hz=(0.0, 6.0)).stacks
    above = group.above(1.0)
    assert above.frequency_hz.min() >= 1.0
    assert above.U.shape[1] == above.Y.shape[1] == above.scale.size == np.sum(group.frequency_hz >= 1.0)
    for part, whole in zip(above.slices, group.slices, strict=True):
        np.testing.assert_array_equal(above.Y[:, part], group.Y[:, whole][:, group.frequency_hz[whole] >= 1.0])
    assert group.above(7.0).spectra == ()
