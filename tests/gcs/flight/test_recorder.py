"""What lands on disk: bytes in their places, stamps that pymavlink reads, nothing overwritten, a full disk survived."""

from __future__ import annotations

import os
import sys
import time
from io import FileIO
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.errors import TippathError
from gcs.flight.recorder import Recorder, _Growing
from gcs.flight.syncing import Syncing
from gcs.link.log_blocks import StreamResult
from gcs.link.log_end import Cause, EndState, LogEnd

REACHED = LogEnd(state=EndState.REACHED, cause=Cause.ASKED, log_s=60.1, clock_s=60.0)


def test_blocks_lie_at_their_place_whatever_the_order(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a" / "b", lambda: 0.0)
    assert recorder.log_path is None
    for number in (3, 0, 1):
        assert recorder.store(0, number, bytes([number]) * 200)
    path = tmp_path / "a" / "b" / "flight.BIN"
    assert path.stat().st_size == 800  # it grows on disk, not in a buffer
    assert recorder.store(0, 2, bytes([2]) * 200)
    summary = recorder.finish((StreamResult(file=0, blocks=4, expected=4, missing=(), duplicates=0, end=REACHED),))
    assert path.read_bytes() == b"".join(bytes([n]) * 200 for n in range(4))
    assert summary.log == path
    assert summary.problems == ()
    assert summary.complete
    assert "REMOTE_LOG_DATA_BLOCK" in summary.how


def test_missing_blocks_are_counted_and_named(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, lambda: 0.0)
    recorder.store(0, 0, bytes(200))
    recorder.store(0, 9, bytes(200))
    summary = recorder.finish(
        (StreamResult(file=0, blocks=2, expected=10, missing=((1, 8),), duplicates=3, end=REACHED),)
    )
    assert summary.missing_blocks == 8
    assert summary.problems == ("flight.BIN: 8 of 10 blocks missing",)
    assert not summary.complete
    assert summary.to_json()["logs"][0]["missing"] == [[1, 8]]


def test_a_log_of_which_nobody_showed_the_end_is_not_complete(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, lambda: 0.0)
    recorder.store(0, 0, bytes(200))
    summary = recorder.finish((StreamResult(file=0, blocks=1, expected=1, missing=(), duplicates=0),))
    assert (summary.missing_blocks, summary.complete) == (0, False)
    assert "whether it is whole at its end is not known" in summary.problems[0]


def test_a_cut_log_is_told_in_seconds_with_the_vehicles_reason(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, lambda: 0.0)
    recorder.store(0, 0, bytes(200))
    end = LogEnd(state=EndState.CUT, cause=Cause.ASKED, log_s=50.31, clock_s=60.0, reported="Log stream stopped: tired")
    summary = recorder.finish((StreamResult(file=0, blocks=1, expected=1, missing=(), duplicates=0, end=end),))
    assert summary.problems == (
        "flight.BIN ends 9.7 s before the recording did (the vehicle: Log stream stopped: tired)",
    )
    log = summary.to_json()["logs"][0]
    assert (log["end"], log["log_s"], log["vehicle_clock_s"], log["complete"]) == ("cut", 50.31, 60.0, False)
    assert log["short_s"] == pytest.approx(9.69)


def test_a_name_that_exists_is_never_written(tmp_path: Path) -> None:
    (tmp_path / "flight.BIN").write_bytes(b"an earlier flight")
    (tmp_path / "flight.tlog").write_bytes(b"its telemetry")
    recorder = Recorder(tmp_path, lambda: 0.0)
    recorder.store(0, 0, bytes(200))
    recorder.store(1, 0, bytes([1]) * 200)
    summary = recorder.finish(
        (
            StreamResult(file=0, blocks=1, expected=1, missing=(), duplicates=0, end=REACHED),
            StreamResult(file=1, blocks=1, expected=1, missing=(), duplicates=0, end=REACHED),
        )
    )
    assert [log.path.name for log in summary.logs] == ["flight-2.BIN", "flight-3.BIN"]
    assert (tmp_path / "flight.BIN").read_bytes() == b"an earlier flight"
    assert (tmp_path / "flight.tlog").read_bytes() == b"its telemetry"
    assert "began a new log" in summary.problems[0]


def test_telemetry_is_read_by_pymavlink(tmp_path: Path) -> None:
    times = iter([1_700_000_000.25, 1_700_000_001.5])
    recorder = Recorder(tmp_path, lambda: next(times))
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    recorder.frame(mavlink.MAVLink_heartbeat_message(4, 3, 0, 25, 4, 3).pack(mav))
    recorder.frame(mavlink.MAVLink_attitude_message(7, 1, 2, 3, 4, 5, 6).pack(mav))
    summary = recorder.finish(())
    assert summary.tlog is not None
    assert summary.tlog_frames == 2
    log = mavutil.mavlink_connection(str(summary.tlog))
    first, second = log.recv_msg(), log.recv_msg()
    assert log.recv_msg() is None
    log.close()
    assert (first.get_type(), first.custom_mode, first._timestamp) == ("HEARTBEAT", 25, 1_700_000_000.25)
    assert (second.get_type(), second.time_boot_ms, second._timestamp) == ("ATTITUDE", 7, 1_700_000_001.5)


def test_no_block_leaves_no_empty_log(tmp_path: Path) -> None:
    summary = Recorder(tmp_path, lambda: 0.0).finish(())
    assert summary.log is None
    assert not summary.complete
    assert not (tmp_path / "flight.BIN").exists()
    assert "LOG_BACKEND_TYPE" in summary.problems[0]


def test_a_folder_that_cannot_be_is_an_error_with_advice(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TippathError, match="choose another folder"):
        Recorder(tmp_path / "file" / "flight", lambda: 0.0)


@pytest.mark.skipif(sys.platform == "win32", reason="limits of file sizes are a Unix thing")
def test_a_disk_that_takes_no_more_is_a_condition_that_may_pass(tmp_path: Path) -> None:
    import resource
    import signal

    recorder = Recorder(tmp_path, lambda: 0.0)
    assert recorder.store(0, 0, bytes(200))
    recorder.frame(bytes(30))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (300, before[1]))
        assert not recorder.store(0, 1, b"\x01" * 200)
        assert recorder.problem is not None
        for _ in range(20):
            recorder.frame(bytes(30))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert recorder.store(0, 1, b"\x01" * 200)
    assert recorder.problem is None
    summary = recorder.finish((StreamResult(file=0, blocks=2, expected=2, missing=(), duplicates=0, end=REACHED),))
    assert (tmp_path / "flight.BIN").read_bytes() == bytes(200) + b"\x01" * 200
    assert summary.tlog is not None
    assert summary.tlog.stat().st_size == 38 * summary.tlog_frames
    assert len(summary.problems) == 2


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_a_full_device_loses_no_more_than_what_it_did_not_take(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, lambda: 0.0)
    recorder._logs[0] = _Growing(Path("/dev/full"), FileIO("/dev/full", "w"))
    assert not recorder.store(0, 0, bytes(200))
    assert recorder.problem == "the log is not being kept: No space left on device"
    recorder.finish(())


@pytest.mark.skipif(sys.platform == "win32", reason="limits of file sizes are a Unix thing")
def test_half_a_block_is_not_left_at_the_end(tmp_path: Path) -> None:
    import resource
    import signal

    recorder = Recorder(tmp_path, lambda: 0.0)
    assert recorder.store(0, 0, bytes(200))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (512, before[1]))
        assert recorder.store(0, 1, b"\x01" * 200)
        assert not recorder.store(0, 2, b"\x02" * 200)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert (tmp_path / "flight.BIN").stat().st_size == 400
    recorder.finish(())


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="no count of open files here")
def test_a_log_that_another_follows_is_closed(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, lambda: 0.0)
    assert recorder.store(0, 0, bytes(200))
    few = len(os.listdir("/proc/self/fd"))
    assert all(recorder.store(file, 0, bytes(200)) for file in range(1, 200))
    assert len(os.listdir("/proc/self/fd")) == few
    assert len(recorder.finish(()).logs) == 200


def test_a_block_in_two_versions_is_told_and_the_log_is_not_called_complete(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, lambda: 0.0)
    recorder.store(0, 0, bytes(200))
    told = StreamResult(file=0, blocks=1, expected=1, missing=(), duplicates=0, end=REACHED, in_two_versions=1)
    summary = recorder.finish((told,))
    assert not summary.complete
    assert summary.problems == (
        "flight.BIN: 1 block came in two versions, damaged or somebody else's; the first is kept",
    )


def test_what_was_written_reaches_the_disk_without_being_asked(tmp_path: Path) -> None:
    syncing = Syncing(every_s=0.01)
    with FileIO(tmp_path / "a", "x") as stream:
        stream.write(b"x")
        syncing.written(stream)
        end = time.monotonic() + 30
        while not syncing.count and time.monotonic() < end:
            time.sleep(0.005)
        assert syncing.count == 1  # and not again while nothing is new
    syncing.written(stream)  # closed: no harm
    syncing.close()
