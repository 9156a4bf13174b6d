"""The desk: open a flight, choose its runs, fit, compare, diagnose, climb the ladder, design, report.

Headless: every step calls the function that its command calls, and appends that command. The state is replaced whole,
under a lock, when a step is over; a step that fails or is called off changes nothing. Results are written beside the
log, never over another one. Where the folder does not take them they stay in the state, and wait to be kept elsewhere.
"""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.desk.state import Base, Choice, Designed, DeskState, Fitted, Rung, TimedNote
from gcs.errors import TippathError, UsageError
from gcs.flight.folder import FlightFolder, flight_of, keep_text, stamp

if TYPE_CHECKING:  # they bring scipy along, which takes a second
    from gcs.desk.shelf import Shelf
    from gcs.logs import Run
    from sysid.data.record import Record
    from sysid.fit.result import Fit, RecordUsed

INPUT_COST = 5.0
"""The paper's, and that of `tippath design`."""


class Cancelled(TippathError):
    """The work was called off; nothing was changed."""


@dataclass(frozen=True)
class _Result:
    """Something to be written into the flight's folder."""

    what: str
    write: Callable[[FlightFolder], None]
    """Raises TippathError where the folder does not take it."""


class Desk:
    """One flight at a time. `state`, `use`, `choose_base`, `undo` and `cancel` never wait; the others do, and are
    called from a worker. All raise TippathError: what is wrong and what to do.
    """

    def __init__(
        self,
        *,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        on_command: Callable[[str], None] = lambda _: None,
        on_said: Callable[[str], None] = lambda _: None,
    ) -> None:
        """`on_command` is told every command as it is appended, `on_said` every last word; neither may wait."""
        self._now = now
        self._on_command = on_command
        self._on_said = on_said
        self._lock = threading.RLock()
        self._work = threading.Lock()
        self._writing = threading.RLock()
        self._cancelled = threading.Event()
        self._state = DeskState()
        self._runs: tuple[Run, ...] = ()
        self._folder: FlightFolder | None = None
        self._pending: list[_Result] = []
        self._places: dict[Fit, Path] = {}
        """Where the fits of this flight are kept."""

    def state(self) -> DeskState:
        """This moment."""
        return self._state

    def cancel(self) -> None:
        """Call off what is being worked on; it ends with `Cancelled` at its next step, and changes nothing."""
        with self._lock:
            if self._state.busy:
                self._cancelled.set()
                self._set(busy=f"calling off: {self._state.busy}")

    # ---------------------------------------------------------------------------------------------- the flight

    def open(self, word: str, *, wait: bool = False) -> None:
        """Open a flight folder or a log: read its runs, its name and notes, and the fits kept beside it.

        `wait`: until what is being worked on is over, instead of refusing. A flight whose results are not kept yet is
        not left.
        """
        from gcs.desk import choices, ladder, shelf, shell
        from gcs.logs import ingest
        from gcs.logs.words import printable

        path = Path(word).expanduser()
        if not path.exists():
            raise TippathError(f"{path}: no such folder or log")
        with self._working(f"reading {path.name}", wait=wait):
            if self._state.unkept:
                raise TippathError(
                    f"not kept yet: {', '.join(self._state.unkept)}; keep them in another folder before leaving "
                    f"{self._state.path}"
                )
            found = ingest(
                [path],
                progress=lambda one: self._step(
                    printable(one.path.name), one.done_bytes / one.total_bytes if one.total_bytes else None
                ),
            )
            folder = flight_of(path)
            self._step("looking for fits")
            records = [one for run in found.runs if (one := choices.record_of(run)) is not None]
            kept = shelf.look(folder.path, records)
            rows = choices.rows_of(found.runs, folder)
            base = choices.default_base(found.runs)
            if kept.ladder:
                rows = choices.as_fitted(rows, found.runs, kept.ladder[0].fit)
                base = choices.base_of(kept.ladder[0].fit)
            fitted = self._fitted_before(kept, records)
            unread = [*found.refused.values(), *(f"{Path(p).name}: {d.describe()}" for p, d in found.damage.items())]
            self._step("")
            with self._writing, self._lock:
                self._runs, self._folder, self._pending = found.runs, folder, []
                self._places = {one.fit: one.path for one in (*kept.ladder, kept.tpp, kept.cd) if one is not None}
                self._state = DeskState(
                    path,
                    folder.path,
                    printable(folder.name),
                    tuple(TimedNote(printable(time), printable(text)) for time, text in folder.notes()),
                    choices.vehicle_words(folder),
                    rows,
                    (*map(printable, unread), *kept.unread),
                    base,
                    fitted,
                    ladder.named([Rung("", None, one.fit, one.path) for one in kept.ladder]),
                    busy=self._state.busy,
                )
            self._did(shell.words(["tippath", "ingest", path]))

    def _fitted_before(self, kept: Shelf, records: Sequence[Record]) -> Fitted | None:
        """The tables of the fits that were kept; None where one of the two is missing."""
        from gcs.analysis.fits import side_by_side
        from gcs.desk import ladder
        from sysid.errors import SysidError

        if kept.tpp is None or kept.cd is None or _own_reading(kept.tpp.fit):
            return None
        try:
            fit = kept.tpp.fit
            found = side_by_side(fit, kept.cd.fit, _of(fit.records, records), _of(fit.validation, records))
        except (SysidError, TippathError):
            return None
        return ladder.tables(found, (kept.tpp.path, kept.cd.path))

    def rename(self, text: str) -> None:
        """Give the flight a name."""
        name = _one_line(text)
        with self._writing:
            self._opened()
            self._set(name=name)
            self._keep("the flight's name", lambda folder: folder.rename(name))
            self._audit(f"named {name}" if name else "the name was removed")

    def note(self, text: str) -> None:
        """Write something down, with the time."""
        said = _one_line(text)
        with self._writing:
            self._opened()
            if not said:
                raise TippathError("an empty note is none")
            time = self._now()
            with self._lock:
                self._set(notes=(*self._state.notes, TimedNote(stamp(time), said)))
            self._keep("a note", lambda folder: folder.note(time, said))

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
        from sysid.data.record import CHANNELS
        from sysid.model.bases import compose
        from sysid.model.effect import EffectError

        if model not in ("tpp", "cd"):
            raise UsageError(f"{model}: there are tpp and cd")
        try:
            compose(model, effects, CHANNELS, {"Omega_0": 1.0, "V_0": 1.0})
        except EffectError as error:
            raise UsageError(str(error)) from error
        self._set(base=Base(model, tuple(effects)))

    # ---------------------------------------------------------------------------------------------- fit and ladder

    def fit(self) -> None:
        """Fit TPP, CD and the CD that the TPP reduces to; the ladder begins anew with the base that was chosen."""
        from gcs.analysis.fits import assess, identify_flight, on_cd
        from gcs.desk import ladder

        with self._working("fitting"):
            self._opened()
            rows, base = self._state.runs, self._state.base
            records, validation = self._records(Choice.FIT), self._records(Choice.VALIDATE)
            if not records:
                raise TippathError("no run is chosen to be fitted: leave at least a roll and a pitch chirp to the fit")
            self._step("TPP and CD")
            found = identify_flight(records, validation, effects=base.effects)
            self._step("judging them", 0.5)
            judged = {one: assess(one, records).to_json() for one in (found.tpp, found.cd)}
            self._step("", 0.9)
            bottom = found.tpp if base.model == "tpp" else found.cd
            with self._lock:
                self._set(
                    fitted=ladder.tables(found),
                    ladder=ladder.named([Rung("", None, bottom, None)]),
                    said=f"fitted to {len(records)} runs",
                )
            chosen = [[row.word for row in rows if row.choice is one] for one in (Choice.FIT, Choice.VALIDATE)]
            for name, one in (("cd", found.cd), ("tpp", found.tpp)):
                effects = base.effects if name == "tpp" else tuple(on_cd(base.effects))
                self._keep_base(one, name, judged[one], (chosen[0], effects, chosen[1]))

    def _keep_base(
        self, fit: Fit, name: str, judged: Mapping[str, Any], made: tuple[Sequence[str], Sequence[str], Sequence[str]]
    ) -> None:
        """Keep a fit of runs, with effects, judged on others: `made` has the words for all three."""
        from gcs.desk import shell

        runs, effects, validation = made
        self._keep_fit(
            fit,
            lambda: f"{name}.json",
            lambda folder: {**fit.to_json(folder), **judged},
            lambda path: shell.fit(runs, name, effects, validation, path),
            f"fitted {name.upper()}",
        )

    def compare(self) -> None:
        """Where the current rung fails."""
        from gcs.analysis.comparison import compare_text
        from gcs.desk import shell
        from sysid.compare.compare import compare

        with self._working("comparing"):
            rung = self._rung()
            if rung.comparison is not None:
                return
            self._step(rung.name)
            records, _, quiet = self._flown(rung.fit)
            found = compare(rung.fit.model, records, rung.fit.band_hz, quiet)
            text = compare_text(found, rung.fit)
            self._step("")
            floor = found.noise_floor_percent or rung.noise_floor_percent
            self._replace(rung.fit, comparison=found, comparison_text=text, noise_floor_percent=floor)
            self._keep_text(
                "a comparison",
                lambda: f"{self._place(rung.fit).stem}-compare.json",
                lambda _: _document(found.to_json()),
                lambda path: shell.compare(rung.fit, self._place(rung.fit), path),
                "compared",
            )

    def diagnose(self) -> None:
        """Which effect the current rung lacks."""
        from gcs.analysis.diagnosis import diagnose_fit
        from gcs.analysis.diagnosis_text import diagnosis_text
        from gcs.desk import shell

        with self._working("asking"):
            rung = self._rung()
            if rung.diagnosis is not None:
                return
            records, validation, quiet = self._flown(rung.fit)
            self._step(rung.name)
            found = diagnose_fit(rung.fit, records, validation, quiet, say=self._step)
            place = self._places.get(rung.fit)
            text = diagnosis_text(found, str(place or "FIT.json"), shell.words(shell.named(rung.fit)))
            self._step("")
            floor = {key: float(value) for key, value in found.last.noise_floor_percent.items()}
            self._replace(rung.fit, diagnosis=found, diagnosis_text=text, noise_floor_percent=floor)
            answer = found.last.verdict + (f" {found.last.effect}" if found.last.verdict == "missing" else "")
            self._set(said=f"{answer}, confidence {found.last.confidence:.2f}")
            self._keep_text(
                "a diagnosis",
                lambda: f"{self._place(rung.fit).stem}-diagnosis.json",
                lambda _: _document(found.to_json()),
                lambda path: shell.diagnose(rung.fit, self._place(rung.fit), path),
                f"asked: {answer}",
            )

    def add(self, effect: str) -> None:
        """One rung more: a catalogue id, or the path of the user's own effect file (its code runs)."""
        from gcs.analysis.diagnosis import add_effect
        from gcs.analysis.diagnosis_text import addition_text
        from gcs.desk import ladder, shell

        with self._working(f"adding {Path(effect).name}"):
            rung = self._rung()
            one = ladder.effect_to_add(rung.fit, effect)
            records, validation, _ = self._flown(rung.fit)
            self._step(rung.name)
            found = add_effect(rung.fit, one, records, validation, say=self._step)
            place = self._places.get(rung.fit)
            self._step("writing")
            with self._lock:
                rungs = self._state.ladder
                if not rungs or rungs[-1].fit is not rung.fit:
                    raise TippathError("the ladder was changed meanwhile: add it again")
                added = Rung("", effect, found.after, None, found.noise_floor_percent, found)
                self._set(ladder=ladder.named([*rungs, added]))
            self._keep_fit(
                found.after,
                lambda: f"{self._place(rung.fit).stem}-{Path(effect).stem}.json",
                found.to_json,
                lambda path: shell.add(rung.fit, self._place(rung.fit), effect, path),
                f"added {effect}",
            )
            written = self._places.get(found.after)
            text = addition_text(found, str(place or "FIT.json"), None if written is None else str(written))
            self._replace(found.after, addition_text=text)
            self._say_unless_unkept(text.partition("\n\n")[0].replace("\n ", ""))

    def undo(self) -> None:
        """One rung back; files are kept."""
        from gcs.desk import ladder

        with self._lock:
            if self._state.busy:
                raise TippathError(f"wait: {self._state.busy}")
            rungs = self._state.ladder
            if len(rungs) < 2:
                raise TippathError("this is the bottom of the ladder" if rungs else "no fit yet")
            self._set(ladder=ladder.named(rungs[:-1]), said=f"taken back: {rungs[-1].name}; its file is kept")

    # ---------------------------------------------------------------------------------------------- what comes of it

    def design(self, input_cost: float = INPUT_COST) -> None:
        """LQR gains on the current rung (on the fitted TPP where the ladder is of CD), kept as GAINS.json."""
        from gcs.analysis.fits import gains_text
        from gcs.desk import ladder, shell
        from gcs.flight.gains import gains_of
        from sysid.control.loop import following
        from sysid.control.regulator import design

        if not 0 < input_cost < float("inf"):
            raise UsageError("the input cost wants a positive number; the paper's is 5")
        with self._working("designing gains"):
            fit = self._to_design_on()
            self._step("")
            gains = design(self._as_read(fit).model, input_cost)
            document = gains.to_json()
            self._step("the predicted answer", 0.5)
            answer = following(gains, fit.model)
            self._step("")
            name = ladder.full_name(fit)
            made = Designed(gains_text(gains), None, gains_of(document).crc, "", name, gains, answer)
            self._set(designed=made, said="gains designed")

            def command(path: Path) -> str:
                cost = None if input_cost == INPUT_COST else float(input_cost)
                said = shell.design(fit, self._place(fit), cost, path)
                with self._lock:
                    if self._state.designed is made:
                        self._set(designed=replace(made, path=path, command=said))
                return said

            self._keep_text(
                "gains", lambda: "gains.json", lambda _: _document(document), command, f"designed gains on {name}"
            )

    def next_card(self) -> Path:
        """Write the maneuver that the diagnosis proposes as a test card; where it was written."""
        from gcs.desk import shell

        rung = self._rung()
        found = rung.diagnosis
        if found is None:
            raise TippathError("not asked yet: the diagnosis says what would tell more")
        text = None if found.next is None else found.next.toml
        if text is None:
            raise TippathError("no maneuver on a card would tell more")
        self._keep_text(
            "a card",
            lambda: "next.toml",
            lambda _: text,
            lambda path: shell.next_card(rung.fit, self._place(rung.fit), self._card(path)),
            "wrote the card that would tell more",
        )
        if self._state.card is None or "a card" in self._state.unkept:
            raise TippathError(self._state.said)
        return self._state.card

    def _card(self, path: Path) -> Path:
        self._set(card=path)
        return path

    def report(self) -> None:
        """The self-contained page of fits, comparison, diagnosis, ladder and gains."""
        from gcs.analysis.report import flight_report
        from gcs.desk import shell

        with self._working("writing the report"):
            fits = self._to_report()
            if self._state.unkept:
                raise TippathError(f"not kept yet: {', '.join(self._state.unkept)}; a report is made of files")
            paths = [self._place(fit) for fit in fits]
            designed = self._state.designed
            gains = None if designed is None else designed.path
            files = [path for fit in fits for path in shell.user_files(fit)]
            text = flight_report(paths, files, gains, say=self._step)
            self._step("writing")

            def command(path: Path) -> str:
                self._set(report=path, said=f"wrote {path}")
                return shell.report(fits, paths, gains, path)

            self._keep_text("the report", lambda: "report.html", lambda _: text, command, "wrote the report")

    def keep_in(self, folder: Path) -> None:
        """Keep results in another folder from now on, those that are on the screen only as well."""
        self._opened()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise TippathError(f"{folder} cannot be made ({error.strerror or error}); choose another") from error
        with self._writing:
            self._folder = FlightFolder(folder)
            self._set(home=folder, said=f"results are kept in {folder}")
            self._flush()

    def audit(self, did: str, command: str | None = None) -> None:
        """Tell the flight's audit what was done elsewhere: gains that were pushed. Nothing where no flight is open."""
        if self._folder is not None:
            self._audit(did, command)

    # ---------------------------------------------------------------------------------------------- what is where

    def _opened(self) -> FlightFolder:
        if self._folder is None:
            raise TippathError("no flight yet: fly a card, or open a flight folder or a log")
        return self._folder

    def _rung(self) -> Rung:
        self._opened()
        rung = self._state.current
        if rung is None:
            raise TippathError("no fit yet: fit the flight first")
        return rung

    def _records(self, choice: Choice) -> list[Record]:
        """Of the runs that are used so, in their order."""
        from gcs.desk.choices import record_of
        from gcs.logs import check_same_rate_source

        found = []
        for row, run in zip(self._state.runs, self._runs, strict=True):
            record = record_of(run) if row.choice is choice else None
            if record is not None:
                found.append(record)
        check_same_rate_source(found)
        return found

    def _flown(self, fit: Fit) -> tuple[list[Record], list[Record], list[Record]]:
        """The runs that a fit was made from, those that judged it, and quiet hover, as its command would read them."""
        from gcs.analysis.comparison import quiet_among
        from gcs.analysis.diagnosis import flown_with_validation
        from gcs.desk.choices import record_of

        if _own_reading(fit):
            return flown_with_validation(fit, (), (), None, None)
        known = [one for run in self._runs if (one := record_of(run)) is not None]
        records = _of(fit.records, known)
        return records, _of(fit.validation, known), quiet_among(self._runs, fit, records)

    def _to_design_on(self) -> Fit:
        fit = self._rung().fit
        if fit.model.structure.base == "tpp":
            return fit
        if self._state.fitted is None:
            raise TippathError("gains are designed on a TPP: choose it as the base and fit")
        return self._state.fitted.found.tpp

    def _as_read(self, fit: Fit) -> Fit:
        """A kept fit with the paths of the user's effects as a command finds them in its file."""
        from gcs.desk import shell
        from sysid.fit.result import Fit

        files = shell.user_files(fit)
        return Fit.load(self._places[fit], files) if files and fit in self._places else fit

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

    def _keep(self, what: str, write: Callable[[FlightFolder], None]) -> None:
        with self._writing:
            self._pending.append(_Result(what, write))
            self._flush()

    def _flush(self) -> None:
        """Write what waits, in order; what the folder does not take waits on."""
        folder = self._opened()
        left, problem = [], ""
        for one in self._pending:
            try:
                one.write(folder)
            except TippathError as error:
                left.append(one)
                problem = problem or str(error)
        self._pending = left
        unkept = tuple(dict.fromkeys(one.what for one in left if one.what))
        self._set(unkept=unkept)
        if problem:
            self._set(said=f"{problem}; it stays on the screen until it is kept in another folder")

    def _keep_text(
        self,
        what: str,
        name: Callable[[], str],
        text: Callable[[Path], str],
        command: Callable[[Path], str],
        did: str,
    ) -> None:
        def write(folder: FlightFolder) -> None:
            path = keep_text(text(folder.path), folder.path / name())
            said = command(path)
            self._did(said)
            self._audit(did, said)

        self._keep(what, write)

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
            said = command(path)
            with self._lock:
                fitted = self._state.fitted
                if fitted is not None and fit in (fitted.found.tpp, fitted.found.cd):
                    where: dict[str, Any] = {"tpp_path" if fit is fitted.found.tpp else "cd_path": path}
                    self._set(fitted=replace(fitted, commands=(*fitted.commands, said), **where))
            self._replace(fit, path=path)
            return said

        from gcs.desk import ladder

        self._keep_text(ladder.full_name(fit), name, lambda folder: _document(document(folder)), placed, did)

    def _audit(self, did: str, command: str | None = None) -> None:
        time = self._now()

        def write(folder: FlightFolder) -> None:
            folder.audit(time, did, command, by="app")

        with self._writing:
            folder = self._opened()
            try:
                write(folder)
            except TippathError:
                self._pending.append(_Result("", write))

    def _did(self, command: str) -> None:
        with self._lock:
            if command not in self._state.commands[-1:]:
                self._set(commands=(*self._state.commands, command))
                self._on_command(command)

    # ---------------------------------------------------------------------------------------------- small things

    def _set(self, **changes: Any) -> None:
        with self._lock:
            self._state = replace(self._state, **changes)
            if changes.get("said"):
                self._on_said(changes["said"])

    def _replace(self, fit: Fit, **changes: Any) -> None:
        """Change the rung of a fit, where it is still on the ladder."""
        with self._lock:
            rungs = self._state.ladder
            self._set(ladder=tuple(replace(one, **changes) if one.fit is fit else one for one in rungs))

    def _say_unless_unkept(self, text: str) -> None:
        with self._lock:
            if not self._state.unkept:
                self._set(said=text)

    def _step(self, what: str, share: float | None = None) -> None:
        """Tell how far the work is; raises Cancelled where it was called off."""
        if self._cancelled.is_set():
            raise Cancelled(f"called off: {self._doing}; nothing was changed")
        self._set(busy=f"{self._doing}: {what}" if what else self._doing, progress=share)

    @contextlib.contextmanager
    def _working(self, what: str, *, wait: bool = False) -> Iterator[None]:
        """One thing at a time; what the mathematics refuses is told as the data's word."""
        from sysid.errors import SysidError

        if not self._work.acquire(blocking=wait):
            raise TippathError(f"wait: {self._state.busy or 'something else is being worked on'}")
        try:
            self._doing = what
            with self._lock:
                self._cancelled.clear()
                self._set(busy=what, progress=None, said="")
            yield
        except SysidError as error:
            raise TippathError(str(error)) from error
        except Cancelled as end:
            self._set(said=str(end))
            raise
        finally:
            self._set(busy="", progress=None)
            self._work.release()


def _document(document: Mapping[str, Any]) -> str:
    """As commands write and print it."""
    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _one_line(text: str) -> str:
    """What somebody typed, without anything that a terminal obeys."""
    return "".join(c if c.isprintable() else " " for c in text).strip()


def _own_reading(fit: Fit) -> bool:
    """Whether a fit reads its logs in another way than the desk does."""
    from sysid.data.preprocess import DEFAULT_BAND_HZ

    return fit.profile is not None or fit.window_s is not None or fit.band_hz[1] != DEFAULT_BAND_HZ[1]


def _of(used: Sequence[RecordUsed], records: Sequence[Record]) -> list[Record]:
    """The records that a fit names. Raises TippathError where one is not among them."""
    known = {(Path(one.path).resolve(), one.id, one.sha256): one for one in records}
    found = []
    for one in used:
        record = known.get((Path(one.path).resolve(), one.id, one.sha256))
        if record is None:
            raise TippathError(f"{one.id} is not a run of this flight, or its log has changed: fit again")
        found.append(record)
    return found
