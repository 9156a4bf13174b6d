"""Whether effects hold on other runs: their sizes, fitted to those runs alone, beside the sizes they have.

A play, a lag or a limit is one number, however hard the vehicle is flown. An entry that only resembles what is there
follows the runs that it was fitted to with a size that suits their amplitude; runs of another ask for another size.
How much of the error it explains there shows that less well: half of a wrong size still explains most of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from statistics import NormalDist
from typing import Any

import numpy as np

from sysid.data.dataset import Bins, Dataset, viewed
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.initial_states import begun
from sysid.diagnose.score import log_chance
from sysid.diagnose.validated import divided
from sysid.errors import FitError
from sysid.fit.estimate import Estimate, estimate
from sysid.fit.result import finite
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.relaxation import RelaxationError

CHANCE = 2 * NormalDist().cdf(-3.0)
"""Of differences as large as one that is told, in one of all sizes that are asked;"""
BY_CHANCE = math.log(CHANCE)
"""and its logarithm, where what the other runs lose by the sizes as they were fitted tells it: standard
errors of a mode that hardly shows there bound nothing."""
LITTLE = 0.03
"""Of what the entry explains of the other runs with its sizes as they were fitted, that it may lose by these: as much
as a size loses that is off by a sixth. A mode of 160 times what is detectable lost 0.02, and was found at 10 Hz there
for 5.5; a hub for a product of rates lost more than it explained."""


@dataclass(frozen=True, kw_only=True)
class Size:
    """One parameter on the fitted runs and on others."""

    parameter: Parameter
    fitted: float
    error: float
    """Standard error."""
    elsewhere: float
    elsewhere_error: float
    whole: float = 0.0
    """The largest of its effect in its unit, on either: what the rest of a coupling adds is small beside that."""
    asked: int = 1
    """Sizes that are compared, this among them: of four one is soon off by more than three standard errors."""
    by_chance: bool = False
    """Whether the other runs are followed as well, but for chance or a little of what the entry explains, with all
    sizes as they were fitted."""

    @property
    def off(self) -> float:
        """By which share of the largest they differ at least, chance taken off: 0 where it may be chance."""
        if self.by_chance:
            return 0.0
        certain = -NormalDist().inv_cdf(CHANCE / 2 / self.asked)
        apart = abs(self.elsewhere - self.fitted) - certain * float(np.hypot(self.error, self.elsewhere_error))
        return max(0.0, apart) / max(self.whole, abs(self.fitted), abs(self.elsewhere), 1e-300)

    def to_json(self) -> dict[str, Any]:
        return {
            "parameter": self.parameter.name,
            "fitted": finite(self.fitted),
            "standard_error": finite(self.error),
            "validation": finite(self.elsewhere),
            "validation_standard_error": finite(self.elsewhere_error),
            "off": finite(self.off),
        }


@lru_cache(maxsize=4)
def sizes(one: Candidate, effects: tuple[str, ...], other: Dataset) -> tuple[Size, ...]:
    """Sizes of these effects (ids, or paths of a user's) that both sets of runs determine; the most different first.

    The whole structure is fitted to the other runs, beginning at the candidate. None where they do not determine it:
    a limit that they do not reach, an axis that they do not move. Kept: the verdict on single effects and the one on
    chains ask the same.
    """
    structure = one.model.structure
    asked = [effect for effect in structure.composed if (effect.path or effect.id) in effects]
    found = _asked(one, asked, (), other)
    if found is None and len(asked) > 1:  # one of them may not show there: each by itself
        found = [
            size
            for effect in asked
            for size in _asked(one, [effect], [each for each in asked if each is not effect], other) or ()
        ]
    return tuple(sorted(found or (), key=lambda size: -size.off))


def _asked(one: Candidate, effects: Sequence[Effect], kept: Sequence[Effect], other: Dataset) -> list[Size] | None:
    """Sizes of effects, those of `kept` ones held; None where the other runs do not determine the structure."""
    model = one.model
    held = {*one.held, *one.estimate.at_bound, *(name for effect in kept for name in effect.names)}
    fixed = {name: model[name] for name in model.structure.names if name in held}
    try:
        runs = Bins(tuple(viewed(one, model.structure.inputs) for one in begun(model, other.spectra)))
        again = estimate(model.structure, runs, model, fixed, one.estimate.weights)
    except (FitError, RelaxationError, np.linalg.LinAlgError):
        return None
    if (one.estimate.instrumented or one.estimate.instrument == "prediction error") and not again.instrumented:
        return None  # feedback may have moved the one and not the other
    found = _beside(one, again, effects, fixed)
    if any(size.off > 0 for size in found) and _as_well(again, one, runs, found, fixed, other):
        return [replace(size, by_chance=True) for size in found]
    return found


def _beside(one: Candidate, again: Estimate, effects: Sequence[Effect], fixed: Mapping[str, float]) -> list[Size]:
    """Sizes as they were fitted, beside those of the other runs; those that both determine. What says of which kind an
    effect is and is not possible there tells nothing: slow gusts were taken for a drag that pushes."""
    model, names = one.model, one.model.structure.names
    here, there = (np.sqrt(np.maximum(np.diag(each.covariance), 0)) for each in (one.estimate, again))
    found: list[Size] = []
    for effect in effects:
        own = []
        for parameter in effect.parameters:
            if parameter.name not in names or parameter.name in {*fixed, *again.at_bound}:
                continue
            i = names.index(parameter.name)
            size = Size(
                parameter=parameter,
                fitted=float(model.values[i]),
                error=float(here[i]),
                elsewhere=float(again.model.values[i]),
                elsewhere_error=float(there[i]),
            )
            told = parameter.sizes or not parameter.implausible(size.elsewhere)
            if told and np.all(np.isfinite((size.fitted, size.error, size.elsewhere, size.elsewhere_error))):
                own.append(size)
        found += [replace(one, whole=_largest(own, one.parameter.unit)) for one in own]
    return [replace(one, asked=len(found)) for one in found]


def _as_well(
    again: Estimate,
    one: Candidate,
    runs: Bins,
    found: Sequence[Size],
    fixed: Mapping[str, float],
    other: Dataset,
) -> bool:
    """Whether the commands explain no more of what is left of the other runs, but for chance or a little of what a
    single effect explains there, with these sizes held as they were fitted than where they are free."""
    structure, weights = one.model.structure, one.estimate.weights
    held = {**fixed, **{size.parameter.name: size.fitted for size in found}}
    try:
        bound = estimate(structure, runs, one.model, held, weights)
        left = divided(bound.error, other).chi_squared
        lost = left - divided(again.error, other).chi_squared
        if log_chance(max(lost, 1e-300), len(found)) > BY_CHANCE:
            return True
        return len(one.added) == 1 and lost < LITTLE * (_left_without(one, runs, fixed, other) - left)
    except (FitError, RelaxationError, np.linalg.LinAlgError):
        return False


def _left_without(one: Candidate, runs: Bins, fixed: Mapping[str, float], other: Dataset) -> float:
    """What the commands explain, chi squared, of the other runs without the effects that were added. Raises FitError,
    RelaxationError and LinAlgError."""
    structure = one.model.structure
    without = replace(
        structure, composed=tuple(each for each in structure.composed if (each.path or each.id) not in one.added)
    )
    kept = {name: value for name, value in fixed.items() if name in without.names}
    return divided(estimate(without, runs, None, kept, one.estimate.weights).error, other).chi_squared


def _largest(sizes: Sequence[Size], unit: str) -> float:
    return max(abs(value) for one in sizes if one.parameter.unit == unit for value in (one.fitted, one.elsewhere))
