"""Whole cards in fake time: what the vehicle was asked, what was written, what is on disk, whatever happens."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_flight import PARAMETERS, SYSTEMID, FakeSession, FakeVehicle

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver, TestCard, load_card, parse_card, single_card
from gcs.cli.sweep import print_document, print_result
from gcs.errors import TippathError
from gcs.flight.excitation import abort
from gcs.flight.flown_card import Briefing, SweepResult
from gcs.flight.flyable import NotReadyError, require_flyable
from gcs.flight.folder import FlightFolder, create
from gcs.flight.order import IN_ORDER
from gcs.flight.recorder import RecordingSummary
from gcs.flight.run import Note, Probed, Progress, RunProgress, RunReady, RunResult
from gcs.flight.run_state import Ending, Phase
from gcs.flight.sweep import fly_card
from gcs.link.log_end import LogEnd
from gcs.link.procedures import ProcedureError
from gcs.vehicle.profile import CannotFlyError

STABILIZE, ALT_HOLD, RTL = 0, 2, 6
CHIRP = Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=10.0)
DOUBLET = Maneuver(kind="doublet", axis="pitch", amplitude=0.1, duration_s=3.0, pulse_s=0.25)


@pytest.fixture
def vehicle() -> FakeVehicle:
    return FakeVehicle()


@pytest.fixture
def session(vehicle: FakeVehicle) -> FakeSession:
    return FakeSession(vehicle)


@pytest.fixture
def folder(tmp_path: Path) -> FlightFolder:
    return create(tmp_path / "flight")


def fly(session: FakeSession, folder: FlightFolder, *maneuvers: Maneuver, **more: Any) -> SweepResult:
    card = more.pop("card", None) or TestCard(name="test", maneuvers=maneuvers)
    return fly_card(session, card, folder=folder, clock=session, disk_free=lambda _: 10**12, **more)


def modes(vehicle: FakeVehicle) -> list[int]:
    return [mode for _, mode in vehicle.asked]


def as_found(vehicle: FakeVehicle) -> bool:
    return vehicle.parameters == PARAMETERS


def test_a_card_is_flown_to_its_end_and_leaves_the_vehicle_as_found(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    said: list[Progress] = []
    result = fly(session, folder, CHIRP, DOUBLET, on_progress=said.append)
    assert result.complete
    assert [run.ending for run in result.runs] == [Ending.FINISHED, Ending.FINISHED]
    assert all(run.clean for run in result.runs), [run.verdict for run in result.runs]
    assert modes(vehicle) == [SYSTEMID, STABILIZE, SYSTEMID, STABILIZE]
    assert vehicle.mode == STABILIZE
    assert as_found(vehicle)
    assert not any(mode == SYSTEMID for *_, mode in vehicle.written), "never written in the excitation mode"
    assert vehicle.written[26][1:3] == ("SID_AXIS", 0.0), "given back first: with it 0 no switch starts a sweep"
    assert session.ended_recordings == 1
    kinds = [type(one) for one in said]
    assert kinds.count(RunReady) == kinds.count(RunResult) == 2
    frequency = [one for one in said if isinstance(one, RunProgress) and one.phase is Phase.FLYING]
    assert frequency[0].elapsed_s < 0 < frequency[-1].elapsed_s


def test_the_values_written_are_the_cards(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    fly(session, folder, CHIRP)
    first = {name: value for _, name, value, _ in reversed(vehicle.written[:13])}
    assert first["SID_AXIS"] == 10
    assert first["SID_MAGNITUDE"] == np.float32(0.1)
    assert (first["SID_T_REC"], first["SIDX_LAW"], first["SIDX_KIND"], first["SID_T_FADE_IN"]) == (10, 1, 0, 0)


def test_the_flights_file_tells_what_was_flown(session: FakeSession, folder: FlightFolder) -> None:
    fly(session, folder, CHIRP, about={"link": "udpin:127.0.0.1:14550"})
    about = json.loads(folder.about.read_text())
    assert about["format"] == "tippath.flight/1"
    assert about["link"] == "udpin:127.0.0.1:14550"
    assert about["runs"][0]["flew"] == "Table 1"
    assert about["runs"][0]["maneuver"]["amplitude"] == 0.1
    assert about["runs"][0]["verdict"]["keep"] is True
    assert about["stopped"] == ""
    assert about["recording"]["logs"][0]["path"] == "flight.BIN"
    assert folder.card.exists()


def test_the_verdict_sees_the_samples_of_the_maneuver_only(session: FakeSession, folder: FlightFolder) -> None:
    (run,) = fly(session, folder, CHIRP).runs
    assert run.verdict is not None
    assert run.verdict.expected == 1000
    assert abs(run.verdict.samples - 1000) <= 2
    assert run.verdict.coherent_hz is not None
    assert run.verdict.coherent_hz[0] < 1.0
    assert run.verdict.coherent_hz[1] > 8.0
    assert run.peaks.p is not None
    assert 0.1 < run.peaks.p < 0.5


def test_a_vehicle_that_does_not_answer_is_flown_again(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.gain = 0.0
    result = fly(session, folder, CHIRP, DOUBLET)
    assert result.complete
    assert [run.verdict is not None and run.verdict.keep for run in result.runs] == [False, False]
    assert "of the band" in result.runs[0].verdict.reasons[0]  # type: ignore[union-attr]
    assert "did not answer" in result.runs[1].verdict.reasons[0]  # type: ignore[union-attr]


# -------------------------------------------------------------------------------------------- somebody wants the end


def test_ctrl_c_in_mid_chirp_ends_the_excitation_and_the_card(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    wish: list[str] = []
    vehicle.in_sweep(4.0, lambda: wish.append("Ctrl-C"))
    result = fly(session, folder, CHIRP, DOUBLET, aborted=lambda: wish[0] if wish else None)
    assert (result.complete, result.ending, len(result.runs)) == (False, Ending.ABORTED, 1)
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert vehicle.asked[1][0] - vehicle.asked[0][0] < 4.2
    assert as_found(vehicle)
    assert json.loads(folder.about.read_text())["runs"][0]["ending"] == "aborted"


def test_an_abort_is_repeated_until_it_arrives(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    wish: list[str] = []

    def lose_and_wish() -> None:
        session.drop_commands = 4
        wish.append("Ctrl-C")

    vehicle.in_sweep(4.0, lose_and_wish)
    result = fly(session, folder, CHIRP, aborted=lambda: wish[0] if wish else None)
    assert result.ending is Ending.ABORTED
    assert session.drop_commands == 0
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert 5.0 < vehicle.asked[1][0] - vehicle.asked[0][0] < 6.0, "four lost, 0.3 s apart"


def test_a_ctrl_c_between_two_runs_starts_no_other(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    wish: list[str] = []

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunResult):
            wish.append("Ctrl-C")

    result = fly(session, folder, CHIRP, DOUBLET, on_progress=on_progress, aborted=lambda: wish[0] if wish else None)
    assert (len(result.runs), result.ending, result.stopped) == (1, Ending.ABORTED, "Ctrl-C")
    assert modes(vehicle) == [SYSTEMID, STABILIZE]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("a screen fell over")])
def test_an_exception_in_mid_run_is_raised_only_after_the_vehicle_is_back(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder, error: BaseException
) -> None:
    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunProgress) and progress.elapsed_s > 3:
            raise error

    with pytest.raises(type(error)):
        fly(session, folder, CHIRP, on_progress=on_progress)
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert vehicle.mode == STABILIZE
    assert as_found(vehicle)
    assert session.ended_recordings == 1
    assert json.loads(folder.about.read_text())["stopped"] != ""


def test_a_second_and_third_ctrl_c_on_the_way_back_do_not_leave_it_excited(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    interruptions: list[float] = []

    def interrupt() -> None:
        in_run = vehicle.entered is not None and vehicle.now - vehicle.entered > 4
        if in_run and len(interruptions) < 3:
            interruptions.append(vehicle.now)
            raise KeyboardInterrupt

    session.ticks.append(interrupt)
    session.drop_commands = 0
    vehicle.in_sweep(3.9, lambda: setattr(session, "drop_commands", 3))
    with pytest.raises(KeyboardInterrupt):
        fly(session, folder, CHIRP)
    assert len(interruptions) == 3
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert vehicle.mode == STABILIZE


def test_a_vehicle_that_never_leaves_is_left_to_the_pilot_after_a_while(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.never_leaves = True
    wish: list[str] = []
    vehicle.in_sweep(2.0, lambda: wish.append("Ctrl-C"))
    result = fly(session, folder, CHIRP, aborted=lambda: wish[0] if wish else None)
    assert result.ending is Ending.STUCK
    assert "pilot must take it" in result.stopped
    sent = [when for when, mode in vehicle.asked if mode == STABILIZE]
    assert len(sent) > 20
    assert min(np.diff(sent)) > 0.25
    assert not any(mode == SYSTEMID for *_, mode in vehicle.written)


# -------------------------------------------------------------------------------------------- the pilot


@pytest.mark.parametrize("instant", [True, False])
@pytest.mark.parametrize("mode", [STABILIZE, ALT_HOLD, RTL])
def test_a_pilot_who_takes_over_in_mid_sweep_is_never_talked_over(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder, mode: int, instant: bool
) -> None:
    vehicle.instant_heartbeat = instant
    vehicle.in_sweep(4.0, lambda: vehicle.pilot(mode))
    result = fly(session, folder, CHIRP, DOUBLET)
    assert (result.ending, len(result.runs)) == (Ending.PILOT, 1)
    assert modes(vehicle) == [SYSTEMID], "nothing but the start was ever commanded"
    assert vehicle.mode == mode
    assert as_found(vehicle), "parameters may go back, they fly nothing now"


def test_a_pilot_who_takes_over_between_two_runs_ends_the_card(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunReady) and progress.run.number == 2:
            vehicle.pilot(ALT_HOLD)

    result = fly(session, folder, CHIRP, DOUBLET, on_progress=on_progress)
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert result.ending is Ending.PILOT
    assert result.runs[-1].verdict is None
    assert vehicle.mode == ALT_HOLD


def test_a_pilot_who_flies_the_excitation_mode_himself_is_left_alone(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunReady):
            vehicle.pilot(SYSTEMID)

    result = fly(session, folder, CHIRP, on_progress=on_progress)
    assert modes(vehicle) == []
    assert result.ending is Ending.PILOT
    assert not any(mode == SYSTEMID for *_, mode in vehicle.written)


def test_no_parameter_is_written_once_the_excitation_mode_is_on(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    plain = vehicle.write

    def write(name: str, value: float) -> None:
        plain(name, value)
        if name == "SID_F_START_HZ":
            vehicle.pilot(SYSTEMID)

    vehicle.write = write  # type: ignore[method-assign]
    result = fly(session, folder, CHIRP)
    assert "no parameter is written now" in result.stopped
    assert modes(vehicle) == []
    assert [name for _, name, *_ in vehicle.written] == ["SID_AXIS", "SID_MAGNITUDE", "SID_F_START_HZ"]


# -------------------------------------------------------------------------------------------- the link


def test_a_link_lost_in_mid_chirp_is_not_resumed_but_ended_once_it_is_back(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.parameters["SID_T_REC"] = 30.0
    begun: list[float] = []

    def lose() -> None:
        begun.append(vehicle.now)
        session.deaf_from, session.deaf_until = vehicle.now, vehicle.now + 8.0

    vehicle.in_sweep(4.0, lose)
    result = fly(session, folder, Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0), DOUBLET)
    assert (result.ending, len(result.runs)) == (Ending.LINK, 1)
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert vehicle.asked[1][0] >= begun[0] + 8.0, "nothing was sent while the link was lost"
    assert vehicle.mode == STABILIZE


class Blindly:
    """Somebody at the app who wants an end sent unheard."""

    def chosen(self) -> int | None:
        return None

    def again(self, result: RunResult) -> bool:
        return False

    def blind(self) -> bool:
        return True


@pytest.mark.parametrize("asked", [True, False])
def test_while_nothing_is_heard_only_the_maneuvers_size_is_sent_and_only_if_asked(
    asked: bool, vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    lost: list[float] = []

    def lose() -> None:
        lost.append(vehicle.now)
        session.deaf_from, session.deaf_until = vehicle.now, vehicle.now + 12.0

    vehicle.in_sweep(4.0, lose)
    chirp = Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0)
    result = fly(session, folder, chirp, choosing=Blindly() if asked else IN_ORDER)
    assert result.ending is Ending.LINK
    assert {(name, value) for _, name, value in session.unheard} == ({("SID_MAGNITUDE", 0.0)} if asked else set())
    assert all(lost[0] + 3.0 < at_s < lost[0] + 12.5 for at_s, _, _ in session.unheard), "only while it is not heard"
    assert modes(vehicle) == [SYSTEMID, STABILIZE], "no mode is sent unheard"
    assert vehicle.asked[1][0] >= lost[0] + 12.0
    assert as_found(vehicle), "its own size is back, too"


def test_a_failsafe_during_a_lost_link_is_not_talked_over(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def lose() -> None:
        session.deaf_from, session.deaf_until = vehicle.now, vehicle.now + 8.0

    vehicle.in_sweep(4.0, lose)
    vehicle.in_sweep(9.0, lambda: vehicle.pilot(RTL))
    result = fly(session, folder, Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0), DOUBLET)
    assert result.ending is Ending.LINK
    assert modes(vehicle) == [SYSTEMID]
    assert vehicle.mode == RTL
    assert "RTL" in result.runs[0].mode_after


@pytest.mark.parametrize("found_again", [True, False])
def test_settings_are_put_back_if_a_link_lost_before_a_start_is_found(
    found_again: bool,
    vehicle: FakeVehicle,
    session: FakeSession,
    folder: FlightFolder,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    notes: list[str] = []
    stop = session.stop_recording

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunReady):
            session.deaf_from = vehicle.now
            session.deaf_until = vehicle.now + (20.0 if found_again else 1000.0)
            session.sleep(5.0)
        elif isinstance(progress, Note):
            notes.append(progress.words)

    def waited_for(*, meanwhile: Callable[[], None]) -> RecordingSummary:
        session.sleep(25.0)
        return stop(meanwhile=meanwhile)

    monkeypatch.setattr(session, "stop_recording", waited_for)
    fly(session, folder, CHIRP, on_progress=on_progress, aborted=lambda: "lost" if session.snapshot().lost else None)
    assert modes(vehicle) == []
    assert as_found(vehicle) is found_again
    assert any("stay in the vehicle" in note for note in notes) is not found_again


def test_a_link_that_stays_lost_ends_without_a_command(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def lose() -> None:
        session.deaf_from = vehicle.now

    vehicle.in_sweep(4.0, lose)
    result = fly(session, folder, CHIRP)
    assert result.ending is Ending.LINK
    assert modes(vehicle) == [SYSTEMID]
    assert result.runs[0].mode_after == "unknown"


def test_ctrl_c_ends_the_wait_for_a_lost_link_and_sends_nothing(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    """Ctrl-C from before the loss is no wish to give up; one after it is."""
    pressed = [1]

    def lose() -> None:
        session.deaf_from = vehicle.now
        vehicle.at(vehicle.now + 12.0, lambda: pressed.append(1))

    vehicle.in_sweep(3.0, lose)
    result = fly(session, folder, CHIRP, DOUBLET, interruptions=lambda: len(pressed))
    assert (result.ending, len(result.runs)) == (Ending.LINK, 1)
    assert "what the vehicle does is not known" in result.stopped
    assert modes(vehicle) == [SYSTEMID]
    assert 12.0 < vehicle.now - session.deaf_from < 13.0, "not the whole minute"
    assert result.missing_words.endswith("planned samples not flown or not received")


@pytest.mark.parametrize(("switch", "flown"), [(0.0, False), (1.0, True), (None, True)])
def test_a_rate_to_follow_needs_the_lqr_where_the_vehicle_tells(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder, switch: float | None, flown: bool
) -> None:
    rate = Maneuver(kind="doublet", axis="roll", amplitude=0.01, duration_s=3.0, target="rate", pulse_s=0.25)
    if switch is not None:
        vehicle.parameters["LQR_SW"] = switch
    if flown:
        result = fly(session, folder, rate)
        assert result.complete, result.stopped
        checks = {check["name"]: check["words"] for check in json.loads(folder.about.read_text())["checks"]}
        assert checks["controller"].startswith("the pilot's switch selects" if switch else "the vehicle does not tell")
        return
    for attempt in (
        lambda: require_flyable(session, single_card(rate), session),
        lambda: fly(session, folder, rate),
    ):
        with pytest.raises(NotReadyError, match=r"controller: the LQR is not selected \(LQR_SW is 0\)"):
            attempt()
    assert modes(vehicle) == []
    assert session.recordings == []
    assert fly(session, folder, CHIRP).complete, "a chirp is flown with either controller"


def test_what_is_missing_is_not_denied(session: FakeSession, vehicle: FakeVehicle, folder: FlightFolder) -> None:
    assert fly(session, folder, CHIRP).missing_words.startswith("0 ")  # one at the end of a run is no loss
    vehicle.in_sweep(4.0, lambda: vehicle.pilot(ALT_HOLD))
    early = fly(session, create(folder.path / "second"), CHIRP)
    verdict = early.runs[0].verdict
    assert verdict is not None
    assert early.missing_words == f"{verdict.missing:,} of 1,000 planned samples not flown or not received"


def test_a_short_silence_is_no_lost_link(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    def lose() -> None:
        session.deaf_from, session.deaf_until = vehicle.now, vehicle.now + 2.5

    vehicle.in_sweep(4.0, lose)
    assert fly(session, folder, CHIRP).runs[0].ending is Ending.FINISHED


def test_a_lost_acknowledgement_of_the_start_starts_only_once(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    session.drop_acks = 1
    result = fly(session, folder, CHIRP)
    assert result.complete
    assert modes(vehicle) == [SYSTEMID, STABILIZE]


def test_lost_starts_are_sent_again(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    session.drop_commands = 3
    assert fly(session, folder, CHIRP).complete
    assert modes(vehicle) == [SYSTEMID, STABILIZE]


def test_a_finish_that_was_not_heard_is_known_from_the_log(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.silent_text = True
    result = fly(session, folder, CHIRP)
    assert result.complete
    assert result.runs[0].clean


# -------------------------------------------------------------------------------------------- the vehicle says no


def test_a_refused_mode_ends_the_card_with_the_vehicles_words(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.refuses = "Axis requires manual throttle"
    result = fly(session, folder, CHIRP, DOUBLET)
    assert (result.ending, len(result.runs)) == (Ending.REFUSED, 1)
    assert "Axis requires manual throttle" in result.stopped
    assert modes(vehicle) == [SYSTEMID]
    assert as_found(vehicle)


def test_a_refused_parameter_ends_the_card_before_anything_is_excited(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.stubborn.add("SID_MAGNITUDE")
    result = fly(session, folder, CHIRP)
    assert not result.complete
    assert "SID_MAGNITUDE" in result.stopped
    assert modes(vehicle) == []
    assert vehicle.parameters["SID_AXIS"] == 0


def test_a_lean_stop_of_the_vehicle_is_told_and_it_is_brought_back(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.in_sweep(4.0, lambda: vehicle.say("SystemID Stopped: lean=31.000000 max=30.000000"))
    result = fly(session, folder, CHIRP, DOUBLET)
    assert result.ending is Ending.STOPPED
    assert "lean=31" in result.stopped
    assert modes(vehicle) == [SYSTEMID, STABILIZE]


def test_an_exceeded_limit_ends_the_run(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    vehicle.in_sweep(4.0, lambda: setattr(vehicle, "lean", math.radians(26)))
    result = fly(session, folder, CHIRP, DOUBLET)
    assert result.ending is Ending.LIMIT
    assert "roll 26.0° is beyond 25.0°" in result.stopped
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert vehicle.asked[1][0] - vehicle.asked[0][0] < 4.3


def test_a_rate_limit_is_judged_on_the_logs_samples(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    result = fly(session, folder, CHIRP, limits=Limits(rate=0.1))
    assert result.ending is Ending.LIMIT
    assert "rad/s is beyond 0.10" in result.stopped


# -------------------------------------------------------------------------------------------- before anything is flown


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v: setattr(v, "armed", False), "the pilot arms and takes off"),
        (lambda v: setattr(v, "status", 3), "the pilot takes off"),
        (lambda v: setattr(v, "mode", ALT_HOLD), "AltHold: a sweep needs Stabilize or Acro"),
        (lambda v: setattr(v, "mode", SYSTEMID), "tippath abort"),
        (lambda v: setattr(v, "logs", False), "LOG_BACKEND_TYPE"),
        (lambda v: setattr(v, "lean", 0.3), "hover level first"),
    ],
)
def test_what_is_not_ready_is_said_and_nothing_is_written(
    vehicle: FakeVehicle,
    session: FakeSession,
    folder: FlightFolder,
    change: Callable[[FakeVehicle], None],
    words: str,
) -> None:
    change(vehicle)
    vehicle._beat()
    with pytest.raises(NotReadyError, match="not ready") as error:
        fly(session, folder, CHIRP)
    assert words in str(error.value)
    assert (vehicle.asked, vehicle.written) == ([], [])


def test_a_full_disk_is_said_before_the_start(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    with pytest.raises(NotReadyError, match="make room"):
        fly_card(session, single_card(CHIRP), folder=folder, clock=session, disk_free=lambda _: 1000)
    assert vehicle.asked == []


def test_a_disk_that_gets_full_in_flight_swallows_no_verdict_and_ends_no_card(
    session: FakeSession, folder: FlightFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[Progress] = []
    full = False

    def watch(progress: Progress) -> None:
        nonlocal full
        said.append(progress)
        full = isinstance(progress, RunReady) and progress.run.number == 1

    def write(self: FlightFolder, about: Mapping[str, Any]) -> None:
        if full:
            raise TippathError("flight.json cannot be written (No space left on device)")
        kept(self, about)

    kept = FlightFolder.write
    monkeypatch.setattr(FlightFolder, "write", write)
    result = fly(session, folder, CHIRP, DOUBLET, on_progress=watch)
    assert [type(one) for one in said].count(RunResult) == 2
    assert result.complete
    assert len(folder.runs()) == 2


def test_a_flights_file_that_was_never_taken_is_told_and_nothing_is_called_complete(
    session: FakeSession, folder: FlightFolder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(self: FlightFolder, about: Mapping[str, Any]) -> None:
        raise TippathError("flight.json cannot be written (No space left on device)")

    monkeypatch.setattr(FlightFolder, "write", full)
    result = fly(session, folder, CHIRP)
    assert result.runs[0].clean
    assert not result.complete
    assert result.problems == ("flight.json cannot be written (No space left on device)",)
    print_result(result, [])
    print_document(result, [])
    said = capsys.readouterr().out
    assert "flight.json cannot be written (No space left on device)" in said
    assert '"complete": false' in said
    assert '"verdict"' in said, "the document is printed all the same"


def test_a_flight_is_told_from_its_first_second_on(session: FakeSession, folder: FlightFolder) -> None:
    """Whatever ends the program then, the folder says which vehicle, which card, and that it did not end."""

    def look(progress: Progress) -> None:
        about = folder.read()
        seen.append((len(about["runs"]), about["planned"], about["ended"], about["vehicle"]["system"]))

    seen: list[tuple[int, int, str | None, int]] = []
    fly(session, folder, CHIRP, DOUBLET, on_progress=look)
    assert seen[0] == (0, 2, None, 1)
    assert folder.read()["ended"] is not None


def test_a_maneuver_the_vehicle_cannot_fly_is_said_before_anything_is_written(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    for name in [name for name in vehicle.parameters if name.startswith("SIDX_")]:
        del vehicle.parameters[name]
    with pytest.raises(CannotFlyError, match="no doublet"):
        fly(session, folder, CHIRP, DOUBLET)
    with pytest.raises(CannotFlyError, match="no doublet"):
        require_flyable(session, TestCard(name="x", maneuvers=(CHIRP, DOUBLET)), session)
    assert (vehicle.asked, vehicle.written, session.recordings) == ([], [], [])


def test_plain_ardupilot_flies_its_own_law_and_the_file_says_so(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    for name in [name for name in vehicle.parameters if name.startswith("SIDX_")]:
        del vehicle.parameters[name]
    vehicle.parameters["SIDX_KIND"] = 0.0  # the fake's own, not asked for
    vehicle.parameters["SIDX_PULSE_S"] = 0.3
    result = fly(session, folder, CHIRP)
    assert result.profile.name == "ArduPilot"
    assert folder.runs()[0]["flew"] == "ArduPilot's law, no noise"
    assert not any(name.startswith("SIDX") for _, name, *_ in vehicle.written)


def test_without_a_word_of_confirmation_nothing_is_flown(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    briefings: list[Briefing] = []

    def refuse(briefing: Briefing) -> bool:
        briefings.append(briefing)
        return False

    with pytest.raises(NotReadyError, match="not confirmed"):
        fly(session, folder, CHIRP, confirm=refuse)
    assert (vehicle.asked, vehicle.written) == ([], [])
    assert session.ended_recordings == 1
    assert "does NOT stop" in briefings[0].link_loss.words, "station 254 does not hold the failsafe of 255"


def test_a_vehicle_without_an_excitation_is_told_apart(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.parameters.clear()
    with pytest.raises(CannotFlyError, match="SID_AXIS"):
        fly(session, folder, CHIRP)


# -------------------------------------------------------------------------------------------- build-up

STEPPED = """
name = "stepped"
rest_s = 0.5
[[step]]
amplitude = 0.25
f_stop_hz = 5
[[step]]
amplitude = 0.5
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.1
duration_s = 10
repeat = 2
"""


def test_a_build_up_goes_step_by_step(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    result = fly(session, folder, card=parse_card(STEPPED, "stepped"))
    assert result.complete
    sizes = [value for _, name, value, _ in vehicle.written if name == "SID_MAGNITUDE"]
    assert sizes == pytest.approx([0.025, 0.05, 0.1, 0.1, 0.05])
    stops = [value for _, name, value, _ in vehicle.written if name == "SID_F_STOP_HZ"]
    assert stops == [5, 10, 10, 10, 10]
    assert [run["purpose"] for run in folder.runs()] == ["build-up", "build-up", "fit", "fit"]


def test_a_step_stays_locked_until_the_one_before_is_clean(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.gain = 0.0
    result = fly(session, folder, card=parse_card(STEPPED, "stepped"))
    assert len(result.runs) == 1
    assert "stays locked" in result.stopped
    assert "was not clean" in result.stopped


def test_a_step_stays_locked_where_the_next_would_leave_the_envelope(
    session: FakeSession, folder: FlightFolder
) -> None:
    result = fly(session, folder, card=parse_card(STEPPED, "stepped"), limits=Limits(rate=0.12))
    assert len(result.runs) == 1
    assert result.runs[0].clean
    assert "of the limits" in result.stopped


# -------------------------------------------------------------------------------------------- abort from outside


def test_abort_ends_an_excitation_that_somebody_else_started(vehicle: FakeVehicle, session: FakeSession) -> None:
    vehicle.parameters["SID_AXIS"] = 10
    vehicle._beat()
    vehicle.pilot(SYSTEMID)
    session.drop_commands = 2
    result = abort(session, clock=session)
    assert (result.was_excited, result.ended, result.mode_after, result.asked) == (True, True, "Stabilize", 3)
    assert modes(vehicle) == [STABILIZE]


def test_abort_believes_no_heartbeat_from_before_a_silence(vehicle: FakeVehicle, session: FakeSession) -> None:
    vehicle._beat()
    vehicle.pilot(SYSTEMID)
    session.deaf_from, session.deaf_until = vehicle.now + 0.01, vehicle.now + 2.5
    vehicle.at(vehicle.now + 1.0, lambda: vehicle.pilot(RTL))
    session.sleep(2.0)
    result = abort(session, clock=session)
    assert (result.was_excited, result.ended, result.mode_after) == (True, True, "RTL")
    assert modes(vehicle) == []


def test_abort_waits_where_what_is_heard_is_late(vehicle: FakeVehicle, session: FakeSession) -> None:
    vehicle._beat()
    vehicle.pilot(SYSTEMID)
    session.lag_s = 5.0
    began = vehicle.now
    vehicle.at(began + 0.2, vehicle._beat)
    result = abort(session, clock=session)
    assert (result.ended, modes(vehicle)) == (True, [STABILIZE])
    first_order_s = vehicle.asked[0][0]
    assert first_order_s > began + 1.0, "the heartbeat after 0.2 s may be older than the silence"


def test_abort_sends_nothing_in_any_other_mode(vehicle: FakeVehicle, session: FakeSession) -> None:
    vehicle.pilot(RTL)
    result = abort(session, clock=session)
    assert (result.was_excited, result.ended, result.asked) == (False, True, 0)
    assert modes(vehicle) == []


def test_the_bundled_cards_fly(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    result = fly(session, folder, card=load_card("quick"))
    assert result.complete
    assert len(result.runs) == 4


def test_a_parameter_that_cannot_be_written_back_is_said(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    said: list[Progress] = []

    def on_progress(progress: Progress) -> None:
        said.append(progress)
        if isinstance(progress, RunResult):
            vehicle.stubborn.add("SID_MAGNITUDE")

    result = fly(session, folder, CHIRP, on_progress=on_progress)
    assert result.complete
    notes = [one.words for one in said if not isinstance(one, RunReady | RunResult | RunProgress)]
    assert any("SID_MAGNITUDE is not as it was" in note for note in notes)


def test_the_fake_refuses_as_the_session_does(session: FakeSession) -> None:
    from gcs.link.procedures import ReadParameter

    with pytest.raises(ProcedureError, match="no answer"):
        session.call(ReadParameter("NO_SUCH", 2))


def test_answers_that_are_lost_do_not_turn_table_1_into_another_law(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    session.drop_answers = {"SIDX_LAW": 5, "SIDX_KIND": 2}
    result = fly(session, folder, CHIRP)
    assert session.drop_answers == {"SIDX_LAW": 0, "SIDX_KIND": 0}
    assert result.runs[0].plan.words == "Table 1"


def test_a_setting_that_is_not_answered_is_never_overwritten(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    session.drop_answers = {"SID_T_REC": 100}
    with pytest.raises(ProcedureError, match="SID_T_REC"):
        fly(session, folder, CHIRP)
    assert (vehicle.written, vehicle.asked) == ([], [])


def test_a_pilot_who_lands_while_somebody_makes_up_his_mind_is_seen(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def think(briefing: Briefing) -> bool:
        vehicle.armed = False
        session.sleep(5.0)
        return True

    with pytest.raises(NotReadyError, match="not armed"):
        fly(session, folder, CHIRP, confirm=think)
    assert (vehicle.written, vehicle.asked) == ([], [])


def test_all_that_stands_against_a_card_is_told_at_once(vehicle: FakeVehicle, session: FakeSession) -> None:
    vehicle.armed, vehicle.mode, vehicle.status = False, ALT_HOLD, 5
    vehicle.parameters["LOG_BACKEND_TYPE"] = 1.0
    for name in [name for name in vehicle.parameters if name.startswith("SIDX_")]:
        del vehicle.parameters[name]
    vehicle._beat()
    with pytest.raises(NotReadyError) as error:
        require_flyable(session, TestCard(name="x", maneuvers=(CHIRP, DOUBLET)), session)
    for words in ("not armed", "AltHold", "a failsafe is active", "LOG_BACKEND_TYPE to 3", "no doublet"):
        assert words in str(error.value)


def test_a_failsafe_while_a_run_waits_for_its_start_starts_nothing(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def think(progress: Progress) -> None:
        if isinstance(progress, RunReady):
            vehicle.status = 5
            session.sleep(3.0)

    result = fly(session, folder, CHIRP, on_progress=think)
    assert "a failsafe is active" in result.stopped
    assert vehicle.asked == []


def test_the_checks_are_made_again_after_somebody_thought(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def think(briefing: Briefing) -> bool:
        assert all(check.ok for check in briefing.seen())
        vehicle.lean = 0.4
        assert [check.name for check in briefing.seen() if not check.ok] == ["attitude"]
        return True

    with pytest.raises(NotReadyError, match="hover level first"):
        fly(session, folder, CHIRP, confirm=think)
    assert vehicle.asked == []


# ------------------------------------------------------------------------- no false claim, no chirp left running


def test_a_late_link_is_not_ready_and_nothing_is_asked(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    session.lag_s = 3.5
    with pytest.raises(NotReadyError, match=r"lag: 3\.50 s: an abort would come too late"):
        fly(session, folder, CHIRP)
    assert (vehicle.asked, vehicle.written, session.recordings) == ([], [], [])


def test_a_vehicle_that_is_heard_and_answers_nothing_is_not_ready_nor_called_unable(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    session.one_way, session.lag_s = True, None
    with pytest.raises(NotReadyError, match="one way only, or a vehicle that accepts signed messages only"):
        require_flyable(session, TestCard(name="x", maneuvers=(CHIRP,)), session)
    assert (vehicle.asked, vehicle.written) == ([], [])


def test_a_lag_in_flight_sheds_the_log_first_and_ends_the_run(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    at_shedding: list[int] = []
    shed = session.shed_log
    session.shed_log = lambda: (at_shedding.append(len(vehicle.asked)), shed())  # type: ignore[assignment, func-returns-value]
    vehicle.in_sweep(3.0, lambda: setattr(session, "lag_s", 1.2))
    result = fly(session, folder, CHIRP, DOUBLET)
    assert result.ending is Ending.LATE
    assert "the link is 1.2 s late" in result.stopped
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert at_shedding == [1], "before the way back was asked for"


def test_a_log_that_stops_ends_the_run_within_two_seconds_and_is_told_at_once(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    endings: list[tuple[float, Ending | None, str]] = []

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunProgress):
            endings.append((vehicle.now, progress.ending, progress.reason))

    stopped: list[float] = []
    vehicle.in_sweep(4.0, lambda: (stopped.append(vehicle.now), setattr(vehicle, "logs", False)))  # type: ignore[func-returns-value]
    result = fly(session, folder, CHIRP, DOUBLET, on_progress=on_progress)
    assert result.ending is Ending.LOG
    told = next(at for at, ending, reason in endings if ending is Ending.LOG and "no new block" in reason)
    assert told - stopped[0] < 2.0
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert not result.complete


def test_no_run_starts_on_a_dead_log(vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder) -> None:
    """A log that died after the checks: later runs used to finish in no time, on the samples of the first."""

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunReady) and progress.run.number == 2:
            vehicle.logs = False

    result = fly(session, folder, CHIRP, CHIRP, DOUBLET, on_progress=on_progress)
    assert len(result.runs) == 1
    assert "the vehicle's log no longer arrives" in result.stopped
    assert (result.ending, result.complete) == (Ending.LOG, False)
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert as_found(vehicle)


def test_what_another_station_changed_before_the_start_is_not_flown(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunReady):
            vehicle.parameters["SID_MAGNITUDE"] = 0.15

    result = fly(session, folder, CHIRP, on_progress=on_progress)
    assert "SID_MAGNITUDE is 0.15 in the vehicle, not 0.1 as shown" in result.stopped
    assert (result.ending, modes(vehicle), result.complete) == (Ending.SETTINGS, [], False)
    assert as_found(vehicle)


def test_a_sweep_that_flies_other_settings_by_its_own_record_is_ended_in_the_lead_in(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.in_sweep(0.0, lambda: setattr(session, "recorded_magnitude", 0.15))
    result = fly(session, folder, CHIRP)
    assert result.ending is Ending.SETTINGS
    assert "amplitude 0.15, not 0.1" in result.stopped
    assert vehicle.asked[1][0] - vehicle.asked[0][0] < 1.0, "before anything is excited"


@pytest.mark.parametrize("after_s", [-0.1, 4.0], ids=["in the lead-in", "in mid-chirp"])
def test_a_write_that_the_vehicle_tells_all_stations_of_ends_a_run_that_would_fly_it(
    after_s: float, vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def on_progress(progress: Progress) -> None:
        if isinstance(progress, RunProgress) and progress.elapsed_s > after_s and not session.said:
            session.written_by_another("SID_MAGNITUDE", 0.2)

    result = fly(session, folder, CHIRP, on_progress=on_progress)
    assert "SID_MAGNITUDE is 0.2 in the vehicle, not 0.1: somebody else changed it" in result.stopped
    assert (result.ending, result.complete, vehicle.mode) == (Ending.SETTINGS, False, STABILIZE)


def test_a_link_out_for_forty_seconds_in_mid_chirp_is_followed_by_the_way_back(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    def lose() -> None:
        session.deaf_from, session.deaf_until = vehicle.now, vehicle.now + 40.0

    vehicle.in_sweep(4.0, lose)
    result = fly(session, folder, CHIRP)
    assert result.ending is Ending.LINK
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert vehicle.asked[1][0] - session.deaf_until < 1.2, "the first heartbeat heard again is answered"
    assert (vehicle.mode, as_found(vehicle)) == (STABILIZE, True)


def test_one_heartbeat_of_another_vehicle_with_our_id_ends_nothing_and_is_told(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    notes: list[str] = []

    def on_progress(progress: Progress) -> None:
        if isinstance(progress, Note):
            notes.append(progress.words)

    vehicle.in_sweep(3.4, lambda: vehicle.heartbeats.append((vehicle.now, STABILIZE, True, 4)))
    result = fly(session, folder, CHIRP, on_progress=on_progress)
    assert result.runs[0].ending is Ending.FINISHED
    assert "two vehicles with id 1?" in result.runs[0].reason
    assert any("two vehicles with id 1?" in note for note in notes)
    assert not any(mode == SYSTEMID for *_, mode in vehicle.written)
    assert as_found(vehicle)


def test_a_start_that_arrives_after_it_was_given_up_is_brought_back_before_anything_is_written(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    """Six starts lost in a queue that delivers one of them seconds later."""
    session.drop_commands = 6
    session.known_lag_s = 8.0
    late: list[float] = []

    def deliver() -> None:
        if not late and session.drop_commands == 0:
            late.append(vehicle.now)
            vehicle.at(vehicle.now + 4.0, lambda: vehicle.pilot(SYSTEMID))

    session.ticks.append(deliver)
    result = fly(session, folder, CHIRP)
    assert result.ending is Ending.REFUSED
    assert modes(vehicle) == [STABILIZE], "six lost, and one way back"
    assert not any(mode == SYSTEMID for *_, mode in vehicle.written)
    assert (vehicle.mode, as_found(vehicle)) == (STABILIZE, True)


def test_a_vehicle_left_excited_by_a_lost_link_is_looked_at_once_more_before_the_end(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = session.stop_recording

    def waited_for(*, meanwhile: Callable[[], None]) -> RecordingSummary:
        session.sleep(20.0)
        return stop(meanwhile=meanwhile)

    def lose() -> None:
        session.deaf_from, session.deaf_until = vehicle.now, vehicle.now + 70.0

    monkeypatch.setattr(session, "stop_recording", waited_for)
    vehicle.in_sweep(4.0, lose)
    notes: list[str] = []
    fly(session, folder, CHIRP, on_progress=lambda p: notes.append(p.words) if isinstance(p, Note) else None)
    (run,) = json.loads(folder.about.read_text())["runs"]
    assert (run["mode_after"], run["reason"].count("what the vehicle does is not known")) == ("Stabilize", 1)
    assert modes(vehicle) == [SYSTEMID, STABILIZE]
    assert any("still excited: the mode before the run is asked for" in note for note in notes)
    assert as_found(vehicle)


def test_a_log_that_is_not_shown_to_be_whole_is_not_complete(
    session: FakeSession, folder: FlightFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = session.stop_recording

    def cut(*, meanwhile: Callable[[], None]) -> RecordingSummary:
        summary = stop(meanwhile=meanwhile)
        short = tuple(replace(log, end=LogEnd()) for log in summary.logs)
        return replace(summary, logs=short, problems=("flight.BIN ends 9.7 s before the recording did",))

    monkeypatch.setattr(session, "stop_recording", cut)
    result = fly(session, folder, CHIRP)
    assert (result.stopped, result.missing_blocks) == ("", 0)
    assert not result.complete
    assert result.missing_words == "that nothing is missing is not shown"


# ------------------------------------------------------------------------------------------------ the probe


def probed(said: list[Progress]) -> Probed:
    (result,) = [one for one in said if isinstance(one, Probed)]
    return result


def test_a_probe_comes_before_the_card_where_it_is_asked_for(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    said: list[Progress] = []
    result = fly(session, folder, CHIRP, DOUBLET, probe=True, on_progress=said.append)
    assert result.complete, result.stopped
    assert [run.run.label for run in result.runs] == ["probe roll", "probe pitch", "roll chirp", "pitch doublet"]
    assert [run.run.number for run in result.runs] == [1, 2, 3, 4]
    sizes = [value for _, name, value, _ in vehicle.written if name == "SID_MAGNITUDE"]
    assert sizes[:2] == pytest.approx([0.02, 0.02])
    assert probed(said).result.ok
    about = json.loads(folder.about.read_text())
    assert about["probe"]["ok"] is True
    assert "p follows delta_x" in about["probe"]["words"][0]


def test_a_vehicle_that_answers_the_wrong_way_round_flies_no_card(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.gain = -3.0
    said: list[Progress] = []
    result = fly(session, folder, CHIRP, DOUBLET, probe=True, on_progress=said.append)
    assert len(result.runs) == 2
    assert result.ending is Ending.PROBE
    assert "reversed" in {finding.kind for finding in probed(said).result.findings}
    assert "the probe says: " in result.stopped
    assert "nothing more was flown" in result.stopped
    assert (vehicle.mode, as_found(vehicle)) == (STABILIZE, True)


def test_an_amplitude_that_is_predicted_to_leave_the_limits_is_not_flown_and_the_largest_is_told(
    vehicle: FakeVehicle, session: FakeSession, folder: FlightFolder
) -> None:
    vehicle.gain = 12.0
    result = fly(session, folder, Maneuver(kind="chirp", axis="roll", amplitude=0.3, duration_s=10.0), probe=True)
    assert len(result.runs) == 1
    assert result.ending is Ending.LIMIT
    assert "is predicted, from the probe, to leave 25°" in result.stopped
    assert "on this axis" in result.stopped
