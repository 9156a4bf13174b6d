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

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.model import polynomial
from sysid.model.acting import acting_commands, divided, linear_dynamics
from sysid.model.relaxation import driven_by, relaxed_response
from sysid.model.response import Ends, Response
from sysid.model.structure import FloatArray, Structure, discretise, stepped

WORST_MODAL_CONDITION = 1e7


def respond(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    sensitivities: bool,
    U: ComplexArray | None = None,
    ends: Ends | None = None,
) -> Response:
    """Predict a stack's outputs. `U` (m, bins) stands in for the logged inputs, for sensitivities to instruments.

    The free motion from `ends`, the last estimate of them, counts in the sensitivities: it changes with the parameters.
    """
    if not linear_dynamics(structure):
        return relaxed_response(structure, values, stack, sensitivities, U)
    front, rest = divided(structure)
    if U is not None and front:
        runs = zip(stack.spectra, stack.slices, strict=True)
        stack = replace(stack, spectra=tuple(driven_by(one, U[:, part]) for one, part in runs))
    if U is None:
        U = stack.U
    if stack.inputs != structure.inputs:
        U = U[[stack.inputs.index(name) for name in structure.inputs]]
    if polynomial.closed_form(structure) is not None and polynomial.exact_enough(stack):
        return polynomial.respond(structure, values, stack, sensitivities=sensitivities, U=U, ends=ends)
    acting, changes = acting_commands(structure, front, values, stack=stack, logged=U, sensitivities=sensitivities)
    inner = np.array([values[structure.names.index(name)] for name in rest.names])
    found = _linear(
        rest, inner, stack, U=acting, changes=list(changes.values()), sensitivities=sensitivities, initial=ends
    )
    if found.J is None or (structure.names == rest.names and not changes):
        return found
    J = np.zeros((values.size, *found.J.shape[1:]), dtype=complex)
    J[[structure.names.index(name) for name in rest.names]] = found.J[: inner.size]
    J[[structure.names.index(name) for name in changes]] += found.J[inner.size :]
    return Response(found.Y, found.E, J)


def _linear(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    U: ComplexArray,
    changes: Sequence[ComplexArray],
    sensitivities: bool,
    initial: Ends | None = None,
) -> Response:
    """Response to acting inputs U, and to each of the `changes` of them, which stand behind the parameters in J."""
    parameters = stepped(values) if sensitivities else values[None, :].astype(complex)
    matrices = structure.matrices(parameters)
    Ads, Bds = discretise(matrices.A, matrices.B, stack.held_s)
    samples = discretise(matrices.A, matrices.B, stack.dt)[0] if stack.thinned_log else Ads
    Ad, Bd, C, D = Ads[0].real, Bds[0].real, matrices.C[0].real, matrices.D[0].real
    mu, V = np.linalg.eig(Ad)
    if np.linalg.cond(V) > WORST_MODAL_CONDITION:
        # equal poles that do not part: nudge the matrix by far less than any estimate resolves
        n = Ad.shape[0]
        mu, V = np.linalg.eig(Ad + np.diag(np.arange(n)) * 1e-9)
    W = np.linalg.inv(V)
    poles = 1 / (stack.z_held - mu[:, None])
    free = 1 / (stack.z - np.diag(W @ samples[0].real @ V)[:, None]) if stack.thinned_log else poles
    CV = C @ V
    X = (W @ Bd @ U) * poles
    Y = CV @ X + D @ U
    n, k = Ad.shape[0], C.shape[0]
    ends = (CV.T[:, :, None] * W[:, None, :]).transpose(2, 1, 0).reshape(n * k, n)
    E = (ends @ (free * stack.z)).reshape(n, k, -1)
    if not sensitivities:
        return Response(Y, E, None)
    count = values.size
    h = 1e-30
    dA, dB = Ads.imag / h, Bds.imag / h
    dC, dD = matrices.C.imag / h, matrices.D.imag / h
    drive = np.concatenate([W @ dA @ V, W @ dB], axis=2).reshape(count * n, -1)
    driven, X = X, X if initial is None else X + _free_motion(stack, free, W, initial)
    if stack.thinned_log:
        freely = (W @ (samples.imag / h) @ V).reshape(count * n, -1) @ (X - driven)
        inner = (drive @ np.concatenate([driven, U])).reshape(count, n, -1) * poles
        inner += freely.reshape(count, n, -1) * free
    else:
        inner = (drive @ np.concatenate([X, U])).reshape(count, n, -1) * poles
    J = CV @ inner
    if np.any(dC) or np.any(dD):
        J = J + (dC @ V) @ X + dD @ U
    if changes:
        J = np.concatenate([J, [CV @ ((W @ Bd @ dU) * poles) + D @ dU for dU in changes]])
    return Response(Y, E, J)


def _free_motion(stack: Stack, poles: ComplexArray, W: ComplexArray, initial: Ends) -> ComplexArray:
    """What end states let the modes do, (n, bins); W (n, n) makes modes of states."""
    motion = poles * stack.z
    for part, difference in zip(stack.slices, initial, strict=True):
        motion[:, part] *= (W @ difference)[:, None]
    return motion
