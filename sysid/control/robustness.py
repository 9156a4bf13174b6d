"""What a loop holds in both commands at once, and how it handles: of a model, delay included, over all frequencies.

The disk margin is that of Seiler, Packard and Gahinet (2020), skew 0: each command may have its own gain and phase, at
once, inside a disk. Of two commands the structured singular value is its bound by diagonal scalings, in closed form:
scalings leave |det| alone, and of 2x2 matrices of one |det| the largest singular value is least where the Frobenius
norm is, where both off-diagonal elements have one size. Of three the Frobenius norm is made least, too: a bound.

Bandwidth and phase delay are ADS-33E-PRF's (3.3.2.1), of the attitude that follows a rate command: where it lags by 135
degrees, or has 6 dB left to where it lags by 180. Disturbance rejection is that of the sensitivity of the rates, which
is the attitudes' as well: bandwidth where it passes -3 dB, and peak (ADS-33F's, Berger et al. 2016).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sysid.control.loop import AXES, commands_per_rate
from sysid.control.regulator import Gains
from sysid.control.stability import commands_of, crossings_hz, frequencies, from_rates, loop_of, rates_per_command
from sysid.data.preprocess import ComplexArray
from sysid.fit.result import finite
from sysid.model.structure import FloatArray, Model

LOWEST_HZ, HIGHEST_HZ, POINTS = 0.02, 200.0, 3000
"""Where handling is looked at."""
ZOOM, ZOOMS = 40, 3
"""Times finer, and how often, about the largest value."""
BALANCINGS = 8
TINY = 1e-30
DB = 20 / math.log(10)


@dataclass(frozen=True, kw_only=True)
class DiskMargin:
    """Of both commands at once."""

    size: float
    """alpha: 0 none, 2 any gain."""
    frequency_hz: float

    @property
    def gain_db(self) -> float:
        """To either side, in each command by itself;"""
        return DB * math.log((2 + self.size) / (2 - self.size)) if self.size < 2 else math.inf

    @property
    def phase_deg(self) -> float:
        """the same, where gains are as designed."""
        return math.degrees(2 * math.atan(self.size / 2))

    def to_json(self) -> dict[str, float | None]:
        return {
            "size": finite(self.size),
            "gain_db": finite(self.gain_db),
            "phase_deg": finite(self.phase_deg),
            "frequency_hz": finite(self.frequency_hz),
        }


@dataclass(frozen=True, kw_only=True)
class Rejection:
    """How a disturbance of one rate is met."""

    hz: float | None
    """Up to where less than -3 dB of it is left; None where that is nowhere, as in a loop without integral action."""
    peak_db: float
    peak_hz: float


@dataclass(frozen=True, kw_only=True)
class Handling:
    """Of one axis; None of what is nowhere between 0.02 and 200 Hz."""

    axis: str
    bandwidth_hz: float | None
    phase_delay_ms: float | None
    limited_by: str | None
    """`gain` or `phase`."""
    rejection_hz: float | None
    """As of `Rejection`."""
    rejection_peak_db: float
    rejection_peak_hz: float

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class Robustness:
    """Beside the classical margins."""

    disk: DiskMargin
    crossover_hz: float | None
    """The highest at which a locus has the size 1; None where none has."""
    handling: tuple[Handling, ...]

    def to_json(self) -> dict[str, Any]:
        return {
            "disk": self.disk.to_json(),
            "crossover_hz": self.crossover_hz,
            "handling": {one.axis: one.to_json() for one in self.handling},
        }


def robustness(gains: Gains, vehicle: Model) -> Robustness:
    """Of a loop that is held."""
    loop = loop_of(gains, vehicle)
    units, _ = crossings_hz(gains, vehicle)
    f = np.geomspace(LOWEST_HZ, HIGHEST_HZ, POINTS)
    s: ComplexArray = np.asarray(2j * np.pi * f, dtype=complex)
    commands = commands_of(gains)
    plant = rates_per_command(vehicle, s, commands)
    return Robustness(
        disk=disk_margin(
            lambda w: from_rates(gains, 1j * w) @ rates_per_command(vehicle, 1j * w, commands), frequencies(gains, loop)
        ),
        crossover_hz=float(np.max(units)) if units.size else None,
        handling=handling(
            f,
            plant @ commands_per_rate(gains, vehicle, s),
            np.asarray(np.linalg.inv(np.eye(2) + plant @ from_rates(gains, s))),
        ),
    )


def disk_sizes(L: ComplexArray) -> FloatArray:
    """(f,): alpha of loops (f, n, n) at each frequency, inf where nothing in the disk closes them."""
    one = np.eye(L.shape[-1])
    S = np.linalg.inv(one + L)
    mu = structured_singular_value(np.asarray(S - 0.5 * one, dtype=complex))
    with np.errstate(divide="ignore"):
        return np.asarray(1 / mu)


def structured_singular_value(M: ComplexArray) -> FloatArray:
    """(f,): mu of matrices (f, 2, 2) against two complex scalars; of larger ones a bound from above."""
    if M.shape[-1] > 2:
        return _largest_balanced(M)
    own = np.abs(M[:, 0, 0]) ** 2 + np.abs(M[:, 1, 1]) ** 2 + 2 * np.abs(M[:, 0, 1] * M[:, 1, 0])
    det = np.abs(M[:, 0, 0] * M[:, 1, 1] - M[:, 0, 1] * M[:, 1, 0])
    return np.asarray(np.sqrt(0.5 * (own + np.sqrt(np.maximum(own**2 - 4 * det**2, 0.0)))))


def _largest_balanced(M: ComplexArray) -> FloatArray:
    """(f,): largest singular values of (f, n, n), scaled until off-diagonal rows are as large as columns (Osborne)."""
    sizes = np.abs(M) * (1 - np.eye(M.shape[-1]))
    scale = np.ones(M.shape[:2])
    for _ in range(BALANCINGS):
        for i in range(M.shape[-1]):
            row = scale[:, i] * np.linalg.norm(sizes[:, i] / scale, axis=1)
            column = np.linalg.norm(sizes[:, :, i] * scale, axis=1) / scale[:, i]
            scale[:, i] *= np.sqrt(np.maximum(column, TINY) / np.maximum(row, TINY))
    return np.asarray(np.linalg.norm(M * scale[:, :, None] / scale[:, None, :], 2, axis=(1, 2)))


def disk_margin(transfer: Callable[[FloatArray], ComplexArray], w: FloatArray) -> DiskMargin:
    """Of the loop broken at all commands, (f, n, n) at rad/s, of which `w` are the first."""
    for _ in range(ZOOMS + 1):
        sizes = disk_sizes(transfer(w))
        least = int(np.argmin(sizes))
        found = DiskMargin(size=float(sizes[least]), frequency_hz=float(w[least] / (2 * np.pi)))
        w = np.linspace(w[max(least - 1, 0)], w[min(least + 1, w.size - 1)], ZOOM)
    return found


def handling(f: FloatArray, answer: ComplexArray, left: ComplexArray) -> tuple[Handling, ...]:
    """Of both axes: rates per rate asked for, and what is left of a disturbance of the rates, (f, 2, 2) at Hz."""
    return tuple(
        _of_axis(axis, f, answer[:, k, k], np.asarray(left[:, k, k], dtype=complex)) for k, axis in enumerate(AXES)
    )


def _of_axis(axis: str, f: FloatArray, answer: ComplexArray, left: ComplexArray) -> Handling:
    bandwidth, limited, delay = bandwidth_of(f, answer)
    met = rejection(f, left)
    return Handling(
        axis=axis,
        bandwidth_hz=bandwidth,
        phase_delay_ms=delay,
        limited_by=limited,
        rejection_hz=met.hz,
        rejection_peak_db=met.peak_db,
        rejection_peak_hz=met.peak_hz,
    )


def rejection(f: FloatArray, left: ComplexArray) -> Rejection:
    """Of what is left of a disturbance (f,), at Hz in ascending order."""
    size = DB * np.log(np.abs(left))
    peak = int(np.argmax(size))
    return Rejection(
        hz=None if size[0] > -3 else _first(f, size, -3.0),
        peak_db=float(size[peak]),
        peak_hz=float(f[peak]),
    )


def bandwidth_of(f: FloatArray, answer: ComplexArray) -> tuple[float | None, str | None, float | None]:
    """ADS-33's bandwidth in Hz, what limits it, and phase delay in ms, of rate per rate asked for (f,)."""
    phase = np.degrees(np.unwrap(np.angle(answer)))
    phase += -360 * np.round(phase[0] / 360) - 90  # of the attitude
    size = DB * np.log(np.abs(answer) / f)
    limits: dict[str, float] = {}
    by_phase, at_180 = _first(f, -phase, 135.0), _first(f, -phase, 180.0)
    if by_phase is not None:
        limits["phase"] = by_phase
    if at_180 is not None:
        six = float(np.interp(at_180, f, size)) + 6
        below = np.flatnonzero((f[1:] <= at_180) & (size[:-1] >= six) & (size[1:] < six))
        if below.size:
            limits["gain"] = _between(f, size, int(below[-1]), six)
    limited = min(limits, key=lambda name: limits[name], default=None)
    delay = None
    if at_180 is not None and 2 * at_180 <= f[-1]:
        twice = float(np.interp(2 * at_180, f, phase))
        delay = 1000 * (-twice - 180) / (360 * 2 * at_180)
    return (None if limited is None else limits[limited]), limited, delay


def _first(f: FloatArray, values: FloatArray, level: float) -> float | None:
    """Where values first rise through a level."""
    crossed = np.flatnonzero((values[:-1] < level) & (values[1:] >= level))
    return _between(f, values, int(crossed[0]), level) if crossed.size else None


def _between(f: FloatArray, values: FloatArray, at: int, level: float) -> float:
    part = (level - values[at]) / (values[at + 1] - values[at])
    return float(f[at] * (f[at + 1] / f[at]) ** part)
