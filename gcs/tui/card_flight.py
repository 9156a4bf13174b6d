"""A card flown from the app: in a thread of its own, run by run, each made ready and then started by a key.

The flying itself is `gcs.flight.sweep.fly_card`, as behind the command. While a run waits for its start, a change of
mode, a disarmed vehicle or a lost link calls the card off, so that nothing starts later that nobody looks at any more.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from gcs.cards.maneuver import CardRun, TestCard, load_card
from gcs.desk.shell import word
from gcs.errors import TippathError
from gcs.flight.excitation import abort
from gcs.flight.flown_card import Briefing, SweepResult
from gcs.flight.flyable import free_bytes
from gcs.flight.folder import create
from gcs.flight.order import AGAIN
from gcs.flight.preflight import Check
from gcs.flight.prepare import Prepared, prepared
from gcs.flight.probe import result_words
from gcs.flight.resume import Earlier, offered, unfinished
from gcs.flight.run import Note, Probed, Progress, RunProgress, RunReady, RunResult
from gcs.flight.run_state import Ending, Phase
from gcs.flight.session import Session
from gcs.flight.sweep import fly_card
from gcs.tui import state as view
from gcs.tui.asked_card import SHOWN_FIRST, AskedCard, asked_card
from gcs.tui.card_views import BEFORE, flown_before, outcome, progress_view, unlocked, view_of, views
from gcs.tui.logbook import Logbook
from gcs.tui.moment import Moment
from gcs.tui.so_far import FitsSoFar
from gcs.tui.state import Mark, Stage, tells_both_axes
from gcs.tui.vehicle_link import VehicleLink
from gcs.vehicle.autopilots import SYSTEMID
from gcs.vehicle.profile import CannotFlyError, VehicleProfile, load_profile
from gcs.vehicle.snapshot import VehicleSnapshot

TOO_EARLY = "not yet: a run is under way"
S_EARLY = "S came too early, nothing starts by it: the vehicle is looked at; S once more when READY stands here"
R_TAKEN = "R is taken: the run is made ready as soon as the vehicle was looked at"
CLOSED, ENDED, BY_HAND = "the app was closed", "the card was ended here", "F12 or space in the app"
SENT_BLIND = "sent unheard until it is heard: the maneuver's size to 0; it may not arrive, and the mode is the pilot's"
LOOKS = 10
"""A run that waits is looked at again every so many tenths of a second."""


class CardFlight:
    """`ready`, `start`, `choose_run`, `end_card` and `abort` only set a wish, and never wait."""

    def __init__(
        self,
        moment: Moment,
        link: VehicleLink,
        card: str,
        *,
        folder: Path,
        profile: str | None = None,
        probe: bool,
        on_landed: Callable[[Path], None],
    ) -> None:
        """`profile` is the vehicle's, where it is not to be recognised. `on_landed` hears, in a thread of its own, of
        the folder of every flight that was recorded."""
        self._moment = moment
        self._link = link
        self._folder = folder
        self._probe = probe
        self._on_landed = on_landed
        self._profile_word = profile
        self._profiles = () if profile is None else (load_profile(profile),)
        self._asked = asked_card(card)
        self._card = load_card(self._asked.card or SHOWN_FIRST)
        moment.set(card=self._card.name, runs=views(self._card), limits=self._card.limits)
        self.logbook = Logbook(moment, lambda: datetime.now(UTC))
        self.logbook.ask(self._card)
        self._abort: str | None = None
        self._blind = False
        self._started = False
        self._ready_wished = False
        """R came while the vehicle was still looked at."""
        self._wish: int | None = None
        """Number of the run that is wished for in place of the one that waits;"""
        self._changed = False
        """and that it is another one: it wants its own R."""
        self._planned: tuple[CardRun, ...] = ()
        self._flown: list[RunResult] = []
        self._notes: list[str] = []
        """Told while a card is flown, and once more when it is over."""
        self._seen: Callable[[], tuple[Check, ...]] | None = None
        """The checks as they stand, of the card that is flown."""
        self._flying: threading.Thread | None = None
        self._earlier: Earlier | None = None
        """Of the flight that goes on, once it does."""
        self._so_far = FitsSoFar(lambda words: moment.set(so_far=words))
        threading.Thread(target=self._look_for_unfinished, name="tippath unfinished", daemon=True).start()

    @property
    def card(self) -> TestCard:
        """The one that is flown next."""
        return self._card

    @property
    def profiles(self) -> tuple[VehicleProfile, ...]:
        """The vehicle's, where it is not to be recognised."""
        return self._profiles

    # What keys wish.

    def ready(self) -> None:
        """Make the next run ready: begin the card, or go on with it. Nothing moves."""
        with self._moment.pressed:
            stage = self._moment.now.stage
            if stage is Stage.HELD:
                self._moment.set(stage=Stage.READY, said="", rpm_reference=self._link.rpm())
                self._moment.mark(self._moment.now.current, Mark.READY)
            elif stage is Stage.IDLE and self._moment.now.unanswered is not None:
                self._moment.set(said="the card's checklist is not answered yet: H")
            elif stage is Stage.IDLE and not self._busy():
                self._begin()
            elif stage is Stage.NO_VEHICLE:
                self._moment.set(said="there is no vehicle")
            elif stage is Stage.CHECKING and self._moment.now.progress is None:
                self._ready_wished = True
                self._moment.set(said=R_TAKEN)
            elif stage is not Stage.READY:
                self._moment.set(said=TOO_EARLY)

    def start(self) -> None:
        """Start the run that is ready."""
        with self._moment.pressed:
            if self._moment.now.stage is Stage.READY:
                self._started = True
                self._moment.pressed.notify_all()
            elif not self._moment.now.stage.under_way:
                self._moment.set(said="nothing is ready: R first, then S")
            elif self._moment.now.stage is Stage.HELD:
                self._moment.set(said="not ready: R first, then S")
            else:
                self._moment.set(said=S_EARLY if self._moment.now.stage is Stage.CHECKING else TOO_EARLY)

    def choose_run(self, number: int) -> None:
        """Another run is the next, flown before or not; it waits for R and S like any other."""
        with self._moment.pressed:
            now = self._moment.now
            if now.stage in (Stage.HELD, Stage.READY) and number != now.current:
                self._wish = number
                self._changed = True
                self._moment.set(stage=Stage.HELD, said="")
                self._moment.pressed.notify_all()
            elif now.stage not in (Stage.HELD, Stage.READY):
                self._moment.set(said="a run is chosen between two runs of a card")

    def end_card(self) -> None:
        """Between two runs: fly no further."""
        with self._moment.pressed:
            if self._moment.now.stage in (Stage.HELD, Stage.READY):
                self._abort = ENDED
                self._moment.pressed.notify_all()
            elif self._moment.now.stage is Stage.FLYING:
                self._moment.set(said="a run is flying: F12 aborts it")

    def abort(self) -> None:
        """End what is excited; call off what is ready."""
        with self._moment.pressed:
            stage = self._moment.now.stage
            if stage is Stage.READY:
                self._started = False  # also a start that the card has not seen yet
                self._moment.set(stage=Stage.HELD, said="called off: nothing was started")
                self._moment.mark(self._moment.now.current, Mark.NEXT)
            elif stage is Stage.FLYING:
                self._abort = BY_HAND
                self._moment.set(stage=Stage.ABORTING)
                self._moment.pressed.notify_all()
            elif stage is Stage.CHECKING:
                self._abort = BY_HAND
                self._moment.pressed.notify_all()
            elif stage is Stage.IDLE and self._excited_by_another():
                threading.Thread(target=self._end_excitation, name="tippath abort", daemon=True).start()
            elif stage is not Stage.ABORTING:
                self._moment.set(said="nothing to abort: no maneuver is running")
            elif (vehicle := self._link.snapshot()) is not None and vehicle.lost:
                self._blind = True
                self._moment.set(said=SENT_BLIND)

    def _excited_by_another(self) -> bool:
        vehicle = self._link.snapshot()
        return vehicle is not None and vehicle.mode == SYSTEMID

    def _end_excitation(self) -> None:
        session = self._link.session
        if session is None:
            return
        with contextlib.suppress(TippathError):
            result = abort(session, self._link.mode_before)
            self._moment.set(said=f"the mode is {result.mode_after}" if result.ended else result.reason)

    def choose(self, card_word: str) -> None:
        """Another card, by its file or the name of a bundled one, with `--leave-out` and `--log card` behind it where
        they are wanted; or `--resume` and the folder of a flight that is to go on. Raises TippathError."""
        asked = asked_card(card_word)
        earlier = _to_go_on(asked)
        card = load_card(asked.card or SHOWN_FIRST) if earlier is None else earlier.card
        with self._moment.lock:
            if self._moment.now.stage.under_way:
                raise TippathError("a card is being flown: end it first (E)")
            self._card, self._asked = card, asked
            self._so_far.forget()
            self.logbook.ask(card)
            self._moment.set(
                card=card.name,
                runs=views(card, earlier),
                current=0,
                use=None,
                said=card.description if earlier is None else f"{earlier.folder.path.name}: {earlier.words}",
                checks=(),
                limits=card.limits,
            )

    def close(self, within_s: float) -> None:
        """Bring a run under way to its end, and wait for that."""
        with self._moment.pressed:
            self._abort = self._abort or CLOSED
            self._moment.pressed.notify_all()
        self._so_far.close()
        if self._flying is not None:
            self._flying.join(within_s)

    # Between two runs, as `gcs.flight.order` asks.

    def chosen(self) -> int | None:
        """The run that is wished for."""
        with self._moment.lock:
            wish, self._wish = self._wish, None
            return wish

    def again(self, result: RunResult) -> bool:
        """A run that was aborted, by hand or at a limit, may be flown again: nothing of it resumes by itself."""
        with self._moment.pressed:
            if result.verdict is None or self._abort not in (None, BY_HAND) or self._link.ending.is_set():
                return False
            self._abort, self._blind = None, False
            return True

    def blind(self) -> bool:
        """F12 was pressed once more while the link was lost in a run."""
        return self._blind

    # The card's own thread.

    def _busy(self) -> bool:
        return self._flying is not None and self._flying.is_alive()

    def _begin(self) -> None:
        session = self._link.session
        assert session is not None
        self._abort, self._wish = None, None
        self._started = self._ready_wished = self._changed = self._blind = False
        self._notes.clear()
        self._flown.clear()
        self._so_far.forget()
        self._moment.set(
            stage=Stage.CHECKING, runs=views(self._card), current=1, progress=None, use=None, checks=(), said=""
        )
        self._flying = threading.Thread(
            target=self._fly, args=(session, self._card, self._asked), name="tippath card", daemon=True
        )
        self._flying.start()

    def _fly(self, session: Session, card: TestCard, asked: AskedCard) -> None:
        words, landed = "", None
        try:
            earlier = self._earlier = _to_go_on(asked)
            if earlier is not None:
                asked = replace(asked, log=earlier.log)
            ready = prepared(
                session,
                card if asked.card or earlier is not None else None,
                profiles=self._profiles,
                consent=lambda _: asked.leave_out,
                otherwise=card,
                log=asked.log,
                link=session.link,
            )
            self._take(ready)
            if not asked.card and not asked.resume and not ready.own:
                asked = replace(asked, card=SHOWN_FIRST)
            folder = create(None, self._folder) if earlier is None else earlier.folder
            self._moment.set(flight=folder.path)
            result = fly_card(
                session,
                ready.card,
                ready.profile,
                folder=folder,
                confirm=self._briefed,
                on_progress=self._progressed,
                aborted=lambda: self._abort,
                about={"command": "fly", "link": session.link, **self.logbook.document()},
                probe=self._probe and asked.log == "stream",
                log=asked.log,
                left_out=ready.left_out,
                earlier=earlier,
                choosing=self,
            )
            words = self._landed(result, asked)
            landed = result.folder.path if result.recording is not None and result.recording.logs else None
        except CannotFlyError as error:
            words = f"{error} (C, and --leave-out behind the card)"
        except TippathError as error:
            words = str(error)
        except Exception as error:  # a fault of ours must neither hide nor end the app in flight
            words = f"the card stopped on a fault: {type(error).__name__}: {error}"
        finally:
            self._over(words)
            self._look_for_unfinished()
            if landed is not None and not self._link.ending.is_set():
                threading.Thread(target=self._on_landed, args=(landed,), name="tippath runs", daemon=True).start()

    def _look_for_unfinished(self) -> None:
        """Whether something is left of the newest flight, to be offered."""
        earlier = offered(self._folder)
        if earlier is None:
            self._moment.set(unfinished=None, left="")
        else:
            self._moment.set(unfinished=earlier.folder.path, left=earlier.words)

    def _over(self, words: str) -> None:
        with self._moment.lock:
            for run in self._moment.now.runs:
                if run.mark in (Mark.WAITING, Mark.NEXT, Mark.READY, Mark.FLYING):
                    self._moment.mark(run.number, Mark.SKIPPED)
            stage = Stage.IDLE if self._link.session is not None else Stage.NO_VEHICLE
            self._moment.set(stage=stage, current=0, progress=None, use=None, said=words, rpm_reference=None)
            self.logbook.ask(self._card)

    def _take(self, ready: Prepared) -> None:
        """The card as this vehicle flies it, where that is not the one shown."""
        with self._moment.lock:
            if ready.card is not self._card:
                self._moment.set(card=ready.card.name, runs=views(ready.card), limits=ready.card.limits)
        if ready.left_out:
            self._notes.append(f"left out: {'; '.join(ready.left_out)}")

    def _landed(self, result: SweepResult, asked: AskedCard) -> str:
        where = word(result.folder.path)
        link = self._link.shell_words
        vehicle = "" if self._profile_word is None else f" --vehicle-profile {word(self._profile_word)}"
        into = "" if asked.resume else f" -o {where}"
        command = f"tippath sweep --connect {link}{vehicle} {asked.options}{into}"
        self._link.did(command)
        with contextlib.suppress(TippathError):  # a disk that is full was told of by the recording
            result.folder.audit(datetime.now(UTC), "flew a card", command, by="app")
        done = "flown" if result.log == "card" else "kept"
        text = f"recorded {where}: {result.kept} of {result.planned} runs {done}, {result.missing_words}"
        return "; ".join([text, *([result.stopped] if result.stopped else []), *self._notes, *result.problems])

    def _briefed(self, briefing: Briefing) -> bool:
        probes = sum(run.probe for run, _ in briefing.plans)
        flown = () if self._earlier is None else flown_before(self._earlier, probes)
        left = (view_of(run, {one.number for one in flown}) for run, _ in briefing.plans)
        runs = tuple(sorted((*flown, *left), key=lambda run: run.number))
        self._seen, self._planned = briefing.seen, tuple(run for run, _ in briefing.plans)
        if self._moment.now.flight is not None:
            with contextlib.suppress(TippathError):  # a disk that takes no note is told of by the recording
                self.logbook.begun(self._moment.now.flight)
        self._moment.set(checks=tuple(briefing.checks), link_loss=briefing.link_loss.words, runs=runs)
        return self._abort is None

    def _progressed(self, progress: Progress) -> None:
        match progress:
            case RunReady():
                self._wait_for_start(progress)
            case RunProgress():
                self._show(progress)
            case RunResult():
                self._judged(progress)
            case Probed():
                self._moment.set(said=f"probe: {'; '.join(result_words(progress.result))}")
            case Note():
                self._notes.append(progress.words)
                self._moment.set(said=progress.words)

    def _wait_for_start(self, ready: RunReady) -> None:
        """Wait until this run was made ready and started, or called off, or another is wished for."""
        session = self._link.session
        assert session is not None
        number = ready.run.number
        with self._moment.pressed:
            runs = self._moment.now.runs
            before = next(run for run in runs if run.number == number)
            flown = any(run.mark in (Mark.KEEP, Mark.AGAIN) and run.why != (BEFORE,) for run in runs)
            held = (flown or self._changed) and not self._ready_wished
            self._started = self._ready_wished = self._changed = False
            self._moment.set(
                stage=Stage.HELD if held else Stage.READY,
                current=number,
                progress=view.Progress(0.0, ready.run.maneuver.duration_s, None, ready.plan.words),
                use=None,
                rpm_reference=self._link.rpm(),
                disk_free=None if self._moment.now.flight is None else free_bytes(self._moment.now.flight),
            )
            self._moment.mark(number, Mark.NEXT if held else Mark.READY)
            if self._moment.now.said in (TOO_EARLY, R_TAKEN, S_EARLY):
                self._moment.set(said="")
            mode, looked = session.snapshot().mode, 0
            while not self._started and self._abort is None and self._wish is None:
                self._moment.pressed.wait(0.1)
                looked += 1
                if looked % LOOKS == 0:
                    self._look_again()
                self._abort = self._abort or self._called_off(session.snapshot(), mode)
            if self._wish is not None or self._abort is not None:
                self._moment.mark(number, before.mark, before.why)
            else:
                self._moment.set(stage=Stage.FLYING, said="", use=None)
                self._moment.mark(number, Mark.FLYING, ())

    def _look_again(self) -> None:
        """Show the checks as they stand now, not as they were when the card began."""
        checks = () if self._seen is None else self._seen()
        if checks:
            self._moment.set(checks=checks)

    def _called_off(self, vehicle: VehicleSnapshot, mode: int) -> str | None:
        if self._link.ending.is_set():
            return CLOSED
        if vehicle.lost:
            return "the link was lost while a run waited for its start"
        if not vehicle.armed:
            return "the vehicle was disarmed while a run waited for its start"
        if vehicle.mode != mode:
            return f"the mode is {vehicle.mode_name}: the pilot has it"
        return None

    def _show(self, progress: RunProgress) -> None:
        duration = progress.plan.maneuver.duration_s
        early = progress.phase is Phase.RETURNING and progress.elapsed_s < duration - 0.2
        with self._moment.lock:
            stage = self._moment.now.stage
            if early and stage is Stage.FLYING:
                stage = Stage.ABORTING
                if progress.ending is not None:
                    self._moment.set(said=f"{progress.ending.value}: {progress.reason}")
            self._moment.set(
                stage=stage,
                progress=progress_view(progress),
                use=progress.use,
            )

    def _judged(self, result: RunResult) -> None:
        mark, why, words = outcome(result)
        with self._moment.lock:
            flown = any(
                run.number == result.run.number and run.mark in (Mark.KEEP, Mark.AGAIN) for run in self._moment.now.runs
            )
            if result.verdict is not None or not flown:
                self._moment.mark(result.run.number, mark, why)
            self._flown.append(result)
            runs, limits = self._moment.now.runs, self._moment.now.limits
            self._moment.set(runs=unlocked(runs, self._planned, self._flown, limits))
            now = self._moment.now
            if result.clean and result.file is not None and now.flight is not None and tells_both_axes(now.runs):
                self._so_far.after(now.flight)
            all_kept = all(run.mark is Mark.KEEP for run in self._moment.now.runs)
            over = result.ending not in (Ending.FINISHED, *AGAIN) or result.verdict is None or all_kept
            self._moment.set(
                stage=Stage.CLOSING if over else Stage.CHECKING,
                said=f"{result.run.label}: {words}",
                progress=None,
                checks=(),
            )


def _to_go_on(asked: AskedCard) -> Earlier | None:
    """The flight that is to go on; None for a new one. Raises TippathError where nothing of it is left."""
    earlier = unfinished(Path(asked.resume).expanduser()) if asked.resume else None
    if earlier is not None and not earlier.left:
        raise TippathError(f"{earlier.folder.path.name}: {earlier.words}; nothing is left to fly (C: another card)")
    return earlier
