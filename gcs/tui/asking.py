"""An app that asks, and that works in threads: what waits is done away from the screen, and its end is a message."""

from __future__ import annotations

from collections.abc import Callable

from textual.message import Message

from gcs.errors import TippathError
from gcs.tui.changing import ChangingApp
from gcs.tui.dialogs import Ask, Confirm
from gcs.tui.plot import Style
from gcs.tui.worker import AppWorker


class AskingApp(ChangingApp):
    """What is asked for is done, or its refusal is shown on every screen until something else is asked for."""

    class Finished(Message):
        """Something that was waited for in a worker is over."""

        def __init__(self, what: str, error: str | None) -> None:
            super().__init__()
            self.what = what
            self.error = error

    def __init__(self, worker: AppWorker, style: Style) -> None:
        super().__init__()
        self.worker = worker
        self.plot_style: Style = style
        self._problem = ""
        """Why the last thing asked for was not done."""

    def look(self) -> None:
        """Show this moment."""
        raise NotImplementedError

    # Questions.

    def ask(self, question: str, hint: str, then: Callable[[str], None], value: str = "") -> None:
        self._problem = ""

        def answered(word: str | None) -> None:
            if word is not None:
                then(word)

        self.push_screen(Ask(self.plot_style, question, hint, value), answered)

    def ask_to_work(self, question: str, hint: str, what: str, do: Callable[[str], None], value: str = "") -> None:
        self.ask(question, hint, lambda word: self.work(what, lambda: do(word)), value)

    def confirm(self, question: str, lines: tuple[str, ...], what: str, do: Callable[[], None]) -> None:
        def answered(answer: str | None) -> None:
            if answer == "yes":
                self.work(what, do)

        self._problem = ""
        self.push_screen(Confirm(self.plot_style, question, lines), answered)

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

    def on_asking_app_finished(self, message: Finished) -> None:
        """Tell what went wrong; what went right is in the state."""
        if message.error is not None:
            self.notice(message.error)
        self.look()

    def do_now(self, do: Callable[[], None]) -> None:
        """Something that does not wait, but may be refused."""
        self._problem = ""
        try:
            do()
        except TippathError as problem:
            self._problem = str(problem)
        self.look()

    def notice(self, text: str) -> None:
        """Tell the user why something was not done."""
        self._problem = text
        self.look()
