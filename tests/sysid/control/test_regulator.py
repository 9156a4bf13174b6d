"""What gains are worked out with, against SciPy, which takes longer to load than they take."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from sysid.control.regulator import _riccati
from sysid.control.stability import _balanced


def test_the_riccati_equation() -> None:
    rng = np.random.default_rng(1)
    Q, R = np.diag([1.0, 1.0, 1e-3, 1e-3]), 5 * np.eye(2)
    for _ in range(20):
        A = rng.standard_normal((4, 4)) * [1, 1, 50, 50] - 30 * np.eye(4)
        B = rng.standard_normal((4, 2)) * [[1.0], [1.0], [100.0], [100.0]]
        assert _riccati(A, B, Q, R) == pytest.approx(solve_continuous_are(A, B, Q, R), rel=1e-9, abs=1e-12)


def test_motion_that_no_command_reaches_and_that_grows_has_no_gains() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        _riccati(np.diag([1.0, -1.0]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))


def test_balancing_keeps_the_roots_and_shrinks_the_norm() -> None:
    A, late = np.array([[-1.0, 1e6], [1e-6, -2.0]]), np.zeros((2, 2))
    balanced, _ = _balanced(A, late)
    assert np.linalg.norm(balanced) < 10
    assert np.sort(np.linalg.eigvals(balanced)) == pytest.approx(np.sort(np.linalg.eigvals(A)))
