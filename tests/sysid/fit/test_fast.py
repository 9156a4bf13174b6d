"""The quick way through a bare base's fit against the general one: the same optimum and the same errors."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
import random_vehicles
from random_vehicles import A_HAIR, above_the_optimum, flown

from sysid.data.preprocess import spectra
from sysid.data.record import Record
from sysid.data.stacks import stack
from sysid.fit import fast
from sysid.fit.estimate import estimate
from sysid.fit.gauss_newton import minimise
from sysid.fit.output_error import output_error
from sysid.model.paper import CD, TPP
from sysid.model.structure import Model, Structure

Card = tuple[list[Record], list[Record]]


def without_excitation(records: list[Record], keep_s: list[float]) -> list[Record]:
    """Runs of unequal length, and nothing that would make instruments of them."""
    names = ("t", "p", "q", "delta_x", "delta_y")
    return [
        Record(one.id, {name: one.channels[name][one.t < stop] for name in names}, maneuver=one.maneuver, axis=one.axis)
        for one, stop in zip(records, keep_s, strict=True)
    ]


@pytest.mark.parametrize("structure", [TPP, CD])
def test_the_quick_way_ends_where_the_general_way_ends(structure: Structure, hover_card: Card) -> None:
    records = without_excitation(hover_card[0], [32.0, 30.0, 25.5, 28.0])
    (group,) = stack(spectra(records, structure.inputs, structure.outputs)[0])
    quick = fast.fit(structure, group)
    assert quick is not None
    begin = Model(structure, quick.values * 1.02)
    general, _ = minimise(begin, [group], output_error(begin, [group]).residual_power)
    errors = np.sqrt(np.diag(quick.covariance))
    assert np.all(np.abs(quick.values - general.values) < 0.1 * errors)
    from sysid.fit.estimate import _covariance
    from sysid.fit.output_error import axis_weights

    weights = axis_weights([group], output_error(general, [group]).residual_power)
    reference = np.sqrt(np.diag(_covariance(general, [group], weights, range(quick.values.size), None)))
    np.testing.assert_allclose(errors, reference, rtol=0.06)


def test_the_quick_way_is_taken_and_left(ideal_card: Card, monkeypatch: pytest.MonkeyPatch) -> None:
    """It serves a bare base at a high rate; a failure of it costs nothing but time."""
    records = without_excitation(ideal_card[0], [32.0] * 4)
    found = spectra(records, TPP.inputs, TPP.outputs)[0]
    assert fast.applies(TPP, stack(found))
    quick = estimate(TPP, found)
    monkeypatch.setattr(fast, "fit", lambda structure, group: None)
    slow = estimate(TPP, found)
    errors = np.sqrt(np.diag(slow.covariance))
    assert np.all(np.abs(quick.model.values - slow.model.values) < 0.1 * errors)


def test_the_quick_way_reaches_the_optimum_of_random_vehicles(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 500 Hz, where it applies, and in runs long enough that it begins on some of the bins."""
    monkeypatch.setattr(random_vehicles, "EVERY", 1)
    monkeypatch.setattr(random_vehicles, "DURATION_S", 32.0)
    for one in islice(flown(8), 12):
        (group,) = stack(spectra(one.records, TPP.inputs, TPP.outputs)[0])
        assert fast.applies(TPP, [group])
        assert group.z.size >= fast.THINNING * fast.FEWEST_BINS
        assert above_the_optimum(one) < A_HAIR


def test_what_the_quick_way_leaves_is_what_the_model_leaves(hover_card: Card) -> None:
    records = without_excitation(hover_card[0], [32.0, 30.0, 25.5, 28.0])
    for structure in (TPP, CD):
        (group,) = stack(spectra(records, structure.inputs, structure.outputs)[0])
        quick = fast.fit(structure, group)
        assert quick is not None
        general = output_error(Model(structure, quick.values), [group])
        np.testing.assert_allclose(quick.residual_power, general.residual_power, rtol=1e-6)
        np.testing.assert_allclose(quick.measured_power, general.measured_power, rtol=1e-12)
        for one, other in zip(quick.residuals, general.residuals, strict=True):
            assert np.max(np.abs(one - other)) < 1e-5 * np.max(np.abs(other))
