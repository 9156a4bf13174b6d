"""Which run of a card is flown next: in the card's order, or as somebody chooses who sees how each one went.

Nothing here moves the vehicle: a run that was chosen is made ready like any other, and started by its own key.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from gcs.cards.maneuver import CardRun
from gcs.flight.run import RunResult
from gcs.flight.run_state import Ending

AGAIN = (Ending.ABORTED, Ending.LIMIT, Ending.STOPPED)
"""Ends of a run after which the vehicle is where the pilot left it, and another may be made ready."""


class Choosing(Protocol):
    """Whoever decides between two runs, and whether anything is sent to a vehicle that is not heard."""

    def chosen(self) -> int | None:
        """Number of the run that is wished for in place of the one that waits for its start; each wish is told once."""

    def again(self, result: RunResult) -> bool:
        """Whether the card goes on after a run that ended early: by default with that run."""

    def blind(self) -> bool:
        """Whether a run's size is to be set to 0 while the vehicle is not heard (`gcs.flight.rules`, 8)."""


class InOrder:
    """Nobody decides: the card is flown from its first run to its last, and a run that ends early ends it."""

    def chosen(self) -> int | None:
        """None."""
        return None

    def again(self, result: RunResult) -> bool:
        """False."""
        return False

    def blind(self) -> bool:
        """False."""
        return False


IN_ORDER = InOrder()


def newest(flown: Sequence[RunResult]) -> dict[int, RunResult]:
    """Number of each run that was flown -> what its last try came to."""
    return {one.run.number: one for one in flown}


@dataclass(kw_only=True)
class Order:
    """Where a card stands, between two runs."""

    runs: Sequence[CardRun]
    flown: Sequence[RunResult]
    """So far; it grows."""
    choosing: Choosing
    locked: Callable[[CardRun], str]
    """Why a run may not be flown yet, empty where it may."""
    tell: Callable[[str], None]
    place: int | None = 0
    """In `runs`, of the one that is next; None after the last."""
    _wish: int | None = None

    def wished(self) -> bool:
        """Whether another run is wished for in place of the one that waits."""
        self._wish = self.choosing.chosen()
        return self._wish is not None

    def take_wish(self) -> bool:
        """Go to the run that is wished for, or tell why it cannot be flown; false where none was wished for."""
        if self._wish is None:
            return False
        number, self._wish = self._wish, None
        place = self._place_of(number)
        why = "it cannot be flown now" if place is None else self.locked(self.runs[place])
        if why:
            self.tell(f"run {number}: {why}")
        else:
            self.place = place
        return True

    def again(self, result: RunResult) -> bool:
        """Whether the card goes on, with the same run, after one that ended early."""
        return result.ending in AGAIN and not result.run.probe and self.choosing.again(result)

    def move_on(self) -> None:
        """After a run that came to its end. In order the next is the one behind; where somebody chooses, those that
        were not clean come up once more after the others."""
        at = self.place
        assert at is not None
        if self.choosing is IN_ORDER or self.runs[at].probe:
            self.place = at + 1 if at + 1 < len(self.runs) else None
            return
        left = [place for place, run in enumerate(self.runs) if not self._is_done(run) and not self.locked(run)]
        self.place = next((place for place in left if place > at), left[0] if left else None)

    def _place_of(self, number: int) -> int | None:
        """None where it is none of these, a probe, or a probe has to come first."""
        known = newest(self.flown)
        if any(run.probe and run.number not in known for run in self.runs):
            return None
        return next((i for i, run in enumerate(self.runs) if run.number == number and not run.probe), None)

    def _is_done(self, run: CardRun) -> bool:
        result = newest(self.flown).get(run.number)
        return result is not None and (run.probe or result.clean)
