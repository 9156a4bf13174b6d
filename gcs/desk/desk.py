"""The desk: open a flight, choose its runs, fit, compare, diagnose, climb the ladder, design, report.

Headless: every step calls the function that its command calls, and appends that command. The state is replaced whole,
under a lock, when a step is over; a step that fails or is called off changes nothing. Results are written beside the
log, never over another one. Where the folder does not take them they stay in the state, and wait to be kept elsewhere.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.desk import shell
from gcs.desk.keeping import Keeping, ToKeep, document_text
from gcs.desk.state import Base, Choice, Rung, TimedNote
from gcs.desk.working import Working
from gcs.errors import TippathError, UsageError
from gcs.files import write_whole
from gcs.flight.folder import FlightFolder, stamp

if TYPE_CHECKING:
    from gcs.desk.calculations import Calculations
    from gcs.logs import Run
    from sysid.data.record import Record
    from sysid.fit.result import Fit

ENDINGS = {"a comparison": "compare", "a diagnosis": "diagnosis"}
"""Of their files."""


class Desk(Working):
    """One flight at a time. `state`, `use`, `choose_base`, `undo` and `cancel` never wait; the others do, and are
    called from a worker. All raise TippathError: what is wrong and what to do.
    """

    def __init__(
        self,
        *,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        on_command: Callable[[str], None] = lambda _: None,
        on_said: Callable[[str], None] = lambda _: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`on_command` is told every command as it is appended, `on_said` every last word; neither may wait."""
        super().__init__(on_said, clock)
        self._now = now
        self._on_command = on_command
        self._keeping = Keeping(now, self._did, self._kept)
        self._runs: tuple[Run, ...] = ()
        self._places: dict[Fit, Path] = {}
        """Where the fits of this flight are kept."""

    @cached_property
    def _calculations(self) -> Calculations:
        from gcs.desk.calculations import Calculations  # a second of scipy and control, and the app is to be there

        return Calculations(lambda what, share=None: self._step(what, share), self._hear)

    # ---------------------------------------------------------------------------------------------- the flight

    def open(self, word: str, *, wait: bool = False) -> None:
        """Open a flight folder or a log: read its runs, its name and notes, and the fits kept beside it.

        `wait`: until what is being worked on is over, instead of refusing. A flight whose results are not kept yet is
        not left.
        """
        path = Path(word).expanduser()
        if not path.exists():
            raise TippathError(f"{path}: no such folder or log")
        with self._working(f"reading {path.name}", wait=wait):
            if self._state.unkept:
                raise TippathError(
                    f"not kept yet: {', '.join(self._state.unkept)}; keep them in another folder before leaving "
                    f"{self._state.path}"
                )
            opened = self._calculations.read(path)
            with self._keeping.lock, self._lock:
                self._keeping.begin(opened.folder)
                self._runs, self._places = opened.runs, dict(opened.places)
                self._state = replace(opened.state, busy=self._state.busy)
            self._did(shell.words(["tippath", "ingest", path]))

    def rename(self, text: str) -> None:
        """Give the flight a name."""
        name = _one_line(text)
        with self._keeping.lock:
            self._keeping.folder()
            self._set(name=name)
            self._keeping.keep("the flight's name", lambda folder: folder.rename(name))
            self._keeping.audit(f"named {name}" if name else "the name was removed")

    def note(self, text: str) -> None:
        """Write something down, with the time."""
        words = _one_line(text)
        with self._keeping.lock:
            self._keeping.folder()
            if not words:
                raise TippathError("an empty note is none")
            time = self._now()
            with self._lock:
                self._set(notes=(*self._state.notes, TimedNote(stamp(time), words)))
            self._keeping.keep("a note", lambda folder: folder.note(time, words))

    def use(self, run_id: str, choice: Choice) -> None:
        """Use a run to fit, to validate, or not at all. It counts from the next `fit`."""
        with self._lock:
            rows = [row for row in self._state.runs if run_id in (row.id, row.word)]
            if len(rows) != 1:
                raise UsageError(f"{run_id}: {'no such run' if not rows else 'several logs have a run of that name'}")
            (row,) = rows
            if Choice.NOISE in (choice, row.choice):
                raise TippathError(
                    f"{row.id} is quiet hover, it tells the noise"
                    if row.choice is Choice.NOISE
                    else f"{row.id} is not quiet hover"
                )
            if not row.usable and choice is not Choice.OUT:
                raise TippathError(f"{row.id} is not usable: {'; '.join(row.reasons)}")
            runs = tuple(replace(one, choice=choice) if one is row else one for one in self._state.runs)
            self._set(runs=runs)

    def choose_base(self, model: str, effects: Sequence[str] = ()) -> None:
        """`tpp` or `cd`, and the effects to begin with. It counts from the next `fit`."""
        self._calculations.require_base(model, effects)
        self._set(base=Base(model, tuple(effects)))

    # ---------------------------------------------------------------------------------------------- fit and ladder

    def fit(self) -> None:
        """Fit TPP, CD and the CD that the TPP reduces to; the ladder begins anew with the base that was chosen."""
        with self._working("fitting"):
            self._keeping.folder()
            rows, base = self._state.runs, self._state.base
            records, validation = self._records(Choice.FIT), self._records(Choice.VALIDATE)
            if not records:
                raise TippathError("no run is chosen to be fitted: leave at least a roll and a pitch chirp to the fit")
            fitted = self._calculations.fit(records, validation, base)
            with self._lock:
                self._set(
                    fitted=fitted.shown,
                    ladder=self._calculations.named([Rung(name="", effect=None, fit=fitted.bottom, path=None)]),
                    said=f"fitted to {len(records)} run{'s' if len(records) > 1 else ''}",
                )
            runs, judging = ([row.word for row in rows if row.choice is one] for one in (Choice.FIT, Choice.VALIDATE))
            for fit in (fitted.shown.found.cd, fitted.shown.found.tpp):
                name = fit.model.structure.base
                making = runs, name, fitted.effects(fit), judging
                self._keep_base(fit, name, fitted.judged[fit], making)

    def _keep_base(self, fit: Fit, name: str, judged: Mapping[str, Any], making: shell.Making) -> None:
        """Keep a fit of runs, with what engineers ask of it."""
        self._keep_fit(
            fit,
            lambda: f"{name}.json",
            lambda folder: {**fit.to_json(folder), **judged},
            lambda path: shell.fit(*making, path),
            f"fitted {fit.model.structure.base_.label}",
        )

    def compare(self) -> None:
        """Where the current rung fails."""
        with self._working("comparing"):
            rung = self._rung()
            if rung.comparison is not None:
                return
            comparison, document, text = self._calculations.compare(rung, self._flown(rung.fit))
            floor = comparison.noise_floor_percent or rung.noise_floor_percent
            self._replace(rung.fit, comparison=comparison, comparison_text=text, noise_floor_percent=floor)
            self._keep_document("a comparison", rung.fit, document, shell.compare, "compared")

    def diagnose(self) -> None:
        """Which effect the current rung lacks."""
        with self._working("asking"):
            rung = self._rung()
            if rung.answer is not None:
                return
            with self._ranked(rung):
                diagnosis, document, told = self._calculations.diagnose(rung, self._flown(rung.fit))
                floor = dict(told.noise_floor_percent)
                self._replace(rung.fit, diagnosis=diagnosis, answer=told, noise_floor_percent=floor)
            last = diagnosis.last
            answer = last.verdict + (f" {last.effect}" if last.verdict == "missing" else "")
            self._set(said=f"{answer}, confidence {last.confidence:.2f}")
            self._keep_document("a diagnosis", rung.fit, document, shell.diagnose, f"asked: {answer}")

    def _keep_document(
        self, what: str, fit: Fit, document: Mapping[str, Any], command: Callable[[Fit, Path, Path], str], did: str
    ) -> None:
        """Keep what was asked of a fit, under the fit's name with an ending."""
        ending = ENDINGS[what]
        self._keeping.keep_file(
            ToKeep(
                what=what,
                name=lambda: f"{self._place(fit).stem}-{ending}.json",
                text=lambda _: document_text(document),
                command=lambda path: command(fit, self._place(fit), path),
                did=did,
            )
        )

    def add(self, effect: str) -> None:
        """One rung more: a catalogue id, or the path of the user's own effect file (its code runs)."""
        with self._working(f"adding {Path(effect).name}"):
            rung = self._rung()
            known = self._calculations.effect(rung.fit, effect)
            addition = self._calculations.add(rung, known, self._flown(rung.fit))
            place = str(self._places.get(rung.fit) or "FIT.json")
            with self._lock:
                rungs = self._state.ladder
                if not rungs or rungs[-1].fit is not rung.fit:
                    raise TippathError("the ladder was changed meanwhile: add it again")
                grown = Rung(
                    name="",
                    effect=effect,
                    fit=addition.after,
                    path=None,
                    noise_floor_percent=addition.noise_floor_percent,
                    addition=addition,
                )
                self._set(ladder=self._calculations.named([*rungs, grown]))
            self._keep_fit(
                addition.after,
                lambda: f"{self._place(rung.fit).stem}-{Path(effect).stem}.json",
                lambda folder: self._calculations.addition_document(addition, folder),
                lambda path: shell.add(rung.fit, self._place(rung.fit), effect, path),
                f"added {effect}",
            )
            written = self._places.get(addition.after)
            text, sentence = self._calculations.added(addition, place, written)
            self._replace(addition.after, addition_text=text)
            self._say_unless_unkept(sentence)

    def undo(self) -> None:
        """One rung back; files are kept."""
        with self._lock:
            if self._state.busy:
                raise TippathError(f"wait: {self._state.busy}")
            rungs = self._state.ladder
            if len(rungs) < 2:
                raise TippathError("this is the bottom of the ladder" if rungs else "no fit yet")
            self._set(
                ladder=self._calculations.named(rungs[:-1]), said=f"taken back: {rungs[-1].name}; its file is kept"
            )

    # ---------------------------------------------------------------------------------------------- what comes of it

    def next_card(self) -> Path:
        """Write the maneuver that the diagnosis proposes as a test card; where it was written."""
        rung = self._rung()
        if rung.answer is None:
            raise TippathError("not asked yet: the diagnosis says what would tell more")
        plan = rung.answer.plan
        text = None if plan is None else plan.card
        if plan is None or text is None:
            raise TippathError("no maneuver on a card would tell more")
        written: list[Path] = []

        def command(path: Path) -> str:
            written.append(path)
            self._set(card=path, said=f"wrote {path}: {plan.maneuver}")
            return shell.next_card(rung.fit, self._place(rung.fit), path)

        self._keeping.keep_file(
            ToKeep(
                what="a card",
                name=lambda: "next.toml",
                text=lambda _: text,
                command=command,
                did="wrote the card that would tell more",
            )
        )
        if not written:
            raise TippathError(self._state.said)
        return written[0]

    def report(self) -> None:
        """The self-contained page of fits, comparison, diagnosis, ladder and gains."""
        self._report(None)

    def report_for_paper(self) -> None:
        """That page, and the same as PDF beside it."""
        self._report(self._now())

    def _report(self, paper: datetime | None) -> None:
        with self._working("writing the report"):
            fits = self._to_report()
            if self._state.unkept:
                raise TippathError(f"not kept yet: {', '.join(self._state.unkept)}; a report is made of files")
            paths = [self._place(fit) for fit in fits]
            gains = None if self._state.designed is None else self._state.designed.path
            files = [path for fit in fits for path in shell.user_files(fit)]
            text, printed = self._calculations.report(paths, files, gains, paper)

            def command(path: Path) -> str:
                self._set(report=path, printed=None, said=f"wrote {path}")
                if printed is not None:
                    beside = path.with_suffix(".pdf")
                    write_whole(printed, beside)
                    self._set(printed=beside, said=f"wrote {path} and {beside.name}")
                return shell.report(fits, paths, gains, path, paper=printed is not None)

            self._keeping.keep_file(
                ToKeep(
                    what="the report",
                    name=lambda: "report.html",
                    text=lambda _: text,
                    command=command,
                    did="wrote the report",
                )
            )

    def keep_in(self, folder: Path) -> None:
        """Keep results in another folder from now on, those that are on the screen only as well."""
        self._keeping.folder()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise TippathError(f"{folder} cannot be made ({error.strerror or error}); choose another") from error
        with self._keeping.lock:
            self._set(home=folder, said=f"results are kept in {folder}")
            self._keeping.move(FlightFolder(folder))

    def audit(self, did: str, command: str | None = None) -> None:
        """Tell the flight's audit what was done elsewhere: gains that were pushed. Nothing where no flight is open."""
        if self._keeping.begun:
            self._keeping.audit(did, command)

    # ---------------------------------------------------------------------------------------------- what is where

    def _rung(self) -> Rung:
        self._keeping.folder()
        rung = self._state.current
        if rung is None:
            raise TippathError("no fit yet: fit the flight first")
        return rung

    def _records(self, choice: Choice) -> list[Record]:
        return self._calculations.used(self._state.runs, self._runs, choice)

    def _flown(self, fit: Fit) -> tuple[list[Record], list[Record], list[Record]]:
        return self._calculations.flown_by(fit, self._runs)

    def _to_design_on(self) -> Fit:
        fit = self._rung().fit
        if self._calculations.designs_on(fit):
            return fit
        if self._state.fitted is None:
            raise TippathError("gains are designed on a TPP: choose it as the base and fit")
        return self._state.fitted.found.tpp

    def _to_report(self) -> list[Fit]:
        """The ladder, and the other base beside it."""
        self._rung()
        found = [rung.fit for rung in self._state.ladder]
        fitted = self._state.fitted
        beside = [] if fitted is None else [one for one in (fitted.found.tpp, fitted.found.cd) if one not in found]
        return [*found, *beside]

    def _place(self, fit: Fit) -> Path:
        """Where a fit is kept. Raises TippathError where it is not."""
        path = self._places.get(fit)
        if path is None:
            raise TippathError("the fit it was made from is not kept yet")
        return path

    # ---------------------------------------------------------------------------------------------- keeping

    def _keep_fit(
        self,
        fit: Fit,
        name: Callable[[], str],
        document: Callable[[Path], Mapping[str, Any]],
        command: Callable[[Path], str],
        did: str,
    ) -> None:
        def placed(path: Path) -> str:
            self._places[fit] = path
            words = command(path)
            with self._lock:
                fitted = self._state.fitted
                if fitted is not None and fit in (fitted.found.tpp, fitted.found.cd):
                    where: dict[str, Any] = {"tpp_path" if fit is fitted.found.tpp else "cd_path": path}
                    self._set(fitted=replace(fitted, commands=(*fitted.commands, words), **where))
            self._replace(fit, path=path)
            return words

        self._keeping.keep_file(
            ToKeep(
                what=self._calculations.full_name(fit),
                name=name,
                text=lambda folder: document_text(document(folder)),
                command=placed,
                did=did,
            )
        )

    def _kept(self, unkept: tuple[str, ...], problem: str) -> None:
        self._set(unkept=unkept)
        if problem:
            self._set(said=f"{problem}; it stays on the screen until it is kept in another folder")

    def _did(self, command: str) -> None:
        with self._lock:
            if command not in self._state.commands[-1:]:
                self._set(commands=(*self._state.commands, command))
                self._on_command(command)


def _one_line(text: str) -> str:
    """What somebody typed, without anything that a terminal obeys."""
    return "".join(c if c.isprintable() else " " for c in text).strip()
