"""Prediction-error estimates, for a loop whose excitation nobody logged: the noise is estimated with the model.

With a controller on, gusts reach the commands, and what a command is now follows from what the noise was before. A fit
that asks how well outputs are predicted from commands alone takes some of that for the vehicle's answer. One that also
predicts the noise from its own past does not (Ljung's prediction-error method): what is left then is new in every
sample, no command knew it, and of the commands only what past noise does not foretell speaks for the vehicle.

The noise is a vector autoregression over MEMORY_S, free in all its numbers. A loop that remembers longer would want
more, one that is short is told apart with less; fewer numbers leave a bias, more cost little. That past is only past
over the whole circle of frequencies, so the bins reach WIDER than the fit's band: beyond it the vehicle hardly answers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sysid.data.dataset import WIDER, Bins
from sysid.data.preprocess import ComplexArray, spectrum
from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.estimate import Estimate, free_of
from sysid.fit.gauss_newton import NormalEquations, bounded_step, moved
from sysid.fit.growth import answered, growth, growth_slopes, misled
from sysid.fit.output_error import OutputError, output_error
from sysid.fit.rows import orthonormal, rows, smoothed_spectrum
from sysid.fit.whitening import jumps, weighed
from sysid.model.acting import jumping
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model, Structure

MEMORY_S = 0.2
"""Of the noise."""
STEPS, MANY_STEPS = 15, 100
"""The second where growing modes have their cost, which may lead far."""
SHORT = 0.05
"""Standard errors: a step that is shorter ends the search."""
HALVINGS = 6
LEAST_PAST = 3.0
"""Times what chance makes of it, that past noise must foretell of the answers to the commands: else no loop shows."""
MOST_PAST = 0.98
"""Of the answers to the commands: what past noise does not foretell of them is too little to identify a vehicle by."""
WORST = 1.5
"""Times the output error's power of the fit it begins at: more is another valley, or a model that does not fit. Not
where that fit has growing modes that the loop may have made: what explains more for them leaves less."""
AT_REST = 0.1
"""1/s, of a pole: so near to the axis the likelihood has a kink, and no step that lowers it on either side."""
WORST_CONDITION = 1e12


@dataclass(frozen=True, eq=False)
class Noise:
    """v(t) + sum over m of lags[m] v(t - m - 1) = what is new; `root` makes that white, of unit variance."""

    lags: FloatArray
    """(n, k, k)"""
    root: FloatArray
    """(k, k), lower triangular"""
    rate_hz: float
    gusty: bool = False
    """Whether growing modes have their cost beside it."""

    @classmethod
    def of(cls, error: OutputError, stacks: Sequence[Stack], rate_hz: float, gusty: bool = False) -> Noise:
        """By Yule and Walker, from the residuals' spectrum."""
        k, count = error.residual_power.size, max(1, round(MEMORY_S * rate_hz))
        whole = [np.concatenate([group.scale for group in stacks]), np.concatenate([g.frequency_hz for g in stacks])]
        v = whole[0] * np.concatenate(error.residuals, axis=1)
        after = [np.real((v * np.exp(2j * np.pi * whole[1] * m / rate_hz)) @ v.conj().T) for m in range(count + 1)]
        R = [*(one.T for one in after[:0:-1]), *after]
        T = np.block([[R[count + i - m] for i in range(1, count + 1)] for m in range(1, count + 1)])
        lags = np.linalg.solve(T.T, -np.hstack(after[1:]).T).T.reshape(k, count, k).swapaxes(0, 1)
        new = after[0] + np.sum(lags @ np.stack(after[1:]).swapaxes(1, 2), axis=0)
        return cls(lags, _root(0.25 * (new + new.T) / v.shape[1]), rate_hz, gusty)

    @property
    def stable(self) -> bool:
        """Whether the noise can be had back from what is new."""
        n, k, _ = self.lags.shape
        step = np.eye(n * k, k=-k)
        step[:k] = -np.hstack(list(self.lags))
        return bool(np.max(np.abs(np.linalg.eigvals(step))) < 1)

    def late(self, group: Stack) -> ComplexArray:
        """exp(-j omega m) of each lag, (n, bins)."""
        return lags_of(group, len(self.lags), self.rate_hz)

    def weights(self, group: Stack) -> ComplexArray:
        """What makes a stack's residual white, (k, k, bins)."""
        A = np.eye(self.root.shape[0])[:, :, None] + np.tensordot(self.lags, self.late(group), (0, 0))
        return np.asarray(np.tensordot(self.root, A, (1, 0)) * group.scale)


def lags_of(group: Stack, count: int, rate_hz: float) -> ComplexArray:
    """exp(-j omega m) of each of the last samples at that rate, (count, bins)."""
    one = np.exp(-2j * np.pi * group.frequency_hz / rate_hz)
    return np.asarray(np.multiply.accumulate(np.broadcast_to(one, (count, one.size)), axis=0))


def _root(new: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(np.linalg.cholesky(new)))


class _Block(NamedTuple):
    """A segment's rows, white, end states projected out: (rows, 2 k bins) of real numbers."""

    left: FloatArray
    """(1, ...): what is new."""
    slopes: FloatArray
    """(parameters, ...), of the predicted output."""
    past: _Past
    basis: FloatArray
    """(ends, ...), of the end states."""
    frequency_hz: FloatArray


@dataclass(frozen=True, eq=False)
class _Past:
    """Rows by the noise's numbers, of the noise that is foretold: each lag of each output, on every output by a column
    of the root. Products with them are those with the lags, of which there are fewer and shorter ones."""

    late: ComplexArray
    """(n k, bins): each output's noise, each lag late."""
    root: FloatArray
    """(k, k)"""

    def products(self, some: FloatArray) -> FloatArray:
        """With rows (c, 2 k bins), (c, n k k)."""
        k = len(self.root)
        each = some.reshape(len(some) * k, -1) @ rows(self.late).T
        # (row, output, lag, output that foretells) -> (row, lag, column of the root, output that foretells)
        found = np.einsum("rolj,oi->rlij", each.reshape(len(some), k, -1, k), -self.root)
        return np.asarray(found.reshape(len(some), -1))

    @property
    def among(self) -> FloatArray:
        """With one another, (n k k, n k k)."""
        k, late = len(self.root), rows(self.late)
        each = (late @ late.T).reshape(len(late) // k, k, -1, k)
        found = np.einsum("ljmn,ih->lijmhn", each, self.root.T @ self.root)
        return np.asarray(found.reshape(k * len(late), -1))

    def combined(self, by: FloatArray) -> FloatArray:
        """Sums of them, (c, n k k) -> (c, 2 k bins)."""
        k = len(self.root)
        onto = np.einsum("rlij,oi->rolj", by.reshape(len(by), -1, k, k), -self.root)
        return rows((onto.reshape(len(by) * k, -1) @ self.late).reshape(len(by), k, -1))


def _blocks(model: Model, noise: Noise, stacks: Sequence[Stack]) -> Iterator[_Block]:
    k = noise.root.shape[0]
    for group in stacks:
        response = respond(model.structure, model.values, group, True)
        W, late = noise.weights(group), noise.late(group)
        E = weighed(W, np.concatenate([response.E, jumps(group)]))
        columns = weighed(W, np.concatenate([(group.Y - response.Y)[None], response.slopes]))
        for part in group.slices:
            basis = orthonormal(rows(E[..., part]))
            found = _less(basis, rows(columns[..., part]))
            new = found[0].view(complex).reshape(k, -1, 1)
            v = np.linalg.solve(W[..., part].transpose(2, 0, 1), new.swapaxes(0, 1))[:, :, 0].T
            foretold: ComplexArray = group.scale[part] * late[:, None, part] * v
            past = _Past(foretold.reshape(-1, v.shape[1]), noise.root)
            yield _Block(found[:1], found[1:], past, basis, group.frequency_hz[part])


def _less(basis: FloatArray, some: FloatArray) -> FloatArray:
    return some - (some @ basis.T) @ basis


@dataclass(frozen=True, eq=False, kw_only=True)
class Equations:
    """Normal equations in the parameters and in the noise's numbers together."""

    count: int
    """Parameters; the noise's numbers stand behind them."""
    curvature: FloatArray
    gradient: FloatArray
    new: FloatArray
    """(k, k), what is left, before `root` made it white."""
    samples: int
    """Rows of real numbers, an output's."""
    grows: float
    """By which power of e the model's growing modes do in a sample."""

    @classmethod
    def at(cls, model: Model, noise: Noise, stacks: Sequence[Stack]) -> Equations:
        n, k = model.values.size, noise.root.shape[0]
        curvature, gradient = np.zeros((n + noise.lags.size, n + noise.lags.size)), np.zeros(n + noise.lags.size)
        white, samples = np.zeros((k, k)), 0
        for block in _blocks(model, noise, stacks):
            ends = block.past.products(block.basis)
            curvature[:n, :n] += block.slopes @ block.slopes.T
            curvature[:n, n:] += block.past.products(block.slopes)  # which have no end states any more
            curvature[n:, n:] += block.past.among - ends.T @ ends
            gradient[:n] += block.slopes @ block.left[0]
            gradient[n:] += block.past.products(block.left)[0]
            each = block.left[0].reshape(k, -1)
            white += each @ each.T
            samples += each.shape[1]
        curvature[n:, :n] = curvature[:n, n:].T
        grows = 0.0
        if noise.gusty:
            grows = growth(model.structure, model.values) / noise.rate_hz
            gradient[:n] -= samples / noise.rate_hz * growth_slopes(model.structure, model.values)
        back = np.linalg.inv(noise.root)
        return cls(
            count=n,
            curvature=curvature,
            gradient=gradient,
            new=back @ white @ back.T,
            samples=samples,
            grows=grows,
        )

    @property
    def cost(self) -> float:
        """Minus twice the log likelihood of a sample."""
        return float(np.linalg.slogdet(self.new)[1]) + 2 * self.grows

    @property
    def to_past(self) -> FloatArray:
        """What the noise's numbers explain of the slopes, (parameters, numbers)."""
        n = self.count
        return np.asarray(np.linalg.lstsq(self.curvature[n:, n:], self.curvature[n:, :n], rcond=1e-12)[0].T)

    @property
    def beside_past(self) -> tuple[FloatArray, FloatArray]:
        """Curvature and gradient of the parameters, the noise's numbers fitted to each."""
        n, K = self.count, self.to_past
        curvature = self.curvature[:n, :n] - K @ self.curvature[n:, :n]
        return 0.5 * (curvature + curvature.T), self.gradient[:n] - K @ self.gradient[n:]

    def past_share(self, free: Sequence[int]) -> FloatArray:
        """Of the answers to the commands what past noise foretells, (free,)."""
        whole, alone = np.diag(self.curvature)[list(free)], np.diag(self.beside_past[0])[list(free)]
        return np.asarray(1 - alone / np.maximum(whole, 1e-300))

    def noise_move(self, move: FloatArray) -> FloatArray:
        """Of the noise's numbers, beside this one of the parameters."""
        n = self.count
        rest = self.gradient[n:] - self.curvature[n:, :n] @ move
        return np.asarray(np.linalg.lstsq(self.curvature[n:, n:], rest, rcond=1e-12)[0])


def prediction_error(found: Estimate, bins: Bins, fixed: Collection[str] = ()) -> Estimate | None:
    """The estimate where noise is predicted too, begun at `found`; `fixed` parameters stay.

    None where no loop shows, where the commands follow so closely from past noise that nothing is left to identify by,
    or where the search does not settle near where it began, within the bounds.
    """
    structure = found.model.structure
    if jumping(structure, found.model.values, bins.stacks[0]):
        return None
    stacks, rate_hz = _widened(bins, structure)
    gusty = answered(structure, found.error)
    try:
        with np.errstate(all="ignore"):  # a step too far has no response: what comes out is not finite
            settled = _settled(found.model, stacks, rate_hz, fixed, gusty)
            if settled is None:
                return None
            model, noise, equations = settled
            free = free_of(model, fixed)
            covariance = np.zeros_like(found.covariance)
            covariance[np.ix_(free, free)] = _covariance(model, noise, stacks, equations, free)
    except (RelaxationError, FitError, np.linalg.LinAlgError):
        return None
    error = output_error(model, bins.stacks)
    if not np.all(np.isfinite(covariance)) or not np.all(np.isfinite(error.residual_power)):
        return None
    worse = bool(np.any(error.residual_power > WORST * found.error.residual_power))
    if worse and not misled(found.model, found.error, bins):
        return None
    bound = tuple(name for i, name in enumerate(structure.names) if name not in fixed and i not in free)
    if set(bound) - set(found.at_bound):
        return None
    return replace(
        found, model=model, covariance=covariance, error=error, at_bound=bound, instrument="prediction error"
    )


def _widened(bins: Bins, structure: Structure) -> tuple[tuple[Stack, ...], float]:
    """The same segments with bins up to WIDER, as far as they are sampled, and the rate of samples that had just
    these."""
    top = max(float(one.frequency_hz[-1]) for one in bins.spectra)
    sampled = min(float((one.samples - 1) // 2) / (one.samples * one.dt) for one in bins.spectra)
    high_hz = min(WIDER * top, sampled)
    wider = tuple(
        spectrum(one.segment, one.inputs, structure.outputs, ((one.first - 0.5) / (one.samples * one.dt), high_hz))
        for one in bins.spectra
    )
    return Bins(wider).stacks, 2 * high_hz


def _settled(
    model: Model, stacks: Sequence[Stack], rate_hz: float, fixed: Collection[str], gusty: bool
) -> tuple[Model, Noise, Equations] | None:
    """Gauss-Newton steps of parameters and noise together, halved where what is left grows."""
    begin, structure, free = model, model.structure, free_of(model, fixed)
    if not free:
        return None
    noise = Noise.of(output_error(model, stacks), stacks, rate_hz, gusty)
    here = Equations.at(model, noise, stacks)
    share = here.past_share(free)
    chance = noise.lags.size / (noise.root.shape[0] * here.samples)
    if not LEAST_PAST * chance < float(np.max(share)) or not float(np.max(share)) < MOST_PAST:
        return None
    low, high = structure.bounds
    movable = np.isin(np.arange(model.values.size), free)
    for _ in range(MANY_STEPS if gusty else STEPS):
        curvature, gradient = here.beside_past
        step = NormalEquations(np.diag(here.new), curvature, gradient, [])
        move = bounded_step(step, movable, low - model.values, high - model.values)
        lags = here.noise_move(move).reshape(noise.lags.shape[0], *noise.root.shape)
        size = np.sqrt(np.maximum(np.diag(curvature)[free], 0))
        reached = lower(model, noise, stacks, here, move, lags)
        if reached is None:
            return (model, noise, here) if gusty and _at_rest(begin, model) else None
        model, noise, here = reached
        if np.max(np.abs(move[free]) * size) < SHORT:
            return model, noise, here
    return None


def _at_rest(begin: Model, there: Model) -> bool:
    """Whether the search came from where a mode grew to where it neither grows nor fades, and can go no further."""
    grew = growth(begin.structure, begin.values) > growth(there.structure, there.values)
    return grew and bool(np.any(np.abs(np.linalg.eigvals(there.matrices.A).real) < AT_REST))


def lower(
    model: Model, noise: Noise, stacks: Sequence[Stack], here: Equations, move: FloatArray, lags: FloatArray
) -> tuple[Model, Noise, Equations] | None:
    """Where on the way of a step less is left; None where nowhere is. The last digits do not count."""
    root, length = _root(here.new / here.samples), 1.0
    low, high = model.structure.bounds
    for _ in range(HALVINGS):
        tried = Model(model.structure, moved(model.values, length * move, low, high))
        told = replace(noise, lags=noise.lags + length * lags, root=root)
        if told.stable:
            there = Equations.at(tried, told, stacks)
            if np.isfinite(there.cost) and there.cost < here.cost + 1e-6:
                return tried, told, there
        length /= 2
    return None


def _covariance(
    model: Model, noise: Noise, stacks: Sequence[Stack], equations: Equations, free: Sequence[int]
) -> FloatArray:
    """(free, free), as that of an estimate by weights: what is new may still be coloured a little."""
    curvature = equations.beside_past[0][np.ix_(free, free)]
    size = np.sqrt(np.maximum(np.diag(curvature), 0))
    if np.any(size == 0) or np.linalg.cond(curvature / np.outer(size, size)) > WORST_CONDITION:
        raise FitError("the data do not determine the model")
    to_past, k, variance = equations.to_past[list(free)], noise.root.shape[0], np.zeros_like(curvature)
    for block in _blocks(model, noise, stacks):
        asked = block.slopes[list(free)] - _less(block.basis, block.past.combined(to_past))
        e = block.left[0].view(complex).reshape(k, -1)
        S = smoothed_spectrum(e, block.frequency_hz)
        bins = asked.view(complex).reshape(len(asked), k, -1)
        variance += 0.5 * (asked @ rows(np.einsum("klf,blf->bkf", S, bins)).T)
    inverse = np.linalg.inv(curvature / np.outer(size, size)) / np.outer(size, size)
    return np.asarray(inverse @ variance @ inverse.T)
