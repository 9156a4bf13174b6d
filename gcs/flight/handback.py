"""The vehicle as it was found: out of the excitation mode, and with its own values in all that a maneuver wrote.

Nothing is written while it may be excited, because the vehicle reads some parameters in every loop: only after the
last run is cleared (see `gcs.flight.rules`; a size of 0 that somebody wanted sent unheard is the exception). What
could not be given back is said.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from gcs.errors import TippathError
from gcs.flight.connection import Clock, Connection
from gcs.flight.excitation import Excitation
from gcs.flight.rules import TICK_S
from gcs.flight.run_state import Ending, Phase
from gcs.flight.settings import give_back
from gcs.link.clock import SWAP_S
from gcs.vehicle.profile import VehicleProfile

TELL_AFTER_S = 2.0
"""A run that takes longer to clear is told of."""
PROOF_S = 10.0
"""How long it is waited for that the rules take a vehicle for cleared, before the program ends."""


@dataclass(kw_only=True)
class Handback:
    """What is in the vehicle now, what was before, and the last run, until all is as it was."""

    session: Connection
    profile: VehicleProfile
    clock: Clock
    tell: Callable[[str], None]
    settings: dict[str, float] = field(default_factory=dict)
    """What is in the vehicle now, of what a maneuver writes."""
    own: Mapping[str, float] = field(default_factory=dict)
    """What was there before the first run."""
    flown: Excitation | None = None
    """The last run, which is watched until it is cleared before anything is written."""
    unrestored: Mapping[str, float] | None = None
    """The vehicle's own settings, where they could not be put back."""
    _resumed: bool = field(default=False, init=False)
    """A way back that was given up has gone on again."""

    def clear(self, interruptions: Callable[[], int] = lambda: 0) -> bool:
        """Watch the last run until nothing of ours can excite the vehicle any more; false where that is not known.

        Ctrl-C ends the watch, but while the vehicle is being brought back only the third does.
        """
        flown, began, told, pressed, interrupted = self.flown, self.clock.now(), False, interruptions(), 0
        if flown is None:
            return True
        if flown.stills and flown.plan.size is not None:
            self.settings[flown.plan.size] = math.nan  # the 0 that was sent unheard may have come, or not
        while True:
            try:
                if not flown.watch(given_up=interruptions() > pressed):
                    return flown.state.cleared
                if not told and self.clock.now() - began > TELL_AFTER_S:
                    told = True
                    self.tell("watching the mode until no order of ours can be under way any more")
                self.clock.sleep(TICK_S)
            except KeyboardInterrupt:
                interrupted += 1
                if not flown.out_of_hand or interrupted >= 3:
                    raise

    @property
    def uncleared(self) -> str:
        return "" if self.flown is None else self.flown.state.reason or "whether the vehicle is excited is not known"

    def restore(self, interruptions: Callable[[], int] = lambda: 0) -> None:
        """The vehicle's own settings again, once it is certainly not excited."""
        self.unrestored = self.own
        cleared = self.clear(interruptions)
        snapshot = self.session.snapshot()
        if cleared and not snapshot.lost and snapshot.mode != self.profile.excitation_mode:
            self._give_back(self.own)

    def _give_back(self, parameters: Mapping[str, float]) -> None:
        self.clock.sleep(SWAP_S)  # a copy of what was written a moment ago may still come, and would undo this
        for words in give_back(self.session, self.profile, self.settings, parameters):
            self.tell(words)
        self.unrestored = None

    @property
    def _ours(self) -> bool:
        """A start that this program asked for may excite the vehicle still."""
        return self.flown is not None and self.flown.state.asks > 0 and not self.flown.state.cleared

    @property
    def _shows_excitation(self) -> bool:
        """The vehicle is heard, and its last heartbeat shows the excitation mode."""
        snapshot = self.session.snapshot()
        return not snapshot.lost and snapshot.mode == self.profile.excitation_mode

    def last_look(self) -> None:
        """The rest of the log took its time: a vehicle that was not heard may be heard again, and still be excited."""
        with contextlib.suppress(TippathError):
            told_by_log = not self._ours
            self._go_on_with_way_back()
            self._see_it_out()
            if self._shows_excitation:
                self.tell(f"the mode is {self.session.snapshot().mode_name} again: `tippath abort` ends it")
            elif self.unrestored is not None and self._out(told_by_log):
                self._give_back(self.unrestored)
        if self.unrestored is not None:
            self.tell("the maneuver's parameters stay in the vehicle: it could not be told otherwise")

    def watch_on(self) -> None:
        """A watch that Ctrl-C cut short goes on while the rest of the log arrives, and one that was given up where the
        vehicle is heard again, and still excited."""
        self._go_on_with_way_back()
        if self.flown is not None and self.flown.state.phase in (Phase.WATCHING, Phase.RETURNING):
            with contextlib.suppress(TippathError):
                self.flown.watch()

    def _go_on_with_way_back(self) -> None:
        """Of a vehicle that was given up, is heard again, and a start of ours still excites."""
        flown = self.flown
        if flown is None or flown.state.phase is not Phase.ENDED or flown.state.ending is Ending.STUCK:
            return
        if self._ours and self._shows_excitation:
            self.tell("it is heard again, and still excited: the mode before the run is asked for")
            flown.resume()
            self._resumed = True

    def _see_it_out(self) -> None:
        """A way back that goes on is brought to its end, by the same rules, and the vehicle watched until it is
        cleared; in words what came of it."""
        flown = self.flown
        if flown is None:
            return
        end = self.clock.now() + PROOF_S
        try:
            while flown.out_of_hand or (flown.state.phase is Phase.WATCHING and self.clock.now() < end):
                flown.watch()
                if flown.out_of_hand:
                    end = self.clock.now() + PROOF_S
                self.clock.sleep(TICK_S)
        except KeyboardInterrupt:
            if flown.out_of_hand:
                self.tell("bringing it back was interrupted: the pilot must take it")
            raise
        if self._resumed:
            self.tell(self.uncleared if self._ours else f"it shows {self.session.snapshot().mode_name} now")

    def _out(self, told_by_log: bool) -> bool:
        """Whether the vehicle shows another mode, and no start of ours is under way: cleared while its log arrived, or
        never contradicted, because nothing tells it from a stranger once the log has ended."""
        snapshot, flown = self.session.snapshot(), self.flown
        if snapshot.lost or self._ours:
            return False
        if flown is None or not flown.state.asks or told_by_log:
            return True
        excited = [b.mode == flown.plan.mode for b in snapshot.beats if b.at_s >= flown.state.asked_at]
        first = excited.index(True) if True in excited else len(excited)
        back_again = any(now and not before for before, now in itertools.pairwise(excited[first:]))
        return not (flown.state.contradictions or back_again)
