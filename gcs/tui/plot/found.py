"""From what the mathematics found to what a plot shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gcs.tui.plot.model import Bar, BarPlot, FloatArray, FrequencyPlot, Panel, TimePlot

if TYPE_CHECKING:  # only for types: the app starts without the mathematics
    from sysid.compare.values import BandError, Comparison, Densities

LARGEST_DB, LARGEST_DEG = 20.0, 180.0
"""Beyond these a mismatch is drawn at the edge."""
ENOUGH = 0.8
"""The share that a candidate must explain to be named."""


def strip(name: str, t: FloatArray, values: FloatArray, unit: str = "", least: float = 0.1) -> Panel:
    """One signal over time, (n,) each."""
    return Panel(name=name, x=t, line=values, unit=unit, least=least)


def compared(
    name: str, t: FloatArray, measured: FloatArray, modelled: FloatArray, unit: str = "rad/s", least: float = 0.01
) -> tuple[Panel, Panel]:
    """Model over measurement, and the residual below on a scale of its own; (n,) each. The scales are told."""
    return (
        Panel(name=name, x=t, line=measured, over=modelled, unit=unit, least=least, weight=2.0),
        Panel(name=f"{name} res", x=t, line=measured - modelled, unit=unit, least=least, residual=True),
    )


def time_plot(
    comparison: Comparison,
    part: int = 0,
    *,
    outputs: Sequence[int] | None = None,
    commands: Mapping[str, FloatArray] | None = None,
    same_scale: bool = False,
) -> TimePlot:
    """One gap-free part of a run (`comparison.traces[part]`): commands above, model over measurement, residuals.

    outputs: which of the comparison's, all where None. commands: name -> (n,) on the trace's own time, where known.
    same_scale: residuals on the scale of their signal.
    """
    trace = comparison.traces[part]
    panels = [Panel(name=name, x=trace.t, line=values) for name, values in (commands or {}).items()]
    for k in range(len(comparison.outputs)) if outputs is None else outputs:
        above, below = compared(comparison.outputs[k], trace.t, trace.measured[k], trace.modelled[k])
        if same_scale:
            below = Panel(
                name=below.name,
                x=below.x,
                line=below.line,
                unit=below.unit,
                scale_of=len(panels),
                residual=True,
                least=below.least,
            )
        panels += [above, below]
    origin = float(trace.t[0]) if trace.t.size else 0.0
    return TimePlot(panels=tuple(panels), title=f"run {trace.run}", words=("measured", "model", ""), origin_s=origin)


def worst_part(comparison: Comparison, k: int = 0) -> int:
    """The part of a run with the most error on output k."""
    errors = [float(np.sum(one.residual[k] ** 2)) for one in comparison.traces]
    return int(np.argmax(errors)) if errors else 0


def response_plot(comparison: Comparison, k: int = 0) -> FrequencyPlot:
    """The k-th of `comparison.responses`: magnitude and phase, mismatch with what noise allows, coherence."""
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
    )


def response_names(comparison: Comparison) -> tuple[str, ...]:
    """`q from delta_x`, for each of `comparison.responses`."""
    return tuple(f"{one.mismatch.output} from {one.mismatch.command}" for one in comparison.responses)


def spectra_plot(comparison: Comparison, k: int = 0) -> FrequencyPlot:
    """Output k: spectra of measurement, residual and noise in one panel."""
    return densities_plot(comparison.densities, k, comparison.outputs[k], comparison.band_hz)


def densities_plot(found: Densities, k: int, output: str, band_hz: tuple[float, float]) -> FrequencyPlot:
    """As `spectra_plot`, of densities alone."""
    panel = Panel(
        name=output, x=found.frequency_hz, line=found.measured[:, k], over=found.residual[:, k],
        reference=found.noise[:, k], unit="rad/s/√Hz", logarithmic=True, centred=False, least=1.0, most=4.0,
    )  # fmt: skip
    low_hz, high_hz = _band(band_hz)
    words = ("measured", "residual", "noise")
    return FrequencyPlot(panels=(panel,), title=f"{output}: spectra", words=words, low_hz=low_hz, high_hz=high_hz)


def _band(band_hz: tuple[float, float]) -> tuple[float, float]:
    """As on paper: from a quarter of a hertz."""
    low, high = max(band_hz[0], 0.25), band_hz[1]
    return min(low, 0.5 * high), high


def candidate_bars(candidates: Sequence[tuple[str, float | None, str]], title: str = "") -> BarPlot:
    """(label, explained share 0..1 or None where it is not testable, note), best first."""
    bars = []
    for number, (label, share, note) in enumerate(candidates):
        said = "not testable" if share is None else f"{100 * share:.0f} %"
        parts = () if share is None else (float(np.clip(np.nan_to_num(share), 0.0, 1.0)),)
        bars.append(Bar(label=label, parts=parts, text=f"{said}  {note}".rstrip(), chosen=number == 0))
    return BarPlot(bars=tuple(bars), title=title, lines=((ENOUGH, "enough to name it"),) if bars else ())


Nrmse = Mapping[str, float]


def ladder_bars(rungs: Sequence[tuple[str, Nrmse, Nrmse | None]], floor: Nrmse | None, output: str) -> BarPlot:
    """NRMSE in percent rung by rung, of one output: fitted as bars, validation marked on them, noise's reach a line."""
    bars = []
    for number, (label, fitted, judged) in enumerate(rungs):
        value = fitted[output]
        beside = None if judged is None else judged[output]
        text = f"{value:.1f}" + ("" if beside is None else f"  {beside:.1f}")
        bars.append(
            Bar(label=label, parts=(max(0.0, value),), text=text, beside=beside, chosen=number == len(rungs) - 1)
        )
    lines = ((floor[output], f"noise {floor[output]:.0f}"),) if floor is not None else ()
    return BarPlot(
        bars=tuple(bars), title=f"{output}: NRMSE, %", full=100.0, lines=lines, words=("fitted",), beside="validation"
    )


def band_bars(bands: Sequence[BandError], axis: str) -> BarPlot:
    """One axis's error by band: what follows the commands, other error, noise."""
    bars = []
    shown = [one for one in bands if one.axis == axis]
    for one in shown:
        noise = one.error_share * (one.noise_share or 0.0)
        linear = min(one.error_share * one.coherence_together, one.error_share - noise)
        parts = linear, max(0.0, one.error_share - noise - linear), noise
        bars.append(
            Bar(label=f"{one.low_hz:.2g}-{one.high_hz:.2g} Hz", parts=parts, text=f"{100 * one.error_share:.0f} %")
        )
    largest = max((one.error_share for one in shown), default=1.0)
    return BarPlot(
        bars=tuple(bars),
        title=f"{axis}: error by band",
        full=max(largest, 1e-9),
        lines=(),
        words=("follows the commands", "other", "noise"),
    )
