"""Vehicle profiles: the parameters written, what is said to be flown, what is refused before anything is written."""

from __future__ import annotations

import math

import pytest

from gcs.cards.maneuver import Maneuver
from gcs.errors import TippathError
from gcs.vehicle.profile import CannotFlyError, bundled_profiles, choose_profile, parse_profile

CHIRP = Maneuver(kind="chirp", axis="pitch", amplitude=0.15, duration_s=30.0)
ARDUPILOT, PX4 = 3, 12
SIDX = {"SID_AXIS": 0.0, "SIDX_LAW": 0.0, "SIDX_KIND": 0.0}


def test_a_vehicle_is_known_by_its_parameters() -> None:
    assert choose_profile(SIDX, ARDUPILOT).chirp_law == "table 1"
    assert choose_profile({"SID_AXIS": 0.0}, ARDUPILOT).chirp_law == "ardupilot"
    with pytest.raises(CannotFlyError, match="SID_AXIS"):
        choose_profile({}, ARDUPILOT)
    with pytest.raises(CannotFlyError):
        choose_profile(SIDX, PX4)


def test_table_1_is_written_parameter_by_parameter_the_axis_first() -> None:
    plan = choose_profile(SIDX, ARDUPILOT).plan(CHIRP)
    assert plan.writes[0] == ("SID_AXIS", 11.0)
    assert dict(plan.writes) == {
        "SID_AXIS": 11.0,
        "SID_MAGNITUDE": 0.15,
        "SID_F_START_HZ": 0.5,
        "SID_F_STOP_HZ": 10.0,
        "SID_T_FADE_IN": 0.0,
        "SID_T_REC": 30.0,
        "SID_T_FADE_OUT": 0.0,
        "SIDX_KIND": 0.0,
        "SIDX_LAW": 1.0,
        "SIDX_C1": 4.0,
        "SIDX_NOISE": 0.2,
        "SIDX_PULSE_S": 0.25,
        "SIDX_SEED": 0.0,
    }
    assert (plan.words, plan.mode, plan.axis_number) == ("Table 1", 25, 11)
    assert (plan.lead_s, plan.over_s, plan.finished_s) == (1.0, 31.0, 32.0)


def test_another_law_than_table_1_is_not_called_table_1() -> None:
    profile = choose_profile(SIDX, ARDUPILOT)
    words = profile.plan(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=30.0, noise_fraction=0.1)).words
    assert words == "Table 1's law with 0.5-10 Hz, noise 0.1, C1 4"
    assert profile.plan(Maneuver(kind="doublet", axis="roll", amplitude=0.1, duration_s=8.0)).words.startswith(
        "doublets"
    )
    assert profile.plan(Maneuver(kind="quiet", duration_s=10.0)).words == "nothing added"


def test_plain_ardupilot_says_what_it_flies_and_writes_nothing_it_lacks() -> None:
    plan = choose_profile({"SID_AXIS": 0.0}, ARDUPILOT).plan(CHIRP)
    assert plan.words == "ArduPilot's law, no noise"
    assert [name for name, _ in plan.writes] == [
        "SID_AXIS",
        "SID_MAGNITUDE",
        "SID_F_START_HZ",
        "SID_F_STOP_HZ",
        "SID_T_FADE_IN",
        "SID_T_REC",
        "SID_T_FADE_OUT",
    ]


def test_the_time_of_finished_is_that_of_a_real_ardupilot() -> None:
    # quad_pitch_from_vehicle.tlog: "Starting" at 74.60 s, "Finished" at 146.62 s, with these settings
    maneuver = Maneuver(kind="chirp", axis="pitch", amplitude=0.05, duration_s=60.0, fade_in_s=5.0, fade_out_s=2.0)
    plan = choose_profile({"SID_AXIS": 0.0}, ARDUPILOT).plan(maneuver)
    assert plan.finished_s == pytest.approx(146.62 - 74.60, abs=0.1)


@pytest.mark.parametrize(
    ("maneuver", "words"),
    [
        (
            Maneuver(kind="doublet", axis="roll", amplitude=0.1, duration_s=8.0),
            "no doublet; leave it out of the card and let the pilot fly it",
        ),
        (Maneuver(kind="quiet", duration_s=10.0), "no quiet"),
        (Maneuver(kind="chirp", axis="elevator", amplitude=0.1, duration_s=30.0), "not elevator"),
        (Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=3.0), "no two periods"),
    ],
)
def test_what_plain_ardupilot_cannot_fly_is_refused(maneuver: Maneuver, words: str) -> None:
    with pytest.raises(CannotFlyError, match=words):
        choose_profile({"SID_AXIS": 0.0}, ARDUPILOT).plan(maneuver)


def test_a_rate_maneuver_goes_to_the_rate_axis_in_degrees() -> None:
    plan = choose_profile(SIDX, ARDUPILOT).plan(
        Maneuver(kind="doublet", axis="pitch", amplitude=0.3, duration_s=8.0, target="rate", pulse_s=0.5)
    )
    values = dict(plan.writes)
    assert values["SID_AXIS"] == 8
    assert values["SID_MAGNITUDE"] == pytest.approx(math.degrees(0.3))
    assert (values["SIDX_KIND"], values["SIDX_PULSE_S"]) == (1, 0.5)


def test_the_elevator_is_an_axis_where_the_vehicle_has_one() -> None:
    plan = choose_profile(SIDX, ARDUPILOT).plan(Maneuver(kind="chirp", axis="elevator", amplitude=0.3, duration_s=30.0))
    assert (plan.axis_number, plan.words) == (20, "Table 1")
    assert plan.writes[0] == ("SID_AXIS", 20.0)


def test_every_bundled_profile_plans_a_chirp_and_has_every_parameter_once() -> None:
    assert len(bundled_profiles()) >= 2
    for profile in bundled_profiles():
        plan = profile.plan(CHIRP)
        assert len({name for name, _ in plan.writes}) == len(plan.writes)
        assert all(len(name) <= 16 and math.isfinite(value) for name, value in plan.writes)
        assert next(iter(profile.parameters)) == "axis"
        assert set(profile.settings) == {name for name, _ in plan.writes}


def test_a_broken_profile_names_what_is_missing() -> None:
    with pytest.raises(TippathError, match=r"mine.toml: modes is missing"):
        parse_profile("name = 'x'", "mine.toml")
    with pytest.raises(TippathError, match="not TOML"):
        parse_profile("[", "mine.toml")
