"""What the log tells by itself: whether its samples came, how noisy the hover is, whether a step was flown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from gcs.flight.probe.values import LETTERS, MEASURED, FloatArray, ProbeFinding, ProbeStep, Samples

FEW_LOST = 0.01
SLOWEST_HZ = 40.0
"""A log must hold four samples in a period at the end of a 10 Hz sweep."""
NOISIER = 1.6
"""Times the usual deviation."""
QUIET_RATE = 0.6
"""rad/s: no vehicle hovers with rates that vary by more; in deg/s every one does."""


def log_rate_hz(t: FloatArray) -> float | None:
    """How many samples a second the log holds, by its time stamps in s; None where they tell none."""
    if t.size < 3:
        return None
    spacing = float(np.median(np.diff(t)))
    return 1 / spacing if spacing > 0 else None


def log_findings(samples: Samples, axis: str | None, expected_hz: float | None) -> Iterator[ProbeFinding]:
    """Whether samples came, often enough and without gaps; `axis` None for the quiet hover."""
    t = samples["t"]
    hz = log_rate_hz(t)
    if hz is None or t[-1] - t[0] < 1.0:
        yield ProbeFinding(kind="no samples", axis=axis, how="short")
        return
    if hz < SLOWEST_HZ:
        yield ProbeFinding(kind="slow log", axis=None, numbers={"rate_hz": hz})
    elif expected_hz is not None and hz < 0.9 * expected_hz:
        yield ProbeFinding(
            kind="slow log",
            axis=None,
            serious=False,
            numbers={"rate_hz": hz, "expected_hz": expected_hz},
            how="than expected",
        )
    spaces = np.diff(t)
    wide = spaces[spaces > 3 / hz]
    lost = float(np.sum(wide) - wide.size / hz) / float(t[-1] - t[0])
    if wide.size:
        numbers = {"gaps": float(wide.size), "lost": lost, "longest_s": float(wide.max())}
        yield ProbeFinding(kind="gaps", axis=axis, serious=lost > FEW_LOST, numbers=numbers)


def _known(samples: Samples, name: str) -> FloatArray:
    """The finite samples of a channel; none where it is not known."""
    values = samples.get(name, np.empty(0))
    return values[np.isfinite(values)]


def hover_noise(quiet: Samples) -> dict[str, float]:
    """Standard deviation of p, q (rad/s) and the commands; a channel that is not known is absent."""
    channels = {name: _known(quiet, name) for name in ("p", "q", "delta_x", "delta_y", "delta_e")}
    return {name: float(values.std()) for name, values in channels.items() if values.size > 1}


def noise_findings(
    quiet: Samples, steps: Sequence[ProbeStep], usual: Mapping[str, float] | None
) -> Iterator[ProbeFinding]:
    """Whether p and q are there, alive, in rad/s and as quiet as `usual`, their deviations of an earlier probe."""
    noise = hover_noise(quiet)
    for name in MEASURED:
        pieces = [_known(samples, name) for samples in (quiet, *(step.samples for step in steps))]
        pieces = [values for values in pieces if values.size > 10]
        if not pieces:
            yield ProbeFinding(kind="no samples", axis=name, how="rate")
            continue
        if any(np.mean(np.diff(values) == 0) > 0.9 for values in pieces):
            yield ProbeFinding(kind="frozen", axis=name)
            continue
        deviation = noise.get(name)
        if deviation is None:
            continue
        if deviation > QUIET_RATE:
            yield ProbeFinding(kind="units", axis=name, numbers={"deviation": deviation}, how="noise")
        before = (usual or {}).get(name)
        if before is not None and deviation > NOISIER * before:
            yield ProbeFinding(
                kind="noisy", axis=name, serious=False, numbers={"deviation": deviation, "usual": before}
            )


def flown_findings(step: ProbeStep) -> Iterator[ProbeFinding]:
    """Whether the excitation, where it is logged, is what was asked for, and whether the command moved."""
    axis, asked = step.maneuver.axis, step.maneuver.amplitude
    letter = LETTERS[axis]
    excitation, command = (_known(step.samples, name + letter) for name in ("excitation_", "delta_"))
    if command.size < 10:
        yield ProbeFinding(kind="no samples", axis=axis, how="command")
        return
    if excitation.size > 10 and np.ptp(excitation) < asked:
        numbers = {"moved": 0.5 * float(np.ptp(excitation)), "asked": asked}
        yield ProbeFinding(kind="no excitation", axis=axis, numbers=numbers, how="not added")
    elif np.ptp(command) < 0.1 * asked or np.mean(np.diff(command) == 0) > 0.999:
        numbers = {"moved": 0.5 * float(np.ptp(command)), "asked": asked}
        yield ProbeFinding(kind="no excitation", axis=axis, numbers=numbers, how="still")
