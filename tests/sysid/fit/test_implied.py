"""Inertias, Lock number and flap frequency ratio against the paper's numbers and a Monte Carlo."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from planted import NOMINAL_OMEGA, TABLE_4, fly
from planted_fits import records

from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.fit.implied import Implied, Vehicle, implied, rotor_speed
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP
from sysid.model.structure import Model, Structure

PAPER = Vehicle(k_beta=88.0, mass=4.5, arm=0.15)
"""Notes to the paper, eq. 17."""


def fit(values: Mapping[str, float], structure: Structure = TPP, relative: float = 0.01) -> Fit:
    model = Model(structure, structure.vector(values))
    covariance = np.diag((relative * model.values) ** 2)
    return Fit(
        model=model,
        covariance=covariance,
        nrmse_percent={"p": 80.0, "q": 80.0},
        validation_nrmse_percent=None,
        records=(),
        validation=(),
        band_hz=(0.0, 15.0),
    )


def figures(of: Fit, vehicle: Vehicle = PAPER, omega: float | None = NOMINAL_OMEGA) -> dict[str, Implied]:
    return {one.name: one for one in implied(of, vehicle, omega)}


def test_table_4_implies_what_the_notes_say() -> None:
    found = figures(fit(TABLE_4))
    assert found["I_yy"].value == pytest.approx(0.133, abs=0.0005)
    assert found["I_xx"].value == pytest.approx(0.641, abs=0.0005)
    assert found["Lock number"].value == pytest.approx(1.0, abs=0.03)
    assert found["flap frequency ratio"].value ** 2 - 1 == pytest.approx(0.18, abs=0.005)
    assert not any(one.implausible for one in found.values())


def test_thrust_counts_only_with_mass_and_arm() -> None:
    found = figures(fit(TABLE_4), Vehicle(k_beta=88.0))
    assert found["I_yy"].value == pytest.approx(88.0 / 713.378)


def test_standard_errors_are_those_of_a_thousand_draws() -> None:
    of = fit(TABLE_4, relative=0.02)
    found = figures(of)
    rng = np.random.default_rng(1)
    names = TPP.names
    draws = rng.multivariate_normal(of.model.values, of.covariance, 4000)
    tau, A_b, B_a, M_a = (draws[:, names.index(name)] for name in ("tau_f", "A_b", "B_a", "M_a"))
    lock = 16 / (tau * NOMINAL_OMEGA)
    ratio = np.sqrt(1 + 0.5 * (B_a - A_b) * lock / 8)
    inertia = (88 + 0.15 * 4.5 * 9.80665) / M_a
    for name, expected in (("Lock number", lock), ("flap frequency ratio", ratio), ("I_yy", inertia)):
        assert found[name].standard_error == pytest.approx(expected.std(), rel=0.06), name


def test_a_rotor_that_turns_the_other_way_is_the_same_rotor() -> None:
    mirrored = {**TABLE_4, "A_b": -TABLE_4["A_b"], "B_a": -TABLE_4["B_a"]}
    found, other = figures(fit(TABLE_4)), figures(fit(mirrored), omega=-NOMINAL_OMEGA)
    for name in found:
        assert other[name].value == pytest.approx(found[name].value)
    assert figures(fit(mirrored))["flap frequency ratio"].implausible, "signs and sense of rotation disagree"


def test_measured_inertias_off_by_three_are_flagged_and_a_tenth_is_not() -> None:
    for times, expected in ((3.0, True), (1 / 3, True), (1.1, False), (0.9, False)):
        found = figures(fit(TABLE_4), Vehicle(k_beta=88.0, mass=4.5, arm=0.15, I_xx=0.641 * times, I_yy=0.133 * times))
        assert found["I_xx"].implausible == found["I_yy"].implausible == expected
    assert figures(fit(TABLE_4), Vehicle(k_beta=3 * 88.0, I_yy=0.133))["I_yy"].implausible


def test_a_missing_lag_shows_in_the_inertia() -> None:
    """30 ms of servo lag left out pull M_a from 713 to 451."""
    assert figures(fit({**TABLE_4, "M_a": 451.0}), Vehicle(k_beta=88.0, mass=4.5, arm=0.15, I_yy=0.133))[
        "I_yy"
    ].implausible


def test_impossible_parameters_give_flags_and_no_error() -> None:
    found = figures(fit({**TABLE_4, "L_b": -100.0, "M_a": 0.0, "tau_f": -0.1}))
    assert all(found[name].implausible for name in ("I_xx", "I_yy", "Lock number"))
    assert found["I_yy"].to_json()["value"] is None


def test_what_cannot_be_implied_is_left_out() -> None:
    assert [one.name for one in implied(fit(TABLE_4), PAPER, None)][:2] == ["I_xx", "I_yy"]
    assert "Lock number" not in figures(fit(TABLE_4), PAPER, None)
    assert len(implied(fit(TABLE_4), Vehicle(k_beta=88.0, omega=NOMINAL_OMEGA), None)) == 6
    assert figures(fit(TABLE_4), Vehicle(k_beta=88.0, omega=99.0))["Lock number"].value == pytest.approx(1.0, abs=0.03)
    cd = dict.fromkeys(CD.names, 1.0)
    assert implied(fit(cd, CD), PAPER, NOMINAL_OMEGA) == ()


def test_a_turned_swashplate_turns_both_rows_alike() -> None:
    """The independent integrator's vehicle, its swashplate turned by 0.2 rad, against the same vehicle as it was."""
    size = {"psi": 0.2}
    flight = fly("swashplate_phase", size, seed=5, duration_s=12.0, gusts=0.3)
    found, before = figures(identify(TPP, records(flight))), figures(fit(TABLE_4))
    for name in ("cyclic turned, roll", "cyclic turned, pitch"):
        error = found[name].standard_error
        assert error is not None
        assert error < 1.0
        assert found[name].value - before[name].value == pytest.approx(math.degrees(size["psi"]), abs=4 * error)
        assert not found[name].implausible


def test_held_parameters_have_no_error() -> None:
    of = fit(TABLE_4)
    of.covariance[1, :] = of.covariance[:, 1] = 0.0
    assert figures(of)["I_yy"].standard_error is None
    assert figures(of)["I_xx"].standard_error is not None


def test_exact_flapping_tells_its_own_numbers() -> None:
    structure = compose("tpp", ["second_order_flapping"], (), {"Omega_0": NOMINAL_OMEGA})
    of = fit({**TABLE_4, "lock_number": 1.018, "flap_frequency_ratio": 1.085}, structure)
    found = figures(of)
    assert found["Lock number"].value == 1.018
    assert found["flap frequency ratio"].value == 1.085
    assert math.isclose(found["Lock number"].standard_error or 0, 0.01018, rel_tol=1e-3)


def test_rotor_speed_is_the_mean_of_the_runs_that_log_it() -> None:
    t = np.arange(10.0)
    rest = dict.fromkeys(("p", "q", "delta_x", "delta_y"), t)
    fast, silent = Record("a", {"t": t, **rest, "omega": 0 * t + 170}), Record("b", {"t": t, **rest})
    assert rotor_speed([fast, silent]) == 170
    assert rotor_speed([silent]) is None
