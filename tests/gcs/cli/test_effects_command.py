"""`tippath effects`: the table, one entry, its JSON, and a user's file."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from gcs.cli import effects, main
from sysid.model.effect import FOLDER, catalogue

TEXT = {"type": "string", "minLength": 1}
RANGE = {"type": "array", "items": {"type": ["number", "null"]}, "minItems": 2, "maxItems": 2}
PARAMETER = {
    "type": "object",
    "properties": {
        "name": TEXT,
        "unit": TEXT,
        "meaning": TEXT,
        "null": {"type": ["number", "null"]},
        "null_is_infinite": {"type": "boolean"},
        "bounds": RANGE,
        "plausible": RANGE,
        "typical": {"type": "number"},
        "grid": {"type": "array", "items": {"type": "number"}},
    },
    "required": ["name", "unit", "meaning", "null", "bounds", "plausible"],
}
ENTRY = {
    "type": "object",
    "properties": {
        **dict.fromkeys(("id", "title", "group", "equation", "source", "signature", "stage"), TEXT),
        "parameters": {"type": "array", "items": PARAMETER, "minItems": 1},
        "channels": {"type": "array"},
        "linear": {"type": "boolean"},
        "path": {"type": ["string", "null"]},
    },
    "required": ["id", "title", "group", "equation", "source", "signature", "parameters", "channels", "path"],
}
SCHEMA = {
    "type": "object",
    "properties": {"format": {"const": "tippath.effects/1"}, "effects": {"type": "array", "items": ENTRY}},
    "required": ["format", "effects"],
}


def document(text: str) -> Any:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    found = json.loads(text, parse_constant=refuse)
    jsonschema.validate(found, SCHEMA)
    return found


def test_the_table_lists_all_in_78_columns(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects"]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 78
    for name in catalogue():
        assert f"  {name} " in out
    assert "needs omega" in out


@pytest.mark.parametrize("name", sorted(catalogue()))
def test_one_entry_says_everything(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", name]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 78
    flat = " ".join(out.split())
    effect = catalogue()[name]
    for text in (effect.equation, effect.signature, effect.source, effect.title):
        assert " ".join(text.split()) in flat
    for parameter in effect.parameters:
        assert f"{parameter.name} " in out
        assert parameter.meaning in flat
    assert "inf" not in flat.replace("infinite", "").replace("inflow", "")


def test_json_is_one_document(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "--json"]) == 0
    found = document(capsys.readouterr().out)
    assert [one["id"] for one in found["effects"]] == list(catalogue())
    assert main(["effects", "servo_rate_limit", "--json"]) == 0
    (one,) = document(capsys.readouterr().out)["effects"]
    (rate,) = one["parameters"]
    assert rate["null"] is None
    assert rate["null_is_infinite"] is True
    assert rate["bounds"][1] is None


def test_the_readme_s_table_says_what_entries_declare() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8").split("## What an entry says")[1].split("\n## ")[0]
    rows = re.findall(r"^\| `(\w+)` \| (.*) \| (.*) \| (.*) \| (.*) \|$", text, re.MULTILINE)
    assert len(rows) == 10
    for name, equation, nulls, plausible, source in rows:
        effect = catalogue()[name]
        assert equation.replace("\\|", "|") == effect.equation
        assert source == effect.source
        for one in effect.parameters:
            assert f"{one.name} {effects.null_words(one.null)}" in nulls.split("; ")
            assert any(
                word.startswith(f"{one.name} {effects.range_words(one.plausible)}") for word in plausible.split("; ")
            )


def test_a_users_file_by_path(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    path = tmp_path / "mine.py"
    path.write_text(text.split("```python\n")[1].split("```")[0], encoding="utf-8")
    assert main(["effects", str(path), "--json"]) == 0
    (one,) = document(capsys.readouterr().out)["effects"]
    assert one["path"] == str(path)
    assert len(one["sha256"]) == 64
    assert main(["effects", str(path)]) == 0
    assert "M_tail" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("word", "status", "says"), [("servo-lagg", 2, "tippath effects"), ("lag", 2, "servo_lag"), ("gone.py", 1, "gone")]
)
def test_what_is_not_there(word: str, status: int, says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", word]) == status
    captured = capsys.readouterr()
    assert captured.out == ""
    assert says in captured.err


def test_an_entry_is_drawn_in_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "servo_lag"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (at,) = [i for i, line in enumerate(lines) if line.startswith("  signature ")]
    assert "p from delta_x, with it over without it" in lines[at]
    drawn = lines[at + 2 :]
    assert [line.split()[0] for line in drawn if line.startswith(" Δ")] == ["Δ", "Δ"]
    assert any("⠒" in line or "⠤" in line for line in drawn)
    assert drawn[-1].split()[0] == "Hz"
    assert main(["effects", "servo_backlash"]) == 0
    assert "with it" in capsys.readouterr().out


@pytest.mark.parametrize(("ending", "begins"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("html", b"<!doctype html>")])
def test_an_entry_is_drawn_into_a_file(
    ending: str, begins: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"lag.{ending}"
    assert main(["effects", "servo_lag", "--plot", str(path)]) == 0
    assert capsys.readouterr().err == f"wrote {path}\n"
    assert path.read_bytes().lower().startswith(begins.lower())
    assert main(["effects", "servo_lag", "--plot", str(path)]) == 2
    assert "--force" in capsys.readouterr().err


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "servo_backlash", "elevator")], indirect=True)
def test_the_whole_catalogue_is_drawn_into_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "all.svg"
    assert main(["effects", "--plot", str(path)]) == 0
    assert path.stat().st_size > 20_000
    assert main(["effects", "--plot", str(tmp_path / "all.pdf")]) == 2
    assert "name a file that ends in .png, .svg or .html" in capsys.readouterr().err


def test_what_cannot_stand_on_the_paper_s_vehicle_is_not_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    path, picture = tmp_path / "mine.py", tmp_path / "mine.png"
    path.write_text(text.replace("s.M_tail * s.q", "s.M_tail * s.nobody"), encoding="utf-8")
    assert main(["effects", str(path)]) == 0
    assert "signature " not in capsys.readouterr().out
    assert main(["effects", str(path), "--plot", str(picture)]) == 1
    assert "there is nothing to draw" in capsys.readouterr().err
    assert not picture.exists()
