"""`tippath add` on short flights with known effects: what helps, what does not, what cannot act, and how it is said."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from contract_schemas import ADDED, FIT, JUDGED
from planted import PLANTED, axes, fly

pytestmark = pytest.mark.usefixtures("few_effects", "answers_kept")
Tippath = Callable[..., tuple[int, str, str]]
CHANNELS = ("t", "p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y", "omega")


def save(path: Path, run: dict[str, Any]) -> Path:
    """A run as the CSV that anybody could have written."""
    rows = zip(*(run[name] for name in CHANNELS), strict=True)
    lines = [",".join(CHANNELS), *(",".join(f"{x:.7g}" for x in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    """Roll and pitch chirps, twice each, of a vehicle with a servo's lag and of one with nothing."""
    folder = tmp_path_factory.mktemp("flown")
    found: dict[str, list[Path]] = {}
    for name, effect in (("lag", "servo_lag"), ("clean", None)):
        for seed in (7, 8):
            flight = fly(effect, PLANTED.get(effect or "", {}), seed=seed, duration_s=12.0)
            found.setdefault(name, []).extend(
                save(folder / f"{name}-{seed}-{axis}.csv", run) for run, axis in zip(flight, axes(False), strict=True)
            )
    return found


@pytest.fixture(scope="module")
def fits(flown: dict[str, list[Path]], answers_kept: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """TPP on each with the second flight to judge, TPP without anything to judge, and CD."""
    from gcs.cli import main

    folder, found = tmp_path_factory.mktemp("fits"), {}
    for name, runs, model in (("lag", "lag", "tpp"), ("clean", "clean", "tpp"), ("cd", "lag", "cd")):
        found[name] = folder / f"{name}.json"
        judging = list(map(str, flown[runs][len(flown[runs]) // 2 :]))
        fitted = list(map(str, flown[runs][: len(flown[runs]) // 2]))
        words = ["fit", *fitted, "--model", model, "--validate", *judging, "-o", str(found[name])]
        assert main(words) == 0
    found["alone"] = folder / "alone.json"
    assert main(["fit", *map(str, flown["lag"]), "--model", "tpp", "-o", str(found["alone"])]) == 0
    return found


def no_constants(text: str) -> Any:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def flat(text: str) -> str:
    return " ".join(text.split())


def test_what_helps_is_said_first_and_kept(fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    target, picture = tmp_path / "with.json", tmp_path / "x.svg"
    status, out, err = tippath("add", fits["lag"], "servo_lag", "-o", target, "--plot", picture)
    assert status == 0, err
    lines = out.splitlines()
    assert lines[0].startswith("servo_lag: the error falls, p ")
    assert len(lines) <= 40
    assert max(len(line) for line in lines if "pytest-" not in line) <= 80  # a path is as long as it is
    assert "noise" in next(line for line in lines if line.startswith("ladder"))
    assert [line.split("  ")[0] for line in lines if line.startswith(("TPP", "+ ", "placebo"))][:2] == [
        "TPP",
        "+ servo_lag",
    ]
    assert "the placebo is " in out
    assert " ✓ error falls on runs that were not fitted: p " in out
    assert " ✓ its size is physically plausible: tau_s = " in out
    assert " ms" in out
    assert f"next: tippath diagnose {target}" in flat(out).replace(" \\ ", " ")
    assert picture.read_text(encoding="utf-8").startswith("<?xml")
    document = no_constants(target.read_text())
    for schema in (FIT, JUDGED, ADDED):
        jsonschema.validate(document, schema)
    assert document["structure"]["effects"] == ["servo_lag"]
    assert document["parameters"]["tau_s"]["value"] == pytest.approx(PLANTED["servo_lag"]["tau_s"], rel=0.1)
    assert [one["effects"] for one in document["lineage"]] == [[], ["servo_lag"]]
    assert {one["key"]: one["seen"] for one in document["signs"]}["validation"] is True


def test_the_document_is_the_file(fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "with.json"
    status, out, err = tippath("add", fits["lag"], "transport_delay", "--json", "-o", target)
    assert status == 0, err
    assert no_constants(out) == json.loads(target.read_text())


@pytest.mark.parametrize(
    ("effect", "few_effects"), [("servo_lag", ()), ("servo_backlash", ("servo_backlash",))], indirect=["few_effects"]
)
def test_what_does_nothing_is_said_plainly(effect: str, fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("add", fits["clean"], effect)
    assert status == 0, err
    assert out.startswith(f"{effect} changes next to nothing here")
    assert "✓ error falls" not in out
    assert effect != "servo_lag" or "nothing of it is left" in out
    assert "nothing to keep: go on with" in out
    assert "-o FIT2.json" not in out


@pytest.mark.thorough
def test_without_validation_it_says_what_is_open(fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("add", fits["alone"], "servo_lag")
    assert status == 0, err
    assert "whether it would on other runs is open" in flat(out)
    assert " ? error falls on runs that were not fitted: there are none" in out


def test_flapping_makes_a_tip_path_plane_of_a_cylinder(fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "tpp.json"
    status, out, err = tippath("add", fits["cd"], "flapping", "-o", target)
    assert status == 0, err
    assert [line.split("  ")[0] for line in out.splitlines() if line.startswith(("CD", "+"))] == ["CD", "+ flapping"]
    document = json.loads(target.read_text())
    assert document["structure"]["base"] == "tpp"
    plain = json.loads(fits["lag"].read_text())
    assert document["nrmse_percent"] == pytest.approx(plain["nrmse_percent"], abs=0.05), "as if fitted at once"
    status, _, err = tippath("add", target, "flapping")
    assert (status, "has flapping already" in err) == (2, True)


def test_an_implausible_size_is_no_answer(fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("add", fits["lag"], "dynamic_inflow", "--json")
    assert status == 0, err
    (sign,) = (one for one in no_constants(out)["signs"] if one["key"] == "plausible")
    assert sign["seen"] is False
    assert "physics does not allow" in sign["text"]
    text = flat(tippath("add", fits["lag"], "dynamic_inflow")[1])
    assert "but only at implausible values: dynamic_inflow stands in for something else" in text
    assert "nothing to keep" in text


@pytest.mark.thorough
def test_other_runs_refit_the_parent_first(
    flown: dict[str, list[Path]], fits: dict[str, Path], tippath: Tippath
) -> None:
    status, out, err = tippath("add", fits["clean"], "servo_lag", *flown["lag"], "--json")
    assert status == 0, err
    document = no_constants(out)
    assert {Path(one["path"]).name for one in document["records"]} == {one.name for one in flown["lag"]}
    assert document["validation_nrmse_percent"] is None
    first, second = document["lineage"]
    assert all(first["nrmse_percent"][axis] < second["nrmse_percent"][axis] for axis in ("p", "q"))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["servo_lagg"], "did you mean servo_lag"),
        (["Servo-Lag"], "did you mean servo_lag"),
        (["nonsense"], "`tippath effects` lists them"),
        (["servo_lag", "--plot", "x.jpg"], ".png, .svg or .html"),
        (["servo_lag", "-o", "no/such/fit.json"], "there is no folder"),
        (["servo_lag", "-o", "x.png", "--plot", "x.png"], "to one file"),
        (["servo_lag", "--band", "15:0"], "--band"),
        (["servo_lag", "--window", "5:2"], "--window"),
        (["servo_lag", "--with", "other.py"], "does not use it"),
    ],
)
def test_wrong_usage(words: list[str], says: str, fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("add", fits["lag"], *words)
    assert (status, out) == (2, "")
    assert says in err


def test_what_is_there_already(fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "with.json"
    target.write_text("mine")
    assert tippath("add", fits["lag"], "servo_lag", "-o", target)[0] == 2
    assert target.read_text() == "mine"
    assert tippath("add", fits["lag"], "servo_lag", "-o", target, "--force")[0] == 0
    status, _, err = tippath("add", target, "servo_lag")
    assert (status, "has servo_lag already" in err) == (2, True)
    status, _, err = tippath("add", target, "servo_second_order")
    assert (status, "stand for the same part" in err) == (1, True)
    status, _, err = tippath("add", fits["lag"], "flapping")
    assert (status, "has flapping already" in err) == (2, True)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("raise RuntimeError('boom')", "boom"),
        ("x = 1", "EFFECT"),
        ("EFFECT = (", "EFFECT"),
    ],
    ids=["fails", "empty", "broken"],
)
def test_an_effect_file_that_is_none(
    content: str, says: str, fits: dict[str, Path], tippath: Tippath, tmp_path: Path
) -> None:
    path = tmp_path / "mine.py"
    path.write_text(content + "\n")
    status, out, err = tippath("add", fits["lag"], path)
    assert (status, out) == (1, "")
    assert "mine.py" in err
    assert says in err or "syntax" in err.lower() or "never closed" in err
    assert tippath("add", fits["lag"], tmp_path / "gone.py")[0] == 1


def test_what_cannot_act_and_runs_that_do_not_serve(
    fits: dict[str, Path], flown: dict[str, list[Path]], tippath: Tippath, tmp_path: Path
) -> None:
    gains = tmp_path / "gains.json"
    gains.write_text('{"format": "tippath.gains/1"}')
    for words, says in (
        ([fits["lag"], "disc_incidence"], "it needs angle_of_attack"),
        ([fits["lag"], "elevator"], "elevator cannot act here"),
        ([gains, "servo_lag"], "tippath.gains/1"),
        ([tmp_path / "gone.json", "servo_lag"], "gone.json"),
        ([fits["lag"], "servo_lag", tmp_path / "gone.csv"], "gone.csv"),
        ([fits["lag"], "servo_lag", flown["lag"][0], "--validate", flown["lag"][0]], "every one validates"),
        ([fits["lag"], "servo_lag", flown["lag"][0], "--band", "9:15"], "not identifiable"),
    ):
        status, out, err = tippath("add", *words)
        assert (status, out) == (1, ""), err
        assert says in err


@pytest.mark.thorough
def test_a_closed_pipe_is_no_error(fits: dict[str, Path], few_effects: Path) -> None:
    code = f"import pathlib, sysid.model.effect as e; e.FOLDER = pathlib.Path({str(few_effects)!r})"
    words = f"{code}; from gcs.cli import main; raise SystemExit(main())"
    command = f"{sys.executable} -c {shlex.quote(words)} add {fits['clean']} servo_lag --json | head -c 1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert "Traceback" not in done.stderr
    assert done.stdout == "{"


def test_the_help_documents_what_it_adds(tippath: Tippath) -> None:
    out = tippath("add", "--help")[1]
    for key in ADDED["required"]:
        assert f'"{key}"' in out
