"""The terminal app: a thin view of an engine that runs without it.

A timer reads the engine's state, which is immutable, and gives it to the screen that is there; keys set wishes. What
waits (a fit, a push, a pilot's reply) runs in a thread and posts one message when it is over. F12 works from anywhere.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
from collections.abc import Callable
from functools import partial

from textual.app import App
from textual.binding import Binding
from textual.message import Message

from gcs.errors import TippathError
from gcs.maneuver import bundled_cards
from gcs.tui import words
from gcs.tui.base import Dialog, Page
from gcs.tui.controller import ControllerScreen
from gcs.tui.dialogs import Ask, Confirm
from gcs.tui.engine import Engine
from gcs.tui.fit import FitScreen
from gcs.tui.fly import SPAN_S, FlyScreen
from gcs.tui.help import HelpScreen
from gcs.tui.plot import Style
from gcs.tui.state import State

LOOKS_PER_S = 12.0


class TippathApp(App[None]):
    """Fly, fit, design, push."""

    TITLE = "tippath"
    CSS_PATH = "tippath.tcss"
    ENABLE_COMMAND_PALETTE = False
    BINDINGS = [
        Binding("f12", "abort", "ABORT", priority=True),
        Binding("space", "abort", "abort", show=False),
        Binding("1", "screen('fly')", "Fly"),
        Binding("2", "screen('fit')", "Fit"),
        Binding("3", "screen('controller')", "Controller"),
        Binding("question_mark", "screen('help')", "help"),
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

    def __init__(self, engine: Engine, style: Style = "braille", *, bell: bool = True) -> None:
        super().__init__()
        self.engine = engine
        self.plot_style: Style = style
        self._rings = bell
        self._seen: State | None = None
        self._leaving = False
        self._problem = ""
        """Why the last thing asked for was not done; shown on every screen until something else is asked for."""
        for name, kind in (
            ("fly", FlyScreen),
            ("fit", FitScreen),
            ("controller", ControllerScreen),
            ("help", HelpScreen),
        ):
            self.add_mode(name, partial(kind, style))

    async def on_mount(self) -> None:
        """Begin to look."""
        await self.switch_mode("fly")
        self.set_interval(1 / LOOKS_PER_S, self.look)
        self._mind_signals()

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
            if isinstance(screen, Page):
                screen.show(state, self._problem)
            elif isinstance(screen, Dialog):
                screen.show(state)
            if isinstance(screen, FlyScreen):
                screen.draw(self.engine.window(SPAN_S), state.lost)

    # Keys.

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """On a link with a real vehicle, or anybody's, there are no pilot's keys."""
        return self.engine.state().simulated if action == "pilot" else True

    def action_abort(self) -> None:
        """F12 from anywhere, space outside a text field."""
        self._problem = ""
        self.engine.abort()
        self.look()

    async def action_screen(self, name: str) -> None:
        """Another screen."""
        self._problem = ""
        await self.switch_mode(name)
        self.look()

    def action_engine(self, wish: str) -> None:
        """A wish that does not wait."""
        self._problem = ""
        {"ready": self.engine.ready, "start": self.engine.start, "end_card": self.engine.end_card}[wish]()
        self.look()

    def action_work(self, what: str) -> None:
        """A fit or a design."""
        self.work(what, {"fit": self.engine.fit, "design": self.engine.design}[what])

    def action_pilot(self, line: str) -> None:
        """A key of the simulated pilot."""
        self.work("the simulated pilot", lambda: self.engine.pilot(line))

    def action_choose_card(self) -> None:
        """Ask for a card."""
        names = ", ".join(bundled_cards())

        def chosen(word: str | None) -> None:
            if word is not None:
                self.work("the card", lambda: self.engine.choose_card(word))

        self.push_screen(Ask(self.plot_style, "Which card?", f"a TOML file, or one of: {names}"), chosen)

    def action_open_flight(self) -> None:
        """Ask for a flight."""

        def chosen(word: str | None) -> None:
            if word is not None:
                self.work("the flight", lambda: self.engine.open_flight(word))

        self.push_screen(Ask(self.plot_style, "Which flight?", "a flight folder or a log"), chosen)

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

        self.push_screen(Confirm(self.plot_style, question, lines), answered)

    async def action_quit(self) -> None:
        """As `q`."""
        self.action_leave()

    def action_leave(self) -> None:
        """Quit; asks where a card is under way, and then aborts first."""
        if self._leaving:
            return
        state = self.engine.state()
        if not state.stage.under_way:
            self.exit()
            return

        def answered(answer: str | None) -> None:
            self._leaving = False
            if answer == "yes":
                self.engine.abort()
                self.exit()

        self._leaving = True
        lines = (
            "A card is under way. Yes aborts the run first, waits until the vehicle is back in the mode before it, "
            "completes the log, and then quits.",
        )
        self.push_screen(Confirm(self.plot_style, "Quit?", lines), answered)

    # Work in threads.

    def work(self, what: str, do: Callable[[], None]) -> None:
        """Do something that waits, away from the screen; its end comes as a message."""
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
