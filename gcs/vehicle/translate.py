"""A card in the paper's words, as far as one vehicle can fly it: what stays, and in words what is left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gcs.cards.maneuver import Maneuver, TestCard, card_text
from gcs.vehicle.profile import CannotFlyError, VehicleProfile

NO_NOISE = "the chirps' noise: this vehicle flies its own chirp law, without noise"


@dataclass(frozen=True, slots=True)
class Translation:
    """A card for one vehicle."""

    card: TestCard
    """The very card where nothing is left out."""
    left_out: tuple[str, ...]
    """One sentence each, empty where all of it can be flown."""


def translate(card: TestCard, profile: VehicleProfile) -> Translation:
    """What of a card the vehicle can fly. Nothing is left out silently: whoever flies it asks first.

    Raises CannotFlyError where nothing is left, or a maneuver makes no sense on any vehicle.
    """
    stays: list[Maneuver] = []
    left_out: list[str] = []
    for maneuver in card.maneuvers:
        without = _without_noise(maneuver, profile)
        try:
            profile.plan(without)
        except CannotFlyError as error:
            if maneuver.problem() is not None:
                raise
            left_out.append(f"{error}")
            continue
        stays.append(without)
        if without is not maneuver:
            left_out.append(NO_NOISE)
    if not left_out:
        return Translation(card, ())
    told = tuple(dict.fromkeys(left_out))
    if not stays:
        raise CannotFlyError("nothing of this card can be flown: " + "; ".join(told))
    fitting = replace(card, maneuvers=tuple(stays))
    return Translation(replace(fitting, text=card_text(fitting)), told)


def _without_noise(maneuver: Maneuver, profile: VehicleProfile) -> Maneuver:
    noisy = maneuver.kind == "chirp" and maneuver.noise_fraction > 0
    return replace(maneuver, noise_fraction=0.0) if noisy and profile.chirp_law == "ardupilot" else maneuver
