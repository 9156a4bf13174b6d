"""How far a model is from the measured responses, and one model from another, in dB and degrees.

Engineers judge so (Tischler and Remple, Aircraft and Rotorcraft System Identification): responses are compared where
the coherence is at least 0.6, and an integrated cost J weighs 1 dB as 7.57 degrees,

    J = 20/n sum W (dB^2 + 0.01745 degree^2),   W = (1.58 (1 - exp(-gamma^2)))^2,   n = 20 points,

gamma^2 being the coherence function itself: W is 1 at full coherence and one half at 0.6. J up to 100 is good, up to
50 hardly to be told from the flight. The difference of two models near zero parameters is told so, not in percent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.data.dataset import Bins
from sysid.data.onboard_model import OnboardModel
from sysid.data.preprocess import DEFAULT_BAND_HZ, ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.output_error import OutputError, output_error
from sysid.fit.result import finite
from sysid.model.predict import respond
from sysid.model.response import transfer
from sysid.model.structure import FloatArray, Model
from sysid.response.measure import judged
from sysid.response.values import LEAST_COHERENCE, Responses, widest
from sysid.response.windows import Solution, Windows, windows

GOOD_COST = 100.0
COST_POINTS = 20
PHASE_WEIGHT = 0.01745
ONBOARD_FROM_HZ = 0.5


@dataclass(frozen=True, eq=False)
class Difference:
    """One response, a model's less another's or the measured one's."""

    output: str
    command: str
    frequency_hz: FloatArray
    """(f,), the frequencies compared; empty where there were none."""
    decibels: FloatArray
    """(f,)"""
    degrees: FloatArray
    """(f,), -180..180."""

    @property
    def band_hz(self) -> tuple[float, float] | None:
        return None if not self.frequency_hz.size else (float(self.frequency_hz[0]), float(self.frequency_hz[-1]))

    @property
    def rms(self) -> tuple[float, float]:
        """dB and degrees, every octave counting the same."""
        return _rms(self.decibels), _rms(self.degrees)

    @property
    def largest(self) -> tuple[float, float]:
        """dB and degrees."""
        return _largest(self.decibels), _largest(self.degrees)

    def to_json(self) -> dict[str, Any]:
        band = self.band_hz
        return {
            "output": self.output,
            "input": self.command,
            "band_hz": None if band is None else list(band),
            "rms_db": finite(self.rms[0]),
            "rms_deg": finite(self.rms[1]),
            "largest_db": finite(self.largest[0]),
            "largest_deg": finite(self.largest[1]),
        }


@dataclass(frozen=True, eq=False)
class Mismatch(Difference):
    """A model's response less the measured one, in the band where the measured one can be trusted."""

    coherence: FloatArray
    """(f,), partial."""
    cost: float
    """J; NaN without a band."""

    def to_json(self) -> dict[str, Any]:
        return {**super().to_json(), "cost": finite(self.cost)}


@dataclass(frozen=True, eq=False)
class Mismatches:
    """Every response of a model beside the measured one."""

    each: tuple[Mismatch, ...]
    measured: Responses


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelResponses:
    """A model's responses and what they lack of the measured ones, all runs averaged in the same windows."""

    windows: Windows
    outputs: tuple[str, ...]
    expected: ComplexArray
    """(k, m, f), the model's."""
    left: Solution
    """What the windows say of the residual: measured less modelled, and its noise."""

    @classmethod
    def of(cls, model: Model, stacks: Sequence[Stack], error: OutputError) -> ModelResponses:
        """The model flies the same commands through the same averaging; `error` is what it leaves of the stacks, trims
        and end states taken out, so that the differences are the model's and not the method's."""
        structure = model.structure
        cut = windows(stacks, structure.commands)
        modelled: ComplexArray = np.concatenate(
            [respond(structure, model.values, group, False).Y for group in stacks], axis=1
        )
        left = cut.solve(np.concatenate(error.residuals, axis=1))
        return cls(windows=cut, outputs=structure.outputs, expected=cut.solve(modelled).H, left=left)


def mismatch(model: Model, bins: Bins) -> Mismatches:
    """Compare a model with the flown responses, output by output and command by command."""
    return mismatches(ModelResponses.of(model, bins.stacks, output_error(model, bins.stacks)))


def mismatches(of: ModelResponses) -> Mismatches:
    """The differences in the bands where measured responses can be trusted."""
    cut = of.windows
    measured = judged(cut, of.outputs, of.left._replace(H=of.expected + of.left.H))
    found = []
    for k, output in enumerate(of.outputs):
        for m, command in enumerate(cut.commands):
            with np.errstate(divide="ignore", invalid="ignore"):
                ratio = of.expected[k, m] / measured.H[k, m]
            coherence = measured.partial_coherence[k, m]
            use = widest(np.isfinite(ratio) & (coherence >= LEAST_COHERENCE))
            decibels, degrees = _apart(ratio[use])
            frequency = cut.frequency_hz[use]
            cost = integrated_cost(frequency, decibels, degrees, coherence[use])
            found.append(Mismatch(output, command, frequency, decibels, degrees, coherence=coherence[use], cost=cost))
    return Mismatches(tuple(found), measured)


def integrated_cost(
    frequency_hz: FloatArray, decibels: FloatArray, degrees: FloatArray, coherence: FloatArray
) -> float:
    """J of the differences (f,) at 20 points spread evenly over the octaves; NaN where there is no band."""
    if not frequency_hz.size:
        return float("nan")
    at = np.geomspace(frequency_hz[0], frequency_hz[-1], COST_POINTS)
    x = np.log(frequency_hz)
    dB, phase, gamma = (np.interp(np.log(at), x, y) for y in (decibels, degrees, coherence))
    weight = (1.58 * (1 - np.exp(-gamma))) ** 2
    return float(20 / COST_POINTS * np.sum(weight * (dB**2 + PHASE_WEIGHT * phase**2)))


def response_difference(
    model: Model, other: Model, band_hz: tuple[float, float] = DEFAULT_BAND_HZ, points: int = 60
) -> tuple[Difference, ...]:
    """A model's responses less another's, on a logarithmic grid of the band (from 0.1 Hz where it begins at zero).

    For every command that both have. Nonlinear effects count as in small motion.
    """
    frequency = np.geomspace(max(band_hz[0], 0.1), band_hz[1], points)
    ours = transfer(model.structure, model.values, frequency)
    theirs = transfer(other.structure, other.values, frequency)
    found = []
    for k, output in enumerate(model.structure.outputs):
        for m, command in enumerate(model.structure.commands):
            if command in other.structure.commands:
                with np.errstate(divide="ignore", invalid="ignore"):
                    ratio = ours[k, m] / theirs[k, other.structure.commands.index(command)]
                found.append(Difference(output, command, frequency, *_apart(ratio)))
    return tuple(found)


def onboard_difference(
    model: Model, onboard: OnboardModel, band_hz: tuple[float, float], points: int = 40
) -> Difference:
    """A model's response less what the vehicle identified itself, from 0.5 Hz on, where PX4's high-pass lets through.

    Empty where the model has no such response, or the band lies beyond what the vehicle's sampling shows.
    """
    low, high = max(band_hz[0], ONBOARD_FROM_HZ), min(band_hz[1], onboard.highest_hz)
    structure = model.structure
    if low >= high or onboard.output not in structure.outputs or onboard.command not in structure.commands:
        return Difference(onboard.output, onboard.command, np.empty(0), np.empty(0), np.empty(0))
    frequency = np.geomspace(low, high, points)
    ours = transfer(structure, model.values, frequency)
    ours = ours[structure.outputs.index(onboard.output), structure.commands.index(onboard.command)]
    return Difference(onboard.output, onboard.command, frequency, *_apart(ours / onboard.response(frequency)))


def _apart(ratio: ComplexArray) -> tuple[FloatArray, FloatArray]:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(20 * np.log10(np.abs(ratio))), np.asarray(np.degrees(np.angle(ratio)))


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else float("nan")


def _largest(x: FloatArray) -> float:
    return float(np.max(np.abs(x))) if x.size else float("nan")
