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

from sysid.control.controllers import AnyGains, controller_of
from sysid.control.robustness import disk_sizes
from sysid.control.stability import branches, negative_axis_met, unit_passed
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
STEP = 1e-4
CELLS = np.eye(4).reshape(4, 2, 2)
"""Each response of the two by two alone."""
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

    band_hz: tuple[float, float] | None
    """None where the responses are nowhere known well enough."""
    phase_deg: Crossing | None
    delay_ms: Crossing | None
    gain_db: Crossing | None
    disk: Crossing | None = None
    """Size of the disk margin where it is smallest in the band."""
    unstable_poles: int = 0
    """Of the open loop, by the model: responses do not tell how often their loci should go round -1."""
    needed: tuple[str, ...] = ()
    """Margins that the model has at some frequency, and so is to be measured;"""
    missing: tuple[str, ...] = ()
    """of these, what the band does not show."""
    sweep_to_hz: float | None = None
    """To measure what is missing above the band; None where nothing is."""
    sweep_from_hz: float | None = None
    """The same, below."""

    def to_json(self) -> dict[str, Any]:
        """`band_hz`, of each margin and the disk's size `value`, `bound`, `frequency_hz`, or null, `unstable_poles`,
        `needed`, `missing`, `sweep_to_hz`, `sweep_from_hz`."""
        each = {"phase_deg": self.phase_deg, "delay_ms": self.delay_ms, "gain_db": self.gain_db, "disk": self.disk}
        return {
            "band_hz": None if self.band_hz is None else list(self.band_hz),
            **{name: None if one is None else one.to_json() for name, one in each.items()},
            "unstable_poles": self.unstable_poles,
            **self.lacks(),
        }

    def lacks(self) -> dict[str, Any]:
        """`needed`, `missing`, `sweep_to_hz`, `sweep_from_hz`."""
        return {
            "needed": list(self.needed),
            "missing": list(self.missing),
            "sweep_to_hz": self.sweep_to_hz,
            "sweep_from_hz": self.sweep_from_hz,
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
    of: tuple[ComplexArray, ComplexArray, FloatArray]
    """Controller, responses and their standard errors, (f, 2, 2) each."""


def measured_margins(gains: AnyGains, responses: Responses) -> MeasuredMargins | None:
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
        disk=_disk(loci),
    )


NOTHING_MEASURED = MeasuredMargins(band_hz=None, phase_deg=None, delay_ms=None, gain_db=None)


def with_model(found: MeasuredMargins, gains: AnyGains, vehicle: Model) -> MeasuredMargins:
    """The same with what only a model that the gains hold tells: poles of the open loop, and where its margins are
    decided, which is to be measured."""
    controller = controller_of(gains)
    edges = controller.edges(vehicle)
    at = {"gain_db": edges.gain_hz, "phase_deg": edges.phase_hz, "delay_ms": edges.delay_hz}
    needed = {name: hz for name, hz in at.items() if hz is not None}
    low, high = found.band_hz or (0.0, math.inf)
    missing = {name: hz for name, hz in needed.items() if getattr(found, name) is None or not low <= hz <= high}
    above = [max(hz, high) for hz in missing.values() if hz >= low and found.band_hz]
    below = [hz for hz in missing.values() if hz < low]
    return replace(
        found,
        unstable_poles=controller.unstable_poles(vehicle),
        needed=tuple(needed),
        missing=tuple(missing),
        sweep_to_hz=math.ceil(BEYOND * max(above)) if above else None,
        sweep_from_hz=float(f"{min(below) / BEYOND:.1g}") if below else None,
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


def measured_loci(gains: AnyGains, responses: Responses) -> Loci | None:
    """Loci where all four responses have a small error beside the distance from -1; None where that is nowhere."""
    if not (set(RATES) <= set(responses.outputs) and set(CYCLIC) <= set(responses.commands)):
        return None
    rows = np.ix_(
        [responses.outputs.index(name) for name in RATES], [responses.commands.index(name) for name in CYCLIC]
    )
    H, error = np.moveaxis(responses.H[rows], -1, 0), np.moveaxis(responses.error[rows], -1, 0)
    known = np.all(np.isfinite(error), axis=(1, 2))
    C = controller_of(gains).from_rates(responses.frequency_hz)
    loci = np.full((known.size, 2), np.nan + 0j)
    errors = np.full((known.size, 2), np.nan)
    if np.count_nonzero(known) >= FEWEST:
        loci[known], errors[known] = _eigenvalues(C[known], H[known], error[known])
    good = widest(np.all(errors < LARGEST_ERROR, axis=1))
    if np.count_nonzero(good) < FEWEST:
        return None
    values = branches(loci[good])
    swapped = values[:, 0] != loci[good][:, 0]
    return Loci(
        responses.frequency_hz[good],
        values,
        np.where(swapped[:, None], errors[good][:, ::-1], errors[good]),
        (C[good], H[good], error[good]),
    )


def _eigenvalues(C: ComplexArray, H: ComplexArray, error: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Of C H, (f, 2), and their standard errors by the eigenvectors: d lambda = l C dH r."""
    values, right = np.linalg.eig(C @ H)
    left = np.linalg.inv(right) @ C
    variance = np.einsum("fik,fkm,fmi->fi", np.abs(left) ** 2, error**2, np.abs(right) ** 2)
    return values, np.sqrt(0.5 * variance)


def _disk(loci: Loci) -> Crossing:
    """The smallest disk of the band, its error by how its size changes with each response."""
    C, H, error = loci.of
    sizes = disk_sizes(C @ H)
    at = int(np.argmin(sizes))
    step = STEP * np.maximum(np.abs(H[at]), error[at])
    moved = [way * turn * step * cell for cell in CELLS for turn in (1, 1j) for way in (1, -1)]
    there = disk_sizes(C[at] @ (H[at] + np.array(moved))).reshape(len(CELLS), 2, 2)
    slopes = (there[..., 0] - there[..., 1]) / (2 * step.ravel()[:, None])
    variance = float(np.sum(0.5 * error[at].ravel()[:, None] ** 2 * slopes**2))
    return Crossing(
        value=float(sizes[at]), bound=FACTOR * math.sqrt(variance), frequency_hz=float(loci.frequency_hz[at])
    )


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
