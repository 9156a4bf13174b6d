"""A design of gains for people: matrices, poles, and what the loop holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from gcs.analysis.text.blocks import wrapped
from sysid.control.measured_margins import Crossing, MeasuredMargins
from sysid.control.prefilter import DynamicPrefilter
from sysid.control.regulator import Gains
from sysid.control.robustness import DiskMargin
from sysid.control.stability import SENSIBLE_MS, ClosedLoop, Margins

LESS_DEG = 5.0
"""Beyond its bound, by which a measured phase margin falls short of the model's to be spoken of."""


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
            f"LQR on {gains.model.structure.base_.label}, "
            f"rates 1, flapping {gains.flapping_cost:g}, input cost {gains.input_cost:g}",
            *rows("K", gains.K),
            *rows("observer L", gains.observer_gain),
            *rows("prefilter g", gains.prefilter),
            *([] if gains.dynamic is None else rows("and on the way", gains.dynamic.F)),
            *([] if gains.dynamic is None else [f"  {'':14}{_followed(gains.dynamic)}"]),
            f"  poles         {poles(gains.poles)} 1/s",
            f"  observer      {poles(gains.observer_poles)} 1/s",
            *_loop_lines(gains.loop, "both" if len(gains.K) == 2 else "all"),
        ]
    )


def _followed(dynamic: DynamicPrefilter) -> str:
    """The models that the rates follow."""
    p, q = (f"{w / (2 * math.pi):.1f} Hz" for w in dynamic.frequency)
    return f"of models that p and q follow, {p} and {q}, damping {dynamic.damping[0]:g}"


def _loop_lines(loop: ClosedLoop, which: str) -> list[str]:
    """Margins, and of what; or that there are none."""

    def named(effects: Sequence[str]) -> str:
        return ", ".join(Path(one).name for one in effects)

    if loop.margins is None:
        lines = ["NOT held: no margins"]
    else:
        lines = [f"held: {loop.margins.words} in {which} commands"]
        if not loop.margins.sensible:
            lines.append("that is thin: a higher input cost leaves more, and sampling takes its share of the delay")
    lines += [f"with {named(loop.effects)} in the loop"] if loop.effects else []
    lines += [f"without {named(loop.left_out)}: small motion does not show it"] if loop.left_out else []
    lines += ["it drifts, slower than 0.5 Hz, which the rates do not show: the pilot holds it"] if loop.drifts else []
    return [
        row for k, line in enumerate(lines) for row in wrapped(f"  {'loop' if k == 0 else '':14}{line}", rest=" " * 16)
    ]


def measured_text(found: MeasuredMargins, by_model: Margins | None) -> str:
    """Margins by the measured responses of the fit's runs, to stand below a design."""
    if found.band_hz is None:
        return _measured(
            "not measured well enough for margins: fly longer sweeps of both axes (one alone tells of no loop of two)"
        )
    low, high = found.band_hz
    each = [("to", found.sweep_to_hz), ("from", found.sweep_from_hz)]
    to = " and ".join(f"{way} {hz:g} Hz" for way, hz in each if hz is not None)

    def margin(name: str, key: str, one: Crossing | None, unit: str, digits: int) -> str:
        where = f"between {low:.2g} and {high:.2g} Hz"
        if one is None:
            return f"{name}: not measured {where}: " + (f"sweep {to}" if key in found.missing else "the model has none")
        beyond = f"; the model's is not {where}: sweep {to}" if key in found.missing else ""
        return f"{name} {one.value:.{digits}f} ± {one.bound:.{digits}f}{unit} at {one.frequency_hz:.1f} Hz{beyond}"

    told = [
        margin("phase", "phase_deg", found.phase_deg, "°", 0),
        margin("gain margin", "gain_db", found.gain_db, " dB", 1),
    ]
    if found.delay_ms is not None:
        digits = 0 if found.delay_ms.value >= SENSIBLE_MS else 1
        told.insert(1, margin("delay", "delay_ms", found.delay_ms, " ms", digits))
    if found.disk is not None:
        disk = DiskMargin(size=found.disk.value, frequency_hz=found.disk.frequency_hz)
        told.append(
            f"disk margin in this band {disk.size:.2f} ± {found.disk.bound:.2f} ({disk.gain_db:.1f} dB or "
            f"{disk.phase_deg:.0f}°) at {disk.frequency_hz:.1f} Hz"
        )
    told.append(f"{found.unstable_poles or 'no'} unstable poles in the open loop, by the model")
    less = (
        found.phase_deg is not None
        and by_model is not None
        and found.phase_deg.value + found.phase_deg.bound + LESS_DEG < by_model.phase_deg
    )
    missing = ". The model promises more: it lacks something, which `tippath diagnose` names; do not fly these"
    return _measured("; ".join(told) + (missing if less else ""))


def _measured(words: str) -> str:
    return "\n".join(wrapped(f"  {'measured':14}{words}", rest=" " * 16))
