"""The app's link to a vehicle: looked for until it is there, then watched; what it last told of rates and gains."""

from __future__ import annotations

import contextlib
import shlex
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from gcs.cards.maneuver import TestCard
from gcs.errors import LinkError, TippathError
from gcs.flight.connection import WallClock
from gcs.flight.live import LiveWindow, rates_alone
from gcs.flight.readiness import answer_where_needed, look
from gcs.flight.session import Session
from gcs.link.procedures import ProcedureError, ReadParameter
from gcs.tui.air_time import AirTime
from gcs.tui.moment import Moment
from gcs.tui.state import STARTING, Bank, Stage
from gcs.vehicle.autopilots import ACTIVE_CRC, STABILIZE, SWITCH, SYSTEMID
from gcs.vehicle.profile import VehicleProfile
from gcs.vehicle.snapshot import VehicleSnapshot

CONNECT_S = 3.0
AGAIN_S = 1.0
WATCH_S = 0.05
KEPT_TELEMETRY = 1200
SWITCH_S = 5.0
"""So often the pilot's switch is asked for between two runs: nobody tells when it is turned."""


class SimulatedVehicle(Protocol):
    """A simulated vehicle that the app started, and the pilot of it."""

    @property
    def ground_link(self) -> str: ...
    def say(self, line: str) -> str:
        """One line to its pilot; the reply."""

    def close(self) -> None: ...


SHELL_LINK = "udpin:127.0.0.1:14550"
"""Where `tippath sim` is heard."""


class VehicleLink:
    """Looks for the vehicle in a thread of its own, once begun."""

    def __init__(
        self,
        moment: Moment,
        link: str | None,
        start_vehicle: Callable[[], SimulatedVehicle] | None,
        open_session: Callable[..., Session],
        *,
        primary: bool,
        options: Sequence[str] = (),
        begun_by: str = "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`options` are those behind --connect that a shell needs to reach the same vehicle; `begun_by` the
        command that starts such a vehicle as the app's own simulated one; `clock` counts seconds."""
        self._clock = clock
        self.air = AirTime()
        self._options = tuple(options)
        self._begun_by = begun_by
        self._moment = moment
        self.word = link
        """The LINK; None where no vehicle is looked for, and until a simulated one has started."""
        self._start_vehicle = start_vehicle
        self._open_session = open_session
        self._primary = primary
        self.ending = threading.Event()
        self.session: Session | None = None
        self.mode_before = STABILIZE
        """The last mode that was not the excitation's."""
        self._reboots = 0
        self._switch_asked_s = 0.0
        self._vehicle: SimulatedVehicle | None = None
        self._telemetry: deque[tuple[float, float, float]] = deque(maxlen=KEPT_TELEMETRY)
        self._conductor = threading.Thread(target=self._conduct, name="tippath app", daemon=True)

    def begin(self) -> None:
        """Begin to look."""
        self._conductor.start()

    @property
    def shell_words(self) -> str:
        """The link and its options, as a shell takes them: of a simulated vehicle, whose port dies with the app, that
        of the command that starts another one."""
        return shlex.join([SHELL_LINK if self._begun_by else self.word or "LINK", *self._options])

    def did(self, command: str) -> None:
        """Append what a shell would do on this link, the vehicle first where the app started it."""
        if self._begun_by and self._begun_by not in self._moment.now.commands:
            self._moment.did(self._begun_by)
        self._moment.did(command)

    def snapshot(self) -> VehicleSnapshot | None:
        """The vehicle now; None where there is none."""
        if self.session is None:
            return None
        try:
            return self.session.snapshot()
        except LinkError:
            return None

    @property
    def air_s(self) -> float | None:
        """Seconds in the air; None where the vehicle was never seen there."""
        return self.air.seconds(self._clock())

    def rpm(self) -> float | None:
        """Of its rotor."""
        vehicle = self.snapshot()
        return None if vehicle is None else vehicle.rpm

    def window(self, last_s: float) -> LiveWindow:
        """The log's samples while it is recorded, else what telemetry told of the rates."""
        session = self.session
        if session is not None:
            with contextlib.suppress(LinkError):
                if session.snapshot().recording is not None:
                    window = session.samples(last_s)
                    if window.t.size:
                        return window
        with self._moment.lock:
            rows = tuple(self._telemetry)
        return rates_alone(rows, last_s)

    def pilot(self, line: str) -> None:
        """A line to the pilot of the simulated vehicle that this app started; there is none on any other link.

        `lqr` throws the bank switch to its other position.
        """
        vehicle = self._vehicle
        if vehicle is None:
            raise TippathError("there is no simulated pilot on this link")
        if line == "lqr":
            bank = self._moment.now.bank
            line = "lqr off" if bank is not None and bank.switch_on else "lqr on"
        reply = vehicle.say(line)
        self._moment.set(said=f"simulated pilot, {line}: {reply}")
        if line.startswith("lqr"):
            self._read_bank()

    def close(self) -> None:
        """Let the link and the simulated vehicle go. Twice is no harm."""
        if self.session is not None:
            self.session.close()
        if self._vehicle is not None:
            self._vehicle.close()

    def _conduct(self) -> None:
        try:
            if self._start_vehicle is not None:
                self._moment.set(trouble=STARTING)
                self._vehicle = self._start_vehicle()
                self.word = self._vehicle.ground_link
                self._moment.set(link=self.word)
                if self.ending.is_set():
                    self._vehicle.close()
                    return
        except TippathError as error:
            self._moment.set(trouble=str(error))
            return
        except Exception as error:  # a fault of ours is told, and no vehicle is waited for
            self._moment.set(trouble=f"the simulated vehicle did not start: {type(error).__name__}: {error}")
            return
        if self.word is None:
            return
        while not self.ending.is_set() and self.session is None:
            self._connect(self.word)
        while not self.ending.wait(WATCH_S):
            self._watch()

    def _connect(self, link: str) -> None:
        try:
            session = self._open_session(link, primary=self._primary, connect_timeout_s=CONNECT_S)
        except TippathError as error:
            self._moment.set(trouble=str(error))
            self.ending.wait(AGAIN_S)
            return
        with self._moment.lock:
            self.session = session
            self._moment.set(trouble=None, stage=Stage.IDLE)
        if self.ending.is_set():
            session.close()
            return
        threading.Thread(target=self._answer_log, args=(session, link), name="tippath log", daemon=True).start()
        self._read_bank()

    def _answer_log(self, session: Session, link: str) -> None:
        """Where the vehicle streams its log, answer it, so that it can be armed."""
        with contextlib.suppress(TippathError):
            answer_where_needed(session, WallClock(), link)

    def check(self, card: TestCard, profiles: Sequence[VehicleProfile]) -> None:
        """Look whether the card can be flown with the vehicle as it is set. Raises TippathError."""
        session, link = self.session, self.word
        if session is None or link is None:
            raise TippathError("there is no vehicle to look at")
        with self._moment.working("looking at the vehicle"):
            self._moment.set(readiness=look(session, WallClock(), card, link=link, profiles=profiles))

    def _watch(self) -> None:
        vehicle = self.snapshot()
        if vehicle is None:
            return
        self.air = self.air.seen(vehicle, self._clock())
        if vehicle.mode not in (SYSTEMID, -1):
            self.mode_before = vehicle.mode
        if vehicle.reboots != self._reboots and self.session is not None and self.word is not None:
            self._reboots = vehicle.reboots  # it may be set otherwise now
            self._moment.set(readiness=None)
            again = (self.session, self.word)
            threading.Thread(target=self._answer_log, args=again, name="tippath log", daemon=True).start()
        self._watch_switch(vehicle)
        at, p, q = vehicle.attitude_at_s, vehicle.p, vehicle.q
        if at is None or p is None or q is None:
            return
        with self._moment.lock:
            if not self._telemetry or self._telemetry[-1][0] < at:
                self._telemetry.append((at, p, q))

    def _watch_switch(self, vehicle: VehicleSnapshot) -> None:
        """Whether the LQR is selected, by the vehicle's newest word; where it has gains, it is asked now and then."""
        bank, now = self._moment.now.bank, self._clock()
        if bank is None or not bank.active:
            return
        told = next((one.value for one in reversed(vehicle.said) if one.name == SWITCH), None)
        if told is not None and (told == 1.0) is not bank.switch_on:
            self._moment.set(bank=replace(bank, switch_on=told == 1.0))
        calm = self._moment.now.stage in (Stage.IDLE, Stage.HELD) and not vehicle.lost
        if calm and now - self._switch_asked_s > SWITCH_S:
            self._switch_asked_s = now
            threading.Thread(target=self._ask_switch, name="tippath switch", daemon=True).start()

    def _ask_switch(self) -> None:
        """The answer is seen with all that the vehicle says."""
        session = self.session
        if session is not None:
            with contextlib.suppress(TippathError):
                session.call(ReadParameter(SWITCH, 1))

    def _read_bank(self) -> None:
        """What the vehicle holds, where it has a bank at all."""
        session = self.session
        if session is None:
            return
        try:
            active = session.call(ReadParameter(ACTIVE_CRC, 2)).value
            switch = session.call(ReadParameter(SWITCH, 2)).value
        except ProcedureError:
            return
        if active >= 0:
            before = self._moment.now.bank
            self._moment.set(bank=Bank(int(active), None if before is None else before.previous, switch == 1.0))
