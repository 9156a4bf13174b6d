"""What was once found wrong on bad links, and what held: one table, each row a fault script with what must be said, or
the test that has it already. Whatever is said is compared with the vehicle's own log and state (`tests/storms.py`)."""

from __future__ import annotations

import ast
import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from slow_flight import SlowFlight
from storms import CARD, Storm, play

from gcs.link.frames import FrameFinder
from sitl.protocol.links import Address

TESTS = Path(__file__).parents[1]
ONE_RUN = CARD[: CARD.rindex("[[maneuver]]")]
HERE, STOPPED = "end_to_end/test_link_rows.py", "end_to_end/test_stopped_processes.py"
SWEEP, LINK, LOG = "gcs/flight/test_sweep.py", "gcs/flight/test_session.py", "gcs/flight/test_recording_end.py"
BLOCKS, RECORDER = "gcs/link/test_link_procedures.py", "gcs/flight/test_recorder.py"


@dataclass(frozen=True, slots=True)
class Flown:
    """A card of one run of 3 s through a storm."""

    row: str
    what: str
    script: str
    says: str
    """A pattern in what is said."""
    ending: str = "finished"
    """Of the run; empty where none is flown."""
    whole: bool = True
    """The log is called complete; whether it is, is compared in any case."""
    thorough: bool = False
    """One more of a kind."""


FLOWN = (
    Flown("A1", "a second station takes the log", 'other-station = "log@sweep+1"', "log", "log stopped", False),
    Flown("A1", "uplink out for 12 s", 'outage = "up@sweep+1:13"', "", "link lost", False, True),
    Flown("A3", "link out for 40 s in mid-chirp", 'outage = "both@sweep+2:42"', "link lost", "link lost", False),
    Flown("A4", "a heartbeat of somebody else", 'forge = "heartbeat=rtl@sweep+2.3"', "contradicted", "finished"),
    Flown("A6", "a link of 20 kB/s", "bandwidth = 20000", "the link carries .* and the log needs", "", False),
    Flown("A8", "a link of one way", 'outage = "up"', "answer", "", False),
    Flown("A10", "a round trip of 1.2 s", "lag = 0.6", "lag|late", "", False),
    Flown("A10", "a forged block", 'forge = "block=40@sweep+1"', "two versions", "finished", False),
    Flown("A10", "a block of an absurd number", 'forge = "block=60000@sweep+1"', "keep", "finished", thorough=True),
    Flown("held", "loss 2 %", "loss = 0.02", "keep", thorough=True),
    Flown("held", "loss 10 %", "loss = 0.1", "keep", thorough=True),
    Flown("held", "loss 30 %", "loss = 0.3", "keep", thorough=True),
    Flown("held", "loss 60 %", "loss = 0.6", "not ready|answers nothing", "", False, True),
    Flown("held", "outage 1 s", 'outage = "both@sweep+1:2"', "keep", thorough=True),
    Flown("held", "outage 5 s", 'outage = "both@sweep+1:6"', "link lost", "link lost"),
    Flown("held", "outage 5 s, uplink alone", 'outage = "up@sweep+1:6"', "", "link lost", True, True),
    Flown("held", "outage 5 s, downlink alone", 'outage = "down@sweep+1:6"', "", "link lost", True, True),
    Flown("held", "delay 0.3 s", 'lag = "0.15"', "keep", thorough=True),
    Flown("held", "jitter 0.3 s", "jitter = 0.15", "keep", thorough=True),
    Flown("held", "reordering 10 %", "reorder = 0.1", "keep", thorough=True),
    Flown("held", "duplicates 30 %", "duplicate = 0.3", "keep", thorough=True),
    Flown("held", "bits flipped in 20 %", "corrupt = 0.2", "keep", thorough=True),
    Flown(
        *("held", "all of it at once"),
        "loss = 0.1\nduplicate = 0.2\nreorder = 0.1\ncorrupt = 0.05\nlag = 0.05\njitter = 0.03",
        "keep",
        thorough=True,
    ),
    Flown("held", "a second vehicle on the port", 'spoof = "heartbeat=rtl@1:"', "keep", thorough=True),
    Flown(
        "held",
        "a forged end",
        'forge = "text=SystemID Finished@sweep+2"',
        "before the maneuver was over",
        "stopped by the vehicle",
    ),
    Flown("held", "a second station aborts", 'spoof = "mode=stabilize@sweep+2"', "taken over", "taken over"),
    Flown("held", "the vehicle reboots", 'reboot = "sweep+2"', "began a new log|taken over", "taken over", False),
)


@dataclass(frozen=True, slots=True)
class Held:
    """A row that a test has already."""

    row: str
    what: str
    file: str
    test: str


HELD = (
    Held("A1", "no run starts on a dead log", SWEEP, "test_no_run_starts_on_a_dead_log"),
    Held("A2", "uplink out for 12 s", LOG, "test_an_uplink_out_for_twelve_seconds"),
    Held("A2", "outage 20 and 40 s", LOG, "test_an_uplink_out_for_longer_and_a_new_log_after_it"),
    Held("A2", "TCP cut 0.5 s", LOG, "test_a_connection_cut_for_half_a_second"),
    Held("A2", "TCP cut 5 s", LOG, "test_a_connection_cut_for_five_seconds"),
    Held("A2", "foreign START", LOG, "test_a_start_of_another_station_takes_the_stream_away"),
    Held("A2", "the ground stopped for 10 s", LOG, "test_this_program_stopped_for_longer_than_the_vehicle_waits"),
    Held("A5", "other settings before it", SWEEP, "test_what_another_station_changed_before_the_start_is_not_flown"),
    Held("A5", "in it", SWEEP, "test_a_sweep_that_flies_other_settings_by_its_own_record_is_ended_in_the_lead_in"),
    Held("A7", "a full disk", SWEEP, "test_a_disk_that_gets_full_in_flight_swallows_no_verdict_and_ends_no_card"),
    Held("A7", "half a block", RECORDER, "test_half_a_block_is_not_left_at_the_end"),
    Held("A10", "file descriptors", RECORDER, "test_a_log_that_another_follows_is_closed"),
    Held("held", "MAVLink 1", HERE, "test_a_vehicle_that_speaks_mavlink_1_is_flown_and_its_log_whole"),
    Held("held", "stations beside", LINK, "test_another_station_and_another_vehicle_change_nothing_and_are_counted"),
    Held("held", "hostile texts", LINK, "test_hostile_text_arrives_harmless_and_in_order"),
    Held("held", "random frames", LINK, "test_a_hundred_random_peers_worth_of_noise_does_not_stop_the_engine"),
    Held("held", "an abort in loss", SWEEP, "test_an_abort_is_repeated_until_it_arrives"),
    Held("held", "the wall clock", HERE, "test_a_wall_clock_that_jumps_leaves_the_log_whole_and_the_record_readable"),
    Held("held", "the ground stopped", STOPPED, "test_the_ground_stopped_for_some_seconds_loses_nothing"),
    Held("held", "the vehicle stopped", STOPPED, "test_a_vehicle_stopped_for_ten_seconds_is_a_lost_link"),
    Held("held", "kill -9", STOPPED, "test_a_flight_killed_in_mid_run_leaves_the_beginning_of_the_log_and_goes_on"),
    Held("held", "two pushes at once", STOPPED, "test_two_pushes_at_once_leave_one_whole_set"),
    Held("held", "10 minutes", "study/study_log_streams.py", "study_ten_minutes_are_recorded_whole"),
    Held("held", "Ctrl-C", SWEEP, "test_ctrl_c_in_mid_chirp_ends_the_excitation_and_the_card"),
    Held("held", "a full disk before it", SWEEP, "test_a_full_disk_is_said_before_the_start"),
    Held("held", "a failsafe in an outage", SWEEP, "test_a_failsafe_during_a_lost_link_is_not_talked_over"),
)


def _flown() -> Iterator[object]:
    for one in FLOWN:
        marks = [pytest.mark.thorough] if one.thorough else []
        yield pytest.param(one, id=f"{one.row} {one.what}", marks=marks)


@pytest.mark.parametrize("row", list(_flown()))
def test_a_row_says_what_became_of_it_and_nothing_else(row: Flown, tmp_path: Path) -> None:
    outcome = play(Storm(5, "card", row.script), tmp_path / "storm", ONE_RUN)
    assert not outcome.breaches, outcome.told()
    assert re.search(row.says, outcome.said), outcome.told()
    assert [run["ending"] for run in outcome.claims.get("runs", ())] == ([row.ending] if row.ending else [])
    recording = outcome.claims.get("recording") or {"complete": False}
    assert recording["complete"] is row.whole, outcome.told()
    assert (outcome.status == 0) is (row.whole and row.ending == "finished")


@pytest.mark.parametrize("row", HELD, ids=lambda row: f"{row.row} {row.what}")
def test_a_row_that_another_test_has_is_there(row: Held) -> None:
    tree = ast.parse((TESTS / row.file).read_text())
    names = [one.name for one in ast.walk(tree) if isinstance(one, ast.FunctionDef)]
    assert any(name.startswith(row.test) for name in names)


def test_a_vehicle_that_speaks_mavlink_1_is_flown_and_its_log_whole(tmp_path: Path) -> None:
    """As one whose SERIALn_PROTOCOL is 1: all that it says is said so, the log's blocks, too."""
    reader, versions = mavlink.MAVLink(None), set[int]()

    def prepare(flown: SlowFlight) -> None:
        send = flown.wire.send

        def sent(address: Address, data: bytes) -> None:
            message = reader.decode(bytearray(data))
            mav = mavlink.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
            mav.seq = message.get_seq()
            frame = bytes(message.pack(mav, force_mavlink1=True))
            versions.add(frame[0])
            send(address, frame)

        flown.wire.send = sent  # type: ignore[method-assign]

    outcome = play(Storm(5, "card", ""), tmp_path / "storm", ONE_RUN, prepare)
    assert versions == {0xFE}
    assert (outcome.status, outcome.breaches) == (0, []), outcome.told()
    assert outcome.claims["complete"] is outcome.claims["recording"]["complete"] is True


def test_a_wall_clock_that_jumps_leaves_the_log_whole_and_the_record_readable(tmp_path: Path) -> None:
    """An hour back, and ten days ahead, while it is recorded."""

    shown: list[float] = []
    swept: list[float] = []

    def prepare(flown: SlowFlight) -> None:
        def jumping() -> float:
            sweep_s = flown.now() - swept[0] if swept else -math.inf
            if not swept and flown.vehicle.sweeping:
                swept.append(flown.now())
            jump_s = 0.0 if sweep_s < 1 else -3600.0 if sweep_s < 2 else 864_000.0
            shown.append(1.7e9 + flown.now() + jump_s)
            return shown[-1]

        flown._wall_clock = jumping  # type: ignore[method-assign]

    outcome = play(Storm(5, "card", ""), tmp_path / "storm", ONE_RUN, prepare)
    assert (outcome.status, outcome.breaches) == (0, []), outcome.told()
    assert outcome.claims["recording"]["complete"] is True
    steps = [late - early for early, late in itertools.pairwise(shown)]
    assert min(steps) == pytest.approx(-3600.0, abs=1.0)
    assert max(steps) == pytest.approx(867_600.0, abs=1.0)
    tlog = tmp_path / "storm" / "flight" / "flight.tlog"
    frames = FrameFinder().feed(tlog.read_bytes())
    reader: Any = mavutil.mavlink_connection(str(tlog))
    assert sum(1 for _ in iter(reader.recv_msg, None)) > 0.9 * len(frames) > 200
    reader.close()


def test_no_row_is_left_out() -> None:
    """A9 is files: `tests/gcs/logs`, `tests/gcs/test_documents.py`."""
    assert {one.row for one in (*FLOWN, *HELD)} == {*(f"A{number}" for number in (1, 2, 3, 4, 5, 6, 7, 8, 10)), "held"}
