"""Why a diagnosis says what it says, in the words of somebody who flies.

Four parts. What the effect is, with the numbers found and what is plausible for them. Why the evidence points to it:
its signature, and beside it what these very runs show, measured by taking the effect out of the model that has it and
comparing the rest with the flown responses; the difference is what the effect does, unmixed with what the parent's
parameters did in its place. What changes: parameters and modes before and after, and implausible values that became
plausible. What else could look so: effects that the data cannot tell from it, and those that come near only at values
that physics does not allow.

Nothing is said that was not measured: each sentence has a number from these runs and a threshold under which it is not
spoken.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnose.candidates import Ranked
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.quantities import amount, amount_signed, listed, plausible_range, quantity
from sysid.diagnose.removed_error import fall, name_of, shown_by_runs
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.structure import Mode

WIDTH = 78
SMALL = 2.0
"""Standard errors from its null, up to which one of several parameters is not told."""
MOVED = 3.0
"""Standard errors by which a parameter must move to be told,"""
MOVED_SHARE = 0.01
"""and of its own value."""
MOST_TOLD = 4
NEARLY = 0.9
"""Of the winner's chi squared."""


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Sentences by part; empty parts have nothing to say."""

    effects: tuple[str, ...]
    """Empty where there is no winner."""
    what: tuple[str, ...]
    why: tuple[str, ...]
    changes: tuple[str, ...]
    resembles: tuple[str, ...]
    marks: tuple[str, ...] = ()
    """Of `why`: the effects' usual signatures, and"""
    shown: tuple[str, ...] = ()
    """what these runs show, strongest first, less that the fit's numbers change."""

    @property
    def sentences(self) -> tuple[str, ...]:
        return (*self.what, *self.why, *self.changes, *self.resembles)

    def lines(self, width: int = WIDTH) -> list[str]:
        """As text, a heading for each part, continued lines indented."""
        found = []
        for heading, part in (
            ("what it is", self.what),
            ("why", self.why),
            ("what changes", self.changes),
            ("what else could look so", self.resembles),
        ):
            if part:
                found.append(heading)
                for said in part:
                    found += textwrap.wrap(said, width, initial_indent="  ", subsequent_indent="    ")
        return found

    def to_json(self) -> dict[str, Any]:
        return {
            "effects": list(self.effects),
            "what": list(self.what),
            "why": list(self.why),
            "changes": list(self.changes),
            "resembles": list(self.resembles),
        }


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
        return Explanation(
            effects=(),
            what=_no_winner(parent, complete),
            why=(),
            changes=_implausible_parent(parent, None, others),
            resembles=(),
        )
    marks, shown = tuple(f"{one.signature}." for one in _own(winner)), shown_by_runs(parent, winner, others)
    return Explanation(
        effects=winner.effects,
        what=tuple(_what(winner.fit, effect) for effect in _own(winner)),
        why=(*(f"Its mark: {mark}" for mark in marks), *shown, fall(parent, winner)),
        changes=(*_changes(parent, winner.fit), *_implausible_parent(parent, winner, others)),
        resembles=_resembles(winner, others, alike),
        marks=marks,
        shown=shown,
    )


def _own(judged: Ranked) -> list[Effect]:
    assert judged.fit is not None
    composed = judged.fit.model.structure.composed
    by_name = {one.path or one.id: one for one in composed}
    return [by_name[name] for name in judged.effects if name in by_name]


def _no_winner(parent: Candidate, complete: bool) -> tuple[str, ...]:
    reached = ", ".join(f"{name} {value:.1f} %" for name, value in parent.nrmse_percent.items())
    if complete:
        return (f"Nothing is missing that these runs could show: what the model leaves (fit {reached}) is noise.",)
    return (f"What the model leaves (fit {reached}) is more than noise, and no effect of the catalogue explains it.",)


def _errors(of: Candidate) -> dict[str, float]:
    spread = np.sqrt(np.maximum(np.diag(of.estimate.covariance), 0))
    return of.model.structure.by_name(spread)


def _what(fit: Candidate, effect: Effect) -> str:
    names, errors = fit.model.structure.names, _errors(fit)
    found, small = [], []
    for one in effect.parameters:
        if one.name not in names:
            continue
        value, error = fit.model[one.name], errors[one.name]
        if one.null is not None and len(effect.parameters) > 1 and abs(value - one.null) < SMALL * error:
            small.append(one.name)
            continue
        allowed = plausible_range(one)
        judged = f" ({'NOT ' if one.implausible(value) else ''}plausible: {allowed})" if allowed else ""
        found.append(quantity(one, value, error) + judged)
    if small:
        found.append(f"not to be told from none: {listed(small)}")
    title = effect.title[0].upper() + effect.title[1:]
    return f"{title}: {effect.equation}; {', '.join(found)}. Source: {effect.source}."


def _changes(parent: Candidate, fit: Candidate) -> list[str]:
    structure = fit.model.structure
    before, after = _errors(parent), _errors(fit)
    moved = []
    for one in parent.model.structure.parameters:
        if one.name not in structure.names:
            continue
        old, new = parent.model[one.name], fit.model[one.name]
        spread = max(before[one.name], after[one.name])
        if abs(new - old) > max(MOVED * spread, MOVED_SHARE * abs(old)):
            share = abs(new - old) / max(abs(old), 1e-300)
            words = _turned(amount(one, old, before[one.name]), amount(one, new, after[one.name]), one)
            moved.append((-min(share, 10.0), f"{one.name} {words}"))
    found = []
    if moved:
        found.append(f"Before and after: {'; '.join(words for _, words in sorted(moved)[:MOST_TOLD])}.")
        if len(moved) > MOST_TOLD:
            found[-1] = found[-1][:-1] + f"; {len(moved) - MOST_TOLD} more."
    turned = [_mode(old, _nearest(old, fit.model.modes)) for old in parent.model.modes if abs(old.damping_ratio) < 1]
    if turned:
        found.append(f"Modes: {', '.join([*turned, *_new_modes(parent, fit)])}.")
    return found


def _turned(old: str, new: str, one: Parameter) -> str:
    """`459 ± 2 → 709 ± 4 1/s^2`: the unit once where it is the same."""
    unit = next((each for each in (" ms", f" {one.unit}") if old.endswith(each) and new.endswith(each)), "")
    return f"{old.removesuffix(unit)} → {new}"


def _nearest(mode: Mode, others: Sequence[Mode]) -> Mode:
    return min(others, key=lambda other: abs(other.pole - mode.pole))


def _new_modes(parent: Candidate, fit: Candidate) -> list[str]:
    """Oscillations in the band that the parent did not have."""
    taken = [_nearest(old, fit.model.modes) for old in parent.model.modes]
    top = max(float(one.frequency_hz[-1]) for one in parent.dataset.spectra)
    found = [
        f"new {one.frequency_hz:.2f} Hz {one.damping_ratio:.2f}"
        for one in fit.model.modes
        if abs(one.damping_ratio) < 1 and one.frequency_hz < top and one not in taken
    ]
    return list(dict.fromkeys(found))  # equal servos have equal modes


def _mode(old: Mode, new: Mode) -> str:
    return f"{old.frequency_hz:.2f} Hz {old.damping_ratio:.2f} → {new.frequency_hz:.2f} Hz {new.damping_ratio:.2f}"


def _implausible_parent(parent: Candidate, winner: Ranked | None, others: Sequence[Ranked]) -> tuple[str, ...]:
    """The parent's own implausible values, and which effects make them plausible."""
    found = []
    for one in parent.model.structure.parameters:
        value = parent.model[one.name]
        if not one.implausible(value):
            continue
        begin = f"{amount_signed(one, value)} is not plausible ({plausible_range(one)}): it stands in for something"
        if winner is not None and one.name in winner.resolved and winner.fit is not None:
            now = amount(one, winner.fit.model[one.name], _errors(winner.fit)[one.name])
            found.append(f"{begin}. With {' and '.join(winner.effects)} it becomes {now}.")
            continue
        cures = [
            each
            for each in sorted(others, key=lambda other: -other.chi_squared)
            if each.fit is not None and one.name in each.resolved and not each.implausible
        ]
        if cures:
            best = cures[0]
            assert best.fit is not None
            now = amount(one, best.fit.model[one.name], _errors(best.fit)[one.name])
            more = f" So would {listed([name_of(each) for each in cures[1:4]])}." if len(cures) > 1 else ""
            found.append(f"{begin}. {name_of(best)} would make it plausible: {now}.{more}")
        else:
            found.append(f"{begin}, and no effect that was refitted makes it plausible.")
    return tuple(found)


def _resembles(winner: Ranked, others: Sequence[Ranked], alike: Sequence[str]) -> tuple[str, ...]:
    assert winner.fit is not None
    found = []
    if winner.implausible:
        found.append(_stands_in(winner, others))
    if alike:
        by_name = {one.effects: one for one in others}
        each = [by_name.get((name,)) for name in alike]
        values = [f"{name}{_values(one)}" for name, one in zip(alike, each, strict=True)]
        found.append(f"These runs cannot tell it from {listed(values)}.")
    for one in sorted(others, key=lambda other: -other.chi_squared):
        near = one.chi_squared >= NEARLY * winner.chi_squared
        if one.fit is None or not one.implausible or len(one.effects) > 1 or one.effects == winner.effects or not near:
            continue
        share = min(100.0, 100 * one.chi_squared / max(winner.chi_squared, 1e-300))
        found.append(f"{name_of(one)} comes near ({share:.0f} %), but only with {_outside(one)}: it stands in.")
        if len(found) >= MOST_TOLD:
            break
    return tuple(found)


def _values(judged: Ranked | None) -> str:
    if judged is None or judged.fit is None:
        return ""
    model, errors = judged.fit.model, _errors(judged.fit)
    said = [quantity(p, model[p.name], errors[p.name]) for e in _own(judged) for p in e.parameters]
    return f" ({', '.join(said)})"


def _outside(judged: Ranked) -> str:
    assert judged.fit is not None
    model = judged.fit.model
    by_name = {one.name: one for one in model.structure.parameters}
    said = []
    for name in judged.implausible[:2]:
        one = by_name[name]
        said.append(f"{amount_signed(one, model[name])} (plausible: {plausible_range(one)})")
    return listed(said)


def _stands_in(winner: Ranked, others: Sequence[Ranked]) -> str:
    """An implausible winner, and what beside it would bring its values back."""
    assert winner.fit is not None
    begin = f"{_outside(winner)}: {name_of(winner)} stands in for something else."
    for one in sorted(others, key=lambda other: -other.chi_squared):
        both = len(one.effects) > len(winner.effects) and set(winner.effects) < set(one.effects)
        if both and one.fit is not None and not one.implausible:
            beside = " + ".join(name for name in one.effects if name not in winner.effects)
            return f"{begin} Beside {beside} its values would be plausible: {_values(one)[2:-1]}."
    instead = [
        one
        for one in sorted(others, key=lambda other: -other.chi_squared)
        if one.fit is not None and not one.implausible and one.chi_squared >= NEARLY * winner.chi_squared
    ]
    if instead:
        return (
            f"{begin} {name_of(instead[0])} explains nearly as much at plausible values: {_values(instead[0])[2:-1]}."
        )
    return begin
