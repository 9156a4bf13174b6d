"""Measured responses as values: what was measured, how far chance can have moved it, and where it can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray, gusts_kept_out
from sysid.data.record import FloatArray

LEAST_COHERENCE = 0.6
FEWEST_POINTS = 3
BRIDGED = 4
"""Points of the grid, a third of an octave."""
PROBABILITY = 0.95
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, kw_only=True)
class Responses:
    """Outputs per command on a grid of frequencies; NaN where the runs do not separate the commands."""

    frequency_hz: FloatArray
    """(f,)"""
    outputs: tuple[str, ...]
    commands: tuple[str, ...]
    H: ComplexArray
    """(k, m, f), output units per full command, the loop's hold taken out."""
    error: FloatArray
    """(k, m, f), standard error of H, in its units: real and imaginary part together, by chance and by blur."""
    freedom: FloatArray
    """(k, m, f), how many numbers the noise was measured from."""
    half_width_hz: FloatArray
    """(k, m, f), how far the windows reached, on average."""
    multiple_coherence: FloatArray
    """(k, f): share of each output's power that all commands together explain, counting what the reference caused."""
    partial_coherence: FloatArray
    """(k, m, f): the same for one command, what the other commands explain taken away before."""
    references: tuple[str, ...]
    """For each command the channel that gusts do not reach, or the command itself where none is logged."""

    def separates(self, output: str, command: str) -> bool:
        """Whether there is a response anywhere: both axes were swept, each command moved for itself."""
        return bool(np.any(np.isfinite(self.H[self.outputs.index(output), self.commands.index(command)])))

    @property
    def closed_loop_safe(self) -> bool:
        """Whether logged excitation kept the gusts out of every response."""
        return gusts_kept_out(self.references)

    @property
    def decibels(self) -> FloatArray:
        """(k, m, f)"""
        with np.errstate(divide="ignore"):
            return np.asarray(20 * np.log10(np.abs(self.H)))

    @property
    def degrees(self) -> FloatArray:
        """(k, m, f), without turns of 360 degrees between points; the first that can be trusted in -180..180."""
        rows = [_unwrapped(self.H[pair], self.trusted[pair]) for pair in np.ndindex(self.H.shape[:2])]
        return np.stack(rows).reshape(self.H.shape)

    @property
    def relative_bound(self) -> FloatArray:
        """(k, m, f): of the response's own size, what 95 of 100 errors along it, or across it, are below.

        NaN where it is as large as the response.
        """
        # heavier than NumPy itself to load: only where it is needed
        from scipy.special import stdtrit

        factor = stdtrit(np.maximum(self.freedom, 1.0), 0.5 + PROBABILITY / 2)
        with np.errstate(invalid="ignore", divide="ignore"):
            bound = factor * self.error / (np.sqrt(2) * np.abs(self.H))
            return np.where(bound < 1, bound, np.nan)

    @property
    def bound_db(self) -> FloatArray:
        """(k, m, f), to either side."""
        return np.asarray(20 / np.log(10) * self.relative_bound)

    @property
    def bound_deg(self) -> FloatArray:
        """(k, m, f), to either side."""
        return np.degrees(np.arcsin(self.relative_bound))

    @property
    def trusted(self) -> BoolArray:
        """(k, m, f): coherent, and bounded."""
        return np.asarray(np.isfinite(self.relative_bound) & (self.partial_coherence >= LEAST_COHERENCE))

    def valid(self, output: str, command: str) -> BoolArray:
        """(f,): the longest stretch that can be trusted."""
        return widest(self.trusted[self.outputs.index(output), self.commands.index(command)])

    def valid_hz(self, output: str, command: str) -> tuple[float, float] | None:
        """First and last frequency that can be trusted; None where no stretch can."""
        inside = self.frequency_hz[self.valid(output, command)]
        return (float(inside[0]), float(inside[-1])) if inside.size else None


def widest(good: BoolArray) -> BoolArray:
    """The points of the longest stretch of a row (f,), gaps of a few points allowed: a response may dip at a zero.

    None where it would have fewer than FEWEST_POINTS.
    """
    at = np.flatnonzero(good)
    stretches = np.split(at, np.flatnonzero(np.diff(at) > 1 + BRIDGED) + 1)
    longest = max(stretches, key=lambda one: int(one[-1] - one[0]) if one.size else -1)
    found = np.zeros(good.shape, dtype=bool)
    if longest.size >= FEWEST_POINTS:
        found[longest] = True
    return found


def _unwrapped(H: ComplexArray, good: BoolArray) -> FloatArray:
    """Phase of one response (f,), followed over the points that can be trusted; the others lie nearest to these."""
    phase = np.degrees(np.angle(H))
    at = np.flatnonzero(good)
    if not at.size:
        return np.asarray(phase)
    near = np.interp(np.arange(phase.size), at, np.unwrap(phase[at], period=360.0))
    return np.asarray(phase + 360 * np.round((near - phase) / 360))
