"""Vehicle profiles: the parameters written, what is said to be flown, what is refused before anything is written."""

from __future__ import annotations

import math
import random
from importlib import resources
from pathlib import Path

import jsonschema
import pytest
from damaged_documents import FILES, changed

from gcs import documents
from gcs.cards.maneuver import Maneuver
from gcs.cli import main
from gcs.documents import DocumentError
from gcs.errors import TippathError
from gcs.vehicle.profile import (
    CannotFlyError,
    ProfileDocument,
    bundled_profiles,
    choose_profile,
    load_profile,
    parse_profile,
    wanted_parameters,
)

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
    with pytest.raises(TippathError, match=r"mine.toml: chirp_law is missing"):
        parse_profile("name = 'x'", "mine.toml")
    with pytest.raises(TippathError, match="not TOML"):
        parse_profile("[", "mine.toml")


def bundled_text(name: str) -> str:
    return (resources.files("gcs.vehicle") / "profiles" / f"{name}.toml").read_text("utf-8")


@pytest.mark.parametrize("name", ["arducopter", "table1"])
def test_the_bundled_profiles_keep_to_the_schema(name: str) -> None:
    jsonschema.validate(documents.toml_table(bundled_text(name), name), documents.schema(ProfileDocument))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'chirp_law = "ardupilot"',
            'chirp_law = "ardu"',
            "chirp_law is one of table 1, ardupilot, not 'ardu'; did you",
        ),
        ("autopilot = 3", "autopilot = 3.5", "autopilot is a whole number from 0 to 255, not 3.5"),
        ("autopilot = 3", "autopilt = 3", "unknown key 'autopilt'; did you mean autopilot?"),
        ("excitation = 25", "", "[modes]: excitation is missing"),
        ("excitation = 25", "excitation = '25'", "[modes]: excitation is a whole number, not '25'"),
        ("manual_throttle = [0, 1]", "manual_throttle = []", "[modes]: manual_throttle is empty"),
        ("roll = 10", "rol = 10", "[axes]: unknown key 'rol'; did you mean roll?"),
        ('f_start_hz = "SID', 'f_start = "SID', "[parameters]: unknown key 'f_start'; did you mean f_start_hz?"),
        ('"SID_MAGNITUDE"', '"SID_MAGNITUDE_LONGER"', "[parameters]: amplitude is text like"),
        ('amplitude = "SID_MAGNITUDE"', "", "[parameters]: amplitude is missing"),
        ("10 = 0.5", "", "[largest_magnitude]: 10 is missing: beyond which magnitude"),
        ("10 = 0.5", "10 = nan", "[largest_magnitude]: 10 is a number above 0, not nan"),
        ("lead_s = 1.0", "lead_s = -1.0", "[timing]: lead_s is a number from 0 to 60, not -1.0"),
        ("[axes]", "kinds = 3\n[axes]", "unknown key 'kinds'"),
    ],
)
def test_a_damaged_profile_names_table_and_key(old: str, new: str, message: str) -> None:
    text = bundled_text("arducopter")
    assert old in text
    with pytest.raises(DocumentError) as error:
        parse_profile(text.replace(old, new), "mine.toml")
    assert str(error.value).startswith("mine.toml: ")
    assert message in str(error.value)


@pytest.mark.parametrize("damage", FILES)
def test_a_file_that_is_no_profile_is_refused_and_named(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(FILES[damage])
    with pytest.raises(DocumentError, match=r"mine\.toml: "):
        load_profile(str(path))


def test_a_changed_profile_is_read_or_refused() -> None:
    rng, sound, refused = random.Random(3), documents.toml_table(bundled_text("table1"), "x"), 0
    for _ in range(500):
        try:
            documents.convert(changed(sound, rng), ProfileDocument, "x", "TOML").problem()
        except DocumentError:
            refused += 1
    assert refused > 300


def test_a_profile_of_ones_own_is_read_by_its_path_and_flown_by(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    text = bundled_text("arducopter").replace("SID_", "XID_").replace("excitation = 25", "excitation = 99")
    path.write_text(text.replace('name = "ArduPilot"', 'name = "mine"'))
    mine = load_profile(str(path))
    plan = mine.plan(CHIRP)
    assert (plan.mode, plan.writes[0]) == (99, ("XID_AXIS", 11.0))
    assert wanted_parameters((mine,)) == (("XID_AXIS",),)
    assert choose_profile({"XID_AXIS": 0.0}, ARDUPILOT, (mine,)) is mine
    with pytest.raises(CannotFlyError, match=r"not the one of .*mine\.toml: it has no XID_AXIS; give its own profile"):
        choose_profile(SIDX, ARDUPILOT, (mine,))
    with pytest.raises(CannotFlyError, match="its autopilot is number 12, the profile's 3"):
        choose_profile({"XID_AXIS": 0.0}, PX4, (mine,))


def test_a_profile_is_known_by_its_name_too() -> None:
    assert load_profile("table1").offers_our_law
    assert not load_profile("arducopter").offers_our_law
    with pytest.raises(TippathError, match=r"arducoptr: no such vehicle profile; did you mean arducopter\?"):
        load_profile("arducoptr")


def test_a_command_names_the_profile_that_is_not_there_before_it_opens_a_link(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["sweep", "--connect", "udpin:127.0.0.1:0", "--axis", "roll", "--vehicle-profile", "table2"]) == 1
    assert "table2: no such vehicle profile; did you mean table1?" in capsys.readouterr().err
