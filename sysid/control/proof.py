"""Flown against predicted: the closed loop's rates for the rates that were asked for, and what a run shows of its step.

The prediction (`sysid.control.in_time`) is driven by the rates that were asked for as they were logged, an attitude
hold's part included. A step is what a run shows of it: the response to the rate that was asked for, found by
least squares from all that was asked in the run, doublets or a sweep alike. It is found in the same way of the measured
and of the predicted rates, so that what a maneuver does not show is missing in both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.data.record import FloatArray
from sysid.errors import SysidError

KNOTS_S = np.concatenate([np.arange(0.02, 0.3, 0.02), np.arange(0.3, 0.9, 0.06)])
"""Of a step, straight lines between; constant after the last."""
SMOOTH = 0.01
"""Weight of the second differences against what the run tells, so that what no sweep excites stays smooth."""
RISEN = 0.9
HALF = 0.5
NRMSE_PERCENT = 85.0
RISE_SHARE = 0.15
COUPLING = 0.05
OVERSHOOT = 0.10
DELAY_MS = 10.0
"""How far a flown answer may be from the predicted one; delay and rise also by a loop of the vehicle."""
PROBABILITY = 0.95
HIGH_HZ = 15.0
"""Up to here rates are compared, as fits are: above is the rotor's vibration."""

Quantity = Literal["nrmse_percent", "rise_ms", "delay_ms", "overshoot", "coupling"]
Verdict = Literal["accepted", "not accepted", "too few to say"]


class ProofError(SysidError):
    """A run that shows nothing of a step; the message says why."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """Of the rate that was asked for, per rad/s asked."""

    t: FloatArray
    """(n,), s."""
    own: FloatArray
    other: FloatArray

    @property
    def overshoot(self) -> float:
        """Beyond what was asked, as a share of it."""
        return max(0.0, float(self.own.max()) - 1)

    @property
    def coupling(self) -> float:
        """Largest rate of the other axis."""
        return float(np.abs(self.other).max())

    def reaches(self, level: float) -> float | None:
        """s; None where it does not."""
        above = np.flatnonzero(self.own >= level)
        if not above.size or above[0] == 0:
            return None
        k = int(above[0])
        a, b = self.own[k - 1], self.own[k]
        return float(self.t[k - 1] + (level - a) / (b - a) * (self.t[k] - self.t[k - 1]))


@dataclass(frozen=True, kw_only=True)
class FlownRun:
    """One run beside what was predicted of it."""

    id: str
    axis: int
    """0 roll, 1 pitch."""
    t: FloatArray
    """(n,), s"""
    asked: FloatArray
    """(n, 2), rad/s, as the two next."""
    measured: FloatArray
    predicted: FloatArray
    steps: tuple[Step, Step]
    """Measured and predicted."""

    @property
    def nrmse_percent(self) -> tuple[float, float]:
        """Of the rate that was asked for, and of the other; 100 is perfect."""
        left = np.std(self.measured - self.predicted, axis=0) / np.std(self.measured, axis=0)
        return float(100 * (1 - left[self.axis])), float(100 * (1 - left[1 - self.axis]))

    def values(self, quantity: Quantity) -> tuple[float | None, float | None]:
        """Measured and predicted; None where the step does not get there."""
        measured, predicted = self.steps
        if quantity == "nrmse_percent":
            return self.nrmse_percent[0], 100.0
        if quantity in ("overshoot", "coupling"):
            return getattr(measured, quantity), getattr(predicted, quantity)
        full = min(1.0, float(predicted.own.max()))
        level = full * (RISEN if quantity == "rise_ms" else HALF)
        return _ms(measured.reaches(level)), _ms(predicted.reaches(level))


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """One quantity of one axis over the runs of that axis."""

    axis: int
    quantity: Quantity
    predicted: float | None
    measured: tuple[float | None, ...]
    """Of each run."""
    difference: float | None
    """Mean of measured less predicted (of `nrmse_percent`: the mean itself)."""
    bounds: tuple[float, float] | None
    """Of that mean, 95 of 100 times; None of a single run."""
    allowed: tuple[float, float]
    verdict: Verdict


@dataclass(frozen=True, kw_only=True)
class Proof:
    """Runs of a flown controller, and whether it flies as predicted."""

    runs: tuple[FlownRun, ...]
    evidence: tuple[Evidence, ...]

    @property
    def verdict(self) -> Verdict:
        """Not accepted where one quantity surely is elsewhere, accepted where all surely are where they may be."""
        each = [one.verdict for one in self.evidence]
        if "not accepted" in each:
            return "not accepted"
        axes = {run.axis for run in self.runs}
        return "accepted" if axes == {0, 1} and set(each) == {"accepted"} else "too few to say"


def prove(runs: Sequence[FlownRun], loop_s: float) -> Proof:
    """What runs show together; `loop_s`: of the vehicle."""
    found = []
    for axis in sorted({run.axis for run in runs}):
        of_axis = [run for run in runs if run.axis == axis]
        quantities: tuple[Quantity, ...] = ("nrmse_percent", "rise_ms", "delay_ms", "overshoot", "coupling")
        found += [_evidence(of_axis, quantity, loop_s) for quantity in quantities]
    return Proof(runs=tuple(runs), evidence=tuple(found))


def _evidence(runs: Sequence[FlownRun], quantity: Quantity, loop_s: float) -> Evidence:
    pairs = [run.values(quantity) for run in runs]
    measured, expected = [a for a, _ in pairs], [b for _, b in pairs if b is not None]
    predicted = float(np.mean(expected)) if expected else None
    allowed = _allowed(quantity, predicted, 1000 * loop_s)
    base = 0.0 if quantity == "nrmse_percent" else 1.0
    differences = [a - base * b for a, b in pairs if a is not None and b is not None]
    # a step that was predicted to get somewhere and does not, or the other way round, is no number
    whole = len(differences) == len(pairs)
    bounds = mean_bounds(differences) if whole else None
    nowhere = predicted is None and all(one is None for one in measured)
    return Evidence(
        axis=runs[0].axis,
        quantity=quantity,
        predicted=predicted,
        measured=tuple(measured),
        difference=float(np.mean(differences)) if whole else None,
        bounds=bounds,
        allowed=allowed,
        verdict=_verdict(bounds, allowed) if whole else "accepted" if nowhere else "not accepted",
    )


def _verdict(bounds: tuple[float, float] | None, allowed: tuple[float, float]) -> Verdict:
    if bounds is not None and allowed[0] <= bounds[0] and bounds[1] <= allowed[1]:
        return "accepted"
    beyond = bounds is not None and (bounds[1] < allowed[0] or bounds[0] > allowed[1])
    return "not accepted" if beyond else "too few to say"


def _allowed(quantity: Quantity, predicted: float | None, loop_ms: float) -> tuple[float, float]:
    if quantity == "nrmse_percent":
        return NRMSE_PERCENT, 100.0
    most = {
        "rise_ms": max(RISE_SHARE * (predicted or 0.0), loop_ms),
        "delay_ms": max(DELAY_MS, loop_ms),
        "overshoot": OVERSHOOT,
        "coupling": COUPLING,
    }[quantity]
    return -most, most


def mean_bounds(values: Sequence[float]) -> tuple[float, float] | None:
    """Between which the mean is, 95 of 100 times, by Student's t; None of fewer than two."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.stats import t as student

    if len(values) < 2:
        return None
    half = float(student.ppf(0.5 + PROBABILITY / 2, len(values) - 1)) * float(np.std(values, ddof=1))
    half /= math.sqrt(len(values))
    mean = float(np.mean(values))
    return mean - half, mean + half


def below(rates: FloatArray, high_hz: float, dt: float) -> FloatArray:
    """(n, 2): without what is above a frequency, mirrored at both ends."""
    whole = np.concatenate([rates[::-1], rates, rates[::-1]])
    bins = np.fft.rfft(whole, axis=0)
    bins[np.fft.rfftfreq(len(whole), dt) > high_hz] = 0
    return np.asarray(np.fft.irfft(bins, len(whole), axis=0)[len(rates) : 2 * len(rates)])


def flown_run(
    name: str,
    axis: int,
    t: FloatArray,
    *,
    asked: FloatArray,
    measured: FloatArray,
    predicted: FloatArray,
    high_hz: float = HIGH_HZ,
) -> FlownRun:
    """One run with its steps; all (n, 2) but t, in steps of one length. Raises ProofError where it shows no step."""
    if np.std(asked[:, axis]) < 1e-6 or np.std(measured[:, axis]) < 1e-9:
        raise ProofError(f"{name}: nothing was asked of this axis, or nothing was measured")
    dt = float(np.median(np.diff(t)))
    measured, predicted = (below(rates, high_hz, dt) for rates in (measured, predicted))
    steps = [_step(asked[:, axis], rates, axis, dt) for rates in (measured, predicted)]
    return FlownRun(
        id=name,
        axis=axis,
        t=t,
        asked=asked,
        measured=measured - np.mean(measured - predicted, axis=0),
        predicted=predicted,
        steps=(steps[0], steps[1]),
    )


def _step(asked: FloatArray, rates: FloatArray, axis: int, dt: float) -> Step:
    """By least squares over all that was asked: straight lines between knots, zero before, constant after."""
    rises = np.diff(asked, prepend=asked[:1])
    X = np.column_stack([*(_through(rises, k, dt) for k in range(KNOTS_S.size)), np.ones(asked.size)])
    X = X[round(KNOTS_S[-1] / dt) :]
    Y = rates[len(rates) - len(X) :]
    size = float(np.sqrt(np.mean(X[:, :-1] ** 2)))
    bends = np.zeros((KNOTS_S.size - 2, X.shape[1]))
    for k in range(len(bends)):
        bends[k, k : k + 3] = SMOOTH * size * np.sqrt(len(X)) * np.array([1.0, -2.0, 1.0])
    found = np.linalg.lstsq(np.vstack([X, bends]), np.vstack([Y, np.zeros((len(bends), 2))]), rcond=None)[0]
    t = np.arange(0.0, KNOTS_S[-1] + dt / 2, dt)
    at = np.concatenate([[0.0], KNOTS_S])
    own, other = (np.interp(t, at, np.concatenate([[0.0], found[:-1, k]])) for k in (axis, 1 - axis))
    return Step(t=t, own=own, other=other)


def _through(rises: FloatArray, knot: int, dt: float) -> FloatArray:
    """What a hat at this knot makes of the rises of the target; of the last, a step that stays."""
    n = rises.size
    t = dt * np.arange(n)
    at = np.concatenate([[0.0], KNOTS_S])
    values = np.zeros(at.size)
    values[knot + 1] = 1.0
    hat = np.interp(t, at, values)
    if knot == KNOTS_S.size - 1:
        hat[t > at[-1]] = 1.0
    size = 2 * n
    return np.asarray(np.fft.irfft(np.fft.rfft(rises, size) * np.fft.rfft(hat, size), size)[:n])


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else 1000 * seconds
