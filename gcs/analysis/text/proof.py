"""Flown against predicted, in words and as a document."""

from __future__ import annotations

import math
from typing import Any

from gcs.analysis.proof import FlownProof
from gcs.analysis.text.blocks import wrapped
from sysid.control.proof import Evidence, FlownRun, Quantity, Verdict

FORMAT = "tippath.proof/1"
AXES = ("roll", "pitch")
NAMES: dict[Quantity, tuple[str, str, float, int]] = {
    "nrmse_percent": ("NRMSE", "%", 1.0, 0),
    "rise_ms": ("rise to 90 %", "ms", 1.0, 0),
    "delay_ms": ("delay to 50 %", "ms", 1.0, 0),
    "overshoot": ("overshoot", "%", 100.0, 0),
    "coupling": ("other axis", "%", 100.0, 0),
}
"""Name, unit, its size, digits."""
VERDICTS: dict[Verdict, str] = {
    "accepted": "accepted: it flies as predicted",
    "not accepted": "NOT ACCEPTED: it does not fly as predicted",
    "too few to say": "too few to say: fly the card again",
}


def proof_text(found: FlownProof) -> str:
    """78 columns."""
    proof = found.proof
    counts = [sum(run.axis == axis for run in proof.runs) for axis in (0, 1)]
    by = f"{found.model}{', completed by its diagnosis' if found.completed else ''}"
    lines = [
        *wrapped(f"{VERDICTS[proof.verdict]}; {counts[0]} roll and {counts[1]} pitch runs, predicted by {by}"),
        "                        predicted     flown        mean of 95 in 100   may be",
        *(_row(one) for one in proof.evidence),
    ]
    lines += wrapped("Rise, delay, overshoot and other axis are those of a step of the rate, as each run shows it.")
    for name, why in found.left_out:
        lines += wrapped(f"left out: {name}: {why}")
    lines += _next(found)
    return "\n".join(lines)


def _row(one: Evidence) -> str:
    name, unit, size, digits = NAMES[one.quantity]

    def number(value: float | None) -> str:
        return "never" if value is None else f"{size * value:.{digits}f}"

    known = [value for value in one.measured if value is not None]
    flown = number(sum(known) / len(known) if len(known) == len(one.measured) and known else None)
    of_mean = one.quantity == "nrmse_percent"
    base = 0.0 if of_mean else one.predicted or 0.0
    bounds = "-" if one.bounds is None else " to ".join(number(base + edge) for edge in one.bounds)
    may_be = f"from {one.allowed[0]:.0f}" if of_mean else " to ".join(number(base + edge) for edge in one.allowed)
    predicted = "" if of_mean else number(one.predicted)
    mark = {"accepted": "", "not accepted": "  NO", "too few to say": "  ?"}[one.verdict]
    head = f"  {AXES[one.axis]:6}{name:14}"
    return f"{head}{predicted:>7}{'' if of_mean else ' ' + unit:4}{flown:>7} {unit:3}{bounds:>16}{may_be:>16}{mark}"


def _next(found: FlownProof) -> list[str]:
    """What to do."""
    proof = found.proof
    if proof.verdict == "accepted":
        return []
    if proof.verdict == "too few to say":
        most = max(2, 2 * math.ceil(len(proof.runs) / 2))
        lacking = [AXES[axis] for axis in (0, 1) if not any(run.axis == axis for run in proof.runs)]
        why = f"{' and '.join(lacking)} was not flown" if lacking else "the runs spread too much for their number"
        return wrapped(f"{why}: fly the card `proof` again (more than {most} runs in all), and name all flights.")
    wrong = [f"{AXES[one.axis]} {NAMES[one.quantity][0]}" for one in proof.evidence if one.verdict == "not accepted"]
    return wrapped(
        f"What differs ({', '.join(wrong)}) the model lacks, or the vehicle has changed: `tippath diagnose FIT.json "
        "FLIGHT` asks which effect explains these flights, `tippath revert` goes back meanwhile."
    )


def proof_document(found: FlownProof) -> dict[str, Any]:
    """The `tippath.proof/1` document."""
    proof = found.proof
    return {
        "format": FORMAT,
        "verdict": proof.verdict,
        "model": found.model,
        "completed": found.completed,
        "evidence": [_evidence(one) for one in proof.evidence],
        "runs": [_run(run) for run in proof.runs],
        "left_out": [{"run": name, "why": why} for name, why in found.left_out],
        "ask": None if proof.verdict != "not accepted" else "diagnose",
    }


def _evidence(one: Evidence) -> dict[str, Any]:
    return {
        "axis": AXES[one.axis],
        "quantity": one.quantity,
        "predicted": None if one.quantity == "nrmse_percent" else one.predicted,
        "flown": list(one.measured),
        "difference": None if one.quantity == "nrmse_percent" else one.difference,
        "bounds": None if one.bounds is None else list(one.bounds),
        "allowed": list(one.allowed),
        "verdict": one.verdict,
    }


def _run(run: FlownRun) -> dict[str, Any]:
    own, other = run.nrmse_percent
    return {"id": run.id, "axis": AXES[run.axis], "nrmse_percent": own, "nrmse_percent_other_axis": other}
