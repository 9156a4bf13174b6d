"""A fit that saves itself: the numbers, what they were made from, and how far to trust them.

The JSON is what other programs read (`tippath.fit/1`); keys are added, never changed.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar, get_args

import numpy as np

from sysid.data.airframe import Airframe, agreed
from sysid.data.band import BandFrom
from sysid.data.preprocess import gaps, rate_hz
from sysid.data.record import BY_THE_RUNS, Record
from sysid.document import converted, parsed
from sysid.fit.document import FitDocument, ParameterDocument, RecordDocument
from sysid.fit.estimate import Instrument, Weights
from sysid.fit.identifiable import undetermined
from sysid.fit.saved_model import ResultError, effect_names, relative, structure_json, structure_of
from sysid.model.effect import EffectError
from sysid.model.structure import FloatArray, Model, Structure

FORMAT = "tippath.fit/1"
HIGH_CORRELATION = 0.9
ROUNDING = 1e-6
"""Of correlations, in a saved fit."""
Kind = TypeVar("Kind", bound=enum.Enum)


@dataclass(frozen=True, kw_only=True)
class RecordUsed:
    """One run that entered the fit."""

    id: str
    path: str
    sha256: str
    maneuver: str
    axis: str | None
    duration_s: float
    samples: int
    rate_hz: float
    gaps: tuple[tuple[float, float], ...]
    airframe: Airframe | None = None
    loop_rate_hz: float | None = None
    """As the run's record says; None where it does not."""
    loop_told_by: str = ""

    @classmethod
    def of(cls, record: Record, high_hz: float) -> RecordUsed:
        found = gaps(record.t, high_hz)
        return cls(
            id=record.id,
            path=record.path,
            sha256=record.sha256,
            maneuver=record.maneuver,
            axis=record.axis,
            duration_s=record.duration_s,
            samples=record.t.size,
            rate_hz=rate_hz(record.t, found),
            gaps=found,
            airframe=record.airframe,
            loop_rate_hz=None if record.loop_dt_s is None else 1 / record.loop_dt_s,
            loop_told_by=record.loop_told_by,
        )


@dataclass(frozen=True)
class Rung:
    """One step from the bare base to the fitted structure."""

    effects: tuple[str, ...]
    nrmse_percent: Mapping[str, float]
    validation_nrmse_percent: Mapping[str, float] | None

    def to_json(self) -> dict[str, Any]:
        return {
            "effects": list(self.effects),
            "nrmse_percent": _nrmse_json(self.nrmse_percent),
            "validation_nrmse_percent": _nrmse_json(self.validation_nrmse_percent),
        }


@dataclass(frozen=True, kw_only=True)
class ModelError:
    """How far one parameter may be off because the model is not the vehicle: a standard deviation by each cause, in its
    unit."""

    clocks: float
    """Stamps of commands and rates, each off by up to half a period; the hold."""
    frequencies: float
    """What octaves of the band disagree about, beyond chance;"""
    runs: float
    """what runs do;"""
    validation: float
    """and how far validation runs would move it."""

    @property
    def total(self) -> float:
        return math.hypot(self.clocks, self.frequencies, self.runs, self.validation)


@dataclass(frozen=True, eq=False, kw_only=True)
class Fit:
    """A model fitted to runs."""

    model: Model
    covariance: FloatArray
    """(parameters, parameters), units of the parameters."""
    nrmse_percent: Mapping[str, float]
    """Eq. 10 by output on the fitted runs, in percent; 100 is perfect."""
    validation_nrmse_percent: Mapping[str, float] | None
    records: tuple[RecordUsed, ...]
    validation: tuple[RecordUsed, ...]
    band_hz: tuple[float, float]
    warnings: tuple[str, ...] = field(default=())
    profile: str | None = None
    """The log profile that named the channels, where one was given."""
    window_s: tuple[float | None, float | None] | None = None
    """The part of every run that was used, in the log's own time."""
    at_bound: tuple[str, ...] = ()
    """Parameters that ended on a hard bound; they have no standard error."""
    fixed: tuple[str, ...] = ()
    """Parameters that were held."""
    lineage: tuple[Rung, ...] = ()
    """From the first structure to this one."""
    band_from: BandFrom | None = None
    """Why the band is this; None where whoever fitted does not tell."""
    weights: Weights = "constant"
    """Over frequency: by the spectrum of what is left, or constant."""
    instrument: Instrument | None = None
    """What keeps feedback out of the values; None of a fit that was saved without it."""
    model_errors: Mapping[str, ModelError] = field(default_factory=dict)
    """Of free parameters, beside their standard errors; empty where nobody asked (`sysid.fit.model_error`)."""

    @property
    def airframe(self) -> Airframe | None:
        """What kind of rotorcraft the fitted runs are of, where log or user tell."""
        return agreed(one.airframe for one in self.records)

    @property
    def found_loop_s(self) -> float | None:
        """How long the loop held commands as the fitted runs showed, s; None where that was told, or not seen."""
        found = (one.loop_rate_hz for one in self.records if one.loop_told_by == BY_THE_RUNS)
        return next((1 / rate_hz for rate_hz in found if rate_hz is not None), None)

    @property
    def standard_errors(self) -> FloatArray:
        """(parameters,)"""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def insensitivity_percent(self) -> FloatArray:
        """(parameters,): how far each may move alone before the cost shows it, percent of its value."""
        free = np.flatnonzero(np.diag(self.covariance) > 0)
        found = np.zeros(self.model.values.size)
        information = np.linalg.inv(self.covariance[np.ix_(free, free)])
        found[free] = 100 / np.sqrt(np.diag(information)) / np.maximum(np.abs(self.model.values[free]), 1e-300)
        return found

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters whose standard error exceeds their own size: their values are not to be read as numbers."""
        return undetermined(self.model.structure, self.model.values, self.covariance)

    @property
    def implausible(self) -> tuple[str, ...]:
        """Parameters whose values physics does not allow, their standard errors counted in."""
        parameters = zip(self.model.structure.parameters, self.model.values, self.standard_errors, strict=True)
        return tuple(one.name for one, value, error in parameters if one.implausible(float(value), float(error)))

    @property
    def correlations(self) -> tuple[tuple[str, str, float], ...]:
        """Pairs of parameters whose estimates move together, above 0.9 in size, the closest first; else the closest.

        Empty where fewer than two parameters are free.
        """
        free = np.flatnonzero(np.diag(self.covariance) > 0)
        errors = self.standard_errors[free]
        correlation = self.covariance[np.ix_(free, free)] / np.outer(errors, errors)
        names = [self.model.structure.names[i] for i in free]
        pairs = sorted(
            (
                (names[i], names[j], float(np.clip(correlation[i, j], -1, 1)))
                for i in range(len(names))
                for j in range(i + 1, len(names))
            ),
            key=lambda pair: -abs(pair[2]),
        )
        close = [pair for pair in pairs if abs(pair[2]) > HIGH_CORRELATION]
        return tuple(close or pairs[:1])

    @property
    def stable(self) -> bool:
        return self.model.stable

    def to_json(self, relative_to: Path) -> dict[str, Any]:
        """The `tippath.fit/1` document; paths relative to the directory it will stand in."""
        from importlib.metadata import version  # 15 ms, for this one number

        structure, matrices = self.model.structure, self.model.matrices
        return {
            "format": FORMAT,
            "structure": structure_json(structure, relative_to),
            "parameters": self._parameters_json(),
            "modes": [
                {"frequency_hz": finite(mode.frequency_hz), "damping_ratio": finite(mode.damping_ratio)}
                for mode in self.model.modes
            ],
            "stable": self.stable,
            "nrmse_percent": _nrmse_json(self.nrmse_percent),
            "validation_nrmse_percent": _nrmse_json(self.validation_nrmse_percent),
            "records": [_record_json(one, relative_to) for one in self.records],
            "validation_records": [_record_json(one, relative_to) for one in self.validation],
            "lineage": [rung.to_json() for rung in self.lineage],
            "outside_matrices": effect_names(structure.outside_matrices, relative_to),
            "matrices": {
                **{name: np.asarray(getattr(matrices, name)).tolist() for name in "ABCD"},
                "input_delay_s": list(self.model.input_delay_s),
            },
            "covariance": [[finite(x) for x in row] for row in self.covariance],
            "correlations": [
                {"parameters": [one, other], "correlation": finite(value)} for one, other, value in self.correlations
            ],
            "band_hz": list(self.band_hz),
            "band_from": self.band_from,
            "airframe": self.airframe,
            "weights": self.weights,
            "instrument": self.instrument,
            "profile": self.profile,
            "window_s": None if self.window_s is None else list(self.window_s),
            "warnings": list(self.warnings),
            "version": version("tippath"),
        }

    def _parameters_json(self) -> dict[str, dict[str, Any]]:
        """By name; those at a bound or held have no error."""
        vague, wild, found = self.undetermined, self.implausible, {}
        for parameter, value, error, insensitivity in zip(
            self.model.structure.parameters,
            self.model.values,
            self.standard_errors,
            self.insensitivity_percent,
            strict=True,
        ):
            name = parameter.name
            estimated = name not in self.at_bound and name not in self.fixed
            found[name] = {
                "value": float(value),
                "unit": parameter.unit,
                "standard_error": finite(error) if estimated else None,
                "cramer_rao_percent": finite(100 * error / abs(value)) if estimated and value else None,
                "insensitivity_percent": finite(insensitivity) if estimated else None,
                "at_bound": name in self.at_bound,
                "implausible": name in wild,
                "fixed": name in self.fixed,
                "determined": name not in vague,
                **_model_error_json(self.model_errors.get(name)),
            }
        return found

    @classmethod
    def from_json(cls, document: Any, directory: Path, named: Sequence[str] = ()) -> Fit:
        """Read what `to_json` wrote; record paths become usable from here. Raises ResultError.

        A user's base or effect is code: it runs only where its path is among `named`, and only unchanged.
        """
        try:
            if document["format"] != FORMAT:
                raise ResultError(f"not a {FORMAT} document but {str(document['format'])[:40]!r}")
            saved = converted(document, FitDocument)
            return cls._of(saved, directory, named)
        except ResultError:
            raise
        except EffectError as error:
            raise ResultError(f"its structure cannot be composed: {error}") from error
        except (KeyError, TypeError, ValueError) as error:
            raise ResultError(f"not a {FORMAT} document ({error or type(error).__name__})") from error

    @classmethod
    def _of(cls, saved: FitDocument, directory: Path, named: Sequence[str]) -> Fit:
        """Raises ResultError, EffectError, or ValueError for numbers that are none."""
        structure = structure_of(saved.structure, directory, named)
        later = _declared_later(structure, saved.parameters)
        values, covariance = _numbers(structure, saved, later)
        low_hz, high_hz = saved.band_hz
        if not 0 <= low_hz < high_hz:
            raise ResultError(f"a band of {low_hz:g} to {high_hz:g} Hz is none")
        return cls(
            model=Model(structure, values),
            covariance=covariance,
            nrmse_percent=_by_output(saved.nrmse_percent),
            validation_nrmse_percent=_by_output_or_none(saved.validation_nrmse_percent),
            records=tuple(_record_from(one, directory) for one in saved.records),
            validation=tuple(_record_from(one, directory) for one in saved.validation_records),
            band_hz=saved.band_hz,
            band_from=_kind_or_none(BandFrom, saved.band_from),
            warnings=saved.warnings,
            profile=saved.profile,
            window_s=saved.window_s,
            at_bound=tuple(name for name, one in saved.parameters.items() if one.at_bound),
            fixed=(*(name for name, one in saved.parameters.items() if one.fixed), *later),
            lineage=tuple(
                Rung(one.effects, _by_output(one.nrmse_percent), _by_output_or_none(one.validation_nrmse_percent))
                for one in saved.lineage
            ),
            model_errors=_model_errors(saved.parameters),
            weights="residual spectrum" if saved.weights == "residual spectrum" else "constant",
            instrument=_instrument(saved.instrument),
        )

    @classmethod
    def load(cls, path: Path, named: Sequence[str] = ()) -> Fit:
        """Raises ResultError for a file that is not a fit, OSError for one that cannot be read."""
        try:
            document = parsed(path)
        except ValueError as error:
            raise ResultError(f"{path}: not JSON ({error})") from error
        try:
            return cls.from_json(document, path.parent, named)
        except ResultError as error:
            raise ResultError(f"{path}: {error}") from error


def _instrument(word: str | None) -> Instrument | None:
    return next((one for one in get_args(Instrument) if one == word), None)


def _model_error_json(one: ModelError | None) -> dict[str, Any]:
    if one is None:
        return {"model_error": None}
    return {"model_error": finite(one.total), "model_error_by": {name: finite(x) for name, x in asdict(one).items()}}


def _model_errors(parameters: Mapping[str, ParameterDocument]) -> dict[str, ModelError]:
    """Of those that have one."""
    causes = [key.name for key in fields(ModelError)]
    return {
        name: ModelError(**{cause: _number(one.model_error_by[cause]) for cause in causes})
        for name, one in parameters.items()
        if one.model_error_by
    }


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def _by_output(values: Mapping[str, float | None]) -> dict[str, float]:
    return {name: _number(value) for name, value in values.items()}


def _by_output_or_none(values: Mapping[str, float | None] | None) -> dict[str, float] | None:
    return None if values is None else _by_output(values)


def _kind_or_none(kind: type[Kind], word: str | None) -> Kind | None:
    """A saved word as what it stands for. Raises ResultError for one that stands for nothing."""
    try:
        return None if word is None else kind(word)
    except ValueError as error:
        raise ResultError(str(error)) from error


def _declared_later(structure: Structure, said: Mapping[str, ParameterDocument]) -> dict[str, float]:
    """What effects of the catalogue have gained since a document was written: it was made with these at their nulls."""
    own = (parameter for effect in structure.composed if effect.path is None for parameter in effect.parameters)
    missing = ((one.name, one.null) for one in own if one.name not in said)
    return {name: null for name, null in missing if null is not None and math.isfinite(null)}


def _numbers(structure: Structure, saved: FitDocument, later: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Values (parameters,) and covariance (parameters, parameters) as they were saved. Raises ResultError."""
    if any(len(row) != len(saved.covariance) for row in saved.covariance):
        raise ResultError("its covariance is not square")
    values = structure.vector({**later, **{name: one.value for name, one in saved.parameters.items()}})
    covariance = np.array([[_number(x) for x in row] for row in saved.covariance], dtype=float)
    for place in (i for i, name in enumerate(structure.names) if name in later):
        covariance = np.insert(np.insert(covariance, place, 0.0, axis=0), place, 0.0, axis=1)
    if not np.all(np.isfinite(values)) or covariance.shape != (values.size, values.size):
        raise ResultError("parameters or covariance are not numbers of the right shape")
    size = np.sqrt(np.maximum(np.diag(covariance), 0))
    size[size == 0] = 1.0
    correlation = covariance / np.outer(size, size)
    if not (np.allclose(correlation, correlation.T) and np.min(np.linalg.eigvalsh(correlation)) > -ROUNDING):
        raise ResultError("its covariance is that of no errors")
    return values, covariance


def finite(x: float) -> float | None:
    """JSON has no NaN or Infinity."""
    return float(x) if math.isfinite(x) else None


def _nrmse_json(values: Mapping[str, float] | None) -> dict[str, float | None] | None:
    return None if values is None else {name: finite(x) for name, x in values.items()}


def _record_json(one: RecordUsed, directory: Path) -> dict[str, Any]:
    return {
        "id": one.id,
        "path": relative(one.path, directory),
        "sha256": one.sha256,
        "maneuver": one.maneuver,
        "axis": one.axis,
        "duration_s": one.duration_s,
        "samples": one.samples,
        "rate_hz": one.rate_hz,
        "gaps": [list(gap) for gap in one.gaps],
        "airframe": one.airframe,
        "loop_rate_hz": one.loop_rate_hz,
        "loop_told_by": one.loop_told_by,
    }


def _record_from(one: RecordDocument, directory: Path) -> RecordUsed:
    return RecordUsed(
        id=one.id,
        path=str(directory / one.path) if one.path else "",
        sha256=one.sha256,
        maneuver=one.maneuver,
        axis=one.axis,
        duration_s=one.duration_s,
        samples=one.samples,
        rate_hz=one.rate_hz,
        gaps=one.gaps,
        airframe=_kind_or_none(Airframe, one.airframe),
        loop_rate_hz=one.loop_rate_hz,
        loop_told_by=one.loop_told_by,
    )
