"""What of a structure an airframe cannot have, in sentences: it is fitted where it is asked for, and told."""

from __future__ import annotations

from sysid.data.airframe import Airframe
from sysid.model.effect import Effect
from sysid.model.structure import Structure


def not_offered(effect: Effect, airframe: Airframe | None) -> str | None:
    """Why an effect is not asked on this airframe; None where it is."""
    return None if effect.can_be_on(airframe) else f"a {airframe} cannot have it"


def misfits(structure: Structure, airframe: Airframe | None) -> list[str]:
    """What a fit of this structure on this airframe is to be warned of; empty where nothing stands against it."""
    if airframe is None:
        return []
    said = []
    base = structure.base_
    if airframe not in base.airframes:
        better = "multirotor" if airframe is Airframe.MULTIROTOR else "cd"
        part = base.title.lower().replace("-", " ")
        said.append(
            f"a {airframe} has no {part}: what {base.label} tells of it is of something else; fit --model {better}"
        )
    said += [
        f"a {airframe} cannot have {one.id} ({one.title}): what it explains here is something else"
        for one in structure.composed
        if not one.can_be_on(airframe)
    ]
    return said
