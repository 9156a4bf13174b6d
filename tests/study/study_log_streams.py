"""20,000 blocks of the vehicle's log at each loss and outage: ours by stream and fetch, and what MAVProxy's
`dataflash_logger` makes of the same vehicle and faults.

    python tests/study/study_log_streams.py [BLOCKS]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT)]  # before tests/, which has a folder of the same name
sys.path.append(str(ROOT / "tests"))

from log_streams import FAULTS, Streamed, by_mavproxy, ours  # noqa: E402
from peers import MissingError  # noqa: E402

BLOCKS = 20_000
TEN_MINUTES = 144_000
"""Blocks of a vehicle that sweeps all the time."""
LONG_S = 10.0
"""The vehicle drops a stream that was not answered for so long: a log begins anew then."""


def study_a_log_comes_whole_by_stream_or_fetch() -> None:
    _study(BLOCKS)


def study_ten_minutes_are_recorded_whole() -> None:
    with tempfile.TemporaryDirectory() as folder:
        streamed = ours(Path(folder), "", TEN_MINUTES)
    print(f"\n{streamed}")
    assert streamed.whole
    assert streamed.claimed_whole
    assert streamed.fetched


def _study(blocks: int) -> None:
    print(f"\n{'':14}{'written':>8}{'ours':>8}{'other':>6}  {'said':12}{'fetched':9}{'MAVProxy':>8}{'other':>6}")
    broken = []
    for name, script in FAULTS.items():
        with tempfile.TemporaryDirectory() as folder:
            own = ours(Path(folder), script, blocks)
        with tempfile.TemporaryDirectory() as folder:
            try:
                theirs: Streamed | str = by_mavproxy(Path(folder), script, blocks)
            except MissingError as why:
                theirs = str(why)
        said = "whole" if own.claimed_whole else "not whole"
        beside = f"{theirs.same:8,}{theirs.other:6,}" if isinstance(theirs, Streamed) else f"  {theirs}"
        fetched = "all" if own.fetched else "NOT ALL"
        print(f"{name:14}{own.written:8,}{own.same:8,}{own.other:6,}  {said:12}{fetched:9}{beside}", flush=True)
        long = name.startswith("outage") and float(name.split()[1]) > LONG_S
        if own.other or not own.fetched or own.claimed_whole is not own.whole or (not long and not own.whole):
            broken.append(f"{name}: {own}")
    assert not broken, "\n".join(broken)


if __name__ == "__main__":
    _study(int(sys.argv[1]) if sys.argv[1:] else BLOCKS)
