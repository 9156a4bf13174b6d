"""Bins of all runs in windows of frequency, and what of an output follows each command there.

A sweep excites one axis and the controller moves the other after it, so one run alone cannot say which command did
what: its two-input response comes out 3 to 10 dB wrong at a coherence of 1. Cross spectra are therefore averaged over
neighbouring bins *and* over all runs; where even then one command only follows the others, there is no response.

Gusts reach the commands through the feedback. Where the excitation is logged, the part of each command that it caused
serves as instrument (`sysid.data.instrument`), and gusts average out; without it the commands are their own reference,
and responses lean towards minus the controller's inverse where gusts are strong.

Within a window the response may be a line over frequency, straight or bent, so that slopes of phase do not count as
noise. A command acts as the loop holds it: what holding does is taken out, and responses are those of the vehicle.
Bendat and Piersol (Random Data), ch. 7 and 9: conditioned spectra, multiple and partial coherence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import EXCITATIONS, ComplexArray, excitation_of
from sysid.data.record import FloatArray
from sysid.data.stacks import Stack

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

POINTS = 50
BEYOND_SWEEP = (0.8, 1.1)
"""How far before its start and beyond its end a chirp still moves the command, as factors."""
LOWEST_HZ = 0.3
"""Where no sweep is known."""
HALF_WIDTH_HZ = 0.25
WIDER_FROM_HZ = 25 / 6
"""Above it windows grow with frequency, to 6 % of it."""
WIDEST = 0.7
"""Of its own frequency, that a window reaches to either side."""
BINS_PER_UNKNOWN = 3
LEAST_OWN_SHARE = 0.3
"""Of a command's power in a window, that the other commands do not explain; below it there is no response. Sweeps of
both axes together leave 0.7 and more; the axis that only the controller moves has 0.02 to 0.2."""
LEAST_RELATIVE_POWER = 0.03
"""Of the strongest command's own power; a command that is its own reference and moves less is feedback alone."""
END_S, MOVING = 0.5, 0.3
"""Of a command's mean power, that it has at an end of a piece which was cut while it moved."""
BINS_FOR_ENDS = ((12, 2), (6, 1))
"""How many bins of a piece in a window allow for how many unknowns of its ends."""


class Solution(NamedTuple):
    """What the windows say of some outputs; NaN where a window cannot tell the commands apart."""

    H: ComplexArray
    """(k, m, f)"""
    noise: FloatArray
    """(k, f), power per bin that follows no command."""
    own: FloatArray
    """(m, f), each command's own power that its reference caused."""
    variance: FloatArray
    """(k, m, f), of H, by chance: real and imaginary part together."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Regression:
    """One window's outputs on its commands."""

    at: IntArray
    """(n,), numbers of the bins."""
    W: ComplexArray
    """(unknowns, n), commands, and the same times the place in the window, and its square."""
    gain: ComplexArray
    """(n, unknowns), from outputs to the response, its slope and its bend."""
    ends: FloatArray
    """(e, n), orthonormal: what the ends of each piece of a run leave in its bins."""
    clear: BoolArray
    """(m,), which commands move enough for themselves."""
    alone: FloatArray
    """(m,), power that no other command explains, as far as the reference caused it."""
    power: ComplexArray
    """(m, m), of the commands, as far as their references caused them."""

    @property
    def freedom(self) -> int:
        """Bins beyond the unknowns."""
        n, unknowns = self.W.shape[1], self.W.shape[0] + self.ends.shape[0]
        return int(n - unknowns)

    def of(self, y: ComplexArray) -> tuple[ComplexArray, FloatArray]:
        """Responses (k, m) of outputs (k, n), and noise power per bin (k,)."""
        line = y @ self.gain
        rest = y - line @ self.W
        rest = rest - (rest @ self.ends.T) @ self.ends
        return line[:, : self.alone.size], np.sum(np.abs(rest) ** 2, axis=1) / self.freedom

    @cached_property
    def spread(self) -> FloatArray:
        """(m,), variance of a response per noise power per bin."""
        return np.asarray(np.sum(np.abs(self.gain[:, : self.alone.size]) ** 2, axis=0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Windows:
    """Commands and what caused them, on all bins of all runs, cut into windows around each grid frequency."""

    frequency_hz: FloatArray
    """(f,)"""
    half_width_hz: FloatArray
    """(f,)"""
    order: int
    """Of the polynomial over frequency that a response may be in a window."""
    fewest: int
    """Bins for each unknown; windows with fewer say nothing."""
    commands: tuple[str, ...]
    references: tuple[str, ...]
    U: ComplexArray
    """(m, bins), as held, every sample of every run counting the same."""
    R: ComplexArray
    """(m, bins)"""
    scale: FloatArray
    """(bins,), what the bins were multiplied with."""
    at_hz: FloatArray
    """(bins,)"""
    piece: FloatArray
    """(bins,), which gap-free piece each is of; its ends are taken out. Negative: they are to be left in."""

    @cached_property
    def regressions(self) -> tuple[Regression | None, ...]:
        """For each window, None where it does not tell the commands apart."""
        return tuple(map(self._regression, self.frequency_hz, self.half_width_hz))

    def _regression(self, centre: float, half: float) -> Regression | None:
        at = np.flatnonzero(np.abs(self.at_hz - centre) <= half)
        place = (self.at_hz[at] - centre) / half
        ends = self._ends(at, place)
        if at.size < self.fewest * (self.order + 1) * len(self.commands) + ends.shape[0]:
            return None
        u, r = (rows[:, at] - (rows[:, at] @ ends.T) @ ends for rows in (self.U, self.R))
        caused = (u @ r.conj().T) @ np.linalg.pinv(r @ r.conj().T, rcond=1e-9, hermitian=True) @ r
        power = caused @ caused.conj().T
        whole = np.real(np.diag(power))
        if not np.all(whole > 0):
            return None
        unit = power / np.sqrt(np.outer(whole, whole))
        if np.linalg.cond(unit) > 1e9:
            return None
        alone = whole / np.real(np.diag(np.linalg.inv(unit)))
        fed_back = np.array([name not in EXCITATIONS for name in self.references])
        faint = fed_back & (alone < LEAST_RELATIVE_POWER * np.max(alone))
        W, Z = (np.concatenate([place**power * rows for power in range(self.order + 1)]) for rows in (u, caused))
        Z = Z - (Z @ ends.T) @ ends
        try:
            gain = Z.conj().T @ np.linalg.inv(W @ Z.conj().T)
        except np.linalg.LinAlgError:
            return None
        clear = (alone > LEAST_OWN_SHARE * whole) & ~faint
        return Regression(at=at, W=W, gain=gain, ends=ends, clear=clear, alone=alone, power=power)

    def _ends(self, at: IntArray, place: FloatArray) -> FloatArray:
        """Rows (e, n) without overlap: of each piece's bins the constant, and the line where there are enough."""
        rows: list[FloatArray] = []
        piece = self.piece[at]
        for number in np.unique(piece[piece >= 0]):
            inside = piece == number
            count = int(np.count_nonzero(inside))
            unknowns = next((order for least, order in BINS_FOR_ENDS if count >= least), 0)
            for order in range(unknowns):
                row = np.where(inside, place**order, 0.0)
                row = row - sum((row @ before) * before for before in rows[len(rows) - order :])
                rows.append(row / np.linalg.norm(row))
        return np.array(rows).reshape(len(rows), at.size)

    def solve(self, Y: ComplexArray) -> Solution:
        """Responses of Y (k, bins), unscaled, to the commands."""
        k, m, f = Y.shape[0], len(self.commands), self.frequency_hz.size
        H, variance = np.full((k, m, f), np.nan + 0j), np.full((k, m, f), np.nan)
        noise, own = np.full((k, f), np.nan), np.full((m, f), np.nan)
        for number, window in enumerate(self.regressions):
            if window is None:
                continue
            found, noise[:, number] = window.of(self.scale[window.at] * Y[:, window.at])
            clear = window.clear
            H[:, clear, number] = found[:, clear]
            own[clear, number] = window.alone[clear]
            variance[:, clear, number] = noise[:, None, number] * window.spread[clear]
        return Solution(H, noise, own, variance)

    def coherences(self, of: Solution) -> tuple[FloatArray, FloatArray]:
        """Multiple (k, f) and partial (k, m, f): caused power over itself and noise, less what noise alone shows."""
        m, noise = len(self.commands), of.noise
        empty = np.full((m, m), np.nan + 0j)
        counts = np.array([np.nan if one is None else one.at.size for one in self.regressions])
        power = np.stack([empty if one is None else one.power for one in self.regressions], axis=-1)
        each = np.maximum(np.abs(of.H) ** 2 * of.own - noise[:, None], 0)
        together = np.einsum("kif,ijf,kjf->kf", of.H, power, of.H.conj()).real
        together = np.maximum(together - m * noise, 0)
        with np.errstate(invalid="ignore"):
            return together / (together + counts * noise), each / (each + counts * noise[:, None])


def windows(
    stacks: Sequence[Stack],
    commands: Sequence[str],
    points: int = POINTS,
    half_width_hz: float = HALF_WIDTH_HZ,
    *,
    order: int = 1,
    fewest: int = BINS_PER_UNKNOWN,
    ends: bool = False,
    within_hz: tuple[float, float] | None = None,
) -> Windows:
    """Cut the bins of all runs into windows on a logarithmic grid; width grows with frequency.

    Centres lie `within_hz`, where that is less than the bins' band: windows at its edges have both their sides.
    `ends` says that outputs will hold what the state at the ends of pieces leaves: of those that are cut while commands
    move it is then estimated too.
    """
    frequency = np.concatenate([group.frequency_hz for group in stacks])
    scale = np.concatenate([group.scale for group in stacks])
    held = scale * np.concatenate([group.sampling(1).hold for group in stacks])
    U = held * np.concatenate([group.U[[group.inputs.index(name) for name in commands]] for group in stacks], axis=1)
    R, references = U.copy(), list(commands)
    for row, name in enumerate(commands):
        excitation = excitation_of(name)
        logged = _logged(stacks, excitation)
        if logged is not None:
            R[row], references[row] = held * logged, excitation
    grid = _grid(stacks, frequency if within_hz is None else np.clip(frequency, *within_hz), points)
    sizes = [part.stop - part.start for group in stacks for part in group.slices]
    return Windows(
        frequency_hz=grid,
        half_width_hz=np.minimum(half_width_hz * np.maximum(1, grid / WIDER_FROM_HZ), WIDEST * grid),
        order=order,
        fewest=fewest,
        commands=tuple(commands),
        references=tuple(references),
        U=U,
        R=R,
        scale=scale,
        at_hz=frequency,
        piece=np.repeat(_cut_in_motion(stacks, commands) if ends else np.full(len(sizes), -1), sizes),
    )


def _cut_in_motion(stacks: Sequence[Stack], commands: Sequence[str]) -> IntArray:
    """The number of each piece that begins or ends while commands move, -1 of others: the state at their ends is what
    it was, and to take it out would take with it what the sweep began with."""
    moving = []
    for one in (one for group in stacks for one in group.spectra):
        rows = np.stack([one.segment.channels[name] for name in commands])
        power = (rows - rows.mean(axis=1, keepdims=True)) ** 2
        ends = max(1, min(round(END_S / one.dt), one.samples // 4))
        near = np.maximum(power[:, :ends].mean(axis=1), power[:, -ends:].mean(axis=1))
        moving.append(bool(np.any(near > MOVING * power.mean(axis=1))))
    return np.where(moving, np.arange(len(moving)), -1)


def _logged(stacks: Sequence[Stack], channel: str) -> ComplexArray | None:
    """A channel on all bins, (bins,); None where it is not logged on every run."""
    segments = [one for group in stacks for one in group.spectra]
    if not all(channel in one.segment.channels for one in segments):
        return None
    return np.concatenate([one.transform(one.segment.channels[channel][None, :])[0] for one in segments])


def _grid(stacks: Sequence[Stack], frequency_hz: FloatArray, points: int) -> FloatArray:
    """The windows' centres: evenly over the octaves, no further than the sweeps where these are known."""
    low, high = float(np.min(frequency_hz)), float(np.max(frequency_hz))
    swept = [one.segment.record.swept_band_hz for group in stacks for one in group.spectra]
    known = [band for band in swept if band is not None]
    if known and len(known) == len(swept):  # beyond the sweep only the controller moves the commands
        low = max(low, BEYOND_SWEEP[0] * min(band[0] for band in known))
        high = max(low, min(high, BEYOND_SWEEP[1] * max(band[1] for band in known)))
    else:
        low = max(LOWEST_HZ, low)
    return np.geomspace(low, high, points) if low < high else np.array([high])
