"""How a vehicle answered on each axis, and what is wrong with an answer by itself: unseen, too strong, late."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy import signal

from gcs.flight.probe.fit import SEEN, Fit
from gcs.flight.probe.grid import GRID_S
from gcs.flight.probe.values import LATE_S, LETTERS, RATES, AxisAnswer, FloatArray, ProbeFinding, ProbeStep

SURE_LATE = 2.5
"""Standard errors beyond `LATE_S` from which a delay is wrong; below, it is said to seem so."""
LARGEST_GAIN = 150.0
"""rad/s per full command: quadrotors reach 60 in half a second."""

_SWINGS_HZ = (0.3, 0.4, 0.5, 0.7, 1.0, 1.3, 1.6)


def axis_answers(fit: Fit, steps: Sequence[ProbeStep], swapped: bool) -> dict[str, AxisAnswer]:
    """By axis, of the steps that were fitted; with `swapped` axes the other rate's answer."""
    out = {}
    for number, step in enumerate(steps):
        axis = step.maneuver.axis
        column = fit.letters.index(LETTERS[axis])
        ratio = fit.signal_to_noise(column)
        own = RATES[axis] if not swapped else {"p": "q", "q": "p"}[RATES[axis]]
        rate = own if own in fit.rates else fit.rates[0]
        blank = AxisAnswer(
            axis=axis, amplitude=step.maneuver.amplitude, signal_to_noise=ratio, seen=ratio >= SEEN, rate=rate
        )
        out[axis] = _filled(blank, fit, number, column) if blank.seen else blank
    return out


def _filled(blank: AxisAnswer, fit: Fit, number: int, column: int) -> AxisAnswer:
    row = fit.rows[fit.rates.index(blank.rate)]
    error = math.sqrt(max(row.covariance[column, column], 0.0))
    grid = fit.steps[number]
    moved = [np.abs(each.answered[number]).max() for each in fit.rows]
    spread = 1 + 1 / blank.signal_to_noise
    letter = LETTERS[blank.axis]
    swing = max(_swing(grid.raw[name]) for name in fit.rates if name in grid.raw)
    return replace(
        blank,
        gain=float(row.gain[column]),
        gain_error=error,
        delay_s=row.delay_s,
        delay_error_s=row.delay_error_s,
        peak_rate=spread * float(max(moved)) / blank.amplitude,
        peak_attitude=swing / blank.amplitude,
        rate_gains=_rate_gains(grid.e[letter], [each.answered[number] for each in fit.rows], spread),
    )


def _swing(rate: FloatArray) -> float:
    """The largest attitude reached, rad, without a steady turn."""
    return float(np.abs(signal.detrend(np.cumsum(rate) * GRID_S)).max())


def _rate_gains(added: FloatArray, answers: Sequence[FloatArray], spread: float) -> tuple[tuple[float, float], ...]:
    """Frequencies that the excitation holds and the larger rate per what was added there."""
    t = np.arange(added.size) * GRID_S
    at = [np.exp(-2j * math.pi * hz * t) for hz in _SWINGS_HZ]
    put_in = [abs((added - added.mean()) @ wave) for wave in at]
    enough = 0.3 * max(put_in)
    return tuple(
        (float(hz), spread * float(max(abs((y - y.mean()) @ wave) for y in answers)) / size)
        for hz, wave, size in zip(_SWINGS_HZ, at, put_in, strict=True)
        if size > enough
    )


def answer_findings(answer: AxisAnswer) -> Iterator[ProbeFinding]:
    """What is wrong with an axis' answer by itself: not seen, too strong to be true, late."""
    axis = answer.axis
    if not answer.seen or answer.gain is None or answer.delay_s is None or answer.delay_error_s is None:
        yield ProbeFinding(kind="unseen", axis=axis, serious=False, numbers={"signal_to_noise": answer.signal_to_noise})
        return
    names = {"axis": axis, "rate": answer.rate}
    if abs(answer.gain) > LARGEST_GAIN:
        yield ProbeFinding(kind="units", axis=answer.rate, numbers={"gain": answer.gain}, how="gain", names=names)
    if answer.delay_s > LATE_S:
        sure = answer.delay_s - SURE_LATE * answer.delay_error_s > LATE_S
        numbers = {"delay_s": answer.delay_s, "error_s": answer.delay_error_s}
        yield ProbeFinding(kind="late", axis=axis, serious=sure, numbers=numbers, names=names)
