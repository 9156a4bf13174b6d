"""Are gains cleared: judged when they are designed, and again, by the same function, before they are pushed.

A GAINS.json carries the models that its gains were judged on, with the uncertainty of the fit; the judgement in it is
for people, and nobody who pushes believes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs import documents
from gcs.analysis.standing import NOT_ASKED, Standing, State
from gcs.flight.gains import LARGEST, GainsDocument, GainsError
from sysid.control.bounds import SAMPLES, SEED, drawn, uncertainty
from sysid.control.judgement import ROLES, Judgement, Limits, Role, judge
from sysid.control.measured_margins import MeasuredMargins
from sysid.control.prefilter import DynamicPrefilter
from sysid.control.regulator import FORWARD, Gains
from sysid.control.stability import COMMANDS, ClosedLoop
from sysid.errors import SysidError
from sysid.fit.result import Fit
from sysid.fit.saved_model import ModelDocument, model_json, saved_model
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import FloatArray, Model


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


class _Model(documents.Open, frozen=True, kw_only=True):
    role: str
    model: ModelDocument


class _JudgedOn(documents.Open, frozen=True, kw_only=True):
    models: tuple[_Model, ...]
    covariance: tuple[tuple[float, ...], ...] | None = None


class _Judged(documents.Open, frozen=True, kw_only=True):
    limits: Limits


class _Diagnosis(documents.Open, frozen=True, kw_only=True):
    state: State
    effects: tuple[str, ...] = ()
    confidence: float | None = None
    not_modelled: tuple[str, ...] = ()


class ClearedGains(GainsDocument, frozen=True, kw_only=True):
    """A GAINS.json with what its gains are to be judged on; an older one has nothing of that."""

    judged: _Judged | None = None
    diagnosis: _Diagnosis | None = None
    judged_on: _JudgedOn | None = None
    margins_measured: MeasuredMargins | None = None
    """The runs may be elsewhere by now: what was measured is taken as it stands."""


def clearance(
    gains: Gains,
    fit: Fit,
    standing: Standing,
    limits: Limits | None = None,
    *,
    measured: MeasuredMargins | None = None,
    samples: int = SAMPLES,
) -> Clearance:
    """Gains that were designed on a fit, on all that its diagnosis and its bounds leave open."""
    models: list[tuple[Role, Model]] = [("fit", fit.model), *standing.models]
    return _judged(gains, models, standing, uncertainty(fit), limits or Limits(), samples, measured)


def cleared_again(path: Path, named: Sequence[str] = ()) -> Clearance:
    """The gains of a GAINS.json judged anew, on what stands in it; at most as loosely as usual.

    `named`: files of the user's, whose code may run. Raises GainsError for a file that holds no gains, or models that
    cannot be had.
    """
    try:
        document = documents.read_json(path, ClearedGains, what="set of gains", largest=LARGEST)
        gains = gains_in(document)
        on = document.judged_on
        if on is None or not on.models:
            return _judged(gains, [("fit", gains.model)], NOT_ASKED, None, Limits(), 0)
        models = [(_role(one.role), saved_model(one.model, path.parent, named)) for one in on.models]
        limits = Limits() if document.judged is None else Limits().or_stricter(document.judged.limits)
        covariance = None if on.covariance is None else _square(on.covariance, models[0][1])
        return _judged(gains, models, _standing(document), covariance, limits, SAMPLES, document.margins_measured)
    except documents.DocumentError as error:
        raise GainsError(f"{error}; make it with `tippath design`") from error
    except (SysidError, np.linalg.LinAlgError, ValueError) as error:
        raise GainsError(f"{path}: {error}; design again with `tippath design`") from error


def _judged(
    gains: Gains,
    models: list[tuple[Role, Model]],
    standing: Standing,
    covariance: FloatArray | None,
    limits: Limits,
    samples: int,
    measured: MeasuredMargins | None = None,
) -> Clearance:
    drawing = None if covariance is None else drawn(models[0][1], covariance, np.random.default_rng(SEED), samples)
    judgement = judge(gains, models, limits, drawing, measured)
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


def _standing(document: ClearedGains) -> Standing:
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
        model = saved_model(on.models[0].model, path.parent, named) if on is not None and on.models else gains.model
    except documents.DocumentError as error:
        raise GainsError(f"{error}; make it with `tippath design`") from error
    except (SysidError, np.linalg.LinAlgError, ValueError) as error:
        raise GainsError(f"{path}: {error}; design again with `tippath design`") from error
    return gains, model, Limits() if document.judged is None else Limits().or_stricter(document.judged.limits)
