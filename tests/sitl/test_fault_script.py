"""Storms as files, and the faults on board and of impostors."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.__main__ import main
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.faults import Faults
from sitl.faults.script import arguments, options, read_script
from sitl.faults.words import read

STORM = """
loss = 0.02
lag = "3.5@sweep+2:"
outage = ["up@20:24", "both@40:45"]
queue = 600
second-attitude = true
"""


def faults(script: str, seed: int = 1) -> Faults:
    return read(arguments(options(script), seed), lambda: math.inf)


def test_a_script_has_the_words_of_the_options() -> None:
    assert options(STORM) == [
        *("--loss=0.02", "--lag=3.5@sweep+2:", "--outage=up@20:24", "--outage=both@40:45", "--queue=600"),
        "--second-attitude",
    ]
    assert options("second-attitude = false") == []


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("los = 1", "los: there is no such fault; loss is meant?"),
        ("zzz = 1", "zzz: there is no such fault; `tippath sim --help` lists them"),
        ('outage = ["up", "sideways"]', "outage[1]: sideways: up, down or both is wanted"),
        ("lag = true", "lag: a number, or a word in quotes as behind --lag, is wanted"),
        ("loss = [[1]]", "loss[0]: a number"),
        ("loss = 2", "loss: 2: the share of lost packets must lie between 0 and 1"),
        ("queue = [600, 700]", "queue: one value is wanted"),
        ("second-attitude = 1", "second-attitude: true or false is wanted"),
        ("loss = ", "no TOML: Invalid value (at end of document)"),
        ("[loss]", "loss: a number"),
        ("reboot = '2:3'", "reboot: 2:3: a moment is wanted"),
        ("clock-step = -3", "clock-step: -3: S@WHEN is wanted"),
        ("clock-step = '-3@4'", "back it goes only with --reboot"),
        ("alter-writes = 3", "the share of writes must lie between 0 and 1"),
        ("log-slows = 0", "positive number of bytes"),
        ("forge = 'heartbeat=rtl'", "WHAT@S or WHAT@FROM:UNTIL is wanted"),
        ("forge = 'noise=1@3'", "heartbeat=MODE, text=WORDS"),
        ("spoof = 'block=x@3'", "block=N"),
        ("gyro-nan = 'soon'", "'soon' is no number"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(script: str, message: str) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]+$") as refusal:
        options(script)
    assert message in str(refusal.value)


def test_a_file_is_named_and_the_program_ends_with_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for content, message in (
        (b"\xff", "no TOML"),
        (b"x" * (1 << 21), "larger than"),
        (b"lag = 'x'", "lag: x: 'x' is no"),
    ):
        (tmp_path / "storm.toml").write_bytes(content)
        with pytest.raises(ValueError, match=r"storm\.toml: ") as refusal:
            read_script(tmp_path / "storm.toml")
        assert message in str(refusal.value)
    assert main(["--faults", str(tmp_path / "storm.toml")]) == 2
    assert "sitl: --faults" in capsys.readouterr().err
    assert main(["--faults", str(tmp_path / "none.toml")]) == 2
    assert "cannot be read" in capsys.readouterr().err
    (tmp_path / "storm.toml").write_text(STORM)
    assert main(["--faults", str(tmp_path / "storm.toml"), "--speed", "max"]) == 2
    assert "leave out --loss" in capsys.readouterr().err


# On board


@pytest.fixture
def flying(radio: Any) -> Any:
    def fly(script: str, seed: int = 1, **more: Any) -> tuple[Vehicle, Any]:
        vehicle = make_vehicle("hover-ideal", 1, **more)
        return vehicle, radio(vehicle, faults=faults(script, seed))

    return fly


def test_writes_are_altered_or_refused_in_their_window_and_the_answer_tells(flying: Any) -> None:
    def written(script: str, seed: int) -> list[float]:
        vehicle, station = flying(script, seed)
        station.ask(station.heartbeat())
        values = []
        for value in range(5, 15):
            values.append(station.set("SID_T_REC", value))
            assert values[-1] == vehicle.parameters["SID_T_REC"]
        return values

    wanted = [float(value) for value in range(5, 15)]
    assert written("alter-writes = '1@900:'", 1) == wanted
    altered = written("alter-writes = 0.5", 1)
    assert altered == written("alter-writes = 0.5", 1) != written("alter-writes = 0.5", 2)
    assert 0 < sum(a == b for a, b in zip(altered, wanted, strict=True)) < 10
    assert len(set(written("refuse-writes = 1", 1))) == 1


def test_a_reboot_in_the_air_flies_on_with_a_clock_of_its_own_and_another_log(flying: Any, tmp_path: Path) -> None:
    vehicle, station = flying("reboot = 3", directory=tmp_path)
    station.fly(1.0)
    before = vehicle.recording.log
    station.fly(3.0)
    assert vehicle.armed
    assert not vehicle.landed
    assert vehicle.time_s < 3.1 < vehicle.elapsed_s
    assert vehicle.recording.log is not before
    assert vehicle.mode is Mode.STABILIZE
    vehicle.close()
    assert len(list(tmp_path.glob("*.BIN"))) == 2


def test_a_clock_step_goes_on_once_and_time_itself_does_not(flying: Any) -> None:
    vehicle, station = flying("clock-step = '3600@2'")
    station.fly(3.0)
    assert vehicle.time_s == pytest.approx(vehicle.elapsed_s + 3600.0)
    assert vehicle.elapsed_s < 4.1


def test_a_gyro_without_numbers_is_nan_in_the_log_and_the_vehicle_flies_on(
    flying: Any, tmp_path: Path, read_log: Any
) -> None:
    sweep = {"SID_AXIS": 10, "SID_MAGNITUDE": 0.05, "SIDX_KIND": 2, "SID_T_REC": 20}
    vehicle, station = flying("gyro-nan = '2.5:3'", directory=tmp_path, parameters=sweep)
    vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    station.fly(3.0)
    vehicle.close()
    rows = [m for m in read_log(next(tmp_path.glob("*.BIN"))) if m.get_type() in ("SIDD", "RATE")]
    raw = [m for m in rows if m.get_type() == "SIDD"]
    dead = [m.TimeUS * 1e-6 for m in raw if math.isnan(m.Gx)]
    assert (min(dead), max(dead)) == (pytest.approx(2.5, abs=0.02), pytest.approx(3.0, abs=0.02))
    assert len(dead) == pytest.approx(250, abs=10)
    assert all(math.isfinite(m.R) for m in rows if m.get_type() == "RATE")
    assert vehicle.phase.value == "hovering"


def test_a_slow_log_fills_the_buffer_and_is_given_up(flying: Any) -> None:
    vehicle, station = flying("log-slows = '10000@2:'", parameters={"LOG_MAV_BUFSIZE": 50})

    def received(seconds: float) -> tuple[int, list[str]]:
        """Blocks, each acknowledged, and texts."""
        count, texts = 0, []
        for _ in range(round(seconds / 0.02)):
            station.fly(0.02)
            heard = station.take()
            numbers = [m.seqno for m in heard if m.get_type() == "REMOTE_LOG_DATA_BLOCK"]
            station.send(*(mavlink.MAVLink_remote_log_block_status_message(1, 1, number, 1) for number in numbers))
            count += len(numbers)
            texts += [m.text for m in heard if m.get_type() == "STATUSTEXT"]
        return count, texts

    station.send(mavlink.MAVLink_remote_log_block_status_message(1, 1, 2147483646, 1))
    received(0.5)
    assert received(0.45)[0] > 80
    received(0.05)
    count, texts = received(0.5)
    assert 0 < count < 40
    assert texts == []
    assert "Log stream stopped: buffer full" in received(5.0)[1]
    assert vehicle.recording.stream is None


# Impostors


def test_forged_frames_come_on_this_link_and_spoofed_ones_from_elsewhere(flying: Any) -> None:
    _, station = flying('forge = ["heartbeat=land@2", "text=Hello@2", "block=40@2.1:4.5"]')
    station.ask(station.heartbeat())
    station.fly(4.0)
    heard = station.take()
    assert [m.custom_mode for m in heard if m.get_type() == "HEARTBEAT"].count(9) == 1
    assert [m.text for m in heard if m.get_type() == "STATUSTEXT"].count("Hello") == 1
    blocks = [m for m in heard if m.get_type() == "REMOTE_LOG_DATA_BLOCK"]
    assert [(m.seqno, m.get_srcComponent()) for m in blocks] == [(40, 155)] * len(blocks)
    assert len(blocks) == 2
    assert station.link.from_beside == []
    _, station = flying('spoof = "heartbeat=land@2"')
    station.ask(station.heartbeat())
    station.fly(3.0)
    assert 9 not in [m.custom_mode for m in station.take("HEARTBEAT")]
    assert len(station.link.from_beside) == 1


@pytest.mark.parametrize("way", ["forge", "spoof"])
def test_an_impostor_of_the_ground_orders_modes_and_takes_the_log(flying: Any, way: str) -> None:
    vehicle, station = flying(f'{way} = ["mode=rtl@2", "log@3"]')
    station.ask(station.heartbeat())
    station.fly(1.5)
    assert vehicle.mode is Mode.RTL
    station.take()
    station.fly(1.5)
    assert vehicle.recording.stream is not None
    to_ground = len(station.take("REMOTE_LOG_DATA_BLOCK"))
    assert (to_ground > 0) is (way == "forge")
