"""MAVLink messages to events: units, names and text are put right here, once.

A message that says nothing to a ground station for sweeps gives None. Whatever a valid checksum can carry must come
through without an exception: ids 255, NaN, lengths that lie, text with escape sequences.
"""

from __future__ import annotations

import math
import re
import struct
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from gcs.link.events import (
    Attitude,
    AutopilotVersion,
    Battery,
    CommandAck,
    Event,
    FtpReply,
    Heartbeat,
    LocalPosition,
    LogBlock,
    LogData,
    LogEntry,
    LogReceipt,
    ParamError,
    ParamValue,
    RadioStatus,
    RotorSpeed,
    StatusText,
    StatusTextPart,
    SystemTime,
    TimeReply,
)
from gcs.link.signing import RADIO_STATUS

BLOCK_SIZE = 200
TEXT_SIZE = 50
LOG_PIECE = 90
FTP_HEADER = struct.Struct("<HBBBBBxI")
"""Number, session, opcode, size, opcode answered, burst complete, offset."""
FTP_DATA = 239
FTP_ACK, FTP_NAK = 128, 129
PARAMETER_ERRORS = {
    1: "does not exist",
    2: "value out of range",
    3: "permission denied",
    4: "no such component",
    5: "read only",
}

_ESCAPES = re.compile(
    r"\x1b\[[0-?]*[ -/]*[@-~]?"  # control sequences, also cut off ones
    r"|\x1b[\]PX^_][^\x07\x1b]*(?:\x07|\x1b\\)?"  # strings to the terminal: titles, links, device control
    r"|\x1b[ -/]*[0-~]?"  # short escapes
    r"|\x9b[0-?]*[ -/]*[@-~]?"  # the same in eight bits
)


class Message(Protocol):
    """What decode needs of a message of pymavlink's dialect."""

    def get_msgId(self) -> int: ...
    def get_srcSystem(self) -> int: ...
    def get_srcComponent(self) -> int: ...
    def get_msgbuf(self) -> bytearray: ...


LOGGING = 1 << 24
"""MAV_SYS_STATUS_LOGGING."""


def sanitise(text: str) -> str:
    """Text from outside, made safe to print: escape sequences, control and direction-changing characters go.

    Tabs and line ends become one blank. Square brackets and angle brackets stay: they are text.
    """
    text = _ESCAPES.sub("", text)
    text = re.sub(r"[\t\r\n\v\f\x85\u2028\u2029]+", " ", text)
    return "".join(c for c in text if unicodedata.category(c)[0] != "C").strip()


def payload_of(message: Message) -> bytes:
    """The message's payload as it came, zero bytes cut from the end by MAVLink 2 put back by the reader's slices."""
    frame = message.get_msgbuf()
    start = 10 if frame[0] == 0xFD else 6
    return bytes(frame[start : start + frame[1]])


def decode(message: Message) -> Event | None:
    """The event that a message stands for, or None where it says nothing that is used here."""
    reader = _READERS.get(message.get_msgId())
    return None if reader is None else reader(message, message.get_srcSystem(), message.get_srcComponent())


def _heartbeat(m: Any, system: int, component: int) -> Event:
    return Heartbeat(
        system,
        component,
        vehicle_type=m.type,
        autopilot=m.autopilot,
        armed=bool(m.base_mode & 128),
        mode=m.custom_mode,
        status=m.system_status,
    )


def _param_value(m: Any, system: int, component: int) -> Event:
    # param_value has been through a Python float, which quiets signalling NaNs: the bits come from the frame.
    (bits,) = struct.unpack("<I", payload_of(m)[:4].ljust(4, b"\0"))
    return ParamValue(
        system,
        component,
        name=sanitise(m.param_id),
        bits=bits,
        kind=m.param_type,
        count=m.param_count,
        index=m.param_index,
    )


def _param_error(m: Any, system: int, component: int) -> Event:
    reason = PARAMETER_ERRORS.get(m.error, f"error {m.error}")
    return ParamError(system, component, sanitise(m.param_id), m.param_index, reason)


def _command_ack(m: Any, system: int, component: int) -> Event:
    return CommandAck(
        system,
        component,
        command=m.command,
        result=m.result,
        target_system=m.target_system,
        target_component=m.target_component,
    )


def _status_text(m: Any, system: int, component: int) -> Event:
    # Escape sequences may straddle chunks, so a chunk is sanitised only when the whole text is there.
    if m.id == 0:
        return StatusText(system, component, m.severity, sanitise(m.text))
    return StatusTextPart(
        system, component, severity=m.severity, text=m.text, id=m.id, chunk=m.chunk_seq, last=len(m.text) < TEXT_SIZE
    )


def _log_block(m: Any, system: int, component: int) -> Event:
    data = payload_of(m)[6 : 6 + BLOCK_SIZE].ljust(BLOCK_SIZE, b"\0")
    return LogBlock(system, component, m.seqno, data, m.target_system, m.target_component)


def _log_receipt(m: Any, system: int, component: int) -> Event:
    return LogReceipt(system, component, m.seqno)


def _log_entry(m: Any, system: int, component: int) -> Event:
    return LogEntry(system, component, id=m.id, count=m.num_logs, size=m.size, utc_s=m.time_utc)


def _log_data(m: Any, system: int, component: int) -> Event:
    size = min(m.count, LOG_PIECE)  # it may say more than it holds
    return LogData(system, component, m.id, m.ofs, payload_of(m)[7 : 7 + size].ljust(size, b"\0"))


def _ftp(m: Any, system: int, component: int) -> Event | None:
    payload = payload_of(m)[3:].ljust(FTP_HEADER.size + FTP_DATA, b"\0")
    number, session, opcode, size, answers, complete, offset = FTP_HEADER.unpack_from(payload)
    if opcode not in (FTP_ACK, FTP_NAK):
        return None  # a request: another station's, or a vehicle's that takes us for a server
    return FtpReply(
        system,
        component,
        target_system=m.target_system,
        target_component=m.target_component,
        number=number,
        session=session,
        ack=opcode == FTP_ACK,
        answers=answers,
        burst_complete=bool(complete),
        offset=offset,
        data=payload[FTP_HEADER.size : FTP_HEADER.size + min(size, FTP_DATA)],
    )


def _attitude(m: Any, system: int, component: int) -> Event:
    return Attitude(
        system,
        component,
        boot_s=m.time_boot_ms * 1e-3,
        roll=m.roll,
        pitch=m.pitch,
        yaw=m.yaw,
        p=m.rollspeed,
        q=m.pitchspeed,
        r=m.yawspeed,
    )


def _system_time(m: Any, system: int, component: int) -> Event:
    return SystemTime(system, component, m.time_boot_ms * 1e-3)


def _timesync(m: Any, system: int, component: int) -> Event | None:
    # With tc1 0 it is a question of the vehicle's own, or another station's: nothing for us.
    return TimeReply(system, component, m.ts1, m.tc1 * 1e-9) if m.tc1 > 0 else None


def _rpm(m: Any, system: int, component: int) -> Event:
    return RotorSpeed(system, component, m.rpm1 * (2.0 * math.pi / 60.0))


def _radio_status(m: Any, system: int, component: int) -> Event:
    return RadioStatus(
        system,
        component,
        here=m.rssi,
        there=m.remrssi,
        noise_here=m.noise,
        noise_there=m.remnoise,
        room=m.txbuf,
        errors=m.rxerrors,
    )


def _sys_status(m: Any, system: int, component: int) -> Event:
    return Battery(
        system,
        component,
        None if m.voltage_battery == 65535 else m.voltage_battery * 1e-3,
        None if m.current_battery < 0 else m.current_battery * 1e-2,
        None if m.battery_remaining < 0 else m.battery_remaining * 1e-2,
        _logs(m.onboard_control_sensors_present, m.onboard_control_sensors_enabled, m.onboard_control_sensors_health),
    )


def _logs(present: int, enabled: int, healthy: int) -> bool | None:
    return bool(enabled & healthy & LOGGING) if present & LOGGING else None


def _local_position(m: Any, system: int, component: int) -> Event:
    return LocalPosition(
        system,
        component,
        boot_s=m.time_boot_ms * 1e-3,
        north=m.x,
        east=m.y,
        down=m.z,
        v_north=m.vx,
        v_east=m.vy,
        v_down=m.vz,
    )


def _autopilot_version(m: Any, system: int, component: int) -> Event:
    version = m.flight_sw_version
    return AutopilotVersion(
        system, component, m.capabilities, f"{version >> 24 & 255}.{version >> 16 & 255}.{version >> 8 & 255}"
    )


_READERS: dict[int, Callable[[Any, int, int], Event | None]] = {
    0: _heartbeat,
    1: _sys_status,
    2: _system_time,
    22: _param_value,
    30: _attitude,
    32: _local_position,
    77: _command_ack,
    RADIO_STATUS: _radio_status,
    110: _ftp,
    111: _timesync,
    118: _log_entry,
    120: _log_data,
    148: _autopilot_version,
    184: _log_block,
    185: _log_receipt,
    226: _rpm,
    253: _status_text,
    345: _param_error,
}


@dataclass
class _Unfinished:
    severity: int
    since: float
    parts: dict[int, str] = field(default_factory=dict)
    last: int | None = None


class TextAssembly:
    """Joins the chunks of long STATUSTEXTs, in whatever order they come, and does not wait for lost ones for ever."""

    PATIENCE_S = 1.0
    MOST_CHUNKS = 32
    MOST_TEXTS = 32

    def __init__(self) -> None:
        self._unfinished: dict[tuple[int, int, int], _Unfinished] = {}

    def add(self, part: StatusTextPart, now: float) -> list[StatusText]:
        """Take one chunk; give the texts that are whole with it."""
        if part.chunk >= self.MOST_CHUNKS:
            return []
        key = (part.system, part.component, part.id)
        text = self._unfinished.setdefault(key, _Unfinished(part.severity, now))
        text.parts[part.chunk] = part.text
        if part.last:
            text.last = part.chunk
        if text.last is not None and all(n in text.parts for n in range(text.last + 1)):
            return [self._finish(key)]
        if len(self._unfinished) > self.MOST_TEXTS:
            return [self._finish(next(iter(self._unfinished)))]
        return []

    def overdue(self, now: float) -> list[StatusText]:
        """The texts whose missing chunks will not come any more."""
        late = [key for key, text in self._unfinished.items() if now - text.since > self.PATIENCE_S]
        return [self._finish(key) for key in late]

    def _finish(self, key: tuple[int, int, int]) -> StatusText:
        text = self._unfinished.pop(key)
        last = max(text.parts) if text.last is None else max(text.last, *text.parts)
        whole = "".join(text.parts.get(n, "…") for n in range(last + 1))
        if text.last is None:
            whole += "…"
        return StatusText(key[0], key[1], text.severity, sanitise(whole))
