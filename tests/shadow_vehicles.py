"""Late vehicles that are swept, and whether gains hold them: told by their own eigenvalues, and by nothing of the code
that judges gains.

A vehicle is Table 4's with other numbers, its commands late by a delay, by servos, or by both, 0 to 50 ms in all; the
controller on board is written out here again, loop by loop as it runs. Vehicle, hold, delay and controller together are
one matrix over a loop of 2 ms: what it grows by is known to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from loops_in_time import Late, gains_of, tip_path_plane
from planted import DT, SIZES, TABLE_4, chirp
from scipy.linalg import expm
from scipy.signal import lfilter

FloatArray = np.ndarray
SPAN = (0.6, 1.7)
"""Times Table 4's."""
KNOWN = 0.1
"""By which each number of the vehicle that gains were designed on may be off."""
LATEST_S = 0.050
LATE_BY = ("nothing", "delay", "servo", "second-order servo", "delay and servo")
COSTS = (0.3, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
SPOILT = ("larger", "larger, each its own way", "one sign", "swapped")
REST_S = 1.0
GAIN, PHASE_DEG, DELAY_S = 2.0, 45.0, 0.010
"""What good gains have: stable up to twice the gain, 45 degrees to either side and 10 ms later, each at every step on
the way."""


@dataclass(frozen=True)
class Vehicle:
    """Continuous from the commands that arrive to p and q, which are its first two outputs."""

    numbers: dict[str, float]
    late_by: str
    A: FloatArray
    B: FloatArray
    loops_late: int
    """Of 2 ms, before a command arrives."""


@dataclass(frozen=True)
class Bank:
    """Gains with the observer's own model."""

    K: FloatArray
    L: FloatArray
    model: dict[str, float]
    made: str = "designed"
    """How: designed, or spoilt after that."""

    @property
    def prefilter(self) -> FloatArray:
        """With which steady rates follow; of spoilt gains, those that were designed had it."""
        A, B = tip_path_plane(self.model)
        return np.linalg.pinv(np.eye(2, 4) @ np.linalg.solve(-A + B @ self.K, B))


def vehicle(rng: np.random.Generator, late_by: str | None = None) -> Vehicle:
    """A stable one."""
    while True:
        numbers = {name: float(value * rng.uniform(*SPAN)) for name, value in TABLE_4.items()}
        if np.max(np.linalg.eigvals(tip_path_plane(numbers)[0]).real) < -1.0:
            break
    late_by = late_by or LATE_BY[int(rng.integers(len(LATE_BY)))]
    late = float(rng.uniform(0.0, LATEST_S))
    of_servo = {"servo": late, "second-order servo": late, "delay and servo": late * rng.uniform(0.2, 0.8)}
    own, drive = tip_path_plane(numbers)
    servo = max(of_servo.get(late_by, 0.0), 1e-3)
    A, B = own, drive
    two, none = np.eye(2), np.zeros((2, 2))
    if late_by in ("servo", "delay and servo"):
        A = np.block([[own, drive], [np.zeros((2, 4)), -two / servo]])
        B = np.vstack([np.zeros((4, 2)), two / servo])
    elif late_by == "second-order servo":  # late by 2 zeta/w at low frequency
        zeta = float(rng.uniform(0.4, 1.0))
        w = 2 * zeta / max(servo, 3e-3)
        A = np.block(
            [
                [own, drive, np.zeros((4, 2))],
                [np.zeros((2, 4)), none, two],
                [np.zeros((2, 4)), -(w**2) * two, -2 * zeta * w * two],
            ]
        )
        B = np.vstack([np.zeros((6, 2)), w**2 * two])
    delay = {"delay": late, "delay and servo": late - of_servo["delay and servo"]}.get(late_by, 0.0)
    return Vehicle(numbers, late_by, A, B, round(delay / DT))


def bank(numbers: dict[str, float], rng: np.random.Generator) -> Bank:
    """Designed on the vehicle as well as it is known; every other one then spoilt."""
    model = {name: value * float(rng.uniform(1 - KNOWN, 1 + KNOWN)) for name, value in numbers.items()}
    K, L = gains_of(Late(model, input_cost=float(rng.choice(COSTS))))
    made = SPOILT[int(rng.integers(len(SPOILT)))] if rng.random() < 0.5 else "designed"
    if made == "larger":
        K = K * float(rng.uniform(2, 8))
    elif made == "larger, each its own way":
        K = K * rng.uniform(1, 8, (2, 1))
    elif made == "one sign":
        K = K * (np.array([[-1.0], [1.0]]) if rng.random() < 0.5 else np.array([[1.0], [-1.0]]))
    elif made == "swapped":
        K = K[::-1]
    return Bank(K, L, model, made)


# ------------------------------------------------------------------------------------------------ over one loop


def held(A: FloatArray, B: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Over 2 ms of constant inputs."""
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A * DT, B * DT
    power = expm(block)[:n]
    return power[:, :n], power[:, n:]


def growth(one: Vehicle, gains: Bank, *, times: complex = 1.0, later: int = 0) -> float:
    """1/s, of vehicle and controller together, its commands multiplied and some loops later than they are."""
    A, B = held(one.A, one.B)
    own, drive = tip_path_plane(gains.model)
    a, b = held(own - gains.L @ np.eye(2, 4), np.hstack([drive, gains.L]))
    n, loops = len(A), one.loops_late + later
    size = n + 2 * loops + 4
    whole = np.zeros((size, size), dtype=complex)
    x, seen = slice(0, n), slice(size - 4, size)
    whole[x, x] = A
    whole[seen, seen] = a - b[:, :2] @ gains.K
    whole[seen, 0:2] = b[:, 2:]
    sent = -times * gains.K
    if loops == 0:
        whole[x, seen] = B @ sent
    else:
        first, last = slice(n, n + 2), slice(n + 2 * loops - 2, n + 2 * loops)
        whole[x, last] = B
        whole[first, seen] = sent
        for k in range(1, loops):
            whole[n + 2 * k : n + 2 * k + 2, n + 2 * k - 2 : n + 2 * k] = np.eye(2)
    return float(np.log(np.max(np.abs(np.linalg.eigvals(whole)))) / DT)


def good(one: Vehicle, gains: Bank) -> bool:
    """Whether the gains have the margins that are asked for."""
    thirds = (1 / 3, 2 / 3, 1.0)
    turned = [complex(np.exp(1j * np.radians(sign * PHASE_DEG * part))) for part in thirds for sign in (-1, 1)]
    return all(
        growth(one, gains, times=times) < 0 for times in [GAIN**part for part in (0.0, *thirds)] + turned
    ) and all(growth(one, gains, later=k) < 0 for k in range(1, 1 + round(DELAY_S / DT)))


# ------------------------------------------------------------------------------------------------ swept


def swept(one: Vehicle, rng: np.random.Generator, *, seconds: float = 30.0, stop_hz: float = 10.0) -> list[dict]:
    """A roll and a pitch sweep under weak feedback of the rates, in gusts, by a gyro with noise: channels by name."""
    A, B = held(one.A, one.B)
    gust = held(one.A, np.eye(len(one.A), 2))[1]
    feedback = np.array([[0.015, 0.0], [0.0, 0.03]])
    while _fed_back(A, B, feedback, one.loops_late) >= 1:
        feedback = 0.5 * feedback
    gusty, noise = float(rng.uniform(0.2, 1.0)), 0.005
    rest = np.zeros(round(REST_S / DT))
    waves = [np.concatenate([rest, sweep(SIZES[name], seconds, stop_hz), rest]) for name in ("roll", "pitch")]
    n = len(waves[0])
    excitation = np.zeros((n, 2, 2))  # (n, axis, run): both runs side by side
    for run, wave in enumerate(waves):
        excitation[:, run, run] = wave
    wind = gusty * np.stack([_coloured(rng, n) * (0.16, 0.7) for _ in waves], axis=2)
    y = noise * rng.standard_normal((n, 2, 2))
    x, u = np.zeros((len(A), 2)), np.zeros((n + one.loops_late, 2, 2))
    for k in range(n):
        y[k] += x[:2]
        u[k + one.loops_late] = excitation[k] - feedback @ y[k]
        x = A @ x + B @ u[k] + gust @ wind[k]
    sent = u[one.loops_late :]
    return [
        {
            "t": DT * np.arange(n), "p": y[:, 0, run], "q": y[:, 1, run], "delta_x": sent[:, 0, run],
            "delta_y": sent[:, 1, run], "excitation_x": excitation[:, 0, run], "excitation_y": excitation[:, 1, run],
        }
        for run in range(2)
    ]  # fmt: skip


def sweep(size: float, seconds: float, stop_hz: float) -> FloatArray:
    """Table 1's to 10 Hz; further it is exponential."""
    if stop_hz == 10.0:
        return chirp(size, seconds)
    t = np.arange(0, seconds, DT)
    rate = np.log(stop_hz / 0.5) / seconds
    return size * np.sin(2 * np.pi * 0.5 * np.expm1(rate * t) / rate) * np.clip(np.minimum(t, seconds - t), 0, 1)


def _fed_back(A: FloatArray, B: FloatArray, feedback: FloatArray, loops: int) -> float:
    """Largest absolute eigenvalue."""
    n = len(A)
    whole = np.zeros((n + 2 * loops, n + 2 * loops))
    whole[:n, :n] = A
    back = -feedback @ np.eye(2, n)
    if loops == 0:
        whole[:n, :n] += B @ back
    else:
        whole[:n, -2:] = B
        whole[n : n + 2, :n] = back
        whole[n + 2 :, n : n - 2 + 2 * loops] = np.eye(2 * loops - 2)
    return float(np.max(np.abs(np.linalg.eigvals(whole))))


def _coloured(rng: np.random.Generator, n: int, corner_hz: float = 1.5) -> FloatArray:
    """First-order filtered noise of unit deviation, (n, 2)."""
    pole = np.exp(-2 * np.pi * corner_hz * DT)
    return lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], rng.standard_normal((n, 2)), axis=0)


# ------------------------------------------------------------------------------------------------ a bank that runs

FAULTS = (
    *(f"{place}: {what}" for place in ("rates", "commands", "targets", "output")
      for what in ("roll's sign", "pitch's sign", "swapped", "degrees", "1.1", "0.9", "roll alone 1.2")),
    *(f"{place}: {loops} late" for place in ("rates", "commands", "targets", "output") for loops in (1, 2, 5, 12)),
    "its own command", "nothing put out", "another bank", "another loop rate",
)  # fmt: skip
"""What may be wrong with a bank on board."""


def asked_for(run: dict) -> FloatArray:
    """(n, 2), rad/s, that an attitude hold asks for in this run: it brings the vehicle back level."""
    level = np.array([lfilter([DT], [1.0, -1.0 + 0.5 * DT], run[name]) for name in ("p", "q")]).T
    return np.clip(-1.2 * level, -0.6, 0.6)


def ran(gains: Bank, run: dict, fault: str | None = None) -> FloatArray:
    """(n, 2), what the bank puts out, loop by loop, beside whatever flies."""
    seen = {
        "rates": np.stack([run["p"], run["q"]], axis=1),
        "commands": np.stack([run["delta_x"], run["delta_y"]], axis=1),
        "targets": asked_for(run),
    }
    place, _, what = (fault or "").partition(": ")
    if place in seen:
        seen[place] = spoilt(seen[place], what)
    model, K, dt = gains.model, gains.K, DT
    if fault == "another bank":
        model = {name: 1.15 * value for name, value in model.items()}
    if fault == "another loop rate":
        dt = 0.0025
    own, drive = tip_path_plane(model)
    block = np.zeros((8, 8))
    block[:4] = np.hstack([own - gains.L @ np.eye(2, 4), drive, gains.L])
    power = expm(block * dt)[:4]
    x, out = np.zeros(4), seen["targets"] @ gains.prefilter.T
    for k in range(len(out)):
        out[k] -= K @ x
        taken = out[k] if fault == "its own command" else seen["commands"][k]
        x = power @ np.concatenate([x, taken, seen["rates"][k]])
    if fault == "nothing put out":
        return 0.0 * out
    return (spoilt(out, what) if place == "output" else out).astype(np.float32).astype(float)


def spoilt(x: FloatArray, what: str) -> FloatArray:
    """A signal of both axes with something wrong."""
    if what.endswith(" late"):
        loops = int(what.split()[0])
        return np.concatenate([np.repeat(x[:1], loops, axis=0), x[:-loops]])
    match what:
        case "roll's sign":
            return x * [-1, 1]
        case "pitch's sign":
            return x * [1, -1]
        case "swapped":
            return x[:, ::-1].copy()
        case "degrees":
            return np.degrees(x)
        case "roll alone 1.2":
            return x * [1.2, 1]
    return x * float(what)
