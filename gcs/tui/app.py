"""The terminal app: a thin view of a worker that runs without it.

A timer reads the worker's state, which is immutable, and gives it to the screen that is there; keys set wishes. What
waits (a fit, a push, a pilot's reply) runs in a thread and posts one message when it is over; K or escape calls off
what the desk works on. F12 works from anywhere.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

from textual.binding import Binding
from textual.screen import Screen

from gcs.desk.shell import word
from gcs.errors import TippathError, UsageError
from gcs.flight.folder import flight_of
from gcs.link.decode import sanitise
from gcs.tui import themes
from gcs.tui.actions import GUIDE, NOTE, PILOT, REPLAY, REVEAL, bindings
from gcs.tui.ask_from import AskFrom
from gcs.tui.asked_card import AskedCard, offered_cards
from gcs.tui.base import Dialog, Page
from gcs.tui.calls import calls
from gcs.tui.connect import ConnectScreen
from gcs.tui.connections import Connection, typed
from gcs.tui.dialogs import Confirm
from gcs.tui.field_keys import FieldApp
from gcs.tui.fly import SPAN_S, FlyScreen
from gcs.tui.gains_words import push_lines
from gcs.tui.help import HelpScreen
from gcs.tui.leaving import HEARTBEAT, STAYS, before_quitting
from gcs.tui.next_step import PROOF
from gcs.tui.pages import GENERAL, PAGES, mode_of
from gcs.tui.palette import Entry, Palette
from gcs.tui.plot import Style
from gcs.tui.report import ReportScreen
from gcs.tui.state import State, as_flown
from gcs.tui.worker import AppWorker

LOOKS_PER_S = 12.0
AUDITED = 200
"""Lines of a flight's audit that are shown."""


class Connections(Protocol):
    """Where else there is to connect to."""

    @property
    def connection(self) -> Connection: ...
    def connections(self) -> tuple[Connection, ...]: ...
    def connect(self, connection: Connection) -> None: ...


class TippathApp(FieldApp):
    """Connect, fly, fit, compare, diagnose, climb the ladder, design, push, report."""

    TITLE = "tippath"
    CSS_PATH = "tippath.tcss"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS = [
        Binding("f12", "abort", "ABORT", priority=True),
        Binding("space", "abort", "abort", show=False),
        *(Binding(str(k), f"screen('{mode_of(page)}')", page.NAME) for k, page in enumerate(PAGES, 1)),
        Binding("question_mark", "screen('help')", "help"),
        Binding("f1", "screen('help')", "help", priority=True),
        Binding("f2,ctrl+p", "palette", "all keys"),
        Binding("f9", "theme", "colours", priority=True),
        *bindings((NOTE, GUIDE, REVEAL, REPLAY)),
        Binding("escape,k,K", "cancel", "call off"),
        Binding("q,Q", "leave", "quit"),
        Binding("ctrl+q", "leave", "quit", show=False, priority=True),
        Binding("ctrl+c", "leave", "quit", show=False, priority=True),
        Binding("t,T", "pilot('takeoff')", "take off"),
        Binding("l,L", "pilot('land')", "land"),
        Binding("b,B", "pilot('lqr')", "bank switch"),
    ]

    def __init__(
        self,
        worker: AppWorker,
        style: Style = "braille",
        *,
        bell: bool = True,
        say: Callable[[str], None] | None = None,
        theme: str = "dark",
        connections: Connections | None = None,
        first: str = "fly",
        flights: Sequence[str] = (),
    ) -> None:
        """`connections`: where the link can be changed; None where the worker has one only. `flights` are opened
        at once, together; `say` speaks what is called out, and does not wait."""
        super().__init__(worker, style, bell=bell, say=say)
        self.connections = connections
        self._first = first
        self._flights = flights
        self._seen: State | None = None
        self._leaving = False
        self._before_help = first
        self._connections: tuple[Connection, ...] = ()
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
        self.make_screens([mode_of(page) for page in PAGES])
        self.action_look_for_connections()
        if self._flights:
            self.work("the flight", lambda: self.worker.open_flight(*self._flights))

    def may_make_screens(self) -> bool:
        """Not while a card is flown."""
        return super().may_make_screens() and not self.worker.state().stage.under_way

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
        state = self.worker.state()
        before, self._seen = self._seen, state
        if before is not None:
            self.call_out(calls(as_flown(before), as_flown(state)))
        for screen in self.screen_stack:
            self.show_on(screen)

    def show_on(self, screen: Screen[object]) -> None:
        """Show the moment that was looked at last on a screen."""
        state = self._seen
        if state is None:
            return
        if isinstance(screen, ConnectScreen):
            screen.offer(self._connections, "" if self.connections is None else self.connections.connection.name)
        if isinstance(screen, ReportScreen):
            self._read_audit(state)
            screen.audited(self._audit)
        if isinstance(screen, Page):
            screen.show(state, self._problem, guided=self.guided)
        elif isinstance(screen, Dialog):
            screen.show(state)
        if isinstance(screen, FlyScreen):
            screen.draw(self.worker.window(SPAN_S), state.lost)

    def run_look(self) -> None:
        """Show this moment now: a key moved something."""
        self.look()

    # Keys.

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """On a link with a real vehicle, or anybody's, there are no pilot's keys."""
        return self.worker.state().simulated if action == "pilot" else True

    def action_abort(self) -> None:
        """F12 from anywhere, space outside a text field."""
        self._problem = ""
        try:
            self.worker.abort()
        except Exception as problem:  # the key never fails; what it could not do is said
            self._problem = f"abort: {type(problem).__name__}: {problem}"
        self.look()

    def action_cancel(self) -> None:
        """Call off what the desk works on."""
        self._problem = ""
        self.worker.desk.cancel()
        self.worker.call_off()
        self.look()

    async def action_screen(self, name: str) -> None:
        """Another screen."""
        self._problem = ""
        if name == "help" and self.current_mode != "help":
            self._before_help = self.current_mode
        await self.switch_mode(name)
        if name == "connect":
            self.action_look_for_connections()
        self.look()

    async def action_leave_help(self) -> None:
        """Back to where help was asked for."""
        await self.action_screen(self._before_help)

    def action_theme(self) -> None:
        """Other colours."""
        self.theme = themes.after(self.theme)

    def action_choose_run(self, number: int) -> None:
        """Another run of the card is the next."""
        self._problem = ""
        self.worker.choose_run(number)
        self.look()

    def action_pilot(self, line: str) -> None:
        """A key of the simulated pilot."""
        self.work("the simulated pilot", lambda: self.worker.pilot(line))

    def action_palette(self) -> None:
        """Every action of every screen, by name."""
        entries = [Entry("", act.key, act.name, act.action) for act in GENERAL]
        if self.worker.state().simulated:
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

    def action_choose_card(self, typed: str = "", wrong: str = "") -> None:
        """Ask for a card; what is left of a flight is proposed, or one that the diagnosis wrote. `typed` before, it is
        asked again with what is `wrong` with that."""
        state = self.worker.state()
        judging = PROOF if state.bank is not None and state.bank.active and state.bank.switch_on else ""
        proposed = typed or (judging if state.desk.card is None else word(state.desk.card))
        if state.unfinished is not None and not typed:
            proposed = AskedCard(resume=str(state.unfinished)).options
        offers = offered_cards(state.desk.home, proposed)
        hint = wrong or "up/down chooses, or type a TOML file; behind it --leave-out, --log card"

        def choose(asked: str) -> None:
            try:
                self.worker.choose_card(asked)
            except UsageError as problem:
                self.call_from_thread(self.action_choose_card, asked, str(problem))

        def take(asked: str | None) -> None:
            if asked is not None:
                self.work("the card", lambda: choose(asked))

        self._problem = ""
        self.push_screen(AskFrom(self.plot_style, "Which card?", hint, proposed, offers), take)

    # Connection.

    def action_look_for_connections(self) -> None:
        """Look at ports and folders, aside."""
        connections = self.connections
        if connections is None:
            return

        def look() -> None:
            self._connections = connections.connections()

        self.work("looking for links", look, quietly=True)

    def check_vehicle(self) -> None:
        """Ask the vehicle what it is set to."""
        if self.worker.state().vehicle is not None:
            self.work("looking at the vehicle", self.worker.check)

    def action_take_over(self) -> None:
        """Believe the address that is shown: only the operator knows whose it is."""
        vehicle = self.worker.state().vehicle
        if vehicle is None or not vehicle.newcomer:
            self.notice("no other address speaks as the vehicle does")
            return
        self.work(f"taking {vehicle.newcomer} for the vehicle", self.worker.take_over)

    def action_type_link(self) -> None:
        """Ask for a LINK."""
        if self.connections is None:
            self.notice("this app was started on one link; q, then `tippath fly` chooses another")
            return

        def go(word: str) -> None:
            try:
                self.connect_to(typed(word))
            except TippathError as problem:
                self.notice(str(problem))

        self.ask(
            "Which link?",
            "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, /dev/ttyUSB0,57600 or COM5,57600",
            go,
        )

    def connect_to(self, connection: Connection) -> None:
        """Leave this link for another; asks where a vehicle in somebody's hands may notice."""
        connections, state = self.connections, self.worker.state()
        if connections is None:
            return
        if connection.flight is not None:
            flight = str(connection.flight)
            self.work("the flight", lambda: self.worker.open_flight(flight))
            self.call_later(self.action_screen, "runs")
            return
        if state.stage.under_way:
            self.notice("a card is being flown: end it first (2, then E)")
            return

        def do() -> None:
            self.guided = self.guided or connection.guided
            connections.connect(connection)

        vehicle = state.vehicle
        if vehicle is None or not vehicle.armed or vehicle.lost:
            self.work("connecting", do)
            return
        lines = (f"The vehicle is armed. {HEARTBEAT} {STAYS}",)
        self.confirm("Leave this vehicle?", lines, "connecting", do)

    def action_replay_open(self) -> None:
        """Watch the flight that is open again; a link is left for it, as for another link."""
        path = self.worker.state().desk.path
        if path is None or self.connections is None:
            self.notice("no flight is open: 3, then O opens one")
            return
        self.connect_to(Connection(name=f"replay of {path.name}", replay=path))
        self.call_later(self.action_screen, "fly")

    # Gains.

    def action_push(self) -> None:
        """Push, after a yes."""
        state = self.worker.state()
        designed, reason = state.designed, state.not_on_ground()
        if designed is None or reason is not None:
            self.notice(reason if designed is not None and reason else "no gains yet: D designs them")
            return
        if not designed.cleared:
            self._ask_why("they fail (see above)")
            return
        self.confirm("Push these gains?", push_lines(state), "push", self._push)

    def _push(self) -> None:
        """In a thread; where the vehicle is not as it was identified, words why are asked for."""
        # scipy comes along
        from gcs.analysis.pushing import NotClearedError

        try:
            self.worker.push()
        except NotClearedError as error:
            self.call_from_thread(self._ask_why, str(error))

    def _ask_why(self, against: str) -> None:
        hint = f"{against}: words why are kept with the push; nothing typed, nothing pushed"
        self.ask_to_work("Why push these gains all the same?", hint, "push", self.worker.push)

    def action_revert(self) -> None:
        """Go back, after a yes."""
        reason = self.worker.state().not_on_ground()
        if reason is not None:
            self.notice(reason)
            return
        lines = ("The vehicle's bank before the last push becomes the active one again.", "It does so only disarmed.")
        self.confirm("Go back to the gains before?", lines, "revert", self.worker.revert)

    async def action_quit(self) -> None:
        """As `q`."""
        self.action_leave()

    def action_leave(self) -> None:
        """Quit; asks where a card is under way (and aborts first), a vehicle is armed, or results are kept nowhere."""
        if self._leaving:
            return
        lines = before_quitting(self.worker.state())
        if not lines:
            self.exit()
            return

        def answered(answer: str | None) -> None:
            self._leaving = False
            if answer == "yes":
                if self.worker.state().stage.under_way:
                    self.worker.abort()
                self.exit()

        self._leaving = True
        self.push_screen(Confirm(self.plot_style, "Quit?", lines), answered)

    # The audit.

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
