"""What a structure predicts on the Fourier bins of flown runs: outputs, sensitivities, and the columns of end states.

Linear structures go through their discretised matrices in modal form, exact for held commands. Delay, play and limits
act on the commands before. Terms with products, powers or wandering coefficients are found by relaxation: the linear
part answers the rest as if it were an input, evaluated on the whole time history, until nothing changes.
All arrays have the bins last, so that rows of real numbers are views of rows of complex ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sysid.model import FloatArray, Structure, discretise, stepped
from sysid.preprocess import ComplexArray, Spectrum

if TYPE_CHECKING:
    from sysid.polynomial import Sampling

WORST_MODAL_CONDITION = 1e7
RELAXATION_HZ = 30.0
RELAXATIONS = 40
RELAXED = 1e-7
STEP = 1e-4
FEWEST_BINS = 60


class RelaxationError(ArithmeticError):
    """The nonlinear response does not settle at these values."""


@dataclass(frozen=True, eq=False)
class Stack:
    """The bins of all segments of one sample rate, side by side."""

    spectra: tuple[Spectrum, ...]
    dt: float
    slices: tuple[slice, ...]
    """Where each segment's bins lie."""
    frequency_hz: FloatArray
    """(bins,)"""
    z: ComplexArray
    """(bins,)"""
    U: ComplexArray
    """(m, bins)"""
    Y: ComplexArray
    """(k, bins)"""
    inputs: tuple[str, ...]
    """Names of the rows of U."""
    scale: FloatArray
    """(bins,): sqrt(2/n) of each bin's segment, which makes every sample of every run count the same."""
    _known: dict[int, Sampling] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        return sum(one.samples for one in self.spectra)

    def thinned(self, every: int) -> Stack:
        """Every so many bins of each segment, at least FEWEST_BINS: enough for a first look."""
        kept, slices, length = [], [], 0
        for part in self.slices:
            size = part.stop - part.start
            some = np.arange(part.start, part.stop, max(1, min(every, size // FEWEST_BINS)))
            kept.append(some)
            slices.append(slice(length, length + some.size))
            length += some.size
        at = np.concatenate(kept)
        return Stack(
            self.spectra,
            self.dt,
            tuple(slices),
            self.frequency_hz[at],
            self.z[at],
            self.U[:, at],
            self.Y[:, at],
            self.inputs,
            self.scale[at],
        )

    def sampling(self, order: int) -> Sampling:
        """What holding and sampling do on these bins; worked out once."""
        if order not in self._known:
            from sysid.polynomial import sampling

            self._known[order] = sampling(self, order)
        return self._known[order]


class Response(NamedTuple):
    """Model outputs Y (k, bins), end-state columns E (n, k, bins), sensitivities J (coefficients, k, bins) or None.

    The sensitivities to the parameters are `to` (parameters, coefficients) times J, or J itself where `to` is None.
    """

    Y: ComplexArray
    E: ComplexArray
    J: ComplexArray | None
    to: FloatArray | None = None


def stack(spectra: Sequence[Spectrum]) -> list[Stack]:
    """Segments of equal sample spacing together."""
    groups: list[list[Spectrum]] = []
    for one in spectra:
        for group in groups:
            if abs(group[0].dt - one.dt) < 1e-6 * one.dt:
                group.append(one)
                break
        else:
            groups.append([one])
    return [_stacked(group) for group in groups]


def _stacked(group: Sequence[Spectrum]) -> Stack:
    ends = np.cumsum([one.frequency_hz.size for one in group])
    slices = tuple(slice(int(end) - one.frequency_hz.size, int(end)) for end, one in zip(ends, group, strict=True))
    return Stack(
        tuple(group),
        float(np.mean([one.dt for one in group])),
        slices,
        np.concatenate([one.frequency_hz for one in group]),
        np.concatenate([one.z for one in group]),
        np.concatenate([one.U for one in group], axis=1),
        np.concatenate([one.Y for one in group], axis=1),
        group[0].inputs,
        np.concatenate([np.full(one.frequency_hz.size, np.sqrt(2 / one.samples)) for one in group]),
    )


def respond(
    structure: Structure, values: FloatArray, stack: Stack, sensitivities: bool, U: ComplexArray | None = None
) -> Response:
    """Predict a stack's outputs. `U` (m, bins) stands in for the logged inputs, for sensitivities to instruments."""
    if not _linear_dynamics(structure):
        return _relaxed(structure, values, stack, sensitivities)
    if U is None:
        U = stack.U
    if stack.inputs != structure.inputs:
        U = U[[stack.inputs.index(name) for name in structure.inputs]]
    if not structure.composed:
        from sysid import polynomial

        if polynomial.exact_enough(stack):
            return polynomial.respond(structure, values, stack, sensitivities, U)
    acting, changes = _commands(structure, values, stack, U, sensitivities)
    return _linear(structure, values, stack, acting, changes, sensitivities)


def _linear_dynamics(structure: Structure) -> bool:
    return all(effect.linear or effect.samples is not None for effect in structure.composed)


# ------------------------------------------------------------------------------------------------ the linear part


def _linear(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    U: ComplexArray,
    changes: dict[int, ComplexArray],
    sensitivities: bool,
) -> Response:
    """Response to acting inputs U; `changes` are their own derivatives to some parameters."""
    parameters = stepped(values) if sensitivities else values[None, :].astype(complex)
    matrices = structure.matrices(parameters)
    Ads, Bds = discretise(matrices.A, matrices.B, stack.dt)
    Ad, Bd, C, D = Ads[0].real, Bds[0].real, matrices.C[0].real, matrices.D[0].real
    mu, V = np.linalg.eig(Ad)
    if np.linalg.cond(V) > WORST_MODAL_CONDITION:
        # equal poles that do not part: nudge the matrix by far less than any estimate resolves
        n = Ad.shape[0]
        mu, V = np.linalg.eig(Ad + np.diag(np.arange(n)) * 1e-9)
    W = np.linalg.inv(V)
    poles = 1 / (stack.z - mu[:, None])
    CV = C @ V
    X = (W @ Bd @ U) * poles
    Y = CV @ X + D @ U
    n, k = Ad.shape[0], C.shape[0]
    ends = (CV.T[:, :, None] * W[:, None, :]).transpose(2, 1, 0).reshape(n * k, n)
    E = (ends @ (poles * stack.z)).reshape(n, k, -1)
    if not sensitivities:
        return Response(Y, E, None)
    count = values.size
    h = 1e-30
    dA, dB = Ads.imag / h, Bds.imag / h
    dC, dD = matrices.C.imag / h, matrices.D.imag / h
    drive = np.concatenate([W @ dA @ V, W @ dB], axis=2).reshape(count * n, -1)
    inner = (drive @ np.concatenate([X, U])).reshape(count, n, -1) * poles
    J = CV @ inner
    if np.any(dC) or np.any(dD):
        J = J + (dC @ V) @ X + dD @ U
    for index, dU in changes.items():
        J[index] += CV @ ((W @ Bd @ dU) * poles) + D @ dU
    return Response(Y, E, J)


# ------------------------------------------------------------------------------------------------ commands in time


def _commands(
    structure: Structure, values: FloatArray, stack: Stack, logged: ComplexArray, sensitivities: bool
) -> tuple[ComplexArray, dict[int, ComplexArray]]:
    """Inputs as they act after delay, play and limits, and their derivatives to those effects' parameters."""
    outside = [one for one in structure.composed if one.samples is not None or one.response is not None]
    if not outside:
        return logged, {}
    names = [name for one in outside for name in one.names]
    named = dict(zip(structure.names, values, strict=True))
    acting = _acting(structure, named, stack, logged)
    changes: dict[int, ComplexArray] = {}
    if sensitivities:
        for name in names:
            index = structure.names.index(name)
            parameter = structure.parameters[index]
            step = STEP * max(abs(named[name]), 1e-2 * abs(parameter.typical))
            above = _acting(structure, {**named, name: named[name] + step}, stack, logged)
            below_at = max(named[name] - step, parameter.bounds[0])
            below = _acting(structure, {**named, name: below_at}, stack, logged)
            changes[index] = (above - below) / (named[name] + step - below_at)
    return acting, changes


def _acting(structure: Structure, named: dict[str, float], stack: Stack, logged: ComplexArray) -> ComplexArray:
    """Commands after the effects that no matrix holds; other inputs pass."""
    commands = len(structure.commands)
    acting = logged.copy()
    sequential = [one for one in structure.composed if one.samples is not None]
    if sequential:
        for one, part in zip(stack.spectra, stack.slices, strict=True):
            raw = np.stack([one.segment.channels[name] for name in structure.commands])
            for effect in sequential:
                assert effect.samples is not None
                raw = effect.samples(raw, one.dt, {name: named[name] for name in effect.names})
            acting[:commands, part] = one.transform(raw)
    s = 2j * np.pi * stack.frequency_hz
    for effect in structure.composed:
        if effect.response is not None:
            acting[:commands] *= effect.response(s, {name: named[name] for name in effect.names})
    return acting


# ------------------------------------------------------------------------------------------------ relaxation


def _relaxed(structure: Structure, values: FloatArray, stack: Stack, sensitivities: bool) -> Response:
    """Nonlinear or time-varying dynamics: the values and a step of each parameter, relaxed side by side."""
    steps = np.array(
        [STEP * max(abs(v), 1e-2 * abs(p.typical)) for v, p in zip(values, structure.parameters, strict=True)]
    )
    batch = values[None, :]
    if sensitivities:
        batch = np.concatenate([batch, values + np.diag(steps)])
    Y = np.empty((batch.shape[0], len(structure.outputs), stack.z.size), dtype=complex)
    E = np.empty((len(structure.states), len(structure.outputs), stack.z.size), dtype=complex)
    for one, part in zip(stack.spectra, stack.slices, strict=True):
        Y[..., part], E[..., part] = _relax(structure, batch, one)
    J = (Y[1:] - Y[0]) / steps[:, None, None] if sensitivities else None
    return Response(Y[0], E, J)


def _relax(structure: Structure, batch: FloatArray, one: Spectrum) -> tuple[ComplexArray, ComplexArray]:
    """One segment: Y (batch, k, bins) and E (n, k, bins)."""
    from scipy.fft import irfft, next_fast_len, rfft

    segment, n, m = one.segment, len(structure.states), len(structure.commands)
    length = segment.samples * segment.dt
    wide = max(RELAXATION_HZ, float(one.frequency_hz[-1]))
    bins = min(int(wide * length), (segment.samples - 1) // 2)
    grid = next_fast_len(4 * bins)
    s = 2j * np.pi * np.arange(bins + 1) / length
    hold = np.sinc(np.arange(bins + 1) / segment.samples) * np.exp(-0.5 * s * segment.dt)

    def histories(names: Sequence[str], centred: bool) -> tuple[ComplexArray, FloatArray]:
        rows = np.stack([segment.channels[name] for name in names]) if names else np.zeros((0, segment.samples))
        spectrum = rfft(rows, axis=1)[:, : bins + 1]
        if centred:
            spectrum[:, 0] = 0
        return spectrum, irfft(spectrum, grid, axis=1) * (grid / segment.samples)

    U, u = histories(structure.commands, True)
    _, channels = histories(structure.channels, False)
    A, B, _, _ = structure.matrices(batch[0])
    transfer = np.linalg.inv(s[1:, None, None] * np.eye(n) - A)  # (bins, n, n)
    forced = np.zeros((n, bins + 1), dtype=complex)
    forced[:, 1:] = (transfer @ (B[:, :m] @ (U * hold)[:, 1:]).T[:, :, None])[:, :, 0].T
    C = np.eye(2, n)
    first = round(float(one.frequency_hz[0]) * length)
    inside = slice(first, first + one.frequency_hz.size)
    E = (C @ transfer[inside.start - 1 : inside.stop - 1]).transpose(2, 1, 0)
    rows = E.reshape(n, -1).view(float)
    parameters = {name: batch[:, i, None] for i, name in enumerate(structure.names)}
    X = np.broadcast_to(forced, (batch.shape[0], n, bins + 1)).copy()
    outputs = np.zeros((batch.shape[0], 2, bins + 1), dtype=complex)
    last = np.inf
    for _ in range(RELAXATIONS):
        # the free motion from the run's end states, as the measured rates show it
        rest = (
            (one.Y - outputs[:1, :, inside][0] if np.any(outputs) else one.Y - X[0, :2, inside]).reshape(-1).view(float)
        )
        ends, *_ = np.linalg.lstsq(rows.T, rest, rcond=1e-8)
        free = np.zeros((n, bins + 1), dtype=complex)
        free[:, 1:] = (transfer @ ends).T
        x = irfft(X + free, grid, axis=2) * (grid / segment.samples)
        signals = {
            **{name: x[:, i] for i, name in enumerate(structure.states)},
            **{name: u[i] for i, name in enumerate(structure.commands)},
            **{name: channels[i] for i, name in enumerate(structure.channels)},
        }
        rates, measured = structure.evaluate(parameters, signals)
        shape = x[:, 0].shape
        rhs = np.stack([np.broadcast_to(rates[f"{state}_dot"], shape) for state in structure.states], axis=1)
        other = rfft(rhs - A @ x - B[:, :m] @ u, axis=2)[:, :, : bins + 1] * (segment.samples / grid)
        new = forced + np.concatenate(
            [
                np.zeros((batch.shape[0], n, 1)),
                (transfer @ other[:, :, 1:].transpose(0, 2, 1)[..., None])[..., 0].transpose(0, 2, 1),
            ],
            axis=2,
        )
        change = float(np.max(np.abs(new - X)) / max(float(np.max(np.abs(new))), 1e-300))
        if not np.isfinite(change) or change > 1e3:
            raise RelaxationError("the response grows without limit")
        X = new
        y = np.stack([np.broadcast_to(measured[name], shape) for name in structure.outputs], axis=1)
        outputs = rfft(y, axis=2)[:, :, : bins + 1] * (segment.samples / grid) - (C @ free)
        if change < RELAXED:
            break
        if change > 2 * last and change > 0.1:
            raise RelaxationError("the response does not settle")
        last = min(last, change)
    return outputs[:, :, inside], E
