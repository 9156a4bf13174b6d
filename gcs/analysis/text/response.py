"""Measured responses for people, in 78 columns, and as the `tippath.response/1` document."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gcs.analysis.text.blocks import wrapped
from gcs.analysis.text.findings import listed_runs
from sysid.data.record import CHANNELS
from sysid.fit.result import finite
from sysid.model.structure import FloatArray
from sysid.response.flown import FlownResponses, Kept, Why
from sysid.response.values import LEAST_COHERENCE, PROBABILITY

FORMAT = "tippath.response/1"
ROWS = 8
"""Frequencies that the table shows of each response."""


def response_text(found: FlownResponses) -> str:
    """Where each response can be trusted, and what it is there."""
    low, high = found.band_hz
    runs = listed_runs([record.id for record in found.records])
    lines = wrapped(f"measured responses, {runs}, {low:g}-{high:g} Hz", rest="  ")
    lines += [line for text in kept_words(found) for line in wrapped(f"  {text}", rest="    ")]
    for pair in found.pairs:
        lines += ["", *_pair_lines(found, *pair)]
    return "\n".join([*lines, *_footing(found)])


def kept_words(found: FlownResponses) -> list[str]:
    """For what keeps gusts out a sentence, with the commands that it is said of."""
    words = {
        Kept.LOGGED: "against the logged excitation: feedback does not bias it",
        Kept.REBUILT: "against an excitation rebuilt from its settings: feedback does not bias it",
        Kept.NOTHING: "against the command itself: with feedback on, gusts bias it towards minus one over the "
        "controller; log the excitation",
    }
    commands = found.responses.commands
    each = {kept: [name for name in commands if found.kept(name) is kept] for kept in Kept}
    return [f"{', '.join(names)}: {words[kept]}" for kept, names in each.items() if names]


def _pair_lines(found: FlownResponses, output: str, command: str) -> list[str]:
    measured = found.responses
    unit = CHANNELS[output]
    why = found.why_not(output, command)
    if why is not None:
        return wrapped(f"{output} per {command}: {why_words(found, output, command)}", rest="  ")
    k, m = measured.outputs.index(output), measured.commands.index(command)
    good = np.flatnonzero(measured.valid(output, command))
    low, high = measured.frequency_hz[good[0]], measured.frequency_hz[good[-1]]
    lines = [
        f"{output} per {command}, {unit} per full command: {low:.2g}-{high:.2g} Hz",
        "      Hz        dB     ±        deg     ±    coherence   window, Hz",
    ]
    shown = good[np.unique(np.round(np.linspace(0, good.size - 1, ROWS)).astype(int))]
    return lines + [_row(found, k, m, int(at)) for at in shown]


def _row(found: FlownResponses, k: int, m: int, at: int) -> str:
    measured = found.responses
    return (
        f"  {measured.frequency_hz[at]:6.2f}  {measured.decibels[k, m, at]:8.1f} {measured.bound_db[k, m, at]:5.2f}"
        f"  {measured.degrees[k, m, at]:9.0f} {measured.bound_deg[k, m, at]:5.1f}"
        f"  {measured.partial_coherence[k, m, at]:9.2f}       ± {measured.half_width_hz[k, m, at]:.2f}"
    )


def why_words(found: FlownResponses, output: str, command: str) -> str:
    """Why a pair has no response, and what to do."""
    if found.why_not(output, command) is Why.FAINT:
        return f"no answer above noise: nowhere a coherence of {LEAST_COHERENCE:g}"
    others = [name for name in found.responses.commands if name != command]
    axes = found.not_swept
    if not others:
        return "too few samples for a response: fly longer sweeps"
    do = f"sweep {' and '.join(axes)} too" if axes else "sweep each axis for itself, one run each"
    return (
        f"{command} moves only together with {', '.join(others)} in these runs, so nobody can tell which did what: "
        f"{do}. --inputs {command} shows it as flown, the other loops closed"
    )


def _footing(found: FlownResponses) -> list[str]:
    if not any(found.why_not(*pair) is None for pair in found.pairs):
        return []
    note = (
        f"±: {100 * PROBABILITY:.0f} % bounds, chance and the windows' blur. Shown where the coherence with what the "
        f"other commands explain taken away is {LEAST_COHERENCE:g} or more; -o FILE writes every frequency"
    )
    return ["", *wrapped(note, rest="  ")]


# ------------------------------------------------------------------------------------------------ document


def response_document(found: FlownResponses, warnings: Sequence[str] = ()) -> dict[str, Any]:
    """The `tippath.response/1` document: what is no number is null."""
    measured = found.responses
    return {
        "format": FORMAT,
        "band_hz": list(found.band_hz),
        "inputs": list(measured.commands),
        "outputs": list(measured.outputs),
        "frequency_hz": numbers(measured.frequency_hz),
        "references": dict(zip(measured.commands, measured.references, strict=True)),
        "feedback_kept_out_by": {name: found.kept(name).value for name in measured.commands},
        "bounds_percent": 100 * PROBABILITY,
        "responses": [pair_document(found, *pair) for pair in found.pairs],
        "multiple_coherence": dict(zip(measured.outputs, map(numbers, measured.multiple_coherence), strict=True)),
        "runs": [
            {"id": one.id, "path": one.path, "maneuver": one.maneuver, "axis": one.axis, "duration_s": one.duration_s}
            for one in found.records
        ],
        "remarks": list(found.remarks),
        "warnings": list(warnings),
    }


def pair_document(found: FlownResponses, output: str, command: str) -> dict[str, Any]:
    """One response at every frequency; `valid_hz` is where it can be trusted."""
    measured = found.responses
    at = measured.outputs.index(output), measured.commands.index(command)
    valid = measured.valid_hz(output, command)
    why = found.why_not(output, command)
    return {
        "output": output,
        "input": command,
        "unit": CHANNELS[output],
        "valid_hz": None if valid is None else list(valid),
        "reason": None if why is None else why_words(found, output, command),
        "db": numbers(measured.decibels[at]),
        "deg": numbers(measured.degrees[at]),
        "real": numbers(measured.H[at].real),
        "imaginary": numbers(measured.H[at].imag),
        "coherence": numbers(measured.partial_coherence[at]),
        "bound_db": numbers(measured.bound_db[at]),
        "bound_deg": numbers(measured.bound_deg[at]),
        "window_hz": numbers(measured.half_width_hz[at]),
        "valid": measured.valid(output, command).tolist(),
    }


def numbers(values: FloatArray) -> list[float | None]:
    """(n,) as JSON has them."""
    return [finite(float(x)) for x in values]
