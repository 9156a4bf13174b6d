"""Chains that have a half in common: one begins where the other ended, or is fitted once more from there."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.diagnose.candidates import Ranked, Reference, composed_with, ranked
from sysid.diagnose.likely import LATE_APART, SAME, rest_otherwise, twins
from sysid.diagnose.refits import begun_at, refit_or_reason
from sysid.errors import FitError
from sysid.model.effect import Effect, EffectError, named_effect
from sysid.model.parameter import Parameter
from sysid.model.structure import Model, Structure

INWARDS = 0.01
"""Of the way from a bound to what is typical, that a value begins inside of it: a bound may have no response."""

RAMP = 1001
"""Samples of a steady command, by which what rests is compared."""
RAMP_RESTS = 0.05
"""Of it, what servos rest within there."""


def levelled(
    best: Ranked, chains: Mapping[tuple[str, ...], Ranked], single: Mapping[str, Ranked], reference: Reference
) -> dict[tuple[str, ...], Ranked]:
    """Of these chains, by their names, those that explain more from where the best one ended.

    Asked again are those that have another half in the place of one of its own and fall further behind it than the
    halves do alone, by more than fits differ that the runs do not tell. (In a loop a lag of the servos beside a drift
    ended 764 of chi squared behind one of the gyros, which alone is the same.)
    """
    found: dict[tuple[str, ...], Ranked] = {}
    for names, chain in chains.items():
        kept = set(chain.effects) & set(best.effects)
        if len(kept) != 1:
            continue
        (other,), (half,) = set(chain.effects) - kept, set(best.effects) - kept
        if other not in single or half not in single:
            continue
        alone = single[half].chi_squared - single[other].chi_squared
        if best.chi_squared - chain.chi_squared > max(0.0, alone) + SAME:
            again = _from_there(chain, best, single[other], reference)
            found |= {} if again is None else {names: again}
    return found


def _from_there(chain: Ranked, best: Ranked, other: Ranked, reference: Reference) -> Ranked | None:
    """The chain begun at the best one's values, with the other half's as they are alone."""
    assert chain.fit is not None
    assert best.fit is not None
    structure = chain.fit.model.structure
    if not structure.linear:
        return None
    again = begun_at(chain.fit, reference.parent, _beginning(structure, best, other).by_name)
    there = None if again is None else ranked(replace(chain, fit=again), reference)
    return None if there is None or there.fit is None else there


def as_their_twins(
    best: Ranked, chains: Mapping[tuple[str, ...], Ranked], single: Mapping[str, Ranked], reference: Reference
) -> dict[tuple[str, ...], Ranked]:
    """Of these chains those beside a drag, or what else is not linear, that are likelier from where one ended that has
    a twin in the place of a half and is nearly as good as the best. (Servos of second order beside a drag ended 76 of
    chi squared behind a filter of the gyros, which alone is the same.)
    """
    found: dict[tuple[str, ...], Ranked] = {}
    near = [one for one in chains.values() if best.chi_squared - one.chi_squared <= LATE_APART]
    for names, chain in chains.items():
        if chain.fit is None or chain.fit.model.structure.linear:
            continue
        for there in near:
            halves = _exchanged(chain, there, single)
            if halves is None or there.chi_squared - chain.chi_squared <= SAME:
                continue
            again = _fitted_as(chain, _by_place(chain, there, *halves), reference)
            if again.delta_bic < chain.delta_bic and not again.implausible:
                found[names] = again
                break
    return found


def _exchanged(chain: Ranked, there: Ranked, single: Mapping[str, Ranked]) -> tuple[str, str] | None:
    """The half of each that the other has not, where these are twins and all else is the same."""
    own, others = set(chain.effects) - set(there.effects), set(there.effects) - set(chain.effects)
    if len(own) != 1 or len(others) != 1 or not own | others <= set(single):
        return None
    (half,), (twin,) = own, others
    known = single[half].stepped is not None and single[twin].stepped is not None
    return (half, twin) if known and twins(single[half], single[twin]) else None


def _by_place(chain: Ranked, there: Ranked, half: str, twin: str) -> dict[str, float]:
    """Where a chain ended, by the names that the values of its twin have."""
    assert there.fit is not None
    known = there.fit.model.by_name
    mine = [name for effect in chain.own_of(half) for name in effect.names]
    its = [name for effect in there.own_of(twin) for name in effect.names]
    return known | {name: known[as_its] for name, as_its in zip(mine, its, strict=False)}


def begun_at_rest(chains: Mapping[tuple[str, ...], Ranked], reference: Reference) -> dict[tuple[str, ...], Ranked]:
    """Of the best plausible one of these chains and those with play for its dead band, or the other way round, those
    that are likelier from where that one ended.

    Each has valleys of its own beside another effect. (A dead band of 3.2 mrad beside a damping had stayed at 5, and
    play was told for it, whose way was 1.6 to either side.)
    """
    found: dict[tuple[str, ...], Ranked] = {}
    plausible = [names for names, one in chains.items() if not one.implausible]
    if not plausible:
        return found
    of_best = min(plausible, key=lambda names: chains[names].delta_bic)
    best = chains[of_best]
    for names, chain in chains.items():
        resting = rest_otherwise(chain, best)
        if resting is None:
            continue
        for key, there, ways in ((names, best, resting), (of_best, chain, resting[::-1])):
            again = _resting_as(found.get(key, chains[key]), there, ways, reference)
            found |= {} if again is None else {key: again}
    return found


def _resting_as(one: Ranked, there: Ranked, resting: tuple[Effect, Effect], reference: Reference) -> Ranked | None:
    """A chain fitted once more from where another one ended, whose servos rest otherwise, at what stays as far behind;
    None where it is no likelier, or not plausible there."""
    own, others = resting
    assert one.fit is not None
    assert there.fit is not None
    assert own.rests_within is not None
    assert others.rests_within is not None
    known = there.fit.model.by_name
    here, behind = _stays_behind(own), _stays_behind(others)
    times = behind / here if min(here, behind) > 0 else 1.0
    again = _fitted_as(one, {**known, own.rests_within: times * known[others.rests_within]}, reference)
    return again if again.delta_bic < one.delta_bic and not again.implausible else None


def _fitted_as(one: Ranked, known: Mapping[str, float], reference: Reference) -> Ranked:
    """A chain fitted once more from these values; itself where that has no fit."""
    assert one.fit is not None
    structure = one.fit.model.structure
    fit, _ = refit_or_reason(structure, reference.parent, one.fit.added, _at(structure, known))
    return one if fit is None else ranked(replace(one, fit=fit), reference)


def _stays_behind(resting: Effect) -> float:
    """How far servos that rest stay behind a steady command in the mean, of what they rest within."""
    assert resting.samples is not None
    assert resting.rests_within is not None
    values = {one.name: one.null or 0.0 for one in resting.parameters} | {resting.rests_within: RAMP_RESTS}
    ramp = np.linspace(0.0, 1.0, RAMP)[np.newaxis]
    acting = resting.samples(ramp, 1.0, values)
    return float(np.mean(ramp) - np.mean(acting)) / RAMP_RESTS


def near_another(
    more: Ranked,
    begin: Ranked,
    chains: Mapping[tuple[str, ...], Ranked],
    single: Mapping[str, Ranked],
    users: Sequence[Effect],
) -> Model | None:
    """Where one more effect and what it is fitted to begin near the best plausible of these chains that has one of the
    two, the other as it is alone: no valley is looked for then. None where that is not known, and for linear ones,
    which look at all for little (a lag beside a filter ended at none); what rests, as play and a dead band, has valleys
    of its own.
    """
    assert begin.fit is not None
    for kept, new in ((more.effect, begin.effect), (begin.effect, more.effect)):
        there = [one for one in chains.values() if kept in one.effects and not one.implausible]
        if there and new in single and named_effect(new, users).rests_within is None:
            break
    else:
        return None
    return _beginning_beside(more, begin, min(there, key=lambda one: one.delta_bic), single[new], users)


def as_alone(more: Ranked, begin: Ranked, single: Mapping[str, Ranked], users: Sequence[Effect]) -> Model | None:
    """Where one more effect and what it is fitted to begin, both as they are alone; None where that is not known, and
    for linear ones."""
    alone = single.get(more.effect)
    return None if alone is None else _beginning_beside(more, begin, begin, alone, users)


def _beginning_beside(
    more: Ranked, begin: Ranked, chain: Ranked, other: Ranked, users: Sequence[Effect]
) -> Model | None:
    """Of the effect and what it is fitted to, a chain's values and the other half's; None where they are linear, or do
    not go together."""
    assert begin.fit is not None
    try:
        composed = composed_with(begin.fit.model.structure, named_effect(more.effect, users), begin.fit.dataset)
    except (EffectError, FitError):
        return None
    return None if composed.linear else _beginning(composed, chain, other)


def _beginning(structure: Structure, chain: Ranked, other: Ranked) -> Model:
    """A chain's values, and those of what takes the place of a half as it is alone."""
    assert chain.fit is not None
    return _at(structure, {**other.values, **chain.fit.model.by_name})


def _at(structure: Structure, known: Mapping[str, float]) -> Model:
    """At these values, and what is typical of all others, inside of their bounds."""
    values = {one.name: _inside(one, known.get(one.name, one.typical)) for one in structure.parameters}
    return Model(structure, structure.vector(values))


def _inside(one: Parameter, value: float) -> float:
    low, high = (end + INWARDS * (one.typical - end) if math.isfinite(end) else end for end in one.bounds)
    return min(max(value, low), high)
