"""A vehicle that streams its log is armed only while somebody answers it: ours does, and a recording stays whole.

The vehicle's half is ArduPilot's AP_Logger_MAVLink: START is heard only while it sends to nobody, and begins the log
anew with block 0; STOP ends it at once; a receipt of anybody frees a block; 10 s without one end the stream.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.flight.session import Session
from gcs.link.clock import LinkClock
from gcs.link.encode import Ping
from gcs.link.events import TimeReply
from gcs.link.log_answer import LogAnswer, LogClient

START, STOP = 2147483646, 2147483645
FORMATS = b"formats of the log".ljust(200, b"-")


class Logging:
    """The log of a scripted vehicle, as ArduPilot streams it: a block every 10 ms."""

    def __init__(self, vehicle: Any, fake_time: Any) -> None:
        self.vehicle, self.time = vehicle, fake_time
        self.client: tuple[int, int] | None = None
        self.number = 0
        self.stamp = 0
        """Over all logs: no block but the first is like another."""
        self.held: dict[int, tuple[float, bytes]] = {}
        self.received_at = 0.0
        self.starts = 0
        self.receipts_of: set[int] = set()
        vehicle._block_status = self.hear
        vehicle._send_blocks = self.send

    @property
    def armable(self) -> bool:
        """Or `PreArm: Logging failed`."""
        return self.client is not None

    def begin(self, client: tuple[int, int]) -> None:
        self.client, self.number, self.received_at = client, 0, self.time.now()
        self.held.clear()

    def hear(self, m: Any) -> None:
        self.receipts_of.add(m.get_srcSystem())
        if m.seqno == STOP:
            self.client = None
        elif m.seqno == START:
            self.starts += 1
            if self.client is None:
                self.begin((m.get_srcSystem(), m.get_srcComponent()))
        elif m.status == 1 and m.seqno in self.held:
            del self.held[m.seqno]
            self.received_at = self.time.now()
        elif m.seqno in self.held:
            self.held[m.seqno] = (0.0, self.held[m.seqno][1])

    def send(self, now: float) -> None:
        if self.client is None:
            return
        if now - self.received_at > 10.0:
            self.client = None
            return
        if len(self.held) < 60:
            self.stamp += 1
            data = FORMATS if self.number == 0 else f"sample {self.stamp}".encode().ljust(200, b".")
            self.held[self.number] = (0.0, data)
            self.number += 1
        for number, (sent, data) in list(self.held.items()):
            if now - sent > 0.1:
                self.held[number] = (now, data)
                self.say(number, data)

    def say(self, number: int, data: bytes) -> None:
        assert self.client is not None
        message = mavlink.MAVLink_remote_log_data_block_message(*self.client, number, list(data))
        self.vehicle.say(message, self.vehicle.log_mav)


@pytest.fixture
def log(vehicle: Any, fake_time: Any) -> Logging:
    return Logging(vehicle, fake_time)


@pytest.fixture
def session(connect: Callable[..., Session], log: Logging) -> Iterator[Session]:
    with connect() as opened:
        yield opened


def passes(fake_time: Any, seconds: float) -> None:
    end = fake_time.now() + seconds
    while fake_time.now() < end:
        fake_time.pass_by()


def client(session: Session) -> LogClient:
    return session.snapshot().log_client


def test_without_being_told_to_nothing_is_answered(session: Session, log: Logging, fake_time: Any) -> None:
    passes(fake_time, 5.0)
    assert (log.starts, log.armable, client(session)) == (0, False, LogClient.NOBODY)


def test_a_disarmed_vehicle_s_log_is_answered_until_it_flies_and_longer(
    session: Session, log: Logging, vehicle: Any, fake_time: Any
) -> None:
    session.answer_log()
    passes(fake_time, 12.0)
    assert log.armable
    assert client(session) is LogClient.OURS
    assert log.starts == 1
    assert len(log.held) < 5, "acknowledged"
    vehicle.armed = True
    passes(fake_time, 12.0)
    assert log.armable
    session.close()
    assert log.client is None, "the vehicle sends it to nobody who is gone"


def test_an_armed_vehicle_needs_no_answer_unless_it_is_measured(
    session: Session, log: Logging, vehicle: Any, fake_time: Any
) -> None:
    vehicle.armed = True
    passes(fake_time, 1.0)
    session.answer_log()
    passes(fake_time, 5.0)
    assert log.starts == 0
    assert session.answered_rate() is None


def test_what_the_link_carries_is_counted(session: Session, log: Logging, vehicle: Any, fake_time: Any) -> None:
    vehicle.armed = True
    session.answer_log(at_once=True)
    passes(fake_time, 4.0)
    rate = session.answered_rate()
    assert rate is not None
    assert rate.carried == pytest.approx(20_000, rel=0.1)  # 100 blocks of 200 bytes a second
    assert rate.numbered == pytest.approx(rate.carried, rel=0.05)


def test_a_recording_that_begins_while_it_is_answered_begins_with_the_formats(
    session: Session, log: Logging, vehicle: Any, fake_time: Any, tmp_path: Path
) -> None:
    session.answer_log()
    passes(fake_time, 10.0)
    session.start_recording(tmp_path)
    passes(fake_time, 5.0)
    assert client(session) is LogClient.NOBODY
    summary = session.stop_recording()
    (recorded,) = summary.logs
    data = (tmp_path / "flight.BIN").read_bytes()
    stamps = [int(data[n : n + 200].rstrip(b".").split()[1]) for n in range(200, len(data), 200)]
    assert data[:200] == FORMATS
    assert recorded.missing_blocks == 0
    assert len(stamps) > 300
    assert stamps == list(range(stamps[0], stamps[0] + len(stamps))), "nothing of the log before it"


def test_a_stop_that_is_lost_and_blocks_under_way_do_no_harm(
    session: Session, log: Logging, vehicle: Any, fake_time: Any, tmp_path: Path
) -> None:
    session.answer_log()
    passes(fake_time, 0.5)
    assert 20 < log.number < 60, "so few that a straggler could pass for a block of the next log"
    lost = iter([True, True])
    vehicle.deaf = lambda m: m.get_type() == "REMOTE_LOG_BLOCK_STATUS" and m.seqno == STOP and next(lost, False)
    session.start_recording(tmp_path)
    passes(fake_time, 3.0)
    summary = session.stop_recording()
    data = (tmp_path / "flight.BIN").read_bytes()
    assert data[:200] == FORMATS
    assert [stream.missing_blocks for stream in summary.logs] == [0]


def test_after_a_recording_it_is_answered_again_on_the_ground(
    session: Session, log: Logging, vehicle: Any, fake_time: Any, tmp_path: Path
) -> None:
    session.answer_log()
    passes(fake_time, 2.0)
    vehicle.armed = True
    session.start_recording(tmp_path)
    passes(fake_time, 2.0)
    session.stop_recording()
    passes(fake_time, 5.0)
    assert not log.armable
    vehicle.armed = False
    passes(fake_time, 3.0)
    assert log.armable
    assert client(session) is LogClient.OURS


def test_another_client_that_is_there_is_left_alone(
    session: Session, log: Logging, vehicle: Any, fake_time: Any
) -> None:
    log.begin((255, 230))
    passes(fake_time, 0.5)
    session.answer_log()
    passes(fake_time, 1.0)
    assert client(session) is LogClient.ANOTHER
    assert log.receipts_of <= {254}
    assert len(log.held) == 60, "no block of another's was acknowledged"


def test_a_client_that_takes_over_silences_ours_and_its_leaving_is_seen(
    session: Session, log: Logging, vehicle: Any, fake_time: Any
) -> None:
    session.answer_log()
    passes(fake_time, 3.0)
    log.begin((255, 230))
    passes(fake_time, 1.0)
    assert client(session) is LogClient.ANOTHER
    before = len(vehicle.heard)
    passes(fake_time, 5.0)
    said = [m for m in vehicle.heard[before:] if m.get_type() == "REMOTE_LOG_BLOCK_STATUS"]
    assert said == []
    passes(fake_time, 25.0)  # nobody acknowledges: the vehicle gives it up, and 10 s later ours begins
    assert client(session) is LogClient.OURS
    assert log.armable


def test_a_station_s_receipt_is_a_client_too(session: Session, vehicle: Any, fake_time: Any) -> None:
    session.answer_log()
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=230)
    vehicle.say(mavlink.MAVLink_remote_log_block_status_message(1, 1, 12, 1), station)
    passes(fake_time, 0.1)
    assert client(session) is LogClient.ANOTHER


def test_a_vehicle_that_boots_again_is_asked_again(session: Session, log: Logging, fake_time: Any) -> None:
    session.answer_log()
    passes(fake_time, 3.0)
    log.client = None
    log.held.clear()
    passes(fake_time, 6.0)
    assert log.armable
    assert client(session) is LogClient.OURS


def test_a_link_that_the_log_makes_late_is_freed_of_it() -> None:
    answer, link = LogAnswer((254, 190)), LinkClock()
    answer.poll(0.0, False, link)
    assert answer.client is LogClient.ASKED
    (ping,) = link.poll(0.0)
    assert isinstance(ping, Ping)
    link.on_event(TimeReply(1, 1, ping.nonce, 50.0), 0.02)
    for tick in range(30):
        answer.poll(0.1 * tick, False, link)
    assert answer.client is LogClient.ASKED
    for tick in range(30, 80):  # nothing was answered any more
        answer.poll(0.1 * tick, False, link)
    assert answer.client is LogClient.SHED
    answer.restart()
    assert answer.poll(100.0, False, link) == []


def test_a_recording_that_another_client_takes_over_keeps_what_it_hears_and_names_it(
    session: Session, log: Logging, vehicle: Any, fake_time: Any, tmp_path: Path
) -> None:
    session.answer_log()
    passes(fake_time, 2.0)
    session.start_recording(tmp_path)
    passes(fake_time, 4.0)
    health = session.log_health()
    assert health is not None
    assert not health.another
    log.begin((255, 230))
    passes(fake_time, 2.0)
    health = session.log_health()
    assert health is not None
    assert health.another
    assert (health.file, health.blocks) == (1, 60), "kept, in a file of its own"
    assert len(log.held) == 60, "and left to the other to acknowledge"
