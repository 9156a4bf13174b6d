"""What users and other programs may rely on: exit statuses, one JSON document, no overwriting, no traceback."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from contract_schemas import FIT, GAINS, JUDGED, RUNS

from gcs.cli import COMMANDS
from sitl.autopilot.control_laws import AttitudeController
from sitl.autopilot.excitation import Excitation, ExcitationSettings
from sitl.plants import make_plant
from sitl.plants.actuators import clip

pytestmark = pytest.mark.usefixtures("logs_kept")
Tippath = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def foreign_csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A CSV in the contract's columns, formatted by hand from the simulator's physics: 15 s roll, 15 s pitch."""
    path = tmp_path_factory.mktemp("csv") / "foreign.csv"
    plant, controller = make_plant("hover-ideal", 8), AttitudeController()
    lines = ["t,p,q,delta_x,delta_y"]
    t = 100.0
    for axis, size in (("roll", 0.1), ("pitch", 0.15)):
        excitation = Excitation(
            ExcitationSettings(kind="chirp", law="tischler", axis=axis, magnitude=size, duration_s=15.0), 4
        )
        for _ in range(8000):
            x, y = controller.step(plant.phi, plant.theta, plant.p, plant.q, 0.0, 0.0)
            added = excitation.step()
            x, y = clip(x + added.x), clip(y + added.y)
            lines.append(f"{t:.3f},{plant.p:.6f},{plant.q:.6f},{x:.6f},{y:.6f}")
            plant.step(x, y, 0.0, 0.0)
            t += 0.002
    path.write_text("\n".join(lines) + "\n")
    return path


def no_constants(text: str) -> Any:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str, tippath: Tippath) -> None:
    status, out, _ = tippath(command, "--help")
    assert status == 0
    assert len(out) > 200


def test_the_top_help_lists_the_commands(tippath: Tippath) -> None:
    status, out, _ = tippath("--help")
    assert status == 0
    for command in COMMANDS:
        assert command in out.split()


@pytest.mark.parametrize(
    "words",
    [
        ["nonsense"],
        [],
        ["fit"],
        ["fit", "x.csv", "--model", "banana"],
        ["fit", "x.csv", "--model", "tpp", "--band", "15:0"],
        ["fit", "x.csv", "--model", "tpp", "--band", "nan:15"],
        ["fit", "x.csv", "--model", "tpp", "--window", "5:2"],
        ["fit", "x.csv", "--model", "tpp", "--window", "now:then"],
        ["design", "f.json", "--input-cost", "much"],
        ["sweep", "--axis", "yaw"],
        ["push", "gains.json"],
    ],
)
def test_wrong_usage_is_status_2(words: list[str], tippath: Tippath) -> None:
    status, out, err = tippath(*words)
    assert status == 2
    assert out == ""
    assert err.strip()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["injest", "x"], "tippath: argument COMMAND: there is no 'injest'; did you mean ingest?"),
        (
            ["diagnose", "f.json", "--explian"],
            "tippath diagnose: there is no option --explian; did you mean --expl",
        ),
        (["report", "f.json", "--pfd"], "tippath report: there is no option --pfd; did you mean --pdf?"),
        (["sweep", "--conect", "udpin:1"], "tippath sweep: there is no option --conect; did you mean --connect?"),
        (["sim", "--plant", "hovr"], "tippath sim: argument --plant: there is no 'hovr'; did you mean hover?"),
        (["fit", "x", "--airframe", "kite"], "tippath fit: argument --airframe: there is no 'kite'; there are heli"),
        (["key", "shw", "x"], "tippath key: argument new|show-id: there is no 'shw'; did you mean show-id?"),
        (["abort", "x"], "tippath abort: the following arguments are required: --connect"),
        (["--vresion"], "tippath: there is no option --vresion; did you mean --version?"),
        (["demo", "more"], "tippath demo: more is one word too many"),
    ],
)
def test_a_typo_is_told_by_the_command_it_was_made_in(words: list[str], told: str, tippath: Tippath) -> None:
    status, out, err = tippath(*words)
    assert (status, out) == (2, "")
    assert err.startswith(told)
    assert err.count("\n") == 2


def test_behind_two_dashes_nothing_is_an_option(tippath: Tippath) -> None:
    status, _, err = tippath("add", "gone.json", "servo_lag", "--", "--pfd")
    assert status == 1
    assert "gone.json" in err


@pytest.mark.parametrize("command", [["report"], ["design"], ["compare"], ["diagnose"], ["add"]])
def test_a_log_in_place_of_a_fit_is_told_the_command_that_makes_one(
    command: list[str], foreign_csv: Path, tippath: Tippath, tmp_path: Path
) -> None:
    more = ["servo_lag"] if command == ["add"] else []
    status, _, err = tippath(*command, foreign_csv, *more)
    assert status == 2
    assert f"`tippath fit {foreign_csv} --model tpp -o tpp.json` makes one" in err
    (tmp_path / "mine.json").write_text('{"format": "tippath.fit/1"}')
    status, _, err = tippath(*command, tmp_path, *more)
    assert status == 2
    assert "name one that is in it: mine.json" in err


def test_a_foreign_csv_is_fitted_by_one_command(foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "tpp.json"
    status, out, err = tippath("fit", foreign_csv, "--model", "tpp", "--json", "-o", target)
    assert status == 0, err
    document = no_constants(out)
    jsonschema.validate(document, FIT)
    jsonschema.validate(document, JUDGED)
    assert document == json.loads(target.read_text()), "the file is the document"
    # nothing of it is about the CSV's clock, its gusts or its controller
    assert document["modes"][0]["frequency_hz"] == pytest.approx(1.634, rel=0.02)
    assert document["modes"][1]["frequency_hz"] == pytest.approx(5.029, rel=0.02)
    assert document["records"][0]["path"].endswith("foreign.csv")
    status, out, _ = tippath("design", target, "--json")
    assert status == 0
    jsonschema.validate(no_constants(out), GAINS)
    status, out, _ = tippath("ingest", foreign_csv, "--json")
    assert status == 0
    jsonschema.validate(no_constants(out), RUNS)


def test_fit_for_people_and_validation(foreign_csv: Path, tippath: Tippath) -> None:
    status, out, _ = tippath("fit", foreign_csv, "--model", "cd")
    assert status == 0
    assert "NRMSE" in out
    assert "L_lat" in out


def test_nothing_is_overwritten_without_force(foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "fit.json"
    target.write_text("mine")
    status, _, err = tippath("fit", foreign_csv, "--model", "cd", "-o", target)
    assert status == 2
    assert "--force" in err
    assert target.read_text() == "mine"
    assert tippath("fit", foreign_csv, "--model", "cd", "-o", target, "--force")[0] == 0
    assert json.loads(target.read_text())["format"] == "tippath.fit/1"


def test_a_folder_that_is_not_there(foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    status, _, err = tippath("fit", foreign_csv, "--model", "cd", "-o", tmp_path / "no" / "fit.json")
    assert status == 2
    assert "there is no folder" in err


def damaged(path: Path, source: Path, edit: Callable[[list[str]], list[str]]) -> Path:
    path.write_text("\n".join(edit(source.read_text().splitlines())) + "\n")
    return path


@pytest.mark.parametrize("torn", ["1oops", "", "100.0,nan,0.1,0.1,0.1", "100.09,3"], ids=str)
def test_a_torn_line_is_left_out_and_said(torn: str, foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    bad = damaged(tmp_path / "bad.csv", foreign_csv, lambda lines: [*lines[:50], torn, *lines[51:]])
    status, out, err = tippath("fit", bad, "--model", "tpp", "--json")
    assert status == 0
    assert no_constants(out)["records"][0]["samples"] == 15999
    assert not torn or "left out" in err


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda lines: [line.rpartition(",")[0] for line in lines], "delta_y"),
        (lambda lines: [*lines[:50], *(line.replace(".", "oops") for line in lines[50:9000]), *lines[9000:]], "oops"),
        (lambda lines: [lines[0], *(line.rpartition(",")[0] + ",nan" for line in lines[1:])], "delta_y"),
        (lambda lines: [*lines[:50], *(line.rpartition(",")[0] for line in lines[50:9000]), *lines[9000:]], "51"),
        (lambda lines: lines[:1], ""),
        (lambda lines: [], ""),
        (lambda lines: lines[:400], "at least 5 s"),
    ],
    ids=["missing column", "text", "nan", "short lines", "header only", "empty", "too short"],
)
def test_bad_csv_is_said_and_nothing_is_written(
    edit: Callable[[list[str]], list[str]], says: str, foreign_csv: Path, tippath: Tippath, tmp_path: Path
) -> None:
    bad = damaged(tmp_path / "bad.csv", foreign_csv, edit)
    status, out, err = tippath("fit", bad, "--model", "tpp", "-o", tmp_path / "fit.json")
    assert status == 1
    assert out == ""
    assert says in err
    assert "bad.csv" in err
    assert not (tmp_path / "fit.json").exists()


def test_too_little_excitation_names_the_axis(foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    """The pitch command stilled: no numbers, no file."""

    def still(lines: list[str]) -> list[str]:
        return [lines[0], *(line.rpartition(",")[0] + ",0.00001" for line in lines[1:])]

    bad = damaged(tmp_path / "still.csv", foreign_csv, still)
    status, out, err = tippath("fit", bad, "--model", "tpp", "--json", "-o", tmp_path / "fit.json")
    assert status == 1
    assert out == ""
    assert "pitch" in err
    assert not (tmp_path / "fit.json").exists()


@pytest.mark.parametrize("content", ["", "{}", "[1, 2]", '{"format": "tippath.fit/1"}', "\x00\x01", "null"])
def test_design_refuses_what_is_no_fit(content: str, tippath: Tippath, tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    path.write_text(content)
    status, out, err = tippath("design", path)
    assert status == 1
    assert out == ""
    assert "fit.json" in err


def test_missing_files(tippath: Tippath, tmp_path: Path) -> None:
    for words in (
        ["fit", "gone.csv", "--model", "cd"],
        ["design", "gone.json"],
        ["ingest", "gone.BIN"],
        ["report", "gone.json"],
    ):
        status, _, err = tippath(words[0], tmp_path / words[1], *words[2:])
        assert status == 1
        assert "gone" in err


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag")], indirect=True)
def test_report_is_self_contained(foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    fit = tmp_path / "fit.json"
    assert tippath("fit", foreign_csv, "--model", "cd", "-o", fit)[0] == 0
    page = tmp_path / "report.html"
    assert tippath("report", fit, "-o", page, "--pdf")[0] == 0
    text = page.read_text(encoding="utf-8")
    figures = text.count("<svg")
    assert figures >= 4  # responses, spectra, the worst runs, the run
    assert re.findall("<b>Figure ([0-9]+)", text) == [str(1 + n) for n in range(figures)]
    assert not re.search(r"(src|href)=(?!\"#)", text.replace("xlink:href", ""))
    assert not re.search(r"https?://(?!www\.w3\.org/)", text)
    assert len(text) < 500_000
    assert page.with_suffix(".pdf").read_bytes().startswith(b"%PDF-")
    for words in (
        (fit, "-o", tmp_path / "x.pdf"),
        (fit, "--pdf", "x.ps"),
        ("--pdf", "x.pdf"),
        ("--pdf", fit, "-o", page),
    ):
        assert tippath("report", *words)[0] == 2
    foreign_csv.rename(foreign_csv.with_suffix(".moved"))
    try:
        status, _, err = tippath("report", fit, "-o", tmp_path / "second.html")
    finally:
        foreign_csv.with_suffix(".moved").rename(foreign_csv)
    assert status == 1
    assert "not there any more" in err


@pytest.mark.thorough
def test_a_report_s_pdf_has_the_name_that_it_is_given(foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    fit, named = tmp_path / "fit.json", tmp_path / "paper.pdf"
    assert tippath("fit", foreign_csv, "--model", "cd", "-o", fit)[0] == 0
    words = ("report", fit, "-o", tmp_path / "report.html", "--no-diagnosis", "--pdf", named)
    assert tippath(*words)[0] == 0
    assert named.read_bytes().startswith(b"%PDF-")


def test_a_closed_pipe_is_no_error(foreign_csv: Path) -> None:
    command = f"{sys.executable} -m gcs.cli ingest {foreign_csv} --json | head -c 1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert "Traceback" not in done.stderr
    assert np.char.startswith(done.stdout, "{")


def test_design_repeats_what_the_fit_warned_of(foreign_csv: Path, tippath: Tippath, tmp_path: Path) -> None:
    """Gains made on a doubtful model say so; a senseless weight is wrong usage."""
    fit = tmp_path / "fit.json"
    assert tippath("fit", foreign_csv, "--model", "tpp", "-o", fit)[0] == 0
    document = json.loads(fit.read_text()) | {"warnings": ["the model leaves much unexplained"]}
    fit.write_text(json.dumps(document))
    status, out, err = tippath("design", fit)
    assert status == 0
    assert "LQR on TPP" in out
    assert "warning of the fit: the model leaves much unexplained" in err
    for weight in ("0", "-3", "nan", "inf"):
        assert tippath("design", fit, f"--input-cost={weight}")[0] == 2
