"""`tippath ingest`: its table, its JSON, its files and its exit status."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from gcs.cli import ingest as command
from gcs.errors import TippathError, UsageError
from sysid.data.record import Record

INTERVAL = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": ["format", "runs", "damage"],
    "properties": {
        "format": {"const": "tippath.runs/1"},
        "damage": {"type": "object"},
        "runs": {
            "type": "array",
            "items": {
                "type": "object",
                "required": [
                    *("id", "path", "maneuver", "axis", "start_s", "duration_s", "rate_hz", "gaps", "usable", "reasons")
                ],
                "properties": {
                    "id": {"type": "string"},
                    "path": {"type": "string"},
                    "maneuver": {"enum": ["chirp", "doublet", "quiet", "unknown"]},
                    "axis": {"enum": ["roll", "pitch", "elevator", None]},
                    "start_s": {"type": "number"},
                    "duration_s": {"type": "number", "minimum": 0},
                    "rate_hz": {"type": ["number", "null"]},
                    "gaps": {"type": "array", "items": INTERVAL},
                    "usable": {"type": "boolean"},
                    "reasons": {"type": "array", "items": {"type": "string"}},
                },
            },
        },
    },
}


def call(*words: str | Path) -> int:
    parser = argparse.ArgumentParser()
    command.add_parser(parser.add_subparsers())
    args = parser.parse_args(["ingest", *map(str, words)])
    status: int = args.run(args)
    return status


def flight(path: Path, seconds: float = 20.0, amplitude: float = 0.1, rate_hz: float = 200.0) -> Path:
    t = np.arange(0, seconds, 1 / rate_hz)
    x, y = amplitude * np.sin(12 * t), amplitude * np.sin(17 * t)
    table = np.column_stack([t, 3 * x, 2 * y, x, y])
    np.savetxt(path, table, "%.6f", ",", header="t,p,q,delta_x,delta_y", comments="")
    return path


def test_the_table_names_runs_and_reasons(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = flight(tmp_path / "good.csv"), flight(tmp_path / "bad.csv", amplitude=1e-5)
    assert call(good, bad) == 0
    out = capsys.readouterr().out
    assert "good.csv#1" in out
    assert "not usable, because" in out
    assert "no excitation" in out


def test_json_is_the_contracts_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(flight(tmp_path / "good.csv"), "--json", "--window", "2:18") == 0
    document = json.loads(capsys.readouterr().out)
    jsonschema.validate(document, SCHEMA)
    (run,) = document["runs"]
    assert (run["id"], run["usable"], run["start_s"], run["duration_s"]) == ("good.csv#1", True, 2.0, 16.0)


def test_no_usable_run_is_status_one_with_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(flight(tmp_path / "slow.csv", rate_hz=20), "--json") == 1
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    jsonschema.validate(document, SCHEMA)
    assert "20.0 Hz" in document["runs"][0]["reasons"][0]
    assert "no run is usable" in captured.err


def test_records_are_written_and_never_overwritten_unasked(tmp_path: Path) -> None:
    log, folder = flight(tmp_path / "flight.csv"), tmp_path / "records"
    assert call(log, "-o", folder) == 0
    record = Record.load(folder / "flight-1.npz")
    assert record.id == "flight.csv#1"
    before = (folder / "flight-1.npz").read_bytes()
    flight(log, seconds=30)
    with pytest.raises(UsageError, match="--force"):
        call(log, "-o", folder)
    assert (folder / "flight-1.npz").read_bytes() == before
    assert call(log, "-o", folder, "--force", "--json") == 0
    assert Record.load(folder / "flight-1.npz").duration_s == pytest.approx(29.995)


def test_logs_of_one_name_get_their_folders_names(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        flight(tmp_path / folder / "x.csv", seconds=20 if folder == "a" else 25)
    assert call(tmp_path / "a" / "x.csv", tmp_path / "b" / "x.csv", "-o", tmp_path / "out") == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a-x-1.npz", "b-x-1.npz"]


def test_an_output_that_is_a_file_is_refused(tmp_path: Path) -> None:
    log = flight(tmp_path / "flight.csv")
    with pytest.raises(UsageError, match="is a file"):
        call(log, "-o", log)


def test_explain_lists_found_missing_and_what_to_write(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(flight(tmp_path / "flight.csv"), "--explain") == 0
    out = capsys.readouterr().out
    found, missing = out.split("channels found")[1].split("not found")
    assert "delta_x" in found
    assert "omega" in missing
    assert "+1 * delta_x" in found
    assert "[channels.p]" in missing
    assert "--profile" in missing


def test_wrong_words_are_wrong_usage(tmp_path: Path) -> None:
    log = flight(tmp_path / "flight.csv")
    with pytest.raises(UsageError, match="--window"):
        call(log, "--window", "5")
    with pytest.raises(TippathError, match="no such file"):
        call(tmp_path / "absent.csv")
    with pytest.raises(SystemExit) as caught:
        call()
    assert caught.value.code == 2


@pytest.mark.parametrize("name", ["absent.csv", "nothing.xyz"])
def test_json_tells_of_a_refusal_too(tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str) -> None:
    (tmp_path / "nothing.xyz").write_text("x")
    path = tmp_path / name
    assert call(path, "--json") == 1
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    jsonschema.validate(document, SCHEMA)
    assert document["runs"] == []
    assert list(document["refused"]) == [str(path)]
    assert document["refused"][str(path)] in captured.err


def test_json_explains_the_channels_with_scale_and_sign(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, profile = flight(tmp_path / "flight.csv"), tmp_path / "mine.toml"
    channels = {"p": -0.5, "q": 1.0, "delta_x": 1.0, "delta_y": 1.0}
    profile.write_text("".join(f'[channels.{name}]\nsource = "{name}"\nscale = {v}\n' for name, v in channels.items()))
    assert call(log, "--json", "--explain", "--profile", profile) == 0
    (source,) = json.loads(capsys.readouterr().out)["sources"]
    assert source["channels"]["p"] == {"unit": "rad/s", "source": "p", "scale": -0.5, "offset": 0.0}
    assert "omega" in source["absent"]
    assert source["fields"] == ["t", "p", "q", "delta_x", "delta_y"]
    assert call(log, "--explain", "--profile", profile) == 0
    assert "rad/s   = -0.5 * p\n" in capsys.readouterr().out


def test_runs_of_logs_with_one_name_can_be_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = [tmp_path / one / "flight-0001" for one in ("a", "b")] + [tmp_path / "b" / "flight-0002"]
    for place in places:
        place.mkdir(parents=True)
        flight(place / "x.csv", seconds=20 + len(str(place)) % 7)
    assert call(*(place / "x.csv" for place in places), flight(tmp_path / "y.csv")) == 0
    ids = [line.split()[0] for line in capsys.readouterr().out.splitlines() if "usable" in line]
    assert ids == ["a/flight-0001/x.csv#1", "b/flight-0001/x.csv#1", "flight-0002/x.csv#1", "y.csv#1"]


def test_nothing_that_a_name_holds_reaches_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    red = "\x1b[31mred.csv"
    flight(tmp_path / red)
    (tmp_path / f"empty{red}").write_text("")
    assert call(tmp_path, "--explain") == 0
    captured = capsys.readouterr()
    assert "?[31mred.csv#1" in captured.out
    assert "\x1b" not in captured.out + captured.err
    with pytest.raises(TippathError) as error:
        call(tmp_path / f"empty{red}")
    assert "\x1b" not in str(error.value)


def test_explain_tells_what_is_there_where_no_run_could_be_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += ["FMT, 2, 31, IMU, Iffffff, TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"]
    lines += [f"IMU, {1000 + 20 * i}, 0.{i % 7}, 0.1, 0.0, 0.1, 0.1, -9.8" for i in range(500)]
    (tmp_path / "old.log").write_text("\n".join(lines) + "\n")
    assert call(tmp_path / "old.log", "--explain") == 1
    found, missing = capsys.readouterr().out.split("channels found")[1].split("not found")
    assert "+1 * IMU.GyrX" in found
    assert "delta_x" in missing
    assert "RCOU.C1" in missing


def test_explain_tells_the_latency_where_it_was_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from gcs.logs.runs import cutting
    from gcs.logs.runs.latency import Latency

    late = Latency("RATE.P", "SIDD.Gy", 0.01, 0.99)
    monkeypatch.setenv("TIPPATH_CACHE", "off")
    monkeypatch.setattr(cutting.latency, "measure", lambda *a: (late,))
    log = flight(tmp_path / "flight.csv")
    assert call(log, "--explain") == 0
    assert "flight.csv#1: RATE.P is 10.0 ms later than SIDD.Gy" in capsys.readouterr().out


def test_a_log_that_says_nothing_leaves_no_empty_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "syslog.log").write_text("Nov 20 kernel: hello\n")
    assert call(tmp_path / "syslog.log", "--explain") == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "not a text DataFlash log" in captured.err


@pytest.mark.data
def test_five_real_logs_at_once(shared_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("heli_roll_sweep.BIN", "heli_pitch_sweep.BIN", "quad_roll_sweep.BIN", "quad_pitch_sweep.BIN", "log171.bin")
    logs = sorted(shared_data / "ardupilot" / name for name in names)
    assert call(*logs, "--json") == 0
    document = json.loads(capsys.readouterr().out)
    jsonschema.validate(document, SCHEMA)
    usable = {run["id"]: run["usable"] for run in document["runs"]}
    assert usable.pop("log171.bin#1") is False
    assert len(usable) == 4
    assert all(usable.values())
    assert document["damage"] == {}
