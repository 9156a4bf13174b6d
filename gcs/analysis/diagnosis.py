"""A fit is asked what it lacks, and effects are added to it: the verdict, what it stands on, the ladder of rungs.

The mathematics is `sysid.diagnose.diagnose`; here runs are read again, effects are added one after the other, and what
else is to be said is brought together. `gcs.analysis.diagnosis_text` puts it into words. Both serve the command line
and the app.

A repeated question stops where the answer, added, takes the fit to values that physics does not allow: what is asked
of such a fit is answered about the wrong vehicle.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gcs.analysis.comparison import flown
from gcs.analysis.fits import assess, runs_of
from gcs.errors import TippathError
from gcs.logs import Window, resolve_runs
from sysid.compare.compare import compare
from sysid.compare.values import Comparison
from sysid.data.record import Record
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.could_hide import could_hide
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import instrumental_step
from sysid.diagnose.explain import Explanation, explain
from sysid.diagnose.hidden import CouldHide
from sysid.diagnose.next_maneuver import NextManeuver, linear_or_not, next_maneuver
from sysid.diagnose.quantities import listed, quantity
from sysid.diagnose.suggest import Suggestion, SuggestionError, suggest
from sysid.diagnose.verdict import EXPLAINED, SURE, Diagnosis
from sysid.fit.checks import fit_checks
from sysid.fit.identify import identify, on_runs
from sysid.fit.result import Fit, RecordUsed
from sysid.model.bases import compose
from sysid.model.effect import Effect, catalogue
from sysid.model.parameter import Parameter
from sysid.model.structure import Model

MOST_RUNGS = 6
DRAWN = 12
"""Candidates in the picture."""
MOST_SAID = 4
"""New parameters that are told one by one."""
LEAST_SHARE = 0.005
"""Explained share that rounds to more than 0 %: less is not shown."""
WORSE_POINTS = 0.2
"""NRMSE on validation runs, by which an effect must change them to count."""
AGREEING = 1.5
"""Standard errors, rms, that parameters of sets of runs may differ by."""
NOTHING = 2.0
"""Standard errors from its null, up to which nothing of an effect is left."""

Band = tuple[float, float]
Progress = Callable[[str], None]


def flown_with_validation(
    fit: Fit, runs: Sequence[str], validate: Sequence[str], profile: Path | None, window: Window | None
) -> tuple[list[Record], list[Record], list[Record]]:
    """Runs to fit, runs that only judge, and quiet hover; the fit's own where none are named.

    Raises TippathError where a log is gone, changed or holds nothing usable, and where every run validates.
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
    taken = {(Path(record.path).resolve(), record.id) for record in judging}
    fitted = [record for record in records if (Path(record.path).resolve(), record.id) not in taken]
    if not fitted:
        raise TippathError(
            "no run is left to fit: every one validates; leave at least a roll and a pitch chirp to the fit"
            if judging
            else "no run to fit: quiet hover shows the noise only"
        )
    return fitted, judging, quiet


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
    hiding: CouldHide
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
    composed = on_runs(fit.model.structure.base, effects, [*records, *validation], records)
    if begin is None and composed.base != fit.model.structure.base:
        # flapping makes another base, whose parameters have no beginning in the old one
        own = [one for one in composed.composed if one.id != "flapping"]
        begin = identify(compose(composed.base), records, (), band_hz or fit.band_hz, effects=own).model
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
        found = diagnose(structure, records, validation, band, effects=effects, fixed=held, begin=fit.model, say=say)
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
        more: Fit | None = None
        wild: tuple[str, ...] = ()
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
            wild = _newly_implausible(fit, more)
        if not repeat or more is None or wild or len(rungs) >= MOST_RUNGS:
            remarks = [*_remarks(records, validation), *_in_a_loop(found)]
            if repeat and more is not None:
                if wild:
                    remarks.append(
                        f"not added: with {found.effect} the fit goes to {listed(wild)}, which physics does not allow"
                    )
                    more = None
                else:
                    remarks.append(f"stopped after {MOST_RUNGS} questions")
            return _told(fit, records, validation, quiet, found, rungs, more, effects, suggesting, remarks, say)
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
    remarks: Sequence[str],
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
    hidden = could_hide(last, instrumental_step(last, found.whitening), found.whitening, found.division, users)
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
        tuple(remarks),
    )


def _newly_implausible(before: Fit, after: Fit) -> tuple[str, ...]:
    """`k_l = -5` of what was plausible, or not there, before."""
    known = {
        one.name
        for one, value in zip(before.model.structure.parameters, before.model.values, strict=True)
        if one.implausible(float(value))
    }
    return tuple(
        quantity(one, float(value))
        for one, value in zip(after.model.structure.parameters, after.model.values, strict=True)
        if one.implausible(float(value)) and one.name not in known
    )


def _next(found: Diagnosis) -> NextManeuver | None:
    """Between the winner and what the data cannot tell from it, or the best two; for an unknown, linear or not."""
    winner = found.winner
    if found.verdict == "complete":
        return None
    if winner is None or winner.fit is None or (found.verdict == "unexplained" and not found.stands_in):
        return linear_or_not(found.parent, found.division)
    others = found.candidates if len(found.chain) == 1 else found.pairs
    rivals = [one.fit for one in others if set(one.effects) & {*found.indistinguishable} and one.fit is not None]
    if not rivals and (second := rival(found)) is not None and second.fit is not None:
        rivals = [second.fit]
    if not rivals:
        return None
    return next_maneuver([winner.fit, *rivals], winner.fit.division, found.whitening)


def rival(found: Diagnosis) -> Ranked | None:
    """The next effect, where the answer is not sure and that one explains nearly as much."""
    winner, second = found.winner, found.runner_up
    if winner is None or second is None or (found.verdict == "missing" and found.confidence >= SURE):
        return None
    near = (second.explained_share or 0.0) >= EXPLAINED * (winner.explained_share or 0.0)
    return second if near else None


def _remarks(records: Sequence[Record], validation: Sequence[Record]) -> tuple[str, ...]:
    """What these runs cost the answer."""
    said = []
    if not validation:
        said.append("no validation runs: whether it holds on others is open; name some with --validate")
    if len(records) == 1:
        said.append("one run only: what differs from run to run cannot show")
    return tuple(said)


def _in_a_loop(found: Diagnosis) -> tuple[str, ...]:
    """That feedback, and not the vehicle alone, made these data, where the best model is unstable."""
    winner = found.winner
    model = found.parent.model if winner is None or winner.fit is None else winner.fit.model
    if model.stable:
        return ()
    pole = max(pole.real for pole in np.linalg.eigvals(model.matrices.A))
    named = "" if winner is None else f" with {listed(winner.effects)}"
    return (
        f"the model{named} is unstable (pole at {pole:+.1f} 1/s): so data look that were flown through a pilot or "
        "controller without excitation of their own. Kind and size of what was found hold only as far as that loop "
        "lets them: fly a chirp with noise on every axis, with the excitation logged, and ask that",
    )


def _effect(name: str, users: Sequence[Effect]) -> Effect:
    known = catalogue()
    return known[name] if name in known else next(one for one in users if one.path == name)


# ------------------------------------------------------------------------------------------------ adding


@dataclass(frozen=True)
class Sign:
    """One of the three signs that an effect is really there, and not only another way to follow the data."""

    key: str
    """`validation`, `agreement` or `plausible`."""
    name: str
    seen: bool | None
    """None where these runs cannot show it."""
    text: str

    def to_json(self) -> dict[str, Any]:
        return {"key": self.key, "name": self.name, "seen": self.seen, "text": self.text}


@dataclass(frozen=True, eq=False)
class Addition:
    """A fit with an effect added, beside the one without and beside the best wrong effect."""

    named: str
    """The effect: catalogue id, or path of a user's file."""
    before: Fit
    after: Fit
    records: tuple[Record, ...]
    noise_floor_percent: dict[str, float]
    placebo: Ranked | None
    signs: tuple[Sign, ...]

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
    asked = diagnose(
        structure, records, validation, band, effects=users, fixed=held, begin=before.model, say=say, chains=False
    )
    name = effect.path or effect.id
    signs = (_validated(before, after), _agrees(before, after, records), _plausible(before, after))
    floor = {key: float(value) for key, value in asked.noise_floor_percent.items()}
    return Addition(name, before, after, tuple(records), floor, asked.placebo_of(name), signs)


def _validated(before: Fit, after: Fit) -> Sign:
    key, name = "validation", "error falls on runs that were not fitted"
    was, now = before.validation_nrmse_percent, after.validation_nrmse_percent
    if was is None or now is None:
        return Sign(key, name, None, "there are none; an error that falls on fitted runs alone proves little")
    text = ", ".join(f"{axis} {was[axis]:.1f} → {now[axis]:.1f} %" for axis in now)
    return Sign(key, name, together(now) - together(was) > WORSE_POINTS, text)


def together(nrmse_percent: Mapping[str, float]) -> float:
    """NRMSE fit in percent of all outputs as one: error shares are added over axes, as the diagnosis adds them."""
    shares = [(1 - value / 100) ** 2 for value in nrmse_percent.values()]
    return 100 * (1 - math.sqrt(sum(shares) / len(shares)))


def _agrees(before: Fit, after: Fit, records: Sequence[Record]) -> Sign:
    """The base's parameters, fitted to sets of runs apart, come nearer to each other."""
    key, name = "agreement", "runs agree better on the parameters"
    spreads = [fit_checks(one.model, records, one.band_hz, one.fixed)[1] for one in (before, after)]
    was, now = spreads
    if was is None or now is None:
        return Sign(key, name, None, "needs two chirps on each axis: fly each twice")
    shared = set(before.model.structure.names)
    first = {name: times for name, times in was.moves if name in shared}
    second = {name: times for name, times in now.moves if name in shared}
    both = sorted(set(first) & set(second))
    if not both:
        return Sign(key, name, None, "no parameter is free in every set of runs")
    rms = [math.sqrt(sum(one[key] ** 2 for key in both) / len(both)) for one in (first, second)]
    text = f"they differ by {rms[0]:.1f} σ without it, by {rms[1]:.1f} σ with it (rms)"
    if max(rms) < AGREEING:
        return Sign(key, name, None, f"{text}: they agree either way")
    return Sign(key, name, rms[1] < rms[0], text)


def _plausible(before: Fit, after: Fit) -> Sign:
    """What it added, and what it did to the rest: an effect that drives another value beyond physics is no answer."""
    key, name = "plausible", "its size is physically plausible"
    errors = dict(zip(after.model.structure.names, after.standard_errors, strict=True))
    new = [one for one in after.model.structure.parameters if one.name not in before.model.structure.names]
    wild = _newly_implausible(before, after)
    if wild:
        return Sign(key, name, False, f"physics does not allow {listed(wild)}")
    said = [quantity(one, after.model[one.name], float(errors[one.name])) for one in new]
    nulls = [one for one in new if one.null is not None]
    if nulls and all(_at_null(one, after.model[one.name], float(errors[one.name])) for one in nulls):
        return Sign(key, name, None, f"nothing of it is left: {', '.join(said)}")
    if new and all(one.name in after.undetermined for one in new):
        return Sign(key, name, None, f"these runs do not determine it: {', '.join(said)}")
    return Sign(key, name, True, ", ".join(said) if len(said) <= MOST_SAID else f"all {len(said)} values are")


def _at_null(one: Parameter, value: float, error: float) -> bool:
    assert one.null is not None
    if math.isinf(one.null):
        return math.isinf(value)
    return abs(value - one.null) <= NOTHING * error


def rung_names(base: str, effects: Sequence[Sequence[str]]) -> list[str]:
    """What each rung added. `flapping` turns CD into TPP, and leaves no effect behind to be named by."""
    from_cd = len(effects) > 1 and len(effects[0]) == len(effects[1])
    found = ["CD" if from_cd else base.upper(), *(["+ flapping"] if from_cd else [])]
    for before, now in itertools.pairwise(effects[len(found) - 1 :]):
        found.append("+ " + ", ".join(Path(one).name for one in now if one not in before))
    if effects and effects[0]:
        found[0] += "".join(f" + {Path(one).name}" for one in effects[0])
    return found


def ladder_of(found: Addition) -> tuple[list[tuple[str, Any, Any]], dict[str, float]]:
    """Rungs and noise floor, as pictures and tables want them."""
    names = rung_names(found.after.model.structure.base, [one.effects for one in found.after.lineage])
    rungs = [
        (name, one.nrmse_percent, one.validation_nrmse_percent)
        for name, one in zip(names, found.after.lineage, strict=True)
    ]
    return rungs, found.noise_floor_percent


def placebo_of(found: Addition) -> tuple[str, Any, Any] | None:
    """The placebo as a rung."""
    wrong = found.placebo
    if wrong is None or wrong.fit is None:
        return None
    return " + ".join(Path(one).name for one in wrong.effects), wrong.fit.nrmse_percent, wrong.validation_nrmse_percent


def drawn(found: FitDiagnosis) -> Any:
    """The picture of a diagnosis: what each candidate explains, and the residual before and with the best."""
    from gcs.analysis.pictures import diagnosis_picture

    last = found.last
    bars: list[tuple[str, float | None, str]] = []
    asked = sorted(
        (one for one in (*last.pairs[:1], *last.candidates) if one.fit is not None),
        key=lambda one: (one is not last.winner, one.delta_bic),
    )
    for one in asked[:DRAWN]:
        if one is last.winner or (one.explained_share or 0.0) >= LEAST_SHARE:
            note = "implausible: " + ", ".join(one.implausible) if one.implausible else ""
            bars.append((" + ".join(Path(name).name for name in one.effects), one.explained_share, note))
    winner = last.winner
    best = None if winner is None or winner.fit is None else compare(winner.fit.model, found.records, found.fit.band_hz)
    label = " + ".join(Path(name).name for name in last.chain)
    answer = label if last.verdict == "missing" else f"{label} stands in" if last.stands_in else ""
    head = f"{last.verdict}{f': {answer}' if answer else ''}, confidence {last.confidence:.2f}"
    return diagnosis_picture(
        bars,
        found.comparison.densities,
        None if best is None or last.verdict == "complete" else best.densities,
        f"with {label}",
        title=f"{head}{'; candidates, the answer first' if bars else ''}",
    )
