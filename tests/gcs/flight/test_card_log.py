"""Cards flown without the log's stream: what stands for the log, what is told of the runs, and what still ends one."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fake_flight import SYSTEMID, FakeSession, FakeVehicle

from gcs.cards.maneuver import Maneuver, TestCard
from gcs.flight.flown_card import Briefing, SweepResult
from gcs.flight.folder import FlightFolder, create
from gcs.flight.run import Progress, RunProgress, RunReady, RunResult
from gcs.flight.run_state import Ending
from gcs.flight.sweep import NotReadyError, fly_card

STABILIZE, ALT_HOLD = 0, 2
CHIRP = Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=10.0)


@pytest.fixture
def vehicle() -> FakeVehicle:
    vehicle = FakeVehicle()
    vehicle.parameters["LOG_BACKEND_TYPE"] = 1.0
    return vehicle


@pytest.fixture
def session(vehicle: FakeVehicle) -> FakeSession:
    return FakeSession(vehicle)


@pytest.fixture
def folder(tmp_path: Path) -> FlightFolder:
    return create(tmp_path / "flight")


def fly(session: FakeSession, folder: FlightFolder, *maneuvers: Maneuver, **more: Any) -> SweepResult:
    card = TestCard(name="test", maneuvers=maneuvers or (CHIRP,))
    return fly_card(session, card, folder=folder, clock=session, disk_free=lambda _: 10**12, log="card", **more)


def modes(vehicle: FakeVehicle) -> list[int]:
    return [mode for _, mode in vehicle.asked]


def test_a_card_is_flown_and_the_vehicle_left_as_found(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    before = dict(vehicle.parameters)
    result = fly(session, folder, CHIRP, CHIRP)
    assert [run.ending for run in result.runs] == [Ending.FINISHED, Ending.FINISHED]
    assert modes(vehicle) == [SYSTEMID, STABILIZE, SYSTEMID, STABILIZE]
    assert vehicle.parameters == before
    assert not any(mode == SYSTEMID for *_, mode in vehicle.written)
    assert (result.done, result.complete) == (True, False), "complete is only what a log shows"
    assert result.missing_words == "log on the vehicle's card"


@pytest.mark.parametrize("told", [True, False], ids=["its echo is heard", "its echo is lost"])
def test_what_another_station_writes_between_reading_back_and_the_start_is_not_flown_to_the_end(
    told: bool, vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    """No record of the vehicle's own tells of it: its log stays on the card."""

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunProgress) and vehicle.parameters["SID_MAGNITUDE"] != 0.2:
            session.written_by_another("SID_MAGNITUDE", 0.2, told=told)

    result = fly(session, folder, on_progress=on_progress)
    assert "SID_MAGNITUDE is 0.2 in the vehicle, not 0.1: somebody else changed it" in result.stopped
    assert result.ending is Ending.SETTINGS
    assert modes(vehicle) == ([] if told else [SYSTEMID, STABILIZE])
    assert told or vehicle.asked[1][0] - vehicle.asked[0][0] < 1.0, "before anything is excited"


def test_settings_that_the_vehicle_does_not_tell_in_flight_are_asked_for_again_and_else_said(
    session: FakeSession, folder: FlightFolder
) -> None:
    def fly_losing(answers: int, into: FlightFolder) -> RunResult:
        def on_progress(progress: Progress) -> None:
            if isinstance(progress, RunProgress):
                session.drop_answers.setdefault("SID_AXIS", answers)
            elif isinstance(progress, RunResult):
                session.drop_answers.clear()

        return fly(session, into, on_progress=on_progress).runs[0]

    assert fly_losing(3, folder).clean
    run = fly_losing(1000, create(folder.path / "second"))
    assert run.verdict is not None
    assert run.verdict.reasons == (
        "whether it was flown as planned is not known: the vehicle no longer told its SID_AXIS",
    )


def test_nothing_is_claimed_that_needs_the_log(session: FakeSession, folder: FlightFolder) -> None:
    (run,) = fly(session, folder).runs
    assert run.verdict is not None
    assert run.verdict.words.startswith("flown, log on the vehicle's card   ")
    assert (run.verdict.keep, run.clean, run.verdict.coherent_hz) == (False, True, None)
    assert 200 < run.verdict.samples < 350, "attitudes"
    about = json.loads(folder.about.read_text())
    assert about["log"] == "card"
    assert about["runs"][0]["verdict"]["keep"] is None
    assert about["runs"][0]["verdict"]["log"] == "card"
    assert about["recording"]["complete"] is False
    assert about["recording"]["problems"] == []


def test_each_runs_time_is_told_by_the_vehicles_clock(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    entered: list[float] = []
    vehicle.in_sweep(2.0, lambda: entered.append(vehicle.entered or math.nan))
    (run,) = fly(session, folder).runs
    assert run.log_start_s is not None
    assert 0.0 < run.log_start_within_s < 0.2
    assert abs(run.log_start_s - entered[0]) <= run.log_start_within_s
    about = json.loads(folder.about.read_text())
    assert about["runs"][0]["log_start_s"] == pytest.approx(run.log_start_s)
    assert about["boot"]["reboots"] == 0
    assert about["boot"]["booted"] is not None


@pytest.mark.parametrize("backend", [0.0, 2.0, None])
def test_a_vehicle_that_keeps_no_log_is_refused(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder, backend: float | None
) -> None:
    if backend is None:
        del vehicle.parameters["LOG_BACKEND_TYPE"]
    else:
        vehicle.parameters["LOG_BACKEND_TYPE"] = backend
    with pytest.raises(NotReadyError, match="LOG_BACKEND_TYPE") as refused:
        fly(session, folder)
    assert ("set it to 1" in str(refused.value)) == (backend is not None)
    assert modes(vehicle) == []


def test_a_vehicle_whose_logging_failed_is_refused(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.say("PreArm: Logging failed")
    with pytest.raises(NotReadyError, match="PreArm: Logging failed"):
        fly(session, folder)
    assert modes(vehicle) == []


def test_a_log_that_fails_before_a_run_starts_nothing(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def confirm(briefing: Briefing) -> bool:
        session.log_fails = "Out of Space for Logging"
        return True

    result = fly(session, folder, confirm=confirm)
    assert (result.ending, modes(vehicle)) == (Ending.LOG, [])
    assert "Out of Space" in result.stopped


def test_a_log_that_fails_in_mid_run_ends_it(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    vehicle.in_sweep(4.0, lambda: setattr(session, "log_fails", "Out of Space for Logging"))
    result = fly(session, folder)
    assert (result.ending, modes(vehicle)) == (Ending.LOG, [SYSTEMID, STABILIZE])
    assert not result.done


def test_dead_telemetry_ends_a_run(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    vehicle.in_sweep(4.0, lambda: setattr(vehicle, "logs", False))
    result = fly(session, folder)
    assert (result.ending, modes(vehicle)) == (Ending.TELEMETRY, [SYSTEMID, STABILIZE])
    assert "no attitude by telemetry for 1." in result.stopped
    assert vehicle.asked[1][0] - vehicle.asked[0][0] < 7.0


def test_no_run_starts_on_dead_telemetry(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    def on_progress(progress: object) -> None:
        if isinstance(progress, RunReady):
            vehicle.logs = False

    result = fly(session, folder, on_progress=on_progress)
    assert (result.ending, modes(vehicle)) == (Ending.TELEMETRY, [])


def test_too_few_attitudes_are_refused(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    def thin() -> None:
        vehicle.samples[:] = vehicle.samples[:3]

    session.ticks.append(thin)
    with pytest.raises(NotReadyError, match="attitudes a second, and the limits are watched by at least 8"):
        fly(session, folder)


@pytest.mark.parametrize(
    ("wanted", "ending", "asked"),
    [
        ("Ctrl-C", Ending.ABORTED, [SYSTEMID, STABILIZE]),
        ("pilot", Ending.PILOT, [SYSTEMID]),
        ("limit", Ending.LIMIT, [SYSTEMID, STABILIZE]),
        ("link", Ending.LINK, [SYSTEMID, STABILIZE]),
    ],
)
def test_what_ends_a_run_ends_it_without_the_log_too(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder, wanted: str, ending: Ending, asked: list[int]
) -> None:
    wish: list[str] = []

    def lose() -> None:
        session.deaf_from, session.deaf_until = vehicle.now, vehicle.now + 5.0

    acts: dict[str, Callable[[], None]] = {
        "Ctrl-C": lambda: wish.append("Ctrl-C"),
        "pilot": lambda: vehicle.pilot(ALT_HOLD),
        "limit": lambda: setattr(vehicle, "gain", 60.0),
        "link": lose,
    }
    before = dict(vehicle.parameters)
    vehicle.in_sweep(3.0, acts[wanted])
    result = fly(session, folder, CHIRP, CHIRP, aborted=lambda: wish[0] if wish else None)
    assert (result.ending, len(result.runs), modes(vehicle)) == (ending, 1, asked)
    assert vehicle.mode == (ALT_HOLD if wanted == "pilot" else STABILIZE)
    assert vehicle.parameters == before
    assert not result.done
    assert result.runs[0].verdict is not None
    assert result.runs[0].verdict.words.startswith("fly again: ")


def test_no_run_starts_on_a_late_link(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    session.lag_s = 0.6
    with pytest.raises(NotReadyError, match="an abort would come too late"):
        fly(session, folder)
    assert modes(vehicle) == []
