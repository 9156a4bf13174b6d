"""What the vehicle said, in SI units, with MAVLink left behind.

Every event names the system and component it came from, because a link carries more than one voice: a second
station, a second vehicle, a camera. Numbers arrive as the vehicle sent them: NaN and infinity are possible in every
float, and whoever reduces events decides what they mean. Text has been sanitised: it holds printable characters only,
but it may still look like markup of some toolkit, so a screen shows it with markup switched off.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import Enum, IntEnum


class ParameterType(IntEnum):
    """MAV_PARAM_TYPE; only those that fit into the 32 bits of a PARAM_VALUE."""

    UINT8 = 1
    INT8 = 2
    UINT16 = 3
    INT16 = 4
    UINT32 = 5
    INT32 = 6
    REAL32 = 9


class Encoding(Enum):
    """How integers travel in the float of PARAM_VALUE and PARAM_SET; floats travel alike in both."""

    C_CAST = "C cast"
    """The number itself, as a float32 (ArduPilot): whole numbers above 2**24 are rounded."""
    BYTEWISE = "bytewise"
    """The integer's own bytes, in the float's place (PX4)."""


_INTEGER_FORMATS = {
    ParameterType.UINT8: "<Bxxx",
    ParameterType.INT8: "<bxxx",
    ParameterType.UINT16: "<Hxx",
    ParameterType.INT16: "<hxx",
    ParameterType.UINT32: "<I",
    ParameterType.INT32: "<i",
}


def float_of_bits(bits: int) -> float:
    """The float32 with these 32 bits. A signalling NaN comes out quiet: compare bits, never NaNs."""
    return float(struct.unpack("<f", struct.pack("<I", bits))[0])


def bits_of_float(value: float) -> int:
    """The 32 bits of the float32 nearest to `value`. Raises OverflowError where it is finite but too large."""
    return int(struct.unpack("<I", struct.pack("<f", value))[0])


def parameter_value(bits: int, kind: int, encoding: Encoding) -> float:
    """The number that a PARAM_VALUE's 32 bits stand for, given its MAV_PARAM_TYPE."""
    if encoding is Encoding.BYTEWISE and kind in _INTEGER_FORMATS:
        return float(struct.unpack(_INTEGER_FORMATS[ParameterType(kind)], struct.pack("<I", bits))[0])
    return float_of_bits(bits)


def parameter_bits(value: float, kind: int, encoding: Encoding) -> int:
    """The 32 bits to send for `value`. Raises ValueError or OverflowError where the type cannot hold it."""
    if encoding is Encoding.BYTEWISE and kind in _INTEGER_FORMATS:
        if not math.isfinite(value) or value != int(value):
            raise ValueError(f"{value!r} is not a whole number, and the parameter is one")
        try:
            packed = struct.pack(_INTEGER_FORMATS[ParameterType(kind)], int(value))
        except struct.error as error:
            raise ValueError(f"{value!r} does not fit {ParameterType(kind).name}") from error
        return int(struct.unpack("<I", packed)[0])
    return bits_of_float(value)


@dataclass(frozen=True, slots=True)
class Event:
    """Something a system on the link said."""

    system: int
    component: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Heartbeat(Event):
    vehicle_type: int
    """MAV_TYPE: 4 helicopter, 6 ground station."""
    autopilot: int
    """MAV_AUTOPILOT: 3 ArduPilot, 8 none."""
    armed: bool
    mode: int
    """custom_mode; its meaning is the autopilot's."""
    status: int
    """MAV_STATE: 3 standby, 4 active, 5 critical."""

    @property
    def from_station(self) -> bool:
        return self.vehicle_type == 6

    @property
    def from_autopilot(self) -> bool:
        """A flying vehicle's autopilot, neither a station nor a camera, gimbal or radio."""
        return self.autopilot != 8 and not self.from_station and self.system != 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ParamValue(Event):
    name: str
    bits: int
    """The 32 bits of param_value as they came: comparing them is exact for denormals, NaN and -0."""
    kind: int
    """MAV_PARAM_TYPE."""
    count: int
    index: int
    """65535 where the vehicle answers out of order or refuses."""

    def value(self, encoding: Encoding = Encoding.C_CAST) -> float:
        return parameter_value(self.bits, self.kind, encoding)


@dataclass(frozen=True, slots=True)
class ParamError(Event):
    name: str
    index: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAck(Event):
    command: int
    result: int
    """MAV_RESULT: 0 accepted, 5 in progress, all else a refusal."""
    target_system: int
    """Whom it answers; 0 where the vehicle does not say."""
    target_component: int


@dataclass(frozen=True, slots=True)
class StatusText(Event):
    severity: int
    """0 emergency to 7 debug."""
    text: str
    """Sanitised; chunks joined, a lost chunk shown as an ellipsis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusTextPart(Event):
    """One chunk of a long text, before `decode.TextAssembly` joins them."""

    severity: int
    text: str
    id: int
    chunk: int
    last: bool


@dataclass(frozen=True, slots=True)
class LogBlock(Event):
    number: int
    """The block's place: byte 200 * number of the log."""
    data: bytes
    """200 bytes."""
    target_system: int = 0
    """The station that the vehicle sends its log to; 0 where it does not say."""
    target_component: int = 0


@dataclass(frozen=True, slots=True)
class LogReceipt(Event):
    """A station's word about a log block, or its START or STOP: whoever says it is a log client."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEntry(Event):
    """One log on board, as LOG_ENTRY lists it."""

    id: int
    count: int
    """Logs that the vehicle has."""
    size: int
    """Bytes, 0 to 2**32 - 1."""
    utc_s: int
    """When it was written, seconds since 1970; 0 where the vehicle does not know."""


@dataclass(frozen=True, slots=True)
class LogData(Event):
    """A piece of a log on board."""

    id: int
    offset: int
    data: bytes
    """At most 90 bytes; fewer at the log's end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FtpReply(Event):
    """An answer of MAVFTP."""

    target_system: int
    """Whom it answers; 0 where the vehicle does not say."""
    target_component: int
    number: int
    session: int
    ack: bool
    """False: it refuses, and the first byte of `data` says why."""
    answers: int
    """The opcode of the request."""
    burst_complete: bool
    offset: int
    data: bytes
    """At most 239 bytes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Attitude(Event):
    boot_s: float
    """The vehicle's own clock, since it booted."""
    roll: float
    """rad, as pitch and yaw."""
    pitch: float
    yaw: float
    p: float
    """rad/s, as q and r."""
    q: float
    r: float


@dataclass(frozen=True, slots=True)
class SystemTime(Event):
    boot_s: float


@dataclass(frozen=True, slots=True)
class TimeReply(Event):
    """The answer to a `Ping`: proof that all that was sent before it has reached the vehicle, or was lost."""

    nonce: int
    """The ping's own, echoed."""
    boot_s: float
    """The vehicle's own clock when the ping arrived."""


@dataclass(frozen=True, slots=True)
class RotorSpeed(Event):
    omega: float
    """rad/s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RadioStatus(Event):
    """A telemetry radio's own word, in its own units (SiK: 1.9 a dB). It has no key, so nothing follows from it."""

    here: int
    """Signal strength at this end; 255 is not known, as in all of these but the errors."""
    there: int
    noise_here: int
    noise_there: int
    room: int
    """% of its buffer that is free."""
    errors: int
    """Packets damaged on the air so far."""


@dataclass(frozen=True, slots=True)
class Battery(Event):
    voltage_v: float | None
    """None where the vehicle does not measure it, as with the others."""
    current_a: float | None
    remaining: float | None
    """0..1."""
    logs: bool | None = None
    """Whether the vehicle's own logging is on and in order; None where it has none to tell of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalPosition(Event):
    """North, east, down from the vehicle's origin (m), and their rates (m/s)."""

    boot_s: float
    north: float
    east: float
    down: float
    v_north: float
    v_east: float
    v_down: float


@dataclass(frozen=True, slots=True)
class AutopilotVersion(Event):
    capabilities: int
    """MAV_PROTOCOL_CAPABILITY bits."""
    version: str
    """major.minor.patch of the flight software."""

    @property
    def encoding(self) -> Encoding:
        return encoding_of(self.capabilities)


CAPABILITY_BYTEWISE = 16
CAPABILITY_FTP = 32


def encoding_of(capabilities: int | None) -> Encoding:
    """How a vehicle with these capability bits packs integers: C cast unless it says bytewise."""
    return Encoding.BYTEWISE if capabilities is not None and capabilities & CAPABILITY_BYTEWISE else Encoding.C_CAST
