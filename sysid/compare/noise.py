"""What of a model's error is noise: from logged excitation, from the commands, or from quiet hover where it was flown.

In quiet hover no command moves, and the residual is noise alone. What quiet hover does not show and the commands do not
explain linearly is the work of a nonlinearity, or of rougher air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.compare.on_runs import ModelOnRuns, power_of_bins
from sysid.compare.values import Densities
from sysid.data.dataset import Dataset
from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.noise import LEAST_FREEDOM, Division, divide
from sysid.fit.output_error import output_error
from sysid.model.structure import FloatArray, Model

CONTROLS = ("delta_e", "delta_c", "delta_r", "delta_a", "r")
"""Logged channels that may move the vehicle beside the structure's own inputs."""
LEAST_CONTROL_SHARE, CONTROL_ERRORS = 0.05, 4.0
"""Of the error, and standard deviations of what noise would seem to explain, for a control to count."""
SIGNIFICANT = 0.01
SIGNIFICANT_AXIS = 2.6
"""Standard deviations of what noise alone would seem to explain: 0.5 % for each of two axes."""
TESTABLE = 0.5
"""Part of the windows that must have bins enough to tell noise from error."""
QUIET_ERRORS = 2.6
"""Standard errors of quiet hover's power by which it must lie below what the commands leave, to count as less."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Levels:
    """The division's windows with the bins in them."""

    frequency_hz: FloatArray
    """(bins,), of all stacks."""
    window: FloatArray
    """(bins,), number of the window that each lies in."""
    count: FloatArray
    """(w,)"""
    noise: FloatArray
    """(w, k), power per bin that the commands do not explain."""
    unknowns: float
    """Per window."""
    testable: float
    """Part of the windows in which noise could be told from error."""

    @classmethod
    def of(cls, division: Division, stacks: Sequence[Stack]) -> Levels:
        frequency = np.concatenate([group.frequency_hz for group in stacks])
        window = window_of(frequency, division.edges_hz)
        w = division.power.shape[0]
        count = np.bincount(window, minlength=w).astype(float)
        noise = np.maximum(division.power - division.explained, 0) / np.maximum(count, 1)[:, None]
        unknowns = 2 * len(division.commands)
        filled = count[count > 0]
        return cls(
            frequency_hz=frequency,
            window=window,
            count=count,
            noise=noise,
            unknowns=unknowns,
            testable=float(np.mean(filled >= unknowns + LEAST_FREEDOM)),
        )


def window_of(frequency_hz: FloatArray, edges_hz: FloatArray) -> Any:
    return np.clip(np.searchsorted(edges_hz, frequency_hz, side="right") - 1, 0, edges_hz.size - 2)


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseShare:
    """What of the error is noise, from the best source there is."""

    share: FloatArray | None
    """(k,), None where the runs are too short to tell and no quiet hover was flown."""
    levels: FloatArray
    """(w, k), power per bin."""
    source: str
    ratio: FloatArray | None
    """(k,), quiet hover's noise over what the commands leave."""
    distortion: FloatArray
    """(k,), share of the error that is neither as in quiet hover nor linear in the commands."""
    explained: bool | None
    axes: FloatArray
    """(k,), standard deviations by which the commands explain more than they would of noise alone."""

    @classmethod
    def of(
        cls, division: Division, measured: bool, levels: Levels, calm: QuietHover | None, power: FloatArray
    ) -> NoiseShare:
        # heavier than NumPy itself to load: only where it is needed
        from scipy.special import chdtrc

        whole = np.maximum(np.sum(power, axis=1), 1e-300)
        left = np.sum(levels.noise * levels.count[:, None], axis=0)
        spread = np.sqrt(np.sum(levels.unknowns * levels.noise**2 * (levels.count > 0)[:, None], axis=0))
        axes = np.sum(division.explained, axis=0) / np.maximum(spread, 1e-300)
        testable = levels.testable >= TESTABLE
        explained = bool(chdtrc(division.degrees, division.chi_squared) < SIGNIFICANT) if testable else None
        source = "logged excitation" if measured else "commands"
        none = np.zeros(whole.size)
        if calm is None:
            share = division.noise_share if testable else None
            return cls(
                share=share,
                levels=levels.noise,
                source=source,
                ratio=None,
                distortion=none,
                explained=explained,
                axes=axes,
            )
        quiet = np.sum(calm.power * levels.count[:, None], axis=0)
        spread = np.sqrt(np.sum((calm.power * levels.count[:, None]) ** 2 / calm.count[:, None], axis=0))
        less = quiet + QUIET_ERRORS * spread < left
        # rougher air than in the sweeps must not hide what the logged excitation shows to be error
        use = less if measured and testable else np.ones(whole.size, dtype=bool)
        return cls(
            share=np.clip(np.where(use, quiet, left) / whole, 0, 1),
            levels=np.where(use, calm.power, levels.noise),
            source="quiet hover" if np.any(use) else source,
            ratio=quiet / np.maximum(left, 1e-300) if testable else None,
            distortion=np.where(less & testable, (left - quiet) / whole, 0.0),
            explained=explained,
            axes=axes,
        )

    @property
    def more(self) -> Any:
        """(k,), whether there is more than noise."""
        if self.explained is None:
            return np.ones(self.axes.size, dtype=bool)
        return self.explained & (self.axes > SIGNIFICANT_AXIS)

    def at_most(self, share: FloatArray) -> NoiseShare:
        """The same with less noise: more than that is known to be error."""
        if self.share is None:
            return self
        less = np.clip(np.minimum(self.share, share), 0, 1)
        levels = self.levels * less / np.maximum(self.share, 1e-12)
        return replace(self, share=less, levels=levels, explained=True, axes=np.full(less.size, np.inf))


@dataclass(frozen=True, eq=False)
class QuietHover:
    """Quiet hover's noise in the division's windows."""

    power: FloatArray
    """(w, k), per bin: a bin's power does not depend on how long a run is, so it is the same in the sweeps."""
    count: FloatArray
    """(w,), bins that each was averaged over."""


def quiet_levels(
    model: Model,
    still: Dataset,
    edges_hz: FloatArray,
) -> tuple[QuietHover | None, list[str]]:
    """What the model leaves of quiet hover, the noise, and remarks on its preparation; None where there is none."""
    remarks = still.remarks
    stacks = still.viewed(model.structure.inputs, model.structure.outputs).stacks
    if not stacks:
        return None, remarks
    power = power_of_bins(output_error(model, stacks), stacks)
    window = window_of(np.concatenate([group.frequency_hz for group in stacks]), edges_hz)
    w = edges_hz.size - 1
    count = np.bincount(window, minlength=w)
    if not np.any(count):
        return None, remarks
    sums = np.stack([np.bincount(window, row, w) for row in power], axis=-1)
    have = count > 0
    centres = 0.5 * (edges_hz[1:] + edges_hz[:-1])
    levels = [np.interp(centres, centres[have], sums[have, k] / count[have]) for k in range(power.shape[0])]
    return QuietHover(np.stack(levels, axis=-1), np.maximum(count, 1).astype(float)), remarks


def densities(on: ModelOnRuns, levels: Levels, noise: NoiseShare) -> Densities:
    """Spectra in the division's windows."""
    stacks, error = on.stacks, on.error
    scale = np.concatenate([group.scale * np.sqrt(group.dt) for group in stacks])
    dt = float(np.sum([group.samples * group.dt for group in stacks]) / np.sum([group.samples for group in stacks]))
    count = np.maximum(levels.count, 1)[:, None]

    def density(rows: ComplexArray) -> FloatArray:
        power = np.abs(scale * rows) ** 2
        sums = np.stack([np.bincount(levels.window, row, levels.count.size) for row in power], axis=-1)
        return np.asarray(np.sqrt(sums / count))

    have = levels.count > 0
    sums = np.bincount(levels.window, levels.frequency_hz, levels.count.size)
    return Densities(
        (sums / count[:, 0])[have],
        density(np.concatenate([group.Y for group in stacks], axis=1))[have],
        density(np.concatenate(error.residuals, axis=1))[have],
        np.sqrt(noise.levels * dt)[have],
    )


def other_controls(on: ModelOnRuns) -> tuple[dict[str, dict[str, float]], Division]:
    """What other logged controls explain of the error beyond the commands, and the division that counts them too."""
    structure, division = on.model.structure, on.division
    other = [
        name
        for name in CONTROLS
        if name not in (*structure.inputs, *structure.outputs)
        and all(name in one.channels and np.ptp(one.channels[name]) for one in on.records)
    ]
    if not other:
        return {}, division
    bins = on.dataset.viewed((*structure.inputs, *other), structure.outputs)
    whole = np.maximum(np.sum(division.power, axis=0), 1e-300)
    level = Levels.of(division, on.stacks).noise
    chance = np.sqrt(np.sum(2 * level**2, axis=0)) / whole
    shares: dict[str, dict[str, float]] = {}
    strong = []
    for name in other:
        more = divide(on.error, bins.stacks, bins.causes((*structure.commands, name)))
        gained = np.sum(more.explained - division.explained, axis=0) / whole
        shares[name] = on.by_output(np.clip(gained, 0, 1))
        if np.any(gained > np.maximum(LEAST_CONTROL_SHARE, CONTROL_ERRORS * chance)):
            strong.append(name)
    if not strong:
        return shares, division
    return shares, divide(on.error, bins.stacks, bins.causes((*structure.commands, *strong)))
