"""The telemetry that the screens need: asked for where the vehicle does not send it, and given back at the end."""

from __future__ import annotations

import math

from gcs.link.encode import SET_MESSAGE_INTERVAL, TELEMETRY, Command, Send

TELEMETRY_CHECK_S = 2.5
TELEMETRY_TRIES = 3
FRESH_S = 1.5
"""Nothing is asked for on a link that has been silent for longer."""


class TelemetryRequests:
    """Which messages came and which were asked for, a few times. All times are the session's clock, s."""

    def __init__(self) -> None:
        self._heard: dict[int, float] = {}
        self._asked: dict[int, int] = {}
        self._next = math.inf

    def begin(self, now: float) -> None:
        """The vehicle is known: let it send by itself first."""
        self._next = now + TELEMETRY_CHECK_S

    def heard(self, message: int, now: float) -> None:
        """A message of the vehicle's autopilot, by its number."""
        if message in TELEMETRY:
            self._heard[message] = now

    def poll(self, now: float, last_heard: float) -> list[Send]:
        """What is to be asked for now; `last_heard` is when the vehicle was."""
        if now < self._next:
            return []
        self._next = now + TELEMETRY_CHECK_S
        if now - last_heard > FRESH_S:
            return []
        missing = [
            message
            for message, interval_s in TELEMETRY.items()
            if now - self._heard.get(message, -math.inf) >= max(2.0, 2.5 * interval_s)
            and self._asked.get(message, 0) < TELEMETRY_TRIES
        ]
        for message in missing:
            self._asked[message] = self._asked.get(message, 0) + 1
        return [Command(SET_MESSAGE_INTERVAL, (float(message), TELEMETRY[message] * 1e6)) for message in missing]

    def given_back(self) -> list[Send]:
        """The vehicle keeps intervals for the next station on this link: its own again."""
        return [Command(SET_MESSAGE_INTERVAL, (float(message), 0.0)) for message in self._asked]
