"""What the screens show: one immutable value, made by the app worker, read by the app on a timer.

Every line on every screen is a function of a `State` and a width. Nothing is kept in a widget, so a screen that was
away shows the same as one that was not, and a test shows any moment of a flight without flying.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path

from gcs.cards.checklist import Answer, Question
from gcs.cards.envelope import Limits, Use
from gcs.desk.state import Designed, DeskState, Fitted
from gcs.flight.preflight import Check
from gcs.flight.readiness import Readiness
from gcs.vehicle.snapshot import VehicleSnapshot

FETCHING = "fetching the log"
"""What is worked on then; a key calls it off."""
STARTING = "the simulated vehicle is starting"
"""The trouble that goes by itself."""


class Stage(Enum):
    """Where a flight is, from the app's side. What the vehicle does is in its snapshot."""

    NO_VEHICLE = "no vehicle"
    IDLE = "idle"
    """Connected; no card is under way."""
    CHECKING = "checking"
    """A card was begun: the vehicle is looked at before anything moves."""
    HELD = "held"
    """Between two runs: the next waits for `ready`."""
    READY = "ready"
    """The next run waits for `start`."""
    FLYING = "flying"
    ABORTING = "aborting"
    """The run is ended early; the vehicle is not yet back in the mode before."""
    CLOSING = "closing"
    """All runs are over; the rest of the log is fetched and the vehicle's parameters are put back."""

    @property
    def under_way(self) -> bool:
        """Whether a card is being flown."""
        return self not in (Stage.NO_VEHICLE, Stage.IDLE)


class Mark(Enum):
    """What became of a run. The word tells it; the sign only repeats it."""

    WAITING = " ", ""
    LOCKED = " ", "locked"
    NEXT = "○", "next"
    READY = "●", "ready"
    FLYING = "▶", "flying"
    KEEP = "✓", "keep"
    AGAIN = "✗", "fly again"
    SKIPPED = " ", "not flown"

    @property
    def sign(self) -> str:
        return self.value[0]

    @property
    def word(self) -> str:
        return self.value[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunView:
    """One line of the card."""

    number: int
    label: str
    """`roll chirp 1/2`."""
    numbers: str
    """`0.5-10 Hz  30 s  A 0.10`."""
    kind: str = ""
    """`chirp`, `doublet` or `quiet`."""
    size: str = ""
    """`A 0.10`; empty where it has no amplitude."""
    mark: Mark = Mark.WAITING
    why: tuple[str, ...] = ()
    """Of the mark: reasons, then figures."""


@dataclass(frozen=True, slots=True)
class Swept:
    """What a chirp sweeps, and how far it is."""

    axis: str
    low_hz: float
    high_hz: float
    at_hz: float


@dataclass(frozen=True, slots=True)
class Progress:
    """The run under way."""

    elapsed_s: float
    """Of the maneuver; below zero before its first excitation."""
    duration_s: float
    frequency_hz: float | None
    words: str
    """What is really flown: `Table 1`."""
    swept: Swept | None = None
    """Of a chirp that tells its frequency."""


@dataclass(frozen=True, slots=True)
class Bank:
    """What the vehicle holds, as last read back."""

    active: int
    """Checksum of the active bank; 0: none."""
    previous: int | None
    """What a revert goes back to, where a push or revert has told."""
    switch_on: bool | None
    """Whether the pilot's switch selects the LQR; None where the vehicle does not say."""


@dataclass(frozen=True, slots=True)
class Replaying:
    """A recorded flight that is watched again."""

    name: str
    at_s: float
    """From its first sample."""
    of_s: float
    speed: float
    """Of the clock; 1 is as it was."""
    paused: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """One moment."""

    link: str
    plant: str | None = None
    """Of the simulated vehicle that the app started; None on any other link, where no pilot is on the keys."""
    vehicle: VehicleSnapshot | None = None
    trouble: str | None = None
    """Why there is no vehicle."""
    station: int | None = None
    """Our own system id; None where there is no link."""
    stage: Stage = Stage.NO_VEHICLE
    card: str = ""
    runs: tuple[RunView, ...] = ()
    current: int = 0
    """Number of the run that is next, ready or flying; 0 where there is none."""
    progress: Progress | None = None
    checklist: tuple[Question, ...] = ()
    """To be answered before the card is begun;"""
    answers: tuple[Answer | None, ...] = ()
    """so far, one for each."""
    air_s: float | None = None
    """Seconds in the air, of this flight or, on the ground, of the last one; None before the first."""
    air_known: bool = True
    """Its take-off was seen; else it flew before it was heard."""
    limits: Limits = field(default_factory=Limits)
    use: Use | None = None
    """Peaks of the run under way (or of the last) in percent of the limits."""
    checks: tuple[Check, ...] = ()
    """What was looked at before the start."""
    readiness: Readiness | None = None
    """What the vehicle was set to when it was last looked at, on the ground or in the air."""
    link_loss: str = ""
    """What the vehicle does when the link is lost, once it was read."""
    rpm_reference: float | None = None
    """Rotor speed when the run was made ready: what the deviation is shown against."""
    samples: int = 0
    """Of the log being recorded."""
    disk_free: int | None = None
    flight: Path | None = None
    """Folder of the flight under way, or of the last."""
    unfinished: Path | None = None
    """Folder of the newest flight, where runs of its card are left."""
    left: str = ""
    """What of it is flown."""
    so_far: str = ""
    """What TPP makes of the runs that were kept, while the card is flown."""
    said: str = ""
    """The worker's last word: a refusal, a verdict, what was done."""
    said_by_desk: bool = False
    """It is of a recorded flight."""
    busy: str = ""
    """What is being worked on away from the screen: a fit, a push."""
    bank: Bank | None = None
    replay: Replaying | None = None
    """None where a vehicle is watched, or none."""
    secret: Path | None = None
    """Folder with the sealed answer of the simulated vehicle; None where nothing is hidden."""
    commands: tuple[str, ...] = ()
    """What was done, as a shell would do it; newest last."""
    desk: DeskState = field(default_factory=DeskState)
    """What is done with a flight after it was flown."""

    @property
    def fitted(self) -> Fitted | None:
        """The fits of the flight that is open."""
        return self.desk.fitted

    @property
    def designed(self) -> Designed | None:
        """Gains that can be pushed: those that are kept in a file."""
        designed = self.desk.designed
        return None if designed is None or designed.path is None else designed

    @property
    def simulated(self) -> bool:
        return self.plant is not None

    @property
    def lost(self) -> bool:
        return self.vehicle is not None and self.vehicle.lost

    @property
    def unanswered(self) -> int | None:
        """Number of the checklist's first question without an answer, from 0; None where all have one."""
        return next((i for i, answer in enumerate(self.answers) if answer is None), None)

    def not_on_ground(self, what: str = "gains are moved") -> str | None:
        """Why gains cannot be moved now, or a log fetched; None where they can."""
        if self.vehicle is None:
            return "there is no vehicle"
        if self.vehicle.lost:
            return "the link is lost"
        if self.stage.under_way:
            return f"a card is being flown: {what} after it, on the ground"
        if self.vehicle.armed:
            return f"the vehicle is armed: {what} on the ground, disarmed; the pilot lands first"
        return None


def tells_both_axes(runs: Sequence[RunView]) -> bool:
    """Whether chirps of roll and of pitch were kept: what TPP is fitted to."""
    kept = [run.label for run in runs if run.mark is Mark.KEEP and run.kind == "chirp"]
    return all(any(label.startswith(axis) for label in kept) for axis in ("roll", "pitch"))


def as_flown(state: State) -> State:
    """The moment of a replay as it was, flying where a run flew; everything else is left as it is.

    Nothing but what is shown and called out takes it so: to all that could act, nothing flies in a replay.
    """
    flown = state.replay is not None and state.progress is not None
    return replace(state, stage=Stage.FLYING) if flown else state


def joined(state: State, desk: DeskState) -> State:
    """A moment with what lies on the desk in it."""
    return replace(state, desk=desk, busy=state.busy or desk.busy)
