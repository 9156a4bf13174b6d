"""`tippath compare`: what is printed, drawn, written and refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

import jsonschema
import planted
import pytest
from contract_schemas import COMPARE
from flying import fly_maneuver, log_of
from more_of_a_kind import thorough
from planted import PLANTED, axes, fly

from sitl.autopilot.vehicle import make_vehicle
from sysid.data.record import Record

pytestmark = pytest.mark.usefixtures("answers_kept")
Tippath = Callable[..., tuple[int, str, str]]
FIVE = ("t", "p", "q", "delta_x", "delta_y")
EXCITED = (*FIVE, "excitation_x", "excitation_y", "omega")

DRAG = '''"""Drag of a long tail."""

from sysid.model.effect import Effect, Stage, magnitude
from sysid.model.parameter import Parameter

with open(__file__ + ".ran", "a") as stream:
    stream.write("x")

EFFECT = Effect(
    id="tail_drag", title="drag of the tail", group="user", equation="q_dot += M_tail q|q|", source="a plate",
    signature="large pitch motions decay faster",
    parameters=(Parameter("M_tail", "-", "pitch acceleration per square of the rate", null=0.0, typical=-2.0),),
    stage=Stage.DYNAMICS, equations=lambda s: {"q_dot": s.M_tail * s.q * magnitude(s.q)}, linear=False,
)
'''


def save(folder: Path, name: str, run: dict[str, Any], channels: tuple[str, ...], axis: str | None) -> Path:
    path = folder / f"{name}.npz"
    kind = "quiet" if axis is None else "chirp"
    record = Record(
        name,
        {key: run[key] for key in channels},
        maneuver=kind,
        axis=axis,
        rate_source="SIDD",
        path=str(path),
        sha256="0" * 64,
        swept_band_hz=(0.5, 10.0),
    )
    record.save(path)
    return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    """Records of a vehicle with a servo that a TPP lacks, of one that lacks nothing, and of quiet hover."""
    folder = tmp_path_factory.mktemp("flown")
    found: dict[str, list[Path]] = {}
    for name, effect in (("lag", "servo_lag"), ("clean", None)):
        flight = fly(effect, PLANTED.get(effect or "", {}), seed=7, duration_s=15.0)
        for number, (run, axis) in enumerate(zip(flight, axes(False), strict=True)):
            found.setdefault(name, []).append(save(folder, f"{name}{number}", run, EXCITED, axis))
            found.setdefault(f"{name} bare", []).append(save(folder, f"{name}-bare{number}", run, FIVE, axis))
    usual = planted.SIZES
    try:
        planted.SIZES = MappingProxyType(dict.fromkeys(usual, 0.0))
        still = fly("servo_lag", PLANTED["servo_lag"], seed=8, duration_s=15.0)
    finally:
        planted.SIZES = usual
    found["quiet"] = [save(folder, f"quiet{i}", run, FIVE, None) for i, run in enumerate(still)]
    return found


@pytest.fixture(scope="module")
def fits(flown: dict[str, list[Path]], answers_kept: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A fit of each, and the CD of the first."""
    from gcs.cli import main

    folder, found = tmp_path_factory.mktemp("fits"), {}
    for name, runs, model in (("lag", "lag", "tpp"), ("clean", "clean", "tpp"), ("cd", "lag", "cd")):
        found[name] = folder / f"{name}.json"
        assert main(["fit", *map(str, flown[runs]), "--model", model, "-o", str(found[name])]) == 0
    found["bare"] = folder / "bare.json"
    assert main(["fit", *map(str, flown["lag bare"]), "--model", "tpp", "-o", str(found["bare"])]) == 0
    return found


def no_constants(text: str) -> Any:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def test_what_is_missing_is_said_in_80_columns(fits: dict[str, Path], tippath: Tippath) -> None:
    for name in ("lag", "cd"):
        status, out, err = tippath("compare", fits[name])
        assert status == 0, err
        assert max(map(len, out.splitlines())) <= 80
        flat = " ".join(out.split())
        assert "linear dynamics are missing there." in flat
        assert "Noise explains" in flat
        for said in ("NRMSE fit, %", "with noise alone", "error by band, %", "above what noise allows", "lag0"):
            assert said in out


def test_nothing_missing_is_said_as_well(fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, _ = tippath("compare", fits["clean"])
    assert status == 0
    assert "what is left is noise: nothing to find here" in out
    assert "missing there" not in out


def test_json(fits: dict[str, Path], tippath: Tippath) -> None:
    for name in fits:
        status, out, _ = tippath("compare", fits[name], "--json")
        assert status == 0
        document = no_constants(out)
        jsonschema.validate(document, COMPARE)
        assert document["nrmse_percent"] == pytest.approx(json.loads(fits[name].read_text())["nrmse_percent"])
        for axis in ("roll", "pitch"):
            for division in ("bands", "windows"):
                shares = [one["error_share"] for one in document[division] if one["axis"] == axis]
                assert sum(shares) == pytest.approx(1)
        assert document["noise_share_is"] == ("upper bound, closed loop" if name == "bare" else "measured")


def test_other_runs_and_quiet_hover(flown: dict[str, list[Path]], fits: dict[str, Path], tippath: Tippath) -> None:
    words = ["compare", fits["bare"], *flown["lag bare"][:2]]
    status, out, _ = tippath(*words, *flown["quiet"], "--json")
    assert status == 0
    document = no_constants(out)
    assert document["noise_share_is"] == "measured"
    assert document["noise_from"] == "quiet hover"
    assert [one["id"] for one in document["runs"]] == ["lag-bare0", "lag-bare1"]
    assert no_constants(tippath(*words, "--json")[1])["noise_from"] == "commands"
    flat = " ".join(tippath("compare", fits["lag"], *flown["clean"])[1].split())
    assert "linear dynamics or their numbers are off there" in flat


def test_one_run_a_short_window_and_another_band(
    flown: dict[str, list[Path]], fits: dict[str, Path], tippath: Tippath
) -> None:
    status, out, _ = tippath("compare", fits["lag"], flown["lag"][0])
    assert status == 0
    assert "the runs do not separate" not in out, "noise on every axis"
    status, out, _ = tippath("compare", fits["lag"], flown["lag"][0], "--window", "3:8.5")
    assert status == 0
    assert "too short to tell noise from error" in " ".join(out.split())
    status, out, _ = tippath("compare", fits["lag"], "--band", "1:8", "--json")
    assert status == 0
    document = no_constants(out)
    assert (document["bands"][0]["low_hz"], document["bands"][-1]["high_hz"]) in ((1.0, 8.0),)


@pytest.mark.parametrize("name", [*thorough(["x.png", "x.svg"]), "x.html"])
def test_a_picture_is_drawn(name: str, fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    path = tmp_path / name
    status, out, err = tippath("compare", fits["lag"], "--plot", path)
    assert status == 0
    assert f"wrote {path}" in err
    assert path.stat().st_size > 20000
    if name == "x.html":
        assert "missing there" in path.read_text(encoding="utf-8")
    assert out


@pytest.mark.thorough
def test_a_picture_is_not_written_over(fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    path.write_text("mine")
    assert tippath("compare", fits["lag"], "--plot", path)[0] == 2
    assert path.read_text() == "mine"
    assert tippath("compare", fits["lag"], "--plot", path, "--force")[0] == 0
    assert path.stat().st_size > 20000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--plot", "x.jpg"], ".png, .svg or .html"),
        (["--plot", "no/such/x.png"], "there is no folder"),
        (["--band", "15:0"], "--band"),
        (["--band", "often"], "--band"),
        (["--window", "5:2"], "--window"),
        (["--with", "a,,b"], "empty name"),
    ],
)
def test_wrong_usage(words: list[str], says: str, fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("compare", fits["lag"], *words)
    assert status == 2
    assert out == ""
    assert says in err


def test_what_the_data_do_not_allow(
    flown: dict[str, list[Path]], fits: dict[str, Path], tippath: Tippath, tmp_path: Path
) -> None:
    empty = tmp_path / "empty.json"
    empty.write_text("{}")
    omega = tmp_path / "omega.json"
    assert tippath("fit", *flown["clean"][:2], "--model", "tpp", "--with", "rotor_speed", "-o", omega)[0] == 0
    for words, says in (
        ([tmp_path / "gone.json"], "gone.json"),
        ([empty], "empty.json"),
        ([fits["lag"], tmp_path / "gone.BIN"], "gone.BIN"),
        ([fits["lag"], *flown["quiet"]], "quiet hover alone"),
        ([fits["lag"], "--band", "0:0.01"], "no frequency"),
        ([fits["lag"], flown["lag"][0], "--window", "3:4"], "at least 5 s"),
        ([omega, *flown["lag bare"]], "omega is not logged"),
    ):
        status, out, err = tippath("compare", *words)
        assert status == 1, err
        assert out == ""
        assert says in err


def test_a_log_that_is_gone_or_has_changed(tippath: Tippath, tmp_path: Path) -> None:
    log, fit = tmp_path / "run.csv", tmp_path / "fit.json"
    flight = fly(None, {}, seed=2, duration_s=20.0)[0]
    lines = [
        ",".join(FIVE),
        *(",".join(f"{x:.7g}" for x in row) for row in zip(*(flight[k] for k in FIVE), strict=True)),
    ]
    log.write_text("\n".join(lines) + "\n")
    assert tippath("fit", log, "--model", "cd", "-o", fit)[0] == 0
    status, out, _ = tippath("compare", fit)
    assert status == 0
    assert "the excitation is not logged" in " ".join(out.split())
    log.write_text("\n".join(lines[:-5]) + "\n")
    status, _, err = tippath("compare", fit)
    assert status == 1
    assert "is not the log this fit was made from any more" in err
    log.unlink()
    status, _, err = tippath("compare", fit)
    assert status == 1
    assert "not there any more" in err


def test_a_users_effect_runs_only_where_it_is_named(
    flown: dict[str, list[Path]], tippath: Tippath, tmp_path: Path
) -> None:
    effect, fit = tmp_path / "tail_drag.py", tmp_path / "tail.json"
    effect.write_text(DRAG)
    assert tippath("fit", *flown["clean"][:2], "--model", "tpp", "--with", effect, "-o", fit)[0] == 0
    trace = effect.with_name(effect.name + ".ran")
    ran = len(trace.read_text())
    status, _, err = tippath("compare", fit)
    assert status == 1
    assert "which is code: name it with --with" in err
    assert len(trace.read_text()) == ran
    status, out, err = tippath("compare", fit, "--with", effect)
    assert status == 0, err
    assert len(trace.read_text()) == ran + 1
    assert "TPP + tail_drag.py against" in out


def test_quiet_hover_in_the_fit_s_own_log_is_found(tippath: Tippath, tmp_path: Path) -> None:
    vehicle = make_vehicle("hover-ideal", seed=6, directory=tmp_path)
    for kind, axis, magnitude in ((0, 10, 0.10), (0, 11, 0.15), (2, 10, 0.0)):
        fly_maneuver(vehicle, kind, axis, magnitude, 10.0)
    log = log_of(vehicle, tmp_path)
    fit = tmp_path / "fit.json"
    assert tippath("fit", tmp_path, "--model", "tpp", "-o", fit)[0] == 0
    assert len(json.loads(fit.read_text())["records"]) == 2, "quiet hover never enters a fit"
    document = no_constants(tippath("compare", fit, "--json")[1])
    assert document["quiet_ratio"]["p"] == pytest.approx(1, abs=0.5)
    assert document["quiet_ratio"]["q"] == pytest.approx(1, abs=0.5)
    assert [one["id"] for one in document["runs"]] == [f"{log.name}#1", f"{log.name}#2"]
