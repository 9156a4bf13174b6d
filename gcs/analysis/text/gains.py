"""A design of gains for people: matrices, poles, and what the loop holds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sysid.control.regulator import Gains
from sysid.control.stability import ClosedLoop


def gains_text(gains: Gains) -> str:
    """A design for people."""

    def rows(name: str, matrix: object) -> list[str]:
        table = [list(map(float, row)) for row in matrix]  # type: ignore[attr-defined]
        return [
            f"  {name if i == 0 else '':14}" + " ".join(f"{value:10.4f}" for value in row)
            for i, row in enumerate(table)
        ]

    def poles(values: object) -> str:
        found = sorted({(round(v.real, 2), round(abs(v.imag), 2)) for v in values})  # type: ignore[attr-defined]
        return ", ".join(f"{re:.2f}" + (f" ± {im:.2f}j" if im > 0.005 else "") for re, im in found)

    return "\n".join(
        [
            f"LQR on {gains.model.structure.base_.label}, rates 1, flapping 0.001, input cost {gains.input_cost:g}",
            *rows("K", gains.K),
            *rows("observer L", gains.observer_gain),
            *rows("prefilter g", gains.prefilter),
            f"  poles         {poles(gains.poles)} 1/s",
            f"  observer      {poles(gains.observer_poles)} 1/s",
            *_loop_lines(gains.loop),
        ]
    )


def _loop_lines(loop: ClosedLoop) -> list[str]:
    """Margins, and of what; or that there are none."""

    def named(effects: Sequence[str]) -> str:
        return ", ".join(Path(one).name for one in effects)

    if loop.margins is None:
        lines = ["NOT held: no margins"]
    else:
        lines = [f"held: {loop.margins.words} in both commands"]
        if not loop.margins.sensible:
            lines.append("that is thin: a higher input cost leaves more, and sampling takes its share of the delay")
    lines += [f"with {named(loop.effects)} in the loop"] if loop.effects else []
    lines += [f"without {named(loop.left_out)}: small motion does not show it"] if loop.left_out else []
    lines += ["it drifts, slower than 0.5 Hz, which the rates do not show: the pilot holds it"] if loop.drifts else []
    return [f"  {'loop' if k == 0 else '':14}{line}" for k, line in enumerate(lines)]
