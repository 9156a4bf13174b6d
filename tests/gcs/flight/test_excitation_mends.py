"""What the checker of rules found wrong in giving settings back, small. Histories stand in `excitation_rules`."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from gcs.cards.maneuver import Maneuver
from gcs.flight.settings import give_back, ordered, write_plan
from gcs.link.procedures import NoAnswerError
from gcs.vehicle.profile import VehicleProfile, bundled_profiles
from gcs.vehicle.snapshot import VehicleSnapshot

AXIS, MAGNITUDE = "SID_AXIS", "SID_MAGNITUDE"


class Silent:
    """A session whose vehicle takes writes and answers the first few only."""

    def __init__(self, answers: int, mode_after: int = 0) -> None:
        self.answers = answers
        self.mode_after = mode_after
        self.written: list[tuple[str, float]] = []

    def snapshot(self) -> VehicleSnapshot:
        return replace(
            VehicleSnapshot(system=1, component=1), mode=self.mode_after if self.written else 0, mode_name="SystemID"
        )

    def call(self, procedure: Any, timeout_s: float | None = None) -> Any:
        self.written.append((procedure.name, procedure.value))
        if len(self.written) > self.answers:
            raise NoAnswerError("no answer")
        return None


@pytest.fixture
def profile() -> VehicleProfile:
    return next(p for p in bundled_profiles() if not p.kinds)


def test_a_write_without_an_answer_may_have_arrived(profile: VehicleProfile) -> None:
    plan = profile.plan(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=10.0))
    now = {AXIS: 8.0, MAGNITUDE: 30.0}
    with pytest.raises(NoAnswerError):
        write_plan(Silent(0), plan, profile, now)
    assert math.isnan(now[MAGNITUDE])
    assert now[AXIS] == 8.0


def test_what_is_not_known_is_taken_for_dangerous(profile: VehicleProfile) -> None:
    wanted = {AXIS: 10.0, MAGNITUDE: 0.05}
    assert ordered(profile, {AXIS: 8.0, MAGNITUDE: math.nan}, wanted)[0] == (MAGNITUDE, 0.05)
    unknown_axis = ordered(profile, {AXIS: math.nan, MAGNITUDE: 30.0}, wanted)
    assert unknown_axis == ((MAGNITUDE, 0.0), (AXIS, 10.0), (MAGNITUDE, 0.05))


def test_nothing_more_is_given_back_once_the_excitation_mode_shows(profile: VehicleProfile) -> None:
    session = Silent(99, mode_after=25)
    before = {AXIS: 0.0, MAGNITUDE: 15.0}
    words = give_back(session, profile, {AXIS: 10.0, MAGNITUDE: 0.1}, before)
    assert session.written == [(AXIS, 0.0)]
    assert any("nothing is written now" in word for word in words)
