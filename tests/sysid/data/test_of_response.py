"""A measured frequency response as a record: its bins are the response, and nothing lies beyond."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sysid.data.of_response import Response, error_of_coherence, record_of
from sysid.data.preprocess import pieces
from sysid.data.record import RecordError
from sysid.fit.identify import identify
from sysid.model.compose import compose

FREQUENCY_HZ = np.geomspace(0.5, 9.0, 80)


def answer(
    frequency_hz: np.ndarray, k: float = 30.0, a: float = 4.0, T: float = 0.06, tau: float = 0.025
) -> np.ndarray:
    s = 2j * np.pi * frequency_hz
    return k * np.exp(-tau * s) / ((s + a) * (T * s + 1))


def response(frequency_hz: np.ndarray = FREQUENCY_HZ, **told: Any) -> Response:
    made = {"H": answer(frequency_hz), **told}
    return Response(output="q", command="delta_y", frequency_hz=frequency_hz, **made)


def test_its_bins_are_the_response_and_nothing_lies_beyond() -> None:
    record = record_of([response()], "r", "r.csv", "0")
    assert (record.maneuver, record.axis, record.swept_band_hz) == ("response", "pitch", (0.5, 9.0))
    (piece,), dropped = pieces(record, (0.0, 15.0))
    assert dropped == []
    one = piece.spectrum(("delta_y",), ("q", "p"))
    assert 0.5 <= one.frequency_hz[0] < 0.7
    assert 8.8 < one.frequency_hz[-1] <= 9.0
    s = 2j * np.pi * one.frequency_hz
    held = (1 - np.exp(-s * one.dt)) / (s * one.dt)
    # what lies between the points is read off their neighbours
    np.testing.assert_allclose(one.Y[0] / one.U[0] / held, answer(one.frequency_hz), rtol=3e-3)
    assert not np.any(one.Y[1])
    whole = np.abs(np.fft.rfft(record.channels["q"]))
    inside = slice(one.first, one.first + one.frequency_hz.size)
    assert np.sum(whole[inside] ** 2) == pytest.approx(np.sum(whole**2))


@pytest.mark.parametrize("falling", [False, True])
def test_the_order_of_points_is_nothing(falling: bool) -> None:
    order = np.arange(FREQUENCY_HZ.size)[::-1] if falling else np.random.default_rng(3).permutation(FREQUENCY_HZ.size)
    shuffled = Response(output="q", command="delta_y", frequency_hz=FREQUENCY_HZ[order], H=answer(FREQUENCY_HZ)[order])
    one, other = (record_of([each], "r", "r.csv", "0") for each in (response(), shuffled))
    assert np.array_equal(one.channels["q"], other.channels["q"])


def test_what_errs_more_counts_less() -> None:
    error = np.where(FREQUENCY_HZ < 2, 0.5, 0.1)
    (piece,), _ = pieces(record_of([response(relative_error=error)], "r", "r.csv", "0"), (0.0, 15.0))
    one = piece.spectrum(("delta_y",), ("q",))
    low, high = (float(np.median(np.abs(one.Y[0][part]))) for part in (one.frequency_hz < 1.8, one.frequency_hz > 2.2))
    assert high / low == pytest.approx(5, rel=0.05)


def test_errors_from_coherence() -> None:
    np.testing.assert_allclose(error_of_coherence(np.array([1.0, 0.8, 0.5])), [0, np.sqrt(0.125), np.sqrt(0.5)])
    assert np.all(np.isnan(error_of_coherence(np.array([0.0, -1.0, 1.5, np.nan]))))


def test_a_wide_gap_ends_it() -> None:
    kept = (FREQUENCY_HZ < 2) | (FREQUENCY_HZ > 4)
    record = record_of([response(FREQUENCY_HZ[kept])], "r", "r.csv", "0")
    assert record.swept_band_hz is not None
    assert record.swept_band_hz[1] < 2
    assert any("beyond a gap" in note for note in record.notes)
    with pytest.raises(RecordError, match="more than a third of an octave apart"):
        record_of([response(np.geomspace(0.1, 10, 12))], "r", "r.csv", "0")
    with pytest.raises(RecordError, match="0 points of q per delta_y are known"):
        record_of([response(H=np.full(80, np.nan + 0j))], "r", "r.csv", "0")


def test_of_what_it_was_made_comes_out_of_it() -> None:
    """Independent of the model's code: the response is a formula."""
    noise = np.random.default_rng(1)
    H = answer(FREQUENCY_HZ) * (1 + 0.03 * (noise.standard_normal(80) + 1j * noise.standard_normal(80)))
    record = record_of([response(H=H)], "r", "r.csv", "0")
    fit = identify(compose("pitch"), [record], band_hz=(0.5, 9.0), effects=["servo_lag", "transport_delay"])
    errors = dict(zip(fit.model.structure.names, np.sqrt(np.diag(fit.covariance)), strict=True))
    assert abs(fit.model["T_d"] - 0.025) < 4 * errors["T_d"] < 0.004
    # a pole of the vehicle and one of its servo are the same to a response: either may bear either name
    slow, fast = sorted((-fit.model["M_q"], 1 / fit.model["tau_s"]))
    assert slow == pytest.approx(4.0, rel=0.05)
    assert fast == pytest.approx(1 / 0.06, rel=0.05)
    assert fit.instrument == "excitation logged"
