"""The vehicle as a process: what it prints, how it ends, and that its log is whole however it is ended."""

from __future__ import annotations

import itertools
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

Start = Callable[..., subprocess.Popen[str]]
Reader = Callable[[Path], list[Any]]

COMMAND = [sys.executable, "-m", "sitl"]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    processes = []

    def launch(*words: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*COMMAND, "-o", str(tmp_path / "logs"), *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield launch
    for process in processes:
        process.kill()
        process.communicate()


def line_from(stream: IO[str] | None) -> str:
    assert stream is not None
    ready, _, _ = select.select([stream], [], [], 10)
    assert ready, "nothing was printed in 10 s"
    return stream.readline()


def tell(process: subprocess.Popen[str], line: str) -> str:
    assert process.stdin is not None
    process.stdin.write(line + "\n")
    process.stdin.flush()
    return line_from(process.stdout).strip()


def only_log(tmp_path: Path) -> Path:
    (path,) = (tmp_path / "logs").glob("*.BIN")
    return path


@pytest.mark.realtime
def test_it_says_where_it_is_and_speaks_there_in_real_time(start: Start, tmp_path: Path) -> None:
    process = start("--listen", "udpin:127.0.0.1:0", "--plant", "hover-ideal", "--set", "SID_AXIS=11")
    ready = json.loads(line_from(process.stdout))
    assert ready["ready"] is True
    assert (ready["plant"], ready["directory"]) == ("hover-ideal", str(tmp_path / "logs"))
    word, host, port = ready["ground_link"].split(":")
    assert word == "udpout"
    assert ready["link"] == f"udpin:{host}:{port}"
    decoder, ours = mavlink.MAVLink(None), mavlink.MAVLink(None, 255, 190)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(5)
        sock.sendto(bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(ours)), (host, int(port)))
        start_s, boot_ms = 0.0, []
        while start_s == 0.0 or time.monotonic() - start_s < 1.0:
            message = decoder.decode(bytearray(sock.recv(2048)))
            if message.get_type() == "ATTITUDE":
                start_s = start_s or time.monotonic()
                boot_ms.append(message.time_boot_ms)
    assert boot_ms[-1] - boot_ms[0] == pytest.approx(1000, abs=150)
    process.send_signal(signal.SIGINT)
    assert process.wait(5) == 0


@pytest.mark.realtime
@pytest.mark.thorough
def test_the_command_hands_its_faults_on(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gcs.cli", "sim", "--listen", "udpin:127.0.0.1:0", "-o", str(tmp_path / "v")]
    faults = ["--lag", "0.1", "--outage=down@0:1.2", "--second-vehicle=land@1.5:", "--second-attitude"]
    with subprocess.Popen(
        [*command, "--json", *faults], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as sim:
        _, host, port = json.loads(line_from(sim.stdout))["ground_link"].split(":")
        decoder, ours = mavlink.MAVLink(None), mavlink.MAVLink(None, 255, 190)
        modes: set[int] = set()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.settimeout(5)
            sock.sendto(bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(ours)), (host, int(port)))
            while modes != {0, 9}:
                message = decoder.decode(bytearray(sock.recv(2048)))
                modes |= {message.custom_mode} if message.get_type() == "HEARTBEAT" else set()
        sim.terminate()
        sim.communicate(timeout=10)


@pytest.mark.realtime
def test_sigterm_leaves_a_whole_log(start: Start, tmp_path: Path, read_log: Reader) -> None:
    process = start("--listen", "udpout:127.0.0.1:0")
    ready = json.loads(line_from(process.stdout))
    assert ready["ground_link"].startswith("udpin:127.0.0.1:")
    assert int(ready["ground_link"].rsplit(":", 1)[1]) > 0
    time.sleep(0.5)
    process.send_signal(signal.SIGTERM)
    assert process.wait(5) == 0
    assert process.stderr is not None
    assert process.stderr.read() == ""
    path = only_log(tmp_path)
    assert path.stat().st_size % 200 == 0
    times = [m.TimeUS for m in read_log(path) if m.get_type() == "RATE"]
    assert len(times) > 100
    assert {b - a for a, b in itertools.pairwise(times)} == {2000}


@pytest.mark.realtime
def test_the_pilots_lines_and_quit(start: Start, tmp_path: Path) -> None:
    process = start("--listen", "udpout:127.0.0.1:0", "--on-ground")
    line_from(process.stdout)
    assert tell(process, "lqr on") == "refused: no gains have been committed"
    assert tell(process, "takeoff") == "ok"
    assert tell(process, "barrel roll").startswith("refused: unknown line")
    assert tell(process, "quit") == "ok"
    assert process.wait(5) == 0
    assert only_log(tmp_path).stat().st_size % 200 == 0


def test_accelerated_it_flies_a_minute_in_seconds(start: Start, tmp_path: Path, read_log: Reader) -> None:
    process = start("--speed", "max", "--duration", "60", "--seed", "3")
    assert json.loads(line_from(process.stdout))["ground_link"] is None
    assert process.wait(20) == 0
    rates = [m for m in read_log(only_log(tmp_path)) if m.get_type() == "RATE"]
    assert len(rates) == 30_000


@pytest.mark.realtime
def test_it_can_end_with_the_program_that_started_it(start: Start) -> None:
    process = start("--listen", "udpout:127.0.0.1:0", "--until-input-ends")
    line_from(process.stdout)
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(5) == 0
    process.stdin = None


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["--listen", "tcp:127.0.0.1:1"], 2, "is no link"),
        (["--listen", "tcpin:127.0.0.1:0", "--loss", "0.1"], 2, "udpout or udpin"),
        (["--listen", "udpout:127.0.0.1:0", "--loss", "2"], 2, "between 0 and 1"),
        (["--listen", "tcpin:127.0.0.1:0", "--outage", "up"], 2, "--outage is a fault of datagrams"),
        (["--lag", "soon"], 2, "--lag soon: 'soon' is no number"),
        (["--speed", "max", "--lag", "1"], 2, "leave out --lag"),
        (["--speed", "0"], 2, "positive number"),
        (["--speed", "10", "--listen", "udpout:127.0.0.1:0"], 2, "without a link"),
        (["--set", "SID_AXIS"], 2, "NAME=VALUE"),
        (["--set", "NOTHING=1"], 2, "no parameter NOTHING"),
        (["--plant", "balloon"], 2, "invalid choice"),
        (["--plant", "forward", "--like", "ardupilot-heli"], 2, "--like ardupilot-heli: ardupilot-heli flies hover or"),
        (["--like", "ardupilot-heli", "--condition", "lively"], 2, "no condition stirs it"),
        (["--plant", "quad"], 2, "quad flies only with --like"),
    ],
)
def test_wrong_usage_is_a_sentence(
    words: list[str], status: int, message: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    from sitl.__main__ import main

    try:
        ended = main(["-o", str(tmp_path), *words])
    except SystemExit as stopped:  # argparse's own
        ended = int(stopped.code or 0)
    captured = capfd.readouterr()
    assert ended == status
    assert message in captured.err
    assert "Traceback" not in captured.err
    assert captured.out == ""
    assert list(tmp_path.rglob("*.BIN")) == []


@pytest.mark.skipif(os.name != "posix", reason="a file in the way of a directory reads differently elsewhere")
def test_a_directory_that_cannot_be_is_named(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from sitl.__main__ import main

    (tmp_path / "file").write_bytes(b"")
    assert main(["-o", str(tmp_path / "file" / "logs")]) == 1
    assert "choose another directory" in capfd.readouterr().err
