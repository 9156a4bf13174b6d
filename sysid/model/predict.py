"""What a structure predicts on the Fourier bins of flown runs: outputs, sensitivities, and the columns of end states.

Linear structures go through their discretised matrices in modal form, exact for held commands. Delay, play and limits
act on the commands before. Terms with products, powers or wandering coefficients are found by relaxation: the linear
part answers the rest as if it were an input, evaluated on the whole time history, until nothing changes.
Inputs that stand in for the logged ones, for instruments, go through all of this as the logged ones do.
All arrays have the bins last, so that rows of real numbers are views of rows of complex ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sysid.data.preprocess import ComplexArray, Segment, Spectrum
from sysid.errors import SysidError
from sysid.model.effect import Effect, Signals
from sysid.model.structure import FloatArray, Structure, discretise, stepped

if TYPE_CHECKING:
    from sysid.model.polynomial import Sampling

WORST_MODAL_CONDITION = 1e7
RELAXATION_HZ = 30.0
RELAXATIONS = 40
RELAXED = 1e-5
DIFFERENCE_RELAXED = 0.03
"""Of the last change of a response, and of a difference of responses; what is left is a fraction of it."""
NEARER = 2
"""Relaxations in which the linear part is fitted to the motion."""
TOGETHER = 3
"""Parameters side by side: more would cost memory and save no time."""
STEP = 1e-3
"""Of a parameter, for differences."""
LARGE_STEP = 1e-2
"""Of a parameter, to see whether it moves the commands steadily."""
FEWEST_BINS = 60


class RelaxationError(SysidError, ArithmeticError):
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
            from sysid.model.polynomial import sampling

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
    if not linear_dynamics(structure):
        return _relaxed(structure, values, stack, sensitivities, U)
    front, rest = divided(structure)
    if U is not None and front:
        runs = zip(stack.spectra, stack.slices, strict=True)
        stack = replace(stack, spectra=tuple(_driven(one, U[:, part]) for one, part in runs))
    if U is None:
        U = stack.U
    if stack.inputs != structure.inputs:
        U = U[[stack.inputs.index(name) for name in structure.inputs]]
    if not structure.composed:
        from sysid.model import polynomial

        if polynomial.exact_enough(stack):
            return polynomial.respond(structure, values, stack, sensitivities, U, ends)
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


def behind(structure: Structure, values: FloatArray, stack: Stack) -> Stack:
    """The stack with its inputs as they act behind everything that acts on samples; `divided` tells what follows."""
    front, _ = divided(structure)
    named = dict(zip(structure.names, map(float, values), strict=True))
    U = stack.U[[stack.inputs.index(name) for name in structure.inputs]]
    return replace(stack, U=_behind(structure, front, stack, U, named), inputs=structure.inputs)


def jumping(structure: Structure, values: FloatArray, stack: Stack) -> list[str]:
    """Parameters with which the acting samples jump (dead band), so that there is no derivative to them.

    What moves steadily changes 16 times less for a 16 times smaller step; of jumps there are 16 times fewer, and the
    root of their sum of squares is 4 times less.
    """
    front, _ = divided(structure)
    names = [name for effect in front for name in effect.names if effect.samples is not None]
    if not names:
        return []
    named = dict(zip(structure.names, map(float, values), strict=True))
    segment = stack.spectra[0].segment

    def change(name: str, step: float) -> float:
        moved = in_time(structure, front, segment, {**named, name: (1 + step) * named[name]})
        return float(np.linalg.norm(moved - here))

    here = in_time(structure, front, segment, named)
    return [name for name in names if 0 < change(name, LARGE_STEP) < 8 * change(name, LARGE_STEP / 16)]


def linear_dynamics(structure: Structure) -> bool:
    """Whether everything behind the commands' samples is linear with constant coefficients."""
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
        found = _behind(structure, front, stack, logged, at) if front else logged.copy()
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


def _behind(
    structure: Structure, front: Sequence[Effect], stack: Stack, logged: ComplexArray, named: Mapping[str, float]
) -> ComplexArray:
    """Inputs (m, bins) as they act behind `front`."""
    found, commands = logged.copy(), len(structure.commands)
    for one, part in zip(stack.spectra, stack.slices, strict=True):
        found[:commands, part] = one.transform(in_time(structure, front, one.segment, named))
    return found


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


def _driven(one: Spectrum, U: ComplexArray) -> Spectrum:
    """The run with input bins U (m, bins) in place of what was logged, on its samples; means stay."""
    channels = dict(one.segment.channels)
    for name, moving in zip(one.inputs, one.in_time(U), strict=True):
        channels[name] = channels[name].mean() + moving
    return replace(one, segment=replace(one.segment, channels=channels))


def _relaxed(
    structure: Structure, values: FloatArray, stack: Stack, sensitivities: bool, U: ComplexArray | None
) -> Response:
    """Nonlinear or time-varying dynamics: first the values, then a step of each parameter from where they settled.

    With inputs U (m, bins) in place of the logged ones there are no end states, which the measured rates would show.
    """
    front, rest = divided(structure)
    outside = {name for effect in front for name in effect.names}
    named = dict(zip(structure.names, map(float, values), strict=True))
    count = len(structure.names) if sensitivities else 0
    Y = np.empty((len(structure.outputs), stack.z.size), dtype=complex)
    E = np.empty((len(rest.states), *Y.shape), dtype=complex)
    J = np.empty((count, *Y.shape), dtype=complex)
    for one, part in zip(stack.spectra, stack.slices, strict=True):
        if U is not None:
            one = _driven(one, U[:, part])
        run = _Run(rest, one)
        logged = run.commands(in_time(structure, front, one.segment, named), named)
        settled = _settle(run, named, logged, ended=U is None)
        Y[:, part], E[..., part] = settled.Y, settled.E
        for first in range(0, count, TOGETHER):
            names = structure.names[first : first + TOGETHER]
            batch = [_step(structure, named, name) for name in names]
            acting = [
                run.commands(in_time(structure, front, one.segment, at), at)
                if name in outside or name in run.late
                else logged
                for name, at in zip(names, batch, strict=True)
            ]
            steps = np.array([at[name] - named[name] for name, at in zip(names, batch, strict=True)])
            moved = _settle_beside(run, settled, [named, *batch], [logged, *acting])
            J[first : first + TOGETHER, :, part] = (moved[1:] - moved[0]) / steps[:, None, None]
    return Response(Y, E, J if sensitivities else None)


def _step(structure: Structure, named: Mapping[str, float], name: str) -> dict[str, float]:
    """The values with one of them moved a little, up where its bounds allow."""
    above, below = _beside(structure, named, name)
    return {**named, name: above if above != named[name] else below}


class _Run:
    """One segment on the relaxation's own grid of time, and its bins from zero to well above the band."""

    def __init__(self, structure: Structure, one: Spectrum) -> None:
        from scipy.fft import next_fast_len, rfft

        self.structure, self.one = structure, one
        samples, dt = one.segment.samples, one.segment.dt
        wide = max(RELAXATION_HZ, float(one.frequency_hz[-1]))
        self.bins = 1 + min(int(wide * samples * dt), (samples - 1) // 2)
        self.grid = next_fast_len(3 * self.bins)
        self.s = 2j * np.pi * np.arange(self.bins) / (samples * dt)
        self.hold = np.sinc(np.arange(self.bins) / samples) * np.exp(-0.5 * self.s * dt)
        self.inside = slice(one.first, one.first + one.frequency_hz.size)
        self.channels = {
            name: self.on_grid(rfft(one.segment.channels[name])[: self.bins]) for name in structure.channels
        }
        self.delays = [effect for effect in structure.composed if effect.response is not None]
        self.late = {name for effect in self.delays for name in effect.names}

    def on_grid(self, spectrum: ComplexArray) -> FloatArray:
        """(..., bins) to (..., grid)."""
        from scipy.fft import irfft

        return np.asarray(irfft(spectrum, self.grid, axis=-1) * (self.grid / self.one.samples))

    def transform(self, samples: FloatArray) -> ComplexArray:
        """(..., grid) to (..., bins)."""
        from scipy.fft import rfft

        return np.asarray(rfft(samples, axis=-1)[..., : self.bins] * (self.one.samples / self.grid))

    def commands(self, acting: FloatArray, named: Mapping[str, float]) -> ComplexArray:
        """Acting samples (commands, n) to bins (commands, bins), without their mean, behind every delay."""
        from scipy.fft import rfft

        U: ComplexArray = rfft(acting, axis=1)[:, : self.bins]
        U[:, 0] = 0
        for effect in self.delays:
            assert effect.response is not None
            U *= effect.response(self.s, {name: named[name] for name in effect.names})
        return U

    def evaluate(
        self, batch: Sequence[Mapping[str, float]], X: ComplexArray, u: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """States (batch, n, grid), their rates, and the outputs (batch, k, grid), of X (batch, n, bins) and commands
        u (batch, m, grid)."""
        structure, x = self.structure, self.on_grid(X)
        signals = {
            **{name: x[:, i] for i, name in enumerate(structure.states)},
            **{name: u[:, i] for i, name in enumerate(structure.commands)},
            **self.channels,
        }
        parameters = {name: np.array([at[name] for at in batch])[:, None] for name in structure.names}
        rates, measured = structure.evaluate(parameters, signals)
        shape = x[:, 0].shape
        rhs = np.stack([np.broadcast_to(rates[f"{state}_dot"], shape) for state in structure.states], axis=1)
        return x, rhs, np.stack([np.broadcast_to(measured[name], shape) for name in structure.outputs], axis=1)

    def resolvent(self, A: FloatArray) -> ComplexArray:
        """(s - A)^-1, (n, n, bins), nothing at bin zero."""
        found = np.zeros((*A.shape, self.bins), dtype=complex)
        found[..., 1:] = np.linalg.inv(self.s[1:, None, None] * np.eye(A.shape[0]) - A).transpose(1, 2, 0)
        return found


class _Settled(NamedTuple):
    """A run's response, and the linear part by which it was found."""

    Y: ComplexArray
    """(k, bins of the band)"""
    E: ComplexArray
    """(n, k, bins of the band)"""
    X: ComplexArray
    """(n, bins), without the free motion."""
    free: ComplexArray
    """(n, bins), the motion that the run's end states account for."""
    A: FloatArray
    B: FloatArray
    transfer: ComplexArray
    """(n, n, bins)"""


def _settle(run: _Run, named: Mapping[str, float], U: ComplexArray, ended: bool) -> _Settled:
    """The response to command bins U (m, bins).

    The linear part is that of small motions first, and then the one nearest to the motion itself.
    """
    structure, inside = run.structure, run.inside
    n, m = len(structure.states), len(structure.commands)
    A, B = structure.matrices(structure.vector(named))[:2]
    B = B[:, :m]
    C = np.eye(2, n)
    u, driven = run.on_grid(U), B @ (U * run.hold)
    transfer = run.resolvent(A)
    X = _through(transfer, driven[None])[0]
    outputs, last = X[:2], np.inf
    for count in range(RELAXATIONS):
        # the free motion from the run's end states, as the measured rates show it
        E = transfer[:2, :, inside].transpose(1, 0, 2)
        rest = (run.one.Y - outputs[:, inside]).reshape(-1).view(float)
        ends, *_ = np.linalg.lstsq(np.ascontiguousarray(E).reshape(n, -1).view(float).T, rest, rcond=1e-8)
        free = np.einsum("ijf,j->if", transfer, ends if ended else 0 * ends)
        x, rates, y = run.evaluate([named], (X + free)[None], u[None])
        other = rates[0] - A @ x[0] - B @ u
        if count < NEARER:
            nearer = (other @ x[0].T) @ np.linalg.pinv(x[0] @ x[0].T, rcond=1e-9, hermitian=True)
            A, other = A + nearer, other - nearer @ x[0]
            transfer = run.resolvent(A)
        new = _through(transfer, (driven + run.transform(other))[None])[0]
        change = float(np.max(np.abs(new - X)) / max(float(np.max(np.abs(new))), 1e-300))
        if not np.isfinite(change) or change > 1e3:
            raise RelaxationError("the response grows without limit")
        outputs = run.transform(y[0]) + C @ (new - X - free)
        X = new
        if change < RELAXED:
            break
        if change > 2 * last and change > 0.1:
            raise RelaxationError("the response does not settle")
        last = min(last, change)
    return _Settled(outputs[:, inside], E, X, free, A, B, transfer)


def _settle_beside(
    run: _Run, settled: _Settled, batch: Sequence[Mapping[str, float]], U: Sequence[ComplexArray]
) -> ComplexArray:
    """Outputs (batch, k, bins of the band) at the settled values, first, and at others near them; one free motion.

    It ends where the differences from the first, and not the responses, have settled. The first goes along so that what
    changes nothing has a difference of zero.
    """
    driving, u = settled.B @ (np.stack(U) * run.hold), run.on_grid(np.stack(U))
    X = np.broadcast_to(settled.X, (len(batch), *settled.X.shape))
    C, outputs = np.eye(2, X.shape[1]), X[:, :2]
    for _ in range(RELAXATIONS):
        x, rates, y = run.evaluate(batch, X + settled.free, u)
        other = run.transform(rates - settled.A @ x - settled.B @ u)
        new = _through(settled.transfer, driving + other)
        size = np.max(np.abs(new - new[0]), axis=(1, 2))
        change = np.max(np.abs(new - X - (new[0] - X[0])), axis=(1, 2))
        if not np.all(np.isfinite(change)):
            raise RelaxationError("the response grows without limit")
        outputs = run.transform(y) + C @ (new - X - settled.free)
        X = new
        if np.all(change <= DIFFERENCE_RELAXED * size):
            break
    return outputs[..., run.inside]


def _through(transfer: ComplexArray, driving: ComplexArray) -> ComplexArray:
    """(n, n, bins) times (batch, n, bins)."""
    return np.asarray(np.einsum("ijf,bjf->bif", transfer, driving))
