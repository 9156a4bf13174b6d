"""Rungs and parameters in rows: what each reached, with bars; what a rung did to the parameters."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.analysis.ladder import Nrmse, RungNumbers
from gcs.analysis.quantities import amount
from sysid.data.record import RATES
from sysid.fit.result import Fit

LEFT = 40
"""Columns of what a number is; the numbers follow."""


def ladder_text(rungs: Sequence[RungNumbers], floor: Nrmse | None) -> list[str]:
    """(name, fitted NRMSE, validation NRMSE or None) by output, with bars of their mean; two fit into 78 columns."""
    outputs = tuple(rungs[0][1]) if rungs else RATES
    beside = "" if floor is None else f"noise {' / '.join(f'{floor[name]:.1f}' for name in outputs)}"
    heads = "  ".join(f"{name}: fitted valid." for name in outputs)
    lines = [f"{'ladder':25}{heads}  {beside}".rstrip()]
    for name, fitted, validated in rungs:
        numbers = "  ".join(
            f"{fitted[axis]:9.1f} " + (f"{'-':>6}" if validated is None else f"{validated[axis]:6.1f}")
            for axis in outputs
        )
        mean = sum(fitted.values()) / len(fitted)
        lines.append(f"{cut(name, 24):25}{numbers}  {bar(mean / 100, 18)}".rstrip())
    return lines


def bar(share: float, width: int = 20) -> str:
    """A bar of eighths, at most `width` long."""
    eighths = round(8 * width * min(max(share, 0.0), 1.0))
    return "█" * (eighths // 8) + " ▏▎▍▌▋▊▉"[eighths % 8].strip()


def moved_text(before: Fit, after: Fit) -> list[str]:
    """Parameters with their errors, before and after."""
    lines = [f"  {'parameter':20}{'before':>22}{'after':>26}"]
    known = dict(
        zip(before.model.structure.names, zip(before.model.values, before.standard_errors, strict=True), strict=True)
    )
    for one, value, error in zip(
        after.model.structure.parameters, after.model.values, after.standard_errors, strict=True
    ):
        was = known.get(one.name)
        first = "" if was is None else amount(one, float(was[0]), float(was[1]))
        second = amount(one, float(value), float(error))
        if one.name in after.fixed:
            second += " held"
        elif one.name in after.at_bound:
            second += " at its limit"
        mark = "  implausible" if one.name in after.implausible else ""
        lines.append(f"  {one.name:20}{first:>22}{second:>26}{mark}".rstrip())
    return lines


def nrmse_row(name: str, before: Nrmse | None, now: Nrmse) -> str:
    """NRMSE fit of both outputs, from and to where there is a from."""
    cells = [
        f"{axis} " + (f"{'':8}{now[axis]:5.1f}" if before is None else f"{before[axis]:5.1f} → {now[axis]:5.1f}")
        for axis in now
    ]
    return f"  {cut(name, LEFT - 1):{LEFT}}{'   '.join(cells)} %"


def cut(text: str, width: int) -> str:
    """At most so many characters, with an ellipsis where something was cut."""
    return text if len(text) <= width else text[: width - 1] + "…"
