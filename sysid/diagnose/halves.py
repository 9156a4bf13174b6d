"""Halves of a chain by themselves, where they were not refitted alone, or ended elsewhere: a score far from the null
promises little of a limit that explains all, and a tilted wake has more than one valley; beside them anything makes a
chain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from sysid.diagnose.candidates import Ranked, Reference, composed_with, ranked
from sysid.diagnose.progress import Asking, Listener, Stage
from sysid.diagnose.refits import refit_or_reason
from sysid.model.effect import EffectError, named_effect
from sysid.model.structure import Model

MAY_BE_NOTHING = 3.0
"""Standard errors that every size of a half is from nothing at most, for the other half to be fitted alone from its
values in the chain: a tilted wake explained 0.999 beside a hub that was 2.5 of them, and 0.59 alone, in another
valley."""


def halves_alone(chain: Ranked, candidates: Sequence[Ranked], reference: Reference, say: Listener) -> list[Ranked]:
    """What of the candidates is a half of this chain, fitted from its values there: where it had no fit of its own, or
    the other half may be nothing and it is likelier so."""
    halves = [one for one in candidates if one.effect in chain.effects]
    asked = [one for one in halves if one.fit is None or _rest_may_be_nothing(chain, one.effect)]
    again = [(_alone(one, chain, reference, say), one) for one in asked]
    return [one for one, before in again if one.fit is not None and one.chi_squared > before.chi_squared]


def _rest_may_be_nothing(chain: Ranked, half: str) -> bool:
    """Whether no size of the chain's other half is surely more than its null."""
    values, errors = chain.values, chain.standard_errors
    rest = [own for effect in chain.effects if effect != half for own in chain.own_of(effect)]
    sizes = [one for own in rest for one in own.parameters if one.sizes and math.isfinite(one.null or 0.0)]
    if not sizes or any(one.name not in errors for one in sizes):
        return False
    return max(abs(values[one.name] - (one.null or 0.0)) / errors[one.name] for one in sizes) < MAY_BE_NOTHING


def half(chain: Ranked, effect: str, reference: Reference) -> Model | None:
    """One half of a chain as it stands there, the other left out; None where it cannot stand alone."""
    assert chain.fit is not None
    parent, both = reference.parent, chain.fit.model.by_name
    try:
        alone = composed_with(parent.model.structure, named_effect(effect, reference.users), parent.dataset)
    except EffectError:
        return None
    if not set(alone.names) <= set(both):
        return None
    return Model(alone, alone.vector({name: both[name] for name in alone.names}))


def _alone(one: Ranked, chain: Ranked, reference: Reference, say: Listener) -> Ranked:
    say(Asking(stage=Stage.ALONE, effects=one.effects))
    begin = half(chain, one.effect, reference)
    if begin is None:
        return one
    fit, _ = refit_or_reason(begin.structure, reference.parent, one.effects, begin)
    return ranked(replace(one, fit=fit), reference)
