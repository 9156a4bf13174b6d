"""Halves of a chain by themselves, where they were not refitted alone: a score far from the null promises little of a
limit that explains all, and beside it anything makes a chain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnose.candidates import Ranked, Reference, composed_with, ranked
from sysid.diagnose.evidence import refit
from sysid.diagnose.progress import Asking, Listener, Stage
from sysid.errors import FitError
from sysid.model.effect import EffectError, named_effect
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model


def halves_alone(chain: Ranked, candidates: Sequence[Ranked], reference: Reference, say: Listener) -> list[Ranked]:
    """The candidates; what is a half of this chain and has no fit of its own gets one, from its values in the chain."""
    return [
        _alone(one, chain, reference, say) if one.fit is None and one.effect in chain.effects else one
        for one in candidates
    ]


def _alone(one: Ranked, chain: Ranked, reference: Reference, say: Listener) -> Ranked:
    assert chain.fit is not None
    parent, both = reference.parent, chain.fit.model.by_name
    say(Asking(stage=Stage.ALONE, effects=one.effects))
    try:
        composed = composed_with(parent.model.structure, named_effect(one.effect, reference.users), parent.dataset)
        if not set(composed.names) <= set(both):
            return one
        begin = Model(composed, composed.vector({name: both[name] for name in composed.names}))
        fit = refit(composed, parent, one.effects, begin)
    except (FitError, EffectError, RelaxationError, np.linalg.LinAlgError):
        return one
    return ranked(replace(one, fit=fit), reference)
