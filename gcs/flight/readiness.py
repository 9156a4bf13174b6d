"""Whether a card can be flown with this vehicle on this link: read on the ground or in the air, nothing set.

What its settings mean is `gcs.vehicle.readiness`; here they are asked for, together with what the vehicle tells of
itself and what the link carries. Where the vehicle streams its log it is answered meanwhile, so that it can be armed
and the link's share of the log can be counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from gcs.cards.maneuver import TestCard
from gcs.flight import preflight
from gcs.flight.log_health import ENOUGH
from gcs.flight.settings import Asking, Clock, ask_together
from gcs.link.clock import LOST_AFTER_S
from gcs.link.log_answer import AnsweredRate, LogClient
from gcs.link.transport import carries
from gcs.vehicle.autopilots import AUTOPILOTS, KINDS, mode_name, state_trouble
from gcs.vehicle.profile import CannotFlyError, VehicleProfile, bundled_profiles, choose_profile
from gcs.vehicle.readiness import (
    ASKED,
    Asked,
    Item,
    Standing,
    asked_of_log,
    items,
    log_need,
    streams_log,
    too_slow,
    way_of_log,
)
from gcs.vehicle.snapshot import VehicleSnapshot

LAG_WAIT_S = 4.0
RATE_WAIT_S = 4.0
"""How long the log is listened to, to count what the link carries of it."""
TICK_S = 0.05


class Ground(Asking, Protocol):
    """What is needed of a session."""

    @property
    def station(self) -> int: ...
    def answer_log(self, wanted: bool = True, *, at_once: bool = False) -> None: ...
    def answered_rate(self) -> AnsweredRate | None: ...


class Time(Clock, Protocol):
    def sleep(self, seconds: float) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Readiness:
    """What was looked at, the worst first, the log's before the others."""

    link: str
    vehicle: str
    """In words."""
    card: str
    stream: bool
    """The log comes over the link; else it is taken from the vehicle afterwards."""
    items: tuple[Item, ...]

    @property
    def ready(self) -> bool:
        """Whether the card can be flown with the vehicle as it is set; the pilot still arms and takes off."""
        return all(item.standing is not Standing.MUST for item in self.items)

    @property
    def changes(self) -> dict[str, float]:
        """Settings without which the card cannot be flown."""
        return _wanted(self.items, Standing.MUST)

    @property
    def better(self) -> dict[str, float]:
        """Settings with which it would be flown better."""
        return {name: value for name, value in _wanted(self.items, Standing.BETTER).items() if name not in self.changes}

    @property
    def restart(self) -> bool:
        """Whether the autopilot must be restarted for its changes."""
        return any(item.restart and item.standing is Standing.MUST for item in self.items)


def _wanted(found: Sequence[Item], standing: Standing) -> dict[str, float]:
    return {name: value for item in found if item.standing is standing for name, value in item.wanted}


def look(
    session: Ground,
    clock: Time,
    card: TestCard,
    *,
    link: str,
    profiles: Sequence[VehicleProfile] = (),
    stream: bool | None = None,
) -> Readiness:
    """Read all of it; takes some seconds, longer on a slow link. `stream` as in `gcs.vehicle.readiness.Asked`.

    Raises LinkError where the link is lost meanwhile, ProcedureError where the vehicle stops answering.
    """
    _wait(clock, LAG_WAIT_S, lambda: session.snapshot().lag_s is not None)
    snapshot = session.snapshot()
    asked = Asked(f_stop_hz=_highest(card), stream=stream, carries=carries(link), station=session.station)
    about = {"link": link, "vehicle": _who(snapshot), "card": card.name}
    if snapshot.lag_s is None:  # it hears nothing: no question would be answered
        found = (*_of_link(snapshot), *_of_vehicle(snapshot, None))
        return Readiness(**about, stream=True, items=_ordered(found))
    settings, profile, unable = _read(session, clock, profiles)
    over_link = way_of_log(settings, asked)
    _listen(session, clock, settings, asked)
    snapshot = session.snapshot()
    found = (
        *_of_card(card, profile, unable),
        *items(settings, asked, profile),
        *_of_client(snapshot.log_client, over_link),
        *_of_rate(session.answered_rate(), settings, asked, over_link),
        *_of_link(snapshot),
        *_of_vehicle(snapshot, profile),
    )
    return Readiness(**about, stream=over_link, items=_ordered(found))


def answer_where_needed(session: Ground, clock: Clock, link: str) -> bool:
    """Answer the vehicle's log from now on, so that it can be armed, where it streams it and the link carries it.

    Raises as `look`.
    """
    settings = ask_together(session, clock, asked_of_log(carries(link)))
    needed = streams_log(settings) and not too_slow(settings, carries(link))
    session.answer_log(needed)
    return needed


def client_words(client: LogClient) -> str:
    """Who answers the vehicle's log, for a screen; empty where that does not matter."""
    return {
        LogClient.NOBODY: "",
        LogClient.ASKED: "answering the vehicle's log so that it can be armed (no block of it came yet)",
        LogClient.OURS: "answering the vehicle's log so that it can be armed",
        LogClient.ANOTHER: "another station answers the vehicle's log: this one stays silent",
        LogClient.SHED: "the vehicle's log is too much for this link: it is not answered any more",
    }[client]


# ------------------------------------------------------------------------------------------------ reading


def _read(
    session: Ground, clock: Clock, profiles: Sequence[VehicleProfile]
) -> tuple[dict[str, float], VehicleProfile | None, str]:
    """The settings, what kind of vehicle it is, and why it is none."""
    known = profiles or bundled_profiles()
    names = dict.fromkeys((*ASKED, *(name for one in known for name in (*one.needs, *one.settings))))
    settings = ask_together(session, clock, tuple(names))
    try:
        return settings, choose_profile(settings, session.snapshot().autopilot, profiles), ""
    except CannotFlyError as error:
        return settings, None, str(error)


def _listen(session: Ground, clock: Time, settings: Mapping[str, float], asked: Asked) -> None:
    """To the log, until its rate is counted; not on a link that it would fill."""
    if not streams_log(settings) or too_slow(settings, asked.carries):
        return
    session.answer_log(at_once=True)
    _wait(clock, RATE_WAIT_S, lambda: session.answered_rate() is not None)


def _wait(clock: Time, seconds: float, done: Callable[[], bool]) -> None:
    end = clock.now() + seconds
    while clock.now() < end and not done():
        clock.sleep(TICK_S)


def _highest(card: TestCard) -> float:
    return max((run.maneuver.f_stop_hz for run in card.runs() if run.maneuver.kind == "chirp"), default=10.0)


# ------------------------------------------------------------------------------------------------ what it means


def _of_card(card: TestCard, profile: VehicleProfile | None, unable: str) -> tuple[Item, ...]:
    if profile is None:
        return (Item(name="vehicle", standing=Standing.MUST, value="no maneuvers", words=unable),)
    for run in card.runs():
        try:
            profile.plan(run.maneuver)
        except CannotFlyError as error:
            return (Item(name="card", standing=Standing.MUST, value=card.name, words=str(error)),)
    return (Item(name="card", standing=Standing.FINE, value=card.name, words=f"flown by {profile.name}"),)


def _of_client(client: LogClient, stream: bool) -> tuple[Item, ...]:
    words = client_words(client)
    if client is LogClient.NOBODY:
        return ()
    standing = Standing.FINE
    if client is LogClient.ANOTHER:
        standing = Standing.MUST if stream else Standing.FINE
        words += "; end its log download (in MAVProxy `module unload dataflash_logger`), or fly `--log card`"
    elif client is LogClient.ASKED:
        words = "asked for, and no block came: a vehicle that logs nothing before arming sends none, nor does one that "
        words += "was not restarted since it was set to, nor one that serves a station that is not heard here"
    elif client is LogClient.SHED:
        standing = Standing.MUST
        words += ", because it became late with it; keep the log on the card and fly `tippath sweep --log card`"
    return (Item(name="log", standing=standing, value=client.value, words=words),)


def _of_rate(rate: AnsweredRate | None, settings: Mapping[str, float], asked: Asked, stream: bool) -> tuple[Item, ...]:
    need = log_need(settings)
    needs = "" if need is None else f"a sweep's log needs about {need / 1e3:.0f} kB/s"
    if rate is not None:
        enough = rate.carried >= ENOUGH * rate.numbered
        value = f"{rate.carried / 1e3:.0f} of {rate.numbered / 1e3:.0f} kB/s of the log arrive"
    elif asked.carries is not None:
        enough = not too_slow(settings, asked.carries)
        value = f"carries {asked.carries / 1e3:.1f} kB/s at most"
    else:
        enough, value = True, "rate not counted"
        needs = ", ".join(filter(None, [needs, "nothing of the log came yet"]))
    if not stream:
        needs = "" if need is None else f"a sweep's log needs about {need / 1e3:.0f} kB/s: "
        needs += "it stays on the card, telemetry alone crosses this link"
        return (Item(name="link", standing=Standing.FINE, value=value, words=needs),)
    standing = Standing.FINE if enough else Standing.MUST
    if not enough:
        needs = "; ".join(filter(None, [needs, "a faster link (USB, UDP), or `tippath sweep --log card`"]))
    return (Item(name="link", standing=standing, value=value, words=needs),)


def _of_link(snapshot: VehicleSnapshot) -> tuple[Item, ...]:
    (check,) = preflight.lag(snapshot)
    silent = snapshot.lag_s is None or snapshot.answer_age_s > LOST_AFTER_S
    late = "" if snapshot.lag_s is None else f"{snapshot.lag_s:.2f} s"
    standing = Standing.FINE if check.ok else Standing.MUST
    words = "orders arrive in time" if check.ok else check.words.removeprefix(f"{late}: ")
    found = [Item(name="lag", standing=standing, value="no answer" if silent else late, words=words)]
    if snapshot.signs:
        words = "it signs what it says, and obeys only who has its key: --key FILE"
        found.append(Item(name="signing", standing=Standing.MUST, value="no key here", words=words))
    elif snapshot.signed:
        found.append(Item(name="signing", standing=Standing.FINE, value="signed", words=_refused(snapshot)))
    if snapshot.newcomer:
        words = "the vehicle's own is silent: is it the same one? Connect anew to take it"
        found.append(Item(name="address", standing=Standing.MUST, value=snapshot.newcomer, words=words))
    if snapshot.strangers:
        words = "from other addresses, dropped"
        found.append(Item(name="strangers", standing=Standing.FINE, value=f"{snapshot.strangers} packets", words=words))
    if snapshot.other_stations:
        count = f"{snapshot.other_stations} other"
        found.append(Item(name="stations", standing=Standing.FINE, value=count, words="ground stations on this link"))
    return tuple(found)


def _refused(snapshot: VehicleSnapshot) -> str:
    return "not believed: " + ", ".join(f"{n} {why}" for why, n in snapshot.refused) if snapshot.refused else ""


def _of_vehicle(snapshot: VehicleSnapshot, profile: VehicleProfile | None) -> tuple[Item, ...]:
    found = []
    trouble = state_trouble(snapshot.status)
    if trouble:
        found.append(Item(name="state", standing=Standing.MUST, value=f"{snapshot.status}", words=trouble))
    flies = "armed" if snapshot.armed else "disarmed"
    words = "" if snapshot.armed else "the pilot arms and takes off"
    manual = () if profile is None else profile.manual_throttle_modes
    if profile is not None and snapshot.mode not in manual:
        names = " or ".join(mode_name(mode, snapshot.vehicle_type, snapshot.autopilot) for mode in manual)
        words = "; ".join(filter(None, [words, f"a sweep starts from {names}"]))
    found.append(Item(name="mode", standing=Standing.FINE, value=f"{snapshot.mode_name}, {flies}", words=words))
    found.append(_battery(snapshot))
    rotor = "not told" if snapshot.rpm is None else f"{snapshot.rpm:.0f} rpm"
    words = "no RPM comes over this link; its steadiness is not checked" if snapshot.rpm is None else ""
    return (*found, Item(name="rotor speed", standing=Standing.FINE, value=rotor, words=words))


def _battery(snapshot: VehicleSnapshot) -> Item:
    left, volts = snapshot.battery_remaining, snapshot.battery_v
    value = " ".join(
        [*([] if volts is None else [f"{volts:.1f} V"]), *([] if left is None else [f"{100 * left:.0f} %"])]
    )
    low = left is not None and left < preflight.LOW_BATTERY
    return Item(
        name="battery",
        standing=Standing.MUST if low else Standing.FINE,
        value=value or "not told",
        words=f"below {100 * preflight.LOW_BATTERY:.0f} % nothing is started: charge it" if low else "",
    )


def _ordered(found: Sequence[Item]) -> tuple[Item, ...]:
    worst = list(Standing)
    return tuple(sorted(found, key=lambda item: (worst.index(item.standing), not item.of_log)))


def _who(snapshot: VehicleSnapshot) -> str:
    autopilot = AUTOPILOTS.get(snapshot.autopilot, f"autopilot {snapshot.autopilot}")
    kind = KINDS.get(snapshot.vehicle_type, f"vehicle of type {snapshot.vehicle_type}")
    return f"system {snapshot.system}, {autopilot} {snapshot.version}".rstrip() + f", {kind}"
