"""What kind of rotorcraft flew: it decides which physical effects there can be at all."""

from __future__ import annotations

import enum
from collections.abc import Iterable


class Airframe(enum.StrEnum):
    """Named as files and options name them."""

    HELICOPTER = "helicopter"
    """Rotors that are tilted by a swashplate."""
    MULTIROTOR = "multirotor"
    """Rotors fixed to the body, told apart by their motors alone."""


ANY = tuple(Airframe)


def agreed(each: Iterable[Airframe | None]) -> Airframe | None:
    """What all those say that say anything; None where nobody does, or not all the same."""
    told = {one for one in each if one is not None}
    return told.pop() if len(told) == 1 else None
