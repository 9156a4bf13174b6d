"""What keys do in the field, on every screen: the guide, and the sealed answer of what was hidden."""

from __future__ import annotations

from pathlib import Path

from gcs.demo.revealed import revealed
from gcs.desk import shell
from gcs.tui.desk_keys import DeskApp
from gcs.tui.dialogs import Told
from gcs.tui.plot import Style
from gcs.tui.worker import AppWorker


class FieldApp(DeskApp):
    """The part of the app that helps whoever stands beside the runway."""

    def __init__(self, worker: AppWorker, style: Style) -> None:
        super().__init__(worker, style)
        self.guided = False
        """A line at a time says what is seen."""

    def action_guide(self) -> None:
        """The guide comes, or goes."""
        self.guided = not self.guided
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
