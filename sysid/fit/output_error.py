"""What a model leaves of the measured bins, each segment's trim and end states taken out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.bursts import BURST_S
from sysid.fit.rows import project, rows
from sysid.model.predict import respond
from sysid.model.structure import FloatArray, Model


@dataclass(frozen=True, eq=False)
class OutputError:
    """What a model leaves unexplained, end states projected out."""

    residuals: list[ComplexArray]
    """For every segment (k, bins)."""
    measured_power: FloatArray
    """(k,), mean square times samples, summed over all segments."""
    residual_power: FloatArray
    """(k,)"""
    stacks: Sequence[Stack] = ()
    """Of the segments; none where nobody asks how what is left goes with the motion."""

    @cached_property
    def with_motion(self) -> float:
        """How surely what is left is louder where the motion is: the correlation of both powers' logarithms from one
        BURST_S to the next, as angular accelerations. A model's own error grows with the motion, gusts blow as they
        blow."""
        moved: list[FloatArray] = []
        left: list[FloatArray] = []
        residuals = iter(self.residuals)
        for group in self.stacks:
            for one, part in zip(group.spectra, group.slices, strict=True):
                e, bins = next(residuals), part.stop - part.start
                width = max(1, round(BURST_S * bins / (one.samples * one.dt)))
                by = group.frequency_hz[part] / np.sqrt(np.maximum(self.residual_power, 1e-300))[:, None]
                for found, rates in ((moved, group.Y[:, part] - e), (left, e)):
                    power = np.mean(np.abs(np.fft.ifft(by * rates, axis=1)) ** 2, axis=0)
                    found.append(np.add.reduceat(power, np.arange(0, bins, width)))
        if not moved:
            return 0.0
        x, y = (np.log(np.maximum(np.concatenate(one), 1e-300)) for one in (moved, left))
        x, y = x - np.mean(x), y - np.mean(y)
        return float(x @ y / max(float(np.sqrt((x @ x) * (y @ y))), 1e-300))

    @property
    def shares(self) -> FloatArray:
        """(k,), of the measured power, that is left."""
        return self.residual_power / self.measured_power

    @property
    def nrmse_percent(self) -> FloatArray:
        """Eq. 10 per output, pooled over runs; 100 is perfect."""
        return 100 * (1 - np.sqrt(self.shares))


def output_error(model: Model, stacks: Sequence[Stack]) -> OutputError:
    """What the model leaves of each segment after its own trim and end states."""
    residuals = []
    measured, left = np.zeros((2, len(model.structure.outputs)))
    for group in stacks:
        response = respond(model.structure, model.values, group, False)
        e = group.Y - response.Y
        for part in group.slices:
            scale = group.scale[part.start]
            rest = project(rows(response.E[..., part]), rows(e[None, :, part]))
            left_over: ComplexArray = rest.view(complex).reshape(e.shape[0], -1)
            residuals.append(left_over)
            left += scale**2 * np.sum(np.abs(left_over) ** 2, axis=1)
            measured += scale**2 * np.sum(np.abs(group.Y[:, part]) ** 2, axis=1)
    return OutputError(residuals, measured, left, stacks)


def axis_weights(stacks: Sequence[Stack], power: FloatArray) -> list[FloatArray]:
    """One over the residual's standard deviation, (k, bins), every sample of every run counting the same."""
    floor = 1e-12 * max(float(power.max()), 1e-300)
    scale = 1 / np.sqrt(np.maximum(power, floor))
    return [scale[:, None] * group.scale for group in stacks]
