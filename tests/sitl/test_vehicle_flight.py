"""The vehicle without a link: modes, sweeps, safety, pilot and what its log says of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sitl.autopilot.modes import Mode, Phase, Reason
from sitl.autopilot.parameters import BANK_ORDER, bank_crc
from sitl.autopilot.running import run
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.clock import FreeClock, WallClock
from sitl.pilot import obey

Fly = Callable[[Vehicle, float], list[str]]
Reader = Callable[[Path], list[Any]]

SWEEP = {
    "SID_AXIS": 10,
    "SID_MAGNITUDE": 0.1,
    "SID_F_START_HZ": 1,
    "SID_F_STOP_HZ": 8,
    "SID_T_FADE_IN": 0,
    "SID_T_REC": 3,
    "SID_T_FADE_OUT": 0,
    "SIDX_LAW": 1,
    "SIDX_SEED": 5,
}


def sweeper(directory: Path | None = None, plant: str = "hover-ideal", **changes: float) -> Vehicle:
    vehicle = make_vehicle(plant, 1, directory=directory, parameters={**SWEEP, **changes})
    vehicle.texts.clear()
    return vehicle


def commit(vehicle: Vehicle, bank: tuple[float, ...]) -> None:
    for name, value in zip(BANK_ORDER, bank, strict=True):
        vehicle.write_parameter("LQS_" + name, value)
    answer = vehicle.write_parameter("LQR_COMMIT", bank_crc(bank))
    assert answer is not None
    assert answer.bank_changed


def only_log(directory: Path) -> Path:
    (path,) = directory.glob("*.BIN")
    return path


def test_it_starts_armed_and_hovering_or_on_the_ground(fly: Fly) -> None:
    vehicle = make_vehicle("hover", 1)
    assert (vehicle.armed, vehicle.landed, vehicle.mode) == (True, False, Mode.STABILIZE)
    fly(vehicle, 20)
    phi, theta = vehicle.attitude
    assert 0 < math.hypot(phi, theta) < 0.2
    assert vehicle.rotor_rpm == pytest.approx(vehicle.plant.nominal_rpm, rel=0.01)
    grounded = make_vehicle("hover", 1, on_ground=True)
    fly(grounded, 2)
    assert (grounded.armed, grounded.landed, grounded.rotor_rpm) == (False, True, 0)
    assert grounded.attitude == (0.0, 0.0)
    assert 0 < abs(grounded.gyro[0]) < 0.2  # noise, and vibration at most


def test_equal_seeds_fly_alike_to_the_last_bit_and_others_do_not(fly: Fly) -> None:
    flown = []
    for seed in (3, 3, 4):
        vehicle = make_vehicle("hover", seed)
        fly(vehicle, 2)
        flown.append((vehicle.gyro, vehicle.commands))
    assert flown[0] == flown[1] != flown[2]


def test_a_sweeps_sequence_in_the_log(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    """A second of nothing, the maneuver for T_REC, nothing again, and the text a second later."""
    vehicle = sweeper(tmp_path)
    fly(vehicle, 0.5)
    entry_us = vehicle.time_us
    assert vehicle.set_mode(25, Reason.GROUND)
    said = fly(vehicle, 6)
    assert said == ["SystemID Starting: axis=10", "SystemID Finished"]
    assert vehicle.mode is Mode.SYSTEMID
    assert not vehicle.sweeping
    vehicle.close()
    log = read_log(only_log(tmp_path))
    sidd = [m for m in log if m.get_type() == "SIDD"]
    tpex = {m.TimeUS: m for m in log if m.get_type() == "TPEX"}
    rate = {m.TimeUS: m for m in log if m.get_type() == "RATE"}
    assert [m.TimeUS - entry_us for m in sidd] == [2000 * n for n in range(3000)]
    driven = [m.Time for m in sidd if tpex[m.TimeUS].EX != 0]
    assert (driven[0], driven[-1], len(driven)) == (pytest.approx(1.0), pytest.approx(3.998), 1500)
    assert {tpex[m.TimeUS].EX for m in sidd} - {0.0} == {
        tpex[t].EX for t in tpex if tpex[t].EX
    }  # outside the mode there is none
    assert max(abs(m.Targ) for m in sidd) == pytest.approx(0.1, rel=0.01)
    assert [m.F for m in sidd if 1.0 <= m.Time < 4.0] == sorted(m.F for m in sidd if 1.0 <= m.Time < 4.0)
    for m in sidd[::50]:
        assert (m.Gx, m.Gy, m.Gz) == (rate[m.TimeUS].R, rate[m.TimeUS].P, rate[m.TimeUS].Y)
    finished = next(m for m in log if m.get_type() == "MSG" and m.Message == "SystemID Finished")
    assert finished.TimeUS - entry_us == 5_000_000
    (sids,) = (m for m in log if m.get_type() == "SIDS")
    assert (sids.TimeUS, sids.Ax, sids.FSt, sids.FSp, sids.TFin, sids.TC, sids.TR) == (entry_us, 10, 1, 8, 0, 0, 3)
    (sidy,) = (m for m in log if m.get_type() == "SIDY")
    assert (sidy.Kind, sidy.Law, sidy.C1) == (0, 1, 4)
    modes = [(m.Mode, m.Rsn) for m in log if m.get_type() == "MODE"]
    assert modes == [(0, Reason.START), (25, Reason.GROUND)]


def test_every_sample_is_logged_2_ms_apart_with_the_commands_really_sent(
    tmp_path: Path, fly: Fly, read_log: Reader
) -> None:
    vehicle = sweeper(tmp_path, SID_MAGNITUDE=3.0, SID_T_REC=2)
    vehicle.plant.step = lambda x, y, e, c, r: None  # type: ignore[method-assign]
    vehicle.set_mode(25, Reason.GROUND)
    fly(vehicle, 2)
    vehicle.close()
    log = read_log(only_log(tmp_path))
    for kind in ("RATE", "TPEX"):
        times = [m.TimeUS for m in log if m.get_type() == kind]
        assert [b - a for a, b in itertools.pairwise(times)] == [2000] * 999
    out = [m.ROut for m in log if m.get_type() == "RATE"]
    assert (min(out), max(out)) == (-1, 1)
    assert max(m.EX for m in log if m.get_type() == "TPEX") > 2
    counts = {kind: sum(m.get_type() == kind for m in log) for kind in ("RPM", "ATT", "ARSP")}
    assert counts == {"RPM": 80, "ATT": 20, "ARSP": 0}
    assert {m.Name for m in log if m.get_type() == "PARM"} == set(vehicle.parameters.table)


@pytest.mark.parametrize(("axis", "channel"), [(10, "EX"), (11, "EY"), (20, "EE")])
def test_noise_is_on_every_axis_and_the_chirp_on_its_own(
    tmp_path: Path, fly: Fly, read_log: Reader, axis: int, channel: str
) -> None:
    vehicle = sweeper(tmp_path, SID_AXIS=axis)
    vehicle.set_mode(25, Reason.GROUND)
    fly(vehicle, 5)
    vehicle.close()
    rows = [m for m in read_log(only_log(tmp_path)) if m.get_type() == "TPEX" and m.EE != 0]
    power = {name: sum(getattr(m, name) ** 2 for m in rows) for name in ("EX", "EY", "EE")}
    assert len(rows) == 1500
    assert max(power, key=power.__getitem__) == channel
    assert all(0.0 < value < 0.1 * power[channel] for name, value in power.items() if name != channel)


def test_a_rate_sweep_goes_through_the_controller_in_degrees(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    vehicle = sweeper(tmp_path, SID_AXIS=7, SID_MAGNITUDE=10, SIDX_NOISE=0)
    vehicle.set_mode(25, Reason.GROUND)
    fly(vehicle, 5)
    vehicle.close()
    log = read_log(only_log(tmp_path))
    assert max(m.Targ for m in log if m.get_type() == "SIDD") == pytest.approx(10, rel=0.01)
    assert max(m.RDes for m in log if m.get_type() == "RATE") == pytest.approx(10, rel=0.01)
    assert not any(m.EX for m in log if m.get_type() == "TPEX")


def test_each_run_has_its_own_noise_unless_a_seed_is_given(fly: Fly) -> None:
    def elevator(vehicle: Vehicle) -> list[float]:
        vehicle.set_mode(25, Reason.GROUND)
        fly(vehicle, 1.0)
        values = []
        for _ in range(20):
            vehicle.step()
            values.append(vehicle.commands[2])
        vehicle.set_mode(0, Reason.GROUND)
        return values

    new = sweeper(SIDX_SEED=0)
    assert elevator(new) != elevator(new)
    fixed = sweeper(SIDX_SEED=9)
    assert elevator(fixed) == elevator(fixed)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"SID_AXIS": 0}, "No axis selected, SID_AXIS = 0"),
        ({"SID_AXIS": 3}, "SID_AXIS = 3: this vehicle has 7, 8, 10, 11, 20"),
    ],
)
def test_a_sweep_is_refused_with_a_reason(fly: Fly, changes: dict[str, float], text: str) -> None:
    vehicle = sweeper(None, **changes)
    assert not vehicle.set_mode(25, Reason.GROUND)
    assert vehicle.mode is Mode.STABILIZE
    assert fly(vehicle, 0) == [text]


def test_a_sweep_needs_a_flying_vehicle_and_manual_throttle(fly: Fly) -> None:
    grounded = make_vehicle("hover-ideal", 1, on_ground=True, parameters=SWEEP)
    grounded.texts.clear()
    assert not grounded.set_mode(25, Reason.GROUND)
    assert fly(grounded, 0) == ["Aircraft must be flying"]
    vehicle = sweeper()
    assert vehicle.set_mode(2, Reason.PILOT)
    assert not vehicle.set_mode(25, Reason.GROUND)
    assert fly(vehicle, 0) == ["Axis requires manual throttle"]
    assert vehicle.mode is Mode.ALT_HOLD


def test_asking_again_starts_nothing_and_leaving_ends_it(fly: Fly) -> None:
    vehicle = sweeper()
    vehicle.set_mode(25, Reason.GROUND)
    fly(vehicle, 1.5)
    assert vehicle.set_mode(25, Reason.GROUND)
    assert fly(vehicle, 0.5) == []
    assert vehicle.sweeping
    vehicle.set_mode(0, Reason.GROUND)
    assert not vehicle.sweeping
    assert fly(vehicle, 4) == []
    vehicle.set_mode(25, Reason.GROUND)
    assert fly(vehicle, 0.1) == ["SystemID Starting: axis=10"]


def test_impossible_settings_are_accepted_and_then_named(fly: Fly) -> None:
    vehicle = sweeper(SIDX_LAW=0, SID_T_REC=1.5)  # not longer than 2/f_start
    assert vehicle.set_mode(25, Reason.GROUND)
    said = fly(vehicle, 3)
    assert said[:2] == ["SystemID Starting: axis=10", "SystemID Parameter Error"]
    assert "two periods" in said[2]
    assert vehicle.mode is Mode.SYSTEMID
    assert not vehicle.sweeping
    absurd = sweeper(SID_MAGNITUDE=3e38)
    assert absurd.set_mode(25, Reason.GROUND)
    assert "SystemID Parameter Error" in fly(absurd, 2)


def test_the_lean_limit_ends_a_sweep(fly: Fly) -> None:
    vehicle = sweeper(ANGLE_MAX=100)
    vehicle.set_mode(25, Reason.GROUND)
    said = fly(vehicle, 4)
    assert said[1].startswith("SystemID Stopped: lean=1.0")
    assert said[1].endswith("max=1.000000")
    assert not vehicle.sweeping
    assert vehicle.mode is Mode.SYSTEMID


def test_landing_under_a_sweep_ends_it(fly: Fly) -> None:
    vehicle = sweeper(SID_T_REC=60)
    vehicle.set_mode(25, Reason.GROUND)
    fly(vehicle, 1.5)
    assert obey(vehicle, "land") == "ok"
    said = fly(vehicle, 6)
    assert said == ["SystemID Stopped: Landed", "Disarming motors"]
    assert not vehicle.armed


def test_land_and_take_off_again(tmp_path: Path, fly: Fly) -> None:
    vehicle = make_vehicle("hover", 1, directory=tmp_path)
    fly(vehicle, 1)
    assert obey(vehicle, "takeoff").startswith("refused")
    vehicle._airborne_s = 1900.0
    assert vehicle.battery_percent == 0
    assert obey(vehicle, "LAND") == "ok"
    assert fly(vehicle, 5)[-1] == "Disarming motors"
    assert vehicle.battery_percent == 100, "the pilot has changed it"
    assert (vehicle.phase, vehicle.height_m, vehicle.rotor_rpm) == (Phase.DISARMED, 0, 0)
    assert obey(vehicle, "land").startswith("refused")
    assert obey(vehicle, "takeoff") == "ok"
    assert fly(vehicle, 1) == ["Arming motors"]
    assert vehicle.armed
    assert vehicle.landed
    fly(vehicle, 4)
    assert vehicle.phase is Phase.HOVERING
    vehicle.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["vehicle-1.BIN", "vehicle-2.BIN"]


def test_land_as_a_mode_lands_and_can_be_left(fly: Fly) -> None:
    vehicle = sweeper()
    assert obey(vehicle, "mode land") == "ok"
    fly(vehicle, 1)
    assert vehicle.phase is Phase.DESCENDING
    obey(vehicle, "mode stabilize")
    fly(vehicle, 4)
    assert vehicle.phase is Phase.HOVERING


def test_the_pilots_lines(fly: Fly, paper_bank: tuple[float, ...]) -> None:
    vehicle = make_vehicle("hover-ideal", 1, on_ground=True)
    assert obey(vehicle, "lqr on") == "refused: no gains have been committed"
    commit(vehicle, paper_bank)
    assert obey(vehicle, "lqr on") == "ok"
    assert vehicle.parameters["LQR_SW"] == 1
    assert obey(vehicle, "lqr off") == "ok"
    assert vehicle.parameters["LQR_SW"] == 0
    assert obey(vehicle, "mode systemid") == "refused: No axis selected, SID_AXIS = 0"
    assert obey(vehicle, "mode alt_hold") == "ok"
    for line in ("", "lqr", "mode 25", "loop the loop", "takeoff now"):
        assert obey(vehicle, line).startswith("refused: unknown line")


def test_the_lqr_flies_and_survives_its_own_sweep(fly: Fly, paper_bank: tuple[float, ...]) -> None:
    vehicle = make_vehicle("hover-ideal", 1, on_ground=True, parameters=SWEEP)
    commit(vehicle, paper_bank)
    obey(vehicle, "takeoff")
    fly(vehicle, 5)
    assert obey(vehicle, "lqr on") == "ok"
    fly(vehicle, 10)
    assert math.hypot(*vehicle.attitude) < 0.3
    assert vehicle.set_mode(25, Reason.GROUND)
    assert fly(vehicle, 6)[-1] == "SystemID Finished"
    refused = vehicle.write_parameter("LQR_COMMIT", bank_crc(paper_bank))
    assert refused is not None
    assert refused.value == 0
    assert fly(vehicle, 0) == ["LQR commit refused: armed"]


def test_an_unstable_flight_ends_as_a_crash_not_as_an_error(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    vehicle = sweeper(tmp_path)
    vehicle.plant.p = 1e6
    assert fly(vehicle, 1) == ["Crash: Disarming", "Disarming motors"]
    assert not vehicle.armed
    assert read_log(only_log(tmp_path))[-1].get_type().startswith(("MSG", "PAD"))
    assert vehicle.take_off() is None
    fly(vehicle, 5)
    assert vehicle.phase is Phase.HOVERING
    vehicle.close()


@pytest.mark.parametrize("options", [0, 16])
def test_the_ground_failsafe_both_ways(fly: Fly, options: int) -> None:
    vehicle = sweeper(None, FS_OPTIONS=options, SID_T_REC=30)
    assert fly(vehicle, 7) == []  # no station was there yet
    vehicle.set_mode(25, Reason.GROUND)
    for _ in range(3):
        vehicle.ground.hear(255)
        assert "GCS Failsafe" not in " ".join(fly(vehicle, 4.9))
    assert fly(vehicle, 0.05) == []
    said = fly(vehicle, 0.1)
    if options:
        assert said == ["GCS Failsafe: Continuing Pilot Control"]
        assert vehicle.mode is Mode.SYSTEMID
        assert vehicle.sweeping
    else:
        assert said == ["GCS Failsafe"]
        assert vehicle.mode is Mode.RTL
        assert not vehicle.sweeping
    mode = vehicle.mode
    vehicle.ground.hear(255)
    assert fly(vehicle, 1) == ["GCS Failsafe Cleared"]
    assert vehicle.mode is mode


def test_only_its_own_ground_station_holds_the_failsafe_and_it_can_be_off(fly: Fly) -> None:
    vehicle = sweeper()
    vehicle.ground.hear(255)
    for _ in range(6):
        vehicle.ground.hear(254)
        fly(vehicle, 1)
    assert vehicle.mode is Mode.RTL
    unwatched = sweeper(None, FS_GCS_ENABLE=0)
    unwatched.ground.hear(255)
    assert fly(unwatched, 8) == []
    assert unwatched.mode is Mode.STABILIZE


def test_log_disarmed_keeps_a_log_on_the_ground(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    vehicle = make_vehicle("hover", 1, directory=tmp_path, on_ground=True)
    fly(vehicle, 0.1)
    assert list(tmp_path.iterdir()) == []
    vehicle.write_parameter("LOG_DISARMED", 1)
    fly(vehicle, 0.5)
    vehicle.close()
    rates = [m for m in read_log(only_log(tmp_path)) if m.get_type() == "RATE"]
    assert len(rates) == 250
    assert {m.ROut for m in rates} == {0}


class Jerky:
    """A clock that jumps now and then, as a busy or suspended machine does."""

    def __init__(self, jumps: dict[int, float]) -> None:
        self._now_s = 50.0
        self._waits = 0
        self._jumps = jumps

    def now(self) -> float:
        return self._now_s

    def wait_until(self, moment_s: float) -> None:
        self._waits += 1
        self._now_s = max(self._now_s, moment_s) + self._jumps.get(self._waits, 0.0)


def test_late_steps_are_made_up_and_none_is_dropped(tmp_path: Path, read_log: Reader) -> None:
    vehicle = make_vehicle("hover", 1, directory=tmp_path)
    clock = Jerky({100: 0.5})
    steps_between: list[int] = []
    before = vehicle.time_us

    def between() -> None:
        nonlocal before
        steps_between.append((vehicle.time_us - before) // 2000)
        before = vehicle.time_us

    start = clock.now()
    run(vehicle, clock, between, lambda: clock.now() - start >= 2.0)
    assert vehicle.time_us - 1_000_000 == pytest.approx(2_000_000, abs=4000)
    assert max(steps_between) == 25
    vehicle.close()
    times = [m.TimeUS for m in read_log(only_log(tmp_path)) if m.get_type() == "RATE"]
    assert {b - a for a, b in itertools.pairwise(times)} == {2000}


def test_after_a_long_suspension_the_vehicles_time_has_stood_still() -> None:
    vehicle = make_vehicle("hover", 1)
    clock = Jerky({100: 3600.0})
    turns = 0

    def between() -> None:
        nonlocal turns
        turns += 1

    run(vehicle, clock, between, lambda: turns >= 300)
    assert vehicle.time_s == pytest.approx(1.0 + 300 * 0.002, abs=0.01)


def test_a_free_clock_flies_faster_than_time_and_a_wall_clock_needs_a_speed() -> None:
    vehicle = make_vehicle("hover", 1)
    wall, stop_us = WallClock(), vehicle.time_us + 4_000_000
    start = wall.now()
    run(vehicle, FreeClock(), lambda: None, lambda: vehicle.time_us >= stop_us)
    assert vehicle.time_us == stop_us
    assert wall.now() - start < 4.0
    for speed in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="speed"):
            WallClock(speed)
    fast = WallClock(50.0)
    moment = fast.now() + 0.5
    fast.wait_until(moment)
    assert fast.now() >= moment


def test_unknown_parameters_and_plants_are_named() -> None:
    with pytest.raises(KeyError, match="NOTHING"):
        make_vehicle("hover", 1, parameters={"NOTHING": 1})
    with pytest.raises(ValueError, match="unknown plant"):
        make_vehicle("balloon", 1)
