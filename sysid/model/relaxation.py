"""Answers of what is not linear, or wanders with time: the linear part answers the rest until nothing changes.

Terms with products, powers or wandering coefficients count as an input of the linear part, evaluated on the whole time
history. Derivatives are steps of each parameter from where it settled, answered by small motions about that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.stacks import Stack
from sysid.errors import SysidError
from sysid.model.acting import divided, either_side, in_time
from sysid.model.modal import Modes
from sysid.model.response import Response
from sysid.model.structure import AnyArray, FloatArray, Structure

BEYOND_THE_BAND, LEAST_HZ = 2.5, 15.0
"""Times a band's upper end, and Hz, up to where motion counts at least: products of it fall into the band. To 30 Hz chi
squared of a drag on four strange flights changed by less than 1 of 3,400, and by 0.1 of the others."""
RELAXATIONS = 40
RELAXED = 1e-5
DIFFERENCE_RELAXED = 0.01
"""Of the last change of a response, and of a difference of responses; what is left is a fraction of it."""
TANGENT_STEP = 1e-6
"""Of a state's largest motion, for differences;"""
ROUNDING = 1e-8
"""of the largest rate or output, that this state's own motion changes it by at least: less may be rounding."""
NEARER = 2
"""Relaxations in which the linear part is fitted to the motion."""
UNSEEN = 1e-9
"""Of what an end state does to any state, that it does to the measured rates where these tell nothing of it."""
STEADY = 0.1
"""Change of a response, below which the next relaxation begins where the last ones point to;"""
POINTING = 5
"""so many of them, beside the last."""
TOGETHER = 24_000
"""Samples of a state, of parameters side by side: with more of them arrays leave the processor's cache, with fewer it
is calls that take the time."""
FEWEST_TOGETHER = 3
"""Parameters side by side, however long the run."""
KEPT = 8
"""Responses of single runs: of the last two sets of values, most often."""
THINNED = 16
"""Of so many bins one tells which states the measured rates show."""
ENDS_RANK = 1e-12
"""Of the largest eigenvalue of inner products, of which weaker combinations of end states tell nothing."""


class RelaxationError(SysidError, ArithmeticError):
    """The nonlinear response does not settle at these values."""


def bins_in_reach(one: Spectrum) -> int:
    """Number of a run's bins above zero up to where motion counts."""
    reach_hz = max(LEAST_HZ, BEYOND_THE_BAND * float(one.frequency_hz[-1]))
    return min(int(reach_hz * one.segment.duration_s + 1e-6), (one.segment.samples - 1) // 2)


def driven_by(one: Spectrum, U: ComplexArray) -> Spectrum:
    """The run with input bins U (m, bins) in place of what was logged, on its samples; means stay."""
    channels = dict(one.segment.channels)
    for name, moving in zip(one.inputs, one.in_time(U), strict=True):
        channels[name] = channels[name].mean() + moving
    return replace(one, segment=replace(one.segment, channels=channels))


def relaxed_response(
    structure: Structure,
    values: FloatArray,
    stack: Stack,
    *,
    sensitivities: bool,
    U: ComplexArray | None,
    of: Sequence[int] | None = None,
) -> Response:
    """Nonlinear or time-varying dynamics: first the values, then a step of each parameter, or `of` these, from where
    they settled.

    With inputs U (m, bins) in place of the logged ones there are no end states, which the measured rates would show.
    """
    rest, at_values = divided(structure)[1], (structure, tuple(values.tolist()))
    stepping = structure.names if of is None else tuple(structure.names[i] for i in of)
    Y = np.empty((len(structure.outputs), stack.z.size), dtype=complex)
    E = np.empty((len(rest.states), *Y.shape), dtype=complex)
    J = np.empty((len(stepping), *Y.shape), dtype=complex) if sensitivities else None
    for one, part in zip(stack.spectra, stack.slices, strict=True):
        if U is None:
            answer = _as_flown(*at_values, one)
        else:
            answer = _answer(*at_values, driven_by(one, U[:, part]), ended=False)
        Y[:, part], E[..., part] = answer.settled.Y, answer.settled.E
        if J is not None:
            J[..., part] = answer.slopes(stepping)
    return Response(Y, lambda: E, J)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Answer:
    """A run at some values."""

    structure: Structure
    named: Mapping[str, float]
    run: _Run
    acting: ComplexArray
    """Bins of the commands that act in it, (commands, bins),"""
    settled: _Settled
    """and the response to these."""
    _slopes: dict[tuple[str, ...], ComplexArray] = field(default_factory=dict)

    def slopes(self, names: tuple[str, ...]) -> ComplexArray:
        """Derivatives of the outputs to these parameters, (names, k, bins of the band). Worked out once: a fit weighs
        them anew, and what judges it asks at the values where it ended."""
        if names not in self._slopes:
            size = self.run.together
            parts = [self._moved(names[first : first + size]) for first in range(0, len(names), size)]
            self._slopes[names] = np.concatenate([np.empty((0, *self.settled.Y.shape), dtype=complex), *parts])
        return self._slopes[names]

    @cached_property
    def tangent(self) -> _Tangent:
        """Of the motion, for all derivatives."""
        return _Tangent.at(self.run, self.named, self.settled.X + self.settled.free, self.run.on_grid(self.acting))

    def _moved(self, names: tuple[str, ...]) -> ComplexArray:
        front, run = divided(self.structure)[0], self.run
        outside = {*run.late, *(name for effect in front for name in effect.names)}
        batch = [_step(self.structure, self.named, name) for name in names]
        acting = [
            run.commands(in_time(self.structure, front, run.one.segment, at), at) if name in outside else self.acting
            for name, at in zip(names, batch, strict=True)
        ]
        steps = np.array([at[name] - self.named[name] for name, at in zip(names, batch, strict=True)])
        moved = _settle_beside(run, self.tangent, [self.named, *batch], [self.acting, *acting])
        return np.asarray(moved / steps[:, None, None])


def _answer(structure: Structure, values: tuple[float, ...], one: Spectrum, ended: bool) -> _Answer:
    front, rest = divided(structure)
    named = structure.by_name(np.array(values))
    run = _Run(rest, one)
    acting = run.commands(in_time(structure, front, one.segment, named), named)
    settled = _settle(run, named, acting, ended)
    return _Answer(structure=structure, named=named, run=run, acting=acting, settled=settled)


@lru_cache(maxsize=KEPT)
def _as_flown(structure: Structure, values: tuple[float, ...], one: Spectrum) -> _Answer:
    """With the free motion. Kept: what is left is asked first, derivatives and errors at the same values."""
    return _answer(structure, values, one, ended=True)


def _step(structure: Structure, named: Mapping[str, float], name: str) -> dict[str, float]:
    """The values with one of them moved a little, up where its bounds allow."""
    above, below = either_side(structure, named, name)
    return {**named, name: above if above != named[name] else below}


class _Run:
    """One segment on the relaxation's own grid of time, and its bins from zero to well above the band."""

    def __init__(self, structure: Structure, one: Spectrum) -> None:
        # heavier than NumPy itself to load: only where it is needed
        from scipy.fft import next_fast_len

        self.structure, self.one = structure, one
        self.measured = [structure.states.index(name) for name in structure.outputs]
        samples, dt = one.segment.samples, one.segment.dt
        self.bins = 1 + bins_in_reach(one)
        self.grid = next_fast_len(3 * self.bins)
        self.together = max(FEWEST_TOGETHER, TOGETHER // self.grid)
        self.s = 2j * np.pi * np.arange(self.bins) / (samples * dt)
        held_s = one.segment.held_s
        self.hold = np.sinc(np.arange(self.bins) / samples * (held_s / dt)) * np.exp(-0.5 * self.s * held_s)
        self.inside = slice(one.first, one.first + one.frequency_hz.size)
        self.channels = {
            name: self.on_grid(one.segment.logged_bins([name], self.bins)[0]) for name in structure.channels
        }
        self.delays = [effect for effect in structure.composed if effect.response is not None]
        self.late = {name for effect in self.delays for name in effect.names}

    def on_grid(self, spectrum: ComplexArray) -> FloatArray:
        """(..., bins) to (..., grid)."""
        # heavier than NumPy itself to load: only where it is needed
        from scipy.fft import irfft

        return np.asarray(irfft(spectrum, self.grid, axis=-1) * (self.grid / self.one.samples))

    def transform(self, samples: FloatArray) -> ComplexArray:
        """(..., grid) to (..., bins)."""
        # heavier than NumPy itself to load: only where it is needed
        from scipy.fft import rfft

        return np.asarray(rfft(samples, axis=-1)[..., : self.bins] * (self.one.samples / self.grid))

    def commands(self, acting: FloatArray, named: Mapping[str, float]) -> ComplexArray:
        """Acting samples, as `in_time` gives them, to bins (commands, bins), without mean, behind every delay."""
        U = self.one.segment.changed_bins(self.structure.commands, acting, self.bins)
        U[:, 0] = 0
        for effect in self.delays:
            assert effect.response is not None
            U *= effect.response(self.s, {name: named[name] for name in effect.names})
        return U

    def evaluate(
        self, batch: Sequence[Mapping[str, float]], x: FloatArray, u: FloatArray
    ) -> tuple[FloatArray, FloatArray | None]:
        """Rates of states x (batch, n, grid), and what outputs show beside the measured ones (batch, k, grid), if
        anything, with commands u (batch, m, grid)."""
        structure = self.structure
        signals = {
            **{name: x[:, i] for i, name in enumerate(structure.states)},
            **{name: u[:, i] for i, name in enumerate(structure.commands)},
            **self.channels,
        }
        parameters = {name: np.array([at[name] for at in batch])[:, None] for name in structure.names}
        rates, measured = structure.evaluate(parameters, signals)
        rhs = np.empty_like(x)
        for i, state in enumerate(structure.states):
            rhs[:, i] = rates[f"{state}_dot"]
        if all(measured[name] is signals[name] for name in structure.outputs):
            return rhs, None
        return rhs, np.stack([measured[name] - signals[name] for name in structure.outputs], axis=1)

    def transfer(self, A: FloatArray) -> _Transfer:
        modes = Modes.of(A, self.one.dt)
        gains = np.zeros((len(A), self.bins), dtype=complex)
        gains[:, 1:] = 1 / (self.s[1:] - modes.poles[:, None])
        return _Transfer(modes.V, gains, modes.W)


class _Transfer(NamedTuple):
    """(s - A)^-1 of all bins in modal form, nothing at bin zero."""

    V: ComplexArray
    """(n, modes), of modes in states;"""
    gains: ComplexArray
    """(modes, bins)"""
    W: ComplexArray
    """(modes, n)"""

    def modal(self, rates: AnyArray, of: Sequence[int] | slice = slice(None)) -> ComplexArray:
        """Modes (..., modes, bins) that rates of these states (..., states, bins) drive."""
        return np.asarray((self.W[:, of] @ rates) * self.gains)

    def through(self, rates: AnyArray) -> ComplexArray:
        """States (..., n, bins) that rates (..., n, bins) drive."""
        return np.asarray(self.V @ self.modal(rates))

    def ends(self, rows: Sequence[int], part: slice) -> ComplexArray:
        """What each end state does to these states, in some of the bins, (n, rows, bins)."""
        residues = self.W.T[:, None, :] * self.V[rows]
        return np.asarray(residues @ self.gains[:, part])


class _Settled(NamedTuple):
    """A run's response."""

    Y: ComplexArray
    """(k, bins of the band)"""
    E: ComplexArray
    """(n, k, bins of the band)"""
    X: ComplexArray
    """(n, bins), without the free motion."""
    free: ComplexArray
    """(n, bins), the motion that the run's end states account for."""


def _settle(run: _Run, named: Mapping[str, float], U: ComplexArray, ended: bool) -> _Settled:
    """The response to command bins U (m, bins).

    The linear part is that of small motions first, and then the one nearest to the motion itself; of states that hardly
    move, or together, this may be anything, and where relaxations run away from it they stay with the first.
    """
    try:
        return _relaxed(run, named, U, ended, NEARER)
    except RelaxationError:
        with np.errstate(over="ignore", invalid="ignore"):  # what grows without limit is refused by what it reaches
            return _relaxed(run, named, U, ended, 0)


def _relaxed(run: _Run, named: Mapping[str, float], U: ComplexArray, ended: bool, nearer_in: int) -> _Settled:
    """The same, by the linear part as fitted to the motion in the first relaxations, so many."""
    structure, inside = run.structure, run.inside
    n, m = len(structure.states), len(structure.commands)
    A, B = structure.matrices(structure.vector(named))[:2]
    B = B[:, :m]
    rows = run.measured
    u, driven = run.on_grid(U), B @ (U * run.hold)
    transfer = run.transfer(A)
    X = transfer.through(driven)
    # states that only schedule or measure others: no rate tells where they began, but for rounding
    does = np.max(np.abs(transfer.ends(range(n), slice(1, None, THINNED))), axis=2)
    unseen = np.max(does[:, rows], axis=1) <= UNSEEN * np.max(does, axis=1)
    outputs, last = X[rows], np.inf
    before: list[tuple[ComplexArray, FloatArray]] = []
    free = np.zeros_like(X)
    for count in range(RELAXATIONS):
        if count <= nearer_in:  # the last ones by the same linear part
            E = transfer.ends(rows, inside)
            E[unseen] = 0
            explaining = _Explaining.by(_flat(E)) if ended else None
        if explaining is not None:  # the free motion from the run's end states, as the measured rates show it
            ends = explaining.of((run.one.Y - outputs[:, inside]).reshape(-1).view(float))
            free = transfer.through(ends[:, None])
        x = run.on_grid(X + free)
        rates, beside = run.evaluate([named], x[None], u[None])
        other = rates[0] - A @ x - B @ u
        if count < nearer_in:
            nearer = (other @ x.T) @ np.linalg.pinv(x @ x.T, rcond=1e-9, hermitian=True)
            A, other = A + nearer, other - nearer @ x
            transfer = run.transfer(A)
        new = transfer.through(driven + run.transform(other))
        moved = new - X
        change = float(np.max(np.abs(moved)) / max(float(np.max(np.abs(new))), 1e-300))
        if not np.isfinite(change) or change > 1e3:
            raise RelaxationError("the response grows without limit")
        outputs = new[rows] if beside is None else new[rows] + run.transform(beside[0])
        before = (
            [*before[-POINTING:], (new[None], _flat(moved[None]))] if count >= nearer_in and change < STEADY else []
        )
        X = new
        if change < RELAXED:
            break
        if change > 2 * last and change > 0.1:
            raise RelaxationError("the response does not settle")
        last = min(last, change)
        if before:
            X = _pointed_to(before)[0]
    return _Settled(Y=outputs[:, inside], E=E, X=X, free=free)


def _pointed_to(before: Sequence[tuple[AnyArray, FloatArray]]) -> AnyArray:
    """Where each of a batch settles by its last relaxations, each to where and by how much, were these linear (Anderson
    1965)."""
    (there, left), others = before[-1], before[:-1]
    if not others:
        return there
    apart = np.stack([left - moved for _, moved in others], axis=1)
    gram = _settling(apart @ apart.transpose(0, 2, 1))
    shares = (np.linalg.pinv(gram, 1e-10, hermitian=True) @ (apart @ left[:, :, None])).transpose(1, 0, 2)[..., None]
    found: AnyArray = there * (1 - np.sum(shares, axis=0))
    for share, (to, _) in zip(shares, others, strict=True):
        found += share * to
    return found


def _flat(batch: AnyArray) -> FloatArray:
    """(batch, ...) to (batch, real numbers)."""
    return np.ascontiguousarray(batch).reshape(len(batch), -1).view(float)


class _Explaining(NamedTuple):
    """How much of each row of E (n, N) explains something best, by inner products; weak combinations nothing."""

    E: FloatArray
    size: FloatArray
    inverse: FloatArray
    """Of the inner products of rows of size 1."""

    @classmethod
    def by(cls, E: FloatArray) -> _Explaining:
        gram = _settling(E @ E.T)
        size = np.sqrt(np.diag(gram))
        size = np.where(size > 0, size, 1.0)
        return cls(E, size, np.linalg.pinv(gram / np.outer(size, size), ENDS_RANK, hermitian=True))

    def of(self, rest: FloatArray) -> FloatArray:
        """Of what is left (N,) by each row, (n,)."""
        return np.asarray(self.inverse @ (_settling(self.E @ rest) / self.size) / self.size)


def _settling(products: FloatArray) -> FloatArray:
    """The same, where it is finite: LAPACK would print on the terminal what is not."""
    if not np.all(np.isfinite(products)):
        raise RelaxationError("the response grows without limit")
    return products


class _Tangent(NamedTuple):
    """Small motions about the one of a run: the mean over time of how rates and outputs change with the states, and
    what wanders of it."""

    x: FloatArray
    """The run's motion, (n, grid)"""
    transfer: _Transfer
    rows: list[int]
    """States whose rates wander;"""
    columns: list[int]
    """states with which these, or outputs, do."""
    size: FloatArray
    """Of the latter's motion, (columns, 1)"""
    rates: FloatArray
    """(rows, columns, grid)"""
    outputs: FloatArray | None
    """(k, columns, grid), beside what is measured of the states themselves; None where nothing is"""

    @classmethod
    def at(cls, run: _Run, named: Mapping[str, float], X: ComplexArray, u: FloatArray) -> _Tangent:
        """About X (n, bins), with commands u (m, grid), by a small step of each state."""
        structure = run.structure
        x, A = run.on_grid(X), structure.matrices(structure.vector(named)).A
        n = len(x)
        size = np.max(np.abs(x), axis=1, keepdims=True)
        size[size == 0] = 1.0
        stepped = np.concatenate([x[None], x + TANGENT_STEP * size * np.eye(n)[:, :, None]])
        rates, beside = run.evaluate([named] * (n + 1), stepped, np.broadcast_to(u, (n + 1, *u.shape)))
        # of a state's own size: (states, rates or outputs, grid)
        of_rates = (rates[1:] - rates[0]) / TANGENT_STEP - (size * A.T)[:, :, None]
        acting = np.max(np.abs(of_rates), axis=2) > ROUNDING * np.max(np.abs(rates[0]), axis=1)
        of_rates *= acting[:, :, None] / size[:, :, None]
        mean = np.mean(of_rates, axis=2)
        rows = np.flatnonzero(acting.any(axis=0)).tolist()
        columns, measured = acting.any(axis=1), None
        if beside is not None:
            of_outputs = (beside[1:] - beside[0]) / TANGENT_STEP
            seen = np.max(np.abs(of_outputs), axis=2) > ROUNDING * np.max(np.abs(x[run.measured] + beside[0]), axis=1)
            columns |= seen.any(axis=1)
            measured = (of_outputs * seen[:, :, None] / size[:, :, None])[columns].transpose(1, 0, 2)
        wandering = (of_rates - mean[:, :, None])[np.ix_(columns, rows)].transpose(1, 0, 2)
        numbers = np.flatnonzero(columns).tolist()
        return cls(x, run.transfer(A + mean.T), rows, numbers, size[numbers], wandering, measured)

    def settled(self, run: _Run, driving: ComplexArray) -> tuple[ComplexArray, FloatArray | None]:
        """Small motions that rates (batch, n, bins) drive: the measured states (batch, k, bins), and what outputs show
        beside them (batch, k, grid), if anything."""
        V, columns = self.transfer.V, self.columns
        modes = self.transfer.modal(driving)
        if not columns:
            return V[run.measured] @ modes, None
        plain = run.on_grid(V[columns] @ modes) / self.size
        moving, settled, answered = plain, plain, np.zeros_like(modes)
        before: list[tuple[FloatArray, FloatArray]] = []
        for _ in range(RELAXATIONS if self.rows else 0):
            rates = np.einsum("rct,bct->brt", self.rates, self.size * moving)
            answered = self.transfer.modal(run.transform(rates), self.rows)
            settled = plain + run.on_grid(V[columns] @ answered) / self.size
            moved = settled - moving
            change, most = (np.max(np.abs(one), axis=(1, 2)) for one in (moved, settled))
            if not np.all(np.isfinite(change)):
                raise RelaxationError("the response grows without limit")
            before.append((settled, _flat(moved)))
            if np.all(change <= DIFFERENCE_RELAXED * most):
                break
            moving = _pointed_to(before)
        beside = None if self.outputs is None else np.einsum("kct,bct->bkt", self.outputs, self.size * settled)
        return V[run.measured] @ (modes + answered), beside


def _settle_beside(
    run: _Run, tangent: _Tangent, batch: Sequence[Mapping[str, float]], U: Sequence[ComplexArray]
) -> ComplexArray:
    """How far outputs (batch - 1, k, bins of the band) at values near the settled ones, which come first, are from
    theirs; one free motion.

    The first are evaluated together with the others, so that what changes nothing has a difference of zero.
    """
    m, bins = len(run.structure.commands), np.stack(U)
    u = run.on_grid(bins)
    rates, outputs = run.evaluate(batch, np.broadcast_to(tangent.x, (len(batch), *tangent.x.shape)), u)
    B = run.structure.matrices(np.stack([run.structure.vector(at) for at in batch])).B[..., :m].real
    held, other = B @ (bins * run.hold), rates - B @ u
    moved, beside = tangent.settled(run, held[1:] - held[0] + run.transform(other[1:] - other[0]))
    if outputs is not None:
        beside = outputs[1:] - outputs[0] + (0.0 if beside is None else beside)
    if beside is not None:
        moved = moved + run.transform(beside)
    return np.asarray(moved[..., run.inside])
