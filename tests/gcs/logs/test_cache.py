"""What was read is kept, believed only while everything is the same, and never in the way."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import TippathError, UsageError
from gcs.logs import cache, ingest, logs_in, opening, reading, resolve_runs
from gcs.logs.reading import Progress

Save = Callable[[bytes, str], Path]


@pytest.fixture(autouse=True)
def switched_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.SWITCH, "on")


@pytest.fixture
def parses(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The logs that were really opened."""
    opened: list[Path] = []
    really = opening.open_log

    def count(path: Path, profile: object) -> opening.Opened:
        opened.append(path)
        return really(path, profile)  # type: ignore[arg-type]

    monkeypatch.setattr(reading.opening, "open_log", count)
    return opened


def kept(folder: Path) -> list[Path]:
    return sorted((folder / cache.FOLDER).glob("*"))


def test_a_log_is_read_once_and_comes_back_as_it_was(two_chirps: bytes, saved: Save, parses: list[Path]) -> None:
    path = saved(two_chirps[:-20], "flight.BIN")  # damaged, so that damage and notes make the journey too
    first, second = ingest([path]), ingest([path])
    assert parses == [path]
    assert first.sources == second.sources
    for one, other in zip(first.runs, second.runs, strict=True):
        assert one.record is not None
        assert other.record is not None
        assert one.health == other.health
        assert one.reasons == other.reasons
        assert one.record.notes == other.record.notes
        assert one.record.swept_band_hz == other.record.swept_band_hz
        assert set(one.record.channels) == set(other.record.channels)
        for name, values in one.record.channels.items():
            assert np.array_equal(values, other.record.channels[name])
            assert not other.record.channels[name].flags.writeable


def test_a_changed_log_is_read_anew(two_chirps: bytes, saved: Save, parses: list[Path]) -> None:
    path = saved(two_chirps, "flight.BIN")
    ingest([path])
    times = path.stat()
    changed = bytearray(two_chirps)
    changed[-1] ^= 1
    path.write_bytes(changed)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # same size, same time
    ingest([path])
    assert len(parses) == 2


def test_another_window_or_profile_is_another_reading(two_chirps: bytes, saved: Save, parses: list[Path]) -> None:
    path = saved(two_chirps, "flight.BIN")
    whole = ingest([path])
    cut = ingest([path], window=(None, whole.runs[0].start_s + 3))
    other = ingest([path], "arducopter_rate")
    assert len(parses) == 3
    assert len(cut.runs) < len(whole.runs)
    assert {run.rate_source for run in other.runs} != {run.rate_source for run in whole.runs}


@pytest.mark.parametrize("harm", [lambda raw: raw[: len(raw) // 2], lambda raw: b"", lambda raw: b"\0" * len(raw)])
def test_half_a_file_counts_as_none(
    harm: Callable[[bytes], bytes], two_chirps: bytes, saved: Save, parses: list[Path]
) -> None:
    path = saved(two_chirps, "flight.BIN")
    ingest([path])
    (file,) = kept(path.parent)
    file.write_bytes(harm(file.read_bytes()))
    assert len(ingest([path]).usable) == 2
    assert len(parses) == 2
    ingest([path])
    assert len(parses) == 2, "it was written again, whole"


def test_what_is_no_content_of_ours_is_not_believed(two_chirps: bytes, saved: Save, parses: list[Path]) -> None:
    import msgspec

    path = saved(two_chirps, "flight.BIN")
    ingest([path])
    (file,) = kept(path.parent)
    body = msgspec.msgpack.encode({"source": {"path": 3}, "runs": "many"})
    key = cache._own_key()
    assert key is not None
    file.write_bytes(cache._mark(body, key) + body)
    assert len(ingest([path]).usable) == 2


def test_what_another_user_kept_is_not_believed(
    two_chirps: bytes, saved: Save, parses: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A flight folder that was sent, its cache whole, for this log and this reader, with other numbers in it."""
    path = saved(two_chirps, "flight.BIN")
    truth = ingest([path]).runs[0].record
    assert truth is not None
    (file,) = kept(path.parent)
    content = cache.load(file)
    assert content is not None
    record = replace(truth, channels={**truth.channels, "p": 2 * truth.channels["p"]})
    poisoned = replace(content, runs=(replace(content.runs[0], record=record), *content.runs[1:]))
    with monkeypatch.context() as other:
        other.setattr(cache, "user_cache_path", lambda name, **_: tmp_path / "another user" / name)
        cache.save(file, poisoned)
        believed = cache.load(file)
        assert believed is not None
        assert believed.runs[0].record is not None
        assert np.array_equal(believed.runs[0].record.channels["p"], 2 * truth.channels["p"])
    assert cache.load(file) is None
    again = ingest([path]).runs[0].record
    assert again is not None
    assert np.array_equal(again.channels["p"], truth.channels["p"])
    assert len(parses) == 2
    assert cache.load(file) is not None, "kept anew, as this user's own"


def test_a_key_is_its_owner_s_alone_and_drawn_anew_where_it_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "user_cache_path", lambda name, **_: tmp_path / name)
    key, path = cache._own_key(), tmp_path / "tippath" / "cache.key"
    assert key is not None
    assert cache._own_key() == key == path.read_bytes()
    assert [one.name for one in path.parent.iterdir()] == ["cache.key"]
    if os.name == "posix":
        assert path.stat().st_mode & 0o777 == 0o600
        path.chmod(0o644)
        assert cache._own_key() not in (None, key)
    path.write_bytes(b"short")
    assert len(cache._own_key() or b"") == 32


def test_without_a_key_nothing_is_kept(
    two_chirps: bytes, saved: Save, parses: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "home").write_text("a file where the folder would be")
    monkeypatch.setattr(cache, "user_cache_path", lambda name, **_: tmp_path / "home" / name)
    path = saved(two_chirps, "flight.BIN")
    assert len(ingest([path]).usable) == len(ingest([path]).usable) == 2
    assert len(parses) == 2
    assert not kept(path.parent)


def test_where_nothing_can_be_written_the_log_is_read_all_the_same(
    two_chirps: bytes, saved: Save, parses: list[Path]
) -> None:
    path = saved(two_chirps, "flight.BIN")
    (path.parent / cache.FOLDER).write_text("a file where the folder would be")
    assert len(ingest([path]).usable) == len(ingest([path]).usable) == 2
    assert len(parses) == 2


def test_a_full_disk_leaves_nothing_half_written(
    two_chirps: bytes, saved: Save, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = saved(two_chirps, "flight.BIN")

    def full(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    assert len(ingest([path]).usable) == 2
    assert kept(path.parent) == []


def test_the_switch(two_chirps: bytes, saved: Save, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.SWITCH, "off")
    path = saved(two_chirps, "flight.BIN")
    ingest([path])
    assert not (path.parent / cache.FOLDER).exists()


def test_few_ways_of_reading_are_kept(two_chirps: bytes, saved: Save) -> None:
    path = saved(two_chirps, "flight.BIN")
    other = saved(two_chirps, "flight.BIN.BIN")
    ingest([other])
    for stop in range(100, 100 + cache.KEPT + 3):
        ingest([path], window=(None, float(stop)))
    names = [file.name for file in kept(path.parent)]
    assert sum(name.startswith("flight.BIN-") for name in names) == cache.KEPT
    assert sum(name.startswith("flight.BIN.BIN-") for name in names) == 1


def test_a_flight_json_is_asked_every_time(two_chirps: bytes, saved: Save) -> None:
    from gcs.flight.folder import FlightFolder

    path = saved(two_chirps, "flight.BIN")
    entered = ingest([path]).runs[0].entered_s
    FlightFolder(path.parent).write(
        {"runs": [{"log_start_s": entered, "ending": "aborted", "reason": "the pilot said so", "verdict": None}]}
    )
    assert [run.usable for run in ingest([path]).runs] == [False, True]


def test_side_by_side_gives_the_same_in_the_same_order(
    two_chirps: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(cache.SWITCH, "off")
    for number, data in enumerate((two_chirps, two_chirps[: len(two_chirps) // 2], b"no log at all", two_chirps[:-30])):
        (tmp_path / f"{number}.BIN").write_bytes(data)
    paths = logs_in(tmp_path)
    one_by_one = ingest(paths)
    monkeypatch.setattr(reading, "SIDE_BY_SIDE_BYTES", 0)
    monkeypatch.setattr(reading.os, "cpu_count", lambda: 2)
    seen: list[Progress] = []
    together = ingest(paths, progress=seen.append)
    assert [run.id for run in together.runs] == [run.id for run in one_by_one.runs]
    assert [run.health for run in together.runs] == [run.health for run in one_by_one.runs]
    assert together.refused == one_by_one.refused
    assert len(together.refused) == 1
    assert [step.done for step in seen] == [1, 2, 3, 4]
    assert seen[-1].done_bytes == seen[-1].total_bytes == sum(path.stat().st_size for path in paths)


def test_fits_read_from_the_cache_too(two_chirps: bytes, saved: Save, parses: list[Path]) -> None:
    path = saved(two_chirps, "flight.BIN")
    first, second = resolve_runs([str(path)]), resolve_runs([f"{path}#1", f"{path}#2"])
    assert parses == [path]
    assert [record.id for record in first] == [record.id for record in second]


def test_logs_of_a_card(tmp_path: Path, two_chirps: bytes) -> None:
    def put(name: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(two_chirps)
        return path

    deep = [put("log/2026-11-20/9.BIN"), put("log/2026-11-20/10.BIN"), put("log/2026-11-21/1.BIN")]
    put("log/2026-11-20/.tippath/9.BIN")
    put("log/2026-11-20/notes.txt")
    put("log/2026-11-20/9.csv")
    assert logs_in(tmp_path) == deep, "of 9.BIN and 9.csv the one that holds most"
    top = [put("2.bin"), put("3.CSV")]
    assert logs_in(tmp_path) == [*top, *deep], "a log on the top hides none of those below it"
    session = put("log/session/flight.BIN")
    put("log/session/other.BIN")
    put("log/session/tries/1.BIN")
    assert logs_in(tmp_path) == [*top, *deep, session], "a flight folder among others is its flight"
    flight = [put("flight.BIN"), put("flight-2.BIN")]
    assert set(logs_in(tmp_path)) == set(flight)


def test_of_a_flight_without_its_own_log_what_was_fetched_is_taken_each_run_once(tmp_path: Path) -> None:
    def put(name: str) -> Path:
        (tmp_path / name).write_bytes(b"x")
        return tmp_path / name

    telemetry = put("flight.tlog")
    assert logs_in(tmp_path) == [telemetry]
    one = put("fetched-00000001.run-2-only.BIN")
    assert logs_in(tmp_path) == [one]
    put("fetched-00000001.BIN.part")
    all_runs = put("fetched-00000001.runs-only.BIN")
    assert logs_in(tmp_path) == [all_runs]
    whole = put("fetched-00000001.BIN")
    assert logs_in(tmp_path) == [whole]
    streamed = put("flight.BIN")
    assert logs_in(tmp_path) == [streamed]


def test_a_file_that_is_empty_hides_none_of_its_name(tmp_path: Path, two_chirps: bytes) -> None:
    (tmp_path / "1.BIN").write_bytes(b"")
    (tmp_path / "1.log").write_bytes(two_chirps)
    assert logs_in(tmp_path) == [tmp_path / "1.log"]


@pytest.mark.parametrize("name", ["²1.csv", "x²", "१.csv", "10²-3.ulg"])
def test_digits_of_every_kind_in_names(tmp_path: Path, name: str) -> None:
    path = (tmp_path / name).with_suffix(".csv")
    path.write_text("t,p,q,delta_x,delta_y\n")
    (tmp_path / "1.csv").write_text("")
    assert set(logs_in(tmp_path)) == {path, tmp_path / "1.csv"}
    with pytest.raises(UsageError, match="number of a run"):
        resolve_runs([f"{tmp_path / '1.csv'}#²"])


def test_links_that_go_round_are_followed_once(tmp_path: Path, two_chirps: bytes) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "1.BIN").write_bytes(two_chirps)
    (tmp_path / "logs" / "again").symlink_to(tmp_path)
    (tmp_path / "gone.BIN").symlink_to(tmp_path / "nowhere.BIN")
    (tmp_path / "2.BIN").mkdir()
    assert logs_in(tmp_path) == [tmp_path / "logs" / "1.BIN"]


def test_a_folder_of_records_says_what_to_name(tmp_path: Path) -> None:
    (tmp_path / "flight-1.npz").write_bytes(b"")
    with pytest.raises(TippathError, match=r"\*\.npz"):
        logs_in(tmp_path)


def test_copies_in_one_folder_are_read_once_and_told(tmp_path: Path, two_chirps: bytes) -> None:
    for name in ("1.BIN", "copy of 1.BIN"):
        (tmp_path / name).write_bytes(two_chirps)
    found = ingest([tmp_path])
    assert [run.id for run in found.runs] == ["1.BIN#1", "1.BIN#2"]
    assert any("copy of 1.BIN holds the same bytes" in hint for hint in found.sources[0].hints)


def test_a_record_does_not_hide_its_log(tmp_path: Path, two_chirps: bytes) -> None:
    path, record = tmp_path / "1.BIN", tmp_path / "record.npz"
    path.write_bytes(two_chirps)
    resolve_runs([str(path)])[0].save(record)
    assert [source.kind for source in ingest([record, path]).sources] == ["record", "dataflash"]


@pytest.mark.parametrize("name", ["pipe.csv", "pipe.BIN", "pipe.npz"])
def test_pipes_are_refused_and_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(TippathError, match="pipe"):
        ingest([tmp_path / name])


def test_a_link_to_nothing_and_a_run_for_a_log_are_told_as_such(tmp_path: Path, two_chirps: bytes) -> None:
    (tmp_path / "gone.BIN").symlink_to(tmp_path / "nowhere.BIN")
    with pytest.raises(TippathError, match="a link to what does not exist"):
        ingest([tmp_path / "gone.BIN"])
    (tmp_path / "1.BIN").write_bytes(two_chirps)
    with pytest.raises(TippathError, match="name it without #2"):
        ingest([tmp_path / "1.BIN#2"])


@pytest.mark.parametrize("data", [b"", b"no zip", b"PK\x03\x04 half a zip"])
def test_an_npz_that_is_no_record(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "x.npz").write_bytes(data)
    np.savez(tmp_path / "y.npz", a=np.arange(3))
    for name in ("x.npz", "y.npz"):
        with pytest.raises(TippathError, match="not a record; records are"):
            ingest([tmp_path / name])


@pytest.mark.parametrize("side_by_side", [False, True])
def test_names_that_are_no_text(
    two_chirps: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, side_by_side: bool
) -> None:
    """On a card that was written under another encoding: nothing is kept of such a log, and it is read all the same."""
    if side_by_side:
        monkeypatch.setattr(reading, "SIDE_BY_SIDE_BYTES", 0)
        monkeypatch.setattr(reading.os, "cpu_count", lambda: 2)
    for name in (b"caf\xe9.BIN", b"cafe.BIN"):
        Path(os.fsdecode(bytes(tmp_path) + b"/" + name)).write_bytes(two_chirps + name)
    found = ingest([tmp_path])
    assert [run.id for run in found.runs] == ["cafe.BIN#1", "cafe.BIN#2", "caf?.BIN#1", "caf?.BIN#2"]
    assert all(run.usable for run in found.runs)
    assert len(list((tmp_path / cache.FOLDER).iterdir())) == 1


def test_what_a_folder_has_and_cannot_be_read_is_told_with_the_fit(tmp_path: Path, two_chirps: bytes) -> None:
    (tmp_path / "1.BIN").write_bytes(two_chirps)
    (tmp_path / "2.BIN").write_bytes(b"")
    first, second = resolve_runs([str(tmp_path)])
    assert any("2.BIN: the file is empty" in note for note in first.notes)
    assert not any("2.BIN" in note for note in second.notes)


def test_many_write_the_same_at_once(saved: Save, two_chirps: bytes) -> None:
    path = saved(two_chirps, "flight.BIN")
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: ingest([path]).runs, range(4)))
    assert all([run.health for run in runs] == [run.health for run in found[0]] for runs in found)
    (kept,) = (path.parent / cache.FOLDER).iterdir()
    assert cache.load(kept) is not None


def test_where_nothing_can_be_kept_it_is_read_all_the_same(saved: Save, two_chirps: bytes) -> None:
    path = saved(two_chirps, "flight.BIN")
    (path.parent / cache.FOLDER).write_text("a file where the folder would be")
    assert len(ingest([path]).usable) == 2
    assert len(ingest([path]).usable) == 2


def test_a_profile_that_changed_under_its_name_is_read_anew(saved: Save, two_chirps: bytes, tmp_path: Path) -> None:
    path, profile = saved(two_chirps, "flight.BIN"), tmp_path / "mine.toml"
    text = "".join(
        f'[channels.{name}]\nsource = "{source}"\nscale = 0.01\n'
        for name, source in (("p", "SIDD.Gx"), ("q", "SIDD.Gy"), ("delta_x", "RATE.ROut"), ("delta_y", "RATE.POut"))
    )
    profile.write_text(text)
    before = ingest([path], profile).runs[0]
    profile.write_text(text.replace("0.01", "0.02"))
    after = ingest([path], profile).runs[0]
    assert before.record is not None
    assert after.record is not None
    np.testing.assert_allclose(after.record.channels["p"], 2 * before.record.channels["p"])
