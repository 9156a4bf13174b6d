"""Blackbox logs: every encoding by a writer of the tests' own, chirps to runs, damage, and a real log."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from blackbox_writer import (
    BETAFLIGHT,
    CHIRP,
    HIGH_HZ,
    LOW_HZ,
    MOTOR_S,
    ROTORFLIGHT,
    SETTINGS,
    Field,
    Flight,
    Writer,
    flight,
    logged,
)
from injuries import COUNTS, bounded_turns, injure
from more_of_a_kind import thorough

from gcs.errors import TippathError
from gcs.logs import ingest, resolve_runs
from gcs.logs.formats import blackbox, blackbox_csv
from gcs.logs.formats.blackbox_table import BlackboxLog
from sysid.data.airframe import Airframe

Saved = Callable[..., Path]
Tippath = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def flown() -> Flight:
    return flight()


@pytest.fixture(scope="module")
def chirps(flown: Flight) -> bytes:
    return logged(flown, "new")


def random_log(
    seed: int, count: int = 400, fields: Sequence[Field] = BETAFLIGHT
) -> tuple[Writer, list[dict[str, int]]]:
    """Numbers of every size in every field."""
    chance = random.Random(seed)
    log = Writer(fields=fields)
    rows = []
    limits = {"rcCommand": 1 << 14, "setpoint": 1 << 14, "mixer": 1 << 14, "vbatLatest": 1 << 12}
    for i in range(count):
        row = {"time": 1_000_000 + 2000 * i + chance.randrange(300)}
        for name, sign, *_ in log.fields:
            if name not in ("time", "loopIteration"):
                most = min(limits.get(name.partition("[")[0], 1 << 30), 1 << chance.choice((1, 3, 5, 7, 12, 20, 29)))
                row[name] = chance.randrange(-most if sign else 0, most)
        if i % 50 == 7:
            log.slow(chance.randrange(1 << 20), 3, chance.randrange(2), 1, 0)
            log.gps(0, 11, chance.randrange(-5000, 5000), 77)
            log.event(30, b"\x05\x04")
            log.event(101, b"\x08Take\x1boff")
        log.add(row)
        rows.append(row)
    return log, rows


@pytest.mark.parametrize("fields", [BETAFLIGHT, ROTORFLIGHT])
def test_every_encoding_and_predictor_comes_back(saved: Saved, fields: Sequence[Field]) -> None:
    log, rows = random_log(5, fields=fields)
    log.end()
    file = blackbox.read(saved(log.data + bytes(200), "flight.bbl"))
    (found,) = file.logs
    assert not file.damage.any
    for name, *_ in log.fields:
        if name not in ("time", "loopIteration"):
            assert np.array_equal(found.columns[name].stored, [row[name] for row in rows]), name
    assert found.series("loopIteration").values == pytest.approx(2 * np.arange(len(rows)))
    assert found.series("debug[0]" if fields is BETAFLIGHT else "mixer[0]").t == pytest.approx(
        [1e-6 * row["time"] for row in rows]
    )
    assert found.texts()[0][1] == "Take?off"
    assert found.modes()[0] == (pytest.approx(1e-6 * rows[6]["time"]), 5)
    assert found.series("rxSignalReceived").values.tolist() == [1] * 8


def test_time_goes_on_where_the_counter_begins_anew(saved: Saved) -> None:
    log = Writer()
    for i in range(100):
        log.add({"time": (0xFFFFFFFF - 100_000 + 2000 * i) & 0xFFFFFFFF})
    (found,) = blackbox.read(saved(log.data, "flight.bbl")).logs
    t = found.series("rssi").t
    assert np.diff(t) == pytest.approx(0.002)


def test_settings_scale_rates_accelerations_and_sums(saved: Saved) -> None:
    values = {"gyroADC[1]": -250, "accSmooth[2]": 1024, "axisP[0]": 400, "axisI[0]": 90, "axisF[0]": 50, "axisD[1]": 7}
    for fine, rate in (("0", -250.0), ("1", -25.0)):
        log = Writer(settings={**SETTINGS, "blackbox_high_resolution": fine})
        for i in range(50):
            log.add({"time": 2000 * i, **values})
        (found,) = blackbox.read(saved(log.data, "flight.bbl")).logs
        assert found.series("gyroADC[1]").values == pytest.approx(rate)
        assert found.series("accSmooth[2]").values == pytest.approx(0.5)
        assert found.series("axisSum[0]").values == pytest.approx(500), "limited by pidsum_limit"
        assert found.series("axisSum[1]").values == pytest.approx(7)
        assert found.airframe is Airframe.MULTIROTOR


# ------------------------------------------------------------------------------------------------ chirps


@pytest.mark.parametrize("kind", ["new", *thorough(["old", "inav"])])
def test_chirps_become_runs_with_their_excitation(saved: Saved, flown: Flight, kind: str) -> None:
    settings = SETTINGS | ({"Firmware revision": "INAV 9.1.0 (abcdef01) MATEKF405"} if kind == "inav" else {})
    found = ingest([saved(logged(flown, kind, settings), "flight.bbl")])
    assert [(run.maneuver, run.axis, run.usable) for run in found.runs] == [
        ("chirp", "roll", True),
        ("chirp", "pitch", True),
    ]
    for place, run in enumerate(found.runs):
        record = run.record
        assert record is not None
        assert record.airframe is Airframe.MULTIROTOR
        assert record.swept_band_hz == pytest.approx((LOW_HZ, HIGH_HZ), rel=0.1)
        own, other = ("excitation_x", "excitation_y")[:: 1 if place == 0 else -1]
        on = np.interp(record.t, flown.t + 7, flown.axis == place) == 1
        scale = 90 / 30 if kind == "inav" else 1.0
        expected = (1, -1)[place] * scale * np.interp(record.t, flown.t + 7, flown.chirp)
        assert record.channels[own][on] == pytest.approx(expected[on], abs=0.06 * scale)
        assert not record.channels[other].any()
        rate = np.radians(np.interp(record.t, flown.t + 7, flown.rate[:, place]))
        assert record.channels["pq"[place]] == pytest.approx((1, -1)[place] * rate, abs=2e-3)
        assert record.loop_dt_s == (None if kind == "inav" else 1e-3)


def test_a_chirp_flight_fits_its_motors(chirps: bytes, saved: Saved, tippath: Tippath) -> None:
    log = saved(chirps, "btfl_001.bbl")
    fit = log.parent / "fit.json"
    code, _, err = tippath(
        *("fit", f"{log}#1", f"{log}#2", "--model", "cd", "--with", "motor_lag", "--band", "0.5:15", "-o", fit)
    )
    assert code == 0, err
    values = json.loads(fit.read_text("utf-8"))["parameters"]
    lag = next(value["value"] for name, value in values.items() if name.startswith("tau"))
    assert lag == pytest.approx(MOTOR_S, rel=0.1)
    assert values["L_lat"]["value"] == pytest.approx(180, rel=0.1)
    assert values["M_lon"]["value"] == pytest.approx(180, rel=0.1)


def test_other_debug_modes_are_no_chirp(saved: Saved) -> None:
    for seed in range(3):
        log, _ = random_log(seed, 200)
        log.settings = {**SETTINGS, **CHIRP}
        (found,) = blackbox.read(saved(log.data, "flight.bbl")).logs
        assert not any(name.startswith("chirp.") for name in found.fields())
    still = Writer(settings={**SETTINGS, **CHIRP})
    for i in range(200):
        still.add({"time": 2000 * i, "debug[0]": 900 + i, "debug[1]": 1, "debug[2]": 30, "debug[3]": 400})
    (found,) = blackbox.read(saved(still.data, "flight.bbl")).logs
    assert not found.has("chirp.axis")


def test_rotorflight_takes_what_goes_to_the_mixer(saved: Saved) -> None:
    """Made: no public log of a helicopter flown with Rotorflight could be had."""
    log = Writer(fields=ROTORFLIGHT, settings={**SETTINGS, "Firmware type": "Rotorflight", "acc_1G": "4096"})
    for i in range(6000):
        t = i / 500
        wave = np.sin(2 * np.pi * (0.4 * t + 0.4 * t * t))
        log.add(
            {"time": 2000 * i, "gyroADC[0]": round(60 * wave), "gyroADC[1]": round(30 * np.cos(3 * t))}
            | {"mixer[0]": round(200 * wave), "mixer[1]": round(-100 * wave), "mixer[3]": 420, "headspeed": 2100}
        )
    (run,) = ingest([saved(log.data, "LOG00001.TXT")]).runs
    assert run.record is not None
    channels, wave = run.record.channels, np.sin(2 * np.pi * (0.4 * run.record.t + 0.4 * run.record.t**2))
    assert run.record.airframe is Airframe.HELICOPTER
    assert channels["delta_x"] == pytest.approx(0.2 * wave, abs=1e-3)
    assert channels["delta_y"] == pytest.approx(0.1 * wave, abs=1e-3)
    assert channels["p"] == pytest.approx(np.radians(60 * wave), abs=0.01)
    assert channels["delta_c"] == pytest.approx(0.42)
    assert channels["omega"] == pytest.approx(2100 * 2 * np.pi / 60)


# ------------------------------------------------------------------------------------------------ decoded


def decoded(log: BlackboxLog, units: Mapping[str, str], settings: str = "") -> bytes:
    """As blackbox_decode and the Explorer write it: numbers as they are stored."""
    names = [name for name, *_ in BETAFLIGHT]
    t = log.series("rssi").t
    columns = [np.round(1e6 * t) if name == "time" else log.columns[name].stored for name in names]
    quote = '"' if settings else ""
    header = ",".join(f"{quote}{name}{units.get(name, '')}{quote}" for name in names)
    rows = ("," if settings else ", ").join(["%d"] * len(names))
    body = "\n".join(rows % tuple(row) for row in np.stack(columns, axis=1).tolist())
    return f"{settings}{header if settings else header.replace(',', ', ')}\n{body}\n".encode()


def test_decoded_csv_is_the_same_log(saved: Saved, chirps: bytes) -> None:
    whole = blackbox.read(saved(chirps, "flight.bbl")).logs[0]
    runs = ingest([saved(chirps, "flight.bbl")]).runs
    settings = "".join(f'"{name}",{value}\n' for name, value in {**CHIRP, "acc_1G": "2048"}.items())
    settings = f'"Product","Blackbox flight data recorder by Nicholas Sherlock"\n{settings}"pidSumLimit",500\n'
    explorer = ingest([saved(decoded(whole, {}, settings), "explorer.csv")]).runs
    for one, other in zip(runs, explorer, strict=True):
        assert one.record is not None
        assert other.record is not None
        assert other.axis == one.axis
        assert other.record.channels.keys() == one.record.channels.keys()
        for name, values in one.record.channels.items():
            assert other.record.channels[name] == pytest.approx(values), name
    plain = saved(decoded(whole, {"time": " (us)", "vbatLatest": " (V)", "gyroADC[0]": " (deg/s)"}), "plain.01.csv")
    (first, second) = ingest([plain]).runs
    assert (first.axis, second.axis) == ("roll", "pitch")
    assert first.record is not None
    assert runs[0].record is not None
    assert "az" not in first.record.channels, "nothing says what 1 g is there"
    assert first.record.channels["delta_x"] == pytest.approx(runs[0].record.channels["delta_x"])


def test_a_profile_of_its_columns_reads_a_decoded_csv_as_it_stands(saved: Saved, chirps: bytes, tmp_path: Path) -> None:
    whole = blackbox.read(saved(chirps, "flight.bbl")).logs[0]
    profile = tmp_path / "mine.toml"
    sources = {"p": "gyroADC[0] (deg/s)", "q": "gyroADC[1]", "delta_x": "axisP[0] / 2", "delta_y": "axisP[1]"}
    channels = "".join(f'[channels.{name}]\nsource = "{source}"\nscale = 1e-3\n' for name, source in sources.items())
    profile.write_text(f'[time]\nsource = "time (us)"\nscale = 1e-6\n{channels}')
    path = saved(decoded(whole, {"time": " (us)", "gyroADC[0]": " (deg/s)"}), "plain.csv")
    (run,) = ingest([path], profile).runs
    assert run.record is not None
    assert run.record.channels["p"] == pytest.approx(1e-3 * whole.columns["gyroADC[0]"].stored)


def test_decoded_csv_without_its_columns_is_told(saved: Saved) -> None:
    head = b'"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"looptime",125\n'
    with pytest.raises(TippathError, match="no line of column names"):
        ingest([saved(head, "flight.csv")])
    with pytest.raises(TippathError, match="no column time"):
        ingest([saved(b"loopIteration, time (h), axisP[0]\n1, 2, 3\n", "flight.csv")])


# ------------------------------------------------------------------------------------------------ damage


def test_several_logs_are_numbered_through(saved: Saved, chirps: bytes) -> None:
    still = Writer()
    for i in range(500):
        still.add({"time": 2000 * i})
    cut = chirps[:3000]
    no_fields = cut[: cut.index(b"Field P")]
    path = saved(still.data + chirps + Writer().data + no_fields + Writer().data + chirps, "btfl_all.bbl")
    found = ingest([path])
    assert [(run.id, run.axis, run.usable) for run in found.runs] == [
        ("btfl_all.bbl#1", None, False),
        ("btfl_all.bbl#2", "roll", True),
        ("btfl_all.bbl#3", "pitch", True),
        ("btfl_all.bbl#4", "roll", True),
        ("btfl_all.bbl#5", "pitch", True),
    ]
    assert any("set debug_mode = CHIRP" in reason for reason in found.runs[0].reasons)
    assert any("3 logs in this file" in note for note in found.sources[0].notes)
    assert "2 more logs in it without samples" in found.sources[0].notes
    assert any("left out" in note and "log 4" in note for note in found.sources[0].notes)
    (record,) = resolve_runs([f"{path}#5"])
    assert record.axis == "pitch"


NOT_READ = {
    "only the mark": (b"H Product:Blackbox flight data recorder by Nicholas Sherlock\n", "which fields"),
    "no mark": (b"\0" * 100, "no blackbox log"),
    "data version": (b"", "data version 1"),
    "encoding": (b"", "encoding 5"),
    "predictor": (b"", "predictor 99"),
    "fields cut": (b"", "fields of its I frames are cut"),
    "no samples": (b"", "no samples"),
}


@pytest.mark.parametrize("case", NOT_READ)
def test_what_cannot_be_read_is_told(saved: Saved, case: str) -> None:
    raw, words = NOT_READ[case]
    head = Writer().data
    changed = {
        "data version": head.replace(b"Data version:2", b"Data version:1"),
        "encoding": head.replace(b"Field I encoding:1,", b"Field I encoding:5,"),
        "predictor": head.replace(b"Field P predictor:6,2", b"Field P predictor:99,2"),
        "fields cut": head.replace(b"Field I signed:0,", b"Field I signed:"),
        "no samples": head,
    }
    path = saved(changed.get(case, raw), "flight.bbl")
    with pytest.raises(TippathError, match=words) as caught:
        ingest([path])
    assert str(caught.value).startswith(str(path))


def test_settings_that_make_no_sense_are_not_taken(saved: Saved) -> None:
    wild = dict.fromkeys((*SETTINGS, *CHIRP, "looptime"), "nan") | {"motorOutput": "inf,x", "pidsum_limit": "-3"}
    log = Writer(settings={**wild, "gyro_scale": "0x7fc00000", "acc_1G": ""})
    log.settings = SETTINGS
    for i in range(50):
        log.add({"time": 2000 * i, "gyroADC[0]": 40, "axisP[0]": 700})
    path = saved(log.data, "flight.bbl")
    (found,) = blackbox.read(path).logs
    assert found.loop_rate_hz is None
    assert found.series("gyroADC[0]").values == pytest.approx(40)
    assert found.series("axisSum[0]").values == pytest.approx(700)
    (run,) = ingest([path]).runs
    assert run.record is not None
    assert "az" not in run.record.channels


@pytest.mark.parametrize("kept", [0, 10, 2000, -1, -7])
def test_a_cut_log_keeps_what_it_has(saved: Saved, chirps: bytes, kept: int) -> None:
    path = saved(chirps[:kept], "flight.bbl")
    if 0 <= kept < 5000:
        with pytest.raises(TippathError):
            ingest([path])
        return
    file = blackbox.read(path)
    assert file.damage.skipped_bytes <= 20
    assert file.logs[0].series("rssi").t.size > 0.99 * 8_500


@pytest.mark.parametrize("count", COUNTS)
def test_no_injury_makes_the_reader_fail_or_invent_times(saved: Saved, count: int) -> None:
    log, rows = random_log(11, 200)
    whole = log.data
    known = {row["time"] for row in rows}
    chance = random.Random(12)
    read, kept = 0, 0.0
    for i in bounded_turns(count):
        path = saved(injure(whole, chance, lambda chance: b"IP"[chance.randrange(2) :][:1], cut=True), "x.bbl")
        try:
            file = blackbox.read(path)
            for run in ingest([path]).runs if i % 5 == 0 else ():
                assert run.record is None or np.all(np.diff(run.record.t) > 0)
        except TippathError:
            continue
        read += 1
        assert 0 <= file.damage.skipped_bytes <= path.stat().st_size
        for found in file.logs:
            t = found.series(next(iter(found.columns))).t  # loopIteration, unless its name is what was damaged
            assert np.all(np.diff(t) > 0)
            kept += len(known & set(np.round(1e6 * t).astype(int).tolist())) / max(t.size, 1)
    assert read > 0.6 * count
    assert kept > 0.9 * read, "nearly all times that are believed were written so"


@pytest.mark.parametrize("count", COUNTS)
def test_no_injury_makes_the_reader_of_decoded_logs_fail(saved: Saved, count: int) -> None:
    log, _ = random_log(13, 150)
    whole = blackbox.read(saved(log.data, "x.bbl")).logs[0]
    raw = decoded(whole, {}, '"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"acc_1G",2048\n')
    chance = random.Random(14)
    read = 0
    for _ in bounded_turns(count):
        path = saved(injure(raw, chance, lambda _: b'"', (1, 3), cut=True), "x.csv")
        try:
            file = blackbox_csv.read(path)
        except TippathError:
            continue
        read += 1
        for found in file.logs:
            assert all(np.all(np.diff(found.series(key).t) > 0) for key in found.fields())
    assert read > 0.15 * count


# ------------------------------------------------------------------------------------------------ real


@pytest.mark.data
def test_the_real_log_is_late_as_is_known(shared_data: Path, tmp_path: Path, tippath: Tippath) -> None:
    """Its README: three logs, flight from 229 to 270.5 s of the third, a delay of 18 to 26 ms from 2 Hz up."""
    path = shared_data / "measured" / "betaflight_btfl_002.bbl"
    if not path.exists():
        pytest.skip(f"NOT CHECKED: {path} is absent")
    file = blackbox.read(path)
    assert [log.series("gyroADC[0]").t.size for log in file.logs] == [1136, 38, 11615]
    assert file.damage.skipped_bytes == 0
    last = file.logs[2]
    assert last.series("gyroADC[0]").values[5000:5003].tolist() == [-28, -27, -27], "as orangebox decodes them"
    assert last.series("motor[3]").values[5000:5003].tolist() == [561, 550, 561]
    fit = tmp_path / "fit.json"
    options = ("--window", "229:270.5", "--model", "cd", "--with", "transport_delay", "--band", "2:15", "-o", fit)
    assert tippath("fit", f"{path}#3", *options)[0] == 0
    values = json.loads(fit.read_text("utf-8"))["parameters"]
    assert 0.018 <= values["T_d"]["value"] <= 0.026
    assert values["L_lat"]["value"] > 0
    assert values["M_lon"]["value"] > 0
