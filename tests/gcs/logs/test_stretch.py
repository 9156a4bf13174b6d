"""A log without a maneuver names the stretch in which it was flown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.logs import ingest
from gcs.logs.runs.stretch import flown_stretch


def channels(moving: list[tuple[float, float]], length_s: float = 90.0, noise: float = 0.003) -> dict[str, np.ndarray]:
    draw = np.random.default_rng(4)
    t = 200.0 + np.arange(0, length_s, 0.01)
    rate = draw.normal(0, noise, t.size)
    for start, stop in moving:
        rate += np.where((t >= 200 + start) & (t < 200 + stop), np.sin(7 * t), 0.0)
    return {"t": t, "p": rate, "q": 0.5 * rate}


def test_the_longest_flight_without_its_ends() -> None:
    assert flown_stretch(channels([(5, 15), (30, 70)])) == (233.0, 267.0)


def test_a_calm_moment_does_not_end_it() -> None:
    start, stop = flown_stretch(channels([(10, 30), (35, 60)])) or (0.0, 0.0)
    assert (start, stop) == (213.0, 257.0)


@pytest.mark.parametrize("moving", [[], [(10, 20)]])
def test_none_where_nothing_moves_for_long_enough(moving: list[tuple[float, float]]) -> None:
    assert flown_stretch(channels(moving)) is None


@pytest.mark.parametrize("t", [[], [1.0], [0.0, 1.0, 1e9]])
def test_none_of_a_clock_that_is_empty_or_has_jumped(t: list[float]) -> None:
    at = np.array(t)
    assert flown_stretch({"t": at, "p": 9 * at, "q": at}) is None


def test_what_a_newcomer_types_next_is_told(shared_data: Path) -> None:
    """A refusal said START:STOP, and nobody knows the seconds of a log before a plot of it."""
    path = shared_data / "measured" / "crazyflie_usd_log15"
    if not path.exists():
        pytest.skip(f"NO REAL LOGS: {path} is absent")
    (run,) = ingest([path]).runs
    assert "--window 55:92 --band 1:15" in " ".join(run.reasons)
    (cut,) = ingest([path], window=(55.0, 92.0)).runs
    assert cut.usable
