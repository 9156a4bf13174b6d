"""Yaw and heave, each by its own command, judged on motions that scipy integrated, not the code that fits them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from more_of_a_kind import thorough
from scipy.signal import cont2discrete, lfilter

import sysid
from gcs.analysis.text.checks import check_text
from sysid.data.airframe import Airframe
from sysid.data.record import FloatArray, Record
from sysid.errors import FitError
from sysid.fit.check_kinds import NoModes
from sysid.fit.checks import _agreement, fit_checks
from sysid.model.base import find_base, on_axes

DT = 0.004
BAND_HZ = (0.3, 10.0)
T: FloatArray = DT * np.arange(10000, dtype=np.float64)
CHIRP: FloatArray = 0.1 * np.sin(2 * np.pi * (0.3 * T + 0.12 * T**2)) * (T < 39)


def flown(
    command: str, output: str, numerator: list[float], denominator: list[float], *, seed: int, late: int = 0
) -> Record:
    """An output that answers a command, held over each sample and `late` of them late; roll and pitch rest."""
    num, den, _ = cont2discrete((numerator, denominator), DT, "zoh")
    acting = np.concatenate([np.zeros(late), CHIRP[: T.size - late]])
    answer = lfilter(np.ravel(num), den, acting)
    rng = np.random.default_rng(seed)
    channels: dict[str, FloatArray] = {"t": T, command: CHIRP, "delta_x": 0 * T, "delta_y": 0 * T}
    channels |= {name: 0.01 * rng.standard_normal(T.size) for name in ("p", "q")}
    channels[output] = answer + 0.03 * np.std(answer) * rng.standard_normal(T.size)
    axis = {"delta_r": "yaw", "delta_c": "thrust"}[command]
    return Record(axis, channels, maneuver="chirp", axis=axis)


def test_yaw_of_first_order_is_found() -> None:
    run = flown("delta_r", "r", [50.0], [1.0, 3.0], seed=1)
    fit = sysid.fit_model([run], "yaw", band_hz=BAND_HZ)
    assert [fit.model[name] for name in ("N_r", "N_ped")] == pytest.approx([-3.0, 50.0], rel=0.02)
    assert list(fit.nrmse_percent) == ["r"]


def test_the_delay_of_a_late_tail_is_found() -> None:
    run = flown("delta_r", "r", [50.0], [1.0, 3.0], seed=2, late=12)
    fit = sysid.fit_model([run], "yaw", band_hz=BAND_HZ)
    found = sysid.diagnose_fit(fit, [run])
    assert (found.verdict, found.effect) == ("missing", "transport_delay")
    assert found.winner is not None
    assert found.winner.fit is not None
    assert found.winner.fit.model["T_d"] == pytest.approx(0.048, abs=0.002)


def test_rotors_that_react_lead_and_motors_lag() -> None:
    """k (0.25 s + 1)/((s + 0.8)(0.06 s + 1)), a lead that is longer than the lag."""
    base, contained = on_axes(find_base("multirotor"), ["yaw"])
    assert (base.name, contained) == ("multirotor_yaw", ())
    run = flown("delta_r", "r", [20.0 * 0.25, 20.0], np.polymul([1.0, 0.8], [0.06, 1.0]).tolist(), seed=3)
    fit = sysid.fit_model([run], base.name, band_hz=BAND_HZ)
    found = [fit.model[name] for name in ("N_r", "N_ped", "T_r", "tau_m")]
    assert found == pytest.approx([-0.8, 20.0, 0.25, 0.06], rel=0.08)
    without = sysid.fit_model([run], base.name, band_hz=BAND_HZ, fixed={"T_r": 0.0})
    assert without.nrmse_percent["r"] < fit.nrmse_percent["r"] - 10


def test_heave_shows_damping_and_the_lag_of_thrust() -> None:
    """az = (Z_w w + Z_col delta - az)/tau_T, w' = az: az/delta = Z_col s/(tau_T s^2 + s - Z_w)."""
    run = flown("delta_c", "az", [-60.0, 0.0], [0.08, 1.0, 1.1], seed=4)
    base, contained = on_axes(find_base("cd"), ["heave"])
    assert (base.name, contained) == ("heave", ())
    assert on_axes(find_base("multirotor"), ["thrust"]) == (base, ())
    fit = sysid.fit_model([run], "heave", band_hz=BAND_HZ)
    assert [fit.model[name] for name in ("Z_w", "Z_col", "tau_T")] == pytest.approx([-1.1, -60.0, 0.08], rel=0.05)


def lifted(radius_m: float, mass_kg: float, damping: float, *, seed: int) -> tuple[Record, dict[str, float]]:
    """A rotor in hover by momentum theory as it stands, not linearised, its air sped up as an apparent mass; and what
    theory says of it: k_i, tau_i, Z_w. Thrust follows the blades by 20 ms, which feel the flow through the disc."""
    rho, g, lag_s, parts = 1.225, 9.80665, 0.02, 4
    area = np.pi * radius_m**2
    v_0 = float(np.sqrt(mass_kg * g / (2 * rho * area)))
    apparent = 0.637 * rho * 4 / 3 * np.pi * radius_m**3
    command = 0.4 * CHIRP
    w, v, thrust, az = 0.0, v_0, mass_kg * g, np.zeros(T.size)
    for i, delta in enumerate(command):
        az[i] = -thrust / mass_kg
        for _ in range(parts):
            blades = mass_kg * (g + 60.0 * delta - damping * ((v - w) - v_0))
            step = DT / parts
            w, v, thrust = (
                w + step * (g - thrust / mass_kg),
                v + step * (thrust - 2 * rho * area * v * (v - w)) / apparent,
                thrust + step * (blades - thrust) / lag_s,
            )
    rng = np.random.default_rng(seed)
    channels = {"t": T, "delta_c": command, "delta_x": 0 * T, "delta_y": 0 * T, "excitation_c": command}
    channels |= {name: 0.01 * rng.standard_normal(T.size) for name in ("p", "q")}
    channels["az"] = az + 0.03 * np.std(az) * rng.standard_normal(T.size)
    theory = {"k_i": damping * v_0 / (2 * g), "tau_i": apparent / (4 * rho * area * v_0), "Z_w": -damping}
    return Record("heave", channels, maneuver="chirp", axis="thrust"), theory


@pytest.mark.parametrize(
    ("radius_m", "mass_kg", "damping"), [(2.0, 60.0, 2.7), *thorough([(6.0, 2500.0, 1.7), (0.9, 5.0, 3.5)])]
)
def test_inflow_that_follows_the_thrust_is_found(radius_m: float, mass_kg: float, damping: float) -> None:
    run, theory = lifted(radius_m, mass_kg, damping, seed=7)
    fit = sysid.fit_model([run], "heave_inflow", band_hz=BAND_HZ)
    assert [fit.model[name] for name in theory] == pytest.approx(list(theory.values()), rel=0.1)
    assert fit.model["tau_T"] == pytest.approx(0.02, rel=0.15)
    assert fit.model["Z_col"] == pytest.approx(-60.0, rel=0.05)
    without = sysid.fit_model([run], "heave", band_hz=BAND_HZ)
    assert without.nrmse_percent["az"] < fit.nrmse_percent["az"] - 5


@pytest.mark.parametrize(
    ("radius_m", "mass_kg", "damping"),
    [(0.44, 6.7, 2.7), *thorough([(0.55, 8.2, 2.9), (0.85, 46.9, 2.6), (0.44, 2.8, 3.6)])],
)
def test_a_small_rotor_s_inflow_is_found_beside_the_lag_of_its_thrust(
    radius_m: float, mass_kg: float, damping: float
) -> None:
    """Inflow and thrust settle in as many milliseconds: from one beginning the search ended with tau_i at its bound."""
    run, theory = lifted(radius_m, mass_kg, damping, seed=8)
    fit = sysid.fit_model([run], "heave_inflow", band_hz=BAND_HZ)
    assert fit.nrmse_percent["az"] > 98.9
    assert fit.model["tau_i"] == pytest.approx(theory["tau_i"], rel=0.15)
    assert [fit.model[name] for name in theory] == pytest.approx(list(theory.values()), rel=0.5)


def test_what_yaw_and_heave_need_is_named_where_it_is_not_logged() -> None:
    run = flown("delta_r", "r", [50.0], [1.0, 3.0], seed=5)
    with pytest.raises(FitError, match="az, delta_c is not logged, which HEAVE"):
        sysid.fit_model([run], "heave", band_hz=BAND_HZ)


def test_a_helicopter_is_told_that_it_has_no_motors_to_lag() -> None:
    run = flown("delta_r", "r", [50.0], [1.0, 3.0], seed=6)
    helicopter = Record("run", run.channels, maneuver="chirp", axis="yaw", airframe=Airframe.HELICOPTER)
    fit = sysid.fit_model([helicopter], "multirotor_yaw", band_hz=BAND_HZ)
    assert any("a helicopter has no yaw behind motors" in warning for warning in fit.warnings)


@pytest.mark.parametrize(
    ("damping", "gain", "lead_s", "lag_s"),
    [(5.7, 33.0, 0.59, 0.012), (3.0, 11.0, 0.54, 0.14), *thorough([(4.3, 57.0, 0.4, 0.014), (5.5, 50.0, 0.49, 0.055)])],
)
def test_a_lead_beyond_the_damping_s_time_is_found(damping: float, gain: float, lead_s: float, lag_s: float) -> None:
    """From no lead at all the search ended with one at its bound, or with motors of half a second."""
    denominator = np.polymul([1.0, damping], [lag_s, 1.0]).tolist()
    run = flown("delta_r", "r", [gain * lead_s, gain], denominator, seed=9)
    fit = sysid.fit_model([run], "multirotor_yaw", band_hz=BAND_HZ)
    found = [fit.model[name] for name in ("N_r", "N_ped", "T_r", "tau_m")]
    assert found == pytest.approx([-damping, gain, lead_s, lag_s], rel=0.2)


def test_a_vehicle_that_only_integrates_has_no_mode_to_check() -> None:
    run = flown("delta_r", "r", [50.0], [1.0, 0.0], seed=9)
    spun = replace(run, channels={**run.channels, "omega": np.full(T.size, 170.0)})
    fit = sysid.fit_model([spun], "yaw", band_hz=BAND_HZ, fixed={"N_r": 0.0})
    checks, _ = fit_checks(fit.model, [spun], BAND_HZ, fit.fixed)
    told = {one.name: (one.passed, check_text(one)) for one in checks}
    assert told["below the rotor"] == (True, "rotor 27.1 Hz, and the model only integrates")
    assert _agreement([fit.model, fit.model]).finding == NoModes()
