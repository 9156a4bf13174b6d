"""The telemetry that the screens need: asked for where the vehicle does not send it, and given back at the end."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping

from gcs.link.encode import SET_MESSAGE_INTERVAL, TELEMETRY, Command, Send

TELEMETRY_CHECK_S = 2.5
TELEMETRY_TRIES = 3
FRESH_S = 1.5
"""Nothing is asked for on a link that has been silent for longer."""


ENOUGH = 0.6
"""Of the rate that was wanted: less, and it is asked for again."""


class TelemetryRequests:
    """Which messages came and which were asked for, a few times. All times are the session's clock, s.

    What is `want`ed is asked for by its rate, as long as it is wanted: other stations overwrite it.
    """

    def __init__(self) -> None:
        self._wanted: Mapping[int, float] = {}
        self._came: Counter[int] = Counter()
        """Since the last look, of what is wanted."""
        self._looked = 0.0
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
        if message in self._wanted:
            self._came[message] += 1

    def want(self, wanted: Mapping[int, float], now: float) -> list[Send]:
        """Ask for these messages, each with its interval in s, from now on; what was wanted before goes back."""
        back = [_interval(message, 0.0) for message in self._wanted if message not in wanted]
        self._wanted, self._came, self._looked = dict(wanted), Counter(), now
        self._next = now + TELEMETRY_CHECK_S
        return [*back, *(_interval(message, interval_s) for message, interval_s in wanted.items())]

    def _too_slow(self, now: float) -> list[int]:
        """Of what is wanted, since the last look."""
        over_s, came = now - self._looked, self._came
        self._looked, self._came = now, Counter()
        return [message for message, every_s in self._wanted.items() if came[message] * every_s < ENOUGH * over_s]

    def poll(self, now: float, last_heard: float) -> list[Send]:
        """What is to be asked for now; `last_heard` is when the vehicle was."""
        if now < self._next:
            return []
        self._next = now + TELEMETRY_CHECK_S
        slow = self._too_slow(now)
        if now - last_heard > FRESH_S:
            return []
        missing = [
            message
            for message, interval_s in TELEMETRY.items()
            if message not in self._wanted
            and now - self._heard.get(message, -math.inf) >= max(2.0, 2.5 * interval_s)
            and self._asked.get(message, 0) < TELEMETRY_TRIES
        ]
        for message in missing:
            self._asked[message] = self._asked.get(message, 0) + 1
        wanted = [_interval(message, self._wanted[message]) for message in slow]
        return [*wanted, *(_interval(message, TELEMETRY[message]) for message in missing)]

    def given_back(self) -> list[Send]:
        """The vehicle keeps intervals for the next station on this link: its own again."""
        return [_interval(message, 0.0) for message in {**self._asked, **self._wanted}]


def _interval(message: int, interval_s: float) -> Send:
    """0 is the vehicle's own."""
    return Command(SET_MESSAGE_INTERVAL, (float(message), interval_s * 1e6))
