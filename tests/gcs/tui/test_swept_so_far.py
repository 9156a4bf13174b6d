"""A sweep while it is flown: where it is, and how well the rate follows it there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_app import FLYING, app_on, screen_text, settle

from gcs.flight.live import LiveWindow
from gcs.tui.state import Progress, Swept
from gcs.tui.swept_so_far import CELLS, coherence_bar, coherence_so_far

T = np.arange(0.0, 20.0, 0.01)
HZ = 0.5 * 20.0 ** (T / 30.0)
SWEEP = 0.1 * np.sin(2 * np.pi * np.cumsum(HZ) * 0.01)
NOISE = np.random.default_rng(4).normal(0.0, 1.0, T.size)


def flown(p: np.ndarray, excitation: np.ndarray = SWEEP) -> LiveWindow:
    none = np.full(T.size, np.nan)
    return LiveWindow(t=T, p=p, q=NOISE, delta_x=none, delta_y=none, excitation_x=excitation, excitation_y=none)


SWEPT = Swept("roll", 0.5, 10.0, float(HZ[-1]))


def test_it_fills_along_the_frequencies_as_far_as_the_sweep_is():
    values = coherence_so_far(flown(3 * SWEEP + 0.002 * NOISE), SWEPT)
    there = [value for value in values if value is not None]
    assert len(values) == CELLS
    assert len(there) == round(CELLS * np.log(HZ[-1] / 0.5) / np.log(20.0)) + 1
    assert values[len(there) :] == (None,) * (CELLS - len(there))
    assert min(there[1:-2]) > 0.8
    assert coherence_bar(values, "braille").startswith("█")
    assert coherence_bar(values, "ascii").endswith(".....")


def test_a_rate_that_does_not_answer_is_seen():
    told = [value for value in coherence_so_far(flown(NOISE), SWEPT) if value is not None]
    assert np.mean(told) < 0.4
    beyond = np.where(HZ < 1.5, 3 * SWEEP, 0.0) + 0.3 * NOISE
    half = [value for value in coherence_so_far(flown(beyond), SWEPT) if value is not None]
    assert np.mean(half[1:5]) > 2 * np.mean(half[9:])


@pytest.mark.parametrize(
    ("window", "swept"),
    [
        (flown(SWEEP, np.full(T.size, np.nan)), SWEPT),
        (flown(SWEEP), replace(SWEPT, axis="yaw")),
        (replace(flown(SWEEP), t=T[:2], p=T[:2], excitation_x=T[:2]), SWEPT),
    ],
)
def test_what_is_not_told_is_no_bar(window, swept):
    assert coherence_so_far(window, swept) == (None,) * CELLS


@pytest.mark.parametrize("style", ["braille", "ascii"])
async def test_it_stands_in_the_place_of_the_time_s_bar(style):
    app, engine = app_on(replace(FLYING, progress=Progress(15.0, 30.0, 3.5, "Table 1", SWEPT)), style)
    engine.samples = flown(3 * SWEEP + 0.002 * NOISE)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("2")
        await settle(app)
        (line,) = (line for line in screen_text(app) if "15.0 s of 30" in line)
        assert "0.5 ██" in line if style == "braille" else "0.5 99" in line
        assert "10 Hz  15 s left  3.5 Hz  A 0.10" in line
        engine.now = replace(FLYING, progress=Progress(15.0, 30.0, None, "doublet"))
        await settle(app)
        assert not any("10 Hz  15 s left" in line for line in screen_text(app))
