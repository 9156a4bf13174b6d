"""The first Fourier bins of real samples, quickly whatever their number.

A run is as long as it was flown, and a fast Fourier transform of a number of samples with a large prime factor takes
ten times as long. Of all its bins a band has a few; these are a convolution with a chirp (Bluestein 1970), which may be
of any length that is not too short, and two rows of real numbers are one of complex ones.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.record import FloatArray

ComplexArray = NDArray[np.complex128]
SLOW_FACTOR = 200
"""Prime factor of a length from which on its own transform takes longer than the chirp's,"""
FEW = 8
"""where of the samples one in so many, or less, is wanted as a bin."""
KEPT = 16
"""Lengths whose chirps are kept: those of the runs of a flight, with bins of two bands."""


class _Chirp(NamedTuple):
    chirp: ComplexArray
    """exp(-j pi i^2 / n), (n,)."""
    transformed: ComplexArray
    """Of its inverse around zero, (length,)."""


def first_bins(rows: FloatArray, count: int) -> ComplexArray:
    """Bins 0 to count - 1 of real samples (r, n), (r, count); count is at most n // 2 + 1."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.fft import fft, ifft, rfft

    n = rows.shape[1]
    if FEW * count > n or largest_factor(n) < SLOW_FACTOR:
        return np.asarray(rfft(rows, axis=1)[:, :count])
    chirp, transformed = _chirp(n, count)
    odd = rows[1::2] if len(rows) % 2 == 0 else np.concatenate([rows[1::2], np.zeros((1, n))])
    found = ifft(fft((rows[0::2] + 1j * odd) * chirp, transformed.size, axis=1) * transformed, axis=1)
    above = found[:, :count] * chirp[:count]
    below = (found[:, -np.arange(count)] * chirp[:count]).conj()
    bins = np.stack([0.5 * (above + below), -0.5j * (above - below)], axis=1)
    return np.asarray(bins.reshape(-1, count)[: len(rows)])


@lru_cache(maxsize=KEPT)
def _chirp(n: int, count: int) -> _Chirp:
    # heavier than NumPy itself to load: only where it is needed
    from scipy.fft import fft, next_fast_len

    i = np.arange(n + count)
    turned = np.exp(-1j * np.pi / n * (i * i % (2 * n)))  # of a whole number of turns nothing is left to round
    length = next_fast_len(n + 2 * count - 2)
    back = np.zeros(length, dtype=complex)
    back[:count] = turned[:count].conj()
    back[1 - n - count :] = turned[:0:-1].conj()
    return _Chirp(turned[:n], np.asarray(fft(back)))


@lru_cache(maxsize=256)
def largest_factor(n: int) -> int:
    """The largest prime factor of a number above 1; of 1 itself 1."""
    largest, factor = 1, 2
    while factor * factor <= n:
        while n % factor == 0:
            largest, n = factor, n // factor
        factor += 1
    return max(largest, n)
