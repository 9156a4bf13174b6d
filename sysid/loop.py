"""What a design promises: the closed loop's answer to doublets of the rate command, in time.

Computed in frequency over a period long enough for the answer to die out, so that a delay is exact and a vehicle may
have more states than its controller knows of. Play, limits and products are left out: it is the answer in small motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.model import FloatArray, Model
from sysid.regulator import DesignError, Gains, loop_margins
from sysid.response import transfer

AXES = ("roll", "pitch")
RATE = 0.3
"""rad/s asked for."""
PULSE_S = 0.5
"""Of each half of a doublet, as the card `lqr-doublet` flies them."""
SHOWN_S = 3.0
PERIOD_S = 30.0
"""A mode that rings on for so long has no place in a loop that anybody flies."""
STEP_S = 0.002
BEFORE_S = 0.25
ANTICIPATED = 0.02
"""Of the largest answer; what is left of it at the end of the period, or seems to come before the doublet."""
NOT_HELD = "the gains do not hold this model: there is no answer to predict"


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
    if loop_margins(gains, vehicle).phase_deg == 0:
        raise DesignError(NOT_HELD)
    count = round(PERIOD_S / STEP_S)
    frequency = np.asarray(np.fft.rfftfreq(count, STEP_S)[1:], dtype=np.float64)  # a doublet has no mean
    s = 2j * np.pi * frequency
    A, B, C, _ = (np.asarray(x, dtype=float) for x in gains.model.matrices)
    B = B[:, :2]
    K, L, g = gains.K, gains.observer_gain, gains.prefilter
    inner = s[:, None, None] * np.eye(len(A)) - (A - L @ C - B @ K)
    plant = transfer(vehicle.structure, vehicle.values, frequency)[:2, :2].transpose(2, 0, 1)
    feedback = K @ np.linalg.solve(inner, np.broadcast_to(L.astype(complex), (s.size, *L.shape)))
    forward = np.eye(2) - K @ np.linalg.solve(inner, np.broadcast_to(B.astype(complex), (s.size, *B.shape)))
    commands = np.linalg.solve(np.eye(2) + feedback @ plant, forward @ g)
    rates = plant @ commands
    asked = np.zeros(count)
    first, pulse = round(BEFORE_S / STEP_S), round(PULSE_S / STEP_S)
    asked[first : first + pulse], asked[first + pulse : first + 2 * pulse] = RATE, -RATE
    held = np.fft.rfft(asked)[1:] * np.sinc(frequency * STEP_S) * np.exp(-0.5 * s * STEP_S)
    shown = slice(0, round((BEFORE_S + SHOWN_S) / STEP_S))

    def in_time(bins: np.ndarray) -> FloatArray:
        answer = np.fft.irfft(np.concatenate([[0], bins * held]), count)
        if np.max(np.abs(answer[-first:])) > ANTICIPATED * np.max(np.abs(answer)):
            raise DesignError(NOT_HELD)  # an answer before its question is one that grows without end
        return answer[shown]

    roll, pitch = (
        Answer(axis, asked[shown], *(in_time(one[:, row, k]) for one in (rates, commands) for row in (0, 1)))
        for k, axis in enumerate(AXES)
    )
    return Following(STEP_S * np.arange(-first, asked[shown].size - first, dtype=np.float64), roll, pitch)
