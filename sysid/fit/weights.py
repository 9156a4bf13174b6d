"""The weights of a fit over frequency: one over the spectrum of what it leaves, the outputs together.

Noise is seldom white: gusts are strong where the vehicle answers, and a controller hides low frequencies. Where the
excitation was logged, the noise is what it does not explain of the residual; what it does explain is the model's error,
and counts as white, so that no model is excused where it fails. Without an excitation the residual's own spectrum
weighs, smoothed, and again when the fit has moved: there feedback shows at low frequencies, and they lose their weight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.data.instrument import Causes
from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.noise import NEIGHBOURS, WINDOW_HZ, Division, divide
from sysid.fit.output_error import OutputError
from sysid.fit.whitening import whitener_of
from sysid.model.structure import FloatArray

FEWEST = 24
"""Bins of all runs together that a spectrum is averaged over;"""
NARROWEST_HZ = 0.5
WIDTH = 0.3
"""and its width, in Hz and of the frequency."""
CERTAIN = 4.0
"""Standard deviations of chance beyond which what the excitation explains is the model's error."""
LEAST = 1e-10
"""Of the measured power, that noise has at every frequency."""


def spectral_weights(error: OutputError, stacks: Sequence[Stack], causes: Causes | None) -> list[ComplexArray]:
    """For every stack weights (k, k, bins), by what is left; `causes` where the excitation was logged.

    Weighted, what is left has a power of about one in all.
    """
    count = sum(group.z.size for group in stacks)
    least = LEAST * np.diag(np.maximum(error.measured_power, 1e-300)) / count
    if causes is None:
        spectra = _smoothed(error, stacks)
    else:
        division = divide(error, stacks, causes)
        spectra = [division.at(group.frequency_hz) + np.diag(_model_error(division, count)) for group in stacks]
    size = 1 / math.sqrt(2 * count * error.measured_power.size)
    return [
        np.ascontiguousarray((size * group.scale) * whitener_of(S + least).transpose(1, 2, 0))
        for group, S in zip(stacks, spectra, strict=True)
    ]


def inflation(stacks: Sequence[Stack], outputs: int, logged: bool) -> float:
    """By how much variances are larger than those told by the residual that has made its own weights.

    Where it happens to be low it weighs more and seems surer: to first order in one over the bins that are averaged.
    """
    if logged:
        seconds = sum(group.samples * group.dt for group in stacks)
        averaged = (1 + 2 * NEIGHBOURS) * WINDOW_HZ * seconds
    else:
        low, high = _neighbourhood(np.sort(np.concatenate([group.frequency_hz for group in stacks])))
        averaged = 1 / float(np.mean(1 / (high - low)))
    return 1 + 2 * outputs / averaged


def _model_error(division: Division, bins: int) -> FloatArray:
    """What the excitation explains beyond chance, on each bin alike, (k,)."""
    chance = division.degrees + CERTAIN * math.sqrt(2 * division.degrees)
    certain = max(0.0, 1 - chance / max(division.chi_squared, 1e-300))
    return np.asarray(certain * np.maximum(np.sum(division.explained, axis=0), 0) / bins)


def _smoothed(error: OutputError, stacks: Sequence[Stack]) -> list[ComplexArray]:
    """The residual's spectral matrix at the bins of every stack, (bins, k, k), all runs together."""
    frequency = np.concatenate([group.frequency_hz for group in stacks])
    left = np.concatenate([group.scale for group in stacks]) * np.concatenate(error.residuals, axis=1)
    order = np.argsort(frequency, kind="stable")
    sorted_hz, e = frequency[order], left[:, order]
    low, high = _neighbourhood(sorted_hz)
    sums = np.cumsum(e[:, None] * e[None].conj(), axis=2)
    sums = np.concatenate([np.zeros_like(sums[..., :1]), sums], axis=2)
    S = np.empty((frequency.size, *sums.shape[:2]), dtype=complex)
    S[order] = ((sums[..., high] - sums[..., low]) / (high - low)).transpose(2, 0, 1)
    return np.split(S, np.cumsum([group.z.size for group in stacks])[:-1])


def _neighbourhood(frequency_hz: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and beyond the last of the bins that each bin is averaged with; frequencies ascend."""
    half = 0.5 * np.maximum(NARROWEST_HZ, WIDTH * frequency_hz)
    place = np.arange(frequency_hz.size)
    low = np.minimum(np.searchsorted(frequency_hz, frequency_hz - half), place - FEWEST // 2)
    high = np.maximum(np.searchsorted(frequency_hz, frequency_hz + half, side="right"), place + FEWEST // 2)
    return np.maximum(low, 0), np.minimum(high, frequency_hz.size)
