"""`tippath diagnose` on flights of the simulated vehicle: found, said in one screen, written, refused, judged.

One vehicle hides a servo's lag, one hides nothing; both are flown as fast as they compute, and only their logs are
read. What is expected is the vehicle's own sealed answer.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from contract_schemas import DIAGNOSIS, FIT, REVEAL
from flying import CHIRP, DOUBLET, LAG, LAG_CARD, PITCH, ROLL, flown

from gcs.analysis.text.ladder import bar, ladder_text
from gcs.cards.maneuver import load_card
from sitl.hidden import plant_one
from sitl.hidden.seal import seal_answer

pytestmark = pytest.mark.usefixtures("answers_kept", "few_effects_in_module")
Tippath = Callable[..., tuple[int, str, str]]
LAG_S = plant_one(*LAG).sizes["tau_s"]
DEAD_BAND_CARD = (
    *((CHIRP, axis, size, 10.0) for axis, size in ((ROLL, 0.10), (PITCH, 0.15))),
    *((DOUBLET, axis, size, 5.0) for axis, size in ((ROLL, 0.10), (PITCH, 0.15))),
)

DRAG = '''"""Drag of a long tail."""

from sysid.model.effect import Effect, Stage, magnitude
from sysid.model.parameter import Parameter

EFFECT = Effect(
    id="tail_drag", title="drag of the tail", group="user", equation="q_dot += M_tail q|q|", source="a plate",
    signature="large pitch motions decay faster",
    parameters=(Parameter("M_tail", "-", "pitch acceleration per square of the rate", null=0.0, typical=-2.0),),
    stage=Stage.DYNAMICS, equations=lambda s: {"q_dot": s.M_tail * s.q * magnitude(s.q)}, linear=False,
)
'''


def typed(*words: object) -> str:
    """What a command that succeeds prints."""
    from gcs.cli import main

    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        assert main([str(word) for word in words]) == 0
    return out.getvalue()


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A vehicle with a lag hidden in it, its answer sealed beside its log, and one as its model says."""
    found = {}
    for name, hidden in (("lag", LAG), ("clean", None)):
        folder = tmp_path_factory.mktemp(name)
        if hidden is not None:
            seal_answer(plant_one(*hidden), hidden[1], folder)
        found[name] = folder / "flight.BIN"
        found[name].write_bytes(flown("hover-ideal", LAG_CARD, hidden))
    return found


@pytest.fixture(scope="module")
def fits(logs: dict[str, Path], answers_kept: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder, found = tmp_path_factory.mktemp("fits"), {}
    for name, log, model in (("lag", "lag", "tpp"), ("clean", "clean", "tpp"), ("cd", "lag", "cd")):
        found[name] = folder / f"{name}.json"
        judging = [f"{logs[log]}#{number}" for number in (5, 6, 7)]
        typed("fit", logs[log], "--model", model, "--validate", *judging, "-o", found[name])
    return found


@pytest.fixture(scope="module")
def written(fits: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Everything that one question about the lag can leave behind."""
    folder = tmp_path_factory.mktemp("written")
    found: dict[str, Any] = {"fit": folder / "with.json", "page": folder / "x.html", "term": folder / "term.py"}
    found["card"] = folder / "next.toml"
    text = typed(
        *("diagnose", fits["lag"], "--json", "-o", found["fit"], "--plot", found["page"]),
        *("--suggest", found["term"], "--card", found["card"]),
    )
    found["diagnosis"] = folder / "diagnosis.json"
    found["diagnosis"].write_text(text)
    found["document"] = no_constants(text)
    return found


def no_constants(text: str) -> Any:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def flat(text: str) -> str:
    return " ".join(text.split())


def sentences(text: str) -> list[str]:
    """Those long enough to be noticed twice."""
    return [said for said in flat(text).split(". ") if len(said) > 30]


# ------------------------------------------------------------------------------------------------ words


def test_the_answer_comes_first_on_one_screen(written: dict[str, Any], fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("diagnose", fits["lag"])
    assert status == 0, err
    lines = out.splitlines()
    assert lines[0].startswith("missing: servo_lag")
    assert "confidence" in lines[0] + lines[1]
    assert 20 < len(lines) <= 40
    assert max(len(line) for line in lines if "pytest-" not in line) <= 80  # a path is as long as it is
    assert len(set(sentences(out))) == len(sentences(out))
    assert "first-order lag of the servos" in out
    assert "tau_s = " in out
    assert " ms " in out
    assert "plausible: 0 to 80 ms" in out
    assert "not to be told from gyro_lag" in out
    for said in ("on validation runs", "placebo: ", "why: ", "candidates, the answer first", "not testable here: "):
        assert said in out
    for jargon in ("chi", "bic", "BIC", "inf ", "nan", "0 to inf"):
        assert jargon not in out
    assert f"next: tippath add {fits['lag']} servo_lag -o" in flat(out).replace(" \\ ", " ")


def test_nothing_missing_is_short(fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, _ = tippath("diagnose", fits["clean"])
    assert status == 0
    lines = out.splitlines()
    assert lines[0].startswith("complete: what is left is noise")
    assert len(lines) <= 14
    assert "could hide here" in out
    assert "next: tippath design" in out
    assert "candidates" not in out


def test_explain_says_all_of_it(fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, _ = tippath("diagnose", fits["lag"], "--explain")
    assert status == 0
    assert max(map(len, out.splitlines())) <= 80
    for heading in (" what it is", " why", " what changes", " what else could look so", " not testable here"):
        assert heading in out.splitlines()
    assert "disc_incidence: it needs angle_of_attack" in out
    assert "--explain" not in out


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag")], indirect=True)
def test_no_validation_and_other_runs_are_said(logs: dict[str, Path], fits: dict[str, Path], tippath: Tippath) -> None:
    runs = [f"{logs['lag']}#{number}" for number in (1, 3)]
    status, out, err = tippath("diagnose", fits["lag"], *runs)
    assert status == 0, err
    assert "no validation runs: whether it holds on others is open" in flat(out)
    assert "on validation runs" not in out
    again = flat(out).replace(" \\ ", " ")
    assert f"servo_lag {runs[0]} {runs[1]} -o" in again, "the next command names the same runs"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("quadratic_damping",)], indirect=True)
def test_what_it_may_be_beyond_the_catalogue_is_said_and_in_the_document(
    fits: dict[str, Path], tippath: Tippath
) -> None:
    status, out, err = tippath("diagnose", fits["lag"])
    assert status == 0, err
    status, document, err = tippath("diagnose", fits["lag"], "--json")
    assert status == 0, err
    mode, term = json.loads(document)["beyond"]
    assert mode.startswith("a slow mode at ")
    assert term.startswith("a simple term would do much: ")
    assert f"{mode} {term}" in flat(out)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("dynamic_inflow", "gyro_lag")], indirect=True)
def test_runs_of_two_vehicles_have_no_one_answer(
    logs: dict[str, Path], fits: dict[str, Path], tippath: Tippath
) -> None:
    runs = [f"{logs['lag']}#1", f"{logs['lag']}#3", f"{logs['clean']}#2", f"{logs['clean']}#4"]
    status, out, err = tippath("diagnose", fits["lag"], *runs)
    assert status == 0, err
    lines = out.splitlines()
    assert lines[0].startswith("unexplained: ")
    assert len(lines) <= 40
    assert [line for line in lines if len(line) > 80 and "pytest-" not in line] == [], "but for paths"
    assert "to tell linear from nonlinear: " in out
    assert "next: " in out


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "motor_lag", "servo_backlash", "servo_lag")], indirect=True)
def test_what_an_airframe_cannot_have_is_not_asked(fits: dict[str, Path], tippath: Tippath) -> None:
    absent = {"flapping", "servo_backlash", "servo_lag"}
    words = ("diagnose", fits["cd"], "--airframe", "multirotor")
    for more in ((), ("--explain",)):
        status, out, err = tippath(*words, *more)
        assert status == 0, err
        assert " not asked: 3 effects that a multirotor cannot have; --json names them" in out.splitlines()
        assert not [word for word in ("flapping", "backlash", "linkage", "servos") if word in out]
        assert "of the motors" in out
    document = no_constants(tippath(*words, "--json")[1])
    assert document["airframe"] == "multirotor"
    reasons = {one["effect"]: one["not_testable"] for one in document["candidates"]}
    assert reasons == {"motor_lag": None, **dict.fromkeys(absent, "a multirotor cannot have it")}
    helicopter = tippath("diagnose", fits["cd"], "--airframe", "helicopter")[1]
    assert "not asked" not in helicopter
    assert "missing: flapping" in helicopter


def test_bars_and_ladders_keep_to_their_columns() -> None:
    assert (bar(0.0), bar(1.0, 4), bar(2.0, 4), bar(0.5, 3)) == ("", "████", "████", "█▌")
    rungs = [("+ " + "long_" * 9, {"p": -33.3, "q": 100.0}, None), ("TPP", {"p": 8.0, "q": 9.0}, {"p": 7.0, "q": 6.0})]
    lines = ladder_text(rungs, {"p": 99.9, "q": 99.9})
    assert max(map(len, lines)) <= 78
    columns = {line.index(mark) + len(mark) for line, mark in zip(lines, ("q: fitted", " 100.0", "  9.0"), strict=True)}
    assert len(columns) == 1


# ------------------------------------------------------------------------------------------------ documents


def test_json(written: dict[str, Any]) -> None:
    document = written["document"]
    jsonschema.validate(document, DIAGNOSIS)
    assert (document["verdict"], document["effect"], document["chain"]) == ("missing", "servo_lag", ["servo_lag"])
    assert document["explained_share"] >= 0.8
    assert "gyro_lag" in document["equivalent"]["servo_lag"]
    asked = [one["delta_bic"] for one in document["candidates"] if one["delta_bic"] is not None]
    assert asked == sorted(asked), "best first"
    (lag,) = (one for one in document["candidates"] if one["effect"] == "servo_lag")
    assert lag["explained_share"] == document["explained_share"]
    assert lag["parameters"]["tau_s"] == pytest.approx(LAG_S, rel=0.1)
    untold = {one["effect"] for one in document["candidates"] if one["not_testable"]}
    assert "disc_incidence" in untold


def test_what_it_writes(written: dict[str, Any], fits: dict[str, Path]) -> None:
    fit = no_constants(written["fit"].read_text())
    jsonschema.validate(fit, FIT)
    assert fit["structure"]["effects"] == ["servo_lag"]
    assert [one["effects"] for one in fit["lineage"]] == [[], ["servo_lag"]]
    before = json.loads(fits["lag"].read_text())
    assert all(fit["nrmse_percent"][axis] > before["nrmse_percent"][axis] for axis in ("p", "q"))
    page = written["page"].read_text(encoding="utf-8")
    assert "missing: servo_lag" in page
    assert page.count("<svg") == 1


def test_the_next_maneuver_is_a_card_or_it_is_said_why_not(written: dict[str, Any]) -> None:
    """The lag of servos and of gyros look alike to whatever a card can fly."""
    proposed = written["document"]["next_maneuver"]
    assert proposed["separates"][0] == "servo_lag"
    if proposed["card"] is None:
        assert not written["card"].exists()
        assert "log" in proposed["maneuver"]
    else:
        assert load_card(str(written["card"])).maneuvers


@pytest.mark.thorough
@pytest.mark.usefixtures("few_effects")
def test_a_suggestion_can_be_added_at_once(written: dict[str, Any], fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("add", fits["lag"], written["term"])
    assert status == 0, err
    assert out.startswith("term.py: the error falls")
    assert tippath("diagnose", fits["lag"], "--suggest", written["term"])[0] == 2


def test_the_secret_is_found_named_and_revealed(
    written: dict[str, Any], logs: dict[str, Path], tippath: Tippath
) -> None:
    status, out, _ = tippath("reveal", logs["lag"].parent, written["diagnosis"], "--json")
    assert status == 0
    document = no_constants(out)
    jsonschema.validate(document, REVEAL)
    (one,) = document["diagnoses"]
    assert one["outcome"] == "right"
    ((name, said, truth),) = [tuple(pair.values()) for pair in one["parameters"]]
    assert (name, said) == ("tau_s", pytest.approx(truth, rel=0.1))
    assert "right" in tippath("reveal", logs["lag"].parent, written["diagnosis"])[1]


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag")], indirect=True)
def test_repeat_climbs_from_cd_until_it_is_complete(fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "whole.json"
    status, out, err = tippath("diagnose", fits["cd"], "--repeat", "-o", target)
    assert status == 0, err
    lines = out.splitlines()
    assert lines[0].startswith("ladder")
    assert [line.split("  ")[0] for line in lines[1:4]] == ["CD", "+ flapping", "+ servo_lag"]
    assert any(line.startswith("complete") for line in lines)
    assert max(len(line) for line in lines if "pytest-" not in line) <= 80  # a path is as long as it is
    fit = json.loads(target.read_text())
    assert (fit["structure"]["base"], fit["structure"]["effects"]) == ("tpp", ["servo_lag"])
    assert len(fit["lineage"]) == 3
    document = no_constants(tippath("diagnose", target, "--json")[1])
    assert document["verdict"] == "complete"
    assert document["explained_share"] is None


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag")], indirect=True)
def test_a_user_s_own_effect_is_asked_where_it_is_named(
    fits: dict[str, Path], tippath: Tippath, tmp_path: Path
) -> None:
    effect = tmp_path / "tail_drag.py"
    effect.write_text(DRAG)
    document = no_constants(tippath("diagnose", fits["lag"], "--with", effect, "--json")[1])
    assert str(effect) in {one["effect"] for one in document["candidates"]}
    assert document["effect"] == "servo_lag"


# ------------------------------------------------------------------------------------------------ refusals


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--plot", "x.jpg"], ".png, .svg or .html"),
        (["-o", "no/such/fit.json"], "there is no folder"),
        (["--suggest", "term.txt"], "ends in .py"),
        (["--card", "x.png", "--plot", "x.png"], "to one file"),
        (["--band", "15:0"], "--band"),
        (["--band", "often"], "--band"),
        (["--window", "5:2"], "--window"),
        (["--with", "a,,b"], "empty name"),
    ],
)
def test_wrong_usage(words: list[str], says: str, fits: dict[str, Path], tippath: Tippath) -> None:
    status, out, err = tippath("diagnose", fits["lag"], *words)
    assert (status, out) == (2, "")
    assert says in err


@pytest.mark.parametrize("option", ["-o", "--plot", "--suggest", "--card"])
def test_nothing_is_written_over(option: str, fits: dict[str, Path], tippath: Tippath, tmp_path: Path) -> None:
    path = tmp_path / {"--plot": "x.png", "--suggest": "x.py"}.get(option, "x")
    path.write_text("mine")
    status, _, err = tippath("diagnose", fits["lag"], option, path)
    assert (status, "--force" in err, path.read_text()) == (2, True, "mine")


@pytest.mark.usefixtures("few_effects")
def test_what_is_no_fit_and_runs_that_are_none(
    fits: dict[str, Path], logs: dict[str, Path], tippath: Tippath, tmp_path: Path
) -> None:
    other, broken = tmp_path / "gains.json", tmp_path / "broken.json"
    other.write_text('{"format": "tippath.gains/1"}')
    broken.write_text("{")
    failing = tmp_path / "failing.py"
    failing.write_text("raise RuntimeError('boom')\n")
    log = logs["lag"]
    for words, says in (
        ([other], "tippath.gains/1"),
        ([broken], "not JSON"),
        ([tmp_path / "gone.json"], "gone.json"),
        ([fits["lag"], tmp_path / "gone.BIN"], "gone.BIN"),
        ([fits["lag"], f"{log}#99"], "no such run"),
        ([fits["lag"], f"{log}#5", "--band", "9:15"], "not identifiable"),
        ([fits["lag"], "--band", "14.5:15"], "do not determine the model"),
        ([fits["lag"], "--validate", log], "every one validates"),
        ([fits["lag"], f"{log}#1", f"{log}#3", "--validate", f"{log}#1", f"{log}#3"], "every one validates"),
        ([fits["lag"], "--with", failing], "boom"),
    ):
        status, out, err = tippath("diagnose", *words)
        assert (status, out) == (1, ""), err
        assert says in err
        assert max(map(len, err.splitlines())) < 400


@pytest.mark.usefixtures("few_effects")
def test_a_log_that_changed_or_went(tippath: Tippath, tmp_path: Path) -> None:
    log, fit = tmp_path / "run.csv", tmp_path / "fit.json"
    source = np.random.default_rng(3)
    t = np.arange(0, 12, 0.01)
    columns = [t, *(np.interp(t, t[::7], source.normal(0, 0.1, t[::7].size)) for _ in range(2))]
    p, q = (np.convolve(each, np.exp(-6 * t), "full")[: t.size] * 0.05 for each in columns[1:])
    rows = np.stack([t, p, q, *columns[1:]], axis=1)
    lines = ["t,p,q,delta_x,delta_y", *(",".join(f"{x:.6f}" for x in row) for row in rows)]
    log.write_text("\n".join(lines) + "\n")
    assert tippath("fit", log, "--model", "cd", "-o", fit)[0] == 0
    log.write_text("\n".join(lines[:-5]) + "\n")
    status, _, err = tippath("diagnose", fit)
    assert (status, "is not the log this fit was made from any more" in err) == (1, True)
    log.unlink()
    status, _, err = tippath("diagnose", fit)
    assert (status, "not there any more" in err) == (1, True)


def test_ctrl_c_leaves_nothing_behind(
    fits: dict[str, Path], tippath: Tippath, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = "gcs.analysis.text.diagnosis.diagnosis_text"  # the last thing before the first file
    monkeypatch.setattr(text, lambda *_, **__: os.kill(os.getpid(), signal.SIGINT))
    words = ["-o", "fit.json", "--plot", "x.png", "--suggest", "x.py", "--card", "x.toml"]
    status, out, err = tippath("diagnose", fits["lag"], *words)
    assert (status, out) == (130, "")
    assert "interrupted" in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag")], indirect=True)
def test_a_closed_pipe_is_no_error(fits: dict[str, Path], only_effects: Path) -> None:
    code = f"import pathlib, sysid.model.effect as e; e.FOLDER = pathlib.Path({str(only_effects)!r})"
    words = f"{code}; from gcs.cli import main; raise SystemExit(main())"
    command = f"{sys.executable} -c {shlex.quote(words)} diagnose {fits['clean']} --json | head -c 1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert "Traceback" not in done.stderr
    assert done.stdout == "{"


def test_the_help_documents_the_format(tippath: Tippath) -> None:
    out = tippath("diagnose", "--help")[1]
    for key in DIAGNOSIS["required"]:
        if key != "format":
            assert f'"{key}"' in out, key
    assert "80 %" in out


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("dynamic_inflow", "flapping", "servo_deadband", "servo_lag")], indirect=True)
def test_what_could_hide_behind_a_dead_band_is_told_too(tippath: Tippath, tmp_path: Path) -> None:
    log = tmp_path / "flight.BIN"
    log.write_bytes(flown("hover-ideal", DEAD_BAND_CARD, ("servo_deadband", 3)))
    fit = tmp_path / "fit.json"
    assert tippath("fit", log, "--model", "tpp", "--validate", f"{log}#3", f"{log}#4", "-o", fit)[0] == 0
    status, out, _ = tippath("diagnose", fit)
    assert status == 0
    assert out.startswith("missing: servo_deadband")
    assert "could hide" in out


def test_complete_says_what_is_left_and_whether_it_matters(tippath: Tippath, fits: dict[str, Path]) -> None:
    document = no_constants(tippath("diagnose", fits["clean"], "--json")[1])
    left = document["remainder"]
    assert 0 <= document["within_points"] < 2
    assert left["limit"] == {"gain_db": 1.0, "phase_deg": 5.0}
    assert (left["seen"], left["matters"]) == (None, False)
    assert left["margins"]["gain_db"] < 1
    lines = tippath("diagnose", fits["clean"])[1].splitlines()
    assert any(line.startswith("  what is left, seen or not, could change at most ") for line in lines)
    assert max(map(len, lines)) <= 78
    assert no_constants(tippath("diagnose", fits["lag"], "--json")[1])["within_points"] is None


@pytest.mark.parametrize("words", ["1", "0dB", "1dB,2dB", "5Hz"])
def test_a_limit_is_in_decibels_and_degrees(tippath: Tippath, fits: dict[str, Path], words: str) -> None:
    status, _, err = tippath("diagnose", fits["clean"], "--matters", words)
    assert status == 2
    assert f"--matters {words}: wants changes of margins above 0, such as 1dB,5deg" in " ".join(err.split())


def test_a_limit_without_margins_to_hold_against_it_is_told(tippath: Tippath, fits: dict[str, Path]) -> None:
    said = "no gains hold this model, so --matters has no margins to judge by"
    for name, told in (("cd", True), ("clean", False)):
        document = no_constants(tippath("diagnose", fits[name], "--json", "--matters", "2dB")[1])
        assert any(said in one for one in document["remarks"]) == told
