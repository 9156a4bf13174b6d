"""`tippath response`: what is printed, drawn, written and refused."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from contract_schemas import FREQUENCY_RESPONSE
from scipy.io import loadmat
from swept_loops import sweeps, truth

Tippath = Callable[..., tuple[int, str, str]]
BAND = ("--band", "0.5:10")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """CSVs of a roll and a pitch sweep under feedback in light gusts."""
    folder = tmp_path_factory.mktemp("swept")
    (runs,) = sweeps(1, gusts=0.02)
    found = {}
    for axis, run in zip(("roll", "pitch"), runs, strict=True):
        found[axis] = folder / f"{axis}.csv"
        table = np.stack(list(run.values()), axis=1)
        np.savetxt(found[axis], table, delimiter=",", header=",".join(run), comments="", fmt="%.8g")
    return found


def test_for_people(flown: dict[str, Path], tippath: Tippath) -> None:
    status, out, _ = tippath("response", flown["roll"], flown["pitch"], *BAND)
    assert status == 0
    assert all(len(line) <= 78 for line in out.splitlines())
    assert "delta_x, delta_y: against the logged excitation: feedback does not bias it" in out
    lines = out.splitlines()
    at = lines.index("p per delta_x, rad/s per full command: 0.5-10 Hz")
    hertz, decibels, bound, degrees, *_ = map(float, lines[at + 2].split()[:5])
    expected = truth(np.array([hertz]))[0, 0, 0]
    assert abs(decibels - 20 * np.log10(abs(expected))) < bound + 0.06, "figures of one decimal"
    assert abs(degrees - np.degrees(np.angle(expected))) < 3


def test_the_document(flown: dict[str, Path], tippath: Tippath) -> None:
    status, out, _ = tippath("response", flown["roll"], flown["pitch"], *BAND, "--json")
    assert status == 0
    document = json.loads(out)
    jsonschema.validate(document, FREQUENCY_RESPONSE)
    pair = document["responses"][0]
    assert (pair["output"], pair["input"], pair["reason"]) == ("p", "delta_x", None)
    assert document["feedback_kept_out_by"] == {"delta_x": "excitation logged", "delta_y": "excitation logged"}
    measured = np.array(pair["real"]) + 1j * np.array(pair["imaginary"])
    expected = truth(np.array(document["frequency_hz"]))[0, 0]
    error = np.abs(20 * np.log10(np.abs(measured / expected)))
    assert np.mean(error < np.array(pair["bound_db"])) > 0.85


def test_every_kind_of_file_says_the_same(flown: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    files = {kind: tmp_path / f"frf.{kind}" for kind in ("json", "csv", "mat", "txt")}
    for path in files.values():
        assert tippath("response", flown["roll"], flown["pitch"], *BAND, "-o", path)[0] == 0
    document = json.loads(files["json"].read_text())
    pair = document["responses"][1]
    assert (pair["output"], pair["input"]) == ("q", "delta_x")
    with files["csv"].open() as stream:
        rows = [row for row in csv.DictReader(stream) if (row["output"], row["input"]) == ("q", "delta_x")]
    np.testing.assert_allclose([float(row["db"]) for row in rows], pair["db"], rtol=1e-4)
    assert [bool(int(row["valid"])) for row in rows] == pair["valid"]
    mat = loadmat(files["mat"])
    np.testing.assert_allclose(mat["H"][1, 0], np.array(pair["real"]) + 1j * np.array(pair["imaginary"]))
    np.testing.assert_allclose(mat["omega_rad_s"][:, 0], 2 * np.pi * np.array(document["frequency_hz"]))
    assert [str(name[0]) for name in mat["inputs"][:, 0]] == ["delta_x", "delta_y"]
    part = files["txt"].read_text().split("! OUTPUT: q\n")[1].split("! INPUT")[0]
    table = np.array([list(map(float, line.split())) for line in part.splitlines() if not line.startswith("!")])
    np.testing.assert_allclose(table[:, 0], 2 * np.pi * np.array(document["frequency_hz"]), rtol=1e-5)
    np.testing.assert_allclose(table[:, 2], pair["deg"], rtol=1e-5)
    np.testing.assert_allclose(table[:, 3], pair["coherence"], rtol=1e-5)


def test_it_is_drawn(flown: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    page = tmp_path / "frf.html"
    status, _, err = tippath("response", flown["roll"], flown["pitch"], *BAND, "--plot", page)
    assert status == 0
    assert f"wrote {page}" in err
    assert "<svg" in page.read_text()


def test_one_sweep_alone_is_refused_with_what_to_do(flown: dict[str, Path], tippath: Tippath) -> None:
    status, out, _ = tippath("response", flown["roll"], *BAND)
    assert status == 1
    words = " ".join(out.split())
    assert "q per delta_y: delta_y moves only together with delta_x in these runs" in words
    assert "sweep" in words
    status, out, _ = tippath("response", flown["roll"], *BAND, "--inputs", "delta_x")
    assert status == 0
    assert "p per delta_x, rad/s per full command: 0.5-10 Hz" in out


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["--inputs", "delta_q"], 2, "delta_q: is no channel"),
        (["--inputs", "delta_c"], 1, "delta_c is not logged in every run"),
        (["--outputs", ""], 2, "an empty name: is no channel"),
        (["-o", "frf.xls"], 2, "name a file that ends in .csv, .json, .mat, .txt"),
        (["--plot", "frf.pdf"], 2, ".png, .svg or .html"),
        (["--band", "40:45"], 1, "log faster"),
    ],
)
def test_what_cannot_be_answered(
    flown: dict[str, Path], tippath: Tippath, words: list[str], status: int, said: str
) -> None:
    found, out, err = tippath("response", flown["roll"], flown["pitch"], *words)
    assert (found, said in err + out) == (status, True), err + out
    assert "Traceback" not in err


def test_no_file_is_overwritten(flown: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "frf.csv"
    target.write_text("mine")
    assert tippath("response", flown["roll"], flown["pitch"], "-o", target)[0] == 2
    assert target.read_text() == "mine"
