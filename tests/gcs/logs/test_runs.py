"""Finding runs, from real ArduPilots and from the simulated vehicle's messages."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs.errors import TippathError, UsageError
from gcs.logs import check_same_rate_source, ingest, parse_window, resolve_runs, split_run_word
from sysid.data.record import Record

Saved = Callable[[bytes, str], Path]
Flown = Callable[..., bytes]


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "axis", "start_s"),
    [
        ("quad_roll_sweep.BIN", "roll", 77.172),
        ("quad_pitch_sweep.BIN", "pitch", 76.942),
        ("heli_roll_sweep.BIN", "roll", 256.590),
        ("heli_pitch_sweep.BIN", "pitch", 95.310),
    ],
)
def test_a_real_sweep_is_one_run_of_a_minute(shared_data: Path, name: str, axis: str, start_s: float) -> None:
    (run,) = ingest([shared_data / "ardupilot" / name]).runs
    assert (run.usable, run.maneuver, run.axis, run.rate_source) == (True, "chirp", axis, "SIDD")
    assert run.reasons == ()
    assert run.start_s == pytest.approx(start_s, abs=0.005)
    assert run.duration_s == pytest.approx(60, abs=0.1)
    assert run.swept_band_hz == (0.5, 10.0)
    assert run.rate_hz == pytest.approx(400, abs=1)
    assert run.gaps == ()
    record = run.record
    assert record is not None
    assert record.t[0] == pytest.approx(run.start_s - 0.5, abs=0.005)
    assert record.t[-1] == pytest.approx(run.start_s + 61, abs=0.005)
    on, off = ("excitation_x", "excitation_y") if axis == "roll" else ("excitation_y", "excitation_x")
    assert np.abs(record.channels[on]).max() == pytest.approx(0.05, rel=0.01)
    assert not record.channels[off].any()
    assert ("omega" in record.channels) == name.startswith("heli")


@pytest.mark.data
def test_the_rates_of_a_real_sweep_are_in_our_units_and_signs(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "ardupilot" / "quad_roll_sweep.BIN"]).runs
    assert run.record is not None
    c = run.record.channels
    # the attitude's slope is the rate: an independent sensor path of the same flight
    slope = np.gradient(c["phi"], c["t"])
    assert np.corrcoef(slope, c["p"])[0, 1] > 0.98
    assert np.polyfit(c["p"], slope, 1)[0] == pytest.approx(1, abs=0.05)
    assert 0.1 < np.abs(c["p"]).max() < 2


@pytest.mark.data
def test_a_flight_without_a_maneuver_says_why_it_cannot_be_used(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "ardupilot" / "log171.bin"]).runs
    assert not run.usable
    assert run.maneuver == "unknown"
    assert run.rate_hz == pytest.approx(49.5, abs=0.2)
    assert any("no excitation" in reason and "feedback" in reason for reason in run.reasons)
    assert any("49.5 Hz" in reason and "60 Hz" in reason for reason in run.reasons)
    assert max(stop - start for start, stop in run.gaps) == pytest.approx(2.0, abs=0.1)
    with pytest.raises(TippathError, match="not usable, because"):
        resolve_runs([str(shared_data / "ardupilot" / "log171.bin")])


def test_the_simulated_vehicles_runs_in_order(two_chirps: bytes, saved: Saved) -> None:
    path = saved(two_chirps, "flight.BIN")
    found = ingest([path])
    assert [(r.id, r.maneuver, r.axis, r.usable) for r in found.runs] == [
        ("flight.BIN#1", "chirp", "roll", True),
        ("flight.BIN#2", "chirp", "pitch", True),
    ]
    assert found.damage == {}
    for run in found.runs:
        assert run.duration_s == pytest.approx(6, abs=0.01)
        assert run.swept_band_hz == (0.5, 10.0)
        assert any("Tischler" in note for note in run.notes)
        assert run.record is not None
        c = run.record.channels
        assert c["t"][0] == pytest.approx(run.start_s - 0.5, abs=0.003)
        assert c["t"][-1] == pytest.approx(run.start_s + 7, abs=0.003)
        assert np.allclose(np.diff(c["t"]), 0.002)
        assert c["delta_e"] == pytest.approx(0.05)
        assert c["delta_c"] == pytest.approx(0.4)
        assert np.allclose(c["omega"], (1600 + c["t"]) * 2 * np.pi / 60, atol=0.01)
    roll = found.runs[0].record
    assert roll is not None
    # SIDD, not RATE (which this log offsets by 1 deg/s)
    assert abs(np.mean(roll.channels["p"][:200])) < np.deg2rad(0.5)
    assert np.allclose(
        roll.channels["p"][300:3000], np.deg2rad(20 * roll.channels["excitation_x"][300:3000]), atol=0.01
    )


@pytest.mark.parametrize(("kind", "name"), [(0, "chirp"), (1, "doublet"), (2, "quiet")])
def test_kinds_of_maneuver(flown: Flown, saved: Saved, kind: int, name: str) -> None:
    (run,) = ingest([saved(flown([{"kind": kind}]), "flight.BIN")]).runs
    assert (run.maneuver, run.usable, run.reasons) == (name, True, ())
    assert run.duration_s == pytest.approx(6, abs=0.01)
    assert run.axis == (None if name == "quiet" else "roll")
    assert (run.swept_band_hz is not None) == (name == "chirp")


def test_an_excitation_of_the_rate_command_is_not_called_cyclic(flown: Flown, saved: Saved) -> None:
    (run,) = ingest([saved(flown([{"axis": 7}]), "flight.BIN")]).runs
    assert run.axis == "roll"
    assert run.record is not None
    assert not any(name.startswith("excitation") for name in run.record.channels)


def test_a_sweep_the_vehicle_stopped_is_cut_there(flown: Flown, saved: Saved) -> None:
    path = saved(flown([{"stop_after": 5.5, "duration": 20.0}, {"axis": 11}]), "flight.BIN")
    first, second = ingest([path]).runs
    assert first.duration_s == pytest.approx(5.5, abs=0.02)
    assert first.usable
    assert any("Stopped: lean" in note for note in first.notes)
    assert any("cut short: 5.5 s of 20.0 s" in note for note in first.notes)
    assert (second.axis, second.duration_s) == ("pitch", pytest.approx(6, abs=0.01))


def test_a_sweep_that_never_began_is_listed_and_not_usable(flown: Flown, saved: Saved) -> None:
    first, second = ingest([saved(flown([{"stop_after": 0.0}, {}]), "flight.BIN")]).runs
    assert not first.usable
    assert any("before the maneuver began" in reason for reason in first.reasons)
    assert second.usable


def test_two_entries_without_a_mode_between_are_two_runs(flown: Flown, saved: Saved) -> None:
    runs = ingest([saved(flown([{}, {"axis": 11}], leave=False, quiet_s=0.0), "flight.BIN")]).runs
    assert [run.axis for run in runs] == ["roll", "pitch"]
    assert all(run.duration_s == pytest.approx(6, abs=0.01) for run in runs)


@pytest.mark.parametrize("own_messages", [True, False])
def test_without_sids_the_entry_is_worked_out_from_sidd(flown: Flown, saved: Saved, own_messages: bool) -> None:
    data = flown([{"with_sids": False, "axis": 11}, {}], own_messages=own_messages)
    first, second = ingest([saved(data, "flight.BIN")]).runs
    assert (first.axis, second.axis) == ("pitch", "roll")
    assert first.start_s == pytest.approx(13.0, abs=0.02)
    assert first.duration_s == pytest.approx(6, abs=0.05)
    assert any("SIDS" in note for note in first.notes)
    assert first.usable


def test_a_log_that_ends_in_mid_sweep_gives_what_there_is(flown: Flown, saved: Saved) -> None:
    data = flown([{"duration": 12.0}], quiet_s=1.0)
    whole = ingest([saved(data, "whole.BIN")]).runs[0]
    cut = ingest([saved(data[: len(data) * 2 // 3], "cut.BIN")])
    (run,) = cut.runs
    assert run.usable
    assert 5 < run.duration_s < whole.duration_s - 2
    assert any("cut short" in note for note in run.notes)
    assert whole.record is not None
    assert run.record is not None
    n = run.record.t.size
    assert np.array_equal(run.record.channels["p"], whole.record.channels["p"][:n])


def test_damage_in_mid_sweep_becomes_a_gap_and_no_false_sample(flown: Flown, saved: Saved) -> None:
    data = flown([{"duration": 12.0}])
    whole = ingest([saved(data, "whole.BIN")]).runs[0].record
    assert whole is not None
    true = set(zip(whole.t.tolist(), whole.channels["p"].tolist(), whole.channels["delta_x"].tolist(), strict=True))
    middle = len(data) // 2
    injured = data[:middle] + bytes(9000) + data[middle + 9000 :]
    found = ingest([saved(injured, "holed.BIN")])
    (run,) = found.runs
    assert run.usable
    assert len(run.gaps) == 1
    assert run.gaps[0][1] - run.gaps[0][0] == pytest.approx(9000 / 141 * 0.002, rel=0.1)
    (damage,) = found.damage.values()
    assert 8500 < damage.skipped_bytes < 9500
    assert run.record is not None
    c = run.record.channels
    assert set(zip(c["t"].tolist(), c["p"].tolist(), c["delta_x"].tolist(), strict=True)) <= true


def test_a_damaged_time_stamp_takes_its_sample_along_and_no_other(flown: Flown, saved: Saved) -> None:
    data = bytearray(flown([{}]))
    at = data.index(b"\xa3\x95\x09", len(data) // 2)
    data[at + 3 + 5] ^= 0x40
    (run,) = ingest([saved(bytes(data), "flight.BIN")]).runs
    assert run.usable
    assert run.record is not None
    spacing = np.round(np.diff(run.record.t) / 0.002).astype(int)
    assert np.bincount(spacing).tolist() == [0, spacing.size - 1, 1]


def test_no_injury_makes_ingest_fail(flown: Flown, saved: Saved) -> None:
    chance = random.Random(31)
    data = flown([{"duration": 5.0}], quiet_s=0.2)
    listed = 0
    for _ in range(60):
        out = bytearray(data)
        for _ in range(chance.randrange(1, 40)):
            at = chance.randrange(len(out))
            match chance.randrange(4):
                case 0:
                    out[at] = chance.randrange(256)
                case 1:
                    del out[at : at + chance.choice((1, 60, 5000))]
                case 2:
                    out[at:at] = chance.randbytes(chance.choice((1, 60)))
                case 3:
                    out[at % 1500] = chance.randrange(256)
        try:
            found = ingest([saved(bytes(out), "flight.BIN")])
        except TippathError:
            continue
        for run in found.runs:
            listed += 1
            assert run.usable == (not run.reasons)
    assert listed > 40


def test_a_window_cuts_every_run_and_drops_those_outside(two_chirps: bytes, saved: Saved) -> None:
    path = saved(two_chirps, "flight.BIN")
    first, second = ingest([path]).runs
    (late,) = ingest([path], window=(second.start_s - 1, None)).runs
    assert late.id == "flight.BIN#2"
    (part,) = ingest([path], window=(first.start_s + 0.5, first.start_s + 5.75)).runs
    assert part.record is not None
    assert part.record.t[0] == pytest.approx(first.start_s + 0.5, abs=0.003)
    assert part.duration_s == pytest.approx(5.25, abs=0.01)
    assert not any("cut short" in note for note in part.notes)
    (record,) = resolve_runs([str(path)], window=(second.start_s, None))
    assert record.axis == "pitch"


def test_a_window_over_a_log_without_maneuvers_is_the_users_word(flown: Flown, saved: Saved) -> None:
    data = flown([{"with_sids": True}], quiet_s=6.0)
    path = saved(data, "flight.BIN")
    (run,) = ingest([path], window=(10.0, 15.5)).runs
    assert (run.maneuver, run.rate_source) == ("unknown", "RATE")
    assert not run.usable  # nothing was flown there
    assert any(reason.startswith("no excitation:") for reason in run.reasons)


def test_runs_by_word(two_chirps: bytes, saved: Saved, tmp_path: Path) -> None:
    path = saved(two_chirps, "flight.BIN")
    assert [r.id for r in resolve_runs([str(path)])] == ["flight.BIN#1", "flight.BIN#2"]
    assert [r.axis for r in resolve_runs([f"{path}#2"])] == ["pitch"]
    assert [r.id for r in resolve_runs([f"{path}#2", str(path), str(tmp_path)])] == ["flight.BIN#2", "flight.BIN#1"]
    (record,) = resolve_runs([f"{path}#1"])
    record.save(tmp_path / "flight-1.npz")
    (again,) = resolve_runs([str(tmp_path / "flight-1.npz")])
    assert again.id == "flight.BIN#1"
    assert np.array_equal(again.channels["p"], record.channels["p"])
    with pytest.raises(TippathError, match=r"the log has flight.BIN#1, flight.BIN#2"):
        resolve_runs([f"{path}#3"])
    for word in (f"{path}#0", f"{path}#x"):
        with pytest.raises(UsageError):
            resolve_runs([word])
    with pytest.raises(TippathError, match="no such file"):
        resolve_runs([str(tmp_path / "absent.BIN")])
    with pytest.raises(UsageError):
        resolve_runs([])


def test_a_file_with_a_hash_in_its_name_is_that_file(saved: Saved) -> None:
    path = saved(b"x", "odd#2")
    assert split_run_word(str(path)) == (path, None)


def test_a_flight_folder_is_its_flight_logs_and_nothing_twice(two_chirps: bytes, flown: Flown, tmp_path: Path) -> None:
    folder = tmp_path / "flight-0007"
    folder.mkdir()
    (folder / "flight.BIN").write_bytes(two_chirps)
    (folder / "vehicle-1.BIN").write_bytes(two_chirps)
    assert [run.id for run in ingest([folder]).runs] == ["flight.BIN#1", "flight.BIN#2"]
    (folder / "flight-2.BIN").write_bytes(flown([{}]))
    (folder / "flight-10.BIN").write_bytes(flown([{"axis": 11}]))
    ids = [run.id for run in ingest([folder]).runs]
    assert ids == ["flight.BIN#1", "flight.BIN#2", "flight-2.BIN#1", "flight-10.BIN#1"]
    (tmp_path / "nothing").mkdir()
    with pytest.raises(TippathError, match=r"no log \("):
        ingest([tmp_path / "nothing"])


@pytest.mark.parametrize("name", ["x.xls", "x"])
def test_formats_that_are_not_read_say_which_are(saved: Saved, name: str) -> None:
    with pytest.raises(TippathError, match=r"Read are: DataFlash \.BIN"):
        ingest([saved(b"some bytes", name)])


def test_one_unreadable_log_of_several_is_refused_by_name(two_chirps: bytes, saved: Saved) -> None:
    good, bad = saved(two_chirps, "flight.BIN"), saved(b"", "empty.BIN")
    found = ingest([good, bad])
    assert len(found.usable) == 2
    assert "empty" in found.refused[str(bad)]
    with pytest.raises(TippathError, match="empty"):
        ingest([bad])


def test_rates_of_different_messages_are_not_mixed(two_chirps: bytes, saved: Saved) -> None:
    path = saved(two_chirps, "flight.BIN")
    sidd = resolve_runs([str(path)])
    rate = resolve_runs([str(path)], Path("arducopter_rate"))
    assert {record.rate_source for record in rate} == {"RATE"}
    assert np.mean(rate[0].channels["p"][:200]) > np.deg2rad(0.7)
    check_same_rate_source(sidd)
    with pytest.raises(TippathError, match=r"RATE: .*SIDD: .*arducopter_rate"):
        check_same_rate_source([*sidd, *rate])


@pytest.mark.parametrize(
    ("text", "window"), [("60:95", (60, 95)), ("60:", (60, None)), (":95.5", (None, 95.5)), (":", (None, None))]
)
def test_windows(text: str, window: tuple[float | None, float | None]) -> None:
    assert parse_window(text) == window


@pytest.mark.parametrize("text", ["60", "a:b", "9:5", "5:5", "1:2:3", "nan:4", ":inf", ""])
def test_wrong_windows_say_how_to_write_them(text: str) -> None:
    with pytest.raises(UsageError, match="--window"):
        parse_window(text)


def test_records_name_their_log_and_its_hash(two_chirps: bytes, saved: Saved) -> None:
    import hashlib

    path = saved(two_chirps, "flight.BIN")
    for record in resolve_runs([str(path)]):
        assert isinstance(record, Record)
        assert record.path == str(path)
        assert record.sha256 == hashlib.sha256(two_chirps).hexdigest()


def test_texts_that_share_a_time_are_all_kept(two_chirps: bytes) -> None:
    from gcs.logs.formats.dataflash import parse
    from gcs.logs.formats.dataflash_table import DataFlashTables

    message = b"\xa3\x95\x3b" + (10_000_000).to_bytes(8, "little") + b"same time".ljust(64, b"\0")
    tables = DataFlashTables(parse(np.frombuffer(two_chirps + 3 * message, np.uint8)), "log")
    assert tables.texts() == [(10.0, "same time")] * 3


def test_the_swept_band_of_a_chirp_cut_short_is_what_was_flown(flown: Flown, saved: Saved) -> None:
    whole, early = ingest([saved(flown([{}, {"stop_after": 5.5, "duration": 20.0}]), "flight.BIN")]).runs
    assert whole.swept_band_hz == (0.5, 10.0), "the plan's, of a run that reached its end"
    assert early.swept_band_hz == pytest.approx((0.5, 0.5 + 0.8 * 5.5), abs=0.02)
    assert early.record is not None
    assert early.record.swept_band_hz == early.swept_band_hz


def test_the_swept_band_of_a_log_that_ends_in_the_sweep_is_what_is_in_it(flown: Flown, saved: Saved) -> None:
    data = flown([{"duration": 12.0}], quiet_s=1.0)
    (run,) = ingest([saved(data[: len(data) * 2 // 3], "cut.BIN")]).runs
    assert run.swept_band_hz == pytest.approx((0.5, 0.5 + 0.8 * run.duration_s), abs=0.02)


def test_a_window_sweeps_what_lies_in_it(two_chirps: bytes, saved: Saved) -> None:
    (run,) = ingest([saved(two_chirps, "flight.BIN")], window=(14.0, 18.5)).runs
    assert run.swept_band_hz == pytest.approx((0.5 + 0.8 * 1.0, 0.5 + 0.8 * 5.5), abs=0.02)


def test_what_was_noted_travels_with_the_record(flown: Flown, saved: Saved, tmp_path: Path) -> None:
    data = flown([{"duration": 12.0}])
    middle = len(data) // 2
    holed = saved(data[:middle] + bytes(9000) + data[middle + 9000 :] + b"\xa3\x95", "holed.BIN")
    (record,) = resolve_runs([str(holed)])
    assert any("gap" in note for note in record.notes)
    assert any(note.startswith("holed.BIN: ") and "bytes could not be read" in note for note in record.notes)
    assert any("the end is cut" in note for note in record.notes)
    (short,) = resolve_runs([str(saved(flown([{"stop_after": 5.5, "duration": 20.0}]), "short.BIN"))])
    assert any("cut short: 5.5 s of 20.0 s" in note for note in short.notes)
    assert any("Stopped: lean" in note for note in short.notes)
    record.save(tmp_path / "again.npz")
    (again,) = resolve_runs([str(tmp_path / "again.npz")])
    assert again.notes == record.notes
    (listed,) = ingest([tmp_path / "again.npz"]).runs
    assert len(set(listed.notes)) == len(listed.notes), "nothing is noted twice"


@pytest.mark.parametrize(("size", "when"), [(700, "before any samples"), (1800, "s after its first sample")])
def test_a_log_that_hardly_began_says_that_it_ends(flown: Flown, saved: Saved, size: int, when: str) -> None:
    path = saved(flown([{}])[:size], "flight.BIN")
    (run,) = ingest([path]).runs
    (reason,) = run.reasons
    assert reason.startswith("the log ends")
    assert when in reason
    assert "SYSTEMID" not in reason
    with pytest.raises(TippathError, match="the log ends"):
        resolve_runs([str(path)])


def test_a_log_without_one_usable_field_lists_none(saved: Saved, writer: Callable[..., Any]) -> None:
    log = writer({"MSG": (59, "QZ", "TimeUS,Message")})
    for i in range(4):
        log.add("MSG", 1_000_000 * i, b"hello")
    for run in ingest([saved(log.data, "flight.BIN")], Path("arducopter"), window=(0.0, 9.0)).runs:
        assert not any("The log has ." in reason for reason in run.reasons)


@pytest.mark.parametrize("window", [(500.0, 600.0), (500.0, None), (None, 3.0)])
def test_a_window_outside_the_log_says_where_the_log_runs(
    two_chirps: bytes, saved: Saved, window: tuple[float | None, float | None]
) -> None:
    with pytest.raises(TippathError, match=r"the log runs from 10\.000 to 3\d\.\d{3} s"):
        resolve_runs([str(saved(two_chirps, "flight.BIN"))], window=window)


def test_modes_that_share_a_time_are_all_kept_and_not_complained_about(two_chirps: bytes) -> None:
    from gcs.logs.formats.dataflash import parse
    from gcs.logs.formats.dataflash_table import DataFlashTables

    def mode(us: int, number: int) -> bytes:
        return b"\xa3\x95\x78" + us.to_bytes(8, "little") + bytes((number, number, 1))

    end = 40_000_000
    many = b"".join(mode(end + i // 2 * 7_000_000, i) for i in range(14))  # in pairs, and far apart
    tables = DataFlashTables(parse(np.frombuffer(two_chirps + many, np.uint8)), "log")
    assert tables.series("MODE.ModeNum").values.tolist() == [0, 25, 0, 25, 0, *range(14)]
    assert tables.dropped == {}
    back = mode(end, 9)
    tables = DataFlashTables(parse(np.frombuffer(two_chirps + many + back + many[-14:], np.uint8)), "log")
    tables.series("MODE.ModeNum")
    assert tables.dropped == {"MODE": 1}, "a time that goes back is still damage"
