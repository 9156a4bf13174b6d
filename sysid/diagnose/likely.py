"""How likely each candidate is beside the others, and the class that an answer declares.

A candidate's weight is its likelihood under the noise's spectrum, averaged over what its own parameters may plausibly
be (Laplace's approximation): what could have been anywhere and is needed in one place has promised less. Real vehicles
are built of no entry exactly, so differences count the less, the more even the likeliest leaves.

Entries that predict the same are one answer: a lag of the servos and one of the gyros, an overdamped second order and
a lag; and so is one that contains another where what it has more does not pay, as a lag of its own on each axis. The
class is the fewest answers that together are nearly certain.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.diagnose.candidates import Ranked
from sysid.diagnose.evidence import gain
from sysid.model.effect import Effect, catalogue, tied
from sysid.model.parameter import Parameter

TEMPER = 1.5
"""Times that differences of chi squared are too large, where noise is as it seems;"""
MISFIT_TOLD = 7.0
"""and chi squared left beyond noise that makes them as many times too large again."""
CHANCE = 2.0
SAME = 10.0
"""Chi squared by which one candidate must be likelier than another to be surely told from it."""
SPREAD = 1.5
"""Powers of e, one standard deviation, that a size may be from what it is mostly."""
SAME_SHARE = 1e-4
"""Of the power that an effect removes, by which two may differ in what they predict and be the same,"""
SAME_POWER = 1.0
"""and in chi squared at most: here no run like these could tell them."""
CERTAIN = 0.97
"""Of all candidates, that a class holds;"""
USEFUL, ENOUGH = 3, 0.7
"""or the likeliest three, where they hold so much, and are so much less sure: longer lists tell nobody what to do."""

TWINS = 1e-6
"""Of what two effects explain alone, by which their answers may differ and they be one under two names."""
ALIKE = 0.2
"""Of what two effects explain, up to which their answers may differ and they explain the same."""
BETWEEN_SAMPLES = 1 / 3
"""Of the answer's chi squared: what acts on samples and has so much is as good where a log lost some. 9 strange flights
of play or a dead band, at 50 to 125 Hz, were named one of the two, 3 wrongly; then the right one had 0.39 to 0.88."""
PERHAPS_BETWEEN_SAMPLES = 0.8
"""The same where a log may have lost some, and does not tell: a play was named at 0.995 by every second command of a
loop, where the dead band that was there had 0.86 of what that explained;"""
PERHAPS_AT_REST = 0.5
"""and of play and a dead band without an excitation on record: by every fourth command a play was named at 0.97, where
the dead band that was there had 0.58 of it."""
LATE = (
    ("servo_lag", "motor_lag", "gyro_lag", "lag_per_axis"),
    ("transport_delay",),
    ("servo_second_order", "gyro_filter"),
)
"""What makes answers late, by its form: a lag, a delay, a second order."""
LATE_APART, LATE_SHARE = 25.0, 0.1
"""Chi squared, SAME where an excitation is logged, and share of the answer's, by which one of another form may explain
less and be as good: what tells the forms apart is small beside what all do, and without an excitation hangs on how the
gusts were foretold. Of 298 such names on strangers that four judgements had spent four were of the wrong form, right
ones being behind by 6 to 23 (a delay of 2 ms by a filter that rings), or implausible for how they ring; with an
excitation two of 383, by 1.7 and 8."""
AT_AN_END = 0.75
"""Of the answer's chi squared, that a tether explains at least where that answer stands at an end of its range: of
strangers that judgements had spent ten of ten that were named slipstream_wing, dynamic_inflow or speed_stability with
a bound for their time or drag hung on a tether, which explained 0.78 and more; beside modes, none more than 0.3."""


@dataclass(frozen=True, slots=True)
class Class:
    """What is as good an answer as the one named."""

    alike: tuple[str, ...]
    """Other entries, the likeliest first; of those that predict the same one for all."""
    equivalent: Mapping[str, tuple[str, ...]]
    """Of those and of the answer: entries that predict the same here."""
    named: float
    """Probability, among the candidates, of the answer,"""
    whole: float
    """and of the whole class."""
    pairs: tuple[tuple[str, ...], ...] = ()
    """Others of it that are two entries each, which do together what a single one does that is the answer."""

    @property
    def right(self) -> float:
        """Probability that the answer is right, or one of a class that is short enough to be of use."""
        return self.whole if len(self.alike) + len(self.pairs) < USEFUL else self.named

    def named_with(self, winner: Ranked) -> set[str]:
        """Every entry that stands in it, by whatever name, the winner's among them."""
        return {*winner.effects, *self.alike, *(name for names in self.equivalent.values() for name in names)}


def declared(winner: Ranked, candidates: Sequence[Ranked]) -> Class:
    """The class of a winner among candidates of as many effects, and pairs that a single one is made of."""
    rivals = [
        one
        for one in candidates
        if one.stepped is not None and one is not winner and impossible(one) <= set(winner.implausible)
    ]
    weights = {one.effects: _beside(one, winner) for one in (winner, *rivals)}
    families = _families(winner, rivals, weights)
    top = max(weights.values())
    masses = [sum(math.exp(weights[one.effects] - top) for one in family) for family in families]
    shares = [mass / sum(masses) for mass in masses]
    order = [0, *sorted(range(1, len(families)), key=lambda i: -shares[i])]
    held = [sum(shares[i] for i in order[: n + 1]) for n in range(len(order))]
    count = _count(held)
    kept = [families[i] for i in order[:count]]
    named, heads = set(winner.effects), [family[0].effects for family in kept[1:]]
    alike = [effects for effects in heads if len(effects) == len(winner.effects)]
    return Class(
        alike=tuple(dict.fromkeys(name for effects in alike for name in effects if name not in named)),
        pairs=tuple(effects for effects in heads if effects not in alike),
        equivalent=_equivalents(kept, named),
        named=shares[0],
        whole=held[count - 1],
    )


def where_samples_are_lost(
    among: Class,
    winner: Ranked,
    singles: Sequence[Ranked],
    chains: Sequence[Ranked] = (),
    share: float = BETWEEN_SAMPLES,
) -> Class:
    """The class on a log that lost samples of the commands, or may have: what a play or a dead band makes of small
    commands hangs on every one of them, so neither is the truth on such a log, and the nearer need not be right. In it
    is what explains this share of what the winner does, alone or beside the same other half of a chain."""
    if len(winner.effects) > 1:
        others = [*_in_the_place_of_a_half(winner, among, singles, chains, share)]
    elif _on_samples(winner):
        others = [(one, one.effect, _least(one, winner, share)) for one in singles if _on_samples(one)]
    else:
        return among
    known = among.named_with(winner)
    allowed = set(winner.implausible)
    more = [
        name
        for one, name, least in others
        if one.fit is not None and set(one.implausible) <= allowed and one.chi_squared >= least and name not in known
    ]
    return replace(among, alike=_of_use(among, more))


def _least(one: Ranked, winner: Ranked, share: float) -> float:
    """Chi squared from which on one that acts on samples is as good as another, by the share that it needs of it."""
    assert winner.fit is not None
    rest = not winner.fit.division.measured and all(effect.rests_within for effect in (*one.own, *winner.own))
    return (min(share, PERHAPS_AT_REST) if rest else share) * winner.chi_squared


def _of_use(among: Class, more: Sequence[str]) -> tuple[str, ...]:
    """The class with others, no more than are of use."""
    return (*among.alike, *dict.fromkeys(more))[: max(USEFUL - 1, len(among.alike))]


def _in_the_place_of_a_half(
    winner: Ranked, among: Class, singles: Sequence[Ranked], chains: Sequence[Ranked], share: float
) -> Iterator[tuple[Ranked, str, float]]:
    """Other chains that have, in the place of a half that acts on samples, another that does; its name, and chi squared
    from which on it is as good, beside what the half that stays, by whatever name, explains alone."""
    alone = {one.effect: one.chi_squared for one in singles if one.fit is not None}
    for half, other in (winner.effects, winner.effects[::-1]):
        if not _acts_on_samples(winner, half):
            continue
        stays = {other, *among.equivalent.get(other, ())}
        kept = max(0.0, *(alone.get(name, 0.0) for name in stays))
        least = kept + share * (winner.chi_squared - kept)
        for one in chains:
            name = next((each for each in one.effects if each not in {half, *stays}), None)
            if name is not None and stays & set(one.effects) and _acts_on_samples(one, name):
                yield one, name, least


def with_unasked(among: Class, winner: Ranked, singles: Sequence[Ranked], chains: Sequence[Ranked]) -> Class:
    """The class of a chain with what alone is like a half of it, or like what may stand there, and as good, and was not
    fitted beside the other half: the search had no more time, and nothing tells them apart. No more than are of use."""
    if len(winner.effects) == 1:
        return among
    asked = {frozenset(one.effects) for one in chains if one.fit is not None}
    known = among.named_with(winner)
    fitted = _plausible(singles)
    more = [
        each.effect
        for half, other in (winner.effects, winner.effects[::-1])
        for one in fitted
        if one.effect == half or (one.effect in among.alike and frozenset((one.effect, other)) in asked)
        for each in fitted
        if each.effect not in known and frozenset((each.effect, other)) not in asked
        if _as_good(each, one)
    ]
    return replace(among, alike=_of_use(among, more))


def with_tethers(among: Class, winner: Ranked, singles: Sequence[Ranked]) -> Class:
    """The class of a single effect that stands at an end of its range which physics does not allow, with the tethers
    that explain nearly as much: a wake, an inflow or a bar that takes so long follows the attitude itself."""
    if len(winner.effects) > 1 or not _at_an_end(winner):
        return among
    known, least = among.named_with(winner), AT_AN_END * winner.chi_squared
    more = [
        one.effect
        for one in singles
        if tied(one.effects) and one.fit is not None and not impossible(one) and one.effect not in known
        if one.chi_squared >= least
    ]
    return replace(among, alike=_of_use(among, more))


def with_late(among: Class, winner: Ranked, singles: Sequence[Ranked], chains: Sequence[Ranked] = ()) -> Class:
    """The class of what makes answers late, alone or in a chain, with the other forms of that which explain nearly as
    much, however they ring; before what is of none. No more than are of use."""
    known = among.named_with(winner)
    rivals = [*_late_rivals(winner, among, singles, chains)]
    more: dict[str, tuple[str, ...]] = {}
    for form in filter(known.isdisjoint, LATE):
        nearly = [(name, one) for name, one in rivals if name in form and _late_as_well(one, winner)]
        if nearly:
            first, head = min(nearly, key=lambda each: each[1].delta_bic)
            more[first] = tuple(name for name, one in nearly if one is not head and same(one, head, winner))
    if not more:
        return among
    late = [name for name in among.alike if _is_late(name)]
    alike = dict.fromkeys([*late, *more, *among.alike])
    return replace(among, alike=tuple(alike)[: USEFUL - 1], equivalent={**among.equivalent, **more})


def _late_rivals(
    winner: Ranked, among: Class, singles: Sequence[Ranked], chains: Sequence[Ranked]
) -> Iterator[tuple[str, Ranked]]:
    """Candidates that have something else in the place of what makes the winner's answers late; its name with each."""
    if len(winner.effects) == 1:
        yield from ((one.effect, one) for one in singles if _is_late(winner.effect))
        return
    for half, other in (winner.effects, winner.effects[::-1]):
        stays = {other, *among.equivalent.get(other, ())}
        for one in chains if _is_late(half) else ():
            names = [name for name in one.effects if name not in stays]
            if len(names) == 1 and len(one.effects) == len(winner.effects):
                yield names[0], one


def _is_late(name: str) -> bool:
    return any(name in form for form in LATE)


def _late_as_well(one: Ranked, winner: Ranked) -> bool:
    """Whether one of another form explains nearly as much, at possible values, however it rings."""
    assert winner.fit is not None
    if one.fit is None or not {*one.implausible} <= {"zeta"}:
        return False
    apart = SAME if winner.fit.division.measured else LATE_APART
    return winner.chi_squared - one.chi_squared <= min(apart, LATE_SHARE * winner.chi_squared)


def _at_an_end(one: Ranked) -> bool:
    """Whether a number of its own is at a bound, beyond what physics allows."""
    assert one.fit is not None
    model, bound = one.fit.model, one.fit.estimate.at_bound
    own = (parameter for effect in one.own for parameter in effect.parameters)
    return any(each.name in bound and each.implausible(model[each.name]) for each in own)


def with_twins(
    among: Class, winner: Ranked, singles: Sequence[Ranked], chains: Sequence[Ranked] | None = None
) -> Class:
    """The class of a chain with what is one with an entry of it alone: beside what is linear, or acts on samples of the
    commands before it, it is so too, wherever a fit of its own ended, if there was one, and however implausible it was
    alone: that hangs on what else there is. Beside a drag it need not be: there it is as good where it is in none of
    the `chains`, for nothing tells them apart then."""
    if len(winner.effects) == 1:
        return among
    sure = all(effect.linear or effect.samples is not None for effect in winner.own)
    asked = {frozenset(one.effects) for one in chains or () if one.fit is not None}
    fitted = [one for one in singles if one.stepped is not None]
    able = [one for one in fitted if sure or (chains is not None and not any(_beside_half(one, winner, asked)))]
    known = among.named_with(winner)
    equivalent = dict(among.equivalent)
    for one in fitted:
        if one.effect not in (*winner.effects, *among.alike):
            continue
        more = [each.effect for each in able if each.effect not in known and _stands_for(each, one, winner)]
        known.update(more)
        if more:
            equivalent[one.effect] = (*equivalent.get(one.effect, ()), *more)
    return replace(among, equivalent=equivalent)


def _stands_for(twin: Ranked, one: Ranked, chain: Ranked) -> bool:
    """Whether it is one with this half of a chain, or of its class, and may be what that is."""
    if not twins(one, twin):
        return False
    if not twin.implausible:
        return True
    return _fits(twin, chain, one) if one.effect in chain.effects else _as_plausible(twin, one)


def _beside_half(one: Ranked, winner: Ranked, asked: Container[frozenset[str]]) -> Iterator[bool]:
    """For each half of a chain whether this one was fitted beside it."""
    return (frozenset((one.effect, half)) in asked for half in winner.effects)


def _fits(twin: Ranked, chain: Ranked, half: Ranked) -> bool:
    """Whether values of this half of a chain are plausible ones of its twin, too, by their standard errors."""
    assert chain.fit is not None
    names = [name for effect in half.own for name in effect.names]
    its = [parameter for effect in twin.own for parameter in effect.parameters]
    values, errors = ([of[name] for name in names] for of in (chain.fit.model, chain.fit.standard_errors))
    return len(names) == len(its) and not any(map(Parameter.implausible, its, values, errors))


def _as_plausible(twin: Ranked, one: Ranked) -> bool:
    """Whether of a twin no other values are implausible than of this one, which stands in the class of a chain: there
    it has others than alone."""
    mine, its = ([name for effect in each.own for name in effect.names] for each in (one, twin))
    allowed = {its[i] for i, name in enumerate(mine) if name in one.implausible and i < len(its)}
    return len(mine) == len(its) and set(twin.implausible) <= allowed


def twins(one: Ranked, other: Ranked) -> bool:
    """Whether two are the same one under two names, as a lag of all servos and of both gyros."""
    assert one.stepped is not None
    assert other.stepped is not None
    apart = gain(one.stepped, other.stepped)[1]
    return one.added == other.added and apart <= TWINS * min(one.chi_squared, other.chi_squared)


def _as_good(one: Ranked, other: Ranked) -> bool:
    """Whether it explains alone what the other does, and is as likely, its numbers paid."""
    return one.delta_bic <= other.delta_bic + SAME_POWER and not do_else(one, other)


def do_else(one: Ranked, other: Ranked) -> bool:
    """Whether two effects explain different things: how far their answers are apart, beside what they explain."""
    assert one.stepped is not None
    assert other.stepped is not None
    return gain(one.stepped, other.stepped)[1] > ALIKE * min(one.chi_squared, other.chi_squared)


def _plausible(singles: Sequence[Ranked]) -> list[Ranked]:
    return [one for one in singles if one.stepped is not None and not one.implausible]


def _on_samples(one: Ranked) -> bool:
    return all(effect.samples is not None for effect in one.own)


def _acts_on_samples(chain: Ranked, half: str) -> bool:
    return any(effect.samples is not None for effect in chain.own_of(half))


def rest_otherwise(one: Ranked, other: Ranked) -> tuple[Effect, Effect] | None:
    """The half of each that the other has not, where servos rest within it and all else is the same: play for a dead
    band, or the other way round."""
    apart = [set(here.effects) - set(there.effects) for here, there in ((one, other), (other, one))]
    if [len(names) for names in apart] != [1, 1]:
        return None
    halves = [half for each, names in zip((one, other), apart, strict=True) for half in each.own_of(*names)]
    return (halves[0], halves[1]) if [half.rests_within is not None for half in halves] == [True, True] else None


def impossible(one: Ranked) -> set[str]:
    """Its parameters that physics does not allow; what is none in free flight alone, a tether or a stand may be."""
    return set(one.implausible) - tied(one.effects)


def doubtful(one: Ranked) -> set[str]:
    """Its doubtful values but those of a tether: whoever flies knows whether there is one."""
    return set(one.outside) - tied(one.effects)


def _families(winner: Ranked, rivals: Sequence[Ranked], weights: Mapping[tuple[str, ...], float]) -> list[list[Ranked]]:
    """Those that predict the same together, the winner's first; the simplest of each, then the likeliest, leads it."""
    families: list[list[Ranked]] = [[winner]]
    for one in sorted(rivals, key=lambda one: (one.added, -weights[one.effects])):
        home = next((family for family in families if _no_other(one, family, winner)), None)
        if home is None:
            families.append([one])
        else:
            home.append(one)
    return families


def _count(held: Sequence[float]) -> int:
    """How many of the likeliest make the class, by what so many hold together."""
    certain = next((n for n, share in enumerate(held, 1) if share >= CERTAIN), len(held))
    return USEFUL if certain > USEFUL and held[USEFUL - 1] >= ENOUGH else certain


def near(winner: Ranked, candidates: Sequence[Ranked]) -> frozenset[str]:
    """All plausible entries that the runs do not surely tell from the answer, however unlikely."""
    assert winner.stepped is not None
    least = max(SAME, misfit(winner))
    return frozenset(
        name
        for one in candidates
        if one.stepped is not None
        and not one.implausible
        and gain(winner.stepped, one.stepped)[0] + one.added - winner.added < least
        for name in one.effects
        if name not in winner.effects
    )


def _equivalents(families: Sequence[Sequence[Ranked]], named: set[str]) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {}
    for head, *others in families:
        for one in others:
            mine = [name for name in head.effects if name not in one.effects]
            his = [name for name in one.effects if name not in head.effects]
            for name, other in zip(mine, his, strict=False):
                if other not in named:
                    found[name] = tuple(dict.fromkeys((*found.get(name, ()), other)))
    return found


def _no_other(one: Ranked, family: Sequence[Ranked], winner: Ranked) -> bool:
    """Whether it is no answer beside these: it predicts the same, or would by its equations were it fitted better, or
    is one of them with more free than pays."""
    head = family[0]
    if same(one, head, winner):
        return True
    assert one.stepped is not None
    assert head.stepped is not None
    behind = gain(head.stepped, one.stepped)[0]
    if behind < SAME and any(_related(one, other, "same_as") for other in family):
        return True
    return one.delta_bic >= head.delta_bic and any(_related(one, other, "contains") for other in family)


def _related(one: Ranked, other: Ranked, how: Literal["same_as", "contains"]) -> bool:
    """Whether, of effects that only one of them has, its own names the other's so."""
    own, his = set(one.effects) - set(other.effects), set(other.effects) - set(one.effects)
    known = catalogue()
    named = {each for name in own if name in known for each in getattr(known[name], how)}
    return bool(his) and his <= named


def same(one: Ranked, other: Ranked, winner: Ranked) -> bool:
    """Whether two predict the same, beside what the winner explains."""
    assert one.stepped is not None
    assert other.stepped is not None
    apart = one.stepped.told - other.stepped.told
    return float(apart @ apart) <= min(SAME_POWER, SAME_SHARE * max(winner.chi_squared, 0.0))


def weight(one: Ranked, winner: Ranked) -> float:
    """Logarithm, beside the winner's likelihood."""
    assert one.stepped is not None
    assert winner.stepped is not None
    temper = max(TEMPER, misfit(winner, CHANCE) / MISFIT_TOLD)
    behind = 0.0 if one is winner else gain(winner.stepped, one.stepped)[0]
    return -0.5 * behind / temper + promised(one, temper)


def _beside(one: Ranked, winner: Ranked) -> float:
    """Its weight; what has doubtful values may only resemble, and is at best as likely as a winner that has none."""
    own = weight(one, winner)
    return min(own, weight(winner, winner)) if one.outside and not winner.outside else own


def promised(one: Ranked, temper: float = 1.0) -> float:
    """Logarithm of the share of what its own parameters may be that these runs leave them; 0 where they leave all.

    Sizes may be anything within some powers of e, whatever their units, and the sooner about none the less they tell.
    """
    assert one.fit is not None
    model = one.fit.model
    own = [name for effect in one.own for name in effect.names if name in one.fit.free]
    places = [model.structure.names.index(name) for name in own]
    spread = one.fit.estimate.covariance[np.ix_(places, places)]
    widths = np.array([SPREAD * max(abs(model[name]), 1e-12) for name in own])
    if not own or not np.all(np.isfinite(spread)):
        return 0.0
    inner = np.maximum(np.linalg.eigvalsh(temper * spread / np.outer(widths, widths)), 1e-12)
    # what takes the place of parameters that it had anyway promises no more than these did
    return min(1.0, max(0, one.added) / len(own)) * float(np.sum(0.5 * np.log(inner / (1 + inner))))


def misfit(one: Ranked, chance: float = 0.0) -> float:
    """Chi squared that a candidate leaves beyond noise, and so many standard deviations of that: real vehicles are
    built of no entry exactly."""
    assert one.fit is not None
    left = one.fit.division
    return max(0.0, left.chi_squared - left.degrees - chance * math.sqrt(2 * left.degrees))
