"""A slow mode that no entry has, moved by the body and pulling at it: a load that swings below, fuel that sloshes.

It is narrower than the windows in which commands are held against a residual, and too slow for a flexible frame. So it
is asked by itself: at frequencies and damping ratios of a grid, what such a mode would add to the outputs, by the
motion that the imposed commands make. On each axis its moment is what any mode of second order makes of the body's
rate, (c + d s)/(s^2 + 2 zeta w s + w^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.record import RATES
from sysid.diagnose.candidate_terms import transfers
from sysid.diagnose.evidence import Candidate, Stepped
from sysid.diagnose.score import along, in_bursts, log_chance
from sysid.diagnose.steep import steep
from sysid.fit.innovations import Innovations
from sysid.fit.whitening import Whitening
from sysid.model.structure import FloatArray

SLOWEST_HZ, FASTEST_HZ = 0.5, 4.0
"""Slower than the second begins what the catalogue's flexible mode is asked at."""
APART = 1.1
"""From one frequency to the next, as wide as a mode of the least damping ratio;"""
INSIDE = 1.2
"""and times the frequencies at which the runs' band ends."""
DAMPING = (0.05, 0.2)


@dataclass(frozen=True, slots=True)
class SlowMode:
    """The one that explains most."""

    frequency_hz: float
    chi_squared: float
    """By the noise near it, where that is more than its spectrum says, or comes in bursts."""
    log_p: float
    """Logarithm of the chance that noise alone shows as much at any point of the grid, known no better than by the
    frequencies near it where the excitation tells noise apart."""


def slow_mode(one: Candidate, stepped: Stepped, whitening: Whitening) -> SlowMode | None:
    """None where the model has no body that turns, or the runs no frequencies at which it is asked."""
    structure, stacks = one.model.structure, one.dataset.stacks
    rates = [name for name in RATES if name in structure.states and name in structure.outputs]
    bins_hz = np.concatenate([group.frequency_hz for group in stacks])
    points = _points(float(np.min(bins_hz)), float(np.max(bins_hz)))
    if not rates or not points:
        return None
    moved = [
        np.stack([T[i] * Y[structure.outputs.index(name)] for i, name in enumerate(rates)])
        for T, Y in zip(transfers(one, [f"{name}_dot" for name in rates]), one.Y_imposed, strict=True)
    ]
    s = [np.asarray(2j * np.pi * group.frequency_hz, dtype=np.complex128) for group in stacks]
    own = stepped.own @ stepped.Z
    near = None if isinstance(whitening, Innovations) else steep(stepped, whitening, one.dataset.causes)

    def known(Z: FloatArray) -> float:
        if near is None:  # of what is new in every sample noise is known well
            return math.inf
        return near.surely(*along(Z, stepped.residual, near.gram(Z)), Z)

    best, shown = SlowMode(0.0, 0.0, math.inf), 0.0
    for frequency_hz, zeta in points:
        Z = whitening([_shaken(each, at, frequency_hz, zeta) for each, at in zip(moved, s, strict=True)])
        Z -= (Z @ stepped.J.T) @ own
        if not np.all(np.isfinite(Z)):  # of a model that runs away
            return None
        chi_squared, degrees = along(Z, stepped.residual)
        if log_chance(chi_squared, degrees) >= max(best.log_p, shown):
            continue
        chi_squared = _surely(Z, chi_squared, stepped, whitening)
        log_p = log_chance(chi_squared, degrees)
        if log_p < best.log_p:
            best = SlowMode(frequency_hz, chi_squared, log_p)
        if log_p < shown:
            shown = min(shown, log_chance(min(chi_squared, known(Z)), degrees))
    return SlowMode(best.frequency_hz, best.chi_squared, min(0.0, shown + math.log(len(points))))


def _points(low_hz: float, high_hz: float) -> list[tuple[float, float]]:
    low, high = max(SLOWEST_HZ, INSIDE * low_hz), min(FASTEST_HZ, high_hz / INSIDE)
    if low >= high:
        return []
    count = 1 + int(math.log(high / low) / math.log(APART))
    return [(low * APART**i, zeta) for i in range(count) for zeta in DAMPING]


def _shaken(moved: ComplexArray, s: ComplexArray, frequency_hz: float, zeta: float) -> ComplexArray:
    """(2 rates, k, bins) of what the body's motion makes of each rate's row, (rates, k, bins)."""
    w = 2 * math.pi * frequency_hz
    mode = moved / (s * s + 2 * zeta * w * s + w * w)
    return np.concatenate([mode, s * mode])


def _surely(Z: FloatArray, chi_squared: float, stepped: Stepped, whitening: Whitening) -> float:
    """Chi squared of the residual along rows (c, N), by the noise near them, and by its power when they act."""
    sure = chi_squared / max(1.0, _noise_near(Z, stepped.residual))
    return min(sure, in_bursts(Z, stepped.residual, stepped.envelope(whitening)))


def _noise_near(Z: FloatArray, residual: FloatArray) -> float:
    """Power of what rows (c, N) leave of the residual where they are large: of white noise 1."""
    basis = np.linalg.qr(Z.T)[0]
    share = np.sum(basis**2, axis=1)
    left = residual - basis @ (residual @ basis)
    return float(share @ left**2) / max(float(share @ (1 - share)), 1e-300)
