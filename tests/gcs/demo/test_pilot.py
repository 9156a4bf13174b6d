"""The simulated vehicle as a process: it comes up, its pilot answers, and it ends whatever happens."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from gcs.demo.pilot import PilotError, SimulatedVehicle


def gone(pid: int, within_s: float = 6.0) -> bool:
    end = time.monotonic() + within_s
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


@pytest.mark.realtime
def test_it_comes_up_obeys_its_pilot_and_ends(tmp_path: Path) -> None:
    with SimulatedVehicle("hover-ideal", tmp_path / "vehicle", seed=2, on_ground=True) as vehicle:
        assert vehicle.ground_link.startswith("udpin:127.0.0.1:")
        assert not vehicle.ground_link.endswith(":0")
        assert (vehicle.ready.plant, vehicle.directory) == ("hover-ideal", tmp_path / "vehicle")
        assert os.getpgid(vehicle._process.pid) != os.getpgid(0), "a Ctrl-C in our terminal does not reach it"
        with pytest.raises(PilotError, match="cannot land: not flying"):
            vehicle.say("land")
        with pytest.raises(PilotError, match="cannot lqr on: no gains"):
            vehicle.say("lqr on")
        assert vehicle.say("takeoff") == "ok"
        assert vehicle.alive
        pid = vehicle._process.pid
    assert not vehicle.alive
    assert gone(pid)
    vehicle.close()
    with pytest.raises(PilotError, match="ended"):
        vehicle.say("takeoff")


def test_what_it_says_against_its_start_is_passed_on(tmp_path: Path) -> None:
    with pytest.raises(PilotError, match=r"ended: .*nonsense"):
        SimulatedVehicle("hover", tmp_path, listen="nonsense")


@pytest.mark.realtime
def test_it_ends_with_us_even_when_we_are_killed(tmp_path: Path) -> None:
    program = textwrap.dedent(
        f"""
        import sys, time
        from pathlib import Path
        from gcs.demo.pilot import SimulatedVehicle
        vehicle = SimulatedVehicle("hover-ideal", Path({str(tmp_path / "vehicle")!r}))
        print(vehicle._process.pid, flush=True)
        time.sleep(60)
        """
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as ours:
        assert ours.stdout is not None
        pid = int(ours.stdout.readline())
        os.kill(pid, 0)
        ours.send_signal(signal.SIGKILL)
        ours.wait(5)
    assert gone(pid)


def test_a_folder_that_takes_nothing_is_told_at_once(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(PilotError, match=r"cannot start: .*logs cannot be written .*another folder with -o DIR"):
        SimulatedVehicle("hover", tmp_path / "file" / "logs")
