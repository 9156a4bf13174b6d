"""Vehicles with random parameters and the runs they flew: what a fit without start values has to survive.

Each parameter of Table 4 is multiplied by 0.6 to 1.7, by itself. A stable vehicle flies a roll and a pitch chirp
without controller, and 5 to 50 % of each rate, inside the fitted band, is then made residual: white noise, noise of
1.5 Hz, or gusts that went through the vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from planted import DT, SIZES, TABLE_4, chirp
from scipy.signal import lfilter, lsim

from sysid.data.dataset import prepared
from sysid.data.preprocess import low_pass
from sysid.data.record import Record
from sysid.fit.estimate import estimate
from sysid.fit.gauss_newton import minimise
from sysid.fit.output_error import output_error
from sysid.model.paper import TPP
from sysid.model.structure import FloatArray, Model

DURATION_S = 20.0
EVERY = 2
"""250 Hz, the chirps' samples being 2 ms."""
FACTORS = (0.6, 1.7)
RESIDUAL = (0.05, 0.50)
KINDS = ("white", "coloured", "gusts")
COLOUR_HZ = 1.5
BAND_HZ = 15.0
A_HAIR = 1e-5
"""Of the summed logarithms of residual power: a few hundredths of a standard error."""


@dataclass(frozen=True, eq=False)
class Flown:
    """One random vehicle and what it logged."""

    truth: Model
    records: tuple[Record, ...]
    kind: str
    share: float
    """Residual over output, both below 15 Hz."""
    draws: int
    """Vehicles drawn so far, unstable ones among them."""


def flown(seed: int) -> Iterator[Flown]:
    """Stable vehicles without end, the kinds of residual in turn."""
    rng = np.random.default_rng(seed)
    table = np.array([TABLE_4[name] for name in TPP.names])
    draws = found = 0
    while True:
        draws += 1
        truth = Model(TPP, table * rng.uniform(*FACTORS, table.size))
        if not truth.stable:
            continue
        kind, share = KINDS[found % len(KINDS)], float(rng.uniform(*RESIDUAL))
        runs = tuple(_run(truth, axis, kind, share, rng) for axis in ("roll", "pitch"))
        found += 1
        yield Flown(truth, runs, kind, share, draws)


def _run(truth: Model, axis: str, kind: str, share: float, rng: np.random.Generator) -> Record:
    A, B, C, D = truth.matrices
    sweep = chirp(SIZES[axis], DURATION_S)[::EVERY]
    dt, n = EVERY * DT, sweep.size
    t = np.arange(n) * dt
    u = _coloured(rng, 10.0, n, dt) * 0.05 * SIZES[axis]
    u[:, ("roll", "pitch").index(axis)] += sweep
    y = lsim((A, B, C, D), u, t, interp=False)[1]
    match kind:
        case "white":
            residual = rng.standard_normal((n, 2))
        case "coloured":
            residual = _coloured(rng, COLOUR_HZ, n, dt)
        case _:
            on_rates = np.eye(4, 2)
            residual = lsim((A, on_rates, C, np.zeros((2, 2))), _coloured(rng, COLOUR_HZ, n, dt), t, interp=False)[1]
    for i in range(2):
        inside = [float(np.std(low_pass(one[:, i], dt, BAND_HZ))) for one in (y, residual)]
        y[:, i] += residual[:, i] * share * inside[0] / inside[1]
    channels = {"t": t, "p": y[:, 0], "q": y[:, 1], "delta_x": u[:, 0], "delta_y": u[:, 1]}
    return Record(axis, channels, maneuver="chirp", axis=axis)


def _coloured(rng: np.random.Generator, corner_hz: float, n: int, dt: float) -> FloatArray:
    """First-order filtered noise of unit deviation, (n, 2)."""
    pole = np.exp(-2 * np.pi * corner_hz * dt)
    return np.asarray(lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], rng.standard_normal((n, 2)), axis=0))


def above_the_optimum(one: Flown) -> float:
    """Cost of the fit without start values less that of the optimum reached from the truth; below 0, a better one.

    The cost is the one that is minimised, both weighed alike; the power that a fit reports takes the end states of
    each output without weights, and is not least at the same place.
    """
    bins = prepared(one.records, (0.0, BAND_HZ)).viewed(TPP.inputs)
    stacks = bins.stacks
    best, power = minimise(one.truth, stacks, output_error(one.truth, stacks).residual_power)
    least_squares = estimate(TPP, bins, weights="constant").model
    reached, reference = (minimise(model, stacks, power, steps=0)[1] for model in (least_squares, best))
    return float(np.sum(np.log(reached)) - np.sum(np.log(reference)))
