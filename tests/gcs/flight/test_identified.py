"""Is it the vehicle that was identified: what differs refuses, what is not known is said."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.analysis.pushing import NotClearedError, ToPush, plan, push_judged
from gcs.flight.gains import BANK, GainsError, gains_of, load_gains, push
from gcs.flight.identified import Identified, objections, of_battery, of_parameters, of_rotor
from gcs.flight.session import Session
from gcs.vehicle.identity import group_of

THEN = {
    "SCHED_LOOP_RATE": 400.0,
    "INS_GYRO_FILTER": 20.0,
    "ATC_RAT_RLL_P": 0.135,
    "H_RSC_GOV_RPM": 1500.0,
    "FRAME_CLASS": 6.0,
    "MOT_THST_EXPO": 0.65,
}


@pytest.fixture
def at_hand(vehicle: Any, connect: Callable[..., Session]) -> Any:
    """The vehicle, as it was identified."""
    vehicle.offer_bank()
    for name, value in THEN.items():
        vehicle.set(name, value)
    return vehicle


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        ("SCHED_LOOP_RATE", 200.0, "loop rate"),
        ("INS_GYRO_FILTER", 80.0, "filters"),
        ("ATC_RAT_RLL_P", math.nextafter(0.135, 1.0) + 1e-6, "gains"),
        ("H_RSC_GOV_RPM", 1600.0, "rotor speed"),
        ("FRAME_CLASS", 1.0, "vehicle"),
        ("MOT_THST_EXPO", math.nan, "controls"),
    ],
)
def test_what_is_not_as_identified_refuses_and_words_why_let_it_pass(
    at_hand: Any, connect: Any, gains_document: dict[str, Any], name: str, value: float, kind: str
) -> None:
    gains = gains_of(gains_document | {"identified": Identified(parameters=THEN).to_json()})
    at_hand.set(name, value)
    with connect() as session:
        with pytest.raises(NotClearedError, match=f"not as identified: {name} was .* nothing was written") as refused:
            push_judged(session, ToPush(gains=gains))
        assert refused.value.reason == kind
        assert not [m for m in at_hand.heard if m.get_type() == "PARAM_SET"]
        assert [one.kind for one in plan(session, ToPush(gains=gains))[1] if one.refuses] == [kind]
        pushed = push_judged(session, ToPush(gains=gains, why="a bench"))
    assert pushed.result.committed
    assert json.loads(json.dumps(pushed.to_json(), allow_nan=False))["objections"][0]["kind"] == kind


def test_the_same_vehicle_is_no_objection_and_what_nobody_knows_is_said(
    at_hand: Any, connect: Any, gains_document: dict[str, Any]
) -> None:
    gains = gains_of(gains_document | {"identified": Identified(parameters=THEN).to_json()})
    with connect() as session:
        pushed = push_judged(session, ToPush(gains=gains))
        assert [one.words for one in pushed.objections] == [
            "battery: not known in the fit",
            "rotor speed: not known in the fit",
        ]
        nothing = objections(session, None)
    assert nothing[0].kind == "not identified"
    assert not any(one.refuses for one in nothing)


def test_a_parameter_that_is_gone_and_one_that_changed_between_runs(at_hand: Any, connect: Any) -> None:
    then = Identified(parameters=THEN, changed=("ATC_RAT_PIT_P",))
    told = of_parameters(then, {**THEN, "H_RSC_GOV_RPM": None})
    assert [(one.kind, one.refuses) for one in told] == [("rotor speed", True), ("not identified", True)]
    told = of_parameters(Identified(parameters=THEN), {name: 1.0 * value for name, value in list(THEN.items())[1:]})
    assert [(one.kind, one.refuses) for one in told] == [("not identified", False)]
    assert "not answered: SCHED_LOOP_RATE" in told[0].words


@pytest.mark.parametrize(
    ("then", "now", "refuses"),
    [
        ((22.0, 24.0), 21.0, None),
        ((22.0, 24.0), 26.0, None),
        ((22.0, 24.0), 16.0, True),
        ((22.0, 24.0), 30.0, True),
        ((22.0, 24.0), None, False),
        (None, 24.0, False),
    ],
)
def test_another_battery(then: tuple[float, float] | None, now: float | None, refuses: bool | None) -> None:
    assert [one.refuses for one in of_battery(then, now)] == ([] if refuses is None else [refuses])


@pytest.mark.parametrize(
    ("then", "now", "refuses"),
    [
        ((1650.0, 1655.0), 1650.0, None),
        ((1650.0, 1655.0), 1500.0, True),
        ((1650.0, 1655.0), 1800.0, True),
        ((1650.0, 1655.0), 0.0, False),
        ((1650.0, 1655.0), None, False),
        (None, 1650.0, False),
    ],
)
def test_another_rotor_speed(then: tuple[float, float] | None, now: float | None, refuses: bool | None) -> None:
    assert [one.refuses for one in of_rotor(then, now)] == ([] if refuses is None else [refuses])


def test_battery_and_rotor_of_the_vehicle_itself_are_compared(
    at_hand: Any, connect: Any, fake_time: Any, gains_document: dict[str, Any]
) -> None:
    then = Identified(parameters=THEN, battery_v=(22.5, 24.0), rotor_rpm=(1650.0, 1650.0))
    with connect() as session:
        at_hand.say(mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12600, -1, 80, 0, 0, 0, 0, 0, 0))
        fake_time.until(lambda: session.snapshot().battery_v is not None)
        assert [(one.kind, one.refuses) for one in objections(session, then)] == [
            ("battery", True),
            ("rotor speed", False),
        ]


def test_somebody_else_who_commits_meanwhile_is_found_out(
    at_hand: Any, connect: Any, gains_document: dict[str, Any]
) -> None:
    def other(m: Any) -> bool:
        if m.get_type() == "PARAM_SET" and m.param_id == "LQS_" + BANK[-1]:
            at_hand.set("LQR_ACTIVE", float(0xABCDEF))
        return False

    at_hand.deaf = other
    with connect() as session, pytest.raises(GainsError, match="somebody else has committed abcdef") as refused:
        push(session, gains_of(gains_document))
    assert refused.value.reason == "differs"
    assert not [m for m in at_hand.heard if m.get_type() == "PARAM_SET" and m.param_id == "LQR_COMMIT"]


def test_a_vehicle_armed_while_it_is_written_gets_no_commit(
    at_hand: Any, connect: Any, gains_document: dict[str, Any]
) -> None:
    def arm(m: Any) -> bool:
        at_hand.armed |= m.get_type() == "PARAM_SET"
        return False

    at_hand.deaf = arm
    with connect() as session, pytest.raises(GainsError, match="armed") as refused:
        push(session, gains_of(gains_document))
    assert refused.value.reason == "armed"
    assert not [m for m in at_hand.heard if m.get_type() == "PARAM_SET" and m.param_id == "LQR_COMMIT"]


@pytest.mark.parametrize("bad", [{"parameters": {"FRAME_CLASS": math.nan}}, {"battery_v": [1]}, "x", {"changed": 3}])
def test_what_is_known_of_the_vehicle_is_read_or_refused(
    gains_document: dict[str, Any], tmp_path: Path, bad: Any
) -> None:
    path = tmp_path / "gains.json"
    path.write_text(json.dumps(gains_document | {"identified": bad}))
    with pytest.raises(GainsError, match=r"identified.*tippath design"):
        load_gains(path)


def test_every_name_has_one_group() -> None:
    assert group_of("ATC_RAT_PIT_FLTD") == "filters"
    assert group_of("ATC_RAT_YAW_P") is None
    assert group_of("SID_AXIS") is None
    assert group_of("MOT_THST_HOVER") is None
