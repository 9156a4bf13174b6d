"""A recorded flight watched again: the same screens, at any speed, with nothing that anything could be sent to.

There is no session and no link: what would be asked of a vehicle is refused in a line.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gcs.desk import Desk
from gcs.errors import TippathError
from gcs.flight.live import LiveWindow
from gcs.flight.session_notes import SessionNote
from gcs.logs.replay import PastFlight, PastRun, past_flight
from gcs.tui import state as view
from gcs.tui.moment import Moment
from gcs.tui.state import Mark, Progress, Replaying, RunView, Stage, State, Swept
from gcs.vehicle.autopilots import STABILIZE, SYSTEMID
from gcs.vehicle.snapshot import VehicleSnapshot

NOTHING_SENT = "this is a REPLAY: nothing is sent to any vehicle"
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
STEP_S = 5.0
BEFORE_S = 1.0
"""A run is looked for so much before its excitation."""


@dataclass(frozen=True, slots=True)
class Player:
    """Where a replay is: pure, time is handed in. Seconds of the flight are counted from its first sample."""

    length_s: float
    speed: float = 1.0
    paused: bool = False
    from_s: float = 0.0
    """Where it was when the clock showed `since_s`."""
    since_s: float = 0.0

    def at(self, now_s: float) -> float:
        """Seconds of the flight at a moment of the clock."""
        at_s = self.from_s + (0.0 if self.paused else self.speed * (now_s - self.since_s))
        return min(max(at_s, 0.0), self.length_s)

    def moved(self, now_s: float, to_s: float) -> Player:
        """Somewhere else."""
        return replace(self, from_s=min(max(to_s, 0.0), self.length_s), since_s=now_s)

    def pausing(self, now_s: float) -> Player:
        """Paused, or going on; from its end it goes on at the begin."""
        at_s = self.at(now_s)
        over = at_s >= self.length_s
        paused = False if over else not self.paused
        return replace(self.moved(now_s, 0.0 if over else at_s), paused=paused)

    def at_speed(self, now_s: float, speed: float) -> Player:
        """Faster or slower from here on."""
        return replace(self.moved(now_s, self.at(now_s)), speed=speed)

    def faster(self, now_s: float, by: int) -> Player:
        """The next speed up or down."""
        others = [one for one in SPEEDS if (one > self.speed if by > 0 else one < self.speed)]
        if not others:
            return self
        return self.at_speed(now_s, others[0] if by > 0 else others[-1])


class ReplayWorker:
    """What the app asks (`AppWorker`), of a flight that is over. Made, it begins to read in a thread of its own."""

    def __init__(
        self,
        path: Path,
        *,
        speed: float = 1.0,
        make_desk: Callable[..., Desk] = Desk,
        read: Callable[[Path], PastFlight] = past_flight,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`speed` is that of the clock times so much; `read` gives the flight, `clock` seconds."""
        self._path = path
        self._read = read
        self._clock = clock
        self._moment = Moment(State(link="", card=path.name, trouble=f"{path.name} is read", flight=path))
        self._desk = make_desk(
            on_command=self._moment.did, on_said=lambda text: self._moment.set(said=text, said_by_desk=True)
        )
        self._flight: PastFlight | None = None
        self._player = Player(0.0, speed)
        threading.Thread(target=self._open, name="tippath replay", daemon=True).start()

    def _open(self) -> None:
        try:
            flight = self._read(self._path)
        except Exception as error:  # a log that cannot be read, or a fault of ours: told, and the app goes on
            self._moment.set(trouble=f"{self._path.name} cannot be replayed: {error}")
            return
        with self._moment.lock:
            length_s = flight.stop_s - flight.start_s
            self._player = replace(self._player, length_s=length_s, since_s=self._clock())
            self._flight = flight
            self._moment.set(trouble=None, limits=flight.limits, card=flight.card or flight.name)
        try:
            self._desk.open(str(self._path), wait=True)
        except TippathError as error:
            self._moment.set(said=f"{self._path.name} was not opened: {error}")

    # What the app reads.

    @property
    def desk(self) -> Desk:
        return self._desk

    @property
    def waiting_notes(self) -> tuple[str, ...]:
        """None: a recorded flight takes them."""
        return ()

    def state(self) -> State:
        """This moment of the flight."""
        state = view.joined(self._moment.now, self._desk.state())
        flight, player, now_s = self._flight, self._player, self._clock()
        if flight is None:
            return state
        at_s = player.at(now_s)
        told = Replaying(flight.name, at_s, player.length_s, player.speed, player.paused or at_s >= player.length_s)
        return replace(past_moment(state, flight, flight.start_s + at_s), replay=told)

    def window(self, last_s: float) -> LiveWindow:
        flight = self._flight
        if flight is None:
            none = np.empty(0)
            return LiveWindow(
                t=none, p=none, q=none, delta_x=none, delta_y=none, excitation_x=none, excitation_y=none
            )  # fmt: skip
        return flight.window(flight.start_s + self._player.at(self._clock()), last_s)

    # What keys wish.

    def replay(self, wish: str) -> None:
        """`pause`, `back`, `forward`, `faster`, `slower`, `before` (the run before) or `after`."""
        with self._moment.lock:
            flight, player, now_s = self._flight, self._player, self._clock()
            if flight is None:
                return
            at_s = player.at(now_s)
            match wish:
                case "pause":
                    self._player = player.pausing(now_s)
                case "back" | "forward":
                    self._player = player.moved(now_s, at_s + (STEP_S if wish == "forward" else -STEP_S))
                case "faster" | "slower":
                    self._player = player.faster(now_s, 1 if wish == "faster" else -1)
                case _:
                    starts = [run.start_s - flight.start_s - BEFORE_S for run in flight.runs]
                    self._player = player.moved(now_s, _neighbour(starts, at_s, after=wish == "after"))

    def choose_run(self, number: int) -> None:
        """Go to a run."""
        with self._moment.lock:
            flight = self._flight
            if flight is not None and 0 < number <= len(flight.runs):
                to_s = flight.runs[number - 1].start_s - flight.start_s - BEFORE_S
                self._player = self._player.moved(self._clock(), to_s)

    def abort(self) -> None:
        self._refuse()

    def ready(self) -> None:
        self._refuse()

    def start(self) -> None:
        self._refuse()

    def end_card(self) -> None:
        self._refuse()

    def _refuse(self) -> None:
        self._moment.set(said=NOTHING_SENT)

    def answer(self, number: int, word: str) -> None:
        raise TippathError(NOTHING_SENT)

    def check(self) -> None:
        raise TippathError(NOTHING_SENT)

    def take_over(self) -> None:
        raise TippathError(NOTHING_SENT)

    def choose_card(self, word: str) -> None:
        raise TippathError(NOTHING_SENT)

    def push(self, why: str = "") -> None:
        raise TippathError(NOTHING_SENT)

    def revert(self) -> None:
        raise TippathError(NOTHING_SENT)

    def fetch_log(self) -> None:
        raise TippathError(NOTHING_SENT)

    def pilot(self, line: str) -> None:
        raise TippathError(NOTHING_SENT)

    def call_off(self) -> None:
        """Nothing is ever fetched here."""

    # What is done with the flight, as ever.

    def note(self, note: SessionNote) -> None:
        self._desk.note(note.text)

    def open_flight(self, *paths: str) -> None:
        self._desk.open(*paths)

    def fit(self) -> None:
        self._desk.fit()

    def design(self) -> None:
        self._desk.design()

    def close(self) -> None:
        """Nothing is to be ended. Twice is no harm."""
        self._desk.cancel()


def _neighbour(starts: list[float], at_s: float, *, after: bool) -> float:
    """The start behind a moment, or the one before; the begin where there is none before, the moment where none is
    behind."""
    if after:
        return next((start for start in starts if start > at_s + 0.1), at_s)
    return next((start for start in reversed(starts) if start < at_s - 1.0), 0.0)


def past_moment(state: State, flight: PastFlight, at_s: float) -> State:
    """The state with what was known of a flight at a moment of its log's clock."""
    place = flight.flying(at_s)
    runs = tuple(_seen(i, run, at_s) for i, run in enumerate(flight.runs))
    flown = [run for run in flight.runs if run.start_s <= at_s]
    progress = None
    if place is not None:
        run = flight.runs[place]
        progress = Progress(
            at_s - run.start_s,
            run.stop_s - run.start_s,
            flight.hertz(at_s),
            "as it was flown",
            _swept(flight, run, at_s),
        )
    return replace(
        state,
        vehicle=VehicleSnapshot(
            system=0,
            component=0,
            link_age_s=0.0,
            lost=False,
            mode=STABILIZE if place is None else SYSTEMID,
            mode_name="between runs" if place is None else "excited",
            armed=False,
            rpm=flight.rpm(at_s),
        ),
        stage=Stage.IDLE,
        runs=runs,
        current=0 if place is None else place + 1,
        progress=progress,
        use=flight.used(flown[-1], at_s) if flown else None,
    )


def _swept(flight: PastFlight, run: PastRun, at_s: float) -> Swept | None:
    """Of a chirp whose band and frequency are told."""
    hertz = flight.hertz(at_s)
    if run.kind != "chirp" or run.band_hz is None or hertz is None:
        return None
    return Swept(run.axis, *run.band_hz, hertz)


def _seen(place: int, run: PastRun, at_s: float) -> RunView:
    """A run as it was known then: nothing of its verdict before its end."""
    over = at_s >= run.stop_s
    mark = Mark.WAITING if at_s < run.start_s else Mark.FLYING
    if over:
        mark = Mark.KEEP if run.keep else Mark.AGAIN
    return RunView(
        number=place + 1,
        label=run.label,
        numbers=run.numbers,
        kind=run.kind,
        mark=mark,
        why=run.why if over else (),
    )
