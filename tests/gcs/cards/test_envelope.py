"""Limits and peaks: percent, violations, and what an unknown value does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.cards.envelope import Limits, Peaks, use, violations

LIMITS = Limits(rate=2.0, attitude=math.radians(20), command=0.5)


def test_peaks_grow_and_never_shrink() -> None:
    peaks = Peaks().with_samples(np.array([0.1, -0.4]), np.array([0.2]), np.array([0.05]), np.array([-0.3]))
    assert (peaks.p, peaks.q, peaks.delta_x, peaks.delta_y) == (0.4, 0.2, 0.05, 0.3)
    peaks = peaks.with_samples(*[np.array([0.01])] * 4).with_telemetry(0.1, -0.6, -0.2, None)
    assert (peaks.p, peaks.q, peaks.roll, peaks.pitch) == (0.4, 0.6, 0.2, None)
    assert (peaks.rate, peaks.attitude, peaks.command) == (0.6, 0.2, 0.3)


def test_use_is_in_percent_of_the_nearest_limit() -> None:
    found = use(LIMITS, Peaks(p=1.0, q=0.5, roll=math.radians(5), delta_y=0.5), link_age_s=0.7)
    assert (found.rate, found.attitude, found.command) == pytest.approx((50, 25, 100))
    assert found.largest == pytest.approx(100)
    assert found.link == pytest.approx(20)


def test_what_is_not_known_is_no_percentage_and_breaks_nothing() -> None:
    found = use(LIMITS, Peaks())
    assert (found.rate, found.attitude, found.command, found.link, found.largest) == (None, None, None, None, 0.0)
    assert violations(LIMITS, Peaks()) == ()
    nothing = Peaks().with_samples(*[np.array([np.nan, np.inf])] * 4).with_telemetry(math.nan)
    assert nothing == Peaks()


@pytest.mark.parametrize(
    ("peaks", "words"),
    [
        (Peaks(p=2.01), "p 2.01 rad/s is beyond 2.00"),
        (Peaks(q=2.5), "q 2.50 rad/s"),
        (Peaks(roll=math.radians(21)), "roll 21.0° is beyond 20.0°"),
        (Peaks(pitch=math.radians(30)), "pitch 30.0°"),
        (Peaks(delta_x=0.6), "delta_x 0.60 is beyond 0.50 of full command"),
        (Peaks(delta_y=0.51), "delta_y 0.51"),
    ],
)
def test_each_limit_is_watched(peaks: Peaks, words: str) -> None:
    (found,) = violations(LIMITS, peaks)
    assert words in found


def test_at_the_limit_nothing_is_broken() -> None:
    assert violations(LIMITS, Peaks(p=2.0, roll=math.radians(20), delta_x=0.5), link_age_s=3.5) == ()
    assert violations(LIMITS, Peaks(), link_age_s=3.6) == ("nothing heard for 3.6 s",)
