"""What is made of one log: its runs and their health, which vehicle, when, and a fit with its errors.

It depends on the log's bytes, the settings and this program's version, and on nothing else: so it is kept under the
digest of these, and nothing is worked out twice.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from gcs import documents
from gcs.analysis.axes import lone_axis, of_axes
from gcs.analysis.band import chosen_band
from gcs.analysis.fits import split_runs
from gcs.campaign.identity import contents, program, sketch
from gcs.campaign.when import When, by_satellites
from gcs.errors import TippathError
from gcs.logs import Ingest, ingest
from gcs.logs.cache import digest_of
from gcs.logs.formats.tables import Log
from gcs.logs.opening import open_log
from gcs.logs.runs.run import Run
from sysid.data.airframe import Airframe, agreed
from sysid.data.band import USUAL, BandFrom, ChosenBand
from sysid.data.dataset import Dataset, prepared
from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.errors import SysidError
from sysid.fit.identify import identify, judge
from sysid.fit.model_error import with_model_errors
from sysid.fit.result import Fit
from sysid.fit.saved_model import model_json, model_of
from sysid.model.base import find_base, on_axes
from sysid.model.compose import compose
from sysid.model.effect import find

Reason = Literal["cannot be read", "no run", "no usable run", "airframe not known", "cannot be fitted"]
BASE_OF: Mapping[Airframe, str] = {Airframe.HELICOPTER: "tpp", Airframe.MULTIROTOR: "multirotor"}
ROOT = Path(Path.cwd().anchor)
CONDITIONS = ("omega", "airspeed")
"""Channels whose means over the fitted runs are kept."""


class Settings(documents.Open, frozen=True, kw_only=True):
    """What is asked of every log."""

    model: str | None = None
    """A base; None for that of the airframe that the log tells."""
    effects: tuple[str, ...] = ()
    band_hz: tuple[float, float] | None = None
    profile: str | None = None
    """Name of a bundled one, or a file."""
    diagnose: bool = False
    """Whether each fit is asked what it lacks."""


class Follows(documents.Open, frozen=True, kw_only=True):
    """Where an axis of a run follows its command."""

    low_hz: float
    high_hz: float
    share: float
    """Of the command's band; 0 where it follows nowhere."""


class Flown(documents.Open, frozen=True, kw_only=True):
    """One run that was found, with its health."""

    id: str
    maneuver: str
    axis: str | None
    start_s: float
    duration_s: float
    usable: bool
    reasons: tuple[str, ...]
    rate_hz: float | None
    gaps: int
    gaps_s: float
    jitter: float | None
    saturated_share: float
    """Of the samples at full command, on the axis that has most."""
    follows: dict[str, Follows]
    """Axis -> its coherence with the command; excited axes only."""


class Number(documents.Open, frozen=True, kw_only=True):
    """One free parameter."""

    value: float
    unit: str
    standard_error: float
    model_error: float
    """What the standard error does not know of; 0 where nothing showed. Of all flights it may be off the same way: it
    is for who reads a value, not for who compares flights."""


class AtBound(documents.Open, frozen=True, kw_only=True):
    """A parameter that a fit let go no farther: it has no error."""

    value: float
    unit: str


class Numbers(documents.Open, frozen=True, kw_only=True):
    """A log's fit."""

    structure: str
    """As `TPP + servo_lag`."""
    base: str
    effects: tuple[str, ...]
    parameters: dict[str, Number]
    covariance: tuple[tuple[float, ...], ...]
    """Of these parameters, in their order."""
    at_bound: dict[str, AtBound] = {}
    """Parameters that ended at a bound, as a delay at 0."""
    nrmse_percent: dict[str, float]
    validation_nrmse_percent: dict[str, float] | None
    band_hz: tuple[float, float]
    warnings: tuple[str, ...]
    model: dict[str, Any]
    """The whole model, as `sysid.fit.saved_model` reads it; paths from the root."""


class Verdict(documents.Open, frozen=True, kw_only=True):
    """What the fit was found to lack, as `tippath diagnose` says it."""

    verdict: str
    effect: str | None
    stands_in: bool
    indistinguishable: tuple[str, ...]
    indistinguishable_pairs: tuple[str, ...] = ()
    """Each as `transport_delay + dynamic_inflow`."""
    confidence: float
    explained_share: float | None


class Predicted(documents.Open, frozen=True, kw_only=True):
    """How well another flight's model predicts this one: only trims and end states are estimated."""

    key: str
    by: str
    """Key of the other's outcome."""
    version: str
    nrmse_percent: dict[str, float] | None
    """None where it cannot be judged;"""
    words: str = ""
    """which is why."""


class Outcome(documents.Open, frozen=True, kw_only=True):
    """All that is kept of one log."""

    format: Literal["tippath.campaign_log/1"] = "tippath.campaign_log/1"
    key: str
    path: str
    sha256: str
    """Of the log, with what is read beside it."""
    version: str
    """As `gcs.campaign.identity.program`."""
    settings: Settings
    seconds: float = 0.0
    reason: Reason | None = None
    """Why there is no fit; None where there is one."""
    words: str = ""
    """The reason in full."""
    when: When | None = None
    vehicle: dict[str, str] = {}
    """What the log says of it and how it was set up."""
    airframe: str | None = None
    runs: tuple[Flown, ...] = ()
    conditions: dict[str, float] = {}
    """Means over the fitted runs of what was logged of `CONDITIONS`, SI."""
    seen: str = ""
    """Digest of what its gyro saw: the same in two copies of a flight, whatever they were stored in."""
    sketch: tuple[int, ...] = ()
    """Of the same: what copies that were cut share some of, see `gcs.campaign.identity`."""
    fit: Numbers | None = None
    verdict: Verdict | None = None
    """None where nothing was asked, or it could not be answered."""
    predicted: Predicted | None = None
    """By the fit of another flight of its group; not kept with it, for it depends on that as well."""


def key_of(sha256: str, settings: Settings) -> str:
    """Under which the outcome of a log with these contents is kept."""
    words = (settings.profile, settings.model, *settings.effects)
    files = [digest_of(Path(word)) for word in words if word is not None and Path(word).is_file()]
    return hashlib.sha256(msgspec.json.encode([sha256, settings, files, program()])).hexdigest()


def worked_on(path: Path, settings: Settings) -> Outcome:
    """What is made of a log; whatever is wrong with it is a reason. Raises OSError where it is not even a file."""
    began = time.perf_counter()
    sha256 = contents(path)
    blank = Outcome(key=key_of(sha256, settings), path=str(path), sha256=sha256, version=program(), settings=settings)
    found = _of_log(path, blank)
    return msgspec.structs.replace(found, seconds=round(time.perf_counter() - began, 3))


def _of_log(path: Path, blank: Outcome) -> Outcome:
    settings = blank.settings
    try:
        found = read_runs(path, settings)
    except TippathError as error:
        return _without(blank, "cannot be read", str(error))
    records = [run.record for run in found.usable if run.record is not None]
    airframe = agreed(record.airframe for record in records)
    known = msgspec.structs.replace(
        blank,
        when=by_satellites(_first_log(path)),
        vehicle=_agreed([record.vehicle for record in records]),
        airframe=None if airframe is None else str(airframe),
        runs=tuple(_flown(run) for run in found.runs),
        conditions=_conditions(records),
        seen=_seen(records),
        sketch=sketch([record.channels["p"] for record in records]),
    )
    swept = [record for record in records if record.maneuver != "quiet"]
    if not found.runs:
        return _without(known, "no run", "no maneuver was found in it")
    if not swept:
        return _without(known, "no usable run", _why_not(found))
    model = settings.model or (None if airframe is None else BASE_OF[airframe])
    if model is None:
        words = "the log does not say whether a helicopter or a multirotor flew; give --model"
        return _without(known, "airframe not known", words)
    try:
        fit, fitted, judging = _fitted(swept, model, settings)
    except (TippathError, SysidError) as error:
        return _without(known, "cannot be fitted", str(error))
    verdict = _verdict(fit, fitted, judging) if settings.diagnose else None
    return msgspec.structs.replace(known, fit=_numbers(fit), verdict=verdict)


def predicted_on(path: Path, of: Outcome, by: Outcome) -> Predicted:
    """How well the model of one flight predicts what was fitted of another, in that one's band."""
    assert of.fit is not None
    assert by.fit is not None
    blank = Predicted(key=prediction_key(of, by), by=by.key, version=program(), nrmse_percent=None)
    own_files = [word for word in (of.settings.model, *of.settings.effects) if word is not None]
    try:
        model = model_of(by.fit.model, ROOT, own_files)
        records = [run.record for run in read_runs(path, of.settings).usable if run.record is not None]
        runs = of_axes([one for one in records if one.maneuver != "quiet"], model.structure.base_)
        nrmse = judge(model, prepared(split_runs(runs)[0], of.fit.band_hz), of.fit.band_hz)
    except (TippathError, SysidError) as error:
        return msgspec.structs.replace(blank, words=str(error))
    return msgspec.structs.replace(blank, nrmse_percent=nrmse)


def prediction_key(of: Outcome, by: Outcome) -> str:
    """Under which `predicted_on` is kept: both outcomes' keys hold all that it depends on."""
    return hashlib.sha256(f"{of.key} by {by.key}".encode()).hexdigest()


def read_runs(path: Path, settings: Settings) -> Ingest:
    """A log's runs. Raises TippathError."""
    profile = None if settings.profile is None else Path(settings.profile)
    return ingest([path], profile, f_high_hz=(settings.band_hz or USUAL.hz)[1])


def _without(outcome: Outcome, reason: Reason, words: str) -> Outcome:
    return msgspec.structs.replace(outcome, reason=reason, words=words)


def _first_log(path: Path) -> Log | None:
    try:
        return next(iter(open_log(path, None).boots), None)
    except (TippathError, OSError):
        return None


def _flown(run: Run) -> Flown:
    return Flown(
        id=run.id,
        maneuver=run.maneuver,
        axis=run.axis,
        start_s=round(run.start_s, 3),
        duration_s=round(run.duration_s, 3),
        usable=run.usable,
        reasons=run.reasons,
        rate_hz=run.rate_hz,
        gaps=len(run.gaps),
        gaps_s=round(sum(stop - start for start, stop in run.gaps), 3),
        jitter=None if run.health is None else run.health.jitter,
        saturated_share=0.0 if run.health is None else max(run.health.saturated_share.values(), default=0.0),
        follows={
            axis: Follows(low_hz=one.low_hz, high_hz=one.high_hz, share=one.share)
            for axis, one in (() if run.health is None else run.health.coherent.items())
        },
    )


def _why_not(found: Ingest) -> str:
    return "; ".join(sorted({reason for run in found.runs for reason in run.reasons})) or "quiet hover only"


def _agreed(each: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """What all runs' logs say alike."""
    first = dict(each[0]) if each else {}
    return {name: word for name, word in first.items() if all(one.get(name, word) == word for one in each)}


def _conditions(records: Sequence[Record]) -> dict[str, float]:
    logged = {
        name: np.concatenate([one.channels[name] for one in records if name in one.channels])
        for name in CONDITIONS
        if any(name in one.channels for one in records)
    }
    return {name: float(np.nanmean(values)) for name, values in logged.items() if np.isfinite(values).any()}


def _seen(records: Sequence[Record]) -> str:
    digest = hashlib.sha256()
    for record in records:
        digest.update(np.round(record.channels["p"], 5).tobytes())
    return digest.hexdigest() if records else ""


def _fitted(records: Sequence[Record], model: str, settings: Settings) -> tuple[Fit, Dataset, Dataset]:
    base = find_base(model)
    runs = of_axes(records, base)
    chirps, doublets = split_runs(runs)
    band = chosen_band(chirps) if settings.band_hz is None else ChosenBand(settings.band_hz, BandFrom.GIVEN)
    fitted, judging = prepared(chirps, band.hz), prepared(doublets, band.hz)
    axis = lone_axis(base, fitted)
    part, contained = on_axes(base, base.axes if axis is None else [axis])
    effects = [find(word) for word in (*contained, *settings.effects)]
    fit = identify(compose(part), fitted, judging, band.hz, effects=effects)
    return replace(with_model_errors(fit, fitted, judging), band_from=band.source), fitted, judging


def _verdict(fit: Fit, fitted: Dataset, judging: Dataset) -> Verdict | None:
    try:
        answer = diagnose(fit.model.structure, fitted, judging, fit.band_hz, begin=fit.model)
    except SysidError:
        return None
    return Verdict(
        verdict=answer.verdict,
        effect=answer.effect,
        stands_in=answer.stands_in,
        indistinguishable=answer.indistinguishable,
        indistinguishable_pairs=tuple(map(" + ".join, answer.indistinguishable_pairs)),
        confidence=answer.confidence,
        explained_share=answer.explained_share,
    )


def _numbers(fit: Fit) -> Numbers:
    structure = fit.model.structure
    places = [place for place in range(len(structure.names)) if fit.covariance[place, place] > 0]
    parameters = {}
    for place in places:
        one = structure.parameters[place]
        more = fit.model_errors.get(one.name)
        parameters[one.name] = Number(
            value=float(fit.model.values[place]),
            unit=one.unit,
            standard_error=float(fit.covariance[place, place] ** 0.5),
            model_error=0.0 if more is None else more.total,
        )
    return Numbers(
        structure=structure.title,
        base=structure.base,
        effects=tuple(effect.id for effect in structure.composed),
        parameters=parameters,
        covariance=tuple(tuple(float(v) for v in row) for row in fit.covariance[np.ix_(places, places)]),
        at_bound={
            one.name: AtBound(value=float(value), unit=one.unit)
            for one, value in zip(structure.parameters, fit.model.values, strict=True)
            if one.name in fit.at_bound
        },
        nrmse_percent=dict(fit.nrmse_percent),
        validation_nrmse_percent=(None if fit.validation_nrmse_percent is None else dict(fit.validation_nrmse_percent)),
        band_hz=fit.band_hz,
        warnings=fit.warnings,
        model=model_json(fit.model, ROOT),
    )
