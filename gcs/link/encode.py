"""What the ground says: small values, turned into MAVLink 2 frames in one place.

A send names no system: the session knows whom it talks to and who it is, and an encoder adds both.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.link.decode import FTP_DATA, FTP_HEADER
from gcs.link.signing import Signing

START_BLOCKS = 2147483646
STOP_BLOCKS = 2147483645
STATION_COMPONENT = 190

REQUEST_MESSAGE = 512
SET_MESSAGE_INTERVAL = 511
DO_SET_MODE = 176
AUTOPILOT_VERSION = 148

TELEMETRY = {30: 0.1, 1: 1.0, 226: 0.2}
"""Message -> wanted interval, s: ATTITUDE, SYS_STATUS, RPM. Asked for only while the vehicle does not send it, because
intervals outlive us."""

ATTITUDE, SERVO_OUTPUT_RAW = 30, 36


@dataclass(frozen=True, slots=True)
class StationHeartbeat:
    """We are here: a ground station."""


@dataclass(frozen=True, slots=True)
class ParamRead:
    """Ask for one parameter, by name, or by index where the name is empty."""

    name: str = ""
    index: int = -1


@dataclass(frozen=True, slots=True)
class ParamList:
    """Ask for all parameters."""


@dataclass(frozen=True, slots=True)
class ParamWrite:
    """Set one parameter to exactly these 32 bits."""

    name: str
    bits: int
    kind: int


@dataclass(frozen=True, slots=True)
class Command:
    """A COMMAND_LONG; `attempt` counts repetitions of the same command."""

    command: int
    parameters: tuple[float, ...] = ()
    attempt: int = 0


@dataclass(frozen=True, slots=True)
class BlockStatus:
    """Of log block `number`: kept (true), or missing and wanted again; or START_BLOCKS, STOP_BLOCKS with true."""

    number: int
    kept: bool


@dataclass(frozen=True, slots=True)
class Ping:
    """A TIMESYNC question, which the vehicle answers at once with its own clock and this nonce (above 0)."""

    nonce: int


@dataclass(frozen=True, slots=True)
class LogListRequest:
    """Which logs are on board? Entries `first` to `last`."""

    first: int = 0
    last: int = 0xFFFF


@dataclass(frozen=True, slots=True)
class LogDataRequest:
    """`size` bytes of the log `id`, from `offset`."""

    id: int
    offset: int
    size: int


@dataclass(frozen=True, slots=True)
class LogEnd:
    """No more of a list or a log: until this is heard it goes on."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FtpRequest:
    """A request of MAVFTP; asked again it keeps its number. At most 239 bytes of `data`."""

    number: int
    session: int
    opcode: int
    offset: int = 0
    size: int = 0
    data: bytes = b""


Send = (
    StationHeartbeat
    | Ping
    | ParamRead
    | ParamList
    | ParamWrite
    | Command
    | BlockStatus
    | LogListRequest
    | LogDataRequest
    | LogEnd
    | FtpRequest
)


class Encoder:
    """Frames of one station to one vehicle; counts their sequence numbers.

    `target` is (system, component), (0, 0) while the vehicle is not known. With `signing` each is signed. Not for
    several threads at once.
    """

    def __init__(self, system: int, component: int = STATION_COMPONENT, signing: Signing | None = None) -> None:
        self.target = (0, 0)
        self._mav: Any = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._signing = signing
        if signing is not None:
            signing.equip(self._mav)

    def encode(self, send: Send) -> bytes:
        """One frame. Raises ValueError for what MAVLink cannot carry, such as a name of 17 letters."""
        if self._signing is not None:
            self._signing.stamp(self._mav)
        frame: bytes = self._frame(send)
        self._mav.seq = (self._mav.seq + 1) % 256
        return frame

    def _frame(self, send: Send) -> bytes:
        system, component = self.target
        message: Any
        match send:
            case StationHeartbeat():
                message = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
            case Ping(nonce):
                message = dialect.MAVLink_timesync_message(0, nonce)
            case ParamRead(name, index):
                message = dialect.MAVLink_param_request_read_message(system, component, _name(name), index)
            case ParamList():
                message = dialect.MAVLink_param_request_list_message(system, component)
            case ParamWrite(name, bits, kind):
                message = dialect.MAVLink_param_set_message(system, component, _name(name), 0.0, kind)
                # Packed here, because a Python float does not keep the bits of every NaN.
                payload = struct.pack("<IBB16sB", bits, system, component, _name(name), kind)
                return bytes(message._pack(self._mav, message.crc_extra, payload))
            case Command(command, parameters, attempt):
                seven = (*parameters, *(0.0,) * 7)[:7]
                message = dialect.MAVLink_command_long_message(system, component, command, attempt % 256, *seven)
            case BlockStatus(number, kept):
                message = dialect.MAVLink_remote_log_block_status_message(system, component, number, int(kept))
            case LogListRequest(first, last):
                message = dialect.MAVLink_log_request_list_message(system, component, first, last)
            case LogDataRequest(id, offset, size):
                message = dialect.MAVLink_log_request_data_message(system, component, id, offset, size)
            case LogEnd():
                message = dialect.MAVLink_log_request_end_message(system, component)
            case FtpRequest():
                message = dialect.MAVLink_file_transfer_protocol_message(0, system, component, _ftp_payload(send))
        return bytes(message.pack(self._mav))


def _ftp_payload(send: FtpRequest) -> bytes:
    if len(send.data) > FTP_DATA:
        raise ValueError(f"a name on the vehicle has at most {FTP_DATA} bytes")
    size = len(send.data) or send.size
    head = FTP_HEADER.pack(send.number & 0xFFFF, send.session, send.opcode, size, 0, 0, send.offset)
    return (head + send.data).ljust(FTP_HEADER.size + FTP_DATA, b"\0")


def _name(name: str) -> bytes:
    try:
        raw = name.encode("ascii")
    except UnicodeEncodeError:
        raise ValueError(f"{name!r} is no parameter's name: letters outside ASCII") from None
    if len(raw) > 16:
        raise ValueError(f"{name!r} is no parameter's name: longer than 16 letters")
    return raw
