"""A small Textual app to be served: it says what it hears."""

from __future__ import annotations

from textual import events
from textual.app import App, ComposeResult
from textual.binding import Binding
from textual.widgets import Button, Static


class Heard(App[None]):
    """Every key is shown, F12 counted; B rings, Q ends it."""

    BINDINGS = [Binding("f12", "abort", priority=True)]
    CSS = "#keys { height: 3; } Button { width: 30; }"

    def __init__(self) -> None:
        super().__init__()
        self.keys = ""
        self.aborted = 0

    def compose(self) -> ComposeResult:
        yield Static("ready", id="keys", markup=False)
        yield Static("", id="size")
        yield Button("press me", id="button")

    def on_mount(self) -> None:
        self.set_focus(None)

    def on_resize(self, event: events.Resize) -> None:
        self.query_one("#size", Static).update(f"size {event.size.width}x{event.size.height}")

    def on_key(self, event: events.Key) -> None:
        if event.key == "b":
            self.bell()
        if event.key == "q":
            self.exit()
        self.show(event.character if event.is_printable and event.character else event.key)

    def on_button_pressed(self) -> None:
        self.show("(pressed)")

    def action_abort(self) -> None:
        self.aborted += 1
        self.show("")

    def show(self, key: str) -> None:
        self.keys += key
        self.query_one("#keys", Static).update(f"ready <{self.keys}> aborted {self.aborted}")


if __name__ == "__main__":
    Heard().run()
