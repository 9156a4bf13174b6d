"""Whether a recording is whole: the block receiver, the live reader and the recorder against a vehicle that stops.

The vehicle is the simulated one's log and block stream, on a link in fake time; its own file is the judge.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from gcs.flight.live import LiveLog
from gcs.flight.recorder import Recorder, RecordingSummary
from gcs.link.encode import START_BLOCKS, STOP_BLOCKS, BlockStatus, Send
from gcs.link.events import Attitude, Event, LogBlock, StatusText
from gcs.link.log_blocks import LogBlocks
from gcs.link.log_end import EndState
from sitl.autopilot.blocks import BlockStream
from sitl.autopilot.logger import DataFlashLog, FileSink

STEP_S = 0.01
LATENCY_S = 0.01
Window = tuple[float, float]
NEVER: Window = (0.0, 0.0)


@dataclass
class Vehicle:
    """RATE at 100 Hz into a file, and into blocks while somebody asks for them; booted at `boot_at` of our clock."""

    directory: Path
    boot_at: float = -50.0
    log: DataFlashLog | None = None
    stream: BlockStream | None = None
    logs: list[Path] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    ours: bool = True
    """Whether the stream goes to us."""
    clock_told: bool = True

    def boot_s(self, now: float) -> float:
        return now - self.boot_at

    def _begin(self, now: float) -> None:
        self.close()
        path = self.directory / f"vehicle-{len(self.logs) + 1}.BIN"
        self.logs.append(path)
        self.stream = BlockStream(1024 * 1024, now)
        self.log = DataFlashLog([self.stream, FileSink(path)], round(self.boot_s(now) * 1e6))

    def close(self) -> None:
        if self.log is not None:
            self.log.close()
        self.log = None

    def start(self, now: float, ours: bool = True) -> None:
        self._begin(now)
        self.ours = ours

    def drop(self, reason: str) -> None:
        if self.stream is not None and self.log is not None:
            self.log.detach(self.stream)
            self.stream = None
            self.said.append(f"Log stream stopped: {reason}")

    def reboot(self, now: float) -> None:
        self.close()
        self.stream, self.boot_at = None, now

    def hear(self, send: Send, now: float) -> None:
        assert isinstance(send, BlockStatus)
        if send.number == START_BLOCKS:
            self.start(now)
        elif self.stream is None or not self.ours:
            return
        elif send.number == STOP_BLOCKS:
            self.close()
        elif send.kept:
            self.stream.acknowledged(send.number, now)
        else:
            self.stream.refused(send.number, now)

    def say(self, now: float) -> Iterator[Event]:
        time_us = round(self.boot_s(now) * 1e6)
        if self.log is not None:
            self.log.write("RATE", time_us, *(0.0,) * 13)
            self.log.flush()
        if self.stream is not None and (failure := self.stream.failure(now)) is not None:
            self.drop(failure)
        if self.stream is not None and self.ours:
            yield from (LogBlock(1, 155, number, data) for number, data in self.stream.due(now))
        if self.clock_told and round(now / STEP_S) % 10 == 0:
            yield Attitude(1, 1, boot_s=time_us * 1e-6, roll=0, pitch=0, yaw=0, p=0, q=0, r=0)
        yield from (StatusText(1, 1, 4, text) for text in self.said)
        self.said.clear()


class Flight:
    """Ground and vehicle on one link in fake time. Times of the faults are seconds since the beginning."""

    def __init__(
        self,
        directory: Path,
        *,
        loss: float = 0.0,
        up_out: Window = NEVER,
        down_out: Window = NEVER,
        frozen: Window = NEVER,
        seed: int = 3,
    ) -> None:
        (directory / "vehicle").mkdir()
        self.vehicle = Vehicle(directory / "vehicle")
        self.live = LiveLog()
        self.recorder = Recorder(directory / "ground", lambda: 0.0)
        self.blocks = LogBlocks(self.store, self.live.end_s)
        self.loss, self.up_out, self.down_out, self.frozen = loss, up_out, down_out, frozen
        self.now, self.file = 0.0, 0
        self.rng = random.Random(seed)
        self.under_way: list[tuple[float, int, Any]] = []
        self.put_count = 0
        self.say(self.blocks.start(self.now))

    def store(self, file: int, number: int, data: bytes) -> bool:
        if file != self.file:
            self.live.restart()
            self.file = file
        self.live.feed(number, data)
        return self.recorder.store(file, number, data)

    def put(self, thing: Any, out: Window) -> None:
        if out[0] <= self.now < out[1] or self.rng.random() < self.loss:
            return
        self.put_count += 1
        self.under_way.append((self.now + LATENCY_S, self.put_count, thing))

    def say(self, sends: list[Send]) -> None:
        for send in sends:
            self.put(send, self.up_out)

    def go(self, until_s: float) -> Flight:
        while self.now < until_s and self.blocks.outcome is None:
            self.now += STEP_S
            stopped = self.frozen[0] <= self.now < self.frozen[1]
            arrived = [one for one in self.under_way if one[0] <= self.now]
            if stopped:
                arrived = [one for one in arrived if not isinstance(one[2], Event)]
            self.under_way = [one for one in self.under_way if one not in arrived]
            for _, _, thing in sorted(arrived, key=lambda one: one[:2]):
                if isinstance(thing, Event):
                    self.say(self.blocks.on_event(thing, self.now))
                else:
                    self.vehicle.hear(thing, self.now)
            for event in self.vehicle.say(self.now):
                self.put(event, self.down_out)
            if not stopped:
                self.say(self.blocks.poll(self.now))
        return self

    def cut_tcp(self, for_s: float) -> Flight:
        """The connection breaks and comes back: the vehicle's stream went with its peer."""
        self.vehicle.drop("the ground hung up")
        self.up_out = self.down_out = (self.now, self.now + for_s)
        return self

    def end(self, within_s: float = 15.0) -> RecordingSummary:
        self.say(self.blocks.stop(self.now))
        self.go(self.now + within_s)
        self.vehicle.close()
        return self.recorder.finish(self.blocks.results(self.now))

    def kept_whole(self, summary: RecordingSummary) -> bool:
        """Whether the ground's only log is the vehicle's only one, byte for byte."""
        if len(summary.logs) != 1 or len(self.vehicle.logs) != 1:
            return False
        return summary.logs[0].path.read_bytes() == self.vehicle.logs[0].read_bytes()


def ends(summary: RecordingSummary) -> list[str]:
    return [log.end.state.value for log in summary.logs]


# ------------------------------------------------------------------------------------------------ whole


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("outage", [{}, {"up_out": (3.0, 8.0)}, {"down_out": (3.0, 8.0)}])
def test_a_whole_log_is_called_complete(tmp_path: Path, loss: float, outage: dict[str, Window]) -> None:
    flight = Flight(tmp_path, loss=loss, **outage)
    summary = flight.go(15.0).end()
    assert flight.kept_whole(summary)
    assert summary.complete
    assert summary.problems == ()
    assert ends(summary) == ["reached"]
    assert summary.to_json()["complete"] is True


def test_a_stop_of_this_program_that_the_vehicle_waits_for_costs_nothing(tmp_path: Path) -> None:
    flight = Flight(tmp_path, frozen=(3.0, 8.0))
    summary = flight.go(12.0).end()
    assert flight.kept_whole(summary)
    assert summary.complete


# ------------------------------------------------------------------------------------------------ cut


def assert_cut(flight: Flight, summary: RecordingSummary, logs: int, short_s: float) -> None:
    """No block is missing and yet the first log is short by about `short_s`, and that is told everywhere."""
    assert summary.missing_blocks == 0
    assert not flight.kept_whole(summary)
    assert not summary.complete
    assert len(summary.logs) == logs
    first = summary.logs[0]
    assert first.end.state is EndState.CUT
    assert first.end.short_s == pytest.approx(short_s, abs=0.5)
    assert any(f"flight.BIN ends {first.end.short_s:.1f} s before" in problem for problem in summary.problems)
    about = summary.to_json()
    assert about["complete"] is False
    assert (about["logs"][0]["end"], about["logs"][0]["complete"]) == ("cut", False)
    # What is there is the beginning of the vehicle's own.
    assert flight.vehicle.logs[0].read_bytes().startswith(first.path.read_bytes())


def test_an_uplink_out_for_twelve_seconds(tmp_path: Path) -> None:
    flight = Flight(tmp_path, up_out=(3.0, 15.0))
    summary = flight.go(18.0).end()
    assert_cut(flight, summary, 1, 5.0)
    assert "before the recording did (the vehicle: Log stream stopped: no acknowledgement" in summary.problems[0]


@pytest.mark.parametrize(("outage_s", "short_s"), [(20.0, 11.0), (40.0, 30.0)])
def test_an_uplink_out_for_longer_and_a_new_log_after_it(tmp_path: Path, outage_s: float, short_s: float) -> None:
    flight = Flight(tmp_path, up_out=(3.0, 3.0 + outage_s))
    summary = flight.go(35.0 if outage_s < 30 else 50.0).end()
    assert_cut(flight, summary, 2, short_s)
    assert ends(summary) == ["cut", "reached"]
    assert "before the vehicle's next log began" in summary.problems[0]
    assert "began a new log 1 time(s)" in summary.problems[-1]


def test_a_connection_cut_for_half_a_second(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.go(3.0).cut_tcp(0.5)
    summary = flight.go(20.0).end()
    assert_cut(flight, summary, 2, 11.0)
    assert ends(summary) == ["cut", "reached"]


def test_a_connection_cut_for_five_seconds(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.go(3.0).cut_tcp(5.0)
    summary = flight.go(10.0).end()
    assert_cut(flight, summary, 1, 7.0)


def test_a_start_of_another_station_takes_the_stream_away(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.go(3.0).vehicle.start(flight.now, ours=False)
    summary = flight.go(8.0).end()
    assert_cut(flight, summary, 1, 5.0)


def test_a_start_of_another_station_on_our_link_is_a_new_log_to_us(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.go(3.0).vehicle.start(flight.now)
    summary = flight.go(8.0).end()
    assert [path.read_bytes() for path in flight.vehicle.logs][1] == summary.logs[1].path.read_bytes()
    assert ends(summary) == ["cut", "reached"]
    assert not summary.complete


def test_this_program_stopped_for_longer_than_the_vehicle_waits(tmp_path: Path) -> None:
    flight = Flight(tmp_path, frozen=(3.0, 14.0))
    summary = flight.go(16.0).end()
    assert not flight.kept_whole(summary)
    assert not summary.complete
    assert ends(summary)[0] == "cut"
    assert "ends" in summary.problems[0]


def test_a_stream_that_the_vehicle_gave_up_just_before_the_end_is_cut_by_its_own_word(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.go(3.0).vehicle.drop("buffer full")
    summary = flight.go(3.2).end()
    assert ends(summary) == ["cut"]
    assert "Log stream stopped: buffer full" in summary.problems[0]


def test_the_word_that_a_stream_stopped_counts_only_while_nothing_more_comes(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.go(3.0).vehicle.said.append("Log stream stopped: says another")
    flight.go(3.5)
    assert flight.blocks.reported == "Log stream stopped: says another"
    flight.go(6.0)
    assert flight.blocks.reported == ""
    assert flight.end().complete


# ------------------------------------------------------------------------------------------------ restarts, not known


def test_a_log_that_ends_where_the_vehicle_restarted_has_its_end(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.go(3.0).vehicle.reboot(flight.now)
    summary = flight.go(8.0).end()
    assert ends(summary) == ["reached", "reached"]
    assert summary.logs[0].end.cause.value == "restart"
    assert not summary.complete
    assert summary.problems == ("the vehicle began a new log 1 time(s) while it was recorded",)


def test_a_restart_that_was_not_heard_leaves_the_end_unknown(tmp_path: Path) -> None:
    flight = Flight(tmp_path, down_out=(3.0, 9.0))
    flight.go(7.0).vehicle.reboot(flight.now)
    summary = flight.go(14.0).end()
    assert ends(summary) == ["not known", "reached"]
    assert "the vehicle restarted while it was not heard" in summary.problems[0]


def test_without_the_vehicles_clock_the_end_is_not_known(tmp_path: Path) -> None:
    flight = Flight(tmp_path)
    flight.vehicle.clock_told = False
    summary = flight.go(3.0).end()
    assert flight.kept_whole(summary)
    assert ends(summary) == ["not known"]
    assert summary.problems == (
        "flight.BIN: whether it is whole at its end is not known, the vehicle did not tell its clock",
    )
    assert not summary.complete


def test_a_vehicle_not_heard_after_the_end_was_asked_for_proves_nothing(tmp_path: Path) -> None:
    flight = Flight(tmp_path, down_out=(3.0, 99.0))
    summary = flight.go(3.0).end()
    assert ends(summary) == ["not known"]
    late = tmp_path / "late"
    late.mkdir()
    flight = Flight(late, down_out=(3.0, 99.0))
    summary = flight.go(10.0).end()
    assert ends(summary) == ["cut"]
    assert summary.problems[0].startswith("flight.BIN ends 7.0 s before the recording did")


@pytest.mark.parametrize("seed", range(12))
def test_whatever_happens_complete_is_said_of_whole_logs_only(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    begin, length = 2.0 + 3.0 * rng.random(), rng.choice([0.0, 2.0, 6.0, 9.5, 10.5, 13.0])
    fault = rng.choice(["up_out", "down_out", "frozen"])
    faults: dict[str, Any] = {fault: (begin, begin + length)}
    flight = Flight(tmp_path, loss=rng.choice([0.0, 0.1]), seed=seed, **faults)
    if rng.random() < 0.3:
        flight.go(begin).cut_tcp(length)
    summary = flight.go(begin + length + 5.0 * rng.random() + 0.6).end()
    assert summary.complete == flight.kept_whole(summary)
