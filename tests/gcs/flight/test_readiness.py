"""What `tippath check` finds with vehicles as strangers set them, and what it proposes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from fake_flight import FakeSession, FakeVehicle

from gcs.cards.maneuver import Maneuver, TestCard, load_card, single_card
from gcs.flight.readiness import Readiness, answer_where_needed, look
from gcs.flight.readiness_words import document, page, parameter_file
from gcs.link.log_answer import AnsweredRate, LogClient
from gcs.vehicle.readiness import Item, Standing

UDP, RADIO = "udpin:0.0.0.0:14550", "/dev/ttyUSB0,57600"
CARD = single_card(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0))
STOCK = {  # a helicopter of ArduCopter 4.7 as it comes
    "LOG_BACKEND_TYPE": 1.0,
    "LOG_BITMASK": 180222.0,
    "LOG_MAV_BUFSIZE": 8.0,
    "LOG_DISARMED": 0.0,
    "SCHED_LOOP_RATE": 400.0,
    "INS_GYRO_FILTER": 20.0,
    "ARMING_CHECK": 1.0,
    "FS_GCS_ENABLE": 0.0,
    "FS_OPTIONS": 16.0,
    "FS_THR_ENABLE": 1.0,
}
FULL = 180223.0
"""LOG_BITMASK with bit 0."""


@pytest.fixture
def vehicle() -> FakeVehicle:
    """On the ground, disarmed, as it comes."""
    made = FakeVehicle()
    for name in [name for name in made.parameters if name.startswith("SIDX_")]:
        del made.parameters[name]
    made.parameters |= STOCK
    made.armed, made.status = False, 3
    made._beat()
    return made


def checked(vehicle: FakeVehicle, link: str = UDP, card: TestCard = CARD, **more: Any) -> Readiness:
    session = more.pop("session", None) or FakeSession(vehicle)
    return look(session, session, card, link=link, **more)


def item(found: Readiness, name: str) -> Item:
    (one,) = [item for item in found.items if item.name == name]
    return one


def test_a_stock_vehicle_is_ready_for_a_card_whose_log_stays_on_board(vehicle: FakeVehicle) -> None:
    found = checked(vehicle)
    assert (found.ready, found.stream, found.changes, found.restart) == (True, False, {}, False)
    assert "tippath sweep --log card" in item(found, "LOG_BACKEND_TYPE").words
    mask = item(found, "LOG_BITMASK")
    assert mask.standing is Standing.BETTER  # 100 Hz serves a sweep to 10 Hz, at a cost that is said
    assert "100 Hz" in mask.value
    assert "2.0 times as wide" in mask.words
    assert found.better["LOG_BITMASK"] == FULL
    assert item(found, "mode").value == "Stabilize, disarmed"
    assert "arms and takes off" in item(found, "mode").words
    assert "11 ms" in item(found, "INS_GYRO_FILTER").words


def test_the_stream_needs_its_backend_and_a_restart(vehicle: FakeVehicle) -> None:
    found = checked(vehicle, stream=True)
    assert not found.ready
    assert found.changes == {"LOG_BACKEND_TYPE": 3.0}
    assert found.restart
    assert "while a log client answers" in item(found, "LOG_BACKEND_TYPE").words


def test_the_fast_log_needs_a_buffer_that_holds_it(vehicle: FakeVehicle) -> None:
    vehicle.parameters |= {"LOG_BACKEND_TYPE": 3.0, "LOG_BITMASK": FULL}
    found = checked(vehicle)
    assert found.stream
    assert found.changes == {"LOG_MAV_BUFSIZE": 50.0}
    assert "DMS.Dp" in item(found, "LOG_MAV_BUFSIZE").words
    vehicle.parameters["LOG_MAV_BUFSIZE"] = 50.0
    assert checked(vehicle).ready
    vehicle.parameters["LOG_MAV_BUFSIZE"] = 64.0  # above 53 ArduPilot's count of blocks overflows
    assert checked(vehicle).changes == {"LOG_MAV_BUFSIZE": 50.0}


def test_a_log_too_thin_for_the_sweep_must_be_changed(vehicle: FakeVehicle) -> None:
    vehicle.parameters["LOG_BITMASK"] = 180220.0  # neither bit: 50 Hz
    found = checked(vehicle)
    assert found.changes == {"LOG_BITMASK": FULL}
    gentle = replace(CARD.maneuvers[0], f_stop_hz=5.0)
    assert checked(vehicle, card=single_card(gentle)).changes == {}, "50 Hz serve a sweep to 5 Hz"


def test_a_radio_takes_the_log_from_the_card(vehicle: FakeVehicle) -> None:
    vehicle.parameters |= {"LOG_BACKEND_TYPE": 3.0, "LOG_BITMASK": FULL, "LOG_MAV_BUFSIZE": 50.0}
    session = FakeSession(vehicle)
    found = checked(vehicle, RADIO, session=session)
    assert not found.stream
    assert found.changes == {"LOG_BACKEND_TYPE": 1.0}
    assert "5.8 kB/s" in item(found, "link").value
    assert "285 kB/s" in item(found, "link").words
    assert "tippath sweep --log card" in item(found, "LOG_BACKEND_TYPE").words
    assert session.answered == [], "its log would fill the line"
    vehicle.parameters["LOG_BACKEND_TYPE"] = 1.0
    assert checked(vehicle, RADIO).ready
    assert not checked(vehicle, RADIO, stream=True).ready


def test_a_network_that_loses_the_log_is_counted(vehicle: FakeVehicle) -> None:
    vehicle.parameters["LOG_BACKEND_TYPE"] = 3.0
    session = FakeSession(vehicle)
    session.rate = AnsweredRate(over_s=3.0, carried=20_000.0, numbered=70_000.0)
    found = checked(vehicle, session=session)
    assert session.answered == [True]
    assert item(found, "link").standing is Standing.MUST
    assert "20 of 70 kB/s" in item(found, "link").value
    session.rate = AnsweredRate(over_s=3.0, carried=70_000.0, numbered=70_000.0)
    assert item(checked(vehicle, session=session), "link").standing is Standing.FINE


def test_another_log_client_stands_against_a_stream(vehicle: FakeVehicle) -> None:
    vehicle.parameters["LOG_BACKEND_TYPE"] = 3.0
    session = FakeSession(vehicle)
    session.log_client = LogClient.ANOTHER
    found = checked(vehicle, session=session)
    assert item(found, "log").standing is Standing.MUST
    assert "stays silent" in item(found, "log").words


def test_a_lost_link_and_what_was_left_ready_are_told(vehicle: FakeVehicle) -> None:
    vehicle.parameters |= {"SID_AXIS": 10.0, "SID_MAGNITUDE": 15.0}
    found = checked(vehicle)
    assert "does NOT stop" in item(found, "lost link").value
    assert found.better["FS_GCS_ENABLE"] == 1.0
    assert found.better["FS_OPTIONS"] == 0.0
    assert item(found, "SID_AXIS").standing is Standing.BETTER
    assert found.ready, "nothing of it forbids a card"


def test_a_vehicle_without_the_mode_says_so_and_all_else_with_it(vehicle: FakeVehicle) -> None:
    for name in [name for name in vehicle.parameters if name.startswith("SID_")]:
        del vehicle.parameters[name]
    vehicle.parameters["LOG_BACKEND_TYPE"] = 2.0
    vehicle.status = 5
    vehicle._beat()
    found = checked(vehicle, RADIO)
    wrong = {item.name for item in found.items if item.standing is Standing.MUST}
    assert wrong == {"vehicle", "LOG_BACKEND_TYPE", "state"}
    assert "SystemID mode" in item(found, "vehicle").words
    assert "failsafe" in item(found, "state").words
    assert found.items[0].name == "LOG_BACKEND_TYPE", "the log comes first"


def test_a_card_that_it_cannot_fly_is_told(vehicle: FakeVehicle) -> None:
    found = checked(vehicle, card=load_card("hover"))
    assert "doublet" in item(found, "card").words
    assert not found.ready


def test_answers_that_are_lost_are_no_lack(vehicle: FakeVehicle) -> None:
    session = FakeSession(vehicle)
    session.drop_answers = {"LOG_BACKEND_TYPE": 5, "SID_AXIS": 3}
    found = checked(vehicle, session=session)
    assert item(found, "LOG_BACKEND_TYPE").value == "1"
    assert found.ready


def test_a_vehicle_that_hears_nothing_is_not_asked(vehicle: FakeVehicle) -> None:
    session = FakeSession(vehicle)
    session.lag_s, session.one_way = None, True
    found = checked(vehicle, session=session)
    assert not found.ready
    assert "one way only" in item(found, "lag").words
    assert session.calls == 0


def test_the_page_and_the_file(vehicle: FakeVehicle) -> None:
    vehicle.parameters |= {"LOG_BACKEND_TYPE": 3.0, "LOG_BITMASK": 180220.0}
    found = checked(vehicle, RADIO)
    lines = page(found)
    assert all(len(line) <= 78 for line in lines)
    assert lines[2] == " must be changed"
    assert "LOG_BACKEND_TYPE" in lines[3]
    text = parameter_file(found)
    settings = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    assert settings == [["LOG_BACKEND_TYPE", "1"], ["LOG_BITMASK", "180223"]]
    assert "#FS_GCS_ENABLE,1" in text.splitlines()
    assert all(len(line) <= 78 for line in text.splitlines())
    about = document(found, "x.param")
    assert about["ready"] is False
    assert about["reason"].startswith("2 things must be changed")
    assert {item["name"] for item in about["items"]} >= {"battery", "rotor speed", "mode", "lag", "lost link"}


def test_only_a_vehicle_that_streams_its_log_over_a_link_that_carries_it_is_answered(vehicle: FakeVehicle) -> None:
    session = FakeSession(vehicle)
    assert not answer_where_needed(session, session, UDP)
    vehicle.parameters["LOG_BACKEND_TYPE"] = 3.0
    assert not answer_where_needed(session, session, RADIO)
    assert session.answered == []
    assert answer_where_needed(session, session, UDP)
    assert session.answered == [False]
