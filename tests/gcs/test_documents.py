"""Documents: read into structs, and refused in one sentence with file, place and key, whatever is done to them."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Annotated, Literal

import jsonschema
import pytest
from damaged_documents import changed
from msgspec import Meta

from gcs import documents
from gcs.document_faults import first_fault
from gcs.documents import DocumentError, Open, Strict

Share = Annotated[float, Meta(ge=0, le=1)]


class Chirp(Strict, tag_field="kind", tag="chirp"):
    amplitude: Share
    c1: float = 4.0


class Doublet(Strict, tag_field="kind", tag="doublet"):
    amplitude: Share
    pulse_s: float = 0.25


class Channel(Strict):
    source: str | tuple[str, ...]
    scale: float = 1.0


class Limits(Strict):
    rate: Annotated[float, Meta(gt=0)] = 3.0


class Card(Strict):
    name: Annotated[str, Meta(min_length=1, max_length=20)]
    axis: Literal["roll", "pitch"] = "roll"
    repeat: Annotated[int, Meta(ge=1, le=50)] = 1
    on: bool = True
    mass: Annotated[float, Meta(gt=0), Meta(description="kg")] | None = None
    band: tuple[float, float] | None = None
    matrix: tuple[tuple[float, float], tuple[float, float]] | None = None
    limits: Limits = Limits()
    maneuver: tuple[Chirp | Doublet, ...] = ()
    channels: dict[Literal["p", "q", "delta_x"], Channel] = {}
    largest: dict[int, float] = {}

    def __post_init__(self) -> None:
        if self.name == "bad":
            raise ValueError("bad is no name")


class Gains(Open):
    format: Literal["gains/1"]
    K: tuple[tuple[float, float], tuple[float, float]]
    model: Chirp | Doublet | None = None


GOOD = """
name = "x"
largest = {1 = 2}
band = [0, 5.5]
[limits]
rate = 2
[[maneuver]]
kind = "doublet"
amplitude = 0.1
[channels.p]
source = ["a", "b"]
"""


def test_a_sound_document_becomes_a_struct() -> None:
    card = documents.parse_toml(GOOD, Card, "my.toml")
    assert card.limits == Limits(rate=2.0)
    assert card.maneuver == (Doublet(amplitude=0.1),)
    assert card.channels == {"p": Channel(source=("a", "b"))}
    assert card.largest == {1: 2.0}
    assert card.band == (0.0, 5.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "name is missing"),
        ("nam = 'x'", "unknown key 'nam'; did you mean name?"),
        ("zzz = 'x'", "unknown key 'zzz'; there are: name, axis, repeat"),
        ("name = 3", "name is text in quotes, not 3"),
        ("name = ''", "name is empty"),
        ("name = 'aaaaaaaaaaaaaaaaaaaaaaaaa'", "name has 25 characters; 20 are the most"),
        ("name = 'bad'", "bad is no name"),
        ("name = 'x'\naxis = 'rol'", "axis is one of roll, pitch, not 'rol'; did you mean roll?"),
        ("name = 'x'\naxis = 3", "axis is one of roll, pitch, not 3"),
        ("name = 'x'\nrepeat = 2.0", "repeat is a whole number from 1 to 50, not 2.0"),
        ("name = 'x'\nrepeat = true", "repeat is a whole number, not true"),
        ("name = 'x'\nrepeat = 0", "repeat is a whole number from 1 to 50, not 0"),
        ("name = 'x'\nrepeat = 0x" + 5000 * "f", "repeat is a whole number from 1 to 50, not a number of very many"),
        ("name = 'x'\nmass = 'x'", "mass is a number, not 'x' (kg)"),
        ("name = 'x'\nmass = 0", "mass is a number above 0, not 0 (kg)"),
        ("name = 'x'\nmass = nan", "mass is a number above 0, not nan (kg)"),
        ("name = 'x'\non = 1", "on is true or false, not 1"),
        ("name = 'x'\nlimits = 3", "limits is a table, not 3"),
        ("name = 'x'\n[limits]\nrate = 0", "[limits]: rate is a number above 0, not 0"),
        ("name = 'x'\n[limits]\nrate = nan", "[limits]: rate is a number above 0, not nan"),
        ("name = 'x'\n[limits]\nrate = inf", "[limits]: rate is a number above 0, not inf"),
        ("name = 'x'\nband = [1]", "band is a list of 2 numbers"),
        ("name = 'x'\nband = [1, 'a']", "band[1] is a number, not 'a'"),
        ("name = 'x'\nband = [1, inf]", "band[1] is a number that is finite, not inf"),
        ("name = 'x'\nmatrix = [[1, 2], [3]]", "matrix is 2 rows of 2 numbers"),
        ("name = 'x'\nmaneuver = 3", "maneuver is a list of tables, written [[maneuver]], once for each"),
        ("name = 'x'\nmaneuver = [3]", "maneuver is a list of tables"),
        ("name = 'x'\n[[maneuver]]", "maneuver 1: kind is missing: one of chirp, doublet"),
        ("name = 'x'\n[[maneuver]]\nkind = 'jump'", "maneuver 1: kind is one of chirp, doublet, not 'jump'"),
        ("name = 'x'\n[[maneuver]]\nkind = 'chirp'", "maneuver 1: amplitude is missing"),
        ("name = 'x'\n[[maneuver]]\nkind = 'chirp'\npulse_s = 1", "maneuver 1: pulse_s means nothing for a chirp"),
        ("name = 'x'\n[[maneuver]]\nkind = 'chirp'\npuls = 1", "maneuver 1: unknown key 'puls'; there are: kind, amp"),
        ("name = 'x'\n[channels.pp]\nsource = 'a'", "[channels]: unknown key 'pp'; did you mean p?"),
        ("name = 'x'\n[channels.p]\nsource = 3", "[channels.p]: source is text in quotes or a list, not 3"),
        ("name = 'x'\n[channels.p]\nsource = ['a', 3]", "[channels.p]: source[1] is text in quotes, not 3"),
        ("name = 'x'\n[channels.p]\nscal = 3", "[channels.p]: unknown key 'scal'; did you mean scale?"),
        ("name = 'x'\n[largest]\na = 3", "[largest]: key 'a' is no whole number"),
        ("name = 2020-01-01", "name is text in quotes, not "),
        ("name = 'x'\n'\\u001b[2J' = 1", r"unknown key '\\u001b[2J'"),
        ('name = "x"\n"\\u001b[2J" = 1', r"unknown key '\x1b[2J'"),
        ("[[", "not TOML: "),
        ("a = " + "[" * 100_000, "nested too deep"),
        ("a = " + "[" * 90 + "]" * 90, "nested more than 64 deep"),
        ("a." * 200 + "b = 1", "a key of more than 64 parts"),
        ("a = " + "9" * 5000, "a number too long"),
        ("a = '" + "9" * 300_000 + "'", "larger than 256 kB"),
    ],
)
def test_a_fault_is_named_with_its_place(text: str, message: str) -> None:
    with pytest.raises(DocumentError) as error:
        documents.parse_toml(text, Card, "my.toml")
    assert str(error.value).startswith("my.toml: ")
    assert message in str(error.value)
    assert str(error.value).isprintable()
    assert len(str(error.value)) < 200


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not JSON: there is nothing in it"),
        ("{", "not JSON: "),
        ("[]", "it is a table, not a list"),
        ("{}", "format is missing"),
        ('{"format": "fits/1"}', "format is 'gains/1', not 'fits/1'"),
        ('{"format": "gains/1", "K": [[1, 2], [3, NaN]]}', "K[1][1] is a number that is finite, not nan"),
        ('{"format": "gains/1", "K": [[1, 2], [3, 1e999]]}', "K[1][1] is a number that is finite, not inf"),
        ('{"format": "gains/1", "K": [[1, 2], [3, ' + "9" * 400 + "]]}", "K[1][1] is a number that is finite, not a"),
        ('{"format": "gains/1", "K": [[1, 2]]}', "K is 2 rows of 2 numbers"),
        ('{"format": "gains/1", "K": [[1, 2], [3, 4]], "model": {"kind": "chirp"}}', "model.amplitude is missing"),
        (
            '{"format": "gains/1", "K": [[1, 2], [3, 4]], "model": {"kind": "chirp", "amplitude": "0"}}',
            "model.amplitude",
        ),
        ('{"format": "gains/1", "K": [[1, 2], [3, 4]], "more": [NaN]}', "more[0] is not finite"),
        ("[" * 200_000, "nested too deep"),
        ("9" * 5000, "a number too long"),
    ],
)
def test_in_json_a_place_is_a_path(text: str, message: str) -> None:
    with pytest.raises(DocumentError) as error:
        documents.parse_json(text, Gains, "my.json")
    assert str(error.value).startswith("my.json: ")
    assert message in str(error.value)


def test_programs_may_add_keys() -> None:
    document = {"format": "gains/1", "K": [[1, 2], [3, 4]], "new": {"deep": [1, "x", None]}}
    assert documents.parse_json(json.dumps(document), Gains, "x").K == ((1.0, 2.0), (3.0, 4.0))


def test_files_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "card.toml"
    with pytest.raises(DocumentError, match=r"card\.toml: cannot be read as a card \(No such file"):
        documents.read_toml(path, Card, what="card")
    with pytest.raises(DocumentError, match=r"cannot be read as a card \(Is a directory"):
        documents.read_toml(tmp_path, Card, what="card")
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DocumentError, match="not text in UTF-8"):
        documents.read_toml(path, Card, what="card")
    path.write_bytes(b"a" * 300_000)
    with pytest.raises(DocumentError, match="larger than 256 kB"):
        documents.read_toml(path, Card, what="card")
    path.write_bytes(b"\0" * 100)
    with pytest.raises(DocumentError, match="not TOML"):
        documents.read_toml(path, Card, what="card")
    with pytest.raises(DocumentError, match="not JSON"):
        documents.read_json(path, Gains)


def test_what_editors_put_around_a_text_is_no_fault(tmp_path: Path) -> None:
    path = tmp_path / "card.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert documents.read_toml(path, Card) == documents.parse_toml(GOOD, Card, "x")


def test_the_schema_says_the_same(tmp_path: Path) -> None:
    schema = documents.schema(Card)
    jsonschema.Draft202012Validator.check_schema(schema)
    sound = documents.toml_table(GOOD, "x")
    jsonschema.validate(sound, schema)
    for change in ({"axis": "yaw"}, {"repeat": 0}, {"nam": "x"}, {"maneuver": [{"kind": "chirp"}]}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({**sound, **change}, schema)


def test_whatever_is_changed_it_is_read_or_refused() -> None:
    rng = random.Random(1)
    sound = documents.toml_table(GOOD, "x")
    refusals = []
    for _ in range(2000):
        try:
            documents.convert(changed(sound, rng), Card, "x", rng.choice(["TOML", "JSON"]))
        except DocumentError as error:
            refusals.append(str(error))
    assert len(refusals) > 1200
    assert all(text.isprintable() for text in refusals)
    assert not [text for text in refusals if "`" in text], "in our words, not in the library's"


def test_first_fault_sees_what_the_reader_sees() -> None:
    """The description of the struct and the reader agree: what one refuses, so does the other."""
    rng = random.Random(2)
    sound = documents.toml_table(GOOD, "x")
    for _ in range(2000):
        document = changed(sound, rng)
        try:
            documents.convert(document, Card, "x")
        except DocumentError:
            assert first_fault(document, Card) is not None, document
        else:
            assert first_fault(document, Card) is None, document
