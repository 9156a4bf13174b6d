"""What is made of one log: its runs and their health, which vehicle, when, and a fit with its errors.

It depends on the log's bytes, the settings and this program's version, and on nothing else: so it is kept under the
digest of these, and nothing is worked out twice.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from gcs import documents
from gcs.analysis.axes import lone_axis, of_axes
from gcs.analysis.band import chosen_band
from gcs.analysis.fits import split_runs
from gcs.campaign.when import When, flown_at
from gcs.errors import TippathError
from gcs.logs import Ingest, ingest
from gcs.logs.cache import digest_of
from gcs.logs.formats.tables import Log
from gcs.logs.opening import open_log
from gcs.logs.runs.run import Run
from sysid.data.airframe import Airframe, agreed
from sysid.data.band import BandFrom, ChosenBand
from sysid.data.dataset import prepared
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.fit.identify import identify
from sysid.fit.model_error import with_model_errors
from sysid.fit.result import Fit
from sysid.model.base import find_base, on_axes
from sysid.model.compose import compose
from sysid.model.effect import find

Reason = Literal["cannot be read", "no run", "no usable run", "airframe not known", "cannot be fitted"]
BASE_OF: Mapping[Airframe, str] = {Airframe.HELICOPTER: "tpp", Airframe.MULTIROTOR: "multirotor"}
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


class Flown(documents.Open, frozen=True, kw_only=True):
    """One run that was found."""

    id: str
    maneuver: str
    axis: str | None
    duration_s: float
    usable: bool
    reasons: tuple[str, ...]


class Number(documents.Open, frozen=True, kw_only=True):
    """One free parameter."""

    value: float
    unit: str
    standard_error: float
    model_error: float
    """What the standard error does not know of; 0 where nothing showed. Of all flights it may be off the same way: it
    is for who reads a value, not for who compares flights."""


class Numbers(documents.Open, frozen=True, kw_only=True):
    """A log's fit."""

    structure: str
    """As `TPP + servo_lag`."""
    base: str
    effects: tuple[str, ...]
    parameters: dict[str, Number]
    covariance: tuple[tuple[float, ...], ...]
    """Of these parameters, in their order."""
    nrmse_percent: dict[str, float]
    validation_nrmse_percent: dict[str, float] | None
    band_hz: tuple[float, float]
    warnings: tuple[str, ...]


class Outcome(documents.Open, frozen=True, kw_only=True):
    """All that is kept of one log."""

    format: Literal["tippath.campaign_log/1"] = "tippath.campaign_log/1"
    key: str
    path: str
    sha256: str
    version: str
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
    """Digest of what its gyro saw: the same in two copies of a flight, however they were cut or stored."""
    fit: Numbers | None = None


def key_of(sha256: str, settings: Settings) -> str:
    """Under which the outcome of a log with these bytes is kept."""
    file = None if settings.profile is None else Path(settings.profile)
    profile = digest_of(file) if file is not None and file.is_file() else ""
    return hashlib.sha256(msgspec.json.encode([sha256, settings, profile, version("tippath")])).hexdigest()


def worked_on(path: Path, settings: Settings) -> Outcome:
    """What is made of a log; whatever is wrong with it is a reason. Raises OSError where it is not even a file."""
    began = time.perf_counter()
    sha256 = digest_of(path)
    blank = Outcome(
        key=key_of(sha256, settings), path=str(path), sha256=sha256, version=version("tippath"), settings=settings
    )
    found = _of_log(path, blank)
    return msgspec.structs.replace(found, seconds=round(time.perf_counter() - began, 3))


def _of_log(path: Path, blank: Outcome) -> Outcome:
    settings = blank.settings
    profile = None if settings.profile is None else Path(settings.profile)
    try:
        found = ingest([path], profile, f_high_hz=(settings.band_hz or (0.0, 15.0))[1])
    except TippathError as error:
        return _without(blank, "cannot be read", str(error))
    records = [run.record for run in found.usable if run.record is not None]
    airframe = agreed(record.airframe for record in records)
    known = msgspec.structs.replace(
        blank,
        when=flown_at(path, _first_log(path)),
        vehicle=_agreed([record.vehicle for record in records]),
        airframe=None if airframe is None else str(airframe),
        runs=tuple(_flown(run) for run in found.runs),
        conditions=_conditions(records),
        seen=_seen(records),
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
        return msgspec.structs.replace(known, fit=_numbers(_fitted(swept, model, settings)))
    except (TippathError, SysidError) as error:
        return _without(known, "cannot be fitted", str(error))


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
        duration_s=round(run.duration_s, 3),
        usable=run.usable,
        reasons=run.reasons,
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


def _fitted(records: Sequence[Record], model: str, settings: Settings) -> Fit:
    base = find_base(model)
    runs = of_axes(records, base)
    chirps, doublets = split_runs(runs)
    band = chosen_band(chirps) if settings.band_hz is None else ChosenBand(settings.band_hz, BandFrom.GIVEN)
    fitted, judging = prepared(chirps, band.hz), prepared(doublets, band.hz)
    axis = lone_axis(base, fitted)
    part, contained = on_axes(base, base.axes if axis is None else [axis])
    effects = [find(word) for word in (*contained, *settings.effects)]
    fit = identify(compose(part), fitted, judging, band.hz, effects=effects)
    return replace(with_model_errors(fit, fitted, judging), band_from=band.source)


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
        nrmse_percent=dict(fit.nrmse_percent),
        validation_nrmse_percent=(None if fit.validation_nrmse_percent is None else dict(fit.validation_nrmse_percent)),
        band_hz=fit.band_hz,
        warnings=fit.warnings,
    )
