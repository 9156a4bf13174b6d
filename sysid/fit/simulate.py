"""Measured and modelled rates in time, both as the fit saw them: inside its band, trims and end states estimated."""

from __future__ import annotations

from sysid.data.preprocess import Spectrum
from sysid.data.record import FloatArray
from sysid.data.stacks import stack
from sysid.fit.output_error import output_error
from sysid.model.structure import Model


def overlay(model: Model, spectrum: Spectrum) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Time (n,), measured (n, k) and modelled (n, k) rates in rad/s, by the inverse transform of the band's bins."""
    (residual,) = output_error(model, stack([spectrum])).residuals
    return spectrum.segment.t, spectrum.in_time(spectrum.Y).T, spectrum.in_time(spectrum.Y - residual).T
