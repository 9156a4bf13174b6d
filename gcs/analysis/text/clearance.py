"""What gains are worth, in words: on the fit, on all that its diagnosis leaves open, and over its bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gcs.analysis.clearance import Clearance
from gcs.analysis.standing import Standing
from gcs.analysis.text.blocks import wrapped
from gcs.flight.gains import GainsError
from sysid.control.command_noise import CommandNoise
from sysid.control.judgement import Judgement, OnModel, Quantity, Shortfall, Verdict
from sysid.control.measured_margins import MeasuredMargins
from sysid.control.observers import KALMAN, WithObserver
from sysid.control.over_costs import AtCost

VERDICTS: dict[Verdict, str] = {
    "holds": "holds: every margin and answer is as asked",
    "poor": "poor: it holds, and does not fly as asked",
    "not measured": "NOT MEASURED: no measured margin stands where the model has one; do not fly it yet",
    "fails": "FAILS: do not fly it",
}
NAMES: dict[Quantity, tuple[str, str, float]] = {
    "held": ("", "", 1.0),
    "gain_db": ("gain margin", " dB", 1.0),
    "phase_deg": ("phase", "°", 1.0),
    "delay_ms": ("delay", " ms", 1.0),
    "overshoot": ("overshoot", " %", 100.0),
    "coupling": ("other axis", " %", 100.0),
    "peak_db": ("disturbances raised by", " dB", 1.0),
    "noise": ("commands moved by disturbances", " times the flown", 1.0),
    "servos": ("their speed", " times the servos'", 1.0),
}
"""Name, unit, and the unit's size."""


def clearance_text(found: Clearance) -> str:
    """To stand below a design, or before a push; 78 columns."""
    return "\n".join(
        line for name, words in clearance_told(found) for line in wrapped(f"  {name:14}{words}", rest=" " * 16)
    )


def costs_text(costs: Sequence[AtCost], asked: float) -> str:
    """A table of gains over input cost: margins are the least on any model, the answer is the fit's."""
    rows = [
        "K over input cost (margins: the least on any model above; answer: the fit's)",
        "    cost  K rates flapping gain dB phase ° delay ms overshoot coupling",
    ]
    for one in costs:
        fit, least = one.judgement.models[0], one.least
        mark = ">" if one.gains.input_cost == asked else " "
        if least is None or fit.overshoot is None or fit.coupling is None:
            worth = "   not held on every model"
        else:
            margins = (_or_any(least.gain_db, 1), _or_any(least.phase_deg, 0), _or_any(least.delay_ms, 0))
            answer = f"{100 * fit.overshoot:7.0f} %{100 * fit.coupling:7.0f} %"
            worth = f"{margins[0]:>8}{margins[1]:>8}{margins[2]:>9} {answer}"
        head = f"  {mark}{one.gains.input_cost:5g} {one.rate_gain:8.3f}{one.flapping_gain:9.2f}"
        rows.append(f"{head}{worth}  {one.judgement.verdict}")
    return "\n".join(rows)


def observers_text(observers: Sequence[WithObserver]) -> str:
    """A table of observers: noise of the commands and gusts are the fit's runs', margins the least on any model."""
    rows = [
        "observers, K as designed (noise: of commands x / y; gusts: what the loop",
        "leaves of what they do to p / q; margins: the least on any model above)",
        "               gain dB  phase °  delay ms        noise %    gusts %",
    ]
    for one in observers:
        least = one.least
        worth = "   not held on every model"
        if least is not None:
            margins = (_or_any(least.gain_db, 1), _or_any(least.phase_deg, 0), _or_any(least.delay_ms, 0))
            worth = f"{margins[0]:>9}{margins[1]:>9}{margins[2]:>10}"
        stirred = "not known" if one.noise is None else " / ".join(f"{100 * value:.2f}" for value in one.noise[:2])
        left = "" if one.gusts_left is None else " / ".join(f"{100 * value:.0f}" for value in one.gusts_left)
        rows.append(f"  {one.name:11}{worth:28} {stirred:>14} {left:>10}  {one.judgement.verdict}")
    poles = {one.name: one.gains.observer_poles for one in observers}.get(KALMAN)
    if poles is not None:
        shown = ", ".join(
            f"{pole.real:.1f}" + (f" ± {pole.imag:.1f}j" if pole.imag > 0 else "")
            for pole in sorted(poles, key=lambda pole: -pole.real)
            if pole.imag >= 0
        )
        rows += wrapped(f"  {KALMAN}: poles {shown} 1/s, for gusts and gyro noise of the fit's runs", rest=" " * 4)
    return "\n".join(rows)


def _or_any(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "any"


def require_cleared(found: Clearance, why: str | None) -> None:
    """Raises GainsError, reason `margins` or `not measured`, for gains that fail, or whose margins were to be measured
    and are not, and of which nobody says why they are pushed."""
    judgement = found.judgement
    if not judgement.refused or (why or "").strip():
        return
    if judgement.verdict == "not measured" and judgement.measured is not None:
        raise GainsError(
            f"these gains are not cleared: not measured: {missing_words(judgement.measured)}; nothing was sent. Sweep "
            "so far and design again, or say --why",
            reason="not measured",
        )
    if judgement.verdict == "fails":
        broken = "; ".join(_broken(judgement, only_failing=True))
        raise GainsError(
            f"these gains are not cleared: {broken}; nothing was sent. Design others (a higher --input-cost leaves "
            "more), or say --why",
            reason="margins",
        )


def missing_words(measured: MeasuredMargins) -> str:
    """Which margins the measured band does not show, and how far to sweep."""
    names = " and ".join(NAMES[name][0] for name in NAMES if name in measured.missing)
    if measured.band_hz is None:
        return f"{names}: fly longer sweeps of both axes"
    each = [("to", measured.sweep_to_hz), ("from", measured.sweep_from_hz)]
    return f"{names}: sweep " + " and ".join(f"{way} {hz:g} Hz" for way, hz in each if hz is not None)


def standing_words(standing: Standing) -> str:
    """What is known of what the fit lacks."""
    sure = "" if standing.confidence is None else f", confidence {standing.confidence:.2f}"
    if standing.state == "complete":
        return f"complete{sure}"
    if standing.state == "missing":
        lost = standing.not_modelled
        beside = f"; no model was made of {', '.join(lost)}, as likely: not judged with it" if lost else ""
        return f"lacks {' + '.join(standing.effects)}{sure}{beside}"
    if standing.state == "unexplained":
        return f"incomplete{sure}: something is missing that nothing explains, and the vehicle's margins are others"
    return "NOT DIAGNOSED: what the fit lacks is not known, and margins are the fit's own; `tippath diagnose` asks"


def clearance_told(found: Clearance) -> list[tuple[str, str]]:
    """The same, unbroken: what each sentence is about, and the sentence."""
    judgement = found.judgement
    broken = _broken(judgement, only_failing=judgement.verdict == "fails")
    if judgement.measured is not None and judgement.measured.missing:
        broken.append(f"not measured: {missing_words(judgement.measured)}")
    told = [("judged", VERDICTS[judgement.verdict] + (f"; {'; '.join(broken)}" if broken else ""))]
    told.append(("diagnosis", standing_words(found.standing)))
    told += [(_role(one), f"{one.model.structure.title}: {_worth(one)}") for one in judgement.models]
    told += _robust(judgement.models[0])
    if judgement.noise is not None:
        told.append(("commands", _moved_words(judgement.noise)))
    bounds = judgement.bounds
    if bounds is not None:
        least = "" if bounds.least is None else f", 95 % of them with at least {bounds.least.words}"
        lost = f"{bounds.not_held} NOT held" if bounds.not_held else "all held"
        told.append(("bounds", f"{bounds.samples} samples of the fit's errors: {lost}{least}"))
    return told


def _moved_words(noise: CommandNoise) -> str:
    """What gusts and gyro make of the commands."""
    roll, pitch = noise.own.rms
    fast = max(noise.own.rate_rms)
    words = f"gusts and gyro move them by {100 * roll:.2g} and {100 * pitch:.2g} % rms, {100 * fast:.2g} % a second"
    if noise.times_flown is not None:
        words += f", {noise.times_flown:.2f} times the flown at most"
    if noise.of_servo_speed is not None:
        words += f"; three of these are {100 * noise.of_servo_speed:.0f} % of the servos' speed"
    return words + f" ({noise.own.band_hz[0]:g} to {noise.own.band_hz[1]:.0f} Hz)"


def _role(one: OnModel) -> str:
    return {"fit": "on the fit", "missing": "completed", "not told apart": "or as well"}[one.role]


def _worth(one: OnModel) -> str:
    margins = one.loop.margins
    if margins is None or one.answers is None:
        return "NOT held"
    each = (
        f"{axis.axis} overshoots {100 * axis.overshoot:.0f} %, other axis {100 * axis.coupling:.0f} %"
        for axis in one.answers
    )
    return f"{margins.words}; {'; '.join(each)}"


def _robust(one: OnModel) -> list[tuple[str, str]]:
    """Disk margin and handling on the fit."""
    if one.robustness is None:
        return []
    disk, crossover = one.robustness.disk, one.robustness.crossover_hz
    crossing = "no crossover" if crossover is None else f"crossover {crossover:.1f} Hz"
    gain = f"{disk.gain_db:.1f} dB" if math.isfinite(disk.gain_db) else "any gain"
    told = [("disk margin", f"{gain} or {disk.phase_deg:.0f}° in both commands, each its own way, {crossing}")]
    for axis in one.robustness.handling:
        no_bandwidth = "no bandwidth up to 200 Hz"
        words = [no_bandwidth if axis.bandwidth_hz is None else f"bandwidth {axis.bandwidth_hz:.1f} Hz"]
        words += [] if axis.phase_delay_ms is None else [f"phase delay {axis.phase_delay_ms:.0f} ms"]
        rejected = "not rejected" if axis.rejection_hz is None else f"rejected to {axis.rejection_hz:.1f} Hz"
        peak = f"raised by {axis.rejection_peak_db:.1f} dB at {axis.rejection_peak_hz:.1f} Hz"
        told.append((axis.axis, f"{', '.join(words)}; disturbances {rejected}, {peak}"))
    return told


def _broken(judgement: Judgement, *, only_failing: bool = False) -> list[str]:
    """Each model with what it falls short of."""
    found = [(one.model.structure.title, one.shortfalls) for one in judgement.models]
    found += [("over its bounds", judgement.thin_bounds), ("measured", judgement.thin_measured)]
    found += [("on the fit", judgement.restless)]
    kept = [(name, [one for one in each if one.fails or not only_failing]) for name, each in found]
    return [f"{name}: {_short(each)}" for name, each in kept if each]


def _short(shortfalls: Sequence[Shortfall]) -> str:
    words = []
    for one in shortfalls:
        name, unit, size = NAMES[one.quantity]
        if one.value is None or one.limit is None:
            words.append("not held")
        else:
            digits = 1 if one.quantity in ("gain_db", "peak_db", "noise", "servos") else 0
            words.append(f"{name} {size * one.value:.{digits}f}{unit} (asked {size * one.limit:g})")
    return ", ".join(words)
