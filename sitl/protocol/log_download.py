"""LOG_REQUEST_LIST, _DATA and _END as ArduPilot answers them: one download at a time, in slices, until told to end.

A request's first slice goes out with it, so several short requests at once are all answered: MAVProxy fills gaps so.
While something is being sent, further requests are dropped without a word, and another station's with a text. While
armed everything is refused with a text. Entries are numbered from 1, the oldest log first, whatever its file is called.
Nothing is erased here.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Severity
from sitl.autopilot.storage import BY_MESSAGES, Allowance, StoredLog, read
from sitl.autopilot.vehicle import Vehicle
from sitl.protocol.links import Address
from sitl.protocol.telemetry import Message

PIECE = 90
_WARNED_AGAIN_S = 5.0
_MOST_A_POLL = 60
ARMED = "Disarm for log download"
BUSY = "Log download in progress"


class Peer(Protocol):
    """Who asks."""

    address: Address

    def send(self, message: Message) -> None: ...


@dataclass(slots=True, kw_only=True)
class _Sending:
    """What is on its way to one peer: the rest of a list, or of a stretch of one log."""

    peer: Peer
    entries: deque[tuple[int, StoredLog]]
    count: int
    last: int
    """Of the list: the last entry asked for, or the last there is."""
    log: StoredLog | None = None
    id: int = 0
    offset: int = 0
    left: int = 0

    @property
    def over(self) -> bool:
        return not self.entries and self.log is None


class LogDownload:
    """Answers for one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._waiting: deque[tuple[Peer, Message]] = deque()
        self._sending: _Sending | None = None
        self._allowance = Allowance(vehicle.storage.bytes_per_s)
        self._warned_s: float | None = None

    def hear(self, peer: Peer, message: Message) -> None:
        """One of the four messages; it is answered at the next poll."""
        if self._vehicle.storage.offers(BY_MESSAGES) and not self._refuses(self._vehicle.time_s):
            self._waiting.append((peer, message))

    def poll(self, now_s: float, room: bool) -> None:
        """Take what was asked for meanwhile, each with its first slice, and send the next one."""
        self._allowance.grow(now_s)
        while self._waiting:
            before = self._sending
            self._take(*self._waiting.popleft())
            if self._sending is not before:
                self._send_slice(room)
        self._send_slice(room)

    def _take(self, peer: Peer, message: Message) -> None:
        match message.get_msgId():
            case mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST:
                self._list(peer, message)
            case mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA:
                self._read(peer, message)
            case mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END:
                self._sending = None
            case _:
                self._vehicle.say(Severity.WARNING, "Erasing logs is not possible here")

    def _send_slice(self, room: bool) -> None:
        sending = self._sending
        if sending is None or not room or self._vehicle.armed:
            return
        for _ in range(_MOST_A_POLL):
            if sending.over or not self._allowance.take(PIECE + 19):
                break
            self._send_next(sending)
        if sending.over:
            self._sending = None

    @property
    def address(self) -> Address | None:
        """Whom it sends to."""
        peer = self._sending.peer if self._sending is not None else self._waiting[0][0] if self._waiting else None
        return None if peer is None else peer.address

    def forget(self, address: Address) -> None:
        """Nobody listens there any more."""
        self._waiting = deque(asked for asked in self._waiting if asked[0].address != address)
        if self._sending is not None and self._sending.peer.address == address:
            self._sending = None

    def _refuses(self, now_s: float) -> bool:
        if not self._vehicle.armed:
            return False
        if self._warned_s is None or now_s - self._warned_s >= _WARNED_AGAIN_S:
            self._warned_s = now_s
            self._vehicle.say(Severity.ERROR, ARMED)
        return True

    def _is_busy(self, peer: Peer) -> bool:
        if self._sending is not None and self._sending.peer is not peer:
            self._vehicle.say(Severity.INFO, BUSY)
        return self._sending is not None

    def _list(self, peer: Peer, message: Message) -> None:
        if self._is_busy(peer):
            return
        logs = self._vehicle.storage.logs()
        if not logs:
            peer.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0))
            return
        numbered = enumerate(logs, 1)
        wanted = deque((id, log) for id, log in numbered if message.start <= id <= message.end)
        self._sending = _Sending(peer=peer, entries=wanted, count=len(logs), last=min(message.end, len(logs)))

    def _read(self, peer: Peer, message: Message) -> None:
        if self._is_busy(peer):
            return
        logs = self._vehicle.storage.logs()
        if not 1 <= message.id <= len(logs):
            return
        log = logs[message.id - 1]
        left = min(message.count, max(0, log.size - message.ofs))
        self._sending = _Sending(
            peer=peer,
            entries=deque(),
            count=len(logs),
            last=len(logs),
            log=log,
            id=message.id,
            offset=message.ofs,
            left=left,
        )

    def _send_next(self, sending: _Sending) -> None:
        if sending.entries:
            id, log = sending.entries.popleft()
            size = min(log.size, 0xFFFFFFFF)
            sending.peer.send(mavlink.MAVLink_log_entry_message(id, sending.count, sending.last, log.written_s, size))
            return
        assert sending.log is not None
        data = read(sending.log.path, sending.offset, min(PIECE, sending.left)) or b""
        sending.peer.send(
            mavlink.MAVLink_log_data_message(sending.id, sending.offset, len(data), data.ljust(PIECE, b"\0"))
        )
        sending.offset += len(data)
        sending.left -= len(data)
        if len(data) < PIECE or sending.left <= 0:
            sending.log = None
