"""Is it the vehicle, set up as it was, that the model of these gains was identified on?

What was known then stands in the file of gains; what is now is asked of the vehicle. What differs speaks against a
push; what is not known on one of the two sides is said, and neither for nor against.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gcs import documents
from gcs.flight.session import Session
from gcs.link.procedures import ReadSeveral
from gcs.vehicle.identity import Group, group_of, standing_on

Kind = Literal["margins", "not judged", "switch", "battery", "not identified", Group]
VOLTAGE = 0.1
"""Of the voltages flown with: a pack's way from full to empty is as much to either side of its middle, and a command's
gain goes with the square."""
ROTOR = 0.03
"""Of the rotor speeds flown with: flapping stiffness goes with the square."""
TURNING = 0.3
"""Of the flown rotor speed: slower, the rotor is at rest or on its way."""


class Identified(documents.Open, frozen=True, kw_only=True):
    """What is known of a vehicle while its model was identified."""

    parameters: dict[str, float] = {}
    """Those that a model stands on, by name."""
    changed: tuple[str, ...] = ()
    """Those that were not the same in all runs."""
    battery_v: tuple[float, float] | None = None
    """Lowest and highest; None where nobody logged it, as the next."""
    rotor_rpm: tuple[float, float] | None = None

    def to_json(self) -> dict[str, Any]:
        return {
            "parameters": self.parameters,
            "changed": list(self.changed),
            "battery_v": None if self.battery_v is None else list(self.battery_v),
            "rotor_rpm": None if self.rotor_rpm is None else list(self.rotor_rpm),
        }


@dataclass(frozen=True, kw_only=True)
class Objection:
    """Something that speaks against a push, or that is not known."""

    kind: Kind
    words: str
    refuses: bool = True
    """False where it only is not known."""

    def to_json(self) -> dict[str, Any]:
        return {"kind": self.kind, "words": self.words, "refuses": self.refuses}


def objections(session: Session, then: Identified | None) -> tuple[Objection, ...]:
    """What is not as it was. Raises ProcedureError, LinkError."""
    if then is None or not (then.parameters or then.changed):
        words = "whether it is the vehicle that was identified, as it was set up: not known (its logs tell no settings)"
        told = [Objection(kind="not identified", words=words, refuses=False)]
    else:
        answered = session.call(ReadSeveral(tuple(then.parameters)))
        now = {name: None if one is None else one.value for name, one in answered.items()}
        told = list(of_parameters(then, now))
    snapshot = session.snapshot()
    battery, rotor = (None, None) if then is None else (then.battery_v, then.rotor_rpm)
    return (*told, *of_battery(battery, snapshot.battery_v), *of_rotor(rotor, snapshot.rpm))


def of_parameters(then: Identified, now: Mapping[str, float | None]) -> list[Objection]:
    """`now` has what was answered, None for a name that the vehicle does not have."""
    found: dict[Group, list[str]] = {}
    unknown: list[str] = []
    for name, was in standing_on(then.parameters).items():
        is_now = now.get(name)
        group = group_of(name)
        assert group is not None
        if name not in now:
            unknown.append(name)
        elif is_now is None:
            found.setdefault(group, []).append(f"{name} was {was:g}, and the vehicle has none")
        elif not same(was, is_now):
            found.setdefault(group, []).append(f"{name} was {was:g}, is {is_now:g}")
    told = [
        Objection(kind=group, words=f"{group}: not as identified: {'; '.join(each)}") for group, each in found.items()
    ]
    if then.changed:
        words = f"settings: not the same in all runs of the fit: {', '.join(then.changed)}"
        told.append(Objection(kind="not identified", words=words))
    if unknown:
        words = f"settings: not answered: {', '.join(unknown)}"
        told.append(Objection(kind="not identified", words=words, refuses=False))
    return told


def same(a: float, b: float) -> bool:
    """Whether two numbers are one float32, as a log and a vehicle tell it."""
    try:
        return struct.pack("<f", a) == struct.pack("<f", b) or a == b
    except OverflowError:
        return a == b


def of_battery(then: tuple[float, float] | None, now: float | None) -> list[Objection]:
    """V; what was flown with, and what is there."""
    if then is None:
        return [Objection(kind="battery", words="battery: not known in the fit", refuses=False)]
    low, high = then
    flown = f"{low:.1f} V" if high - low < 0.05 else f"{low:.1f} to {high:.1f} V"
    if now is None:
        return [Objection(kind="battery", words=f"battery: {flown} in the fit; not told now", refuses=False)]
    if low * (1 - VOLTAGE) <= now <= high * (1 + VOLTAGE):
        return []
    return [Objection(kind="battery", words=f"battery: {now:.1f} V, {flown} in the fit: another pack, or an empty one")]


def of_rotor(then: tuple[float, float] | None, now: float | None) -> list[Objection]:
    """Revolutions a minute; on the ground a rotor mostly rests, and only its settings can be compared."""
    if then is None:
        return [Objection(kind="rotor speed", words="rotor speed: not known in the fit", refuses=False)]
    low, high = then
    if now is None or now < TURNING * low:
        words = "rotor speed: the rotor rests, and its speed is seen only in the air"
        return [Objection(kind="rotor speed", words=words, refuses=False)]
    if low * (1 - ROTOR) <= now <= high * (1 + ROTOR):
        return []
    return [Objection(kind="rotor speed", words=f"rotor speed: {now:.0f} rpm, {low:.0f} to {high:.0f} in the fit")]
