"""What physics allows is within reach of a candidate where its nearest values make the runs hardly less likely.

Standard errors tell that of numbers that the runs know well. Of a filter far above the band its lateness alone is
known: corner and damping ratio may be anything together, the estimate lies where noise has it, and errors there are
those of a slope. So what comes near to the best is fitted once more, with what lies outside held where it is allowed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnose.by_noise import by_the_noise
from sysid.diagnose.candidates import Ranked, Reference, ranked
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.likely import SAME
from sysid.diagnose.refits import moved_on, refit_or_reason
from sysid.model.parameter import SURELY
from sysid.model.structure import Model

NEARLY_AS_MUCH = 0.87
"""Of the chi squared of a fit whose values physics does not allow, that one in a valley of its own explains which it
allows: of strangers that judgements had spent two drifts of the hover had 0.88 and 0.92, and of 17 flights that hid
what the catalogue does not have, and were likest to a drift, none more than 0.85."""


def in_reach(candidates: Sequence[Ranked], reference: Reference) -> list[Ranked]:
    """The candidates; of those that may be the answer and have values outside what physics allows, each where that is
    hardly less likely by values that it allows, or in a valley of these; or else, beside one that has none outside,
    with its own as implausible.
    """
    able = [one for one in candidates if one.fit is not None and one.delta_bic < 0]
    most = max((one.chi_squared for one in candidates if one.fit is not None), default=0.0)
    near = [one for one in able if one.chi_squared > most - SAME]
    likeliest = min(near, key=lambda one: one.delta_bic, default=None)
    fair = any(not one.outside for one in near)

    def allowed(one: Ranked) -> Ranked:
        if one in near and (one.implausible or (fair and one is not likeliest)):
            return _judged(one, reference)
        farther = one in able and one.implausible and one.chi_squared > NEARLY_AS_MUCH * most
        return (_in_its_valley(one, reference) or one) if farther else one

    return [allowed(one) for one in candidates]


def _judged(one: Ranked, reference: Reference) -> Ranked:
    assert one.fit is not None
    nearest = _outside(one)
    if not nearest or not one.fit.model.structure.linear:
        return one
    told = False
    for values in (nearest, _typical(one, nearest)):  # what is allowed may have a valley of its own
        held = _held(one.fit, values, reference.parent)
        again = one if held is None else ranked(replace(one, fit=held), reference)
        if again is one or again.fit is None:
            continue
        if not again.implausible and again.chi_squared > one.chi_squared - SURELY**2:
            return replace(again, added=one.added) if one.implausible else one
        told = True
    there = _in_its_valley(one, reference) if one.implausible else None
    if there is not None:
        return there
    return replace(one, implausible=tuple(dict.fromkeys((*one.implausible, *nearest)))) if told else one


def _in_its_valley(one: Ranked, reference: Reference) -> Ranked | None:
    """By the noise from what is typical, nothing held, where it ends at values that physics allows and explains nearly
    as much: least squares may have taken slow gusts for answers, and a drag that pushes is a valley of its own."""
    assert one.fit is not None
    outside, model = _outside(one), one.fit.model
    if not outside or not model.structure.linear or not one.fit.division.measured:
        return None
    near = Model(model.structure, model.structure.vector({**model.by_name, **_typical(one, outside)}))
    free = by_the_noise(one.fit, near, reference.parent.metric)
    if free is None:
        return None
    there = ranked(replace(one, fit=free), reference)
    return None if there.implausible or there.chi_squared < NEARLY_AS_MUCH * one.chi_squared else there


def _typical(one: Ranked, names: Collection[str]) -> dict[str, float]:
    return {each.name: each.typical for effect in one.own for each in effect.parameters if each.name in names}


def _outside(one: Ranked) -> dict[str, float]:
    """Parameters of its own that say of which kind it is and lie outside what physics allows -> the nearest that it
    allows; none where a size does so: that is known by its standard error."""
    assert one.fit is not None
    model = one.fit.model
    own = [each for effect in one.own for each in effect.parameters if each.name in one.outside]
    found = [each for each in own if each.implausible(model[each.name])]
    if any(each.sizes for each in found):
        return {}
    return {each.name: float(np.clip(model[each.name], *each.plausible)) for each in found}


def _held(one: Candidate, values: dict[str, float], parent: Candidate) -> Candidate | None:
    """Fitted with these held; None where the runs do not determine the rest."""
    structure = one.model.structure
    begin = Model(structure, structure.vector(one.model.by_name | values))
    held = refit_or_reason(structure, parent, one.added, begin, values)[0]
    return None if held is None else moved_on(held, parent)
