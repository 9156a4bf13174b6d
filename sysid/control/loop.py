"""What a design promises: the closed loop's answer to doublets of the rate command, in time.

By the inverse Laplace transform, to the right of every root that a loop which is held may have: so a delay is exact, a
vehicle may have more states than its controller knows of, and it may drift or ring. Play, limits and products are left
out: it is the answer in small motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.control.regulator import DesignError, Gains
from sysid.control.stability import closed_loop, rates_per_command
from sysid.data.preprocess import ComplexArray
from sysid.model.structure import DRIFT_RAD_S, FloatArray, Model

AXES = ("roll", "pitch")
RATE = 0.3
"""rad/s asked for."""
PULSE_S = 0.5
"""Of each half of a doublet, as the card `lqr-doublet` flies them."""
SHOWN_S = 3.0
PERIOD_S = 30.0
"""Of the transform."""
STEP_S = 0.002
BEFORE_S = 0.25
RIGHT_OF_ALL = DRIFT_RAD_S + 1.0
"""1/s: the real part at which the transform is taken; what a period leaves unsaid is then nothing."""
NOT_HELD = "the gains do not hold this model: there is no answer to predict"


@dataclass(frozen=True, kw_only=True)
class AxisAnswer:
    """What an answer to a rate command comes to."""

    axis: str
    rise_s: float | None
    """From the step until nine tenths of it are reached; None where they never are."""
    overshoot: float
    """Beyond what was asked, as a share of it; 0 where it stays below."""
    coupling: float
    """Largest rate of the other axis, as a share of what was asked."""


class Answer(NamedTuple):
    """To a doublet on one axis; arrays of shape (n,)."""

    axis: str
    asked: FloatArray
    """rad/s"""
    p: FloatArray
    """rad/s"""
    q: FloatArray
    """rad/s"""
    delta_x: FloatArray
    """Of full command."""
    delta_y: FloatArray

    @property
    def own(self) -> FloatArray:
        """The rate that was asked for."""
        return self.p if self.axis == "roll" else self.q

    @property
    def other(self) -> FloatArray:
        """The rate that was not."""
        return self.q if self.axis == "roll" else self.p

    @property
    def overshoot(self) -> float:
        """Beyond what was asked, as a share of it; 0 where it stays below."""
        return max(0.0, float(np.max(np.abs(self.own)) / np.max(np.abs(self.asked))) - 1)

    @property
    def coupling(self) -> float:
        """Largest rate of the other axis, as a share of what was asked."""
        return float(np.max(np.abs(self.other)) / np.max(np.abs(self.asked)))

    @property
    def rise_s(self) -> float | None:
        """From the step until nine tenths of it are reached; None where they never are."""
        reached = np.flatnonzero(self.own * np.sign(self.asked[self.asked != 0][0]) >= 0.9 * np.max(np.abs(self.asked)))
        asked = np.flatnonzero(self.asked)
        return None if not reached.size else float((reached[0] - asked[0]) * STEP_S)

    @property
    def worth(self) -> AxisAnswer:
        return AxisAnswer(axis=self.axis, rise_s=self.rise_s, overshoot=self.overshoot, coupling=self.coupling)


@dataclass(frozen=True, eq=False)
class Following:
    """How a vehicle would follow its rate command under a set of gains."""

    t: FloatArray
    """(n,), s; the doublet begins at 0."""
    roll: Answer
    pitch: Answer


def following(gains: Gains, vehicle: Model) -> Following:
    """The answers of a vehicle, whatever its states, under gains designed on another model.

    Raises DesignError where the gains do not hold the vehicle.
    """
    if not closed_loop(gains, vehicle).stable:
        raise DesignError(NOT_HELD)
    count = round(PERIOD_S / STEP_S)
    asked = _doublet(count)
    fade = np.exp(-RIGHT_OF_ALL * STEP_S * np.arange(count))
    s: ComplexArray = np.asarray(RIGHT_OF_ALL + 2j * np.pi * np.fft.rfftfreq(count, STEP_S), dtype=complex)
    held = np.fft.rfft(asked * fade) * (1 - np.exp(-s * STEP_S)) / (s * STEP_S)
    commands = commands_per_rate(gains, vehicle, s)
    rates = rates_per_command(vehicle, s, gains.commands) @ commands
    shown = slice(0, round((BEFORE_S + SHOWN_S) / STEP_S))

    # Commands jump with what is asked. What a jump rings with above the highest frequency would outgrow all else once
    # the fade is taken back: Lanczos' factors take it off, for a blur of a sample. Rates do not jump.
    smooth = np.sinc(np.arange(s.size) / (s.size - 1)) ** 2

    def in_time(bins: ComplexArray) -> FloatArray:
        return np.asarray(np.fft.irfft(bins * held, count)[shown] / fade[shown])

    smoothed = commands * smooth[:, None, None]
    roll, pitch = (
        Answer(axis, asked[shown], *(in_time(one[:, row, k]) for one in (rates, smoothed) for row in (0, 1)))
        for k, axis in enumerate(AXES)
    )
    t = STEP_S * np.arange(shown.stop, dtype=np.float64) - BEFORE_S
    return Following(t, roll, pitch)


def _doublet(count: int) -> FloatArray:
    """(count,), rad/s."""
    asked = np.zeros(count)
    first, pulse = round(BEFORE_S / STEP_S), round(PULSE_S / STEP_S)
    asked[first : first + pulse], asked[first + pulse : first + 2 * pulse] = RATE, -RATE
    return asked


def commands_per_rate(gains: Gains, vehicle: Model, s: ComplexArray) -> ComplexArray:
    """(f, commands, 2): commands per rate asked for, the loop closed."""
    asked = gains.prefilter if gains.dynamic is None else gains.prefilter + gains.dynamic.at(s)
    return np.asarray(commands_per_added(gains, vehicle, s) @ asked)


def commands_per_added(gains: Gains, vehicle: Model, s: ComplexArray) -> ComplexArray:
    """(f, commands, commands): commands per what is added to them, the loop closed."""
    A, B, C, _ = (np.asarray(x, dtype=float) for x in gains.model.matrices)
    B = B[:, : len(gains.K)]
    K, L = gains.K, gains.observer_gain
    inner = s[:, None, None] * np.eye(len(A)) - (A - L @ C - B @ K)
    feedback = K @ np.linalg.solve(inner, np.broadcast_to(L.astype(complex), (s.size, *L.shape)))
    forward = np.eye(len(K)) - K @ np.linalg.solve(inner, np.broadcast_to(B.astype(complex), (s.size, *B.shape)))
    back = feedback @ rates_per_command(vehicle, s, gains.commands)
    return np.asarray(np.linalg.solve(np.eye(len(K)) + back, forward))
