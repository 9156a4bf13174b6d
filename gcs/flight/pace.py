"""How time goes by for a session: the wall clock with two threads, or in tests a time of their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Protocol

BEAT_S = 1.0


class Pace(Protocol):
    """How time goes by while somebody waits for the vehicle, and who does a session's work meanwhile."""

    def now(self) -> float:
        """Seconds that never go back."""
        ...

    def wait(self, event: threading.Event, seconds: float) -> bool:
        """Until it is set, but no longer; whether it is."""
        ...

    def begin(self, turn: Callable[[], None], beat: Callable[[], None]) -> None:
        """From now on take `turn` after `turn`, and every second `beat`; neither raises."""
        ...

    def end(self) -> None:
        """No more of either once this returns."""
        ...


class RealTime:
    """The wall clock and two threads: turns wait for bytes, beats wait for nothing else."""

    def __init__(self) -> None:
        self._ending = threading.Event()
        self._threads: tuple[threading.Thread, ...] = ()

    def now(self) -> float:
        return time.monotonic()

    def wait(self, event: threading.Event, seconds: float) -> bool:
        return event.wait(seconds)

    def begin(self, turn: Callable[[], None], beat: Callable[[], None]) -> None:
        def take_turns() -> None:
            while not self._ending.is_set():
                turn()

        def keep_beating() -> None:
            beat()
            while not self._ending.wait(BEAT_S):
                beat()

        self._threads = (
            threading.Thread(target=take_turns, name="tippath engine", daemon=True),
            threading.Thread(target=keep_beating, name="tippath heartbeat", daemon=True),
        )
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        self._ending.set()
        for thread in self._threads:
            thread.join(2.0)
