"""Reading a 100 MB log: against pymavlink's DFReader and against reading the bytes alone, in the same run."""

from __future__ import annotations

import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pymavlink import DFReader

from gcs.logs.formats import dataflash, dataflash_scan

MESSAGES = ("RATE", "SIDD")
GPS = struct.Struct("<QBBIHBhiiiffffB")
"""TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U, as the log declares it."""
HUGE = 2_000_000_000

READ = """
import sys
from pathlib import Path
import numpy as np
from gcs.logs.formats import dataflash, dataflash_scan
def peak():  # getrusage would count what the parent held when it forked
    status = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in status if line.startswith("VmHWM"))
base = peak()
log = dataflash.read(Path(sys.argv[1]))
if sys.argv[2] == "all":
    columns = [log.table(name) for name in ("RATE", "SIDD")]
else:
    columns = [log.column(name, field) for name, field in (("RATE", "TimeUS"), ("RATE", "R"), ("SIDD", "Gx"))]
print(base, peak())
"""


def long_flight(once: Path, path: Path, size: int, *, gps: bool) -> None:
    """One flight of at least so many bytes: a real sweep over and over, with the clock going on.

    The log declares GPS messages and has none; `gps` puts them in, ten a second.
    """
    data = np.fromfile(once, np.uint8)
    log = dataflash.parse(data)
    stamped = [name for name in log.names if "TimeUS" in log.formats[name].columns]
    body = int(min(log.places(name)[0] for name in ("RATE", "IMU", "ATT", "SIDS")))
    places = np.concatenate([log.places(name) for name in stamped])
    places = places[places >= body]
    where = places[:, None] + np.arange(3, 11)
    times = data[where].copy().view("<u8")[:, 0]
    clock = log.column("RATE", "TimeUS")
    period = int(clock[-1] - clock[0]) + 2500
    assert log.formats["GPS"].types == "QBBIHBcLLeffffB"
    head = bytes([*dataflash_scan.HEAD, log.formats["GPS"].id])
    attitudes = log.places("ATT")
    attitudes = attitudes[attitudes >= body].tolist() if gps else []
    with path.open("wb") as stream:
        stream.write(data[:body].tobytes())
        written, again = 0, 0
        while written < size:
            data[where] = (times + np.uint64(again * period)).view(np.uint8).reshape(-1, 8)
            last = body
            for at in attitudes:
                us = int(data[at + 3 : at + 11].view("<u8")[0])
                fix = (us, 0, 3, us // 1000, 2300, 12, 80, -353632621, 1491652374, 58400, 0.0, 0.0, 0.0, 0.0, 1)
                stream.write(data[last:at].tobytes())
                stream.write(head + GPS.pack(*fix))
                last = at
            stream.write(data[last:].tobytes())
            written, again = stream.tell(), again + 1


def best(what: Callable[[], object], times: int = 5) -> float:
    """Seconds of the fastest of several."""
    found = float("inf")
    for _ in range(times):
        start = time.perf_counter()
        what()
        found = min(found, time.perf_counter() - start)
    return found


def memory(path: Path, what: str) -> tuple[float, float]:
    """Peak bytes of a process that reads the log: before it, and with it."""
    done = subprocess.run([sys.executable, "-c", READ, str(path), what], capture_output=True, text=True, check=True)
    before, after = done.stdout.split()
    return float(before), float(after)


@pytest.mark.data
@pytest.mark.parametrize("gps", [False, True], ids=["no GPS", "GPS"])
def bench_two_messages_of_100_mb(shared_data: Path, tmp_path: Path, gps: bool) -> None:
    path = tmp_path / "large.BIN"
    long_flight(shared_data / "ardupilot" / "quad_roll_sweep.BIN", path, 100_000_000, gps=gps)
    size = path.stat().st_size

    def ours() -> dict[str, int]:
        log = dataflash.read(path)
        return {name: log.table(name)["TimeUS"].size for name in MESSAGES}

    counts = ours()
    # taken in turns, so that another load on the machine meets both
    pairs = [(best(lambda: np.fromfile(path, np.uint8), 2), best(ours, 1)) for _ in range(8)]
    bytes_s, ours_s = min(a for a, _ in pairs), min(b for _, b in pairs)

    start = time.perf_counter()
    other = DFReader.DFReader_binary(str(path))
    opened_s = time.perf_counter() - start
    count = 0
    while (message := other.recv_match(type=list(MESSAGES))) is not None:
        message.to_dict()
        count += 1
    other.close()
    theirs_s = time.perf_counter() - start
    assert count == sum(counts.values())

    before, peak = memory(path, "all")
    print(
        f"\n{size / 1e6:.0f} MB, {'with' if gps else 'without'} GPS, {count:,} messages: {ours_s:.3f} s; "
        f"np.fromfile {bytes_s:.3f} s, {ours_s / bytes_s:.1f} times; "
        f"DFReader {theirs_s:.1f} s (of them {opened_s:.1f} s to open), {theirs_s / ours_s:.0f} times faster; "
        f"memory at most {peak / size:.1f} times the file, {(peak - before) / size:.1f} without the interpreter's"
    )
    assert theirs_s > 30 * ours_s
    assert ours_s < 15 * bytes_s
    assert peak < 3 * size


@pytest.mark.data
def bench_memory_for_2_gb(shared_data: Path, tmp_path: Path) -> None:
    path = tmp_path / "huge.BIN"
    long_flight(shared_data / "ardupilot" / "quad_roll_sweep.BIN", path, HUGE, gps=False)
    size = path.stat().st_size
    try:
        start = time.perf_counter()
        _, peak = memory(path, "three columns")
        took_s = time.perf_counter() - start
    finally:
        path.unlink()
    print(f"\n{size / 1e9:.1f} GB: three columns in {took_s:.1f} s, memory at most {peak / 1e6:.0f} MB")
    assert peak < 1.1e9
