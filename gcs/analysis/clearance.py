"""Are gains cleared: judged when they are designed, and again, by the same function, before they are pushed.

A GAINS.json carries the models that its gains were judged on, with the uncertainty of the fit; the judgement in it is
for people, and nobody who pushes believes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from gcs import documents
from gcs.analysis.standing import NOT_ASKED, Standing, State
from gcs.flight.gains import LARGEST, GainsDocument, GainsError
from gcs.flight.identified import Identified
from gcs.vehicle.rate_loops import AXES, name_of
from sysid.control.bounds import SAMPLES, SEED, drawn, uncertainty
from sysid.control.command_noise import CommandNoise
from sysid.control.controllers import AnyGains
from sysid.control.judgement import ROLES, Judgement, Limits, Role, judge
from sysid.control.measured_margins import NOTHING_MEASURED, MeasuredMargins, measured_margins, with_model
from sysid.control.prefilter import DynamicPrefilter
from sysid.control.regulator import FORWARD, Gains
from sysid.control.sampled import RateController
from sysid.control.stability import COMMANDS, ClosedLoop
from sysid.errors import SysidError
from sysid.fit.result import Fit
from sysid.fit.saved_model import ModelDocument, model_json, saved_model
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import FloatArray, Model
from sysid.rate_loop.settings import AxisLoop
from sysid.response.values import Responses


@dataclass(frozen=True, eq=False, kw_only=True)
class Clearance:
    """What gains are worth, and on what that stands."""

    judgement: Judgement
    standing: Standing
    covariance: FloatArray | None
    """(parameters, parameters), of the first model's; None where it is not told."""

    @property
    def models(self) -> list[tuple[Role, Model]]:
        return [(one.role, one.model) for one in self.judgement.models]

    def to_json(self, folder: Path) -> dict[str, Any]:
        """What a design adds to its GAINS.json in a folder: `judged`, `diagnosis`, `judged_on`."""
        models = [{"role": role, "model": model_json(model, folder)} for role, model in self.models]
        covariance = None if self.covariance is None else self.covariance.tolist()
        return {
            "judged": self.judgement.to_json(),
            "diagnosis": self.standing.to_json(),
            "judged_on": {"models": models, "covariance": covariance},
        }


def gains_document(gains: Gains, cleared: Clearance, of: Identified, folder: Path) -> dict[str, Any]:
    """A GAINS.json in a folder: gains, what they are worth, and the vehicle that they are for."""
    return gains.to_json() | cleared.to_json(folder) | {"identified": of.to_json()}


RATE_GAINS = "tippath.rate_gains/1"
GAINS = {"P": "p", "I": "i", "D": "d", "FF": "ff"}
"""Of an ArduPilot's rate loop, that are designed: a parameter's word and what it is in a loop."""


class _Kind(documents.Open, frozen=True, kw_only=True):
    format: str | None = None


class _Model(documents.Open, frozen=True, kw_only=True):
    role: str
    model: ModelDocument


class _JudgedOn(documents.Open, frozen=True, kw_only=True):
    models: tuple[_Model, ...]
    covariance: tuple[tuple[float, ...], ...] | None = None


class _Loops(documents.Open, frozen=True, kw_only=True):
    roll: AxisLoop
    pitch: AxisLoop
    loop_hz: Annotated[float, Meta(gt=0)]
    gyro_filter_hz: Annotated[float, Meta(ge=0)] = 0.0


class _LoopsJudgedOn(_JudgedOn, frozen=True, kw_only=True):
    loops: _Loops
    """As they were flown; what is written into them are the parameters' new values."""


class _New(documents.Open, frozen=True, kw_only=True):
    new: float


class _Judged(documents.Open, frozen=True, kw_only=True):
    limits: Limits


class _Diagnosis(documents.Open, frozen=True, kw_only=True):
    state: State
    effects: tuple[str, ...] = ()
    confidence: float | None = None
    not_modelled: tuple[str, ...] = ()


class _Weights(documents.Open, frozen=True, kw_only=True):
    inputs: Annotated[float, Meta(gt=0)]
    flapping: Annotated[float, Meta(ge=0)]


class ClearedGains(GainsDocument, frozen=True, kw_only=True):
    """A GAINS.json with what its gains are to be judged on; an older one has nothing of that."""

    weights: _Weights | None = None
    judged: _Judged | None = None
    diagnosis: _Diagnosis | None = None
    judged_on: _JudgedOn | None = None
    margins_measured: MeasuredMargins | None = None
    """The runs may be elsewhere by now: what was measured is taken as it stands."""


class ClearedRateGains(documents.Open, frozen=True, kw_only=True):
    """What of a `tippath.rate_gains/1` document its gains are judged by."""

    parameters: dict[str, _New]
    judged_on: _LoopsJudgedOn
    judged: _Judged | None = None
    diagnosis: _Diagnosis | None = None
    margins_measured: MeasuredMargins | None = None
    command_noise: CommandNoise | None = None


def clearance(
    gains: AnyGains,
    fit: Fit,
    standing: Standing,
    limits: Limits | None = None,
    *,
    measured: MeasuredMargins | None = None,
    noise: CommandNoise | None = None,
    samples: int = SAMPLES,
) -> Clearance:
    """Gains that were designed on a fit, on all that its diagnosis and its bounds leave open."""
    models: list[tuple[Role, Model]] = [("fit", fit.model), *standing.models]
    return _judged(gains, models, standing, uncertainty(fit), limits or Limits(), samples, measured, noise)


def by_measurement(gains: AnyGains, model: Model, responses: Responses) -> MeasuredMargins:
    """Margins by the responses of a fit's own runs, and what of them is missing; the gains hold the model."""
    return with_model(measured_margins(gains, responses) or NOTHING_MEASURED, gains, model)


def cleared_again(path: Path, named: Sequence[str] = ()) -> Clearance:
    """The gains of a GAINS.json, the paper's or an ArduPilot's, judged anew, on what stands in it; at most as loosely
    as usual.

    `named`: files of the user's, whose code may run. Raises GainsError for a file that holds no gains, or models that
    cannot be had.
    """
    try:
        kind = documents.read_json(path, _Kind, what="set of gains", largest=LARGEST)
        if kind.format == RATE_GAINS:
            return _rate_gains_again(path, named)
        document = documents.read_json(path, ClearedGains, what="set of gains", largest=LARGEST)
        gains = gains_in(document)
        on = document.judged_on
        if on is None or not on.models:
            return _judged(gains, [("fit", gains.model)], NOT_ASKED, None, Limits(), 0)
        return _again(gains, on, document, path.parent, named)
    except documents.DocumentError as error:
        raise GainsError(f"{error}; make it with `tippath design`") from error
    except (SysidError, np.linalg.LinAlgError, ValueError) as error:
        raise GainsError(f"{path}: {error}; design again with `tippath design`") from error


def _rate_gains_again(path: Path, named: Sequence[str]) -> Clearance:
    document = documents.read_json(path, ClearedRateGains, what="set of gains", largest=LARGEST)
    on = document.judged_on
    values = {name: one.new for name, one in document.parameters.items()}
    if unknown := sorted({*values} - {name_of(axis, word) for axis in AXES for word in GAINS}):
        raise ValueError(f"{', '.join(unknown)} is no gain that is designed here")
    roll, pitch = (
        replace(loop, **{field: values.get(name_of(axis, word), getattr(loop, field)) for word, field in GAINS.items()})
        for axis, loop in zip(AXES, (on.loops.roll, on.loops.pitch), strict=True)
    )
    gains = RateController((roll, pitch), 1 / on.loops.loop_hz, on.loops.gyro_filter_hz)
    if not on.models:
        raise ValueError("it holds no model")
    return _again(gains, on, document, path.parent, named)


def _again(
    gains: AnyGains, on: _JudgedOn, document: ClearedGains | ClearedRateGains, folder: Path, named: Sequence[str]
) -> Clearance:
    models = [(_role(one.role), saved_model(one.model, folder, named)) for one in on.models]
    limits = Limits() if document.judged is None else Limits().or_stricter(document.judged.limits)
    covariance = None if on.covariance is None else _square(on.covariance, models[0][1])
    measured = document.margins_measured
    noise = document.command_noise if isinstance(document, ClearedRateGains) else None
    return _judged(gains, models, _standing(document), covariance, limits, SAMPLES, measured, noise)


def _judged(
    gains: AnyGains,
    models: list[tuple[Role, Model]],
    standing: Standing,
    covariance: FloatArray | None,
    limits: Limits,
    samples: int,
    measured: MeasuredMargins | None = None,
    noise: CommandNoise | None = None,
) -> Clearance:
    drawing = None if covariance is None else drawn(models[0][1], covariance, np.random.default_rng(SEED), samples)
    judgement = judge(gains, models, limits, drawing, measured, noise)
    return Clearance(judgement=judgement, standing=standing, covariance=covariance)


def gains_in(document: GainsDocument) -> Gains:
    """The controller as it stands in the file, whoever wrote it. Raises ValueError where its model is no TPP."""
    held, third = document.parameters, document.elevator
    effects = [] if third is None else [name for name in FORWARD if name == "elevator" or {"L_p", "M_q"} <= set(held)]
    structure = compose(TPP.base, effects, COMMANDS) if effects else TPP
    missing = [name for name in structure.names if name not in held]
    if document.model.structure != TPP.base or missing:
        raise ValueError(f"its model is not a TPP with {', '.join(structure.names)}")
    model = Model(structure, structure.vector({name: held[name] for name in structure.names}))
    K, L = np.array(document.K), np.array(document.observer_gain)
    g = np.array(document.prefilter)
    if third is not None:
        K, g = np.vstack([K, third.K]), np.vstack([g, third.prefilter])
    A, B, C, _ = (np.asarray(one, dtype=float) for one in model.matrices)
    B = B[:, : len(K)]
    return Gains(
        model=model,
        K=K,
        observer_gain=L,
        prefilter=g,
        poles=np.linalg.eigvals(A - B @ K),
        observer_poles=np.linalg.eigvals(A - L @ C),
        input_cost=float("nan"),
        loop=ClosedLoop(None),
        dynamic=_dynamic(document, len(K)),
    )


def _dynamic(document: GainsDocument, commands: int) -> DynamicPrefilter | None:
    """Raises ValueError where it is none for so many commands."""
    said = document.dynamic_prefilter
    if said is None:
        return None
    frequency, damping, F = np.array(said.frequency_rad_s), np.array(said.damping), np.array(said.F)
    if F.shape != (commands, 4) or not (np.all(frequency > 0) and np.all(damping > 0)):
        raise ValueError(f"its dynamic prefilter wants {commands} rows of F, and positive frequency and damping")
    return DynamicPrefilter(frequency=frequency, damping=damping, F=F)


def _standing(document: ClearedGains | ClearedRateGains) -> Standing:
    """What the design knew of its fit; the models stand beside it."""
    said = document.diagnosis
    if said is None:
        return NOT_ASKED
    return Standing(state=said.state, effects=said.effects, confidence=said.confidence, not_modelled=said.not_modelled)


def _role(word: str) -> Role:
    found = next((role for role in ROLES if role == word), None)
    if found is None:
        raise ValueError(f"a model's role is one of {', '.join(ROLES)}")
    return found


def _square(rows: tuple[tuple[float, ...], ...], model: Model) -> FloatArray:
    size = model.values.size
    if len(rows) != size or any(len(row) != size for row in rows):
        raise ValueError(f"its covariance is not of the model's {size} parameters")
    return np.array(rows)


def designed(path: Path, named: Sequence[str] = ()) -> tuple[Gains, Model, Limits]:
    """The gains of a GAINS.json, the model that they were first judged on, and what was asked of them, at most as
    loosely as usual. Raises GainsError as `cleared_again` does."""
    try:
        document = documents.read_json(path, ClearedGains, what="set of gains", largest=LARGEST)
        with np.errstate(all="ignore"):
            gains, on = gains_in(document), document.judged_on
            if not np.all(np.isfinite(gains.model.matrices.A)):
                raise ValueError("its model's numbers make no finite matrices")
        if (said := document.weights) is not None:
            gains = replace(gains, input_cost=said.inputs, flapping_cost=said.flapping)
        model = saved_model(on.models[0].model, path.parent, named) if on is not None and on.models else gains.model
    except documents.DocumentError as error:
        raise GainsError(f"{error}; make it with `tippath design`") from error
    except (SysidError, np.linalg.LinAlgError, ValueError) as error:
        raise GainsError(f"{path}: {error}; design again with `tippath design`") from error
    return gains, model, Limits() if document.judged is None else Limits().or_stricter(document.judged.limits)
