"""Gauss-Newton steps with halving that minimise the output error, each segment's end states projected out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.output_error import axis_weights
from sysid.fit.rows import less_ends, rows
from sysid.fit.scaled import scaled_solve
from sysid.fit.whitening import weighing
from sysid.model.acting import linear_dynamics
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.response import Ends
from sysid.model.structure import AnyArray, FloatArray, Model, Structure

SETTLED = 0.02
"""Relative difference of residual power to the one given, from which on the outputs are weighed by their own."""
MAXIMUM_STEPS = 60
MAXIMUM_STEPS_IN_TIME = 15
"""The same where every step takes simulations; most end after 4 to 12."""
TOLERANCE = 3e-6  # of the summed logarithms of residual power: at most 0.1 standard errors
SMALLEST_LENGTH = 1e-5
DETERMINED = 1e-12
"""Of the best determined direction, that one which a step follows has at least."""
KEPT = 0.05
"""Of what a step promises, what it must bring;"""
PATIENCE = 30
"""this many steps in a row that bring less end the search: a bent valley that is not followed to its end,"""
PATIENCE_IN_TIME = 4
"""the same where every step takes simulations: of 33 along one such valley the last 29 brought a sixth of the first."""
SHORT = 0.9
"""Of a step to where there is no response: most often to a bound, a lag of zero."""


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of one weighted linearisation, end states projected out."""

    power: FloatArray
    """(k,), of the residual: as if unweighted where the weights are constant over frequency, else weighted."""
    curvature: FloatArray
    gradient: FloatArray
    ends: list[FloatArray]
    """For every stack (segments, end states), the differences of first and last state."""
    spectral: bool = False
    """Whether the weights are those of a spectrum, and the power is the weighted one."""

    def promise(self, move: FloatArray) -> float:
        """By how much this step would lower the cost if the outputs were linear."""
        return float(2 * self.gradient @ move - move @ self.curvature @ move)

    @property
    def cost(self) -> float:
        """The sum that is minimised: logarithms of power, or the weighted power."""
        return float(np.sum(self.power if self.spectral else np.log(self.power)))

    @property
    def finite(self) -> bool:
        """Whether there is a step from here: LAPACK prints on the terminal where it is handed what is not a number."""
        return bool(np.isfinite(self.curvature).all() and np.isfinite(self.gradient).all())


def normal_equations(
    structure: Structure,
    values: FloatArray,
    stacks: Sequence[Stack],
    weights: Sequence[AnyArray],
    full: bool,
    ends: Sequence[Ends] | None = None,
    of: Sequence[int] | None = None,
) -> NormalEquations:
    """Curvature J J^T, gradient J r and what is left, end states projected out.

    Weights are constant over frequency, (k, bins), or lower triangular matrices, (k, k, bins). `of` numbers the
    parameters that move, where not all do; of the others the curvature may be left at zero, which costs nothing.
    """
    count = values.size if full else 0
    curvature, gradient, power = np.zeros((count, count)), np.zeros(count), np.zeros(len(structure.outputs))
    found: list[FloatArray] = []
    for number, (group, weight) in enumerate(zip(stacks, weights, strict=True)):
        response = respond(
            structure, values, group, sensitivities=full, ends=None if ends is None else ends[number], of=of
        )
        n = response.E.shape[0]
        columns = [response.E, (group.Y - response.Y)[None], *([] if response.J is None else [response.J])]
        white = np.empty((sum(map(len, columns)), *group.Y.shape), dtype=complex)
        first, by_weight = 0, weighing(weight)
        for some in columns:
            by_weight(some, white[first : first + len(some)])
            first += len(some)
        blocks = [rows(white[..., part]) for part in group.slices]
        products, explained = less_ends(np.array([block @ block.T for block in blocks]), n)
        found.append(explained[:, :, 0])
        moved = np.zeros(products.shape[0] - 1)
        for part, block, difference in zip(group.slices, blocks, found[-1], strict=True):
            rest = block[n] - difference @ block[:n]  # inner products alone would leave rounding where little is left
            unweighted = (group.scale[part.start] / weight[:, part.start]) ** 2 if weight.ndim == 2 else 1.0
            power += (rest * rest).reshape(power.size, -1).sum(axis=1) * unweighted
            moved += block[n + 1 :] @ rest
        if full:
            inner, to = products[1:, 1:], response.to
            if to is not None:
                inner, moved = to @ inner @ to.T, to @ moved
            if to is not None or of is None or len(of) == count:
                gradient += moved
                curvature += inner
            else:
                gradient[list(of)] += moved
                curvature[np.ix_(of, of)] += inner
    return NormalEquations(power, curvature, gradient, found, weights[0].ndim == 3)


def minimise(
    model: Model,
    stacks: Sequence[Stack],
    power: FloatArray,
    held: Sequence[str] = (),
    steps: int = MAXIMUM_STEPS,
    tolerance: float = TOLERANCE,
    spectral: Sequence[ComplexArray] | None = None,
) -> tuple[Model, FloatArray]:
    """Gauss-Newton with step halving and hard bounds on sum log(residual power) over the outputs.

    Outputs are weighed by what was left of them where the last step began; by `power` (k,) at first, or by what is left
    there if that is another. With `spectral` weights (k, k, bins) for every stack it is the weighted power that falls,
    and they stay; they make it about one at the beginning. `held` parameters stay. It ends where a step promises, or
    brings, less than `tolerance` of that sum. Returns the model and its residual power.
    """
    structure = model.structure
    low, high = structure.bounds
    movable = np.array([name not in held for name in structure.names])
    values = np.clip(model.values, low, high)
    weights: Sequence[AnyArray] = axis_weights(stacks, power) if spectral is None else spectral
    equations = partial(normal_equations, structure, stacks=stacks, of=np.flatnonzero(movable).tolist())
    here = equations(values, weights=weights, full=True)
    if spectral is None and not np.allclose(power, here.power, rtol=SETTLED):
        weights = axis_weights(stacks, here.power)
        here = equations(values, weights=weights, full=True, ends=here.ends)
    poor, patience = 0, PATIENCE if linear_dynamics(structure) else PATIENCE_IN_TIME
    for _ in range(steps if linear_dynamics(structure) else min(steps, MAXIMUM_STEPS_IN_TIME)):
        free = movable & ~((values <= low) & (here.gradient < 0)) & ~((values >= high) & (here.gradient > 0))
        if not np.any(free):
            break
        move = bounded_step(here, free, low - values, high - values)
        promise = here.promise(move)
        if promise < tolerance:
            break
        weights = axis_weights(stacks, here.power) if spectral is None else spectral
        ends = (values, moved(values, move, low, high))
        reached = _lower(equations, ends, weights, here, tolerance / promise)
        if reached is None:
            break
        before = here.cost
        values, here = reached
        poor = poor + 1 if before - here.cost < KEPT * promise else 0
        if before - here.cost < tolerance or poor == patience:
            break
    return Model(structure, values), here.power


def _lower(
    equations: Callable[..., NormalEquations],
    ends: tuple[FloatArray, FloatArray],
    weights: Sequence[AnyArray],
    here: NormalEquations,
    least: float,
) -> tuple[FloatArray, NormalEquations] | None:
    """Where on the way from one end to the other the cost is lower, the way being halved; None where it nowhere is.

    It is halved until nothing is promised that counts, `least` of the whole way. Most steps go all the way; where one
    does not, derivatives are taken where the cost is lower, and nowhere else.
    """
    begin, end = ends
    length = 1.0
    while length > max(SMALLEST_LENGTH, 0.5 * least):
        trial = end if length == 1 else begin + length * (end - begin)
        there = _try(equations, trial, weights, here.ends, full=length == 1)
        if there is not None and there.cost < here.cost:
            if length < 1:
                there = _try(equations, trial, weights, here.ends)
            if there is not None:
                return trial, there
        length = SHORT if there is None and length == 1 else length / 2
    return None


def moved(values: FloatArray, move: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The values moved, at a bound where they go to it: rounding would leave some inside, or none of a rate of 1e16."""
    return np.where(move <= low - values, low, np.where(move >= high - values, high, np.clip(values + move, low, high)))


def bounded_step(here: NormalEquations, free: NDArray[np.bool_], least: FloatArray, most: FloatArray) -> FloatArray:
    """The Gauss-Newton step (parameters,) between these steps; what would pass them goes there, and the rest follows.

    To cut the step alone is not enough where parameters stand for each other: a lag that ends at zero would leave its
    delay as far off as if the lag had gone on below. Where all that promises nothing, for a number went far beyond the
    bound that it would be put at, the step is cut after all: a filter's corner was to go from 105 to below zero, and to
    57 Hz.
    """
    whole = move = gauss_newton_step(here, free)
    held = np.zeros_like(free)
    while np.any(beyond := free & ~held & ((move < least) | (move > most))):
        held |= beyond
        move = gauss_newton_step(here, free & ~held, np.where(held, np.clip(move, least, most), 0.0))
    return _cut(whole, least, most) if np.any(held) and here.promise(move) <= 0 else move


def _cut(move: FloatArray, least: FloatArray, most: FloatArray) -> FloatArray:
    """As much of a step as stays between these, and a little less: at a bound there may be no response."""
    room = np.where(move < 0, least, most)
    with np.errstate(invalid="ignore", divide="ignore"):
        parts = np.where(move != 0, room / move, np.inf)
    return np.asarray(min(1.0, SHORT * float(np.min(parts, initial=1.0))) * move)


def gauss_newton_step(here: NormalEquations, free: NDArray[np.bool_], given: FloatArray | None = None) -> FloatArray:
    """The Gauss-Newton step of the free parameters, (parameters,), beside those `given`; none of them where the
    linearisation is not finite."""
    move = np.zeros(free.size) if given is None else given
    if not here.finite:
        return move
    H, g = here.curvature[np.ix_(free, free)], (here.gradient - here.curvature @ move)[free]
    move[free] = scaled_solve(H, g, DETERMINED)
    return move


def _try(
    equations: Callable[..., NormalEquations],
    values: FloatArray,
    weights: Sequence[AnyArray],
    ends: Sequence[Ends],
    full: bool = True,
) -> NormalEquations | None:
    """The normal equations there, or what is left alone where not `full`; None where there is no response."""
    if not np.all(np.isfinite(values)):
        return None
    try:
        with np.errstate(all="ignore"):  # a time constant of zero has no response: what comes out is not finite
            found = equations(values, weights=weights, full=full, ends=ends)
    except (RelaxationError, np.linalg.LinAlgError):
        return None
    return found if found.finite else None
