"""A log fetched into a file, in fake time: whole, gone on with, never written over; and which log is the flight's."""

from __future__ import annotations

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fetched import Air, FileSession, FileVehicle, dataflash, noise
from more_of_a_kind import thorough

from gcs.errors import TippathError
from gcs.flight.fetching import pick
from gcs.flight.fetching.fetch import Fetched, Fetching, Progress, fetch, require_disarmed
from gcs.flight.fetching.part import PartFile
from gcs.flight.fetching.times import HEAD_BYTES, layout, offset_of, span, stamps
from gcs.flight.fetching.ways import VehicleLog, list_logs
from gcs.flight.fetching.windows import Windows, fetch_runs, windows
from gcs.link.procedures import ProcedureError

SIZE = 40_003
CONTENT = noise(SIZE)


@pytest.fixture
def card(tmp_path: Path) -> Path:
    """The vehicle's, with one log."""
    folder = tmp_path / "card"
    folder.mkdir()
    (folder / "vehicle-7.BIN").write_bytes(CONTENT)
    return folder


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


def fetching(session: FileSession, **options: Any) -> Fetching:
    return Fetching(session=session, clock=session.now, wait=session.wait, **options)


def fetch_newest(
    card: Path, out: Path, *, air: Air | None = None, ways: Any = ("log", "ftp"), **options: Any
) -> Fetched:
    session = FileSession(FileVehicle(card, air, ways=ways))
    return fetch(fetching(session, **options), pick.newest(list_logs(session)).log, out, "log")


@pytest.mark.parametrize("ways", [("ftp",), ("log",), ("log", "ftp")])
@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_the_file_is_the_vehicles(ways: tuple[str, ...], loss: float, card: Path, out: Path) -> None:
    done = fetch_newest(card, out, air=Air(loss=loss), ways=ways)
    assert (done.path, done.path.read_bytes()) == (out / "log.BIN", CONTENT)
    assert done.checked == ("ftp" in ways)
    assert done.log.number == (7 if "ftp" in ways else 1)
    assert [path.name for path in out.iterdir()] == ["log.BIN"]


@pytest.mark.parametrize("at", [1, 238, 239, 4096, 20_000, SIZE - 1, SIZE])
@pytest.mark.parametrize("way", ["ftp", "log"])
def test_a_fetch_cut_at_any_byte_is_gone_on_with(way: str, at: int, card: Path, out: Path) -> None:
    (out / "log.BIN.part").write_bytes(CONTENT[:at])
    done = fetch_newest(card, out, by=way)
    assert done.path.read_bytes() == CONTENT
    assert (done.resumed_from, done.came) == (at, SIZE - at)
    assert [path.name for path in out.iterdir()] == ["log.BIN"]


def test_another_vehicles_part_is_left_alone(card: Path, out: Path) -> None:
    strange = noise(20_000, 9)
    (out / "log.BIN.part").write_bytes(strange)
    done = fetch_newest(card, out)
    assert (done.path.name, done.path.read_bytes()) == ("log-2.BIN", CONTENT)
    assert (out / "log.BIN.part").read_bytes() == strange


def test_one_other_byte_at_the_cut_is_enough(card: Path, out: Path) -> None:
    (out / "log.BIN.part").write_bytes(CONTENT[:9_999] + bytes([CONTENT[9_999] ^ 1]))
    assert fetch_newest(card, out, ways=("log",)).path.name == "log-2.BIN"


def test_what_slips_through_is_found_by_the_checksum(card: Path, out: Path) -> None:
    """A byte that is compared nowhere: the vehicle's CRC32 shows it, and nothing is called the log."""
    wrong = bytearray(CONTENT[:39_000])
    wrong[1000] ^= 1
    (out / "log.BIN.part").write_bytes(wrong)
    with pytest.raises(TippathError, match="CRC32"):
        fetch_newest(card, out)
    assert [path.name for path in out.iterdir()] == ["log.BIN.part.wrong"]
    assert fetch_newest(card, out).path.read_bytes() == CONTENT


def test_what_is_there_is_not_fetched_again_nor_written_over(card: Path, out: Path) -> None:
    (out / "log.BIN").write_bytes(CONTENT)
    done = fetch_newest(card, out)
    assert (done.already, done.came, done.checked) == (True, 0, True)
    (out / "log.BIN").write_bytes(noise(SIZE, 5))
    assert fetch_newest(card, out).path.name == "log-2.BIN"
    assert (out / "log.BIN").read_bytes() == noise(SIZE, 5)


def test_a_log_that_grows_for_a_while_is_had_to_its_end(card: Path, out: Path) -> None:
    vehicle = FileVehicle(card)
    session = FileSession(vehicle)
    log = list_logs(session)[0]
    more = [noise(500, seed) for seed in range(3)]

    def grow(seconds: float) -> None:
        session.wait(seconds)
        if more:
            with (card / "vehicle-7.BIN").open("ab") as stream:
                stream.write(more.pop(0))

    done = fetch(Fetching(session=session, clock=session.now, wait=grow), log, out, "log")
    assert done.path.read_bytes() == CONTENT + b"".join(noise(500, seed) for seed in range(3))
    assert (done.checked, done.grows) == (True, False)


def test_a_log_that_grows_for_ever_is_taken_as_it_is(card: Path, out: Path) -> None:
    session = FileSession(FileVehicle(card))
    log = list_logs(session)[0]

    def grow(seconds: float) -> None:
        session.wait(seconds)
        with (card / "vehicle-7.BIN").open("ab") as stream:
            stream.write(bytes(100))

    done = fetch(Fetching(session=session, clock=session.now, wait=grow), log, out, "log")
    assert (done.checked, done.grows) == (False, True)
    assert (card / "vehicle-7.BIN").read_bytes().startswith(done.path.read_bytes())


def test_a_full_disk_leaves_what_came_and_is_said(card: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    append = PartFile.append

    def full(self: PartFile, data: bytes) -> None:
        if self.size > 9000:
            raise self._refusal(OSError(errno.ENOSPC, "No space left on device"))
        append(self, data)

    vehicle = FileVehicle(card)
    session = FileSession(vehicle)
    log = list_logs(session)[0]
    with monkeypatch.context() as patched:
        patched.setattr(PartFile, "append", full)
        with pytest.raises(TippathError, match=r"No space left on device.*go on"):
            fetch(fetching(session, by="log"), log, out, "log")
    kept = (out / "log.BIN.part").read_bytes()
    assert 9000 < len(kept) < SIZE
    assert CONTENT.startswith(kept)
    before = vehicle.sent_of_logs
    session.wait(0.5)
    assert vehicle.sent_of_logs == before, "the vehicle was told to end"
    assert fetch_newest(card, out).resumed_from == len(kept)


def test_arming_under_way_ends_it(card: Path, out: Path) -> None:
    session = FileSession(FileVehicle(card))
    log = list_logs(session)[0]

    def arm(progress: Progress) -> None:
        session.vehicle.vehicle.armed = progress.at > 5000

    with pytest.raises(TippathError, match="armed under way"):
        fetch(fetching(session, on_progress=arm), log, out, "log")
    assert CONTENT.startswith((out / "log.BIN.part").read_bytes())


def test_an_armed_vehicle_is_refused_in_its_own_words(card: Path) -> None:
    session = FileSession(FileVehicle(card))
    require_disarmed(session)
    session.vehicle.vehicle.armed = True
    with pytest.raises(TippathError, match=r"Disarm for log download.*Land, disarm"):
        require_disarmed(session)


def test_the_quicker_way_is_taken(tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    card = tmp_path / "card"
    card.mkdir()
    (card / "vehicle-1.BIN").write_bytes(noise(60_000))
    monkeypatch.setattr("gcs.flight.fetching.fetch.TRIAL_BYTES", {"ftp": 5_000, "log": 5_000})
    monkeypatch.setattr("gcs.flight.fetching.fetch.WORTH_ASKING_S", 0.01)
    vehicle = FileVehicle(card)
    vehicle._files._allowance._bytes_per_s = 20_000.0
    session = FileSession(vehicle)
    done = fetch(fetching(session), list_logs(session)[0], out, "log")
    assert (done.way, done.checked) == ("log", True)
    assert done.path.read_bytes() == noise(60_000)


@pytest.mark.parametrize("size", [0, 0xFFFF_FFFF])
def test_sizes_that_are_none_are_refused(size: int) -> None:
    logs = [VehicleLog(number=3, size=size, id=3)]
    with pytest.raises(TippathError, match="nothing to fetch"):
        pick.newest(logs)
    with pytest.raises(TippathError, match=f"says that it has {size:,} bytes"):
        pick.numbered(logs, 3)
    with pytest.raises(TippathError, match="no log 4; it has 3"):
        pick.numbered(logs, 4)


def test_a_vehicle_with_no_way_is_named(card: Path) -> None:
    vehicle = FileVehicle(card, ways=())
    vehicle.capabilities = 32
    with pytest.raises(ProcedureError, match=r"neither by MAVFTP.*nor by LOG_REQUEST_DATA.*card"):
        list_logs(FileSession(vehicle))


# Which log


def read_of(content: bytes) -> Callable[[int, int], bytes]:
    return lambda start, stop: content[start:stop]


def runs(*starts: float) -> list[dict[str, Any]]:
    return [{"log_start_s": start, "duration_s": 10.0} for start in starts]


def choose(contents: dict[int, bytes], of: list[dict[str, Any]], streamed: Path) -> pick.Choice:
    logs = [VehicleLog(number=number, size=len(content), id=number) for number, content in contents.items()]
    return pick.of_flight(logs, of, streamed, lambda log: read_of(contents[log.number]))


def test_times_are_found_from_anywhere_in_a_log() -> None:
    content = dataflash(100.0, start_s=50.0)
    known = layout(content[:1000])
    assert span(read_of(content), len(content), known) == pytest.approx((50.0, 149.99))
    assert stamps(content[5001:9000], known)[0].t == stamps(content[: 5001 + 27], known)[-1].t + 0.01
    for t in (40.0, 50.0, 77.77, 149.0, 200.0):
        at = offset_of(read_of(content), len(content), known, t)
        later = [stamp.t for stamp in stamps(content[:at], known) if stamp.t > t]
        assert not later
        if 50.0 < t < 149.5:
            assert stamps(content[at : at + 5000], known)[0].t == pytest.approx(t, abs=2.0)


@pytest.mark.parametrize("content", [b"", noise(5000), b"\xa3\x95\x80", dataflash(0.0)])
def test_what_has_no_times_covers_nothing(content: bytes, tmp_path: Path) -> None:
    with pytest.raises(TippathError, match="none of the vehicle's newest logs covers"):
        choose({1: content or b"x"}, runs(5.0), tmp_path / "none")


def test_the_flights_log_is_found_by_the_vehicles_clock(tmp_path: Path) -> None:
    contents = {1: dataflash(100.0, start_s=1.0), 2: dataflash(60.0, start_s=200.0), 3: dataflash(20.0, start_s=1.0)}
    assert choose(contents, runs(210.0, 230.0), tmp_path / "none").log.number == 2
    assert choose(contents, runs(40.0, 70.0), tmp_path / "none").log.number == 1
    with pytest.raises(TippathError, match=r"It has 1, 2, 3; --log"):
        choose(contents, runs(500.0), tmp_path / "none")
    unknown = choose(contents, [{"log_start_s": None, "duration_s": 3.0}], tmp_path / "none")
    assert (unknown.log.number, "no times" in unknown.words) == (3, True)


def test_of_two_logs_with_the_same_clock_the_one_with_its_bytes_is_taken(tmp_path: Path) -> None:
    contents = {1: dataflash(100.0, seed=1), 2: dataflash(100.0, seed=2)}
    streamed = tmp_path / "flight.BIN"
    streamed.write_bytes(contents[1][:90_000])
    chosen = choose(contents, runs(10.0), streamed)
    assert (chosen.log.number, "by its bytes" in chosen.words) == (1, True)
    chosen = choose(contents, runs(10.0), tmp_path / "none")
    assert (chosen.log.number, "--log NUMBER" in chosen.words) == (2, True)


def test_where_no_log_has_all_runs_the_one_with_most_is_taken_and_said(tmp_path: Path) -> None:
    contents = {1: dataflash(60.0, start_s=1.0), 2: dataflash(60.0, start_s=70.0), 3: dataflash(5.0, start_s=140.0)}
    chosen = choose(contents, runs(10.0, 55.0, 80.0, 100.0), tmp_path / "none")
    assert chosen.log.number == 2
    assert chosen.words == "by the vehicle's clock; it has 2 of the flight's 4 runs, no log has more"
    with pytest.raises(TippathError, match=r"was its card full.*What was recorded in flight stays"):
        choose({3: contents[3]}, runs(10.0, 80.0), tmp_path / "none")


@pytest.mark.parametrize(("booted_s", "number"), [(1000.0, 1), (4000.0, 2), (9000.0, 2), (None, 2)])
def test_after_a_reboot_the_log_of_the_flights_boot_is_taken(booted_s: float | None, number: int) -> None:
    contents = {1: dataflash(100.0, seed=1), 2: dataflash(100.0, seed=2)}
    logs = [
        VehicleLog(number=1, size=len(contents[1]), id=1, utc_s=1116),  # 101 s after booting, and a little late
        VehicleLog(number=2, size=len(contents[2]), id=2, utc_s=4101),
    ]
    chosen = pick.of_flight(
        logs, runs(10.0), Path("none"), lambda log: read_of(contents[log.number]), booted_s=booted_s
    )
    assert chosen.log.number == number
    assert ("by its date" in chosen.words) == (booted_s in (1000.0, 4000.0))


# The runs alone

TIMES = [(50.0, 60.0), (20.0, 25.0), (64.5, 70.0)]


def runs_alone(session: FileSession, out: Path) -> tuple[Windows, Fetched]:
    fetches = fetching(session, by="ftp")
    log = list_logs(session)[0]
    wanted = windows(fetches, log, TIMES)
    assert wanted is not None
    return wanted, fetch_runs(fetches, log, wanted, out, "log.runs-only", [1, 2, 3])


def test_runs_alone_are_the_head_and_their_messages(card: Path, out: Path) -> None:
    content = dataflash(100.0)
    (card / "vehicle-7.BIN").write_bytes(content)
    wanted, done = runs_alone(FileSession(FileVehicle(card)), out)
    got = done.path.read_bytes()
    assert got == b"".join(content[start:stop] for start, stop in wanted.pieces), "the vehicle's bytes"
    assert len(wanted.pieces) == 3, "head, the earlier run, and two that nearly touch"
    assert (done.path.name, done.runs, done.size) == ("log.runs-only.BIN", (1, 2, 3), len(got))
    assert len(got) < 0.5 * len(content)
    assert (len(got) - 2 * 89) % 27 == 0, "whole messages"
    times = [stamp.t for stamp in stamps(got, layout(got))]
    for start, stop in TIMES:
        inside = [t for t in times if start - 1.0 <= t <= stop + 0.2]
        assert inside == pytest.approx([start - 1.0 + i / 100 for i in range(len(inside))])
        assert len(inside) == pytest.approx(100 * (stop - start + 1.2), abs=1)
    assert runs_alone(FileSession(FileVehicle(card)), out)[1].already


@pytest.mark.parametrize("share", [0.0001, *thorough([0.2, 0.4]), 0.7, 0.9999])
def test_runs_alone_are_gone_on_with_wherever_cut_and_however_the_log_has_grown(
    share: float, card: Path, out: Path
) -> None:
    content = dataflash(100.0)
    (card / "vehicle-7.BIN").write_bytes(content[: 27 * 8000])
    whole = runs_alone(FileSession(FileVehicle(card)), out)[1]
    got = whole.path.read_bytes()
    whole.path.unlink()
    at = max(1, round(share * len(got)))
    (out / "log.runs-only.BIN.part").write_bytes(got[:at])
    (card / "vehicle-7.BIN").write_bytes(content)
    done = runs_alone(FileSession(FileVehicle(card)), out)[1]
    assert done.path.read_bytes() == got
    assert (done.resumed_from, done.came) == (at, len(got) - at)
    assert [path.name for path in out.iterdir()] == ["log.runs-only.BIN"]


def test_little_is_read_to_find_a_time() -> None:
    content, asked = dataflash(1000.0), set()
    known = layout(content[:4096])

    def counted(start: int, stop: int) -> bytes:
        asked.add((start, stop))
        return content[start:stop]

    at = offset_of(counted, len(content), known, 700.0)
    assert stamps(content[at : at + 2048], known)[0].t == pytest.approx(700.0, abs=0.8)
    assert sum(stop - start for start, stop in asked) < HEAD_BYTES + 16_000
