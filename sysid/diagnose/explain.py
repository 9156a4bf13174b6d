"""Why a diagnosis says what it says: what is stated of the answer, each statement with the numbers that it stands on.

Four parts. What the effect is, with the numbers found and what is plausible for them. Why the evidence points to it:
its signature, and beside it what these very runs show, measured by taking the effect out of the model that has it and
comparing the rest with the flown responses; the difference is what the effect does, unmixed with what the parent's
parameters did in its place. What changes: parameters and modes before and after, and implausible values that became
plausible. What else could look so: effects that the data cannot tell from it, and those that come near only at values
that physics does not allow.

Nothing is told that was not measured: each statement has a number from these runs and a threshold under which it is not
made.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sysid.diagnose.candidates import Ranked
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.reasons import (
    Alike,
    Change,
    ComesNear,
    EffectFound,
    FitRises,
    ImplausibleBefore,
    ModesMove,
    NothingKnown,
    NothingMissing,
    ParametersMove,
    Resemblance,
    Shown,
    Size,
    StandsIn,
    What,
)
from sysid.diagnose.removed_error import rise, shown_by_runs
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.structure import Mode

SMALL = 2.0
"""Standard errors from its null, up to which one of several parameters is not told."""
MOVED = 3.0
"""Standard errors by which a parameter must move to be told,"""
MOVED_SHARE = 0.01
"""and of its own value."""
MOST_TOLD = 4
NEARLY = 0.9
"""Of the winner's chi squared."""
MOST_CURES = 4
MOST_OUTSIDE = 2


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Statements by part; empty parts have nothing to say."""

    effects: tuple[str, ...]
    """Empty where there is no winner."""
    what: tuple[What, ...]
    marks: tuple[str, ...] = ()
    """Why: the effects' usual signatures,"""
    shown: tuple[Shown, ...] = ()
    """what these runs show, strongest first,"""
    rise: FitRises | None = None
    """and how the fit's numbers change."""
    changes: tuple[Change, ...] = ()
    resembles: tuple[Resemblance, ...] = ()


def explain(
    parent: Candidate,
    winner: Ranked | None,
    others: Sequence[Ranked] = (),
    alike: Sequence[str] = (),
    *,
    complete: bool = False,
) -> Explanation:
    """Explain the winner, or why there is none. `others` are all candidates, `alike` the ids not told from it.

    `complete`: what the parent leaves is noise; whatever was refitted, nothing won.
    """
    if complete or winner is None or winner.fit is None:
        nothing = NothingMissing if complete else NothingKnown
        return Explanation(
            effects=(),
            what=(nothing(parent.nrmse_percent),),
            changes=tuple(_implausible_parent(parent, None, others)),
        )
    return Explanation(
        effects=winner.effects,
        what=tuple(_what(winner.fit, effect) for effect in _own(winner)),
        marks=tuple(effect.signature for effect in _own(winner)),
        shown=shown_by_runs(parent, winner, others),
        rise=rise(parent, winner),
        changes=(*_changes(parent, winner.fit), *_implausible_parent(parent, winner, others)),
        resembles=_resembles(winner, others, alike),
    )


def _own(judged: Ranked) -> list[Effect]:
    assert judged.fit is not None
    composed = judged.fit.model.structure.composed
    by_name = {one.path or one.id: one.worded(judged.fit.dataset.airframe) for one in composed}
    return [by_name[name] for name in judged.effects if name in by_name]


def _what(fit: Candidate, effect: Effect) -> EffectFound:
    names, errors = fit.model.structure.names, fit.standard_errors
    sizes, none = [], []
    for one in effect.parameters:
        if one.name not in names:
            continue
        value, error = fit.model[one.name], errors[one.name]
        if one.null is not None and one.sizes and len(effect.parameters) > 1 and abs(value - one.null) < SMALL * error:
            none.append(one.name)
        else:
            sizes.append(Size(one, value, error))
    return EffectFound(effect, tuple(sizes), tuple(none))


def _changes(parent: Candidate, fit: Candidate) -> Iterator[Change]:
    moves = _moves(parent, fit)
    if moves:
        yield ParametersMove(tuple(moves[:MOST_TOLD]), max(len(moves) - MOST_TOLD, 0))
    turned = [(old, _nearest(old, fit.model.modes)) for old in parent.model.modes if abs(old.damping_ratio) < 1]
    if turned:
        yield ModesMove(tuple(turned), tuple(_new_modes(parent, fit)))


def _moves(parent: Candidate, fit: Candidate) -> list[tuple[Size, Size]]:
    """Parameters that moved, those that moved most of their value first."""
    before, after = parent.standard_errors, fit.standard_errors
    moved: list[tuple[float, str, tuple[Size, Size]]] = []
    for one in parent.model.structure.parameters:
        if one.name not in fit.model.structure.names:
            continue
        old, new = parent.model[one.name], fit.model[one.name]
        spread = max(before[one.name], after[one.name])
        if abs(new - old) > max(MOVED * spread, MOVED_SHARE * abs(old)):
            share = abs(new - old) / max(abs(old), 1e-300)
            move = Size(one, old, before[one.name]), Size(one, new, after[one.name])
            moved.append((-min(share, 10.0), one.name, move))
    return [move for _, _, move in sorted(moved, key=lambda each: each[:2])]


def _nearest(mode: Mode, others: Sequence[Mode]) -> Mode:
    return min(others, key=lambda other: abs(other.pole - mode.pole))


def _new_modes(parent: Candidate, fit: Candidate) -> list[Mode]:
    """Oscillations in the band that the parent did not have."""
    taken = [_nearest(old, fit.model.modes) for old in parent.model.modes]
    top = max(float(one.frequency_hz[-1]) for one in parent.dataset.spectra)
    return [
        one for one in fit.model.modes if abs(one.damping_ratio) < 1 and one.frequency_hz < top and one not in taken
    ]


def _implausible_parent(
    parent: Candidate, winner: Ranked | None, others: Sequence[Ranked]
) -> Iterator[ImplausibleBefore]:
    """The parent's own implausible values, and which effects make them plausible."""
    for one in parent.model.structure.parameters:
        value = parent.model[one.name]
        if not one.implausible(value, parent.standard_errors[one.name]):
            continue
        size = Size(one, value)
        if winner is not None and one.name in winner.resolved and winner.fit is not None:
            now = _size(winner.fit, one)
            yield ImplausibleBefore(size=size, cure=winner.effects, added=True, now=now)
            continue
        cures = [
            each
            for each in _likeliest_first(others)
            if each.fit is not None and one.name in each.resolved and not each.implausible
        ]
        if cures and cures[0].fit is not None:
            also = tuple(each.effects for each in cures[1:MOST_CURES])
            yield ImplausibleBefore(size=size, cure=cures[0].effects, now=_size(cures[0].fit, one), others=also)
        else:
            yield ImplausibleBefore(size=size, cure=())


def _size(fit: Candidate, parameter: Parameter) -> Size:
    return Size(parameter, fit.model[parameter.name], fit.standard_errors[parameter.name])


def _likeliest_first(candidates: Sequence[Ranked]) -> list[Ranked]:
    return sorted(candidates, key=lambda one: -one.chi_squared)


def _resembles(winner: Ranked, others: Sequence[Ranked], alike: Sequence[str]) -> tuple[Resemblance, ...]:
    assert winner.fit is not None
    resembles: list[Resemblance] = [_stands_in(winner, others)] if winner.implausible else []
    if alike:
        by_name = {one.effects: one for one in others}
        resembles.append(Alike(tuple((name, _sizes(by_name.get((name,)))) for name in alike)))
    for one in _likeliest_first(others):
        near = one.chi_squared >= NEARLY * winner.chi_squared
        if one.fit is None or not one.implausible or len(one.effects) > 1 or one.effects == winner.effects or not near:
            continue
        share = min(1.0, one.chi_squared / max(winner.chi_squared, 1e-300))
        resembles.append(ComesNear(one.effects, share, _outside(one)))
        if len(resembles) >= MOST_TOLD:
            break
    return tuple(resembles)


def _sizes(judged: Ranked | None) -> tuple[Size, ...] | None:
    """Of its own parameters; None where it was not refitted."""
    if judged is None or judged.fit is None:
        return None
    return tuple(_size(judged.fit, parameter) for effect in _own(judged) for parameter in effect.parameters)


def _outside(judged: Ranked) -> tuple[Size, ...]:
    """The first of its values that physics does not allow."""
    assert judged.fit is not None
    model = judged.fit.model
    by_name = {one.name: one for one in model.structure.parameters}
    return tuple(Size(by_name[name], model[name]) for name in judged.implausible[:MOST_OUTSIDE])


def _stands_in(winner: Ranked, others: Sequence[Ranked]) -> StandsIn:
    """An implausible winner, and what beside it would bring its values back."""
    outside = _outside(winner)
    for one in _likeliest_first(others):
        both = len(one.effects) > len(winner.effects) and set(winner.effects) < set(one.effects)
        if both and one.fit is not None and not one.implausible:
            beside = tuple(name for name in one.effects if name not in winner.effects)
            return StandsIn(effects=winner.effects, outside=outside, beside=beside, sizes=_sizes(one) or ())
    for one in _likeliest_first(others):
        if one.fit is not None and not one.implausible and one.chi_squared >= NEARLY * winner.chi_squared:
            return StandsIn(effects=winner.effects, outside=outside, instead=one.effects, sizes=_sizes(one) or ())
    return StandsIn(effects=winner.effects, outside=outside)
