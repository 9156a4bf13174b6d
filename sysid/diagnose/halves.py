"""Halves of a chain by themselves, where they were not refitted alone: a score far from the null promises little of a
limit that explains all, and beside it anything makes a chain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from sysid.diagnose.candidates import Ranked, Reference, composed_with, ranked
from sysid.diagnose.progress import Asking, Listener, Stage
from sysid.diagnose.refits import refit_or_reason
from sysid.model.effect import EffectError, named_effect
from sysid.model.structure import Model


def halves_alone(chain: Ranked, candidates: Sequence[Ranked], reference: Reference, say: Listener) -> list[Ranked]:
    """What of the candidates is a half of this chain and had no fit of its own, fitted from its values in the chain."""
    halves = [one for one in candidates if one.fit is None and one.effect in chain.effects]
    return [again for one in halves if (again := _alone(one, chain, reference, say)).fit is not None]


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
