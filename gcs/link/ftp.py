"""MAVFTP as procedures (`gcs.link.procedures`): list a folder, read a file from any byte, ask for its CRC32.

A file is read by bursts, in which the vehicle sends up to 500 packets by itself. What was lost on the way is asked for
piece by piece when a burst is over, several pieces at a time, because an ArduPilot holds five requests and answers none
of them during a burst. A session that the vehicle has forgotten (an outage, a restart, another station) is opened
again and reading goes on where it was: whether it is still the same file only its CRC32 can tell.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from gcs.link.decode import FTP_DATA, sanitise
from gcs.link.encode import FtpRequest, Send
from gcs.link.events import Event, FtpReply
from gcs.link.patience import Patience
from gcs.link.pieces import Pieces
from gcs.link.procedures import Done, Failed

T = TypeVar("T")

NAME = "MAVFTP"
TERMINATE, LIST, OPEN, READ, CRC32, BURST = 1, 3, 4, 5, 14, 15
FAIL_ERRNO, INVALID_SESSION, NO_SESSIONS, END_OF_FILE, UNKNOWN_COMMAND, NOT_FOUND = 2, 4, 5, 6, 7, 10
REASONS = {
    1: "it failed",
    FAIL_ERRNO: "it failed",
    INVALID_SESSION: "the session is not known",
    NO_SESSIONS: "another ground station is reading files",
    END_OF_FILE: "the file ends before",
    UNKNOWN_COMMAND: "the vehicle does not do that",
    8: "the file exists",
    9: "the file is protected",
    NOT_FOUND: "there is no such file",
}
STEP = 601
"""Between the numbers of two requests: a burst's answers count up, and no number may come twice soon."""
SESSION = 113
"""Of our reading, as good as any: other stations count from 0."""
BACKLOG = 5
"""Requests that an ArduPilot holds."""
NO_ANSWER_S = 8.0
"""Without a word from its file server at the beginning: it has none."""
GIVE_UP_S = 60.0
"""Without a word from it while a file is being read: an outage that was not waited for."""


@dataclass(frozen=True, slots=True)
class FtpEntry:
    """What a folder on the vehicle holds."""

    name: str
    size: int
    folder: bool = False


def checksum(data: bytes, before: int = 0) -> int:
    """The CRC32 that autopilots answer with, `before` that of what came before: it begins at 0 and is not inverted."""
    return zlib.crc32(data, before ^ 0xFFFFFFFF) ^ 0xFFFFFFFF


def first_number(now: float) -> int:
    """For a conversation that begins now: a vehicle that gets the number of its last answer repeats that answer."""
    return int(now * 1e3) * 7919 & 0xFFFF


def path_bytes(path: str) -> bytes:
    """A name on the vehicle as it travels. Raises ValueError where it is too long."""
    raw = path.encode()
    if len(raw) >= FTP_DATA:
        raise ValueError(f"a name on the vehicle has at most {FTP_DATA - 1} bytes")
    return raw + b"\0"


class _Asking(Generic[T]):
    """One question after the other, each said again under its own number until it is answered."""

    def __init__(self, about: str, session: int, patience_s: float) -> None:
        self.outcome: Done[T] | Failed | None = None
        self._about = about
        self._session = session
        self._patience_s = patience_s
        self._patience = Patience()
        self._number = 0
        self._asked: FtpRequest | None = None

    def start(self, now: float) -> list[Send]:
        self._patience.answered_at = now
        self._number = first_number(now)
        return self._ask(now)

    def on_event(self, event: Event, now: float) -> list[Send]:
        asked = self._asked
        if self.outcome is not None or asked is None or not isinstance(event, FtpReply):
            return []
        if event.answers != asked.opcode or event.number != (asked.number + 1) & 0xFFFF:
            return []
        self._patience.answered(now)
        if not event.ack:
            return self._refused(event.data[0] if event.data else 1, now)
        return self._hear(event, now)

    def poll(self, now: float) -> list[Send]:
        if self.outcome is not None or self._asked is None or not self._patience.is_over(now):
            return []
        if now - self._patience.answered_at > self._patience_s:
            self.outcome = Failed(f"{self._about}: no answer in {self._patience_s:.0f} s", answered=False)
            return []
        self._patience.asked(now)
        return [self._asked]

    def _ask(self, now: float) -> list[Send]:
        self._number = (self._number + STEP) & 0xFFFF
        self._asked = self._request(self._number)
        self._patience.asked(now)
        return [self._asked]

    def _refused(self, error: int, now: float) -> list[Send]:
        why = REASONS.get(error, f"error {error}")
        self.outcome = Failed(f"{self._about}: {why}", answered=True)
        return []

    def _request(self, number: int) -> FtpRequest:
        raise NotImplementedError

    def _hear(self, event: FtpReply, now: float) -> list[Send]:
        raise NotImplementedError


class ListFolder(_Asking[tuple[FtpEntry, ...]]):
    """What a folder on the vehicle holds, in its order. ValueError for a name that is too long."""

    MOST = 20_000

    def __init__(self, path: str, session: int = 0) -> None:
        super().__init__(f"the vehicle's folder {sanitise(path)}", session, NO_ANSWER_S)
        self._path = path_bytes(path)
        self._count = 0
        self._entries: list[FtpEntry] = []

    def _request(self, number: int) -> FtpRequest:
        return FtpRequest(number=number, session=self._session, opcode=LIST, offset=self._count, data=self._path)

    def _hear(self, event: FtpReply, now: float) -> list[Send]:
        raw = [entry for entry in event.data.split(b"\0") if entry]
        self._count += len(raw)
        self._entries += [entry for entry in map(_entry, raw) if entry is not None]
        if not raw or self._count >= self.MOST:
            self.outcome = Done(tuple(self._entries))
            return []
        return self._ask(now)

    def _refused(self, error: int, now: float) -> list[Send]:
        if error != END_OF_FILE:
            return super()._refused(error, now)
        self.outcome = Done(tuple(self._entries))
        return []


def _entry(raw: bytes) -> FtpEntry | None:
    kind, rest = raw[:1], raw[1:].decode("utf-8", "replace")
    name, _, size = rest.partition("\t")
    if not name or name != sanitise(name):
        return None  # no name that could be asked for again
    if kind == b"D":
        return FtpEntry(name, 0, True)
    number = size.partition("\t")[0]
    return FtpEntry(name, int(number)) if kind == b"F" and number.isascii() and number.isdigit() else None


class FileChecksum(_Asking[int]):
    """The CRC32 of a file on the vehicle, which reads it through first: as `checksum` counts it."""

    def __init__(self, path: str, session: int = 0, patience_s: float = GIVE_UP_S) -> None:
        super().__init__(f"the CRC32 of {sanitise(path)}", session, patience_s)
        self._path = path_bytes(path)

    def _request(self, number: int) -> FtpRequest:
        return FtpRequest(number=number, session=self._session, opcode=CRC32, data=self._path)

    def _hear(self, event: FtpReply, now: float) -> list[Send]:
        if len(event.data) < 4:
            return self._refused(1, now)
        self.outcome = Done(int(struct.unpack_from("<I", event.data)[0]))
        return []


class ReadFile:
    """The bytes `start` up to `stop` (None: to the end) of a file on the vehicle, handed to `store` in order.

    The outcome is the file's size as the vehicle told it on opening, bytes. What `store` raises ends the reading.
    """

    WORTH_A_BURST = 24_000
    """Bytes; fewer are asked for piece by piece, so that no burst goes on for nothing."""
    REOPENINGS = 8
    """Without a byte between them."""
    BUSY_S = 10.0
    """How long another station's session is waited for."""
    SESSION_S = 3.5
    """A silent one is over then."""

    def __init__(
        self,
        path: str,
        store: Callable[[bytes], None],
        *,
        start: int = 0,
        stop: int | None = None,
        session: int = SESSION,
    ) -> None:
        """ValueError for a name that is too long."""
        self.outcome: Done[int] | Failed | None = None
        self.size: int | None = None
        """Of the whole file; None until it is open."""
        self._about = f"reading {sanitise(path)}"
        self._path = path_bytes(path)
        self._store = store
        self._stop = stop
        self._session = session
        self._pieces = Pieces(start, start)
        self._number = 0
        self._opening: FtpRequest | None = None
        self._patience = Patience()
        self._bursting = False
        self._burst_number = 0
        self._asked: list[int] = []
        """Offsets of the pieces asked for, in that order."""
        self._reopened = 0
        self._ends = 0
        self._began = 0.0

    @property
    def at(self) -> int:
        """All before it was handed on."""
        return self._pieces.at

    def start(self, now: float) -> list[Send]:
        self._began = self._patience.answered_at = now
        self._number = first_number(now)
        return self._open(now)

    def farewell(self) -> list[Send]:
        """What ends the session, whatever became of it."""
        return [self._request(TERMINATE)]

    def on_event(self, event: Event, now: float) -> list[Send]:
        if self.outcome is not None or not isinstance(event, FtpReply):
            return []
        if event.answers == OPEN:
            return self._on_open(event, now)
        if self._opening is not None or event.session != self._session or event.answers not in (READ, BURST):
            return []
        return self._on_piece(event, now) if event.ack else self._on_refusal(event, now)

    def poll(self, now: float) -> list[Send]:
        if self.outcome is not None or not self._patience.is_over(now):
            return []
        limit_s = NO_ANSWER_S if self.size is None else GIVE_UP_S
        if now - self._patience.answered_at > limit_s:
            self.outcome = Failed(f"{self._about}: no answer in {limit_s:.0f} s", answered=False)
            return []
        if self._opening is not None:
            self._patience.asked(now)
            return [self._opening]
        # Silence: the burst's last packet was lost, or the pieces asked for.
        self._bursting = False
        self._asked.clear()
        return self._go_on(now)

    def _request(self, opcode: int, offset: int = 0, size: int = 0, data: bytes = b"") -> FtpRequest:
        self._number = (self._number + STEP) & 0xFFFF
        return FtpRequest(
            number=self._number, session=self._session, opcode=opcode, offset=offset, size=size, data=data
        )

    # Opening

    def _open(self, now: float) -> list[Send]:
        self._bursting = False
        self._asked.clear()
        self._opening = self._request(OPEN, data=self._path)
        self._patience.asked(now)
        return [self._opening]

    def _on_open(self, event: FtpReply, now: float) -> list[Send]:
        if self._opening is None or event.number != (self._opening.number + 1) & 0xFFFF:
            return []
        self._patience.answered(now)
        if not event.ack:
            return self._not_opened(event.data[0] if event.data else 1, now)
        size = int(struct.unpack("<I", event.data[:4].ljust(4, b"\0"))[0])
        self.size, self._opening, self._session = size, None, event.session
        pieces = self._pieces
        if size < pieces.highest:
            self.outcome = Failed(f"{self._about}: it is shorter than it was, {size:,} bytes", answered=True)
            return self.farewell()
        pieces.stop = size if self._stop is None else min(size, self._stop)
        return self._go_on(now)

    def _not_opened(self, error: int, now: float) -> list[Send]:
        if error == NO_SESSIONS and now - self._began < self.BUSY_S:
            # A question of its own, or the vehicle would only repeat its answer; and not before a silent session is
            # over, which each answer, this one too, may have kept alive.
            self._opening = self._request(OPEN, data=self._path)
            self._patience.pause(now, self.SESSION_S)
            return []
        self.outcome = Failed(f"{self._about}: {REASONS.get(error, f'error {error}')}", answered=True)
        return []

    # Reading

    def _on_piece(self, event: FtpReply, now: float) -> list[Send]:
        if event.answers == READ and event.offset in self._asked:
            # Answers come in the order of the questions: those before it are lost.
            del self._asked[: self._asked.index(event.offset) + 1]
        before = self._pieces.at
        data = self._pieces.add(event.offset, event.data)
        if data:
            self._store(data)
        self._patience.answered(now)
        if self._pieces.at > before:
            self._reopened = self._ends = 0
            self._began = now
        ours = (event.number - self._burst_number) & 0xFFFF < STEP
        if event.answers == BURST and ours and (event.burst_complete or len(event.data) < FTP_DATA):
            self._bursting = False
            self._asked.clear()  # what was asked for before the burst would have come before it
        return self._go_on(now)

    def _on_refusal(self, event: FtpReply, now: float) -> list[Send]:
        error = event.data[0] if event.data else 1
        self._bursting = False
        self._asked.clear()
        if error == END_OF_FILE:
            self._ends += 1
            if self._ends > self.REOPENINGS and not self._pieces.whole:
                ends = f"it ends at byte {self._pieces.at:,} of the {self.size:,} that the vehicle told"
                self.outcome = Failed(f"{self._about}: {ends}", answered=True)
                return self.farewell()
            return self._go_on(now)
        if self._reopened >= self.REOPENINGS:
            self.outcome = Failed(f"{self._about}: {REASONS.get(error, f'error {error}')}", answered=True)
            return self.farewell()
        self._reopened += 1
        self._began = now
        return self._open(now)

    def _go_on(self, now: float) -> list[Send]:
        """What to ask for now: nothing while a burst is on its way."""
        pieces = self._pieces
        if pieces.whole:
            self.outcome = Done(self.size or 0)
            return self.farewell()
        if self._bursting:
            return []
        rest = pieces.stop - pieces.highest
        if 0 < rest <= self.WORTH_A_BURST:
            pieces.want(pieces.stop)
            rest = 0
        sends: list[Send] = [self._request(READ, offset, size) for offset, size in self._due()]
        if rest > 0 and len(self._asked) < BACKLOG:
            self._bursting = True
            sends.append(self._request(BURST, pieces.highest, FTP_DATA))
            self._burst_number = self._number
        if sends:
            self._patience.asked(now)
        return sends

    def _due(self) -> list[tuple[int, int]]:
        """Pieces to ask for, as many as the vehicle holds."""
        due: list[tuple[int, int]] = []
        for first, last in self._pieces.missing:
            for offset in range(first, last, FTP_DATA):
                if len(self._asked) >= BACKLOG:
                    return due
                if offset not in self._asked:
                    self._asked.append(offset)
                    due.append((offset, min(FTP_DATA, last - offset)))
        return due
