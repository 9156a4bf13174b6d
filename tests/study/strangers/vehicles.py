"""Vehicles of three sizes and the loops that hold them.

Parameters are drawn evenly in their logarithm around each size's own. A vehicle that is not stable by itself is drawn
again. The loop's law: commands follow minus the inverse of the steady answer (rates per command) times a bandwidth in
attitude and a share in rates; the bandwidth goes with the vehicle's slowest mode. Gains are halved until the loop holds
with a servo of a third of tau_f in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from planted import Array, _Equations, equations, in_numbers


@dataclass(frozen=True, kw_only=True, slots=True)
class Size:
    """A size of vehicle: the middle of what is drawn."""

    L_b: float
    M_a: float
    tau_f: float
    rpm: float
    band_hz: tuple[float, float]
    """What its chirps sweep."""


SIZES: Mapping[str, Size] = MappingProxyType(
    {
        "small": Size(L_b=1100.0, M_a=450.0, tau_f=0.05, rpm=2400.0, band_hz=(0.5, 12.0)),
        "delftacopter": Size(L_b=147.5, M_a=713.4, tau_f=0.091, rpm=1650.0, band_hz=(0.5, 10.0)),
        "90 kg": Size(L_b=60.0, M_a=30.0, tau_f=0.13, rpm=850.0, band_hz=(0.25, 6.0)),
    }
)
"""A small electric helicopter, the paper's vehicle, and one of 90 kg. With what is drawn around them L_b spans 33 to
2000 1/s^2, M_a 17 to 1300, tau_f 0.036 to 0.18 s."""
SPREAD = 1.8
"""Largest factor on L_b and M_a;"""
SPREAD_TAU = 1.4
"""and on tau_f and the cyclic's own axes."""
COUPLING = (0.1, 1.4)
"""A_b and B_a, which have opposite signs."""
LEAST_DAMPING = 0.12
LEAST_DECAY = 0.5
"""1/s, of the vehicle alone;"""
LOOP_DECAY = 0.15
"""and of the loop with a late servo, of its slowest mode."""
LOOPS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"weak": (0.4, 0.8), "usual": (0.8, 1.3), "strong": (2.0, 3.0)}
)
"""Times the usual gains."""
BANDWIDTH = 0.11
"""Of the attitude loop, of the slowest mode's frequency;"""
RATE_SHARE = 0.1
"""and the share of a rate that is taken back."""
TURN = 0.05
"""rad, what a chirp's amplitude turns the vehicle by in tau_f, in the long run."""
LARGEST_CHIRP = 0.3
GUST = (0.0011, 0.00098)
"""Standard deviation of gusts, rad/s^2, as shares of L_b and M_a: the paper's vehicle's."""


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """What flies, in numbers."""

    size: str
    loop: str
    table: Mapping[str, float]
    """Under the names of `planted.TABLE_4`, and `omega`, rad/s; a quadrotor's under `QUADROTOR`'s."""
    rate_gain: Array
    """(2, 2): command per rad/s;"""
    attitude_gain: Array
    """and per rad."""
    amplitudes: tuple[float, float]
    """Of roll and pitch chirps, of full command."""

    @property
    def band_hz(self) -> tuple[float, float]:
        """What its chirps sweep."""
        return SIZES[self.size].band_hz if self.flaps else QUADROTOR_BAND_HZ

    @property
    def gust(self) -> Array:
        """Standard deviation of usual gusts, rad/s^2, of roll and pitch."""
        if not self.flaps:
            return np.full(2, QUADROTOR_GUST)
        return np.array([GUST[0] * self.table["L_b"], GUST[1] * self.table["M_a"]])

    @property
    def flaps(self) -> bool:
        """Whether it has a rotor that a swashplate tilts."""
        return "tau_f" in self.table

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its base's numbers."""
        return tuple(name for name in self.table if name != "omega")

    @property
    def slowest(self) -> float:
        """rad/s, of the slowest mode."""
        return float(np.min(np.abs(np.linalg.eigvals(_alone(self.table)))))


def drawn(rng: np.random.Generator) -> Vehicle:
    """A vehicle and its loop."""
    size, loop = str(rng.choice(list(SIZES))), str(rng.choice(list(LOOPS)))
    table = _table(rng, SIZES[size])
    while not _calm(table):
        table = _table(rng, SIZES[size])
    steady = steady_rates(table)
    strength = float(rng.uniform(*LOOPS[loop]))
    slowest = float(np.min(np.abs(np.linalg.eigvals(_alone(table)))))
    inverse: Array = np.asarray(np.linalg.inv(steady), dtype=np.float64)
    rate, attitude = strength * RATE_SHARE * inverse, strength * BANDWIDTH * slowest * inverse
    while not _holds(table, rate, attitude, LOOP_DECAY * slowest):
        rate, attitude = rate / 2, attitude / 2
    amplitudes = tuple(min(LARGEST_CHIRP, TURN / (table["tau_f"] * abs(float(steady[i, i])))) for i in range(2))
    return Vehicle(
        size=size,
        loop=loop,
        table=MappingProxyType(table),
        rate_gain=rate,
        attitude_gain=attitude,
        amplitudes=(amplitudes[0], amplitudes[1]),
    )


QUADROTOR: Mapping[str, float] = MappingProxyType(
    {"L_p": -1.0, "M_q": -1.2, "L_q": 0.0, "M_p": 0.0, "L_lat": 250.0, "L_lon": 0.0, "M_lat": 0.0, "M_lon": 200.0}
)
"""A quadrotor of some kilograms: rates that its motors' commands accelerate; with them `omega`, rad/s."""
QUADROTOR_BAND_HZ = (0.5, 10.0)
QUADROTOR_HOLD = 8.0
"""1/s, what its loop takes back of a rate;"""
QUADROTOR_LEVEL = 2.0
"""and 1/s, how fast it levels."""
QUADROTOR_RATE = 0.5
"""rad/s, that its chirps reach;"""
QUADROTOR_GUST = 0.3
"""rad/s^2."""


def quadrotor(rng: np.random.Generator) -> Vehicle:
    """A quadrotor and its loop: no axis answers the other's command."""
    table = {name: value * SPREAD ** float(rng.uniform(-1, 1)) for name, value in QUADROTOR.items()}
    table["omega"] = 600.0 * SPREAD_TAU ** float(rng.uniform(-1, 1))
    loop = str(rng.choice(list(LOOPS)))
    hold = QUADROTOR_HOLD * float(rng.uniform(*LOOPS[loop]))
    power = np.array([table["L_lat"], table["M_lon"]])
    amplitudes = QUADROTOR_RATE * (hold - np.array([table["L_p"], table["M_q"]])) / power
    return Vehicle(
        size="quadrotor",
        loop=loop,
        table=MappingProxyType(table),
        rate_gain=np.diag(hold / power),
        attitude_gain=np.diag(QUADROTOR_LEVEL * hold / power),
        amplitudes=(float(amplitudes[0]), float(amplitudes[1])),
    )


def base_of(table: Mapping[str, float]) -> _Equations:
    """The vehicle's equations with nothing hidden."""
    if "tau_f" in table:
        return equations(None, {}, False, table)
    E = _Equations({})
    E.add("p", p=table["L_p"], q=table["L_q"], x=table["L_lat"], y=table["L_lon"], gust_p=1.0)
    E.add("q", p=table["M_p"], q=table["M_q"], x=table["M_lat"], y=table["M_lon"], gust_q=1.0)
    E.add("phi", p=1.0)
    E.add("theta", q=1.0)
    return E


def steady_rates(table: Mapping[str, float]) -> Array:
    """(p, q) per (x, y) in the long run: the disc stands level and follows the body."""
    lateral, longitudinal = [table["B_lat"], table["B_lon"]], [table["A_lat"], table["A_lon"]]
    return np.array([lateral, longitudinal]) / table["tau_f"]


def _table(rng: np.random.Generator, size: Size) -> dict[str, float]:
    def near(value: float, factor: float) -> float:
        return value * math.exp(rng.uniform(-math.log(factor), math.log(factor)))

    coupling = math.exp(rng.uniform(*np.log(COUPLING)))
    own = {"B_lat": near(0.52, SPREAD_TAU), "A_lon": near(0.3, SPREAD_TAU)}
    return {
        "L_b": near(size.L_b, SPREAD),
        "M_a": near(size.M_a, SPREAD),
        "tau_f": near(size.tau_f, SPREAD_TAU),
        "A_b": -near(coupling, 1.15),
        "B_a": near(coupling, 1.15),
        **own,
        "A_lat": own["B_lat"] * float(rng.uniform(-0.55, 0.2)),
        "B_lon": own["A_lon"] * float(rng.uniform(-0.3, 0.3)),
        "omega": near(size.rpm, 1.2) * 2 * math.pi / 60,
    }


def _alone(table: Mapping[str, float]) -> Array:
    """The vehicle without its loop and without its attitude: p, q, and a, b where there are."""
    A, _, _ = in_numbers(base_of(table))
    return A[:-2, :-2]


def _calm(table: Mapping[str, float]) -> bool:
    poles = np.linalg.eigvals(_alone(table))
    return bool(np.max(poles.real) < -LEAST_DECAY and np.min(-poles.real / np.abs(poles)) > LEAST_DAMPING)


def _holds(table: Mapping[str, float], rate: Array, attitude: Array, decay: float) -> bool:
    """Whether every mode of the loop dies out that fast, or the attitude's as fast as its bandwidth lets it."""
    E = equations("servo_lag", {"tau_s": table["tau_f"] / 3}, False, table)
    A, B, C = in_numbers(E)
    states = list(E.rows)
    feedback = rate @ C
    feedback[:, [states.index("phi"), states.index("theta")]] += attitude
    poles = np.linalg.eigvals(A - B[:, :2] @ feedback)
    least = min(decay, 0.3 * BANDWIDTH / LOOP_DECAY * decay, 0.5 * _slowest_attitude(attitude, table))
    return bool(np.max(poles.real) < -least)


def _slowest_attitude(attitude: Array, table: Mapping[str, float]) -> float:
    """1/s, what the attitude gains alone would bring it back with."""
    return float(np.min(np.linalg.eigvals(steady_rates(table) @ attitude).real))
