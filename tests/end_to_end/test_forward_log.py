"""Forward flight through the files a user would have: three chirps to a .BIN, read by ingest, fitted as Table 5."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from flying import CHIRP, fly_maneuver, log_of

from gcs.logs import ingest, resolve_runs
from gcs.logs.runs.run import Run
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.plants.forward import AIRSPEED, ROTOR_RPM, ForwardPlant
from sitl.plants.hover import Gusts
from sitl.plants.table5 import TABLE_5, TABLE_5_FUSELAGE
from sysid.fit.identify import identify
from sysid.model.paper import TPP

CHIRPS = [(10, 0.10, "roll"), (11, 0.15, "pitch"), (20, 0.30, "elevator")]
TRUTH = {**TABLE_5._asdict(), **TABLE_5_FUSELAGE._asdict()}


def fly(vehicle: Vehicle, duration_s: float) -> Path:
    for axis, magnitude, _ in CHIRPS:
        fly_maneuver(vehicle, CHIRP, axis, magnitude, duration_s)
    assert vehicle.directory is not None
    return log_of(vehicle, vehicle.directory)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly(make_vehicle("forward", seed=6, directory=tmp_path_factory.mktemp("forward")), 30.0)


@pytest.fixture(scope="module")
def runs(log: Path) -> tuple[Run, ...]:
    return ingest([log]).runs


def test_the_elevator_s_run_is_found_and_called_so(runs: tuple[Run, ...]) -> None:
    assert [(run.maneuver, run.axis) for run in runs] == [("chirp", axis) for _, _, axis in CHIRPS]
    for run in runs:
        assert run.usable, run.reasons
        assert not any("excites neither" in note for note in run.notes)


def test_every_channel_of_forward_flight_is_there(runs: tuple[Run, ...]) -> None:
    for run in runs:
        assert run.record is not None
        channels = run.record.channels
        assert {"delta_e", "omega", "airspeed", "excitation_x", "excitation_y", "excitation_e"} <= set(channels)
        assert AIRSPEED[0] <= channels["airspeed"].min() < channels["airspeed"].max() <= AIRSPEED[1]
        rpm = channels["omega"] * 60 / (2 * np.pi)
        assert ROTOR_RPM[0] <= rpm.min() < rpm.max() <= ROTOR_RPM[1]
    elevator = runs[2].record
    assert elevator is not None
    assert np.abs(elevator.channels["excitation_e"]).max() == pytest.approx(0.3, rel=0.25)
    np.testing.assert_array_equal(elevator.channels["delta_e"], elevator.channels["excitation_e"])
    assert runs[2].health is not None
    command, rate = runs[2].health.excitation["elevator"]
    assert command > 0.1
    assert rate > 0.05
    assert "elevator" not in (runs[0].health.excitation if runs[0].health is not None else {})


def test_table_5_comes_back_from_three_chirps(log: Path) -> None:
    fit = identify(TPP, resolve_runs([str(log)]), effects=("angular_damping", "elevator"))
    names = fit.model.structure.names
    assert set(names) == set(TRUTH)
    off = {name: (fit.model[name] - TRUTH[name]) / float(np.sqrt(fit.covariance[i, i])) for i, name in enumerate(names)}
    assert max(abs(value) for value in off.values()) < 4.5, off
    for name in ("L_b", "M_a", "tau_f", "A_lon", "B_lat", "M_elev"):
        assert fit.model[name] == pytest.approx(TRUTH[name], rel=0.1), name
    modes = [(mode.frequency_hz, mode.damping_ratio) for mode in fit.model.modes]
    assert modes == [pytest.approx((1.762, 0.454), rel=0.06), pytest.approx((4.622, 0.221), rel=0.06)]


def test_another_pitch_damping_is_found_in_its_place(tmp_path: Path) -> None:
    """M_q of -2, in air without gusts: what is fitted is the plant's, not the paper's."""
    plant = ForwardPlant(Gusts(0.0, 0.0, 1.5), 2, fuselage=TABLE_5_FUSELAGE._replace(M_q=-2.0))
    path = fly(Vehicle(plant, seed=2, directory=tmp_path, name="forward"), 12.0)
    fit = identify(TPP, resolve_runs([str(path)]), effects=("angular_damping", "elevator"))
    assert fit.model["M_q"] == pytest.approx(-2.0, abs=0.4)
    assert fit.model["M_elev"] == pytest.approx(37.752, rel=0.02)
