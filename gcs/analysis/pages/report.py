"""A self-contained page about a flight: tables, checks, where the model fails, what it lacks, and the ladder; gains
with the answer they promise; and measured against modelled rates for every run.

Where several fits are shown, the one with most steps behind it (the first of equals) is compared and diagnosed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs import documents
from gcs.analysis.clearance import clearance, gains_in
from gcs.analysis.comparison import flown, flown_with_validation
from gcs.analysis.diagnosis import diagnose_fit
from gcs.analysis.fits import assess, runs_of
from gcs.analysis.ladder import Nrmse, rungs_of
from gcs.analysis.pages.diagnosis import drawn
from gcs.analysis.pages.ladder import ladder_picture
from gcs.analysis.pages.page import BLACK, BLUE, GREEN, ORANGE, page, svg
from gcs.analysis.pages.pictures import compare_picture
from gcs.analysis.standing import beside
from gcs.analysis.text.addition import MARKS
from gcs.analysis.text.blocks import wrapped
from gcs.analysis.text.clearance import clearance_text
from gcs.analysis.text.comparison import compare_text
from gcs.analysis.text.diagnosis import diagnosis_text
from gcs.analysis.text.fit import fit_text
from gcs.analysis.text.gains import gains_text
from gcs.analysis.text.ladder import ladder_text
from gcs.analysis.text.progress import spoken
from gcs.errors import TippathError
from gcs.flight.folder import flight_of
from gcs.flight.gains import GainsDocument, GainsError, checksum, load_gains
from gcs.logs.words import printable
from sysid.compare.compare import compare
from sysid.control.loop import Following, following
from sysid.control.regulator import Gains, lqr, not_held
from sysid.control.stability import closed_loop
from sysid.data.dataset import Dataset, prepared
from sysid.data.record import CHANNELS, RATES, Record
from sysid.errors import SysidError
from sysid.fit.result import Fit
from sysid.fit.simulate import overlay
from sysid.model.structure import Model

Section = tuple[str, str, list[str]]
"""Heading, text, pictures."""
Progress = Callable[[str, float | None], None]


SAME = 1e-9
"""Relative: gains designed again on another machine."""


def run_picture(record: Record, models: Sequence[tuple[str, Model]], band_hz: tuple[float, float]) -> str:
    """SVG of one run: commands, then each output measured against each model, as the fit saw them (inside the band)."""
    inputs, outputs = models[0][1].structure.inputs, models[0][1].structure.outputs
    figure, axes = _figure(1 + len(outputs), (10, 2.2 + 2.0 * len(outputs)))
    top = axes[0]
    for name, colour in zip(inputs, (BLACK, ORANGE, GREEN), strict=False):
        top.plot(record.t - record.t[0], record.channels[name], color=colour, linewidth=0.6, label=name)
    top.set_ylabel("command")
    top.legend(loc="upper left", fontsize=8, ncols=3)
    for index, output in enumerate(outputs):
        axis = axes[1 + index]
        for one in prepared([record], band_hz).viewed(inputs, outputs).spectra:
            for number, ((label, model), colour) in enumerate(zip(models, (BLUE, ORANGE, GREEN), strict=False)):
                t, measured, modelled = overlay(model, one)
                t = t - record.t[0]
                if number == 0:
                    axis.plot(t, measured[:, index], color=BLACK, linewidth=1.0, label="measured")
                axis.plot(
                    t, modelled[:, index], color=colour, linewidth=0.9, linestyle="--" if number else "-", label=label
                )
        axis.set_ylabel(f"{output}, {CHANNELS[output]}")
        axis.legend(loc="upper left", fontsize=8, ncols=4)
    axes[-1].set_xlabel("time in the record, s")
    axes[0].set_title(f"{record.id}   {record.axis or ''} {record.maneuver}", fontsize=10, loc="left")
    return svg(figure)


def _figure(rows: int, size: tuple[float, float]) -> tuple[Any, Any]:
    # a second to load: only where something is drawn
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True)
    for axis in axes:
        axis.grid(True, linewidth=0.3)
        axis.tick_params(labelsize=8)
    return figure, axes


# ------------------------------------------------------------------------------------------------ a whole flight


class SignDocument(documents.Open, frozen=True, kw_only=True):
    """What spoke for an addition, or against it."""

    name: str
    text: str
    seen: bool | None


class AddedDocument(documents.Open, frozen=True, kw_only=True):
    """What `tippath add` leaves in a fit's file beside the fit."""

    noise_floor_percent: dict[str, float] | None = None
    """Of each output."""
    signs: tuple[SignDocument, ...] | None = None


def flight_report(
    paths: Sequence[Path],
    named: Sequence[str] = (),
    gains: Path | None = None,
    *,
    diagnosing: bool = True,
    say: Progress = lambda _what, _share: None,
    warn: Callable[[str], None] = lambda _words: None,
) -> str:
    """The page of one or more FIT.json, with the gains designed on one of them; `warn` hears that these do not hold it.

    `named` are the user's effect files, whose code may run. Raises TippathError where a log is gone, ResultError for a
    file that is no fit, GainsError for one that holds no gains.
    """
    fits = [Fit.load(path, named) for path in paths]
    main = max(range(len(fits)), key=lambda number: len(fits[number].lineage))
    path, fit = paths[main], fits[main]
    added = _added(path, fit)
    designed = [] if gains is None else [_gains_section(gains, list(zip(paths, fits, strict=True)), warn)]
    steps = len(fits) + 2 + diagnosing
    sections: list[Section] = []
    runs: dict[tuple[str, str], Record] = {}
    fitted: list[Dataset] = []
    for number, (one_path, one) in enumerate(zip(paths, fits, strict=True)):
        say(one_path.name, number / steps)
        fitted.append(prepared(runs_of(one, one.records), one.band_hz))
        for record in [*fitted[-1].records, *runs_of(one, one.validation)]:
            runs[record.path, record.id] = record
        judged = assess(one, fitted[-1])
        sections.append((one_path.name, fit_text(one, judged.checks, judged.responses), []))
    say("where it fails", len(fits) / steps)
    found = compare(fit.model, fitted[main], fit.band_hz, flown(fit)[1])
    sections += _ladder_section(path, fit, added, found.noise_floor_percent)
    sections.append((f"Where {path.name} fails", compare_text(found, fit), [svg(compare_picture(found))]))
    if diagnosing:
        sections.append(_diagnosis_section(path, fit, fitted[main], lambda what: say(what, (len(fits) + 1) / steps)))
    sections += designed
    models = [(_label(fit), fit.model) for fit in fits]
    pictures = []
    for number, record in enumerate(runs.values()):
        say(record.id, 1 - (1 - number / len(runs)) / steps)
        pictures.append(run_picture(record, models, fits[0].band_hz))
    sections.append(("Measured against modelled", "", pictures))
    title, about = _head(paths, next(iter(runs.values())).path)
    return page(title, [*([("The flight", about, [])] if about else []), *sections])


def _label(fit: Fit) -> str:
    return fit.model.structure.title


def _head(paths: Sequence[Path], log: str) -> tuple[str, str]:
    """The title, and what the flight's folder tells of the flight."""
    folder = flight_of(Path(log))
    title = folder.name or "tippath: " + ", ".join(path.stem for path in paths)
    lines = [printable(f"{time[:16].replace('T', ' ')}  {text}") for time, text in folder.notes()]
    try:
        flown = folder.runs()
    except TippathError:
        flown = []
    for run in flown:
        verdict = run.get("verdict")
        reasons = verdict.get("reasons") if isinstance(verdict, dict) else None
        kept = isinstance(verdict, dict) and verdict.get("keep") is True
        why = "; ".join(map(str, reasons)) if isinstance(reasons, list) and reasons else str(run.get("reason", ""))
        lines.append(printable(f"{run.get('label', '')}: {'keep' if kept else f'fly again: {why}'}"))
    return title, "\n".join(lines)


def _added(path: Path, fit: Fit) -> AddedDocument:
    """Raises DocumentError for what is none."""
    added = documents.read_json(path, AddedDocument, what="a fit")
    if added.noise_floor_percent is not None and added.noise_floor_percent.keys() != fit.nrmse_percent.keys():
        outputs = ", ".join(fit.nrmse_percent)
        raise documents.DocumentError(
            f"{path}: noise_floor_percent is not of this fit's outputs ({outputs}); add again"
        )
    return added


def _ladder_section(path: Path, fit: Fit, added: AddedDocument, floor: Nrmse | None) -> list[Section]:
    """Rung by rung, with the signs that the last addition left in its file."""
    if len(fit.lineage) < 2:
        return []
    rungs = rungs_of(fit.model.structure.base_, fit.lineage)
    floor = added.noise_floor_percent or floor
    lines = ladder_text(rungs, floor)
    for one in added.signs or ():
        lines += wrapped(f"{MARKS[one.seen]} {one.name}: {one.text}", " ", "   ")
    return [(f"The ladder to {path.name}", "\n".join(lines), [svg(ladder_picture(rungs, floor))])]


def _diagnosis_section(path: Path, fit: Fit, fitted: Dataset, say: Callable[[str], None]) -> Section:
    _, validation, quiet = flown_with_validation(fit, (), (), None, None)
    found = diagnose_fit(fit, fitted, validation, quiet, say=spoken(say))
    return f"What {path.name} lacks", diagnosis_text(found, path.name, full=True), [svg(drawn(found))]


def _gains_section(path: Path, named: Sequence[tuple[Path, Fit]], warn: Callable[[str], None]) -> Section:
    """The gains designed again on the fit that they are from, and the answer they promise, or that they do not hold.

    Raises GainsError, with the reason for each fit, where they are from none of them.
    """
    crc = load_gains(path).crc
    document = json.loads(path.read_text(encoding="utf-8"))
    reasons = []
    for one, fit in reversed(named):
        gains = _designed_again(document, fit)
        if isinstance(gains, str):
            reasons.append(f"{one.name}: {gains}")
            continue
        text = f"{gains_text(gains)}\n  checksum      {checksum(crc)}"
        if gains.loop.stable:
            cleared = clearance(gains, fit, beside(one.parent, fit, fit.model.structure.files))
            text += f"\n{clearance_text(cleared)}"
            return f"Gains, {path.name}", text, [following_picture(following(gains, fit.model))]
        refused = f"{not_held(gains, fit.model)}. Do not push it; design again, `tippath design` says what holds"
        warn(f"{path}: {refused}")
        return f"Gains, {path.name}, which do not hold {one.name}", f"{refused}.\n\n{text}", []
    raise GainsError(f"{path} was designed on none of these fits: {'; '.join(reasons)}")


def _designed_again(document: dict[str, Any], fit: Fit) -> Gains | str:
    """The gains of a document, with the loop that they make with this fit; or why they are not from it.

    K and the steady prefilter follow from the model and the input cost; observer and dynamic prefilter may be others.
    """
    weights = document.get("weights")
    cost = weights.get("inputs") if isinstance(weights, dict) else None
    if not isinstance(cost, int | float):
        return "the gains do not say with which input cost they were designed"
    try:
        held = gains_in(documents.convert(document, GainsDocument, "the gains"))
        gains = lqr(fit.model, float(cost), elevator=len(held.K) > 2)
    except SysidError as error:
        return f"no gains can be designed on it: {error}"
    own = gains.model.by_name
    theirs = document["model"]["parameters"]
    moved = [name for name, value in own.items() if theirs.get(name) != value]
    if moved:
        return f"its model is another ({', '.join(moved)} differ)"
    for name, here, value in (("K", held.K, gains.K), ("prefilter", held.prefilter, gains.prefilter)):
        if not np.allclose(here, value, rtol=0, atol=SAME * float(np.max(np.abs(value)))):
            return f"{name} is not what `tippath design` makes of its model"
    return replace(held, input_cost=gains.input_cost, loop=closed_loop(held, fit.model))


def following_picture(found: Following) -> str:
    """SVG of the rates asked for and predicted, on each axis."""
    figure, axes = _figure(2, (10, 4.6))
    for axis, one in zip(axes, (found.roll, found.pitch), strict=True):
        own, other = RATES if one.axis == "roll" else RATES[::-1]
        axis.plot(found.t, one.asked, color=BLACK, linewidth=1.0, label=f"{own} asked for")
        axis.plot(found.t, one.own, color=BLUE, linewidth=1.2, label=f"{own} predicted")
        axis.plot(found.t, one.other, color=ORANGE, linewidth=0.9, linestyle="--", label=f"{other} predicted")
        axis.set_ylabel("rad/s")
        axis.legend(loc="upper right", fontsize=8)
    axes[0].set_title("rate doublets, closed loop, small motion", fontsize=10, loc="left")
    axes[-1].set_xlabel("s")
    return svg(figure)
