"""`tippath fit --export`, `tippath add --export`: a model for other programs, beside what its runs show."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.io import loadmat
from swept_loops import sweeps, truth

Tippath = Callable[..., tuple[int, str, str]]
BAND = ("--band", "0.5:10")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """CSVs of a roll and a pitch sweep under feedback in light gusts, of a vehicle that the package did not make."""
    folder = tmp_path_factory.mktemp("swept")
    (runs,) = sweeps(1, gusts=0.02)
    found = []
    for axis, run in zip(("roll", "pitch"), runs, strict=True):
        found.append(folder / f"{axis}.csv")
        table = np.stack(list(run.values()), axis=1)
        np.savetxt(found[-1], table, delimiter=",", header=",".join(run), comments="", fmt="%.8g")
    return found


def test_the_model_flies_elsewhere_as_the_vehicle_does(flown: list[Path], tippath: Tippath, tmp_path: Path) -> None:
    """Its matrices, read by another library from MATLAB's file, give what the vehicle's own equations do."""
    path = tmp_path / "model.mat"
    assert tippath("fit", *flown, "--model", "tpp", *BAND, "--export", path)[0] == 0
    mat = loadmat(path, simplify_cells=True)
    assert (list(mat["inputs"]), list(mat["outputs"])) == (["delta_x", "delta_y"], ["p", "q"])
    system = control.ss(*(np.atleast_2d(mat[name]) for name in "ABCD"))
    omega = mat["omega_rad_s"]
    theirs = system(1j * omega) * np.exp(-1j * omega * mat["input_delay_s"][0])
    np.testing.assert_allclose(mat["H_model"], theirs, rtol=1e-9)
    expected = truth(mat["frequency_hz"])
    assert np.max(np.abs(mat["H_model"] / expected - 1)) < 0.05
    valid = mat["valid"].astype(bool)
    assert valid[0, 0].mean() > 0.9
    off = np.abs(20 * np.log10(np.abs(mat["H"] / expected)))
    assert np.mean((off < mat["bound_db"])[valid]) > 0.85
    named = dict(zip(mat["parameter_names"], mat["parameter_values"], strict=True))
    assert named["L_b"] == pytest.approx(147.5, rel=0.05)


def test_every_kind_of_file_says_the_same(flown: list[Path], tippath: Tippath, tmp_path: Path) -> None:
    files = {kind: tmp_path / f"model.{kind}" for kind in ("json", "csv", "mat")}
    for path in files.values():
        assert tippath("fit", *flown, "--model", "tpp", "--with", "transport_delay", *BAND, "--export", path)[0] == 0
    document = json.loads(files["json"].read_text())
    assert (document["format"], document["base"]) == ("tippath.model/1", "tpp")
    assert document["effects"] == ["transport_delay"]
    assert document["outside_matrices"] == ["transport_delay"], "in the responses, and as the inputs' delay"
    assert document["input_delay_s"][0] == document["parameters"]["T_d"]["value"]
    pair = next(one for one in document["responses"] if (one["output"], one["input"]) == ("q", "delta_x"))
    mat = loadmat(files["mat"], simplify_cells=True)
    np.testing.assert_allclose(mat["A"], document["A"])
    np.testing.assert_allclose(mat["H_model"][1, 0].real, pair["model_real"])
    np.testing.assert_allclose(mat["H"][1, 0].imag, pair["imaginary"])
    with files["csv"].open() as stream:
        rows = [row for row in csv.DictReader(stream) if (row["output"], row["input"]) == ("q", "delta_x")]
    for name in ("db", "model_db", "model_deg", "bound_deg"):
        np.testing.assert_allclose([float(row[name]) for row in rows], pair[name], rtol=1e-4, atol=1e-6)
    assert tippath("fit", files["csv"], "--model", "cd", *BAND)[0] == 0, "the measured ones are runs, as any"


def test_what_was_not_swept_is_modelled_and_not_measured(flown: list[Path], tippath: Tippath, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    assert tippath("fit", flown[0], "--model", "tpp", *BAND, "--export", path)[0] == 0
    document = json.loads(path.read_text())
    pair = next(one for one in document["responses"] if (one["output"], one["input"]) == ("p", "delta_y"))
    assert pair["reason"] is not None
    assert set(pair["db"]) == {None}
    assert None not in pair["model_db"]
    assert True not in pair["valid"]


def test_an_addition_is_exported_too(flown: list[Path], tippath: Tippath, tmp_path: Path) -> None:
    fit, path = tmp_path / "fit.json", tmp_path / "model.json"
    assert tippath("fit", *flown, "--model", "cd", *BAND, "-o", fit)[0] == 0
    status, _, err = tippath("add", fit, "flapping", "--export", path)
    assert status == 0
    assert f"wrote {path}" in err
    document = json.loads(path.read_text())
    assert (document["base"], document["effects"], document["states"][-2:]) == ("tpp", [], ["a", "b"])


@pytest.mark.parametrize("command", ["fit", "add"])
def test_a_file_is_refused_before_the_work(flown: list[Path], tippath: Tippath, tmp_path: Path, command: str) -> None:
    fit = tmp_path / "fit.json"
    assert tippath("fit", *flown, "--model", "cd", *BAND, "-o", fit)[0] == 0
    asked = ("fit", *flown, "--model", "cd") if command == "fit" else ("add", fit, "flapping")
    status, _, err = tippath(*asked, "--export", tmp_path / "model.slx")
    assert (status, "name a file that ends in .csv, .json, .mat" in err) == (2, True)
    there = tmp_path / "there.mat"
    there.write_bytes(b"mine")
    status, _, err = tippath(*asked, "--export", there)
    assert (status, "add --force" in err, there.read_bytes()) == (2, True, b"mine")
    one = tmp_path / "one.json"
    status, _, err = tippath(*asked, "-o", one, "--export", one)
    assert (status, "two results cannot be written to one file" in err, one.exists()) == (2, True, False)
