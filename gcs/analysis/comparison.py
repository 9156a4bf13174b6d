"""A model compared with flights: which runs are read, and the comparison in words.

A fit is compared with its own runs unless others are named. The quiet hover that was flown beside them is read too:
it never enters a fit, and it is what noise looks like.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gcs.analysis.fits import runs_of, wrapped
from gcs.logs import Run, Window, ingest, resolve_runs
from sysid.compare.data_checks import listed
from sysid.compare.values import Comparison
from sysid.data.record import AXIS_OF, Record
from sysid.fit.result import Fit


def flown(
    fit: Fit,
    runs: Sequence[str] = (),
    profile: Path | None = None,
    window: Window | None = None,
) -> tuple[list[Record], list[Record]]:
    """The records to compare with, and those of quiet hover beside them.

    runs: RUN words; none are the fit's own runs, with the quiet hover of the same logs. The fit's profile reads them
    where no other is given; its window counts for its own runs only. Raises TippathError with the reasons.
    """
    if runs:
        own = None if fit.profile is None else Path(fit.profile)
        found = resolve_runs(runs, profile or own, window, f_high_hz=fit.band_hz[1])
        return split(found)
    if profile is not None:
        fit = replace(fit, profile=str(profile))
    if window is not None:
        fit = replace(fit, window_s=window)
    records = runs_of(fit, fit.records)
    return records, [*split(records)[1], *_quiet_beside(fit, records)]


def split(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """What was flown, and quiet hover."""
    quiet = [record for record in records if record.maneuver == "quiet"]
    return [record for record in records if record.maneuver != "quiet"], quiet


def _quiet_beside(fit: Fit, records: Sequence[Record]) -> list[Record]:
    """Usable runs of quiet hover in the logs of these records, with rates from the same kind of message."""
    profile = None if fit.profile is None else Path(fit.profile)
    logs = [Path(path) for path in dict.fromkeys(record.path for record in records) if not path.endswith(".npz")]
    if not logs:
        return []
    return quiet_among(ingest(logs, profile, fit.window_s, f_high_hz=fit.band_hz[1]).runs, fit, records)


def quiet_among(runs: Sequence[Run], fit: Fit, records: Sequence[Record]) -> list[Record]:
    """Usable quiet hover among runs, from the logs of these records and with rates from the same kind of message."""
    sources = {record.rate_source for record in records}
    known = {(record.path, record.id) for record in records}
    logs = {record.path for record in records}
    return [
        run.record
        for run in runs
        if run.usable
        and run.record is not None
        and run.path in logs
        and run.maneuver == "quiet"
        and run.record.rate_source in sources
        and (run.record.path, run.record.id) not in known
        and set(fit.model.structure.inputs) <= set(run.record.channels)
    ]


def compare_text(found: Comparison, fit: Fit) -> str:
    """A comparison for people; 78 columns."""
    structure = fit.model.structure
    runs = [one.id for one in found.runs]
    title = " + ".join([structure.base.upper(), *(Path(one).name for one in structure.effects)])
    lines = wrapped(f"{title} against {listed(runs)}, {found.band_hz[0]:g}-{found.band_hz[1]:g} Hz", rest="  ")
    lines += ["", "                    roll p   pitch q", _row("NRMSE fit, %", [*found.nrmse_percent.values()])]
    if found.noise_floor_percent is not None:
        lines.append(_row("with noise alone", [*found.noise_floor_percent.values()]))
    lines.append("")
    for text in found.findings:
        lines += wrapped(text, " ", "   ")
    lines += ["", *_band_lines(found), "", *_response_lines(found)]
    if len(found.runs) > 1:
        lines += ["", *_run_lines(found)]
    for text in found.remarks:
        lines += ["", *wrapped(f"note: {text}", rest="  ")]
    return "\n".join(lines)


def _row(name: str, values: Sequence[float]) -> str:
    return f"  {name:16}" + "".join(f"{value:8.1f}  " for value in values).rstrip()


def _band_lines(found: Comparison) -> list[str]:
    """Shares of the error by band; of each band's error what is noise and what follows the commands."""
    axes = [AXIS_OF[output] for output in found.outputs]
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
    lines = [
        "runs                      NRMSE, %        error, %     noise in it, %",
        "                          p      q        p    q        p    q",
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
