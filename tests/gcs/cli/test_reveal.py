"""`tippath reveal` on answers that the vehicle sealed: opened, judged, and refused where they are damaged."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gcs.cli.sim import CONDITIONS, banner
from gcs.demo.seal import OUTCOMES, open_answer
from sitl.hidden import Hidden, draw, plant_one
from sitl.hidden.seal import seal, seal_answer
from sitl.plants import conditions

Tippath = Callable[..., tuple[int, str, str]]


def sealed(directory: Path, hidden: Hidden) -> str:
    directory.mkdir(parents=True, exist_ok=True)
    return seal_answer(hidden, 5, directory)[1]


def diagnosis(path: Path, **changes: Any) -> Path:
    document = {
        "format": "tippath.diagnosis/1",
        "verdict": "missing",
        "effect": "servo_lag",
        "stands_in": False,
        "indistinguishable": [],
        "candidates": [{"effect": "servo_lag", "parameters": {"tau_s": 0.02}, "implausible": False}],
        **changes,
    }
    path.write_text(json.dumps(document))
    return path


def test_what_was_sealed_comes_back(tmp_path: Path) -> None:
    for seed in range(20):
        hidden = draw(seed, ("hover-ideal", "forward")[seed % 2])
        sha256 = sealed(tmp_path / str(seed), hidden)
        answer = open_answer(tmp_path / str(seed))
        assert answer.document == {"format": "tippath.answer/1", "seed": 5, **hidden.to_json()}
        data = (tmp_path / str(seed) / "answer").read_bytes()
        assert answer.sha256 == sha256 == hashlib.sha256(data).hexdigest()
        assert len(data) == 56 + 2048, "its size says nothing"
        assert not any(word.encode() in data for word in (hidden.id, "sentence", "catalogue"))


def test_the_nonce_makes_equal_answers_unlike(tmp_path: Path) -> None:
    hidden = plant_one("servo_lag", 1)
    assert sealed(tmp_path / "a", hidden) != sealed(tmp_path / "b", hidden)
    assert seal({"one": 1}, bytes(16)) == seal({"one": 1}, bytes(16))


def test_reveal_for_people(tmp_path: Path, tippath: Tippath) -> None:
    hidden = plant_one("servo_lag", 1)
    sha256 = sealed(tmp_path, hidden)
    diagnosis(tmp_path / "d.json")
    (tmp_path / "fit.json").write_text('{"format": "tippath.fit/1"}')
    (tmp_path / "broken.json").write_text("{")
    status, out, err = tippath("reveal", tmp_path)
    assert (status, err) == (0, "")
    assert hidden.sentence in out
    assert sha256 in out
    assert "d.json said missing servo_lag: right" in out
    assert f"tau_s 0.02, truth {hidden.sizes['tau_s']:.4g}" in out
    assert "fit.json" not in out
    assert max(len(line) for line in out.splitlines()) <= 120


CASES: list[tuple[str, dict[str, Any], str]] = [
    ("servo_lag", {}, "right"),
    ("three_slow_servos", {}, "right"),
    ("gyro_lag", {}, "same"),
    ("transport_delay", {}, "wrong"),
    ("transport_delay", {"indistinguishable": ["transport_delay"]}, "not_told_apart"),
    ("none", {}, "wrong"),
    ("none", {"verdict": "complete", "effect": None, "candidates": []}, "right"),
    ("servo_lag", {"verdict": "complete", "effect": None}, "missed"),
    ("servo_lag", {"verdict": "unexplained", "effect": None}, "missed"),
    ("servo_lag", {"verdict": "unexplained", "effect": None, "stands_in": True}, "stand_in"),
    ("transport_delay", {"verdict": "unexplained", "effect": None, "stands_in": True}, "missed"),
    ("rubber_hub", {}, "wrong"),
    ("rubber_hub", {"verdict": "unexplained", "effect": None}, "right"),
    ("rubber_hub", {"verdict": "complete", "effect": None}, "missed"),
    ("none", {"verdict": "unexplained", "effect": None}, "wrong"),
]


@pytest.mark.parametrize(("name", "changes", "outcome"), CASES)
def test_every_outcome(name: str, changes: dict[str, Any], outcome: str, tmp_path: Path, tippath: Tippath) -> None:
    sealed(tmp_path, plant_one(name, 1))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    path = diagnosis(elsewhere / "mine.json", **changes)
    status, out, _ = tippath("reveal", tmp_path, path, "--json")
    assert status == 0
    document = json.loads(out)
    assert document["format"] == "tippath.reveal/1"
    assert document["hidden"] == name
    (one,) = document["diagnoses"]
    assert (one["outcome"], one["path"]) == (outcome, str(path))
    known = outcome in ("right", "stand_in") and "effect" not in changes
    assert [p["name"] for p in one["parameters"]] == (["tau_s"] if known or outcome == "stand_in" else [])
    assert outcome in OUTCOMES
    assert OUTCOMES[outcome] in tippath("reveal", tmp_path, path)[1]


@pytest.mark.parametrize("where", [3, 12, 30, 60, 2103])
def test_a_damaged_answer_is_refused(where: int, tmp_path: Path, tippath: Tippath) -> None:
    sealed(tmp_path, plant_one("servo_lag", 1))
    data = bytearray((tmp_path / "answer").read_bytes())
    data[where] ^= 1
    (tmp_path / "answer").write_bytes(data)
    status, out, err = tippath("reveal", tmp_path)
    assert (status, out) == (1, "")
    assert "damaged" in err or "no sealed answer" in err


@pytest.mark.parametrize("size", [0, 5, 20, 56, 500])
def test_a_cut_answer_is_refused(size: int, tmp_path: Path, tippath: Tippath) -> None:
    sealed(tmp_path, plant_one("servo_lag", 1))
    (tmp_path / "answer").write_bytes((tmp_path / "answer").read_bytes()[:size])
    assert tippath("reveal", tmp_path)[0] == 1


@pytest.mark.parametrize("content", [[1], {"format": "tippath.answer/9"}, {"format": "tippath.answer/1"}])
def test_a_whole_seal_around_something_else_is_refused(content: Any, tmp_path: Path, tippath: Tippath) -> None:
    (tmp_path / "answer").write_bytes(seal(content, bytes(16)))
    status, out, err = tippath("reveal", tmp_path)
    assert (status, out) == (1, "")
    assert "version" in err or "plant is missing" in err


def test_nothing_there(tmp_path: Path, tippath: Tippath) -> None:
    status, _, err = tippath("reveal", tmp_path)
    assert (status, "no answer is sealed" in err) == (1, True)
    assert tippath("reveal", tmp_path / "gone")[0] == 2
    sealed(tmp_path, plant_one("none", 1))
    status, out, _ = tippath("reveal", tmp_path)
    assert (status, "nothing is hidden" in out) == (0, True)
    (tmp_path / "no.json").write_text("{}")
    status, _, err = tippath("reveal", tmp_path, tmp_path / "no.json")
    assert (status, "is no diagnosis" in err) == (1, True)


def test_sim_knows_the_conditions_and_tells_of_the_seal_only(tmp_path: Path) -> None:
    assert tuple(conditions.CONDITIONS) == CONDITIONS
    about = {"link": "l", "ground_link": "g", "plant": "hover-ideal", "seed": 77, "directory": "d"}
    text = banner(json.dumps({**about, "sealed": {"path": "d/answer", "sha256": "abc"}}))
    assert "something may be hidden (sealed in d/answer), seed 77" in text
    assert "SHA-256 abc" in text
    assert "hidden" not in banner(json.dumps({**about, "sealed": None}))


def test_sim_refuses_what_cannot_be_hidden(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gcs.cli", "sim", "--listen", "udpout:127.0.0.1:0", "-o", str(tmp_path / "v")]
    done = subprocess.run([*command, "--hidden", "servo_lagg"], capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "did you mean servo_lag" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_help_documents_the_format(tippath: Tippath) -> None:
    out = " ".join(tippath("reveal", "--help")[1].split())
    assert "tippath.reveal/1" in out
    for outcome in OUTCOMES:
        assert f'"{outcome}"' in out


def cover(directory: Path, packed: bytes) -> Path:
    """A seal that is whole, with this in it."""
    body, nonce = len(packed).to_bytes(4, "big") + packed, bytes(16)
    blocks = range(-(-len(body) // 32))
    stream = b"".join(hashlib.sha256(nonce + block.to_bytes(8, "big")).digest() for block in blocks)
    covered = bytes(a ^ b for a, b in zip(body, stream, strict=False))
    directory.mkdir()
    (directory / "answer").write_bytes(b"TPSEAL1\n" + nonce + hashlib.sha256(nonce + body).digest() + covered)
    return directory


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (bytes(200 << 20), "larger than any answer"),
        (b"[" * 200_000, "nested too deep"),
        (b'{"format": "tippath.answer/1", "plant": 3}', "plant is text in quotes, not 3"),
        (b'{"format": "tippath.answer/2"}', "another version"),
        (b"\xff", "cannot be understood"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_whole_seal_with_something_else_in_it(text: bytes, says: str, tmp_path: Path, tippath: Tippath) -> None:
    packed = zlib.compress(text)
    tracemalloc.start()
    try:
        status, _, err = tippath("reveal", cover(tmp_path / "a", packed))
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
    assert status == 1
    assert says in err
    assert len(err.splitlines()) == 1


def test_a_diagnosis_that_is_none_is_not_judged(tmp_path: Path, tippath: Tippath) -> None:
    sealed(tmp_path, plant_one("servo_lag", 1))
    (tmp_path / "deep.json").write_text("[" * 200_000)
    diagnosis(tmp_path / "lists.json", effect=["servo_lag"], candidates=[{"effect": {}}])
    status, out, _ = tippath("reveal", tmp_path)
    assert status == 0
    assert "no diagnosis lies here" in out
    assert tippath("reveal", tmp_path, tmp_path / "deep.json")[0] == 1
