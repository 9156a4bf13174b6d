"""Measured frequency responses, several inputs at once, from all runs together, and how far to trust them.

A sweep excites one axis and the controller moves the other after it, so one run alone cannot say which command did
what: its two-input response comes out 3 to 10 dB wrong at a coherence of 1. Cross spectra are therefore averaged over
neighbouring bins *and* over all runs; where even then one command only follows the others, there is no response.

Gusts reach the commands through the feedback. Where the excitation is logged, the part of each command that it caused
serves as instrument (`sysid.data.instrument`), and gusts average out; without it the commands are their own reference,
and responses lean towards minus the controller's inverse where gusts are strong.

Within a window the response may be a straight line over frequency, so that slopes of phase do not count as noise.
Bendat and Piersol (Random Data), ch. 7 and 9: conditioned spectra, multiple and partial coherence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.preprocess import EXCITATIONS, ComplexArray, Spectrum, excitation_of, gusts_kept_out
from sysid.data.record import RATES
from sysid.data.stacks import Stack, stack
from sysid.model.structure import FloatArray

POINTS = 50
BEYOND_SWEEP = (0.8, 1.1)
"""How far before its start and beyond its end a chirp still moves the command, as factors."""
LOWEST_HZ = 0.3
HALF_WIDTH_HZ = 0.25
RELATIVE_HALF_WIDTH = 0.06
BINS_PER_UNKNOWN = 4
LEAST_OWN_SHARE = 0.3
"""Of a command's power in a window, that the other commands do not explain; below it there is no response. Sweeps of
both axes together leave 0.7 and more; the axis that only the controller moves has 0.02 to 0.2."""
LEAST_RELATIVE_POWER = 0.03
"""Of the strongest command's own power; a command that is its own reference and moves less is feedback alone."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Responses:
    """Outputs per command on a grid of frequencies; NaN where the runs do not separate the commands."""

    frequency_hz: FloatArray
    """(f,)"""
    outputs: tuple[str, ...]
    commands: tuple[str, ...]
    H: ComplexArray
    """(k, m, f), output units per full command."""
    multiple_coherence: FloatArray
    """(k, f): share of each output's power that all commands together explain, counting what the reference caused."""
    partial_coherence: FloatArray
    """(k, m, f): the same for one command, what the other commands explain taken away before."""
    references: tuple[str, ...]
    """For each command the channel that gusts do not reach, or the command itself where none is logged."""

    def separates(self, output: str, command: str) -> bool:
        """Whether there is a response anywhere: both axes were swept, each command moved for itself."""
        return bool(np.any(np.isfinite(self.H[self.outputs.index(output), self.commands.index(command)])))

    @property
    def closed_loop_safe(self) -> bool:
        """Whether logged excitation kept the gusts out of every response."""
        return gusts_kept_out(self.references)


@dataclass(frozen=True, eq=False, kw_only=True)
class Windows:
    """Commands and what caused them, on all bins of all runs, cut into windows around each grid frequency."""

    frequency_hz: FloatArray
    """(f,)"""
    commands: tuple[str, ...]
    references: tuple[str, ...]
    U: ComplexArray
    """(m, bins), every sample of every run counting the same."""
    R: ComplexArray
    """(m, bins)"""
    scale: FloatArray
    """(bins,), what the bins were multiplied with."""
    chosen: tuple[FloatArray, ...]
    """For each window a row of bin numbers and a row of places within it, -1..1."""

    def solve(self, Y: ComplexArray) -> tuple[ComplexArray, FloatArray, FloatArray]:
        """Responses of Y (k, bins), unscaled, to the commands: H (k, m, f), noise power per bin (k, f), and each
        command's own power that its reference caused (m, f); NaN where a window cannot tell the commands apart."""
        m, f = len(self.commands), self.frequency_hz.size
        H = np.full((Y.shape[0], m, f), np.nan + 0j)
        noise, own = np.full((Y.shape[0], f), np.nan), np.full((m, f), np.nan)
        for number, (bins, place) in enumerate(self.chosen):
            at = bins.astype(int)
            u, r, y = self.U[:, at], self.R[:, at], self.scale[at] * Y[:, at]
            unknowns = 2 * m
            if at.size < BINS_PER_UNKNOWN * unknowns:
                continue
            caused = (u @ r.conj().T) @ np.linalg.pinv(r @ r.conj().T, rcond=1e-9, hermitian=True) @ r
            power = caused @ caused.conj().T
            whole = np.real(np.diag(power))
            if not np.all(whole > 0):
                continue
            size = np.sqrt(whole)
            unit = power / np.outer(size, size)
            if np.linalg.cond(unit) > 1e9:
                continue
            alone = whole / np.real(np.diag(np.linalg.inv(unit)))
            fed_back = np.array([name not in EXCITATIONS for name in self.references])
            faint = fed_back & (alone < LEAST_RELATIVE_POWER * np.max(alone))
            clear = (alone > LEAST_OWN_SHARE * whole) & ~faint
            W, Z = np.concatenate([u, place * u]), np.concatenate([caused, place * caused])
            try:
                line = np.linalg.solve((W @ Z.conj().T).T, (y @ Z.conj().T).T).T
            except np.linalg.LinAlgError:
                continue
            rest = y - line @ W
            noise[:, number] = np.sum(np.abs(rest) ** 2, axis=1) / (at.size - unknowns)
            H[:, clear, number] = line[:, :m][:, clear]
            own[clear, number] = alone[clear]
        return H, noise, own


def windows(stacks: Sequence[Stack], commands: Sequence[str], points: int = POINTS) -> Windows:
    """Cut the bins of all runs into windows on a logarithmic grid; width grows with frequency."""
    frequency = np.concatenate([group.frequency_hz for group in stacks])
    scale = np.concatenate([group.scale for group in stacks])
    U = np.concatenate(
        [group.scale * group.U[[group.inputs.index(name) for name in commands]] for group in stacks], axis=1
    )
    R, references = U.copy(), list(commands)
    for row, name in enumerate(commands):
        excitation = excitation_of(name)
        logged = _logged(stacks, excitation)
        if logged is not None:
            R[row], references[row] = scale * logged, excitation
    grid = _grid(stacks, frequency, points)
    chosen = []
    for centre in grid:
        half = max(HALF_WIDTH_HZ, RELATIVE_HALF_WIDTH * float(centre))
        at = np.flatnonzero(np.abs(frequency - centre) <= half)
        chosen.append(np.stack([at, (frequency[at] - centre) / half]))
    return Windows(
        frequency_hz=grid,
        commands=tuple(commands),
        references=tuple(references),
        U=U,
        R=R,
        scale=scale,
        chosen=tuple(chosen),
    )


def _logged(stacks: Sequence[Stack], channel: str) -> ComplexArray | None:
    """A channel on all bins, (bins,); None where it is not logged on every run."""
    segments = [one for group in stacks for one in group.spectra]
    if not all(channel in one.segment.channels for one in segments):
        return None
    return np.concatenate([one.transform(one.segment.channels[channel][None, :])[0] for one in segments])


def _grid(stacks: Sequence[Stack], frequency_hz: FloatArray, points: int) -> FloatArray:
    """The windows' centres: evenly over the octaves, no further than the sweeps where these are known."""
    low, high = max(LOWEST_HZ, float(np.min(frequency_hz))), float(np.max(frequency_hz))
    swept = [one.segment.record.swept_band_hz for group in stacks for one in group.spectra]
    known = [band for band in swept if band is not None]
    if known and len(known) == len(swept):  # beyond the sweep only the controller moves the commands
        low = max(low, BEYOND_SWEEP[0] * min(band[0] for band in known))
        high = max(low, min(high, BEYOND_SWEEP[1] * max(band[1] for band in known)))
    return np.geomspace(low, high, points) if low < high else np.array([high])


def measure(
    spectra: Sequence[Spectrum], commands: Sequence[str], outputs: Sequence[str] = RATES, points: int = POINTS
) -> Responses:
    """Responses of the outputs to the commands, from the bins of all runs together."""
    stacks = stack(spectra)
    cut = windows(stacks, commands, points)
    H, noise, own = cut.solve(np.concatenate([group.Y for group in stacks], axis=1))
    return judged(cut, tuple(outputs), H, noise, own)


def judged(cut: Windows, outputs: tuple[str, ...], H: ComplexArray, noise: FloatArray, own: FloatArray) -> Responses:
    """Responses with their coherences: caused power over itself and noise, less what noise alone would show."""
    counts = np.array([place.shape[1] for place in cut.chosen])
    each = np.maximum(np.abs(H) ** 2 * own - noise[:, None], 0)
    partial = each / (each + counts * noise[:, None])
    m = len(cut.commands)
    power = np.full((m, m, cut.frequency_hz.size), np.nan + 0j)
    for number, (bins, _) in enumerate(cut.chosen):
        u, r = cut.U[:, bins.astype(int)], cut.R[:, bins.astype(int)]
        caused = (u @ r.conj().T) @ np.linalg.pinv(r @ r.conj().T, rcond=1e-9, hermitian=True) @ r
        power[:, :, number] = caused @ caused.conj().T
    together = np.maximum(np.einsum("kif,ijf,kjf->kf", H, power, H.conj()).real - m * noise, 0)
    multiple = together / (together + counts * noise)
    return Responses(
        frequency_hz=cut.frequency_hz,
        outputs=outputs,
        commands=cut.commands,
        H=H,
        multiple_coherence=multiple,
        partial_coherence=partial,
        references=cut.references,
    )
