"""All that stands against flying a card, looked at before a folder is made, and told in one go."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from gcs.cards.maneuver import TestCard
from gcs.errors import TippathError
from gcs.flight import preflight
from gcs.flight.connection import Clock, Connection, WallClock
from gcs.flight.preflight import Check
from gcs.flight.rules import TICK_S
from gcs.flight.settings import ask_all, ask_together, recognise
from gcs.vehicle.autopilots import SWITCH
from gcs.vehicle.profile import CannotFlyError, VehicleProfile
from gcs.vehicle.readiness import BACKEND

LAG_WAIT_S = 4.0
"""How long a vehicle's first answer, which tells how late the link is, is waited for."""


class NotReadyError(TippathError):
    """Checks before the start failed; the message lists all that did, what and why."""


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
) -> VehicleProfile:
    """Whether this vehicle, as it is now, can fly the card at all, and what it is: `profile`, or the first that fits of
    `profiles`, or of those that come with the package. With `stream` its log must come over the link.

    Raises CannotFlyError where the vehicle cannot and nothing else stands against it, NotReadyError with all that does,
    LinkError or ProcedureError.
    """
    clock = clock or WallClock()
    _wait_for_lag(session, clock)
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
    log = preflight.streamed(ask_together(session, clock, (BACKEND,))) if stream else ()
    checks = (*late, *preflight.flying(session.snapshot(), profile), *log, *controller(session, clock, card))
    if unable is not None and all(check.ok for check in checks):
        raise unable
    require((*checks, *([] if unable is None else [Check("card", str(unable), False)])))
    assert profile is not None
    return profile


def _wait_for_lag(session: Connection, clock: Clock) -> None:
    """Until it is known how late the link is, or that the vehicle does not answer."""
    end = clock.now() + LAG_WAIT_S
    while session.snapshot().lag_s is None and clock.now() < end:
        clock.sleep(TICK_S)


def controller(session: Connection, clock: Clock, card: TestCard) -> tuple[Check, ...]:
    """Which controller follows the rates that a card commands; nothing where it commands none."""
    if all(maneuver.target != "rate" for maneuver in card.maneuvers):
        return ()
    return preflight.controller(ask_all(session, clock, [SWITCH]).get(SWITCH))


def free_bytes(path: Path) -> int | None:
    """Bytes free on the disk of `path`, None where the system does not tell."""
    try:
        return shutil.disk_usage(path).free
    except OSError:
        return None
