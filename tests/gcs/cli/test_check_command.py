"""`tippath check` and `tippath sweep --wait`: what they print and how they end, before a vehicle in fake time."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest
from fake_flight import FakeSession, FakeVehicle

import gcs.flight.connection
import gcs.flight.prepare  # loaded before its clock is replaced, or it would keep that one for good
import gcs.flight.session
import gcs.flight.sweep
from gcs.cards.maneuver import Maneuver, single_card
from gcs.cli import main
from gcs.flight.flyable import require_flyable, wait_for_pilot
from gcs.link.log_answer import LogClient

LINK = "udpin:127.0.0.1:1"
CARD = single_card(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0))


@pytest.fixture
def vehicle(monkeypatch: pytest.MonkeyPatch) -> FakeVehicle:
    made = FakeVehicle()
    session = FakeSession(made)
    monkeypatch.setattr(gcs.flight.session.Session, "open", lambda link, **more: contextlib.nullcontext(session))
    monkeypatch.setattr(gcs.flight.connection, "WallClock", lambda: session)
    made.armed, made.status = False, 3
    made._beat()
    return made


def test_a_vehicle_that_is_ready_is_0_and_one_page(vehicle: FakeVehicle, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--connect", LINK, "--card", "hover"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == " the card can be flown as the vehicle is set; nothing was set"
    assert max(map(len, lines)) <= 78
    assert len(lines) < 40
    assert vehicle.written == []
    assert vehicle.asked == []


def test_what_must_be_changed_is_1_and_lands_in_a_file_that_is_not_overwritten(
    vehicle: FakeVehicle, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    vehicle.parameters["LOG_BACKEND_TYPE"] = 0.0
    target = tmp_path / "heli.param"
    words = ["check", "--connect", LINK, "-o", str(target), "--json"]
    assert main(words) == 1
    document = json.loads(capsys.readouterr().out)
    assert (document["format"], document["ready"]) == ("tippath.check/1", False)
    assert document["changes"] == {"LOG_BACKEND_TYPE": 1.0}
    assert document["parameter_file"] == str(target)
    assert "LOG_BACKEND_TYPE,1" in target.read_text().splitlines()
    assert main(words) == 2
    assert vehicle.written == []


def test_the_pilot_is_waited_for_while_the_log_is_answered(vehicle: FakeVehicle) -> None:
    session = FakeSession(vehicle)
    told: list[str] = []
    profile = require_flyable(session, CARD, session, in_the_air=False)
    session.log_client = LogClient.OURS
    began = vehicle.now

    def fly() -> None:
        vehicle.armed, vehicle.status = True, 4
        vehicle._beat()

    vehicle.at(began + 20.0, fly)
    assert wait_for_pilot(session, session, profile, tell=told.append)
    assert 22.5 < vehicle.now - began < 25.0
    assert told == [
        "waiting: not armed: the pilot arms and takes off; answering the vehicle's log so that it can be armed"
    ]


def test_waiting_ends_when_somebody_wants_it_and_what_it_cannot_fly_is_not_waited_for(vehicle: FakeVehicle) -> None:
    session = FakeSession(vehicle)
    profile = require_flyable(session, CARD, session, in_the_air=False)
    end = vehicle.now + 2.0
    assert not wait_for_pilot(session, session, profile, tell=lambda _: None, ended=lambda: vehicle.now > end)
    vehicle.parameters["LOG_BACKEND_TYPE"] = 1.0
    assert main(["sweep", "--connect", LINK, "--axis", "roll", "--wait"]) == 1
