"""Procedures in fake time: no sockets, no sleeping, minutes of retries in milliseconds."""

from __future__ import annotations

import random
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from gcs.link.encode import (
    DO_SET_MODE,
    START_BLOCKS,
    STOP_BLOCKS,
    BlockStatus,
    Command,
    ParamList,
    ParamRead,
    ParamWrite,
    Send,
)
from gcs.link.events import (
    Attitude,
    AutopilotVersion,
    CommandAck,
    Event,
    Heartbeat,
    LogBlock,
    ParamError,
    ParameterType,
    ParamValue,
    StatusText,
    bits_of_float,
)
from gcs.link.log_blocks import LogBlocks, StreamResult
from gcs.link.procedures import (
    Done,
    Failed,
    ReadAllParameters,
    ReadParameter,
    RequestAutopilotVersion,
    SetMode,
    WriteParameter,
)

BYTEWISE = AutopilotVersion(1, 1, 16, "1.14.0")


def value(name: str, number: float, count: int = 1, index: int = 0) -> ParamValue:
    return ParamValue(1, 1, name=name, bits=bits_of_float(number), kind=9, count=count, index=index)


def run(procedure: Any, answer: Callable[[Send, float], list[Event]], limit_s: float = 60.0) -> Any:
    """Fake time in steps of 10 ms; answers arrive one step later."""
    now = 0.0
    due: list[Event] = []
    sends = procedure.start(now)
    while procedure.outcome is None and now < limit_s:
        heard, due = due, [event for send in sends for event in answer(send, now)]
        now += 0.01
        sends = [send for event in heard for send in procedure.on_event(event, now)] + procedure.poll(now)
    return procedure.outcome


def test_reading_repeats_until_answered() -> None:
    asked: list[Send] = []

    def deaf_twice(send: Send, now: float) -> list[Event]:
        asked.append(send)
        return [value("OTHER", 1), value("A", 2.5)] if len(asked) == 3 else []

    outcome = run(ReadParameter("A"), deaf_twice)
    assert isinstance(outcome, Done)
    assert outcome.value.value == 2.5
    assert asked == [ParamRead("A")] * 3


def test_reading_what_is_not_there_ends_with_a_reason() -> None:
    silent = run(ReadParameter("NOPE"), lambda send, now: [])
    assert isinstance(silent, Failed)
    assert not silent.answered
    assert "NOPE" in silent.reason
    told = run(ReadParameter("NOPE"), lambda send, now: [ParamError(1, 1, "NOPE", -1, "does not exist")])
    assert isinstance(told, Failed)
    assert told.answered
    assert "does not exist" in told.reason


@pytest.mark.parametrize(
    "procedure", [lambda: ReadParameter("A"), lambda: WriteParameter("A", 2.5)], ids=["read", "write"]
)
def test_thirty_percent_lost_each_way_fails_no_flight(procedure: Callable[[], Any]) -> None:
    """A flight has some sixty such conversations; three hundred make five flights."""
    chance = random.Random(16)

    def lossy(send: Send, now: float) -> list[Event]:
        return [value("A", 2.5)] if chance.random() < 0.7 * 0.7 else []

    assert all(isinstance(run(procedure(), lossy), Done) for _ in range(300))


def test_silence_is_given_up_within_ten_seconds() -> None:
    for procedure in (ReadParameter("A"), WriteParameter("A", 2.5)):
        silent = run(procedure, lambda send, now: [], limit_s=10.0)
        assert isinstance(silent, Failed)


@pytest.mark.parametrize("number", [0.1, -0.0, 1e-42, 3.4e38, 16777215.0, float("inf")])
def test_a_write_is_done_only_by_the_same_32_bits(number: float) -> None:
    sent: list[Send] = []

    def echo(send: Send, now: float) -> list[Event]:
        sent.append(send)
        assert isinstance(send, ParamWrite)
        return [ParamValue(1, 1, name="A", bits=send.bits, kind=9, count=1, index=0)]

    outcome = run(WriteParameter("A", number), echo)
    assert isinstance(outcome, Done)
    assert outcome.value.bits == bits_of_float(number)
    assert sent == [ParamWrite("A", bits_of_float(number), ParameterType.REAL32)]


def test_one_bit_off_is_a_refusal_with_the_vehicles_own_words() -> None:
    held = bits_of_float(0.1) ^ 1

    def stubborn(send: Send, now: float) -> list[Event]:
        return [ParamValue(1, 1, name="A", bits=held, kind=9, count=1, index=0), StatusText(1, 1, 4, "A is read only")]

    outcome = run(WriteParameter("A", 0.1), stubborn)
    assert isinstance(outcome, Failed)
    assert outcome.answered
    assert outcome.reason.endswith("it says: A is read only")


def test_an_acceptance_right_behind_a_refusal_is_the_answer() -> None:
    """The refusal was an earlier order's: answers to two modes that were asked for are not told apart."""

    def acknowledged(result: int) -> CommandAck:
        return CommandAck(1, 1, command=DO_SET_MODE, result=result, target_system=0, target_component=0)

    back = SetMode(0, tries=1)
    back.start(0.0)
    back.on_event(acknowledged(4), 0.10)
    assert back.outcome is None, "the vehicle's own words about it are waited for"
    back.on_event(acknowledged(0), 0.12)
    assert isinstance(back.outcome, Done)


def test_a_late_answer_to_an_earlier_read_is_no_refusal() -> None:
    write = WriteParameter("A", 2.0)
    write.start(0.0)
    assert write.on_event(value("A", 1.0), 0.01) == [ParamRead("A")]
    assert write.outcome is None
    assert write.on_event(value("A", 2.0), 0.02) == []
    assert isinstance(write.outcome, Done)


def test_a_lost_write_behind_a_stale_echo_is_sent_again() -> None:
    write = WriteParameter("A", 2.0)
    write.start(0.0)
    write.on_event(value("A", 1.0), 0.01)
    assert write.on_event(value("A", 1.0), 0.02) == [ParamWrite("A", bits_of_float(2.0), 9)]
    write.on_event(value("A", 2.0), 0.03)
    assert isinstance(write.outcome, Done)


def test_a_write_that_acts_is_never_sent_twice() -> None:
    sent: list[Send] = []

    def deaf(send: Send, now: float) -> list[Event]:
        sent.append(send)
        return []

    outcome = run(WriteParameter("LQR_REVERT", 1.0, repeat=False), deaf)
    assert isinstance(outcome, Failed)
    assert not outcome.answered
    assert sent == [ParamWrite("LQR_REVERT", bits_of_float(1.0), 9)]
    sent.clear()
    run(WriteParameter("LQR_REVERT", 1.0, repeat=False), lambda s, now: sent.append(s) or [value("LQR_REVERT", 0.0)])  # type: ignore[func-returns-value]
    assert [send for send in sent if isinstance(send, ParamWrite)] == [ParamWrite("LQR_REVERT", 0x3F800000, 9)]


def test_bytewise_vehicles_are_asked_for_the_type_and_get_the_integers_bytes() -> None:
    write = WriteParameter("N", -3.0)
    write.on_event(BYTEWISE, 0.0)
    assert write.start(0.0) == [ParamRead("N")]
    assert write.on_event(ParamValue(1, 1, name="N", bits=7, kind=ParameterType.INT32, count=1, index=0), 0.1) == [
        ParamWrite("N", 0xFFFFFFFD, ParameterType.INT32)
    ]
    write.on_event(ParamValue(1, 1, name="N", bits=0xFFFFFFFD, kind=ParameterType.INT32, count=1, index=0), 0.2)
    assert isinstance(write.outcome, Done)
    assert write.outcome.value.value == -3.0


def test_bytewise_refuses_fractions_for_integers_and_c_cast_sends_them() -> None:
    write = WriteParameter("N", 10.7)
    write.on_event(BYTEWISE, 0.0)
    write.start(0.0)
    assert write.on_event(ParamValue(1, 1, name="N", bits=7, kind=ParameterType.INT32, count=1, index=0), 0.1) == []
    assert isinstance(write.outcome, Failed)
    assert "whole number" in write.outcome.reason
    assert WriteParameter("N", 10.7).start(0.0) == [ParamWrite("N", bits_of_float(10.7), 9)]


def test_too_large_for_a_float32_fails_before_anything_is_sent() -> None:
    write = WriteParameter("A", 1e39)
    assert write.start(0.0) == []
    assert isinstance(write.outcome, Failed)


def test_the_list_with_holes_is_filled_by_index() -> None:
    rng = random.Random(4)
    names = [f"P{i}" for i in range(300)]
    requests: list[Send] = []

    def lossy(send: Send, now: float) -> list[Event]:
        requests.append(send)
        match send:
            case ParamList():
                wanted = list(range(300))
            case ParamRead("", index):
                wanted = [index]
            case _:
                raise AssertionError(send)
        answers = [value(names[i], i, 300, i) for i in wanted if rng.random() > 0.3]
        rng.shuffle(answers)
        return [*answers, *answers[:3], value("P1", 1, 300, 65535)]

    outcome = run(ReadAllParameters(), lossy)
    assert isinstance(outcome, Done)
    assert list(outcome.value) == names
    assert [parameter.value for parameter in outcome.value.values()] == list(range(300))
    assert requests.count(ParamList()) == 1


def test_a_count_that_changes_under_way_starts_the_list_again() -> None:
    lists = 0

    def growing(send: Send, now: float) -> list[Event]:
        nonlocal lists
        if isinstance(send, ParamList):
            lists += 1
        if lists == 1:  # the third answer comes after SID_AXIS unhid others: index 2 is another parameter by then
            return [value("A", 1, 3, 0), value("B", 2, 3, 1), value("X", 9, 4, 2)]
        return [value(n, i, 4, i) for i, n in enumerate("ABXC")] if isinstance(send, ParamList) else []

    outcome = run(ReadAllParameters(), growing)
    assert isinstance(outcome, Done)
    assert list(outcome.value) == ["A", "B", "X", "C"]
    assert lists == 2


def test_a_list_that_never_comes_fails() -> None:
    outcome = run(ReadAllParameters(), lambda send, now: [])
    assert isinstance(outcome, Failed)
    assert "none came" in outcome.reason


def test_a_mode_is_set_when_acknowledged_and_repetitions_say_so() -> None:
    attempts: list[int] = []

    def third(send: Send, now: float) -> list[Event]:
        assert isinstance(send, Command)
        assert (send.command, send.parameters) == (176, (1.0, 25.0))
        attempts.append(send.attempt)
        return (
            [CommandAck(1, 1, command=176, result=0, target_system=254, target_component=190)]
            if len(attempts) == 3
            else [CommandAck(1, 1, command=511, result=0, target_system=254, target_component=190)]
        )

    assert isinstance(run(SetMode(25), third), Done)
    assert attempts == [0, 1, 2]


def test_a_refused_mode_waits_for_the_text_that_follows() -> None:
    mode = SetMode(25)
    mode.start(0.0)
    mode.on_event(CommandAck(1, 1, command=176, result=4, target_system=254, target_component=190), 0.1)
    assert mode.poll(0.2) == []
    mode.on_event(StatusText(1, 1, 4, "No axis selected, SID_AXIS = 0"), 0.25)
    mode.poll(0.3)
    assert mode.outcome is None
    mode.on_event(Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=True, mode=0, status=4), 0.5)
    mode.poll(0.5)
    assert isinstance(mode.outcome, Failed)
    assert mode.outcome.reason == "the vehicle refuses mode 25 (failed); it says: No axis selected, SID_AXIS = 0"


def test_the_text_is_waited_for_until_it_was_read() -> None:
    """A busy machine reads on 0.7 s after the refusal, and finds the text; a vehicle that falls silent has no more."""
    refusal = CommandAck(1, 1, command=176, result=4, target_system=254, target_component=190)
    late, silent = SetMode(25), SetMode(25)
    for mode in (late, silent):
        mode.start(0.0)
        mode.on_event(refusal, 0.1)
        mode.poll(0.8)
        assert mode.outcome is None
    late.on_event(StatusText(1, 1, 4, "No axis selected, SID_AXIS = 0"), 0.8)
    late.poll(0.8)
    silent.poll(1.1)
    assert isinstance(late.outcome, Failed)
    assert late.outcome.reason.endswith("it says: No axis selected, SID_AXIS = 0")
    assert isinstance(silent.outcome, Failed)
    assert silent.outcome.reason == "the vehicle refuses mode 25 (failed)"


def test_a_mode_whose_acknowledgement_is_lost_is_believed_to_heartbeats() -> None:
    beat = Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=True, mode=25, status=4)
    assert isinstance(run(SetMode(25), lambda send, now: [beat]), Done)
    assert isinstance(run(SetMode(0), lambda send, now: [beat]), Failed)


def test_the_version_is_the_answer_not_its_acknowledgement() -> None:
    request = RequestAutopilotVersion()
    assert request.start(0.0) == [Command(512, (148.0,), 0)]
    request.on_event(CommandAck(1, 1, command=512, result=0, target_system=254, target_component=190), 0.1)
    assert request.outcome is None
    request.on_event(AutopilotVersion(1, 1, 131072, "4.7.0"), 0.2)
    assert isinstance(request.outcome, Done)
    assert request.outcome.value.version == "4.7.0"


# The receiver of log blocks.


def block(number: int, log: int = 0) -> bytes:
    """A block that differs from log to log, but for the first five: formats are the same in each."""
    seed = number if number < 5 else number + 7919 * log
    return (zlib.crc32(seed.to_bytes(4, "little")).to_bytes(4, "little") * 50)[:200]


@dataclass
class Disk:
    files: dict[int, dict[int, bytes]] = field(default_factory=dict)
    full: bool = False

    def store(self, file: int, number: int, data: bytes) -> bool:
        if self.full:
            return False
        blocks = self.files.setdefault(file, {})
        assert blocks.get(number, data) == data, "something was overwritten"
        blocks[number] = data
        return True

    def whole(self, file: int, count: int, log: int) -> bool:
        return self.files[file] == {n: block(n, log) for n in range(count)}


@dataclass
class Sender:
    """ArduPilot's side in a dozen lines: 350 blocks a second, resent after 100 ms, nacked ones at once."""

    log: int = 0
    made: int = 0
    running: bool = False
    last_ack: float = 0.0
    unacked: dict[int, float] = field(default_factory=dict)
    made_f: float = 0.0

    def hear(self, send: Send, now: float) -> None:
        assert isinstance(send, BlockStatus)
        self.last_ack = now
        if send.number == START_BLOCKS:
            if not self.running:
                self.log, self.made, self.made_f, self.running, self.unacked = self.log + 1, 0, 0.0, True, {}
        elif send.number == STOP_BLOCKS:
            self.running = False
        elif send.kept:
            self.unacked.pop(send.number, None)
        elif send.number in self.unacked:
            self.unacked[send.number] = -1.0

    def say(self, now: float, step: float) -> list[LogBlock]:
        if now - self.last_ack > 10.0:
            self.running, self.unacked = False, {}
        if self.running:
            self.made_f += 350 * step
            while self.made < int(self.made_f):
                self.unacked[self.made] = -1.0
                self.made += 1
        due = [n for n, sent in self.unacked.items() if now - sent > 0.1][:60]
        for number in due:
            self.unacked[number] = now
        return [LogBlock(1, 155, number, block(number, self.log)) for number in due]


@dataclass
class Air:
    """Both directions of a link in fake time, with loss, duplicates, reordering and outages."""

    receiver: LogBlocks
    sender: Sender
    loss: float = 0.0
    duplicates: float = 0.0
    jitter_s: float = 0.0
    outage: tuple[float, float] = (0.0, 0.0)
    now: float = 0.0
    queue: list[tuple[float, int, Any]] = field(default_factory=list)
    rng: random.Random = field(default_factory=lambda: random.Random(11))
    said: int = 0

    def put(self, thing: Any) -> None:
        if self.outage[0] <= self.now < self.outage[1]:
            return
        for _ in range(1 + (self.rng.random() < self.duplicates)):
            if self.rng.random() >= self.loss:
                self.said += 1
                self.queue.append((self.now + 0.005 + self.jitter_s * self.rng.random(), self.said, thing))

    def go(self, until_s: float, step: float = 0.005) -> None:
        while self.now < until_s and self.receiver.outcome is None:
            self.now += step
            arrived = sorted(item for item in self.queue if item[0] <= self.now)
            self.queue = [item for item in self.queue if item[0] > self.now]
            sends: list[Send] = []
            for _, _, thing in arrived:
                if isinstance(thing, Event):
                    sends += self.receiver.on_event(thing, self.now)
                else:
                    self.sender.hear(thing, self.now)
            for item in self.sender.say(self.now, step):
                self.put(item)
            if int(self.now * 10) != int((self.now - step) * 10):
                self.put(Attitude(1, 1, boot_s=self.now, roll=0, pitch=0, yaw=0, p=0, q=0, r=0))
            for send in sends + self.receiver.poll(self.now):
                self.put(send)

    def begin(self) -> None:
        for send in self.receiver.start(self.now):
            self.put(send)

    def end(self) -> tuple[StreamResult, ...]:
        for send in self.receiver.stop(self.now):
            self.put(send)
        self.go(self.now + 60.0)
        assert isinstance(self.receiver.outcome, Done)
        return self.receiver.outcome.value


def test_a_clean_stream_is_acknowledged_block_by_block() -> None:
    disk = Disk()
    air = Air(LogBlocks(disk.store), Sender())
    air.begin()
    air.go(3.0)
    (result,) = air.end()
    assert result.blocks == result.expected == air.sender.made > 1000
    assert result.missing == ()
    assert disk.whole(0, result.blocks, 1)


@pytest.mark.parametrize("loss", [0.02, 0.3])
def test_loss_duplicates_and_reordering_leave_no_gap(loss: float) -> None:
    disk = Disk()
    air = Air(LogBlocks(disk.store), Sender(), loss, 0.05, 0.03)
    air.begin()
    air.go(6.0)
    (result,) = air.end()
    assert result.missing == ()
    assert result.duplicates > 0
    assert disk.whole(0, air.sender.made, 1)
    assert result.blocks == air.sender.made > 500


def test_an_outage_shorter_than_the_senders_patience_leaves_no_gap() -> None:
    disk = Disk()
    air = Air(LogBlocks(disk.store), Sender(), 0.02, outage=(2.0, 7.0))
    air.begin()
    air.go(12.0)
    (result,) = air.end()
    assert result.missing == ()
    assert disk.whole(0, air.sender.made, 1)


def test_after_a_dropped_stream_a_new_log_goes_into_a_new_file() -> None:
    disk = Disk()
    air = Air(LogBlocks(disk.store), Sender(), outage=(2.0, 16.0))
    air.begin()
    air.go(24.0)
    first, second = air.end()
    assert (first.file, second.file) == (0, 1)
    assert disk.whole(0, first.blocks, 1)
    assert disk.whole(1, air.sender.made, 2)
    assert second.missing == ()


def test_a_reboot_seen_by_the_clock_begins_a_new_file_at_once() -> None:
    disk = Disk()
    air = Air(LogBlocks(disk.store), Sender())
    air.begin()
    air.go(3.0)
    made = air.sender.made
    air.sender.running, air.sender.unacked = False, {}
    air.go(3.5)
    for send in air.receiver.on_event(Attitude(1, 1, boot_s=0.2, roll=0, pitch=0, yaw=0, p=0, q=0, r=0), air.now):
        air.put(send)
    air.go(5.0)
    results = air.end()
    assert [result.missing for result in results] == [(), ()]
    assert disk.whole(0, made, 1)
    assert disk.whole(1, air.sender.made, 2)


def test_numbers_that_restart_without_warning_begin_a_new_file_with_the_formats() -> None:
    disk = Disk()
    receiver = LogBlocks(disk.store)
    receiver.start(0.0)
    for number in range(50):
        receiver.on_event(LogBlock(1, 155, number, block(number, 1)), 0.1)
    acknowledged = []
    for number in range(40):  # the first five are equal: they can only be told later
        acknowledged += receiver.on_event(LogBlock(1, 155, number, block(number, 2)), 0.2)
    assert acknowledged == [BlockStatus(number, True) for number in range(40)]
    assert disk.whole(0, 50, 1)
    assert disk.whole(1, 40, 2)
    assert receiver.open == 0


def test_blocks_of_the_log_before_that_come_late_are_not_taken_into_the_new_one() -> None:
    disk = Disk()
    receiver = LogBlocks(disk.store)
    receiver.start(0.0)
    for number in range(3000):
        receiver.on_event(LogBlock(1, 155, number, block(number, 1)), 0.1)
    for number in range(40):
        receiver.on_event(LogBlock(1, 155, number, block(number, 2)), 0.2)
    for late in (2_970, 2_971, 3_001, 2_300, 1_500):
        assert receiver.on_event(LogBlock(1, 155, late, block(late, 1)), 0.3) == []
    for number in range(40, 60):
        receiver.on_event(LogBlock(1, 155, number, block(number, 2)), 0.4)
    assert disk.whole(1, 60, 2)
    assert receiver.open == 0
    receiver.on_event(LogBlock(1, 155, 1_500, block(1_500, 2)), 30.0)  # long after: an outage of this log
    assert receiver.open == 1_440


def test_what_came_twice_of_the_log_before_is_not_taken_for_formats_of_the_new_one() -> None:
    disk = Disk()
    receiver = LogBlocks(disk.store)
    receiver.start(0.0)
    for number in range(50):
        receiver.on_event(LogBlock(1, 155, number, block(number, 1)), 0.1)
    for twice in (2, 45):  # a format, and not one: beyond the first that differs
        receiver.on_event(LogBlock(1, 155, twice, block(twice, 1)), 0.2)
    for number in range(10, 20):
        receiver.on_event(LogBlock(1, 155, number, block(number, 2)), 0.3)
    for number in range(20, 50):
        receiver.on_event(LogBlock(1, 155, number, block(number, 2)), 0.4)
    assert receiver.file == 1
    assert disk.files[1][45] == block(45, 2)
    assert disk.files[1][2] == block(2, 2)


def test_one_block_with_other_bytes_is_counted_and_begins_no_new_file() -> None:
    """Damaged past its checksum, or forged: the log goes on, and the sender is not kept asking."""
    disk = Disk()
    receiver = LogBlocks(disk.store)
    receiver.start(0.0)
    for number in range(50):
        receiver.on_event(LogBlock(1, 155, number, block(number, 1)), 0.1)
    for other in (7, 30, 31):
        assert receiver.on_event(LogBlock(1, 155, other, block(other, 2)), 0.2) == []
    said = receiver.on_event(LogBlock(1, 155, 50, block(50, 1)), 0.3)
    assert sorted(send.number for send in said if isinstance(send, BlockStatus) and send.kept) == [7, 30, 31, 50]
    for number in range(51, 60):
        receiver.on_event(LogBlock(1, 155, number, block(number, 1)), 0.4)
    receiver.on_event(LogBlock(1, 155, 7, block(7, 2)), 0.5)
    receiver.on_event(LogBlock(1, 155, 60, block(60, 1)), 0.5)
    (result,) = receiver.results(1.0)
    assert disk.whole(0, 61, 1)
    assert (result.blocks, result.missing, result.in_two_versions) == (61, (), 3)


def test_an_absurd_number_alone_makes_no_gap_and_two_beside_each_other_are_an_outage() -> None:
    disk = Disk()
    receiver = LogBlocks(disk.store)
    receiver.start(0.0)
    for number in range(50):
        receiver.on_event(LogBlock(1, 155, number, block(number, 1)), 0.1)
    for absurd in (60_000, 40_000, 90_000, 99_999_999, 20_000):
        assert receiver.on_event(LogBlock(1, 155, absurd, block(absurd, 1)), 0.2) == []
    assert receiver.on_event(LogBlock(1, 155, 50, block(50, 1)), 0.3) == [BlockStatus(50, True)]
    (result,) = receiver.results(1.0)
    assert (result.expected, result.missing, result.impossible) == (51, (), 5)
    for far in (2_900, 2_901):
        receiver.on_event(LogBlock(1, 155, far, block(far, 1)), 1.0)
    (result,) = receiver.results(1.0)
    assert (result.expected, result.missing) == (2_902, ((51, 2_900),))


def test_start_waits_for_a_late_link_before_it_is_said_again() -> None:
    """A vehicle that hears it twice begins its log twice."""
    receiver = LogBlocks(Disk().store, lag_s=lambda: 1.0)
    said = receiver.start(0.0)
    for i in range(1, 240):
        said += receiver.poll(i * 0.01)
    assert said == [BlockStatus(START_BLOCKS, True)]
    assert receiver.poll(2.51) == [BlockStatus(START_BLOCKS, True)]


def test_start_is_repeated_until_the_first_block_and_not_after() -> None:
    receiver = LogBlocks(Disk().store)
    start = BlockStatus(START_BLOCKS, True)
    said = receiver.start(0.0)
    for i in range(1, 350):
        said += receiver.poll(i * 0.01)
    assert said == [start] * 4
    receiver.on_event(LogBlock(1, 155, 0, block(0)), 3.5)
    later = [send for i in range(350, 900) for send in receiver.poll(i * 0.01)]
    assert start not in later


def test_a_full_disk_acknowledges_nothing_and_recovers() -> None:
    disk = Disk()
    air = Air(LogBlocks(disk.store), Sender())
    air.begin()
    air.go(1.0)
    disk.full = True
    kept = air.receiver.received
    air.go(2.0)
    assert air.receiver.received == kept
    assert air.receiver.open > 0
    disk.full = False
    air.go(4.0)
    (result,) = air.end()
    assert result.missing == ()
    assert disk.whole(0, air.sender.made, 1)


def test_blocks_that_the_sender_lost_are_asked_for_to_the_end_and_then_reported() -> None:
    disk = Disk()
    receiver = LogBlocks(disk.store)
    receiver.start(0.0)
    for number in (0, 1, 2, 5, 6, 9):
        receiver.on_event(LogBlock(1, 155, number, block(number)), 0.1)
    asked = [(i * 0.1, send) for i in range(2, 100) for send in receiver.poll(i * 0.1)]
    nacked = {send.number for _, send in asked if isinstance(send, BlockStatus) and not send.kept}
    assert nacked == {3, 4, 7, 8}
    assert max(when for when, _ in asked) > 5.0
    receiver.stop(10.0)
    for i in range(1000):
        receiver.on_event(Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=True, mode=0, status=4), 10.0 + i * 0.1)
        receiver.poll(10.0 + i * 0.1)
    assert isinstance(receiver.outcome, Done)
    (result,) = receiver.outcome.value
    assert result.missing == ((3, 4), (7, 8))


def test_numbers_that_cannot_be_are_ignored() -> None:
    receiver = LogBlocks(Disk().store)
    receiver.start(0.0)
    for number in (2000, 2**31, START_BLOCKS, STOP_BLOCKS, 2**32 - 1):
        assert receiver.on_event(LogBlock(1, 155, number, block(0)), 0.1) == []
    receiver.on_event(LogBlock(1, 155, 0, block(0)), 0.2)
    assert receiver.on_event(LogBlock(1, 155, 2**30, block(0)), 0.3) == []
    assert (receiver.received, receiver.open) == (1, 0)
