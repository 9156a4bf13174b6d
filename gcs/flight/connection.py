"""What flying needs of a session, and of time: so that it runs in fake time before a fake vehicle."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol, TypeVar

from gcs.flight.live import LiveWindow
from gcs.flight.log_health import LogHealth
from gcs.flight.recorder import RecordingSummary
from gcs.link.encode import Send
from gcs.link.procedures import Procedure
from gcs.link.signing import Refusal, Signing
from gcs.link.transport import Transport
from gcs.vehicle.snapshot import Text, VehicleSnapshot

T = TypeVar("T")

LogWay = Literal["stream", "card"]
"""How the vehicle's log comes to the ground: block by block while it is flown, or off the vehicle's card later."""


class Connection(Protocol):
    """What the engine needs of a `gcs.flight.session.Session`."""

    @property
    def station(self) -> int: ...
    def snapshot(self) -> VehicleSnapshot: ...
    def call(
        self,
        procedure: Procedure[T],
        timeout_s: float | None = None,
        *,
        cancelled: Callable[[], bool] | None = None,
    ) -> T: ...
    def send(self, *sends: Send) -> None: ...
    def texts_since(self, cursor: int) -> tuple[int, list[Text]]: ...
    def samples(self, last_s: float) -> LiveWindow: ...
    def log_health(self) -> LogHealth | None: ...
    def start_recording(self, directory: Path, log: LogWay = "stream") -> None: ...
    def shed_log(self) -> None: ...
    def stop_recording(self, *, meanwhile: Callable[[], None]) -> RecordingSummary: ...


class Clock(Protocol):
    """Seconds that never go back, and a way to let them pass."""

    def now(self) -> float: ...
    def sleep(self, seconds: float) -> None: ...


class WallClock:
    """The machine's own."""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        time.sleep(seconds)


def silence(transport: Transport, timeout_s: float, signing: Signing | None = None, system: int | None = None) -> str:
    """Why no vehicle was found on a link in `timeout_s`, as far as what came instead tells."""
    frames, bad_bytes = transport.counts
    wanted = "autopilot's heartbeat" if system is None else f"heartbeat of an autopilot with system id {system}"
    if transport.problem is not None:
        heard = transport.problem
    elif signing is not None and signing.refused:
        heard = _not_believed(signing)
    elif frames:
        heard = f"{frames} MAVLink messages, but no {wanted}, in {timeout_s:.0f} s"
    elif bad_bytes:
        heard = f"{bad_bytes} bytes that are no MAVLink in {timeout_s:.0f} s; check the baud rate or the port"
    elif transport.strangers:
        heard = f"{transport.strangers} datagrams, no {wanted} among them, in {timeout_s:.0f} s"
    else:
        key = "one that wants signed messages is silent, too (--key)" if signing is None else "and that it has this key"
        heard = f"nothing heard in {timeout_s:.0f} s; check that the vehicle is on and sends to this address; {key}"
    return f"no vehicle at {transport.name}: {heard}"


def _not_believed(signing: Signing) -> str:
    """Messages came, and none that the key vouches for: what to do about the reason that was met most."""
    counts = ", ".join(f"{count} {why}" for why, count in signing.refusals())
    why = max(signing.refused, key=lambda one: signing.refused[one])
    return f"no message that the key vouches for ({counts}); {_ADVICE[why]}"


_UNSIGNED = "the vehicle has no key yet: give it this one over USB, or leave out --key"
_ADVICE = {
    Refusal.UNSIGNED: _UNSIGNED,
    Refusal.MAVLINK_1: f"{_UNSIGNED}; signing wants MAVLink 2 (ArduPilot: SERIALn_PROTOCOL 2)",
    Refusal.WRONG: "the vehicle has another key: compare ids (tippath key show-id)",
    Refusal.REPLAYED: "is this a replay of what was said before?",
    Refusal.TOO_OLD: "the vehicle's clock is behind by more than a minute (no GPS yet?): it takes ours over once it "
    "hears us, so speak first (udpout:, tcp: or a serial port)",
}
