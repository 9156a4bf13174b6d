"""A comparison of a model with flights, in keyed blocks: what was found first, then the tables."""

from __future__ import annotations

from collections.abc import Iterable

from gcs.analysis.text.blocks import Blocks, block, text_of, wrapped
from gcs.analysis.text.findings import finding_text, listed_runs
from sysid.compare.values import Comparison
from sysid.data.record import axis_of
from sysid.fit.result import Fit

LONGEST_AXIS = 5
"""Characters of an axis that stand beside its output over a column."""


def compare_text(found: Comparison, fit: Fit) -> str:
    """A comparison for people; 78 columns."""
    return text_of(compare_blocks(found, fit))


def compare_blocks(found: Comparison, fit: Fit) -> Blocks:
    """`title`, `figures`, `findings`, then the tables `bands`, `responses`, `runs`, and `remarks`."""
    structure = fit.model.structure
    runs = [one.id for one in found.runs]
    title = structure.title
    head = f"{title} against {listed_runs(runs)}, {found.band_hz[0]:g}-{found.band_hz[1]:g} Hz"
    names = [_short(output) for output in found.outputs]
    figures = [f"{'':16}{''.join(f'{name:>10}' for name in names)}", _row("NRMSE fit, %", found.nrmse_percent.values())]
    if found.noise_floor_percent is not None:
        figures.append(_row("with noise alone", found.noise_floor_percent.values()))
    return (
        block("title", wrapped(head, rest="  ")),
        block("figures", figures),
        block("findings", [line for each in found.findings for line in wrapped(finding_text(each), " ", "   ")]),
        block("bands", _band_lines(found)),
        block("responses", _response_lines(found)),
        block("runs", _run_lines(found) if len(found.runs) > 1 else []),
        *(block("remark", wrapped(f"note: {text}", rest="  ")) for text in found.remarks),
    )


def _short(output: str) -> str:
    """`roll p`; of others their name."""
    return f"{axis_of(output)} {output}" if len(axis_of(output)) <= LONGEST_AXIS else output


def _row(name: str, values: Iterable[float]) -> str:
    return f"  {name:16}" + "".join(f"{value:8.1f}  " for value in values).rstrip()


def _band_lines(found: Comparison) -> list[str]:
    """Shares of the error by band; of each band's error what is noise and what follows the commands."""
    axes = [axis_of(output) for output in found.outputs]
    lines = [
        "error by band, %    " + "".join(f"{axis:28}" for axis in axes).rstrip(),
        "                    " + ("share noise  coherent          " * len(axes)).rstrip(),
    ]
    each = [[one for one in found.bands if one.axis == axis] for axis in axes]
    for row in zip(*each, strict=True):
        line = f"  {f'{row[0].low_hz:.2g}-{row[0].high_hz:.2g} Hz':17}"
        for one in row:
            noise = "    ?" if one.noise_share is None else f"{100 * one.noise_share:5.0f}"
            strongest, share = max(one.coherence.items(), key=lambda item: item[1])
            name = strongest if share > 0.1 and one.error_share >= 0.005 else ""
            line += f"{100 * one.error_share:6.0f} {noise}  {one.coherence_together:5.2f}  {name:8} "
        lines.append(line.rstrip())
    lines.append("  coherent: with all commands together, and which is the strongest")
    return lines


def _response_lines(found: Comparison) -> list[str]:
    lines = ["model less measured     above what noise allows in"]
    for one in found.responses:
        known = any(db == db for db in one.decibels)
        bands = ", ".join(f"{low:.2g}-{high:.2g}" for low, high in one.noticed)
        said = f"{bands} Hz" if bands else "no band" if known else "the runs do not separate the commands"
        dB, deg = one.mismatch.rms
        figures = f"; rms {dB:.1f} dB, {deg:.0f} deg" if one.mismatch.band_hz else ""
        name = f"  {one.mismatch.output} per {one.mismatch.command}"
        lines += wrapped(f"{name:24}{said}{figures}", rest=" " * 24)
    return lines


def _run_lines(found: Comparison) -> list[str]:
    """What each run has of the error, under the name of its log."""
    outputs, k = found.outputs, len(found.outputs)
    shares = "".join(f"{name:>3}  " for name in outputs)
    lines = [
        f"{'runs':26}{'NRMSE, %':{7 * k + 2}}{'error, %':{5 * k + 3}}noise in it, %",
        f"{'':24}{''.join(f'{name:>3}    ' for name in outputs)}  {shares}    {shares}".rstrip(),
    ]
    last = ""
    for one in found.runs:
        log, mark, number = one.id.rpartition("#")
        if mark and log != last:
            lines.append(f"  {log}"[:78])
            last = log
        words = [f"#{number}" if mark else one.id, one.axis or "", one.maneuver]
        label = " ".join(word for word in words if word)
        nrmse = " ".join(f"{value:6.1f}" for value in one.nrmse_percent.values())
        error = " ".join(f"{100 * value:4.0f}" for value in one.error_share.values())
        noise = (
            "too short"
            if one.noise_share is None
            else " ".join(f"{100 * value:4.0f}" for value in one.noise_share.values())
        )
        lines.append(f"  {'  ' if mark else ''}{label}"[:21].ljust(22) + f"{nrmse}     {error}     {noise}")
    return lines
