"""A probe before the card: a small step on each axis, judged before thirty seconds at full amplitude are flown.

From a few quiet seconds of hover and one small run on each axis: do the rates answer at all, with the right sign, on
the right axis, in time, in the right unit, and does the log hold what it must. What cannot be seen above the noise is
said to be so: it is neither right nor wrong.

The answer is fitted as

    rate_i(t) = sum_j (b0_ij + b1_ij s) w_i^2 / (s^2 + 2 zeta_i w_i s + w_i^2) delta_j(t - T_i)

with `b0`, `b1` by two-stage least squares (what is added is the instrument), because feedback puts gusts into the
commands. A gain is the rate half a second after a step of full command; of both commands on both rates it is a 2 x 2
matrix. A rotor's own coupling turns it by some degrees, a swashplate or a gyro that is a quarter turn off by 90, one
reversed axis makes its determinant negative. So signs and axes are judged together, as the nearest of the eight ways to
exchange and reverse two axes.

Ignored: play and friction, which make a small step's answer smaller than the card's (see `SAFETY`), the sign of an
elevator, for which there is no convention, and yaw.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.linalg import matmul_toeplitz, orth

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver, TestCard
from gcs.vehicle.profile import VehicleProfile

FloatArray = NDArray[np.float64]
Samples = Mapping[str, FloatArray]

QUIET_S = 5.0
"""How much hover before the first step is read."""
FRACTION = 0.2
"""Of the card's amplitude."""
LEAST_AMPLITUDE = 0.002
"""Of full command: less is within the resolution of a servo. Never more than the card's own."""
PULSE_S = 0.5
DOUBLET_S = 6.0
"""Two doublets of half-second pulses, each with two seconds of rest."""
CHIRP_S = 5.0
CHIRP_HZ = (1.0, 2.0)
REST_S = 2.0

LATE_S = 0.15
"""A command that is answered later than this leaves no controller enough margin."""
SEEN = 4.5
"""Answer over its standard error from which it is taken for one."""
SURE_LATE = 2.5
"""Standard errors beyond `LATE_S` from which a delay is wrong; below, it is said to seem so."""
SURE = 3.0
"""Standard errors by which one way of exchanging axes must be better than another."""
TURNED_DEG = 45.0
FEW_LOST = 0.01
SLOWEST_HZ = 40.0
"""A log must hold four samples in a period at the end of a 10 Hz sweep."""
NOISIER = 1.6
"""Times the usual deviation."""
QUIET_RATE = 0.6
"""rad/s: no vehicle hovers with rates that vary by more; in deg/s every one does."""
LARGEST_GAIN = 150.0
"""rad/s per full command: quadrotors reach 60 in half a second."""
SAFETY = 1.25
"""On predicted rate and attitude: gusts add to the answer, and play hides a part of it from a small step."""

_GRID_S = 0.01
_SMOOTH_HZ = 5.0
_NEGLIGIBLE = 1e-6
"""Of the largest singular value."""
_REACHED_S = (0.25, 0.75)
"""After a step of the command: what is reached there is called the gain."""
_LATEST_S = 0.4
_MEMORY_S = 0.6
_INSTRUMENTS_S = tuple(0.1 * k for k in range(8))
"""What is added, so much later, tells the commands' answer to it from gusts."""
_LETTERS = {"roll": "x", "pitch": "y", "elevator": "e"}
_RATES = {"roll": "p", "pitch": "q", "elevator": "q"}
_ATTITUDES = {"p": "phi", "q": "theta"}
_CHANNELS = ("p", "q", "delta_x", "delta_y", "delta_e", "excitation_x", "excitation_y", "excitation_e", "phi", "theta")
_SWINGS_HZ = (0.3, 0.4, 0.5, 0.7, 1.0, 1.3, 1.6)
_WAYS = tuple(
    np.array([[a, 0.0], [0.0, b]]) @ turn for turn in (np.eye(2), np.eye(2)[::-1]) for a in (1, -1) for b in (1, -1)
)
"""The eight ways to exchange and reverse two axes: rows p and q, columns delta_x and delta_y. The first is right."""


# ------------------------------------------------------------------------------------------------ what is flown


def probe_card(card: TestCard, profile: VehicleProfile, fraction: float = FRACTION) -> TestCard:
    """The small runs that a probe flies, one for each axis whose command the card excites, in the card's order.

    A doublet where the vehicle flies them, else a short narrow chirp; `fraction` of the card's largest amplitude on
    that axis. No maneuvers where the card excites no command or the vehicle has none of its axes.
    """
    largest: dict[str, float] = {}
    for maneuver in card.maneuvers:
        if maneuver.kind != "quiet" and maneuver.target == "command" and maneuver.axis in profile.axes:
            largest[maneuver.axis] = max(largest.get(maneuver.axis, 0.0), maneuver.amplitude)
    doublets = "doublet" in profile.kinds
    maneuvers = tuple(
        _small(axis, min(amplitude, max(LEAST_AMPLITUDE, fraction * amplitude)), doublets)
        for axis, amplitude in largest.items()
    )
    return TestCard(f"probe of {card.name}", maneuvers, "a small step on each axis", REST_S, limits=card.limits)


def _small(axis: str, amplitude: float, doublet: bool) -> Maneuver:
    if doublet:
        return Maneuver("doublet", axis, amplitude, DOUBLET_S, pulse_s=PULSE_S, purpose="build-up")
    low, high = CHIRP_HZ
    return Maneuver("chirp", axis, amplitude, CHIRP_S, f_start_hz=low, f_stop_hz=high, purpose="build-up")


# ------------------------------------------------------------------------------------------------ what is concluded


@dataclass(frozen=True, slots=True)
class ProbeStep:
    """One small run with its samples."""

    maneuver: Maneuver
    samples: Samples
    """Arrays of shape (n,) as `gcs.flight.verdict.cut` gives them, best with a second before and after the excitation;
    phi and theta (rad, NaN between their samples) where known."""
    start_s: float | None = None
    """When the excitation began, on the samples' clock: lets it be worked out where the vehicle does not log it."""


@dataclass(frozen=True, slots=True)
class ProbeFinding:
    """One thing that a probe found."""

    kind: str
    """`no samples`, `slow log`, `gaps`, `frozen`, `units`, `noisy`, `no excitation`, `reversed`, `swapped`, `turned`,
    `late` or `unseen`."""
    axis: str | None
    """None where it concerns the whole vehicle."""
    words: str
    serious: bool = True
    """Whether the card must not be flown before it is mended."""
    numbers: Mapping[str, float] | None = None

    def to_json(self) -> dict[str, Any]:
        numbers = {key: _rounded(value) for key, value in (self.numbers or {}).items()}
        return {
            "kind": self.kind, "axis": self.axis, "words": self.words, "serious": self.serious, "numbers": numbers
        }  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisAnswer:
    """How a vehicle answered the step on one axis; numbers are None where nothing was seen above the noise."""

    axis: str
    amplitude: float
    """Flown, of full command."""
    signal_to_noise: float
    """The answer over its standard error; seen from `SEEN` on."""
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

    @property
    def words(self) -> str:
        if self.gain is None or self.gain_error is None:
            return f"{self.axis}: not seen above the noise ({self.signal_to_noise:.1f} times its error)"
        parts = [f"{self.axis}: {self.rate} follows delta_{_LETTERS[self.axis]}"]
        if self.delay_s is not None and self.delay_error_s is not None:
            parts.append(f" after {1000 * self.delay_s:.0f} ± {1000 * self.delay_error_s:.0f} ms")
        parts.append(f", {self.gain:.1f} ± {self.gain_error:.1f} rad/s per full command")
        return "".join(parts)

    def to_json(self) -> dict[str, Any]:
        keys = ("amplitude", "signal_to_noise", "gain", "gain_error", "delay_s", "delay_error_s", "peak_rate")
        numbers = {key: _rounded(getattr(self, key)) for key in (*keys, "peak_attitude")}
        return {"axis": self.axis, "seen": self.seen, "rate": self.rate, **numbers}


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

    @property
    def words(self) -> tuple[str, ...]:
        """A few short lines: what is wrong first."""
        serious = [finding.words for finding in self.findings if finding.serious]
        rest = [finding.words for finding in self.findings if not finding.serious and finding.kind != "unseen"]
        rates = [f"{name} {self.noise[name]:.3f}" for name in ("p", "q") if name in self.noise]
        noise = [f"noise in hover: {', '.join(rates)} rad/s"] if rates else []
        return (*serious, *(answer.words for answer in self.answers), *noise, *rest)

    def to_json(self) -> dict[str, Any]:
        return {
            "ok": self.ok,
            "wrong": self.wrong,
            "findings": [finding.to_json() for finding in self.findings],
            "answers": [answer.to_json() for answer in self.answers],
            "noise": {name: _rounded(value) for name, value in self.noise.items()},
            "rate_hz": _rounded(self.rate_hz),
            "turn_deg": _rounded(self.turn_deg),
            "words": list(self.words),
        }


def _rounded(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(f"{value:.4g}")


def judge_probe(
    quiet: Samples,
    steps: Sequence[ProbeStep],
    rate_hz: float | None = None,
    usual_noise: Mapping[str, float] | None = None,
) -> ProbeResult:
    """What the quiet hover and the steps say.

    `quiet` has the samples of some seconds of hover (five are enough), as `ProbeStep.samples`; `rate_hz` is the rate
    the log should have, None where that is not known; `usual_noise` the deviations of p and q of an earlier probe in
    rad/s, where there was one.
    """
    findings = [*_log_findings(quiet, None, rate_hz), *_noise_findings(quiet, steps, usual_noise)]
    usable = []
    for step in steps:
        trouble = [*_log_findings(step.samples, step.maneuver.axis, rate_hz), *_unmoved(step)]
        findings += trouble
        if not any(finding.kind in ("no samples", "no excitation") for finding in trouble):
            usable.append(step)
    frozen = {finding.axis for finding in findings if finding.kind == "frozen"}
    rates = tuple(name for name in ("p", "q") if name not in frozen)
    cyclic = [step for step in usable if step.maneuver.axis != "elevator"]
    answers: dict[str, AxisAnswer] = {}
    turn_deg = None
    if cyclic and rates:
        fit = _fit(quiet, cyclic, rates)
        wrong, turn_deg = _crossed(fit, cyclic)
        findings += wrong
        answers |= _answers(fit, cyclic, wrong)
    for step in usable:
        if step.maneuver.axis == "elevator" and "q" in rates:
            answers |= _answers(_fit(quiet, [step], ("q",)), [step], [])
    flown = [step.maneuver.axis for step in steps if step.maneuver.axis in answers]
    in_order = tuple(answers[axis] for axis in dict.fromkeys(flown))
    findings += [finding for answer in in_order for finding in _of_answer(answer)]
    return ProbeResult(
        findings=tuple(_once(findings)),
        answers=in_order,
        noise=_noise(quiet),
        rate_hz=_rate_hz(quiet["t"]),
        turn_deg=turn_deg,
    )


def _once(findings: Sequence[ProbeFinding]) -> Iterator[ProbeFinding]:
    """Each kind once for an axis; the worst first."""
    told = set()
    for finding in sorted(findings, key=lambda finding: not finding.serious):
        if (finding.kind, finding.axis) not in told:
            told.add((finding.kind, finding.axis))
            yield finding


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


# ------------------------------------------------------------------------------------------------ the log


def _rate_hz(t: FloatArray) -> float | None:
    if t.size < 3:
        return None
    spacing = float(np.median(np.diff(t)))
    return 1 / spacing if spacing > 0 else None


def _log_findings(samples: Samples, axis: str | None, expected_hz: float | None) -> Iterator[ProbeFinding]:
    t = samples["t"]
    where = "in quiet hover" if axis is None else f"of the {axis} step"
    rate_hz = _rate_hz(t)
    if rate_hz is None or t[-1] - t[0] < 1.0:
        words = f"no samples {where} came (less than a second of them): nothing can be said; is the log running?"
        yield ProbeFinding("no samples", axis, words)
        return
    if rate_hz < SLOWEST_HZ:
        words = f"the log comes at {rate_hz:.0f} Hz: too slow for a sweep; set the vehicle to log in every loop"
        yield ProbeFinding("slow log", None, words, True, {"rate_hz": rate_hz})
    elif expected_hz is not None and rate_hz < 0.9 * expected_hz:
        words = f"the log comes at {rate_hz:.0f} Hz, not at {expected_hz:.0f}"
        yield ProbeFinding("slow log", None, words, False, {"rate_hz": rate_hz, "expected_hz": expected_hz})
    spaces = np.diff(t)
    wide = spaces[spaces > 3 / rate_hz]
    lost = float(np.sum(wide) - wide.size / rate_hz) / float(t[-1] - t[0])
    if wide.size:
        words = f"{wide.size} gaps in the log {where}, {100 * lost:.1f} % lost, the longest {wide.max():.2f} s"
        numbers = {"gaps": float(wide.size), "lost": lost, "longest_s": float(wide.max())}
        yield ProbeFinding("gaps", axis, words, lost > FEW_LOST, numbers)


def _known(samples: Samples, name: str) -> FloatArray:
    """The finite samples of a channel; none where it is not known."""
    values = samples.get(name, np.empty(0))
    return values[np.isfinite(values)]


def _noise(quiet: Samples) -> dict[str, float]:
    channels = {name: _known(quiet, name) for name in ("p", "q", "delta_x", "delta_y", "delta_e")}
    return {name: float(values.std()) for name, values in channels.items() if values.size > 1}


def _noise_findings(
    quiet: Samples, steps: Sequence[ProbeStep], usual: Mapping[str, float] | None
) -> Iterator[ProbeFinding]:
    noise = _noise(quiet)
    for name in ("p", "q"):
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


def _unmoved(step: ProbeStep) -> Iterator[ProbeFinding]:
    """Whether the excitation, where it is logged, is what was asked for, and whether the command moved."""
    axis, asked = step.maneuver.axis, step.maneuver.amplitude
    letter = _LETTERS[axis]
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


# ------------------------------------------------------------------------------------------------ samples on a grid


@dataclass(frozen=True, eq=False, slots=True)
class _Gridded:
    """A step on an even grid: means over `_GRID_S`, smoothed alike, so that what leads from one to another is kept."""

    axis: str
    start_s: float
    u: dict[str, FloatArray]
    """Commands by letter."""
    e: dict[str, FloatArray]
    """What was added, by letter, as logged or worked out; the command itself where neither is possible."""
    y: dict[str, FloatArray]
    rows: NDArray[np.bool_]
    """Where samples were."""
    raw: dict[str, FloatArray]
    """As logged, not smoothed."""


def _means(samples: Samples) -> tuple[dict[str, FloatArray], NDArray[np.bool_]]:
    """Every known channel as means over the grid, gaps bridged, and where there were samples."""
    t = samples["t"]
    at = np.floor((t - t[0]) / _GRID_S + 1e-6).astype(int)
    size = int(at[-1]) + 1
    grid = np.arange(size)
    there = np.bincount(at, minlength=size) > 0
    # A log slower than the grid leaves holes that are none.
    width = max(1, math.ceil(2 * float(np.median(np.diff(t))) / _GRID_S))
    rows = np.convolve(there, np.ones(width), "same") > 0
    means = {}
    for name in _CHANNELS:
        values = samples.get(name)
        if values is None:
            continue
        finite = np.isfinite(values)
        if finite.sum() < 10 or finite.mean() < 0.5:
            continue
        count = np.bincount(at[finite], minlength=size)
        total = np.bincount(at[finite], np.asarray(values)[finite], minlength=size)
        has = count > 0
        means[name] = np.interp(grid, grid[has], total[has] / count[has])
    return means, rows


def _smooth(values: FloatArray) -> FloatArray:
    sos = signal.butter(4, _SMOOTH_HZ, fs=1 / _GRID_S, output="sos")
    smooth: FloatArray = signal.sosfiltfilt(sos, values, padlen=min(50, values.size - 1))
    return smooth


def _gridded(step: ProbeStep, rates: Sequence[str]) -> _Gridded:
    raw, rows = _means(step.samples)
    letter = _LETTERS[step.maneuver.axis]
    size = rows.size
    letters = ("e",) if letter == "e" else ("x", "y")
    nothing = np.zeros(size)
    u = {k: _smooth(raw.get("delta_" + k, nothing)) for k in letters}
    added = raw.get("excitation_" + letter)
    if added is None and step.start_s is not None:
        since = np.asarray(float(step.samples["t"][0]) + (np.arange(size) + 0.5) * _GRID_S - step.start_s, float)
        added = _law(step.maneuver, since)
    e = dict.fromkeys(letters, nothing)
    # Its mean over what came before is what feedback and trim held: only what moves counts.
    e[letter] = u[letter] - u[letter].mean() if added is None else _smooth(added)
    y = {name: _smooth(raw[name]) if name in raw else nothing for name in rates}
    return _Gridded(step.maneuver.axis, float(step.samples["t"][0]), u, e, y, rows, raw)


def _law(maneuver: Maneuver, t: FloatArray) -> FloatArray:
    """What the vehicle adds, from the start of the excitation: doublets, or ArduPilot's chirp without its fades."""
    flown = (t >= 0) & (t < maneuver.duration_s)
    if maneuver.kind == "doublet":
        pulse = np.floor(t / maneuver.pulse_s) % 6
        return np.asarray(maneuver.amplitude * flown * np.select([pulse == 0, pulse == 1], [1.0, -1.0], 0.0))
    constant_s = 2 / maneuver.f_start_hz
    span_s = maneuver.duration_s - constant_s
    growth = math.log(maneuver.f_stop_hz / maneuver.f_start_hz) / span_s
    late = np.clip(t - constant_s, 0.0, span_s)
    phase = np.where(t < constant_s, t - constant_s, np.expm1(growth * late) / growth)
    return np.asarray(maneuver.amplitude * flown * np.sin(2 * math.pi * maneuver.f_start_hz * phase))


# ------------------------------------------------------------------------------------------------ the fit


@dataclass(frozen=True, eq=False, slots=True)
class _Row:
    """One rate's answer to the commands."""

    gain: FloatArray
    """Rate half a second after a step of full command, shape (m,) in the order of `_Fit.letters`."""
    covariance: FloatArray
    """Shape (m, m)."""
    evidence: FloatArray
    """How far each command's whole answer stands out, squared standard errors less what noise gives, shape (m,)."""
    delay_s: float
    delay_error_s: float
    answered: tuple[FloatArray, ...]
    """The fitted answer to what was added in each step, on its grid, without offset and slope."""


@dataclass(frozen=True, eq=False, slots=True)
class _Fit:
    letters: tuple[str, ...]
    rates: tuple[str, ...]
    rows: tuple[_Row, ...]
    steps: tuple[_Gridded, ...]

    @property
    def G(self) -> FloatArray:
        """Gains, shape (rates, letters)."""
        return np.array([row.gain for row in self.rows])

    def variance(self, weights: FloatArray) -> float:
        """Of the sum of weights times G, both of shape (rates, letters)."""
        return float(sum(w @ row.covariance @ w for w, row in zip(weights, self.rows, strict=True)))


def _fit(quiet: Samples, steps: Sequence[ProbeStep], rates: tuple[str, ...]) -> _Fit:
    grids = tuple(_gridded(step, rates) for step in steps)
    letters = tuple(dict.fromkeys(_LETTERS[grid.axis] for grid in grids))
    rows = tuple(_fit_row(quiet, grids, letters, rate) for rate in rates)
    return _Fit(letters, rates, rows, grids)


@dataclass(frozen=True, eq=False, slots=True)
class _Problem:
    """One rate in all steps, one after the other, with what must be projected out."""

    grids: tuple[_Gridded, ...]
    letters: tuple[str, ...]
    y: FloatArray
    rows: NDArray[np.bool_]
    drift: FloatArray
    """Orthonormal: an offset and a slope for each step."""
    instruments: FloatArray
    """Orthonormal: what was added in each step and up to 0.7 s before, without offsets and slopes."""

    def free(self, columns: FloatArray) -> FloatArray:
        """Without offsets and slopes, where there were samples."""
        kept = columns[self.rows]
        free: FloatArray = kept - self.drift @ (self.drift.T @ kept)
        return free

    def instrumented(self, columns: FloatArray) -> FloatArray:
        """What the instruments find in columns of shape (n, ...); offsets and slopes are not in it, shape (k, ...)."""
        found: FloatArray = self.instruments.T @ columns[self.rows]
        return found

    def answers(self, w: float, zeta: float) -> tuple[FloatArray, ...]:
        """For each step the filter's output and its derivative over w for each command, at once: (2 m, n)."""
        moved = (np.stack([grid.u[k] - grid.u[k][:10].mean() for k in self.letters]) for grid in self.grids)
        return tuple(_lag(values, w, zeta) for values in moved)

    def filtered(self, w: float, zeta: float, delay_s: float) -> FloatArray:
        """The answers of all steps, late by `delay_s`, shape (n, 2 m)."""
        return _late(self.answers(w, zeta), delay_s)


def _lag(values: FloatArray, w: float, zeta: float) -> FloatArray:
    """Rows (m, n) through w^2 / (s^2 + 2 zeta w s + w^2) and its derivative over w: (2 m, n)."""
    k = 2 / _GRID_S
    denominator = np.array([k * k + 2 * zeta * w * k + w * w, 2 * (w * w - k * k), k * k - 2 * zeta * w * k + w * w])
    position = signal.lfilter(w * w * np.array([1.0, 2.0, 1.0]), denominator, values)
    speed = signal.lfilter(w * k * np.array([1.0, 0.0, -1.0]), denominator, values)
    return np.concatenate([position, speed])


def _late(answers: Sequence[FloatArray], delay_s: float) -> FloatArray:
    """Rows (2 m, n) of each step, late by `delay_s` after its beginning at rest; columns, one step after the other."""
    whole = int(delay_s / _GRID_S)
    part = delay_s / _GRID_S - whole
    late = np.zeros((sum(rows.shape[1] for rows in answers), answers[0].shape[0]))
    start = 0
    for rows in answers:
        size = rows.shape[1]
        late[start + whole : start + size] = (1 - part) * rows.T[: max(size - whole, 0)]
        late[start + whole + 1 : start + size] += part * rows.T[: max(size - whole - 1, 0)]
        start += size
    return late


def _problem(grids: tuple[_Gridded, ...], letters: tuple[str, ...], rate: str) -> _Problem:
    rows = np.concatenate([grid.rows for grid in grids])
    bounds = np.cumsum([0, *(grid.rows.size for grid in grids)])
    k = len(_INSTRUMENTS_S)
    columns, added = np.zeros((rows.size, 2 * len(grids))), np.zeros((rows.size, k * len(grids)))
    for i, grid in enumerate(grids):
        inside = slice(bounds[i], bounds[i + 1])
        columns[inside, 2 * i] = 1.0
        columns[inside, 2 * i + 1] = np.linspace(-1, 1, grid.rows.size)
        e = grid.e[_LETTERS[grid.axis]]
        for j, late_s in enumerate(_INSTRUMENTS_S):
            late = round(late_s / _GRID_S)
            added[bounds[i] + late : bounds[i + 1], k * i + j] = e[: max(e.size - late, 0)]
    drift = np.linalg.qr(columns[rows])[0]
    bare = added[rows] - drift @ (drift.T @ added[rows])
    y = np.concatenate([grid.y[rate] for grid in grids])
    return _Problem(grids, letters, y, rows, drift, orth(bare, rcond=1e-6))


def _fit_row(quiet: Samples, grids: tuple[_Gridded, ...], letters: tuple[str, ...], rate: str) -> _Row:
    problem = _problem(grids, letters, rate)
    z = problem.instrumented(problem.y)
    answers = lru_cache(maxsize=1)(problem.answers)  # a delay moves them, and asks for no new ones

    def misfit(point: FloatArray) -> float:
        w, zeta, delay_s = _natural(point)
        return _solve(len(letters), problem.instrumented(_late(answers(w, zeta), delay_s)), z)[2]

    def early(point: FloatArray) -> float:
        return misfit(point) if point[2] <= LATE_S else math.inf

    starts = [
        np.array([math.log(w), math.log(zeta), delay])
        for w in np.geomspace(2.0, 50.0, 8)
        for zeta in (0.3, 0.6, 1.2)
        for delay in np.arange(0.0, _LATEST_S, 0.03)
    ]
    errors = np.array([misfit(point) for point in starts])
    point = _refined(misfit, starts[int(np.argmin(errors))])
    in_time = np.where([start[2] <= LATE_S for start in starts], errors, math.inf)
    worse = early(_refined(early, starts[int(np.argmin(in_time))])) - misfit(point)
    return _finished(problem, _natural(point), _quiet_noise(quiet, rate), max(worse, 0.0))


def _natural(point: FloatArray) -> tuple[float, float, float]:
    """Frequency in rad/s, damping ratio and delay within what is searched."""
    w, zeta = math.exp(min(max(point[0], 0.0), 4.2)), math.exp(min(max(point[1], -1.8), 1.1))
    return w, zeta, min(max(float(point[2]), 0.0), _LATEST_S)


def _refined(misfit: Any, point: FloatArray) -> FloatArray:
    """Coordinate steps that halve; three unknowns, and nothing that can fail."""
    best, steps = misfit(point), np.array([0.2, 0.3, 0.015])
    for _ in range(6):
        for i in range(3):
            for sign in (1.0, -1.0):
                tried = point.copy()
                tried[i] += sign * steps[i]
                error = misfit(tried)
                if error < best:
                    point, best = tried, error
        steps = steps / 2
    return point


def _solve(m: int, R: FloatArray, z: FloatArray) -> tuple[FloatArray, NDArray[np.intp], float]:
    """Coefficients, which columns they belong to, and the squares that the instruments find in what is left: gusts that
    reach the commands by feedback are not in them.

    `R` and `z` are what the instruments find in the answers to `m` commands, (k, 2 m), and in the rate. A numerator
    that turns the strongest gain the other way round at first stands for a delay: it is left out.
    """
    b, used = np.linalg.lstsq(R, z, rcond=_NEGLIGIBLE)[0], np.arange(2 * m)
    strongest = int(np.argmax(np.abs(b[:m]) + np.abs(b[m:])))
    if b[strongest] * b[m + strongest] < 0:
        used = np.delete(used, m + strongest)
        b = np.linalg.lstsq(R[:, used], z, rcond=_NEGLIGIBLE)[0]
    unexplained: FloatArray = z - R[:, used] @ b
    return np.asarray(b), used, float(unexplained @ unexplained)


def _inverse(problem: _Problem, X: FloatArray) -> FloatArray:
    """What takes the rate to the coefficients: the pseudoinverse of that part of X that was added."""
    Q = problem.instruments
    inverse: FloatArray = np.linalg.pinv(Q.T @ X, rcond=_NEGLIGIBLE) @ Q.T
    return inverse


def _quiet_noise(quiet: Samples, rate: str) -> FloatArray:
    """The rate in quiet hover, smoothed as the steps and without its slope; empty where it is not known."""
    if quiet["t"].size < 50 or quiet["t"][-1] - quiet["t"][0] < 1.0:
        return np.empty(0)
    values = _means(quiet)[0].get(rate)
    return np.empty(0) if values is None else np.asarray(signal.detrend(_smooth(values)))


def _autocovariance(residual: FloatArray, quiet: FloatArray) -> FloatArray:
    """Of what is not answer, shape (n,): the residual's, raised to the quiet hover's variance, fading with the lag."""
    n = residual.size
    lags = np.arange(min(n, round(_MEMORY_S / _GRID_S)))
    own = np.array([residual[lag:] @ residual[: n - lag] for lag in lags]) / n
    scale = max(1.0, float(quiet.var()) / max(own[0], 1e-30)) if quiet.size else 1.0
    out = np.zeros(n)
    out[: lags.size] = scale * own * (1 - lags / lags.size)
    return out


def _finished(problem: _Problem, point: tuple[float, float, float], quiet: FloatArray, worse: float) -> _Row:
    """The fit at its best point, with errors that hold for coloured noise.

    `worse` is the squares that the best fit in time leaves more than this one.
    """
    m = len(problem.letters)
    answers = problem.filtered(*point)
    b, used, _ = _solve(m, problem.instrumented(answers), problem.instrumented(problem.y))
    X = problem.free(answers[:, used])
    noise = _autocovariance(problem.free(problem.y) - X @ b, quiet)
    inverse = _inverse(problem, X)
    covariance = inverse @ matmul_toeplitz(noise, inverse.T)
    reached = _reached(m, *point[:2])[:, used]
    delay_error = _delay_error(problem, X, b, used, point, noise)
    if point[2] > LATE_S:
        # The misfit need not be a parabola: how much worse an answer in time would be counts, too.
        level = max(float(2 * noise.sum() - noise[0]), 1e-30)
        delay_error = max(delay_error, (point[2] - LATE_S) / math.sqrt(max(worse / level, 1e-6)))
    answered = np.zeros(problem.rows.size)
    answered[problem.rows] = problem.instruments @ (problem.instruments.T @ (X @ b))
    bounds = np.cumsum([grid.rows.size for grid in problem.grids])[:-1]
    return _Row(
        reached @ b,
        reached @ covariance @ reached.T,
        np.array([_evidence(b, covariance, used % m == j) for j in range(m)]),
        point[2],
        delay_error,
        tuple(np.split(answered, bounds)),
    )


def _reached(m: int, w: float, zeta: float) -> FloatArray:
    """The filter's and its derivative's mean answer to a step within `_REACHED_S`, shape (m, 2 m)."""
    start, stop = (round(at / _GRID_S) for at in _REACHED_S)
    position, speed = _lag(np.ones((1, stop)), w, zeta)[:, start:].mean(axis=1)
    return np.hstack([position * np.eye(m), speed * np.eye(m)])


def _evidence(b: FloatArray, covariance: FloatArray, which: NDArray[np.bool_]) -> float:
    """Of some coefficients: chi squared less its degrees of freedom."""
    part = covariance[np.ix_(which, which)]
    return float(b[which] @ np.linalg.pinv(part) @ b[which]) - float(which.sum())


def _delay_error(
    problem: _Problem,
    X: FloatArray,
    b: FloatArray,
    used: NDArray[np.intp],
    point: tuple[float, float, float],
    noise: FloatArray,
) -> float:
    """Standard error of the delay, frequency and damping being as unknown as the gains."""
    slopes = []
    for i, step in enumerate((0.02 * point[0], 0.02 * point[1], 0.005)):
        high, low = (tuple(x + sign * step * (j == i) for j, x in enumerate(point)) for sign in (1, -1))
        low = (low[0], low[1], max(low[2], 0.0))
        difference = problem.filtered(*high) - problem.filtered(*low)
        slopes.append(problem.free(difference[:, used] @ b) / (high[i] - low[i]))
    J = np.column_stack([X, *slopes])
    J = J / np.maximum(np.linalg.norm(J, axis=0), 1e-30)
    scale = max(float(np.linalg.norm(slopes[2])), 1e-30)
    inverse = np.linalg.pinv(J, rcond=1e-3)
    variance = float(inverse[-1] @ matmul_toeplitz(noise, inverse[-1]))
    return math.sqrt(max(variance, 0.0)) / scale


# ------------------------------------------------------------------------------------------------ signs and axes


def _seen(fit: _Fit, column: int) -> float:
    """The answer of all rates to one command over its standard error."""
    return math.sqrt(max(0.0, sum(float(row.evidence[column]) for row in fit.rows)))


def _crossed(fit: _Fit, steps: Sequence[ProbeStep]) -> tuple[list[ProbeFinding], float | None]:
    """Reversed and swapped axes, and how far commands and rates are turned."""
    mixing = _mixing(fit)
    columns = [j for j in range(len(fit.letters)) if _seen(fit, j) >= SEEN]
    if not columns or len(fit.rates) < 2:
        findings = _reversed_alone(fit, columns)
        return [*_mixing_findings(fit, mixing), *findings], None
    G = _even(fit.G[:, columns])
    way, sure = _nearest(fit, G, columns)
    findings = list(_mixing_findings(fit, mixing))
    rest = way @ mixing
    attitude = _by_attitude(fit)
    if sure:
        findings += _way_findings(rest, [fit.letters[j] for j in columns], attitude)
    turn = None
    if len(columns) == 2 and np.linalg.det(G) > 0:
        turn = math.degrees(math.atan2(G[1, 0] - G[0, 1], G[0, 0] + G[1, 1]))
        if not findings and abs(turn) > TURNED_DEG:
            words = (
                f"commands and rates are turned by {turn:.0f} degrees: a swashplate's phase angle, or strong coupling"
            )
            findings.append(ProbeFinding("turned", None, words, False, {"turn_deg": turn}))
    return findings, turn


def _even(G: FloatArray) -> FloatArray:
    """Rows of one length: neither rate's inertia counts."""
    even: FloatArray = G / np.maximum(np.linalg.norm(G, axis=1, keepdims=True), 1e-12)
    return even


def _nearest(fit: _Fit, G: FloatArray, columns: Sequence[int]) -> tuple[FloatArray, bool]:
    """The way of exchanging axes that is nearest to the gains, and whether it surely beats being in order.

    `G` is of shape (2, len(columns)); the columns that were not seen are taken to be in order with those that were.
    """
    places = [_letter_index(fit.letters[j]) for j in columns]
    scores = [float(np.sum(way[:, places] * G)) for way in _WAYS]
    best = int(np.argmax(scores))
    order = scores[0]
    if best == 0:
        return _WAYS[0], True
    scale = np.where(np.abs(fit.G[:, columns]) > 1e-12, G / np.where(fit.G[:, columns] == 0, 1, fit.G[:, columns]), 0)
    weights = np.zeros_like(fit.G)
    weights[:, columns] = (_WAYS[best] - _WAYS[0])[:, places] * scale
    error = math.sqrt(max(fit.variance(weights), 0.0))
    sure = scores[best] - order > SURE * error and order < 0.6 * scores[best]
    return (_WAYS[best], True) if sure else (_WAYS[0], False)


def _letter_index(letter: str) -> int:
    return "xy".index(letter)


def _reversed_alone(fit: _Fit, columns: Sequence[int]) -> list[ProbeFinding]:
    """With one rate only, its own command's sign is all that can be judged."""
    found = []
    for j in columns:
        axis = {"x": "roll", "y": "pitch"}[fit.letters[j]]
        if _RATES[axis] == fit.rates[0] and fit.rows[0].gain[j] < 0:
            found.append(_reversed(axis, "command or gyro"))
    return found


def _way_findings(way: FloatArray, letters: Sequence[str], attitude: Mapping[str, str]) -> Iterator[ProbeFinding]:
    """What a way of exchanging axes means, for the columns that were seen."""
    if way[0, 0] == 0:
        signs = [("-" if way[i].sum() < 0 else "") + "delta_" + "yx"[i] for i in range(2) if "yx"[i] in letters]
        answers = ", ".join(f"{'pq'['yx'.index(s[-1])]} answers {s}" for s in signs)
        blame = "the gyro's axes" if "swapped" in attitude.values() else "the command's or the gyro's axes"
        words = f"roll and pitch are swapped: {answers}; look at {blame} (a swashplate's phase angle, the board's turn)"
        yield ProbeFinding("swapped", None, words)
        return
    for i, axis in enumerate(("roll", "pitch")):
        if way[i, i] < 0 and "xy"[i] in letters:
            yield _reversed(axis, attitude.get(_RATES[axis], "command or gyro"))


def _reversed(axis: str, blame: str) -> ProbeFinding:
    rate, letter = _RATES[axis], _LETTERS[axis]
    where = {
        "gyro": f"the gyro is: {rate} moves against the attitude",
        "command": f"the command more likely than the gyro: {rate} goes with the attitude",
        "swapped": f"the gyro is: {rate} does not go with the attitude",
    }.get(blame, "command or gyro: the log does not tell which")
    words = f"{axis} is reversed: positive delta_{letter} gives negative {rate}; {where}"
    return ProbeFinding("reversed", axis, words)


def _mixing(fit: _Fit) -> FloatArray:
    """How what is added shows on the commands, as one of the eight ways: rows delta_x, delta_y, columns what is added.

    Judged at the edges of what is added, where no feedback is as fast; in order where that is not known.
    """
    way = np.eye(2)
    for grid in fit.steps:
        j = _letter_index(_LETTERS[grid.axis])
        added = grid.raw.get("excitation_" + "xy"[j])
        if added is None:
            continue
        edge = np.diff(added)
        power = float(edge @ edge)
        shows = [
            float(edge @ np.diff(grid.raw["delta_" + k])) / power if "delta_" + k in grid.raw else 0.0 for k in "xy"
        ]
        strongest = int(np.argmax(np.abs(shows)))
        if power > 0 and abs(shows[strongest]) > 0.5:
            way[:, j] = 0.0
            way[strongest, j] = math.copysign(1.0, shows[strongest])
    return way if abs(np.linalg.det(way)) > 0.5 else np.eye(2)


def _mixing_findings(fit: _Fit, mixing: FloatArray) -> Iterator[ProbeFinding]:
    if mixing[0, 0] == 0:
        words = (
            "what is added on roll shows on delta_y, and on pitch on delta_x: look at the mixing, or at the log's names"
        )
        yield ProbeFinding("swapped", None, words)
        return
    for i, axis in enumerate(("roll", "pitch")):
        if mixing[i, i] < 0:
            letter = _LETTERS[axis]
            words = f"{axis} is reversed: delta_{letter} moves against what is added to it; look at the mixing"
            yield ProbeFinding("reversed", axis, words)


def _by_attitude(fit: _Fit) -> dict[str, str]:
    """What the attitude says of each rate: `command` (the rate goes with it), `gyro` (against it) or `swapped`."""
    told = {}
    for rate, angle in _ATTITUDES.items():
        shares = []
        for other in fit.rates:
            top = bottom = 0.0
            for grid in fit.steps:
                if angle in grid.raw and other in grid.raw:
                    turned = signal.detrend(np.cumsum(grid.raw[other]) * _GRID_S)
                    moved = signal.detrend(grid.raw[angle])
                    top += float(turned @ moved)
                    bottom += float(turned @ turned) + 1e-30
            shares.append((top / bottom if bottom else 0.0, other))
        if not shares or all(share == 0 for share, _ in shares):
            continue
        share, other = max(shares, key=lambda pair: abs(pair[0]))
        told[rate] = "swapped" if other != rate else "gyro" if share < 0 else "command"
    return told


# ------------------------------------------------------------------------------------------------ each axis


def _answers(fit: _Fit, steps: Sequence[ProbeStep], crossed: Sequence[ProbeFinding]) -> dict[str, AxisAnswer]:
    swapped = any(finding.kind == "swapped" for finding in crossed)
    out = {}
    for number, step in enumerate(steps):
        axis = step.maneuver.axis
        column = fit.letters.index(_LETTERS[axis])
        ratio = _seen(fit, column)
        own = _RATES[axis] if not swapped else {"p": "q", "q": "p"}[_RATES[axis]]
        rate = own if own in fit.rates else fit.rates[0]
        blank = AxisAnswer(
            axis=axis, amplitude=step.maneuver.amplitude, signal_to_noise=ratio, seen=ratio >= SEEN, rate=rate
        )
        out[axis] = _filled(blank, fit, number, column) if blank.seen else blank
    return out


def _filled(blank: AxisAnswer, fit: _Fit, number: int, column: int) -> AxisAnswer:
    row = fit.rows[fit.rates.index(blank.rate)]
    error = math.sqrt(max(row.covariance[column, column], 0.0))
    grid = fit.steps[number]
    moved = [np.abs(each.answered[number]).max() for each in fit.rows]
    spread = 1 + 1 / blank.signal_to_noise
    letter = _LETTERS[blank.axis]
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
    return float(np.abs(signal.detrend(np.cumsum(rate) * _GRID_S)).max())


def _rate_gains(added: FloatArray, answers: Sequence[FloatArray], spread: float) -> tuple[tuple[float, float], ...]:
    """Frequencies that the excitation holds and the larger rate per what was added there."""
    t = np.arange(added.size) * _GRID_S
    at = [np.exp(-2j * math.pi * hz * t) for hz in _SWINGS_HZ]
    put_in = [abs((added - added.mean()) @ wave) for wave in at]
    enough = 0.3 * max(put_in)
    return tuple(
        (float(hz), spread * float(max(abs((y - y.mean()) @ wave) for y in answers)) / size)
        for hz, wave, size in zip(_SWINGS_HZ, at, put_in, strict=True)
        if size > enough
    )


def _of_answer(answer: AxisAnswer) -> Iterator[ProbeFinding]:
    axis = answer.axis
    if not answer.seen or answer.gain is None or answer.delay_s is None or answer.delay_error_s is None:
        words = f"{axis}: not seen above the noise; probe again in calm air or with a larger step"
        yield ProbeFinding("unseen", axis, words, False, {"signal_to_noise": answer.signal_to_noise})
        return
    if abs(answer.gain) > LARGEST_GAIN:
        words = (
            f"{axis}: {abs(answer.gain):.0f} rad/s per full command is beyond any vehicle; is {answer.rate} in deg/s?"
        )
        yield ProbeFinding("units", answer.rate, words, True, {"gain": answer.gain})
    if answer.delay_s > LATE_S:
        sure = answer.delay_s - SURE_LATE * answer.delay_error_s > LATE_S
        words = (
            f"{axis}: {answer.rate} {'follows' if sure else 'seems to follow'} {1000 * answer.delay_s:.0f} ± "
            f"{1000 * answer.delay_error_s:.0f} ms after the command, more than {1000 * LATE_S:.0f}: "
        )
        words += "look for a slow servo or filter, or late stamps" if sure else "a larger step would tell"
        yield ProbeFinding("late", axis, words, sure, {"delay_s": answer.delay_s, "error_s": answer.delay_error_s})
