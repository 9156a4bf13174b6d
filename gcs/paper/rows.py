"""From fits and runs to rows and lines beside the printed numbers: pure functions of values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs.analysis.fits import PAPER_PARAMETERS
from gcs.paper.values import Line, Panel, PaperFigure, Row
from sysid.compare.compare import compare
from sysid.compare.on_runs import CompareError
from sysid.data.dataset import Dataset, prepared
from sysid.data.record import CHANNELS, Record
from sysid.fit.result import Fit
from sysid.fit.simulate import overlay
from sysid.model.paper import CD, TPP
from sysid.model.structure import FloatArray, Model

EVERY_S = 0.02
"""Between two points of a drawn line: five to a period of 10 Hz."""

PRINTED = {
    "TPP": Model(TPP, np.array(PAPER_PARAMETERS["tpp"])),
    "CD": Model(CD, np.array(PAPER_PARAMETERS["cd"])),
}
"""Table 4."""

Modes = Sequence[tuple[float, float]]
Beside = Mapping[str, Model]


def mode_rows(label: str, model: Model, printed: Modes, beside: Beside) -> list[Row]:
    """Frequency and damping of each mode; `beside`: other models' in further columns."""
    rows = []
    for number, mode in enumerate(model.modes):
        of = [(mode.frequency_hz, "frequency, Hz"), (mode.damping_ratio, "damping ratio")]
        for which, (value, word) in enumerate(of):
            others = {name: _mode(one, number, which) for name, one in beside.items()}
            theirs = printed[number][which] if number < len(printed) else None
            name = f"{label} {2 * number + 1}-{2 * number + 2} {word}"
            rows.append(Row(name=name, printed=theirs, ours=value, beside=others))
    return rows


def _mode(model: Model, number: int, which: int) -> float | None:
    if number >= len(model.modes):
        return None
    mode = model.modes[number]
    return (mode.frequency_hz, mode.damping_ratio)[which]


def parameter_rows(label: str, fit: Fit, printed: Mapping[str, float], beside: Mapping[str, Fit]) -> list[Row]:
    """Values with standard errors; a fit `beside` gives its values, and how many of its standard errors the printed
    value is away from them."""
    rows = []
    for name in fit.model.structure.names:
        others: dict[str, float | None] = {}
        for word, other in beside.items():
            others[word] = other.model[name]
            others[f"{word}, off in SE"] = in_errors(other, name, printed[name])
        held = name in fit.fixed
        error = None if held else errors_of(fit)[name]
        rows.append(
            Row(name=f"{label} {name}", printed=printed[name], ours=fit.model[name], error=error, beside=others)
        )
    return rows


def errors_of(fit: Fit) -> dict[str, float]:
    """Standard errors by name."""
    return dict(zip(fit.model.structure.names, map(float, fit.standard_errors), strict=True))


def in_errors(fit: Fit, name: str, truth: float) -> float | None:
    """The fit's value less the truth, in its standard errors; None where it was held."""
    error = errors_of(fit)[name]
    return (fit.model[name] - truth) / error if error > 0 else None


def nrmse_rows(
    label: str, ours: Mapping[str, float], printed: Sequence[float], beside: Mapping[str, Mapping[str, float] | None]
) -> list[Row]:
    """NRMSE of p and q, percent."""
    return [
        Row(
            name=f"{label} {output}",
            printed=theirs,
            ours=ours[output],
            beside={name: None if one is None else one.get(output) for name, one in beside.items()},
            digits=1,
        )
        for output, theirs in zip(("p", "q"), printed, strict=True)
    ]


BACK = 4.0
"""Standard errors: what lies within came back, of two dozen numbers in one flight."""


def worst_of(fit: Fit, truth: Mapping[str, float]) -> tuple[str, float, str]:
    """The free parameter farthest from the truth, by how many standard errors, and whether all came back, in words."""
    off = {name: in_errors(fit, name, value) for name, value in truth.items()}
    free = {name: abs(value) for name, value in off.items() if value is not None}
    name = max(free, key=lambda one: free[one])
    return name, free[name], "come back" if free[name] <= BACK else "do not all come back"


def largest_change(ours: Mapping[str, float], other: Mapping[str, float]) -> tuple[str, float]:
    """The name whose value changes most from `ours` to `other`, and by how much of ours in percent."""
    changes = {name: 100 * abs(other[name] / value - 1) for name, value in ours.items() if value}
    name = max(changes, key=lambda one: changes[one])
    return name, changes[name]


def modes_of(model: Model) -> tuple[dict[str, float], dict[str, float]]:
    """Eigenfrequencies and damping ratios by the number of their pole pair."""
    names = [f"{2 * number + 1}-{2 * number + 2}" for number in range(len(model.modes))]
    pairs = list(zip(names, model.modes, strict=True))
    return {name: m.frequency_hz for name, m in pairs}, {name: m.damping_ratio for name, m in pairs}


def noise_floor(fit: Fit, runs: Dataset) -> dict[str, float]:
    """NRMSE of a model that leaves nothing but noise, percent by output; empty where the runs do not tell."""
    try:
        found = compare(fit.model, runs, fit.band_hz).noise_floor_percent
    except CompareError:
        return {}
    return {} if found is None else dict(found)


# ------------------------------------------------------------------------------------------------ figures


def run_figure(
    label: str, caption: str, records: Sequence[Record], models: Mapping[str, Model], band_hz: tuple[float, float]
) -> PaperFigure:
    """Runs one after the other: commands, then each rate measured and by each model, inside the band."""
    first = next(iter(models.values())).structure
    drawn: dict[str, list[tuple[str, FloatArray, FloatArray]]] = {}
    at = 0.0
    for record in records:
        start = float(record.t[0])
        for name in first.inputs:
            drawn.setdefault("command", []).append((name, record.t - start + at, record.channels[name]))
        for spectrum in prepared([record], band_hz).viewed(first.inputs, first.outputs).spectra:
            for number, (name, model) in enumerate(models.items()):
                t, measured, modelled = overlay(model, spectrum)
                for k, output in enumerate(first.outputs):
                    lines = drawn.setdefault(f"{output}, {CHANNELS[output]}", [])
                    if number == 0:
                        lines.append(("measured", t - start + at, measured[:, k]))
                    lines.append((name, t - start + at, modelled[:, k]))
        at += float(record.t[-1]) - start
    return PaperFigure(label=label, caption=caption, panels=tuple(panel(y, lines) for y, lines in drawn.items()))


def panel(y: str, lines: Sequence[tuple[str, FloatArray, FloatArray]]) -> Panel:
    """Lines of one name become one, in the order of time, thinned."""
    names = list(dict.fromkeys(name for name, _, _ in lines))
    return Panel(y=y, lines=tuple(_line(name, [one for one in lines if one[0] == name]) for name in names))


def _line(name: str, parts: Sequence[tuple[str, FloatArray, FloatArray]]) -> Line:
    x: list[float] = []
    values: list[float] = []
    for _, t, y in parts:
        step = max(1, round(EVERY_S / float(np.median(np.diff(t))))) if t.size > 1 else 1
        x += [round(float(one), 3) for one in t[::step]]
        values += [float(f"{one:.4g}") for one in y[::step]]
    return Line(label=name, x=tuple(x), y=tuple(values))
