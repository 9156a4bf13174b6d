"""A worker whose link can be changed: each link gets a worker of its own, the desk with its flight stays.

A link is left only while no card is under way; the vehicle is left as it is.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from gcs.demo.pilot import SimulatedVehicle
from gcs.desk import Desk
from gcs.errors import TippathError
from gcs.flight.live import LiveWindow
from gcs.flight.session import Session
from gcs.flight.session_notes import SessionNote
from gcs.tui.connections import NOWHERE, Connection, connections, vehicle_logs
from gcs.tui.replay import ReplayWorker
from gcs.tui.state import State
from gcs.tui.worker import FlightWorker


class Reconnecting:
    """What the app asks (`AppWorker`), and beside it where to connect to.

    primary: be the station whose heartbeat holds a real vehicle's failsafe; of a simulated one it always does.
    probe: as `FlightWorker`'s. key, system: as `Session.open`'s, of a real vehicle.
    """

    def __init__(
        self,
        connection: Connection = NOWHERE,
        *,
        folder: Path = Path(),
        primary: bool = False,
        card: str = "",
        profile: str | None = None,
        probe: bool | None = None,
        key: Path | None = None,
        system: int | None = None,
        make: Callable[..., FlightWorker] = FlightWorker,
        make_vehicle: Callable[..., SimulatedVehicle] = SimulatedVehicle,
    ) -> None:
        self._folder = folder
        self._primary = primary
        self._card = card
        self._profile = profile
        self._probe = probe
        self._key = key
        self._system = system
        self._make = make
        self._make_vehicle = make_vehicle
        self._changing = threading.Lock()
        self._before: tuple[str, ...] = ()
        """Commands done on links that were left."""
        self._on_command: Callable[[str], None] = lambda _: None
        self._on_said: Callable[[str], None] = lambda _: None
        self._desk = Desk(on_command=lambda text: self._on_command(text), on_said=lambda text: self._on_said(text))
        self._secret: Path | None = None
        self._connection = connection
        self._now = self._on(connection)

    # Where to.

    @property
    def connection(self) -> Connection:
        """Where we are, or try to be."""
        return self._connection

    def connections(self) -> tuple[Connection, ...]:
        """What there is to connect to; looks at ports and folders."""
        return connections(self._folder)

    def connect(self, connection: Connection) -> None:
        """Leave this link for another; waits until the old one is gone. Raises TippathError during a card."""
        if not self._changing.acquire(blocking=False):
            raise TippathError("wait: another link is being opened")
        try:
            if self._now.state().stage.under_way:
                raise TippathError("a card is being flown: end it first (2, then E)")
            # Two links to one port cannot be; so the old one goes first. What it says until then is still true.
            self._now.close()
            self._before = self.state().commands
            self._connection = connection
            self._now = self._on(connection)
        finally:
            self._changing.release()

    def _on(self, connection: Connection) -> FlightWorker | ReplayWorker:
        start: Callable[[], SimulatedVehicle] | None = None
        self._secret = None
        if connection.replay is not None:
            return ReplayWorker(connection.replay, speed=connection.speed, make_desk=self._taken_over)
        if connection.plant is not None:

            def start() -> SimulatedVehicle:
                seed = secrets.randbelow(10_000) if connection.hidden and connection.seed is None else connection.seed
                directory = vehicle_logs(self._folder, connection.hidden)
                self._secret = directory if connection.hidden else None
                return self._make_vehicle(
                    connection.plant,
                    directory,
                    seed=seed,
                    on_ground=connection.on_ground,
                    more=("--hidden", "random") if connection.hidden else (),
                )

        real = connection.plant is None
        options = [] if self._key is None else ["--key", str(self._key)]
        options += [] if self._system is None else ["--system", str(self._system)]
        return self._make(
            connection.link,
            open_session=partial(Session.open, key=self._key, system=self._system) if real else Session.open,
            plant=connection.flies,
            start_vehicle=start,
            folder=self._folder,
            primary=self._primary or connection.plant is not None,
            card=connection.card or self._card,
            profile=self._profile,
            probe=self._probe,
            options=options if real else (),
            begun_by="" if real else begun_in_a_shell(connection),
            make_desk=self._taken_over,
        )

    def _taken_over(self, *, on_command: Callable[[str], None], on_said: Callable[[str], None]) -> Desk:
        self._on_command, self._on_said = on_command, on_said
        return self._desk

    # The worker on the link that is there.

    @property
    def desk(self) -> Desk:
        return self._desk

    def state(self) -> State:
        """This moment."""
        state = self._now.state()
        return replace(state, commands=(*self._before, *state.commands), secret=self._secret)

    def window(self, last_s: float) -> LiveWindow:
        return self._now.window(last_s)

    def ready(self) -> None:
        self._now.ready()

    def start(self) -> None:
        self._now.start()

    def choose_run(self, number: int) -> None:
        self._now.choose_run(number)

    def end_card(self) -> None:
        self._now.end_card()

    def abort(self) -> None:
        self._now.abort()

    def replay(self, wish: str) -> None:
        self._now.replay(wish)

    def answer(self, number: int, word: str) -> None:
        self._now.answer(number, word)

    def note(self, note: SessionNote) -> None:
        self._now.note(note)

    @property
    def waiting_notes(self) -> tuple[str, ...]:
        """That no flight has taken."""
        return self._now.waiting_notes

    def check(self) -> None:
        self._now.check()

    def take_over(self) -> None:
        self._now.take_over()

    def choose_card(self, word: str) -> None:
        self._now.choose_card(word)
        self._card = word

    def open_flight(self, *paths: str) -> None:
        self._now.open_flight(*paths)

    def fit(self) -> None:
        self._now.fit()

    def design(self) -> None:
        self._now.design()

    def push(self, why: str = "") -> None:
        self._now.push(why)

    def revert(self) -> None:
        self._now.revert()

    def fetch_log(self) -> None:
        self._now.fetch_log()

    def call_off(self) -> None:
        self._now.call_off()

    def pilot(self, line: str) -> None:
        self._now.pilot(line)

    def close(self) -> None:
        """End what is there. Twice is no harm."""
        self._now.close()


def begun_in_a_shell(connection: Connection) -> str:
    """What starts such a simulated vehicle there; another draw of what is hidden, unless a seed was given."""
    words = ["tippath", "sim", *(["--hidden", "random"] if connection.hidden else ["--plant", str(connection.plant)])]
    words += [] if connection.seed is None else ["--seed", str(connection.seed)]
    return " ".join([*words, *(["--on-ground"] if connection.on_ground else []), "&"])
