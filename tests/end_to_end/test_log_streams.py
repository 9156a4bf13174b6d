"""2,000 blocks of the vehicle's log on bad links, by stream and by fetch; `make study` has 20,000, and MAVProxy."""

from __future__ import annotations

from pathlib import Path

import pytest
from log_streams import FAULTS, ours

BLOCKS = 2000
LATER = {"loss 2 %", "loss 10 %", "outage 1 s"}
"""One more of a kind."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.thorough if name in LATER else [])
        for name in FAULTS
        if name.startswith(("loss", "outage 1 ", "outage 5"))
    ],
)
def test_two_thousand_blocks_come_whole_by_stream_and_by_fetch(name: str, tmp_path: Path) -> None:
    streamed = ours(tmp_path, FAULTS[name], BLOCKS)
    assert streamed.written >= BLOCKS
    assert streamed.whole
    assert streamed.claimed_whole
    assert streamed.fetched


def test_a_log_that_was_cut_by_an_outage_is_not_called_whole_and_is_fetched(tmp_path: Path) -> None:
    streamed = ours(tmp_path, FAULTS["outage 12 s"], 2 * BLOCKS)
    assert not streamed.claimed_whole
    assert (streamed.other, streamed.whole) == (0, False)
    assert streamed.same > 500
    assert streamed.fetched
