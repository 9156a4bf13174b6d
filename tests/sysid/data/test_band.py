"""The band that a fit has where nobody names one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sysid.data.band import BandFrom, ChosenBand, common_band, swept_band
from sysid.data.record import Record

BAND = (0.5, 10.0)


def run(axis: str | None, band: tuple[float, float] | None = BAND, rate_hz: float = 400.0) -> Record:
    t = np.arange(0, 10, 1 / rate_hz)
    channels = {"t": t, **{name: np.sin(t) for name in ("p", "q", "delta_x", "delta_y")}}
    return Record("one", channels, axis=axis, swept_band_hz=band, chirp_noise=0.0)


def test_it_is_what_was_swept_on_both_axes() -> None:
    narrow = run("pitch", (0.3, 8.0))
    assert swept_band([run("roll"), narrow]) == ChosenBand((0.5, 8.0), BandFrom.SWEPT)


def test_a_sweep_cut_short_beside_a_whole_one_of_its_axis_costs_nothing() -> None:
    assert swept_band([run("roll"), run("roll", (0.5, 2.0)), run("pitch")]) == ChosenBand(BAND, BandFrom.SWEPT)


@pytest.mark.parametrize("other", [run("elevator", (0.1, 2.0)), run("roll", None), run(None, None)])
def test_runs_that_sweep_neither_axis_do_not_move_it(other: Record) -> None:
    assert swept_band([run("roll"), other]) == ChosenBand(BAND, BandFrom.SWEPT)


def test_an_elevator_s_sweep_counts_where_there_is_no_other() -> None:
    assert swept_band([run("elevator", (0.1, 2.0))]) == ChosenBand((0.1, 2.0), BandFrom.SWEPT)


def test_chirps_flown_with_noise_have_the_paper_s_band() -> None:
    noisy = replace(run("pitch"), chirp_noise=0.2)
    assert swept_band([run("roll"), noisy]) == ChosenBand((0.0, 15.0), BandFrom.NOISE)


@pytest.mark.parametrize(
    ("rate_hz", "loop_hz", "high_hz"),
    [
        (400.0, None, 15.0),
        (100.0, None, 10.0),  # no loop is likely to be so slow
        (100.0, 100.0, 15.0),
        (200.0, 400.0, 10.0),
    ],
)
def test_beyond_the_sweep_a_log_that_lost_samples_of_the_noise_is_not_fitted(
    rate_hz: float, loop_hz: float | None, high_hz: float
) -> None:
    loop_dt_s = None if loop_hz is None else 1 / loop_hz
    noisy = [replace(run(axis, rate_hz=rate_hz), chirp_noise=0.2, loop_dt_s=loop_dt_s) for axis in ("roll", "pitch")]
    source = BandFrom.NOISE if high_hz == 15.0 else BandFrom.NOISE_LOST
    assert swept_band(noisy) == ChosenBand((0.0, high_hz), source)


def test_without_a_sweep_there_is_none() -> None:
    assert swept_band([run("roll", None)]) is None


def test_sweeps_with_nothing_in_common_have_the_usual_one() -> None:
    assert swept_band([run("roll", (0.5, 2.0)), run("pitch", (4.0, 9.0))]) == ChosenBand((0.0, 15.0), BandFrom.USUAL)


def test_it_goes_no_further_than_the_samples() -> None:
    fast = (0.5, 40.0)
    assert swept_band([run("roll", fast)]) == ChosenBand(fast, BandFrom.SWEPT)
    slow = swept_band([run("roll", fast, rate_hz=100.0)])
    assert slow is not None
    assert slow.hz == pytest.approx((0.5, 25.0))


def test_less_than_an_octave_is_no_band() -> None:
    assert common_band({"roll": [(3.0, 5.0)]}) is None
    assert common_band({"roll": [(2.5, 5.0)]}) == (2.5, 5.0)
    assert common_band({}) is None
