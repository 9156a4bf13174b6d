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
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.model import polynomial
from sysid.model.acting import acting_commands, divided, linear_dynamics
from sysid.model.modal import Modes
from sysid.model.monomials import linearised
from sysid.model.relaxation import driven_by, relaxed_response
from sysid.model.response import Ends, Response
from sysid.model.structure import FloatArray, Matrices, Structure

BLOCK = 512
"""Bins whose sensitivities are worked out together: what lies between stays in the processor's cache."""
KEPT = 16
"""Responses to logged inputs: of the few candidates that are looked at in turn."""


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
    if of is not None and len(of) == len(structure.names):
        of = None
    if U is None and ends is None:
        numbers = None if of is None else tuple(of)
        return _as_logged(structure, tuple(values.tolist()), stack, sensitivities, numbers)
    return _worked_out(structure, values, stack, (sensitivities, of), U, ends)


@lru_cache(maxsize=KEPT)
def _as_logged(
    structure: Structure, values: tuple[float, ...], stack: Stack, sensitivities: bool, of: tuple[int, ...] | None
) -> Response:
    """Kept: what ends a fit, judges it and compares it asks the same again; nobody changes what comes out."""
    return _worked_out(structure, np.array(values), stack, (sensitivities, of))


_Wanted = tuple[bool, Sequence[int] | None]
"""Whether sensitivities are, and to the parameters of which numbers, where not to all."""


def _worked_out(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    what: _Wanted,
    U: ComplexArray | None = None,
    ends: Ends | None = None,
) -> Response:
    """`respond`, whatever is known already."""
    sensitivities, of = what
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
    inner = values[[structure.names.index(name) for name in rest.names]] if front else values
    here = [name for name in wanted if name in rest.names]
    numbers = tuple(rest.names.index(name) for name in here) if sensitivities else None
    found = _linear(rest, inner, stack, U=acting, changes=list(changes.values()), of=numbers, initial=ends)
    if found.J is None or (len(here) == len(wanted) and not changes):
        return found
    J = found.J[: len(here)]
    if len(here) < len(wanted):
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
    """(moving, n, n), between modes;"""
    drive: ComplexArray
    """(moving, n, n + m), from modes and inputs to modes over the time that inputs are held;"""
    by_inputs: ComplexArray
    """(still, n, m), from inputs alone;"""
    C: FloatArray
    D: FloatArray
    moving: NDArray[np.intp]
    """Numbers of those that move a mode,"""
    still: NDArray[np.intp]
    """and of those that do not."""
    outside: bool
    """Whether any moves C or D."""


@lru_cache(maxsize=64)
def _modal(structure: Structure, values: tuple[float, ...], held_s: float) -> tuple[Modes, Matrices, Matrices]:
    """Modes, matrices and the derivatives of these: first what is left is asked for, then often the slopes."""
    here, moved = linearised(structure, np.array(values))
    return Modes.of(here.A, held_s), here, moved


@lru_cache(maxsize=64)
def _answering(
    structure: Structure, values: tuple[float, ...], held_s: float, of: tuple[int, ...] | None
) -> _Answering:
    """With slopes to the parameters of these numbers, or with none. Kept: fits, instruments and comparisons ask the
    same numbers on other bins and of other inputs."""
    modes, (_, B, C, D), moved = _modal(structure, values, held_s)
    W, WB, held = modes.W, modes.W @ B, modes.held[:, None]
    if of is None:
        return _Answering(modes, C, D, held * WB, None)
    dA, dB, dC, dD = (x[list(of)] for x in moved)
    moves = dA.any(axis=(1, 2))
    moving, still = np.flatnonzero(moves), np.flatnonzero(~moves)
    turned, driven = W @ dA[moving] @ modes.V, held * (W @ dB)
    drive = np.concatenate([turned * modes.moved, (turned * modes.held_moved) @ WB + driven[moving]], axis=2)
    slopes = _Slopes(turned, drive, driven[still], dC, dD, moving, still, bool(dC.any() or dD.any()))
    return _Answering(modes, C, D, held * WB, slopes)


def _linear(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    *,
    U: ComplexArray,
    changes: Sequence[ComplexArray],
    of: tuple[int, ...] | None,
    initial: Ends | None = None,
) -> Response:
    """Response to acting inputs U, and to each of the `changes` of them, which stand behind the parameters in J: `of`
    these numbers, or no J where that is None."""
    modes, C, D, held, slopes = _answering(structure, tuple(values.tolist()), stack.held_s, of)
    sampled = modes.sampled(stack.dt) if stack.thinned_log else modes
    V, W = modes.V, modes.W
    poles = _over(stack.z_held, modes.factor)
    CV = C @ V
    X = held @ U
    X *= poles
    Y = CV @ X
    if np.any(D):
        Y += D @ U

    @cache
    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def free() -> ComplexArray:
        return _over(stack.z, sampled.factor) if stack.thinned_log else poles

    def end_columns() -> ComplexArray:
        n, k = len(V), len(C)
        to = (CV.T[:, :, None] * W[:, None, :]).transpose(2, 1, 0).reshape(n * k, n)
        return np.asarray((to @ (free() * stack.z)).reshape(n, k, -1))

    if slopes is None:
        return Response(Y, end_columns, None)
    freely = None if initial is None else _free_motion(stack, free(), W, initial)
    driven, X = X, X if freely is None else X + freely
    count, still = len(slopes.C), slopes.still
    J = np.empty((count + len(changes), *Y.shape), dtype=complex)
    ways = [(slopes.drive, np.concatenate([driven if stack.thinned_log else X, U]), poles)]
    if freely is not None and stack.thinned_log:  # free motion goes on from sample to sample of the log
        ways.append((slopes.turned * sampled.moved, freely, free()))
    _fill_with_moved(J, slopes.moving, CV, ways)
    if still.size:
        J[still] = _by_inputs(CV, slopes.by_inputs, poles, U)
    if slopes.outside:
        J[:count] += (slopes.C @ V) @ X + slopes.D @ U
    for row, dU in zip(J[count:], changes, strict=True):
        row[...] = CV @ ((held @ dU) * poles) + D @ dU
    return Response(Y, end_columns, J)


def _over(z: ComplexArray, factor: ComplexArray) -> ComplexArray:
    """1 / (z - factor), of bins z and modes' factors: (n, bins)."""
    apart = z - factor[:, None]
    return np.asarray(np.reciprocal(apart, out=apart))


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
            (drive.reshape(count * n, len(moving)) @ moving[:, part]).reshape(count, n, -1) for drive, moving, _ in ways
        ]
        for one, (_, _, poles) in zip(inner, ways, strict=True):
            one *= poles[:, part]
        for one in inner[1:]:
            inner[0] += one
        J[numbers, :, part] = CV @ inner[0]


def _by_inputs(CV: ComplexArray, drive: ComplexArray, poles: ComplexArray, U: ComplexArray) -> ComplexArray:
    """What parameters change that move no mode, but what inputs U (m, bins) do to the modes by `drive` (parameters, n,
    m); (parameters, k, bins). Most move one input alone."""
    found = np.zeros((len(drive), len(CV), U.shape[1]), dtype=complex)
    for column, one, moves in zip(drive.transpose(2, 0, 1), U, np.any(drive, axis=1).T, strict=True):
        here = np.flatnonzero(moves)
        if here.size:
            through = (CV * column[here, None]).reshape(-1, CV.shape[1]) @ poles
            found[here] += through.reshape(-1, *found.shape[1:]) * one
    return found


def _free_motion(stack: Stack, poles: ComplexArray, W: ComplexArray, initial: Ends) -> ComplexArray:
    """What end states let the modes do, (n, bins); W (n, n) makes modes of states."""
    motion = poles * stack.z
    for part, difference in zip(stack.slices, initial, strict=True):
        motion[:, part] *= (W @ difference)[:, None]
    return motion
