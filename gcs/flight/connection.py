"""What flying needs of a session, and of time: so that it runs in fake time before a fake vehicle."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal, Protocol, TypeVar

from gcs.flight.live import LiveWindow
from gcs.flight.log_health import LogHealth
from gcs.flight.recorder import RecordingSummary
from gcs.link.procedures import Procedure
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
