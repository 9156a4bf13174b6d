"""What keys do on each screen, once: bindings, the footer and the palette are all made from it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from textual.binding import Binding, BindingType


@dataclass(frozen=True, slots=True)
class Act:
    """One thing that a key does."""

    keys: str
    """As Textual names them, `f,F`."""
    action: str
    """`app.work('fit')`, or a method of the screen."""
    word: str
    """On the footer, behind the key; empty where there is no room for it."""
    name: str
    """In the palette and in help."""
    shown: str = ""
    """The key as people call it, where that is not the first of `keys` in capitals."""

    @property
    def key(self) -> str:
        return self.shown or self.keys.partition(",")[0].upper()


def both(letter: str) -> str:
    """A letter as it is shown and as it is typed."""
    return f"{letter.lower()},{letter.upper()}"


def bindings(acts: Iterable[Act]) -> list[BindingType]:
    """For Textual."""
    return [Binding(act.keys, act.action, act.word or act.name, show=False) for act in acts]


def footer(acts: Iterable[Act]) -> str:
    """The keys, and what they do."""
    return "  ".join(f"{act.key} {act.word}" for act in acts if act.word)


PILOT = (
    Act("t,T", "app.pilot('takeoff')", "take off", "the simulated pilot takes off"),
    Act("l,L", "app.pilot('land')", "land", "the simulated pilot lands, and changes the battery"),
    Act("b,B", "app.pilot('lqr')", "bank switch", "the simulated pilot's switch: LQR, or autopilot"),
)
"""The simulated pilot's."""
HELP = Act("question_mark,f1", "app.screen('help')", "help", "what the keys do", "?")
GUIDE = Act("f3", "app.guide", "guide", "the guide: a line at a time says what you see; again, and it is gone", "F3")
NOTE = Act("n,N", "app.note", "note", "write a note, with the time of flight")
REVEAL = Act("z,Z", "app.reveal", "", "open the sealed answer of a hidden effect")
REPLAY = Act("f4", "app.replay_open", "replay", "watch the flight that is open again, on Fly, at any speed", "F4")
QUIT = Act("q,Q", "app.leave", "quit", "quit", "q")
ANYWHERE = (
    Act("f12", "app.abort", "abort", "abort: back to the mode before the run", "F12/space"),
    HELP,
    NOTE,
    QUIT,
    Act("f2", "app.palette", "all keys", "every action of every screen", "F2"),
    GUIDE,
    REPLAY,
)
"""At the end of every screen's footer, as far as there is room."""
SCROLL = (
    Act("down", "scroll(1)", "", "scroll down", "down"),
    Act("up", "scroll(-1)", "", "scroll up", "up"),
    Act("pagedown", "scroll(10)", "", "scroll down by a page", "page down"),
    Act("pageup", "scroll(-10)", "", "scroll up by a page", "page up"),
)
