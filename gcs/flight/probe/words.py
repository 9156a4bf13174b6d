"""What a probe found, in sentences, and its document."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from gcs.flight.probe.values import LATE_S, LETTERS, MEASURED, RATES, AxisAnswer, ProbeFinding, ProbeResult


def result_words(result: ProbeResult) -> tuple[str, ...]:
    """A few short lines: what is wrong first."""
    serious = [finding_words(finding) for finding in result.findings if finding.serious]
    rest = [finding_words(finding) for finding in result.findings if not finding.serious and finding.kind != "unseen"]
    rates = [f"{name} {result.noise[name]:.3f}" for name in MEASURED if name in result.noise]
    noise = [f"noise in hover: {', '.join(rates)} rad/s"] if rates else []
    return (*serious, *(answer_words(answer) for answer in result.answers), *noise, *rest)


def result_document(result: ProbeResult) -> dict[str, Any]:
    """A probe's part of a card's document."""
    return {
        "ok": result.ok,
        "wrong": result.wrong,
        "findings": [_finding_document(finding) for finding in result.findings],
        "answers": [_answer_document(answer) for answer in result.answers],
        "noise": {name: _rounded(value) for name, value in result.noise.items()},
        "rate_hz": _rounded(result.rate_hz),
        "turn_deg": _rounded(result.turn_deg),
        "words": list(result_words(result)),
    }


def finding_words(finding: ProbeFinding) -> str:
    """One thing that a probe found."""
    return _SENTENCES[finding.kind](finding, finding.numbers or {}, finding.names or {})


def answer_words(answer: AxisAnswer) -> str:
    """How a vehicle answered on one axis."""
    if answer.gain is None or answer.gain_error is None:
        return f"{answer.axis}: not seen above the noise ({answer.signal_to_noise:.1f} times its error)"
    parts = [f"{answer.axis}: {answer.rate} follows delta_{LETTERS[answer.axis]}"]
    if answer.delay_s is not None and answer.delay_error_s is not None:
        parts.append(f" after {1000 * answer.delay_s:.0f} ± {1000 * answer.delay_error_s:.0f} ms")
    parts.append(f", {answer.gain:.1f} ± {answer.gain_error:.1f} rad/s per full command")
    return "".join(parts)


def _finding_document(finding: ProbeFinding) -> dict[str, Any]:
    numbers = {key: _rounded(value) for key, value in (finding.numbers or {}).items()}
    words = finding_words(finding)
    return {"kind": finding.kind, "axis": finding.axis, "words": words, "serious": finding.serious, "numbers": numbers}


def _answer_document(answer: AxisAnswer) -> dict[str, Any]:
    keys = ("amplitude", "signal_to_noise", "gain", "gain_error", "delay_s", "delay_error_s", "peak_rate")
    numbers = {key: _rounded(getattr(answer, key)) for key in (*keys, "peak_attitude")}
    return {"axis": answer.axis, "seen": answer.seen, "rate": answer.rate, **numbers}


def _rounded(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(f"{value:.4g}")


# ------------------------------------------------------------------------------------------------ kind by kind

Numbers = Mapping[str, float]
Names = Mapping[str, str]


def _where(axis: str | None) -> str:
    return "in quiet hover" if axis is None else f"of the {axis} step"


def _no_samples(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    axis = finding.axis
    if finding.how == "rate":
        return f"{axis} is not in the log: nothing can be said of that axis"
    if finding.how == "command" and axis is not None:
        return f"delta_{LETTERS[axis]} is not in the log: nothing can be said of {axis}"
    missing = f"no samples {_where(axis)} came (less than a second of them)"
    return f"{missing}: nothing can be said; is the log running?"


def _slow_log(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    comes = f"the log comes at {numbers['rate_hz']:.0f} Hz"
    if finding.how == "than expected":
        return f"{comes}, not at {numbers['expected_hz']:.0f}"
    return f"{comes}: too slow for a sweep; set the vehicle to log in every loop"


def _gaps(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    lost = f"{100 * numbers['lost']:.1f} % lost, the longest {numbers['longest_s']:.2f} s"
    return f"{numbers['gaps']:.0f} gaps in the log {_where(finding.axis)}, {lost}"


def _frozen(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    return f"{finding.axis} stands still in the log: its gyro is frozen, or is not logged in every loop"


def _units(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    if finding.how == "gain":
        gain = f"{abs(numbers['gain']):.0f} rad/s per full command"
        return f"{names['axis']}: {gain} is beyond any vehicle; is {names['rate']} in deg/s?"
    varies = f"{finding.axis} varies by {numbers['deviation']:.2f} rad/s in quiet hover"
    return f"{varies}: is it in deg/s, or is the vehicle not quiet?"


def _noisy(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    deviation, usual = numbers["deviation"], numbers["usual"]
    times = f"{finding.axis} is {deviation / usual:.1f} times as noisy as usual"
    return f"{times}: {deviation:.3f} rad/s, not {usual:.3f}"


def _no_excitation(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    axis, asked, moved = str(finding.axis), f"±{numbers['asked']:g}", f"±{numbers['moved']:.4f}"
    if finding.how == "not added":
        return f"nothing like {asked} was added on {axis} (the log has {moved}): no step was flown"
    return f"delta_{LETTERS[axis]} did not move ({moved}) while {asked} was asked for on {axis}"


def _reversed(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    axis = str(finding.axis)
    rate, letter = RATES[axis], LETTERS[axis]
    if finding.how == "mixing":
        return f"{axis} is reversed: delta_{letter} moves against what is added to it; look at the mixing"
    where = {
        "gyro": f"the gyro is: {rate} moves against the attitude",
        "command": f"the command more likely than the gyro: {rate} goes with the attitude",
        "swapped": f"the gyro is: {rate} does not go with the attitude",
    }.get(finding.how, "command or gyro: the log does not tell which")
    return f"{axis} is reversed: positive delta_{letter} gives negative {rate}; {where}"


def _swapped(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    if finding.how == "mixing":
        shows = "what is added on roll shows on delta_y, and on pitch on delta_x"
        return f"{shows}: look at the mixing, or at the log's names"
    answers = ", ".join(f"{rate} answers {command}" for rate, command in names.items())
    blame = "the gyro's axes" if finding.how == "gyro" else "the command's or the gyro's axes"
    return f"roll and pitch are swapped: {answers}; look at {blame} (a swashplate's phase angle, the board's turn)"


def _turned(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    turned = f"commands and rates are turned by {numbers['turn_deg']:.0f} degrees"
    return f"{turned}: a swashplate's phase angle, or strong coupling"


def _late(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    sure = finding.serious
    late = f"{1000 * numbers['delay_s']:.0f} ± {1000 * numbers['error_s']:.0f} ms after the command"
    follows = f"{names['rate']} {'follows' if sure else 'seems to follow'} {late}, more than {1000 * LATE_S:.0f}"
    todo = "look for a slow servo or filter, or late stamps" if sure else "a larger step would tell"
    return f"{finding.axis}: {follows}: {todo}"


def _unseen(finding: ProbeFinding, numbers: Numbers, names: Names) -> str:
    return f"{finding.axis}: not seen above the noise; probe again in calm air or with a larger step"


_SENTENCES: Mapping[str, Callable[[ProbeFinding, Numbers, Names], str]] = {
    "no samples": _no_samples,
    "slow log": _slow_log,
    "gaps": _gaps,
    "frozen": _frozen,
    "units": _units,
    "noisy": _noisy,
    "no excitation": _no_excitation,
    "reversed": _reversed,
    "swapped": _swapped,
    "turned": _turned,
    "late": _late,
    "unseen": _unseen,
}
