"""Cards: what is believed, what is refused by the name of the key, and in what order runs are flown."""

from __future__ import annotations

import math
import random
from pathlib import Path

import jsonschema
import pytest
from damaged_documents import FILES, bytes_changed

from gcs import documents
from gcs.cards.maneuver import CardDocument, Maneuver, bundled_cards, card_text, load_card, parse_card, single_card
from gcs.errors import UsageError

CHIRP = """
name = "one"
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.1
duration_s = 30
"""


def with_line(line: str) -> str:
    return CHIRP + line + "\n"


def test_what_a_chirp_leaves_out_is_table_1() -> None:
    (maneuver,) = parse_card(CHIRP, "x").maneuvers
    assert (maneuver.f_start_hz, maneuver.f_stop_hz, maneuver.noise_fraction, maneuver.c1) == (0.5, 10.0, 0.2, 4.0)
    assert maneuver.is_table_1
    assert maneuver.purpose == "fit"
    assert not parse_card(with_line("f_stop_hz = 9.5"), "x").maneuvers[0].is_table_1


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (with_line("amplitud = 0.1"), "unknown key 'amplitud'; did you mean amplitude"),
        (with_line("pulse_s = 0.2"), "pulse_s means nothing for a chirp"),
        (CHIRP.replace("amplitude = 0.1\n", ""), "amplitude is missing"),
        (CHIRP.replace("0.1", "'0.1'"), "amplitude is a number, not '0.1'"),
        (CHIRP.replace("0.1", "true"), "amplitude is a number, not true"),
        (CHIRP.replace("0.1", "1.2"), "amplitude is a number from 0 to 1, not 1.2"),
        (CHIRP.replace("0.1", "nan"), "amplitude is a number from 0 to 1, not nan"),
        (CHIRP.replace("0.1", "0"), "amplitude is 0"),
        (CHIRP.replace("30", "1e9"), "duration_s is a number from 1 to 600"),
        (CHIRP.replace("30", "4"), "duration_s: 4 s hold no two periods"),
        (CHIRP.replace("roll", "yawn"), "axis is one of roll, pitch, elevator, yaw, not 'yawn'"),
        (CHIRP.replace("chirp", "jump"), "kind is one of chirp, doublet, quiet, not 'jump'"),
        (with_line("f_stop_hz = 0.4"), "f_stop_hz: 0.4 Hz does not lie above"),
        (with_line("repeat = 2.0"), "repeat is a whole number"),
        (with_line("repeat = true"), "repeat is a whole number"),
        (with_line("repeat = 0"), "repeat is a whole number from 1 to 50"),
        (with_line('purpose = "fun"'), "purpose is one of"),
        (with_line("fade_in_s = 20\nfade_out_s = 20"), "fade_in_s and fade_out_s"),
        (CHIRP + "[limits]\nrate = 1", "unknown key 'rate'; there are: rate_rad_s"),
        (CHIRP + "[limits]\nattitude_deg = 0", "attitude_deg is a number from 1 to 80"),
        (CHIRP + "[[step]]\nf_stop_hz = 5", "step 1: amplitude is missing"),
        (CHIRP + "[[step]]\namplitude = 0.5\n[[step]]\namplitude = 0.25", "must grow"),
        ("nam = 'x'\n" + CHIRP.replace('name = "one"', ""), "unknown key 'nam'; did you mean name"),
        ("name = 'x'\n", "no [[maneuver]]"),
        ("name = 'x'\nmaneuver = 3\n", "[[maneuver]]"),
        ("name = 3\n" + CHIRP.replace('name = "one"', ""), "name is text"),
        ("[[", "not TOML"),
        ("name='x'\n[[maneuver]]\nkind='doublet'\naxis='roll'\namplitude=0.1\nduration_s=1\npulse_s=0.6", "two pulses"),
        ("name='x'\n[[maneuver]]\nkind='quiet'\naxis='roll'\nduration_s=10", "axis means nothing for a quiet"),
    ],
)
def test_nonsense_is_refused_by_name(text: str, key: str) -> None:
    with pytest.raises(UsageError) as error:
        parse_card(text, "my.toml")
    assert key in str(error.value)
    assert str(error.value).startswith("my.toml")


def test_the_bundled_cards_are_what_they_say() -> None:
    assert set(bundled_cards()) >= {"hover", "forward", "quick", "lqr-doublet"}
    hover = load_card("hover")
    flown = [(run.maneuver.kind, run.maneuver.axis, run.maneuver.amplitude) for run in hover.runs()]
    assert flown == [
        *[("chirp", "roll", 0.10)] * 2,
        *[("chirp", "pitch", 0.15)] * 2,
        *[("doublet", "roll", 0.10)] * 2,
        *[("doublet", "pitch", 0.15)] * 2,
    ]
    assert all(run.maneuver.is_table_1 for run in hover.runs() if run.maneuver.kind == "chirp")
    assert 150 < hover.duration_s < 175
    assert [m.target for m in load_card("lqr-doublet").maneuvers] == ["rate", "rate"]
    assert load_card("quick").duration_s < 60


@pytest.mark.parametrize("name", sorted(bundled_cards()))
def test_a_card_survives_being_written_and_read(name: str) -> None:
    card = load_card(name)
    again = parse_card(card_text(card), "again")
    assert again.maneuvers == card.maneuvers
    assert (again.rest_s, again.limits, again.steps) == (card.rest_s, card.limits, card.steps)


def test_limits_of_a_card_are_read_and_survive() -> None:
    card = parse_card(CHIRP + "[limits]\nrate_rad_s = 1.5\nattitude_deg = 12\ncommand = 0.5", "x")
    assert (card.limits.rate, card.limits.command) == (1.5, 0.5)
    assert card.limits.attitude == pytest.approx(math.radians(12))
    assert parse_card(card_text(card), "y").limits.attitude == pytest.approx(card.limits.attitude)


def test_steps_come_before_the_full_amplitude_and_lock_it() -> None:
    card = parse_card(with_line("repeat = 2") + "[[step]]\namplitude=0.25\nf_stop_hz=5\n[[step]]\namplitude=0.5\n", "x")
    runs = card.runs()
    assert [run.label for run in runs] == ["roll chirp 25 %", "roll chirp 50 %", "roll chirp 1/2", "roll chirp 2/2"]
    assert [run.maneuver.amplitude for run in runs] == pytest.approx([0.025, 0.05, 0.1, 0.1])
    assert [run.maneuver.f_stop_hz for run in runs] == [5, 10, 10, 10]
    assert [run.unlocks_at for run in runs] == pytest.approx([1.0, 2.0, 2.0, 1.0])
    assert [run.locked_by for run in runs] == [None, 1, 2, None]
    assert [run.maneuver.purpose for run in runs] == ["build-up", "build-up", "fit", "fit"]


def test_a_file_goes_before_a_bundled_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.toml").write_text(CHIRP)
    assert load_card(str(tmp_path / "mine.toml")).name == "one"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hover").write_text(CHIRP)
    assert load_card("hover").name == "one"


def test_a_card_that_is_not_there_says_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"did you mean hover\?.*" + ", ".join(bundled_cards())):
        load_card("hovr")
    with pytest.raises(UsageError, match="no such card"):
        load_card(str(tmp_path))


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "card.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UsageError, match="cannot be read as a card"):
        load_card(str(path))


def test_a_single_maneuver_becomes_a_card_that_can_be_kept() -> None:
    card = single_card(Maneuver(kind="chirp", axis="pitch", amplitude=0.15, duration_s=20.0))
    assert parse_card(card.text, "kept").maneuvers == card.maneuvers
    with pytest.raises(UsageError, match="amplitude is a number from 0 to 1"):
        single_card(Maneuver(kind="chirp", axis="pitch", amplitude=3.0, duration_s=20.0))


@pytest.mark.parametrize("damage", FILES)
def test_a_file_that_is_no_card_is_refused_and_named(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "card.toml"
    path.write_bytes(FILES[damage])
    with pytest.raises(UsageError, match=r"card\.toml: ") as error:
        load_card(str(path))
    assert len(str(error.value)) < 300 + len(str(path))


def test_a_damaged_card_is_read_or_refused(tmp_path: Path) -> None:
    rng, path, refused = random.Random(9), tmp_path / "card.toml", 0
    for k in range(400):
        name = sorted(bundled_cards())[k % len(bundled_cards())]
        path.write_bytes(bytes_changed(bundled_cards()[name].encode(), rng))
        try:
            card = load_card(str(path))
        except UsageError:
            refused += 1
        else:
            assert all(maneuver.problem() is None for maneuver in card.maneuvers)
    assert refused > 100


@pytest.mark.parametrize("name", sorted(bundled_cards()))
def test_the_bundled_cards_keep_to_the_schema(name: str) -> None:
    jsonschema.validate(documents.toml_table(bundled_cards()[name], name), documents.schema(CardDocument))


def test_limits_hold_wherever_a_maneuver_comes_from() -> None:
    doublet = Maneuver(kind="doublet", axis="pitch", amplitude=1.2, duration_s=8.0)
    assert doublet.problem() == "amplitude is a number from 0 to 1, not 1.2"
    assert Maneuver(kind="doublet", axis="pitch", amplitude=1.2, duration_s=8.0, target="rate").problem() is None
    assert "kind is one of" in str(Maneuver(kind="jump").problem())
    assert str(Maneuver(kind="chirp", axis="yawn", amplitude=0.1).problem()).startswith("axis is one of")
    assert "leave it out" in str(Maneuver(kind="quiet", amplitude=0.1).problem())
    assert "duration_s" in str(Maneuver(kind="quiet", duration_s=math.nan).problem())
