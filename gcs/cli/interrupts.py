"""What Ctrl-C, a hang-up and the other ways of ending a program do while a vehicle may be excited.

None of them ends the program at once: they ask for the end, and whoever flies brings the vehicle back first. Stopping
it with Ctrl-Z would stop our heartbeat in the middle of a sweep, so that is not taken.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

PATIENCE = 3
"""So many Ctrl-C until the program stops waiting for the vehicle."""


class Interrupts:
    """Counts the wishes to end."""

    def __init__(self) -> None:
        self.count = 0
        self.pressed = 0
        """Times somebody pressed Ctrl-C, as against a signal that nobody chose."""
        self.reason: str | None = None

    def __call__(self) -> str | None:
        """Why somebody wants the end, None while nobody does."""
        return self.reason

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.count += 1
        self.pressed += number == signal.SIGINT
        name = {signal.SIGINT: "Ctrl-C"}.get(signal.Signals(number), signal.Signals(number).name)
        self.reason = self.reason or name
        if self.count == 1:
            print(f"\n {name}: ending the excitation, then the recording", file=sys.stderr, flush=True)
        elif self.count < PATIENCE:
            print(
                f"\n still bringing the vehicle back; {PATIENCE - self.count} more gives up",
                file=sys.stderr,
                flush=True,
            )
        else:
            raise KeyboardInterrupt


@contextmanager
def interrupts() -> Iterator[Interrupts]:
    """While inside, ends are asked for and not taken; afterwards everything is as before."""
    wishes = Interrupts()
    before: dict[int, Any] = {}
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            before[number] = signal.signal(number, wishes._ask)
    if hasattr(signal, "SIGTSTP"):
        before[signal.SIGTSTP] = signal.signal(signal.SIGTSTP, signal.SIG_IGN)
    try:
        yield wishes
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
