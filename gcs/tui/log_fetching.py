"""A flight's log off the vehicle from within the app: the way of `tippath fetch`, called off by a key."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder
from gcs.flight.session import Session


class LogFetching:
    """One at a time."""

    def __init__(self) -> None:
        self._off = threading.Event()

    def call_off(self) -> None:
        """End it at its next piece."""
        self._off.set()

    def bring(self, session: Session, folder: Path, say: Callable[[str], None]) -> list[Path]:
        """The logs of a flight into its folder. Raises TippathError: refused, unanswered, called off."""
        # as the command: only where it is needed
        from gcs.flight.fetching.fetch import Fetching, Progress, require_disarmed
        from gcs.flight.fetching.of_flight import Asked, bring, choose, note, size_words, time_words
        from gcs.flight.fetching.ways import list_logs

        def on_progress(progress: Progress) -> None:
            if self._off.is_set():
                raise TippathError("fetching was called off; what came is kept, and I goes on with it")
            if progress.lost_s is not None:
                say(f"link lost for {progress.lost_s:.0f} s, waiting")
            elif progress.rate is not None and progress.left_s is not None:  # else it is only looked at
                share, rate = 100 * progress.at // max(1, progress.size), size_words(round(progress.rate))
                say(f"{share} %, {rate}/s, {time_words(progress.left_s)} left")

        self._off.clear()
        require_disarmed(session)
        flight = FlightFolder(folder)
        asked = Asked(output=folder, flight=flight if flight.about.is_file() else None)
        fetching = Fetching(session=session, on_progress=on_progress)
        came = []
        for one in choose(asked, fetching, list_logs(session), say):
            done = bring(asked, fetching, one, say)
            if asked.flight is not None:
                note(asked.flight, done, one.of)
            came.append(done.path)
        return came
