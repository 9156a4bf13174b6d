"""Logs as vehicles write them: a rate that changes, messages that were dropped, sweeps of other axes, cut files."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

from gcs.cli.listing import document, table
from gcs.errors import TippathError, UsageError
from gcs.logs import FromStart, Ingest, ingest, parse_window, resolve_runs
from gcs.logs.formats.tables import before_no_gap, covered_s

Saved = Callable[..., Path]
DMS = (14, "QIIIIBBBBBBBBB", "TimeUS,N,Dp,RT,RS,Fa,Fmn,Fmx,Pa,Pmn,Pmx,Sa,Smn,Smx")
DSF = (15, "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv")
PARM = (32, "QNff", "TimeUS,Name,Value,Default")


def messages(data: bytes) -> Iterator[tuple[str, int, bytes]]:
    """Name, TimeUS (0 for FMT) and bytes of every message of an undamaged binary log."""
    known: dict[int, tuple[str, int, bool]] = {128: ("FMT", 89, False)}
    at = 0
    while at + 3 <= len(data):
        name, length, timed = known[data[at + 2]]
        message = data[at : at + length]
        if name == "FMT":
            _, id, its_length, its_name, _, columns = struct.unpack("<3sBB4s16s64s", message)
            known[id] = (its_name.rstrip(b"\0").decode(), its_length, columns.startswith(b"TimeUS"))
        yield name, struct.unpack_from("<Q", message, 3)[0] if timed else 0, message
        at += length


def rewritten(data: bytes, keep: Callable[[str, int], bool], more: Mapping[int, bytes] | None = None) -> bytes:
    """A log of the messages that are kept, with others put in where their time (us) comes."""
    pieces: list[bytes] = []
    due = sorted((more or {}).items())
    for name, us, message in messages(data):
        while due and us >= due[0][0]:
            pieces.append(due.pop(0)[1])
        if keep(name, us):
            pieces.append(message)
    return b"".join(pieces)


def made(writer: Callable[..., object], name: str, format: tuple[int, str, str], *values: object) -> bytes:
    """One message with the format that it needs."""
    log = writer({name: format})
    log.add(name, *values)  # type: ignore[attr-defined]
    return log.data  # type: ignore[attr-defined, no-any-return]


def text(found: Ingest) -> str:
    return "\n".join(table(found))


# ------------------------------------------------------------------------------------------------ the rate of a place


def test_a_rate_that_changes_is_no_gap() -> None:
    t = np.concatenate((np.arange(4000) * 0.01, 40 + np.arange(16000) * 0.0025))
    assert before_no_gap(t).all()
    assert before_no_gap(t[::-1].max() - t[::-1]).all(), "nor where it falls"
    assert covered_s(t) == pytest.approx(80.0, abs=0.02)


@pytest.mark.parametrize("at", [1000, 12000])
def test_the_sample_before_a_gap_is_not_believed_at_either_rate(at: int) -> None:
    t = np.concatenate((np.arange(4000) * 0.01, 40 + np.arange(16000) * 0.0025))
    keep = before_no_gap(np.delete(t, slice(at, at + 20)))
    assert np.flatnonzero(~keep).tolist() == [at - 1]


def test_a_run_logged_more_slowly_than_another_is_used(shared_data: Path) -> None:
    found = ingest([shared_data / "ardupilot" / "heli_bitmask_changed_two_runs.BIN"])
    slow, fast = found.runs
    assert slow.usable, slow.reasons
    assert (slow.axis, fast.axis) == ("roll", "pitch")
    assert slow.duration_s == pytest.approx(40.0, abs=0.05)
    assert slow.rate_hz == pytest.approx(100.0, abs=0.5)
    assert slow.record is not None
    assert slow.record.t.size > 4100, "with what lies around it"
    assert slow.health is not None
    assert slow.health.coherent["roll"].high_hz > 8.5
    assert {quiet.where for quiet in slow.health.quiet} == {"before", "after"}
    notes = " ".join(slow.notes)
    assert "logged at 100 Hz, the vehicle's loop runs at 400: enough for a sweep to 10 Hz" in notes
    assert "error bounds up to 2.0 times as wide" in notes
    assert "commands were held for 2.5 ms (the vehicle's loop: SCHED_LOOP_RATE 400) and logged every 10 ms" in notes
    assert "LOG_BITMASK bit 0" in notes
    assert fast.usable
    assert len(fast.gaps) > 20
    notes = " ".join(fast.notes)
    assert "LOG_MAV_BUFSIZE to 50 (it is 8)" in notes
    assert "in pieces of at least 2 s" in notes
    assert "more amplitude" not in notes, "a piece of a sweep does not sweep the band"
    assert "LOG_BITMASK" not in notes
    assert "left out before gaps: " in text(found)


# ------------------------------------------------------------------------------------------------ what was dropped


def with_gaps(flight: bytes, first_us: int, every_us: int, lasting_us: int, more: Mapping[int, bytes]) -> bytes:
    def keep(name: str, us: int) -> bool:
        return name not in ("RATE", "SIDD", "TPEX") or us < first_us or (us - first_us) % every_us >= lasting_us

    return rewritten(flight, keep, more)


def test_what_the_vehicle_dropped_is_the_cause_of_gaps(
    saved: Saved, flown: Callable[..., bytes], writer: Callable[..., object]
) -> None:
    flight = flown([{"axis": 10, "duration": 12.0}])
    rest = (0,) * 9
    more = {
        10_500_000: made(writer, "DMS", DMS, 10_500_000, 1, 40, 0, 0, *rest),
        27_900_000: made(writer, "DMS", DMS, 27_900_000, 2, 452, 0, 0, *rest),
    }
    (run,) = ingest([saved(with_gaps(flight, 15_000_000, 4_000_000, 60_000, more))]).runs
    assert run.usable, run.reasons
    assert len(run.gaps) >= 2
    (note,) = [note for note in run.notes if "DMS.Dp" in note]
    assert "the vehicle itself dropped 412 messages" in note
    assert "LOG_MAV_BUFSIZE to 50" in note
    assert "card" in note
    (whole,) = ingest([saved(rewritten(flight, lambda *_: True, more), "whole.BIN")]).runs
    assert not any("dropped" in note for note in whole.notes), "nothing is missing in this run"


def test_a_slow_card_is_the_cause_of_gaps_in_the_vehicles_own_file(
    saved: Saved, flown: Callable[..., bytes], writer: Callable[..., object]
) -> None:
    more = {
        10_500_000: made(writer, "DSF", DSF, 10_500_000, 5, 0, 0, 0, 0, 0),
        22_000_000: made(writer, "DSF", DSF, 22_000_000, 9, 0, 0, 0, 0, 0),
        27_900_000: made(writer, "DSF", DSF, 27_900_000, 3, 0, 0, 0, 0, 0),
    }
    flight = with_gaps(flown([{"axis": 10, "duration": 12.0}]), 15_000_000, 4_000_000, 60_000, more)
    (run,) = ingest([saved(flight)]).runs
    (note,) = [note for note in run.notes if "DSF.Dp" in note]
    assert "dropped 4 messages" in note, "a counter that begins again dropped nothing"
    assert "LOG_FILE_BUFSIZE" in note


def test_many_short_gaps_are_refused_in_true_words_and_used_up_to_where_they_are_none(
    shared_data: Path, saved: Saved
) -> None:
    flight = (shared_data / "ardupilot" / "heli_roll_sweep.BIN").read_bytes()
    path = saved(with_gaps(flight, 250_000_000, 170_000, 24_000, {}), "dropped.BIN")
    (run,) = ingest([path]).runs
    assert not run.usable
    (reason,) = run.reasons
    assert "no piece of 2 s" in reason
    assert "gaps of at most" in reason
    assert "% of the samples are there" in reason
    assert "telemetry" not in reason, "it is the vehicle's own log"
    band = run.usable_to_hz
    assert band is not None
    assert 6 <= band < 10
    assert any("LOG_MAV_BUFSIZE" not in note for note in run.notes), "its LOG_BACKEND_TYPE sends nothing"
    (up_to,) = ingest([path], f_high_hz=band).runs
    assert up_to.usable, up_to.reasons


def test_a_run_in_pieces_needs_enough_of_them(saved: Saved, flown: Callable[..., bytes]) -> None:
    flight = flown([{"axis": 10, "duration": 12.0}])
    path = saved(with_gaps(flight, 15_000_000, 500_000, 60_000, {}))
    (run,) = ingest([path]).runs
    assert not run.usable
    assert "only 2.5 s lie in pieces of at least 2 s" in run.reasons[0]
    enough = saved(with_gaps(flight, 15_000_000, 2_600_000, 60_000, {}), "enough.BIN")
    assert ingest([enough]).runs[0].usable


# ------------------------------------------------------------------------------------------------ cut files, other axes


def test_maneuvers_outside_the_samples_of_a_file_are_one_line(shared_data: Path) -> None:
    found = ingest([shared_data / "ardupilot" / "heli_axis7_roll_rate.BIN"])
    (run,) = found.runs
    assert (run.id, run.axis, run.usable) == ("heli_axis7_roll_rate.BIN#7", "roll", True)
    shown = text(found)
    line = "8 maneuvers of this boot lie outside the samples of this file: 114.57 to 1164.28 s"
    assert shown.count(line) == 1
    assert "nothing was injected" not in shown
    written = document(found)
    assert [entry["id"] for entry in written["runs"]] == [run.id]
    assert any(line in note for note in written["sources"][0]["notes"])


def test_a_run_that_keeps_its_number_is_found_by_it(shared_data: Path) -> None:
    word = f"{shared_data / 'ardupilot' / 'heli_axis7_roll_rate.BIN'}#"
    (record,) = resolve_runs([word + "7"])
    assert record.axis == "roll"
    with pytest.raises(TippathError, match=r"no such run; the log has heli_axis7_roll_rate.BIN#7"):
        resolve_runs([word + "1"])


def test_a_file_without_any_of_its_maneuvers_says_so(saved: Saved, flown: Callable[..., bytes]) -> None:
    flight = flown([{"axis": 10}, {"axis": 11}])
    path = saved(rewritten(flight, lambda name, us: name not in ("RATE", "SIDD", "TPEX", "RPM") or us > 31_100_000))
    found = ingest([path])
    (run,) = found.runs
    assert not run.usable
    assert "no maneuver lies in the samples of this file" in run.reasons[0]
    assert "2 maneuvers of this boot lie outside the samples of this file" in text(found)


def test_a_yaw_sweep_is_a_run_of_yaw(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "ardupilot" / "heli_axis12_yaw_mixer.BIN"]).runs
    assert (run.id, run.maneuver, run.axis) == ("heli_axis12_yaw_mixer.BIN#8", "chirp", "yaw")
    assert run.usable
    assert run.health is not None
    assert run.health.coherent["yaw"].share > 0.8
    assert run.record is not None
    assert np.any(run.record.channels["excitation_r"])


def test_a_sweep_of_roll_has_no_excitation_of_yaw_and_thrust(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "ardupilot" / "heli_roll_sweep.BIN"]).runs
    assert run.record is not None
    excitations = {name for name in run.record.channels if name.startswith("excitation")}
    assert excitations == {"excitation_x", "excitation_y"}


@pytest.mark.parametrize(("axis", "name"), [(9, "yaw"), (13, "thrust")])
def test_other_axes_are_named_for_what_they_are(
    axis: int, name: str, saved: Saved, flown: Callable[..., bytes]
) -> None:
    (run,) = ingest([saved(flown([{"axis": axis}], own_messages=False))]).runs
    assert (run.maneuver, run.axis, run.usable) == ("chirp", name, False)
    assert run.reasons == (
        f"no excitation: {name} command 0 of full and rate 0 rad/s rms; sweep it with more amplitude",
    )


def louder(flight: bytes, from_us: int, factor: float) -> bytes:
    """The same with SIDD.Targ times a factor from a time on."""
    pieces = []
    for name, us, message in messages(flight):
        if name == "SIDD" and us >= from_us:
            targ = struct.unpack_from("<f", message, 15)[0]
            message = message[:15] + struct.pack("<f", factor * targ) + message[19:]
        pieces.append(message)
    return b"".join(pieces)


def test_a_magnitude_changed_in_mid_sweep_is_the_reason(shared_data: Path) -> None:
    (run,) = ingest([shared_data / "ardupilot" / "quad_sid_magnitude_15_in_mid_sweep.BIN"]).runs
    assert not run.usable
    (reason,) = run.reasons
    assert "the magnitude was changed in mid-sweep: 0.05 at its start (SIDS.Mag)" in reason
    assert "SIDD.Targ reaches 15" in reason
    assert "give a scale" not in text(Ingest((run,), ()))


def test_what_was_flown_before_the_magnitude_changed_is_used(saved: Saved, flown: Callable[..., bytes]) -> None:
    flight = flown([{"axis": 10, "duration": 20.0}])
    (whole,) = ingest([saved(louder(flight, 0, 1.5))]).runs
    assert whole.duration_s == pytest.approx(20.0, abs=0.05), "noise adds as much"
    (run,) = ingest([saved(louder(flight, 25_000_000, 300.0), "louder.BIN")]).runs
    assert run.usable, run.reasons
    assert run.start_s + run.duration_s == pytest.approx(25.0, abs=0.1)
    assert run.record is not None
    assert run.record.t[-1] < 25.1
    assert any("only what was flown before is taken" in note for note in run.notes)


# ------------------------------------------------------------------------------------------------ bad ends


def rows(n: int, change: Callable[[np.ndarray, np.ndarray], None]) -> str:
    t = np.arange(n) / 100
    x = 0.1 * np.sin(2 * np.pi * (0.5 + 0.1 * t) * t)
    p, q = 3 * x + 0.02 * np.sin(37 * t), 0.05 * np.sin(31 * t)
    change(p, q)
    lines = (",".join(f"{value:.6g}" for value in row) for row in zip(t, p, q, x, 0.01 * x, strict=True))
    return "\n".join(["t,p,q,delta_x,delta_y", *lines])


def test_a_loggers_ramp_at_the_end_is_cut_and_said(tmp_path: Path) -> None:
    def ramp(p: np.ndarray, q: np.ndarray) -> None:
        p[-115:] = np.linspace(3, 313, 115)

    path = tmp_path / "ramp.csv"
    path.write_text(rows(4222, ramp))
    (run,) = ingest([path]).runs
    assert run.usable, run.reasons
    assert run.record is not None
    assert 4222 - 115 - 4 <= run.record.t.size <= 4222 - 115
    (note,) = [note for note in run.notes if "no gyro" in note]
    assert "the last 11" in note
    assert "from 41.0" in note
    assert "313 rad/s" in note


def test_a_burst_in_the_middle_is_a_gap(tmp_path: Path) -> None:
    def burst(p: np.ndarray, q: np.ndarray) -> None:
        q[2000:2010] = [5, 90, 200, -150, 130, 170, 200, 180, 80, 4]

    path = tmp_path / "burst.csv"
    path.write_text(rows(4222, burst))
    (run,) = ingest([path]).runs
    assert run.usable, run.reasons
    assert len(run.gaps) == 1
    assert run.record is not None
    assert 4222 - 14 <= run.record.t.size <= 4222 - 10
    assert any("samples left out (between 20.00 and 20.0" in note and "no gyro" in note for note in run.notes)


def test_a_flight_in_degrees_is_still_one(tmp_path: Path) -> None:
    def degrees(p: np.ndarray, q: np.ndarray) -> None:
        p *= 400.0

    path = tmp_path / "degrees.csv"
    path.write_text(rows(4222, degrees))
    (run,) = ingest([path]).runs
    assert "degrees" in run.reasons[0]


# ------------------------------------------------------------------------------------------------ windows


def test_a_window_counts_from_each_runs_start(saved: Saved, flown: Callable[..., bytes]) -> None:
    path = saved(flown([{"axis": 10, "duration": 12.0}, {"axis": 11, "duration": 10.0}]))
    whole = ingest([path]).runs
    cut = ingest([path], window=parse_window("@2:9")).runs
    assert [run.id for run in cut] == ["flight.BIN#1@2:9", "flight.BIN#2@2:9"]
    for before, after in zip(whole, cut, strict=True):
        assert after.start_s == pytest.approx(before.start_s + 2, abs=0.01)
        assert after.duration_s == pytest.approx(7.0, abs=0.02)
        assert after.usable, after.reasons
    late = ingest([path], window=FromStart(11.0, None)).runs
    assert [run.id for run in late] == ["flight.BIN#1@11:"], "the other is over by then"
    with pytest.raises(TippathError, match=r"@30:40: the run is over 12.0 s after its start"):
        ingest([path], window=FromStart(30.0, 40.0))


def test_a_window_behind_a_run_is_its_own(saved: Saved, flown: Callable[..., bytes]) -> None:
    path = saved(flown([{"axis": 10, "duration": 12.0}, {"axis": 11, "duration": 10.0}]))
    first, second = resolve_runs([f"{path}#1@2:9", f"{path}#2"])
    assert (first.id, second.id) == ("flight.BIN#1@2:9", "flight.BIN#2")
    assert first.duration_s == pytest.approx(7.0, abs=0.02)
    assert second.duration_s > 10
    both = resolve_runs([f"{path}@1:7"])
    assert [record.id for record in both] == ["flight.BIN#1@1:7", "flight.BIN#2@1:7"]
    with pytest.raises(UsageError, match="START must lie before STOP"):
        resolve_runs([f"{path}#1@9:2"])


def test_a_csv_is_cut_from_its_first_sample(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    path.write_text(rows(4222, lambda p, q: None))
    (record,) = resolve_runs([f"{path}@5:25"])
    assert (record.t[0], record.t[-1]) == (5.0, 25.0)


@pytest.mark.parametrize("words", ["@-1:5", "@5", "@a:b", "@9:3"])
def test_a_window_from_the_start_that_makes_no_sense_is_wrong_usage(words: str) -> None:
    with pytest.raises(UsageError, match="--window"):
        parse_window(words)
