"""The probe's samples on an even grid, smoothed alike, and what was added to the commands meanwhile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from gcs.cards.maneuver import Maneuver
from gcs.flight.probe.values import LETTERS, FloatArray, ProbeStep, Samples
from sysid.data.chirp import Chirp

GRID_S = 0.01
_SMOOTH_HZ = 5.0
_CHANNELS = ("p", "q", "delta_x", "delta_y", "delta_e", "excitation_x", "excitation_y", "excitation_e", "phi", "theta")


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Gridded:
    """A step on an even grid: means over `GRID_S`, smoothed alike, so that what leads from one to another is kept."""

    axis: str
    u: dict[str, FloatArray]
    """Commands by letter."""
    e: dict[str, FloatArray]
    """What was added, by letter, as logged or worked out; the command itself where neither is possible."""
    y: dict[str, FloatArray]
    rows: NDArray[np.bool_]
    """Where samples were."""
    raw: dict[str, FloatArray]
    """As logged, not smoothed."""


def means(samples: Samples) -> tuple[dict[str, FloatArray], NDArray[np.bool_]]:
    """Every known channel as means over the grid, gaps bridged, and where there were samples."""
    t = samples["t"]
    at = np.floor((t - t[0]) / GRID_S + 1e-6).astype(int)
    size = int(at[-1]) + 1
    grid = np.arange(size)
    there = np.bincount(at, minlength=size) > 0
    # A log slower than the grid leaves holes that are none.
    width = max(1, math.ceil(2 * float(np.median(np.diff(t))) / GRID_S))
    rows = np.convolve(there, np.ones(width), "same") > 0
    known = {}
    for name in _CHANNELS:
        values = samples.get(name)
        if values is None:
            continue
        finite = np.isfinite(values)
        if finite.sum() < 10 or finite.mean() < 0.5:
            continue
        count = np.bincount(at[finite], minlength=size)
        total = np.bincount(at[finite], np.asarray(values)[finite], minlength=size)
        has = count > 0
        known[name] = np.interp(grid, grid[has], total[has] / count[has])
    return known, rows


def smooth(values: FloatArray) -> FloatArray:
    """Without what is faster than `_SMOOTH_HZ`, and not later; values on the grid, shape (n,)."""
    sos = signal.butter(4, _SMOOTH_HZ, fs=1 / GRID_S, output="sos")
    slow: FloatArray = signal.sosfiltfilt(sos, values, padlen=min(50, values.size - 1))
    return slow


def gridded(step: ProbeStep, rates: Sequence[str]) -> Gridded:
    """A step's commands, what was added to them, and these rates."""
    raw, rows = means(step.samples)
    letter = LETTERS[step.maneuver.axis]
    size = rows.size
    letters = ("e",) if letter == "e" else ("x", "y")
    nothing = np.zeros(size)
    u = {k: smooth(raw.get("delta_" + k, nothing)) for k in letters}
    added = raw.get("excitation_" + letter)
    if added is None and step.start_s is not None:
        since = np.asarray(float(step.samples["t"][0]) + (np.arange(size) + 0.5) * GRID_S - step.start_s, float)
        added = _law(step.maneuver, since)
    e = dict.fromkeys(letters, nothing)
    # Its mean over what came before is what feedback and trim held: only what moves counts.
    e[letter] = u[letter] - u[letter].mean() if added is None else smooth(added)
    y = {name: smooth(raw[name]) if name in raw else nothing for name in rates}
    return Gridded(axis=step.maneuver.axis, u=u, e=e, y=y, rows=rows, raw=raw)


def _law(maneuver: Maneuver, t: FloatArray) -> FloatArray:
    """What the vehicle adds, from the start of the excitation: doublets, or ArduPilot's chirp without its fades."""
    flown = (t >= 0) & (t < maneuver.duration_s)
    if maneuver.kind == "doublet":
        pulse = np.floor(t / maneuver.pulse_s) % 6
        return np.asarray(maneuver.amplitude * flown * np.select([pulse == 0, pulse == 1], [1.0, -1.0], 0.0))
    chirp = Chirp(
        axis=maneuver.axis,
        law="ardupilot",
        f_start_hz=maneuver.f_start_hz,
        f_stop_hz=maneuver.f_stop_hz,
        duration_s=maneuver.duration_s,
    )
    return maneuver.amplitude * chirp.wave(t)
