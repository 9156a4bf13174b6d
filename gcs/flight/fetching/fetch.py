"""A log off the vehicle into a file: the way that is quicker, on from where an earlier attempt was cut, and checked.

Nothing is ever written over. What lies there under the log's name is gone on with, or taken for the log itself, only
where its bytes are the vehicle's; else the next name is taken.
"""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from gcs.errors import TippathError
from gcs.flight.fetching import ways
from gcs.flight.fetching.part import PartFile, checksum_of, part_of, piece_of
from gcs.flight.fetching.times import Read
from gcs.flight.fetching.ways import BY_FTP, BY_MESSAGES, Connection, VehicleLog
from gcs.link.log_files import ListLogs
from gcs.link.procedures import ProcedureError, RefusedError

TRIAL_BYTES = {BY_FTP: 119_500, BY_MESSAGES: 65_536}
"""After so many of the log a way's rate is known: of MAVFTP, one burst."""
WORTH_ASKING_S = 20.0
"""Where the rest takes longer, the other way is tried."""
SAME_PIECE = 200
GROWS_FOR_S = 30.0
"""An ArduPilot writes on for 15 s after disarming; a log that grows longer is taken as it is then."""
RATE_OVER_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How far it is."""

    log: VehicleLog
    way: str
    at: int
    """Bytes of the log that are there."""
    size: int
    rate: float | None
    """Bytes a second over the last seconds; None while not known."""
    lost_s: float | None
    """Since when the vehicle was not heard; None while it is."""

    @property
    def left_s(self) -> float | None:
        return None if not self.rate else (self.size - self.at) / self.rate


@dataclass(frozen=True, slots=True, kw_only=True)
class Fetched:
    """A log, or a run of it, on disk."""

    path: Path
    log: VehicleLog
    size: int
    """Bytes of the file."""
    way: str
    seconds: float
    came: int
    """Bytes that came now."""
    resumed_from: int = 0
    crc32: int
    checked: bool
    """The vehicle's CRC32 of its file is the same."""
    grows: bool = False
    """The vehicle was still writing it."""
    already: bool = False
    """It was there."""
    runs: tuple[int, ...] = ()
    """The flight's runs that it holds alone; none for the whole log."""

    @classmethod
    def of_part(
        cls,
        part: PartFile,
        log: VehicleLog,
        way: str,
        *,
        crc32: int,
        checked: bool = False,
        grows: bool = False,
        runs: Sequence[int] = (),
    ) -> Fetched:
        """Of a file that has come to its end."""
        return cls(
            path=part.target,
            log=log,
            size=part.size,
            way=way,
            seconds=part.seconds,
            came=part.size - part.resumed_from,
            resumed_from=part.resumed_from,
            crc32=crc32,
            checked=checked,
            grows=grows,
            runs=tuple(runs),
        )

    @classmethod
    def there(
        cls, path: Path, log: VehicleLog, way: str, *, theirs: int | None = None, runs: Sequence[int] = ()
    ) -> Fetched:
        """Of a file that was there; `theirs` is the vehicle's CRC32 of it. Raises TippathError where it cannot be
        read."""
        crc = checksum_of(path)
        size = path.stat().st_size
        return cls(
            path=path, log=log, size=size, way=way, seconds=0.0, came=0, crc32=crc, checked=theirs == crc,
            already=True, runs=tuple(runs),
        )  # fmt: skip

    def to_json(self) -> dict[str, Any]:
        return {
            "file": str(self.path),
            "log": self.log.number,
            "on_vehicle": self.log.path,
            "bytes": self.size,
            "by": ways.NAMES[self.way],
            "seconds": round(self.seconds, 2),
            "bytes_per_s": round(self.came / self.seconds) if self.seconds > 0 else None,
            "resumed_from": self.resumed_from,
            "crc32": f"{self.crc32:08x}",
            "checked": self.checked,
            "grows": self.grows,
            "already": self.already,
            "run": self.runs[0] if len(self.runs) == 1 else None,
            "runs": list(self.runs) or None,
        }


@dataclass(kw_only=True)
class Fetching:
    """What a fetch needs: the vehicle, whom to tell, and the time."""

    session: Connection
    by: str | None = None
    """Admit one way only."""
    on_progress: Callable[[Progress], None] = lambda progress: None
    clock: Callable[[], float] = time.monotonic
    wait: Callable[[float], None] = time.sleep
    rate: float | None = None
    """Bytes a second of the longest reading so far; None before there was one."""
    _longest: int = 0
    _seen: deque[tuple[float, int]] = field(default_factory=deque)
    _kept: dict[tuple[int, int, int], bytes] = field(default_factory=dict)

    def ways_of(self, log: VehicleLog) -> tuple[str, ...]:
        """By which the log can be read. Raises TippathError where there is none."""
        offered = tuple(way for way in log.ways if self.by in (None, way))
        if not offered:
            raise TippathError(f"log {log.number} is not to be had by {ways.NAMES.get(self.by or '', 'any way')}")
        return offered

    def reading(self, log: VehicleLog) -> Read:
        """Some bytes of a log, by the way that is there, each once; how far that is is not told."""

        def read(start: int, stop: int) -> bytes:
            key = (log.number, start, stop)
            if key not in self._kept:
                came = bytearray()
                if start < stop:
                    self.read(log, self.ways_of(log)[0], came.extend, start, stop, None, lambda: start + len(came))
                self._kept[key] = bytes(came)
            return self._kept[key]

        return read

    def read(
        self,
        log: VehicleLog,
        way: str,
        store: Callable[[bytes], Any],
        start: int,
        stop: int,
        size: int | None,
        at: Callable[[], int],
    ) -> None:
        """Bytes of a log; told as so far of `size`. Raises TippathError where the vehicle was armed meanwhile."""
        self._seen.clear()
        began = self.clock()

        def watch() -> None:
            snapshot = self.session.snapshot()
            if snapshot.armed:
                raise TippathError("the vehicle was armed under way, so fetching has ended; what came is kept")
            lost_s = snapshot.link_age_s if snapshot.lost else None
            rate = None if size is None else self._rate(at())
            self.on_progress(Progress(log=log, way=way, at=at(), size=size or stop, rate=rate, lost_s=lost_s))

        ways.read(self.session, log, way, store, start=start, stop=stop, watch=watch)
        took = self.clock() - began
        if stop - start > self._longest and took > 0:
            self._longest, self.rate = stop - start, (stop - start) / took

    def _rate(self, at: int) -> float | None:
        now, seen = self.clock(), self._seen
        seen.append((now, at))
        while now - seen[0][0] > RATE_OVER_S:
            seen.popleft()
        took = now - seen[0][0]
        return (at - seen[0][1]) / took if took > 0.5 else None

    def size_now(self, log: VehicleLog) -> int:
        """As the vehicle tells it now. Raises TippathError where the log has vanished."""
        now = next((one for one in ways.list_logs(self.session) if one.number == log.number), None)
        if now is None:
            raise TippathError(f"log {log.number} has vanished from the vehicle; what came is kept")
        return now.size


def require_disarmed(session: Connection) -> None:
    """Raises TippathError, with the vehicle's words, where it is armed."""
    if not session.snapshot().armed:
        return
    words = ""
    try:
        session.call(ListLogs(), 2.0)
    except RefusedError as error:
        words = f" ({error})"
    except ProcedureError:
        pass
    raise TippathError(
        f"the vehicle is armed{words}: logs are fetched on the ground. Land, disarm, give it 15 s to end its log, and "
        "give the same command again"
    )


def fetch(fetching: Fetching, log: VehicleLog, folder: Path, stem: str) -> Fetched:
    """The whole log into `folder` as `stem`.BIN, or under the next free name.

    Raises TippathError: refused, unanswered, a disk that is full, bytes that are not the vehicle's.
    """
    read = fetching.reading(log)
    target, already = target_of(folder, stem, log, read)
    if already:
        theirs = ways.checksum_on_board(fetching.session, log)
        return Fetched.there(target, log, fetching.ways_of(log)[0], theirs=theirs)
    with PartFile(target, fetching.clock) as part:
        way, log, grows = _to_its_end(fetching, log, part)
        crc = part.checksum()
        theirs = None if grows else ways.checksum_on_board(fetching.session, log)
        if theirs is not None and theirs != crc:
            if fetching.size_now(log) == part.size:
                raise _other_bytes(part, crc, theirs)
            theirs, grows = None, True
        part.finish()
        return Fetched.of_part(part, log, way, crc32=crc, checked=theirs is not None, grows=grows)


def _other_bytes(part: PartFile, ours: int, theirs: int) -> TippathError:
    aside = part.path.with_name(f"{part.path.name}.wrong")
    with contextlib.suppress(OSError):
        part.path.replace(aside)
    return TippathError(
        f"what came is not what the vehicle has: CRC32 {ours:08x}, and {theirs:08x} on board. It is kept as "
        f"{aside.name}; give the same command again to fetch it anew"
    )


# The name


def target_of(folder: Path, stem: str, log: VehicleLog, read: Read) -> tuple[Path, bool]:
    """Where the log goes, and whether it is there already."""
    number = 1
    while True:
        target = folder / (f"{stem}.BIN" if number == 1 else f"{stem}-{number}.BIN")
        if target.exists():
            if target.stat().st_size == log.size and is_of(target, log, read):
                return target, True
        elif not part_of(target).exists() or is_of(part_of(target), log, read):
            return target, False
        number += 1


def is_of(path: Path, log: VehicleLog, read: Read) -> bool:
    """Whether a file is a beginning of the log, by its length and by pieces of it: first, middle, last and between."""
    size = path.stat().st_size
    if size > log.size:
        return False
    places = sorted({max(0, (size - SAME_PIECE) * share // 8) for share in range(9)}, reverse=True)
    return all(piece_of(path, at, min(size, at + SAME_PIECE)) == read(at, min(size, at + SAME_PIECE)) for at in places)


# The bytes


def _to_its_end(fetching: Fetching, log: VehicleLog, part: PartFile) -> tuple[str, VehicleLog, bool]:
    """Read until the log grows no more: the way, the log with its size, and whether it grows still."""
    way, grown_since = _fill(fetching, log, part, log.size), fetching.clock()
    while True:
        fetching.wait(1.0)
        size = fetching.size_now(log)
        if size < part.size:
            raise TippathError(f"log {log.number} is shorter than what came of it; was the vehicle restarted?")
        if size == part.size or size >= ways.LARGEST:
            return way, replace(log, size=part.size), False
        if fetching.clock() - grown_since > GROWS_FOR_S:
            return way, replace(log, size=part.size), True
        log = replace(log, size=size)
        _read_on(fetching, log, part, way, size)


def _fill(fetching: Fetching, log: VehicleLog, part: PartFile, size: int) -> str:
    """Read up to `size` by the way that proves quicker; that way."""
    offered = fetching.ways_of(log)
    rates: dict[str, float] = {}
    for way in offered if len(offered) > 1 else ():
        if part.size < size:
            rates[way] = _tried(fetching, log, part, way, size)
        if part.size >= size or (size - part.size) / rates[way] < WORTH_ASKING_S:
            break
    way = max(rates, key=lambda way: rates[way], default=offered[0])
    _read_on(fetching, log, part, way, size)
    return way


def _tried(fetching: Fetching, log: VehicleLog, part: PartFile, way: str, size: int) -> float:
    """The rate, bytes a second, of a stretch by this way; 0.001 where it does not answer."""
    began, before = fetching.clock(), part.size
    try:
        _read_on(fetching, log, part, way, min(size, part.size + TRIAL_BYTES[way]), size)
    except ProcedureError:
        if fetching.session.snapshot().lost or way == fetching.ways_of(log)[0]:
            raise
    return max(1e-3, (part.size - before) / max(1e-3, fetching.clock() - began))


def _read_on(fetching: Fetching, log: VehicleLog, part: PartFile, way: str, stop: int, size: int | None = None) -> None:
    if part.size < stop:
        told = stop if size is None else size
        fetching.read(log, way, part.append, part.size, stop, told, lambda: part.size)
