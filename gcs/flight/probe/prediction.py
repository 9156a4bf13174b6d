"""How far the card itself would take the vehicle, by what the probe's small steps showed."""

from __future__ import annotations

import math

import numpy as np

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver
from gcs.flight.probe.values import AxisAnswer, ProbeResult

SAFETY = 1.25
"""On predicted rate and attitude: gusts add to the answer, and play hides a part of it from a small step."""


def largest_amplitude(
    result: ProbeResult, limits: Limits, abort_s: float, maneuver: Maneuver, safety: float = SAFETY
) -> float | None:
    """The amplitude up to which `maneuver` is predicted to stay within rate and attitude; at most 1.

    None where the probe did not see that axis answer. Linear: rate and attitude grow as the amplitude. `safety` times
    what is predicted for it must stay within each limit; `abort_s` is how long the slowest abort takes.
    """
    answer = next((answer for answer in result.answers if answer.axis == maneuver.axis), None)
    if answer is None or not answer.seen or answer.peak_rate is None:
        return None
    attitude = predicted_attitude(answer, maneuver, abort_s)
    return float(min(1.0, limits.rate / (safety * answer.peak_rate), limits.attitude / (safety * attitude)))


def too_large_words(result: ProbeResult | None, limits: Limits, abort_s: float, maneuver: Maneuver) -> str:
    """Why a run's amplitude is too large for what the probe saw; empty where it is not, or not known."""
    if result is None or maneuver.kind == "quiet" or maneuver.target != "command":
        return ""
    largest = largest_amplitude(result, limits, abort_s, maneuver)
    if largest is None or maneuver.amplitude <= largest:
        return ""
    return (
        f"amplitude {maneuver.amplitude:g} is predicted, from the probe, to leave "
        f"{math.degrees(limits.attitude):.0f}° or {limits.rate:g} rad/s before an abort acts "
        f"({abort_s:.1f} s); at most {largest:.2g} on this axis"
    )


def predicted_attitude(answer: AxisAnswer, maneuver: Maneuver, abort_s: float) -> float:
    """Attitude reached per full command, rad, of an answer that was seen: at each frequency flown the swing, and the
    largest rate there kept on until the abort acts, but not longer than it takes to swing to the other side."""
    if maneuver.kind == "doublet":  # its two pulses are one period
        start_hz = stop_hz = 0.5 / maneuver.pulse_s
    else:
        start_hz, stop_hz = maneuver.f_start_hz, maneuver.f_stop_hz
    known = np.array(answer.rate_gains or ((start_hz, answer.peak_rate or 0.0),))
    flown = [start_hz, *(hz for hz in known[:, 0] if start_hz < hz < stop_hz)]
    rates = np.interp(flown, *known.T)
    reached = [
        rate * (1 / (2 * math.pi * hz) + min(abort_s, 1 / (math.pi * hz)))
        for hz, rate in zip(flown, rates, strict=True)
    ]
    return float(max(reached))
