"""Margins of a loop from the measured responses of its vehicle: what the gains leave, without any model of it.

The loop is broken at both commands together, as `sysid.control.stability` breaks it, so that both sides can be
compared: loci of controller times measured responses, where these are known well enough, beside those of the model.
What lies outside the measured band is not said, and neither is whether the loop is stable: that is for the model.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from sysid.control.stability import (
    Feedback,
    branches,
    crossings_hz,
    from_rates,
    negative_axis_met,
    unit_passed,
    unstable_poles,
)
from sysid.data.preprocess import ComplexArray
from sysid.data.record import CYCLIC, RATES, FloatArray
from sysid.model.structure import Model
from sysid.response.values import Responses, widest

LARGEST_ERROR = 0.25
"""Standard error of a locus, in the plane where -1 is the edge; beyond it nothing is said."""
FEWEST = 4
FINER = 10
"""Points between those measured: a locus is smooth."""
BEYOND = 1.25
"""Of a crossing's frequency: as far a sweep goes, so that it is measured on either side."""
FACTOR = 1.96
"""Standard errors in a bound of 95 %."""


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A margin where a locus crosses, with its 95 % bound."""

    value: float
    """Degrees, dB or ms."""
    bound: float
    """To either side."""
    frequency_hz: float

    def to_json(self) -> dict[str, float]:
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class MeasuredMargins:
    """The smallest margins inside the band; None where no locus crosses there."""

    band_hz: tuple[float, float]
    phase_deg: Crossing | None
    delay_ms: Crossing | None
    gain_db: Crossing | None
    unstable_poles: int = 0
    """Of the open loop, by the model: responses do not tell how often their loci should go round -1."""
    sweep_to_hz: float | None = None
    """To measure what the model crosses beyond the band; None where that is nothing."""

    def to_json(self) -> dict[str, Any]:
        """`band_hz`, of each margin `value`, `bound`, `frequency_hz`, or null, `unstable_poles`, `sweep_to_hz`."""
        each = {"phase_deg": self.phase_deg, "delay_ms": self.delay_ms, "gain_db": self.gain_db}
        return {
            "band_hz": list(self.band_hz),
            **{name: None if one is None else one.to_json() for name, one in each.items()},
            "unstable_poles": self.unstable_poles,
            "sweep_to_hz": self.sweep_to_hz,
        }


@dataclass(frozen=True, eq=False)
class Loci:
    """Loci over frequency with their errors."""

    frequency_hz: FloatArray
    """(f,)"""
    values: ComplexArray
    """(f, 2)"""
    errors: FloatArray
    """(f, 2), standard errors of real and imaginary part each."""


def measured_margins(gains: Feedback, responses: Responses) -> MeasuredMargins | None:
    """Margins under gains by measured responses of p and q; None where these are not measured well enough."""
    loci = measured_loci(gains, responses)
    if loci is None:
        return None
    phases, delays, levels = [], [], []
    f = np.geomspace(loci.frequency_hz[0], loci.frequency_hz[-1], FINER * (loci.frequency_hz.size - 1) + 1)
    for values, errors in zip(loci.values.T, loci.errors.T, strict=True):
        size, turn, error = _between_points(loci.frequency_hz, values, errors, f)
        fine = np.exp(size + 1j * turn)
        for at in np.flatnonzero(unit_passed(fine)).tolist():
            phase, delay = _at_unit(f, size, turn, error, at)
            phases.append(phase)
            delays.append(delay)
        levels += [
            _at_negative_axis(f, size, turn, error, at)
            for at in np.flatnonzero(negative_axis_met(fine) & (size[:-1] < 0)).tolist()
        ]
    return MeasuredMargins(
        band_hz=(float(f[0]), float(f[-1])),
        phase_deg=_smallest(phases),
        delay_ms=_smallest(delays),
        gain_db=_smallest(levels),
    )


def with_model(found: MeasuredMargins, gains: Feedback, vehicle: Model) -> MeasuredMargins:
    """The same with what only a model tells: poles of the open loop, and what it crosses beyond the band."""
    beyond = [hz for each in crossings_hz(gains, vehicle) for hz in each.tolist() if hz > found.band_hz[1]]
    return replace(
        found,
        unstable_poles=unstable_poles(gains, vehicle),
        sweep_to_hz=math.ceil(BEYOND * max(beyond)) if beyond else None,
    )


def _between_points(
    frequency_hz: FloatArray, values: ComplexArray, errors: FloatArray, at_hz: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of one locus: logarithm of its size, phase in rad, and its error beside its size, on a finer grid."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.interpolate import CubicSpline

    x, size = np.log(frequency_hz), np.log(np.abs(values))
    rows = CubicSpline(x, np.stack([size, np.unwrap(np.angle(values))]), axis=1)(np.log(at_hz))
    error = np.exp(np.interp(np.log(at_hz), x, np.log(np.maximum(errors, 1e-12)) - size))
    return rows[0], rows[1], error


def measured_loci(gains: Feedback, responses: Responses) -> Loci | None:
    """Loci where all four responses have a small error beside the distance from -1; None where that is nowhere."""
    if not (set(RATES) <= set(responses.outputs) and set(CYCLIC) <= set(responses.commands)):
        return None
    rows = np.ix_(
        [responses.outputs.index(name) for name in RATES], [responses.commands.index(name) for name in CYCLIC]
    )
    H, error = np.moveaxis(responses.H[rows], -1, 0), np.moveaxis(responses.error[rows], -1, 0)
    known = np.all(np.isfinite(error), axis=(1, 2))
    C = from_rates(gains, 2j * np.pi * responses.frequency_hz)
    loci = np.full((known.size, 2), np.nan + 0j)
    errors = np.full((known.size, 2), np.nan)
    if np.count_nonzero(known) >= FEWEST:
        loci[known], errors[known] = _eigenvalues(C[known], H[known], error[known])
    good = widest(np.all(errors < LARGEST_ERROR, axis=1))
    if np.count_nonzero(good) < FEWEST:
        return None
    values = branches(loci[good])
    swapped = values[:, 0] != loci[good][:, 0]
    return Loci(responses.frequency_hz[good], values, np.where(swapped[:, None], errors[good][:, ::-1], errors[good]))


def _eigenvalues(C: ComplexArray, H: ComplexArray, error: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Of C H, (f, 2), and their standard errors by the eigenvectors: d lambda = l C dH r."""
    values, right = np.linalg.eig(C @ H)
    left = np.linalg.inv(right) @ C
    variance = np.einsum("fik,fkm,fmi->fi", np.abs(left) ** 2, error**2, np.abs(right) ** 2)
    return values, np.sqrt(0.5 * variance)


def _at_unit(
    frequency_hz: FloatArray, size: FloatArray, turn: FloatArray, errors: FloatArray, at: int
) -> tuple[Crossing, Crossing]:
    """Phase margin, and the delay that would use it up; an error along the locus moves where it crosses."""
    part = size[at] / (size[at] - size[at + 1])
    f = _between(frequency_hz, at, part)
    angle = float(np.mod(_between(turn, at, part) - np.pi, 2 * np.pi))
    slope = (turn[at + 1] - turn[at]) / (size[at + 1] - size[at])
    bound = FACTOR * float(np.degrees(_between(errors, at, part) * np.hypot(1.0, slope)))
    phase = Crossing(value=float(np.degrees(min(angle, 2 * np.pi - angle))), bound=bound, frequency_hz=f)
    return phase, replace(phase, value=1000 * angle / (2 * np.pi * f), bound=1000 * bound / 360 / f)


def _at_negative_axis(
    frequency_hz: FloatArray, size: FloatArray, turn: FloatArray, errors: FloatArray, at: int
) -> Crossing:
    """Gain margin; an error across the locus moves where it crosses."""
    goal = np.pi * (2 * np.round((turn[at] / np.pi - 1) / 2) + 1)
    part = float(np.clip((goal - turn[at]) / (turn[at + 1] - turn[at]), 0, 1))
    slope = (size[at + 1] - size[at]) / (turn[at + 1] - turn[at])
    dB = 20 / np.log(10)
    bound = FACTOR * dB * float(_between(errors, at, part) * np.hypot(1.0, slope))
    return Crossing(value=-dB * _between(size, at, part), bound=bound, frequency_hz=_between(frequency_hz, at, part))


def _between(values: FloatArray, at: int, part: float) -> float:
    return float(values[at] + part * (values[at + 1] - values[at]))


def _smallest(each: list[Crossing]) -> Crossing | None:
    return min(each, key=lambda one: one.value, default=None)
