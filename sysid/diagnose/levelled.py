"""Chains that are as good by their halves alone, and ended apart: the worse once more from where the better ended."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from sysid.diagnose.candidates import Ranked, Reference, ranked
from sysid.diagnose.likely import SAME
from sysid.diagnose.refits import begun_at
from sysid.model.parameter import Parameter

INWARDS = 0.01
"""Of the way from a bound to what is typical, that a value begins inside of it: a bound may have no response."""


def levelled(
    best: Ranked, chains: Mapping[tuple[str, ...], Ranked], single: Mapping[str, Ranked], reference: Reference
) -> dict[tuple[str, ...], Ranked]:
    """Of these chains, by their names, those that explain more from where the best one ended.

    Asked again are those that have another half in the place of one of its own and fall further behind it than the
    halves do alone, by more than fits differ that the runs do not tell. (In a loop a lag of the servos beside a drift
    ended 764 of chi squared behind one of the gyros, which alone is the same.)
    """
    found: dict[tuple[str, ...], Ranked] = {}
    for names, chain in chains.items():
        kept = set(chain.effects) & set(best.effects)
        if len(kept) != 1:
            continue
        (other,), (half,) = set(chain.effects) - kept, set(best.effects) - kept
        if other not in single or half not in single:
            continue
        alone = single[half].chi_squared - single[other].chi_squared
        if best.chi_squared - chain.chi_squared > max(0.0, alone) + SAME:
            again = _from_there(chain, best, single[other], reference)
            found |= {} if again is None else {names: again}
    return found


def _from_there(chain: Ranked, best: Ranked, other: Ranked, reference: Reference) -> Ranked | None:
    """The chain begun at the best one's values, with the other half's as they are alone."""
    assert chain.fit is not None
    assert best.fit is not None
    structure = chain.fit.model.structure
    if not structure.linear:
        return None
    known = {**other.values, **best.fit.model.by_name}
    values = {one.name: _inside(one, known.get(one.name, one.typical)) for one in structure.parameters}
    again = begun_at(chain.fit, reference.parent, values)
    return None if again is None else ranked(replace(chain, fit=again), reference)


def _inside(one: Parameter, value: float) -> float:
    low, high = (end + INWARDS * (one.typical - end) if math.isfinite(end) else end for end in one.bounds)
    return min(max(value, low), high)
