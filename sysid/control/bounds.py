"""What a loop holds over all that a fit's numbers may be: samples of its covariance and of its model's error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.control.controllers import AnyGains, controller_of
from sysid.control.stability import Margins
from sysid.fit.result import Fit, finite
from sysid.model.structure import FloatArray, Model

SAMPLES = 500
SEED = 17
RARE = 0.05
"""Of the samples, that may have less than what is told."""


@dataclass(frozen=True, kw_only=True)
class OverBounds:
    """Margins over samples of a model."""

    samples: int
    not_held: int
    least: Margins | None
    """What 95 % of the samples have at least, each margin by itself; None where fewer are held."""
    worst: Margins | None
    """The smallest of each; None where one is not held."""

    def to_json(self) -> dict[str, Any]:
        return {
            "samples": self.samples,
            "not_held": self.not_held,
            "least": None if self.least is None else margins_json(self.least),
            "worst": None if self.worst is None else margins_json(self.worst),
        }


def uncertainty(fit: Fit) -> FloatArray:
    """(parameters, parameters): covariance of a fit's numbers, what its model's error moves them by counted in."""
    covariance = np.where(np.isfinite(fit.covariance), fit.covariance, 0.0)
    errors = [fit.model_errors[name].total if name in fit.model_errors else 0.0 for name in fit.model.structure.names]
    return np.asarray(covariance + np.diag(np.nan_to_num(errors) ** 2))


def drawn(model: Model, covariance: FloatArray, rng: np.random.Generator, count: int = SAMPLES) -> FloatArray:
    """(count, parameters), normal about the model's values, inside hard limits."""
    size, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    spread = axes * np.sqrt(np.maximum(size, 0.0))
    values = model.values + rng.standard_normal((count, model.values.size)) @ spread.T
    low, high = model.structure.bounds
    return np.asarray(np.clip(values, low, high))


def over_bounds(gains: AnyGains, model: Model, draws: FloatArray) -> OverBounds:
    """Gains in the loop with a model at each of these values, (count, parameters)."""
    held = controller_of(gains).held
    return bounds_of([held(Model(model.structure, values)).margins for values in draws])


def bounds_of(found: Sequence[Margins | None]) -> OverBounds:
    """Of the margins of samples, None where one is not held."""
    sizes = np.array([(0.0, 0.0, 0.0) if one is None else (one.gain_db, one.phase_deg, one.delay_s) for one in found])
    lost = sum(one is None for one in found)
    rare = np.sort(sizes, axis=0)[int(RARE * len(found))]
    return OverBounds(
        samples=len(found),
        not_held=lost,
        least=None if lost > RARE * len(found) else Margins(*map(float, rare)),
        worst=None if lost else Margins(*map(float, np.min(sizes, axis=0))),
    )


def margins_json(one: Margins) -> dict[str, float | None]:
    """As a design writes them; null where more makes no difference."""
    return {name: finite(getattr(one, name)) for name in ("gain_db", "phase_deg", "delay_ms")}
