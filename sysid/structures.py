"""The paper's structures for hover: Tip-Path-Plane (eq. 5-7) and Cylinder Dynamics (eq. 8-9).

Symbols are Table 4's, free of Omega: tau_f = tau_fn/Omega, A_b = A_bn/Omega^2, B_a = B_an/Omega^2.
"""

from __future__ import annotations

import numpy as np

from sysid.model import AnyArray, EquationError, FloatArray, Matrices, Model, Structure
from sysid.parameter import Parameter

_INPUTS = ("delta_x", "delta_y")
_OUTPUTS = ("p", "q")


def _tpp_matrices(values: AnyArray) -> Matrices:
    L_b, M_a, tau_f, A_b, B_a, A_lat, A_lon, B_lat, B_lon = values
    A = np.zeros((4, 4), dtype=values.dtype)
    A[0, 3] = L_b
    A[1, 2] = M_a
    A[2] = np.array([0, -tau_f, -1, A_b]) / tau_f
    A[3] = np.array([-tau_f, 0, B_a, -1]) / tau_f
    B = np.zeros((4, 2), dtype=values.dtype)
    B[2] = np.array([A_lat, A_lon]) / tau_f
    B[3] = np.array([B_lat, B_lon]) / tau_f
    return Matrices(A, B, np.eye(2, 4), np.zeros((2, 2)))


# Eliminating a = q'/M_a and b = p'/L_b leaves two second-order equations whose nine coefficients
# map one to one to the nine parameters:
#   p'' = -L_b p - p'/tau_f + c_p q' + L_b/tau_f (B_lat delta_x + B_lon delta_y),   c_p = B_a L_b/(M_a tau_f)
#   q'' = -M_a q - q'/tau_f + c_q p' + M_a/tau_f (A_lat delta_x + A_lon delta_y),   c_q = A_b M_a/(L_b tau_f)
# coefficients: L_b, M_a, 1/tau_f, c_p, c_q, then the four input terms, p before q.


def _tpp_regressors(s: AnyArray, Y: AnyArray, U: AnyArray) -> AnyArray:
    columns = np.zeros((s.size, 2, 9), dtype=complex)
    p, q = Y[:, 0], Y[:, 1]
    columns[:, 0, 0] = -p
    columns[:, 1, 1] = -q
    columns[:, 0, 2] = -s * p
    columns[:, 1, 2] = -s * q
    columns[:, 0, 3] = s * q
    columns[:, 1, 4] = s * p
    columns[:, 0, 5:7] = U
    columns[:, 1, 7:9] = U
    return columns


def _tpp_denominator(s: AnyArray, coefficients: FloatArray) -> AnyArray:
    L_b, M_a, rate, c_p, c_q = coefficients[:5]
    D = np.empty((s.size, 2, 2), dtype=complex)
    D[:, 0, 0] = s * s + rate * s + L_b
    D[:, 0, 1] = -c_p * s
    D[:, 1, 0] = -c_q * s
    D[:, 1, 1] = s * s + rate * s + M_a
    return D


def _tpp_parameters(coefficients: FloatArray) -> FloatArray:
    L_b, M_a, rate, c_p, c_q, p_x, p_y, q_x, q_y = coefficients
    tau_f = 1 / rate
    return np.array(
        [
            L_b,
            M_a,
            tau_f,
            c_q * tau_f * L_b / M_a,
            c_p * tau_f * M_a / L_b,
            q_x * tau_f / M_a,
            q_y * tau_f / M_a,
            p_x * tau_f / L_b,
            p_y * tau_f / L_b,
        ]
    )


TPP = Structure(
    base="tpp",
    states=("p", "q", "a", "b"),
    inputs=_INPUTS,
    outputs=_OUTPUTS,
    parameters=(
        Parameter("L_b", "1/s^2", "roll acceleration per lateral flapping", (10.0, 1e4)),
        Parameter("M_a", "1/s^2", "pitch acceleration per longitudinal flapping", (10.0, 1e4)),
        Parameter("tau_f", "s", "time constant of the tip-path plane", (0.005, 0.5)),
        Parameter("A_b", "-", "longitudinal flapping from lateral", (-5.0, 5.0)),
        Parameter("B_a", "-", "lateral flapping from longitudinal", (-5.0, 5.0)),
        Parameter("A_lat", "rad", "longitudinal flapping per roll cyclic", (-5.0, 5.0)),
        Parameter("A_lon", "rad", "longitudinal flapping per pitch cyclic", (0.0, 5.0)),
        Parameter("B_lat", "rad", "lateral flapping per roll cyclic", (0.0, 5.0)),
        Parameter("B_lon", "rad", "lateral flapping per pitch cyclic", (-5.0, 5.0)),
    ),
    matrices=_tpp_matrices,
    equation_error=EquationError(2, _tpp_regressors, _tpp_denominator, _tpp_parameters),
    uncoupled=(150.0, 150.0, 0.1, 0, 0, 0, 0.1, 0.1, 0),
)
"""Eq. 5-7, states p, q, a, b, nine parameters."""


def _cd_matrices(values: AnyArray) -> Matrices:
    L_p, L_q, M_p, M_q, L_lat, L_lon, M_lat, M_lon = values
    A = np.array([[L_p, L_q], [M_p, M_q]])
    B = np.array([[L_lat, L_lon], [M_lat, M_lon]])
    return Matrices(A, B, np.eye(2), np.zeros((2, 2)))


def _cd_regressors(s: AnyArray, Y: AnyArray, U: AnyArray) -> AnyArray:
    columns = np.zeros((s.size, 2, 8), dtype=complex)
    columns[:, 0, 0:2] = Y
    columns[:, 1, 2:4] = Y
    columns[:, 0, 4:6] = U
    columns[:, 1, 6:8] = U
    return columns


def _cd_denominator(s: AnyArray, coefficients: FloatArray) -> AnyArray:
    A = coefficients[:4].reshape(2, 2)
    return s[:, None, None] * np.eye(2) - A


CD = Structure(
    base="cd",
    states=("p", "q"),
    inputs=_INPUTS,
    outputs=_OUTPUTS,
    parameters=(
        Parameter("L_p", "1/s", "roll damping"),
        Parameter("L_q", "1/s", "roll acceleration per pitch rate"),
        Parameter("M_p", "1/s", "pitch acceleration per roll rate"),
        Parameter("M_q", "1/s", "pitch damping"),
        Parameter("L_lat", "1/s^2", "roll acceleration per roll cyclic"),
        Parameter("L_lon", "1/s^2", "roll acceleration per pitch cyclic"),
        Parameter("M_lat", "1/s^2", "pitch acceleration per roll cyclic"),
        Parameter("M_lon", "1/s^2", "pitch acceleration per pitch cyclic"),
    ),
    matrices=_cd_matrices,
    equation_error=EquationError(1, _cd_regressors, _cd_denominator, lambda coefficients: coefficients),
    uncoupled=(-5.0, 0, 0, -5.0, 0, 0, 0, 0),
)
"""Eq. 8-9, states p, q, eight parameters."""

STRUCTURES = {"cd": CD, "tpp": TPP}


def reduce_to_cd(model: Model) -> Model:
    """The Cylinder-Dynamics model that a TPP model becomes when its flapping has settled (section 3.3).

    Setting a' = b' = 0 and solving for a and b; raises ValueError where they have no steady state.
    """
    A, B, _, _ = model.matrices
    slow, fast = slice(0, 2), slice(2, 4)
    try:
        settled = -np.linalg.solve(A[fast, fast], np.hstack([A[fast, slow], B[fast]]))
    except np.linalg.LinAlgError as error:
        raise ValueError("this model's flapping has no steady state") from error
    A_cd = A[slow, slow] + A[slow, fast] @ settled[:, :2]
    B_cd = A[slow, fast] @ settled[:, 2:]
    return Model(CD, np.concatenate([A_cd.ravel(), B_cd.ravel()]))
