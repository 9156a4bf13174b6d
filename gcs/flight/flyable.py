"""All that stands against flying a card, looked at before a folder is made, and told in one go."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from gcs.cards.maneuver import TestCard
from gcs.errors import LinkError, TippathError
from gcs.flight import preflight
from gcs.flight.connection import Clock, Connection, WallClock
from gcs.flight.preflight import AGAIN, Check
from gcs.flight.readiness import client_words
from gcs.flight.rules import TICK_S
from gcs.flight.settings import ask_together, recognise
from gcs.link.transport import carries
from gcs.vehicle.autopilots import SWITCH
from gcs.vehicle.profile import CannotFlyError, VehicleProfile
from gcs.vehicle.readiness import asked_of_log

LAG_WAIT_S = 4.0
"""How long a vehicle's first answer, which tells how late the link is, is waited for."""
STEADY_S = 3.0
"""In the air, and in the mode, for so long without a break."""
WARNING = 4
"""The severity of a text of the vehicle from which on it matters to somebody who waits."""


class NotReadyError(TippathError):
    """Checks before the start failed; the message lists all that did, what and why."""

    reason = "not ready"


def require(checks: Sequence[Check]) -> None:
    """Raises NotReadyError with all that failed."""
    failed = [check for check in checks if not check.ok]
    if failed:
        raise NotReadyError("not ready: " + "; ".join(f"{check.name}: {check.words}" for check in failed))


def require_flyable(
    session: Connection,
    card: TestCard,
    clock: Clock | None = None,
    *,
    profile: VehicleProfile | None = None,
    profiles: Sequence[VehicleProfile] = (),
    stream: bool = True,
    in_the_air: bool = True,
    link: str | None = None,
) -> VehicleProfile:
    """Whether this vehicle, as it is now, can fly the card at all, and what it is: `profile`, or the first that fits of
    `profiles`, or of those that come with the package. With `stream` its log must come over the link; without
    `in_the_air` the pilot may still take off. `link` is the LINK, which may tell what it carries.

    Raises CannotFlyError where the vehicle cannot and nothing else stands against it, NotReadyError with all that does,
    LinkError or ProcedureError.
    """
    clock = clock or WallClock()
    wait_for_lag(session, clock)
    late = preflight.lag(session.snapshot())
    if not late[0].ok:  # it could not be asked
        require((*late, *preflight.flying(session.snapshot(), profile)))
    unable: CannotFlyError | None = None
    try:
        profile = profile or recognise(session, clock, profiles)
        for run in card.runs():
            profile.plan(run.maneuver)
    except CannotFlyError as error:
        unable = error
    carried = None if link is None else carries(link)
    log = preflight.streamed(ask_together(session, clock, asked_of_log(carried)), carried) if stream else ()
    flying = preflight.flying(session.snapshot(), profile) if in_the_air else ()
    checks = (*late, *flying, *log, *(controller(session, clock, card) if in_the_air else ()))
    if unable is not None and all(check.ok for check in checks):
        raise unable
    require((*checks, *([] if unable is None else [Check("card", str(unable), False)])))
    assert profile is not None
    return profile


def wait_for_pilot(
    session: Connection,
    clock: Clock,
    profile: VehicleProfile,
    *,
    tell: Callable[[str], None],
    ended: Callable[[], bool] = lambda: False,
) -> bool:
    """Until the pilot has the vehicle in the air for some seconds, in a mode from which the card may start; False once
    `ended()`. `tell` hears what is waited for, and the vehicle's own words of warning.

    Raises LinkError where the link is lost meanwhile.
    """
    told, cursor = "", session.texts_since(0)[0]
    steady_s = clock.now()
    while not ended():
        snapshot = session.snapshot()
        if snapshot.lost:
            raise LinkError("the link was lost while the pilot's take-off was waited for; nothing was flown")
        standing = [check.words.removesuffix(AGAIN) for check in preflight.flying(snapshot, profile) if not check.ok]
        words = "; ".join([*standing, *filter(None, [client_words(snapshot.log_client)])] if standing else ())
        if words and words != told:
            tell(f"waiting: {words}")
        told = words
        cursor, texts = session.texts_since(cursor)
        for text in texts:
            if text.severity <= WARNING:
                tell(f"the vehicle says: {text.text}")
        steady_s = clock.now() if standing else steady_s
        if clock.now() - steady_s >= STEADY_S:
            return True
        clock.sleep(TICK_S)
    return False


def wait_for_lag(session: Connection, clock: Clock) -> None:
    """Until it is known how late the link is, or that the vehicle does not answer."""
    end = clock.now() + LAG_WAIT_S
    while session.snapshot().lag_s is None and clock.now() < end:
        clock.sleep(TICK_S)


def controller(session: Connection, clock: Clock, card: TestCard) -> tuple[Check, ...]:
    """Which controller follows the rates that a card commands; nothing where it commands none."""
    if all(maneuver.target != "rate" for maneuver in card.maneuvers):
        return ()
    return preflight.controller(ask_together(session, clock, [SWITCH]).get(SWITCH))


def free_bytes(path: Path) -> int | None:
    """Bytes free on the disk of `path`, None where the system does not tell."""
    try:
        return shutil.disk_usage(path).free
    except OSError:
        return None
