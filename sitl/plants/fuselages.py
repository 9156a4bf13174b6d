"""Loads on the fuselage beside the hub's moments, and its inertia. Moments are over inertia, rad/s^2.

States are s = [p, q, phi, theta, a, b, ...]; `moments(s, i)` returns those about x and y, then the rates of the load's
own states, which begin at s[i]. What does not change within a sample is worked out in `hold`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

G = 9.80665


class Now(NamedTuple):
    """What a sample holds still."""

    e: float
    """Acting elevator."""
    c: float
    """Collective over that of hover, of full command."""
    r_command: float
    """Of the tip propellers."""
    r: float
    airspeed: float


class Load(Protocol):
    own_states: int

    def hold(self, now: Now) -> None: ...

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]: ...


class _Steady:
    """Nothing to hold, nothing to remember."""

    own_states = 0

    def hold(self, now: Now) -> None:
        pass


class RateDamping(_Steady):
    def __init__(self, L_p: float, M_q: float) -> None:
        self._L_p, self._M_q = L_p, M_q

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        return self._L_p * s[0], self._M_q * s[1]


class QuadraticDrag(_Steady):
    """Surfaces that are dragged broadside: p |p| and q |q|."""

    def __init__(self, L_pp: float, M_qq: float) -> None:
        self._L_pp, self._M_qq = L_pp, M_qq

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        p, q = s[0], s[1]
        return self._L_pp * p * abs(p), self._M_qq * q * abs(q)


class Tether(_Steady):
    """A moment back to level, for a line under tension from below the centre of gravity: with the sine of the lean."""

    def __init__(self, L_phi: float, M_theta: float) -> None:
        self._L_phi, self._M_theta = L_phi, M_theta

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        return self._L_phi * math.sin(s[2]), self._M_theta * math.sin(s[3])


class HubMomentum(_Steady):
    """Motor and hub as a flywheel along the shaft that the body turns: h is angular momentum over inertia, rad/s."""

    def __init__(self, h_p: float, h_q: float) -> None:
        self._h_p, self._h_q = h_p, h_q

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        return -self._h_p * s[1], self._h_q * s[0]


class YawCoupling:
    """p_dot += k_p q r, q_dot += k_q p r."""

    own_states = 0

    def __init__(self, k_p: float, k_q: float) -> None:
        self._k_p, self._k_q = k_p, k_q
        self._r = 0.0

    def hold(self, now: Now) -> None:
        self._r = now.r

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        return self._k_p * s[1] * self._r, self._k_q * s[0] * self._r


class Drift(_Steady):
    """The vehicle slides off where its thrust leans, and the air it meets turns it. Own states v, u in m/s."""

    own_states = 2

    def __init__(self, Y_v: float, L_v: float, X_u: float, M_u: float) -> None:
        self._Y_v, self._L_v, self._X_u, self._M_u = Y_v, L_v, X_u, M_u

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        v, u = s[i], s[i + 1]
        return (
            self._L_v * v,
            self._M_u * u,
            G * (s[2] + s[5]) + self._Y_v * v,
            -G * (s[3] + s[4]) + self._X_u * u,
        )


class FlexibleWing(_Steady):
    """On each axis a second body on a spring and a damper: what of the wing does not follow the fuselage at once.

    kappa is its inertia over the fuselage's, frequency and zeta those with the fuselage clamped. Own states: twist
    against the fuselage (rad) and rate in space (rad/s), roll then pitch. Moments come over the inertia of both, as
    the table's do; so this is a load and an inertia at once.
    """

    own_states = 4

    def __init__(self, roll: tuple[float, float, float], pitch: tuple[float, float, float]) -> None:
        """(frequency in Hz, zeta, kappa) of each axis."""
        self._axes = tuple((2 * math.pi * f, zeta, kappa) for f, zeta, kappa in (roll, pitch))
        self._parts = (1 + roll[2], 1 + pitch[2])

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        (w_p, zeta_p, kappa_p), (w_q, zeta_q, kappa_q) = self._axes
        twist_p = s[i + 1] - s[0]
        twist_q = s[i + 3] - s[1]
        pull_p = w_p * (w_p * s[i] + 2 * zeta_p * twist_p)
        pull_q = w_q * (w_q * s[i + 2] + 2 * zeta_q * twist_q)
        part_p, part_q = self._parts
        return kappa_p * pull_p / part_p, kappa_q * pull_q / part_q, twist_p, -pull_p, twist_q, -pull_q

    def accelerations(self, N_p: float, N_q: float, p: float, q: float, r: float) -> tuple[float, float]:
        """The fuselage without its wing is lighter by 1 + kappa."""
        return N_p * self._parts[0], N_q * self._parts[1]


class ThrustLines:
    """Thrust that misses the centre of gravity: moments of collective and of the tip propellers.

    (roll, pitch) moment per full command of each; `lag_s` None lets the thrust follow at once. Own states: the thrusts.
    """

    own_states = 2

    def __init__(self, collective: tuple[float, float], propellers: tuple[float, float], lag_s: float | None) -> None:
        self._c, self._r = collective, propellers
        self._lag_s = lag_s
        self._now = (0.0, 0.0)

    def hold(self, now: Now) -> None:
        self._now = (now.c, now.r_command)

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        (c, r), lag = self._now, self._lag_s
        c_dot = r_dot = 0.0
        if lag is not None:
            c_dot, r_dot = (c - s[i]) / lag, (r - s[i + 1]) / lag
            c, r = s[i], s[i + 1]
        return self._c[0] * c + self._r[0] * r, self._c[1] * c + self._r[1] * r, c_dot, r_dot


class ForwardFuselage:
    """Eq. 15-16: rate damping and the elevator; `power` m lets them follow dynamic pressure, L_p and M_q as V^m and
    M_elev as V^2m; towards `stall` the elevator loses with the cube of its deflection, and gains nothing beyond."""

    own_states = 0

    def __init__(
        self, L_p: float, M_q: float, M_elev: float, nominal_speed: float, power: float = 0.0, stall: float = math.inf
    ) -> None:
        self._L_p, self._M_q, self._M_elev = L_p, M_q, M_elev
        self._nominal, self._power = nominal_speed, power
        self._stall, self._lost = stall, 1 / (3 * stall**2)
        self._damping, self._push = 1.0, 0.0

    def hold(self, now: Now) -> None:
        ratio = (now.airspeed / self._nominal) ** self._power
        e = max(-self._stall, min(self._stall, now.e))
        self._damping = ratio
        self._push = self._M_elev * ratio * ratio * e * (1 - self._lost * e * e)

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        return self._L_p * self._damping * s[0], self._M_q * self._damping * s[1] + self._push


class AngleOfAttack:
    """alpha' = q - Z_a alpha + Z_e e, q_dot += M_alpha alpha. Own state alpha; Z_e is the tail's own lift."""

    own_states = 1

    def __init__(self, Z_a: float, M_alpha: float, Z_e: float = 0.0) -> None:
        self._Z_a, self._M_alpha, self._Z_e = Z_a, M_alpha, Z_e
        self._e = 0.0

    def hold(self, now: Now) -> None:
        self._e = now.e

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        alpha = s[i]
        return 0.0, self._M_alpha * alpha, s[1] - self._Z_a * alpha + self._Z_e * self._e


class Sideslip(_Steady):
    """beta' = p - Y_b beta, p_dot += L_beta beta: p is forward flight's yaw. Own state beta."""

    own_states = 1

    def __init__(self, Y_b: float, L_beta: float) -> None:
        self._Y_b, self._L_beta = Y_b, L_beta

    def moments(self, s: Sequence[float], i: int) -> tuple[float, ...]:
        beta = s[i]
        return self._L_beta * beta, 0.0, s[0] - self._Y_b * beta


class Inertia(Protocol):
    def accelerations(self, N_p: float, N_q: float, p: float, q: float, r: float) -> tuple[float, float]:
        """Moments over the table's inertia, and rates -> p_dot, q_dot."""


class CoupledInertia:
    """A product of inertia alone, kg m^2: moments through the inverse of [[I_x, -I_xy], [-I_xy, I_y]], without yaw."""

    def __init__(self, I_x: float, I_y: float, I_xy: float) -> None:
        self._I = (I_x, I_y, I_xy)
        self._determinant = I_x * I_y - I_xy**2

    def accelerations(self, N_p: float, N_q: float, p: float, q: float, r: float) -> tuple[float, float]:
        I_x, I_y, I_xy = self._I
        L, M = I_x * N_p, I_y * N_q
        return (I_y * L + I_xy * M) / self._determinant, (I_x * M + I_xy * L) / self._determinant


class TurnedInertia:
    """A rigid body whose principal axes are turned about the shaft, in Euler's equations with the yaw rate given.

    I_x, I_y, I_z are the principal moments of inertia in kg m^2, `turned` the angle in rad. Moments come over the
    untwisted I_x and I_y.
    """

    def __init__(self, I_x: float, I_y: float, I_z: float, turned: float) -> None:
        c, s = math.cos(turned), math.sin(turned)
        self._I_x, self._I_y, self._I_z = I_x, I_y, I_z
        self.xx = I_x * c * c + I_y * s * s
        self.yy = I_x * s * s + I_y * c * c
        self.xy = (I_y - I_x) * s * c
        """The product of inertia, integral of x y dm; minus that stands in the tensor."""
        self._determinant = self.xx * self.yy - self.xy**2

    def accelerations(self, N_p: float, N_q: float, p: float, q: float, r: float) -> tuple[float, float]:
        L = self._I_x * N_p - r * (self._I_z * q - self.yy * q + self.xy * p)
        M = self._I_y * N_q - r * (self.xx * p - self.xy * q - self._I_z * p)
        return (self.yy * L + self.xy * M) / self._determinant, (self.xx * M + self.xy * L) / self._determinant
