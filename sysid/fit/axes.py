"""Axes that the runs do not identify, refused before and after a fit with what to fly instead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.airframe import Airframe
from sysid.data.preprocess import Spectrum
from sysid.data.record import AXIS_OF, CYCLIC, RATES, axis_of
from sysid.errors import FitError
from sysid.model.monomials import linearised
from sysid.model.structure import AnyArray, FloatArray, Model, Structure

LEAST_COMMAND = 2e-4  # rms of full command in the band: one step of a 12-bit servo
LEAST_INDEPENDENT_SHARE = 0.002
LARGEST_RELATIVE_ERROR = 0.25
EFFECTIVE_HZ = (1.0, 2.0, 4.0)
"""Where a command's effect may be known: behind a slow lag gusts drown what is slower, and the lag what is faster."""
SHARE_BAND_HZ = 0.5
OWN_POWER = 0.9
"""Of all rates in the rate of the one axis that was excited, at least: with more in the others they are coupled."""
LEAST_SHARE = 1e-9  # below which a command counts as following the others


def refuse_still_channels(structure: Structure, spectra: Sequence[Spectrum]) -> None:
    """Say which axis has no excitation, or none of its own, before any number is made of it."""
    bins = sum(one.frequency_hz.size for one in spectra)
    count = len(structure.parameters)
    if bins < 2 * count:
        raise FitError(f"only {bins} frequencies in the band: too little data for {count} parameters")
    m = len(structure.commands)
    moved = dict(zip(structure.commands, rms_of_commands(spectra, m), strict=True))
    for name, rms in moved.items():
        axis = AXIS_OF.get(name, name)
        if rms < LEAST_COMMAND:
            way_out = _or_alone(structure, name) if max(moved.values()) >= LEAST_COMMAND else ""
            raise FitError(
                f"{axis} axis not identifiable: {name} hardly moves ({rms:.1e} rms of full command); "
                f"fly a {axis} chirp and add its run{way_out}"
            )
    for row, name in enumerate(structure.outputs):
        if not any(np.any(one.Y[row]) for one in spectra):
            raise FitError(
                f"{AXIS_OF.get(name, name)} axis not identifiable: {name} does not move at all; check its channel"
                if name not in RATES
                else f"{AXIS_OF[name]} axis not identifiable: {name} does not move at all; check the gyro's channel"
            )
    own = independent_share(spectra, m)
    for name, share in zip(structure.commands, own, strict=True):
        axis = AXIS_OF.get(name, name)
        if share < LEAST_INDEPENDENT_SHARE:
            raise FitError(
                f"{axis} axis not identifiable: {name} only follows the other command "
                f"({100 * share:.2g} % of its power is its own); fit it together with a {axis} chirp"
                f"{_or_alone(structure, name)}"
            )


def _or_alone(structure: Structure, unknown: str) -> str:
    """That the other axis can be fitted alone, where there is one."""
    others = [axis_of(name) for name in structure.base_.commands if name != unknown]
    able = [axis for axis in others if any(name[0] == axis for name in structure.base_.alone)]
    return f", or fit {able[0]} alone: --axes {able[0]}" if len(others) == 1 and able else ""


def rms_of_commands(spectra: Sequence[Spectrum], commands: int) -> FloatArray:
    """Root mean square of each command in the band, (commands,), of full command."""
    energy = sum(
        2 / one.samples * np.einsum("ij,ij->i", one.U[:commands].conj(), one.U[:commands]).real for one in spectra
    )
    return np.asarray(np.sqrt(energy / sum(one.samples for one in spectra)))


def excited_alone(structure: Structure, spectra: Sequence[Spectrum]) -> str | None:
    """The one axis of a bare base that was excited, where what the others did is not its answer; else None.

    On a multirotor, whose axes hardly couple, the one that was swept; on others the one whose command moves.
    """
    if not structure.base_.alone or not spectra:
        return None
    records = [one.segment.record for one in spectra]
    told = {record.axis for record in records}
    moves = rms_of_commands(spectra, len(structure.commands)) >= LEAST_COMMAND
    moving = {axis for axis, moved in zip(structure.base_.axes, moves, strict=True) if moved}
    by_motors = all(record.airframe is Airframe.MULTIROTOR for record in records)
    excited = told if by_motors and None not in told else moving
    if len(excited) != 1 or not excited <= moving:
        return None
    (axis,) = excited
    power = np.sum([np.sum(np.abs(one.Y) ** 2, axis=1) / one.samples for one in spectra], axis=0)
    own = sum(one for name, one in zip(structure.outputs, power, strict=True) if axis_of(name) == axis)
    return axis if own >= OWN_POWER * np.sum(power) else None


def independent_share(spectra: Sequence[Spectrum], commands: int = len(CYCLIC)) -> FloatArray:
    """Share of each command's power, (m,), that the other commands do not explain linearly, pooled over all runs.

    With one noise-free sweep and a controller on, the other axis's command follows the swept one and this is near 0.
    """
    bands = int(max(one.frequency_hz[-1] for one in spectra) / SHARE_BAND_HZ) + 1
    cross = np.zeros((commands, commands, bands), dtype=complex)
    for one in spectra:
        U = one.U[:commands] / np.sqrt(one.samples)
        band = (one.frequency_hz / SHARE_BAND_HZ).astype(int)
        starts = np.concatenate([[0], np.flatnonzero(np.diff(band)) + 1])
        cross[..., band[starts]] += np.add.reduceat(U[:, None] * U.conj(), starts, axis=2)
    power = np.einsum("jjb->jb", cross).real
    size = np.sqrt(np.where(power > 0, power, 1.0))
    unit = (cross / (size[:, None] * size)).transpose(2, 0, 1) + LEAST_SHARE * np.eye(commands)
    own = power / np.einsum("bjj->jb", np.linalg.inv(unit)).real
    return np.asarray(np.sum(own, axis=1) / np.maximum(np.sum(power, axis=1), 1e-300))


@dataclass(frozen=True, slots=True)
class VagueAxis:
    """An axis whose control effectiveness is not known to a quarter of itself."""

    axis: str
    command: str
    relative_error: float
    instead: str
    """What else could be fitted; empty where nothing could."""

    @property
    def known(self) -> str:
        """How well, in words."""
        return f"the effect of {self.command} is known only to {100 * self.relative_error:.0f} % of itself"

    @property
    def refusal(self) -> str:
        """Why it is not identified, and what to fly."""
        fly = f"fly a {self.axis} chirp, longer or with more amplitude"
        return f"{self.axis} axis not identifiable: {self.known}; {fly}{self.instead}"


def vague_axis(model: Model, covariance: FloatArray) -> VagueAxis | None:
    """The first axis that is known only vaguely; None where there is none."""
    structure = model.structure
    for column, name in enumerate(structure.commands):
        if name not in structure.base_.commands and "elevator" not in structure.effects:
            continue  # an effect of its own says how well it is known
        best = min(_relative_error(structure, model.values, column, covariance, hz) for hz in EFFECTIVE_HZ)
        if not best < LARGEST_RELATIVE_ERROR:
            instead = "" if structure.composed else _or_alone(structure, name)
            return VagueAxis(AXIS_OF.get(name, name), name, best, instead)
    return None


def _relative_error(
    structure: Structure, values: FloatArray, column: int, covariance: FloatArray, frequency_hz: float
) -> float:
    """Of what one command does to the measured state that shows it best; infinite where it does nothing."""
    size, slopes = _effectiveness(structure, values, column, frequency_hz)
    spread = np.sqrt(np.maximum(np.einsum("ip,pq,iq->i", slopes, covariance, slopes), 0))
    known = size > 0
    return float(np.min(spread[known] / size[known], initial=np.inf))


def _effectiveness(
    structure: Structure, values: FloatArray, column: int, frequency_hz: float
) -> tuple[FloatArray, FloatArray]:
    """What one command does to the measured states: entries (k,) and their slopes (k, parameters).

    Servo states stand between command and base, so a response is taken instead of B.
    """
    here, moved = linearised(structure, values)
    s = 2j * np.pi * frequency_hz
    n = len(here.A)

    def reach(A: AnyArray, B: AnyArray) -> AnyArray:
        return np.linalg.solve(s * np.eye(n) - A, B[..., column : column + 1])[..., 0]

    base = reach(here.A, here.B)
    R = np.linalg.inv(s * np.eye(n) - here.A)
    slopes = (R @ (moved.A @ base[:, None] + moved.B[..., column : column + 1]))[..., 0]
    at = [structure.states.index(name) for name in structure.outputs]
    size = np.abs(base[at])
    return size, np.real(slopes[:, at] * base[at].conj() / np.maximum(size, 1e-300)).T
