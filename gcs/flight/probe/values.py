"""What a probe is given, and what it finds: its steps, its findings, each axis' answer, the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.cards.maneuver import Maneuver

FloatArray = NDArray[np.float64]
Samples = Mapping[str, FloatArray]

LETTERS = {"roll": "x", "pitch": "y", "elevator": "e"}
"""An axis' command and excitation: delta_x, excitation_x."""
RATES = {"roll": "p", "pitch": "q", "elevator": "q"}
"""The rate that should answer it."""
MEASURED = tuple(dict.fromkeys(RATES.values()))
"""Each of them once."""
LATE_S = 0.15
"""A command that is answered later than this leaves no controller enough margin."""


@dataclass(frozen=True, slots=True)
class ProbeStep:
    """One small run with its samples."""

    maneuver: Maneuver
    samples: Samples
    """Arrays of shape (n,) as `gcs.flight.verdict.cut` gives them, best with a second before and after the excitation;
    phi and theta (rad, NaN between their samples) where known."""
    start_s: float | None = None
    """When the excitation began, on the samples' clock: lets it be worked out where the vehicle does not log it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeFinding:
    """One thing that a probe found."""

    kind: str
    """`no samples`, `slow log`, `gaps`, `frozen`, `units`, `noisy`, `no excitation`, `reversed`, `swapped`, `turned`,
    `late` or `unseen`."""
    axis: str | None
    """None where it concerns the whole vehicle."""
    serious: bool = True
    """Whether the card must not be flown before it is mended."""
    numbers: Mapping[str, float] | None = None
    """What was measured, SI."""
    how: str = ""
    """Which of the ways to be so, where a kind has several: `words` names them."""
    names: Mapping[str, str] | None = None
    """Channels and axes that it is about beside its own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisAnswer:
    """How a vehicle answered the step on one axis; numbers are None where nothing was seen above the noise."""

    axis: str
    amplitude: float
    """Flown, of full command."""
    signal_to_noise: float
    """The answer over its standard error; seen from `fit.SEEN` on."""
    seen: bool
    rate: str = "p"
    """The rate that answers: p or q."""
    gain: float | None = None
    """Rate half a second after a step of full command, rad/s."""
    gain_error: float | None = None
    delay_s: float | None = None
    """Dead time between command and rate, beside its own dynamics."""
    delay_error_s: float | None = None
    peak_rate: float | None = None
    """Largest p or q per full command added, feedback at work, rad/s; its error included."""
    peak_attitude: float | None = None
    """Largest swing of attitude in this step per full command, rad, gusts included."""
    rate_gains: tuple[tuple[float, float], ...] = ()
    """Frequency in Hz, and p or q (the larger) per command added there, rad/s, feedback at work."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeResult:
    """What a probe says about a vehicle."""

    findings: tuple[ProbeFinding, ...]
    answers: tuple[AxisAnswer, ...]
    noise: Mapping[str, float]
    """Standard deviation in quiet hover of p, q (rad/s), delta_x, delta_y; a channel that is not known is absent."""
    rate_hz: float | None
    """Of the log."""
    turn_deg: float | None = None
    """How far commands and rates are turned against each other: 0 in order, 90 a quarter turn; None where not known."""

    @property
    def wrong(self) -> bool:
        """Something serious was found."""
        return any(finding.serious for finding in self.findings)

    @property
    def ok(self) -> bool:
        """Nothing serious was found, and every axis was seen to answer. Neither ok nor wrong: not known."""
        return not self.wrong and bool(self.answers) and all(answer.seen for answer in self.answers)
