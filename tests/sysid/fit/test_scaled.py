"""Equations of parameters of any units have the answer that they have in units of their own."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.fit.scaled import instrumental_inverse, scaled_solve

UNITS = np.array([1.0, 1e-7, 1e6, 1e-3])


def rows(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((len(UNITS), 50))


def test_units_do_not_matter() -> None:
    J, e = rows(1), np.random.default_rng(2).standard_normal(50)
    scaled = J * UNITS[:, None]
    wanted = np.linalg.solve(J @ J.T, J @ e)
    assert scaled_solve(scaled @ scaled.T, scaled @ e) * UNITS == pytest.approx(wanted, rel=1e-9)
    as_it_stands = np.linalg.lstsq(scaled @ scaled.T, scaled @ e, rcond=1e-10)[0] * UNITS
    assert as_it_stands != pytest.approx(wanted, rel=0.5)


def test_instruments_of_any_units_invert() -> None:
    J, Z = rows(3), rows(3) + 0.1 * rows(4)
    moved, asked = J * UNITS[:, None], Z / UNITS[:, None]
    product = instrumental_inverse(asked, moved) @ (asked @ moved.T)
    assert product * np.outer(UNITS, 1 / UNITS) == pytest.approx(np.eye(len(UNITS)), abs=1e-9)


def test_what_nothing_determines_stays() -> None:
    J = rows(5)
    J[2], J[3] = 0.0, J[1]
    move = scaled_solve(J @ J.T, J @ rows(6)[0])
    assert move[2] == 0
    assert move[3] == pytest.approx(move[1])


def test_what_does_nothing_has_no_inverse() -> None:
    J = rows(7)
    J[1] = 0.0
    found = instrumental_inverse(J, J)
    kept = [0, 2, 3]
    assert found[1] == pytest.approx(0, abs=1e-12)
    assert found[:, 1] == pytest.approx(0, abs=1e-12)
    assert found[np.ix_(kept, kept)] == pytest.approx(np.linalg.inv(J[kept] @ J[kept].T))


def test_what_rounding_leaves_of_nothing_moves_nothing() -> None:
    H, g = np.array([[2.0, 0.0], [0.0, -1e-22]]), np.array([1.0, 1e-14])
    assert scaled_solve(H, g) == pytest.approx([0.5, 0.0], abs=1e-12)
