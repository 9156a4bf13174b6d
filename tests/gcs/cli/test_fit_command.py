"""`tippath fit` with effects, held parameters, vehicle files and users' effect files: what is printed, refused, run."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from contract_schemas import FIT, JUDGED
from more_of_a_kind import thorough
from planted import PLANTED, fly

from sysid.data.record import Record
from sysid.model.bases import NAMES

Tippath = Callable[..., tuple[int, str, str]]
FIVE = ("t", "p", "q", "delta_x", "delta_y")
EXCITED = (*FIVE, "excitation_x", "excitation_y", "omega")

TAIL = '''"""Drag of a long tail."""

from sysid.model.effect import Effect, Stage, magnitude
from sysid.model.parameter import Parameter

EFFECT = Effect(
    id="tail_drag", title="drag of the tail", group="user", equation="q_dot += M_tail q|q|", source="a plate",
    signature="large pitch motions decay faster",
    parameters=(Parameter("M_tail", "-", "pitch acceleration per square of the rate", null=0.0, typical=-2.0),),
    stage=Stage.DYNAMICS, equations=lambda s: {"q_dot": s.M_tail * s.q * magnitude(s.q)}, linear=False,
)
'''
TRACE = """
with open(__file__ + ".ran", "a") as stream:
    stream.write("x")
"""


def write_csv(path: Path, run: dict[str, Any], names: tuple[str, ...]) -> Path:
    columns = [run[name] for name in names]
    lines = [",".join(names), *(",".join(f"{x:.7g}" for x in row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    """Records of chirps, two on each axis; CSVs of a vehicle with a lag, named by what they hold."""
    folder = tmp_path_factory.mktemp("flights")
    found: dict[str, list[Path]] = {"base": [], "lag": [], "bare": []}
    for name, effect, size in (("base", None, {}), ("lag", "servo_lag", PLANTED["servo_lag"])):
        for number, run in enumerate(fly(effect, size, seed=21, duration_s=15.0)):
            path = folder / f"{name}{number}.npz"
            axis = ("roll", "pitch")[number % 2]
            channels = {key: run[key] for key in EXCITED}
            Record(
                path.stem,
                channels,
                maneuver="chirp",
                axis=axis,
                rate_source="SIDD",
                path=str(path),
                sha256="0" * 64,
                swept_band_hz=(0.5, 10.0),
                chirp_noise=0.2,
            ).save(path)
            found[name].append(path)
            if name == "base" and number < 2:
                found["bare"].append(write_csv(folder / f"bare{number}.csv", run, FIVE))
    return found


def no_constants(text: str) -> Any:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def test_the_text_shows_the_guides_in_78_columns(flights: dict[str, list[Path]], tippath: Tippath) -> None:
    for words in (["--with", "attitude_stiffness,speed_stability"], ["--with", "second_order_flapping"], []):
        status, out, err = tippath("fit", *flights["base"], "--model", "tpp", *words)
        assert status == 0, err
        assert max(map(len, out.splitlines())) <= 78
        for said in ("CR at most 20 %", "insensitivity at most 10 %", "0.6 or more", "J at most 100", "σ between runs"):
            assert said in out
        assert "measured against the logged excitation" in out
    assert "0 of 9 parameters moved more than 3 σ between runs" in out
    assert "largest correlation: " in out
    assert "not determined" not in out
    assert " above" not in out


def test_what_is_open_gets_no_number(flights: dict[str, list[Path]], tippath: Tippath) -> None:
    _, out, _ = tippath("fit", *flights["base"], "--model", "tpp", "--with", "attitude_stiffness,speed_stability")
    (line,) = [line for line in out.splitlines() if line.startswith("  Y_v ")]
    assert line.split()[1:] == ["not", "determined", "1/s"]
    assert "practical" in out
    assert "Y_v +" in out or "Y_v -" in out, "the direction"


def test_one_sweep_gives_no_mismatch(flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path) -> None:
    roll, path = Record.load(flights["base"][0]), tmp_path / "roll.npz"
    channels = {**roll.channels, "excitation_y": 0 * roll.t}
    Record(
        "roll",
        channels,
        maneuver="chirp",
        axis="roll",
        rate_source="SIDD",
        path=str(path),
        sha256="0" * 64,
        swept_band_hz=(0.5, 10.0),
    ).save(path)
    status, out, _ = tippath("fit", path, "--model", "tpp")
    assert status == 0
    assert out.count("the runs do not separate the commands") == 4
    assert out.splitlines()[:2] == ["TPP fitted to 1 run, 0.5-10 Hz", "  band 0.5 to 10 Hz: what was swept"]
    assert json.loads(tippath("fit", path, "--model", "tpp", "--json")[1])["band_from"] == "swept"


def test_the_band_is_told_with_its_reason(flights: dict[str, list[Path]], tippath: Tippath) -> None:
    for runs, words, said, source in (
        ("base", ("--band", "0.3:12"), "band 0.3 to 12 Hz: as asked for", "given"),
        ("base", (), "band 0 to 15 Hz: the usual one, for the chirps were flown with noise on them", "noise"),
        ("bare", (), " Hz: what was swept", "swept"),
    ):
        out = tippath("fit", *flights[runs], "--model", "cd", *words)[1]
        assert said in " ".join(" ".join(out.splitlines()[1:3]).split()), runs
        document = json.loads(tippath("fit", *flights[runs], "--model", "cd", "--json", *words)[1])
        assert document["band_from"] == source


def test_a_multirotor_fitted_as_what_it_is_not_is_warned_of(flights: dict[str, list[Path]], tippath: Tippath) -> None:
    words = ("--with", "servo_backlash", "--airframe", "multirotor", "--json")
    status, out, _ = tippath("fit", *flights["base"], "--model", "tpp", *words)
    assert status == 0
    document = json.loads(out)
    assert document["warnings"][:2] == [
        "a multirotor has no tip path plane: what TPP tells of it is of something else; fit --model multirotor",
        "a multirotor cannot have servo_backlash (play in the linkages): what it explains here is something else",
    ]
    assert {one["airframe"] for one in document["records"]} == {"multirotor"}
    alone = json.loads(tippath("fit", *flights["base"], "--model", "cd", "--json")[1])
    assert {one["airframe"] for one in alone["records"]} == {None}
    assert not [text for text in alone["warnings"] if "cannot have" in text]


def test_json_has_the_same(flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path) -> None:
    target = tmp_path / "fit.json"
    status, out, _ = tippath("fit", *flights["lag"], "--model", "tpp", "--json", "-o", target)
    assert status == 0
    document = no_constants(out)
    jsonschema.validate(document, FIT)
    jsonschema.validate(document, JUDGED)
    assert document == json.loads(target.read_text())
    assert [(one["output"], one["input"]) for one in document["responses"]] == [
        ("p", "delta_x"),
        ("p", "delta_y"),
        ("q", "delta_x"),
        ("q", "delta_y"),
    ]
    assert max(one["cost"] for one in document["responses"]) > document["guides"]["cost"], "a lag is missing"
    assert document["responses_reference"] == {"delta_x": "excitation_x", "delta_y": "excitation_y"}
    assert document["spread"]["sets"] == 2
    assert document["implied"] == []
    status, out, _ = tippath("fit", *flights["bare"], "--model", "tpp", "--json")
    document = no_constants(out)
    assert document["responses_reference"] == {"delta_x": "delta_x", "delta_y": "delta_y"}
    assert document["spread"] is None


def test_structural_indifference_writes_nothing(
    flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path
) -> None:
    target = tmp_path / "fit.json"
    words = ["fit", *flights["lag"], "--model", "tpp", "--with", "servo_lag,gyro_lag", "-o", target]
    status, out, err = tippath(*words)
    assert status == 1
    assert out == ""
    assert "tau_s" in err
    assert "tau_g" in err
    assert "(structural)" in err
    assert not target.exists()
    status, _, err = tippath(*words, "--fix", "tau_g=0.001")
    assert status == 0, err
    assert json.loads(target.read_text())["parameters"]["tau_g"]["fixed"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--with", "banana"], "no effect 'banana'"),
        (["--with", "servo-lag"], "did you mean servo_lag"),
        (["--with", "servo_lag,servo_lag"], "servo_lag is named twice"),
        (["--with", "servo_lag", "--with", "servo_lag"], "servo_lag is named twice"),
        (["--with", "servo_lag,"], "empty name"),
        (["--with", ""], "empty name"),
        (["--with", "flapping"], "its parameters are the base's own"),
        (["--with", "airspeed_scaling"], "it needs "),
        (["--with", "servo_lag,servo_second_order"], "stand for the same part"),
        (["--fix", "L_b"], "wants NAME=VALUE"),
        (["--fix", "L_b=much"], "wants NAME=VALUE"),
        (["--fix", "L_b=nan"], "wants NAME=VALUE"),
        (["--fix", "L_b=inf"], "wants NAME=VALUE"),
        (["--fix", "=3"], "wants NAME=VALUE"),
        (["--fix", "L_b=1,L_b=2"], "held twice"),
        (["--fix", "banana=3"], "no such parameter; there are L_b, M_a"),
        (["--fix", "tau_s=0.02"], "no such parameter"),
        (["--with", "servo_lag", "--fix", "tau_s=-1"], "its equation holds from 0 to 1"),
        (
            ["--fix", "L_b=1,M_a=1,tau_f=1,A_b=1,B_a=1,A_lat=1,A_lon=1,B_lat=1,B_lon=1"],
            "nothing is left to fit",
        ),
        (["--fix-from", "x.json"], "wants FIT.json:NAME"),
        (["--fix-from", ":L_b"], "wants FIT.json:NAME"),
        (["--fix-from", "x.json:"], "wants FIT.json:NAME"),
    ],
)
def test_words_that_make_no_sense(
    words: list[str], says: str, flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path
) -> None:
    target = tmp_path / "fit.json"
    status, out, err = tippath("fit", *flights["base"], "--model", "tpp", "-o", target, *words)
    assert status == 2, err
    assert out == ""
    assert says in err
    assert not target.exists()


@pytest.mark.parametrize("effect", ["angular_damping", "gyro_misalignment", "hub_gyroscopics"])
def test_effects_that_cd_absorbs(effect: str, flights: dict[str, list[Path]], tippath: Tippath) -> None:
    status, _, err = tippath("fit", *flights["base"], "--model", "cd", "--with", effect)
    assert status == 2
    assert "not testable on cd" in err


def test_a_missing_channel_is_the_data_s_no(flights: dict[str, list[Path]], tippath: Tippath) -> None:
    status, _, err = tippath("fit", *flights["bare"], "--model", "tpp", "--with", "rotor_speed")
    assert status == 1
    assert "rotor_speed" in err
    assert "omega is not logged" in err
    assert "not testable" in err


def test_held_and_held_from_another_fit(flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path) -> None:
    first, second = tmp_path / "first.json", tmp_path / "second.json"
    assert tippath("fit", *flights["base"], "--model", "tpp", "-o", first)[0] == 0
    status, out, err = tippath(
        "fit", *flights["base"], "--model", "tpp", "--fix-from", f"{first}:L_b,M_a", "--fix", "tau_f=0.09", "-o", second
    )
    assert status == 0, err
    parameters = json.loads(second.read_text())["parameters"]
    assert parameters["tau_f"]["value"] == 0.09
    was = json.loads(first.read_text())["parameters"]
    for name in ("L_b", "M_a"):
        assert parameters[name]["value"] == was[name]["value"]
        assert parameters[name]["fixed"]
        assert parameters[name]["standard_error"] is None
    assert out.count("held") == 3
    for words, status, says in (
        (f"{first}:tau_s", 2, "no parameter tau_s"),
        (f"{tmp_path / 'gone.json'}:L_b", 1, "gone.json"),
        (f"{flights['bare'][0]}:L_b", 1, "not JSON"),
    ):
        found, _, err = tippath("fit", *flights["base"], "--model", "tpp", "--fix-from", words)
        assert found == status
        assert says in err
    both = ["--fix-from", f"{first}:L_b", "--fix", "L_b=1"]
    assert tippath("fit", *flights["base"], "--model", "tpp", *both)[0] == 2


def test_a_vehicle_file_is_set_beside(flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path) -> None:
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text("k_beta = 88.0\nmass = 4.5\narm = 0.15\nI_xx = 0.64\nI_yy = 0.4\n")
    words = ["fit", *flights["base"], "--model", "tpp", "--vehicle", vehicle]
    status, out, _ = tippath(*words)
    assert status == 0
    assert max(map(len, out.splitlines())) <= 78
    (I_xx,) = [line for line in out.splitlines() if line.startswith("  I_xx")]
    assert float(I_xx.split()[1]) == pytest.approx(0.641, abs=0.02)
    assert out.count("a clue") == 1, "I_yy is off by three"
    implied = {one["name"]: one for one in no_constants(tippath(*words, "--json")[1])["implied"]}
    assert implied["I_yy"]["value"] == pytest.approx(0.133, abs=0.003)
    assert implied["I_yy"]["implausible"]
    assert implied["Lock number"]["value"] == pytest.approx(1.0, abs=0.05)
    status, out, _ = tippath("fit", *flights["bare"], "--model", "tpp", "--vehicle", vehicle)
    assert "no Lock number" in out
    status, out, _ = tippath("fit", *flights["bare"], "--model", "cd", "--vehicle", vehicle)
    assert "implies nothing" in out
    assert "k_beta = 88.0" in tippath("fit", "--help")[1]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "k_beta is missing"),
        ("mass = 4.5\narm = 0.1", "k_beta is missing"),
        ("k_beta = 88\ncolour = 3", "unknown key 'colour'; there are: k_beta, mass"),
        ("k_beta = 'stiff'", "k_beta is a number"),
        ("k_beta = -88", "k_beta is a number"),
        ("k_beta = 0", "k_beta is a number"),
        ("k_beta = nan", "k_beta is a number"),
        ("k_beta = inf", "k_beta is a number"),
        ("k_beta = true", "k_beta is a number"),
        ("k_beta = [88]", "k_beta is a number"),
        ("k_beta = 88\nmass = 4.5", "mass and arm go together"),
        ("k_beta 88", "not TOML"),
        ("\x00", "not TOML"),
    ],
)
def test_vehicle_files_that_make_no_sense(
    content: str, says: str, flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path
) -> None:
    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text(content)
    status, out, err = tippath("fit", *flights["base"], "--model", "tpp", "--vehicle", vehicle)
    assert status == 1
    assert out == ""
    assert says in err
    assert "vehicle.toml" in err


def test_a_vehicle_file_that_is_not_there(flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path) -> None:
    status, _, err = tippath("fit", *flights["base"], "--model", "tpp", "--vehicle", tmp_path / "gone.toml")
    assert status == 1
    assert "gone.toml" in err


# ------------------------------------------------------------------------------------------- users' effect files


@pytest.fixture
def tail_fit(flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path) -> tuple[Path, Path]:
    """A fit with a user's effect, and the effect's file, which leaves a trace whenever it runs."""
    effect, target = tmp_path / "tail_drag.py", tmp_path / "tail.json"
    effect.write_text(TAIL + TRACE)
    status, _, err = tippath("fit", *flights["bare"], "--model", "tpp", "--with", effect, "-o", target)
    assert status == 0, err
    return target, effect


def times_run(effect: Path) -> int:
    trace = effect.with_name(effect.name + ".ran")
    return len(trace.read_text()) if trace.exists() else 0


def test_a_users_effect_is_kept_by_path_and_hash(tail_fit: tuple[Path, Path], tippath: Tippath) -> None:
    target, _ = tail_fit
    document = json.loads(target.read_text())
    jsonschema.validate(document, FIT)
    assert document["structure"]["effects"] == ["tail_drag.py"]
    assert len(document["structure"]["user_effects"]["tail_drag.py"]) == 64
    assert "M_tail" in document["parameters"]
    assert document["lineage"][0]["effects"] == []


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag")], indirect=True)
@pytest.mark.parametrize("command", ["design", *thorough(["report"])])
def test_the_code_runs_only_where_it_is_named(
    command: str, tail_fit: tuple[Path, Path], tippath: Tippath, tmp_path: Path
) -> None:
    target, effect = tail_fit
    ran = times_run(effect)
    result = tmp_path / ("gains.json" if command == "design" else "page.html")
    status, _, err = tippath(command, target, "-o", result)
    assert status == 1
    assert "which is code: name it with --with" in err
    assert times_run(effect) == ran
    assert not result.exists()
    status, _, err = tippath(command, target, "--with", effect, "-o", result)
    assert status == 0, err
    assert times_run(effect) == ran + 1
    assert result.exists()


def test_held_from_a_fit_with_a_users_effect(
    tail_fit: tuple[Path, Path], flights: dict[str, list[Path]], tippath: Tippath
) -> None:
    target, effect = tail_fit
    words = ["fit", *flights["bare"], "--model", "tpp", "--fix-from", f"{target}:M_tail"]
    status, _, err = tippath(*words)
    assert status == 1
    assert "name it with --with" in err
    status, out, err = tippath(*words, "--with", effect)
    assert status == 0, err
    assert "held" in out


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda path: path.write_text(TAIL + "# other\n"), "has changed since this fit was made"),
        (lambda path: path.write_text("def"), "its code was not run"),
        (lambda path: path.write_text("raise SystemExit(3)"), "its code was not run"),
        (lambda path: path.write_text("x = 1"), "its code was not run"),
        (lambda path: path.unlink(), "cannot be read"),
    ],
    ids=["changed", "syntax", "exits", "no EFFECT", "gone"],
)
def test_a_changed_or_broken_file_is_said(
    change: Callable[[Path], object], says: str, tail_fit: tuple[Path, Path], tippath: Tippath, tmp_path: Path
) -> None:
    target, effect = tail_fit
    change(effect)
    for command in ("design", "report"):
        status, _, err = tippath(command, target, "--with", effect, "-o", tmp_path / "result")
        assert status == 1
        assert says in err
        assert "tail_drag.py" in err


def broken(text: str, old: str, new: str) -> str:
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("1/0", "ZeroDivisionError"),
        ("EFFECT = 3", "EFFECT is not an Effect but int"),
        ("import sys; sys.exit(0)", "SystemExit"),
        ("\x00", "not an effect file"),
        (broken(TAIL, "s.M_tail", "s.M_tale"), "its equations fail (AttributeError: M_tale)"),
        (broken(TAIL, '"q_dot": s', '"qq_dot": s'), "there is no state qq"),
        (broken(TAIL, "s.M_tail * s.q * magnitude(s.q)", "1.0 if s.q > 0 else 0.0"), "its equations fail (ValueError"),
        (broken(TAIL, '{"q_dot": s.M_tail * s.q * magnitude(s.q)}', "3"), "its equations fail"),
        (broken(TAIL, "s.M_tail * s.q * magnitude(s.q)", "s.q / (s.M_tail - s.M_tail)"), "no finite numbers"),
        (broken(TAIL, '"M_tail"', '"L_b"'), "the name L_b is taken"),
        (broken(TAIL, "linear=False", 'linear=False, channels=("omega",)'), "omega is not logged"),
    ],
    ids=["raises", "no effect", "exits", "bytes", "name", "state", "branch", "no mapping", "nan", "taken", "channel"],
)
def test_effect_files_that_cannot_be_used(
    content: str, says: str, flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path
) -> None:
    effect = tmp_path / "mine.py"
    effect.write_text(content)
    status, out, err = tippath("fit", *flights["bare"], "--model", "tpp", "--with", effect, "-o", tmp_path / "f.json")
    assert status in (1, 2)
    assert out == ""
    assert says in err
    assert not (tmp_path / "f.json").exists()


def test_an_effect_file_that_is_not_there(flights: dict[str, list[Path]], tippath: Tippath, tmp_path: Path) -> None:
    for path in (tmp_path / "gone.py", tmp_path):
        status, _, err = tippath("fit", *flights["bare"], "--model", "tpp", "--with", path)
        assert status in (1, 2)
        assert path.name in err


def test_a_word_that_names_no_base_is_wrong_usage(tippath: Tippath) -> None:
    status, _, err = tippath("fit", "x.csv", "--model", "ttp")
    assert (status, "did you mean tpp?" in err) == (2, True)
    status, out, _ = tippath("fit", "--help")
    assert status == 0
    assert all(name in out for name in NAMES)


def test_a_file_that_is_no_base_is_said_before_any_log_is_read(tippath: Tippath, tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("x = 1\n", encoding="utf-8")
    status, _, err = tippath("fit", tmp_path / "none.csv", "--model", path)
    assert (status, "mine.py: not a base file" in err) == (1, True)
