"""Forward flight: Table 5 comes back from three chirps, by a fit written here; wandering stays inside and is logged."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal
from scipy.linalg import expm
from scipy.optimize import least_squares

from sitl.autopilot.control_laws import ATTITUDE_GAIN, RATE_GAIN, AttitudeController
from sitl.autopilot.excitation import Excitation, ExcitationSettings
from sitl.autopilot.vehicle import make_vehicle
from sitl.plants import PLANTS, make_plant
from sitl.plants.actuators import clip
from sitl.plants.forward import AIRSPEED, ROTOR_RPM, ForwardPlant
from sitl.plants.hover import Gusts
from sitl.plants.table5 import TABLE_5, TABLE_5_FUSELAGE, Fuselage

DT = 0.002
STILL = Gusts(0.0, 0.0, 1.5)
CHIRPS = (("roll", 0.10), ("pitch", 0.15), ("elevator", 0.30))
NAMES = ("L_b", "M_a", "tau_f", "A_b", "B_a", "A_lat", "A_lon", "B_lat", "B_lon", "L_p", "M_q", "M_elev")
TRUTH = np.array([*TABLE_5, *TABLE_5_FUSELAGE])

Array = NDArray[np.float64]
Fly = Callable[[Any, float], list[str]]
Reader = Callable[[Path], list[Any]]


def matrices(values: Array) -> tuple[Array, Array]:
    """Eq. 15 and 16."""
    L_b, M_a, tau, A_b, B_a, A_lat, A_lon, B_lat, B_lon, L_p, M_q, M_elev = values
    A = np.array([[L_p, 0, 0, L_b], [0, M_q, M_a, 0], [0, -1, -1 / tau, A_b / tau], [-1, 0, B_a / tau, -1 / tau]])
    B = np.array([[0, 0, 0], [0, 0, M_elev], [A_lat / tau, A_lon / tau, 0], [B_lat / tau, B_lon / tau, 0]])
    return A, B


def fly(plant: ForwardPlant, axis: str, size: float, seed: int, duration_s: float) -> tuple[Array, Array]:
    """Commands (n, 3) and true rates (n, 2) of one chirp in closed loop."""
    controller = AttitudeController()
    excitation = Excitation(
        ExcitationSettings(kind="chirp", law="tischler", axis=axis, magnitude=size, duration_s=duration_s), seed
    )
    n = round(duration_s / DT)
    U, Y = np.empty((n, 3)), np.empty((n, 2))
    plant.reset()
    for k in range(n):
        added = excitation.step()
        x, y = controller.step(plant.phi, plant.theta, plant.p, plant.q, 0.0, 0.0)
        U[k] = clip(x + added.x), clip(y + added.y), clip(added.e)
        Y[k] = plant.p, plant.q
        plant.step(*U[k].tolist(), 0.0)
    return U, Y


def simulate(values: Array, U: Array) -> Array:
    """Rates (n, 2) from rest, commands held: the recursion of the exact discretisation as two filters."""
    A, B = matrices(values)
    block = np.zeros((7, 7))
    block[:4, :4], block[:4, 4:] = A * DT, B * DT
    step = expm(block)
    Y = np.zeros((U.shape[0], 2))
    for i in range(3):
        numerator, denominator = signal.ss2tf(step[:4, :4], step[:4, 4:], np.eye(2, 4), np.zeros((2, 3)), i)
        for j in range(2):
            Y[:, j] += signal.lfilter(numerator[j], denominator, U[:, i])
    return Y


def fit(runs: list[tuple[Array, Array]], start: Array) -> Array:
    def residuals(scale: Array) -> Array:
        return np.concatenate([(simulate(start * scale, U) - Y)[::5].ravel() for U, Y in runs])

    scale: Array = least_squares(residuals, np.ones(start.size), method="lm", x_scale=0.1).x
    return start * scale


@pytest.fixture(scope="module")
def start() -> Array:
    return TRUTH * np.where(np.arange(TRUTH.size) % 2, 1.15, 0.87)


@pytest.mark.thorough
def test_table_5_comes_back_from_three_chirps(start: Array) -> None:
    plant = ForwardPlant(STILL, 3)
    found = fit([fly(plant, axis, size, 5 + i, 12.0) for i, (axis, size) in enumerate(CHIRPS)], start)
    np.testing.assert_allclose(found, TRUTH, rtol=1e-4)


def test_in_light_gusts_it_comes_back_roughly(start: Array) -> None:
    plant = make_plant("forward", 4)
    assert isinstance(plant, ForwardPlant)
    found = dict(zip(NAMES, fit([fly(plant, *one, 9, 20.0) for one in CHIRPS], start), strict=True))
    for name in ("L_b", "M_a", "tau_f", "A_lon", "B_lat", "M_elev"):
        assert found[name] == pytest.approx(dict(zip(NAMES, TRUTH, strict=True))[name], rel=0.15), name


@pytest.mark.thorough
def test_another_pitch_damping_is_what_is_fitted(start: Array) -> None:
    plant = ForwardPlant(STILL, 3, fuselage=TABLE_5_FUSELAGE._replace(M_q=-2.0))
    found = fit([fly(plant, axis, size, 5 + i, 10.0) for i, (axis, size) in enumerate(CHIRPS)], start)
    assert found[NAMES.index("M_q")] == pytest.approx(-2.0, rel=1e-3)


def test_the_rotor_follows_its_speed_where_it_is_told_to() -> None:
    """tau_f and A_b are read off the state equations: finite differences of one step from chosen states."""
    for power in (0.0, 1.0):
        plant = ForwardPlant(STILL, 1, rotor_speed_power=power)
        for wanted in ROTOR_RPM:
            faster = (wanted / plant.nominal_rpm) ** power
            plant.omega = wanted * 2 * math.pi / 60
            plant.p = plant.q = plant.b = 0.0
            plant.a = 1e-3
            plant._integrate(0.0, 0.0, 0.0)
            assert plant.b / 1e-3 == pytest.approx(DT * TABLE_5.B_a / faster / TABLE_5.tau_f, rel=0.05)


def test_the_hover_gains_hold_it_with_and_without_lag() -> None:
    """Every closed-loop mode has more than a tenth of damping, with M_q as printed and with a plausible one."""
    for M_q in (TABLE_5_FUSELAGE.M_q, -2.0):
        A, B = matrices(np.array([*TABLE_5, *Fuselage(-0.930, M_q, 37.752)]))
        plant = np.zeros((6, 6))
        plant[:4, :4] = A
        plant[4, 0] = plant[5, 1] = 1
        gain = np.zeros((2, 6))
        gain[:, :2], gain[:, 4:] = RATE_GAIN, ATTITUDE_GAIN
        for lag in (0.002, 0.02, 0.04):
            loop = np.zeros((8, 8))
            loop[:6, :6] = plant
            loop[2:4, 6:] = B[2:4, :2]
            loop[6:, :6], loop[6:, 6:] = -gain / lag, -np.eye(2) / lag
            poles = np.linalg.eigvals(loop)
            assert np.min(-poles.real / np.abs(poles)) > 0.1, (M_q, lag)


def test_it_is_held_in_gusts_for_two_minutes() -> None:
    vehicle = make_vehicle("forward", 2)
    for _ in range(60_000):
        vehicle.step()
    assert vehicle.armed
    assert math.hypot(*vehicle.attitude) < 0.2


def test_airspeed_and_rotor_speed_wander_inside_their_bounds_and_slowly() -> None:
    for seed in range(5):
        plant = ForwardPlant(STILL, seed)
        seen = []
        for _ in range(60_000):
            seen.append((plant.airspeed, plant.omega * 60 / (2 * math.pi)))
            plant._samples += 1
            plant._look_at_the_air()
        for values, (low, high) in zip(np.array(seen).T, (AIRSPEED, ROTOR_RPM), strict=True):
            assert low <= values.min() < low + 0.25 * (high - low)
            assert high - 0.25 * (high - low) < values.max() <= high
            spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size))) ** 2
            assert spectrum[np.fft.rfftfreq(values.size, DT) > 0.12].sum() < 1e-4 * spectrum.sum()
    assert ForwardPlant(STILL, 1).airspeed != ForwardPlant(STILL, 2).airspeed


def test_every_plant_can_be_made_and_flown() -> None:
    for name in PLANTS:
        plant = make_plant(name, 1)
        for _ in range(50):
            plant.step(0.05, -0.05, 0.1, 0.2)
        assert 0 < abs(plant.p) < 3
    with pytest.raises(ValueError, match="hover, hover-ideal, forward"):
        make_plant("glider", 1)


def test_airspeed_is_logged_as_ardupilot_logs_it(tmp_path: Path, fly: Fly, read_log: Reader) -> None:
    vehicle = make_vehicle("forward", 1, directory=tmp_path)
    fly(vehicle, 2)
    vehicle.close()
    log = read_log(next(tmp_path.glob("*.BIN")))
    rows = [m for m in log if m.get_type() == "ARSP"]
    assert len(rows) == 100
    columns = "TimeUS,I,Airspeed,DiffPress,Temp,RawPress,Offset,U,H,Hp,TR,Pri"
    assert rows[0].get_fieldnames() == columns.split(",")
    assert {b.TimeUS - a.TimeUS for a, b in itertools.pairwise(rows)} == {20_000}
    assert all(AIRSPEED[0] <= m.Airspeed <= AIRSPEED[1] for m in rows)
    assert rows[0].DiffPress == pytest.approx(0.5 * 1.225 * rows[0].Airspeed ** 2, rel=1e-6)
    assert (rows[0].I, rows[0].U, rows[0].Temp) == (0, 1, 15.0)
    rpm = [m.RPM for m in log if m.get_type() == "RPM"]
    assert len(rpm) == 80
    assert all(ROTOR_RPM[0] <= value <= ROTOR_RPM[1] for value in rpm)


def test_on_the_ground_there_is_no_airspeed(fly: Fly) -> None:
    vehicle = make_vehicle("forward", 1, on_ground=True)
    fly(vehicle, 0.1)
    assert vehicle.airspeed == 0.0
