"""The vehicle's log as it comes to the ground in storms, by our recorder and by MAVProxy's: the same vehicle, faults
and fake time (`tests/slow_flight.py`); the vehicle's own files are the judge.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from peers import peers_python
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from slow_flight import SlowFlight

from gcs.flight.session import Session

BLOCK = 200
IDLES = 5
"""Times that MAVProxy's main loop comes round in a turn of 20 ms."""
FAULTS = {
    "clean": "",
    **{f"loss {share} %": f"loss = {share / 100}" for share in (2, 10, 30)},
    **{f"outage {seconds} s": f'outage = "both@5:{5 + seconds}"' for seconds in (1, 5, 12, 20, 40)},
}
"""A name, and the script of `tippath sim --faults`."""


@dataclass(frozen=True, slots=True)
class Streamed:
    """What came of the vehicle's logs to the ground, in blocks."""

    written: int
    """By the vehicle, from when they were asked for until they were wanted no more."""
    same: int
    """On the ground as the vehicle has them."""
    other: int
    """On the ground, not as the vehicle has them, and not called missing."""
    claimed_whole: bool
    fetched: bool = False
    """All of the vehicle's logs came afterwards by `tippath fetch`, byte for byte."""

    @property
    def whole(self) -> bool:
        """Whether one log came, as the vehicle has it, to its end."""
        return self.same == self.written and not self.other


def ours(folder: Path, script: str, blocks: int) -> Streamed:
    """By a session's recorder; and then fetched."""
    with _flying(folder, script) as (flown, written):
        session = Session.open(flown.wire.name)
        session.start_recording(folder / "ground")
        logs = _fly_on(flown, written, blocks)
        summary = session.stop_recording()
        session.close()
        flown.sleep(5.0)
        flown.pilot("land")
        flown.sleep(10.0)
        fetched = all(_fetched(flown, path, folder / path.stem) for path in logs)
    missing = [{number for first, last in log.missing for number in range(first, last + 1)} for log in summary.logs]
    same, other = _compared(logs, [log.path for log in summary.logs], missing)
    return Streamed(sum(map(_size, logs)), same, other, summary.complete, fetched)


def _fetched(flown: SlowFlight, path: Path, into: Path) -> bool:
    number = path.stem.partition("-")[2]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        status = flown.tippath("fetch", "--log", number, "--whole", "-o", into)
    (came,) = into.glob("*.BIN") if status == 0 else (None,)
    return came is not None and came.read_bytes() == path.read_bytes()


def by_mavproxy(folder: Path, script: str, blocks: int) -> Streamed:
    """By the `dataflash_logger` of MAVProxy, in this process. Raises `peers.MissingError`."""
    python = peers_python()
    sys.path.append(str(next(python.parents[1].glob("lib/python*/site-packages"))))
    (folder / "ground").mkdir()
    with pytest.MonkeyPatch.context() as patched, _flying(folder, script) as (flown, written):
        module = importlib.import_module("MAVProxy.modules.mavproxy_dataflash_logger")
        patched.setattr(module, "time", SimpleNamespace(time=flown.now))
        port = mavlink.MAVLink(SimpleNamespace(write=flown.wire.at_ground.send), 255, 230)
        reading = mavlink.MAVLink(None)
        reading.robust_parsing = True
        with contextlib.redirect_stdout(io.StringIO()):
            logger = module.dataflash_logger(_state(folder / "ground", port))

            def turn() -> None:
                for message in reading.parse_buffer(_heard(flown)) or ():
                    logger.mavlink_packet(message)
                    logger.idle_task()
                for _ in range(IDLES):
                    logger.idle_task()

            flown.begin(turn, lambda: port.heartbeat_send(6, 8, 0, 0, 4))
            logs = _fly_on(flown, written, blocks)
            size = sum(map(_size, logs))
            logger.cmd_dataflash_logger(["stop"])
            flown.sleep(5.0)
            logger.logfile.close()
    ground = sorted((folder / "ground").glob("*.BIN"), key=lambda path: int(path.stem))
    same, other = _compared(logs, ground, [set() for _ in ground])
    return Streamed(size, min(same, size), other, claimed_whole=False)


def _state(folder: Path, port: Any) -> Any:
    """As much of MAVProxy as its module asks for."""
    master = SimpleNamespace(mav=port, motors_armed=lambda: True)
    return SimpleNamespace(
        status=SimpleNamespace(logdir=str(folder)),
        master=lambda *_: master,
        command_map={},
        completions={},
        completion_functions={},
        functions=None,
        console=None,
    )


def _heard(flown: SlowFlight) -> bytes:
    return b"".join(frame.raw for frame in flown.wire.at_ground.receive(0.0))


@contextlib.contextmanager
def _flying(folder: Path, script: str) -> Iterator[tuple[SlowFlight, Callable[[], list[Path]]]]:
    """A vehicle in the air, and the logs that it wrote since."""
    with pytest.MonkeyPatch.context() as patched:
        flown = SlowFlight(
            patched, "hover-ideal", None, folder / "sd", bytes_s=400_000.0, on_ground=False, script=script
        )
        flown.sleep(1.0)
        before = set((folder / "sd").glob("*.BIN"))

        def written() -> list[Path]:
            new = set((folder / "sd").glob("vehicle-*.BIN")) - before
            return sorted(new, key=lambda path: int(path.stem.partition("-")[2]))

        yield flown, written
        flown.close()


def _fly_on(flown: SlowFlight, written: Callable[[], list[Path]], blocks: int) -> list[Path]:
    """The logs until then: one more begins when the stream is ended."""
    while sum(map(_size, logs := written())) < blocks:
        flown.sleep(0.5)
    return logs


def _size(log: Path) -> int:
    return -(-log.stat().st_size // BLOCK)


def _compared(own: Sequence[Path], ground: Sequence[Path], missing: Sequence[set[int]]) -> tuple[int, int]:
    """Blocks on the ground that are as in the log of the vehicle's that they are most alike, and others."""
    same = other = 0
    logs = [_blocks(path) for path in own]
    for path, gaps in zip(ground, missing, strict=True):
        came = {number: block for number, block in enumerate(_blocks(path)) if number not in gaps}
        alike = max(
            (sum(number < len(log) and log[number] == block for number, block in came.items()) for log in logs),
            default=0,
        )
        same, other = same + alike, other + len(came) - alike
    return same, other


def _blocks(path: Path) -> list[bytes]:
    log = path.read_bytes()
    return [log[at : at + BLOCK] for at in range(0, len(log), BLOCK)]
