"""A diagnosis of a fit for people and for other programs: the verdict, what it stands on, and the ladder of rungs.

The mathematics is `sysid.diagnose`; here runs are read again, effects are added one after the other, and the findings
put into words. The same functions serve the command line and the app.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gcs.analysis import assess, runs_of, wrapped
from gcs.comparison import flown
from gcs.logs import Window, resolve_runs
from sysid.checks import fit_checks
from sysid.compare import Comparison, compare
from sysid.diagnose import SURE, Diagnosis, Judged, diagnose
from sysid.effect import Effect, catalogue
from sysid.evidence import settle
from sysid.explain import Explanation, explain
from sysid.hiding import Hiding, could_hide
from sysid.identify import identify, on_runs
from sysid.maneuvers import NextManeuver, linear_or_not, next_maneuver
from sysid.model import Model
from sysid.noise import divide
from sysid.record import Record
from sysid.result import Fit, RecordUsed
from sysid.structures import compose
from sysid.suggest import Suggestion, SuggestionError, suggest

MOST_RUNGS = 6
SHOWN, DRAWN = 6, 12
"""Candidates in the table, and in the picture."""
WORSE_POINTS = 0.2
"""NRMSE on validation runs, by which an effect must change them to count."""
AGREEING = 1.5
"""Standard errors, rms, that parameters of sets of runs may differ by."""

Band = tuple[float, float]
Progress = Callable[[str], None]


def flown_with_validation(
    fit: Fit, runs: Sequence[str], validate: Sequence[str], profile: Path | None, window: Window | None
) -> tuple[list[Record], list[Record], list[Record]]:
    """Runs to fit, runs that only judge, and quiet hover; the fit's own where none are named.

    Raises TippathError where a log is gone, changed or holds nothing usable.
    """
    records, quiet = flown(fit, runs, profile, window)
    if validate:
        own = None if fit.profile is None else Path(fit.profile)
        judging = resolve_runs(validate, profile or own, window, f_high_hz=fit.band_hz[1])
    elif runs:
        judging = []
    else:
        judging = runs_of(fit, fit.validation)
    judging = [record for record in judging if record.maneuver != "quiet"]
    taken = {(record.path, record.id) for record in judging}
    return [record for record in records if (record.path, record.id) not in taken], judging, quiet


@dataclass(frozen=True)
class Step:
    """One rung of the ladder."""

    effects: tuple[str, ...]
    nrmse_percent: dict[str, float]
    validation_nrmse_percent: dict[str, float] | None
    verdict: str | None
    """What was said of it; None where it was not asked."""
    effect: str | None
    confidence: float | None

    def to_json(self) -> dict[str, Any]:
        return {
            "effects": list(self.effects),
            "nrmse_percent": self.nrmse_percent,
            "validation_nrmse_percent": self.validation_nrmse_percent,
            "verdict": self.verdict,
            "effect": self.effect,
            "confidence": self.confidence,
        }


@dataclass(frozen=True, eq=False)
class FitDiagnosis:
    """A diagnosis with all that is told beside it."""

    fit: Fit
    """The fit that the last question was about."""
    records: tuple[Record, ...]
    last: Diagnosis
    comparison: Comparison
    """Of the last fit with its runs: where it fails."""
    rungs: tuple[Step, ...]
    added: Fit | None
    """With the winner, where one is missing."""
    explanation: Explanation
    hiding: Hiding
    next: NextManeuver | None
    suggestion: Suggestion | None
    """The simple terms that explain most beside the structure, where something is left; asked for only."""
    remarks: tuple[str, ...] = field(default=())

    def to_json(self) -> dict[str, Any]:
        return {
            **self.last.to_json(),
            "character": {
                "findings": list(self.comparison.findings),
                "bands": [one.to_json() for one in self.comparison.bands],
                "growth": [one.to_json() for one in self.comparison.growth],
                "controls": {name: dict(shares) for name, shares in self.comparison.controls.items()},
            },
            "explanation": self.explanation.to_json(),
            "could_hide": self.hiding.to_json(),
            "next_maneuver": None if self.next is None else self.next.to_json(),
            "terms": [
                {"equation": term.entry.equation, "error_share": term.error_share, "as_well": len(term.as_well)}
                for term in (() if self.last.terms is None else self.last.terms.terms)
            ],
            "suspicions": [one.to_json() for one in self.comparison.suspicions],
            "structure": {"base": self.fit.model.structure.base, "effects": list(self.fit.model.structure.effects)},
            "rungs": [one.to_json() for one in self.rungs],
            "remarks": list(self.remarks),
        }

    def fit_json(self, folder: Path) -> dict[str, Any] | None:
        """The fit with what was found added, as `tippath add` would write it; None where nothing was."""
        found = self.added or (self.fit if len(self.rungs) > 1 else None)
        if found is None:
            return None
        return {**found.to_json(folder), **assess(found, self.records).to_json()}


def refitted(
    fit: Fit,
    effects: Sequence[str | Effect],
    records: Sequence[Record],
    validation: Sequence[Record],
    band_hz: Band | None = None,
    *,
    grown: Fit | None = None,
    begin: Model | None = None,
) -> Fit:
    """The fit's base with these effects on these runs, what the fit held held again; the rest as `identify` has it."""
    held = {name: fit.model[name] for name in fit.fixed}
    return identify(
        compose(fit.model.structure.base),
        records,
        validation,
        band_hz or fit.band_hz,
        effects=effects,
        fixed=held,
        profile=fit.profile,
        window_s=fit.window_s,
        grown=grown,
        begin=begin,
    )


def _made_from(fit: Fit, records: Sequence[Record], validation: Sequence[Record], band_hz: Band) -> bool:
    """Whether the fit was made from just these runs in this band."""

    def same(used: Sequence[RecordUsed], given: Sequence[Record]) -> bool:
        return {(one.id, one.sha256, one.samples) for one in used} == {
            (one.id, one.sha256, one.t.size) for one in given
        }

    return band_hz == fit.band_hz and same(fit.records, records) and same(fit.validation, validation)


def diagnose_fit(
    fit: Fit,
    records: Sequence[Record],
    validation: Sequence[Record] = (),
    quiet: Sequence[Record] = (),
    *,
    effects: Sequence[Effect] = (),
    band_hz: Band | None = None,
    repeat: bool = False,
    suggesting: bool = False,
    say: Progress = lambda _: None,
) -> FitDiagnosis:
    """Ask what a fit lacks; with `repeat`, add the answer and ask again until it is another one than `missing`.

    `effects` are a user's own, asked beside the catalogue's; `suggesting` looks for simple terms too. Raises SysidError
    where the runs do not identify the structure.
    """
    band = band_hz or fit.band_hz
    named = [*fit.model.structure.composed]
    if not _made_from(fit, records, validation, band):
        fit = refitted(fit, named, records, validation, band)
    rungs: list[Step] = []
    while True:
        structure = on_runs(fit.model.structure.base, named, [*records, *validation], records)
        held = {name: fit.model[name] for name in fit.fixed}
        found = diagnose(structure, records, validation, band, effects=effects, fixed=held, say=say)
        rungs.append(
            Step(
                structure.effects,
                found.parent.nrmse_percent,
                None if found.validation_nrmse_percent is None else dict(found.validation_nrmse_percent),
                found.verdict,
                found.effect,
                found.confidence,
            )
        )
        more = None
        if found.verdict == "missing" and found.effect is not None:
            begin = next(
                one.fit.model for one in found.candidates if one.effect == found.effect and one.fit is not None
            )
            more = refitted(
                fit,
                [*named, _effect(found.effect, effects)],
                records,
                validation,
                band,
                grown=fit,
                begin=begin,
            )
        if not repeat or more is None or len(rungs) >= MOST_RUNGS:
            return _told(fit, records, validation, quiet, found, rungs, more, effects, suggesting, say)
        say(f"added {found.effect}")
        fit, named = more, [*more.model.structure.composed]


def _told(
    fit: Fit,
    records: Sequence[Record],
    validation: Sequence[Record],
    quiet: Sequence[Record],
    found: Diagnosis,
    rungs: Sequence[Step],
    more: Fit | None,
    users: Sequence[Effect],
    suggesting: bool,
    say: Progress,
) -> FitDiagnosis:
    """What is said beside a verdict."""
    winner = found.winner
    say("where it fails")
    where = compare(found.parent.model, records, fit.band_hz, quiet)
    say("why")
    why = explain(found.parent, winner, found.candidates, found.indistinguishable, complete=found.verdict == "complete")
    say("what could hide")
    last = winner.fit if found.verdict == "missing" and winner is not None and winner.fit is not None else found.parent
    hidden = could_hide(last, settle(last, found.metric), found.metric, found.division, users)
    say("what would tell")
    suggestion = None
    if suggesting:
        with contextlib.suppress(SuggestionError):
            words = " + ".join(
                [fit.model.structure.base.upper(), *(Path(one).name for one in fit.model.structure.effects)]
            )
            suggestion = suggest(found.simple().terms, words, len(records))
    return FitDiagnosis(
        fit,
        tuple(records),
        found,
        where,
        tuple(rungs),
        more,
        why,
        hidden,
        _next(found),
        suggestion,
        _remarks(fit, records, validation),
    )


def _next(found: Diagnosis) -> NextManeuver | None:
    """Between the winner and what the data cannot tell from it, or the best two; for an unknown, linear or not."""
    winner = found.winner
    if found.verdict == "complete":
        return None
    if winner is None or winner.fit is None or (found.verdict == "unexplained" and not found.stands_in):
        return linear_or_not(found.parent, found.division)
    rivals = [one.fit for one in found.candidates if one.effect in found.indistinguishable and one.fit is not None]
    if not rivals and found.confidence < SURE and (second := found.runner_up) is not None and second.fit is not None:
        rivals = [second.fit]
    if not rivals:
        return None
    on = found.parent.ground
    division = divide(winner.fit.estimate.error, on.stacks, on.causes)
    return next_maneuver([winner.fit, *rivals], division, found.metric)


def _remarks(fit: Fit, records: Sequence[Record], validation: Sequence[Record]) -> tuple[str, ...]:
    """What these runs cost the answer."""
    said = []
    if not validation:
        said.append(
            "no validation runs: an effect that only follows the noise of these runs would not be found out; fly "
            "another maneuver or amplitude and name it with --validate"
        )
    if len(records) == 1:
        said.append("one run only: what differs from run to run cannot show")
    return tuple(said)


def _effect(name: str, users: Sequence[Effect]) -> Effect:
    known = catalogue()
    return known[name] if name in known else next(one for one in users if one.path == name)


# ------------------------------------------------------------------------------------------------ adding


@dataclass(frozen=True)
class Sign:
    """One of the three signs that an effect is really there, and not only another way to follow the data."""

    name: str
    seen: bool | None
    """None where these runs cannot show it."""
    text: str

    def to_json(self) -> dict[str, Any]:
        return {"name": self.name, "seen": self.seen, "text": self.text}


@dataclass(frozen=True, eq=False)
class Addition:
    """A fit with an effect added, beside the one without and beside the best wrong effect."""

    before: Fit
    after: Fit
    records: tuple[Record, ...]
    noise_floor_percent: dict[str, float]
    placebo: Judged | None
    signs: tuple[Sign, ...]

    @property
    def effect(self) -> str:
        return next(one for one in self.after.model.structure.effects if one not in self.before.model.structure.effects)

    def to_json(self, folder: Path) -> dict[str, Any]:
        """The fit's document with what the ladder shows."""
        return {
            **self.after.to_json(folder),
            **assess(self.after, self.records).to_json(),
            "noise_floor_percent": self.noise_floor_percent,
            "placebo": None if self.placebo is None else self.placebo.to_json(),
            "signs": [one.to_json() for one in self.signs],
        }


def add_effect(
    fit: Fit,
    effect: Effect,
    records: Sequence[Record],
    validation: Sequence[Record] = (),
    *,
    band_hz: Band | None = None,
    say: Progress = lambda _: None,
) -> Addition:
    """Refit with one effect more, and look for the signs that it is the right one.

    Raises EffectError where it cannot act on these runs, FitError where they do not determine it.
    """
    composed = [*fit.model.structure.composed]
    band = band_hz or fit.band_hz
    before = fit if _made_from(fit, records, validation, band) else refitted(fit, composed, records, validation, band)
    say("the structure as it is")
    after = refitted(fit, [*composed, effect], records, validation, band, grown=before)
    say(effect.id)
    structure = on_runs(fit.model.structure.base, composed, [*records, *validation], records)
    held = {name: fit.model[name] for name in fit.fixed}
    users = [] if effect.path is None else [effect]
    asked = diagnose(structure, records, validation, band, effects=users, fixed=held, say=say, chains=False)
    name = effect.path or effect.id
    signs = (_validated(before, after), _agrees(before, after, records), _plausible(after, effect))
    floor = {key: float(value) for key, value in asked.noise_floor_percent.items()}
    return Addition(before, after, tuple(records), floor, asked.placebo_of(name), signs)


def _validated(before: Fit, after: Fit) -> Sign:
    name = "error falls on runs that were not fitted"
    was, now = before.validation_nrmse_percent, after.validation_nrmse_percent
    if was is None or now is None:
        return Sign(name, None, "no validation runs: an error that falls on fitted runs alone proves little")
    change = {axis: now[axis] - was[axis] for axis in now}
    text = ", ".join(f"{axis} {was[axis]:.1f} → {now[axis]:.1f} %" for axis in now)
    return Sign(name, min(change.values()) > -WORSE_POINTS and max(change.values()) > WORSE_POINTS, text)


def _agrees(before: Fit, after: Fit, records: Sequence[Record]) -> Sign:
    """The base's parameters, fitted to sets of runs apart, come nearer to each other."""
    name = "runs agree better on the parameters"
    spreads = [fit_checks(one.model, records, one.band_hz, one.fixed)[1] for one in (before, after)]
    was, now = spreads
    if was is None or now is None:
        return Sign(name, None, "needs two chirps on each axis: fly each twice")
    shared = set(before.model.structure.names)
    first = {name: times for name, times in was.moves if name in shared}
    second = {name: times for name, times in now.moves if name in shared}
    both = sorted(set(first) & set(second))
    if not both:
        return Sign(name, None, "no parameter is free in every set of runs")
    rms = [math.sqrt(sum(one[key] ** 2 for key in both) / len(both)) for one in (first, second)]
    text = f"they differ by {rms[0]:.1f} σ without it, by {rms[1]:.1f} σ with it (rms)"
    return Sign(name, rms[1] < rms[0] or rms[1] < AGREEING, text)


def _plausible(after: Fit, effect: Effect) -> Sign:
    name = "its size is physically plausible"
    model = after.model
    own = [one for one in model.structure.composed if one.id == effect.id]
    parameters = own[0].parameters if own else model.structure.parameters
    said, good = [], True
    for one in parameters:
        value = model[one.name]
        low, high = one.plausible
        good &= not one.implausible(value)
        if one.implausible(value):
            said.append(f"{one.name} = {value:.4g} {one.unit} is outside {low:g} to {high:g}")
        else:
            said.append(f"{one.name} = {value:.4g} {one.unit}")
    return Sign(name, good, ", ".join(said))


def ladder_of(found: Addition) -> tuple[list[tuple[str, Any, Any]], dict[str, float]]:
    """Rungs and noise floor, as pictures and tables want them."""
    names = rung_names(found.after.model.structure.base, [one.effects for one in found.after.lineage])
    rungs = [
        (name, one.nrmse_percent, one.validation_nrmse_percent)
        for name, one in zip(names, found.after.lineage, strict=True)
    ]
    return rungs, found.noise_floor_percent


def drawn(found: FitDiagnosis) -> Any:
    """The picture of a diagnosis: what each candidate explains, and the residual before and with the best."""
    from gcs.pictures import diagnosis_picture

    last = found.last
    bars: list[tuple[str, float | None, str]] = []
    for one in (*last.pairs[:1], *last.candidates):
        if one.fit is not None and len(bars) < DRAWN:
            note = "implausible: " + ", ".join(one.implausible) if one.implausible else ""
            bars.append((" + ".join(Path(name).name for name in one.effects), one.explained_share, note))
    winner = last.winner
    best = None if winner is None or winner.fit is None else compare(winner.fit.model, found.records, found.fit.band_hz)
    label = " + ".join(Path(name).name for name in last.chain)
    return diagnosis_picture(
        bars, found.comparison.densities, None if best is None else best.densities, f"with {label}"
    )
