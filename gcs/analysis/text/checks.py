"""What the checks of a fit found, in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, assert_never

from sysid.fit.check_kinds import (
    CommandsLate,
    CommandsThinned,
    FewChirps,
    InsideSweep,
    LowEdgeHolds,
    LowEdgeMoves,
    ModesDiffer,
    NoModes,
    NothingFree,
    OutsideSweep,
    ParametersMoved,
    RotorAbove,
    RotorUnknown,
    SetRefused,
    SetsDiffer,
    SweepUnknown,
)
from sysid.fit.checks import PAPER_DAMPING_CHANGE_PERCENT, PAPER_FREQUENCY_CHANGE_PERCENT, Check


def checks_document(checks: Sequence[Check]) -> list[dict[str, Any]]:
    """`name`, `passed`, `text` of each."""
    return [{"name": check.name, "passed": check.passed, "text": check_text(check)} for check in checks]


def check_text(check: Check) -> str:
    """What a check found."""
    match check.finding:
        case SweepUnknown():
            return "swept band not known: none of the runs is a chirp with its settings"
        case OutsideSweep(frequencies_hz, (low, high)):
            outside = ", ".join(f"{frequency_hz:.2f} Hz" for frequency_hz in frequencies_hz)
            return f"{outside} outside the swept {low:g}-{high:g} Hz: extrapolated, sweep there too"
        case InsideSweep((low, high)):
            return f"every mode inside the swept {low:g}-{high:g} Hz"
        case RotorUnknown():
            return "rotor speed not logged: compare the modes with it by hand"
        case RotorAbove(rotor_hz, times):
            return _rotor_text(rotor_hz, times, check.passed)
        case FewChirps():
            return "needs two chirps on each axis: fly each twice"
        case SetRefused(refusal):
            return f"a set of runs alone does not identify the model: {refusal}"
        case ModesDiffer():
            return "the sets of runs do not even agree on which modes oscillate"
        case SetsDiffer(sets, frequency, damping):
            paper = f"paper {PAPER_FREQUENCY_CHANGE_PERCENT} and {PAPER_DAMPING_CHANGE_PERCENT} %"
            differ = f"differ by {frequency:.1f} % in natural frequency, {damping:.1f} % in damping"
            return f"{sets} sets of runs {differ} ({paper})"
        case NoModes():
            return "the model only integrates"
        case NothingFree():
            return "no parameter is free in every set of runs"
        case ParametersMoved(moved, of, limit, largest):
            each = ", ".join(f"{name} {times:.1f} σ" for name, times in largest)
            missing = f": something is missing ({each})" if moved else f" (at most {each})"
            return f"{moved} of {of} parameters moved more than {limit:g} σ between runs{missing}"
        case CommandsThinned() | CommandsLate():
            return early_text(check.finding)
        case LowEdgeHolds(_, to_hz):
            return f"no parameter moves when the band begins at up to {to_hz:g} Hz"
        case LowEdgeMoves() as moves:
            return _moves_text(moves)
    assert_never(check.finding)


def early_text(found: CommandsThinned | CommandsLate) -> str:
    """That commands act before their time stamps, and what to do."""
    early = f"{1000 * found.early_s:.1f} ± {1000 * found.error_s:.1f} ms"
    if isinstance(found, CommandsThinned):
        return (
            f"commands act {early} before their time stamps, as those of a faster loop do in a log of "
            f"{1 / found.sample_s:.0f} Hz: lags come out short by that; say the loop's rate with --loop-rate, or "
            "loop_rate_hz in a profile"
        )
    return (
        f"commands are stamped {early} late, or rates as much early: two clocks differ, or a filter is in the log "
        "that the vehicle does not have; commands_late_s in a profile's [time] sets it right"
    )


MOST_MOVES = 3


def _moves_text(finding: LowEdgeMoves) -> str:
    shown = ", ".join(
        f"{one.name} from {one.value:.3g} to {one.other:.3g} {one.unit}".rstrip(" -")
        for one in finding.moves[:MOST_MOVES]
    )
    others = len(finding.moves) - MOST_MOVES
    more = f", and {others} more" if others > 0 else ""
    where = f"when the band begins at up to {finding.to_hz:g} Hz instead of {finding.low_hz:g}"
    if finding.instrumented:
        return f"{shown}{more} {where}: something is missing at low frequencies"
    return f"{shown}{more} {where}: feedback biases the fit; log the excitation, or raise the band's low edge"


def _rotor_text(rotor_hz: float, times: float, passed: bool | None) -> str:
    if math.isinf(times):
        return f"rotor {rotor_hz:.1f} Hz, and the model only integrates"
    close = ": averaging over a revolution does not hold" if passed is False else ""
    return f"rotor {rotor_hz:.1f} Hz, {times:.1f} times the highest mode{close}"
