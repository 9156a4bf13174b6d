"""A recording without the log: that stays on the vehicle's card, and telemetry alone tells how the flight goes.

It has a `Recording`'s face. Nothing of the log is asked for, and nothing of it can be missing here; what stands in for
its samples are the attitudes that the vehicle sends, each with its own clock.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gcs.flight.attitude_rate import AttitudeRate
from gcs.flight.live import LiveWindow, rates_alone
from gcs.flight.log_health import LogHealth
from gcs.flight.recorder import Recorder, RecordingSummary
from gcs.flight.telemetry import TelemetryRequests
from gcs.link.clock import REBOOT_STEP_S, LinkClock
from gcs.link.encode import ATTITUDE, SERVO_OUTPUT_RAW, Send
from gcs.link.events import Attitude, Battery, Event, Heartbeat, StatusText
from gcs.vehicle.autopilots import says_log_failed

KEPT = 8192
"""Attitudes: a run of two minutes at 50 a second, and what lies around it."""
SERVOS_S = 0.2
"""Interval of SERVO_OUTPUT_RAW, for the record."""
UNHEALTHY = "its logging is off or has failed (SYS_STATUS)"


class Attitudes:
    """What is heard instead of blocks; `start` and `stop` ask for nothing. May be read from another thread."""

    started = True

    def __init__(self) -> None:
        self.outcome: tuple[()] | None = None
        self.count = 0
        """New ones: a copy, or one overtaken on its way, is none."""
        self.kept_at: float | None = None
        """When the newest was heard, on the session's clock."""
        self.modes: set[int] = set()
        """That were seen."""
        self._told = ""
        self._healthy: bool | None = None
        self._lock = threading.Lock()
        self._rows: deque[tuple[float, float, float]] = deque(maxlen=KEPT)

    def start(self, now: float) -> list[Send]:
        """Nothing is to be said."""
        return []

    def stop(self, now: float) -> list[Send]:
        """There is no rest to wait for."""
        self.outcome = ()
        return []

    def on_event(self, event: Event, now: float) -> list[Send]:
        """Whatever the vehicle's autopilot said."""
        match event:
            case Attitude():
                self._keep(event, now)
            case StatusText() if says_log_failed(event.text):
                self._told = event.text
            case Battery():
                self._healthy = event.logs
            case Heartbeat():
                self.modes.add(event.mode)
        return []

    def _keep(self, event: Attitude, now: float) -> None:
        with self._lock:
            newest_s = self._rows[-1][0] if self._rows else -np.inf
            if event.boot_s < newest_s - REBOOT_STEP_S:
                self._rows.clear()  # the vehicle's clock began anew
            elif event.boot_s <= newest_s:
                return
            self._rows.append((event.boot_s, event.p, event.q))
        self.count, self.kept_at = self.count + 1, now

    @property
    def reported(self) -> str:
        """The vehicle's word that it does not write its log; empty where it gave none."""
        return self._told or (UNHEALTHY if self._healthy is False else "")

    @property
    def newest_s(self) -> float | None:
        """The newest attitude's time on the vehicle's clock."""
        with self._lock:
            return self._rows[-1][0] if self._rows else None

    def window(self, last_s: float) -> LiveWindow:
        """The attitudes of the last `last_s` seconds of the vehicle's clock: rates; commands are not known."""
        with self._lock:
            rows = tuple(self._rows)
        return replace(rates_alone(rows, last_s), received=self.count, log_s=rows[-1][0] if rows else None)


class CardRecording:
    """Begins at once. `carries` is what the link carries in bytes a second, where that is known."""

    def __init__(
        self,
        recorder: Recorder,
        clock: Callable[[], float],
        link_clock: LinkClock,
        telemetry: TelemetryRequests,
        carries: float | None,
    ) -> None:
        self.recorder = recorder
        self.blocks = Attitudes()
        self.over = threading.Event()
        self._clock = clock
        self._link_clock = link_clock
        self._telemetry = telemetry
        self._rate = AttitudeRate(carries, clock())

    def ask(self, now: float) -> list[Send]:
        """For what is to be heard instead of the log, from now on."""
        return self._telemetry.want({ATTITUDE: self._rate.interval_s, SERVO_OUTPUT_RAW: SERVOS_S}, now)

    def poll(self, now: float) -> list[Send]:
        """Attitudes as often as the link carries them; more only in the mode that it was begun in."""
        if self.blocks.outcome is not None:
            self.over.set()
            return []
        may_raise = len(self.blocks.modes) <= 1
        changed = self._rate.look(now, self.blocks.count, self._link_clock.lag_s, may_raise=may_raise)
        return self.ask(now) if changed else []

    def health(self) -> LogHealth:
        """How telemetry arrives, at this moment."""
        now, heard = self._clock(), self.blocks
        return LogHealth(
            file=0,
            blocks=heard.count,
            open=0,
            silent_s=None if heard.kept_at is None else max(0.0, now - heard.kept_at),
            log_s=heard.newest_s,
            clock_s=self._link_clock.vehicle_s(now),
            capacity=None,
            reported=heard.reported,
            problem=self.recorder.problem,
            on_card=True,
        )

    def seen(self) -> dict[str, Any]:
        """What a snapshot tells of it, by the snapshot's fields."""
        return {
            "recording": self.recorder.directory / "flight.tlog",
            "log_on_card": True,
            "blocks_received": 0,
            "blocks_open": 0,
            "duplicates": 0,
            "recording_problem": self.recorder.problem,
        }

    def window(self, last_s: float) -> LiveWindow:
        """The last seconds of telemetry."""
        return self.blocks.window(last_s)

    def finish(self) -> RecordingSummary:
        """Close the files."""
        return self.recorder.finish((), on_card=True)
