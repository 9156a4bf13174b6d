"""Excitations that nobody logged, rebuilt from what the log or a profile tells of the chirp."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.logs import ingest
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.runs import systemid
from gcs.logs.runs.span import Span
from sysid.data.chirp import placed, with_excitation
from sysid.data.preprocess import EXCITATIONS
from sysid.data.record import Record

Saved = Callable[[bytes, str], Path]

MESSAGES = {
    "MODE": (120, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "SIDS": (10, "QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "RATE": (75, "Qfffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew"),
}
SECONDS, LOW, HIGH = 12.0, 0.5, 8.0


def flown(t: float) -> float:
    """ArduPilot's law from 0.5 to 8 Hz in 12 s, written out once more; t from its start."""
    if not 0 <= t < SECONDS:
        return 0.0
    held = 2 / LOW
    growth = math.log(HIGH / LOW) / (SECONDS - held)
    turns = LOW * (t - held) if t < held else LOW / growth * math.expm1(growth * (t - held))
    return 0.1 * min(1.0, 0.5 - 0.5 * math.cos(math.pi * min(t, 1.0))) * math.sin(2 * math.pi * turns)


def log(
    writer: Callable[..., Any], *, flies: bool = True, sids: bool = True, parameters: Mapping[str, float] | None = None
) -> bytes:
    """One entry into SYSTEMID, of which SIDS tells and no SIDD; the command holds feedback too."""
    made = writer(MESSAGES)
    for name, value in (parameters or {}).items():
        made.add("PARM", 4_000_000, name.encode(), value, 0.0)
    made.add("MODE", 5_000_000, 0, 0, 1)
    for i in range(9000):
        us = 5_000_000 + 2000 * i
        if us == 6_000_000:
            made.add("MODE", us, 25, 25, 2)
            if sids:
                made.add("SIDS", us, 10, 0.1, LOW, HIGH, 1.0, 2 / LOW, SECONDS, 0.0)
        t = us * 1e-6
        p = 12 * flown(t - 7.05) + 0.2 * math.sin(1.3 * t)
        command = flies * flown(t - 7.0) - 0.002 * p
        made.add("RATE", us, 0, 57.3 * p, command, 0, 8 * math.sin(1.7 * t), 0.01 * math.sin(t), *[0.0] * 7)
    made.add("MODE", 23_000_000, 0, 0, 1)
    return bytes(made.data)


def record_of(path: Path, profile: Path | None = None) -> Record:
    (run,) = ingest([path], profile=profile).runs
    assert run.record is not None
    return run.record


def test_settings_without_samples_rebuild_the_chirp(writer: Callable[..., Any], saved: Saved) -> None:
    record = record_of(saved(log(writer), "flight.BIN"))
    assert record.excitation_from == "SIDS"
    truth = np.array([flown(t - 7.0) for t in record.t])
    assert np.sqrt(np.mean((record.channels["excitation_x"] - truth) ** 2)) < 0.03 * np.std(truth)
    assert not np.any(record.channels["excitation_y"])
    assert any(note.startswith("excitation rebuilt from SIDS") for note in record.notes)


SET = {
    "SID_AXIS": 10.0,
    "SID_MAGNITUDE": 0.1,
    "SID_F_START_HZ": LOW,
    "SID_F_STOP_HZ": HIGH,
    "SID_T_REC": SECONDS,
    "SID_T_FADE_IN": 1.0,
    "SID_T_FADE_OUT": 0.0,
}


def off(record: Record) -> float:
    truth = np.array([flown(t - 7.0) for t in record.t])
    return float(np.sqrt(np.mean((record.channels["excitation_x"] - truth) ** 2)) / np.std(truth))


def test_where_sids_is_lost_the_parameters_rebuild_it(writer: Callable[..., Any], saved: Saved) -> None:
    record = record_of(saved(log(writer, sids=False, parameters=SET), "flight.BIN"))
    assert record.excitation_from == "PARM"
    assert off(record) < 0.03


@pytest.mark.parametrize("other", [{"SID_AXIS": 7.0}, {"SID_AXIS": 11.0}, {"SID_T_REC": 0.0}, {"SID_MAGNITUDE": 0.0}])
def test_other_parameters_rebuild_nothing(writer: Callable[..., Any], saved: Saved, other: Mapping[str, float]) -> None:
    record = record_of(saved(log(writer, sids=False, parameters={**SET, **other}), "flight.BIN"))
    assert record.excitation_from == ""


CARD = {
    "kind": "chirp",
    "axis": "roll",
    "target": "command",
    "amplitude": 0.1,
    "f_start_hz": LOW,
    "f_stop_hz": HIGH,
    "duration_s": SECONDS,
    "c1": 4.0,
    "fade_in_s": 1.0,
    "fade_out_s": 0.0,
}


@pytest.mark.parametrize(
    ("entry", "source"),
    [
        ({"parameters": SET}, "flight.json"),
        ({"maneuver": CARD}, "flight.json"),
        ({"maneuver": {**CARD, "target": "rate"}}, ""),
        ({"maneuver": {**CARD, "kind": "doublet"}}, ""),
        ({"maneuver": {**CARD, "amplitude": None}}, ""),
        ({"parameters": SET, "log_start_s": 9.0}, ""),
    ],
    ids=["what was set", "the card", "a rate", "a doublet", "damaged", "another run"],
)
def test_a_flights_own_settings_rebuild_it(
    writer: Callable[..., Any], saved: Saved, entry: Mapping[str, Any], source: str
) -> None:
    path = saved(log(writer, sids=False), "flight.BIN")
    run = {"label": "roll chirp 1/1", "ending": "finished", "log_start_s": 6.0, "log_start_within_s": 0.0, **entry}
    about = {"format": "tippath.flight/1", "log": "card", "runs": [run]}
    (path.parent / "flight.json").write_text(json.dumps(about))
    record = record_of(path)
    assert record.excitation_from == source
    if source:
        assert off(record) < 0.03


def test_a_chirp_that_the_command_does_not_show_is_not_made_up(writer: Callable[..., Any], saved: Saved) -> None:
    record = record_of(saved(log(writer, flies=False), "flight.BIN"))
    assert record.excitation_from == ""
    assert not any(name.startswith("excitation") for name in record.channels)


def test_what_is_logged_is_taken_as_it_is(two_chirps: bytes, saved: Saved) -> None:
    for run in ingest([saved(two_chirps, "flight.BIN")]).runs:
        assert run.record is not None
        assert run.record.excitation_from == ""
        assert np.any(run.record.channels[f"excitation_{'xy'[run.axis == 'pitch']}"])


PROFILE = """
[time]
source = "time"
[channels]
p = {source = "p"}
q = {source = "q"}
delta_x = {source = "u"}
delta_y = {source = "v"}
"""
LAW = 'law = "ardupilot"\nfade_in_s = 1.0\n'
BY_HAND = f"""
[[runs]]
start_s = 2.4
stop_s = 14.4
maneuver = "chirp"
axis = "roll"
swept_band_hz = [{LOW}, {HIGH}]
"""
BY_COLUMNS = """
[settings]
active = "on"
axis = "axis"
f_start_hz = "low"
f_stop_hz = "high"
amplitude = "size"
"""


def table() -> bytes:
    """A CSV with its own settings: the chirp begins at 2 s."""
    rows = ["time,p,q,u,v,on,axis,low,high,size"]
    for i in range(8000):
        t = 0.002 * i
        p = 12 * flown(t - 2.05) + 0.2 * math.sin(1.3 * t)
        numbers = (t, p, 0.1 * math.sin(1.7 * t), flown(t - 2.0) - 0.002 * p, 0.01 * math.sin(t))
        on = int(2.0 - 1e-9 <= t < 2.0 + SECONDS + 0.001)
        rows.append(",".join(f"{x:.6f}" for x in numbers) + f",{on},0,{LOW},{HIGH},0.1")
    return "\n".join(rows).encode()


@pytest.mark.parametrize("runs", [BY_HAND, BY_COLUMNS], ids=["by hand", "by columns"])
def test_a_profile_that_tells_the_law_rebuilds_the_chirp(saved: Saved, runs: str) -> None:
    csv = saved(table(), "flown.csv")
    record = record_of(csv, saved((PROFILE + runs + LAW).encode(), "told.toml"))
    assert record.excitation_from == "the profile's settings"
    truth = np.array([flown(t - 2.0) for t in record.t])
    assert np.sqrt(np.mean((record.channels["excitation_x"] - truth) ** 2)) < 0.05 * np.std(truth)
    untold = record_of(csv, saved((PROFILE + runs).encode(), "untold.toml"))
    assert untold.excitation_from == ""
    assert "excitation_x" not in untold.channels


@pytest.mark.data
@pytest.mark.parametrize("name", ["heli_roll_sweep.BIN", "quad_pitch_sweep.BIN"])
def test_the_law_is_a_real_autopilots(shared_data: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    record = record_of(shared_data / "ardupilot" / name)
    assert record.excitation_from == ""
    spans: list[Span] = []
    find = systemid.find

    def keep(log: DataFlashTables) -> list[Span]:
        spans.extend(find(log))
        return spans

    monkeypatch.setattr(systemid, "find", keep)
    record_of(shared_data / "ardupilot" / name)
    known = spans[0].law
    assert known is not None
    again = with_excitation(record.without(EXCITATIONS), known.chirp, spans[0].start_s, known.within_s, known.source)
    assert again is not None
    letter = "x" if record.axis == "roll" else "y"
    logged = record.channels[f"excitation_{letter}"]
    truth = placed(known.chirp, record.t, logged, spans[0].start_s, known.within_s)
    found = placed(known.chirp, record.t, record.channels[f"delta_{letter}"], spans[0].start_s, known.within_s)
    assert truth is not None
    assert found is not None
    assert truth.share > 0.98
    assert abs(found.start_s - truth.start_s) < found.error_s < 0.03
    assert np.corrcoef(again.channels[f"excitation_{letter}"], logged)[0, 1] > 0.9
