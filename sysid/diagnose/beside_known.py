"""A second effect that one step hardly shows, beside one that was added.

What the added effect has taken up of a second one is no small step from there: a delay beside an inflow, a drift beside
a lag. Where such a score is faint a refit tells, and what was imposed and what is new in every sample have to say the
same: either alone is fooled, the one by bursts, the other by what feeds back.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from sysid.diagnose.candidates import SIGNIFICANT, Ranked, explained_by, of_all_questions
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.foretold import foretells_better_by
from sysid.diagnose.progress import Asking, Listener, Stage
from sysid.diagnose.refits import FEW_POINTS, refitted, worth_the_time
from sysid.diagnose.score import log_chance
from sysid.model.acting import linear_dynamics
from sysid.model.effect import Effect, named_effect

FORETELLS = 45.0
"""Chi squared that it foretells more at least. (Beside right names of 80 strangers that hid one effect, asked anew with
it, the likeliest second of few points foretold 42 more, but for one that explained no more than chance does; of the
missed halves of seven strangers that hid two three foretold 83 to 697.)"""


def chance_beside_known(asked: Sequence[Ranked], parent: Candidate, users: Sequence[Effect], say: Listener) -> float:
    """Chance, a logarithm, that noise alone shows as much as the best refit beside what was added to the base; 0 where
    nothing was, where feedback makes powers or dynamics take simulations, or where no score makes one worth its time.
    """
    structure = parent.model.structure
    if not (parent.division.measured and structure.composed and linear_dynamics(structure)):
        return 0.0
    effects = ((one, one.score, named_effect(one.effect, users)) for one in asked if worth_the_time(one))
    faint = [
        (one, score.tried)
        for one, score, effect in effects
        if score is not None and score.tried <= FEW_POINTS and (effect.linear or effect.samples is not None)
    ]
    for number, (one, tried) in enumerate(faint, 1):
        say(Asking(stage=Stage.REFITS, effects=one.effects, number=number, of=len(faint)))
        log_p = _log_p(one, parent, users) + math.log(tried) + math.log(len(asked))
        chance = of_all_questions(log_p, parent.division)
        if chance < SIGNIFICANT:
            return chance
    return 0.0


def _log_p(one: Ranked, parent: Candidate, users: Sequence[Effect]) -> float:
    """Of its refit, by the parent's noise and by its own; 0 where it does not surely foretell more."""
    fit = refitted(one, parent, users).fit
    if fit is None:
        return 0.0
    explained = min(explained_by(fit, parent, by.metric) for by in (parent, fit))
    if explained <= 0 or foretells_better_by(fit, parent) < FORETELLS:
        return 0.0
    return log_chance(explained, max(1, fit.fitted - parent.fitted))
