"""What the desk works out, step by step: the same functions as behind the commands, on one flight.

Scipy and control come along with this module, which takes a second; the desk brings it in with its first step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol

from gcs.analysis.addition import Addition, add_effect
from gcs.analysis.answer import Answer, answer_of
from gcs.analysis.band import chosen_band
from gcs.analysis.comparison import flown_with_validation, quiet_among
from gcs.analysis.diagnosis import FitDiagnosis, diagnose_fit
from gcs.analysis.fits import PAIR, assess, identify_flight, on_airframe, on_cd, side_by_side
from gcs.analysis.quantities import quantity
from gcs.analysis.text.addition import addition_blocks, addition_document, outcome
from gcs.analysis.text.blocks import Blocks, whole
from gcs.analysis.text.comparison import compare_blocks
from gcs.analysis.text.documents import comparison_document, diagnosis_document
from gcs.analysis.text.fit import judgement_document
from gcs.analysis.vehicles import doubted
from gcs.desk import choices, ladder, reopened, saved, shell, windows
from gcs.desk.state import Base, Choice, DeskState, Fitted, Rung, RunRow, TimedNote
from gcs.errors import TippathError, UsageError
from gcs.flight.folder import FlightFolder, flight_of
from gcs.logs import Ingest, Run, check_same_rate_source, ingest
from gcs.logs.words import printable
from sysid.compare.compare import compare
from sysid.compare.values import Comparison
from sysid.control.regulator import designs_on
from sysid.data.dataset import prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import CHANNELS, Record
from sysid.diagnose.progress import Listener
from sysid.errors import SysidError
from sysid.fit.identify import identify
from sysid.fit.result import Fit, RecordUsed
from sysid.model.base import bases
from sysid.model.compose import compose
from sysid.model.effect import Effect, EffectError
from sysid.model.paper import TPP

Document = dict[str, Any]


class Step(Protocol):
    """Hears how far the work is, and raises where it was called off."""

    def __call__(self, what: str, share: float | None = None) -> None: ...


@dataclass(frozen=True, eq=False)
class Opened:
    """A flight that was read, with what was kept of it in earlier sessions."""

    runs: tuple[Run, ...]
    folder: FlightFolder
    places: Mapping[Fit, Path]
    """Where its fits are kept."""
    state: DeskState


@dataclass(frozen=True, eq=False)
class FittedFlight:
    """The fits of a flight, and the documents that judge them."""

    shown: Fitted
    base: Base
    judged: Mapping[Fit, Mapping[str, Any]]

    @property
    def bottom(self) -> Fit:
        """The ladder's lowest rung."""
        return self.shown.found.tpp if self.base.model == TPP.base else self.shown.found.cd

    def effects(self, fit: Fit) -> Sequence[str]:
        """What one of the two was fitted with."""
        return self.base.effects if fit is self.shown.found.tpp else on_cd(self.base.effects)


Flown = tuple[list[Record], list[Record], list[Record]]
"""Runs that were fitted, runs that judge, and quiet hover."""


def _unread(read: Ingest) -> list[str]:
    """What of the logs could not be read, or not together; what one lacks that another has is none."""
    alone = [source for source in read.sources if source.joined is None]
    damaged = [f"{Path(one.path).name}: {one.damage.describe()}" for one in alone if one.damage and one.damage.any]
    return damaged + [f"{Path(path).name}: {why}" for one in read.sources for path, why in one.apart.items()]


class Calculations:
    """Each tells `step` how far it is. All raise TippathError or SysidError: what is wrong and what to do."""

    def __init__(self, step: Step, hear: Listener) -> None:
        """`hear` is told of a diagnosis, and raises too."""
        self._step, self._hear = step, hear

    def read(self, paths: Sequence[Path]) -> Opened:
        """Flight folders or logs, their runs and the fits kept beside the first."""
        path, *beside = paths
        read = ingest(
            paths,
            progress=lambda log: self._step(
                printable(log.path.name), log.done_bytes / log.total_bytes if log.total_bytes else None
            ),
        )
        folder = flight_of(path)
        self._step("looking for fits")
        runs = tuple(windows.as_kept(read.runs, folder.path))
        records = [record for run in runs if (record := choices.record_of(run)) is not None]
        kept = saved.look(folder.path, records)
        rows, base = choices.rows_of(runs, folder), choices.default_base(runs)
        if kept.ladder:
            rows = choices.as_fitted(rows, runs, kept.ladder[0].fit)
            base = choices.base_of(kept.ladder[0].fit)
        fitted = _fitted_before(kept, records)
        unread = [*read.refused.values(), *read.left_out.values(), *_unread(read)]
        rungs = reopened.rungs(kept.ladder, folder.path, lambda fit: self.flown_by(fit, read.runs), self._step)
        self._step("")
        page = folder.path / "report.html"
        state = DeskState(
            path=path,
            beside=tuple(beside),
            home=folder.path,
            report=page if page.is_file() else None,
            name=printable(folder.name),
            notes=tuple(TimedNote(printable(time), printable(text)) for time, text in folder.notes()),
            vehicle=choices.vehicle_words(folder),
            runs=rows,
            unread=(*map(printable, unread), *kept.unread),
            base=base,
            fitted=fitted,
            ladder=ladder.named(rungs),
        )
        places = {one.fit: one.path for one in (*kept.ladder, kept.tpp, kept.cd) if one is not None}
        return Opened(runs, folder, places, state)

    def fit(self, records: Sequence[Record], validation: Sequence[Record], base: Base) -> FittedFlight:
        """TPP, CD and the CD that the TPP reduces to."""
        self._step("TPP and CD")
        band = chosen_band(records)
        fitted = prepared(records, band.hz)
        fits = identify_flight(fitted, validation, band, effects=base.effects)
        self._step("judging them", 0.5)
        judged = {one: judgement_document(assess(one, fitted)) for one in (fits.tpp, fits.cd)}
        self._step("", 0.9)
        return FittedFlight(ladder.tables(fits), base, judged)

    def compare(self, rung: Rung, flown: Flown) -> tuple[Comparison, Document, Blocks]:
        """Where a rung fails: values, the document to keep, text."""
        self._step(rung.name)
        records, _, quiet = flown
        comparison = compare(rung.fit.model, records, rung.fit.band_hz, quiet)
        text = compare_blocks(comparison, rung.fit)
        self._step("")
        return comparison, comparison_document(comparison, doubted(records)), text

    def diagnose(self, rung: Rung, flown: Flown) -> tuple[FitDiagnosis, Document, Answer]:
        """What a rung lacks: values, the document to keep, and what is shown of it."""
        diagnosis = diagnose_fit(rung.fit, *flown, say=self._hear)
        self._step("")
        return diagnosis, diagnosis_document(diagnosis, doubted([*flown[0], *flown[1]])), answer_of(diagnosis)

    def effect(self, fit: Fit, word: str) -> Effect:
        """The effect to add that a word names; a file's code runs."""
        return ladder.effect_to_add(fit, word)

    def add(self, rung: Rung, effect: Effect, flown: Flown) -> Addition:
        """A rung's fit with one effect more."""
        self._step(rung.name)
        records, validation, _ = flown
        asked = None if rung.diagnosis is None else rung.diagnosis.last
        addition = add_effect(rung.fit, effect, records, validation, asked=asked, say=self._hear)
        self._step("writing")
        return addition

    def addition_document(self, addition: Addition, folder: Path) -> Document:
        """The grown fit as it is kept in a folder."""
        return addition_document(addition, folder)

    def designs_on(self, fit: Fit) -> bool:
        """Whether gains are designed on a fit of this structure."""
        return designs_on(fit.model.structure)

    def used(self, rows: Sequence[RunRow], runs: Sequence[Run], choice: Choice) -> list[Record]:
        """Of the runs that are used so, in their order. Raises TippathError where their rates differ in kind."""
        records = [
            record
            for row, run in zip(rows, runs, strict=True)
            if row.choice is choice and (record := choices.record_of(run)) is not None
        ]
        check_same_rate_source(records)
        return records

    def alone(self, record: Record, axis: str) -> tuple[str, ...]:
        """What a fit of one axis to one run says. Raises TippathError for an axis that is fitted with others only."""
        if axis not in bases() or bases()[axis].axes != (axis,):
            raise TippathError(f"{axis} is not fitted alone: roll, pitch and yaw are")
        fitted = prepared([record], chosen_band([record]).hz)
        fit = identify(compose(axis), fitted, (), fitted.band_hz)
        percent = ", ".join(f"{name} {value:.0f} %" for name, value in fit.nrmse_percent.items() if value is not None)
        sizes = zip(fit.model.structure.parameters, fit.model.values, fit.standard_errors, strict=True)
        values = ", ".join(quantity(one, float(value), float(error)) for one, value, error in sizes)
        return f"{axis} alone, of first order: NRMSE {percent}; {values}", *fit.warnings

    def flown_by(self, fit: Fit, runs: Sequence[Run]) -> Flown:
        """The runs that a fit was made from, those that judged it, and quiet hover, as its command would read them."""
        known = [record for run in runs if (record := choices.record_of(run)) is not None]
        if _own_reading(fit, known):
            return flown_with_validation(fit, (), (), None, None)
        records, judging = (
            [one.held(fit.found_loop_s) for one in _named(used, known)] for used in (fit.records, fit.validation)
        )
        quiet = quiet_among(runs, fit, records)
        return on_airframe(records, fit.airframe), on_airframe(judging, fit.airframe), quiet

    def as_read(self, fit: Fit, place: Path | None) -> Fit:
        """A kept fit with the paths of the user's effects as a command finds them in its file."""
        files = shell.user_files(fit)
        return fit if place is None or not files else Fit.load(place, files)

    def require_base(self, model: str, effects: Sequence[str]) -> None:
        """Raises UsageError where there is no such base model, or where the effects cannot be composed onto it."""
        if model not in PAIR:
            known = f"; a shell has it: tippath fit LOG --model {model}" if model in bases() else ""
            raise UsageError(f"{model}: there are {' and '.join(PAIR)} here{known}")
        try:
            compose(model, effects, CHANNELS, {"Omega_0": 1.0, "V_0": 1.0})
        except EffectError as error:
            raise UsageError(str(error)) from error

    def named(self, rungs: Sequence[Rung]) -> tuple[Rung, ...]:
        """Rungs with their names, bottom first."""
        return ladder.named(rungs)

    def full_name(self, fit: Fit) -> str:
        """`TPP + servo_lag`."""
        return ladder.full_name(fit)

    def added(self, addition: Addition, place: str, written: Path | None) -> tuple[Blocks, str]:
        """What is to be said of an added effect, in full and in a sentence, which offers nothing of a face's."""
        text = addition_blocks(addition, place, None if written is None else str(written))
        return text, whole(outcome(addition)[1], {})

    def report(
        self, paths: Sequence[Path], named: Sequence[str], gains: Path | None, paper: datetime | None
    ) -> tuple[str, bytes | None]:
        """The page of some fits and gains, and, where it is for `paper`, made then, the same as PDF; `named` are the
        user's effect files."""
        from gcs.analysis.pages.page import page  # matplotlib comes along as well
        from gcs.analysis.pages.report import flight_document

        document = flight_document(paths, named, gains, say=self._step)
        self._step("writing")
        if paper is None:
            return page(document), None
        from gcs.analysis.pages.pdf import pdf  # fonts are read: only where it is asked for

        return page(document), pdf(document, paper)


def _fitted_before(kept: saved.SavedResults, records: Sequence[Record]) -> Fitted | None:
    """The tables of the fits that were kept; None where one of the two is missing."""
    if kept.tpp is None or kept.cd is None or _own_reading(kept.tpp.fit, records):
        return None
    try:
        fit = kept.tpp.fit
        both = side_by_side(fit, kept.cd.fit, _named(fit.records, records), _named(fit.validation, records))
    except (SysidError, TippathError):
        return None
    return ladder.tables(both, (kept.tpp.path, kept.cd.path))


def _own_reading(fit: Fit, records: Sequence[Record]) -> bool:
    """Whether a fit reads its logs in another way than the desk does, which has these runs of them.

    In a band that ends lower, runs are usable that the desk does not take.
    """
    if fit.profile is not None or fit.window_s is not None or fit.band_hz[1] > DEFAULT_BAND_HZ[1]:
        return True
    known = {record.id for record in records}
    lower = fit.band_hz[1] < DEFAULT_BAND_HZ[1]
    return lower and any(one.id not in known for one in (*fit.records, *fit.validation))


def _named(used: Sequence[RecordUsed], records: Sequence[Record]) -> list[Record]:
    """The records that a fit names. Raises TippathError where one is not among them."""
    known = {(Path(one.path).resolve(), one.id, one.sha256): one for one in records}
    named = []
    for one in used:
        record = known.get((Path(one.path).resolve(), one.id, one.sha256))
        if record is None:
            raise TippathError(f"{one.id} is not a run of this flight, or its log has changed: fit again")
        named.append(record)
    return named
