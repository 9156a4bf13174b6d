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
from sysid.diagnose.refits import FEW_POINTS, WORTH_THE_TIME, refitted
from sysid.diagnose.score import log_chance
from sysid.model.acting import linear_dynamics
from sysid.model.effect import Effect

FORETELLS = 45.0
"""Chi squared that it foretells more at least. (Beside right names of 80 strangers that hid one effect, asked anew with
it, the likeliest second of few points foretold 42 more, but for one that explained no more than chance does; of the
missed halves of seven strangers that hid two three foretold 83 to 697.)"""


def chance_beside_known(asked: Sequence[Ranked], parent: Candidate, users: Sequence[Effect], say: Listener) -> float:
    """Chance, a logarithm, that noise alone shows as much as the best refit beside what was added to the base; 0 where
    nothing was, where feedback makes powers, or where no score makes one worth its time."""
    if not (parent.division.measured and parent.model.structure.composed):
        return 0.0
    faint = [one for one in asked if one.score is not None and one.score.log_p_there <= WORTH_THE_TIME]
    faint = [one for one in faint if one.score is not None and one.score.tried <= FEW_POINTS]
    for number, one in enumerate(faint, 1):
        say(Asking(stage=Stage.REFITS, effects=one.effects, number=number, of=len(faint)))
        chance = of_all_questions(_chance(one, parent, users) + math.log(len(asked)), parent.division)
        if chance < SIGNIFICANT:
            return chance
    return 0.0


def _chance(one: Ranked, parent: Candidate, users: Sequence[Effect]) -> float:
    """Of its refit, by the parent's noise and by its own; 0 where it does not surely foretell more."""
    fit = refitted(one, parent, users).fit
    if fit is None or not linear_dynamics(fit.model.structure) or one.score is None:
        return 0.0
    explained = min(explained_by(fit, parent, by.metric) for by in (parent, fit))
    if explained <= 0 or foretells_better_by(fit, parent) < FORETELLS:
        return 0.0
    return log_chance(explained, max(1, fit.fitted - parent.fitted)) + math.log(one.score.tried)
