"""Thinned logs: validation runs judge only where samples tell what the commands did, and which logs lost some."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planted import fly_many
from planted_fits import records

from sysid.data.dataset import Dataset
from sysid.data.record import Record
from sysid.diagnose.thinned import samples_lost, telling, untold

BAND = (0.5, 10.0)
LOOP_S = 0.002


def every(tenth: Record, loop_s: float | None = LOOP_S) -> Record:
    """One sample of ten: 50 Hz of a loop of 500."""
    return replace(tenth, channels={name: one[::10] for name, one in tenth.channels.items()}, loop_dt_s=loop_s)


@pytest.fixture(scope="module")
def chirp() -> Record:
    return records(fly_many(None, {}, seeds=[11], duration_s=8.0)[0])[0]


@pytest.fixture(scope="module")
def doublet(chirp: Record) -> Record:
    """The same run, its command two steps."""
    t = chirp.channels["t"]
    steps = np.where((t > 3.003) & (t < 3.991), 0.1, 0.0) * np.where(t < 3.497, 1.0, -1.0)
    return replace(
        chirp,
        id="doublet",
        channels={**chirp.channels, "delta_x": np.asarray(steps), "delta_y": np.asarray(0.01 * steps)},
    )


def judging(*runs: Record) -> tuple[Record, ...] | None:
    found = telling(Dataset(records=runs, band_hz=BAND))
    return None if found is None else found.records


def test_steps_between_the_samples_of_a_thinned_log_do_not_judge(chirp: Record, doublet: Record) -> None:
    slow, steps = every(chirp), every(doublet)
    assert judging(slow, steps) == (slow,)
    assert judging(steps) is None


def test_every_step_is_known_where_the_log_has_all_of_the_loop(chirp: Record, doublet: Record) -> None:
    assert judging(chirp, doublet) == (chirp, doublet)
    told = every(doublet, 10 * LOOP_S)  # of a loop as slow as the log
    assert judging(told) == (told,)
    assert judging(every(doublet, None)) is None  # no loop is likely to be
    assert np.ptp(told.channels["delta_x"]) == pytest.approx(0.2)


def test_a_log_that_is_slower_than_loops_and_does_not_tell_of_its_own_is_told_apart(chirp: Record) -> None:
    def on(one: Record) -> Dataset:
        return Dataset(records=(one,), band_hz=BAND)

    nothing_told = on(every(chirp, None))
    assert untold(nothing_told)
    assert samples_lost(nothing_told)
    found_since = nothing_told.held(LOOP_S)
    assert untold(found_since)
    assert samples_lost(found_since)
    told = on(every(chirp))
    assert not untold(told)
    assert samples_lost(told)
    faster_than_loops = on(replace(chirp, loop_dt_s=LOOP_S / 4))
    assert not untold(faster_than_loops)
    assert samples_lost(faster_than_loops)
    every_loop = on(every(chirp, 10 * LOOP_S))
    assert not untold(every_loop)
    assert not samples_lost(every_loop)
    fast = on(replace(chirp, loop_dt_s=None))
    assert not untold(fast)
    assert not samples_lost(fast)
