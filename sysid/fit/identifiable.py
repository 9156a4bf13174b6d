"""What the data leave open: directions in parameter space along which the response, or the fit, does not change.

Three reasons, named differently because the remedies differ. *Structural*: whatever is flown, two parameters do the
same (rank of the response's slopes), or two effects may change places (a lag before a linear vehicle is a lag behind
it). *On these runs*: the equations tell them apart, these commands do not. *Practical*: the runs do, but with so little
power at this noise that a parameter may move by more than its own size.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.model.parameter import Parameter
from sysid.model.response import slopes, transfer
from sysid.model.structure import FloatArray, Structure

FREQUENCIES_HZ = np.geomspace(0.1, 15.0, 40)
SAME = 1e-8
"""Relative change of a response that counts as none."""
LEAST_SLOPE = 1e-7
"""Smallest singular value of the slopes, each scaled to one, beside the largest."""
PLACES = (1, 2)
"""Seeds: rank is judged away from special values, and in two places."""
FEWEST_NAMED = 0.1
LARGEST_SPREAD = 1.0


@dataclass(frozen=True)
class Direction:
    """Parameters that move together without being noticed."""

    moves: tuple[tuple[str, float], ...]
    """(name, change) in the parameters' units, the largest relative change first."""

    def __str__(self) -> str:
        return ", ".join(f"{name} {change:+.3g}" for name, change in self.moves)


def size(parameter: Parameter, value: float) -> float:
    """What counts as the whole of a parameter: its value, or what is usual where that is more."""
    return max(abs(value), abs(parameter.typical), 1e-300)


def structural(structure: Structure, held: Collection[str] = ()) -> str | None:
    """Why no flight whatever determines all free parameters of a composition; None where one may.

    Judged on the frequency response to every command and logged channel, each moved for itself. Parameters of
    nonlinear effects do not show there and are not judged.
    """
    unseen = {name for one in structure.composed if not one.linear or one.samples is not None for name in one.names}
    loose = [i for i, name in enumerate(structure.names) if name not in held and name not in unseen]
    typical = np.array([one.typical for one in structure.parameters])
    return _exchange(structure, typical, held) or _rank(structure, typical, loose)


def _exchange(structure: Structure, typical: FloatArray, held: Collection[str]) -> str | None:
    """Two effects of the same units whose values may be swapped."""
    values = structure.by_name(typical)
    for one, other in itertools.combinations(structure.composed, 2):
        free = not any(name in held for name in (*one.names, *other.names))
        alike = [p.unit for p in one.parameters] == [p.unit for p in other.parameters]
        still = one.linear and other.linear and one.samples is None and other.samples is None
        if not (free and alike and still):
            continue
        apart, swapped = dict(values), dict(values)
        for number, (a, b) in enumerate(zip(one.parameters, other.parameters, strict=True)):
            x, y = values[a.name], values[b.name]
            if abs(x - y) <= 0.2 * abs(x):  # values alike would swap in any case
                y = x * (1.5 + 0.1 * number)
            apart[a.name], apart[b.name] = x, y
            swapped[a.name], swapped[b.name] = y, x
        here = transfer(structure, structure.vector(apart), FREQUENCIES_HZ)
        there = transfer(structure, structure.vector(swapped), FREQUENCIES_HZ)
        if np.max(np.abs(here - there)) <= SAME * np.max(np.abs(here)):
            first, second = " and ".join(one.names), " and ".join(other.names)
            return (
                f"the data do not determine the model: {one.id} and {other.id} may change places without any change "
                f"of the response, so no flight of these channels tells {first} from {second} (structural); "
                f"leave one out, or hold it with --fix"
            )
    return None


def _rank(structure: Structure, typical: FloatArray, loose: Sequence[int]) -> str | None:
    found = None
    for seed in PLACES:
        values = typical * np.random.default_rng(seed).uniform(0.6, 1.6, typical.size)
        J = slopes(structure, values, FREQUENCIES_HZ)[list(loose)]
        rows = np.ascontiguousarray(J.reshape(len(loose), -1)).view(float)
        length = np.sqrt(np.einsum("ij,ij->i", rows, rows))
        whole = length * np.array([size(structure.parameters[i], float(values[i])) for i in loose])
        if np.any(whole <= SAME * np.max(whole)):
            name = structure.names[loose[int(np.argmin(whole))]]
            found = (
                f"the data do not determine the model: {name} does not show in the response, whatever is flown "
                f"(structural); hold it with --fix"
            )
            continue
        left, singular, _ = np.linalg.svd(rows / length[:, None], full_matrices=False)
        if singular[-1] > LEAST_SLOPE * singular[0]:
            return None
        direction = along(structure, values, loose, left[:, -1] / length)
        found = (
            f"the data do not determine the model: the response stays the same along {direction}, whatever is flown "
            f"(structural); leave one of these effects out, or hold one parameter with --fix"
        )
    return found


def along(
    structure: Structure, values: FloatArray, loose: Sequence[int], move: FloatArray, times: float | None = None
) -> Direction:
    """A direction in the loose parameters' units: so many times `move`, or what moves most by its own size."""
    sizes = np.array([size(structure.parameters[i], float(values[i])) for i in loose])
    relative = move / sizes
    largest = int(np.argmax(np.abs(relative)))
    scale = 1 / relative[largest] if times is None else times * np.sign(relative[largest])
    order = np.argsort(-np.abs(relative), kind="stable")
    named = [
        (structure.names[loose[i]], float(scale * move[i]))
        for i in order
        if abs(relative[i]) > FEWEST_NAMED * abs(relative[largest])
    ]
    return Direction(tuple(named))


def alike(
    structure: Structure, values: FloatArray, loose: Sequence[int], correlation: FloatArray, length: FloatArray
) -> str:
    """Why these runs leave a direction open: curvature scaled to one (loose, loose), and its scale (loose,)."""
    _, axes = np.linalg.eigh(correlation)
    direction = along(structure, values, loose, axes[:, 0] / length)
    return (
        f"the data do not determine the model: the fit stays the same along {direction} on these runs; "
        f"hold one of them with --fix, leave an effect out, or fly another maneuver"
    )


def vague(structure: Structure, values: FloatArray, covariance: FloatArray) -> tuple[Direction, ...]:
    """Directions along which the standard error exceeds the parameters' own sizes, the vaguest first (practical).

    Each moves by one standard error.
    """
    loose = [int(i) for i in np.flatnonzero(np.diag(covariance) > 0)]
    if not loose or not np.all(np.isfinite(covariance)):
        return ()
    sizes = np.array([size(structure.parameters[i], float(values[i])) for i in loose])
    power, axes = np.linalg.eigh(covariance[np.ix_(loose, loose)] / np.outer(sizes, sizes))
    return tuple(
        along(structure, values, loose, sizes * axes[:, i], float(np.sqrt(power[i])))
        for i in range(len(loose) - 1, -1, -1)
        if power[i] > LARGEST_SPREAD**2
    )


def undetermined(structure: Structure, values: FloatArray, covariance: FloatArray) -> tuple[str, ...]:
    """Free parameters that may move by more than their own size: their values are not to be read as numbers."""
    errors = np.sqrt(np.maximum(np.diag(covariance), 0))
    return tuple(
        one.name
        for one, value, error in zip(structure.parameters, values, errors, strict=True)
        if error > LARGEST_SPREAD * size(one, float(value))
    )
