"""A stock ArduCopter's flight, simulated, as a user's log: listed, and its plant found again.

The plant is the simulator's own, so a fit that gives it back checks the plumbing (formats, rates, axes, signs), and
says nothing of real vehicles; those are in `../shared/data/ardupilot`.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import sysid
from gcs.cli.sim import AUTOPILOTS
from gcs.flight.session import Session
from gcs.link.procedures import ReadAllParameters
from gcs.logs import ingest
from sitl.autopilot.clothes import CLOTHES
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import make_vehicle
from sitl.plants.stock import QUAD
from sitl.plants.table4 import TABLE_4

SWEEP = {"SID_F_STOP_HZ": 10.0, "SID_T_FADE_IN": 1.0, "SID_T_REC": 20.0, "SID_T_FADE_OUT": 0.5}


def flown(like: str, plant: str, folder: Path, **settings: float) -> Path:
    """The card's file of a roll and a pitch sweep."""
    vehicle = make_vehicle(plant, 5, directory=folder, parameters=SWEEP | settings, like=like)
    for axis in (10, 11):
        vehicle.write_parameter("SID_AXIS", axis)
        assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
        for _ in range(round(27.0 / vehicle.dt)):
            vehicle.step()
        assert vehicle.set_mode(Mode.STABILIZE, Reason.GROUND)
        for _ in range(round(1.0 / vehicle.dt)):
            vehicle.step()
    vehicle.close()
    return next(folder.glob("*.BIN"))


@pytest.mark.parametrize(
    ("like", "plant", "magnitude", "base", "effects", "truth"),
    [
        (
            "ardupilot-heli",
            "hover-ideal",
            0.08,
            "tpp",
            [],
            {name: getattr(TABLE_4, name) for name in ("L_b", "M_a", "tau_f", "A_lat", "A_lon", "B_lat")},
        ),
        (
            "ardupilot-quad",
            "quad",
            0.05,
            "cd",
            ["motor_lag"],
            {"L_lat": QUAD.L_lat, "M_lon": QUAD.M_lon, "tau_m": QUAD.tau},
        ),
    ],
)
def test_a_fast_log_gives_the_plant_back(
    like: str, plant: str, magnitude: float, base: str, effects: list[str], truth: dict[str, float], tmp_path: Path
) -> None:
    found = ingest([flown(like, plant, tmp_path, SID_MAGNITUDE=magnitude, LOG_BITMASK=180223)]).runs
    assert [(run.maneuver, run.axis, run.usable, len(run.gaps)) for run in found] == [
        ("chirp", "roll", True, 0),
        ("chirp", "pitch", True, 0),
    ]
    assert {round(run.rate_hz) for run in found} == {400}
    records = [run.record for run in found if run.record is not None]
    fit = sysid.fit_model(records, base, effects)
    assert {name: fit.model[name] for name in truth} == pytest.approx(truth, rel=0.05)


def test_the_default_bitmask_gives_usable_runs_at_100_hz(tmp_path: Path) -> None:
    found = ingest([flown("ardupilot-quad", "quad", tmp_path, SID_MAGNITUDE=0.05)]).runs
    assert [(run.axis, run.usable, round(run.rate_hz), len(run.gaps)) for run in found] == [
        ("roll", True, 100, 0),
        ("pitch", True, 100, 0),
    ]


# Processes


def test_the_command_knows_the_table() -> None:
    assert set(AUTOPILOTS) == set(CLOTHES)


@pytest.fixture
def simulated(tmp_path: Path) -> Iterator[dict[str, str]]:
    """`tippath sim --like ardupilot-quad`, on the ground: its first line."""
    words = ["sim", "--like", "ardupilot-quad", "--on-ground", "--json", "-o", str(tmp_path / "v")]
    command = [sys.executable, "-m", "gcs.cli", *words, "--listen", "tcpin:127.0.0.1:0"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
        process.terminate()
        process.communicate(timeout=10)


@pytest.mark.realtime
def test_the_command_starts_it_and_a_session_lists_its_parameters(simulated: dict[str, str]) -> None:
    assert (simulated["like"], simulated["plant"]) == ("ardupilot-quad", "quad")
    with Session.open(simulated["ground_link"]) as session:
        names = set(session.call(ReadAllParameters()))
    hidden = {parameter.name for parameter in CLOTHES["ardupilot-quad"].table} - names
    assert hidden == {
        "SID_MAGNITUDE",
        "SID_F_START_HZ",
        "SID_F_STOP_HZ",
        "SID_T_FADE_IN",
        "SID_T_REC",
        "SID_T_FADE_OUT",
    }
