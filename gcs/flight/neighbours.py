"""Who else speaks on this link: other stations and vehicles, a telemetry radio, another address in the vehicle's name.
They are shown, and not listened to.
"""

from __future__ import annotations

from typing import Any

from gcs.link.events import Event, Heartbeat, RadioStatus
from gcs.link.signing import Signing
from gcs.link.transport import Transport

HEARD_FOR_S = 10.0
"""How long a second station, a second vehicle or a radio counts as being there after it was heard."""


class Neighbours:
    """Times are the session's clock, s."""

    def __init__(self, transport: Transport, signing: Signing | None) -> None:
        self._transport = transport
        self._signing = signing
        self._heard: dict[tuple[bool, int, int], float] = {}
        """(whether a station, system, component) -> when."""
        self._radio: tuple[RadioStatus, float] | None = None

    def hear(self, event: Event | None, ours: int | None, now: float) -> None:
        """Anything that was said on the link; `ours` is the vehicle's system id, None before there is one."""
        if isinstance(event, RadioStatus):
            self._radio = (event, now)
        if not isinstance(event, Heartbeat):
            return
        other_vehicle = event.from_autopilot and ours is not None and event.system != ours
        if event.from_station or other_vehicle:
            self._heard[(event.from_station, event.system, event.component)] = now

    def seen(self, now: float) -> dict[str, Any]:
        """Fields of a snapshot."""
        self._heard = {who: heard for who, heard in self._heard.items() if now - heard <= HEARD_FOR_S}
        radio = self._radio
        frames, bad_bytes = self._transport.counts
        return {
            "other_stations": sum(station for station, _, _ in self._heard),
            "other_vehicles": len({system for station, system, _ in self._heard if not station}),
            "radio": radio[0] if radio is not None and now - radio[1] <= HEARD_FOR_S else None,
            "refused": () if self._signing is None else self._signing.refusals(),
            "newcomer": self._transport.newcomer or "",
            "strangers": self._transport.strangers,
            "frames": frames,
            "bad_bytes": bad_bytes,
        }

    def tend(self, recording: bool) -> None:
        """What is due: the time of signatures is kept; and whoever has the key is the vehicle, from whatever address,
        but not while something is recorded."""
        if self._signing is not None:
            self._signing.keep()
            if not recording:
                self._transport.take_over()
