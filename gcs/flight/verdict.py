"""Keep a run, or fly it again? Ranked at once, from the samples that came, so that the pilot is still in the air.

Three questions: did the samples come, did the vehicle stay inside its envelope, and was it excited. For a chirp the
last is the coherence between what was put in and what the vehicle did; for a doublet, whether the command moved as
planned and the rates answered. A run not to be kept stays out of fits of its folder, unless it is named by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.cards.envelope import Limits, Peaks, Use, use
from gcs.cards.maneuver import Maneuver
from gcs.flight.live import LiveWindow
from gcs.vehicle.own_log import LARGER_BUFFER, LOG_EVERY_LOOP, SAMPLES_OF_A_PERIOD, SLOWER, slower_than_loop
from gcs.vehicle.profile import Plan
from sysid.data.coherence import coherence

FloatArray = NDArray[np.float64]

COHERENT = 0.6
"""Above this the rates follow the excitation: what is left is noise or something nonlinear."""
ENOUGH_BAND = 0.6
"""Part of the swept band that must be coherent."""
COMMANDS = {"roll": "x", "pitch": "y", "elevator": "e"}
"""Axes whose command the live log tells, and its letter there."""
NO_SAMPLES = "no samples came"
ON_CARD = "flown, log on the vehicle's card"
FEW_MISSING = 0.01
EVEN, MOST_EVEN = 0.5, 0.95
"""A log has a rate where so many of its spacings are within half of the median."""
SLOWEST_HZ = 60.0
"""A fit up to 15 Hz needs four samples of a period."""
FEW_AT_END_S = 0.25
"""Missing at a run's end: a chirp is fastest there."""
SEGMENT_S = 4.0
"""Length of a piece of the averaged spectra: 0.25 Hz resolution."""
RATE_SPREAD = 0.008
"""rad/s: a rate that varies by less did not answer; the gyro's own noise is near 0.004."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What a run is worth, and why."""

    keep: bool
    reasons: tuple[str, ...]
    """Why to fly it again; empty where it is kept."""
    samples: int
    expected: int
    missing: int
    gaps: int
    """Stretches of missing samples."""
    use: Use
    """Peaks in percent of the limits."""
    coherent_hz: tuple[float, float] | None
    """Where a chirp's coherence is above `COHERENT`: lowest and highest frequency."""
    coherent_share: float | None
    """Part of the swept band where it is."""
    ends_early_s: float | None = None
    """By how much the last sample comes before the run's end, at least a few samples; None where that is not known."""
    notes: tuple[str, ...] = ()
    """What else to know of the samples, and what would make them better."""
    lost: str | None = None
    """Of the reasons the one that samples did not come, though the run was flown to its end."""
    told_for_s: float | None = None
    """The log stayed on the vehicle's card, and telemetry told `samples` attitudes in so many seconds: whether the run
    is worth keeping is not known before the log is read. None where the log came."""

    @property
    def on_card(self) -> bool:
        return self.told_for_s is not None

    @property
    def clean(self) -> bool:
        """Nothing speaks against the run, as far as is known."""
        return self.keep or (self.on_card and not self.reasons)

    @property
    def gaps_words(self) -> str:
        """`gaps 0`, only where there are samples between which they could be."""
        if self.samples < 2:
            return "no samples"
        at_end = f", {self.ends_early_s:.1f} s missing at the end" if (self.ends_early_s or 0.0) >= 0.05 else ""
        return f"gaps {self.gaps}{at_end}"

    @property
    def words(self) -> str:
        """In one line: `keep   coherence 0.5-9.6 Hz   gaps 0`."""
        kept = ON_CARD if self.on_card else "keep"
        return "   ".join([kept if self.clean else "fly again: " + "; ".join(self.reasons), *self.figures])

    @property
    def figures(self) -> tuple[str, ...]:
        """`coherence 0.5-9.6 Hz`, `gaps 0`, `44 % of the limits`: as far as there are any."""
        parts = []
        if self.told_for_s is not None:
            parts.append(f"{self.samples:,} attitudes in {self.told_for_s:.0f} s")
            return (*parts, f"{self.use.largest:.0f} % of the limits")
        if self.coherent_hz is not None:
            parts.append(f"coherence {self.coherent_hz[0]:.1f}-{self.coherent_hz[1]:.1f} Hz")
        if NO_SAMPLES not in self.reasons:
            parts.append(self.gaps_words)
        return (*parts, f"{self.use.largest:.0f} % of the limits", *self.notes)

    def to_json(self) -> dict[str, Any]:
        return {
            "keep": None if self.on_card and not self.reasons else self.keep,
            "log": "card" if self.on_card else "stream",
            "reasons": list(self.reasons),
            "lost": self.lost,
            "samples": self.samples,
            "expected": self.expected,
            "missing": self.missing,
            "gaps": self.gaps,
            "ends_early_s": None if self.ends_early_s is None else round(self.ends_early_s, 3),
            "percent_of_limits": self.use.to_json(),
            "coherent_hz": None if self.coherent_hz is None else [round(f, 2) for f in self.coherent_hz],
            "coherent_share": None if self.coherent_share is None else round(self.coherent_share, 3),
            "notes": list(self.notes),
        }


def judge(
    plan: Plan,
    limits: Limits,
    peaks: Peaks,
    samples: Mapping[str, FloatArray],
    rate_hz: float | None,
    *,
    interruption: str | None = None,
    start_s: float | None = None,
) -> Verdict:
    """The verdict on one run.

    `samples` has arrays of shape (n,) under t, p, q, delta_x, delta_y, excitation_x, excitation_y, cut to the maneuver,
    and under delta_e, excitation_e where they are known;
    `rate_hz` is that of the vehicle's loop, None where it is not known; a log that is evenly slower is judged by what
    the maneuver needs; `interruption` says why the run ended early.
    `start_s` is the log's time of the maneuver's begin: with it a log that ends before the run did is told from gaps.
    """
    came = _arrival(samples["t"], rate_hz, plan.maneuver.duration_s, start_s)
    peak_use = use(limits, peaks)
    if interruption is None:
        lost = _lost(came, plan.maneuver)
        band, part, unlike = _excited(plan, samples, came)
    else:
        lost, band, part, unlike = interruption, None, None, []
    beyond = f"{peak_use.largest:.0f} % of the limits" if peak_use.largest > 100 else None
    reasons = (*(reason for reason in (lost, beyond) if reason is not None), *unlike)
    return Verdict(
        keep=not reasons,
        reasons=reasons,
        samples=came.samples,
        expected=came.expected,
        missing=came.missing,
        gaps=came.gaps,
        use=peak_use,
        coherent_hz=band,
        coherent_share=part,
        ends_early_s=came.ends_early_s if interruption is None else None,
        lost=lost if interruption is None else None,
        notes=_notes(came, rate_hz),
    )


def judge_by_telemetry(
    limits: Limits, peaks: Peaks, attitudes: int, told_for_s: float, *, interruption: str | None = None
) -> Verdict:
    """What telemetry alone says of a run whose log is on the vehicle's card: nothing for it, only what is against it.

    `attitudes` came in `told_for_s` seconds; of the samples nothing is known.
    """
    peak_use = use(limits, peaks)
    beyond = f"{peak_use.largest:.0f} % of the limits" if peak_use.largest > 100 else None
    return Verdict(
        keep=False,
        reasons=tuple(reason for reason in (interruption, beyond) if reason is not None),
        samples=attitudes,
        expected=0,
        missing=0,
        gaps=0,
        use=peak_use,
        coherent_hz=None,
        coherent_share=None,
        told_for_s=told_for_s,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Arrival:
    """What came of the samples that a maneuver should have."""

    samples: int
    expected: int
    """0 where the log's rate is not known."""
    rate_hz: float
    """Of the log: as given, by the samples where they come evenly at less; 0 where neither tells."""
    gaps: int
    widest_gap: float
    """Samples missing in it."""
    ends_early_s: float | None

    @property
    def missing(self) -> int:
        return max(0, self.expected - self.samples)


def _notes(came: _Arrival, loop_hz: float | None) -> tuple[str, ...]:
    """How the log is slower than the loop, and what to do where samples are missing though the link lost none."""
    notes = []
    if loop_hz and 0 < came.rate_hz < loop_hz:
        notes.append(f"{slower_than_loop(came.rate_hz, loop_hz)}; {LOG_EVERY_LOOP}")
    if came.gaps and came.missing > FEW_MISSING * came.expected:
        notes.append(
            "where no block of the log is missing, the vehicle dropped them before it sent them: "
            f"{LARGER_BUFFER}, or take the vehicle's own file from its card"
        )
    return tuple(notes)


def _log_rate(spacing: FloatArray, loop_hz: float | None) -> float | None:
    """The rate that a log has: the loop's, or its own where it is evenly slower; None where neither is known."""
    if not spacing.size:
        return loop_hz
    median = float(np.median(spacing))
    even = float(np.mean(np.abs(spacing - median) < EVEN * median)) > MOST_EVEN
    return 1 / median if loop_hz is None or (even and 1 / median < SLOWER * loop_hz) else loop_hz


def _arrival(t: FloatArray, rate_hz: float | None, duration_s: float, start_s: float | None) -> _Arrival:
    spacing = float(np.median(np.diff(t))) if t.size > 2 else None
    rate_hz = _log_rate(np.diff(t) if t.size > 2 else np.empty(0), rate_hz)
    gaps, widest_gap = _gaps(t, spacing)
    return _Arrival(
        samples=int(t.size),
        expected=round(duration_s * rate_hz) if rate_hz else 0,
        rate_hz=rate_hz or 0.0,
        gaps=gaps,
        widest_gap=widest_gap,
        ends_early_s=_ends_early(t, spacing, start_s, duration_s),
    )


def _lost(came: _Arrival, maneuver: Maneuver) -> str | None:
    """Why too few samples came, None where enough did."""
    if not came.expected or came.samples < 3:
        return NO_SAMPLES
    needed_hz = SAMPLES_OF_A_PERIOD * maneuver.f_stop_hz if maneuver.kind == "chirp" else SLOWEST_HZ
    if came.rate_hz < max(needed_hz, SLOWEST_HZ) * SLOWER:
        return f"logged at {came.rate_hz:.0f} Hz, too slow: at least {needed_hz:.0f} Hz are needed; {LOG_EVERY_LOOP}"
    few = f"{came.missing} of {came.expected} samples are missing"
    early_s = came.ends_early_s
    if early_s is not None and early_s > min(FEW_AT_END_S, FEW_MISSING * maneuver.duration_s):
        return f"the log ends {early_s:.1f} s before the run did" + (f" ({few})" if came.missing else "")
    if came.missing > FEW_MISSING * came.expected:
        return few
    if came.gaps and came.widest_gap > max(3.0, 0.25 / maneuver.f_stop_hz * came.rate_hz):
        return f"{came.gaps} gaps"
    return None


def _excited(
    plan: Plan, samples: Mapping[str, FloatArray], came: _Arrival
) -> tuple[tuple[float, float] | None, float | None, list[str]]:
    """A chirp's coherent band and its share, and why the vehicle was not excited as planned."""
    if came.samples < 3 or not came.rate_hz:
        return None, None, []
    if plan.maneuver.kind == "doublet" and plan.maneuver.axis in COMMANDS:
        return None, None, _unanswered(plan, samples)
    if plan.maneuver.kind != "chirp" or plan.maneuver.axis not in COMMANDS:
        return None, None, []  # of yaw the live log tells neither command nor rate
    band, part = coherent_band(plan, samples, came.rate_hz)
    if part >= ENOUGH_BAND:
        return band, part, []
    return band, part, [f"the rates follow the excitation in only {100 * part:.0f} % of the band"]


def _ends_early(t: FloatArray, spacing: float | None, start_s: float | None, duration_s: float) -> float | None:
    """Time without samples before the run's end; up to three samples more or less are none."""
    if spacing is None or start_s is None:
        return None
    early_s = start_s + duration_s - spacing - float(t[-1])
    return early_s if early_s > 3 * spacing else 0.0


def _gaps(t: FloatArray, spacing: float | None) -> tuple[int, float]:
    """Stretches with samples missing, and the samples missing in the longest."""
    if spacing is None:
        return 0, 0.0
    steps = np.diff(t)
    wide = steps[steps > 1.8 * spacing]
    return int(wide.size), float(wide.max() / spacing - 1) if wide.size else 0.0


def _input(plan: Plan, samples: Mapping[str, FloatArray]) -> FloatArray:
    """What was put in on the excited axis: the excitation where it is logged, else the command."""
    letter = COMMANDS[plan.maneuver.axis]
    unknown = np.full(samples["t"].shape, np.nan)
    excitation = samples.get("excitation_" + letter, unknown)
    known = np.isfinite(excitation)
    if known.mean() > 0.99 and np.any(excitation[known]):
        return np.where(known, excitation, 0.0)
    return np.nan_to_num(samples.get("delta_" + letter, unknown))


def coherent_band(
    plan: Plan, samples: Mapping[str, FloatArray], rate_hz: float
) -> tuple[tuple[float, float] | None, float]:
    """Where either rate follows the excitation: lowest and highest frequency in Hz, and the part of the swept band.

    Ordinary coherence of one input, the larger of p and q at each frequency: a swashplate that is turned answers on the
    other axis.
    """
    put_in = _input(plan, samples)
    n = int(min(SEGMENT_S * rate_hz, put_in.size / 4))
    if n < 16:
        return None, 0.0
    low, high = plan.maneuver.f_start_hz, plan.maneuver.f_stop_hz
    frequency = np.fft.rfftfreq(n, 1 / rate_hz)
    swept = (frequency >= low) & (frequency <= high)
    best = np.maximum(coherence(put_in, samples["p"], n), coherence(put_in, samples["q"], n))
    good = swept & (best >= COHERENT)
    if not good.any():
        return None, 0.0
    inside = frequency[good]
    return (float(inside[0]), float(inside[-1])), float(good.sum() / swept.sum())


def _unanswered(plan: Plan, samples: Mapping[str, FloatArray]) -> list[str]:
    reasons = []
    if plan.maneuver.target == "command":
        put_in = _input(plan, samples)
        reach = 0.5 * float(put_in.max() - put_in.min())
        if reach < 0.5 * plan.maneuver.amplitude:
            reasons.append(
                f"the command moved by {reach:.3f}, not by {plan.maneuver.amplitude:g}: no doublet was flown"
            )
    spread = float(max(samples["p"].std(), samples["q"].std()))
    if spread < RATE_SPREAD:
        reasons.append(f"the rates did not answer (they vary by {spread:.4f} rad/s)")
    return reasons


def cut(window: LiveWindow, start_s: float, stop_s: float) -> dict[str, FloatArray]:
    """The samples with start_s <= t <= stop_s of the log's time, as `judge` wants them."""
    keep = (window.t >= start_s) & (window.t <= stop_s)
    names = ("t", "p", "q", "delta_x", "delta_y", "delta_e", "excitation_x", "excitation_y", "excitation_e")
    known = {name: getattr(window, name) for name in names}
    return {name: values[keep] for name, values in known.items() if values is not None}
