"""Lines of text at any width: the abort key never goes, nothing is wider than it may be, the bell rings in time."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import pytest
from fake_app import FLYING as IN_FLIGHT
from fake_desk import DESKS
from rich.cells import cell_len

from gcs.cards.envelope import Use
from gcs.desk import DeskState
from gcs.flight.preflight import Check
from gcs.tui import calls, connect_words, next_step, words
from gcs.tui.state import STARTING, Bank, Mark, Progress, RunView, Stage, State, joined
from gcs.tui.top_line import top_line, who
from gcs.vehicle.snapshot import Text, VehicleSnapshot

VEHICLE = VehicleSnapshot(
    system=1,
    component=1,
    link_age_s=0.1,
    lost=False,
    mode=0,
    mode_name="Stabilize",
    armed=True,
    rpm=1648.0,
    battery_v=22.1,
)
STATE = State(link="udpin:127.0.0.1:14550", vehicle=VEHICLE, stage=Stage.IDLE, card="hover", rpm_reference=1650.0)


@pytest.mark.parametrize("width", [24, 40, 60, 80, 120])
@pytest.mark.parametrize(
    "vehicle",
    [
        None,
        VEHICLE,
        replace(VEHICLE, lost=True, link_age_s=4.2),
        replace(VEHICLE, lost=True, link_age_s=math.inf),
        replace(VEHICLE, mode_name="全角" * 20, rpm=None, battery_v=None),
    ],
)
def test_the_abort_key_is_on_the_top_line_at_any_width(width, vehicle):
    line = top_line(replace(STATE, vehicle=vehicle), width).plain
    assert line.endswith("F12 ABORT ")
    assert cell_len(line) == width


def test_the_top_line_at_80_says_all_of_it():
    line = top_line(STATE, 80).plain
    for word in ("LINK 0.1 s", "Stabilize (pilot)", "ARMED", "RPM 1648 -0.1 %", "BAT 22.1 V"):
        assert word in line


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize(
    ("changes", "said", "unsaid"),
    [
        ({"air_s": 192.4}, [" 3:12 "], [">"]),
        ({"air_s": 192.4, "air_known": False}, [" >3:12 "], []),
        ({"bank": Bank(0x12, None, True)}, ["LQR ON"], []),
        ({"bank": Bank(0, None, True)}, [], ["LQR"]),
        ({"battery_remaining": 0.87}, ["▓▓▓▓ 87 %"], ["LOW"]),
        ({"battery_remaining": 0.3, "air_s": 5.0}, ["▓▓░░ 30 %", " 0:05 "], ["LOW"]),
        (
            {"battery_remaining": 0.12, "air_s": 2000.0, "bank": Bank(1, None, True)},
            ["12 % LOW", " 33:20 ", "LQR ON"],
            [],
        ),
    ],
)
def test_time_in_the_air_battery_and_the_controller_stand_on_the_top_line(width, changes, said, unsaid):
    of_vehicle = {key: value for key, value in changes.items() if key == "battery_remaining"}
    others = {key: value for key, value in changes.items() if key != "battery_remaining"}
    line = top_line(
        replace(STATE, vehicle=replace(VEHICLE, lag_s=0.02, answer_age_s=0.1, **of_vehicle), **others), width
    )
    for words_ in said:
        assert words_ in line.plain
    for words_ in unsaid:
        assert words_ not in line.plain
    assert cell_len(line.plain) == width


@pytest.mark.parametrize(
    ("mode", "stage", "commands"),
    [
        (0, Stage.IDLE, "pilot"),
        (25, Stage.FLYING, "tippath"),
        (25, Stage.ABORTING, "tippath"),
        (25, Stage.IDLE, "excitation"),
        (6, Stage.IDLE, "autopilot"),
        (9, Stage.FLYING, "autopilot"),
    ],
)
def test_who_commands_the_mode(mode, stage, commands):
    assert who(replace(STATE, vehicle=replace(VEHICLE, mode=mode), stage=stage)) == commands


@pytest.mark.parametrize("height", [1, 2, 3, 5, 20])
@pytest.mark.parametrize("current", [0, 1, 6, 12])
def test_the_current_run_is_in_sight(height, current):
    runs = tuple(RunView(number=i, label=f"roll chirp {i}/12", numbers="0.5-10 Hz") for i in range(1, 13))
    lines = words.run_lines(replace(STATE, runs=runs, current=current), 80, height)
    assert len(lines) == min(height, 12)
    assert all(cell_len(line) <= 80 for line, _ in lines)
    if current:
        assert any(f"roll chirp {current}/12" in line for line, _ in lines)
    if height < 12:
        assert any(f"({12 - height} more)" in line for line, _ in lines)


def test_every_moment_has_something_to_do_next():
    vehicles = [None, VEHICLE, replace(VEHICLE, armed=False), replace(VEHICLE, mode=25), replace(VEHICLE, lost=True)]
    moments = itertools.product(Stage, vehicles, (None, "hover"), ("", STATE.link), (DeskState(), *DESKS.values()))
    for stage, vehicle, plant, link, desk in moments:
        state = joined(replace(STATE, stage=stage, vehicle=vehicle, plant=plant, link=link), desk)
        for screen in (*words.SCREENS, "help"):
            said = next_step.next_words(state, screen)
            assert 5 < len(said) <= 90, said


def test_no_page_is_offered_of_what_is_not_kept_yet():
    state = replace(STATE, desk=DESKS["unkept"])
    assert next_step.next_words(state, "Report").startswith("3, then D keeps the results in another folder")


def test_a_simulated_vehicle_that_did_not_start_is_not_waited_for():
    waiting = replace(STATE, vehicle=None, plant="hover", stage=Stage.NO_VEHICLE, trouble=STARTING)
    assert next_step.next_words(waiting, "Fly") == "wait for the vehicle"
    failed = replace(waiting, trouble="vehicle-logs cannot be written")
    assert "did not start" in next_step.next_words(failed, "Fly")
    assert any("begin again" in str(line) for line in connect_words.heard_lines(failed, 78))
    assert words.notice(failed, "Fly", 80) == "vehicle-logs cannot be written"


def test_on_hardware_the_tool_never_says_that_it_takes_off():
    grounded = replace(STATE, vehicle=replace(VEHICLE, armed=False))
    assert next_step.next_words(grounded, "Fly").startswith("the pilot arms")
    assert next_step.next_words(replace(grounded, plant="hover"), "Fly").startswith("T: the simulated pilot")


def flying(elapsed_s: float, percent: float = 10.0) -> State:
    return replace(
        STATE, stage=Stage.FLYING, progress=Progress(elapsed_s, 30.0, None, "Table 1"), use=Use(percent, 0.0, 0.0)
    )


CALLS = [
    (flying(-0.1), flying(0.1), [calls.START]),
    (flying(14.9), flying(15.1), [calls.HALF]),
    (flying(26.95), flying(27.05), [calls.COUNT[3]]),
    (flying(27.95), flying(28.05), [calls.COUNT[2]]),
    (flying(28.95), flying(29.05), [calls.COUNT[1]]),
    (flying(29.9), replace(STATE, stage=Stage.CLOSING), [calls.END]),
    (flying(5.0), replace(flying(5.1), stage=Stage.ABORTING), [calls.ABORT]),
    (flying(5.0, 90), replace(flying(5.1, 101), stage=Stage.ABORTING), [calls.LIMIT, calls.ABORT]),
    (flying(5.0, 90), flying(5.1, 101), [calls.LIMIT]),
    (flying(5.1, 101), flying(5.2, 102), []),
    (flying(5.0), flying(5.1), []),
    (STATE, replace(STATE, vehicle=replace(VEHICLE, lost=True)), [calls.LINK_LOST]),
    (STATE, STATE, []),
    (
        replace(flying(29.9), runs=(RunView(number=1, label="roll", numbers="", mark=Mark.FLYING),)),
        replace(STATE, stage=Stage.CLOSING, runs=(RunView(number=1, label="roll", numbers="", mark=Mark.KEEP),)),
        [calls.END, calls.KEEP],
    ),
]


@pytest.mark.parametrize(("before", "after", "called"), CALLS)
def test_what_is_called_out(before, after, called):
    assert calls.calls(before, after) == called
    urgent = calls.ringing(called)
    assert urgent is (called[0] if called else None)


def test_whoever_only_hears_tells_the_calls_apart():
    by_ear = (calls.START, calls.HALF, calls.END, calls.LIMIT, calls.ABORT, calls.LINK_LOST)
    assert len({call.pattern for call in by_ear}) == len(by_ear)
    assert all(call.pattern == tuple(sorted(call.pattern)) for call in by_ear)
    assert len({call.words for call in (*by_ear, *calls.COUNT.values(), calls.KEEP, calls.AGAIN)}) == 11


def test_what_is_missing_is_said():
    recording = replace(VEHICLE, recording=Path("flight.BIN"), blocks_open=7)
    assert "7 blocks missing" in words.recording_line(replace(STATE, vehicle=recording), 80)
    full = replace(recording, recording_problem="no space left on device")
    assert "NOT KEPT: no space left on device" in words.recording_line(replace(STATE, vehicle=full), 80)


def test_the_newest_text_is_shown_harmless():
    texts = tuple(Text(i, 0.0, 6, f"text {i}\x1b[31m") for i in range(1, 9))
    lines = words.said_lines(replace(STATE, vehicle=replace(VEHICLE, texts=texts)), 80, 2)
    assert lines == [" vehicle: text 7", " vehicle: text 8"]


@pytest.mark.parametrize("width", [10, 40, 78])
def test_long_words_are_cut_and_short_ones_left(width):
    assert words.fitted("abc", width) == "abc"
    assert cell_len(words.fitted("全角" * 100, width)) <= width
    assert all(cell_len(line) <= max(width, 20) for line in words.wrapped("  " + "word " * 50, width))
    assert len(words.notice_lines("word " * 500, 80, 3)) == 3
    assert words.notice_lines("", 80, 3) == []


def test_what_a_lost_link_does_is_told_in_full_before_a_start():
    answer = "the sweep does NOT stop: the failsafe listens to station 255, this is 254 (start with --primary)"
    long = f"if the link drops: {answer}"
    ready = replace(STATE, stage=Stage.READY, link_loss=long)
    assert words.caution(ready, 80) == long
    assert words.caution(ready, 200) == "", "there the whole of it stands on its line"
    assert words.caution(replace(ready, stage=Stage.FLYING), 80) == ""
    recorded = replace(ready, vehicle=replace(VEHICLE, recording=Path("flight.BIN")), samples=958_491)
    assert words.caution(replace(recorded, link_loss="if the link drops: returns home after 5 s"), 80) == ""


def test_in_a_lost_link_the_tool_does_not_claim_to_abort():
    lost = replace(STATE, stage=Stage.ABORTING, vehicle=replace(VEHICLE, lost=True))
    assert "nothing is sent" in words.progress_line(lost, 80, "braille")
    assert next_step.next_words(lost, "Fly").startswith("the PILOT ends it")


CHECKS = tuple(
    Check(*text.split(": ", 1))
    for text in (
        "link: heard 0.1 s ago",
        "in the air: armed and in the air",
        "mode: Stabilize",
        "battery: 22.1 V 87 %",
        "log: arrives: 1234 blocks, 0 open",
        "disk: 41.0 GB free",
        "attitude: 2° lean",
        "rates: vary by 0.03 rad/s",
        "trim: delta_x +0.01, delta_y -0.02",
    )
)


@pytest.mark.parametrize("width", [80, 100, 120, 300])
@pytest.mark.parametrize("height", [1, 2, 4])
@pytest.mark.parametrize("checks", [CHECKS, (*CHECKS, Check("stations", "2 other ground station(s) on this link"))])
def test_what_was_looked_at_is_shortened_and_never_cut(width, height, checks):
    lines = words.looked_at(checks, width, height)
    assert 1 <= len(lines) <= height
    assert all(cell_len(line) <= width for line in lines)
    text = " ".join(line.strip() for line in lines)
    assert (
        text == "looked at: " + " · ".join(f"{check.name}: {check.words}" for check in checks)
        or text == "in order: " + ", ".join(check.name for check in checks)
        or text == f"{len(checks)} of {len(checks)} checks in order"
    )
    if width == 80 and height == 1 and checks is CHECKS:
        assert text.startswith("in order: link, in the air, mode, ")


@pytest.mark.parametrize("width", [1, 9, 12, 20, 40, 79])
def test_too_small_is_said_in_what_fits(width):
    assert cell_len(words.too_small((width, 20), (80, 24))) <= width
    assert width < 12 or "too small" in words.too_small((width, 20), (80, 24))
    top = top_line(STATE, width).plain
    assert top.strip().endswith("F12 ABORT"[:width].strip())


@pytest.mark.parametrize(
    ("width", "changes", "words"),
    [
        (120, {}, "LINK 0.1 s lag 0.02 s"),
        (80, {}, "LINK 0.1|0.0  "),
        (80, {"lag_s": 1.23}, "LINK 0.1 s LATE 1.2 s"),
        (80, {"answer_age_s": 5.0}, "LINK 0.1 s NO ANSWER"),
    ],
)
def test_the_links_lag_stands_beside_its_age(width: int, changes: dict[str, float], words: str) -> None:
    vehicle = replace(IN_FLIGHT.vehicle, lag_s=0.02, answer_age_s=0.2)  # type: ignore[type-var]
    before = replace(IN_FLIGHT, vehicle=vehicle, rpm_reference=1650.0)
    state = replace(before, vehicle=replace(vehicle, **changes))  # type: ignore[arg-type]
    line = top_line(state, width).plain
    assert words in line
    assert len(line) == width
    assert ("RPM 1648 -0.1 %" in line) is not bool(changes)
    assert (calls.calls(before, state) == [calls.LINK_LATE]) is bool(changes), "it is told by the bell, too"
