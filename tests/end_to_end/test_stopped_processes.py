"""Programs that are stopped, killed or run twice, over sockets and in real time: what they leave behind is compared
with what the vehicle wrote itself."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from storms import CARD, SETTINGS, gains_document

from gcs.cli import main
from gcs.flight.gains import gains_of
from gcs.flight.session import Session
from gcs.link.procedures import ReadSeveral
from gcs.vehicle.autopilots import ACTIVE_CRC

pytestmark = [
    pytest.mark.realtime,
    pytest.mark.thorough,
    pytest.mark.skipif(os.name == "nt", reason="signals of POSIX"),
]
TIPPATH = [sys.executable, "-m", "gcs.cli"]
BLOCK = 200


class Vehicle:
    """A simulated vehicle as a process of its own."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.logs = folder / "sd"
        given: list[str | Path] = [
            "--plant",
            "hover-ideal",
            "--listen",
            "udpin:127.0.0.1:0",
            "--json",
            "-o",
            self.logs,
            *words,
        ]
        self.process = subprocess.Popen(
            [*TIPPATH, "sim", *given],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert self.process.stdout is not None
        self.link: str = json.loads(self.process.stdout.readline())["ground_link"]

    def parameters(self, *names: str) -> dict[str, float]:
        with Session.open(self.link) as session:
            answers = session.call(ReadSeveral(names))
        return {name: answer.value for name, answer in answers.items() if answer is not None}

    def own(self, log: Path) -> bool:
        """Whether this file of the ground's is one of the vehicle's, byte for byte."""
        return log.read_bytes() in [path.read_bytes() for path in self.logs.glob("*.BIN")]

    def began(self, log: Path) -> bool:
        """Whether it is the beginning of one, but for blocks that had not come yet."""
        content = log.read_bytes()

        def other(own: bytes, at: int) -> bool:
            block = content[at : at + BLOCK]
            return block not in (own[at : at + len(block)], bytes(len(block)))

        owns = [path.read_bytes() for path in self.logs.glob("*.BIN")]
        return any(not any(other(own, at) for at in range(0, len(content), BLOCK)) for own in owns)


@pytest.fixture
def vehicle(tmp_path: Path) -> Iterator[Vehicle]:
    vehicle = Vehicle(tmp_path)
    yield vehicle
    os.killpg(vehicle.process.pid, signal.SIGCONT)
    vehicle.process.terminate()
    vehicle.process.communicate(timeout=20)


class Sweep:
    """`tippath sweep` of two runs, as a process of its own."""

    def __init__(self, vehicle: Vehicle, folder: Path) -> None:
        (folder / "card.toml").write_text(CARD)
        self.flight = folder / "flight"
        words: list[str | Path] = [
            "--connect",
            vehicle.link,
            "--card",
            folder / "card.toml",
            "-o",
            self.flight,
            "--no-probe",
            "--json",
        ]
        self.process = subprocess.Popen(
            [*TIPPATH, "sweep", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def until_run(self, number: int, after_s: float) -> None:
        """So long after this run's start."""
        end = time.monotonic() + 60.0
        while time.monotonic() < end and self.process.poll() is None:
            audit = self.flight / "audit.jsonl"
            if audit.exists() and audit.read_text().count("starting ") >= number:
                time.sleep(1.0 + after_s)  # the vehicle's word comes a second later
                return
            time.sleep(0.02)
        pytest.fail(f"run {number} did not start: {self.process.communicate()}")

    def over(self) -> tuple[int, dict[str, Any]]:
        out, err = self.process.communicate(timeout=120)
        assert "Traceback" not in err
        return self.process.returncode, json.loads(out)

    @property
    def log(self) -> Path:
        return self.flight / "flight.BIN"


def stopped(process: subprocess.Popen[str], seconds: float) -> None:
    """With what it started itself."""
    os.killpg(process.pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.killpg(process.pid, signal.SIGCONT)


def test_the_ground_stopped_for_some_seconds_loses_nothing(vehicle: Vehicle, tmp_path: Path) -> None:
    sweep = Sweep(vehicle, tmp_path)
    sweep.until_run(1, 1.0)
    stopped(sweep.process, 2.5)  # at 3.5 the link counts as lost
    status, said = sweep.over()
    assert (status, said["complete"]) == (0, True), said
    assert vehicle.own(sweep.log)


def test_a_vehicle_stopped_for_ten_seconds_is_a_lost_link_and_its_log_whole(vehicle: Vehicle, tmp_path: Path) -> None:
    before = vehicle.parameters(*SETTINGS)
    sweep = Sweep(vehicle, tmp_path)
    sweep.until_run(1, 1.0)
    stopped(vehicle.process, 10.0)
    status, said = sweep.over()
    assert (status, said["runs"][0]["ending"], said["reason"]) == (1, "link lost", "link lost")
    assert said["recording"]["complete"] is vehicle.own(sweep.log) is True
    assert vehicle.parameters(*SETTINGS) == before


def test_a_flight_killed_in_mid_run_leaves_the_beginning_of_the_log_and_goes_on(
    vehicle: Vehicle, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = vehicle.parameters(*SETTINGS)
    sweep = Sweep(vehicle, tmp_path)
    sweep.until_run(2, 1.5)
    sweep.process.kill()
    sweep.process.communicate()
    kept = sweep.log.read_bytes()
    assert main(["abort", "--connect", vehicle.link]) == 0
    capsys.readouterr()
    assert main(["sweep", "--connect", vehicle.link, "--resume", str(sweep.flight), "--no-probe", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["complete"], said["planned"], len(said["runs"])) == (True, 2, 2)
    assert sweep.log.read_bytes() == kept
    assert vehicle.began(sweep.log)
    assert vehicle.own(sweep.flight / "flight-2.BIN")
    assert vehicle.parameters(*SETTINGS) == before


def test_two_pushes_at_once_leave_one_whole_set_and_each_tells_the_truth(tmp_path: Path) -> None:
    vehicle = Vehicle(tmp_path, "--on-ground")
    try:
        costs = (10.0, 30.0)
        for number, cost in enumerate(costs):
            (tmp_path / f"{number}.json").write_text(json.dumps(gains_document(cost)))
        pushes = [
            subprocess.Popen(
                [*TIPPATH, "push", tmp_path / f"{number}.json", "--connect", vehicle.link, "--json"],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            for number in range(len(costs))
        ]
        ended = [(push.communicate(timeout=90), push.returncode) for push in pushes]
        crc = int(vehicle.parameters(ACTIVE_CRC)[ACTIVE_CRC])
        sets = [gains_of(gains_document(cost)).crc for cost in costs]
        assert crc in (0, *sets)
        assert not any("Traceback" in err for (_, err), _ in ended)
        assert crc == 0 or any(status == 0 and one == crc for one, (_, status) in zip(sets, ended, strict=True))
        assert any(status for _, status in ended) or crc in sets
    finally:
        vehicle.process.terminate()
        vehicle.process.communicate(timeout=20)


def test_a_vehicle_ends_with_the_command_that_started_it_even_where_that_is_killed(tmp_path: Path) -> None:
    told = subprocess.Popen(
        [*TIPPATH, "sim", "--listen", "udpout:127.0.0.1:0", "--json", "-o", tmp_path / "sd"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    assert told.stdin is not None
    assert told.stdout is not None
    assert told.stderr is not None
    told.stdout.readline()
    told.stdin.write(b"mode land\n")
    told.stdin.flush()
    assert b"pilot: ok" in told.stderr.readline()
    told.send_signal(signal.SIGKILL)
    _, rest = told.communicate(timeout=10)  # that pipe is the vehicle's, too: it ends when both are gone
    assert rest == b""
