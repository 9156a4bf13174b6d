"""What a link's clock claims: lag, and what has certainly reached the vehicle; withheld where nothing shows it."""

from __future__ import annotations

import math

import pytest

from gcs.link.clock import PING_EVERY_S, SWAP_S, LinkClock
from gcs.link.decode import decode
from gcs.link.encode import Encoder, Ping
from gcs.link.events import Attitude, TimeReply

OFFSET = 1000.0
"""The session's clock less the vehicle's."""


def attitude(boot_s: float) -> Attitude:
    return Attitude(1, 1, boot_s=boot_s, roll=0.0, pitch=0.0, yaw=0.0, p=0.0, q=0.0, r=0.0)


class Line:
    """Pings up and stamps down, each way late by so much, in order."""

    def __init__(self, up_s: float = 0.0, down_s: float = 0.0) -> None:
        self.clock = LinkClock()
        self.up_s, self.down_s = up_s, down_s
        self.deaf = False
        self.now = OFFSET
        self.coming: list[tuple[float, TimeReply | Attitude]] = []

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.now += 0.05
            for send in self.clock.poll(self.now):
                assert isinstance(send, Ping)
                if not self.deaf:
                    arrived = self.now + self.up_s
                    self.coming.append((arrived + self.down_s, TimeReply(1, 1, send.nonce, arrived - OFFSET)))
            self.coming.append((self.now + self.down_s, attitude(self.now - OFFSET)))
            due = sorted((entry for entry in self.coming if entry[0] <= self.now), key=lambda entry: entry[0])
            self.coming = [entry for entry in self.coming if entry[0] > self.now]
            for _, event in due:
                self.clock.on_event(event, self.now)


def test_nothing_is_claimed_before_the_first_answer() -> None:
    line = Line()
    line.deaf = True
    line.run(5.0)
    assert line.clock.lag_s is None
    assert line.clock.stamp_age_s(line.now) is None
    assert line.clock.known_s == -math.inf


@pytest.mark.parametrize(("up_s", "down_s"), [(0.0, 0.0), (0.3, 0.1), (3.5, 3.5), (0.1, 5.0), (5.0, 0.1)])
def test_the_lag_is_never_told_below_half_the_round_trip(up_s: float, down_s: float) -> None:
    line = Line(up_s, down_s)
    line.run(20.0)
    lag_s = line.clock.lag_s
    assert lag_s is not None
    assert 0.5 * (up_s + down_s) - 0.06 <= lag_s <= max(up_s, down_s) + 0.11


@pytest.mark.parametrize("way", ["up_s", "down_s"])
def test_a_lag_that_begins_later_is_seen_with_its_size(way: str) -> None:
    line = Line()
    line.run(5.0)
    assert line.clock.lag_s == pytest.approx(0.0, abs=0.06)
    setattr(line, way, 2.0)
    line.run(6.0)
    assert line.clock.lag_s == pytest.approx(2.0, abs=0.11)


def test_what_was_sent_is_known_to_have_arrived_only_after_a_later_stamp() -> None:
    line = Line(0.1, 0.1)
    line.run(5.0)
    margin = line.now - line.clock.known_s
    assert 2 * SWAP_S + 0.2 <= margin <= 2 * SWAP_S + 0.2 + 2 * PING_EVERY_S + 0.15
    line.deaf = True  # pings no longer arrive, stamps still come
    known_s = line.clock.known_s
    line.run(10.0)
    assert line.clock.known_s <= known_s + 2.0
    assert line.now - line.clock.answered_s > 9.0


def test_an_answer_alone_proves_nothing_yet() -> None:
    clock = LinkClock()
    (ping,) = clock.poll(10.0)
    assert isinstance(ping, Ping)
    clock.on_event(TimeReply(1, 1, ping.nonce, 3.0), 10.1)
    assert clock.known_s == -math.inf, "a message stamped before it may still be on its way"
    clock.on_event(attitude(3.0 + SWAP_S - 0.01), 10.6)
    assert clock.known_s == -math.inf
    clock.on_event(attitude(3.0 + SWAP_S), 10.7)
    assert clock.known_s == pytest.approx(10.0 - SWAP_S)


def test_old_repeated_and_foreign_answers_change_nothing() -> None:
    clock = LinkClock()
    (ping,) = clock.poll(10.0)
    assert isinstance(ping, Ping)
    clock.on_event(TimeReply(1, 1, ping.nonce + 1, 9.0), 10.1)
    clock.on_event(TimeReply(1, 1, ping.nonce, math.nan), 10.1)
    assert clock.lag_s is None
    (again,) = clock.poll(10.3)
    assert isinstance(again, Ping)
    clock.on_event(TimeReply(1, 1, again.nonce, 3.0), 10.4)
    clock.on_event(TimeReply(1, 1, again.nonce, 50.0), 12.0)
    assert clock.lag_s == pytest.approx(0.05)
    assert clock.stamp_age_s(10.4) == pytest.approx(0.1), "at most: the ping may have arrived at once"


def test_a_stamp_from_the_future_is_of_another_clock() -> None:
    """The last words of before a reboot, swapped with the first of after it."""
    clock = LinkClock()
    (ping,) = clock.poll(10.0)
    assert isinstance(ping, Ping)
    clock.on_event(TimeReply(1, 1, ping.nonce, 0.1), 15.0)
    assert clock.stamp_age_s(15.0) == pytest.approx(5.0)
    clock.on_event(attitude(106.0), 15.1)
    assert clock.stamp_age_s(15.1) is None, "not known rather than new"


def test_a_vehicle_that_restarts_is_measured_anew_and_what_was_known_stays_known() -> None:
    line = Line()
    line.run(5.0)
    known_s = line.clock.known_s
    line.clock.on_event(attitude(0.1), line.now)
    assert line.clock.restarts == 1
    assert line.clock.lag_s is None
    assert line.clock.known_s == known_s


def test_pings_travel_as_timesync_and_only_answers_are_heard() -> None:
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    parser, vehicle = mavlink.MAVLink(None), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    (asked,) = parser.parse_buffer(Encoder(254).encode(Ping(123456789)))
    assert (asked.get_type(), asked.tc1, asked.ts1) == ("TIMESYNC", 0, 123456789)

    def heard(tc1: int) -> object:
        (message,) = parser.parse_buffer(mavlink.MAVLink_timesync_message(tc1, 123456789).pack(vehicle))
        return decode(message)

    assert heard(2_500_000_000) == TimeReply(1, 1, 123456789, 2.5)
    assert heard(0) is None
    assert heard(-5) is None
