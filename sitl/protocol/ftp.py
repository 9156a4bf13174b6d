"""MAVFTP as ArduPilot serves it: one session, five requests waiting, bursts of 500 packets that nothing interrupts.

Only reading: listing, opening, ReadFile, BurstReadFile, CRC32, ending. A request that comes again with the number of
the last one gets the last answer again. A session that was silent for 3 s may be taken over. Whatever is not offered is
an unknown command. Files: `logs/00000001.BIN` and so on, and the parameters as `@PARAM/param.pck`.
"""

from __future__ import annotations

import errno
import struct
import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.storage import BY_FTP, Allowance, StoredLog, read
from sitl.autopilot.vehicle import Vehicle
from sitl.protocol.links import Address
from sitl.protocol.log_download import Peer
from sitl.protocol.param_file import FOLDER, ParamFile, part_of
from sitl.protocol.telemetry import Message

HEADER = struct.Struct("<HBBBBBxI")
"""Number, session, opcode, size, opcode answered, burst complete, offset."""
DATA = 239
BURST_PACKETS = 500
BACKLOG = 5
SESSION_TIMEOUT_S = 3.0
_FRAME = 251 + 15
_MOST_A_POLL = 60

ACK, NAK = 128, 129
FAIL_ERRNO, INVALID_SESSION, NO_SESSIONS, END_OF_FILE, UNKNOWN_COMMAND, NOT_FOUND = 2, 4, 5, 6, 7, 10
LOGS = "logs"

Reader = Callable[[int, int], bytes | None]
"""Of an open file: up to so many bytes from an offset, fewer at the end; None where it cannot be read so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Packet:
    """What a FILE_TRANSFER_PROTOCOL message carries."""

    number: int
    session: int
    opcode: int
    answers: int = 0
    burst_complete: bool = False
    offset: int = 0
    size: int = 0
    data: bytes = b""

    def pack(self) -> bytes:
        """251 bytes."""
        head = (self.number & 0xFFFF, self.session, self.opcode, self.size, self.answers, self.burst_complete)
        return (HEADER.pack(*head, self.offset & 0xFFFFFFFF) + self.data).ljust(251, b"\0")


def unpack(payload: bytes) -> Packet:
    """The packet in 251 bytes; a size that exceeds them is cut."""
    number, session, opcode, size, answers, complete, offset = HEADER.unpack(payload[: HEADER.size].ljust(12, b"\0"))
    data = payload[HEADER.size :].ljust(DATA, b"\0")[:DATA]
    return Packet(
        number=number,
        session=session,
        opcode=opcode,
        answers=answers,
        burst_complete=bool(complete),
        offset=offset,
        size=size,
        data=data[: min(size, DATA)],
    )


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request, and who made it."""

    peer: Peer
    system: int
    component: int
    packet: Packet

    @property
    def text(self) -> str:
        return self.packet.data.split(b"\0")[0].decode("utf-8", "replace")


@dataclass(slots=True)
class _Burst:
    asked: _Asked
    number: int
    offset: int
    left: int = BURST_PACKETS


class FtpServer:
    """Answers for one vehicle."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._waiting: deque[_Asked] = deque()
        self._burst: _Burst | None = None
        self._open: Reader | None = None
        self._session: int | None = None
        self._used_s = 0.0
        self._last: tuple[_Asked, Packet] | None = None
        self._allowance = Allowance(vehicle.storage.bytes_per_s)

    @property
    def address(self) -> Address | None:
        """Whom it sends to next."""
        asked = self._burst.asked if self._burst is not None else self._waiting[0] if self._waiting else None
        return None if asked is None else asked.peer.address

    def hear(self, peer: Peer, message: Message) -> None:
        """A request; it waits for its turn, and is lost where five wait already."""
        if self._vehicle.storage.offers(BY_FTP) and len(self._waiting) < BACKLOG:
            packet = unpack(bytes(message.payload))
            self._waiting.append(_Asked(peer, message.get_srcSystem(), message.get_srcComponent(), packet))

    def poll(self, now_s: float, room: bool) -> None:
        """Send the next slice of a burst, then answer what waits."""
        self._allowance.grow(now_s)
        for _ in range(_MOST_A_POLL):
            if not room or (self._burst is None and not self._waiting) or not self._allowance.take(_FRAME):
                return
            if self._burst is not None:
                self._burst_on(self._burst)
            else:
                self._answer(self._waiting.popleft(), now_s)
            self._used_s = now_s

    def forget(self, address: Address) -> None:
        """Nobody listens there any more."""
        self._waiting = deque(asked for asked in self._waiting if asked.peer.address != address)
        if self._burst is not None and self._burst.asked.peer.address == address:
            self._burst = None

    def _send(self, asked: _Asked, packet: Packet) -> None:
        self._last = (asked, packet)
        message = mavlink.MAVLink_file_transfer_protocol_message(0, asked.system, asked.component, packet.pack())
        asked.peer.send(message)

    def _reply(self, asked: _Asked, data: bytes = b"", error: int | None = None) -> None:
        if error is not None:
            data = bytes((error, errno.EINVAL)) if error == FAIL_ERRNO else bytes([error])
        self._send(
            asked,
            Packet(
                number=asked.packet.number + 1,
                session=asked.packet.session,
                opcode=ACK if error is None else NAK,
                answers=asked.packet.opcode,
                offset=asked.packet.offset,
                size=len(data),
                data=data,
            ),
        )

    def _is_again(self, asked: _Asked) -> bool:
        if self._last is None:
            return False
        before, reply = self._last
        same = (before.system, before.component) == (asked.system, asked.component)
        return same and reply.session == asked.packet.session and reply.number == (asked.packet.number + 1) & 0xFFFF

    def _answer(self, asked: _Asked, now_s: float) -> None:
        if self._is_again(asked):
            assert self._last is not None
            self._send(asked, self._last[1])
            return
        packet = asked.packet
        match packet.opcode:
            case 0:
                self._reply(asked)
            case mavlink.MAV_FTP_OPCODE_TERMINATESESSION | mavlink.MAV_FTP_OPCODE_RESETSESSION:
                if packet.opcode == mavlink.MAV_FTP_OPCODE_RESETSESSION or packet.session == self._session:
                    self._open = self._session = None
                self._reply(asked)
            case mavlink.MAV_FTP_OPCODE_LISTDIRECTORY:
                self._list(asked)
            case mavlink.MAV_FTP_OPCODE_OPENFILERO:
                self._open_file(asked, now_s)
            case mavlink.MAV_FTP_OPCODE_CALCFILECRC:
                self._checksum(asked)
            case mavlink.MAV_FTP_OPCODE_READFILE | mavlink.MAV_FTP_OPCODE_BURSTREADFILE:
                self._read(asked)
            case _:
                self._reply(asked, error=UNKNOWN_COMMAND)

    def _log(self, name: str) -> StoredLog | None:
        """The file of that name, None where there is none."""
        folder, _, file = name.lstrip("./").rpartition("/")
        if folder != LOGS:
            return None
        return next((log for log in self._vehicle.storage.logs() if f"{log.number:08}.BIN" == file), None)

    def _list(self, asked: _Asked) -> None:
        name = asked.text.strip("/.")
        if name == LOGS:
            entries = [f"F{log.number:08}.BIN\t{log.size}" for log in self._vehicle.storage.logs()]
        elif not name:
            entries = [f"D{LOGS}", f"D{FOLDER}"]
        else:
            self._reply(asked, error=NOT_FOUND)
            return
        data = b""
        for entry in entries[asked.packet.offset :]:
            more = entry.encode() + b"\0"
            if len(data) + len(more) > DATA:
                break
            data += more
        self._reply(asked, data, None if data else END_OF_FILE)

    def _open_file(self, asked: _Asked, now_s: float) -> None:
        taken = self._open is not None and asked.packet.session != self._session
        if taken and now_s - self._used_s < SESSION_TIMEOUT_S:
            self._reply(asked, error=NO_SESSIONS)
            return
        try:
            file = self._file(asked.text)
        except ValueError:
            self._reply(asked, error=FAIL_ERRNO)
            return
        if file is None:
            self._reply(asked, error=NOT_FOUND)
            return
        (self._open, size), self._session = file, asked.packet.session
        self._reply(asked, struct.pack("<I", min(size, 0xFFFFFFFF)))

    def _file(self, name: str) -> tuple[Reader, int] | None:
        """The file and its size, bytes; None where there is none. Raises ValueError for what cannot be asked of it."""
        part = part_of(name)
        if part is not None:
            parameters = ParamFile(self._vehicle.parameters, part)
            return parameters.read, parameters.size
        log = self._log(name)
        return None if log is None else (partial(read, log.path), log.size)

    def _checksum(self, asked: _Asked) -> None:
        log = self._log(asked.text)
        content = None if log is None else read(log.path, 0, log.size)
        if content is None:
            self._reply(asked, error=NOT_FOUND)
            return
        # ArduPilot's CRC begins at 0 and is not inverted, as zlib's is.
        self._reply(asked, struct.pack("<I", zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF))

    def _read(self, asked: _Asked) -> None:
        packet = asked.packet
        if self._open is None:
            self._reply(asked, error=NOT_FOUND)
        elif packet.session != self._session:
            self._reply(asked, error=INVALID_SESSION)
        elif packet.opcode == mavlink.MAV_FTP_OPCODE_BURSTREADFILE:
            self._burst = _Burst(asked, packet.number + 1, packet.offset)
            self._burst_on(self._burst)
        else:
            data = self._open(packet.offset, min(packet.size, DATA))
            error = FAIL_ERRNO if data is None else None if data else END_OF_FILE
            self._reply(asked, data or b"", error)

    def _burst_on(self, burst: _Burst) -> None:
        """The next packet of a burst. A file's end is told as such, behind its last packet, and completes no burst."""
        size = min(burst.asked.packet.size or DATA, DATA)
        data = None if self._open is None else self._open(burst.offset, size)
        if not data:
            packet = replace(burst.asked.packet, number=burst.number - 1, offset=burst.offset)
            self._burst = None
            self._reply(replace(burst.asked, packet=packet), error=FAIL_ERRNO if data is None else END_OF_FILE)
            return
        burst.left -= 1
        self._send(
            burst.asked,
            Packet(
                number=burst.number,
                session=burst.asked.packet.session,
                opcode=ACK,
                answers=burst.asked.packet.opcode,
                burst_complete=burst.left == 0,
                offset=burst.offset,
                size=len(data),
                data=data,
            ),
        )
        burst.number += 1
        burst.offset += len(data)
        if burst.left == 0:
            self._burst = None
