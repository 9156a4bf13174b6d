"""The simulated vehicle as a stock ArduCopter: against the facts of real flights, and their logs where these are."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.blocks import BlockStream
from sitl.autopilot.clothes import CLOTHES
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.stock_recording import DroppingStream
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.pilot import obey

Reader = Callable[[Path], list[Any]]
Fly = Callable[[Vehicle, float], list[str]]
REAL = Path(__file__).parents[3] / "shared" / "data" / "ardupilot"
START = 2147483646
LOGGING_FAILED = "PreArm: Logging failed"
PLANT = {"ardupilot-heli": "hover-ideal", "ardupilot-quad": "quad"}
BOOT_S = 42
SHORT: dict[str, Any] = {
    "SID_MAGNITUDE": 0.05,
    "SID_F_STOP_HZ": 10.0,
    "SID_T_FADE_IN": 1.0,
    "SID_T_REC": 6.0,
    "SID_T_FADE_OUT": 0.5,
}


def stock(
    like: str = "ardupilot-heli", *, directory: Path | None = None, on_ground: bool = False, **settings: float
) -> Any:
    return make_vehicle(PLANT[like], 5, directory=directory, on_ground=on_ground, parameters=settings, like=like)


def boot(vehicle: Vehicle) -> None:
    """It has been up for as long as its EKF takes; nothing happened meanwhile, and no step is computed."""
    vehicle.time_us += BOOT_S * 1_000_000


def sweep(vehicle: Vehicle, axis: int, fly: Fly) -> list[str]:
    """What it said in a whole stay in SYSTEMID of `SHORT`, and 0.1 s more."""
    vehicle.write_parameter("SID_AXIS", axis)
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    texts = fly(vehicle, 1.0 + 1.0 + 4.0 + 6.0 + 0.5 + 0.1)
    assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
    return texts


def start() -> Any:
    return mavlink.MAVLink_remote_log_block_status_message(1, 1, START, 1)


def received(station: Any, blocks: dict[int, bytes]) -> list[int]:
    """The numbers of the blocks that came since the last time."""
    new = {m.seqno: bytes(m.data) for m in station.take("REMOTE_LOG_DATA_BLOCK")}
    blocks.update(new)
    return sorted(new)


def acknowledge(station: Any, numbers: list[int]) -> None:
    station.send(*(mavlink.MAVLink_remote_log_block_status_message(1, 155, number, 1) for number in numbers))


# Parameters


@pytest.mark.parametrize("like", list(CLOTHES))
def test_parameters_are_a_stock_copter_s(like: str) -> None:
    parameters = stock(like, on_ground=True).parameters
    expected = {
        "LOG_BACKEND_TYPE": 1,
        "LOG_BITMASK": 180222,
        "LOG_MAV_BUFSIZE": 8,
        "LOG_DISARMED": 0,
        "SCHED_LOOP_RATE": 400,
        "INS_GYRO_FILTER": 20,
        "FS_GCS_ENABLE": 0,
        "FS_OPTIONS": 16,
        "ARMING_CHECK": 1,
        "SID_MAGNITUDE": 15,
        "FRAME_CLASS": 6 if like == "ardupilot-heli" else 1,
    }
    assert {name: parameters[name] for name in expected} == expected
    assert not [name for name in parameters.table if name.startswith(("SIDX_", "LQR_", "LQS_", "SYSID_"))]
    assert ("H_SW_TYPE" in parameters) == (like == "ardupilot-heli")
    assert parameters["MAV_GCS_SYSID"] == 255
    before = set(parameters.visible())
    parameters.write("SID_AXIS", 10, armed=False)
    assert len(set(parameters.visible()) - before) == 6
    assert parameters.read("LQR_COMMIT") is None
    assert parameters.write("LQR_REVERT", 1, armed=False) is None


@pytest.mark.parametrize(
    ("like", "name"), [("ardupilot-heli", "heli_axis7_roll_rate.BIN"), ("ardupilot-quad", "quad_roll_pitch.BIN")]
)
def test_every_parameter_and_message_is_one_of_the_real_log(like: str, name: str, tmp_path: Path, fly: Fly) -> None:
    real = formats(REAL / name)
    vehicle = stock(like, directory=tmp_path, **SHORT)
    sweep(vehicle, 10, fly)
    vehicle.close()
    (path,) = tmp_path.glob("*.BIN")
    ours = formats(path)
    assert ours.keys() - {"parameters"} <= real.keys()
    assert {key: value for key, value in ours.items() if key != "parameters" and real[key] != value} == {}
    assert set(ours["parameters"]) <= set(real["parameters"])


def formats(path: Path) -> dict[str, Any]:
    """By name of a message: number, length, layout, columns, units, multipliers; the names of all parameters."""
    if not path.exists():
        pytest.skip(f"{path.name} is not there: the real flights lie beside the repository")
    log = DFReader.DFReader_binary(str(path))
    about: dict[str, Any] = {"parameters": []}
    names: dict[int, str] = {}
    try:
        while (message := log.recv_match(type=["FMT", "FMTU", "PARM"])) is not None:
            if message.get_type() == "PARM":
                about["parameters"].append(message.Name)
            elif message.get_type() == "FMT":
                names[message.Type] = message.Name
                about[message.Name] = (message.Type, message.Length, message.Format, message.Columns)
            elif message.FmtType in names:
                name = names[message.FmtType]
                about[name] = (*about[name][:4], message.UnitIds, message.MultIds)
    finally:
        log.close()
    return about


# Arming and booting


def test_it_arms_42_s_after_boot(fly: Fly) -> None:
    vehicle = stock(on_ground=True)
    assert obey(vehicle, "takeoff") == "refused: PreArm: AHRS: EKF3 still initialising"
    boot(vehicle)
    assert obey(vehicle, "takeoff") == "ok"
    assert vehicle.armed


def test_with_the_log_s_stream_it_arms_only_for_a_client(radio: Any) -> None:
    vehicle = stock(on_ground=True, LOG_BACKEND_TYPE=3)
    boot(vehicle)
    station = radio(vehicle)
    station.ask(station.heartbeat())
    assert obey(vehicle, "takeoff") == f"refused: {LOGGING_FAILED}"
    station.fly(0.01)
    assert [m.text for m in station.take("STATUSTEXT")] == [LOGGING_FAILED]
    station.ask(start())
    assert obey(vehicle, "takeoff") == "ok"


@pytest.mark.parametrize(("check", "arms"), [(1, False), (1 << 10, False), (1047550, True), (0, True)])
def test_the_arming_check_can_leave_the_log_out(check: int, arms: bool, fly: Fly) -> None:
    vehicle = stock(on_ground=True, LOG_BACKEND_TYPE=2, ARMING_CHECK=check)
    boot(vehicle)
    assert (vehicle.take_off() is None) == arms


def test_some_parameters_act_after_a_reboot(radio: Any, tmp_path: Path) -> None:
    vehicle = stock(on_ground=True, directory=tmp_path)
    station = radio(vehicle)
    station.ask(station.heartbeat())
    for name, value in (("LOG_BACKEND_TYPE", 2), ("SCHED_LOOP_RATE", 200)):
        assert station.set(name, value) == value
    boot(vehicle)
    station.ask(station.heartbeat(), start())
    station.fly(0.2)
    assert station.take("REMOTE_LOG_DATA_BLOCK") == []
    assert vehicle.dt == 0.0025
    assert obey(vehicle, "takeoff") == "ok"
    assert obey(vehicle, "reboot").startswith("refused: armed")
    station.fly(5)
    vehicle.land()
    station.fly(5)
    before_s = vehicle.elapsed_s
    assert obey(vehicle, "reboot") == "ok"
    assert vehicle.time_s == 1.0
    assert vehicle.elapsed_s == pytest.approx(before_s)
    assert (vehicle.dt, vehicle.parameters["SCHED_LOOP_RATE"]) == (0.005, 200)
    station.take()
    station.heard.clear()
    station.fly(2)
    assert len(station.take("HEARTBEAT")) == 2
    station.ask(start())
    station.fly(0.2)
    assert station.take("REMOTE_LOG_DATA_BLOCK") != []
    assert len(list(tmp_path.glob("*.BIN"))) == 1, "a card of its own only before the reboot"


# Sweeps


@pytest.mark.parametrize("like", list(CLOTHES))
def test_a_sweep_is_arducopter_s(like: str, tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    vehicle = stock(like, directory=tmp_path, **SHORT)
    assert not vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    vehicle.write_parameter("SID_AXIS", 10)
    assert vehicle.set_mode(Mode.ALT_HOLD, Reason.GROUND)
    assert not vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    vehicle.write_parameter("SID_AXIS", 14)
    assert not vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
    assert fly(vehicle, 1.0)[2:] == [
        "No axis selected, SID_AXIS = 0",
        "Axis requires manual throttle",
        "Axis requires switch from Loiter",
    ]
    assert sweep(vehicle, 10, fly) == ["SystemID Starting: axis=10", "SystemID Finished"]
    vehicle.close()
    messages = read_log(next(tmp_path.glob("*.BIN")))
    (sids,) = (m for m in messages if m.get_type() == "SIDS")
    assert (sids.Ax, sids.TC, sids.TR) == (10, 4.0, 6.0)
    (finished,) = (m for m in messages if m.get_type() == "MSG" and m.Message == "SystemID Finished")
    assert (finished.TimeUS - sids.TimeUS) * 1e-6 == pytest.approx(1 + 1 + 4 + 6 + 0.5, abs=0.01)
    data = [m for m in messages if m.get_type() == "SIDD"]
    assert max(m.Time for m in data if m.Targ != 0) < 7.0
    for m in data:
        assert m.Targ == pytest.approx(arducopter_chirp(m.Time), abs=1e-6)


def arducopter_chirp(t: float) -> float:
    """ArduPilot's law written out once more, with the settings of `SHORT`."""
    t -= 1.0
    if not 0 <= t < 6.0:
        return 0.0
    w0, w1, tc, T = math.tau * 0.5, math.tau * 10.0, 4.0, 6.0
    B = math.log(w1 / w0)
    phase = w0 * (t - tc) if t <= tc else w0 * (T - tc) / B * (math.exp(B * (t - tc) / (T - tc)) - 1)
    fade = 0.5 - 0.5 * math.cos(math.pi * t / 1.0) if t < 1.0 else 1.0
    left = T - t
    fade = 0.5 - 0.5 * math.cos(math.pi * left / 0.5) if left < 0.5 else fade
    return 0.05 * fade * math.sin(phase)


@pytest.mark.parametrize("axis", range(1, 14))
def test_every_axis_moves_what_it_is_named_for(axis: int, fly: Fly) -> None:
    size = 3.0 if axis <= 6 else 10.0 if axis <= 9 else 0.1
    still, moved = (stock("ardupilot-quad", **SHORT | {"SID_MAGNITUDE": size * on}) for on in (0.0, 1.0))
    apart = np.zeros(4)
    for vehicle in (still, moved):
        vehicle.write_parameter("SID_AXIS", axis)
        assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    for _ in range(1200):
        for vehicle in (still, moved):
            vehicle.step()
        after, before = (np.array([p.p, p.q, p.r, p.az / 10]) for p in (moved.plant, still.plant))
        apart = np.maximum(apart, np.abs(after - before))
    expected = 3 if axis == 13 else (axis - 1) % 3
    assert apart.argmax() == expected
    assert apart[expected] > 0.01


def test_a_record_that_is_too_short_is_a_parameter_error(fly: Fly) -> None:
    vehicle = stock(**SHORT | {"SID_T_REC": 4.0, "SID_AXIS": 10})
    fly(vehicle, 0.1)
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    assert fly(vehicle, 3.0) == ["SystemID Starting: axis=10", "SystemID Parameter Error"]


def test_a_magnitude_written_in_flight_acts_at_once(fly: Fly) -> None:
    vehicle = stock("ardupilot-quad", **SHORT | {"SID_AXIS": 10})
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    fly(vehicle, 3.0)
    vehicle.write_parameter("SID_MAGNITUDE", 15)
    assert any(text.startswith("SystemID Stopped: lean=") for text in fly(vehicle, 2.0))


# Logs


@pytest.mark.parametrize(("bits", "rate_hz"), [(180223, 400), (180221, 200), (180222, 100), (180220, 50)])
def test_the_bitmask_decides_the_rate(bits: int, rate_hz: int, tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    vehicle = stock(directory=tmp_path, LOG_BITMASK=bits, SID_AXIS=10, **SHORT)
    fly(vehicle, 2.0)
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    fly(vehicle, 2.0)
    vehicle.close()
    messages = read_log(next(tmp_path.glob("*.BIN")))
    entered = next(m.TimeUS for m in messages if m.get_type() == "SIDS")
    count = Counter(m.get_type() for m in messages if getattr(m, "TimeUS", 0) >= entered)
    for name in ("SIDD", "RATE", "PIDR", "ANG"):
        assert count[name] == pytest.approx(2 * rate_hz, abs=1)
    assert count["RCOU"] == pytest.approx(20, abs=1)
    before = [m.TimeUS for m in messages if m.get_type() == "RATE" and m.TimeUS < entered]
    spacing = {b - a for a, b in itertools.pairwise(before)}
    assert spacing == ({2500} if bits & 1 else {100_000} if bits & 2 else set())


def test_the_card_s_file_is_from_arming_to_15_s_after_disarming(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    vehicle = stock(on_ground=True, directory=tmp_path, LOG_BITMASK=180223)
    boot(vehicle)
    assert list(tmp_path.glob("*.BIN")) == []
    vehicle.take_off()
    fly(vehicle, 5.0)
    vehicle.land()
    fly(vehicle, 20.0)
    messages = read_log(next(tmp_path.glob("*.BIN")))
    times = [m.TimeUS for m in messages if m.get_type() == "RATE"]
    assert times[0] == pytest.approx(vehicle_us(BOOT_S + 1), abs=20_000)
    disarmed = next(m.TimeUS for m in messages if m.get_type() == "MSG" and m.Message == "Disarming motors")
    assert times[-1] - disarmed == pytest.approx(15e6, abs=20_000)
    greeting = [m.Message for m in messages if m.get_type() == "MSG"][:2]
    assert greeting == ["ArduCopter V4.7.0-dev (90700977)", "Frame: HELI"]


def vehicle_us(seconds: float) -> int:
    return round(1e6 * seconds)


@pytest.mark.parametrize(("buffer_kb", "dropping"), [(8, True), (50, False)])
def test_a_small_buffer_drops_messages_and_counts_them(
    buffer_kb: int, dropping: bool, radio: Any, tmp_path: Path, read_log: Reader
) -> None:
    """The ground answers every 80 ms, as on a link with some lag; the card's file misses nothing."""
    vehicle = stock(
        directory=tmp_path, LOG_BACKEND_TYPE=3, LOG_MAV_BUFSIZE=buffer_kb, LOG_BITMASK=180223, SID_AXIS=10, **SHORT
    )
    station = radio(vehicle)
    station.ask(station.heartbeat())
    blocks: dict[int, bytes] = {}
    station.send(start())
    for turn in range(75):
        if turn == 20:
            vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
        station.fly(0.08)
        acknowledge(station, received(station, blocks))
    station.fly(0.3)
    received(station, blocks)
    vehicle.close()
    assert sorted(blocks) == list(range(len(blocks))), "blocks go missing on the way, not in the buffer"
    ground = tmp_path / "ground.bin"
    ground.write_bytes(b"".join(blocks[number] for number in sorted(blocks)))
    streamed = read_log(ground)
    card = read_log(tmp_path / "vehicle-1.BIN")
    dms = [m for m in streamed if m.get_type() == "DMS"]
    assert len(dms) == pytest.approx(6, abs=1)
    assert (dms[-1].Dp > 0) == dropping
    assert not [m for m in card if m.get_type() == "DMS"]
    on_card, on_ground = (
        [m.TimeUS for m in messages if m.get_type() == "SIDD" and m.TimeUS < dms[-1].TimeUS]
        for messages in (card, streamed)
    )
    assert {b - a for a, b in itertools.pairwise(on_card)} == {2500}
    assert set(on_ground) <= set(on_card)
    assert (len(on_ground) < len(on_card)) == dropping


def test_a_buffer_beyond_its_counter_is_a_small_one() -> None:
    rooms = {kb: DroppingStream(kb, 0.0, {})._room for kb in (8, 50, 52, 54)}
    assert rooms == {8: 38, 50: 241, 52: 251, 54: 4}


def test_a_message_that_does_not_fit_is_dropped_whole() -> None:
    stream = DroppingStream(1, 0.0, {7: 150})  # four blocks
    message = b"\xa3\x95\x07" + bytes(147)
    stream.begun()
    for _ in range(8):
        stream.write(message)
    assert stream.dropped == 8 - 4 * 200 // 150
    assert isinstance(stream, BlockStream)
    assert stream.failure(1.0) is None


# The link


def test_it_introduces_itself_as_arducopter(radio: Any) -> None:
    for like, mav_type in (("ardupilot-heli", 4), ("ardupilot-quad", 2)):
        station = radio(stock(like))
        station.ask(station.heartbeat())
        station.fly(1.1)
        heard = station.take()
        (heartbeat, *_) = (m for m in heard if m.get_type() == "HEARTBEAT")
        assert (heartbeat.type, heartbeat.autopilot, heartbeat.system_status) == (mav_type, 3, 4)
        assert any(m.get_type() == "SYSTEM_TIME" for m in heard)
        (version,) = station.ask(
            mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0), kind="AUTOPILOT_VERSION"
        )
        assert version.flight_sw_version >> 16 == 0x0407
        assert bytes(version.flight_custom_version) == b"90700977"
        assert version.capabilities & 131072


def test_telemetry_is_fast_as_on_a_loop_of_400_hz(radio: Any) -> None:
    station = radio(stock())
    station.ask(station.heartbeat())
    assert [station.command(511, 105, us) for us in (2500, 3000, 5000)] == [4, 0, 0]


def test_heartbeats_of_other_stations_reach_every_link(radio: Any) -> None:
    for like, expected in (("ardupilot-heli", [254]), (None, [])):
        vehicle = stock() if like else make_vehicle("hover-ideal", 1)
        station, other = radio(vehicle), ("127.0.0.1", 40001)
        station.ask(station.heartbeat())
        stranger = mavlink.MAVLink(None, 254, 190)
        station.link.to_vehicle.append((other, bytes(station.heartbeat().pack(stranger))))
        station.fly(0.1)
        senders = [m.get_srcSystem() for m in station.take("HEARTBEAT")]
        assert [system for system in senders if system != 1] == expected


@pytest.mark.parametrize(("options", "mode"), [(0, Mode.RTL), (16, Mode.STABILIZE)])
def test_a_failsafe_shows_in_the_status(radio: Any, options: int, mode: Mode) -> None:
    vehicle = stock(FS_GCS_ENABLE=1, FS_OPTIONS=options)
    station = radio(vehicle)
    station.ask(station.heartbeat())
    station.fly(7)
    assert vehicle.mode is mode
    assert station.take("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL
    station.send(station.heartbeat())
    station.fly(1.1)
    assert station.take("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_ACTIVE


def test_rate_is_filtered_and_sidd_is_not(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    """20 Hz, of second order: the rotor's 27.5 Hz is left to less than half, as the formula says."""
    vehicle = stock(directory=tmp_path, LOG_BITMASK=180223, SID_AXIS=10, **SHORT | {"SID_MAGNITUDE": 0.0})
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    fly(vehicle, 6.0)
    vehicle.close()
    messages = read_log(next(tmp_path.glob("*.BIN")))
    t, raw = np.array([(m.TimeUS * 1e-6, m.Gy) for m in messages if m.get_type() == "SIDD"]).T
    filtered = np.array([m.P for m in messages if m.get_type() == "RATE"])
    wave = np.exp(-2j * np.pi * 27.5 * t)
    warped = math.tan(math.pi * 27.5 * 0.0025) / math.tan(math.pi * 20 * 0.0025)
    assert abs(filtered @ wave) / abs(raw @ wave) == pytest.approx(1 / math.sqrt(1 + warped**4), rel=0.03)


def test_what_it_cannot_wear_is_said(tmp_path: Path) -> None:
    for plant, condition, words in (
        ("forward", None, "ardupilot-heli flies hover or hover-ideal, not forward"),
        ("hover-ideal", "lively", "no condition stirs it"),
    ):
        with pytest.raises(ValueError, match=words):
            make_vehicle(plant, 1, condition=condition, like="ardupilot-heli")
