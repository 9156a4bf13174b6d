"""A self-contained page about a flight: what was found in a glance; the flight; the ladder and the discovery of each of
its rungs; where the model fails; values; gains with the answer they promise; each run measured against modelled; where
all that comes from.

Where several fits are shown, the one with most steps behind it (the first of equals) is compared and diagnosed, with
the rungs below it, which are looked for beside it. What a kept diagnosis told of a fit is not asked again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs import documents
from gcs.analysis.answer import as_asked_now
from gcs.analysis.comparison import flown, flown_with_validation
from gcs.analysis.diagnosis import diagnose_fit
from gcs.analysis.fits import assess, runs_of
from gcs.analysis.ladder import Nrmse, rungs_of
from gcs.analysis.pages.bode import bode_figure
from gcs.analysis.pages.discovery import Told, discovery, told
from gcs.analysis.pages.flown import columns_for, run_figure
from gcs.analysis.pages.gains_section import gains_section
from gcs.analysis.pages.ladder import ladder_picture
from gcs.analysis.pages.models import fits_table, guides_table, modes_table, values_table
from gcs.analysis.pages.parts import Document, Facts, Listing, Part, Picture, Section, Sentences
from gcs.analysis.pages.pictures import PAGE_WIDTH, overlay_figure, spectra_figure
from gcs.analysis.pages.provenance import about_of, flight_parts, runs_table, source_parts, title_of
from gcs.analysis.rungs import KeptFit, load_fit, rungs_below
from gcs.analysis.standing import diagnosis_beside, standing_of
from gcs.analysis.text.addition import MARKS
from gcs.analysis.text.blocks import text_of
from gcs.analysis.text.comparison import compare_blocks
from gcs.analysis.text.documents import diagnosis_document
from gcs.analysis.text.findings import finding_text
from gcs.analysis.text.fit import checks_text, responses_text
from gcs.analysis.text.progress import spoken
from gcs.flight.folder import flight_of
from gcs.logs.words import printable
from sysid.compare.compare import compare
from sysid.compare.metrics import Mismatches, mismatch
from sysid.compare.values import Comparison, Densities
from sysid.data.dataset import Dataset, prepared
from sysid.data.record import Record
from sysid.fit.result import Fit

Progress = Callable[[str, float | None], None]
TABLES = ("bands", "responses", "runs", "remark")
"""Of a comparison's text: what the page has neither as sentences nor in a figure."""


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


@dataclass(frozen=True, eq=False, kw_only=True)
class RungFound:
    """A rung of the ladder, and what is known of it."""

    kept: KeptFit
    comparison: Comparison
    asked: Told | None
    """None where it was not diagnosed."""
    best: Densities | None
    """What the residual is with what it lacks."""


def flight_document(
    paths: Sequence[Path],
    named: Sequence[str] = (),
    gains: Path | None = None,
    *,
    diagnosing: bool = True,
    say: Progress = lambda _what, _share: None,
    warn: Callable[[str], None] = lambda _words: None,
) -> Document:
    """The page of one or more FIT.json, with the gains designed on one of them; `warn` hears that these do not hold it.

    `named` are the user's effect files, whose code may run. Raises TippathError where a log is gone, ResultError for a
    file that is no fit, GainsError for one that holds no gains.
    """
    fits = [KeptFit(path, load_fit(path, named)) for path in paths]
    main = max(fits, key=lambda one: len(one.fit.lineage))
    added = _added(main.path, main.fit)
    designed, worth = (None, "") if gains is None else gains_section(gains, fits, warn)
    rungs = rungs_below(main.path, main.fit, fits, named)
    others = [one for one in fits if all(one.fit is not rung.fit for rung in rungs)]
    steps = 3.0 + len(rungs)
    say(main.path.name, 0.0)
    fitted = prepared(runs_of(main.fit, main.fit.records), main.fit.band_hz)
    quiet = flown(main.fit)[1]
    found = []
    for number, kept in enumerate(rungs):
        say(kept.path.name, (1 + number) / steps)
        found.append(_rung(kept, fitted, quiet, named, diagnosing and kept.fit is main.fit, say))
    say("the runs", (1 + len(rungs)) / steps)
    runs = _all_runs(fitted, fits)
    folder = flight_of(Path(next(iter(runs.values())).path))
    floor = added.noise_floor_percent or found[-1].comparison.noise_floor_percent
    sections = [_summary(found, floor, gains, worth)]
    about = flight_parts(folder)
    sections += [Section("The flight", tuple(about))] if about else []
    sections += _ladder_section(main, added, floor)
    sections += [_discovery_section(one, diagnosing) for one in found]
    sections += [_failing_section(found, fitted), _models_section(rungs, fitted)]
    sections += [] if not others else [_others_section(others)]
    sections += [] if designed is None else [designed]
    drawn = [(one.fit.model.structure.title, one.fit) for one in (main, *(rungs[-2:-1] or others[:1]))]
    sections.append(_runs_section(drawn, main.fit, runs, lambda what, done: say(what, 1 - (1 - done) / steps)))
    files = [one.path for one in (*rungs, *others)]
    sources = [runs_table(main.fit, runs), *source_parts(main, folder, files, version("tippath"))]
    sections.append(Section("Where this comes from", tuple(sources), fresh=True))
    flown_runs = list(runs.values())
    models = [one.fit.model.structure.title for one in (*rungs, *others)]
    return Document(title_of(folder, flown_runs), about_of(folder, flown_runs, models), tuple(sections))


def _all_runs(fitted: Dataset, fits: Sequence[KeptFit]) -> dict[tuple[str, str], Record]:
    """By log and name: the fitted ones first, then those that only judge, and other fits' own."""
    runs = {(one.path, one.id): one for one in fitted.records}
    for kept in fits:
        for one in [*runs_of(kept.fit, kept.fit.records), *runs_of(kept.fit, kept.fit.validation)]:
            runs.setdefault((one.path, one.id), one)
    return runs


def _rung(
    kept: KeptFit, fitted: Dataset, quiet: Sequence[Record], named: Sequence[str], asking: bool, say: Progress
) -> RungFound:
    """What is known of a rung; `asking`: what no kept diagnosis tells is asked now."""
    fit, folder = kept.fit, kept.path.parent
    document: Any = diagnosis_beside(folder, fit)
    if asking and (document is None or not as_asked_now(document, fit)):
        _, validation, hover = flown_with_validation(fit, (), (), None, None)
        asked = diagnose_fit(fit, fitted, validation, hover, say=spoken(lambda what: say(what, None)))
        document = diagnosis_document(asked, folder=folder)
    models = () if document is None else standing_of(document, folder, named).models
    best = next((model for role, model in models if role == "missing"), None)
    return RungFound(
        kept=kept,
        comparison=compare(fit.model, fitted, fit.band_hz, quiet),
        asked=None if document is None else told(document),
        best=None if best is None else compare(best, fitted, fit.band_hz, quiet).densities,
    )


def _added(path: Path, fit: Fit) -> AddedDocument:
    """Raises DocumentError for what is none."""
    added = documents.read_json(path, AddedDocument, what="a fit")
    if added.noise_floor_percent is not None and added.noise_floor_percent.keys() != fit.nrmse_percent.keys():
        outputs = ", ".join(fit.nrmse_percent)
        raise documents.DocumentError(
            f"{path}: noise_floor_percent is not of this fit's outputs ({outputs}); add again"
        )
    return added


def _summary(found: Sequence[RungFound], floor: Nrmse | None, gains: Path | None, worth: str) -> Section:
    """The answer, before any reason."""
    named = [(one.kept.fit.model.structure.title, one.kept.fit) for one in found]
    said = {
        one.kept.fit.model.structure.title: "not diagnosed" if one.asked is None else one.asked.answer for one in found
    }
    last = named[-1][1]
    reached = " and ".join(f"{name} {value:.1f} %" for name, value in last.nrmse_percent.items())
    lines = [f"{printable(named[-1][0])} explains {reached} (NRMSE fit)."]
    if floor is not None:
        alone = " and ".join(f"{name} {value:.1f} %" for name, value in floor.items())
        lines[0] = f"{lines[0][:-1]}; a model that leaves nothing but noise would reach {alone}."
    lines += [f"{printable(name)}: {words}." for name, words in said.items()]
    if gains is not None:
        lines.append(f"Gains {gains.name}: {worth}.")
    lines += [f"Warning: {printable(words)}" for words in last.warnings]
    return Section("Summary", (Sentences(tuple(lines)), fits_table(named, floor, said)))


def _ladder_section(main: KeptFit, added: AddedDocument, floor: Nrmse | None) -> list[Section]:
    """Rung by rung, with the signs that the last addition left in its file."""
    fit = main.fit
    if len(fit.lineage) < 2:
        return []
    rungs = rungs_of(fit.model.structure.base_, fit.lineage)
    drawn = Picture(
        ladder_picture(rungs, floor, width=PAGE_WIDTH),
        "The error that is left (100 % less the NRMSE fit) rung by rung, on fitted runs and on runs that were not "
        "fitted (dashed), above the part that is noise (grey). Numbers are the NRMSE fit.",
    )
    signs = tuple(printable(f"{MARKS[one.seen]} {one.name}: {one.text}") for one in added.signs or ())
    return [Section(f"The ladder to {main.path.name}", (drawn, *((Sentences(signs),) if signs else ())))]


def _discovery_section(rung: RungFound, diagnosing: bool) -> Section:
    heading = f"What {rung.kept.path.name} lacks"
    if rung.asked is None:
        told_of = " (left out by --no-diagnosis)" if not diagnosing else ""
        words = f"It was not diagnosed{told_of}: `tippath diagnose {rung.kept.path.name}` asks."
        return Section(heading, (Sentences((words,)),))
    outputs = rung.kept.fit.model.structure.outputs
    parts = discovery(rung.asked, rung.comparison.densities, rung.best, outputs)
    return Section(heading, tuple(parts), fresh=any(isinstance(part, Picture) for part in parts))


def _failing_section(found: Sequence[RungFound], fitted: Dataset) -> Section:
    """The last rung against the measurement, with the one below it."""
    last = found[-1]
    fit = last.kept.fit
    parts: list[Part] = [Sentences(tuple(finding_text(one) for one in last.comparison.findings), listed=True)]
    models = [(one.kept.fit.model.structure.title, _responses(one.kept.fit, fitted)) for one in reversed(found[-2:])]
    beside = "" if len(models) == 1 else f", and {printable(models[1][0])} (dotted)"
    parts += [
        Picture(
            bode_figure(command, models, fit.band_hz),
            f"Frequency responses to {command}: measured with 95 % bounds (grey), {printable(models[0][0])} "
            f"(dashed){beside} where the coherence is good. Below, the partial coherence; its guide is dotted.",
        )
        for command in _answered(models[0][1])
    ]
    parts += [
        Picture(
            spectra_figure(last.comparison),
            f"Above: amplitude spectra of the measured rate and of what {printable(models[0][0])} leaves, over the "
            "noise. Below: the error of each band, divided into what follows the commands, other error, and noise.",
        ),
        Picture(
            overlay_figure(last.comparison),
            f"The run with most error of each axis: measured, {models[0][0]}, residual.",
        ),
        Listing(text_of([one for one in compare_blocks(last.comparison, fit) if one.key in TABLES])),
    ]
    return Section(f"Where {last.kept.path.name} fails", tuple(parts), fresh=True)


def _responses(fit: Fit, fitted: Dataset) -> Mismatches:
    structure = fit.model.structure
    return mismatch(fit.model, fitted.viewed(structure.inputs, structure.outputs))


def _answered(found: Mismatches) -> list[str]:
    """The commands with a response that was measured."""
    measured = found.measured
    return [
        command
        for command in measured.commands
        if any(measured.valid_hz(output, command) is not None for output in measured.outputs)
    ]


def _models_section(rungs: Sequence[KeptFit], fitted: Dataset) -> Section:
    """Values of all rungs side by side, then what engineers ask of the last."""
    named = [(one.fit.model.structure.title, one.fit) for one in rungs]
    title, fit = named[-1]
    judged = assess(fit, fitted)
    listing = "\n\n".join([responses_text(judged.responses), *([checks_text(judged.checks)] if judged.checks else [])])
    return Section("Values", (values_table(named), modes_table(named), guides_table(title, fit), Listing(listing)))


def _others_section(others: Sequence[KeptFit]) -> Section:
    """Models that are no rungs of the ladder, for comparison: how well they fit, and their values."""
    named = [(one.fit.model.structure.title, one.fit) for one in others]
    note = Facts(tuple((name, one.path.name) for (name, _), one in zip(named, others, strict=True)))
    return Section("Other models", (note, fits_table(named, None, {}), values_table(named), modes_table(named)))


def _runs_section(
    drawn: Sequence[tuple[str, Fit]],
    main: Fit,
    runs: Mapping[tuple[str, str], Record],
    say: Callable[[str, float], None],
) -> Section:
    """Every run measured against each model."""
    models = [(printable(title), fit.model) for title, fit in drawn]
    used = {(one.path, one.id) for one in main.records}
    parts = []
    for number, (key, record) in enumerate(runs.items()):
        say(record.id, number / len(runs))
        what = f"{record.axis or ''} {record.maneuver}".strip()
        kind = "fitted" if key in used else "not fitted"
        left = f"below each, what {models[0][0]} leaves"
        caption = printable(f"{record.id}, {what}, {kind}: measured and modelled inside the band; {left}.")
        parts.append(Picture(run_figure(record, models, main.band_hz, columns_for(len(runs))), caption))
    return Section("Measured against modelled", tuple(parts), fresh=True)
