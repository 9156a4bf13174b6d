"""The on-board control laws: an attitude controller that keeps flying during a sweep, and the LQR with observer.

The attitude controller's gains were found for Table 4's plant by placing every closed-loop pole left of -1.2 1/s
with 0 to 40 ms of actuator lag; cross terms take the rotor's coupling into account, as the paper's eq. 1 does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

DT = 0.002

# command per rad/s and per rad: rows delta_x, delta_y; columns roll, pitch
RATE_GAIN = ((0.015, 0.0), (0.060, 0.070))
ATTITUDE_GAIN = ((0.246, -0.056), (0.317, 0.437))

HOLD_RATE = 1.2  # 1/s, rate asked for per rad of attitude while the LQR flies
HOLD_LIMIT = 0.6  # rad/s


class AttitudeController:
    """Level attitude with rate damping; a mixer sweep is added to its output, a sweep of angle or rate to its input."""

    def step(
        self, phi: float, theta: float, p: float, q: float, p_command: float, q_command: float
    ) -> tuple[float, float]:
        """Attitude in rad and rates in rad/s -> cyclic commands, unclipped."""
        dp, dq = p - p_command, q - q_command
        (k11, k12), (k21, k22) = RATE_GAIN
        (a11, a12), (a21, a22) = ATTITUDE_GAIN
        return (
            -(k11 * dp + k12 * dq + a11 * phi + a12 * theta),
            -(k21 * dp + k22 * dq + a21 * phi + a22 * theta),
        )


def attitude_hold(phi: float, theta: float) -> tuple[float, float]:
    """Rate references that bring the vehicle level while the LQR flies, rad/s."""

    def limited(x: float) -> float:
        return max(-HOLD_LIMIT, min(HOLD_LIMIT, x))

    return limited(-HOLD_RATE * phi), limited(-HOLD_RATE * theta)


@dataclass(frozen=True, eq=False, kw_only=True)
class LqrGains:
    """One bank: K (3, 4), observer gain L (4, 2), prefilter g (3, 2), and the observer's model A (4, 4), B (4, 3).

    The rates asked for are followed by models of their own, natural frequency w (2,) in rad/s and damping zeta (2,), 0
    where there are none; F (3, 4) takes their rates less those asked for, and their accelerations.
    """

    K: np.ndarray
    L: np.ndarray
    g: np.ndarray
    A: np.ndarray
    B: np.ndarray
    w: np.ndarray
    zeta: np.ndarray
    F: np.ndarray

    @classmethod
    def from_values(cls, values: Sequence[float]) -> LqrGains:
        """29 values in bank order, or 54. Raises ValueError with the reason where they cannot be flown."""
        if len(values) not in (29, 54):
            raise ValueError("a bank has 29 values, or 54")
        if not all(math.isfinite(x) for x in values):
            raise ValueError("a value is not finite")
        more = (*values[29:], *(0.0,) * 25)[:25]
        K = np.array([*values[0:8], *more[0:4]]).reshape(3, 4)
        L = np.array(values[8:16]).reshape(4, 2)
        g = np.array([*values[16:20], *more[4:6]]).reshape(3, 2)
        L_b, M_a, tau_f, A_b, B_a, A_lat, A_lon, B_lat, B_lon = values[20:29]
        L_p, M_q, M_elev = more[6:9]
        w, zeta, F = np.array(more[9:11]), np.array(more[11:13]), np.array(more[13:]).reshape(3, 4)
        if not tau_f > 0:
            raise ValueError("tau_f is not positive")
        if np.any(F) and not (np.all(w > 0) and np.all(zeta > 0)):
            raise ValueError("what F takes has no frequency or damping")
        A = np.array(
            [
                [L_p, 0, 0, L_b],
                [0, M_q, M_a, 0],
                [0, -1, -1 / tau_f, A_b / tau_f],
                [-1, 0, B_a / tau_f, -1 / tau_f],
            ]
        )
        B = np.array([[0, 0, 0], [0, 0, M_elev], [A_lat / tau_f, A_lon / tau_f, 0], [B_lat / tau_f, B_lon / tau_f, 0]])
        if not np.all(np.linalg.eigvals(A - L @ np.eye(2, 4)).real < 0):
            raise ValueError("the observer is unstable")
        if not np.all(np.linalg.eigvals(A - B @ K).real < 0):
            raise ValueError("the controlled model is unstable")
        return cls(K=K, L=L, g=g, A=A, B=B, w=w, zeta=zeta, F=F)


class LqrController:
    """u = -K x_hat + g y_ref (eq. 13) + F z, x_hat from the observer of eq. 11, z of models that follow y_ref.

    Both are held and advanced exactly.
    """

    def __init__(self, gains: LqrGains) -> None:
        C = np.eye(2, 4)
        block = np.zeros((9, 9))
        block[:4, :4] = gains.A - gains.L @ C
        block[:4, 4:7] = gains.B
        block[:4, 7:] = gains.L
        power = expm(block * DT)[:4]
        self._follow: list[list[list[float]]] = [
            expm(np.array([[0, 1, 0], [-w * w, -2 * zeta * w, w * w], [0, 0, 0]]) * DT)[:2].tolist()
            for w, zeta in zip(gains.w, gains.zeta, strict=True)
        ]
        # plain floats: a small NumPy product costs more than these sixteen multiplications
        self._advance: list[list[float]] = power.tolist()
        self._K: list[list[float]] = gains.K.tolist()
        self._g: list[list[float]] = gains.g.tolist()
        self._F: list[list[float]] = gains.F.tolist()
        self.reset()

    def reset(self) -> None:
        self.state = [0.0, 0.0, 0.0, 0.0]
        self._measured = (0.0, 0.0)
        self.followed = [[0.0, 0.0], [0.0, 0.0]]
        """Rate and acceleration of each model."""

    def step(self, p: float, q: float, p_ref: float, q_ref: float) -> tuple[float, float, float]:
        """Measured and wanted rates in rad/s -> cyclic commands and elevator, unclipped."""
        self._measured = (p, q)
        x, ((p_m, p_dot), (q_m, q_dot)) = self.state, self.followed
        out = []
        for K, g, F in zip(self._K, self._g, self._F, strict=True):
            feedback = K[0] * x[0] + K[1] * x[1] + K[2] * x[2] + K[3] * x[3]
            onward = F[0] * (p_m - p_ref) + F[1] * (q_m - q_ref) + F[2] * p_dot + F[3] * q_dot
            out.append(g[0] * p_ref + g[1] * q_ref - feedback + onward)
        for i, asked in enumerate((p_ref, q_ref)):
            known = (*self.followed[i], asked)
            self.followed[i] = [sum(c * v for c, v in zip(row, known, strict=True)) for row in self._follow[i]]
        return out[0], out[1], out[2]

    def applied(self, delta_x: float, delta_y: float, delta_e: float) -> None:
        """The command really sent this sample, excitation and limits included: the observer advances on it."""
        known = (*self.state, delta_x, delta_y, delta_e, *self._measured)
        self.state = [sum(c * v for c, v in zip(row, known, strict=True)) for row in self._advance]
