"""Who else is heard on the link: a vehicle with the same id, a single stray heartbeat, another ground station.

Each is a voice: asked with the time, it answers with the frames that it sends now.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Mode
from sitl.autopilot.parameters import Kind
from sitl.faults.air import Packet
from sitl.faults.windows import ALWAYS, Once, Window
from sitl.protocol.server import AUTOPILOT, SYSTEM
from sitl.protocol.telemetry import Message

_UPTIME_S = 4321.0
"""The second vehicle has been up for longer: its boot stamps are of another clock."""


class Beat:
    """A steady rhythm with a phase of its own."""

    def __init__(self, period_s: float, phase_s: float) -> None:
        self._period_s = period_s
        self._phase_s = phase_s
        self._last = math.inf

    def due(self, now_s: float) -> bool:
        """Whether a beat has passed since the last time that was asked."""
        beat = math.floor((now_s - self._phase_s) / self._period_s + 1e-9)
        due, self._last = beat > self._last, beat
        return due


def framed(mav: mavlink.MAVLink, message: Message) -> bytes:
    """The frame that this sender says next."""
    packed = bytes(message.pack(mav))
    mav.seq = (mav.seq + 1) % 256
    return packed


def heartbeat_of(mode: int, armed: bool) -> Message:
    """Of this vehicle's kind; `mode` is a custom mode."""
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    flags |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
    state = mavlink.MAV_STATE_ACTIVE if armed else mavlink.MAV_STATE_STANDBY
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_HELICOPTER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, flags, mode, state, 3
    )


class SecondVehicle:
    """Another vehicle with the same system and component id: its heartbeat at 1 Hz, and its attitude at 10 Hz."""

    def __init__(
        self,
        mode: int = 0,
        *,
        window: Window = ALWAYS,
        attitude: bool = False,
        armed: bool = True,
        phase_s: float = 0.37,
    ) -> None:
        """`mode` is its custom mode; 0 is Stabilize."""
        self._mode = mode
        self._window = window
        self._armed = armed
        self._mav = mavlink.MAVLink(None, SYSTEM, AUTOPILOT)
        self._heartbeat = Beat(1.0, phase_s)
        self._attitude = Beat(0.1, phase_s) if attitude else None

    def __call__(self, now_s: float) -> list[bytes]:
        messages = []
        if self._heartbeat.due(now_s):
            messages.append(heartbeat_of(self._mode, self._armed))
        if self._attitude is not None and self._attitude.due(now_s):
            messages.append(mavlink.MAVLink_attitude_message(round(1000 * (now_s + _UPTIME_S)), *(0.0,) * 6))
        return [framed(self._mav, message) for message in messages] if self._window.covers(now_s) else []


class StrayHeartbeat:
    """One heartbeat with the vehicle's id and another mode, when `at` begins.

    The vehicle tells a change of mode at once and then every second: at a whole second after the start of a sweep its
    own heartbeat follows this one at once.
    """

    def __init__(self, mode: int, at: Window, *, armed: bool = True) -> None:
        self._frame = framed(mavlink.MAVLink(None, SYSTEM, AUTOPILOT), heartbeat_of(mode, armed))
        self._once = Once(at)

    def __call__(self, now_s: float) -> list[bytes]:
        return [self._frame] if self._once.comes(now_s) else []


class StartWatch:
    """A stage that holds nothing up: it notes when the ground first ordered an excitation, for windows to count from.

    Before other stages of the uplink, so that a lag can catch that very order. It reads one frame a packet, as on UDP.
    """

    def __init__(self) -> None:
        self.first_s = math.inf

    def __call__(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        if self.first_s == math.inf and any(_orders_excitation(data) for _, data in packets):
            self.first_s = now_s
        return list(packets)


def _orders_excitation(data: bytes) -> bool:
    if mavlink.MAVLINK_MSG_ID_COMMAND_LONG not in data[5:8]:
        return False
    try:
        message = mavlink.MAVLink(None).decode(bytearray(data))
    except mavlink.MAVError:
        return False
    order = (getattr(message, "command", None), getattr(message, "param2", None))
    return order == (mavlink.MAV_CMD_DO_SET_MODE, Mode.SYSTEMID)


@dataclass(frozen=True, slots=True)
class Order:
    """Sent once, when `at` begins."""

    message: Message
    at: Window


def parameter_write(name: str, value: float) -> Message:
    """Raises ValueError for a name of more than 16 characters or a value beyond float32."""
    if not 1 <= len(name) <= 16 or not name.isascii():
        raise ValueError(f"{name!r} is no parameter's name: it has 1 to 16 characters")
    if not abs(value) <= 3.4e38:
        raise ValueError(f"{value} is no value of a parameter")
    return mavlink.MAVLink_param_set_message(SYSTEM, AUTOPILOT, name.encode(), value, int(Kind.REAL32))


def start_of_log() -> Message:
    """What a log client says first: the vehicle's blocks go to whoever said it last."""
    return mavlink.MAVLink_remote_log_block_status_message(
        SYSTEM, AUTOPILOT, mavlink.MAV_REMOTE_LOG_DATA_BLOCK_START, mavlink.MAV_REMOTE_LOG_DATA_BLOCK_ACK
    )


class OtherStation:
    """Another ground station, which does what `orders` say and listens to nothing."""

    def __init__(self, orders: Sequence[Order], *, system: int = 254) -> None:
        self._orders = [(Once(order.at), order.message) for order in orders]
        self._mav = mavlink.MAVLink(None, system, mavlink.MAV_COMP_ID_MISSIONPLANNER)

    def __call__(self, now_s: float) -> list[bytes]:
        return [framed(self._mav, message) for once, message in self._orders if once.comes(now_s)]
