"""Play and dead bands that one step hardly shows. Where a servo rests hangs on every gust before, and what the imposed
commands alone make of that foretells little of it: where such a score is faint, a refit tells."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sysid.diagnose.candidates import Ranked, explained_by, of_all_questions
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.progress import Asking, Listener, Stage
from sysid.diagnose.refits import refitted, worth_the_time
from sysid.diagnose.score import log_chance
from sysid.diagnose.thinned import noise_folded
from sysid.model.effect import Effect, named_effect

SIZES = 100
"""How many a refit looks at, about, by all power and by the noise."""
LEAST = 0.02
"""Of the power that was left, that it explains at least: what is there is followed sample by sample. (Of 166 clean
strangers the likeliest refit explained 0.008, and chi squared of 18; of one more, whose log lost samples, 0.012 and 46.
Of 18 that hid play or a dead band, and showed it so, the likeliest explained 0.021 and more, but for one too small to
be detected.)"""


def chance_of_rest(asked: Sequence[Ranked], parent: Candidate, users: Sequence[Effect], say: Listener) -> float:
    """Chance, a logarithm, that noise alone shows as much as the best refit of what a servo rests within; 0 where no
    score makes one worth its time, or feedback makes powers."""
    if not parent.division.measured or noise_folded(parent.dataset):
        return 0.0
    faint = [one for one in asked if worth_the_time(one) and named_effect(one.effect, users).rests_within is not None]
    found = 0.0
    for number, one in enumerate(faint, 1):
        say(Asking(stage=Stage.REFITS, effects=one.effects, number=number, of=len(faint)))
        found = min(found, _chance(one, parent, users))
    return of_all_questions(found, parent.division)


def _chance(one: Ranked, parent: Candidate, users: Sequence[Effect]) -> float:
    fit = refitted(one, parent, users).fit
    if fit is None or fit.error_share > (1 - LEAST) * parent.error_share:
        return 0.0
    explained = explained_by(fit, parent, fit.metric)
    return 0.0 if explained <= 0 else log_chance(explained, 1) + math.log(SIZES)
