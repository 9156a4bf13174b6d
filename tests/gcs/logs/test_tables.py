"""Impossible time stamps are thrown out, as few as can be, however long the log."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.logs.formats import tables
from gcs.logs.formats.tables import Series, increasing


def fewest_given_up(t: np.ndarray, strictly: bool) -> int:
    """By the plain quadratic rule."""
    t = t[np.isfinite(t)]
    longest = np.zeros(t.size, int)
    for i in range(t.size):
        before = t[:i] < t[i] if strictly else t[:i] <= t[i]
        longest[i] = 1 + max(longest[:i][before], default=0)
    return int(t.size - longest.max(initial=0))


@pytest.mark.parametrize("strictly", [True, False])
@pytest.mark.parametrize("seed", range(40))
def test_what_stays_is_in_order_and_little_is_given_up(
    seed: int, strictly: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables, "AROUND", 6)  # so that short clocks are looked at in part
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.integers(1 if strictly else 0, 4, rng.integers(1, 120))).astype(float)
    for place in rng.integers(0, t.size, rng.integers(0, 4)):
        t[place] = rng.choice([t[place] - 60, t[place] + 60, 1e12, -1.0, np.nan, np.inf])
    keep = increasing(t, strictly=strictly)
    steps = np.diff(t[keep])
    assert np.all(steps > 0 if strictly else steps >= 0)
    assert np.all(np.isfinite(t[keep]))
    given_up = np.count_nonzero(np.isfinite(t) & ~keep)
    assert given_up <= fewest_given_up(t, strictly) + 3, "a neighbourhood may cost a few stamps more than the whole"


def test_one_bad_stamp_of_two_million_costs_itself() -> None:
    t = np.arange(2e6)
    t[1_000_000] = 5
    keep = increasing(t)
    assert np.flatnonzero(~keep).tolist() == [1_000_000]


def test_a_clock_that_goes_back_for_good_keeps_its_longer_part() -> None:
    keep = increasing(np.concatenate((np.arange(300.0), np.arange(1000.0) / 10)))
    assert np.count_nonzero(keep) >= 1000


def test_a_part_of_a_series_holds_its_ends() -> None:
    series = Series(np.arange(10.0), np.arange(10.0), "clock")
    assert series.part(2.0, 4.0).t.tolist() == [2.0, 3.0, 4.0]
    assert series.spacing_s == 1.0
    assert np.isinf(series.part(20, 30).spacing_s)
