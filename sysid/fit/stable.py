"""The best stable model near the data, where the free fit is unstable."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.output_error import OutputError, axis_weights, output_error
from sysid.fit.rows import project, rows
from sysid.model.predict import respond
from sysid.model.structure import FloatArray, Model

STABILITY_PUSHES = (0.03, 0.3, 3.0, 30.0)
STABILITY_MARGIN = 0.1  # 1/s


def held_stable(free: Model, stacks: Sequence[Stack]) -> tuple[Model, OutputError]:
    """The best stable model found by pushing an unstable one's poles across the axis; for judging the free fit.

    A penalty on the poles' real parts grows until they have crossed; the outputs count by their measured power.
    """
    # heavier than NumPy itself to load: only where it is needed
    from scipy.optimize import least_squares

    structure = free.structure
    weights = axis_weights(stacks, output_error(free, stacks).measured_power)
    best: tuple[float, Model] | None = None
    begins = [free.values]
    if not structure.composed:
        begins.append(np.array(structure.base_.uncoupled))
    for begin in begins:
        values = begin
        scale = np.maximum(np.abs(begin), 1.0)
        for push in STABILITY_PUSHES:

            def residuals(x: FloatArray, push: float = push) -> FloatArray:
                real = np.linalg.eigvals(structure.matrices(x).A).real
                parts = [push * np.maximum(real + STABILITY_MARGIN, 0)]
                for group, weight in zip(stacks, weights, strict=True):
                    response = respond(structure, x, group, False)
                    e, E = weight * (group.Y - response.Y), weight * response.E
                    parts += [project(rows(E[..., part]), rows(e[None, :, part]))[0] for part in group.slices]
                return np.concatenate(parts)

            try:
                values = least_squares(residuals, values, x_scale=scale, max_nfev=40).x
            except np.linalg.LinAlgError:
                break  # a step led to where there is no response
        else:
            model = Model(structure, values)
            if model.stable:
                error = output_error(model, stacks)
                cost = float(np.sum(error.residual_power / error.measured_power))
                if best is None or cost < best[0]:
                    best = (cost, model)
    if best is None:
        raise FitError("no stable model was found near the data")
    return best[1], output_error(best[1], stacks)
