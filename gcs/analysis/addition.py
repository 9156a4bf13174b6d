"""An effect added to a fit, beside the fit without it and the best wrong effect; and whether it is really there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gcs.analysis.ladder import WORSE_POINTS, Nrmse, RungNumbers, change_text, rungs_of, short_names, together
from gcs.analysis.quantities import listed, quantity
from gcs.analysis.refit import Band, as_answered, made_from, newly_implausible, refitted
from sysid.data.dataset import Dataset, Runs, prepared
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.progress import Asking, Listener, Stage, unheard
from sysid.diagnose.verdict import Diagnosis
from sysid.errors import SysidError
from sysid.fit.checks import EIGENFREQUENCY, Check, Spread, fit_checks
from sysid.fit.identify import on_runs
from sysid.fit.result import Fit, finite
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter

AGREEING = 1.5
"""Standard errors, rms, that parameters of sets of runs may differ by."""

NOTHING = 2.0
"""Standard errors from its null, up to which nothing of an effect is left."""

MOST_SAID = 4
"""New parameters that are told one by one."""


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


@dataclass(frozen=True, slots=True)
class Placebo:
    """The best wrong effect in the place of one that was added."""

    effects: tuple[str, ...]
    nrmse_percent: Nrmse
    validation_nrmse_percent: Nrmse | None
    document: Mapping[str, Any] | None = None
    """As a candidate of the diagnosis; None of one that was kept."""

    @classmethod
    def of(cls, one: Ranked, made: Fit) -> Placebo:
        """A candidate as it was fitted in the effect's place."""
        errors = dict(zip(made.model.structure.names, map(float, made.standard_errors), strict=True))
        judged = made.validation_nrmse_percent
        numbers = {
            "nrmse_percent": made.nrmse_percent,
            "validation_nrmse_percent": None if judged is None else dict(judged),
            "parameters": {name: finite(made.model[name]) for name in one.values},
            "standard_errors": {name: finite(errors[name]) for name in one.values},
        }
        return cls(one.effects, made.nrmse_percent, judged, {**one.to_json(), **numbers})


@dataclass(frozen=True, eq=False, kw_only=True)
class Addition:
    """A fit with an effect added, beside the one without and beside the best wrong effect."""

    named: str
    """The effect: catalogue id, or path of a user's file."""
    before: Fit
    after: Fit
    runs: Dataset
    """Those that were fitted."""
    noise_floor_percent: dict[str, float]
    checks: tuple[Check, ...]
    """The eigenfrequency check of the grown fit."""
    placebo: Placebo | None
    signs: tuple[Sign, ...]

    @property
    def placebo_rung(self) -> RungNumbers | None:
        """The placebo as a rung of the ladder."""
        wrong = self.placebo
        if wrong is None:
            return None
        return " + ".join(short_names(wrong.effects)), wrong.nrmse_percent, wrong.validation_nrmse_percent


def add_effect(
    fit: Fit,
    effect: Effect,
    records: Runs,
    validation: Runs = (),
    *,
    band_hz: Band | None = None,
    asked: Diagnosis | None = None,
    say: Listener = unheard,
) -> Addition:
    """Refit with one effect more, and look for the signs that it is the right one.

    `asked` is a diagnosis of this fit on these runs: where it has the effect, the catalogue is not asked again.
    Raises EffectError where the effect cannot act on these runs, FitError where they do not determine it.
    """
    composed = [*fit.model.structure.composed]
    band = band_hz or fit.band_hz
    fitted, judging = prepared(records, band), prepared(validation, band)
    before = fit if made_from(fit, fitted, judging) else refitted(fit, composed, fitted, judging, band)
    name = effect.path or effect.id
    say(Asking(stage=Stage.REFITS, effects=(name,)))
    after = refitted(fit, [*composed, effect], fitted, judging, band, grown=before)
    if before is not fit or asked is None or not any(one.effects == (name,) for one in asked.candidates):
        runs = [*fitted.records, *judging.records]
        structure = on_runs(fit.model.structure.base_, composed, runs, fitted.records, fit.model.structure.outputs)
        held = {name: fit.model[name] for name in fit.fixed}
        users = [] if effect.path is None else [effect]
        asked = diagnose(
            structure, fitted, judging, band, effects=users, fixed=held, begin=before.model, say=say, chains=False
        )
    fitted, judging = as_answered(asked, before, fitted, judging)
    if not made_from(before, fitted, judging):
        before = refitted(before, composed, fitted, judging, band)
        after = refitted(before, [*composed, effect], fitted, judging, band, grown=before)
    (_, apart), (checks, closer) = (
        fit_checks(one.model, fitted.held(one.found_loop_s), one.band_hz, one.fixed, one.weights)
        for one in (before, after)
    )
    return Addition(
        named=name,
        before=before,
        after=after,
        runs=fitted,
        noise_floor_percent={key: float(value) for key, value in asked.noise_floor_percent.items()},
        checks=checks[:EIGENFREQUENCY],
        placebo=_in_its_place(asked.placebo_of(name), before, fitted, judging),
        signs=(_validated(before, after), _agrees(before, after, apart, closer), _plausible(before, after)),
    )


def _in_its_place(wrong: Ranked | None, before: Fit, fitted: Dataset, judging: Dataset) -> Placebo | None:
    """The best wrong effect fitted as the right one is, in the fit's weights; None where it cannot be."""
    if wrong is None or wrong.fit is None:
        return None
    effects = [*before.model.structure.composed, *wrong.own]
    try:
        made = refitted(before, effects, fitted, judging, before.band_hz, grown=before, begin=wrong.fit.model)
    except SysidError:
        return None
    return Placebo.of(wrong, made)


def _validated(before: Fit, after: Fit) -> Sign:
    key, name = "validation", "error falls on runs that were not fitted"
    was, now = before.validation_nrmse_percent, after.validation_nrmse_percent
    if was is None or now is None:
        return Sign(key, name, None, "there are none; an error that falls on fitted runs alone proves little")
    text = f"{change_text(was, now)}{_counted_from(after)}"
    return Sign(key, name, together(now) - together(was) > WORSE_POINTS, text)


def _counted_from(after: Fit) -> str:
    """What the change is counted from, where that is not the lowest rung; and what that one reached."""
    below = rungs_of(after.model.structure.base_, after.lineage)[:-1]
    if len(below) < 2:
        return ""
    (lowest, _, first), (last, _, _) = below[0], below[-1]
    if first is None:
        return f", from the rung {last}"
    reached = ", ".join(f"{output} {value:.1f}" for output, value in first.items())
    return f", from the rung {last}; {lowest} had {reached} %"


def _agrees(before: Fit, after: Fit, was: Spread | None, now: Spread | None) -> Sign:
    """The base's parameters, fitted to sets of runs apart, come nearer to each other."""
    key, name = "agreement", "runs agree better on the parameters"
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
    wild = newly_implausible(before, after)
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
