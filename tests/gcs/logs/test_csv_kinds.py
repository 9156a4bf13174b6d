"""CSV logs of every kind: encodings, separators, units, and what an SD card does to them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import TippathError
from gcs.logs import Run, Source, ingest
from gcs.logs.profile import profiles
from gcs.logs.profile.proposal import propose
from gcs.logs.profile.units import factor
from sysid.data.record import Record

Saved = Callable[[bytes, str], Path]
NAMES = ("t", "p", "q", "delta_x", "delta_y")


def flight(count: int = 4000, rate_hz: float = 200.0) -> np.ndarray:
    """Columns t, p, q, delta_x, delta_y of a maneuver; six decimals."""
    t = np.arange(count) / rate_hz
    x, y = 0.1 * np.sin(2 * np.pi * t), 0.1 * np.cos(2 * np.pi * 1.3 * t)
    return np.round(np.column_stack([t, 3 * x, 2 * y, x, y]), 6)


def lines(table: np.ndarray, separator: str = ",", header: tuple[str, ...] | None = NAMES) -> list[str]:
    rows = [separator.join(f"{v:.6f}" for v in row) for row in table]
    return rows if header is None else [separator.join(header), *rows]


def raw(rows: list[str], encoding: str = "utf-8") -> bytes:
    return ("\n".join(rows) + "\n").encode(encoding)


def read(path: Path, profile: Path | None = None) -> tuple[Record, Run, Source]:
    found = ingest([path], profile)
    (run,) = found.runs
    (source,) = found.sources
    assert run.record is not None
    return run.record, run, source


def assert_same(record: Record, table: np.ndarray, names: tuple[str, ...] = NAMES) -> None:
    for i, name in enumerate(names):
        assert np.array_equal(record.channels[name], table[:, i]), name


# ------------------------------------------------------------------------------------------------ how it is written


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1", "cp1252", "ascii"]
)
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_every_encoding_and_line_end(saved: Saved, encoding: str, ending: str) -> None:
    odd = "" if encoding == "ascii" else "Größe °µ"
    rows = ["# flown at 5 °C" if odd else "# flown", *lines(flight(), header=(*NAMES, odd or "x"))]
    rows[2:] = [row + ",0" for row in rows[2:]]
    record, run, _ = read(saved(ending.join([*rows, ""]).encode(encoding), "f.csv"))
    assert run.usable
    assert_same(record, flight())


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " ", "   ", "\t ", " , ", "; "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_every_separator(saved: Saved, separator: str, decimal: str) -> None:
    if decimal == "," and "," in separator:
        pytest.skip("a comma cannot be both")
    rows = [row.replace(".", decimal) for row in lines(flight(), separator)]
    record, _, source = read(saved(raw(rows), "f.csv"))
    assert_same(record, flight())
    assert source.damage is not None
    assert not source.damage.any
    assert ("decimals are written with commas" in source.hints) == (decimal == ",")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_separator_at_the_end_of_rows_is_no_column(saved: Saved, separator: str) -> None:
    rows = lines(flight(), separator)
    for changed in ([row + separator for row in rows], [rows[0], *[row + separator for row in rows[1:]]]):
        assert_same(read(saved(raw(changed), "f.csv"))[0], flight())


def test_what_spreadsheets_add(saved: Saved) -> None:
    quoted = ['"' + row.replace(";", '";"').replace(".", ",") + '"' for row in lines(flight(), ";")]
    record, *_ = read(saved(raw(["sep=;", *quoted]), "f.csv"))
    assert_same(record, flight())
    numbered = [f"{i}," + row for i, row in enumerate(lines(flight(), header=None))]
    assert_same(read(saved(raw([",t,p,q,delta_x,delta_y", *numbered]), "f.csv"))[0], flight())


def test_comments_among_the_rows_are_no_damage(saved: Saved) -> None:
    rows = lines(flight())
    rows[100:100] = ["# gusty", "  % and again", "// third"]
    record, _, source = read(saved(raw(rows), "f.csv"))
    assert_same(record, flight())
    assert source.damage is not None
    assert not source.damage.any


def test_mixed_decimals_are_asked_for(saved: Saved) -> None:
    rows = lines(flight(), ";")
    rows[500] = rows[500].replace(".", ",")
    with pytest.raises(TippathError, match=r"line \d+, column \w+: .* a decimal or a thousand"):
        ingest([saved(raw(rows), "f.csv")])
    rows = lines(flight(), ";")
    rows[7] = "0.030000;1,234.5;0.1;0.1;0.1"
    with pytest.raises(TippathError, match=r"line 8, column p: '1,234\.5'.* a decimal or a thousand"):
        ingest([saved(raw(rows), "f.csv")])
    quoted = [lines(flight())[0], *['"' + row.replace(".", ",").replace(",0,", ',0","0,') + '"' for row in rows[1:3]]]
    with pytest.raises(TippathError, match="line 2"):
        ingest([saved(raw(quoted), "f.csv")])
    quoted = [rows[0].replace(";", ","), *['"1,234",1,2,3,4'] * 200]
    with pytest.raises(TippathError, match=r"line 2, column t: '1,234' may be a thousand or a decimal comma"):
        ingest([saved(raw(quoted), "f.csv")])


def test_decimal_commas_beside_points_in_other_columns(saved: Saved) -> None:
    table = flight()
    rows = [row.replace(".", ",") + ";v1.2" for row in lines(table, ";", (*NAMES, "firmware"))]
    rows[0] = rows[0].replace(";v1,2", "").replace(";v1.2", "")
    assert_same(read(saved(raw(rows), "f.csv"))[0], table)


# ------------------------------------------------------------------------------------------------ units


def in_other_units() -> np.ndarray:
    table = flight()
    table[:, 0] *= 1000
    table[:, 1:3] = np.rad2deg(table[:, 1:3])
    table[:, 3:] *= 100
    return table


@pytest.mark.parametrize(
    "header",
    [
        ["t [ms],p [deg/s],q (°/s),delta_x [%],delta_y (%)"],
        ["t,p,q,delta_x,delta_y", "ms,deg/s,dps,%,%"],
        ["t,p,q,delta_x,delta_y", "[ms],[deg/s],[deg/s],[%],[%]"],
    ],
)
def test_known_units_are_converted_and_said(saved: Saved, header: list[str]) -> None:
    rows = [*header, *[",".join(repr(float(v)) for v in row) for row in in_other_units()]]
    record, run, _ = read(saved(raw(rows), "f.csv"))
    for i, name in enumerate(NAMES):
        assert np.allclose(record.channels[name], flight()[:, i], atol=1e-12)
    assert any(note.startswith("units converted as the header gives them: t from ms, p from") for note in run.notes)


def test_our_own_units_change_nothing_and_are_not_mentioned(saved: Saved) -> None:
    for header in (["t [s]", "p [rad/s]", "q (rad/s)", "delta_x [-]", "delta_y [-1..1]"],):
        record, run, _ = read(saved(raw(lines(flight(), header=tuple(header))), "f.csv"))
        assert_same(record, flight())
        assert not run.notes
    record, *_ = read(saved(raw([lines(flight())[0], "s,rad/s,rad/s,-,1", *lines(flight(), header=None)]), "f.csv"))
    assert_same(record, flight())


@pytest.mark.parametrize("unit", ["furlong", "m/s", "rpm", "raw"])
def test_an_unknown_unit_is_asked_for(saved: Saved, unit: str) -> None:
    header = ("t", f"p [{unit}]", "q", "delta_x", "delta_y")
    with pytest.raises(TippathError, match=rf"line 1, column p: unit '{unit}'.*rad/s.*--profile"):
        ingest([saved(raw(lines(flight(), header=header)), "f.csv")])


def test_a_profile_may_leave_the_unit_off_a_name_and_its_scale_counts(saved: Saved) -> None:
    header = ("time [ms]", "gyro_x (deg/s)", "gyro_y (deg/s)", "u1", "u2")
    profile = saved(
        b"[time]\nsource='time'\nscale=1e-3\n[channels.p]\nsource='gyro_x * pi / 180'\n[channels.q]\n"
        b"source='gyro_y (deg/s)'\nscale=0.017453292519943295\n[channels.delta_x]\nsource='u1 / 100'\n"
        b"[channels.delta_y]\nsource='u2'\nscale=0.01\n",
        "mine.toml",
    )
    record, *_ = read(saved(raw(lines(in_other_units(), header=header)), "f.csv"), profile)
    for i, name in enumerate(NAMES):
        assert np.allclose(record.channels[name], flight()[:, i], atol=1e-7)


def test_units_are_known_in_the_ways_they_are_written() -> None:
    for unit in ("deg/s", "°/s", "Deg / s", "degrees/s", "dps", "deg s^-1"):
        assert factor("p", unit) == pytest.approx(np.pi / 180), unit
    assert factor("ax", "g") == pytest.approx(9.80665)
    assert factor("ax", "m/s²") == 1.0
    assert factor("t", "µs") == 1e-6
    assert factor("omega", "RPM") == pytest.approx(2 * np.pi / 60)
    assert factor("delta_x", "us") is None


# ------------------------------------------------------------------------------------------------ damage


def test_damaged_rows_are_left_out_counted_and_named(saved: Saved) -> None:
    rows = lines(flight())
    rows[10] = rows[10][:20]  # torn
    rows[700] = "0.1,\x00\x00\x00,0.3,0.1,0.1"
    rows[701] = "\ufffd\x07abc"
    rows[2000] = rows[2000].replace(".", "x")
    path = saved(raw(rows), "f.csv")
    record, run, source = read(path)
    keep = np.setdiff1d(np.arange(4000), [9, 699, 700, 1999])
    assert_same(record, flight()[keep])
    assert run.usable
    assert source.damage is not None
    assert source.damage.resyncs == 3
    assert source.damage.skipped_bytes == sum(len(rows[i].encode()) + 1 for i in (10, 700, 701, 2000))
    assert source.damage.total_bytes == path.stat().st_size
    assert "4 rows damaged and left out: lines 11, 701, 702, 2001" in source.notes


def test_cells_without_a_number_leave_their_row_out(saved: Saved) -> None:
    rows = lines(flight())
    for i, cell in ((6, "nan"), (8, "-inf"), (20, ""), (21, " NaN ")):
        cells = rows[i].split(",")
        cells[1 + i % 4] = cell
        rows[i] = ",".join(cells)
    record, _, source = read(saved(raw(rows), "f.csv"))
    assert_same(record, flight()[np.setdiff1d(np.arange(4000), [5, 7, 19, 20])])
    assert any("4 rows without a finite number" in note and "lines 7, 9, 21, 22" in note for note in source.notes)
    assert source.damage is not None
    assert not source.damage.any


def test_a_hole_becomes_a_gap(saved: Saved) -> None:
    rows = lines(flight())
    for i in range(1000, 1030):
        cells = rows[i].split(",")
        rows[i] = ",".join([cells[0], "", "", *cells[3:]])
    record, run, _ = read(saved(raw(rows), "f.csv"))
    assert run.gaps == ((pytest.approx(4.99), pytest.approx(5.145)),)
    assert record.t.size == 3970


def test_a_column_logged_more_slowly_holds(saved: Saved) -> None:
    table = flight(8000, 400.0)
    rows = lines(table)
    for i in range(8000):
        if i % 4:
            cells = rows[i + 1].split(",")
            rows[i + 1] = ",".join([*cells[:3], "", ""])
    record, run, source = read(saved(raw(rows), "f.csv"))
    assert run.rate_hz == pytest.approx(400)
    assert record.t.size == 8000
    assert np.array_equal(record.channels["delta_x"], np.repeat(table[::4, 3], 4))
    assert not source.notes


def test_an_optional_column_of_words_is_left_out(saved: Saved) -> None:
    rows = [row + ",n/a" for row in lines(flight())]
    rows[0] = lines(flight())[0] + ",omega"
    record, run, source = read(saved(raw(rows), "f.csv"))
    assert_same(record, flight())
    assert "omega" in run.absent
    assert source.damage is not None
    assert not source.damage.any


def test_single_wrong_times_are_given_up(saved: Saved) -> None:
    rows = lines(flight())
    for i, t in ((103, "0.5"), (200, "0.1"), (300, "99")):
        rows[i] = t + rows[i][8:]
    record, _, source = read(saved(raw(rows), "f.csv"))
    assert_same(record, flight()[np.setdiff1d(np.arange(4000), [102, 199, 299])])
    assert any("3 rows left out, whose times break the order: lines 104, 201, 301" in note for note in source.notes)


@pytest.mark.parametrize("with_header", [False, True])
def test_two_boots_are_two_logs(saved: Saved, with_header: bool) -> None:
    first, second = flight(4000), flight(3000) + 0.001
    rows = [*lines(first), *lines(second)[0 if with_header else 1 :]]
    rows[2000] = "9" + rows[2000]
    found = ingest([saved(raw(rows), "f.csv")])
    (source,) = found.sources
    one, two = found.runs
    assert [one.id, two.id] == ["f.csv#1", "f.csv#2"]
    assert one.record is not None
    assert two.record is not None
    assert_same(one.record, first[np.setdiff1d(np.arange(4000), [1999])])
    assert np.array_equal(two.record.channels["p"], np.round(second[:, 1], 6))
    assert any(f"begins anew on line {4003 if with_header else 4002}: 2 boots" in note for note in source.notes)


def test_a_preallocated_file_ends_in_zeros(saved: Saved) -> None:
    record, _, source = read(saved(raw(lines(flight()))[:-9] + bytes(5000), "f.csv"))
    assert_same(record, flight()[:-1])
    assert source.damage is not None
    assert source.damage.tail_cut
    assert source.damage.skipped_bytes > 5000


def test_what_is_kept_is_what_was_logged_whatever_is_damaged(saved: Saved) -> None:
    """200 flipped bytes: every row that comes out with its time stands in the undamaged file."""
    chance = np.random.default_rng(8)
    whole = raw(lines(flight(20_000)))
    damaged = bytearray(whole)
    for at in chance.integers(40, len(whole), 30):
        damaged[at] ^= 1 << int(chance.integers(8))
    found = ingest([saved(bytes(damaged), "f.csv")])
    table = flight(20_000)
    known = {row[0]: row for row in table}
    kept = [run.record for run in found.runs if run.record is not None]
    same = total = 0
    for record in kept:
        columns = np.column_stack([record.channels[name] for name in NAMES])
        total += len(columns)
        same += sum(1 for row in columns if row[0] in known and np.array_equal(known[row[0]], row))
        assert all(a < b for a, b in pairwise(record.t.tolist()))
    assert total >= 0.999 * 20_000 - 30
    assert total - same <= 30  # a digit that became another digit cannot be seen


# ------------------------------------------------------------------------------------------------ what to write


HEADERS = {
    "plain": ("time_ms", "gyro_x", "gyro_y", "roll_cmd", "pitch_cmd"),
    "degrees": ("t", "roll rate (deg/s)", "pitch rate (deg/s)", "cyclic_roll", "cyclic_pitch"),
    "motors": ("timestamp_us", "gx", "gy", "m1", "m2", "m3", "m4"),
    "px4": ("timestamp", "vehicle_angular_velocity.xyz[0]", "vehicle_angular_velocity.xyz[1]", "x", "y"),
    "hostile": ('a"b', "c\\d", "[channels.p]", "\x1b[2J", "ü = 3", "'''"),
    "none": ("alpha1", "beta2"),
}


@pytest.mark.parametrize("case", HEADERS)
@pytest.mark.parametrize("kind", ["csv", "dataflash", "ulog"])
def test_the_proposal_is_a_profile(case: str, kind: str) -> None:
    text = propose(HEADERS[case], kind, {})
    document = tomllib.loads(text)
    profile = profiles.parse(text, "mine.toml")
    assert {"p", "q", "delta_x", "delta_y"} <= set(profile.channels)
    assert ("time" in document) == (kind == "csv")


@pytest.mark.parametrize(
    ("case", "time", "scale", "p", "q", "factor", "command"),
    [
        ("plain", "time_ms", 1e-3, "gyro_x", "gyro_y", 1.0, "roll_cmd"),
        ("degrees", "t", 1.0, "roll rate (deg/s)", "pitch rate (deg/s)", np.pi / 180, "cyclic_roll"),
        ("motors", "timestamp_us", 1e-6, "gx", "gy", 1.0, "(-m1 - m2 + m3 + m4) / 2"),
        ("px4", "timestamp", 1e-6, HEADERS["px4"][1], HEADERS["px4"][2], 1.0, "FIELD"),
    ],
)
def test_the_guesses(case: str, time: str, scale: float, p: str, q: str, factor: float, command: str) -> None:
    profile = profiles.parse(propose(HEADERS[case], "csv", {}), "mine.toml")
    assert (profile.time_source, profile.time_scale) == (time, pytest.approx(scale))
    assert profile.channels["p"].sources == (p,)
    assert profile.channels["p"].scale == pytest.approx(factor)
    assert profile.channels["q"].sources == (q,)
    assert profile.channels["delta_x"].sources == (command,)


def test_arduPilots_rates_and_outputs_are_guessed() -> None:
    fields = ("RATE.RDes", "RATE.R", "RATE.ROut", "RATE.PDes", "RATE.P", "RATE.POut", "ATT.Roll", "ATT.DesRoll")
    profile = profiles.parse(propose(fields, "dataflash", {}), "mine.toml")
    assert [profile.channels[name].sources[0] for name in NAMES[1:]] == ["RATE.R", "RATE.P", "RATE.ROut", "RATE.POut"]
    assert profile.channels["p"].scale == pytest.approx(np.pi / 180)


def test_the_proposal_reads_the_log_it_was_made_for(saved: Saved) -> None:
    rows = lines(flight() * [1000, 1, 1, 1, 1], header=HEADERS["plain"])
    profile = saved(propose(HEADERS["plain"], "csv", {}).encode(), "mine.toml")
    record, run, _ = read(saved(raw(rows), "f.csv"), profile)
    assert run.usable
    assert np.allclose(record.channels["q"], flight()[:, 2])


def test_explain_prints_a_profile_that_is_accepted(
    saved: Saved, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from gcs.cli import main

    log = saved(raw(lines(flight())), "f.csv")
    assert main(["ingest", str(log), "--explain"]) == 0
    printed = capsys.readouterr().out.split("a profile to start from:")[1]
    profile = tmp_path / "mine.toml"
    profile.write_text(printed, "utf-8")
    assert main(["ingest", str(log), "--profile", str(profile)]) == 0
    assert profiles.load(profile).time_source == "t"


def test_explain_says_what_to_write_for_a_log_that_is_refused(
    saved: Saved, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from gcs.cli import main

    good = saved(raw(lines(flight())), "good.csv")
    other = saved(raw(lines(flight() * [1000, 1, 1, 1, 1], header=HEADERS["plain"])), "other.csv")
    assert main(["ingest", str(good), str(other), "--explain"]) == 0
    printed = capsys.readouterr().out.split("a profile to start from:")[2]
    profile = tmp_path / "mine.toml"
    profile.write_text(printed, "utf-8")
    assert main(["ingest", str(other), "--profile", str(profile)]) == 0
