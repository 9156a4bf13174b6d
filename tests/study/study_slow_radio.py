"""A stock ArduCopter over a radio of 57,600 baud at its real speed: the README's commands, as processes, step by step.

What is printed is how long each step took and what was fitted beside the simulated vehicle's own numbers. The same
stands in the suite in fake time (`tests/end_to_end/test_57600_baud.py`). Some twelve minutes for each vehicle, of which
the log's way over the radio is most.
"""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from sitl.plants.stock import QUAD
from sitl.plants.table4 import TABLE_4

BAUD_BYTES_S = 5760
BOOT_S = 42.0
HELI = {name: getattr(TABLE_4, name) for name in ("L_b", "M_a", "tau_f", "A_lat", "A_lon", "B_lat")}
"""The quick card leaves the others, which are small, to chance."""


class Walk:
    """A user's terminal beside a simulated vehicle's."""

    def __init__(self, like: str, plant: str, folder: Path) -> None:
        self.folder = folder
        self.took: list[tuple[str, float]] = []
        words = ["sim", "--like", like, "--plant", plant, "--on-ground", "--bandwidth", str(BAUD_BYTES_S), "--json"]
        self.vehicle = subprocess.Popen(
            [sys.executable, "-m", "gcs.cli", *words, "--listen", "udpin:127.0.0.1:0", "-o", str(folder / "vehicle")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.vehicle.stdout is not None
        self.link = json.loads(self.vehicle.stdout.readline())["ground_link"]

    def pilot(self, line: str) -> None:
        assert self.vehicle.stdin is not None
        assert self.vehicle.stderr is not None
        self.vehicle.stdin.write(line + "\n")
        self.vehicle.stdin.flush()
        assert "ok" in self.vehicle.stderr.readline()

    def tippath(self, command: str, *words: str, on_link: bool = False) -> tuple[int, str]:
        """Status and standard output of a command, on a terminal where somebody types `fly` when he is asked."""
        began = time.monotonic()
        link = ["--connect", self.link] if on_link else []
        keyboard, terminal = pty.openpty()
        os.write(keyboard, b"fly\n")
        done = subprocess.run(
            [sys.executable, "-m", "gcs.cli", command, *link, *words],
            stdin=terminal,
            capture_output=True,
            text=True,
            cwd=self.folder,
        )
        os.close(terminal)
        os.close(keyboard)
        self.took.append((command, time.monotonic() - began))
        print(f"--- {command} {' '.join(words)}: {done.returncode} after {self.took[-1][1]:.0f} s")
        print("\n".join(line for line in (done.stdout + done.stderr).splitlines() if line and "▶" not in line)[-2500:])
        return done.returncode, done.stdout

    def close(self) -> None:
        self.vehicle.terminate()
        self.vehicle.communicate(timeout=10)


@pytest.fixture
def walks(tmp_path: Path) -> Iterator[list[Walk]]:
    made: list[Walk] = []
    yield made
    for walk in made:
        walk.close()


@pytest.mark.parametrize(
    ("like", "plant", "model", "truth"),
    [
        ("ardupilot-heli", "hover-ideal", ("--model", "tpp"), HELI),
        (
            "ardupilot-quad",
            "quad",
            ("--model", "cd", "--with", "servo_lag"),
            {"L_lat": QUAD.L_lat, "M_lon": QUAD.M_lon, "tau_s": QUAD.tau},
        ),
    ],
)
def study_57600_baud(
    like: str, plant: str, model: tuple[str, ...], truth: dict[str, float], walks: list[Walk], tmp_path: Path
) -> None:
    walk = Walk(like, plant, tmp_path)
    walks.append(walk)
    began = time.monotonic()
    assert walk.tippath("check", "-o", "heli.param", on_link=True)[0] == 0
    time.sleep(max(0.0, BOOT_S + 2.0 - (time.monotonic() - began)))
    walk.pilot("takeoff")
    time.sleep(8.0)
    words = ("--log", "card", "--card", f"{like}-quick", "-o", "flight-0001")
    assert walk.tippath("sweep", *words, on_link=True)[0] == 0
    walk.pilot("land")
    time.sleep(20.0)
    status, out = walk.tippath("fetch", "-o", "flight-0001", "--json", on_link=True)
    assert status == 0
    log = json.loads(out)
    source = (tmp_path / "vehicle" / "vehicle-1.BIN").stat().st_size
    assert walk.tippath("ingest", "flight-0001", "--flight", "flight-0001")[0] == 0
    runs = [f"{log['file']}#{number}" for number in (1, 2)]
    assert walk.tippath("fit", *runs, *model, "-o", "fit.json")[0] == 0
    print_fit(tmp_path / "fit.json", truth)
    status, out = walk.tippath("diagnose", "fit.json", "--json")
    assert status == 0
    verdict = json.loads(out)
    print(f"  diagnose: {verdict['verdict']} {verdict['effect']}")
    if verdict["effect"] is not None:
        assert walk.tippath("add", "fit.json", verdict["effect"], "-o", "fit-2.json")[0] == 0
        print_fit(tmp_path / "fit-2.json", truth)
    print(f"\n{like}: " + ", ".join(f"{name} {seconds:.0f} s" for name, seconds in walk.took))
    print(f"  fetched {log['bytes']:,} of {source:,} bytes at {log['bytes_per_s']} B/s, runs {log['runs']}")
    assert log["runs"] == [1, 2, 3, 4]
    fitted = json.loads((tmp_path / "fit.json").read_text())["parameters"]
    assert {name: fitted[name]["value"] for name in truth} == pytest.approx(truth, rel=0.15)


def print_fit(path: Path, truth: Mapping[str, float]) -> None:
    """Its numbers beside the truth's."""
    fit = json.loads(path.read_text())
    print(f"  {' + '.join([fit['structure']['base'], *fit['structure']['effects']])}: {fit['nrmse_percent']}")
    for name, value in truth.items():
        fitted = fit["parameters"][name]
        off = 100 * (fitted["value"] / value - 1)
        print(f"  {name:6} {fitted['value']:10.4f} ± {fitted['standard_error']:.4f}  {off:+.1f} %")
