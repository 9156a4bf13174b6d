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
    where = "in quiet hover" if axis is None else f"of the {axis} step"
    hz = log_rate_hz(t)
    if hz is None or t[-1] - t[0] < 1.0:
        words = f"no samples {where} came (less than a second of them): nothing can be said; is the log running?"
        yield ProbeFinding("no samples", axis, words)
        return
    if hz < SLOWEST_HZ:
        words = f"the log comes at {hz:.0f} Hz: too slow for a sweep; set the vehicle to log in every loop"
        yield ProbeFinding("slow log", None, words, True, {"rate_hz": hz})
    elif expected_hz is not None and hz < 0.9 * expected_hz:
        words = f"the log comes at {hz:.0f} Hz, not at {expected_hz:.0f}"
        yield ProbeFinding("slow log", None, words, False, {"rate_hz": hz, "expected_hz": expected_hz})
    spaces = np.diff(t)
    wide = spaces[spaces > 3 / hz]
    lost = float(np.sum(wide) - wide.size / hz) / float(t[-1] - t[0])
    if wide.size:
        words = f"{wide.size} gaps in the log {where}, {100 * lost:.1f} % lost, the longest {wide.max():.2f} s"
        numbers = {"gaps": float(wide.size), "lost": lost, "longest_s": float(wide.max())}
        yield ProbeFinding("gaps", axis, words, lost > FEW_LOST, numbers)


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
            yield ProbeFinding("no samples", name, f"{name} is not in the log: nothing can be said of that axis")
            continue
        if any(np.mean(np.diff(values) == 0) > 0.9 for values in pieces):
            words = f"{name} stands still in the log: its gyro is frozen, or is not logged in every loop"
            yield ProbeFinding("frozen", name, words)
            continue
        deviation = noise.get(name)
        if deviation is None:
            continue
        if deviation > QUIET_RATE:
            words = (
                f"{name} varies by {deviation:.2f} rad/s in quiet hover: is it in deg/s, or is the vehicle not quiet?"
            )
            yield ProbeFinding("units", name, words, True, {"deviation": deviation})
        before = (usual or {}).get(name)
        if before is not None and deviation > NOISIER * before:
            words = (
                f"{name} is {deviation / before:.1f} times as noisy as usual: {deviation:.3f} rad/s, not {before:.3f}"
            )
            yield ProbeFinding("noisy", name, words, False, {"deviation": deviation, "usual": before})


def flown_findings(step: ProbeStep) -> Iterator[ProbeFinding]:
    """Whether the excitation, where it is logged, is what was asked for, and whether the command moved."""
    axis, asked = step.maneuver.axis, step.maneuver.amplitude
    letter = LETTERS[axis]
    excitation, command = (_known(step.samples, name + letter) for name in ("excitation_", "delta_"))
    if command.size < 10:
        words = f"delta_{letter} is not in the log: nothing can be said of {axis}"
        yield ProbeFinding("no samples", axis, words)
        return
    if excitation.size > 10 and np.ptp(excitation) < asked:
        numbers = {"moved": 0.5 * float(np.ptp(excitation)), "asked": asked}
        words = f"nothing like ±{asked:g} was added on {axis} (the log has ±{numbers['moved']:.4f}): no step was flown"
        yield ProbeFinding("no excitation", axis, words, True, numbers)
    elif np.ptp(command) < 0.1 * asked or np.mean(np.diff(command) == 0) > 0.999:
        numbers = {"moved": 0.5 * float(np.ptp(command)), "asked": asked}
        words = f"delta_{letter} did not move (±{numbers['moved']:.4f}) while ±{asked:g} was asked for on {axis}"
        yield ProbeFinding("no excitation", axis, words, True, numbers)
