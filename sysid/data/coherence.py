"""How much of one signal follows another, by frequency."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def coherence(u: FloatArray, y: FloatArray, n: int) -> FloatArray:
    """Magnitude-squared coherence of two signals of equal length, Hann pieces of n samples, half overlapping.

    Shape (n // 2 + 1,), 0 where there is no power.
    """
    starts = np.arange(0, u.size - n + 1, max(1, n // 2))
    window = np.hanning(n)
    pieces = starts[:, None] + np.arange(n)
    a = np.fft.rfft((u[pieces] - u.mean()) * window, axis=1)
    b = np.fft.rfft((y[pieces] - y.mean()) * window, axis=1)
    across = np.abs((a.conj() * b).sum(axis=0)) ** 2
    power = (np.abs(a) ** 2).sum(axis=0) * (np.abs(b) ** 2).sum(axis=0)
    result: FloatArray = np.divide(across, power, out=np.zeros_like(across), where=power > 0)
    return result
