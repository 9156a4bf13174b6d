"""Sweeps of a linear vehicle under feedback and gusts, made without the package: truth for measured responses.

The vehicle is Table 4's tip-path plane, its commands held over each sample and its rates taken at each; many seeds
are stepped side by side. What it answers at a frequency is written out in `truth`.
"""

from __future__ import annotations

import numpy as np
from planted import TABLE_4
from scipy.signal import cont2discrete

DT = 0.01
SWEPT_HZ = (0.5, 10.0)


def equations() -> tuple[np.ndarray, ...]:
    """p, q, a, b; of delta_x and delta_y, and of angular accelerations behind them."""
    N = TABLE_4
    tau = N["tau_f"]
    A = [
        [0, 0, 0, N["L_b"]],
        [0, 0, N["M_a"], 0],
        [0, -1, -1 / tau, N["A_b"] / tau],
        [-1, 0, N["B_a"] / tau, -1 / tau],
    ]
    B = np.zeros((4, 4))
    B[2:, :2] = np.array([[N["A_lat"], N["A_lon"]], [N["B_lat"], N["B_lon"]]]) / tau
    B[:2, 2:] = np.eye(2)
    return np.array(A), B, np.eye(2, 4)


def truth(frequency_hz: np.ndarray) -> np.ndarray:
    """(2, 2, f): p, q per delta_x, delta_y."""
    A, B, C = equations()
    s = 2j * np.pi * frequency_hz[:, None, None]
    return np.moveaxis(C @ np.linalg.solve(s * np.eye(4) - A, B[:, :2].astype(complex)), 0, -1)


def chirp(seconds: float, dt: float = DT) -> np.ndarray:
    """Exponential, at rest for a second before and after."""
    t = np.arange(0, seconds - 2, dt)
    low, high = SWEPT_HZ
    growth = np.log(high / low) / t[-1]
    wave = np.sin(2 * np.pi * low * np.expm1(growth * t) / growth) * np.clip(np.minimum(t, t[-1] - t), 0, 1)
    rest = np.zeros(round(1 / dt))
    return np.concatenate([rest, wave, rest])


def sweeps(
    seeds: int, *, gusts: float = 0.0, feedback: float = 1.0, seconds: float = 32.0, axes: tuple[int, ...] = (0, 1)
) -> list[list[dict[str, np.ndarray]]]:
    """For every seed a run of each axis, channels by name. Rates come back to the commands with `feedback` times
    0.06 of full command per rad/s; gusts are held angular accelerations of `gusts` times 4 and 20 rad/s^2."""
    A, B, C = equations()
    Ad, Bd, *_ = cont2discrete((A, B, C, np.zeros((2, 4))), DT)
    rng = np.random.default_rng(12345)
    flights: list[list[dict[str, np.ndarray]]] = [[] for _ in range(seeds)]
    for axis in axes:
        wave = chirp(seconds)
        excitation = np.zeros((wave.size, 2))
        excitation[:, axis] = (0.1, 0.15)[axis] * wave
        x = np.zeros((seeds, 4))
        Y, U = np.empty((wave.size, seeds, 2)), np.empty((wave.size, seeds, 2))
        for k, added in enumerate(excitation):
            Y[k] = x @ C.T
            U[k] = added - 0.06 * feedback * Y[k]
            wind = gusts * rng.normal(size=(seeds, 2)) * (4.0, 20.0)
            x = x @ Ad.T + np.concatenate([U[k], wind], axis=1) @ Bd.T
        for seed, flight in enumerate(flights):
            flight.append(
                {
                    "t": DT * np.arange(wave.size), "p": Y[:, seed, 0], "q": Y[:, seed, 1],
                    "delta_x": U[:, seed, 0], "delta_y": U[:, seed, 1],
                    "excitation_x": excitation[:, 0], "excitation_y": excitation[:, 1],
                }
            )  # fmt: skip
    return flights
