"""How much of a residual an effect could explain, without refitting: the quick question asked of every entry.

The sensitivities at the parent's values, less what the parent's own parameters would do as well, are held against the
residual under the noise's spectrum (a Lagrange multiplier, or Rao, test). Parameters that mean nothing at the null (a
frequency, a time constant, a limit) go through their grids, and terms that are not linear through their sizes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import ComplexArray
from sysid.diagnose.evidence import Candidate, Stepped, imposed_answers
from sysid.diagnose.whitening import Whitening
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Structure

SMALL_STEP = 0.1
"""Of the way from null to typical: where a linear effect's sensitivities are taken."""
INDEPENDENT = 1e-7
"""Share of a sensitivity that the base's own must leave of it."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """How much of the residual an effect would explain, by one step from the parent."""

    effect: str
    chi_squared: float
    """Of `degrees` where nothing is missing, at the best of `tried` points."""
    degrees: int
    tried: int
    at: Mapping[str, float]
    """The point of the grids, and the one-step estimates of parameters that begin at their null."""
    errors: Mapping[str, float]
    """Standard errors of those estimates."""

    @property
    def log_p(self) -> float:
        """Logarithm of the chance that noise alone shows as much, the number of points counted in."""
        return min(0.0, log_chance(self.chi_squared, self.degrees) + math.log(self.tried))


def log_chance(chi_squared: float, degrees: int) -> float:
    """Logarithm of the chance that chi squared is larger, however small that is."""
    from scipy.stats import chi2

    found = float(chi2.logsf(chi_squared, degrees))
    if math.isfinite(found):
        return found
    half = 0.5 * degrees
    return -0.5 * chi_squared + (half - 1) * math.log(0.5 * chi_squared) - math.lgamma(half)


def score(effect: Effect, composed: Structure, of: Candidate, stepped: Stepped, whitening: Whitening) -> Score | None:
    """None where the effect does nothing on these runs that the parent's own parameters would not do as well."""
    best: Score | None = None
    points = _points(composed, of)
    for nuisance, steps in points:
        found = _ask(
            effect, composed, of, stepped=stepped, whitening=whitening, point=nuisance, steps=steps, tried=len(points)
        )
        if found is not None and (best is None or found.log_p < best.log_p or _more(found, best)):
            best = found
    return best


def _more(one: Score, other: Score) -> bool:
    return one.log_p == other.log_p and one.chi_squared > other.chi_squared


Steps = Sequence[tuple[str, float]]


def _points(composed: Structure, of: Candidate) -> list[tuple[dict[str, float], Steps]]:
    """Values of all new parameters, and which of them step by how much from there; none where the point itself does."""
    known = set(of.model.structure.names)
    new = [one for one in composed.parameters if one.name not in known]
    linear = composed.linear
    begin: dict[str, float] = {}
    for effect in composed.composed:
        if effect.start is not None and any(one.name not in known for one in effect.parameters):
            named = dict(zip(of.model.structure.names, map(float, of.model.values), strict=True))
            begin.update({k: v for k, v in effect.start(named, dict(composed.constants)).items() if k not in known})

    def begins_at_null(one: Parameter) -> bool:
        return one.null is not None and math.isfinite(one.null) and (linear or not one.grid)

    sizes = [one for one in new if begins_at_null(one)]
    others = [one for one in new if not begins_at_null(one)]
    first = {one.name: begin.get(one.name, one.typical) for one in others}
    grids = [first]
    for one in others:
        if one.name not in begin:
            grids += [{**first, one.name: value} for value in one.grid if value != first[one.name]]
    steps = [(one.name, SMALL_STEP * (one.typical - float(one.null or 0.0))) for one in sizes]
    nulls = {one.name: float(one.null or 0.0) for one in sizes}
    # what is large may look otherwise than what is small: whole steps too, where the entry has a grid for them
    wide = {one.name: one.grid for one in sizes if one.grid}
    whole = [
        [
            (name, wide[name][min(i, len(wide[name]) - 1)] - nulls[name] if name in wide else step)
            for name, step in steps
        ]
        for i in range(max((len(grid) for grid in wide.values()), default=0))
    ]
    return [({**nulls, **point}, some) for point in grids for some in (steps, *whole)]


def _ask(
    effect: Effect,
    composed: Structure,
    of: Candidate,
    stepped: Stepped,
    whitening: Whitening,
    point: Mapping[str, float],
    steps: Steps,
    tried: int,
) -> Score | None:
    known = dict(zip(of.model.structure.names, map(float, of.model.values), strict=True))
    named = {**{name: known[name] for name in composed.names if name in known}, **point}
    places: list[dict[str, float]] = []
    for name, step in steps:
        places.append({**named, name: named[name] + step})
    alone = not steps or effect.acts_at_null
    if alone:
        places.insert(0, dict(named))
    try:
        with np.errstate(all="ignore"):
            flown = [_predicted(composed, values, of.dataset) for values in places]
            imposed = [
                imposed_answers(composed, composed.vector(values), of.dataset, Y)[0]
                for values, Y in zip(places, flown, strict=True)
            ]
    except (RelaxationError, np.linalg.LinAlgError):
        return None
    base, base_imposed = of.Y, of.Y_imposed
    D = whitening([np.stack([one[g] - base[g] for one in flown]) for g in range(len(base))])
    Z = whitening([np.stack([one[g] - base_imposed[g] for one in imposed]) for g in range(len(base))])
    if not (np.all(np.isfinite(D)) and np.all(np.isfinite(Z))):
        return None
    # less what the parent's own parameters would do: on the side that asks, and on the side that answers
    own = stepped.Z @ stepped.J.T
    Z1 = Z - np.linalg.lstsq(own.T, stepped.J @ Z.T, rcond=1e-12)[0].T @ stepped.Z
    size = np.einsum("ij,ij->i", Z, Z)
    keep = np.einsum("ij,ij->i", Z1, Z1) > INDEPENDENT * np.maximum(size, 1e-300)
    if not np.any(keep):
        return None
    Z1, D = Z1[keep], D[keep]
    gram = Z1 @ Z1.T
    scale = np.sqrt(np.diag(gram))
    inner, axes = np.linalg.eigh(gram / np.outer(scale, scale))
    rank = inner > 1e-9 * inner[-1]
    asked = (Z1 @ stepped.residual) / scale
    along = axes[:, rank].T @ asked
    chi_squared = float(np.sum(along**2 / inner[rank]))
    names = [
        name
        for place, name in zip(keep, [*([""] if alone else []), *(name for name, _ in steps)], strict=True)
        if place
    ]
    answer = Z1 @ D.T
    at = dict(point)
    errors: dict[str, float] = {}
    try:
        inverse = np.linalg.inv(answer)
        move = inverse @ (Z1 @ stepped.residual)
        spread = np.sqrt(np.maximum(np.diag(inverse @ gram @ inverse.T), 0))
        width = dict(steps)
        for name, times, error in zip(names, move, spread, strict=True):
            if name:
                at[name] = point[name] + float(times) * width[name]
                errors[name] = float(error) * abs(width[name])
    except np.linalg.LinAlgError:
        pass
    return Score(
        effect=effect.path or effect.id,
        chi_squared=chi_squared,
        degrees=int(np.sum(rank)),
        tried=tried,
        at=at,
        errors=errors,
    )


def _predicted(composed: Structure, named: Mapping[str, float], on: Dataset) -> list[ComplexArray]:
    values = composed.vector(named)
    return [respond(composed, values, group, False).Y for group in on.stacks]
