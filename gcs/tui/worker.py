"""The app worker, between the screens and what flies: the state to show, and the few things a key may ask for.

The push is `gcs.flight.gains.push`, and what is done with a flight after it was flown `gcs.desk.Desk`: the same
functions as behind the commands. What is added here is only what a screen needs. When a card is over the desk opens the
flight by itself.

The state is replaced whole, under a lock, and never changed. `AppWorker` is what the app knows; tests give it another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from gcs.desk import Desk
from gcs.desk.shell import word
from gcs.errors import TippathError
from gcs.flight import gains
from gcs.flight.live import LiveWindow
from gcs.flight.session import Session
from gcs.flight.session_notes import SessionNote
from gcs.tui import state as view
from gcs.tui.card_flight import CardFlight
from gcs.tui.log_fetching import LogFetching
from gcs.tui.moment import Moment
from gcs.tui.state import FETCHING, Bank, State
from gcs.tui.vehicle_link import SimulatedVehicle, VehicleLink

CLOSE_S = 20.0
"""How long leaving may take while a run is brought to its end."""


class AppWorker(Protocol):
    """What the app asks. `state` and `window` never wait; `ready`, `start`, `end_card` and `abort` only set a wish."""

    @property
    def desk(self) -> Desk:
        """What is done with a flight after it was flown; its methods that wait are called from a worker."""

    def state(self) -> State: ...
    def window(self, last_s: float) -> LiveWindow: ...
    def ready(self) -> None: ...
    def start(self) -> None: ...
    def choose_run(self, number: int) -> None: ...
    def end_card(self) -> None: ...
    def abort(self) -> None: ...
    def replay(self, wish: str) -> None:
        """Move in a flight that is watched again; nothing elsewhere."""

    def answer(self, number: int, word: str) -> None:
        """To a question of the card's checklist. Raises TippathError."""

    # These wait, and are called from a worker. They raise TippathError.
    def note(self, note: SessionNote) -> None: ...
    def check(self) -> None: ...
    def take_over(self) -> None: ...
    def choose_card(self, word: str) -> None: ...
    def open_flight(self, *paths: str) -> None: ...
    def fit(self) -> None: ...
    def design(self) -> None: ...
    def push(self, why: str = "") -> None: ...
    def revert(self) -> None: ...
    def fetch_log(self) -> None: ...
    def call_off(self) -> None:
        """End what is fetched, at its next piece; never waits."""

    def pilot(self, line: str) -> None: ...
    def close(self) -> None: ...


class FlightWorker:
    """The real one. Made, it begins to look for the vehicle at once, in its own thread."""

    def __init__(
        self,
        link: str | None,
        *,
        plant: str | None = None,
        start_vehicle: Callable[[], SimulatedVehicle] | None = None,
        folder: Path = Path(),
        primary: bool = False,
        card: str = "",
        profile: str | None = None,
        probe: bool | None = None,
        options: Sequence[str] = (),
        begun_by: str = "",
        open_session: Callable[..., Session] = Session.open,
        make_desk: Callable[..., Desk] = Desk,
    ) -> None:
        """Without `link` and `start_vehicle` there is no vehicle, and the desk alone works. `make_desk` gives the desk
        to work on, told by `on_command` and `on_said` whom to tell. `profile` is the vehicle's, where it is not to be
        recognised. With `probe`, by default on every vehicle that the app did not start itself, a small step on each
        axis comes before a card."""
        self._moment = Moment(State(link=link or ("the simulated vehicle" if start_vehicle else ""), plant=plant))
        self._link = VehicleLink(
            self._moment, link, start_vehicle, open_session, primary=primary, options=options, begun_by=begun_by
        )
        self._card = CardFlight(
            self._moment,
            self._link,
            card,
            folder=folder,
            profile=profile,
            probe=start_vehicle is None if probe is None else probe,
            on_landed=self._read_flown,
        )
        self._desk = make_desk(
            on_command=self._moment.did, on_said=lambda text: self._moment.set(said=text, said_by_desk=True)
        )
        self._fetching = LogFetching()
        self._link.begin()

    # What the app reads.

    @property
    def desk(self) -> Desk:
        return self._desk

    def state(self) -> State:
        """This moment."""
        state = view.joined(self._moment.now, self._desk.state())
        session, vehicle = self._link.session, self._link.snapshot()
        if session is None or vehicle is None:
            return state
        received = session.samples(0.0).received if vehicle.recording is not None else 0
        state = replace(state, air_s=self._link.air_s, air_known=self._link.air.known)
        return replace(state, vehicle=vehicle, samples=received, station=session.station)

    def window(self, last_s: float) -> LiveWindow:
        return self._link.window(last_s)

    # What keys wish.

    def ready(self) -> None:
        self._card.ready()

    def start(self) -> None:
        self._card.start()

    def choose_run(self, number: int) -> None:
        self._card.choose_run(number)

    def end_card(self) -> None:
        self._card.end_card()

    def abort(self) -> None:
        self._card.abort()

    def replay(self, wish: str) -> None:
        """This one is flown."""

    def answer(self, number: int, word: str) -> None:
        self._card.logbook.answer(number, word)

    def note(self, note: SessionNote) -> None:
        """Into the flight under way, or the last one; before the first it waits."""
        self._card.logbook.note(note)

    @property
    def waiting_notes(self) -> tuple[str, ...]:
        """That no flight has taken."""
        return self._card.logbook.waiting

    def check(self) -> None:
        """Whether the card can be flown with the vehicle as it is set; not while a card is flown."""
        if self._moment.now.stage.under_way:
            raise TippathError("a card is being flown: the vehicle is looked at before and after it")
        self._link.check(self._card.card, self._card.profiles)

    def take_over(self) -> None:
        """Take another address that speaks as the vehicle for it; not while a card is flown."""
        if self._moment.now.stage.under_way:
            raise TippathError("a card is being flown: the vehicle stays the one that was started")
        if self._link.session is not None:
            self._link.session.take_over()

    def choose_card(self, word: str) -> None:
        self._card.choose(word)

    def pilot(self, line: str) -> None:
        self._link.pilot(line)

    # The flight, once it was flown.

    def _read_flown(self, flight: Path) -> None:
        """The desk goes on with what was flown last, as soon as it is free."""
        try:
            self._desk.open(str(flight), wait=True)
        except TippathError as error:
            self._moment.set(said=f"{flight.name} was not opened: {error}")
        except Exception as error:  # a fault of ours must not end the app
            self._moment.set(said=f"{flight.name} was not opened: {type(error).__name__}: {error}")

    def open_flight(self, *paths: str) -> None:
        """Other flight folders or logs to work on. Raises TippathError where there is none."""
        if self._moment.now.stage.under_way:
            raise TippathError("a card is being flown: end it first (1, then E)")
        self._desk.open(*paths)
        self._moment.set(flight=self._desk.state().path)

    def fit(self) -> None:
        """Fit the flight with the runs and the base that were chosen on the desk."""
        if self._moment.now.stage.under_way:
            raise TippathError("the card is still being flown; the fit comes after it")
        flight = self._moment.now.flight
        if flight is not None and self._desk.state().path != flight:
            self._desk.open(str(flight), wait=True)
        self._desk.fit()

    def design(self) -> None:
        """Gains on the ladder's last fit, kept as GAINS.json beside it."""
        self._desk.design()

    def push(self, why: str = "") -> None:
        """The designed gains to the vehicle, as one verified set; only on the ground, disarmed.

        Where they fail, or the vehicle is not as it was identified, only with words why: NotClearedError.
        """
        # scipy comes along: only where it is needed
        from gcs.analysis.pushing import push_judged, to_push

        session = self._on_ground()
        designed = self._desk.state().designed
        if designed is None:
            raise TippathError("no gains yet: D designs them")
        if designed.path is None:
            raise TippathError("the gains are not kept in any file yet: keep them in another folder first")
        with self._moment.working("pushing gains"):
            whole = replace(gains.gains_of(designed.gains.to_json()), identified=designed.identified)
            ready = to_push(whole, designed.clearance, why)
            pushed = push_judged(session, ready, lambda step: self._moment.set(busy=f"pushing gains: {step}"))
            result = pushed.result
            self._moment.set(
                bank=Bank(result.crc, result.previous_crc, result.switch_on),
                said=f"committed {result.crc:06x}: {len(result.values)} values read back, equal bit for bit"
                if result.committed
                else f"the vehicle held {result.crc:06x} already; nothing was written",
            )
            did = "pushed gains" if result.committed else "pushed gains that the vehicle held already:"
            banks = f"{gains.checksum(result.crc)}, before {gains.checksum(result.previous_crc)}"
            because = f" although something speaks against them, because: {why}" if why else ""
            said = f" --why {word(why)}" if why else ""
            self._moved(f"{did} {banks}{because}", f"tippath push {word(designed.path)}{said}")

    def revert(self) -> None:
        """Back to the bank before the last commit; only on the ground, disarmed."""
        session = self._on_ground()
        with self._moment.working("reverting"):
            result = gains.revert(session)
            bank = self._moment.now.bank
            self._moment.set(
                bank=Bank(result.crc, result.reverted_crc, None if bank is None else bank.switch_on),
                said=f"{result.crc:06x} is active again"
                if result.crc
                else "no LQR is active, as before the first push",
            )
            banks = f"{gains.checksum(result.crc)}, before {gains.checksum(result.reverted_crc)}"
            self._moved(f"reverted gains to {banks}", "tippath revert")

    def fetch_log(self) -> None:
        """The log of the flight that is open off the vehicle's card, beside what was streamed of it; it is read again.

        Only disarmed. What came of a fetch that was called off is gone on with by the next.
        """
        session = self._on_ground("a log is fetched")
        desk = self._desk.state()
        folder = desk.path
        if folder is None or not folder.is_dir():
            raise TippathError("no flight's folder is open: 3, then O opens one; its log comes into it")
        with self._moment.working(FETCHING):
            came = self._fetching.bring(session, folder, lambda text: self._moment.set(busy=f"{FETCHING}: {text}"))
        self._moment.set(said=f"fetched {', '.join(path.name for path in came)}")
        self._moved(f"fetched {', '.join(path.name for path in came)}", f"tippath fetch -o {word(folder)}")
        self._desk.open(str(folder), *map(str, desk.beside), wait=True)

    def call_off(self) -> None:
        self._fetching.call_off()

    def _moved(self, did: str, command: str) -> None:
        """Tell of gains that were moved."""
        on_link = f"{command} --connect {self._link.shell_words}"
        self._link.did(on_link)
        self._desk.audit(did, on_link)

    def _on_ground(self, what: str = "gains are moved") -> Session:
        reason = self.state().not_on_ground(what)
        if reason is not None:
            raise TippathError(reason)
        assert self._link.session is not None
        return self._link.session

    def close(self) -> None:
        """End a run under way, then recording, the link and the simulated vehicle. Twice is no harm."""
        self._desk.cancel()
        self.call_off()
        self._link.ending.set()
        self._card.close(CLOSE_S)
        self._link.close()
