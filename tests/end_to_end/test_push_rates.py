"""Rate gains to a stock autopilot, as its user types it: behind the pilot's switch, past it, and back."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from slow_flight import SlowFlight, in_one_line

from gcs.cli import main
from gcs.flight.gains import GainsError
from gcs.flight.rate_set import load_before, load_rate_set
from gcs.vehicle.gain_switch import SET, checksum
from sitl.autopilot.parameters import float32

FAST = 400_000.0
FLOWN = dict(zip(SET, (0.135, 0.135, 0.0036, 0.0) * 2, strict=True))
NEW = FLOWN | {"ATC_RAT_RLL_P": 0.17, "ATC_RAT_PIT_D": 0.003}
DOCUMENT: dict[str, Any] = {
    "format": "tippath.rate_gains/1",
    "parameters": {name: {"flown": FLOWN[name], "new": new} for name, new in NEW.items()},
    "new": {"held": True, "margins": {"gain_db": 7.0, "phase_deg": 50.0, "delay_ms": 12.0}},
    "asked": {"gain_db": 6.0, "phase_deg": 45.0, "delay_ms": 10.0},
    "identified": {"parameters": {"SCHED_LOOP_RATE": 400, "FRAME_CLASS": 1, **FLOWN}},
}
WHY = ("--why", "a tethered rig")


@pytest.fixture
def gains(tmp_path: Path) -> Path:
    path = tmp_path / "rate_gains.json"
    path.write_text(json.dumps(DOCUMENT))
    return path


@pytest.fixture(params=[True, False], ids=["switch", "stock"])
def flown(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[SlowFlight]:
    sd = tmp_path / "sd"
    made = SlowFlight(monkeypatch, "quad", "ardupilot-quad", sd, bytes_s=FAST, gain_switch=request.param)
    made.sleep(2.0)
    yield made
    made.close()


stock = pytest.mark.parametrize("flown", [False], indirect=True, ids=["stock"])
switch = pytest.mark.parametrize("flown", [True], indirect=True, ids=["switch"])


def values(flown: SlowFlight) -> dict[str, float]:
    return {name: flown.vehicle.parameters[name] for name in SET}


def as_held(of: dict[str, float]) -> dict[str, float]:
    return {name: float32(value) for name, value in of.items()}


def asked(
    flown: SlowFlight, capsys: pytest.CaptureFixture[str], command: str, *words: str | Path
) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    status = flown.tippath(command, *words, "--json")
    return status, json.loads(capsys.readouterr().out)


@switch
def test_a_set_goes_behind_the_pilots_switch(flown: SlowFlight, gains: Path, capsys: Any) -> None:
    status, planned = asked(flown, capsys, "push", gains, "--dry-run")
    assert (status, planned["behind_switch"], set(planned["changes"])) == (0, True, {"ATC_RAT_RLL_P", "ATC_RAT_PIT_D"})
    status, done = asked(flown, capsys, "push", gains)
    crc = checksum(tuple(map(float32, NEW.values())))
    assert (status, done["crc"], done["verified"], done["kept"]) == (0, crc, 8, None)
    assert done["behind_switch"] == {"channel": 9, "option": 300}
    assert [one["kind"] for one in done["objections"]] == ["battery", "rotor speed"]
    assert flown.vehicle.parameters["TPG_ACTIVE"] == crc
    assert values(flown) == as_held(FLOWN)
    assert asked(flown, capsys, "push", gains)[1]["committed"] is False
    flown.sleep(45.0)
    flown.pilot("takeoff")
    flown.sleep(10.0)
    flown.pilot("switch high")
    flown.sleep(0.3)
    assert values(flown) == as_held(NEW)
    assert asked(flown, capsys, "push", gains, *WHY)[1]["reason"] == "armed"
    assert asked(flown, capsys, "revert")[1]["reason"] == "armed"
    flown.pilot("switch low")
    flown.sleep(0.3)
    assert values(flown) == as_held(FLOWN)
    flown.pilot("land")
    flown.sleep(10.0)
    status, back = asked(flown, capsys, "revert")
    assert (status, back["reverted_crc"], back["crc"]) == (0, crc, 0)
    assert flown.vehicle.parameters["TPG_ACTIVE"] == 0
    assert asked(flown, capsys, "revert")[1]["reason"] == "no bank"


@switch
def test_past_the_switch_with_words_why_and_what_was_behind_it_is_forgotten(
    flown: SlowFlight, gains: Path, capsys: Any
) -> None:
    assert asked(flown, capsys, "push", gains)[0] == 0
    status, refused = asked(flown, capsys, "push", gains, "--for-good")
    assert (status, refused["reason"]) == (1, "switch")
    status, done = asked(flown, capsys, "push", gains, "--for-good", *WHY)
    assert (status, done["behind_switch"], done["why"]) == (0, None, WHY[1])
    assert values(flown) == as_held(NEW)
    assert flown.vehicle.parameters["TPG_ACTIVE"] == 0


@switch
def test_no_channel_for_the_switch_is_said(flown: SlowFlight, gains: Path, capsys: Any) -> None:
    flown.vehicle.write_parameter("RC9_OPTION", 0)
    status, refused = asked(flown, capsys, "push", gains)
    assert (status, refused["reason"]) == (1, "switch")
    assert "no channel has the switch's option 300" in refused["error"]


@stock
def test_without_a_switch_words_why_are_asked_and_the_set_before_is_put_back(
    flown: SlowFlight, gains: Path, capsys: Any
) -> None:
    status, refused = asked(flown, capsys, "push", gains)
    assert (status, refused["reason"]) == (1, "switch")
    assert "no hand takes them back in the air" in refused["error"]
    assert values(flown) == as_held(FLOWN)
    status, done = asked(flown, capsys, "push", gains, *WHY)
    kept = Path(done["kept"])
    assert (status, kept.name, done["behind_switch"]) == (0, "rate_gains.before.json", None)
    assert values(flown) == as_held(NEW)
    assert load_before(kept).before == as_held(FLOWN)
    assert asked(flown, capsys, "push", gains)[1]["committed"] is False
    status, back = asked(flown, capsys, "revert", kept, "--dry-run")
    assert (status, set(back["parameters"])) == (0, {"ATC_RAT_RLL_P", "ATC_RAT_PIT_D"})
    assert values(flown) == as_held(NEW)
    assert asked(flown, capsys, "revert", kept)[0] == 0
    assert values(flown) == as_held(FLOWN)
    assert asked(flown, capsys, "revert", kept)[1]["parameters"] == {}
    flown.vehicle.write_parameter("ATC_RAT_RLL_P", 0.2)
    assert asked(flown, capsys, "revert", kept)[1]["reason"] == "differs"
    assert asked(flown, capsys, "revert", kept, *WHY)[0] == 0
    assert values(flown) == as_held(FLOWN)
    assert "no LQR bank" in asked(flown, capsys, "revert")[1]["error"]


@stock
def test_gains_that_somebody_changed_since_they_flew_refuse(flown: SlowFlight, gains: Path, capsys: Any) -> None:
    flown.vehicle.write_parameter("ATC_RAT_RLL_I", 0.2)
    refused = asked(flown, capsys, "push", gains)[1]
    assert "ATC_RAT_RLL_I was 0.135, is 0.2" in refused["error"]
    unknown = json.loads(gains.read_text())
    del unknown["identified"]
    gains.write_text(json.dumps(unknown))
    refused = asked(flown, capsys, "push", gains)[1]
    assert "gains: not as flown: ATC_RAT_RLL_I was 0.135, is 0.2" in refused["error"]


@stock
def test_gains_that_fail_and_a_file_that_nobody_can_judge_refuse(
    flown: SlowFlight, gains: Path, tmp_path: Path, capsys: Any
) -> None:
    thin = DOCUMENT | {"new": {"held": True, "margins": {"gain_db": 3.0, "phase_deg": 50.0, "delay_ms": 12.0}}}
    gains.write_text(json.dumps(thin))
    refused = asked(flown, capsys, "push", gains)[1]
    assert refused["reason"] == "margins"
    assert "gain margin 3.0 dB (asked 6)" in refused["error"]
    gains.write_text(json.dumps(DOCUMENT | {"judged": {"verdict": "fails"}}))
    assert asked(flown, capsys, "push", gains)[1]["reason"] == "margins"
    lines = tmp_path / "new.param"
    lines.write_text("# by design\nATC_RAT_RLL_P,0.17\nATC_RAT_PIT_D 0.003\n")
    assert asked(flown, capsys, "push", lines)[1]["reason"] == "not judged"
    assert asked(flown, capsys, "push", lines, *WHY)[0] == 0
    assert values(flown) == as_held(NEW)


@stock
def test_a_vehicle_that_lacks_a_gain_is_refused(
    flown: SlowFlight, gains: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = flown.vehicle.parameters.read
    hidden = "ATC_RAT_RLL_FF"
    monkeypatch.setattr(flown.vehicle.parameters, "read", lambda name: None if name == hidden else plain(name))
    status, refused = asked(flown, capsys, "push", gains, *WHY)
    assert (status, refused["reason"]) == (1, "no parameter")
    assert hidden in refused["error"]


@stock
@pytest.mark.parametrize("number", [1, 2])
def test_a_set_that_is_refused_in_the_middle_is_taken_back(
    flown: SlowFlight, gains: Path, capsys: Any, number: int
) -> None:
    refuse_writes_after(flown, number, lambda: None)
    status, refused = asked(flown, capsys, "push", gains, *WHY)
    assert status == 1
    assert "every gain is as before" in refused["error"]
    assert refused["reason"] == "refused"
    assert values(flown) == as_held(FLOWN)


@stock
def test_what_a_lost_link_leaves_is_said_and_put_back_by_the_kept_file(
    flown: SlowFlight, gains: Path, capsys: Any
) -> None:
    silent = False

    def lose() -> None:
        nonlocal silent
        silent = True

    refuse_writes_after(flown, 2, lose)
    plain = flown.wire.send
    flown.wire.send = lambda address, data: None if silent else plain(address, data)  # type: ignore[method-assign]
    status, refused = asked(flown, capsys, "push", gains, *WHY)
    assert (status, refused["reason"]) == (1, "half written")
    assert "not known to be as before: ATC_RAT_RLL_P, ATC_RAT_PIT_D" in refused["error"]
    assert values(flown) != as_held(FLOWN)
    silent = False
    flown.vehicle.parameters.stored = lambda name, value: value
    flown.sleep(5.0)
    assert asked(flown, capsys, "revert", gains.with_name("rate_gains.before.json"))[0] == 0
    assert values(flown) == as_held(FLOWN)


def refuse_writes_after(flown: SlowFlight, number: int, then: Callable[[], None]) -> None:
    """From the so many-th new value on the vehicle keeps its old one; old values it takes."""
    seen: list[str] = []

    def stored(name: str, value: float) -> float | None:
        if value == float32(FLOWN.get(name, value)):
            return value
        seen.extend([] if name in seen else [name])
        if len(seen) < number:
            return value
        then()
        return None

    flown.vehicle.parameters.stored = stored


@stock
def test_an_armed_vehicle_gets_nothing(flown: SlowFlight, gains: Path, capsys: Any) -> None:
    flown.sleep(45.0)
    flown.pilot("takeoff")
    flown.sleep(5.0)
    assert asked(flown, capsys, "push", gains, *WHY)[1]["reason"] == "armed"
    assert values(flown) == as_held(FLOWN)


@switch
def test_somebody_else_s_gains_meanwhile_are_no_commit(flown: SlowFlight, gains: Path, capsys: Any) -> None:
    plain = flown.vehicle.parameters.stored

    def stored(name: str, value: float) -> float | None:
        if name == "TPG_PIT_FF":
            flown.vehicle.parameters.put("ATC_RAT_PIT_I", 0.2, saved=True)
        return plain(name, value)

    flown.vehicle.parameters.stored = stored
    refused = asked(flown, capsys, "push", gains)[1]
    assert refused["reason"] == "differs"
    assert "ATC_RAT_PIT_I meanwhile" in refused["error"]
    assert flown.vehicle.parameters["TPG_ACTIVE"] == 0


@switch
def test_a_script_that_stands_still_is_said(flown: SlowFlight, gains: Path, capsys: Any) -> None:
    flown.vehicle.gain_switch = None
    refused = asked(flown, capsys, "push", gains)[1]
    assert refused["reason"] == "no answer"
    assert "the script does not answer" in refused["error"]


@stock
def test_words_for_people(flown: SlowFlight, gains: Path, capsys: Any) -> None:
    assert flown.tippath("push", gains, "--dry-run") == 0
    said = in_one_line(capsys.readouterr().out)
    assert "a push would write these gains; nothing was sent but questions ATC_RAT_RLL_P 0.135 -> 0.17" in said
    assert flown.tippath("push", gains, *WHY) == 0
    assert "8 of 8 values read back equal" in capsys.readouterr().out
    assert flown.tippath("push", gains, *WHY) == 0
    assert "has this set already; nothing was written" in capsys.readouterr().out
    assert flown.tippath("revert", gains.with_name("rate_gains.before.json")) == 0
    assert "2 of 8 gains put back, read back equal" in capsys.readouterr().out


BAD = {
    "nan.param": "ATC_RAT_RLL_P,nan",
    "twice.param": "ATC_RAT_RLL_P,1\nATC_RAT_RLL_P,2",
    "other.param": "PSC_POSXY_P,1",
    "words.param": "fly well",
    "no-number.param": "ATC_RAT_RLL_P,fast",
    "large.param": "ATC_RAT_RLL_P,1e300",
    "empty.param": "# nothing",
    "nan.json": json.dumps(DOCUMENT | {"parameters": {"ATC_RAT_RLL_P": {"flown": 1, "new": float("nan")}}}),
    "none.json": json.dumps(DOCUMENT | {"parameters": {}}),
    "other.json": json.dumps(DOCUMENT | {"parameters": {"SID_AXIS": {"flown": 1, "new": 2}}}),
    "shape.json": json.dumps(DOCUMENT | {"parameters": [1]}),
}


@pytest.mark.parametrize("name", BAD)
def test_a_file_that_holds_no_set_is_refused_and_named(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(BAD[name])
    with pytest.raises(GainsError) as refused:
        load_rate_set(path)
    assert str(refused.value).startswith(str(path))
    with pytest.raises(GainsError, match="push"):
        load_before(path)


def test_the_script_goes_with_the_other_design_only(tmp_path: Path, capsys: Any) -> None:
    assert main(["design", "fit.json", "--script", str(tmp_path / "a.lua")]) == 2
    assert "--for ardupilot" in capsys.readouterr().err
