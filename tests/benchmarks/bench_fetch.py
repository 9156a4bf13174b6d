"""A log over loopback from the simulated vehicle: ours beside pymavlink's MAVFTP, MAVProxy and MAVSDK.

Each runs as a process of its own, one after the other, against a vehicle of its own. MAVProxy and MAVSDK are no
dependencies: the Python that has them is named by TIPPATH_PEERS, and whoever is not there is said to be missing. The
time is from the first byte to the last, so that nobody's start counts, nor our CRC32 and wait for a log that may grow.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

SIZE = 1_000_000
PATIENCE_S = 40.0
PEERS = os.environ.get("TIPPATH_PEERS", sys.executable)
"""A Python, as a path."""


@contextlib.contextmanager
def vehicle(folder: Path, loss: float) -> Iterator[str]:
    """A vehicle on the ground with one log, as fast as it can; the ground's LINK."""
    command = [sys.executable, "-m", "sitl", "-o", str(folder), "--on-ground", "--listen", "udpin:127.0.0.1:0"]
    command += ["--log-rate", "5e6", "--loss", str(loss)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())["ground_link"]
        finally:
            process.terminate()


def size_of(paths: list[Path]) -> int:
    return max((path.stat().st_size for path in paths if path.exists()), default=0)


def watched(command: list[str], paths: list[Path], lines: Sequence[tuple[float, str]] = ()) -> float | None:
    """Seconds from the first byte in one of the files to all of them; None in vain. Lines go in after their seconds."""
    waiting = list(lines)
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            assert process.stdin is not None
            began, first = time.monotonic(), None
            while time.monotonic() < began + PATIENCE_S:
                while waiting and time.monotonic() > began + waiting[0][0]:
                    process.stdin.write(waiting.pop(0)[1])
                    process.stdin.flush()
                size, over = size_of(paths), process.poll() is not None
                first = time.monotonic() if first is None and size > 0 else first
                if first is not None and size >= SIZE:
                    return time.monotonic() - first
                if over:
                    return None
                time.sleep(0.005)
            return None
        finally:
            if process.poll() is None:
                process.kill()


def told(python: str, program: Callable[..., None], *words: str) -> float | None:
    """Seconds as a peer's program prints them; None in vain."""
    source = f"{inspect.getsource(program)}\n{program.__name__}(*{words!r})"
    with contextlib.suppress(subprocess.TimeoutExpired, ValueError, IndexError):
        ran = subprocess.run([python, "-c", source], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        return float(ran.stdout.split()[-1])
    return None


def has(module: str) -> bool:
    return subprocess.run([PEERS, "-c", f"import {module}"], capture_output=True, check=False).returncode == 0


def ours(link: str, out: Path, way: str) -> float | None:
    command = [sys.executable, "-m", "gcs.cli", "fetch", "--connect", link, "--by", way, "-o", str(out)]
    return watched(command, [out / "00000001.BIN.part", out / "00000001.BIN"])


def peer(name: str, link: str, out: Path) -> float | None:
    target = out / "log.bin"
    if name == "MAVProxy, log download":
        words = [f"--master={link}", f"--state-basedir={out}"]
        command = [PEERS, str(Path(PEERS).with_name("mavproxy.py")), *words]
        return watched(command, [target], ((6.0, "log list\n"), (9.0, f"log download 1 {target}\n")))
    if name == "MAVSDK, log_files":
        return told(PEERS, by_mavsdk, link.replace(":", "://", 1), str(target), str(SIZE))
    return told(PEERS, by_mavftp, link, str(target))


PEER_OF = {"pymavlink, MAVFTP": "pymavlink", "MAVProxy, log download": "MAVProxy", "MAVSDK, log_files": "mavsdk"}


@pytest.mark.parametrize("loss", [0.0, 0.02])
def bench_fetch_beside_peers(loss: float, tmp_path: Path) -> None:
    content = random.Random(1).randbytes(SIZE)
    took: dict[str, float | str | None] = {}
    card = tmp_path / "card"
    card.mkdir()
    (card / "vehicle-1.BIN").write_bytes(content)
    for way, name in (("ftp", "ours, MAVFTP"), ("log", "ours, LOG_REQUEST_DATA")):
        out = tmp_path / way
        with vehicle(card, loss) as link:
            took[name] = ours(link, out, way)
        kept = [path for path in out.iterdir() if path.stat().st_size == SIZE]
        assert [path.read_bytes() == content for path in kept] == [True]
    for name, module in PEER_OF.items():
        if not has(module):
            took[name] = f"skipped: {PEERS} has no {module}; name one that has by TIPPATH_PEERS"
            continue
        out = tmp_path / module
        out.mkdir()
        with vehicle(card, loss) as link:
            took[name] = peer(name, link, out)
    print(f"\n{SIZE / 1e6:.0f} MB over loopback, {loss:.0%} of packets lost each way")
    for name, seconds in took.items():
        rate = f"{SIZE / seconds / 1e3:6.0f} kB/s" if isinstance(seconds, float) else seconds or "did not end in time"
        print(f"  {name:24} {rate}")


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
    print(time.monotonic() - began if result.error_code == 0 else "failed")


def by_mavsdk(link: str, target: str, size: str) -> None:
    """MAVSDK's, whose library is C++."""
    import os
    import time

    from mavsdk import ComponentType, Configuration, Mavsdk  # type: ignore[import-not-found, unused-ignore]
    from mavsdk.plugins.log_files import LogFiles  # type: ignore[import-not-found, unused-ignore]

    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(link)
    files = LogFiles(sdk.first_autopilot(10.0))
    entry = files.get_entries()[0]
    began = time.monotonic()
    files.download_log_file_async(entry, target, lambda *_: None)
    while not os.path.exists(target) or os.path.getsize(target) < int(size):
        time.sleep(0.01)
    print(time.monotonic() - began, flush=True)
    os._exit(0)
