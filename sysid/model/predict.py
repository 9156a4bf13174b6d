"""What a structure predicts on the Fourier bins of flown runs: outputs, sensitivities, and the columns of end states.

Linear structures go through their discretised matrices in modal form, exact for held commands: those of the vehicle's
loop, and those of a sample for the free motion, which is seen from sample to sample. Delay, play and limits act on the
commands before (`acting`); what is not linear is found by `relaxation`.
Inputs that stand in for the logged ones, for instruments, go through all of this as the logged ones do.
All arrays have the bins last, so that rows of real numbers are views of rows of complex ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.model import polynomial
from sysid.model.acting import acting_commands, divided, linear_dynamics
from sysid.model.modal import Modes
from sysid.model.relaxation import driven_by, relaxed_response
from sysid.model.response import Ends, Response
from sysid.model.structure import COMPLEX_STEP, FloatArray, Structure, stepped

BLOCK = 512
"""Bins whose sensitivities are worked out together: what lies between stays in the processor's cache."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def respond(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    sensitivities: bool,
    U: ComplexArray | None = None,
    ends: Ends | None = None,
    of: Sequence[int] | None = None,
) -> Response:
    """Predict a stack's outputs. `U` (m, bins) stands in for the logged inputs, for sensitivities to instruments.

    `of` numbers the parameters whose sensitivities are wanted, where not all are; a closed form gives all the same.
    The free motion from `ends`, the last estimate of them, counts in the sensitivities: it changes with the parameters.
    Of a model that runs away, or that has no response, what comes out is not finite.
    """
    if not linear_dynamics(structure):
        return relaxed_response(structure, values, stack, sensitivities=sensitivities, U=U, of=of)
    if U is not None and divided(structure)[0]:
        runs = zip(stack.spectra, stack.slices, strict=True)
        stack = replace(stack, spectra=tuple(driven_by(one, U[:, part]) for one, part in runs))
    if U is None:
        U = stack.U
    if stack.inputs != structure.inputs:
        U = U[[stack.inputs.index(name) for name in structure.inputs]]
    if polynomial.closed_form(structure) is not None and polynomial.exact_enough(stack):
        return polynomial.respond(structure, values, stack, sensitivities=sensitivities, U=U, ends=ends)
    wanted = structure.names if of is None else tuple(structure.names[i] for i in of)
    return _linear_behind(structure, values, stack, U, wanted=wanted, sensitivities=sensitivities, ends=ends)


def _linear_behind(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    U: ComplexArray,
    *,
    wanted: tuple[str, ...],
    sensitivities: bool,
    ends: Ends | None,
) -> Response:
    """The response of linear dynamics behind what acts on the commands' samples and delays, to logged inputs U, with
    its sensitivities to the parameters `wanted`."""
    front, rest = divided(structure)
    moving = wanted if sensitivities else ()
    acting, changes = acting_commands(structure, front, values, stack=stack, logged=U, moving=moving)
    inner = np.array([values[structure.names.index(name)] for name in rest.names])
    here = [name for name in wanted if name in rest.names]
    found = _linear(
        rest,
        inner,
        stack,
        U=acting,
        changes=list(changes.values()),
        sensitivities=sensitivities,
        initial=ends,
        of=[rest.names.index(name) for name in here] if len(here) < len(rest.names) else None,
    )
    if found.J is None or (wanted == rest.names and not changes):
        return found
    J = np.zeros((len(wanted), *found.J.shape[1:]), dtype=complex)
    J[[wanted.index(name) for name in here]] = found.J[: len(here)]
    J[[wanted.index(name) for name in changes]] += found.J[len(here) :]
    return replace(found, J=J)


class _Answering(NamedTuple):
    """A linear structure at its values, in modal form: all of a response that the bins have no part in."""

    modes: Modes
    C: FloatArray
    D: FloatArray
    held: ComplexArray
    """(n, m), from inputs, held for the modes' time, to modes."""
    slopes: _Slopes | None


class _Slopes(NamedTuple):
    """What each parameter moves."""

    turned: ComplexArray
    """(parameters, n, n), between modes;"""
    drive: ComplexArray
    """(parameters, n, n + m), from modes and inputs to modes over the time that inputs are held;"""
    C: FloatArray
    D: FloatArray


@lru_cache(maxsize=64)
def _answering(structure: Structure, values: tuple[float, ...], held_s: float, sensitivities: bool) -> _Answering:
    """Kept: fits, instruments and comparisons ask the same numbers on other bins and of other inputs."""
    at = np.array(values)
    matrices = structure.matrices(stepped(at) if sensitivities else at[None, :].astype(complex))
    A, B, C, D = (x[0].real for x in matrices)
    modes = Modes.of(A, held_s)
    W, WB, held = modes.W, modes.W @ B, modes.held[:, None]
    if not sensitivities:
        return _Answering(modes, C, D, held * WB, None)
    dA, dB, dC, dD = (x.imag / COMPLEX_STEP for x in matrices)
    turned = W @ dA @ modes.V
    drive = np.concatenate([turned * modes.moved, (turned * modes.held_moved) @ WB + held * (W @ dB)], axis=2)
    return _Answering(modes, C, D, held * WB, _Slopes(turned, drive, dC, dD))


def _linear(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    U: ComplexArray,
    changes: Sequence[ComplexArray],
    sensitivities: bool,
    initial: Ends | None = None,
    of: Sequence[int] | None = None,
) -> Response:
    """Response to acting inputs U, and to each of the `changes` of them, which stand behind the parameters in J: `of`
    these numbers, or all."""
    modes, C, D, held, slopes = _answering(structure, tuple(values.tolist()), stack.held_s, sensitivities)
    sampled = modes.sampled(stack.dt) if stack.thinned_log else modes
    V, W = modes.V, modes.W
    poles = 1 / (stack.z_held - modes.factor[:, None])
    free = 1 / (stack.z - sampled.factor[:, None]) if stack.thinned_log else poles
    CV = C @ V
    X = (held @ U) * poles
    Y = CV @ X + D @ U

    def end_columns() -> ComplexArray:
        n, k = len(V), len(C)
        to = (CV.T[:, :, None] * W[:, None, :]).transpose(2, 1, 0).reshape(n * k, n)
        return np.asarray((to @ (free * stack.z)).reshape(n, k, -1))

    if slopes is None:
        return Response(Y, end_columns, None)
    if of is not None:
        slopes = _Slopes(turned=slopes.turned[of], drive=slopes.drive[of], C=slopes.C[of], D=slopes.D[of])
    freely = None if initial is None else _free_motion(stack, free, W, initial)
    driven, X = X, X if freely is None else X + freely
    J = np.empty((len(slopes.drive), *Y.shape), dtype=complex)
    moves = np.any(slopes.turned, axis=(1, 2))
    ways = [(slopes.drive[moves], np.concatenate([driven if stack.thinned_log else X, U]), poles)]
    if freely is not None and stack.thinned_log:  # free motion goes on from sample to sample of the log
        ways.append((slopes.turned[moves] * sampled.moved, freely, free))
    _fill_with_moved(J, np.flatnonzero(moves), CV, ways)
    J[~moves] = _by_inputs(CV, slopes.drive[~moves][:, :, len(V) :], poles, U)
    if np.any(slopes.C) or np.any(slopes.D):
        J = J + (slopes.C @ V) @ X + slopes.D @ U
    if changes:
        J = np.concatenate([J, [CV @ ((held @ dU) * poles) + D @ dU for dU in changes]])
    return Response(Y, end_columns, J)


def _fill_with_moved(
    J: ComplexArray,
    numbers: NDArray[np.intp],
    CV: ComplexArray,
    ways: Sequence[tuple[ComplexArray, ComplexArray, ComplexArray]],
) -> None:
    """Into J (all, k, bins), at these numbers, CV (k, n) times the sum over `ways` of drives (numbers, n, r) times what
    drives (r, bins), through the modes (n, bins). Block by block: what lies between is many times the size of what
    comes out."""
    count, n, _ = ways[0][0].shape
    size = J.shape[2]
    for part in (slice(begin, begin + BLOCK) for begin in range(0, size if count else 0, BLOCK)):
        inner = [
            (drive.reshape(count * n, len(moving)) @ moving[:, part]).reshape(count, n, -1) * poles[:, part]
            for drive, moving, poles in ways
        ]
        J[numbers, :, part] = CV @ reduce(np.add, inner)


def _by_inputs(CV: ComplexArray, drive: ComplexArray, poles: ComplexArray, U: ComplexArray) -> ComplexArray:
    """What parameters change that move no mode, but what inputs U (m, bins) do to the modes by `drive` (parameters, n,
    m); (parameters, k, bins). Most move one input alone."""
    found = np.zeros((len(drive), len(CV), U.shape[1]), dtype=complex)
    for column, one in zip(drive.transpose(2, 0, 1), U, strict=True):
        here = np.any(column, axis=1)
        if np.any(here):
            through = (CV * column[here, None]).reshape(-1, CV.shape[1]) @ poles
            found[here] += through.reshape(-1, *found.shape[1:]) * one
    return found


def _free_motion(stack: Stack, poles: ComplexArray, W: ComplexArray, initial: Ends) -> ComplexArray:
    """What end states let the modes do, (n, bins); W (n, n) makes modes of states."""
    motion = poles * stack.z
    for part, difference in zip(stack.slices, initial, strict=True):
        motion[:, part] *= (W @ difference)[:, None]
    return motion
