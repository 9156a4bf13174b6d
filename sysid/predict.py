"""What a structure predicts on the Fourier bins of flown runs: outputs, sensitivities, and the columns of end states.

Linear structures go through their discretised matrices in modal form, exact for held commands. Delay, play and limits
act on the commands before. Terms with products, powers or wandering coefficients are found by relaxation: the linear
part answers the rest as if it were an input, evaluated on the whole time history, until nothing changes.
All arrays have the bins last, so that rows of real numbers are views of rows of complex ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sysid.effect import Effect, Signals
from sysid.model import FloatArray, Structure, discretise, stepped
from sysid.preprocess import ComplexArray, Segment, Spectrum

if TYPE_CHECKING:
    from sysid.polynomial import Sampling

WORST_MODAL_CONDITION = 1e7
RELAXATION_HZ = 30.0
RELAXATIONS = 40
RELAXED = 1e-6
STEP = 1e-3
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


Ends = Sequence[FloatArray]
"""For every segment of a stack the differences of first and last state, one for each of the columns E."""


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
    if not _linear_dynamics(structure):
        return _relaxed(structure, values, stack, sensitivities)
    if U is None:
        U = stack.U
    if stack.inputs != structure.inputs:
        U = U[[stack.inputs.index(name) for name in structure.inputs]]
    if not structure.composed:
        from sysid import polynomial

        if polynomial.exact_enough(stack):
            return polynomial.respond(structure, values, stack, sensitivities, U, ends)
    front, rest = divided(structure)
    acting, changes = _commands(structure, front, values, stack, U, sensitivities)
    inner = np.array([values[structure.names.index(name)] for name in rest.names])
    found = _linear(rest, inner, stack, acting, list(changes.values()), sensitivities, ends)
    if found.J is None or (structure.names == rest.names and not changes):
        return found
    J = np.zeros((values.size, *found.J.shape[1:]), dtype=complex)
    J[[structure.names.index(name) for name in rest.names]] = found.J[: inner.size]
    J[[structure.names.index(name) for name in changes]] += found.J[inner.size :]
    return Response(found.Y, found.E, J)


@lru_cache(maxsize=256)
def divided(structure: Structure) -> tuple[tuple[Effect, ...], Structure]:
    """What must act on the commands' samples in time, in order, and the structure of all that follows.

    A servo's lag before play, a limit or a dead band acts in time too. A delay stays behind: it commutes with
    everything that does not depend on time.
    """
    last = max((i for i, one in enumerate(structure.composed) if one.samples is not None), default=-1)
    front = tuple(one for one in structure.composed[: last + 1] if one.samples is not None or one.per_command)
    return front, replace(structure, composed=tuple(one for one in structure.composed if one not in front))


def _linear_dynamics(structure: Structure) -> bool:
    return all(effect.linear or effect.samples is not None for effect in structure.composed)


# ------------------------------------------------------------------------------------------------ the linear part


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
    if initial is not None:
        X = X.copy()
        for part, difference in zip(stack.slices, initial, strict=True):
            X[:, part] += poles[:, part] * stack.z[part] * (W @ difference)[:, None]
    drive = np.concatenate([W @ dA @ V, W @ dB], axis=2).reshape(count * n, -1)
    inner = (drive @ np.concatenate([X, U])).reshape(count, n, -1) * poles
    J = CV @ inner
    if np.any(dC) or np.any(dD):
        J = J + (dC @ V) @ X + dD @ U
    if changes:
        J = np.concatenate([J, [CV @ ((W @ Bd @ dU) * poles) + D @ dU for dU in changes]])
    return Response(Y, E, J)


# ------------------------------------------------------------------------------------------------ commands in time


def _commands(
    structure: Structure,
    front: Sequence[Effect],
    values: FloatArray,
    stack: Stack,
    logged: ComplexArray,
    sensitivities: bool,
) -> tuple[ComplexArray, dict[str, ComplexArray]]:
    """Inputs as they act behind `front` and every delay, and their derivatives to those effects' parameters."""
    late = [one for one in structure.composed if one.response is not None]
    if not front and not late:
        return logged, {}
    named = dict(zip(structure.names, map(float, values), strict=True))
    commands = len(structure.commands)
    s = 2j * np.pi * stack.frequency_hz

    def acting(at: Mapping[str, float]) -> ComplexArray:
        found = logged.copy()
        if front:
            for one, part in zip(stack.spectra, stack.slices, strict=True):
                found[:commands, part] = one.transform(in_time(structure, front, one.segment, at))
        for effect in late:
            assert effect.response is not None
            found[:commands] *= effect.response(s, {name: at[name] for name in effect.names})
        return found

    changes: dict[str, ComplexArray] = {}
    if sensitivities:
        for name in (name for one in (*front, *late) for name in one.names):
            above, below = _beside(structure, named, name)
            changes[name] = (acting({**named, name: above}) - acting({**named, name: below})) / (above - below)
    return acting(named), changes


def _beside(structure: Structure, named: Mapping[str, float], name: str) -> tuple[float, float]:
    """A little more and a little less of a parameter, inside its bounds."""
    parameter = structure.parameters[structure.names.index(name)]
    step = STEP * max(abs(named[name]), 1e-2 * abs(parameter.typical))
    return min(named[name] + step, parameter.bounds[1]), max(named[name] - step, parameter.bounds[0])


def in_time(structure: Structure, front: Sequence[Effect], segment: Segment, named: Mapping[str, float]) -> FloatArray:
    """Command samples (commands, n) of a segment as they act behind `front`, absolute."""
    acting = np.stack([segment.channels[name] for name in structure.commands])
    for effect in front:
        parameters = {name: named[name] for name in effect.names}
        if effect.samples is not None:
            acting = effect.samples(acting, segment.dt, parameters)
        else:
            acting = _filtered(effect, acting, segment.dt, parameters)
    return acting


def _filtered(effect: Effect, commands: FloatArray, dt: float, parameters: Mapping[str, float]) -> FloatArray:
    """A servo's linear answer to held commands (c, n), steady before the first sample; the mean over each sample."""
    from scipy.signal import lfilter, ss2tf

    assert effect.equations is not None
    unit = np.eye(len(effect.states) + 1)
    signals = {**parameters, "delta": unit[-1], **{state: unit[i] for i, state in enumerate(effect.states)}}
    said = effect.equations(Signals(signals))
    rows = np.stack([said[f"{state}_dot"] for state in effect.states])
    A, B = discretise(rows[:, :-1], rows[:, -1:], dt)
    C = np.asarray(said["delta"])[None, :-1]
    numerator, denominator = ss2tf(A, B, C, np.zeros((1, 1)))
    first = commands[:, :1]
    answer = lfilter(numerator[0], denominator, commands - first, axis=1) + first
    following = np.concatenate([answer[:, 1:], answer[:, -1:]], axis=1)
    return np.asarray(0.5 * (answer + following))


# ------------------------------------------------------------------------------------------------ relaxation


def _relaxed(structure: Structure, values: FloatArray, stack: Stack, sensitivities: bool) -> Response:
    """Nonlinear or time-varying dynamics: the values and a step of each parameter, relaxed side by side."""
    front, rest = divided(structure)
    named = dict(zip(structure.names, map(float, values), strict=True))
    batch, steps = [named], []
    if sensitivities:
        for name in structure.names:
            above, _ = _beside(structure, named, name)
            step = above - named[name] or _beside(structure, named, name)[1] - named[name]
            steps.append(step)
            batch.append({**named, name: named[name] + step})
    Y = np.empty((len(batch), len(structure.outputs), stack.z.size), dtype=complex)
    E = np.empty((len(rest.states), len(structure.outputs), stack.z.size), dtype=complex)
    for one, part in zip(stack.spectra, stack.slices, strict=True):
        acting = [in_time(structure, front, one.segment, named)]
        outside = {name for effect in structure.composed if effect in front for name in effect.names}
        for name, values_of in zip(structure.names, batch[1:], strict=False):
            acting.append(in_time(structure, front, one.segment, values_of) if name in outside else acting[0])
        Y[..., part], E[..., part] = _relax(rest, batch, one, acting)
    J = (Y[1:] - Y[0]) / np.array(steps)[:, None, None] if sensitivities else None
    return Response(Y[0], E, J)


def _relax(
    structure: Structure, batch: Sequence[Mapping[str, float]], one: Spectrum, acting: Sequence[FloatArray]
) -> tuple[ComplexArray, ComplexArray]:
    """One segment with acting command samples for each of the batch: Y (batch, k, bins) and E (n, k, bins)."""
    from scipy.fft import irfft, next_fast_len, rfft

    segment, n, m = one.segment, len(structure.states), len(structure.commands)
    length = segment.samples * segment.dt
    wide = max(RELAXATION_HZ, float(one.frequency_hz[-1]))
    bins = min(int(wide * length), (segment.samples - 1) // 2)
    grid = next_fast_len(4 * bins)
    s = 2j * np.pi * np.arange(bins + 1) / length
    hold = np.sinc(np.arange(bins + 1) / segment.samples) * np.exp(-0.5 * s * segment.dt)

    def on_grid(spectrum: ComplexArray) -> FloatArray:
        return np.asarray(irfft(spectrum, grid, axis=-1) * (grid / segment.samples))

    distinct = {id(samples): rfft(samples, axis=1)[:, : bins + 1] for samples in acting}
    U = np.stack([distinct[id(samples)] for samples in acting])
    U[..., 0] = 0
    for effect in structure.composed:
        if effect.response is not None:
            U *= np.stack([effect.response(s, {name: at[name] for name in effect.names}) for at in batch])[:, None]
    u = on_grid(U)
    rows_of = [segment.channels[name] for name in structure.channels]
    channels = [on_grid(rfft(row)[: bins + 1]) for row in rows_of]
    A, B, _, _ = structure.matrices(structure.vector(batch[0]))
    transfer = np.linalg.inv(s[1:, None, None] * np.eye(n) - A)  # (bins, n, n)
    forced = np.zeros((len(batch), n, bins + 1), dtype=complex)
    forced[..., 1:] = np.einsum("fij,bjf->bif", transfer, B[:, :m] @ (U * hold)[..., 1:])
    C = np.eye(2, n)
    first = round(float(one.frequency_hz[0]) * length)
    inside = slice(first, first + one.frequency_hz.size)
    E = (C @ transfer[inside.start - 1 : inside.stop - 1]).transpose(2, 1, 0)
    rows = E.reshape(n, -1).view(float)
    parameters = {name: np.array([at[name] for at in batch])[:, None] for name in structure.names}
    X = forced.copy()
    outputs = np.zeros((len(batch), 2, bins + 1), dtype=complex)
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
            **{name: u[:, i] for i, name in enumerate(structure.commands)},
            **{name: channels[i] for i, name in enumerate(structure.channels)},
        }
        rates, measured = structure.evaluate(parameters, signals)
        shape = x[:, 0].shape
        rhs = np.stack([np.broadcast_to(rates[f"{state}_dot"], shape) for state in structure.states], axis=1)
        other = rfft(rhs - A @ x - B[:, :m] @ u, axis=2)[:, :, : bins + 1] * (segment.samples / grid)
        new = forced.copy()
        new[..., 1:] += np.einsum("fij,bjf->bif", transfer, other[..., 1:])
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
