"""Poles of a fit that is unstable: the best stable model near the data, and which of the two is kept.

Where a stable one explains more, the free fit lay in a poor valley and begins again there. Where the data do not say
that a pole is unstable, as they do not of rates alone by chance, the fit moves, along what they leave open, until it is
not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.dataset import Bins
from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.estimate import Estimate, Weights, estimate, in_bounds
from sysid.fit.output_error import OutputError, axis_weights, output_error
from sysid.fit.rows import project, rows
from sysid.model.monomials import linearised
from sysid.model.predict import respond
from sysid.model.structure import FloatArray, Model

STABILITY_PUSHES = (0.03, 0.3, 3.0, 30.0)
STABILITY_MARGIN = 0.1  # 1/s
CERTAIN = 2.0
"""Standard errors of a pole's real part, above zero, from which on the data say that it is unstable."""
STEPS = 10
SMALLEST_COMMON = 1e-12
"""Of a pole's left and right vector of length one: below it, it stands there twice and has no slope."""


@dataclass(frozen=True, eq=False)
class Settled:
    """What an unstable fit became."""

    estimate: Estimate
    held: tuple[Model, OutputError] | None = None
    """The best stable model near the data and what it leaves, where the fit stays unstable; None where there is none,
    and where the fit is stable."""
    refusal: str | None = None
    """Why no stable model was found."""
    moved: tuple[float, float] | None = None
    """The largest real part of a pole before it was held stable, with its standard error, 1/s."""


def settle(free: Estimate, bins: Bins, fixed: Mapping[str, float], weights: Weights = "residual spectrum") -> Settled:
    """The better of a free fit and of one begun at the best stable model; held stable where the data do not object."""
    if free.model.stable:
        return Settled(free)
    steadied = _steadied(free, bins)
    if steadied is not None:
        return steadied
    try:
        held = held_stable(free.model, bins.stacks, fixed)
    except FitError as error:
        return Settled(free, refusal=str(error))
    if _cost(held[1]) < _cost(free.error):
        try:
            again = estimate(free.model.structure, bins, held[0], fixed, weights)
        except FitError:
            return Settled(free, held)
        if _cost(again.error) < _cost(free.error):
            return Settled(again, None if again.model.stable else held)
    return Settled(free, held)


def _cost(error: OutputError) -> float:
    return float(np.sum(np.log(error.residual_power)))


def _steadied(free: Estimate, bins: Bins) -> Settled | None:
    """Moved by as little as the data object, in its covariance, to where no pole is unstable.

    None where the data object, where that is beyond a bound, and where attitude or speed belong to the state: hover may
    be unstable in these.
    """
    structure = free.model.structure
    if structure.attitude_states:
        return None
    values, before = free.model.values.copy(), None
    for _ in range(STEPS):
        real, slopes = largest_pole(Model(structure, values))
        if slopes is None:
            return None
        spread = float(np.sqrt(slopes @ free.covariance @ slopes))
        if before is None:
            before = real, spread
            if not real < CERTAIN * spread:
                return None
        if real < 0:
            model = Model(structure, values)
            break
        values = values - free.covariance @ slopes * ((real + 0.5 * STABILITY_MARGIN) / spread**2)
        if not in_bounds(structure, values):
            return None
    else:
        return None
    if not model.stable:
        return None
    return Settled(replace(free, model=model, error=output_error(model, bins.stacks)), moved=before)


def largest_pole(model: Model) -> tuple[float, FloatArray | None]:
    """The largest real part of a pole, 1/s, and its slopes to the parameters; None where two fell together there."""
    here, moved = linearised(model.structure, model.values)
    A = here.A
    poles, right = np.linalg.eig(A)
    at = int(np.argmax(poles.real))
    # of this pole alone: others that fell together, as critically damped servos' do, have no inverse
    mirrored, others = np.linalg.eig(A.T)
    left = others[:, int(np.argmin(np.abs(mirrored - poles[at])))]
    common = left @ right[:, at]
    if abs(common) < SMALLEST_COMMON:
        return float(poles[at].real), None
    left = left / common
    return float(poles[at].real), np.asarray(((left @ moved.A) @ right[:, at]).real)


def held_stable(
    free: Model, stacks: Sequence[Stack], fixed: Mapping[str, float] | None = None
) -> tuple[Model, OutputError]:
    """The best stable model found by pushing an unstable one's poles across the axis; `fixed` parameters stay.

    A penalty on the poles' real parts grows until they have crossed; the outputs count by their measured power. Raises
    FitError where none is found.
    """
    # heavier than NumPy itself to load: only where it is needed
    from scipy.optimize import least_squares

    structure = free.structure
    loose = np.array([name not in (fixed or {}) for name in structure.names])
    weights = axis_weights(stacks, output_error(free, stacks).measured_power)
    best: tuple[float, Model] | None = None
    begins = [free.values]
    if not structure.composed:
        begins.append(np.array(structure.base_.uncoupled))
    for begin in begins:
        values = np.where(loose, begin, free.values)
        scale = np.maximum(np.abs(values[loose]), 1.0)
        for push in STABILITY_PUSHES:

            def residuals(some: FloatArray, push: float = push, values: FloatArray = values) -> FloatArray:
                x = values.copy()
                x[loose] = some
                real = np.linalg.eigvals(structure.matrices(x).A).real
                parts = [push * np.maximum(real + STABILITY_MARGIN, 0)]
                for group, weight in zip(stacks, weights, strict=True):
                    response = respond(structure, x, group, False)
                    e, E = weight * (group.Y - response.Y), weight * response.E
                    parts += [project(rows(E[..., part]), rows(e[None, :, part]))[0] for part in group.slices]
                return np.concatenate(parts)

            try:
                with np.errstate(all="ignore"):  # a step too far has no response: it is taken back
                    moved = least_squares(residuals, values[loose], x_scale=scale, max_nfev=40).x
                values = values.copy()
                values[loose] = moved
            except (np.linalg.LinAlgError, ValueError):  # of slopes that are not finite
                break  # a step led to where there is no response
        else:
            model = Model(structure, values)
            if model.stable:
                error = output_error(model, stacks)
                cost = float(np.sum(error.shares))
                if best is None or cost < best[0]:
                    best = (cost, model)
    if best is None:
        raise FitError("no stable model was found near the data")
    return best[1], output_error(best[1], stacks)
