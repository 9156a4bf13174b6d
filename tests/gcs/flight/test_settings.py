"""Parameters around a maneuver: no answer is never "has none", and no pair of axis and size is ever a dangerous one."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import pytest
from fake_flight import FakeSession, FakeVehicle

from gcs.cards.maneuver import Maneuver
from gcs.errors import LinkError
from gcs.flight.live import SweepSettings
from gcs.flight.settings import (
    ask,
    changed_since,
    flown_otherwise,
    give_back,
    ordered,
    read_settings,
    recognise,
    write_plan,
)
from gcs.link.procedures import NoAnswerError, Procedure, ReadParameter
from gcs.vehicle.profile import CannotFlyError, Plan, VehicleProfile, bundled_profiles

T = TypeVar("T")

AXIS, MAGNITUDE = "SID_AXIS", "SID_MAGNITUDE"


@pytest.fixture
def profile() -> VehicleProfile:
    return bundled_profiles()[0]


@pytest.fixture
def plan(profile: VehicleProfile) -> Plan:
    return profile.plan(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0))


@pytest.fixture
def vehicle() -> FakeVehicle:
    return FakeVehicle()


@pytest.fixture
def session(vehicle: FakeVehicle) -> FakeSession:
    return FakeSession(vehicle)


# ------------------------------------------------------------------------------------------------ asking


def test_a_parameter_is_believed_to_be_absent_only_while_other_questions_are_answered(
    vehicle: FakeVehicle, session: FakeSession
) -> None:
    assert ask(session, session, "SID_AXIS") == 0.0
    assert ask(session, session, "NO_SUCH") is None
    session.one_way = True
    with pytest.raises(NoAnswerError, match=r"answers nothing.*one way only.*signed"):
        ask(session, session, "NO_SUCH")


def test_a_one_way_link_is_no_vehicle_without_the_systemid_mode(session: FakeSession) -> None:
    session.one_way = True
    with pytest.raises(NoAnswerError) as error:
        recognise(session, session)
    assert "firmware" not in str(error.value)


def test_a_vehicle_that_answers_and_has_no_such_mode_is_told_so(vehicle: FakeVehicle, session: FakeSession) -> None:
    del vehicle.parameters[AXIS]
    with pytest.raises(CannotFlyError, match="firmware built without"):
        recognise(session, session)


def test_a_vehicle_is_recognised_by_a_profile_of_ones_own(
    vehicle: FakeVehicle, session: FakeSession, profile: VehicleProfile
) -> None:
    mine = replace(profile, needs=("MINE_AXIS",), file="mine.toml")
    with pytest.raises(CannotFlyError, match=r"mine\.toml: it has no MINE_AXIS"):
        recognise(session, session, (mine,))
    vehicle.parameters["MINE_AXIS"] = 0.0
    assert recognise(session, session, (mine,)) is mine


def test_a_link_lost_meanwhile_is_said(vehicle: FakeVehicle, session: FakeSession) -> None:
    session.deaf_from = 0.5
    session.sleep(5.0)
    with pytest.raises(LinkError, match="the link was lost"):
        ask(session, session, "NO_SUCH")


class LosesReads(FakeSession):
    """The first reads of one parameter get no answer, while everything else does."""

    lost = 0

    def call(
        self,
        procedure: Procedure[T],
        timeout_s: float | None = None,
        *,
        cancelled: Callable[[], bool] | None = None,
    ) -> T:
        if self.lost and isinstance(procedure, ReadParameter) and procedure.name == "SID_T_FADE_IN":
            self.lost -= 1
            self.sleep(0.6)
            raise NoAnswerError("no answer")
        return super().call(procedure, timeout_s, cancelled=cancelled)


def test_a_setting_that_a_poor_link_lost_several_times_is_asked_for_again(
    vehicle: FakeVehicle, profile: VehicleProfile
) -> None:
    session = LosesReads(vehicle)
    session.lost = 6
    assert read_settings(session, session, profile)["SID_T_FADE_IN"] == vehicle.parameters["SID_T_FADE_IN"]
    assert session.lost == 0


def test_without_a_setting_that_a_maneuver_writes_nothing_is_flown(
    vehicle: FakeVehicle, profile: VehicleProfile
) -> None:
    session = LosesReads(vehicle)
    session.lost = 1000
    with pytest.raises(NoAnswerError, match=r"answers, but not for SID_T_FADE_IN.*nothing was flown"):
        read_settings(session, session, profile)


# ------------------------------------------------------------------------------------------------ the order of writes

PAIRS = [(0, 15.0), (1, 15.0), (10, 0.1), (11, 0.15), (10, 0.0), (7, 17.0), (8, 60.0), (20, 0.3), (4, 10.0)]


@pytest.mark.parametrize(("now", "wanted"), list(itertools.permutations(PAIRS, 2)))
def test_on_the_way_from_one_pair_to_another_none_is_dangerous(
    profile: VehicleProfile, now: tuple[int, float], wanted: tuple[int, float]
) -> None:
    assert not profile.dangerous(*now)
    assert not profile.dangerous(*wanted)
    held = {AXIS: float(now[0]), MAGNITUDE: now[1]}
    for name, value in ordered(profile, held, {AXIS: float(wanted[0]), MAGNITUDE: wanted[1]}):
        held[name] = value
        assert not profile.dangerous(held[AXIS], held[MAGNITUDE]), held
    assert (held[AXIS], held[MAGNITUDE]) == wanted


def test_the_users_15_degrees_never_meet_the_mixer(profile: VehicleProfile) -> None:
    """ArduPilot's default magnitude 15, in degrees on axis 1, is fifteen times full command on axis 10."""
    writes = ordered(profile, {AXIS: 1.0, MAGNITUDE: 15.0}, {AXIS: 10.0, MAGNITUDE: 0.1})
    assert writes == ((MAGNITUDE, 0.1), (AXIS, 10.0))
    back = ordered(profile, {AXIS: 10.0, MAGNITUDE: 0.1}, {AXIS: 1.0, MAGNITUDE: 15.0})
    assert back == ((AXIS, 1.0), (MAGNITUDE, 15.0))


def test_a_magnitude_dangerous_on_the_axis_left_in_the_vehicle_is_not_put_back(
    profile: VehicleProfile, plan: Plan, vehicle: FakeVehicle, session: FakeSession
) -> None:
    vehicle.parameters |= {AXIS: 10.0, MAGNITUDE: 15.0}
    before = {name: vehicle.parameters[name] for name in profile.settings}
    held = dict(before)
    write_plan(session, plan, profile, held)
    words = give_back(session, profile, held, before)
    assert vehicle.parameters[AXIS] == 10.0
    assert vehicle.parameters[MAGNITUDE] == pytest.approx(0.1)
    assert "SID_MAGNITUDE 15 is not put back" in words[0]
    assert "0.1 now" in words[0]


def test_where_the_axis_is_not_taken_the_flown_magnitude_stays(
    profile: VehicleProfile, plan: Plan, vehicle: FakeVehicle, session: FakeSession
) -> None:
    vehicle.parameters |= {AXIS: 1.0, MAGNITUDE: 15.0}
    before = {name: vehicle.parameters[name] for name in profile.settings}
    held = dict(before)
    write_plan(session, plan, profile, held)
    vehicle.stubborn.add(AXIS)
    words = give_back(session, profile, held, before)
    assert (vehicle.parameters[AXIS], vehicle.parameters[MAGNITUDE]) == (10.0, pytest.approx(0.1))
    assert "SID_AXIS is not as it was before" in words[0]
    assert words[1] == "SID_MAGNITUDE stays 0.1 with it"


# ------------------------------------------------------------------------------------------------ what flies


def test_what_somebody_changed_between_write_and_start_is_found(
    profile: VehicleProfile, plan: Plan, vehicle: FakeVehicle, session: FakeSession
) -> None:
    write_plan(session, plan, profile, dict(vehicle.parameters))
    assert changed_since(session, plan) == ""
    vehicle.parameters[MAGNITUDE] = 0.15
    assert "SID_MAGNITUDE is 0.15 in the vehicle, not 0.1 as shown" in changed_since(session, plan)


def recorded(plan: Plan) -> SweepSettings:
    return SweepSettings(
        at_s=12.0,
        axis=10,
        magnitude=0.10000000149011612,
        f_start_hz=0.5,
        f_stop_hz=10.0,
        fade_in_s=0.0,
        constant_s=4.0,
        duration_s=30.0,
        fade_out_s=0.0,
        kind=0,
        law=1,
    )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, ""),
        ({"magnitude": 0.15}, "the vehicle flies amplitude 0.15, not 0.1"),
        ({"axis": 11}, "the vehicle flies axis 11, not 10"),
        ({"f_stop_hz": 20.0}, "the vehicle flies f_stop_hz 20, not 10"),
        ({"law": 0}, "the vehicle flies law 0, not 1"),
        ({"law": None, "kind": None}, ""),
    ],
)
def test_the_vehicles_own_record_of_a_maneuver_is_compared_with_the_plan(
    plan: Plan, change: dict[str, float], words: str
) -> None:
    assert flown_otherwise(plan, replace(recorded(plan), **change)) == words  # type: ignore[arg-type]
