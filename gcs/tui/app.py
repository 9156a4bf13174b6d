"""The terminal app: a thin view of an engine that runs without it.

A timer reads the engine's state, which is immutable, and gives it to the screen that is there; keys set wishes. What
waits (a fit, a push, a pilot's reply) runs in a thread and posts one message when it is over; K or escape calls off
what the desk works on. F12 works from anywhere.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

from textual.app import App
from textual.binding import Binding
from textual.message import Message

from gcs.cards.maneuver import bundled_cards
from gcs.desk.state import Choice
from gcs.errors import TippathError
from gcs.flight.folder import flight_of
from gcs.link.decode import sanitise
from gcs.tui import themes, words
from gcs.tui.actions import Act
from gcs.tui.base import Dialog, Page
from gcs.tui.compare import CompareScreen
from gcs.tui.connect import ConnectScreen
from gcs.tui.controller import ControllerScreen
from gcs.tui.diagnose import DiagnoseScreen
from gcs.tui.dialogs import Ask, Confirm
from gcs.tui.engine import Engine
from gcs.tui.fit import FitScreen
from gcs.tui.fly import SPAN_S, FlyScreen
from gcs.tui.help import HelpScreen
from gcs.tui.ladder import LadderScreen
from gcs.tui.next_step import winner
from gcs.tui.palette import Entry, Palette
from gcs.tui.places import Place, typed
from gcs.tui.plot import Style
from gcs.tui.report import ReportScreen
from gcs.tui.runs import RunsScreen
from gcs.tui.state import State

LOOKS_PER_S = 12.0
AUDITED = 200
"""Lines of a flight's audit that are shown."""

PAGES: tuple[type[Page], ...] = (
    ConnectScreen,
    FlyScreen,
    RunsScreen,
    FitScreen,
    CompareScreen,
    DiagnoseScreen,
    LadderScreen,
    ControllerScreen,
    ReportScreen,
)
"""On the keys 1 to 9."""


def mode_of(page: type[Page]) -> str:
    """What Textual calls a screen."""
    return page.NAME.lower()


PILOT = (
    Act("t,T", "app.pilot('takeoff')", "take off", "the simulated pilot takes off"),
    Act("l,L", "app.pilot('land')", "land", "the simulated pilot lands"),
    Act("b,B", "app.pilot('lqr')", "bank switch", "the simulated pilot's switch: LQR, or autopilot"),
)
GENERAL = (
    Act("f12", "app.abort", "ABORT", "abort: back to the mode before the run", "F12"),
    *(
        Act(str(k), f"app.screen('{mode_of(page)}')", page.NAME, f"screen {page.NAME}")
        for k, page in enumerate(PAGES, 1)
    ),
    Act("question_mark", "app.screen('help')", "help", "what the keys do", "?"),
    Act("k,K", "app.cancel", "", "call off what is being worked on"),
    Act("f9", "app.theme", "", "other colours: dark, black on white for the sun, high contrast, light", "F9"),
    Act("q,Q", "app.leave", "quit", "quit"),
)
"""What works on every screen; the palette lists it."""


class Harbour(Protocol):
    """Where else there is to connect to."""

    @property
    def place(self) -> Place: ...
    def places(self) -> tuple[Place, ...]: ...
    def connect(self, place: Place) -> None: ...


class TippathApp(App[None]):
    """Connect, fly, fit, compare, diagnose, climb the ladder, design, push, report."""

    TITLE = "tippath"
    CSS_PATH = "tippath.tcss"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS = [
        Binding("f12", "abort", "ABORT", priority=True),
        Binding("space", "abort", "abort", show=False),
        *(Binding(str(k), f"screen('{mode_of(page)}')", page.NAME) for k, page in enumerate(PAGES, 1)),
        Binding("question_mark", "screen('help')", "help"),
        Binding("ctrl+p", "palette", "all keys"),
        Binding("f9", "theme", "colours", priority=True),
        Binding("escape,k,K", "cancel", "call off"),
        Binding("q,Q", "leave", "quit"),
        Binding("ctrl+q", "leave", "quit", show=False, priority=True),
        Binding("ctrl+c", "leave", "quit", show=False, priority=True),
        Binding("t,T", "pilot('takeoff')", "take off"),
        Binding("l,L", "pilot('land')", "land"),
        Binding("b,B", "pilot('lqr')", "bank switch"),
    ]

    class Finished(Message):
        """Something that was waited for in a worker is over."""

        def __init__(self, what: str, error: str | None) -> None:
            super().__init__()
            self.what = what
            self.error = error

    def __init__(
        self,
        engine: Engine,
        style: Style = "braille",
        *,
        bell: bool = True,
        theme: str = "dark",
        harbour: Harbour | None = None,
        first: str = "fly",
        flight: str | None = None,
    ) -> None:
        """`harbour`: where the link can be changed; None where the engine has one only. `flight` is opened at once."""
        super().__init__()
        self.engine = engine
        self.plot_style: Style = style
        self.harbour = harbour
        self._first = first
        self._flight = flight
        self._rings = bell
        self._seen: State | None = None
        self._leaving = False
        self._problem = ""
        """Why the last thing asked for was not done; shown on every screen until something else is asked for."""
        self._places: tuple[Place, ...] = ()
        self._audit: tuple[str, ...] = ()
        self._audit_of: tuple[object, ...] = ()
        for one in themes.THEMES:
            self.register_theme(one)
        self.theme = theme
        pages: tuple[type[Page], ...] = (*PAGES, HelpScreen)
        for page in pages:
            self.add_mode(mode_of(page), partial(page, style))

    async def on_mount(self) -> None:
        """Begin to look."""
        await self.switch_mode(self._first)
        self.set_interval(1 / LOOKS_PER_S, self.look)
        self._mind_signals()
        self.action_look_for_places()
        flight = self._flight
        if flight is not None:
            self.work("the flight", lambda: self.engine.open_flight(flight))

    def _mind_signals(self) -> None:
        """Being told to end, or losing the terminal, is leaving: a run under way is ended first."""
        loop = asyncio.get_running_loop()
        for name in ("SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None:
                with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
                    loop.add_signal_handler(number, self.exit)

    def look(self) -> None:
        """Show this moment."""
        state = self.engine.state()
        before, self._seen = self._seen, state
        if self._rings and before is not None and words.rings(before, state):
            self.bell()
        for screen in self.screen_stack:
            if isinstance(screen, ConnectScreen):
                screen.offer(self._places, "" if self.harbour is None else self.harbour.place.name)
            if isinstance(screen, ReportScreen):
                self._read_audit(state)
                screen.audited(self._audit)
            if isinstance(screen, Page):
                screen.show(state, self._problem)
            elif isinstance(screen, Dialog):
                screen.show(state)
            if isinstance(screen, FlyScreen):
                screen.draw(self.engine.window(SPAN_S), state.lost)

    def run_look(self) -> None:
        """Show this moment now: a key moved something."""
        self.look()

    # Keys.

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """On a link with a real vehicle, or anybody's, there are no pilot's keys."""
        return self.engine.state().simulated if action == "pilot" else True

    def action_abort(self) -> None:
        """F12 from anywhere, space outside a text field."""
        self._problem = ""
        try:
            self.engine.abort()
        except Exception as problem:  # the key never fails; what it could not do is said
            self._problem = f"abort: {type(problem).__name__}: {problem}"
        self.look()

    def action_cancel(self) -> None:
        """Call off what the desk works on."""
        self._problem = ""
        self.engine.desk.cancel()
        self.look()

    async def action_screen(self, name: str) -> None:
        """Another screen."""
        self._problem = ""
        await self.switch_mode(name)
        if name == "connect":
            self.action_look_for_places()
        self.look()

    def action_theme(self) -> None:
        """Other colours."""
        self.theme = themes.after(self.theme)

    def action_engine(self, wish: str) -> None:
        """A wish that does not wait."""
        self._problem = ""
        {"ready": self.engine.ready, "start": self.engine.start, "end_card": self.engine.end_card}[wish]()
        self.look()

    def action_work(self, what: str) -> None:
        """Something that takes its time."""
        desk = self.engine.desk
        if what == "compare" and desk.state().comparison is not None:
            self.notice("this rung was compared already; 5 shows it")
            return
        if what == "diagnose" and desk.state().diagnosis is not None:
            self.notice("this rung was asked already; 6 shows the answer")
            return
        do: dict[str, Callable[[], None]] = {
            "fit": self._fit,
            "compare": desk.compare,
            "diagnose": desk.diagnose,
            "design": self.engine.design,
            "report": desk.report,
        }
        self.work(what, do[what])

    def _fit(self) -> None:
        """And compare at once: the strips on the screen are the comparison's, and it takes a quarter of a second."""
        self.engine.fit()
        self.engine.desk.compare()

    def action_pilot(self, line: str) -> None:
        """A key of the simulated pilot."""
        self.work("the simulated pilot", lambda: self.engine.pilot(line))

    def action_palette(self) -> None:
        """Every action of every screen, by name."""
        entries = [Entry("", act.key, act.name, act.action) for act in GENERAL]
        if self.engine.state().simulated:
            entries += [Entry("", act.key, act.name, act.action) for act in PILOT]
        for page in PAGES:
            entries += [Entry(page.NAME, act.key, act.name, act.action) for act in page.ACTS]
        if isinstance(self.screen, Page):  # what can be done here comes first
            here = self.screen.NAME
            entries.sort(key=lambda one: (one.screen != here, bool(one.screen)))

        async def chosen(number: str | None) -> None:
            if number is None:
                return
            entry = entries[int(number)]
            if entry.screen:
                await self.action_screen(entry.screen.lower())
            await self.run_action(entry.action, self.screen)

        self.push_screen(Palette(self.plot_style, entries), chosen)

    # Questions.

    def _asked(self, question: str, hint: str, then: Callable[[str], None], value: str = "") -> None:
        self._problem = ""

        def answered(word: str | None) -> None:
            if word is not None:
                then(word)

        self.push_screen(Ask(self.plot_style, question, hint, value), answered)

    def _asked_to_work(self, question: str, hint: str, what: str, do: Callable[[str], None], value: str = "") -> None:
        self._asked(question, hint, lambda word: self.work(what, lambda: do(word)), value)

    def action_choose_card(self) -> None:
        """Ask for a card; one that the diagnosis wrote is proposed."""
        card = self.engine.state().desk.card
        hint = f"a TOML file, or one of: {', '.join(bundled_cards())}"
        self._asked_to_work("Which card?", hint, "the card", self.engine.choose_card, "" if card is None else str(card))

    def action_open_flight(self) -> None:
        """Ask for a flight."""
        self._asked_to_work("Which flight?", "a flight folder or a log", "the flight", self.engine.open_flight)

    def action_note(self) -> None:
        """Ask for a note."""
        self._asked_to_work("Note", "kept with the time in flight.json", "the note", self.engine.desk.note)

    def action_rename(self) -> None:
        """Ask for a name."""
        desk = self.engine.desk
        self._asked_to_work("Name of this flight?", "any words", "the name", desk.rename, desk.state().name)

    def action_keep_in(self) -> None:
        """Ask for a folder."""
        self._asked_to_work(
            "Keep results where?",
            "a folder; it is made where there is none",
            "keeping",
            lambda word: self.engine.desk.keep_in(Path(word).expanduser()),
        )

    def action_choose_base(self) -> None:
        """Ask for the base model."""
        desk = self.engine.desk
        base = desk.state().base

        def take(word: str) -> None:
            model, *effects = (part for part in word.replace("+", " ").replace(",", " ").split())
            desk.choose_base(model.lower(), effects)

        value = " + ".join((base.model, *base.effects))
        hint = "tpp or cd; with effects to begin with, as in: tpp + angular_damping + elevator"
        self._asked_to_work("Which base model?", hint, "the base", take, value)

    def action_own_effect(self) -> None:
        """Ask for an effect by its id or its file."""
        self._asked_to_work(
            "Which effect?",
            "the path of an effect file (its code runs), or an id of the catalogue",
            "adding",
            self._add,
        )

    def action_weigh(self) -> None:
        """Ask for the input cost."""

        def weigh(word: str) -> None:
            try:
                cost = float(word)
            except ValueError:
                raise TippathError(f"{word} is no number; the paper's input cost is 5") from None
            self.engine.desk.design(cost)

        self._asked_to_work("Input cost?", "more is gentler; the paper's is 5", "design", weigh, "5")

    # The ladder.

    def action_add_winner(self) -> None:
        """Add what is missing; undo is one key."""
        rung = self.engine.desk.state().current
        effect = "" if rung is None else winner(rung)
        if not effect:
            asked = rung is not None and rung.diagnosis is not None
            self.notice("nothing is missing that could be added" if asked else "D asks first what is missing")
            return
        self.work("adding", lambda: self._add(effect))

    def _add(self, effect: str) -> None:
        """And compare at once, for the strips."""
        self.engine.desk.add(effect)
        self.engine.desk.compare()

    def action_undo(self) -> None:
        """One rung back."""
        self._now(self.engine.desk.undo)

    def action_write_card(self) -> None:
        """The maneuver that would tell, as a card."""

        def write() -> None:
            self.engine.desk.next_card()

        self.work("the card", write)

    def use_run(self, number: int, choice: Choice) -> None:
        """Use a run otherwise."""
        runs = self.engine.desk.state().runs
        if 0 <= number < len(runs):
            self._now(lambda: self.engine.desk.use(runs[number].word, choice))

    def _now(self, do: Callable[[], None]) -> None:
        """Something that does not wait, but may be refused."""
        self._problem = ""
        try:
            do()
        except TippathError as problem:
            self._problem = str(problem)
        self.look()

    # Connection.

    def action_look_for_places(self) -> None:
        """Look at ports and folders, aside."""
        harbour = self.harbour
        if harbour is None:
            return

        def look() -> None:
            self._places = harbour.places()

        self.work("looking for links", look, quietly=True)

    def action_type_link(self) -> None:
        """Ask for a LINK."""
        if self.harbour is None:
            self.notice("this app was started on one link; q, then `tippath fly` chooses another")
            return

        def go(word: str) -> None:
            try:
                self.connect_to(typed(word))
            except TippathError as problem:
                self.notice(str(problem))

        self._asked(
            "Which link?",
            "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, /dev/ttyUSB0,57600 or COM5,57600",
            go,
        )

    def connect_to(self, place: Place) -> None:
        """Leave this link for another; asks where a vehicle in somebody's hands may notice."""
        harbour, state = self.harbour, self.engine.state()
        if harbour is None:
            return
        if state.stage.under_way:
            self.notice("a card is being flown: end it first (2, then E)")
            return

        def do() -> None:
            harbour.connect(place)

        vehicle = state.vehicle
        if vehicle is None or not vehicle.armed or vehicle.lost:
            self.work("connecting", do)
            return
        lines = (
            "The vehicle is armed. This station's heartbeat ends with the link; where the vehicle's failsafe listens "
            "to it, the vehicle acts on that. Nothing else changes: the pilot has it.",
        )
        self._confirmed("Leave this vehicle?", lines, "connecting", do)

    # Gains.

    def action_push(self) -> None:
        """Push, after a yes."""
        state = self.engine.state()
        designed, reason = state.designed, state.not_on_ground()
        if designed is None or reason is not None:
            self.notice(reason if designed is not None and reason else "no gains yet: D designs them")
            return
        lines = (
            f"{designed.path} goes to the vehicle's shadow bank, is read back bit for bit, and becomes the active "
            f"bank by its checksum {designed.crc:06x}. The bank before is kept.",
            "Nothing flies by it until the pilot's switch says so.",
        )
        self._confirmed("Push these gains?", lines, "push", self.engine.push)

    def action_revert(self) -> None:
        """Go back, after a yes."""
        reason = self.engine.state().not_on_ground()
        if reason is not None:
            self.notice(reason)
            return
        lines = ("The vehicle's bank before the last push becomes the active one again.", "It does so only disarmed.")
        self._confirmed("Go back to the gains before?", lines, "revert", self.engine.revert)

    def _confirmed(self, question: str, lines: tuple[str, ...], what: str, do: Callable[[], None]) -> None:
        def answered(answer: str | None) -> None:
            if answer == "yes":
                self.work(what, do)

        self._problem = ""
        self.push_screen(Confirm(self.plot_style, question, lines), answered)

    async def action_quit(self) -> None:
        """As `q`."""
        self.action_leave()

    def action_leave(self) -> None:
        """Quit; asks where a card is under way (and then aborts first) and where results are kept nowhere yet."""
        if self._leaving:
            return
        state = self.engine.state()
        lines: tuple[str, ...]
        if state.stage.under_way:
            lines = (
                "A card is under way. Yes aborts the run first, waits until the vehicle is back in the mode before it, "
                "completes the log, and then quits.",
            )
        elif state.desk.unkept:
            lines = (f"Not kept yet: {', '.join(state.desk.unkept)}. N, then 3 and D keeps them in another folder.",)
        else:
            self.exit()
            return

        def answered(answer: str | None) -> None:
            self._leaving = False
            if answer == "yes":
                if self.engine.state().stage.under_way:
                    self.engine.abort()
                self.exit()

        self._leaving = True
        self.push_screen(Confirm(self.plot_style, "Quit?", lines), answered)

    # Work in threads.

    def work(self, what: str, do: Callable[[], None], *, quietly: bool = False) -> None:
        """Do something that waits, away from the screen; its end comes as a message."""
        if not quietly:
            self._problem = ""

        def run() -> None:
            error = None
            try:
                do()
            except TippathError as problem:
                error = str(problem)
            except Exception as problem:  # a fault of ours is told, and does not end the app in flight
                error = f"{what} stopped on a fault: {type(problem).__name__}: {problem}"
            self.post_message(self.Finished(what, error))

        self.run_worker(run, thread=True, name=what, exit_on_error=False)
        self.look()

    def on_tippath_app_finished(self, message: Finished) -> None:
        """Tell what went wrong; what went right is in the state."""
        if message.error is not None:
            self.notice(message.error)
        self.look()

    def notice(self, text: str) -> None:
        """Tell the user why something was not done."""
        self._problem = text
        self.look()

    def _read_audit(self, state: State) -> None:
        """The flight's audit, read again where something was done since."""
        desk = state.desk
        key = (desk.path, desk.home, state.commands, desk.commands, desk.notes, desk.name, state.busy)
        if key == self._audit_of or desk.path is None:
            return
        self._audit_of = key
        path = desk.path

        def read() -> None:
            entries, damaged = flight_of(path).audited()
            lines = [sanitise(f"{one.time[:19].replace('T', ' ')}  {one.did}") for one in reversed(entries[-AUDITED:])]
            self._audit = (*lines, *([f"{damaged} damaged lines"] if damaged else []))

        self.work("the audit", read, quietly=True)
