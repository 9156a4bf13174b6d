"""What goes wrong on the link, beside it and on board: in fake time, and the same again from the same seed."""

from __future__ import annotations

import argparse
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.cli.sim import FAULTS
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.faults import (
    Bandwidth,
    Corruption,
    Duplicates,
    Faults,
    FaultyLink,
    Lag,
    LogStop,
    Loss,
    Order,
    OtherStation,
    Outage,
    Reordering,
    SecondVehicle,
    Stage,
    StartWatch,
    StrayHeartbeat,
    Way,
    Window,
    parameter_write,
    start_of_log,
)
from sitl.faults.words import FLAGS, MANY, ONE, add_options, read
from sitl.protocol.server import Server

PEER = ("ground", 1)
START = mavlink.MAV_REMOTE_LOG_DATA_BLOCK_START
SWEEP = {"SID_AXIS": 10, "SID_MAGNITUDE": 0.05, "SIDX_KIND": 1, "SIDX_PULSE_S": 0.5, "SID_T_REC": 20}


class Wire:
    """A link in memory with faults, and a clock that a test turns by hand."""

    def __init__(self, make_link: Callable[..., Any], faults: Faults, *known: Any) -> None:
        self.now_s = 0.0
        self.bare = make_link(*known)
        self.link = FaultyLink(self.bare, faults, lambda: self.now_s)
        self.up: list[tuple[float, bytes]] = []
        self.down: list[tuple[float, bytes]] = []

    def at(self, now_s: float, *, up: Sequence[bytes] = (), down: Sequence[bytes] = ()) -> None:
        """Turn the clock on in steps of 10 ms, then send."""
        for _ in range(round((now_s - self.now_s) / 0.01)):
            self.now_s = round(self.now_s + 0.01, 2)
            self._look()
        self.bare.to_vehicle += [(PEER, data) for data in up]
        for data in down:
            self.link.send(PEER, data)
        self._look()

    def _look(self) -> None:
        self.up += [(self.now_s, data) for _, data in self.link.receive()]
        self.down += [(self.now_s, data) for _, data in self.bare.from_vehicle]
        self.bare.from_vehicle.clear()


@pytest.fixture
def wire(memory_link: Callable[..., Any]) -> Callable[..., Wire]:
    return lambda faults, *known: Wire(memory_link, faults, *known)


def names(count: int) -> list[bytes]:
    return [b"%d" % n for n in range(count)]


def out(stage: Stage, packets: Sequence[bytes], until_s: float = 60.0) -> list[bytes]:
    """What comes out of a stage when one packet goes in every 10 ms."""
    came = []
    for n in range(round(until_s * 100)):
        came += stage([(PEER, packets[n])] if n < len(packets) else [], n * 0.01)
    return [data for _, data in came]


# Lag


def test_a_lag_is_constant_keeps_the_order_and_has_each_way_for_itself(wire: Any) -> None:
    line = wire(Faults(up=(Lag(3.5),), down=(Lag(0.3),)))
    line.at(1.0, up=[b"a", b"b"], down=[b"x", b"y"])
    line.at(1.2, up=[b"c"], down=[b"z"])
    line.at(10.0)
    assert line.up == [(4.5, b"a"), (4.5, b"b"), (4.7, b"c")]
    assert line.down == [(1.3, b"x"), (1.3, b"y"), (1.5, b"z")]


def test_a_lag_that_begins_and_ends_in_flight_never_lets_anything_overtake(wire: Any) -> None:
    line = wire(Faults(down=(Lag(2.0, window=Window(5.0, 6.0)),)))
    for now_s in (4.99, 5.0, 5.99, 6.0, 7.0, 8.0):
        line.at(now_s, down=[b"%g" % now_s])
    line.at(12.0)
    assert line.down == [(4.99, b"4.99"), (7.0, b"5"), (7.99, b"5.99"), (7.99, b"6"), (7.99, b"7"), (8.0, b"8")]


def test_jitter_swaps_and_a_seed_repeats_it() -> None:
    first, again, other = (out(Lag(0.1, jitter_s=0.2, seed=seed), names(200)) for seed in (1, 1, 2))
    assert sorted(first) == sorted(names(200))
    assert first == again
    assert first != names(200)
    assert first != other


def test_a_window_can_count_from_the_first_sweep() -> None:
    began_s = math.inf
    window = Window(3.0, 8.0, lambda: began_s)
    assert not window.covers(100.0)
    began_s = 100.0
    assert [window.covers(now_s) for now_s in (102.9, 103.0, 107.9, 108.0)] == [False, True, True, False]


# Outages


@pytest.mark.parametrize(("way", "up", "down"), [(Way.UP, 2, 3), (Way.DOWN, 3, 2), (Way.BOTH, 2, 2)])
def test_an_outage_can_be_one_way(wire: Any, way: Way, up: int, down: int) -> None:
    loss = Loss(0.0, 1, [Outage(2.0, 3.0, way=way)])
    line = wire(Faults(up=(loss.up,), down=(loss.down,)))
    for now_s in (1.0, 2.5, 3.0):
        line.at(now_s, up=[b"u"], down=[b"d"])
    assert (len(line.up), len(line.down)) == (up, down)


def test_a_vehicle_that_hears_nothing_goes_on_telling(radio: Any, hovering: Vehicle) -> None:
    loss = Loss(0.0, 1, [Outage(4.0, way=Way.UP)])
    station = radio(hovering, faults=Faults(up=(loss.up,), down=(loss.down,)))
    station.ask(station.heartbeat())
    assert station.set("SID_MAGNITUDE", 0.5) == 0.5
    station.fly(3.5)
    station.take()
    assert station.set("SID_MAGNITUDE", 0.25) is None
    station.fly(3.0)
    assert len(station.take("HEARTBEAT")) in (3, 4)
    assert hovering.parameters["SID_MAGNITUDE"] == 0.5


# Bandwidth


def test_what_does_not_fit_waits_in_order_then_is_dropped_and_the_queue_drains() -> None:
    line = Bandwidth(1000.0, queue_bytes=500)
    packets = [(PEER, bytes([n]) * 100) for n in range(7)]
    assert line(packets, 0.0) == []
    assert (line.queued_bytes, line.dropped) == (500, 2)
    assert line([], 0.1) == packets[:1]
    assert line([(PEER, b"later")], 0.3) == packets[1:3]
    assert line.queued_bytes == 205
    assert line([], 0.51) == [*packets[3:5], (PEER, b"later")]
    assert (line.queued_bytes, line.dropped) == (0, 2)
    assert line(packets[:1], 9.0) == []
    assert line([], 9.1) == packets[:1]


def test_the_log_at_57600_baud_makes_the_link_late(radio: Any) -> None:
    """Nothing tells the vehicle: the lag is that of the queue, 16,384 bytes at 5,760 bytes a second."""
    line = Bandwidth(5760.0)
    station = radio(make_vehicle("hover-ideal", 1), faults=Faults(down=(line,)))
    ages: list[tuple[int, float]] = []
    station.send(station.heartbeat())
    for turn in range(2000):
        if turn == 500:
            station.send(mavlink.MAVLink_remote_log_block_status_message(1, 1, START, 1))
        station.fly(0.002)
        heard = station.take("ATTITUDE")
        ages += [(turn, station.vehicle.time_s - message.time_boot_ms * 1e-3) for message in heard]
    assert max(age for turn, age in ages if turn < 500) < 0.1
    assert max(age for turn, age in ages) > 2.0
    assert line.dropped > 100


# Duplicates, order, damage


def test_duplicates_come_at_once_or_later() -> None:
    assert out(Duplicates(1.0, 1), [b"a", b"b"]) == [b"a", b"a", b"b", b"b"]
    late = out(Duplicates(0.3, 1, within_s=5.0), names(300))
    assert late == out(Duplicates(0.3, 1, within_s=5.0), names(300))
    assert 360 < len(late) < 420
    assert list(dict.fromkeys(late)) == names(300)  # each comes first when it should
    assert max(late.index(b"299") - n for n, data in enumerate(late[:-1]) if data == b"0") > 300


def test_reordering_holds_some_while_others_pass() -> None:
    came = out(Reordering(0.2, 3), names(300))
    assert came == out(Reordering(0.2, 3), names(300))
    assert sorted(came) == sorted(names(300))
    assert 30 < sum(a > b for a, b in zip(map(int, came), map(int, came[1:]), strict=False)) < 80


def test_corruption_changes_one_byte_of_a_share() -> None:
    sent = [bytes([n]) * 20 for n in range(200)]
    came = out(Corruption(0.2, 5), sent)
    assert came == out(Corruption(0.2, 5), sent)
    wrong = [sum(a != b for a, b in zip(x, y, strict=True)) for x, y in zip(sent, came, strict=True)]
    assert set(wrong) == {0, 1}
    assert 20 < sum(wrong) < 60


@pytest.mark.parametrize(
    "make",
    [
        lambda: Lag(-1.0),
        lambda: Lag(math.nan),
        lambda: Lag(1.0, jitter_s=math.inf),
        lambda: Bandwidth(0.0),
        lambda: Bandwidth(5760.0, queue_bytes=100),
        lambda: Duplicates(1.5, 1),
        lambda: Reordering(math.nan, 1),
        lambda: Corruption(-0.1, 1),
        lambda: Loss(2.0, 1),
        lambda: parameter_write("A_NAME_THAT_IS_TOO_LONG", 1.0),
        lambda: parameter_write("SID_MAGNITUDE", 1e300),
    ],
)
def test_faults_that_cannot_be_are_refused(make: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=r"must|no parameter|no value"):
        make()


def test_a_whole_storm_repeats_from_its_seed(radio: Any) -> None:
    def fly(seed: int) -> list[bytes]:
        loss = Loss(0.1, seed, [Outage(2.0, 2.3)])
        down: tuple[Stage, ...] = (Duplicates(0.1, seed), loss.down, Corruption(0.1, seed), Lag(0.1, jitter_s=0.1))
        faults = Faults(up=(loss.up,), down=down, vehicles=(SecondVehicle(attitude=True),))
        station = radio(make_vehicle("hover-ideal", 1), faults=faults)
        station.send(station.heartbeat(), station.heartbeat())
        station.fly(3.0)
        return [data for _, data in station.link.from_vehicle]

    assert fly(1) == fly(1)
    assert fly(1) != fly(2)


# Others on the link


def test_a_second_vehicle_has_the_same_id_another_mode_and_a_rhythm_of_its_own(radio: Any) -> None:
    other = SecondVehicle(Mode.LAND, window=Window(3.0, 8.0), attitude=True, phase_s=0.37)
    station = radio(make_vehicle("hover-ideal", 1), faults=Faults(vehicles=(other,)))
    station.ask(station.heartbeat())
    heard = []
    for _ in range(5000):
        station.fly(0.002)
        heard += [(station.vehicle.time_s, message) for message in station.take()]
    beats = [(now_s, m) for now_s, m in heard if m.get_type() == "HEARTBEAT"]
    strange = [(now_s, m) for now_s, m in beats if m.custom_mode == Mode.LAND]
    assert [now_s for now_s, _ in strange] == pytest.approx([3.37, 4.37, 5.37, 6.37, 7.37], abs=0.005)
    assert {(m.get_srcSystem(), m.get_srcComponent(), m.autopilot) for _, m in beats} == {(1, 1, 3)}
    assert len(beats) - len(strange) == 10
    stamps = [m.time_boot_ms for _, m in heard if m.get_type() == "ATTITUDE"]
    assert sum(stamp > 1_000_000 for stamp in stamps) == pytest.approx(50, abs=1)
    assert sum(stamp < 1_000_000 for stamp in stamps) == pytest.approx(100, abs=1)


def test_it_is_heard_although_the_vehicle_itself_is_not(wire: Any) -> None:
    loss = Loss(1.0, 1)
    line = wire(Faults(down=(loss.down,), vehicles=(SecondVehicle(),)), PEER)
    line.at(5.0, down=[b"lost"])
    assert len(line.down) == 5


def test_a_single_stray_heartbeat(radio: Any) -> None:
    station = radio(make_vehicle("hover-ideal", 1), faults=Faults(vehicles=(StrayHeartbeat(0, Window(4.0)),)))
    station.vehicle.set_mode(Mode.ALT_HOLD, Reason.PILOT)
    station.ask(station.heartbeat())
    station.fly(9.0)
    modes = [m.custom_mode for m in station.take("HEARTBEAT")]
    assert modes.count(Mode.STABILIZE) == 1
    assert modes.index(Mode.STABILIZE) in (2, 3)


def test_another_station_writes_and_everybody_hears_the_echo(radio: Any) -> None:
    orders = [Order(parameter_write("SID_MAGNITUDE", 0.5), Window(2.0))]
    station = radio(make_vehicle("hover-ideal", 1), faults=Faults(stations=(OtherStation(orders),)))
    station.ask(station.heartbeat())
    assert station.set("SID_MAGNITUDE", 0.1) == pytest.approx(0.1)
    station.fly(0.9)
    assert station.take("PARAM_VALUE") == []
    station.fly(0.2)
    (echo,) = station.take("PARAM_VALUE")
    assert (echo.param_id, echo.param_value) == ("SID_MAGNITUDE", 0.5)
    station.fly(2.0)
    assert station.get("SID_MAGNITUDE") == 0.5
    assert {address for address, _ in station.link.from_vehicle} <= {station.address}


def receipts(messages: Sequence[Any]) -> list[Any]:
    return [mavlink.MAVLink_remote_log_block_status_message(1, 1, m.seqno, 1) for m in messages]


def stream(station: Any, seconds: float) -> list[int]:
    """Numbers of the blocks that come; each is acknowledged."""
    numbers = []
    for _ in range(round(seconds / 0.02)):
        station.fly(0.02)
        blocks = station.take("REMOTE_LOG_DATA_BLOCK")
        station.send(*receipts(blocks))
        numbers += [m.seqno for m in blocks]
    return numbers


def begin(station: Any) -> None:
    station.send(station.heartbeat(), mavlink.MAVLink_remote_log_block_status_message(1, 1, START, 1))


def test_another_station_takes_the_log_over(radio: Any) -> None:
    orders = [Order(start_of_log(), Window(3.0))]
    station = radio(make_vehicle("hover-ideal", 1), faults=Faults(stations=(OtherStation(orders),)))
    begin(station)
    assert len(stream(station, 1.9)) > 200
    stream(station, 0.2)
    assert stream(station, 2.0) == []


# The log


@pytest.mark.parametrize(("reason", "said"), [("buffer full", ["Log stream stopped: buffer full"]), (None, [])])
def test_a_log_that_stops_says_so_or_not_and_stays_stopped(
    radio: Any, tmp_path: Path, reason: str | None, said: list[str]
) -> None:
    vehicle = make_vehicle("hover-ideal", 1, directory=tmp_path)
    station = radio(vehicle, faults=Faults(on_board=(LogStop(Window(3.0), reason=reason),)))
    begin(station)
    assert len(stream(station, 1.9)) > 200
    station.fly(0.2)  # blocks that nobody has acknowledged are under way
    station.take("REMOTE_LOG_DATA_BLOCK")
    size = sum(path.stat().st_size for path in tmp_path.iterdir())
    begin(station)
    assert stream(station, 2.0) == []
    assert [m.text for m in station.take("STATUSTEXT") if "Log" in m.text] == said
    vehicle.close()
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) > size + 50_000  # on board it goes on


def test_a_log_that_stops_can_be_started_again(radio: Any) -> None:
    station = radio(make_vehicle("hover-ideal", 1), faults=Faults(on_board=(LogStop(Window(3.0), resumes=True),)))
    begin(station)
    stream(station, 2.5)
    assert stream(station, 1.0) == []
    begin(station)
    again = stream(station, 1.0)
    assert again[0] == 0
    assert len(again) > 100


# What a late or repeated order does


def peak(fly: Callable[[], None], vehicle: Vehicle, seconds: float) -> float:
    """Largest command on roll meanwhile."""
    largest = 0.0
    for _ in range(round(seconds / 0.002)):
        fly()
        largest = max(largest, abs(vehicle.commands[0]))
    return largest


def test_a_write_into_a_running_sweep_changes_the_amplitude_at_once(radio: Any) -> None:
    vehicle = make_vehicle("hover-ideal", 1, parameters=SWEEP)
    station = radio(vehicle)
    station.ask(station.heartbeat())
    vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    station.fly(1.1)
    before = vehicle.commands[0]
    assert station.set("SID_MAGNITUDE", 0.25) == 0.25
    station.fly(0.002)
    assert vehicle.commands[0] - before == pytest.approx(0.2, abs=0.02)
    station.set("SID_AXIS", 11)
    station.fly(0.002)
    assert vehicle.commands[0] - before == pytest.approx(-0.05, abs=0.02)


def test_the_ones_that_end_it(radio: Any) -> None:
    for name, value, text in [
        ("SID_AXIS", 0, "SystemID Stopped: axis = 0"),
        ("SID_T_REC", -1, "SystemID Parameter Error"),
        ("SID_T_REC", 0.5, "SystemID Finished"),
    ]:
        vehicle = make_vehicle("hover-ideal", 1, parameters=SWEEP)
        station = radio(vehicle)
        station.ask(station.heartbeat())
        vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
        station.fly(2.0)
        assert vehicle.sweeping
        station.set(name, value)
        station.fly(1.1)
        assert not vehicle.sweeping
        assert text in [m.text for m in station.take("STATUSTEXT")]
        assert vehicle.mode is Mode.SYSTEMID


def test_a_large_write_in_mid_sweep_ends_at_the_lean_stop_of_angle_max(radio: Any) -> None:
    """As a real ArduPilot did when 15 was written into a running sweep."""
    vehicle = make_vehicle("hover-ideal", 1, parameters={**SWEEP, "ANGLE_MAX": 2000})
    station = radio(vehicle)
    station.ask(station.heartbeat())
    vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    station.fly(1.1)
    station.set("SID_MAGNITUDE", 15)
    assert peak(lambda: station.fly(0.002), vehicle, 2.0) == 1.0
    (text,) = [m.text for m in station.take("STATUSTEXT") if m.text.startswith("SystemID Stopped: lean=2")]
    assert text.endswith("max=20.000000")
    assert not vehicle.sweeping


def order(mode: int) -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, 1, mode, 0, 0, 0, 0, 0)


def test_a_repeated_start_is_accepted_and_does_not_start_again(radio: Any) -> None:
    vehicle = make_vehicle("hover-ideal", 1, parameters=SWEEP)
    station = radio(vehicle)
    station.send(order(25))
    station.fly(3.0)
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 25) == mavlink.MAV_RESULT_ACCEPTED
    station.fly(0.5)
    assert [m.text for m in station.heard if m.get_type() == "STATUSTEXT"] == []
    assert vehicle.sweeping


def test_a_start_that_comes_late_starts_again_after_the_mode_was_left(radio: Any) -> None:
    """The hazard: a copy of the order arrives when the sweep has been ended, and it flies."""
    vehicle = make_vehicle("hover-ideal", 1, parameters=SWEEP)
    station = radio(vehicle, faults=Faults(up=(Duplicates(1.0, 2, within_s=8.0),)))  # 4.4 s later
    station.send(order(25))
    station.fly(2.0)
    vehicle.set_mode(Mode.STABILIZE, Reason.PILOT)
    station.fly(1.0)
    assert vehicle.mode is Mode.STABILIZE
    station.fly(5.0)
    starts = [m for m in station.take("STATUSTEXT") if m.text == "SystemID Starting: axis=10"]
    assert len(starts) == 2
    assert vehicle.mode is Mode.SYSTEMID


def test_a_lag_can_begin_with_the_first_order_and_catches_it(radio: Any) -> None:
    """The order and all after it come late: the vehicle begins when the ground has long taken it for refused."""
    faults = read(arguments("--lag", "3.5@order+0:"), lambda: math.inf)
    vehicle = make_vehicle("hover-ideal", 1, parameters={**SWEEP, "SID_AXIS": 0})
    station = radio(vehicle, faults=faults)
    station.ask(station.heartbeat())
    assert station.set("SID_AXIS", 10) == 10
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 2) == mavlink.MAV_RESULT_ACCEPTED
    assert station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0) == mavlink.MAV_RESULT_ACCEPTED
    station.send(order(25))
    station.fly(1.0)
    station.send(mavlink.MAVLink_param_set_message(1, 1, b"SID_MAGNITUDE", 0.25, 9))
    station.fly(2.4)
    assert vehicle.mode is Mode.STABILIZE
    assert peak(lambda: station.fly(0.002), vehicle, 1.0) < 0.04
    assert vehicle.mode is Mode.SYSTEMID
    assert station.take("COMMAND_ACK") == []
    assert peak(lambda: station.fly(0.002), vehicle, 1.0) > 0.2
    station.fly(3.0)
    assert [m.command for m in station.take("COMMAND_ACK")] == [mavlink.MAV_CMD_DO_SET_MODE]


def test_noise_is_no_order() -> None:
    watch = StartWatch()
    for data in (b"", b"\xfd", b"\xfd" + b"\x4c" * 40, bytes(300)):
        assert watch([(PEER, data)], 1.0) == [(PEER, data)]
    assert watch.first_s == math.inf


def test_lag_is_measurable_from_the_vehicles_answers(radio: Any, hovering: Vehicle) -> None:
    station = radio(hovering, faults=Faults(up=(Lag(1.0),), down=(Lag(0.5),)))
    station.send(station.heartbeat())
    station.fly(2.0)
    station.take()
    asked_us = hovering.time_us
    station.send(mavlink.MAVLink_timesync_message(0, 77))
    station.fly(1.45)
    assert station.take("TIMESYNC") == []
    station.fly(0.1)
    (answer,) = station.take("TIMESYNC")
    assert answer.ts1 == 77
    assert answer.tc1 == pytest.approx((asked_us + 1_000_000) * 1000, abs=5e6)
    station.fly(3.0)
    clock = [m.time_boot_ms for m in station.take("SYSTEM_TIME")]
    assert [b - a for a, b in itertools.pairwise(clock)] == [1000] * (len(clock) - 1)
    assert len(clock) > 3


# Options


def arguments(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=1)
    add_options(parser)
    return parser.parse_args(words)


def test_options_say_which_faults_there_are(wire: Any) -> None:
    given = arguments(
        *("--loss", "0", "--outage", "up@5:6", "--lag-up", "1@:4", "--lag", "0.5@sweep+2:", "--second-vehicle=land@4"),
        *("--other-station", "SID_MAGNITUDE=0.5@3", "--log-stops", "20,silent"),
    )
    faults = read(given, lambda: 6.0)
    line = wire(faults, PEER)
    for now_s in (2.0, 5.5, 7.0, 9.0):
        line.at(now_s, up=[b"%g" % now_s], down=[b"%g" % now_s])
    line.at(12.0)
    own = [(now_s, data) for now_s, data in line.up if len(data) < 9]
    assert own == [(3.0, b"2"), (7.0, b"7"), (9.5, b"9")]
    assert [now_s for now_s, data in line.up if len(data) > 9] == [3.0]
    assert [now_s for now_s, data in line.down if len(data) > 9] == [4.0]
    assert [now_s for now_s, data in line.down if len(data) < 9] == [2.0, 5.5, 7.0, 9.5]
    assert len(faults.on_board) == 1


def test_every_option_can_be_read() -> None:
    words = [
        *("--jitter", "0.1", "--bandwidth", "5760@10:20", "--queue", "8192", "--reorder", "0.1", "--corrupt", "0.05"),
        *("--duplicate", "0.1", "--duplicate-within", "2", "--log-stops", "sweep+2,resumes", "--outage", "both"),
        *("--lag", "3.5", "--lag-up", "1", "--lag-down", "2@4:", "--second-vehicle", "25", "--other-station", "log@9"),
        *("--loss", "0.1@3:9", "--log-slows", "9000@5:", "--alter-writes", "0.5", "--refuse-writes", "0.1@:9"),
        *("--reboot", "12", "--clock-step", "3600@sweep+2", "--gyro-nan", "8:9", "--forge", "mode=rtl@9"),
        *("--spoof", "heartbeat=land@4:6", "--second-attitude"),
    ]
    faults = read(arguments(*words), lambda: math.inf)
    assert [len(part) for part in (faults.up, faults.down, faults.vehicles, faults.stations)] == [10, 9, 1, 1]
    assert [len(part) for part in (faults.on_board, faults.forged, faults.spoofed)] == [7, 1, 1]
    assert set(words[:-1:2]) == {f"--{name}" for name in (*MANY, *ONE)}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--lag", "soon"], "--lag soon: 'soon' is no number"),
        (["--lag", "3@20"], "FROM:UNTIL"),
        (["--lag", "3@20:10"], "ends before it begins"),
        (["--lag-up", "-1"], "0 or more"),
        (["--lag-up", "1@noon+3:"], "count from sweep or order"),
        (["--outage", "sideways"], "up, down or both"),
        (["--bandwidth", "0"], "positive number of bytes"),
        (["--bandwidth", "5760", "--queue", "10"], "at least one frame"),
        (["--duplicate", "2"], "between 0 and 1"),
        (["--second-vehicle", "backwards"], "a mode is wanted: stabilize"),
        (["--other-station", "SID_MAGNITUDE=0.5"], "NAME=VALUE@S"),
        (["--other-station", "SID_MAGNITUDE=0.5@1:2"], "NAME=VALUE@S"),
        (["--log-stops", "20,loudly"], "silent or resumes"),
    ],
)
def test_wrong_words_name_their_option_and_what_is_wanted(words: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=r"^--") as refusal:
        read(arguments(*words), lambda: math.inf)
    assert message in str(refusal.value)


def test_the_command_line_of_the_ground_offers_all_of_them() -> None:
    assert set(FAULTS) == {*MANY, *ONE, *FLAGS}
    texts = {name: text for name, (_, text) in {**MANY, **ONE}.items()}
    assert {name: text for name, (_, text) in FAULTS.items() if name in texts} == texts


def test_a_peer_that_hung_up_is_not_heard_late(memory_link: Callable[..., Any], hovering: Vehicle) -> None:
    bare = memory_link()
    server = Server(hovering, FaultyLink(bare, Faults(up=(Lag(0.5),)), lambda: hovering.time_s))
    bare.to_vehicle.append((1, b""))
    for _ in range(400):
        hovering.step()
        server.poll()
    assert bare.from_vehicle
    message = mavlink.MAVLink_param_set_message(1, 1, b"SID_MAGNITUDE", 0.5, 9)
    bare.to_vehicle.append((1, bytes(message.pack(mavlink.MAVLink(None, 255, 190)))))
    server.poll()
    bare.hung_up.append(1)
    for _ in range(400):
        hovering.step()
        server.poll()
    assert hovering.parameters["SID_MAGNITUDE"] != 0.5
