"""Before a folder is made: what this vehicle is, what of a card it can fly, and whether it can fly that now."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gcs.cards.maneuver import TestCard, load_card
from gcs.errors import UsageError
from gcs.flight import preflight
from gcs.flight.connection import Clock, Connection, LogWay, WallClock
from gcs.flight.flyable import require_flyable, wait_for_lag
from gcs.flight.settings import recognise
from gcs.vehicle.profile import CannotFlyError, VehicleProfile
from gcs.vehicle.translate import translate

NO_CARD = "what to fly? Give --axis roll|pitch|elevator, or --card hover"
NOTHING = TestCard(name="nothing", maneuvers=())
"""To ask what stands against any card."""


@dataclass(frozen=True, slots=True)
class Prepared:
    """A card that this vehicle can fly, as it is now."""

    card: TestCard
    profile: VehicleProfile
    left_out: tuple[str, ...] = ()
    """Of the card that was asked for, by consent."""
    own: bool = False
    """It is the vehicle's own card."""


def prepared(
    session: Connection,
    card: TestCard | None,
    *,
    profiles: Sequence[VehicleProfile] = (),
    consent: Callable[[tuple[str, ...]], bool],
    otherwise: TestCard | None = None,
    log: LogWay = "stream",
    link: str | None = None,
    clock: Clock | None = None,
) -> Prepared:
    """A card, or without one the vehicle's own, else `otherwise`, as far as the vehicle can fly it.

    `consent` is asked with what must be left out, one sentence each, and nothing is left out unless it is true. Raises
    UsageError where there is no card, CannotFlyError, and as `gcs.flight.flyable.require_flyable`, also where the
    vehicle is not known: then with all else that stands against flying.
    """
    clock, stream = clock or WallClock(), log == "stream"
    profile = _known(session, clock, profiles, stream=stream, link=link)
    own = None if card is not None else own_card(profile, session.snapshot().vehicle_type)
    card = card or own or otherwise
    if card is None:
        raise UsageError(NO_CARD)
    translation = translate(card, profile)
    if translation.left_out and not consent(translation.left_out):
        require_flyable(session, translation.card, clock, profile=profile, stream=stream, link=link)
        raise CannotFlyError(
            f"this vehicle cannot fly all of the card: {'; '.join(translation.left_out)}. --leave-out flies the rest"
        )
    require_flyable(session, translation.card, clock, profile=profile, stream=stream, link=link)
    return Prepared(translation.card, profile, translation.left_out, own is not None)


def _known(
    session: Connection, clock: Clock, profiles: Sequence[VehicleProfile], *, stream: bool, link: str | None
) -> VehicleProfile:
    wait_for_lag(session, clock)
    try:
        if all(check.ok for check in preflight.lag(session.snapshot())):
            return recognise(session, clock, profiles)
    except CannotFlyError:
        pass  # with all else that stands against it
    return require_flyable(session, NOTHING, clock, profiles=profiles, stream=stream, link=link)


def own_card(profile: VehicleProfile, vehicle_type: int) -> TestCard | None:
    """The card of a vehicle for which none was named; None where it has none."""
    name = profile.own_card(vehicle_type)
    return None if name is None else load_card(name)
