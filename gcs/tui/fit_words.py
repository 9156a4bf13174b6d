"""What the Fit screen says: first what decides, of the model that is drawn; then the two bases beside the paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.cells import cell_len

from gcs.analysis.quantities import amount
from gcs.analysis.text.checks import check_text
from gcs.analysis.text.findings import listed_runs
from gcs.desk.state import Choice, DeskState, Nrmse, Rung
from gcs.tui.desk_words import Line, broken
from gcs.tui.next_step import full_name
from gcs.tui.state import State

if TYPE_CHECKING:
    from sysid.fit.checks import Check

MARKS = {True: "✓", False: "✗", None: "?"}
REDUCED = " CD reduced: the CD that this TPP becomes where flapping settles at once, not a fit of its own"


def fit_lines(state: State, width: int) -> list[Line]:
    """Warnings, because they say whether to read on; the top rung's figures; the tables of both bases."""
    desk, found = state.desk, state.fitted
    rung = desk.current
    if found is None and rung is None:
        runs = desk.chosen(Choice.FIT)
        chosen = [f"   {run.id} {run.axis or ''} {run.maneuver}" for run in runs]
        return broken(["", " nothing is fitted yet", *([" chosen to be fitted:", *chosen] if chosen else [])], width)
    lines: list[Line] = []
    if found is not None:
        lines += [(f" warning: {text}", "bold") for text in found.warnings]
    if rung is not None:
        lines += model_lines(desk, rung, width)
    if found is not None:
        lines += [
            "",
            (f" both bases on {listed_runs(found.runs)}", "bold"),
            f" checked on {listed_runs(found.validation)} (not used in the fit)"
            if found.validation
            else " checked on the same runs: none was left to check on",
            *(f" {line}" for line in found.tables.splitlines()),
            "",
            REDUCED,
        ]
        if found.commands:
            lines += ["", " the same in a shell:", *(f"   {command}" for command in found.commands)]
    return broken(lines, width)


def model_lines(desk: DeskState, rung: Rung, width: int) -> list[Line]:
    """What decides of the model that is drawn: how well it fits, its modes, their check, its parameters."""
    fit = rung.fit
    outputs = tuple(rung.nrmse_percent)
    lines: list[Line] = [(f" {full_name(desk) + ': NRMSE, %':<34}{''.join(f'{name:>8}' for name in outputs)}", "bold")]
    lines.append(_figures("   fitted", rung.nrmse_percent))
    if rung.validation_nrmse_percent is not None:
        lines.append(_figures("   on runs not used in the fit", rung.validation_nrmse_percent))
    floor = rung.noise_floor_percent or desk.noise_floor_percent
    if floor is not None:
        lines.append(_figures("   with noise alone", floor))
    modes = [f"{one.frequency_hz:.2f} Hz ζ {one.damping_ratio:.2f}" for one in fit.model.modes]
    lines.append(f"   modes  {' · '.join(dict.fromkeys(modes)) or 'none'}")
    checks = _checks(desk, rung)
    if checks is None:
        lines.append("   eigenfrequency check: not made of this model in this session")
    else:
        lines += [f"   {MARKS[one.passed]} {one.name}: {check_text(one)}" for one in checks]
    return [*lines, *_columns(_parameters(rung), width)]


def _figures(name: str, percent: Nrmse) -> str:
    return f"{name:<35}{''.join(f'{value:8.1f}' for value in percent.values())}"


def _checks(desk: DeskState, rung: Rung) -> Sequence[Check] | None:
    """The eigenfrequency check of a rung; None where it was not made of this one."""
    if rung.addition is not None:
        return rung.addition.checks
    found = desk.fitted
    return found.found.checks if found is not None and rung.fit is found.found.tpp else None


def _parameters(rung: Rung) -> list[str]:
    """`M_a = 741.3 ± 2.1 1/s²`, rounded by the error; what is to be said of a value behind it."""
    fit, said = rung.fit, []
    for one, value, error in zip(fit.model.structure.parameters, fit.model.values, fit.standard_errors, strict=True):
        mark = (
            " held" if one.name in fit.fixed
            else " at its bound" if one.name in fit.at_bound
            else " not determined" if one.name in fit.undetermined
            else " implausible" if one.name in fit.implausible
            else ""
        )  # fmt: skip
        spread = fit.model_errors.get(one.name)
        model = None if spread is None else spread.total
        said.append(f"{one.name} {amount(one, float(value), float(error), model)}{mark}")
    return said


def _columns(cells: Sequence[str], width: int) -> list[Line]:
    """As many side by side as the width takes."""
    wide = max((cell_len(one) for one in cells), default=0) + 3
    count = max((width - 3) // wide, 1)
    rows = [cells[i : i + count] for i in range(0, len(cells), count)]
    return ["   " + "".join(one + " " * (wide - cell_len(one)) for one in row).rstrip() for row in rows]
