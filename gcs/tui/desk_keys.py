"""What keys ask of the desk: the flight and its runs, fit, comparison, diagnosis, the ladder, gains, the report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gcs.desk.state import Choice
from gcs.errors import TippathError
from gcs.tui.asking import AskingApp
from gcs.tui.next_step import winner


class DeskApp(AskingApp):
    """The part of the app that works on a flight after it was flown."""

    # The flight.

    def action_open_flight(self) -> None:
        """Ask for a flight."""
        self.ask_to_work("Which flight?", "a flight folder or a log", "the flight", self.worker.open_flight)

    def action_note(self) -> None:
        """Ask for a note."""
        self.ask_to_work("Note", "kept with the time in flight.json", "the note", self.worker.desk.note)

    def action_rename(self) -> None:
        """Ask for a name."""
        desk = self.worker.desk
        self.ask_to_work("Name of this flight?", "any words", "the name", desk.rename, desk.state().name)

    def action_keep_in(self) -> None:
        """Ask for a folder."""
        self.ask_to_work(
            "Keep results where?",
            "a folder; it is made where there is none",
            "keeping",
            lambda word: self.worker.desk.keep_in(Path(word).expanduser()),
        )

    def use_run(self, number: int, choice: Choice) -> None:
        """Use a run otherwise."""
        runs = self.worker.desk.state().runs
        if 0 <= number < len(runs):
            self.do_now(lambda: self.worker.desk.use(runs[number].word, choice))

    # What is worked out.

    def action_work(self, what: str) -> None:
        """Something that takes its time."""
        desk = self.worker.desk
        if what == "compare" and desk.state().comparison is not None:
            self.notice("this rung was compared already; 5 shows it")
            return
        if what == "diagnose" and desk.state().answer is not None:
            self.notice("this rung was asked already; 6 shows the answer")
            return
        do: dict[str, Callable[[], None]] = {
            "fit": self._fit,
            "compare": desk.compare,
            "diagnose": desk.diagnose,
            "design": self.worker.design,
            "report": desk.report,
        }
        self.work(what, do[what])

    def _fit(self) -> None:
        """And compare at once: the strips on the screen are the comparison's, and it takes a quarter of a second."""
        self.worker.fit()
        self.worker.desk.compare()

    def action_choose_base(self) -> None:
        """Ask for the base model."""
        desk = self.worker.desk
        base = desk.state().base

        def take(word: str) -> None:
            model, *effects = (part for part in word.replace("+", " ").replace(",", " ").split())
            desk.choose_base(model.lower(), effects)

        value = " + ".join((base.model, *base.effects))
        hint = "tpp or cd; with effects to begin with, as in: tpp + angular_damping + elevator"
        self.ask_to_work("Which base model?", hint, "the base", take, value)

    def action_weigh(self) -> None:
        """Ask for the input cost."""

        def weigh(word: str) -> None:
            try:
                cost = float(word)
            except ValueError:
                raise TippathError(f"{word} is no number; the paper's input cost is 5") from None
            self.worker.desk.design(cost)

        self.ask_to_work("Input cost?", "more is gentler; the paper's is 5", "design", weigh, "5")

    # The ladder.

    def action_add_winner(self) -> None:
        """Add what is missing; undo is one key."""
        rung = self.worker.desk.state().current
        effect = "" if rung is None else winner(rung)
        if not effect:
            asked = rung is not None and rung.answer is not None
            self.notice("nothing is missing that could be added" if asked else "D asks first what is missing")
            return
        self.work("adding", lambda: self._add(effect))

    def action_own_effect(self) -> None:
        """Ask for an effect by its id or its file."""
        self.ask_to_work(
            "Which effect?",
            "the path of an effect file (its code runs), or an id of the catalogue",
            "adding",
            self._add,
        )

    def _add(self, effect: str) -> None:
        """And compare at once, for the strips."""
        self.worker.desk.add(effect)
        self.worker.desk.compare()

    def action_undo(self) -> None:
        """One rung back."""
        self.do_now(self.worker.desk.undo)

    def action_write_card(self) -> None:
        """The maneuver that would tell, as a card."""

        def write() -> None:
            self.worker.desk.next_card()

        self.work("the card", write)
