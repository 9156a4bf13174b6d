"""Rotors: from the acting cyclic and the body's rates to the disc's tilt and its moment on the fuselage.

The base is the paper's eq. 5-7. Each other class changes one thing of it, and says which. States are
s = [p, q, phi, theta, a, b, own...]; `rates` returns hub moments over inertia (rad/s^2), then a_dot, b_dot and the
rates of the own states. What does not change within a sample is worked out in `hold`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from sitl.plants.table4 import TipPathPlane

SpeedLaw = Callable[[float], tuple[float, float, float]]
"""Rotor speed over nominal -> factors of 1/tau_f, of A_b and B_a, and of the hub moments."""


class Rotor(Protocol):
    own_states: int
    """Beside a and b."""

    def hold(self, x: float, y: float, omega: float, r: float) -> None:
        """Acting roll and pitch cyclic, rotor speed and yaw rate of this sample."""

    def rates(self, s: Sequence[float]) -> tuple[float, ...]: ...


class Disc:
    """Eq. 5-7. The numbers of the table hold at `nominal_rpm`; `law` says how they follow the speed, if at all."""

    own_states = 0

    def __init__(
        self, table: TipPathPlane, nominal_rpm: float, *, law: SpeedLaw | None = None, still: bool = False
    ) -> None:
        """`still` in space: a yawing body sees the tilt turn the other way, a_dot -= r b, b_dot += r a."""
        self.table = table
        self._law = law
        self._still = still
        self._nominal = nominal_rpm * 2 * math.pi / 60
        self.L_b, self.M_a, self.A_b, self.B_a = table.L_b, table.M_a, table.A_b, table.B_a
        self.rate = 1 / table.tau_f
        self.theta_s = self.theta_c = self.turn = 0.0
        self.omega = self._nominal

    def hold(self, x: float, y: float, omega: float, r: float) -> None:
        T = self.table
        self.theta_s = T.A_lat * x + T.A_lon * y
        self.theta_c = T.B_lat * x + T.B_lon * y
        self.turn = -r if self._still else 0.0
        self.omega = omega
        if self._law is not None:
            faster, coupling, moment = self._law(omega / self._nominal)
            self.rate = faster / T.tau_f
            self.A_b, self.B_a = coupling * T.A_b, coupling * T.B_a
            self.L_b, self.M_a = moment * T.L_b, moment * T.M_a

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        a, b = s[4], s[5]
        rate, turn = self.rate, self.turn
        return (
            self.L_b * b,
            self.M_a * a,
            (self.theta_s - a + self.A_b * b) * rate - s[1] + turn * b,
            (self.theta_c - b + self.B_a * a) * rate - s[0] - turn * a,
        )


def powers(k: float, n: float) -> SpeedLaw:
    """tau_f as Omega^-k, A_b and B_a as Omega^-2k, hub moments as Omega^n."""
    return lambda ratio: (ratio**k, ratio ** (-2 * k), ratio**n)


def spring_and_offset(offset: float) -> SpeedLaw:
    """A root spring and a hinge offset, the latter with this share of the stiffness at nominal speed.

    tau_f = 16/(Lock number Omega). The spring's share of (flap frequency ratio)^2 - 1 falls as Omega^-2, the offset's
    stays; the spring's moment stays, the offset's is the blades' centrifugal force and grows as Omega^2.
    """

    def law(ratio: float) -> tuple[float, float, float]:
        squared = ratio * ratio
        return ratio, (1 - offset) / squared + offset, (1 - offset) + offset * squared

    return law


class InflowDisc(Disc):
    """tau_l l' = -l + k_l (theta - tilt); the inflow l takes its share of the cyclic. The catalogue's form."""

    own_states = 2

    def __init__(self, table: TipPathPlane, nominal_rpm: float, k_l: float, tau_l: float) -> None:
        super().__init__(table, nominal_rpm)
        self._k_l, self._per_s = k_l, 1 / tau_l

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        _, _, _, _, a, b, l_s, l_c = s[:8]
        L, M, a_dot, b_dot = super().rates(s)
        return (
            L,
            M,
            a_dot - l_s * self.rate,
            b_dot - l_c * self.rate,
            (self._k_l * (self.theta_s - a) - l_s) * self._per_s,
            (self._k_l * (self.theta_c - b) - l_c) * self._per_s,
        )


class PittPetersDisc(Disc):
    """First-harmonic inflow of Pitt and Peters, driven by the aerodynamic moment itself.

    That moment is what is left of the cyclic behind the disc's tilt, its turning in space and the inflow:
    theta_s - a - (b' + p)/Omega - l_s, and theta_c - b + (a' + q)/Omega - l_c. In hover, with mean inflow ratio lam,
    lift slope times solidity a_sigma: quasi-steady gain K = a_sigma/(16 lam), apparent-mass time
    2 * 16/(45 pi) / (lam Omega). Against the catalogue's form k_l = K/(1 + K), tau_l = time/(1 + K), and the turning
    is new.
    """

    own_states = 2

    def __init__(self, table: TipPathPlane, nominal_rpm: float, lam: float, a_sigma: float) -> None:
        super().__init__(table, nominal_rpm)
        self.K = a_sigma / (16 * lam)
        self.time_s = 32 / (45 * math.pi) / (lam * self._nominal)

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        p, q, _, _, a, b, l_s, l_c = s[:8]
        L, M, a_dot, b_dot = super().rates(s)
        a_dot -= l_s * self.rate
        b_dot -= l_c * self.rate
        left_s = self.theta_s - a - (b_dot + p) / self.omega - l_s
        left_c = self.theta_c - b + (a_dot + q) / self.omega - l_c
        return (L, M, a_dot, b_dot, (self.K * left_s - l_s) / self.time_s, (self.K * left_c - l_c) / self.time_s)


class SecondOrderDisc(Disc):
    """Centrally hinged blades with a root spring in multi-blade coordinates, the disc's inertia kept (Bramwell).

    With g = Lock number/8, k = flap frequency ratio^2 - 1 and the disc's rates in space A = a' + q, B = b' + p, in
    rotor time: A' + g A - 2 B + k a - g b = -g theta_c and B' + g B + 2 A + k b + g a = g theta_s. A and B are the own
    states. The table's tau_f, A_b and B_a are not used.
    """

    own_states = 2

    def __init__(
        self, table: TipPathPlane, nominal_rpm: float, lock_number: float, flap_frequency_ratio: float
    ) -> None:
        super().__init__(table, nominal_rpm)
        self._g, self._k = lock_number / 8, flap_frequency_ratio**2 - 1

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        p, q, _, _, a, b, A, B = s[:8]
        w, g, k = self._nominal, self._g, self._k
        ww = w * w
        return (
            self.L_b * b,
            self.M_a * a,
            A - q,
            B - p,
            w * (2 * B - g * A) - ww * (k * a - g * (b - self.theta_c)),
            -w * (2 * A + g * B) - ww * (k * b + g * (a - self.theta_s)),
        )


class StiffeningHub(Disc):
    """The hub spring runs into its stops: L_b b (1 + (b/knee)^2), the same for a; twice as stiff at the knee, rad."""

    def __init__(self, table: TipPathPlane, nominal_rpm: float, knee: float) -> None:
        super().__init__(table, nominal_rpm)
        self._k3 = 1 / knee**2

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        L, M, a_dot, b_dot = super().rates(s)
        return L * (1 + self._k3 * s[5] ** 2), M * (1 + self._k3 * s[4] ** 2), a_dot, b_dot


class RubberHub(Disc):
    """An elastomeric hub that remembers: a spring and dashpot in series beside the hub spring.

    z' = tilt' - z/time, moment = L_b (tilt + more z): a slow tilt meets the table's stiffness, a quick one `more` more.
    """

    own_states = 2

    def __init__(self, table: TipPathPlane, nominal_rpm: float, more: float, time_s: float) -> None:
        super().__init__(table, nominal_rpm)
        self._more, self._per_s = more, 1 / time_s

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        z_a, z_b = s[6], s[7]
        L, M, a_dot, b_dot = super().rates(s)
        return (
            L + self.L_b * self._more * z_b,
            M + self.M_a * self._more * z_a,
            a_dot,
            b_dot,
            a_dot - z_a * self._per_s,
            b_dot - z_b * self._per_s,
        )


class StickingHinge(Disc):
    """Dry friction in the flapping hinges.

    A tilted disc makes every blade flap once a turn, so the hinge always moves, at Omega times the tilt. What friction
    leaves in the body's axes is its first harmonic: like the blades' own damping it pulls the disc back to the shaft,
    but with a strength `friction` (rad of cyclic) that does not depend on how far it is tilted.
    """

    _ROUNDED = 0.0007  # rad: below this tilt the hinge rolls rather than slides

    def __init__(self, table: TipPathPlane, nominal_rpm: float, friction: float) -> None:
        super().__init__(table, nominal_rpm)
        self._friction = friction

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        a, b = s[4], s[5]
        L, M, a_dot, b_dot = super().rates(s)
        pull = self._friction * self.rate / math.sqrt(a * a + b * b + self._ROUNDED**2)
        return L, M, a_dot - pull * a, b_dot - pull * b


class ObliqueDisc(Disc):
    """In oblique flow the advancing blades lift more: alpha tilts the disc, by A_alpha and B_alpha rad per rad.

    alpha' = q - Z_a alpha is the own state; the wing lifts, and nothing of it pitches the fuselage.
    """

    own_states = 1

    def __init__(self, table: TipPathPlane, nominal_rpm: float, Z_a: float, A_alpha: float, B_alpha: float) -> None:
        super().__init__(table, nominal_rpm)
        self._Z_a, self._A_alpha, self._B_alpha = Z_a, A_alpha, B_alpha

    def rates(self, s: Sequence[float]) -> tuple[float, ...]:
        alpha = s[6]
        L, M, a_dot, b_dot = super().rates(s)
        return (
            L,
            M,
            a_dot + self._A_alpha * self.rate * alpha,
            b_dot + self._B_alpha * self.rate * alpha,
            s[1] - self._Z_a * alpha,
        )
