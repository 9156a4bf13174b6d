"""Play, dead bands and limits, beside an effect that is named or where nothing is, where an excitation is logged.

Where a servo rests, or meets a limit, hangs on every gust before. What was imposed tells little of that: a name fits it
alone, with other values, and leaves nothing, or nothing fits. All commands as they were flown foretell it surely. So
what acts on samples is asked there as it is where no excitation is logged, from the values that the excitation told.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnose.candidates import Ranked, Reference, explained_by, rank, ranked, score_effects
from sysid.diagnose.choice import SURELY_FORETELLS
from sysid.diagnose.evidence import Candidate, candidate
from sysid.diagnose.foretold import less_left
from sysid.diagnose.progress import Asking, Listener, Stage, unheard
from sysid.diagnose.refits import begun_at, refitted
from sysid.fit.output_error import output_error
from sysid.model.effect import named_effect
from sysid.model.relaxation import RelaxationError

PROMISES = 40.0
"""Chi squared that it scores at least to be fitted: beside 53 right names of strangers it was more in two, which
foretold 29 more at most; of three halves of two that are named so the least was 49."""
RIVALS = 4
"""How many linear entries are fitted that promise the next share of what it foretells; none may do so much:"""
RIVAL = 0.7
"""beside a drift, a lag showed as a limit of acceleration, 1.02 times as much as a filter."""


def on_samples_beside(named: Ranked, reference: Reference, say: Listener) -> list[Ranked]:
    """The named effect with what acts on samples that surely foretells more beside it, each such chain; nothing where
    something linear does nearly as much, or where the validation runs do not say so."""
    assert named.fit is not None
    return _surely_foretold(named.fit, named.effects, reference, say)


def on_samples_alone(reference: Reference, say: Listener) -> list[Ranked]:
    """What acts on samples and so foretells more than the structure itself, where by what was imposed nothing explains
    the runs; nothing where something linear does nearly as much, or where the validation runs do not say so."""
    return _surely_foretold(reference.parent, (), reference, say)


def _surely_foretold(fit: Candidate, effects: tuple[str, ...], reference: Reference, say: Listener) -> list[Ranked]:
    """Beside these effects, as they were fitted."""
    if not fit.division.measured or not fit.model.structure.linear:
        return []
    say(Asking(stage=Stage.SECONDS, effects=effects))
    try:
        with np.errstate(all="ignore"):
            return _Foretelling(fit, effects, reference).found()
    except (RelaxationError, np.linalg.LinAlgError):
        return []


class _Foretelling:
    """The runs of named effects, or of none, as if no excitation were logged."""

    def __init__(self, fit: Candidate, effects: tuple[str, ...], reference: Reference) -> None:
        self.fit, self.effects, self.reference = fit, effects, reference
        self.begun = candidate(fit.estimate, fit.held, fit.dataset.unexcited, fit.added)

    def found(self) -> list[Ranked]:
        fitted = self.fitted(self.asked(True), PROMISES)
        best = max((more for _, more in fitted), default=0.0)
        if best < SURELY_FORETELLS:
            return []
        linear = self.fitted(self.asked(False)[:RIVALS], RIVAL * best)
        if any(more > RIVAL * best for _, more in linear):
            return []
        turned = list(self.turned(fitted))
        resting = any(self.rests(one) and more >= SURELY_FORETELLS for one, more in turned)
        # play with a dead band that foretells less, or the other way round: the log may have lost what tells them apart
        told = [self.told(*each) for each in turned if each[1] >= SURELY_FORETELLS or (resting and self.rests(each[0]))]
        return [one for one in told if one is not None]

    def asked(self, samples: bool) -> list[Ranked]:
        """What acts on samples, or all else, the most promising first."""
        begun, metric = self.begun, self.begun.metric
        asked = score_effects(
            begun.asked_in(metric),
            begun.stepped,
            metric,
            self.reference.users,
            unheard,
            lambda one: (one.samples is not None) == samples,
        )
        return sorted((one for one in asked if one.score is not None), key=rank)

    def fitted(self, asked: Sequence[Ranked], least: float) -> list[tuple[Ranked, float]]:
        """Of these what promises the least or more, fitted, and by how much each foretells more than the name alone."""
        promising = [one for one in asked if one.score is not None and one.score.chi_squared >= least]
        if any(self.rests(one) for one in promising):  # only fits tell play from a dead band
            promising += [one for one in asked if self.rests(one) and one not in promising]
        again = [refitted(one, self.begun, self.reference.users) for one in promising]
        return [(one, self.more(one.fit)) for one in again if one.fit is not None]

    def rests(self, one: Ranked) -> bool:
        return named_effect(one.effect, self.reference.users).rests_within is not None

    def more(self, fit: Candidate) -> float:
        return explained_by(fit, self.begun, self.begun.metric)

    def turned(self, fitted: Sequence[tuple[Ranked, float]]) -> Iterator[tuple[Ranked, float]]:
        """Each at its best: where another ended better, begun once more at its values of what both have."""
        best, _ = max(fitted, key=lambda each: each[1])
        assert best.fit is not None
        there = best.fit.told[0].by_name
        for one, more in fitted:
            assert one.fit is not None
            here = one.fit.told[0].by_name
            begin = {name: there.get(name, value) for name, value in here.items()}
            again = None if one is best else begun_at(one.fit, self.begun, begin)
            yield (one, more) if again is None else (replace(one, fit=again), self.more(again))

    def told(self, beside: Ranked, more: float) -> Ranked | None:
        """It with the effects that were named, as it foretells best, held against the runs with their excitation."""
        assert beside.fit is not None
        there, on, effects = beside.fit.asked_in(beside.fit.metric), self.fit.dataset, (*self.effects, beside.effect)
        if not self.holds(there):
            return None
        estimate = replace(beside.fit.estimate, model=there.model, error=output_error(there.model, on.stacks))
        fit = candidate(estimate, beside.fit.held, on, tuple(sorted(effects)))
        both = ranked(replace(beside, effects=effects, fit=fit, foretells=more), self.reference)
        return None if both.fit is None else both

    def holds(self, there: Candidate) -> bool:
        """Whether it foretells the validation runs better, too, where there are any."""
        judging = self.reference.validation
        if judging is None:
            return True
        alone = self.begun.asked_in(self.begun.metric)
        return less_left(there.model, alone.model, there, judging.unexcited) > 0
