"""--dry-run asks and checks all, and nothing leaves but questions; and why nothing came of a command, for programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from slow_flight import SlowFlight

from gcs.cli import main
from sitl.protocol.server import Server

QUESTIONS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_TIMESYNC,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST,
}

GAINS = {
    "format": "tippath.gains/1",
    "K": [[0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8]],
    "observer_gain": [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0], [7.0, 8.0]],
    "prefilter": [[1.5, 0.25], [0.5, 1.25]],
    "model": {
        "structure": "tpp",
        "parameters": {
            name: float(number)
            for number, name in enumerate(("L_b", "M_a", "tau_f", "A_b", "B_a", "A_lat", "A_lon", "B_lat", "B_lon"), 1)
        },
    },
}

WHY = "numbers that no fit has made, which no judgement clears"


class Heard:
    """What a vehicle hears of its ground."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.orders: list[Any] = []
        answer = Server._is_addressed

        def listen(message: Any) -> bool:
            asks = message.get_msgId() in QUESTIONS or (
                message.get_msgId() == mavlink.MAVLINK_MSG_ID_COMMAND_LONG
                and message.command == mavlink.MAV_CMD_REQUEST_MESSAGE
            )
            if not asks:
                self.orders.append(message)
            return answer(message)

        monkeypatch.setattr(Server, "_is_addressed", staticmethod(listen))


@pytest.fixture
def gains(tmp_path: Path) -> Path:
    path = tmp_path / "gains.json"
    path.write_text(json.dumps(GAINS))
    return path


def test_a_sweep_is_told_and_not_flown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heard = Heard(monkeypatch)
    flown = SlowFlight(monkeypatch, "hover-ideal", None, tmp_path / "sd", bytes_s=300_000.0, on_ground=False)
    folder = tmp_path / "flight-0001"
    assert flown.tippath("sweep", "--axis", "roll", "--amplitude", "0.07", "--dry-run", "-o", folder) == 0
    said = capsys.readouterr().out
    assert "nothing was sent but questions" in said
    assert "SID_MAGNITUDE" in said
    assert "-> 0.07" in said
    assert flown.tippath("sweep", "--axis", "roll", "--dry-run", "--json", "-o", folder) == 0
    about = json.loads(capsys.readouterr().out)
    assert (about["dry_run"], about["planned"], about["runs"][0]["parameters"]["SID_MAGNITUDE"]) == (True, 1, 0.1)
    assert not folder.exists()
    assert heard.orders == []
    assert not flown.vehicle.sweeping

    flown.pilot("land")
    flown.sleep(30.0)
    assert flown.tippath("sweep", "--axis", "roll", "--dry-run", "--json", "-o", folder) == 1
    about = json.loads(capsys.readouterr().out)
    assert about["reason"] == "not ready"
    assert "not armed" in about["error"]
    assert heard.orders == []
    flown.close()


def test_gains_are_compared_and_not_written_and_a_revert_says_what_it_would_leave(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], gains: Path
) -> None:
    heard = Heard(monkeypatch)
    flown = SlowFlight(monkeypatch, "hover-ideal", None, tmp_path / "sd", bytes_s=300_000.0, on_ground=True)
    assert flown.tippath("push", gains, "--why", WHY, "--dry-run") == 0
    said = capsys.readouterr().out
    assert "in place of none" in said
    assert "K11" in said
    assert flown.tippath("revert", "--dry-run", "--json") == 1
    assert json.loads(capsys.readouterr().out)["reason"] == "no bank"
    assert heard.orders == []

    assert flown.tippath("push", gains, "--why", WHY) == 0
    capsys.readouterr()
    heard.orders.clear()
    assert flown.tippath("push", gains, "--why", WHY, "--dry-run", "--json") == 0
    about = json.loads(capsys.readouterr().out)
    assert (about["changes"], about["committed"]) == ({}, False)
    other = tmp_path / "other.json"
    other.write_text(json.dumps(GAINS | {"K": [[0.1, 0.2, 0.3, 0.5], [0.5, 0.6, 0.7, 0.8]]}))
    assert flown.tippath("push", other, "--why", WHY, "--dry-run", "--json") == 0
    changes = json.loads(capsys.readouterr().out)["changes"]
    assert {name: (round(v["now"], 6), v["then"]) for name, v in changes.items()} == {"K14": (0.4, 0.5)}
    assert flown.tippath("revert", "--dry-run") == 0
    assert "a revert would leave" in capsys.readouterr().out
    assert heard.orders == []

    flown.pilot("takeoff")
    flown.sleep(15.0)
    assert flown.tippath("push", gains, "--why", WHY, "--dry-run", "--json") == 1
    assert json.loads(capsys.readouterr().out)["reason"] == "armed"
    assert flown.tippath("push", gains, "--why", WHY, "--json") == 1
    assert json.loads(capsys.readouterr().out)["reason"] == "armed"
    flown.close()


def test_no_vehicle_is_a_reason(capsys: pytest.CaptureFixture[str], gains: Path) -> None:
    words = ["push", str(gains), "--why", WHY, "--connect", "tcp:127.0.0.1:9", "--json"]
    assert main(words) == 1
    said, err = capsys.readouterr()
    assert json.loads(said) == {
        "format": "tippath.push/1",
        "reason": "link",
        "error": err.rpartition("tippath push: ")[2].rstrip("\n"),
    }
