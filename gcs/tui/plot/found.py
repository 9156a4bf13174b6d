"""From what the mathematics found to what a plot shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from gcs.analysis.ladder import ErrorLeft
from gcs.tui.plot.heat import Cell, HeatPlot, HeatRow
from gcs.tui.plot.model import Bar, BarPlot, FloatArray, FrequencyPlot, Panel, TimePlot
from sysid.compare.finding_kinds import ErrorInBand, NearlyNoise, TooShort
from sysid.data.record import axis_of

if TYPE_CHECKING:  # only for types: the app starts without the mathematics
    from sysid.compare.values import BandError, Comparison, Densities

LARGEST_DB, LARGEST_DEG = 20.0, 180.0
"""Beyond these a mismatch is drawn at the edge."""
FOLLOWS = 0.2
"""Coherence from which on a cell says what its error follows."""
SHORT = {"delta_x": "δx", "delta_y": "δy", "delta_e": "δe"}
Bands = Sequence[tuple[float, float]]


def strip(name: str, t: FloatArray, values: FloatArray, unit: str = "", least: float = 0.1) -> Panel:
    """One signal over time, (n,) each."""
    return Panel(name=name, x=t, line=values, unit=unit, least=least)


def compared(
    name: str,
    t: FloatArray,
    measured: FloatArray,
    modelled: FloatArray,
    other: FloatArray | None = None,
    *,
    unit: str = "rad/s",
    least: float = 0.01,
    residual_least: float = 0.01,
) -> tuple[Panel, Panel]:
    """Model over measurement, and the residual below on a scale of its own; (n,) each. The scales are told.

    other: what another model makes of it, dashed in both. residual_least: the residual's smallest scale.
    """
    apart = None if other is None else measured - other
    return (
        Panel(
            name=name, x=t, line=measured, over=modelled, reference=other, mirrored=False, unit=unit, least=least,
            weight=2.0,
        ),
        Panel(
            name=f"{name} res", x=t, line=measured - modelled, reference=apart, mirrored=False, unit=unit,
            least=residual_least, residual=True,
        ),
    )  # fmt: skip


def time_plot(
    comparison: Comparison,
    part: int = 0,
    *,
    outputs: Sequence[int] | None = None,
    commands: Mapping[str, FloatArray] | None = None,
    other: tuple[str, FloatArray] | None = None,
    residual_least: Sequence[float] = (),
    more: Mapping[int, Sequence[Panel]] = MappingProxyType({}),
    shaded: Bands = (),
) -> TimePlot:
    """One gap-free part of a run (`comparison.traces[part]`): commands above, model over measurement, residuals.

    outputs: which of the comparison's, all where None. commands: name -> (n,) on the trace's own time, where known.
    other: name of another model and what it makes of the run, (k, n). residual_least: smallest scale of each output's
    residual. more: panels below an output's own. shaded: times that are looked at.
    """
    trace = comparison.traces[part]
    panels = [Panel(name=name, x=trace.t, line=values) for name, values in (commands or {}).items()]
    for k in range(len(comparison.outputs)) if outputs is None else outputs:
        least = residual_least[k] if residual_least else 0.01
        beside = None if other is None else other[1][k]
        panels += compared(
            comparison.outputs[k], trace.t, trace.measured[k], trace.modelled[k], beside, residual_least=least
        )
        panels += more.get(k, ())
    origin = float(trace.t[0]) if trace.t.size else 0.0
    words = ("measured", "model", "" if other is None else other[0])
    return TimePlot(panels=tuple(panels), title=f"run {trace.run}", words=words, origin_s=origin, shaded=tuple(shaded))


def response_plot(comparison: Comparison, k: int = 0, shaded: Bands = ()) -> FrequencyPlot:
    """The k-th of `comparison.responses`: magnitude and phase, mismatch with what noise allows, coherence.

    shaded: bands in Hz that are looked at.
    """
    one = comparison.responses[k]
    f = one.frequency_hz
    with np.errstate(divide="ignore", invalid="ignore"):
        level, turn = 20 * np.log10(np.abs(one.measured)), np.degrees(np.angle(one.measured))
    # beside the measured: where the two are apart by a turn less a little, the sum leaves -180..180
    modelled = (turn + one.degrees + 180.0) % 360.0 - 180.0
    panels = [
        Panel(name="dB", x=f, line=level, over=level + one.decibels, unit="dB", centred=False, least=10.0, weight=1.5),
        Panel(name="phase", x=f, line=turn, over=modelled, unit="deg", fixed=(-180.0, 180.0), wraps=True, weight=1.5),
    ]
    panels += [
        Panel(
            name="Δ dB", x=f, line=one.decibels, reference=one.allowed_db, unit="dB", least=1.0, most=LARGEST_DB,
            residual=True,
        ),
        Panel(
            name="Δ deg", x=f, line=one.degrees, reference=one.allowed_deg, unit="deg", least=10.0, most=LARGEST_DEG,
            wraps=True, residual=True,
        ),
        Panel(name="coh", x=one.mismatch.frequency_hz, line=one.mismatch.coherence, fixed=(0.0, 1.0), weight=0.75),
    ]  # fmt: skip
    low_hz, high_hz = _band(comparison.band_hz)
    return FrequencyPlot(
        panels=tuple(panels),
        title=response_names(comparison)[k],
        words=("measured", "model", "allowed"),
        low_hz=low_hz,
        high_hz=high_hz,
        marked=one.noticed,
        shaded=tuple(shaded),
    )


def response_names(comparison: Comparison) -> tuple[str, ...]:
    """`q from delta_x`, for each of `comparison.responses`."""
    return tuple(f"{one.mismatch.output} from {one.mismatch.command}" for one in comparison.responses)


def spectra_plot(comparison: Comparison, k: int = 0, shaded: Bands = ()) -> FrequencyPlot:
    """Output k: spectra of measurement, residual and noise in one panel; shaded: bands in Hz that are looked at."""
    return densities_plot(comparison.densities, k, comparison.outputs[k], comparison.band_hz, shaded)


def densities_plot(
    found: Densities, k: int, output: str, band_hz: tuple[float, float], shaded: Bands = ()
) -> FrequencyPlot:
    """As `spectra_plot`, of densities alone."""
    panel = Panel(
        name=output, x=found.frequency_hz, line=found.measured[:, k], over=found.residual[:, k],
        reference=found.noise[:, k], unit="rad/s/√Hz", logarithmic=True, centred=False, least=1.0, most=4.0,
    )  # fmt: skip
    low_hz, high_hz = _band(band_hz)
    words = ("measured", "residual", "noise")
    return FrequencyPlot(
        panels=(panel,), title=f"{output}: spectra", words=words, low_hz=low_hz, high_hz=high_hz, shaded=tuple(shaded)
    )


def _band(band_hz: tuple[float, float]) -> tuple[float, float]:
    """As on paper: from a quarter of a hertz."""
    low, high = max(band_hz[0], 0.25), band_hz[1]
    return min(low, 0.5 * high), high


def heat_plot(comparison: Comparison) -> HeatPlot:
    """The error beyond noise by axis and band, the worst axis first; outlined is what its finding names."""
    order = sorted(comparison.outputs, key=lambda output: -_beyond(comparison, output))
    bands = {output: [one for one in comparison.bands if one.axis == axis_of(output)] for output in order}
    rows = tuple(
        HeatRow(
            output=output,
            axis=axis_of(output),
            names=_names(comparison, output),
            cells=tuple(_cell(one) for one in bands[output]),
        )
        for output in order
    )
    first = bands[order[0]]
    named = named_band(comparison, axis_of(order[0]))
    outlined = None
    if named is not None:
        inside = [k for k, one in enumerate(first) if one.low_hz < named[1] * 0.999 and one.high_hz > named[0] * 1.001]
        outlined = (0, inside[0], inside[-1]) if inside else None
    edges = (first[0].low_hz, *(one.high_hz for one in first))
    return HeatPlot(rows=rows, edges_hz=edges, outlined=outlined, title="error beyond noise, x its rms")


def _beyond(comparison: Comparison, output: str) -> float:
    """An axis's error power that is not noise, of what was measured."""
    share = sum(one.beyond_noise for one in comparison.bands if one.axis == axis_of(output))
    return share * (1 - comparison.nrmse_percent[output] / 100) ** 2


def _names(comparison: Comparison, output: str) -> tuple[str, ...]:
    axis = axis_of(output)
    name = output if axis == output else f"{axis} {output}"
    floor = comparison.noise_floor_percent
    beside = () if floor is None else (f"noise {floor[output]:.1f}",)
    return name, f"NRMSE {comparison.nrmse_percent[output]:.1f}", *beside


def _cell(one: BandError) -> Cell:
    """A band's error in words: what sits there, how far above the noise it is, and what it follows."""
    where = f"{one.axis} {one.low_hz:.2g}-{one.high_hz:.2g} Hz: {100 * one.error_share:.0f} % of its error"
    command, alone = max(one.coherence.items(), key=lambda item: item[1], default=("", 0.0))
    follows = f"{SHORT.get(command, command)} {alone:.2f}"
    if one.noise_share is None:
        words: tuple[str, ...] = (f"{100 * one.error_share:.0f} %", "noise ?")
        said = f"{where}; too short to tell it from noise"
    else:
        times = min(1 / max(one.noise_share, 1e-4), 1e4) ** 0.5
        words = (f"{100 * one.beyond_noise:.0f} %", f"{times:.1f}x")
        said = f"{where}, {100 * one.beyond_noise:.0f} % beyond noise ({times:.1f}x)"
    if alone >= FOLLOWS:
        words, said = (*words, follows), f"{said}; follows {follows}"
    return Cell(beyond=one.beyond_noise, words=words, said=said)


def named_band(comparison: Comparison, axis: str) -> tuple[float, float] | None:
    """The band in Hz that the finding on an axis's error names; None where it names none."""
    found = [one for one in comparison.findings if isinstance(one, ErrorInBand | NearlyNoise | TooShort)]
    return next((one.band_hz for one in found if one.axis == axis), None)


def left_bars(rungs: Sequence[tuple[str, Sequence[ErrorLeft]]], title: str = "") -> BarPlot:
    """The error falling, a group of bars for each axis: what each rung leaves, and what it took away.

    rungs: name, and what is left on each axis, lowest first.
    """
    bars = []
    for axis in range(len(rungs[0][1]) if rungs else 0):
        for number, (name, each) in enumerate(rungs):
            one = each[axis]
            bars.append(
                Bar(
                    label=f"{one.output}  {name}",
                    parts=(one.left, max(0.0, one.before - one.left)),
                    text=_reached(one),
                    beside=one.placebo,
                    chosen=number == len(rungs) - 1,
                )
            )
    return BarPlot(bars=tuple(bars), title=title, words=("left", "taken away"), beside="placebo", full=1.0)


def _reached(one: ErrorLeft) -> str:
    """NRMSE on the fitted and on the validation runs, whether that is better; then what is left."""
    validated = "-" if one.validation_percent is None else f"{one.validation_percent:.1f}"
    sign = {True: "↑", False: "↓", None: " "}[one.better]
    return f"{one.nrmse_percent:.1f} / {validated} {sign} {100 * one.left:3.0f} %"


def fallen_plot(
    before: tuple[str, Densities] | None,
    after: tuple[str, Densities],
    outputs: Sequence[str],
    band_hz: tuple[float, float],
) -> FrequencyPlot:
    """Residual spectra over the noise, a panel for each output: before and after the last rung, each with its name."""
    name, now = after
    panels = []
    for k, output in enumerate(outputs):
        was = None
        if before is not None:
            was = before[1].residual[:, k]
            if before[1].frequency_hz.size != now.frequency_hz.size:
                was = np.interp(now.frequency_hz, before[1].frequency_hz, was)
        panels.append(
            Panel(
                name=output, x=now.frequency_hz, line=now.residual[:, k] if was is None else was,
                over=None if was is None else now.residual[:, k], reference=now.noise[:, k], unit="rad/s/√Hz",
                logarithmic=True, centred=False, least=1.0, most=3.0,
            )
        )  # fmt: skip
    low_hz, high_hz = _band(band_hz)
    words = (name, "", "noise") if before is None else (before[0], name, "noise")
    return FrequencyPlot(panels=tuple(panels), title="residual spectra", words=words, low_hz=low_hz, high_hz=high_hz)
