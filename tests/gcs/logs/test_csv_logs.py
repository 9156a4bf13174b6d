"""CSV logs: what is right is read fast, damage is left out and told, the hopeless is named by line and column."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from injuries import COUNTS, bounded_turns

from gcs.errors import TippathError
from gcs.logs import ingest, opening, resolve_runs
from gcs.logs.formats.csv import CsvFile

Saved = Callable[[bytes, str], Path]


def rows(count: int = 4000, rate_hz: float = 200.0) -> list[list[str]]:
    """A roll and pitch maneuver of 20 s."""
    t = np.arange(count) / rate_hz
    x, y = 0.1 * np.sin(2 * np.pi * t), 0.1 * np.cos(2 * np.pi * 1.3 * t)
    table = np.column_stack([t, 3 * x, 2 * y, x, y])
    return [["t", "p", "q", "delta_x", "delta_y"], *([f"{v:.6f}" for v in row] for row in table)]


def text(table: list[list[str]]) -> bytes:
    return "\n".join(",".join(row) for row in table).encode() + b"\n"


def test_a_file_with_the_channels_names_is_one_usable_run(saved: Saved) -> None:
    path = saved(text(rows()), "flight.csv")
    found = ingest([path])
    (run,) = found.runs
    assert (run.id, run.usable, run.maneuver, run.rate_source) == ("flight.csv#1", True, "unknown", "csv")
    assert run.rate_hz == pytest.approx(200)
    assert run.duration_s == pytest.approx(19.995)
    assert run.record is not None
    assert run.record.channels["p"][5] == pytest.approx(0.3 * np.sin(2 * np.pi * 0.025), abs=1e-6)
    assert len(run.record.sha256) == 64


@pytest.mark.parametrize(
    "change",
    [
        "bom",
        "crlf",
        "cr",
        "comment",
        "numpy",
        "half line",
        "half number",
        "blank lines",
        "quotes",
        "extra column",
        "blanks",
        "no last newline",
    ],
)
def test_harmless_differences_change_nothing(saved: Saved, change: str) -> None:
    table = rows()
    plain = ingest([saved(text(table), "plain.csv")]).runs[0].record
    raw = text(table)
    match change:
        case "bom":
            raw = b"\xef\xbb\xbf" + raw
        case "crlf":
            raw = raw.replace(b"\n", b"\r\n")
        case "cr":
            raw = raw.replace(b"\n", b"\r")
        case "comment":
            raw = b"# flown by hand, 3 May\n\n#\n" + raw
        case "numpy":
            raw = b"# by numpy\n# " + raw
        case "half line":
            raw += b"20.000,0.1,0.0"
        case "half number":
            raw += b"20.000,0.1,0.0,0.0,-"
        case "blank lines":
            raw = b"\n\n" + raw.replace(b"\n0.1", b"\n\n0.1") + b"\n\n"
        case "quotes":
            raw = text([[f'"{cell}"' for cell in row] for row in table])
        case "extra column":
            raw = text([[*row, "mode" if i == 0 else "hover"] for i, row in enumerate(table)])
        case "blanks":
            raw = text([[f" {cell} " for cell in row] for row in table])
        case "no last newline":
            raw = raw[:-1]
    other = ingest([saved(raw, "other.csv")]).runs[0].record
    assert plain is not None
    assert other is not None
    for name, values in plain.channels.items():
        assert np.array_equal(values, other.channels[name])


def with_cell(line: int, column: int, value: str, times: int = 1) -> bytes:
    """`value` in this line, and in as many as `times` from there on."""
    table = rows()
    for row in table[line - 1 : line - 1 + times]:
        row[column] = value
    return text(table)


WRONG: dict[str, tuple[bytes, list[str]]] = {
    "nan": (with_cell(2, 1, "nan", 4000), ["line 2", "column p", "no number in the whole column"]),
    "empty": (with_cell(2, 4, "", 4000), ["line 2", "column delta_y", "no number in the whole column"]),
    "text": (with_cell(12, 2, "abc", 50), ["line 12", "column q", "'abc' is not a number", "rows are wrong"]),
    "all text": (with_cell(2, 2, "abc", 4000), ["line 2", "column q", "'abc' is not a number"]),
    "escape": (with_cell(12, 2, "\x1b[2J", 50), ["line 12", "column q", "'\\x1b[2J' is not a number"]),
    "time repeats": (with_cell(103, 0, "0.500000", 60), ["line 103", "column t", "does not increase", "sort"]),
    "time stands": (with_cell(2, 0, "1", 4000), ["line 3", "column t", "does not increase", "digits"]),
    "shuffled": (text([rows()[0], *random.Random(3).sample(rows()[1:], 4000)]), ["column t", "does not increase"]),
    "short rows": (text([*rows()[:50], *[["1", "2"]] * 60, *rows()[50:]]), ["line 51", "2 columns", "header has 5"]),
    "long row": (text([*rows()[:50], ["9"] * 7]), ["line 51", "7 columns", "header has 5"]),
    "decimal comma": (text(rows()).replace(b".", b","), ["line 2", "10 columns", "decimal"]),
    "no header": (text(rows()[1:]), ["line 1", "numbers, not names", "header", "[response] input"]),
    "no q": (text([[c for i, c in enumerate(r) if i != 2] for r in rows()]), ["line 1", "column q missing", "profile"]),
    "no t": (text([r[1:] for r in rows()]), ["line 1", "column t missing"]),
    "name twice": (text([["t", "p", "p", "delta_x", "delta_y"], *rows()[1:]]), ["line 1", "column 3", "twice"]),
    "name empty": (text([["t", "p", "", "delta_x", "delta_y"], *rows()[1:]]), ["line 1", "column 3", "no name"]),
    "no bytes": (b"", ["empty", "header"]),
    "blank": (b" \n\n", ["empty", "header"]),
    "header only": (b"t,p,q,delta_x,delta_y\n", ["no rows"]),
    "binary": (b"t,p,q\n\xff\xfe\x00\x01\n", ["line 2", "not text"]),
    "zero byte": (b"t,p,q\n1,\x00,3\n", ["line 2", "zero byte"]),
    "open quote": (text(rows()[:3]) + b'"1,2,3,4,5\n', ["line"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_named(saved: Saved, case: str) -> None:
    raw, words = WRONG[case]
    path = saved(raw, "flight.csv")
    with pytest.raises(TippathError) as caught:
        ingest([path])
    message = str(caught.value)
    assert message.startswith(str(path))
    for word in words:
        assert word in message
    assert "\x1b" not in message


def test_line_numbers_count_blank_lines(saved: Saved) -> None:
    table = rows(80)
    table[20][1] = "oops"
    path = saved(b"\n\n" + text(table[:10]) + b"\n\n\n" + text(table[10:]), "flight.csv")
    with pytest.raises(TippathError, match="line 26, column p"):
        ingest([path])


@pytest.mark.parametrize("count", COUNTS)
def test_no_damaged_csv_makes_the_reader_fail(saved: Saved, count: int) -> None:
    chance = random.Random(21)
    whole = text(rows(60)), text(rows(1200)[::2]).replace(b",", b";").replace(b".", b",")
    read = 0
    pieces = (b",", b"\n", b'"', b"\xff", b"e", b";", b"", b"9", b"#", b"\0", b"-", b"nan", b"\r", b"\t", b"%", b"[")
    for i in bounded_turns(count):
        raw = bytearray(whole[i % 2])
        for _ in range(chance.randrange(1, 6)):
            at = chance.randrange(len(raw) if chance.random() < 0.8 else 60)
            raw[at : at + chance.choice((0, 1, 2, 40))] = chance.choice(pieces)
        path = saved(bytes(raw), "x.csv")
        try:
            file = CsvFile.parse(bytes(raw), "x.csv")
            names = [name for name in file.header if name]
            found = file.rows(names[:3], names[3:])
            opened = opening.open_log(path, None)
            for run in ingest([path]).runs:
                assert run.record is None or np.all(np.diff(run.record.t) > 0)
        except TippathError:
            continue
        read += 1
        assert all(values.shape == found.lines.shape for values in found.values.values())
        assert opened.damage is not None
        assert 0 <= opened.damage.skipped_bytes <= len(raw)
    assert read > 0.166667 * count


@pytest.mark.parametrize("value", ["1e300", "-3e20", "8000", "nan", "-inf"])
def test_a_value_that_nothing_takes_costs_its_row(saved: Saved, value: str) -> None:
    table = rows()
    for line in (700, 1900):
        table[line][1] = value
    (run,) = ingest([saved(text(table), "flight.csv")]).runs
    assert run.usable
    assert run.record is not None
    assert run.record.t.size == len(table) - 3  # the header, and two rows
    assert any("2 samples left out" in note or "2 rows" in note for note in run.record.notes), run.record.notes


@pytest.mark.data
def test_forty_thousand_measured_rows_are_read_at_once(shared_data: Path) -> None:
    path = shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv"
    (run,) = ingest([path]).runs
    assert run.record is not None
    slow = np.genfromtxt(path, delimiter=",", names=True, max_rows=2000)
    for name in slow.dtype.names:
        assert np.array_equal(slow[name], run.record.channels[name][:2000])
    assert run.usable
    assert run.rate_hz == pytest.approx(1009, abs=2)


def test_a_half_written_last_line_is_said(saved: Saved) -> None:
    path = saved(text(rows()) + b"20.000,0.1,0.0", "flight.csv")
    (source,) = ingest([path]).sources
    assert source.notes[0] == "the last line, 4002, is half written (3 of 5 columns) and left out"
    assert source.damage is not None
    assert (source.damage.skipped_bytes, source.damage.tail_cut) == (14, True)
    (record,) = resolve_runs([str(path)])
    assert any("half written" in note for note in record.notes)
    with pytest.raises(TippathError, match="no rows"):
        ingest([saved(b"t,p,q,delta_x,delta_y\n1,2", "short.csv")])


@pytest.mark.parametrize("ending", [b"\n", b"\r", b"\r\n"])
def test_what_the_csv_module_cannot_read_is_named_too(saved: Saved, ending: bytes) -> None:
    long = b'"' + b"9" * 200_000 + b'"'
    for number, raw in ((1, b"t,p," + long), (7, text(rows()[:6]) + long + b",1,2,3,4")):
        with pytest.raises(TippathError, match=f"line {number}"):
            ingest([saved(raw.replace(b"\n", ending) + ending, "flight.csv")])


def test_messages_show_plain_numbers(saved: Saved) -> None:
    with pytest.raises(TippathError, match=r"\(0\.1 after 0\.985\)"):
        ingest([saved(with_cell(200, 0, "0.1", 60), "flight.csv")])


@pytest.mark.parametrize(("factor", "unit", "scale"), [(1e3, "milliseconds", "0.001"), (1e6, "microseconds", "1e-06")])
def test_times_that_are_no_seconds_are_suspected(saved: Saved, factor: float, unit: str, scale: str) -> None:
    table = rows()
    for row in table[1:]:
        row[0] = f"{float(row[0]) * factor:.3f}"
    (run,) = ingest([saved(text(table), "flight.csv")]).runs
    (reason,) = run.reasons
    assert f"is it in {unit}?" in reason
    assert f"scale = {scale}" in reason
    assert "LOG_BITMASK" not in reason


def test_a_window_outside_a_csv_says_where_it_runs(saved: Saved) -> None:
    with pytest.raises(TippathError, match=r"no samples after 500 s: the log runs from 0\.000 to 19\.995 s"):
        ingest([saved(text(rows()), "flight.csv")], window=(500.0, None))


def test_a_profile_with_another_time_column_says_so(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(text(rows()))
    with pytest.raises(TippathError, match="column timestamp_us missing; the profile takes the time from it; name one"):
        ingest([path], "quadrotor")


@pytest.mark.parametrize("columns", [20_000, 1_000_000])
def test_a_file_of_very_many_columns_is_read_or_refused_at_once(saved: Saved, columns: int) -> None:
    head, *below = (",".join(row) for row in rows(9))
    wide = [f"{head},{','.join(f'c{i}' for i in range(columns))}", *(line + ",1" * columns for line in below)]
    path, begun = saved("\n".join(wide).encode() + b"\n", "wide.csv"), time.process_time()
    if columns > 50_000:
        with pytest.raises(TippathError, match=r"wide\.csv, line 1: longer than 1 MB"):
            ingest([path])
    else:
        assert len(ingest([path]).sources[0].fields) == columns + 5
    assert time.process_time() - begun < 5


@pytest.mark.parametrize("first", [1, 2000, 3999])
def test_a_time_that_no_clock_shows_costs_its_row(saved: Saved, first: int) -> None:
    table = rows()
    table[first][0] = "1e300"
    found = ingest([saved(text(table), "jump.csv")])
    assert sum(run.record.t.size for run in found.runs if run.record is not None) == len(table) - 2
    assert max(run.start_s + run.duration_s for run in found.runs) < 30
