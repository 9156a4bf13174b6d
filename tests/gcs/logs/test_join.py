"""A streamed log and a fetched one of the same flight: together they are the vehicle's own, or they are not joined.

What is compared with is the uncut log of the simulated vehicle, read alone; the cuts are the tests' own.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flying import CHIRP, PITCH, ROLL, flown

from gcs.analysis.fits import runs_of
from gcs.cli import main
from gcs.flight.folder import FlightFolder
from gcs.logs import ingest, resolve_runs
from gcs.logs.formats.dataflash import DataFlashLog, parse
from gcs.logs.formats.dataflash_join import JoinedLog, join
from gcs.logs.formats.dataflash_losses import common, losses, united
from gcs.logs.formats.dataflash_table import EVENTS, DataFlashTables
from gcs.logs.formats.joined import Joined

Stretch = tuple[float, float]
"""Shares of a log's bytes."""


@pytest.fixture(scope="module")
def log() -> bytes:
    return flown("hover-ideal", ((CHIRP, ROLL, 0.1, 4.0), (CHIRP, PITCH, 0.15, 4.0)))


@pytest.fixture(scope="module")
def another() -> bytes:
    """Of another boot: the same clock, other values."""
    return flown("hover-ideal", ((CHIRP, ROLL, 0.1, 4.0),), seed=6)


def without(data: bytes, *stretches: Stretch) -> bytes:
    """The bytes but for these stretches, which are cut out."""
    out, done = b"", 0
    for start, stop in sorted(stretches):
        out, done = out + data[done : round(start * len(data))], round(stop * len(data))
    return out + data[done:]


def zeroed(data: bytes, *stretches: Stretch) -> bytes:
    """The bytes with zeros in these stretches, whole blocks, as a stream leaves what never came."""
    out = bytearray(data)
    for start, stop in stretches:
        first, last = (round(share * len(data) / 200) * 200 for share in (start, stop))
        out[first:last] = bytes(last - first)
    return bytes(out)


def read(data: bytes) -> DataFlashLog:
    return parse(np.frombuffer(data, np.uint8))


def joined(a: bytes, b: bytes) -> JoinedLog:
    both = join(read(a), read(b))
    assert isinstance(both, JoinedLog), both
    return both


def assert_same_series(found: DataFlashTables, whole: DataFlashTables) -> None:
    assert found.fields() == whole.fields()
    for key in whole.fields():
        assert np.array_equal(found.series(key).t, whole.series(key).t), key
        assert np.array_equal(found.series(key).values, whole.series(key).values, equal_nan=True), key
    assert found.texts() == whole.texts()
    assert found.modes() == whole.modes()


def samples(data: bytes) -> int:
    """Rows of what is logged again and again, as a reader of this log alone takes them."""
    tables = DataFlashTables(read(data), "alone")
    names = {key.partition(".")[0] for key in tables.fields()} - EVENTS
    return sum(tables.series(next(k for k in tables.fields() if k.startswith(f"{name}."))).t.size for name in names)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (zeroed, without),
        (without, without),
        (lambda data, *stretches: data[: round(0.6 * len(data))], lambda data, *stretches: data),
    ],
)
def test_different_stretches_cut_out_of_two_copies_are_filled(ours: Any, theirs: Any, log: bytes) -> None:
    both = joined(ours(log, (0.2, 0.25), (0.5, 0.501)), theirs(log, (0.3, 0.42), (0.7, 0.8)))
    assert_same_series(DataFlashTables(both, "joined", sifted=True), DataFlashTables(read(log), "whole"))
    assert both.missing == both.unlike == 0
    assert not len(both.lost.inside), "complete"
    assert both.samples == samples(log)


@pytest.mark.parametrize("step", range(7))
def test_wherever_the_cuts_fall(step: int, log: bytes) -> None:
    """A cut within a message may leave two halves that look like one: no such sample may come in."""
    ours, theirs = ((0.4, 0.4 + 0.01 * step + step / len(log)), (0.75 + step / len(log), 0.8)), (0.55, 0.6)
    both = joined(without(log, *ours), without(log, theirs))
    assert_same_series(DataFlashTables(both, "joined", sifted=True), DataFlashTables(read(log), "whole"))


def test_a_stretch_that_both_lack_stays_a_gap(log: bytes) -> None:
    both = joined(without(log, (0.15, 0.25)), without(log, (0.2, 0.6)))
    whole = DataFlashTables(read(log), "whole")
    found = DataFlashTables(both, "joined", sifted=True)
    t, every = found.series("RATE.R").t, whole.series("RATE.R").t
    ((start, stop),) = both.lost.inside.tolist()
    assert np.diff(t).max() > 0.3
    gone = np.setdiff1d(every, t)
    assert start <= gone.min() <= gone.max() <= stop
    assert np.array_equal(np.setdiff1d(t, every), []), "nothing is made up"
    assert both.missing == pytest.approx(samples(log) - both.samples, rel=0.02)


def test_what_one_file_tells_differently_is_counted_and_the_fetched_one_taken(log: bytes) -> None:
    place = read(log).places("RATE")[500]
    changed = log[: place + 15] + struct.pack("<f", 77.0) + log[place + 19 :]
    assert joined(changed, log).unlike == 1
    whole = DataFlashTables(read(log), "whole")
    assert_same_series(DataFlashTables(joined(changed, log), "joined", sifted=True), whole)
    assert 77.0 in DataFlashTables(joined(log, changed), "joined", sifted=True).series("RATE.R").values


def test_a_damaged_file_helps_where_it_can(log: bytes) -> None:
    rng = np.random.default_rng(3)
    damaged = bytearray(zeroed(log, (0.5, 0.52)))
    for place in rng.integers(len(log) // 10, len(log), 40).tolist():
        damaged[place : place + 7] = rng.bytes(7)
    both = joined(without(log, (0.3, 0.4)), bytes(damaged))
    whole, found = DataFlashTables(read(log), "whole"), DataFlashTables(both, "joined", sifted=True)
    assert both.samples > 0.998 * samples(log)
    assert not set(found.series("SIDD.Targ").t) - set(whole.series("SIDD.Targ").t)
    assert joined(log, bytes(damaged)).lost.inside.size == 0, "what one has whole is complete"


def test_two_of_one_clock_but_of_different_boots_are_refused(log: bytes, another: bytes) -> None:
    why = join(read(log), read(another))
    assert isinstance(why, str)
    assert "another boot with the same clock, or another vehicle" in why


def test_two_that_share_no_time_are_refused(log: bytes) -> None:
    head = read(log).places("RATE")[0] / len(log)
    why = join(read(without(log, (0.4, 1.0))), read(without(log, (head, 0.6))))
    assert isinstance(why, str)
    assert "they share no sample" in why


def test_a_few_samples_prove_no_flight(log: bytes) -> None:
    places = read(log).places("RATE")
    few = [(places[0] / len(log), places[300] / len(log)), (places[302] / len(log), 1.0)]
    why = join(read(log), read(without(log, *few)))
    assert isinstance(why, str)
    assert "too few to show" in why or "share no sample" in why


# What the vehicle itself does not write, and stamps of its own


FORMS = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns", "<BB4s16s64s"),
    "RATE": (1, "Qf", "TimeUS,R", "<Qf"),
    "XKF1": (2, "QBf", "TimeUS,C,Roll", "<QBf"),
    "MODE": (3, "QM", "TimeUS,Mode", "<QB"),
    "DMS": (4, "QI", "TimeUS,Dp", "<QI"),
}


def written(rows: Sequence[tuple[Any, ...]]) -> bytes:
    def packed(name: str, *values: Any) -> bytes:
        number, _, _, layout = FORMS[name]
        return b"\xa3\x95" + bytes([number]) + struct.pack(layout, *values)

    formats = [
        packed("FMT", number, 3 + struct.calcsize(layout), name.encode(), types.encode(), columns.encode())
        for name, (number, types, columns, layout) in FORMS.items()
    ]
    return b"".join([*formats, *(packed(*row) for row in rows)])


def rows(of: str = "RATE", seed: int = 1) -> list[tuple[Any, ...]]:
    draw = np.random.default_rng(seed).normal(size=400)
    return [(of, 1_000_000 + 10_000 * k, float(np.float32(value))) for k, value in enumerate(draw)]


def test_what_the_vehicle_dropped_on_the_way_to_the_link_is_the_cards(log: bytes) -> None:
    every = rows()
    counted = [("DMS", 1_000_001 + 1_000_000 * k, 5 * (k >= 2)) for k in range(5)]
    streamed = sorted([*every[:150], *every[155:], *counted], key=lambda row: row[1])
    both = joined(written(streamed), written(every))
    assert both.starts("RATE").size == 400
    assert losses(read(written(streamed))).inside.tolist() == [[pytest.approx(2.0, abs=0.1), pytest.approx(3.0)]]
    assert not len(both.lost.inside)
    halved = joined(written(streamed), written(every[:140] + every[153:]))
    assert len(halved.lost.inside) == 1, "dropped from one, cut out of the other"


def test_two_cores_that_share_a_time_are_paired_by_what_they_say() -> None:
    first, second = rows(seed=1), rows(seed=2)
    cores = [
        ("XKF1", t, k, value) for a, b in zip(first, second, strict=True) for k, (_, t, value) in enumerate((a, b))
    ]
    both = joined(written(cores), written(cores[:301] + cores[302:]))
    assert both.raw("XKF1").shape[0] == 800
    assert both.unlike == 0


def test_an_event_that_each_writer_stamps_itself_happened_once() -> None:
    ours = [*rows(), ("MODE", 2_000_000, 25), ("MODE", 4_000_000, 0)]
    theirs = [*rows(), ("MODE", 2_000_030, 25), ("MODE", 3_000_000, 5), ("MODE", 4_000_030, 0)]
    both = DataFlashTables(joined(written(ours), written(theirs)), "joined", sifted=True)
    assert [mode for _, mode in [(t, int(v[0])) for t, v in _modes(both)]] == [25, 5, 0]


def _modes(tables: DataFlashTables) -> list[tuple[float, list[float]]]:
    series = tables.series("MODE.Mode")
    return [(t, [value]) for t, value in zip(series.t.tolist(), series.values.tolist(), strict=True)]


def test_stretches_are_added_and_shared() -> None:
    a, b = np.array([[-np.inf, 1.0], [3.0, 5.0], [7.0, np.inf]]), np.array([[0.0, 2.0], [4.0, 8.0]])
    assert united(a, b).tolist() == [[-np.inf, 2.0], [3.0, np.inf]]
    assert common(a, b).tolist() == [[0.0, 1.0], [4.0, 5.0], [7.0, 8.0]]
    assert common(a, np.empty((0, 2))).tolist() == []


# Folders


def flight(path: Path, streamed: bytes, fetched: bytes, /, **about: Any) -> Path:
    path.mkdir()
    (path / "flight.BIN").write_bytes(streamed)
    (path / "fetched-00000004.BIN").write_bytes(fetched)
    FlightFolder(path).write({"runs": [], **about})
    return path


def test_a_folder_is_read_as_one_flight_and_says_who_had_what(
    log: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = flight(tmp_path / "flight-0001", zeroed(log, (0.3, 0.4)), without(log, (0.6, 0.7)))
    before = {path.name: path.read_bytes() for path in folder.glob("*.BIN")}
    assert main(["ingest", str(folder), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    (source,) = document["sources"]
    together = source["joined"]
    assert together["complete"] is True
    assert together["missing"] == together["unlike"] == 0
    assert [Path(one["path"]).name for one in together["files"]] == ["flight.BIN", "fetched-00000004.BIN"]
    assert together["files"][0]["samples"] + together["files"][1]["filled"] == together["samples"] == samples(log)
    assert source["apart"] == {}
    (whole,) = [ingest([path]) for path in [_saved(tmp_path / "whole.BIN", log)]]
    for number, run in enumerate(document["runs"]):
        assert (run["id"], run["usable"], run["gaps"]) == (f"flight.BIN#{number + 1}", True, [])
    for record, expected in zip(resolve_runs([str(folder)]), whole.usable, strict=True):
        assert expected.record is not None
        assert all(np.array_equal(record.channels[c], expected.record.channels[c]) for c in expected.record.channels)
    assert main(["ingest", str(folder / "flight.BIN")]) == 0, "named by itself: as its folder's listing calls it"
    out = capsys.readouterr().out
    more = together["files"][1]["filled"]
    assert "more in fetched-00000004.BIN, 0 missing\n" in out
    assert f"{more:,} more" in out
    assert {path.name: path.read_bytes() for path in folder.glob("*.BIN")} == before


def _saved(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def test_one_that_is_not_of_the_flight_is_left_alone_and_said(
    log: bytes, another: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = flight(tmp_path / "flight-0001", log, another)
    assert main(["ingest", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "fetched-00000004.BIN is not read with it: of " in out
    assert "is read by itself where it is named" in out
    (source,) = ingest([folder]).sources
    assert source.joined is None
    assert source.sha256 == ingest([folder / "flight.BIN"], join=False).sources[0].sha256
    assert list(source.apart) == [str(folder / "fetched-00000004.BIN")]


@pytest.mark.parametrize("bad", [b"", b"no log at all", bytes(4000)])
def test_one_that_cannot_be_read_leaves_the_other(bad: bytes, log: bytes, tmp_path: Path) -> None:
    fetched_is_bad = flight(tmp_path / "a", log, bad)
    (source,) = ingest([fetched_is_bad]).sources
    assert (source.joined, len(source.apart)) == (None, 1)
    streamed_is_bad = flight(tmp_path / "b", bad, log)
    found = ingest([streamed_is_bad])
    assert [run.id for run in found.usable] == ["fetched-00000004.BIN#1", "fetched-00000004.BIN#2"]
    assert list(found.refused) == [str(streamed_is_bad / "flight.BIN")]


def test_what_was_fetched_is_judged_by_the_flight_too(log: bytes, tmp_path: Path) -> None:
    entered = ingest([_saved(tmp_path / "whole.BIN", log)]).runs[0].entered_s
    aborted = {"label": "roll", "log_start_s": entered, "ending": "aborted", "reason": "Ctrl-C", "verdict": None}
    about = {"recording": {"logs": [{"path": "flight.BIN"}]}, "fetched": [{"file": "fetched-00000004.BIN"}]}
    folder = flight(tmp_path / "flight-0001", b"", log, runs=[aborted], **about)
    assert [run.usable for run in ingest([folder]).runs] == [False, True]


def test_a_fetched_part_of_a_flight_fills_what_it_has(log: bytes, tmp_path: Path) -> None:
    folder = flight(tmp_path / "flight-0001", zeroed(log, (0.3, 0.4), (0.8, 0.81)), log)
    places = read(log).places("RATE") / len(log)
    (folder / "fetched-00000004.BIN").rename(folder / "fetched-00000004.runs-only.BIN")
    of_a_run = without(log, (places[0], places[1000]), (places[2800], 1.0))
    (folder / "fetched-00000004.runs-only.BIN").write_bytes(of_a_run)
    (source,) = ingest([folder]).sources
    assert source.joined is not None
    assert source.joined.complete is False
    ((start, stop),) = source.joined.stretches
    assert 0.05 < stop - start < 0.3


def test_a_log_that_was_streamed_in_two_is_one_on_the_card(log: bytes, tmp_path: Path) -> None:
    """Each of the vehicle's two streams begins with the formats; the card has all of it in one."""
    places = read(log).places("RATE") / len(log)
    folder = flight(tmp_path / "flight-0001", without(log, (0.4, 1.0)), without(log, (0.1, 0.2), (0.9, 0.92)))
    (folder / "flight-2.BIN").write_bytes(without(log, (places[0], 0.6)))
    found = ingest([folder])
    assert [run.id for run in found.runs] == ["flight.BIN#1", "flight.BIN#2"]
    (source,) = found.sources
    assert source.joined is not None
    names = [Path(one.path).name for one in source.joined.files]
    assert names == ["flight.BIN", "fetched-00000004.BIN", "flight-2.BIN"]
    assert (source.joined.complete, source.joined.samples) == (True, samples(log))
    assert sum(one.filled for one in source.joined.files) + source.joined.files[0].samples == samples(log)
    (folder / "fetched-00000004.BIN").unlink()
    assert len(ingest([folder]).sources) == 2


def test_a_stream_of_another_boot_is_read_by_itself(log: bytes, another: bytes, tmp_path: Path) -> None:
    folder = flight(tmp_path / "flight-0001", without(log, (0.3, 0.4)), log)
    (folder / "flight-2.BIN").write_bytes(another)
    found = ingest([folder])
    assert [run.id for run in found.runs] == ["flight.BIN#1", "flight.BIN#2", "flight-2.BIN#1"]
    assert [source.joined is not None for source in found.sources] == [True, False]
    assert [dict(source.apart) for source in found.sources] == [{}, {}]


def test_a_copy_that_adds_nothing_changes_no_log(log: bytes, tmp_path: Path) -> None:
    """A fit made before the fetch is of the same bytes after it."""
    folder = flight(tmp_path / "flight-0001", log, without(log, (0.5, 0.6)))
    assert ingest([folder]).sources[0].sha256 == ingest([folder], join=False).sources[0].sha256
    filled = flight(tmp_path / "flight-0002", without(log, (0.5, 0.6)), log)
    assert ingest([filled]).sources[0].sha256 != ingest([filled], join=False).sources[0].sha256


def test_a_fit_made_before_the_fetch_has_its_runs_again(log: bytes, tmp_path: Path) -> None:
    folder = flight(tmp_path / "flight-0001", without(log, (0.2, 0.24)), log)
    alone, together = (ingest([folder], join=join).usable[0].record for join in (False, True))
    assert alone is not None
    assert together is not None
    fit: Any = SimpleNamespace(profile=None, window_s=None, band_hz=(0.0, 15.0), records=(), found_loop_s=None)
    for record in (alone, together):
        used: Any = SimpleNamespace(id=record.id, path=record.path, sha256=record.sha256)
        (again,) = runs_of(fit, [used])
        assert np.array_equal(again.t, record.t)
    assert alone.sha256 != together.sha256


def test_a_change_of_either_file_is_read_anew(log: bytes, tmp_path: Path) -> None:
    folder = flight(tmp_path / "flight-0001", without(log, (0.15, 0.25)), without(log, (0.2, 0.6)))
    assert any(run.gaps for run in ingest([folder]).runs)
    (folder / "fetched-00000004.BIN").write_bytes(log)
    assert not any(run.gaps for run in ingest([folder]).runs)


def test_a_log_off_the_card_is_read_with_what_the_flight_streamed(
    log: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    card = _saved(tmp_path / "00000007.BIN", without(log, (0.6, 0.7)))
    folder = tmp_path / "flight-0001"
    folder.mkdir()
    (folder / "flight.BIN").write_bytes(without(log, (0.3, 0.4)))
    entered = ingest([card]).runs[0].entered_s
    FlightFolder(folder).write({"runs": [{"label": "roll", "log_start_s": entered, "ending": "finished"}]})
    assert main(["ingest", str(card), "--flight", str(folder), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    (source,) = document["sources"]
    assert [Path(one["path"]).name for one in source["joined"]["files"]] == ["flight.BIN", "00000007.BIN"]
    assert source["joined"]["complete"] is True
    assert [run["id"] for run in document["runs"]] == ["00000007.BIN#1", "00000007.BIN#2"]
    assert document["flight"]["matches"][0]["run"] == "00000007.BIN#1"


def test_a_run_to_be_flown_again_for_missing_samples_alone_is_kept_once_they_are_fetched(
    log: bytes, tmp_path: Path
) -> None:
    lost = "900 of 2000 samples are missing"
    entered = [run.entered_s for run in ingest([_saved(tmp_path / "whole.BIN", log)]).runs]
    runs = [
        {
            "label": f"run {k}",
            "ending": "finished",
            "log_start_s": start,
            "verdict": {"keep": False, "reasons": [lost, *more], "lost": lost},
        }
        for k, (start, more) in enumerate(zip(entered, ([], ["gust"]), strict=True))
    ]
    folder = flight(tmp_path / "flight-0001", zeroed(log, (0.2, 0.3), (0.7, 0.8)), log, runs=runs)
    first, second = ingest([folder]).runs
    assert first.usable
    assert f"the flight's verdict on the stream no longer holds (fly again: {lost})" in first.notes
    assert not second.usable, "a gust is no missing sample"
    alone = ingest([folder], join=False).runs
    assert not any(run.usable for run in alone)


@pytest.mark.parametrize(
    ("missing", "stretches", "complete", "words"),
    [
        (0, (), True, "0 missing"),
        (7, ((1.0, 1.25),), False, "about 7 missing in all of them (1 stretch, 0.25 s)"),
        (0, ((1.0, 1.25), (3.0, 3.5)), None, "none seen missing, but not shown for 0.75 s"),
    ],
)
def test_complete_is_said_where_it_is_shown(
    missing: int, stretches: tuple[tuple[float, float], ...], complete: bool | None, words: str
) -> None:
    together = Joined(
        files=(_file("a.BIN"), _file("b.BIN")), samples=9, shared=5, unlike=1, missing=missing, stretches=stretches
    )
    assert together.complete is complete
    assert together.words == (
        f"4 of 9 samples in a.BIN, 3 more in b.BIN, {words}; of 1 sample told differently b.BIN's are taken"
    )


def _file(name: str) -> Any:
    from gcs.logs.formats.joined import JoinedFile

    return JoinedFile(path=name, sha256="", samples=4, filled=3)
