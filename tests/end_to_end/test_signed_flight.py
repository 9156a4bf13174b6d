"""A vehicle that obeys only its key, in fake time: flown with it, silent without, unmoved by whoever else speaks."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from slow_flight import TWO_CHIRPS, SlowFlight, in_one_line

from gcs.cli import main
from gcs.link.key_file import read_key
from sitl.autopilot.modes import Mode


def forged(message: Any, key: bytes | None = None, version: int = 2) -> bytes:
    mav = mavlink.MAVLink(None, 254, 190)
    if key is not None:
        mav.signing.secret_key, mav.signing.sign_outgoing = key, True
        mav.signing.timestamp = 1 << 47
    return bytes(message.pack(mav, force_mavlink1=version == 1))


def test_a_card_is_flown_with_the_key_and_nobody_without_it_moves_or_hears_anything(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key, other = tmp_path / "a.key", tmp_path / "b.key"
    assert main(["key", "new", str(key)]) == 0
    assert main(["key", "new", str(other)]) == 0
    secret = read_key(key).secret
    flown = SlowFlight(
        monkeypatch, "hover-ideal", None, tmp_path / "sd", bytes_s=300_000.0, on_ground=False, key=secret
    )
    (tmp_path / "card.toml").write_text(TWO_CHIRPS)
    stabilize = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, int(Mode.STABILIZE), 0, 0, 0, 0, 0)
    loud = mavlink.MAVLink_param_set_message(1, 1, b"SID_MAGNITUDE", 0.5, 9)
    orders = [forged(one, with_key) for one in (stabilize, loud) for with_key in (None, read_key(other).secret)]
    orders += [forged(stabilize, version=1)]
    sent = 0

    def spoof() -> None:
        nonlocal sent
        if flown.vehicle.sweeping and sent < len(orders):
            flown.wire.others_say.append(orders[sent])
            sent += 1

    flown.between = spoof
    words = ("--no-probe", "--card", tmp_path / "card.toml", "-o", tmp_path / "flight-0001")
    assert flown.tippath("sweep", "--key", key, *words) == 0, capsys.readouterr()
    flown.between = lambda: None
    capsys.readouterr()
    assert sent == len(orders)
    flight = json.loads((tmp_path / "flight-0001" / "flight.json").read_text())
    assert [run["ending"] for run in flight["runs"]] == ["finished", "finished"]
    assert flown.signatures is not None
    assert flown.signatures.refused == {"unsigned": 2, "wrongly signed": 2, "MAVLink 1": 1}
    assert (tmp_path / "flight-0001" / "flight.BIN").stat().st_size > 100_000
    for path in (tmp_path / "flight-0001").rglob("*"):
        assert not path.is_file() or (
            secret not in path.read_bytes() and secret.hex().encode() not in path.read_bytes()
        )

    assert flown.tippath("abort", "--key", other) == 1
    assert "the vehicle has another key: compare ids" in in_one_line("".join(capsys.readouterr()))
    assert flown.tippath("check") == 1
    assert "it signs what it says, and obeys only who has its key: --key FILE" in in_one_line(
        "".join(capsys.readouterr())
    )
    assert flown.tippath("abort", "--key", tmp_path / "no.key") == 2
    assert flown.tippath("abort", "--key", key, "--system", "7") == 1
    assert "no heartbeat of an autopilot with system id 7" in in_one_line("".join(capsys.readouterr()))
    assert flown.tippath("abort", "--key", key) == 0
    flown.close()
