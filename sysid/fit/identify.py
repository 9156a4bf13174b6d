"""From records to a fit: several runs together, effect after effect, validated on others, with words for the user."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.dataset import Bins, Dataset, Runs, means, moves, prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ, RESPONSE, Spectrum
from sysid.data.record import AXIS_OF, COMMANDS, CYCLIC, RATES, Record
from sysid.errors import FitError
from sysid.fit.checks import explain_instability, explain_poverty
from sysid.fit.clocks import found_hold, shared_error
from sysid.fit.estimate import Estimate, Weights, estimate, lacks
from sysid.fit.feedback import refuse_feedback_alone
from sysid.fit.growth import answered
from sysid.fit.identifiable import structural, vague
from sysid.fit.output_error import OutputError, output_error
from sysid.fit.prediction_error import prediction_error
from sysid.fit.result import Fit, RecordUsed, Rung
from sysid.fit.stable import Settled, settle
from sysid.model.airframe import misfits
from sysid.model.base import Base, bases
from sysid.model.compose import compose
from sysid.model.effect import Effect, EffectError
from sysid.model.structure import Model, Structure

LARGE_TILT = 5.0  # rad of flapping per full command
LOST = 0.01  # of the rates at the band's upper end, by interpolating: less is not worth a word


def identify(
    structure: Structure,
    records: Runs,
    validation: Runs = (),
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    *,
    effects: Sequence[str | Effect] = (),
    fixed: Mapping[str, float] | None = None,
    profile: str | None = None,
    window_s: tuple[float | None, float | None] | None = None,
    grown: Fit | None = None,
    begin: Model | None = None,
    weights: Weights = "residual spectrum",
) -> Fit:
    """Fit a bare base with effects to all runs together; validation runs only judge.

    Effects are added one by one in the order named, each fit beginning at the one before; the steps are the fit's
    lineage; one that the runs do not identify is left out. `fixed` parameters are held at their values. `profile` and
    `window_s` say how the records were cut from their logs and are kept with the fit. `grown` is the fit of all
    effects but the last on the same records, which need not be made again; `begin` a model of the whole composition to
    begin at. `weights` are over frequency: by the spectrum of what is left, or constant, as the paper's. Raises
    FitError where an axis is not identifiable, EffectError where an effect cannot act on these runs; the message says
    which and what to do.

    Where no log tells the vehicle's loop and the runs show that it held commands for less than a sample, they are
    fitted so; the fit's records say how long, and its errors know how surely.
    """
    fitted, judging = prepared(records, band_hz), prepared(validation, band_hz)
    _refuse_unfit(structure, fitted, judging)
    if grown is not None and fitted.found_loop_s is None:
        fitted, judging = fitted.held(grown.found_loop_s), judging.held(grown.found_loop_s)
    climb = _Climb(structure, effects, fixed or {}, weights, grown)
    step, rungs = climb.to_the_top(fitted, judging, begin)
    hold = found_hold(step.found.model, fitted, fixed, climb.again)
    if hold is not None:
        as_held = fitted.held(hold.loop_s), judging.held(hold.loop_s)
        with contextlib.suppress(FitError):  # what the runs determine by a whole sample alone stays so
            step, rungs = climb.to_the_top(*as_held, hold.near)
            fitted, judging = as_held
    shared = shared_error(step.found.model, fitted, fixed)
    return Fit(
        model=step.found.model,
        covariance=step.found.covariance if shared is None else step.found.covariance + shared,
        nrmse_percent=rungs[-1].nrmse_percent,
        validation_nrmse_percent=rungs[-1].validation_nrmse_percent,
        records=tuple(RecordUsed.of(record, band_hz[1]) for record in fitted.records),
        validation=tuple(RecordUsed.of(record, band_hz[1]) for record in judging.records),
        band_hz=band_hz,
        warnings=tuple(dict.fromkeys([*_held_for(fitted), *step.warnings(fitted)])),
        profile=profile,
        window_s=window_s,
        at_bound=step.found.at_bound,
        fixed=tuple(fixed or ()),
        lineage=tuple(rungs),
        weights=step.found.weights,
        instrument=step.found.instrument,
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Climb:
    """A bare base, and effects to add one by one."""

    structure: Structure
    effects: Sequence[str | Effect]
    fixed: Mapping[str, float]
    weights: Weights
    grown: Fit | None

    def to_the_top(self, fitted: Dataset, judging: Dataset, begin: Model | None) -> tuple[_Step, list[Rung]]:
        """The fit of all effects and the rungs on the way. Raises as `identify`."""
        structure, effects, grown = self.structure, self.effects, self.grown
        rungs: list[Rung] = [] if grown is None else [*grown.lineage]
        parent: Model | None = None if grown is None or grown.model.structure.base != structure.base else grown.model
        for count in range(0 if grown is None else len(effects), len(effects) + 1):
            last = count == len(effects)
            here = begin if last and begin is not None else parent
            try:
                everyone = [*fitted.records, *judging.records]
                composed = on_runs(structure.base_, effects[:count], everyone, fitted.records, structure.outputs)
                held = {name: value for name, value in self.fixed.items() if last or name in composed.names}
                step = _Step.of(composed, fitted, judging, held=held, begin=here, weights=self.weights, last=last)
            except (EffectError, FitError):
                if last:
                    raise
                continue  # it needs an effect named after it, or its numbers: what is asked for is judged as asked for
            parent = step.found.model
            rungs.append(step.rung)
        return step, rungs

    def again(self, runs: Dataset, near: Model) -> Model:
        """The composition of a fit fitted to these runs, from there."""
        bins = runs.viewed(near.structure.inputs, near.structure.outputs)
        return estimate(near.structure, bins, near, self.fixed, self.weights).model


def _refuse_unfit(structure: Structure, fitted: Dataset, judging: Dataset) -> None:
    """Raises FitError where there is nothing that could be fitted."""
    refuse_mixed_sources([*fitted.records, *judging.records])
    low_hz, high_hz = fitted.band_hz
    if not 0 <= low_hz < high_hz:
        raise FitError(f"the band {low_hz:g}:{high_hz:g} Hz is empty")
    if not fitted.records:
        raise FitError("no run to fit")
    refuse_unlogged(structure, [*fitted.records, *judging.records])
    refuse_unmeasured_responses(structure, [*fitted.records, *judging.records])
    if not fitted.pieces:
        raise FitError("no run has 2 s of gap-free samples: nothing to fit")


@dataclass(frozen=True, eq=False)
class _Step:
    """One fit on the way from the bare base to the last effect."""

    settled: Settled
    fitted: Bins
    rung: Rung
    remarks: list[str]

    @classmethod
    def of(
        cls,
        composed: Structure,
        runs: Dataset,
        judging: Dataset,
        *,
        held: Mapping[str, float],
        begin: Model | None,
        weights: Weights,
        last: bool,
    ) -> _Step:
        fitted = runs.viewed(composed.inputs, composed.outputs)
        open_to_all = structural(composed, held) if composed.composed else None
        if open_to_all is not None:
            raise FitError(open_to_all)
        if begin is not None and begin.structure.base != composed.base:
            begin = None  # cylinder dynamics know nothing of flapping
        refuse_feedback_alone(composed, fitted)
        found = estimate(composed, fitted, begin, held, weights)
        if last and weights != "constant" and found.instrument == "commands":
            found = prediction_error(found, fitted, held) or found
        settled = settle(found, fitted, held, weights) if last else Settled(found)
        found = settled.estimate
        validated: Mapping[str, float] | None = None
        if judging.records:
            if not judging.pieces:
                raise FitError("no validation run has 2 s of gap-free samples")
            validation = judging.viewed(composed.inputs, composed.outputs)
            validated = by_output(composed, output_error(found.model, validation.stacks))
        remarks = [*runs.remarks, *judging.remarks]
        return cls(settled, fitted, Rung(composed.effects, by_output(composed, found.error), validated), remarks)

    @property
    def found(self) -> Estimate:
        return self.settled.estimate

    def warnings(self, runs: Dataset) -> list[str]:
        """What the user should know of this fit."""
        model = self.found.model
        explained = (
            explain_poverty(model, self.found.error.nrmse_percent, self.fitted)
            if model.stable
            else explain_instability(self.settled, self.fitted)
        )
        return [
            *misfits(model.structure, runs.airframe),
            *self.remarks,
            *_resampling(self.fitted.spectra),
            *_suspicious_signs(self.found),
            *explained,
            *_held_stable(self.settled),
            *_vague_axis(self.found, self.fitted),
            *_vague_directions(self.found),
            *_missing_sweeps(runs.records, model.structure),
            *_failed_validation(self.rung.validation_nrmse_percent, self.found),
        ]


def on_runs(
    base: str | Base,
    effects: Sequence[str | Effect],
    records: Sequence[Record],
    fitted: Sequence[Record],
    outputs: Sequence[str] | None = None,
) -> Structure:
    """The composition that these runs allow: with the channels all have, and the fitted runs' mean condition.

    A command that stands still on the fitted runs is left out where an effect can read another in its place.
    """
    available = set.intersection(*(set(record.channels) for record in records))
    still = {name for name in COMMANDS if name in available and not moves(name, fitted)}
    found: Structure | None = None
    if still:
        with contextlib.suppress(EffectError):
            found = compose(base, effects, available - still, means(fitted), outputs=outputs)
    found = found or compose(base, effects, available, means(fitted), outputs=outputs)
    beyond = [effect.id for effect in found.composed if beyond_responses(effect, records)]
    if beyond:
        raise EffectError(f"{', '.join(beyond)} cannot act here: a measured frequency response is linear; fit the runs")
    return found


def beyond_responses(effect: Effect, records: Sequence[Record]) -> bool:
    """Whether an effect is none of linear dynamics, and a run is a measured response, which tells only of those."""
    linear = effect.linear and effect.samples is None
    return not linear and any(record.maneuver == RESPONSE for record in records)


def judge(model: Model, runs: Runs, band_hz: tuple[float, float] = DEFAULT_BAND_HZ) -> dict[str, float]:
    """NRMSE by output of a model on runs; only trims and end states are estimated."""
    on = prepared(runs, band_hz)
    refuse_unlogged(model.structure, on.records)
    if not on.pieces:
        raise FitError("no run has 2 s of gap-free samples: nothing to judge by")
    return by_output(
        model.structure, output_error(model, on.viewed(model.structure.inputs, model.structure.outputs).stacks)
    )


def by_output(structure: Structure, error: OutputError) -> dict[str, float]:
    return {name: float(x) for name, x in zip(structure.outputs, error.nrmse_percent, strict=True)}


def refuse_unlogged(structure: Structure, records: Sequence[Record]) -> None:
    """Raises FitError where a run lacks what the base is measured or driven by."""
    for record in records:
        lacking = [name for name in (*structure.outputs, *structure.base_.commands) if name not in record.channels]
        if lacking:
            raise FitError(
                f"{record.id}: {', '.join(lacking)} is not logged, which {structure.base_.label} with the outputs "
                f"{', '.join(structure.outputs)} needs; fit runs that have it, or measure less"
            )


def refuse_unmeasured_responses(structure: Structure, records: Sequence[Record]) -> None:
    """Raises FitError where a run is a frequency response that holds not all that the base is measured by."""
    for record in records:
        if record.maneuver != RESPONSE:
            continue
        lacking = [name for name in structure.outputs if not np.any(record.channels[name])]
        if lacking:
            alone = [
                base.name
                for base in bases().values()
                if all(np.any(record.channels.get(name, 0.0)) for name in base.outputs)
            ]
            able = f"--model {alone[0]} fits what it holds" if alone else "no base is measured by what it holds"
            raise FitError(f"{record.id}: the response of {', '.join(lacking)} is not in it; {able}")


def refuse_mixed_sources(records: Sequence[Record]) -> None:
    """p and q of all runs of one fit come from the same kind of message: two kinds differ in their filters."""
    sources = sorted({record.rate_source for record in records})
    if len(sources) > 1:
        raise FitError(
            f"the runs take p and q from different messages ({', '.join(sources)}), which differ by milliseconds; "
            "fit runs of one kind together"
        )


def _held_for(runs: Dataset) -> list[str]:
    """That the runs are fitted as a loop held commands that nobody told of."""
    loop_s = runs.found_loop_s
    if loop_s is None:
        return []
    return [
        "no log tells the rate of the vehicle's loop, and commands act earlier than if held from sample to sample: "
        f"they are taken as held for {1000 * loop_s:.2g} ms, as these runs show; --loop-rate, or loop_rate_hz in a "
        "profile, says it surely"
    ]


def _held_stable(settled: Settled) -> list[str]:
    if settled.moved is None:
        return []
    real, error = settled.moved
    return [
        f"its pole at {real:+.2f} ± {error:.2g} 1/s is held stable: the data do not say that it is not, and rates "
        "alone seldom are unstable"
    ]


def _vague_axis(found: Estimate, bins: Bins) -> list[str]:
    """Asked of the fit as it ended: where noise is predicted too, errors are others than those that were let pass."""
    if found.vague is None or not lacks(found, bins):
        return []
    return [
        f"{found.vague.known}, and the excitation explains more than the model does: it lacks an effect; tippath "
        "diagnose asks which"
    ]


def _vague_directions(found: Estimate) -> list[str]:
    """What these runs hardly determine, with the direction in which the numbers may move together."""
    return [
        f"these runs do not determine {direction.moves[0][0]} (practical: too little power at this noise): "
        f"one standard error moves {direction}; fly longer or harder there, or hold it with --fix"
        for direction in vague(found.model.structure, found.model.values, found.covariance)
    ]


def _missing_sweeps(records: Sequence[Record], structure: Structure) -> list[str]:
    """An axis that no run swept is known only through what the controller or the pilot did there."""
    swept = {record.axis for record in records}
    if None in swept or any(record.maneuver == "unknown" for record in records):
        return []
    own = (*structure.base_.commands, "delta_e")  # others that an effect reads need no sweep
    missing = [AXIS_OF[name] for name in structure.commands if name in own and AXIS_OF.get(name, name) not in swept]
    return [
        f"no {axis} maneuver among the runs: what the {axis} command does is known only from the controller's "
        "reactions; add a run that sweeps it"
        for axis in missing
    ]


def _failed_validation(judged: Mapping[str, float] | None, found: Estimate) -> list[str]:
    if judged is None or min(judged.values()) > 0:
        return []
    said = "on the validation runs the model is worse than none at all: do not use it there"
    if found.instrument == "prediction error" and answered(found.model.structure, found.error):
        said += (
            "; its numbers are those that foretell best what is new in each sample, and where gusts are in the "
            "commands a simulation from these need not show it: log the excitation, and see"
        )
    return [said]


def _resampling(found: Sequence[Spectrum]) -> list[str]:
    """What irregular time stamps cost: rates are interpolated between samples, which makes their fastest part smaller.

    Half way between two samples by 1 - cos(pi f dt); a log fast beside the band pays next to nothing.
    """
    moved = sum(one.segment.resampled for one in found)
    total = sum(one.samples for one in found)
    lost = max((1 - np.cos(np.pi * min(0.5, one.frequency_hz[-1] * one.segment.dt)) for one in found), default=0.0)
    if moved * lost <= LOST * total:
        return []
    return [
        f"time stamps are irregular: {moved} of {total} samples lie beside a uniform clock, and to interpolate them "
        f"takes up to {100 * lost:.0f} % of the rates at the band's upper end: log faster, or fit a lower --band"
    ]


def _suspicious_signs(found: Estimate) -> list[str]:
    """Positive commands give positive steady rates by convention; a model that says otherwise met other signs."""
    said, model = [], found.model
    if model.stable and not model.structure.attitude_states:
        A, B, C, D = model.matrices
        steady = D - C @ np.linalg.solve(A, B)
        for command, rate in zip(CYCLIC, RATES, strict=True):
            known = command in model.structure.inputs and rate in model.structure.outputs
            if known and steady[model.structure.outputs.index(rate), model.structure.inputs.index(command)] < 0:
                said.append(
                    f"the steady {rate} answers {command} with the opposite sign: "
                    f"check the sign of {command} or of {rate} ({AXIS_OF[command]} axis)"
                )
    errors = np.sqrt(np.maximum(np.diag(found.covariance), 0))
    for parameter, value, error in zip(model.structure.parameters, model.values, errors, strict=True):
        if parameter.implausible(float(value), float(error)):
            low, high = parameter.plausible
            said.append(f"{parameter.name} = {value:.4g} is outside what physics allows ({low:g} to {high:g})")
    large = {
        one.name for one, value in zip(model.structure.parameters, model.values, strict=True) if value > LARGE_TILT
    }
    if {"A_lon", "B_lat"} <= large:
        said.append("both axes answer the cyclic tens of times too much: are p and q in degrees per second?")
    return said
