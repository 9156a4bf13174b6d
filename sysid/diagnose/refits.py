"""Refits of the effects that may be the answer: which, in what order, and from where."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.data.record import FloatArray
from sysid.diagnose.by_noise import MOST_MOVES_BY_NOISE, by_its_own_noise, by_the_noise, misled, predicting
from sysid.diagnose.candidates import (
    CRUMBS,
    REMAINDER,
    Ranked,
    composed_with,
    explained_by,
    heard,
    values_outside,
)
from sysid.diagnose.evidence import Candidate, White, refit
from sysid.diagnose.likely import SAME, misfit
from sysid.diagnose.progress import Asking, Listener, Stage
from sysid.diagnose.score import Score
from sysid.errors import FitError
from sysid.model.acting import idle, linear_dynamics
from sysid.model.effect import Effect, EffectError, catalogue, named_effect
from sysid.model.parameter import Parameter
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model, Structure

KEPT, KEPT_ON_SAMPLES = 0.5, 0.7
"""Of the chi squared that a score promises, or that another size of what jumps has, what a refit explains at least that
was in the right valley; a limit far below the gusts had half of it, in a valley of these. (Dead bands that were 1.1 and
1.4 times too narrow or wide had 0.60 and 0.35 of what a size near by had, four that were in place 0.73 and more.)"""
NEARLY_KEPT = 0.9
"""Of the same, what a linear entry explains at least that has nowhere to go on to: a lag of 29 ms that ended at 1 ms in
rough air had 0.88."""
FAR = 0.5
"""Of a value: a limit of 24 1/s was left at 90, where it explains little, and its slope promised much further down."""
SERIOUS, SERIOUS_SLOW = 0.1, 0.3
"""Share of the best score from which on a linear entry is refitted, and one that takes simulations or a long search: of
800 right names of single effects on strangers that judgements had spent none scored less than 0.38 of the best, and
halves of chains are asked beside the first. (On a real quadrotor, far from none, one step promised a lag 0.2 of what a
filter did, and at a negative value.)"""
WORTH_THE_TIME = math.log(0.01)
"""Chance that noise alone shows as much at an entry's best point, above which it is neither simulated nor refitted
twice. All points counted in, a mode that explained chi squared of 130 was above it."""
APART = 1.0
"""Chi squared by which fits of the same equations differ that did not end at the same."""
FEW_POINTS = 40
LOOK, LOOKS, ROUNDS, FINEST_LOOK = 1.07, 8, 3, 1.005
"""Ratio of sizes, and how many of them to either side of a fit, at which what jumps is looked at by the noise, and how
often; and where halving that ratio ends. A dead band of 0.0094 that was left at 0.0066 explained 24 there, and 90 where
it was."""
PRICES = {"linear": 2.0, "samples": 12.0, "in time": 25.0}
"""Base fits that a refit takes, by what has to be simulated."""
NEAR = 0.7
"""Of what the best linear entry explains, that the score of another must reach to be refitted all the same; and of the
best entry, that a limit of acceleration explains, for one of rates to be refitted, or the other way round."""
LIMITS = ({"servo_acceleration_limit"}, {"servo_rate_limit"})


def refit_serious(
    asked: Sequence[Ranked], parent: Candidate, users: Sequence[Effect], say: Listener, elsewhere: float = 0.0
) -> list[Ranked]:
    """Refits of what may be the answer, the most promising first: linear entries, which take milliseconds, then others.
    `elsewhere` is chi squared that something outside the catalogue explains.

    An entry that takes simulations is refitted where the linear ones leave more than noise, or where its score alone
    comes near to what the best of them explains; none where its score is far below the best.
    """
    order = _Order(asked, parent, users, say, elsewhere)
    for one in filter(_quick, order.testable):
        if order.serious(one):
            order.fit(one)
    linear_enough, best = not order.question_open, order.best
    explained = 0.0 if best is parent else explained_by(best, parent, best.metric)
    for one, score in order.slow:
        if order.serious(one) and (score.chi_squared > NEAR * explained or not linear_enough):
            order.fit(one)
    order.fit_on_samples()
    order.level()
    return [order.found.get(one.effects, one) for one in asked]


class _Order:
    """Which are refitted, the best of them so far, and how far that is."""

    def __init__(
        self, asked: Sequence[Ranked], parent: Candidate, users: Sequence[Effect], say: Listener, elsewhere: float
    ) -> None:
        scored = max((one.score.chi_squared for one in asked if one.score is not None), default=0.0)
        self.top = max(scored, elsewhere)
        self.parent, self.users, self.say = parent, users, say
        self.found: dict[tuple[str, ...], Ranked] = {}
        self.best, self.question_open, self.spent = parent, True, 0.0
        able = (one for one in asked if one.not_testable is None)
        self.testable = sorted(able, key=lambda one: -_share(one, self.top))
        self.slow = list(_worth_simulating(self.testable))

    def serious(self, one: Ranked) -> bool:
        return _share(one, self.top) >= (SERIOUS if _quick(one) else SERIOUS_SLOW)

    def fit(self, one: Ranked) -> None:
        """Refit it, and keep it where it is the best."""
        self.say(self._asking(one))
        self.found[one.effects] = again = refitted(one, self.parent, self.users)
        self.spent += _price(one)
        if again.fit is not None and again.fit.error_share < self.best.error_share:
            self.best, self.question_open = again.fit, _leaves_more(again.fit, self.parent)
        self.say(heard(again, self.parent, _avoidable(self.best, self.parent)))

    def fit_on_samples(self) -> None:
        """Where the best acts on samples, all else that does: their scores go by a few sizes only, and a dead band of
        0.044 with a score of 93 at 0.05 explained 327, where a play had a score of 160 and explained 234."""
        asked = [one for one, _ in self.slow if acts_on_samples(one)]
        waiting = [one for one in asked if one.effects not in self.found]
        if not 0 < len(waiting) < len(asked):
            return
        best = max(self.found.values(), key=self._explained)
        if not acts_on_samples(best):
            waiting = [one for one in waiting if self._beside_a_limit(one, NEAR * self._explained(best))]
        for one in waiting:
            self.fit(one)

    def _beside_a_limit(self, one: Ranked, least: float) -> bool:
        """Whether it is a limit of rates or of acceleration, and the other explains so much: by few sizes a limit of
        5.3 1/s scored 61, where one of acceleration explained 868, and it 1221."""
        if {*one.effects} not in LIMITS:
            return False
        others = (other for other in self.found.values() if {*other.effects} in LIMITS)
        return max(map(self._explained, others), default=0.0) >= least

    def _explained(self, one: Ranked) -> float:
        return 0.0 if one.fit is None else explained_by(one.fit, self.parent, self.parent.metric)

    def level(self) -> None:
        """What another contains, and is surely told from, once more from where that one ended: late motors had been
        likelier as a lag of each axis by chi squared of 266, at two lags that were the same. Then of entries of the
        same equations the worse from where the better one is: a motor lag was outdone by a lag of the gyros that none
        may have."""
        known = catalogue()
        fitted = [one.effect for one in self.found.values() if one.effect in known and one.fit is not None]
        for effect in fitted:
            for name in filter(fitted.__contains__, known[effect].contains):
                self._level_inside(self.found[(effect,)], self.found[(name,)])
        for effect in fitted:
            for name in known[effect].same_as:
                one, other = self.found[(effect,)], self.found.get((name,))
                if effect < name and other is not None and one.fit is not None and other.fit is not None:
                    self._level((one, one.fit), (other, other.fit))

    def _level_inside(self, larger: Ranked, one: Ranked) -> None:
        """Begin an entry of one number at the mean of those that the one has which contains it; in a loop in the noise
        that this leaves, and where it foretells best there, for by the parent's, which is late itself, another valley
        was as good."""
        assert larger.fit is not None
        assert one.fit is not None
        parent, in_a_loop = self.parent, one.fit.dataset.in_a_loop
        mine, his = ([name for effect in each.own for name in effect.names] for each in (one, larger))
        beside = larger.fit if in_a_loop else parent
        there = larger.fit.asked_in(beside.metric).model if in_a_loop else larger.fit.model
        behind = explained_by(larger.fit, parent, beside.metric) - explained_by(one.fit, parent, beside.metric)
        if behind <= max(SAME, misfit(larger)) or len(mine) != 1:
            return
        again = begun_at(one.fit, beside, {**there.by_name, mine[0]: float(np.mean([there[name] for name in his]))})
        if again is not None:
            self.found[one.effects] = replace(one, fit=again)

    def _level(self, *both: tuple[Ranked, Candidate]) -> None:
        """Put the worse of two at the values of the better, where it explains more there."""
        parent = self.parent
        told = [(explained_by(fit, parent, parent.metric), one, fit) for one, fit in both]
        (explained, one, fit), (more, other, better) = sorted(told, key=lambda each: each[0])
        mine, his = ([name for effect in each.own for name in effect.names] for each in (one, other))
        if more <= explained + APART or len(mine) != len(his):  # one has numbers that the log tells
            return
        there = better.model.by_name
        here = {**there, **{name: there[same] for name, same in zip(mine, his, strict=True)}}
        again = begun_at(fit, parent, here, moves=0)
        if again is not None:
            self.found[one.effects] = replace(one, fit=again)

    def _asking(self, one: Ranked) -> Asking:
        waiting = [
            *(other for other in filter(_quick, self.testable) if self.serious(other)),
            *(other for other, _ in self.slow if self.serious(other)),
        ]
        waiting = [one, *(other for other in waiting if other.effects not in {*self.found, one.effects})]
        behind, done = len(self.found), self.spent / (self.spent + sum(map(_price, waiting)))
        return Asking(
            stage=Stage.REFITS, effects=one.effects, number=behind + 1, of=behind + len(waiting), done=done
        )  # fmt: skip


def _price(one: Ranked) -> float:
    return PRICES["linear" if _quick(one) else "samples" if acts_on_samples(one) else "in time"]


def _avoidable(best: Candidate, parent: Candidate) -> float:
    """Error share of the parent that is no noise, as far as the best so far tells."""
    left = float(np.sum((1 - best.division.noise_share) * best.estimate.error.shares))
    return parent.error_share - best.error_share + left


def _worth_simulating(asked: Sequence[Ranked]) -> Iterator[tuple[Ranked, Score]]:
    for one in asked:
        if one.score is not None and not _quick(one) and worth_the_time(one):
            yield one, one.score


def worth_the_time(one: Ranked) -> bool:
    """Whether noise alone seldom shows as much as its score at its best point."""
    return one.score is not None and one.score.log_p_there <= WORTH_THE_TIME


def _share(one: Ranked, top: float) -> float:
    """Of the best score; of what has none, because it goes by another base, more than all."""
    return math.inf if one.score is None else one.score.chi_squared / max(top, 1e-300)


def _leaves_more(best: Candidate, parent: Candidate) -> bool:
    """Whether the best of the quick ones leaves more than noise, and more than crumbs."""
    left, whole = best.division, best.estimate.error.shares
    if float(np.max(100 * (1 - np.sqrt(left.noise_share)) * np.sqrt(whole))) < CRUMBS:
        return False
    explained = parent.error_share - best.error_share
    return explained <= 0 or float(np.sum((1 - left.noise_share) * whole)) > REMAINDER * explained


def _quick(one: Ranked) -> bool:
    """Whether a refit takes milliseconds: a linear entry without many valleys to search."""
    known = catalogue()
    return one.effect in known and known[one.effect].linear and (one.score is None or one.score.tried <= FEW_POINTS)


def acts_on_samples(one: Ranked) -> bool:
    """Whether it is an entry of the catalogue that acts on samples of the commands."""
    known = catalogue()
    return one.effect in known and known[one.effect].samples is not None


def refitted(one: Ranked, parent: Candidate, users: Sequence[Effect], near: Model | None = None) -> Ranked:
    """The refit; where it explains far less than the score promised, or fails, a better one from where the score was.
    It begins `near` where that is given.

    Valleys are told apart by what is left of all power; what is small beside gusts shows in the noise's measure alone.
    A linear entry beside one that takes simulations in time begins where the score was, and nowhere else: to look at
    every beginning would cost more than all else, and minutes where the response does not settle. No refit where the
    score is beyond what it may be, or where it ended as nothing.
    """
    try:
        composed = composed_with(parent.model.structure, named_effect(one.effect, users), parent.dataset)
    except (FitError, EffectError) as error:
        return replace(one, fit=None, not_testable=str(error))
    by_score = near is None and goes_by_its_score(one, composed, users)
    begin = as_scored(one, composed, parent) if by_score or linear_dynamics(composed) else None
    if by_score and begin is None:
        return replace(one, fit=None)
    near = begin if by_score else near
    fit, failure = refit_or_reason(composed, parent, one.effects, near)
    shows = one.score is not None and one.score.log_p_there < WORTH_THE_TIME
    astray = False
    if begin is not None and shows:
        fit, astray = _as_promised(fit, composed, parent, one, begin)
    if fit is None:
        return replace(one, fit=None, not_testable=failure)
    if shows and one.score is not None and _doubtful(fit, parent, one.score):
        fit = _likelier(predicting(fit, parent), fit, parent)
    if begin is not None and not composed.linear:  # in a loop, what acts on samples: powers lead to another size
        fit = _likelier(predicting(fit, parent, begin), fit, parent)
    fit = moved_on(fit, parent, astray)
    if shows:
        fit = _sized(fit, parent) if begin is None else _gone_on(_sized(fit, parent), parent, one, begin)
    return replace(one, fit=None if does_nothing(fit, one.effects) else fit, not_testable=None)


def does_nothing(fit: Candidate, effects: Sequence[str]) -> bool:
    """Whether one of these effects moves no command where the fit ended: what the fit explains more, others do."""
    segments = [one.segment for one in fit.dataset.spectra]
    return idle(fit.model.structure, fit.model.values, segments, effects)


def moved_on(fit: Candidate, parent: Candidate, astray: bool = False) -> Candidate:
    """The fit in the noise's own measure, where least squares misled it and it explains more there; from what it leaves
    itself where it is known to be `astray`."""
    if not (astray or misled(fit, parent.metric)):
        return fit
    return _likelier(by_its_own_noise(fit, fit.metric if astray else parent.metric), fit, parent)


def _likelier(again: Candidate, fit: Candidate, parent: Candidate) -> Candidate:
    """The one of two fits that explains more in the parent's metric."""
    if again is fit:
        return fit
    more = explained_by(again, parent, parent.metric) > explained_by(fit, parent, parent.metric)
    return again if more else fit


def _as_promised(
    fit: Candidate | None, composed: Structure, parent: Candidate, one: Ranked, begin: Model
) -> tuple[Candidate | None, bool]:
    """The refit, or a better one from where the score was where it explains far less than that promised; and whether
    that was found by the noise alone."""
    assert one.score is not None
    kept, metric = KEPT if composed.linear else KEPT_ON_SAMPLES, parent.metric
    promised = kept * one.score.chi_squared
    explained = 0.0 if fit is None or _astray(fit, parent) else explained_by(fit, parent, metric)
    # what acts on samples ends in the same valley again; of several modes power may show one alone
    short = explained < promised or one.score.tried > FEW_POINTS
    again = refit_or_reason(composed, parent, one.effects, begin)[0] if short and composed.linear else None
    if again is not None and (more := explained_by(again, parent, metric)) > explained:
        fit, explained = again, more
    if fit is None or not parent.division.measured or (explained >= promised and not _has_far_to_go(fit, parent)):
        return fit, False
    again = by_the_noise(fit, begin, metric)
    if again is None or explained_by(again, parent, metric) <= max(0.0, explained):
        return fit, False
    return again, True


def _gone_on(fit: Candidate, parent: Candidate, one: Ranked, begin: Model) -> Candidate:
    """The fit of a linear entry; where it explains clearly less than the score promised a better one, if there is one,
    by the noise from where that was."""
    assert one.score is not None
    promised = NEARLY_KEPT * one.score.chi_squared
    if not (fit.model.structure.linear and parent.division.measured):
        return fit
    if explained_by(fit, parent, parent.metric) >= promised:
        return fit
    return begun_at(fit, parent, begin.by_name) or fit


def _sized(fit: Candidate, parent: Candidate) -> Candidate:
    """The fit of what jumps; where it explains far less than at a size around its own that physics allows, begun once
    more from there, if it explains more then: its valleys are a few percent wide, and of these least squares took the
    deepest by all power, gusts too. (One of many always fits best, by a little.)"""
    size = _jumping(fit, parent)
    if size is None or not linear_dynamics(fit.model.structure):
        return fit
    begun = fit
    for _ in range(ROUNDS):
        more, there = _best_look(begun, parent, size, LOOK ** np.arange(-LOOKS, LOOKS + 1.0))
        if more <= 0 or explained_by(begun, parent, parent.metric) > KEPT_ON_SAMPLES * more:
            break
        again = _fitted_at(begun, parent, there)
        if again is begun:
            break
        begun = again
    ratio = LOOK if begun is not fit else 1.0
    while ratio > FINEST_LOOK:
        ratio = ratio**0.5
        begun = _fitted_at(begun, parent, _best_look(begun, parent, size, np.array([1 / ratio, ratio]))[1])
    return begun


def _fitted_at(fit: Candidate, parent: Candidate, values: Mapping[str, float]) -> Candidate:
    """The fit, or a better one with the size that it has at these values, the rest fitted: in a loop by all power, as
    those are that it is held against."""
    if not fit.dataset.in_a_loop:
        return begun_at(fit, parent, values) or fit
    structure = fit.model.structure
    near = Model(structure, structure.vector({name: values[name] for name in structure.names}))
    again, _ = refit_or_reason(structure, parent, fit.added, near)
    return fit if again is None else _likelier(again, fit, parent)


def _jumping(fit: Candidate, parent: Candidate) -> Parameter | None:
    """The size of one more effect that acts on samples, without a slope to follow."""
    before = parent.model.structure.names
    acting = (effect for effect in fit.model.structure.composed if effect.samples is not None)
    own = [one for effect in acting for one in effect.parameters if one.name not in before]
    return own[0] if len(own) == 1 and own[0].name not in fit.free else None


def _best_look(
    fit: Candidate, parent: Candidate, size: Parameter, times: FloatArray
) -> tuple[float, Mapping[str, float]]:
    """What the fit explains most by the noise at so many times its size, one step of the rest taken; and where."""
    names, best = fit.model.structure.names, (-math.inf, fit.model.by_name)
    for value in fit.model[size.name] * times:
        values = fit.model.values.copy()
        values[names.index(size.name)] = value
        there = None if size.implausible(float(value)) else fit.at(values)
        explained = -math.inf if there is None else explained_by(there, parent, parent.metric)
        if there is not None and explained > best[0]:
            best = explained, there.model.by_name
    return best


def _has_far_to_go(fit: Candidate, parent: Candidate) -> bool:
    """Whether what is not linear would yet move by more than FAR in the parent's metric: what it explains is then what
    a slope promises, far from where it was taken."""
    own = [name for name in fit.free if name not in parent.free]
    if fit.model.structure.linear or not linear_dynamics(fit.model.structure) or not own:
        return False
    move = dict(zip(fit.free, White.of(fit, parent.metric).move(fit).tolist(), strict=True))
    return any(abs(move[name]) > FAR * abs(fit.model[name]) for name in own)


def _doubtful(fit: Candidate, parent: Candidate, score: Score) -> bool:
    """Whether feedback may have led least squares elsewhere: to values that it should not have, or to where it explains
    far less than the score promised."""
    if not fit.dataset.in_a_loop:
        return False
    return (
        bool(values_outside(fit) - values_outside(parent))
        or explained_by(fit, parent, parent.metric) < KEPT * score.chi_squared
    )


def _astray(fit: Candidate, parent: Candidate) -> bool:
    """Whether a refit ended where it leaves more than the parent, whatever a step from there promises; where feedback
    makes no powers."""
    return parent.division.measured and fit.error_share > parent.error_share


def refit_or_reason(
    composed: Structure,
    parent: Candidate,
    added: Sequence[str],
    near: Model | None,
    held: Mapping[str, float] | None = None,
) -> tuple[Candidate | None, str]:
    """The refit, as `evidence.refit` makes it, or why there is none."""
    try:
        return refit(composed, parent, added, near, held), ""
    except (FitError, EffectError, RelaxationError, np.linalg.LinAlgError) as error:
        return None, str(error)


def begun_at(
    fit: Candidate, parent: Candidate, values: Mapping[str, float], moves: int = MOST_MOVES_BY_NOISE
) -> Candidate | None:
    """The fit begun once more at these values; None where it explains no more from there in the parent's metric."""
    near = _inside(fit.model.structure, values)
    if near is None:
        return None
    in_a_loop = fit.dataset.in_a_loop
    again = predicting(fit, parent, near) if in_a_loop else by_the_noise(fit, near, parent.metric, moves)
    better = fit if again is None else _likelier(again, fit, parent)
    return None if better is fit else better


def goes_by_its_score(one: Ranked, composed: Structure, users: Sequence[Effect]) -> bool:
    """Whether it is a linear entry, or one that acts on samples and was scored at every size, beside what takes
    simulations in time; what else is not linear has other sizes than one step promises."""
    effect = named_effect(one.effect, users)
    return one.score is not None and not linear_dynamics(composed) and (effect.linear or effect.samples is not None)


def as_scored(one: Ranked, composed: Structure, parent: Candidate) -> Model | None:
    """The parent with the entry as it was scored; None where a size is beyond what it may be, or the residual shows the
    opposite: that says that there is none."""
    if one.score is None or one.score.times < 0:
        return None
    return _inside(composed, dict(one.score.at) | parent.model.by_name)


def _inside(composed: Structure, values: Mapping[str, float]) -> Model | None:
    """The composition at these values; None where one is missing, or not within its bounds."""
    if not set(composed.names) <= set(values):
        return None
    if any(not each.bounds[0] < values[each.name] < each.bounds[1] for each in composed.parameters):
        return None
    return Model(composed, composed.vector({name: values[name] for name in composed.names}))
