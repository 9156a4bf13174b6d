"""What is set beside a comparison: another model over the same measurement, and the part of a residual in a band."""

from __future__ import annotations

import numpy as np

from sysid.compare.values import Trace
from sysid.model.structure import FloatArray, Model

SMOOTHED_S = 1.0
LOUD = 0.5
"""Of the largest smoothed power: what is louder holds most of it."""


def modelled_by(trace: Trace, own: Model, other: Model) -> FloatArray | None:
    """What another model makes of a trace's commands, (k, n) rad/s; `own` is the model that the trace was made with.

    The difference of the two responses is added to the trace's own, so that what both take out of the measurement
    (trims, end states) stays as it is. None where that is not possible: a model is not linear, has other outputs, or
    inputs that the trace has not.
    """
    from sysid.model.response import transfer

    n = trace.t.size
    inputs = own.structure.inputs
    alike = own.structure.outputs == other.structure.outputs and inputs == other.structure.inputs
    if n < 2 or not alike or not set(inputs) <= set(trace.commands) or not (_linear(own) and _linear(other)):
        return None
    step_hz = (n - 1) / (n * float(trace.t[-1] - trace.t[0]))
    frequency_hz = step_hz * np.arange(1.0, n // 2 + 1)  # from above zero: the trims are out
    U = np.fft.rfft(np.stack([trace.commands[name] for name in inputs]))[:, 1:]
    H, H_own = (transfer(one.structure, one.values, frequency_hz) for one in (other, own))
    change = np.einsum("kmf,mf->kf", H - H_own, U)
    return np.asarray(trace.modelled + np.fft.irfft(np.pad(change, ((0, 0), (1, 0))), n))


def _linear(model: Model) -> bool:
    return all(one.linear and one.samples is None for one in model.structure.composed)


def in_band(t: FloatArray, values: FloatArray, band_hz: tuple[float, float]) -> FloatArray:
    """The part of a signal between two frequencies, (n,); t, (n,), evenly spaced."""
    if t.size < 2:
        return np.zeros(t.size)
    frequency_hz = np.fft.rfftfreq(t.size, float(t[-1] - t[0]) / (t.size - 1))
    inside = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    return np.asarray(np.fft.irfft(np.where(inside, np.fft.rfft(values), 0), t.size))


def loud(t: FloatArray, values: FloatArray) -> tuple[tuple[float, float], ...]:
    """Stretches of time, s, in which a signal's power over a second is above half of its largest."""
    if t.size < 2:
        return ()
    dt = float(t[-1] - t[0]) / (t.size - 1)
    width = min(max(1, round(SMOOTHED_S / dt)), t.size)
    power = np.convolve(values**2, np.ones(width) / width, mode="same")
    if not power.max() > 0:
        return ()
    at = np.flatnonzero(power >= LOUD * power.max())
    parts = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
    return tuple((float(t[one[0]]), float(t[one[-1]])) for one in parts)
