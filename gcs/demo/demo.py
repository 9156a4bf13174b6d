"""The whole flight test on the bundled simulated vehicle, unattended: fly, fit, design, push, fly again.

One function for each step, in the order of the work; `fly_demo` calls them one after the other. It is the same engine
as behind the commands and the app. The simulated pilot takes off, lands and throws the switch; the ground station does
not.

What must hold, or the demonstration has failed: every run was flown and none of its samples is missing; the log that
came over the air is the vehicle's own file byte for byte; the pushed gains were read back bit for bit; and the vehicle
follows the rates that the LQR is asked for.
"""

from __future__ import annotations

import filecmp
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.analysis.following import Following, measure_following
from gcs.cards.maneuver import load_card
from gcs.demo.discovery import Discovery, discover
from gcs.demo.pilot import SimulatedVehicle
from gcs.demo.results import Design, cleared_design, design_on, keep_results
from gcs.errors import TippathError
from gcs.flight.flown_card import Briefing, SweepResult
from gcs.flight.folder import FlightFolder
from gcs.flight.gains import PushResult, RevertResult, checksum, gains_of, revert
from gcs.flight.run import Progress
from gcs.flight.session import Session
from gcs.flight.sweep import fly_card
from gcs.vehicle.autopilots import IN_THE_AIR

if TYPE_CHECKING:  # they bring matplotlib along, which takes a second: here as in the functions below
    from gcs.analysis.fits import Identification
    from sysid.control.regulator import Gains
    from sysid.data.record import Record

FIRST_INPUT_COST = 20.0
"""The first set is a gentle one, as on a first flight; it is also what a revert goes back to."""
INPUT_COSTS = (5.0, 7.0, 10.0, 14.0)
"""The paper's, and dearer ones for where a fit with what was missing leaves it too little margin."""
LAND_WITHIN_S = 20.0
TAKE_OFF_WITHIN_S = 20.0

Say = Callable[[str], None]
Fly = Callable[[str, FlightFolder], SweepResult]
"""Flies a card by its name, and records it in a folder."""


class DemoError(TippathError):
    """Something that had to hold does not; the message says what."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Demonstration:
    """What the demonstration did and found."""

    folder: FlightFolder
    plant: str
    seed: int
    flown: SweepResult
    on_board: Path
    """The vehicle's own file that flight.BIN equals."""
    identification: Identification
    gains: Gains
    pushed: tuple[PushResult, ...]
    lqr_flown: SweepResult
    following: tuple[Following, ...]
    reverted: RevertResult
    discovery: Discovery
    duration_s: float

    def tables(self) -> str:
        """The paper's tables with ours beside, the gains, and how the vehicle followed."""
        from gcs.analysis.text.fit import identification_text
        from gcs.analysis.text.gains import gains_text

        last = self.pushed[-1]
        lines = [
            identification_text(self.identification),
            "",
            gains_text(self.gains),
            "",
            f"pushed {checksum(last.crc)}: {len(last.values)} of {len(last.values)} values read back equal; "
            f"reverted to {checksum(self.reverted.crc)} after the flight",
            "following the rate command with the LQR",
            *(f"  {one.words}" for one in self.following),
            "",
            "what TPP lacks here",
            self.discovery.text,
            "",
            f"{self.folder.log}: {len(self.flown.runs)} runs, {self.flown.missing_blocks} blocks missing, "
            f"byte for byte {self.on_board}",
        ]
        return "\n".join(lines)

    def to_json(self) -> dict[str, Any]:
        from gcs.analysis.text.checks import checks_document

        found = self.identification
        return {
            "format": "tippath.demo/1",
            "folder": str(self.folder.path),
            "plant": self.plant,
            "seed": self.seed,
            "runs": len(self.flown.runs),
            "missing_blocks": self.flown.missing_blocks,
            "byte_identical_to": str(self.on_board),
            "nrmse_percent": {
                "tpp": dict(found.tpp.nrmse_percent),
                "cd": dict(found.cd.nrmse_percent),
                "cd_reduced": dict(found.reduced_nrmse),
            },
            "validation_nrmse_percent": {
                "tpp": found.tpp.validation_nrmse_percent,
                "cd": found.cd.validation_nrmse_percent,
                "cd_reduced": found.reduced_validation,
            },
            "modes": {
                name: [{"frequency_hz": m.frequency_hz, "damping_ratio": m.damping_ratio} for m in model.modes]
                for name, model in (("tpp", found.tpp.model), ("cd", found.cd.model), ("cd_reduced", found.reduced))
            },
            "checks": checks_document(found.checks),
            "pushed": [{"crc": p.crc, "checksum": checksum(p.crc), "verified": len(p.values)} for p in self.pushed],
            "reverted_to": self.reverted.crc,
            "reverted_to_checksum": checksum(self.reverted.crc),
            "following": [one.to_json() for one in self.following],
            "discovery": self.discovery.to_json(),
            "files": sorted(p.name for p in self.folder.path.iterdir() if p.is_file()),
            "duration_s": round(self.duration_s, 1),
        }


def fly_demo(
    folder: FlightFolder,
    plant: str = "hover",
    seed: int = 1,
    *,
    say: Say = lambda words: None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
    on_briefing: Callable[[Briefing], None] = lambda briefing: None,
    aborted: Callable[[], str | None] = lambda: None,
    interruptions: Callable[[], int] = lambda: 0,
) -> Demonstration:
    """The demonstration, in about five minutes, into an empty folder.

    `aborted` is looked at in every run and between the steps; `interruptions` as in `fly_card`. Raises DemoError where
    something does not hold, KeyboardInterrupt where somebody wanted the end, and what the steps raise. The vehicle ends
    in every case.
    """
    began = time.monotonic()

    def tell(words: str) -> None:
        if aborted() is not None:
            raise KeyboardInterrupt
        say(words)

    tell(f"starting the simulated vehicle, plant {plant}, seed {seed}")
    with (
        SimulatedVehicle(plant, folder.path / "vehicle", seed=seed) as vehicle,
        Session.open(vehicle.ground_link, primary=True, connect_timeout_s=10.0) as session,
    ):
        fly = _flies(
            session,
            about={"link": session.link, "simulated": {"plant": plant, "seed": seed}},
            on_progress=on_progress,
            on_briefing=on_briefing,
            aborted=aborted,
            interruptions=interruptions,
        )
        flown = fly("hover", folder)
        land(vehicle, session, tell)
        identified = _identified(folder, vehicle, tell)
        closed_loop = _fly_gains(_Aloft(vehicle, session, fly, tell), folder, identified)
    demonstration = Demonstration(
        folder=folder,
        plant=plant,
        seed=seed,
        flown=flown,
        on_board=identified.on_board,
        identification=identified.identification,
        gains=identified.designs[-1].gains,
        pushed=closed_loop.pushed,
        lqr_flown=closed_loop.flown,
        following=closed_loop.following,
        reverted=closed_loop.reverted,
        discovery=identified.discovery,
        duration_s=time.monotonic() - began,
    )
    tell("writing the report")
    _keep(demonstration, identified)
    require_followed(demonstration.following)
    return demonstration


def _keep(demonstration: Demonstration, identified: _Identified) -> None:
    folder = demonstration.folder
    (folder.path / "tables.txt").write_text(demonstration.tables() + "\n", "utf-8")
    keep_results(folder, identified.identification, identified.discovery, identified.designs[-1])


def _flies(
    session: Session,
    *,
    about: dict[str, Any],
    on_progress: Callable[[Progress], None],
    on_briefing: Callable[[Briefing], None],
    aborted: Callable[[], str | None],
    interruptions: Callable[[], int],
) -> Fly:
    """Flies cards over a session; `about` goes into each flight.json."""

    def briefed(briefing: Briefing) -> bool:
        on_briefing(briefing)
        return True

    def fly(card: str, where: FlightFolder) -> SweepResult:
        result = fly_card(
            session,
            load_card(card),
            folder=where,
            confirm=briefed,
            on_progress=on_progress,
            aborted=aborted,
            interruptions=interruptions,
            about=about,
        )
        require_flown(result, aborted)
        return result

    return fly


@dataclass(frozen=True, eq=False)
class _Identified:
    on_board: Path
    identification: Identification
    discovery: Discovery
    designs: tuple[Design, ...]
    """The gentle one first."""


def _identified(folder: FlightFolder, vehicle: SimulatedVehicle, tell: Say) -> _Identified:
    """The fits of the flight in a folder, what they lack, and gains on the best of them."""
    from gcs.analysis.fits import split_runs

    on_board = require_same_bytes(folder.log, vehicle.directory)
    tell(f"{folder.log.name} is {on_board.name} of the vehicle, byte for byte")
    tell("fitting TPP and CD to the chirps, judging them on the doublets")
    identification, records = identify_runs(folder)
    discovery = discover(identification.tpp, *split_runs(records), tell)
    tell(f"designing the LQR, its observer and its prefilter on {discovery.best.model.structure.title}")
    gentle = design_on(discovery, FIRST_INPUT_COST, folder.path)
    bold = cleared_design(discovery, INPUT_COSTS, folder.path, tell)
    return _Identified(on_board, identification, discovery, (gentle, bold))


@dataclass(frozen=True, eq=False)
class _Aloft:
    vehicle: SimulatedVehicle
    session: Session
    fly: Fly
    tell: Say


@dataclass(frozen=True, eq=False)
class _ClosedLoop:
    pushed: tuple[PushResult, ...]
    flown: SweepResult
    following: tuple[Following, ...]
    reverted: RevertResult


def _fly_gains(aloft: _Aloft, folder: FlightFolder, found: _Identified) -> _ClosedLoop:
    """The gains on the ground to the vehicle, the doublets with them in the air, and back to the first set."""
    vehicle, session, tell = aloft.vehicle, aloft.session, aloft.tell
    pushed = tuple(push_gains(session, one, tell) for one in found.designs)
    take_off(vehicle, session, tell)
    vehicle.say("lqr on")
    tell("the pilot's switch selects the LQR")
    again = FlightFolder(folder.path / "lqr")
    again.path.mkdir()
    flown = aloft.fly("lqr-doublet", again)
    following = tuple(measure_following(again.log, flown.runs))
    for one in following:
        tell(one.words)
    land(vehicle, session, tell)
    return _ClosedLoop(pushed, flown, following, revert_gains(session, pushed, tell))


# ------------------------------------------------------------------------------------------------ the steps


def require_flown(result: SweepResult, aborted: Callable[[], str | None]) -> None:
    """Every run flown, every sample there to the log's end.

    Raises DemoError, or KeyboardInterrupt where somebody wanted the end.
    """
    if aborted() is not None:
        raise KeyboardInterrupt
    if not result.complete:
        raise DemoError(f"the card {result.card.name} was not flown to its end: {result.stopped}")
    if result.missing_blocks or result.recording is None or not result.recording.logs:
        raise DemoError(f"{result.missing_blocks} blocks of the log are missing in {result.folder.log}")
    if not result.recording.complete:
        raise DemoError(f"the log in {result.folder.log} is not complete: {'; '.join(result.recording.problems)}")


def require_followed(following: Sequence[Following]) -> None:
    """The vehicle follows the rates that the LQR is asked for. Raises DemoError."""
    if not all(one.follows for one in following):
        words = "; ".join(one.words for one in following)
        raise DemoError(f"the vehicle does not follow the LQR's rate command: {words}")


def require_same_bytes(log: Path, directory: Path) -> Path:
    """The vehicle's own file that equals the log, every byte. Raises DemoError where none does."""
    own = sorted(directory.glob("*.BIN"))
    for path in own:
        if path.stat().st_size == log.stat().st_size and filecmp.cmp(path, log, shallow=False):
            return path
    raise DemoError(f"{log} equals none of the vehicle's own {len(own)} logs in {directory}")


def identify_runs(folder: FlightFolder) -> tuple[Identification, list[Record]]:
    """Fit the chirps, judge on the doublets. Raises what the log and the fit have to say."""
    from gcs.analysis.fits import identify_flight, split_runs
    from gcs.logs import resolve_runs

    records = resolve_runs([str(folder.log)])
    chirps, doublets = split_runs(records)
    return identify_flight(chirps, doublets), records


def land(vehicle: SimulatedVehicle, session: Session, say: Say) -> None:
    """The simulated pilot lands and disarms. Raises DemoError where he does not within `LAND_WITHIN_S`."""
    vehicle.say("land")
    _wait(session, lambda: not session.snapshot().armed, LAND_WITHIN_S, "the vehicle has not landed")
    say("landed and disarmed by the simulated pilot")


def take_off(vehicle: SimulatedVehicle, session: Session, say: Say) -> None:
    """The simulated pilot takes off into a hover. Raises DemoError where he does not within `TAKE_OFF_WITHIN_S`."""
    vehicle.say("takeoff")
    _wait(
        session,
        lambda: session.snapshot().armed and session.snapshot().status == IN_THE_AIR,
        TAKE_OFF_WITHIN_S,
        "the vehicle has not taken off",
    )
    time.sleep(2.0)  # the climb to the hover
    say("in the air again")


def push_gains(session: Session, made: Design, say: Say) -> PushResult:
    """Judge one set as everybody who pushes does, write it, prove it bit for bit, commit it, prove it again.

    Raises what speaks against it: nobody is there to say why it should be flown all the same.
    """
    from gcs.analysis.pushing import push_judged, to_push

    whole = replace(gains_of(made.gains.to_json()), identified=made.identified)
    pushed = push_judged(session, to_push(whole, made.clearance))
    for one in pushed.objections:
        say(one.words)
    result = pushed.result
    equal = f"{len(result.values)} values read back equal"
    say(f"pushed input cost {made.gains.input_cost:g}: {equal}, {checksum(result.crc)} active")
    return result


def revert_gains(session: Session, pushed: Sequence[PushResult], say: Say) -> RevertResult:
    """Back to the first set. Raises DemoError where another is active afterwards."""
    result = revert(session)
    if result.crc != pushed[0].crc:
        raise DemoError(f"the revert went to {checksum(result.crc)}, not to {checksum(pushed[0].crc)}")
    say(f"reverted to the set before, {checksum(result.crc)}")
    return result


def _wait(session: Session, reached: Callable[[], bool], within_s: float, otherwise: str) -> None:
    deadline = time.monotonic() + within_s
    while not reached():
        if time.monotonic() > deadline:
            raise DemoError(f"{otherwise} after {within_s:.0f} s")
        if session.snapshot().lost:
            raise DemoError("the link to the simulated vehicle was lost")
        time.sleep(0.05)
