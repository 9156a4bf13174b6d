"""A model on the runs that it is compared on, prepared once: bins, residual, and what the excitation caused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.dataset import Bins, Dataset
from sysid.data.instrument import Causes
from sysid.data.preprocess import Spectrum
from sysid.data.record import Record
from sysid.data.stacks import Stack
from sysid.errors import SysidError
from sysid.fit.noise import Division, divide
from sysid.fit.output_error import OutputError, output_error
from sysid.model.structure import FloatArray, Model


class CompareError(SysidError):
    """Runs that a model cannot be compared on; the message says why and what to do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelOnRuns:
    """What a model leaves of flown runs."""

    model: Model
    dataset: Dataset
    bins: Bins
    """With the model's inputs and outputs."""
    error: OutputError

    @classmethod
    def of(cls, model: Model, runs: Dataset) -> ModelOnRuns:
        """Raises CompareError where these runs hold nothing to compare on."""
        structure = model.structure
        if not runs.pieces:
            raise CompareError(
                f"no run has 2 s of gap-free samples: nothing to compare on. {'; '.join(runs.remarks)}".strip()
            )
        bins = runs.viewed(structure.inputs, structure.outputs)
        if not bins.stacks:
            low, high = runs.band_hz
            raise CompareError(f"no frequency lies in {low:g}-{high:g} Hz: widen the band or take longer runs")
        error = output_error(model, bins.stacks)
        if not np.all(error.measured_power > 0):
            dead = ", ".join(name for name, x in zip(structure.outputs, error.measured_power, strict=True) if not x > 0)
            raise CompareError(f"{dead} does not move at all in these runs: check the gyro's channel")
        return cls(model=model, dataset=runs, bins=bins, error=error)

    @property
    def records(self) -> tuple[Record, ...]:
        return self.dataset.records

    @property
    def stacks(self) -> tuple[Stack, ...]:
        return self.bins.stacks

    @property
    def causes(self) -> Causes:
        """What the excitation caused in each of the model's commands."""
        return self.bins.causes(self.model.structure.commands)

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.model.structure.outputs

    @property
    def spectra(self) -> list[Spectrum]:
        """In the order of the residuals."""
        return [one for group in self.stacks for one in group.spectra]

    @cached_property
    def division(self) -> Division:
        """The residual, divided into what the commands explain and noise."""
        return divide(self.error, self.stacks, self.causes)

    @cached_property
    def frequency_hz(self) -> FloatArray:
        """(bins,), of all stacks side by side."""
        return np.concatenate([group.frequency_hz for group in self.stacks])

    @cached_property
    def power(self) -> FloatArray:
        """(k, bins) of the residual, of all stacks side by side, every sample counting the same."""
        return power_of_bins(self.error, self.stacks)

    @property
    def residual_power(self) -> FloatArray:
        """(k,), never quite nothing."""
        return np.maximum(self.error.residual_power, 1e-300)

    def by_output(self, values: Any) -> dict[str, float]:
        """(k,) numbers by the outputs' names."""
        return dict(zip(self.outputs, map(float, values), strict=True))


def power_of_bins(error: OutputError, stacks: Sequence[Stack]) -> FloatArray:
    """(k, bins) of all stacks side by side, every sample counting the same."""
    scale = np.concatenate([group.scale for group in stacks])
    return np.asarray((scale * np.abs(np.concatenate(error.residuals, axis=1))) ** 2)
