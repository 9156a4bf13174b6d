"""Measured and modelled rates in time, both as the fit saw them: inside its band, trims and end states estimated."""

from __future__ import annotations

import numpy as np

from sysid.fit import output_error
from sysid.model import Model
from sysid.predict import stack
from sysid.preprocess import ComplexArray, Spectrum
from sysid.record import FloatArray


def overlay(model: Model, spectrum: Spectrum) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time (n,), measured (n, k) and modelled (n, k) rates in rad/s, by the inverse transform of the band's bins."""
    (residual,) = output_error(model, stack([spectrum])).residuals
    return spectrum.segment.t, _in_time(spectrum.Y, spectrum), _in_time(spectrum.Y - residual, spectrum)


def _in_time(bins: ComplexArray, spectrum: Spectrum) -> FloatArray:
    from scipy.fft import irfft

    n = spectrum.samples
    whole = np.zeros((bins.shape[0], n // 2 + 1), dtype=complex)
    whole[:, spectrum.first : spectrum.first + bins.shape[1]] = bins
    return np.asarray(irfft(whole, n, axis=1).T)
