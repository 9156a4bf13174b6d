"""What keys ask of the desk: the flight and its runs, fit, comparison, diagnosis, the ladder, gains, the report."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from textual.timer import Timer

from gcs.desk.state import Choice, Weights
from gcs.errors import TippathError
from gcs.link.decode import sanitise
from gcs.tui.ask_from import AskFrom, Paths, flights_in, quoted
from gcs.tui.asking import AskingApp
from gcs.tui.connections import recent_flights
from gcs.tui.next_step import winner
from gcs.tui.ranking_words import effects_offered


class DeskApp(AskingApp):
    """The part of the app that works on a flight after it was flown."""

    _resting: Timer | None = None
    """Until the sliders have rested."""

    # The flight.

    def action_open_flight(self, typed: str = "", wrong: str = "") -> None:
        """Ask for a flight: the newest are listed, and what is typed is completed. `typed` before, it is asked again
        with what is `wrong` with that."""
        state = self.worker.state()
        near = state.desk.path or state.flight
        folder = Path() if near is None else near.parent
        found = recent_flights(folder)
        offers = [(quoted(folder / one.flight.name), one.about) for one in found if one.flight is not None]

        def take(asked: str | None) -> None:
            if asked is None:
                return
            names = flights_in(asked)
            missing = [name for name in names if not Path(name).expanduser().exists()]
            if missing:
                self.action_open_flight(asked, f"{missing[0]}: no such folder or log")
            else:
                self.work("the flight", lambda: self.worker.open_flight(*names))

        self._problem = ""
        hint = wrong or (
            "up/down chooses, or type a flight folder or a log; the right arrow completes it. A blank and another one: "
            "both are opened together, as a roll log and a pitch log"
        )
        asked = AskFrom(self.plot_style, "Which flight?", hint, typed, offers, suggester=Paths(), several=True)
        self.push_screen(asked, take)

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
        if 0 <= number < len(runs) and runs[number].choice is choice:
            then = "4, then F fits" if choice is Choice.FIT else "F, V or X uses it otherwise"
            self.notice(f"{runs[number].id} is used so already ({choice.value}); {then}")
        elif 0 <= number < len(runs):
            self.do_now(lambda: self.worker.desk.use(runs[number].word, choice))

    def use_alike(self) -> None:
        """Leave out what is not like the others."""
        self.do_now(self.worker.desk.use_alike)

    def split_runs(self) -> None:
        """Every second run validates."""
        self.do_now(self.worker.desk.alternate)

    def halve_run(self, word: str) -> None:
        """One half is fitted, the other validates."""
        self.work("halving", lambda: self.worker.desk.halve(word))

    def cut_run(self, word: str, start_s: float | None, stop_s: float | None) -> None:
        """Another begin or end."""
        self.work("cutting", lambda: self.worker.desk.cut(word, start_s, stop_s))

    def whole_run(self, word: str) -> None:
        """All of a run."""
        self.work("cutting", lambda: self.worker.desk.take_whole(word))

    def fit_alone(self, word: str) -> None:
        """One axis of one run."""
        self.work("fitting one axis", lambda: self.worker.desk.fit_alone(word))

    def action_fetch_log(self) -> None:
        """The flight's log off the vehicle's card."""
        self.work("fetching the log", self.worker.fetch_log)

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
            "PDF": desk.report_for_paper,
            "shadow": desk.shadow,
            "prove": desk.prove,
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

        desk = self.worker.desk

        def weigh(word: str) -> None:
            try:
                cost = float(word)
            except ValueError:
                raise TippathError(f"{word} is no number; the paper's input cost is 5") from None
            desk.design(cost)

        self.ask_to_work("Input cost?", "more is gentler; the paper's is 5", "design", weigh, "5")

    def turn_weights(self, weights: Weights, rests_s: float) -> None:
        """Sliders were moved: gains and margins follow at once, the whole judgement when they rest."""
        desk = self.worker.desk
        desk.turn(weights)
        self.work("gains", desk.follow, quietly=True)
        if self._resting is not None:
            self._resting.stop()
        self._resting = self.set_timer(rests_s, lambda: self.work("judging", desk.judge_trial, quietly=True))

    def follow_weights(self, crc: int) -> None:
        """What the sliders make of another model; `crc` of gains that the vehicle holds, or none."""
        desk = self.worker.desk
        self.work("gains", (lambda: desk.seek_present(crc)) if crc else desk.follow, quietly=True)

    # The ladder.

    def action_add_winner(self) -> None:
        """Add what is missing; undo is one key."""
        self.add_winner_or("")

    def add_winner_or(self, marked: str) -> None:
        """Add what is missing; where nothing is by name, the marked candidate, once that was said."""
        rung = self.worker.desk.state().current
        effect = "" if rung is None else winner(rung)
        if effect:
            self.work("adding", lambda: self._add(effect))
        elif rung is None or rung.answer is None:
            self.notice("D asks first what is missing")
        elif not marked:
            self.notice("nothing is missing by name; I adds an effect that you choose")
        else:
            name, verdict = sanitise(Path(marked).name), rung.answer.verdict
            lines = (f"the diagnosis does not name it: {verdict}. The ladder will show what it does; U takes it back",)
            self.confirm(f"Add {name} all the same?", lines, "adding", lambda: self._add(marked))

    def action_own_effect(self) -> None:
        """Ask for an effect: the candidates are listed, or the catalogue; an id or a file's path may be typed."""

        def take(word: str | None) -> None:
            if word is not None:
                self.work("adding", lambda: self._add(word))

        self._problem = ""
        hint = "up/down chooses; or type an id of the catalogue, or the path of an effect file (its code runs)"
        offers = effects_offered(self.worker.desk.state())
        self.push_screen(AskFrom(self.plot_style, "Which effect?", hint, "", offers, suggester=Paths()), take)

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
