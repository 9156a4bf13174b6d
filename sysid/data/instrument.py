"""The logged excitation as an instrument: estimates that feedback does not bias.

With a controller on, gusts reach the commands, and least squares takes a little of them for the vehicle's answer. What
the excitation alone did to the commands carries no gust; sensitivities to that part ask the residual only what the
excitation can answer. Soederstrom and Stoica's instrumental-variable method, in the Fourier domain. For nonlinear
effects the sensitivities are those of the vehicle as that part alone would move it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.preprocess import EXCITATIONS, ComplexArray, excitation_of
from sysid.data.record import CYCLIC, FloatArray
from sysid.data.stacks import Stack

FOLLOWING = ("alpha", "beta", "phi", "theta")
"""Channels that follow the vehicle's own motion, and with it what gusts do to it."""
CYCLIC_EXCITATIONS = tuple(excitation_of(name) for name in CYCLIC)
WINDOW_HZ = 0.5
"""Within it the closed loop from excitation to command counts as one complex gain."""


def instruments(stacks: Sequence[Stack], commands: Sequence[str]) -> list[ComplexArray] | None:
    """For every stack the inputs (m, bins) as far as the excitation caused them; those from outside as logged.

    Commands and channels that follow the motion are caused; rotor speed, airspeed and yaw come from outside.

    None where the excitation was not logged on every run, or rests in one. Of a command that none excited only what the
    others' did through the feedback counts as caused.
    """
    found = []
    for stack in stacks:
        names = [name for name in EXCITATIONS if all(name in one.segment.channels for one in stack.spectra)]
        wanted = [excitation_of(command) for command in commands]
        if not set(wanted) <= set(names):
            return None
        R: ComplexArray = np.concatenate(
            [one.transform(np.stack([one.segment.channels[name] for name in wanted])) for one in stack.spectra], axis=1
        )
        if not all(np.any(R[:, part]) for part in stack.slices) and not np.all(np.any(R, axis=1)):
            return None
        rows = [i for i, name in enumerate(stack.inputs) if name in commands or name in FOLLOWING]
        caused = stack.U.copy()
        caused[rows] = caused_by(stack.U[rows], R, stack.scale, stack.frequency_hz)
        found.append(caused)
    return found


def caused_by(U: ComplexArray, R: ComplexArray, scale: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """The part of U (m, bins) that R (r, bins) explains linearly, window by window of frequency, all runs together."""
    caused = np.zeros_like(U)
    order = np.argsort(frequency_hz, kind="stable")
    edges = np.arange(0.0, frequency_hz[order[-1]] + WINDOW_HZ, WINDOW_HZ)
    starts = np.searchsorted(frequency_hz[order], edges)
    windows = [here for here in np.split(order, starts[1:]) if here.size]
    r, u = ([scale[here] * rows[:, here] for here in windows] for rows in (R, U))
    power = np.array([one @ one.conj().T for one in r])
    for here, mine, its, inverse in zip(windows, u, r, np.linalg.pinv(power, rcond=1e-9, hermitian=True), strict=True):
        caused[:, here] = ((mine @ its.conj().T) @ inverse) @ R[:, here]
    return caused


@dataclass(frozen=True, eq=False)
class Causes:
    """Commands on all bins of all stacks, as far as what was logged beside them caused them."""

    commands: tuple[str, ...]
    references: tuple[str, ...]
    caused: list[ComplexArray]
    """For every stack (m, bins)."""
    reference: list[ComplexArray]
    """The bins of the references, for every stack (m, bins)."""


def causes(stacks: Sequence[Stack], commands: Sequence[str], references: Sequence[str] | None = None) -> Causes:
    """What the excitation caused in each command that the stacks have among their inputs.

    `references` are those of all runs where these are some of them: an excitation that rests in some says that nothing
    but feedback moved its command there.
    """
    whole = [one.segment.channels for group in stacks for one in group.spectra]
    references = list(references or (_reference(name, whole) for name in commands))
    found, logged = [], []
    for group in stacks:
        U = group.U[[group.inputs.index(name) for name in commands]]
        R = np.concatenate(
            [one.transform(np.stack([one.segment.channels[name] for name in references])) for one in group.spectra],
            axis=1,
        )
        if R.shape[1] != U.shape[1]:
            raise ValueError("causes want whole stacks, not thinned ones")
        found.append(caused_by(U, R, group.scale, group.frequency_hz))
        logged.append(R)
    return Causes(tuple(commands), tuple(references), found, logged)


def _reference(command: str, runs: Sequence[Mapping[str, FloatArray]]) -> str:
    """The excitation of a command where every run has its channel, and it moves in any or another in each; else the
    command itself, which somebody may have moved by hand."""
    excitation = excitation_of(command)
    if not all(excitation in one for one in runs):
        return command
    if command in CYCLIC and all(any(np.any(one[name]) for name in CYCLIC_EXCITATIONS if name in one) for one in runs):
        return excitation
    return excitation if any(np.any(one[excitation]) for one in runs) else command
