"""The renderer keeps every peak, draws no line over a gap, and fits its box."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.tui.plot import STYLES, bar, chart, dots_across, envelope, round_limit


def drawn(line: str) -> bool:
    return any(character not in " ·-" for character in line)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("spike_at", [1, 4321, 9998])
def test_a_spike_of_one_sample_is_drawn_to_its_height(style, spike_at):
    t = np.arange(10_000) / 500
    values = np.zeros(t.size)
    values[spike_at] = 1.0
    low, high = envelope(t, values, dots_across(60, style), 20.0, t[-1])
    lines = chart(low, high, 3, 60, 1.0, style)
    assert drawn(lines[0]), "the spike reaches the top row"
    assert not drawn(lines[2]), "and nothing reaches the bottom one"


@pytest.mark.parametrize("seed", range(5))
def test_the_envelope_holds_the_extremes_of_its_slices(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.001, 0.003, 5000))
    values = rng.standard_normal(t.size)
    low, high = envelope(t, values, 100, t[-1] + 1, t[-1])
    assert np.nanmax(high) == values.max()
    assert np.nanmin(low) == values.min()
    slots = np.floor(t / ((t[-1] + 1) / 100)).astype(int)
    slots += 99 - slots[-1]
    for slot in (50, 75, 99):
        inside = values[slots == slot]
        assert (low[slot], high[slot]) == (inside.min(), inside.max())


def test_a_gap_stays_empty_and_slow_telemetry_is_joined():
    t = np.concatenate((np.arange(0, 4, 0.1), np.arange(7, 10, 0.1)))
    low, _ = envelope(t, np.ones(t.size), 200, 10.0, 9.99)
    seconds = (np.arange(200) + 0.5) * 10 / 200
    assert np.isnan(low[(seconds > 4.1) & (seconds < 6.9)]).all()
    assert np.isfinite(low[(seconds > 0.1) & (seconds < 3.8)]).all()


def test_the_picture_moves_with_time_and_does_not_shimmer():
    t = np.arange(10_000) / 500
    values = np.sin(9 * t) + np.sin(61 * t)
    slice_s = 10.0 / 100
    now, _ = envelope(t, values, 100, 10.0, 15.05)
    later, _ = envelope(t, values, 100, 10.0, 15.05 + 7 * slice_s)
    np.testing.assert_array_equal(now[7:-1], later[:-8])


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("rows", [1, 2, 5])
def test_the_chart_is_as_large_as_asked_with_any_data(style, rows):
    for values in (np.array([]), np.array([np.nan]), np.array([np.inf, 1e300, -1e300]), np.full(50, 1e6)):
        low, high = envelope(np.arange(values.size) * 0.1, values, dots_across(33, style), 5.0, 5.0)
        lines = chart(low, high, rows, 33, 1.0, style)
        assert [len(line) for line in lines] == [33] * rows


def test_a_steep_signal_has_no_holes():
    t = np.arange(400) / 100
    values = np.where(t < 2, -1.0, 1.0)
    low, high = envelope(t, values, 20, 4.0, t[-1])
    lines = chart(low, high, 4, 20, 1.0, "ascii")
    column = ["".join(line[i] for line in lines) for i in range(20)]
    assert "||||" in column, column


def test_ascii_is_ascii():
    t = np.arange(400) / 100
    low, high = envelope(t, np.sin(t * 5), 40, 4.0, t[-1])
    assert "".join(chart(low, high, 4, 40, 1.0, "ascii")).isascii()
    assert bar(0.5, 8, "ascii") == "####...."


@pytest.mark.parametrize(
    ("largest", "limit"), [(0.0, 0.05), (0.04, 0.05), (0.2, 0.2), (0.21, 0.5), (7, 10), (np.nan, 0.05), (np.inf, 0.05)]
)
def test_scales_are_round_and_hold_the_signal(largest, limit):
    assert round_limit(largest, 0.05) == pytest.approx(limit)


def test_a_bar_shows_a_little_as_something_and_too_much_as_full():
    assert [bar(x, 4, "block") for x in (0.0, 0.01, 0.5, 1.0, 9.0, np.nan)] == [
        "░░░░",
        "▓░░░",
        "▓▓░░",
        "▓▓▓▓",
        "▓▓▓▓",
        "░░░░",
    ]
