"""What is known of the vehicle, reduced from events: an immutable snapshot, and the function that makes the next one.

Mode and armed state are taken from the autopilot's own system and component only, because other stations' heartbeats
travel on every link. What the vehicle did not say, or said as NaN, is None: a limit compared with None fails loudly
where a comparison with NaN would quietly be false.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from gcs.link.clock import REBOOT_STEP_S
from gcs.link.events import (
    Attitude,
    AutopilotVersion,
    Battery,
    Encoding,
    Event,
    Heartbeat,
    LocalPosition,
    ParamValue,
    RadioStatus,
    RotorSpeed,
    StatusText,
    SystemTime,
    encoding_of,
)
from gcs.link.log_answer import LogClient
from gcs.vehicle.autopilots import mode_name

KEPT_TEXTS = 50
KEPT_BEATS = 20
KEPT_SAID = 64


@dataclass(frozen=True, slots=True)
class Text:
    """One message of the vehicle to its people. Sanitised, but not markup: show it with markup off."""

    number: int
    """From 1, in the order heard."""
    at_s: float
    """When it was heard, on the session's clock."""
    severity: int
    """0 emergency to 7 debug."""
    text: str


@dataclass(frozen=True, slots=True)
class Said:
    """A parameter's value as the vehicle said it, to whomever."""

    number: int
    """From 1, in the order heard."""
    name: str
    value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Beat:
    """One heartbeat of the autopilot, and what it can be believed for."""

    number: int
    """From 1, in the order heard."""
    at_s: float
    """When it was heard, on the session's clock."""
    mode: int
    mode_name: str
    armed: bool
    status: int
    known_s: float = -math.inf
    """It was said after all that this station had sent up to this moment (session's clock) had reached the vehicle or
    was lost; -inf where nothing proves it. See `gcs.link.clock`."""
    late_s: float | None = None
    """How old it was when heard, at most; None where the clocks' offset is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSnapshot:
    """One moment's knowledge of the vehicle and of the link to it."""

    system: int
    component: int

    link_age_s: float = math.inf
    """Since anything was heard of the vehicle."""
    lost: bool = True
    """Nothing heard for `LOST_AFTER_S`."""
    lag_s: float | None = None
    """How late what is heard or said arrives, the worse way; None while the vehicle answered no ping."""
    answer_age_s: float = math.inf
    """Since the newest ping that was answered was sent: grows where the vehicle is heard and does not hear."""

    mode: int = -1
    """The autopilot's number; -1 before its first heartbeat."""
    mode_name: str = "unknown"
    armed: bool = False
    vehicle_type: int = 0
    autopilot: int = 0
    status: int = 0
    heartbeats: int = 0
    beats: tuple[Beat, ...] = ()
    """The last `KEPT_BEATS`."""

    roll: float | None = None
    """rad, as pitch and yaw."""
    pitch: float | None = None
    yaw: float | None = None
    p: float | None = None
    """rad/s, as q and r: telemetry for the screen; the log's own are in `Session.samples`."""
    q: float | None = None
    r: float | None = None
    attitude_at_s: float | None = None
    """When the attitude was heard, on the session's clock."""
    north: float | None = None
    """m from the vehicle's origin, as east and down."""
    east: float | None = None
    down: float | None = None
    battery_v: float | None = None
    battery_remaining: float | None = None
    """0..1."""
    rpm: float | None = None
    logs: bool | None = None
    """Whether it says that its own logging is on and in order (SYS_STATUS); None where it tells nothing of it."""

    boot_s: float | None = None
    """The vehicle's own clock."""
    reboots: int = 0
    """How often that clock went back."""
    capabilities: int | None = None
    """MAV_PROTOCOL_CAPABILITY bits, None while not known."""
    version: str = ""

    texts: tuple[Text, ...] = ()
    """The last `KEPT_TEXTS`."""
    said: tuple[Said, ...] = ()
    """The last `KEPT_SAID` values of parameters: vehicles tell all stations what one of them wrote."""

    other_stations: int = 0
    """Ground stations heard on this link that are not this one."""
    other_vehicles: int = 0
    radio: RadioStatus | None = None
    """What a telemetry radio on the way said of itself, lately."""
    signs: bool = False
    """It signs what it says, and this station has no key: nothing here looked at the signatures."""
    signed: bool = False
    """Everything of it was believed by its signature."""
    refused: tuple[tuple[str, int], ...] = ()
    """Why messages with a right checksum were not believed, and how many."""
    newcomer: str = ""
    """Another address that speaks as this vehicle does, while this one's own is silent; nobody listens to it."""
    strangers: int = 0
    """Datagrams from addresses that are not the vehicle's, all dropped."""
    frames: int = 0
    """Valid MAVLink frames heard."""
    bad_bytes: int = 0
    """Bytes that were no valid frame."""
    link_problem: str | None = None
    log_client: LogClient = LogClient.NOBODY
    """Who answers the vehicle's log while it is not recorded."""

    recording: Path | None = None
    """The log that grows on disk, None while nothing is recorded."""
    log_on_card: bool = False
    """What is recorded is telemetry only: the log stays on the vehicle's card."""
    blocks_received: int = 0
    """Of the log being recorded."""
    blocks_open: int = 0
    """Blocks known to be missing, still asked for."""
    duplicates: int = 0
    recording_problem: str | None = None
    """Why something is not being kept, None while all is well."""

    @property
    def missing(self) -> int:
        """Blocks missing at this moment: the same as `blocks_open` while the sender is still asked for them."""
        return self.blocks_open

    @property
    def newcomer_words(self) -> str:
        """Who speaks in the vehicle's name, empty where nobody does."""
        if not self.newcomer:
            return ""
        return f"{self.newcomer} speaks as system {self.system} now, which this one's address does no more"

    @property
    def encoding(self) -> Encoding:
        """How the vehicle packs integer parameters; ArduPilot's way while it has not said."""
        return encoding_of(self.capabilities)


def reduce(
    snapshot: VehicleSnapshot,
    event: Event,
    now: float,
    *,
    known_s: float = -math.inf,
    late_s: float | None = None,
) -> VehicleSnapshot:
    """The snapshot after one more event; events of others change nothing.

    `now` is the session's clock, s; `known_s` and `late_s` are what `Beat` keeps of them.
    """
    if event.system != snapshot.system:
        return snapshot
    if isinstance(event, StatusText):
        number = snapshot.texts[-1].number + 1 if snapshot.texts else 1
        text = Text(number, now, event.severity, event.text)
        return replace(snapshot, texts=(*snapshot.texts, text)[-KEPT_TEXTS:])
    if event.component != snapshot.component:
        return snapshot
    match event:
        case Heartbeat():
            return _after_heartbeat(snapshot, event, now, known_s, late_s)
        case Attitude():
            return _after_attitude(snapshot, event, now)
        case SystemTime():
            return _at_boot_time(snapshot, event.boot_s)
        case LocalPosition():
            north, east, down = _finite(event.north), _finite(event.east), _finite(event.down)
            return replace(_at_boot_time(snapshot, event.boot_s), north=north, east=east, down=down)
        case RotorSpeed():
            omega = _finite(event.omega)
            return replace(snapshot, rpm=None if omega is None else omega * 60.0 / (2.0 * math.pi))
        case Battery():
            return replace(snapshot, battery_v=event.voltage_v, battery_remaining=event.remaining, logs=event.logs)
        case AutopilotVersion():
            return replace(snapshot, capabilities=event.capabilities, version=event.version)
        case ParamValue():
            number = snapshot.said[-1].number + 1 if snapshot.said else 1
            said = Said(number, event.name, event.value(snapshot.encoding))
            return replace(snapshot, said=(*snapshot.said, said)[-KEPT_SAID:])
        case _:
            return snapshot


def _after_heartbeat(
    snapshot: VehicleSnapshot, event: Heartbeat, now: float, known_s: float, late_s: float | None
) -> VehicleSnapshot:
    beat = Beat(
        number=snapshot.heartbeats + 1,
        at_s=now,
        mode=event.mode,
        mode_name=mode_name(event.mode, event.vehicle_type, event.autopilot),
        armed=event.armed,
        status=event.status,
        known_s=known_s,
        late_s=late_s,
    )
    return replace(
        snapshot,
        mode=beat.mode,
        mode_name=beat.mode_name,
        armed=event.armed,
        vehicle_type=event.vehicle_type,
        autopilot=event.autopilot,
        status=event.status,
        heartbeats=beat.number,
        beats=(*snapshot.beats, beat)[-KEPT_BEATS:],
    )


def _after_attitude(snapshot: VehicleSnapshot, event: Attitude, now: float) -> VehicleSnapshot:
    return replace(
        _at_boot_time(snapshot, event.boot_s),
        roll=_finite(event.roll),
        pitch=_finite(event.pitch),
        yaw=_finite(event.yaw),
        p=_finite(event.p),
        q=_finite(event.q),
        r=_finite(event.r),
        attitude_at_s=now,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _at_boot_time(snapshot: VehicleSnapshot, boot_s: float) -> VehicleSnapshot:
    again = snapshot.boot_s is not None and boot_s < snapshot.boot_s - REBOOT_STEP_S
    if not again and snapshot.boot_s is not None and boot_s < snapshot.boot_s:
        return snapshot  # an older packet overtaken by a newer one
    return replace(snapshot, boot_s=boot_s, reboots=snapshot.reboots + again)
