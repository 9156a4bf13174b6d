"""Tables of fitted models: values as they may be quoted, with their errors; modes; how well each fits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gcs.analysis.fits import GUIDE_CRAMER_RAO, GUIDE_INSENSITIVITY
from gcs.analysis.ladder import Nrmse
from gcs.analysis.pages.parts import Table
from gcs.analysis.quantities import amount
from gcs.logs.words import printable
from sysid.fit.result import Fit
from sysid.model.parameter import Parameter

NOT_THERE = "–"


def fits_table(named: Sequence[tuple[str, Fit]], floor: Nrmse | None, said: Mapping[str, str]) -> Table:
    """How well each fits, beside the noise; `said` by name: what its diagnosis answered."""
    outputs = tuple(named[0][1].nrmse_percent)
    judging = outputs if any(fit.validation_nrmse_percent for _, fit in named) else ()
    rows = []
    for name, fit in named:
        judged = fit.validation_nrmse_percent or {}
        cells = [f"{fit.nrmse_percent[one]:.1f}" for one in outputs]
        cells += [f"{judged[one]:.1f}" if one in judged else NOT_THERE for one in judging]
        rows.append((printable(name), *cells, *([said.get(name, "")] if said else [])))
    if floor is not None:
        rows.append(
            ("noise alone", *(f"{floor[one]:.1f}" for one in outputs), *("" for _ in judging), *([""] if said else []))
        )
    head = ("model", *(f"{one} fitted" for one in outputs), *(f"{one} valid." for one in judging))
    others = " and on runs that were not fitted" if judging else ""
    return Table(
        f"NRMSE fit in percent (100 is perfect) on the fitted runs{others}.",
        (*head, *(["diagnosis"] if said else [])),
        tuple(rows),
        words=(0, len(head)),
    )


def values_table(named: Sequence[tuple[str, Fit]]) -> Table:
    """Parameters of several fits side by side."""
    parameters: dict[str, Parameter] = {}
    for _, fit in named:
        parameters |= {one.name: one for one in fit.model.structure.parameters}
    rows = [(printable(name), *(_cell(fit, one) for _, fit in named)) for name, one in parameters.items()]
    head = ("parameter", *(printable(name) for name, _ in named))
    return Table("Parameters with their standard errors.", head, tuple(rows))


def guides_table(name: str, fit: Fit) -> Table:
    """One fit's parameters with the figures that engineers ask for."""
    structure = fit.model.structure
    rows = []
    for one, value, error, alone in zip(
        structure.parameters, fit.model.values, fit.standard_errors, fit.insensitivity_percent, strict=True
    ):
        judged = fit.model_errors.get(one.name)
        share = 100 * error / abs(value) if value else math.inf
        marks = _marks(fit, one.name)
        free = not marks and math.isfinite(share)
        above = free and (share > GUIDE_CRAMER_RAO or alone > GUIDE_INSENSITIVITY)
        cells = (f"{share:.1f}", f"{alone:.1f}") if free else ("", "")
        spread = "" if judged is None else _set(f"± {amount(one, float(f'{judged.total:.2g}'))}")
        rows.append((printable(one.name), _cell(fit, one), spread, *cells, marks or ("above a guide" if above else "")))
    return Table(
        f"{printable(name)}: value with standard error, what is left in the residual counted in (± model), Cramér-Rao "
        f"bound (guide: at most {GUIDE_CRAMER_RAO:g} %) and insensitivity (at most {GUIDE_INSENSITIVITY:g} %).",
        ("parameter", "value", "± model", "CR, %", "insens., %", ""),
        tuple(rows),
        words=(0, 5),
    )


def modes_table(named: Sequence[tuple[str, Fit]]) -> Table:
    """Natural frequencies and damping ratios."""
    rows = [
        (printable(name) if number == 0 else "", f"{mode.frequency_hz:.3f}", f"{mode.damping_ratio:.3f}")
        for name, fit in named
        for number, mode in enumerate(fit.model.modes)
    ]
    return Table("Natural modes.", ("model", "frequency, Hz", "damping ratio"), tuple(rows))


def _cell(fit: Fit, one: Parameter) -> str:
    names = fit.model.structure.names
    if one.name not in names:
        return NOT_THERE
    at = names.index(one.name)
    if one.name in fit.undetermined and one.name not in (*fit.fixed, *fit.at_bound):
        return "not determined"
    return _set(amount(one, float(fit.model.values[at]), float(fit.standard_errors[at])))


def _set(text: str) -> str:
    """`1/s²`, as units are printed."""
    return text.replace("^2", "²").replace("^3", "³")


def _marks(fit: Fit, name: str) -> str:
    each = [
        ("held", name in fit.fixed),
        ("at its bound", name in fit.at_bound),
        ("not determined", name in fit.undetermined and name not in (*fit.fixed, *fit.at_bound)),
        ("implausible", name in fit.implausible and name not in fit.undetermined),
    ]
    return ", ".join(words for words, is_so in each if is_so)
