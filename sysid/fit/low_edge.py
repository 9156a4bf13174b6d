"""Whether a fit's values depend on where its band begins: under feedback without a logged excitation they do.

At low frequencies a controller holds the vehicle, and the commands answer gusts. A fit that takes this for the vehicle
moves when the lowest bins are left out, by far more than what they would add by chance. The moves are those of one step
from the fit, on bins that are there already.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.data.dataset import Bins
from sysid.data.preprocess import ComplexArray
from sysid.fit.check_kinds import LowEdgeHolds, LowEdgeMoves, Move
from sysid.fit.checks import Check
from sysid.fit.estimate import Weights, asked_with, free_of, weights_at
from sysid.fit.identifiable import size
from sysid.fit.rows import project, rows, smoothed_spectrum
from sysid.fit.scaled import scaled_inverse
from sysid.fit.whitening import weighed
from sysid.model.acting import jumping
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import AnyArray, FloatArray, Model

EDGES_HZ = (0.3, 0.7, 1.0, 1.5, 2.0)
HIGHEST_SHARE = 0.2
"""Of the band's high edge, that its low edge is moved to at most."""
LARGEST_MOVE = 4.0
"""Standard errors of the move;"""
LEAST_MOVE = 2.0
"""and of the value itself, below which a move is of no account, as it is below"""
LEAST_SHARE = 0.02
"""of the value."""
WORST_CONDITION = 1e10


@dataclass(frozen=True, eq=False, kw_only=True)
class LowEdges:
    """The values that a fit would have if its band began higher."""

    low_hz: tuple[float, ...]
    """The fit's own low edge first."""
    names: tuple[str, ...]
    """Free parameters;"""
    units: tuple[str, ...]
    values: FloatArray
    """(edges, parameters),"""
    times: FloatArray
    """and by how many of its standard errors each moves at most, (parameters,)."""
    large: tuple[bool, ...]
    """Whether that is beyond chance, and beyond the value's own error."""
    instrumented: bool
    """The excitation is logged: feedback is not the cause."""

    @property
    def moved(self) -> tuple[str, ...]:
        """The largest first."""
        order = np.argsort(-self.times, kind="stable")
        return tuple(self.names[i] for i in order if self.large[i])

    @property
    def check(self) -> Check:
        name = "low edge of the band"
        low_hz, high_hz = self.low_hz[0], self.low_hz[-1]
        if not self.moved:
            return Check(name, True, LowEdgeHolds(low_hz, high_hz))
        moves = [Move(name, self.units[i], *self._ends(i)) for name in self.moved for i in [self.names.index(name)]]
        return Check(name, False, LowEdgeMoves(tuple(moves), low_hz, high_hz, self.instrumented))

    def _ends(self, number: int) -> tuple[float, float]:
        """The fit's value, and that furthest from it."""
        column = self.values[:, number]
        return float(column[0]), float(column[np.argmax(np.abs(column - column[0]))])

    def to_json(self) -> dict[str, Any]:
        return {
            "low_hz": list(self.low_hz),
            "values": {
                name: [float(x) for x in column] for name, column in zip(self.names, self.values.T, strict=True)
            },
            "standard_errors": {name: float(x) for name, x in zip(self.names, self.times, strict=True)},
            "moved": list(self.moved),
        }


def low_edges(
    model: Model,
    bins: Bins,
    band_hz: tuple[float, float],
    held: Collection[str] = (),
    weights: Weights = "residual spectrum",
) -> LowEdges | None:
    """The scan of a fit with these weights on its bins, (low, high) Hz being its band.

    None where nothing can be left out of the band, or no step taken.
    """
    edges = [edge for edge in EDGES_HZ if band_hz[0] < edge <= HIGHEST_SHARE * band_hz[1]]
    free = free_of(model, held)
    if not edges or not free or jumping(model.structure, model.values, bins.stacks[0]):
        return None
    caused = bins.instruments(model.structure.commands)
    try:
        parts = parts_of(model, bins, free, weights_at(model, bins, weights), caused)
    except RelaxationError:
        return None
    steps = [_step(parts, edge) for edge in (band_hz[0], *edges)]
    whole = steps[0]
    if whole is None:
        return None
    taken = [(edge, step) for edge, step in zip(edges, steps[1:], strict=True) if step is not None]
    moves = np.array([step.move - whole.move for _, step in taken]).reshape(-1, len(free))
    chance = np.array([_spread(parts, step, whole) for _, step in taken]).reshape(-1, len(free))
    times = np.abs(moves) / np.maximum(chance, 1e-300)
    parameters = [model.structure.parameters[i] for i in free]
    sizes = np.array([size(one, float(model.values[i])) for i, one in zip(free, parameters, strict=True)])
    least = np.maximum(LEAST_MOVE * _spread(parts, whole), LEAST_SHARE * sizes)
    large = (times > LARGEST_MOVE) & (np.abs(moves) > least)
    return LowEdges(
        low_hz=(band_hz[0], *(edge for edge, _ in taken)),
        names=tuple(one.name for one in parameters),
        units=tuple(one.unit for one in parameters),
        values=model.values[free] + np.concatenate([np.zeros((1, len(free))), moves]),
        times=np.max(times, axis=0, initial=0.0),
        large=tuple(map(bool, np.any(large, axis=0))),
        instrumented=caused is not None,
    )


class Part(NamedTuple):
    """A segment's bins, weighted."""

    frequency_hz: FloatArray
    E: ComplexArray
    """(ends, k, bins),"""
    columns: ComplexArray
    """(1 + 2 free, k, bins): the residual, its slopes, and what it is asked with."""
    spectrum: ComplexArray
    """(k, k, bins), of what is left."""


def parts_of(
    model: Model,
    bins: Bins,
    free: Sequence[int],
    weights: Sequence[AnyArray],
    caused: Sequence[ComplexArray] | None,
) -> list[Part]:
    """Every segment's bins by these weights, with the slopes of the free parameters."""
    found = []
    asked = None if caused is None else asked_with(model, bins.stacks, free, caused)
    for number, (group, weight) in enumerate(zip(bins.stacks, weights, strict=True)):
        response = respond(model.structure, model.values, group, True)
        slopes = response.slopes[list(free)]
        columns = [(group.Y - response.Y)[None], slopes, slopes if asked is None else asked[number]]
        T, E = weighed(weight, np.concatenate(columns)), weighed(weight, response.E)
        for part in group.slices:
            left = project(rows(E[..., part]), rows(T[:1, :, part])).view(complex).reshape(len(group.Y), -1)
            S = smoothed_spectrum(left, group.frequency_hz[part])
            found.append(Part(group.frequency_hz[part], E[..., part], T[..., part], S))
    return found


class _Step(NamedTuple):
    """One step on the bins above a low edge."""

    move: FloatArray
    """(free,)"""
    influence: list[ComplexArray]
    """For every segment what each bin's residual adds to it, (free, k, bins)."""


def _step(parts: Sequence[Part], edge_hz: float) -> _Step | None:
    """None where these bins do not determine it."""
    count = parts[0].columns.shape[0] // 2
    curvature, gradient, asked = np.zeros((count, count)), np.zeros(count), []
    for one in parts:
        above = one.frequency_hz > edge_hz
        rest = project(rows(one.E[..., above]), rows(one.columns[..., above]))
        Z = rest[1 + count :]
        curvature += Z @ rest[1 : 1 + count].T
        gradient += Z @ rest[0]
        padded = np.zeros_like(one.columns[1 + count :])
        padded[..., above] = Z.view(complex).reshape(count, padded.shape[1], -1)
        asked.append(padded)
    inverse = scaled_inverse(curvature, WORST_CONDITION)
    if inverse is None:
        return None
    return _Step(inverse @ gradient, [np.tensordot(inverse, Z, 1) for Z in asked])


def _spread(parts: Sequence[Part], step: _Step, less: _Step | None = None) -> FloatArray:
    """Standard deviations by chance of a step, or of its difference to another, (free,)."""
    variance = np.zeros(step.move.size)
    for number, one in enumerate(parts):
        each = step.influence[number] - (0 if less is None else less.influence[number])
        variance += 0.5 * np.sum(rows(each) * rows(np.einsum("klf,blf->bkf", one.spectrum, each)), axis=1)
    return np.asarray(np.sqrt(np.maximum(variance, 0)))
