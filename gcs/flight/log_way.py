"""What of the vehicle's log, or of telemetry instead, must be fresh before a maneuver and while it is flown.

Streamed, the log's own blocks show that it is written and that the link is alive. Where it stays on the vehicle's card
(`--log card`), fresh attitudes stand for the link, and the vehicle's word for the log: its settings, and that it told
of no failure.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gcs.flight import preflight
from gcs.flight.card_recording import UNHEALTHY
from gcs.flight.connection import Clock, Connection, LogWay
from gcs.flight.log_health import LogHealth
from gcs.flight.preflight import Check
from gcs.flight.rules import LOG_SILENCE_S, TICK_S
from gcs.flight.settings import ask
from gcs.vehicle.autopilots import LOG_BACKEND, no_card_log, says_log_failed
from gcs.vehicle.snapshot import VehicleSnapshot

LEAST_ATTITUDES = 8.0
"""A second, that the limits are watched by."""
TELEMETRY_RATE = 6000
"""Bytes a second of telemetry at most; twice what is wanted for the disk."""


def card_log(session: Connection, clock: Clock) -> tuple[Check, ...]:
    """Whether the vehicle keeps its log by itself, as far as its settings and its own words tell.

    Raises as `gcs.flight.settings.ask`.
    """
    why_not = no_card_log(ask(session, clock, LOG_BACKEND)) or _failed(session)
    return (Check("log", why_not or "the vehicle keeps it on its card; nothing of it is sent", not why_not),)


def _failed(session: Connection) -> str:
    """The vehicle's word that its log is not written, as long as it says nothing better since; empty where none."""
    healthy = session.snapshot().logs
    if healthy:
        return ""
    told = [text.text for text in session.texts_since(0)[1] if says_log_failed(text.text)]
    if healthy is False or told:
        why = f"it says {told[-1]!r}" if told else UNHEALTHY
        return f"the vehicle does not write its log: {why}; look at its card, and fly this again"
    return ""


@dataclass(frozen=True, slots=True)
class Look:
    """What was seen in the seconds of hover before a card."""

    before: VehicleSnapshot
    """As the recording began."""
    now: VehicleSnapshot
    health: LogHealth | None
    seconds: float
    """How long it was looked."""


def hovered(session: Connection, log: LogWay, seconds: float) -> bool:
    """Whether so many seconds of hover came, and enough of the log to count its rate."""
    window, health = session.samples(seconds), session.log_health()
    long_enough = bool(window.t.size) and float(window.t[-1] - window.t[0]) > 0.9 * seconds
    counted = None if health is None else health.capacity
    return long_enough and (log == "card" or (counted is not None and counted.enough))


def arriving(
    log: LogWay, look: Look, disk_free: int | None, duration_s: float, loop_hz: float | None
) -> tuple[Check, ...]:
    """Whether what must be fresh arrives, and fits on the disk."""
    if log == "stream":
        streamed = preflight.recording(look.before, look.now, disk_free, duration_s)
        return (*streamed, *preflight.carried(look.health, loop_hz))
    disk = preflight.disk(disk_free, round(TELEMETRY_RATE * duration_s) + preflight.SPARE_BYTES)
    return (*_telemetry(look), *_in_words(look.now), disk)


def _telemetry(look: Look) -> tuple[Check, ...]:
    count = 0 if look.health is None else look.health.blocks
    rate = count / look.seconds if look.seconds > 0 else 0.0
    words = f"{rate:.0f} attitudes a second"
    if rate >= LEAST_ATTITUDES:
        return (Check("telemetry", words),)
    words += (
        f", and the limits are watched by at least {LEAST_ATTITUDES:g} (more were asked for): let the vehicle send "
        "less else on this link (SRx_*), or use a faster one"
    )
    return (Check("telemetry", words, False),)


def _in_words(snapshot: VehicleSnapshot) -> tuple[Check, ...]:
    if snapshot.recording_problem is not None:
        return (Check("record", snapshot.recording_problem, False),)
    return (
        Check("limits", "rates and attitude by telemetry; the commands are known only from the card's log"),
        Check("probe", "no small step first: it is judged by the commands, which telemetry does not tell"),
    )


def silent(session: Connection, clock: Clock, log: LogWay) -> str:
    """Why no run may start: nothing new came for as long as a run would be ended for. Empty where it did."""
    before, end = _came(session, log), clock.now() + LOG_SILENCE_S
    while _came(session, log) == before:
        if clock.now() >= end:
            if log == "card":
                return f"no telemetry arrives (no new attitude in {LOG_SILENCE_S:g} s); nothing was started"
            health = session.log_health()
            another = health is not None and health.another
            taken = ": another station's log client has taken it, end that one first" if another else ""
            return (
                f"the vehicle's log no longer arrives (no new block in {LOG_SILENCE_S:g} s){taken}; nothing was started"
            )
        clock.sleep(TICK_S)
    return ""


def _came(session: Connection, log: LogWay) -> int:
    if log == "stream":
        return session.snapshot().blocks_received
    health = session.log_health()
    return 0 if health is None else health.blocks


def not_written(session: Connection, log: LogWay) -> str:
    """The vehicle's word, since the recording began, that its card's log is not written; empty where none."""
    health = session.log_health()
    return "" if log == "stream" or health is None else health.reported


def rest_words(path: Path) -> str:
    """What to do about a streamed log that is not whole."""
    return (
        "what is missing the vehicle's own file may have, if it keeps one: disarm, then\n"
        f"`tippath fetch --connect LINK -o {path}`; both are read together"
    )


def log_words(path: Path) -> str:
    """What to do for the log of a flight that stayed on the card."""
    return (
        f"log on the vehicle's card: `tippath fetch --connect LINK -o {path}` brings it, or take it off the card and "
        f"`tippath ingest LOG --flight {path}`"
    )
