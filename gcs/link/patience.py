"""How long to wait for an answer before asking again: by the answers that came, and longer each time."""

from __future__ import annotations


class Patience:
    """Of one conversation. Times in seconds, on whatever clock it is given."""

    FIRST_S = 1.0
    LEAST_S = 0.3
    MOST_S = 4.0

    def __init__(self) -> None:
        self.round_trip_s: float | None = None
        """From a question to its answer, the newest ones most; None before the first."""
        self._asked_at: float | None = None
        self._wait_s = self.FIRST_S
        self._due = 0.0
        self.unanswered = 0
        """Questions since the last answer."""
        self.answered_at = 0.0

    def asked(self, now: float) -> None:
        self.unanswered += 1
        self._asked_at = now if self.unanswered == 1 else None  # an answer to a repetition tells no time
        self._due = now + self._wait_s
        self._wait_s = min(2.0 * self._wait_s, self.MOST_S)

    def answered(self, now: float) -> None:
        if self._asked_at is not None:
            took = now - self._asked_at
            known = self.round_trip_s
            self.round_trip_s = took if known is None else 0.75 * known + 0.25 * took
            self._asked_at = None
        self.unanswered = 0
        self.answered_at = now
        known = self.FIRST_S / 3.0 if self.round_trip_s is None else self.round_trip_s
        self._wait_s = min(self.MOST_S, max(self.LEAST_S, 3.0 * known))
        self._due = now + self._wait_s

    def pause(self, now: float, seconds: float) -> None:
        """Ask nothing for so long."""
        self._due = now + seconds

    def is_over(self, now: float) -> bool:
        """Whether it is time to ask again."""
        return now >= self._due
