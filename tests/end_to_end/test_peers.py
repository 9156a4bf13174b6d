"""MAVProxy and MAVSDK list and fetch logs and parameters from the simulated vehicle in ArduPilot's clothes.

They judge the vehicle: what an autopilot's own ground stations cannot use, it does not do as an autopilot does.
`make study` runs these; where the two cannot be installed they are skipped, with the reason.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from fetched import noise
from peers import MavProxy, MissingError, mavsdk_files, mavsdk_logs, peers_python, with_peer

from gcs.link.key_file import of_passphrase, write_key
from sitl.autopilot.clothes import CLOTHES
from sitl.autopilot.vehicle import make_vehicle

pytestmark = pytest.mark.thorough
LIKE = "ardupilot-heli"
WORDS = "tip-path-plane"
SIZES = {3: 5_000, 12: 300_001}
"""The second ends with a piece of 31 bytes of 90, and 56 of 239."""


@pytest.fixture(scope="module")
def python() -> Path:
    try:
        return peers_python()
    except MissingError as why:
        pytest.skip(str(why))


@pytest.fixture
def link(tmp_path: Path) -> Iterator[str]:
    """Of a vehicle on the ground with logs 3 and 12."""
    card = tmp_path / "card"
    card.mkdir()
    for number, size in SIZES.items():
        (card / f"vehicle-{number}.BIN").write_bytes(noise(size, number))
    words = ["--like", LIKE, "--on-ground", "-o", str(card), "--listen", "udpin:127.0.0.1:0"]
    with subprocess.Popen(
        [sys.executable, "-m", "sitl", *words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["ground_link"]
        process.terminate()
        process.communicate(timeout=10)


@pytest.fixture(scope="module")
def values() -> dict[str, float]:
    """What such a vehicle lists, by name."""
    parameters = make_vehicle(CLOTHES[LIKE].plants[0], 1, on_ground=True, like=LIKE).parameters
    return {name: parameters[name] for name in parameters.visible()}


def saved(path: Path) -> dict[str, float]:
    return {name: float(value) for name, value in (line.split() for line in path.read_text().splitlines())}


def whole(path: Path, size: int) -> bytes:
    """The file as soon as it has its size: MAVProxy says that it is written before it is."""
    end = time.monotonic() + 5.0
    while path.stat().st_size < size and time.monotonic() < end:
        time.sleep(0.02)
    return path.read_bytes()


def test_mavproxy_reads_the_parameters_as_a_file_and_as_messages(
    python: Path, link: str, values: dict[str, float], tmp_path: Path
) -> None:
    kept, defaults = tmp_path / "mav.parm", tmp_path / "defaults.parm"
    with MavProxy(python, link, tmp_path) as proxy:
        assert int(proxy.until(r"Received (\d+) parameters \(ftp\)")[1]) == len(values)
        proxy.until(r"Saved \d+ defaults")
        assert saved(kept) == pytest.approx(values)
        proxy.say("param watch LOG_BITMASK")
        proxy.say("param set LOG_BITMASK 180223")
        proxy.until(r"LOG_BITMASK=180223")
        proxy.say("param fetch")
        proxy.until(r"Saved \d+ defaults")
        assert saved(kept) == pytest.approx(values | {"LOG_BITMASK": 180223.0})
        assert saved(defaults) == pytest.approx(values)
        kept.unlink()
        proxy.say("set param_ftp False")
        proxy.say("param fetch")
        assert int(proxy.until(r"Received (\d+) parameters$")[1]) == len(values)
        proxy.until(r"Saved \d+ parameters")
        assert saved(kept) == pytest.approx(values | {"LOG_BITMASK": 180223.0})


def test_mavproxy_lists_and_fetches_logs_both_ways(python: Path, link: str, tmp_path: Path) -> None:
    by_messages, by_files = tmp_path / "messages.bin", tmp_path / "files.bin"
    with MavProxy(python, link, tmp_path) as proxy:
        proxy.until(r"Received \d+ parameters")
        proxy.say("log list")
        assert proxy.until(r"Log 1  numLogs 2 lastLog 2 size (\d+)")[1] == "5000"
        assert proxy.until(r"Log 2  numLogs 2 lastLog 2 size (\d+)")[1] == "300001"
        proxy.say(f"log download 2 {by_messages}")
        proxy.until(r"Finished downloading", 60.0)
        assert whole(by_messages, SIZES[12]) == noise(SIZES[12], 12)
        proxy.say("ftp list logs")
        assert proxy.until(r"00000003.BIN\t(\d+)")[1] == "5000"
        assert proxy.until(r"00000012.BIN\t(\d+)")[1] == "300001"
        proxy.until("Total size")
        proxy.say(f"ftp get logs/00000012.BIN {by_files}")
        proxy.until(r"Wrote 300001 bytes", 60.0)
        assert whole(by_files, SIZES[12]) == noise(SIZES[12], 12)


def test_mavsdk_lists_and_fetches_logs(python: Path, link: str, tmp_path: Path) -> None:
    target = tmp_path / "log.bin"
    answer = with_peer(python, mavsdk_logs, link.replace(":", "://", 1), "1", str(target))
    assert (answer["sizes"], answer["ended"]) == (list(SIZES.values()), ["SUCCESS"])
    assert target.read_bytes() == noise(SIZES[12], 12)


def test_mavsdk_fetches_files_and_reads_the_parameters(
    python: Path, link: str, values: dict[str, float], tmp_path: Path
) -> None:
    words = (link.replace(":", "://", 1), "logs/00000012.BIN", str(tmp_path))
    answer = with_peer(python, mavsdk_files, *words)
    assert (answer["listed"], answer["ended"]) == (["00000003.BIN", "00000012.BIN"], ["SUCCESS"])
    assert (tmp_path / "00000012.BIN").read_bytes() == noise(SIZES[12], 12)
    assert answer["values"] == pytest.approx(values)


def test_mavproxy_with_the_same_passphrase_understands_and_is_understood(
    python: Path, tmp_path: Path, values: dict[str, float]
) -> None:
    """Its own signing, made of the same words; with others it is refused, and hears nothing that it believes."""
    key = tmp_path / "field.key"
    write_key(of_passphrase(WORDS), key)
    words = ["--like", LIKE, "--on-ground", "-o", str(tmp_path / "card"), "--listen", "udpin:127.0.0.1:0"]
    with subprocess.Popen(
        [sys.executable, "-m", "sitl", *words, f"--key={key}"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        link = json.loads(process.stdout.readline())["ground_link"]

        def refused() -> str:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write("refused\n")
            process.stdin.flush()
            return process.stdout.readline()

        try:
            (tmp_path / "right").mkdir()
            (tmp_path / "wrong").mkdir()
            with MavProxy(python, link, tmp_path / "wrong", "signing key other words than those") as proxy:
                with pytest.raises(TimeoutError):
                    proxy.until(r"Received \d+ parameters", 8.0)
                assert "wrongly signed" in refused()
            with MavProxy(python, link, tmp_path / "right", f"signing key {WORDS}") as proxy:
                assert int(proxy.until(r"Received (\d+) parameters \(ftp\)")[1]) == len(values)
                proxy.say("param watch LOG_BITMASK")
                proxy.say("param set LOG_BITMASK 180223")
                proxy.until(r"LOG_BITMASK=180223")
        finally:
            process.terminate()
            process.communicate(timeout=10)
