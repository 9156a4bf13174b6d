"""One rate as a linear sum of the commands' answers, whose coefficients are found through what was added.

    rate(t) = sum_j (b0_j + b1_j s) w^2 / (s^2 + 2 zeta w s + w^2) delta_j(t - T)

`b0`, `b1` by two-stage least squares (what is added is the instrument), because feedback puts gusts into the commands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.linalg import orth

from gcs.flight.probe.grid import GRID_S, Gridded
from gcs.flight.probe.values import LETTERS, FloatArray

_NEGLIGIBLE = 1e-6
"""Of the largest singular value."""
_INSTRUMENTS_S = tuple(0.1 * k for k in range(8))
"""What is added, so much later, tells the commands' answer to it from gusts."""


class Dynamics(NamedTuple):
    """What lies between a command and a rate."""

    w: float
    """rad/s."""
    zeta: float
    delay_s: float


class Coefficients(NamedTuple):
    """Of the commands' answers, and what they leave."""

    b: FloatArray
    used: NDArray[np.intp]
    """The columns that they belong to."""
    unexplained: float
    """The squares that the instruments see of what is left: gusts that reach the commands by feedback are not in it."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Regression:
    """One rate in all steps, one after the other, with what must be projected out."""

    grids: tuple[Gridded, ...]
    letters: tuple[str, ...]
    """The m commands."""
    y: FloatArray
    """The rate, rad/s, shape (n,)."""
    rows: NDArray[np.bool_]
    """Where there were samples, shape (n,)."""
    drift: FloatArray
    """Orthonormal: an offset and a slope for each step."""
    instruments: FloatArray
    """Orthonormal: what was added in each step and up to 0.7 s before, without offsets and slopes."""

    def free(self, columns: FloatArray) -> FloatArray:
        """Without offsets and slopes, where there were samples."""
        kept = columns[self.rows]
        free: FloatArray = kept - self.drift @ (self.drift.T @ kept)
        return free

    def instrumented(self, columns: FloatArray) -> FloatArray:
        """What the instruments see of columns of shape (n, ...); offsets and slopes are not in it, shape (k, ...)."""
        seen: FloatArray = self.instruments.T @ columns[self.rows]
        return seen

    def answers(self, w: float, zeta: float) -> tuple[FloatArray, ...]:
        """For each step the filter's output and its derivative over w for each command, at once: (2 m, n)."""
        moved = (np.stack([grid.u[k] - grid.u[k][:10].mean() for k in self.letters]) for grid in self.grids)
        return tuple(lag(values, w, zeta) for values in moved)

    def filtered(self, dynamics: Dynamics) -> FloatArray:
        """The answers of all steps, late by the delay, shape (n, 2 m)."""
        return late(self.answers(dynamics.w, dynamics.zeta), dynamics.delay_s)

    def inverse(self, X: FloatArray) -> FloatArray:
        """What takes the rate to the coefficients of X: the pseudoinverse of that part of it that was added."""
        Q = self.instruments
        inverse: FloatArray = np.linalg.pinv(Q.T @ X, rcond=_NEGLIGIBLE) @ Q.T
        return inverse


def regression(grids: tuple[Gridded, ...], letters: tuple[str, ...], rate: str) -> Regression:
    """Of a rate, p or q, on these commands."""
    rows = np.concatenate([grid.rows for grid in grids])
    bounds = np.cumsum([0, *(grid.rows.size for grid in grids)])
    k = len(_INSTRUMENTS_S)
    columns, added = np.zeros((rows.size, 2 * len(grids))), np.zeros((rows.size, k * len(grids)))
    for i, grid in enumerate(grids):
        inside = slice(bounds[i], bounds[i + 1])
        columns[inside, 2 * i] = 1.0
        columns[inside, 2 * i + 1] = np.linspace(-1, 1, grid.rows.size)
        e = grid.e[LETTERS[grid.axis]]
        for j, late_s in enumerate(_INSTRUMENTS_S):
            shift = round(late_s / GRID_S)
            added[bounds[i] + shift : bounds[i + 1], k * i + j] = e[: max(e.size - shift, 0)]
    drift = np.linalg.qr(columns[rows])[0]
    bare = added[rows] - drift @ (drift.T @ added[rows])
    y = np.concatenate([grid.y[rate] for grid in grids])
    instruments = orth(bare, rcond=_NEGLIGIBLE)
    return Regression(grids=grids, letters=letters, y=y, rows=rows, drift=drift, instruments=instruments)


def lag(values: FloatArray, w: float, zeta: float) -> FloatArray:
    """Rows (m, n) through w^2 / (s^2 + 2 zeta w s + w^2) and its derivative over w: (2 m, n)."""
    k = 2 / GRID_S
    denominator = np.array([k * k + 2 * zeta * w * k + w * w, 2 * (w * w - k * k), k * k - 2 * zeta * w * k + w * w])
    position = signal.lfilter(w * w * np.array([1.0, 2.0, 1.0]), denominator, values)
    speed = signal.lfilter(w * k * np.array([1.0, 0.0, -1.0]), denominator, values)
    return np.concatenate([position, speed])


def late(answers: Sequence[FloatArray], delay_s: float) -> FloatArray:
    """Rows (2 m, n) of each step, late by `delay_s` after its beginning at rest; columns, one step after the other."""
    whole = int(delay_s / GRID_S)
    part = delay_s / GRID_S - whole
    columns = np.zeros((sum(rows.shape[1] for rows in answers), answers[0].shape[0]))
    start = 0
    for rows in answers:
        size = rows.shape[1]
        columns[start + whole : start + size] = (1 - part) * rows.T[: max(size - whole, 0)]
        columns[start + whole + 1 : start + size] += part * rows.T[: max(size - whole - 1, 0)]
        start += size
    return columns


def solve(m: int, R: FloatArray, z: FloatArray) -> Coefficients:
    """`R` and `z` are what the instruments see of the answers to `m` commands, (k, 2 m), and of the rate, (k,).

    A numerator that turns the strongest gain the other way round at first stands for a delay: it is left out.
    """
    b, used = np.linalg.lstsq(R, z, rcond=_NEGLIGIBLE)[0], np.arange(2 * m)
    strongest = int(np.argmax(np.abs(b[:m]) + np.abs(b[m:])))
    if b[strongest] * b[m + strongest] < 0:
        used = np.delete(used, m + strongest)
        b = np.linalg.lstsq(R[:, used], z, rcond=_NEGLIGIBLE)[0]
    left: FloatArray = z - R[:, used] @ b
    return Coefficients(np.asarray(b), used, float(left @ left))
