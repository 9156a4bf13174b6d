"""Between the app and what flies: the state to show, and the few things a key may ask for.

The flying itself is `gcs.flight.sweep.fly_card`, the push `gcs.flight.gains.push`, and what is done with a flight after
it was flown `gcs.desk.Desk`: the same functions as behind the commands. What is added here is only what a screen needs:
the card runs in a thread of its own and waits before every run until that run was made ready and then started, two
steps; while it waits, a change of mode, a disarmed vehicle or a lost link calls the card off, so that nothing starts
later that nobody looks at any more. When it is over the desk opens the flight by itself.

The state is replaced whole, under a lock, and never changed. `Engine` is what the app knows; tests give it another.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gcs.cards.maneuver import CardRun, TestCard, load_card
from gcs.desk import Desk
from gcs.desk.shell import word
from gcs.errors import LinkError, TippathError
from gcs.flight.folder import create
from gcs.flight.live import LiveWindow
from gcs.flight.session import Session
from gcs.flight.sweep import (
    Briefing,
    Ending,
    Note,
    Phase,
    Probed,
    Progress,
    RunProgress,
    RunReady,
    RunResult,
    SweepResult,
    abort,
    fly_card,
    free_bytes,
    require_flyable,
)
from gcs.link.procedures import ProcedureError, ReadParameter
from gcs.tui import state as view
from gcs.tui.state import Bank, Mark, RunView, Stage, State
from gcs.vehicle.autopilots import ACTIVE_CRC, STABILIZE, SWITCH, SYSTEMID
from gcs.vehicle.profile import load_profile
from gcs.vehicle.snapshot import VehicleSnapshot

CONNECT_S = 3.0
AGAIN_S = 1.0
WATCH_S = 0.05
CLOSE_S = 20.0
"""How long leaving may take while a run is brought to its end."""
KEPT_TELEMETRY = 1200
TOO_EARLY = "not yet: a run is under way"


class Engine(Protocol):
    """What the app asks. `state` and `window` never wait; `ready`, `start`, `end_card` and `abort` only set a wish."""

    @property
    def desk(self) -> Desk:
        """What is done with a flight after it was flown; its methods that wait are called from a worker."""

    def state(self) -> State: ...
    def window(self, last_s: float) -> LiveWindow: ...
    def ready(self) -> None: ...
    def start(self) -> None: ...
    def end_card(self) -> None: ...
    def abort(self) -> None: ...

    # These wait, and are called from a worker. They raise TippathError.
    def choose_card(self, word: str) -> None: ...
    def open_flight(self, path: str) -> None: ...
    def fit(self) -> None: ...
    def design(self) -> None: ...
    def push(self) -> None: ...
    def revert(self) -> None: ...
    def pilot(self, line: str) -> None: ...
    def close(self) -> None: ...


class SimulatedVehicle(Protocol):
    """A simulated vehicle that the app started, and the pilot of it."""

    @property
    def ground_link(self) -> str: ...
    def say(self, line: str) -> str:
        """One line to its pilot; the reply."""

    def close(self) -> None: ...


class FlightEngine:
    """The real one. Made, it begins to look for the vehicle at once, in its own thread."""

    def __init__(
        self,
        link: str | None,
        *,
        plant: str | None = None,
        start_vehicle: Callable[[], SimulatedVehicle] | None = None,
        folder: Path = Path(),
        primary: bool = False,
        card: str = "hover",
        profile: str | None = None,
        probe: bool | None = None,
        open_session: Callable[..., Session] = Session.open,
        make_desk: Callable[..., Desk] = Desk,
    ) -> None:
        """Without `link` and `start_vehicle` there is no vehicle, and the desk alone works. `make_desk` gives the desk
        to work on, told by `on_command` and `on_said` whom to tell. `profile` is the vehicle's, where it is not to be
        recognised. With `probe`, by default on every vehicle that the app did not start itself, a small step on each
        axis comes before a card."""
        self._folder = folder
        self._primary = primary
        self._start_vehicle = start_vehicle
        self._probe = start_vehicle is None if probe is None else probe
        self._open_session = open_session
        self._vehicle: SimulatedVehicle | None = None
        self._session: Session | None = None
        self._lock = threading.RLock()
        self._pressed = threading.Condition(self._lock)
        self._ending = threading.Event()
        self._card = load_card(card)
        self._card_word = card
        self._profile_word = profile
        self._profiles = () if profile is None else (load_profile(profile),)
        self._state = State(
            link or ("the simulated vehicle" if start_vehicle else ""),
            plant,
            card=self._card.name,
            runs=_views(self._card),
        )
        self._limits_of_card()
        self._abort: str | None = None
        self._started = False
        self._notes: list[str] = []
        """Told while a card is flown, and once more when it is over."""
        self._mode_before = STABILIZE
        self._telemetry: deque[tuple[float, float, float]] = deque(maxlen=KEPT_TELEMETRY)
        self._desk = make_desk(on_command=self._did, on_said=lambda text: self._set(said=text))
        self._link = link
        self._flying: threading.Thread | None = None
        self._conductor = threading.Thread(target=self._conduct, name="tippath app", daemon=True)
        self._conductor.start()

    # What the app reads.

    @property
    def desk(self) -> Desk:
        return self._desk

    def state(self) -> State:
        """This moment."""
        state, session = view.joined(self._state, self._desk.state()), self._session
        if session is None:
            return state
        try:
            vehicle = session.snapshot()
        except LinkError:
            return state
        received = session.samples(0.0).received if vehicle.recording is not None else 0
        return replace(state, vehicle=vehicle, samples=received, station=session.station)

    def window(self, last_s: float) -> LiveWindow:
        """The log's samples while it is recorded, else what telemetry told of the rates."""
        session = self._session
        if session is not None:
            with contextlib.suppress(LinkError):
                if session.snapshot().recording is not None:
                    window = session.samples(last_s)
                    if window.t.size:
                        return window
        with self._lock:
            rows = np.array(self._telemetry, dtype=float).reshape(-1, 3)
        rows = rows[rows[:, 0] >= rows[-1, 0] - last_s] if len(rows) else rows
        unknown = np.full(len(rows), np.nan)
        return LiveWindow(
            t=rows[:, 0],
            p=rows[:, 1],
            q=rows[:, 2],
            delta_x=unknown,
            delta_y=unknown,
            excitation_x=unknown,
            excitation_y=unknown,
        )

    # What keys wish.

    def ready(self) -> None:
        """Make the next run ready: begin the card, or go on with it. Nothing moves."""
        with self._pressed:
            stage = self._state.stage
            if stage is Stage.HELD:
                self._set(stage=Stage.READY, said="", rpm_reference=self._rpm())
                self._mark(self._state.current, Mark.READY)
            elif stage is Stage.IDLE and not self._busy_with_card():
                self._begin()
            elif stage is Stage.NO_VEHICLE:
                self._set(said="there is no vehicle")
            elif stage is not Stage.READY:
                self._set(said=TOO_EARLY)

    def start(self) -> None:
        """Start the run that is ready."""
        with self._pressed:
            if self._state.stage is Stage.READY:
                self._started = True
                self._pressed.notify_all()
            elif not self._state.stage.under_way:
                self._set(said="nothing is ready: R first, then S")
            elif self._state.stage is Stage.HELD:
                self._set(said="not ready: R first, then S")

    def end_card(self) -> None:
        """Between two runs: fly no further."""
        with self._pressed:
            if self._state.stage in (Stage.HELD, Stage.READY):
                self._abort = "the card was ended here"
                self._pressed.notify_all()
            elif self._state.stage is Stage.FLYING:
                self._set(said="a run is flying: F12 aborts it")

    def abort(self) -> None:
        """End what is excited; call off what is ready."""
        with self._pressed:
            stage = self._state.stage
            if stage is Stage.READY:
                self._started = False  # also a start that the card has not seen yet
                self._set(stage=Stage.HELD, said="called off: nothing was started")
                self._mark(self._state.current, Mark.NEXT)
            elif stage is Stage.FLYING:
                self._abort = "F12 or space in the app"
                self._set(stage=Stage.ABORTING)
                self._pressed.notify_all()
            elif stage is Stage.CHECKING:
                self._abort = "F12 or space in the app"
                self._pressed.notify_all()
            elif stage is Stage.IDLE and self._excited_by_another():
                threading.Thread(target=self._end_excitation, name="tippath abort", daemon=True).start()
            elif stage is not Stage.ABORTING:
                self._set(said="nothing is excited")

    def _excited_by_another(self) -> bool:
        vehicle = self._snapshot()
        return vehicle is not None and vehicle.mode == SYSTEMID

    def _end_excitation(self) -> None:
        session = self._session
        if session is None:
            return
        with contextlib.suppress(TippathError):
            result = abort(session, self._mode_before)
            self._set(said=f"the mode is {result.mode_after}" if result.ended else result.reason)

    # The card.

    def choose_card(self, word: str) -> None:
        """Another card, by its file or the name of a bundled one. Raises UsageError."""
        card = load_card(word)
        with self._lock:
            if self._state.stage.under_way:
                raise TippathError("a card is being flown: end it first (E)")
            self._card, self._card_word = card, word
            self._set(card=card.name, runs=_views(card), current=0, use=None, said=card.description, checks=())
            self._limits_of_card()

    def _limits_of_card(self) -> None:
        self._set(limits=self._card.limits)

    def _busy_with_card(self) -> bool:
        return self._flying is not None and self._flying.is_alive()

    def _begin(self) -> None:
        session = self._session
        assert session is not None
        self._abort, self._started = None, False
        self._notes.clear()
        self._set(stage=Stage.CHECKING, runs=_views(self._card), current=1, progress=None, use=None, checks=(), said="")
        self._flying = threading.Thread(target=self._fly, args=(session, self._card), name="tippath card", daemon=True)
        self._flying.start()

    def _fly(self, session: Session, card: TestCard) -> None:
        said, landed = "", None
        try:
            profile = require_flyable(session, card, profiles=self._profiles)
            folder = create(None, self._folder)
            self._set(flight=folder.path)
            result = fly_card(
                session,
                card,
                profile,
                folder=folder,
                confirm=self._briefed,
                on_progress=self._progressed,
                aborted=lambda: self._abort,
                about={"command": "fly", "link": session.link},
                probe=self._probe,
            )
            said = self._landed(result)
            landed = result.folder.path if result.recording is not None and result.recording.logs else None
        except TippathError as error:
            said = str(error)
        except Exception as error:  # a fault of ours must neither hide nor end the app in flight
            said = f"the card stopped on a fault: {type(error).__name__}: {error}"
        finally:
            with self._lock:
                for run in self._state.runs:
                    if run.mark in (Mark.WAITING, Mark.NEXT, Mark.READY, Mark.FLYING):
                        self._mark(run.number, Mark.SKIPPED)
                stage = Stage.IDLE if self._session is not None else Stage.NO_VEHICLE
                self._set(stage=stage, current=0, progress=None, said=said, rpm_reference=None)
            if landed is not None and not self._ending.is_set():
                threading.Thread(target=self._read_flown, args=(landed,), name="tippath runs", daemon=True).start()

    def _read_flown(self, flight: Path) -> None:
        """The desk goes on with what was flown last, as soon as it is free."""
        try:
            self._desk.open(str(flight), wait=True)
        except TippathError as error:
            self._set(said=f"{flight.name} was not opened: {error}")
        except Exception as error:  # a fault of ours must not end the app
            self._set(said=f"{flight.name} was not opened: {type(error).__name__}: {error}")

    def _landed(self, result: SweepResult) -> str:
        kept = sum(run.clean for run in result.runs)
        where = word(result.folder.path)
        vehicle = "" if self._profile_word is None else f" --vehicle-profile {word(self._profile_word)}"
        command = f"tippath sweep --connect {self._link_word()}{vehicle} --card {word(self._card_word)} -o {where}"
        self._did(command)
        with contextlib.suppress(TippathError):  # a disk that is full was told of by the recording
            result.folder.audit(datetime.now(UTC), "flew a card", command, by="app")
        text = f"recorded {where}: {kept} of {result.planned} runs kept, {result.missing_words}"
        problems = () if result.recording is None else result.recording.problems
        return "; ".join([text, *([result.stopped] if result.stopped else []), *self._notes, *problems])

    def _briefed(self, briefing: Briefing) -> bool:
        checks = tuple((check.ok, f"{check.name}: {check.words}") for check in briefing.checks)
        runs = tuple(_view(run) for run, _ in briefing.plans)
        self._set(checks=checks, link_loss=briefing.link_loss.words, runs=runs)
        return self._abort is None

    def _progressed(self, progress: Progress) -> None:
        match progress:
            case RunReady():
                self._wait_for_start(progress)
            case RunProgress():
                self._show(progress)
            case RunResult():
                self._judged(progress)
            case Probed():
                self._set(said=f"probe: {'; '.join(progress.result.words)}")
            case Note():
                self._notes.append(progress.words)
                self._set(said=progress.words)

    def _wait_for_start(self, ready: RunReady) -> None:
        """Wait until this run was made ready and started, or called off."""
        session = self._session
        assert session is not None
        number = ready.run.number
        flown = any(run.mark in (Mark.KEEP, Mark.AGAIN) for run in self._state.runs)
        with self._pressed:
            self._started = False
            self._set(
                stage=Stage.HELD if flown else Stage.READY,
                current=number,
                progress=view.Progress(0.0, ready.run.maneuver.duration_s, None, ready.plan.words),
                rpm_reference=self._rpm(),
                disk_free=None if self._state.flight is None else free_bytes(self._state.flight),
            )
            self._mark(number, Mark.NEXT if flown else Mark.READY)
            if self._state.said == TOO_EARLY:
                self._set(said="")
            mode = session.snapshot().mode
            while not self._started and self._abort is None:
                self._pressed.wait(0.1)
                self._abort = self._abort or self._called_off(session.snapshot(), mode)
            if self._abort is None:
                self._set(stage=Stage.FLYING, said="", use=None)
                self._mark(number, Mark.FLYING)

    def _called_off(self, vehicle: VehicleSnapshot, mode: int) -> str | None:
        if self._ending.is_set():
            return "the app was closed"
        if vehicle.lost:
            return "the link was lost while a run waited for its start"
        if not vehicle.armed:
            return "the vehicle was disarmed while a run waited for its start"
        if vehicle.mode != mode:
            return f"the mode is {vehicle.mode_name}: the pilot has it"
        return None

    def _show(self, progress: RunProgress) -> None:
        duration = progress.plan.maneuver.duration_s
        early = progress.phase is Phase.RETURNING and progress.elapsed_s < duration - 0.2
        with self._lock:
            stage = self._state.stage
            if early and stage is Stage.FLYING:
                stage = Stage.ABORTING
                if progress.ending is not None:
                    self._set(said=f"{progress.ending.value}: {progress.reason}")
            self._set(
                stage=stage,
                progress=view.Progress(progress.elapsed_s, duration, progress.frequency_hz, progress.plan.words),
                use=progress.use,
            )

    def _judged(self, result: RunResult) -> None:
        with self._lock:
            verdict = result.verdict
            if verdict is None:
                mark, words = Mark.SKIPPED, result.reason
            elif result.clean:
                mark, words = Mark.KEEP, verdict.words
            else:
                mark = Mark.AGAIN
                words = verdict.words if result.ending is Ending.FINISHED else f"{result.ending.value}: {result.reason}"
            self._mark(result.run.number, mark, words)
            last = result.run.number == result.run.of or result.ending is not Ending.FINISHED
            self._set(
                stage=Stage.CLOSING if last else Stage.CHECKING,
                said=f"{result.run.label}: {words}",
                progress=None,
                checks=(),
            )

    def _mark(self, number: int, mark: Mark, verdict: str | None = None) -> None:
        with self._lock:
            runs = tuple(
                replace(run, mark=mark, verdict=run.verdict if verdict is None else verdict)
                if run.number == number
                else run
                for run in self._state.runs
            )
            self._set(runs=runs)

    # The fit and the gains.

    def open_flight(self, path: str) -> None:
        """Another flight folder or log to work on. Raises TippathError where there is none."""
        if self._state.stage.under_way:
            raise TippathError("a card is being flown: end it first (1, then E)")
        self._desk.open(path)
        self._set(flight=self._desk.state().path)

    def fit(self) -> None:
        """Fit the flight with the runs and the base that were chosen on the desk."""
        if self._state.stage.under_way:
            raise TippathError("the card is still being flown; the fit comes after it")
        flight = self._state.flight
        if flight is not None and self._desk.state().path != flight:
            self._desk.open(str(flight), wait=True)
        self._desk.fit()

    def design(self) -> None:
        """Gains on the ladder's last fit, kept as GAINS.json beside it."""
        self._desk.design()

    def push(self) -> None:
        """The designed gains to the vehicle, as one verified set; only on the ground, disarmed."""
        from gcs.flight.gains import checksum, gains_of, push

        session = self._on_ground()
        designed = self._desk.state().designed
        if designed is None:
            raise TippathError("no gains yet: D designs them")
        if designed.path is None:
            raise TippathError("the gains are not kept in any file yet: keep them in another folder first")
        with self._working("pushing gains"):
            result = push(
                session,
                gains_of(designed.gains.to_json()),
                on_progress=lambda step: self._set(busy=f"pushing gains: {step}"),
            )
            self._set(
                bank=Bank(result.crc, result.previous_crc, result.switch_on),
                said=f"committed {result.crc:06x}: {len(result.values)} values read back, equal bit for bit"
                if result.committed
                else f"the vehicle held {result.crc:06x} already; nothing was written",
            )
            command = f"tippath push {word(designed.path)} --connect {self._link_word()}"
            self._did(command)
            did = "pushed gains" if result.committed else "pushed gains that the vehicle held already:"
            self._desk.audit(f"{did} {checksum(result.crc)}, before {checksum(result.previous_crc)}", command)

    def revert(self) -> None:
        """Back to the bank before the last commit; only on the ground, disarmed."""
        from gcs.flight.gains import checksum, revert

        session = self._on_ground()
        with self._working("reverting"):
            result = revert(session)
            bank = self._state.bank
            self._set(
                bank=Bank(result.crc, result.reverted_crc, None if bank is None else bank.switch_on),
                said=f"{result.crc:06x} is active again"
                if result.crc
                else "no LQR is active, as before the first push",
            )
            command = f"tippath revert --connect {self._link_word()}"
            self._did(command)
            self._desk.audit(
                f"reverted gains to {checksum(result.crc)}, before {checksum(result.reverted_crc)}", command
            )

    def _on_ground(self) -> Session:
        reason = self.state().not_on_ground()
        if reason is not None:
            raise TippathError(reason)
        assert self._session is not None
        return self._session

    # The simulated pilot.

    def pilot(self, line: str) -> None:
        """A line to the pilot of the simulated vehicle that this app started; there is none on any other link.

        `lqr` throws the bank switch to its other position.
        """
        vehicle = self._vehicle
        if vehicle is None:
            raise TippathError("there is no simulated pilot on this link")
        if line == "lqr":
            bank = self._state.bank
            line = "lqr off" if bank is not None and bank.switch_on else "lqr on"
        reply = vehicle.say(line)
        self._set(said=f"simulated pilot, {line}: {reply}")
        if line.startswith("lqr"):
            self._read_bank()

    # Connection.

    def _conduct(self) -> None:
        try:
            if self._start_vehicle is not None:
                self._set(trouble="the simulated vehicle is starting")
                self._vehicle = self._start_vehicle()
                self._link = self._vehicle.ground_link
                self._set(link=self._link)
                if self._ending.is_set():
                    self._vehicle.close()
                    return
        except TippathError as error:
            self._set(trouble=str(error))
            return
        if self._link is None:
            return
        while not self._ending.is_set() and self._session is None:
            self._connect()
        while not self._ending.wait(WATCH_S):
            self._watch()

    def _connect(self) -> None:
        assert self._link is not None
        try:
            session = self._open_session(self._link, primary=self._primary, connect_timeout_s=CONNECT_S)
        except TippathError as error:
            self._set(trouble=str(error))
            self._ending.wait(AGAIN_S)
            return
        with self._lock:
            self._session = session
            self._set(trouble=None, stage=Stage.IDLE)
        if self._ending.is_set():
            session.close()
            return
        self._read_bank()

    def _watch(self) -> None:
        vehicle = self._snapshot()
        if vehicle is None:
            return
        if vehicle.mode not in (SYSTEMID, -1):
            self._mode_before = vehicle.mode
        at, p, q = vehicle.attitude_at_s, vehicle.p, vehicle.q
        with self._lock:
            if (
                at is not None
                and p is not None
                and q is not None
                and (not self._telemetry or self._telemetry[-1][0] < at)
            ):
                self._telemetry.append((at, p, q))

    def _read_bank(self) -> None:
        """What the vehicle holds, where it has a bank at all."""
        session = self._session
        if session is None:
            return
        try:
            active = session.call(ReadParameter(ACTIVE_CRC, 2)).value
            switch = session.call(ReadParameter(SWITCH, 2)).value
        except ProcedureError:
            return
        if active >= 0:
            before = self._state.bank
            self._set(bank=Bank(int(active), None if before is None else before.previous, switch == 1.0))

    def close(self) -> None:
        """End a run under way, then recording, the link and the simulated vehicle. Twice is no harm."""
        self._desk.cancel()
        with self._pressed:
            self._ending.set()
            self._abort = self._abort or "the app was closed"
            self._pressed.notify_all()
        if self._flying is not None:
            self._flying.join(CLOSE_S)
        if self._session is not None:
            self._session.close()
        if self._vehicle is not None:
            self._vehicle.close()

    # Small things.

    def _snapshot(self) -> VehicleSnapshot | None:
        if self._session is None:
            return None
        try:
            return self._session.snapshot()
        except LinkError:
            return None

    def _rpm(self) -> float | None:
        vehicle = self._snapshot()
        return None if vehicle is None else vehicle.rpm

    def _set(self, **changes: Any) -> None:
        with self._lock:
            self._state = replace(self._state, **changes)

    def _did(self, command: str) -> None:
        with self._lock:
            self._set(commands=(*self._state.commands, command))

    @contextlib.contextmanager
    def _working(self, what: str) -> Any:
        with self._lock:
            if self._state.busy:
                raise TippathError(f"wait: {self._state.busy}")
            self._set(busy=what)
        try:
            yield
        finally:
            self._set(busy="")

    def _link_word(self) -> str:
        return word(self._link or "LINK")


def _views(card: TestCard) -> tuple[RunView, ...]:
    return tuple(_view(run) for run in card.runs())


def _view(run: CardRun) -> RunView:
    locked = run.locked_by is not None
    return RunView(
        run.number,
        run.label,
        run.maneuver.numbers,
        Mark.LOCKED if locked else Mark.WAITING,
        f"until {run.locked_by} is clean" if locked else "",
    )
