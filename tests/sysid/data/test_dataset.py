"""Runs are prepared once, whoever asks for them, and what is handed out is what a preparation of one's own gives."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import sysid.data.dataset
import sysid.data.preprocess
from gcs.analysis.fits import assess, identify_flight
from sysid.compare.compare import compare
from sysid.data.dataset import Dataset, prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ, spectra
from sysid.data.record import Record
from sysid.errors import FitError
from sysid.fit.identify import identify, judge
from sysid.fit.result import Fit
from sysid.model.paper import TPP

Card = tuple[list[Record], list[Record]]
INPUTS = ("delta_x", "delta_y")


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often a run was cut into pieces, and how many channels of pieces were transformed."""
    counted: Counter[str] = Counter()
    cut, transform = sysid.data.dataset.pieces, sysid.data.preprocess.spectrum

    def pieces(record: Record, band_hz: tuple[float, float]):  # type: ignore[no-untyped-def]
        counted["pieces"] += 1
        return cut(record, band_hz)

    def spectrum(segment, inputs, outputs, band_hz, known):  # type: ignore[no-untyped-def]
        counted["transformed"] += len({*inputs, *outputs} - known.keys())
        return transform(segment, inputs, outputs, band_hz, known)

    monkeypatch.setattr(sysid.data.dataset, "pieces", pieces)
    monkeypatch.setattr(sysid.data.preprocess, "spectrum", spectrum)
    return counted


def test_two_models_their_judgement_and_a_comparison_prepare_every_run_once(
    ideal_card: Card, calls: Counter[str]
) -> None:
    chirps, doublets = ideal_card
    fitted, judging = prepared(chirps, DEFAULT_BAND_HZ), prepared(doublets, DEFAULT_BAND_HZ)
    fits = identify_flight(fitted, judging)
    for fit in (fits.tpp, fits.cd):
        assess(fit, fitted)
    compare(fits.tpp.model, fitted, DEFAULT_BAND_HZ)
    runs = len(chirps) + len(doublets)
    assert calls == {"pieces": runs, "transformed": 4 * runs}


def test_records_and_what_was_prepared_of_them_give_the_same(ideal_card: Card, ideal_tpp: Fit) -> None:
    chirps, doublets = ideal_card
    runs = prepared(chirps, DEFAULT_BAND_HZ)
    first, second = ideal_tpp, identify(TPP, runs, prepared(doublets, DEFAULT_BAND_HZ))
    assert np.array_equal(first.model.values, second.model.values)
    assert np.array_equal(first.covariance, second.covariance)
    assert judge(first.model, chirps) == judge(first.model, runs) == second.nrmse_percent


def gap(record: Record) -> Record:
    """With half a second missing, and every other time stamp off the clock."""
    t = record.t.copy()
    t[1:-1:2] += 0.2 * (t[1] - t[0])
    keep = (t < 10.0) | (t > 10.5)
    channels = {name: values[keep] for name, values in {**record.channels, "t": t}.items()}
    return Record("gap", channels, maneuver=record.maneuver, axis=record.axis)


@pytest.mark.parametrize("change", [lambda record: record, gap])
def test_bins_are_those_of_a_preparation_of_their_own(ideal_card: Card, change: Callable[[Record], Record]) -> None:
    """In any order of asking, whole or some of the runs."""
    records = [change(record) for record in ideal_card[0]]
    runs = prepared(records, DEFAULT_BAND_HZ)
    runs.viewed(INPUTS)
    for on, of in ((runs, records), (runs.of(records[1:3]), records[1:3])):
        for inputs in (("omega", *INPUTS), INPUTS[::-1]):
            own, _ = spectra(of, inputs, ("p", "q"))
            for one, other in zip(on.viewed(inputs).spectra, own, strict=True):
                np.testing.assert_allclose(one.U, other.U, rtol=0, atol=1e-12 * np.abs(other.U).max())
                np.testing.assert_allclose(one.Y, other.Y, rtol=0, atol=1e-12 * np.abs(other.Y).max())
                assert one.segment.channels.keys() == other.segment.channels.keys()
                assert one.segment.resampled == other.segment.resampled


def test_another_band_is_another_preparation(ideal_card: Card) -> None:
    runs = prepared(ideal_card[0], DEFAULT_BAND_HZ)
    assert prepared(runs, DEFAULT_BAND_HZ) is runs
    assert runs.of(runs.records) is runs
    narrow = prepared(runs, (0.0, 5.0))
    assert max(one.frequency_hz[-1] for one in narrow.viewed(INPUTS).spectra) <= 5.0


def test_validation_runs_have_the_channels_and_the_condition_of_the_fitted_ones(ideal_card: Card) -> None:
    chirps, doublets = ideal_card
    fitted = prepared(chirps, DEFAULT_BAND_HZ)
    slow = [one.window(None, None) for one in doublets]
    judging = prepared(slow, DEFAULT_BAND_HZ).beside(fitted)
    assert judging.constants == fitted.constants
    assert judging.spectra[0].inputs == fitted.spectra[0].inputs
    assert judging.available == fitted.available


def test_a_piece_without_a_frequency_in_the_band_is_left_out_of_a_fit(ideal_card: Card) -> None:
    """Two seconds hold no frequency between 1.1 and 1.4 Hz; the others do."""
    chirps = ideal_card[0]
    short = chirps[0].window(chirps[0].t[0], chirps[0].t[0] + 2.1)
    band = (1.05, 1.4)
    runs = prepared([*chirps, short], band)
    assert len(runs.pieces) == len(chirps) + 1
    assert len(runs.viewed(INPUTS).spectra) == len(chirps)
    both, alone = identify(TPP, runs, band_hz=band), identify(TPP, chirps, band_hz=band)
    np.testing.assert_allclose(both.model.values, alone.model.values, rtol=1e-9)


def test_nothing_is_refused_in_a_sentence() -> None:
    with pytest.raises(FitError, match="no run to fit"):
        identify(TPP, Dataset(records=(), band_hz=DEFAULT_BAND_HZ))


@pytest.mark.parametrize(("off", "stacks"), [(1.4e-5, 1), (1e-3, 2)])
def test_runs_whose_clocks_hardly_differ_share_a_stack(ideal_card: Card, off: float, stacks: int) -> None:
    chirps, _ = ideal_card
    late = replace(chirps[1], channels={**chirps[1].channels, "t": chirps[1].t * (1 + off)})
    assert len(prepared([chirps[0], late], DEFAULT_BAND_HZ).viewed(INPUTS).stacks) == stacks
