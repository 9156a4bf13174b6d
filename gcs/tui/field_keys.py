"""What keys do in the field: the guide, notes, the card's checklist, and the sealed answer of what was hidden."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from gcs.demo.revealed import revealed
from gcs.desk import shell
from gcs.errors import TippathError
from gcs.flight.session_notes import SessionNote
from gcs.tui.base import Page
from gcs.tui.calls import Call, ringing
from gcs.tui.desk_keys import DeskApp
from gcs.tui.dialogs import Ask, Told
from gcs.tui.field_words import answer_lines, answer_words, minutes
from gcs.tui.next_step import current
from gcs.tui.plot import Style
from gcs.tui.state import Stage, State
from gcs.tui.words import OF_FLYING
from gcs.tui.worker import AppWorker


class FieldApp(DeskApp):
    """The part of the app that helps whoever stands beside the runway."""

    def __init__(
        self, worker: AppWorker, style: Style, *, bell: bool = True, say: Callable[[str], None] | None = None
    ) -> None:
        super().__init__(worker, style)
        self._rings = bell
        self._say = say
        self.guided = False
        """A line at a time says what is seen."""

    def action_guide(self) -> None:
        """The guide comes, or goes."""
        self.guided = not self.guided
        self.look()

    def call_out(self, found: Sequence[Call]) -> None:
        """Ring and speak; the bell rings for the most urgent, the voice says all."""
        call = ringing(found)
        if self._rings and call is not None:
            self.bell()
            for after_s in call.pattern:
                self.set_timer(after_s, self.bell)
        if self._say is not None and found:
            self._say(", ".join(one.words for one in found))

    def action_replay(self, wish: str) -> None:
        """Move in a flight that is watched again."""
        self._problem = ""
        self.worker.replay(wish)
        self.look()

    # Notes.

    def action_note(self) -> None:
        """Ask for a note; it has the time at which the key was pressed."""
        state = self.worker.state()
        if _of_desk(state, self.screen):
            super().action_note()
            return
        now, run = datetime.now(UTC), current(state) if state.stage is Stage.FLYING else None

        def write(text: str) -> None:
            run_s = None if run is None or state.progress is None else state.progress.elapsed_s
            label = "" if run is None else run.label
            note = SessionNote(time=now, text=" ".join(text.split()), air_s=state.air_s, run=label, run_s=run_s)
            self.worker.note(note)

        into = "the next flight's folder" if state.flight is None else state.flight.name
        at = "" if state.air_s is None else f", with its time in the air, {minutes(state.air_s)}"
        self.ask_to_work("Note", f"kept in {into}{at}", "the note", write)

    # The checklist.

    def action_wish(self, wish: str) -> None:
        """A wish that does not wait; `ready` asks the checklist first."""
        state = self.worker.state()
        if wish == "ready" and state.stage is Stage.IDLE and state.unanswered is not None:
            self._ask_line(state.unanswered, ready=True)
            return
        self._problem = ""
        {"ready": self.worker.ready, "start": self.worker.start, "end_card": self.worker.end_card}[wish]()
        self.look()

    def action_checklist(self) -> None:
        """Ask the card's checklist, from its first line on."""
        state = self.worker.state()
        if state.stage.under_way:
            self.push_screen(Told(self.plot_style, "Checklist, as it was answered", tuple(answer_lines(state))))
        elif state.checklist:
            self._ask_line(0, ready=False)
        else:
            self.notice("this card has no checklist ([[checklist]] in its TOML)")

    def _ask_line(self, number: int, *, ready: bool, trouble: str = "") -> None:
        """One line of it, then the next; `ready`: and then the first run is made ready."""
        state = self.worker.state()
        question, before = state.checklist[number], state.answers[number]
        title = f"Checklist {number + 1}/{len(state.checklist)}: {question.ask}?"
        value = "" if before is None else answer_words(before)

        def answered(word: str | None) -> None:
            if word is None:
                return
            try:
                self.worker.answer(number, word)
            except TippathError as problem:
                self._ask_line(number, ready=ready, trouble=str(problem))
                return
            self._go_on(number, ready)

        self._problem = ""
        self.push_screen(Ask(self.plot_style, title, trouble or question.hint, value), answered)

    def _go_on(self, number: int, ready: bool) -> None:
        state = self.worker.state()
        following = state.unanswered if ready else number + 1
        if following is not None and following < len(state.checklist):
            self._ask_line(following, ready=ready)
        elif ready:
            self.action_wish("ready")
        self.look()

    # What was hidden.

    def action_reveal(self) -> None:
        """Ask which sealed answer is to be opened: afterwards it is no riddle any more."""
        secret = self.worker.state().secret
        hint = "the folder of its vehicle; 6 asks what is missing, and an answer that was opened is no riddle any more"
        self.ask_to_work("Open which sealed answer?", hint, "the answer", self._reveal, str(secret or ""))

    def _reveal(self, word: str) -> None:
        flight = self.worker.desk.state().path
        directory = Path(word).expanduser()
        diagnoses = () if flight is None or not flight.is_dir() else tuple(sorted(flight.glob("*-diagnosis*.json")))
        lines = revealed(directory, diagnoses)
        if flight is not None:
            command = shell.words(["tippath", "reveal", directory, *diagnoses])
            self.worker.desk.audit("opened the sealed answer", command)
        self.call_from_thread(self.push_screen, Told(self.plot_style, "What was hidden", tuple(lines)))


def _of_desk(state: State, screen: object) -> bool:
    """Whether a note belongs to the recorded flight that is open, and not to the one that is flown or prepared."""
    if state.stage.under_way or state.desk.path is None:
        return False
    flying = isinstance(screen, Page) and screen.NAME in OF_FLYING and bool(state.link)
    return not flying or state.flight == state.desk.path
