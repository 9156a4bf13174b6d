"""A log over loopback from the simulated vehicle: ours beside pymavlink's MAVFTP, MAVProxy's and MAVSDK's.

Each runs as a process of its own, one after the other, against a vehicle of its own, which sends, as on an autopilot's
UDP, whether or not the other end keeps up: as fast as it can, or at the rate that it has by default. MAVProxy and
MAVSDK are no dependencies: `peers` installs them, or says why it cannot. The time is from the request or the first byte
to the last, so that nobody's start counts, nor our CRC32 and wait for a log that may grow. What came must be the
vehicle's, byte for byte.
"""

from __future__ import annotations

import contextlib
import json
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from peers import MavProxy, MissingError, mavsdk_files, mavsdk_logs, peers_python, with_peer

SIZE = 1_000_000
FASTEST = 5e6
"""Bytes a second, more than the vehicle can."""
PATIENCE_S = 120.0
FILES, MESSAGES = "MAVFTP", "LOG_REQUEST_DATA"
LOG = "00000001.BIN"
Fetch = Callable[[str, Path], float]
"""A link and an empty folder, to seconds; the log is in the folder then, under whatever name.

Raises TimeoutError or subprocess.SubprocessError where it does not come.
"""


@contextlib.contextmanager
def vehicle(folder: Path, loss: float, rate: float) -> Iterator[str]:
    """A vehicle on the ground with one log, given away at so many bytes a second; the ground's LINK."""
    command = [sys.executable, "-m", "sitl", "-o", str(folder), "--on-ground", "--listen", "udpin:127.0.0.1:0"]
    command += ["--like", "ardupilot-heli", "--log-rate", str(rate), "--loss", str(loss)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())["ground_link"]
        finally:
            process.terminate()


# ----------------------------------------------------------------------------------------------------- who fetches


def ours(way: str) -> Fetch:
    def fetch(link: str, out: Path) -> float:
        command = [sys.executable, "-m", "gcs.cli", "fetch", "--connect", link, "--by", way, "-o", str(out)]
        growing = (out / f"{LOG}.part", out / LOG)
        first = None
        end = time.monotonic() + PATIENCE_S
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
            try:
                while time.monotonic() < end:
                    size = max((path.stat().st_size for path in growing if path.exists()), default=0)
                    first = time.monotonic() if first is None and size > 0 else first
                    if first is not None and size >= SIZE:
                        took_s = time.monotonic() - first
                        process.wait(PATIENCE_S)
                        return took_s
                    time.sleep(0.005)
            finally:
                process.kill()
        raise TimeoutError

    return fetch


def by_mavproxy(*lines: str, over: str) -> Fetch:
    """What is typed, `{}` for the file, and what is printed at the end."""

    def fetch(link: str, out: Path) -> float:
        with MavProxy(peers_python(), link, out) as proxy:
            proxy.until("Received .* parameters")
            *before, last = (line.format(out / "log.bin") for line in lines)
            for line in before:
                proxy.say(line)
            began = time.monotonic()
            proxy.say(last)
            proxy.until(over, PATIENCE_S)
            took_s = time.monotonic() - began
            time.sleep(0.5)  # it says so before the file is closed
            return took_s

    return fetch


def mavsdk_log(link: str, out: Path) -> float:
    words = (link.replace(":", "://", 1), "0", str(out / "log.bin"))
    return float(with_peer(peers_python(), mavsdk_logs, *words, patience_s=PATIENCE_S)["seconds"])


def mavsdk_file(link: str, out: Path) -> float:
    words = (link.replace(":", "://", 1), f"logs/{LOG}", str(out))
    return float(with_peer(peers_python(), mavsdk_files, *words, patience_s=PATIENCE_S)["seconds"])


def pymavlink_file(link: str, out: Path) -> float:
    return float(with_peer(Path(sys.executable), by_mavftp, link, str(out / "log.bin"), patience_s=PATIENCE_S))


FETCHES: dict[str, tuple[str, Fetch]] = {
    "ours, files": (FILES, ours("ftp")),
    "pymavlink, MAVFTP": (FILES, pymavlink_file),
    "MAVProxy, ftp get": (
        FILES,
        by_mavproxy("ftp set burst_read_size 239", f"ftp get logs/{LOG} {{}}", over=r"Wrote \d+ bytes"),
    ),
    "MAVSDK, Ftp": (FILES, mavsdk_file),
    "ours, messages": (MESSAGES, ours("log")),
    "MAVProxy, log download": (MESSAGES, by_mavproxy("log list", "log download 1 {}", over="Finished downloading")),
    "MAVSDK, LogFiles": (MESSAGES, mavsdk_log),
}


def outcome(fetch: Fetch, link: str, out: Path, content: bytes) -> float | str:
    """Bytes a second, or why there are none."""
    try:
        took_s = fetch(link, out)
    except MissingError as why:
        return f"skipped: {why}"
    except (TimeoutError, subprocess.SubprocessError):
        return f"did not end in {PATIENCE_S:.0f} s"
    came = [path for path in out.iterdir() if path.stat().st_size == SIZE]
    return SIZE / took_s if [path.read_bytes() for path in came] == [content] else "ended with other bytes"


@pytest.mark.parametrize(("loss", "rate"), [(0.0, FASTEST), (0.02, FASTEST), (0.0, 250_000.0)])
def bench_fetch_beside_peers(loss: float, rate: float, tmp_path: Path) -> None:
    content = random.Random(1).randbytes(SIZE)
    card = tmp_path / "card"
    card.mkdir()
    (card / "vehicle-1.BIN").write_bytes(content)
    rates: dict[str, float | str] = {}
    for number, (name, (_, fetch)) in enumerate(FETCHES.items()):
        out = tmp_path / str(number)
        out.mkdir()
        with vehicle(card, loss, rate) as link:
            rates[name] = outcome(fetch, link, out, content)
    speed = "as fast as the vehicle can" if rate == FASTEST else f"{rate / 1e3:.0f} kB/s of the link"
    print(f"\n{SIZE / 1e6:.0f} MB over loopback, {speed}, {loss:.0%} of packets lost each way")
    best = {way: rates[name] for name, (way, _) in FETCHES.items() if name.startswith("ours")}
    for name, (way, _) in FETCHES.items():
        its, own = rates[name], best[way]
        if isinstance(its, str) or isinstance(own, str):
            print(f"  {name:24} {its}")
        else:
            print(f"  {name:24} {its / 1e3:6.0f} kB/s" + (f", ours {own / its:.1f} times" if its != own else ""))
    assert all(isinstance(own, float) for own in best.values())


# ------------------------------------------------------------------------------------------------ the peers' programs


def by_mavftp(link: str, target: str) -> None:
    """pymavlink's own client. Each program stands alone: it is run by another Python."""
    import time

    from pymavlink import mavutil
    from pymavlink.mavftp import MAVFTP

    master = mavutil.mavlink_connection(link, source_system=250)
    for _ in range(20):
        master.mav.heartbeat_send(6, 8, 0, 0, 0)
        if master.wait_heartbeat(timeout=0.5) is not None:
            break
    files = MAVFTP(master, 1, 1)
    files.ftp_settings.burst_read_size = 239
    began = time.monotonic()
    files.cmd_get(["logs/00000001.BIN", target])
    result = files.process_ftp_reply("OpenFileRO", timeout=50)
    if result.error_code == 0:
        print(time.monotonic() - began)
