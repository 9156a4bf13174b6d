"""A fit made again with other effects, on the same runs or on others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gcs.analysis.quantities import quantity
from sysid.data.band import BandFrom
from sysid.data.dataset import Dataset, Runs, prepared
from sysid.data.record import Record
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.clocks import same_hold
from sysid.fit.identify import identify, on_runs
from sysid.fit.model_error import with_model_errors
from sysid.fit.result import Fit, RecordUsed
from sysid.model.effect import Effect
from sysid.model.structure import Model

Band = tuple[float, float]


def refitted(
    fit: Fit,
    effects: Sequence[str | Effect],
    records: Runs,
    validation: Runs,
    band_hz: Band | None = None,
    *,
    grown: Fit | None = None,
    begin: Model | None = None,
) -> Fit:
    """The fit's base with these effects on these runs, what the fit held held again; the rest as `identify` has it."""
    band = band_hz or fit.band_hz
    fitted, judging = prepared(records, band), prepared(validation, band)
    held = {name: fit.model[name] for name in fit.fixed}
    structure, runs = fit.model.structure, [*fitted.records, *judging.records]
    composed = on_runs(structure.base_, effects, runs, fitted.records, structure.outputs)
    if begin is None and composed.base != structure.base:
        # flapping makes another base, whose parameters have no beginning in the old one
        own = [one for one in composed.composed if one.id != "flapping"]
        begin = identify(composed.bare, fitted, (), band, effects=own).model
    made = identify(
        structure.bare,
        fitted,
        judging,
        band,
        effects=effects,
        fixed=held,
        profile=fit.profile,
        window_s=fit.window_s,
        grown=grown,
        begin=begin,
    )
    made = with_model_errors(made, fitted, judging)
    return replace(made, band_from=fit.band_from if band == fit.band_hz else BandFrom.GIVEN)


def made_from(fit: Fit, fitted: Dataset, judging: Dataset) -> bool:
    """Whether the fit was made from just these runs in their band, held as they are where they were found to be."""

    def same(used: Sequence[RecordUsed], given: Sequence[Record]) -> bool:
        return {(one.id, one.sha256, one.samples) for one in used} == {
            (one.id, one.sha256, one.t.size) for one in given
        }

    held = fitted.found_loop_s is None or same_hold(fitted.found_loop_s, fit.found_loop_s)
    runs = same(fit.records, fitted.records) and same(fit.validation, judging.records)
    return held and runs and fitted.band_hz == fit.band_hz


def as_answered(answer: Diagnosis, fit: Fit, *runs: Dataset) -> list[Dataset]:
    """The runs of a fit as the diagnosis took their commands to be held, where that was otherwise than the fit did."""
    found = answer.parent.dataset.found_loop_s
    return [*runs] if same_hold(found, fit.found_loop_s) else [each.held(found) for each in runs]


def newly_implausible(before: Fit, after: Fit) -> tuple[str, ...]:
    """`k_l = -5` of what was plausible, or not there, before."""
    outside = {
        one.name
        for one, value in zip(before.model.structure.parameters, before.model.values, strict=True)
        if one.implausible(float(value))
    }
    wild = {*after.implausible} - outside
    return tuple(
        quantity(one, float(value))
        for one, value in zip(after.model.structure.parameters, after.model.values, strict=True)
        if one.name in wild
    )
