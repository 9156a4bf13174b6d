"""The fit of a bare base in two milliseconds: the same criterion as `sysid.fit.estimate`, written for speed.

Every row of the normal equations is D(s)^-1 times signals that stand in the two equations: outputs and their
derivatives, commands, end states, and what the equations leave. So inner products of rows are sums over the bins of
f_i* M_ab f_j with few signals f and M = D^-H W D^-1 (2, 2): one small matrix product each pass, and a table of which
row has which signal in which equation does the rest. With M of the last D the same sums solve the equation error, and
with the residual's smoothed spectra for W they are the estimate's variance.

All runs lie side by side in padded arrays. The start is the equation error's reweighted solution on every fourth bin;
Gauss-Newton follows there, then on all bins. `sysid.fit.estimate` is the reference that the tests hold this
against; where this does not apply, or ends in a poor fit, that one is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.rows import smooth
from sysid.model.form import Form
from sysid.model.polynomial import closed_form, exact_enough, inverse, signals
from sysid.model.structure import COMPLEX_STEP, FloatArray, Structure, stepped

THINNING = 4
FEWEST_BINS = 200
"""Of all runs together after thinning."""
CORNER = 3.0  # rad/s
SLOPES = (1.0, 0.0)
REWEIGHTINGS = 2
GOOD_SHARE = 0.1
"""Of the measured power, that a start may leave."""
STEPS = 20
ROUGH, FINE = (5e-2, 1.0), (3e-6, 0.02)
"""When to stop, on the thinned bins and on all: the gain in summed logarithms of residual power that the last step
promises, and the relative change of residual power up to which the outputs need not be weighed anew."""
SMALLEST_LENGTH = 1e-3
RIDGE = 1e-11


class FastFit(NamedTuple):
    """The optimum and what its surroundings say; powers as in `sysid.fit.output_error.OutputError`."""

    values: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    coefficient_covariance: FloatArray
    measured_power: FloatArray
    residual_power: FloatArray
    residuals: list[ComplexArray]
    """For every run (2, bins), end states projected out, both outputs counting the same."""

    @property
    def vagueness(self) -> FloatArray:
        """(2,): how well each command's effect is known at best, its standard error over itself."""
        found = np.sqrt(np.maximum(np.diag(self.coefficient_covariance)[-4:], 0)) / np.abs(self.coefficients[-4:])
        return np.asarray(np.min(found.reshape(2, 2), axis=0))


class _Layout(NamedTuple):
    """Where the signals of a form stand: first those of equation 0 alone, then of both, then of equation 1 alone."""

    order: tuple[int, ...]
    """Of each row its number among `polynomial.signals`, the two targets s^order Y, and the end states' signals."""
    own: int
    """How many signals each equation has alone."""
    table: FloatArray
    """(1 + coefficients + end states, 2, signals): by equation, the signals of the target, of what each coefficient
    multiplies, and of the end states, for every order of s one in each axis."""
    outputs: slice
    derivatives: slice
    targets: slice
    ends: slice


@lru_cache
def _layout(form: Form) -> _Layout:
    targets = 2 * form.order + 2
    ends = targets + 2
    count = ends + form.order + 1
    table = np.zeros((1 + form.coefficients + 2 * form.order, 2, count))
    for row, places in enumerate(form.places, 1):
        for equation, signal, sign in places:
            table[row, equation, signal] = sign
    for equation in (0, 1):
        table[0, equation, targets + equation] = 1
        for power in range(form.order):
            table[1 + form.coefficients + 2 * power + equation, equation, ends + power] = 1
    used = np.any(table, axis=0)
    used[:, -1] = True  # by `_rows`
    order = np.argsort(np.where(used[0], used[1], 2), kind="stable").tolist()

    def both(first: int) -> slice:
        one, other = order.index(first), order.index(first + 1)
        return slice(one, other + 1, other - one)

    derivatives = both(2) if form.order == 2 else slice(0)
    last = slice(order.index(ends), order.index(ends) + form.order + 1)
    own = int(np.count_nonzero(~used[1]))
    return _Layout(
        order=tuple(order),
        own=own,
        table=table[:, :, order],
        outputs=both(0),
        derivatives=derivatives,
        targets=both(targets),
        ends=last,
    )


@dataclass(frozen=True, eq=False)
class _Grid:
    """Bins of all runs, every sample of every run counting the same, padded with zeros to equal number."""

    form: Form
    s: ComplexArray
    """(runs, bins)"""
    known: ComplexArray
    """(runs, signals + 2, bins), as laid out, times sqrt(2/n): measured outputs, commands with what holding does; last
    the commands' images as far as they come into both equations."""
    moving: ComplexArray
    """(runs, signals, bins): the same, but in every pass anew the model's outputs, and what the equations leave for
    the targets."""
    room: ComplexArray
    """(runs, 3 signals, bins), written anew in every pass."""

    @property
    def measured(self) -> ComplexArray:
        """(runs, 2, bins)"""
        return self.known[:, _layout(self.form).outputs]

    def thin(self) -> _Grid:
        known = self.known[..., ::THINNING].copy()
        moving = self.moving[..., ::THINNING].copy()
        return _Grid(self.form, self.s[:, ::THINNING].copy(), known, moving, np.empty_like(self.room[..., ::THINNING]))


class _Normal(NamedTuple):
    """Normal equations of one linearisation, end states projected out."""

    curvature: FloatArray
    gradient: FloatArray
    power: FloatArray
    """(2,), of the residual."""
    rest: ComplexArray
    """(runs, 2, bins): the residual."""
    ends: FloatArray
    """(runs, end states)"""
    rows: FloatArray
    """(runs, coefficients, 2 signals): the sensitivities' rows of the table, end states projected out."""
    inverse: ComplexArray
    """(2, 2, runs, bins): D(s)^-1."""
    weight: FloatArray
    """(2,): of the outputs' power."""


def applies(structure: Structure, stacks: list[Stack]) -> bool:
    """A form is of two outputs and two commands: everything else is fitted through the matrices."""
    return closed_form(structure) is not None and len(stacks) == 1 and exact_enough(stacks[0])


def fit(structure: Structure, stack: Stack) -> FastFit | None:
    """None where no solution is found; the caller then takes the long way."""
    form = structure.base_.form
    assert form is not None
    whole = _grid(form, stack)
    measured = _power(whole.measured)
    if not np.all(measured > 0):
        return None
    thin = whole.thin() if stack.z.size >= THINNING * FEWEST_BINS else whole
    try:
        begun = _start(thin)
        if begun is None:
            return None
        c, last = _descend(thin, *begun, ROUGH)
        c, last = _descend(whole, c, last.power * (whole.s.size / thin.s.size), last.ends, FINE)
        covariance = _covariance(whole, stack, last)
        values = form.to_parameters(c)
        to = form.of_parameters(stepped(values)).imag / COMPLEX_STEP
        back = np.linalg.inv(to.T)
        left, rest, _ = _left(whole, c, np.ones(2))
    except np.linalg.LinAlgError:
        return None
    residuals = [
        rest[run, :, : part.stop - part.start] / stack.scale[part.start] for run, part in enumerate(stack.slices)
    ]
    return FastFit(
        values=values,
        coefficients=c,
        covariance=back @ covariance @ back.T,
        coefficient_covariance=covariance,
        measured_power=measured,
        residual_power=left,
        residuals=residuals,
    )


def _grid(form: Form, stack: Stack) -> _Grid:
    at, layout = stack.sampling(form.order), _layout(form)
    lead = at.s ** (form.order - 1)
    # images are those of the response's leading term, which D(s) turns into these and a share by its second term
    images = lead * at.images * stack.U[:2]
    U = at.hold * stack.U[:2] + at.s * images
    # what one end state does is exact in its leading term and the second, which alone the axes share
    ends = [lead * (1 + at.s * at.jump), lead * (at.jump - at.s * at.bend)]
    if form.order == 2:
        ends.insert(0, 1 + at.s**2 * at.bend)
    listed = [*signals(form, at.s, stack.Y, U), *(at.s**form.order * stack.Y), *ends]
    rows = np.stack([*(listed[number] for number in layout.order), *images]) * stack.scale
    runs, bins = len(stack.slices), max(part.stop - part.start for part in stack.slices)
    s = np.full((runs, bins), 1j)
    # one block: of many smaller ones an allocator gives the pages back, and every fit would take them anew
    count = len(layout.order)
    block = np.empty(runs * (5 * count + 2) * bins, dtype=complex)
    known, moving, room = (
        part.reshape(runs, -1, bins)
        for part in np.split(block, [runs * (count + 2) * bins, runs * (2 * count + 2) * bins])
    )
    for run, part in enumerate(stack.slices):
        size = part.stop - part.start
        s[run, :size] = at.s[part]
        known[run, :, :size] = rows[:, part]
        known[run, :, size:] = 0
    moving[:] = known[:, :count]
    return _Grid(form, s, known, moving, room)


def _power(x: ComplexArray) -> FloatArray:
    """(runs, 2, bins) -> (2,)"""
    flat = x.view(float)
    return np.asarray(np.einsum("rij,rij->i", flat, flat))


def _weights(power: FloatArray) -> FloatArray:
    return np.asarray(1 / np.maximum(power, 1e-12 * max(float(power.max()), 1e-300)))


def _rows(form: Form, c: FloatArray) -> FloatArray:
    """The layout's table at these coefficients: last end states come into both equations, by D's second term."""
    layout = _layout(form)
    table = layout.table.copy()
    table[-2:, :, layout.ends.stop - 1] = -form.second(c).T
    return table


def _metric(K: ComplexArray, weight: FloatArray) -> ComplexArray:
    """M = K^H W K, as `_between`, with the outputs' weights (2,)."""
    return _between(K, weight[:, None, None, None] * K)


def _between(K: ComplexArray, SK: ComplexArray) -> ComplexArray:
    """K^H S K (3, runs, bins) from K and S K (2, 2, runs, bins): the entries 00, 11 and 01."""
    conjugate = K.conj()
    M = np.empty((3, *K.shape[2:]), dtype=complex)
    np.multiply(conjugate[0], SK[0], out=M[:2])
    M[:2] += conjugate[1] * SK[1]
    np.multiply(conjugate[0, 0], SK[0, 1], out=M[2])
    M[2] += conjugate[1, 0] * SK[1, 1]
    return M


def _gram(F: ComplexArray, own: int, M: ComplexArray, room: ComplexArray) -> FloatArray:
    """Sums over the bins of f_i* M_ab f_j for every run: (runs, 2 n, 2 n), the n signals of each equation in turn.

    `F` (runs, signals, bins), as laid out with `own` signals in each equation alone; M (3, runs, bins).
    """
    n = F.shape[1] - own
    one, other = F[:, :n], F[:, own:]
    products, W = room[:, : 3 * n], M[:, :, None]
    np.multiply(W[0], one, out=products[:, :n])
    np.multiply(W[2], other, out=products[:, n : 2 * n])
    np.multiply(W[1], other, out=products[:, 2 * n :])
    right = products.view(float).transpose(0, 2, 1)
    found = np.empty((F.shape[0], 2 * n, 2 * n))
    np.matmul(one.view(float), right[:, :, : 2 * n], out=found[:, :n])
    np.matmul(other.view(float), right[:, :, 2 * n :], out=found[:, n:, n:])
    found[:, n:, :n] = found[:, :n, n:].transpose(0, 2, 1)
    return found


def _by_equation(rows: FloatArray, own: int) -> FloatArray:
    """Rows (rows, 2, signals) -> (rows, 2 n), the n signals of each equation in turn."""
    return np.concatenate([rows[:, 0, : rows.shape[2] - own], rows[:, 1, own:]], axis=1)


def _project(gram: FloatArray, rows: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Inner products of the rows (rows, 2 signals), the last n, end states, projected out of the others.

    Returns them, summed over runs, and how much of each row the end states explain, (runs, n, others).
    """
    products = rows @ gram @ rows.T
    cross = products[:, -n:, :-n]
    explained = np.linalg.solve(products[:, -n:, -n:] * (1 + RIDGE * np.eye(n)), cross)
    left = products[:, :-n, :-n] - cross.transpose(0, 2, 1) @ explained
    return np.asarray(left.sum(axis=0)), np.asarray(explained)


def _solve(H: FloatArray, g: FloatArray) -> FloatArray:
    size = np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.asarray(np.linalg.solve(H / np.outer(size, size) + 1e-14 * np.eye(size.size), g / size) / size)


def _start(grid: _Grid) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """A solution of the equation error weighted by its own denominator, its residual power and its end states.

    It begins weighted by a power of frequency; the next one is tried where much is left.
    """
    form, measured = grid.form, _power(grid.measured)
    weight = _weights(measured)
    best: tuple[float, FloatArray, FloatArray, FloatArray] | None = None
    for slope in SLOPES:
        M = np.zeros((3, *grid.s.shape), dtype=complex)
        M[:2] = weight[:, None, None] * (CORNER + np.abs(grid.s)) ** (-2 * slope)
        c = _equation_error(grid, M)
        with np.errstate(all="ignore"):
            for _ in range(REWEIGHTINGS):
                c = _equation_error(grid, _metric(inverse(form.denominator(grid.s, c)), weight))
            if not np.all(np.isfinite(c)) or not np.all(np.isfinite(form.to_parameters(c))):
                continue
            power, _, ends = _left(grid, c, weight)
        cost = float(np.sum(np.log(power)))
        if np.isfinite(cost) and (best is None or cost < best[0]):
            best = (cost, c, power, ends)
        if np.all(power < GOOD_SHARE * measured):
            break
    return None if best is None else best[1:]


def _equation_error(grid: _Grid, M: ComplexArray) -> FloatArray:
    """Coefficients of the linear equation error, its residuals weighted by M."""
    layout = _layout(grid.form)
    gram = _gram(grid.known[:, : len(layout.order)], layout.own, M, grid.room)
    found, _ = _project(gram, _by_equation(layout.table, layout.own), 2 * grid.form.order)
    return _solve(found[1:, 1:], found[1:, 0])


def _equations(grid: _Grid, c: FloatArray, rows: FloatArray, ends: FloatArray) -> ComplexArray:
    """What the equations leave of the measured outputs at these coefficients and end states, (runs, 2, bins)."""
    taken = np.empty((ends.shape[0], rows.shape[0]))
    taken[:, 0], taken[:, 1 : 1 + c.size], taken[:, 1 + c.size :] = 1, -c, -ends
    share = np.empty((ends.shape[0], 2, grid.known.shape[1]))
    share[:, :, :-2] = (taken @ rows.reshape(rows.shape[0], -1)).reshape(-1, *rows.shape[1:])
    share[:, :, -2:] = grid.form.second(c) @ c[-4:].reshape(2, 2)
    found: FloatArray = share @ grid.known.view(float)
    return found.view(complex)


def _through(K: ComplexArray, x: ComplexArray) -> ComplexArray:
    """K (2, 2, runs, bins) times x (runs, 2, bins)."""
    found = np.empty_like(x)
    for output in (0, 1):
        np.multiply(K[output, 0], x[:, 0], out=found[:, output])
        found[:, output] += K[output, 1] * x[:, 1]
    return found


def _left(grid: _Grid, c: FloatArray, weight: FloatArray) -> tuple[FloatArray, ComplexArray, FloatArray]:
    """Residual power, residual (runs, 2, bins) and end states (runs, n), these with outputs weighted as given."""
    form, layout, n = grid.form, _layout(grid.form), 2 * grid.form.order
    K, rows = inverse(form.denominator(grid.s, c)), _rows(form, c)
    residual = _equations(grid, c, rows, np.zeros((grid.s.shape[0], n)))
    ends = grid.known[:, layout.ends]
    F = np.concatenate([residual[:, :1], ends, residual[:, 1:]], axis=1)
    gram = _gram(F, 1, _metric(K, weight), grid.room)
    some = np.zeros((1 + n, 2, F.shape[1]))
    some[0, 0, 0] = some[0, 1, -1] = 1
    some[1:, :, 1:-1] = rows[-n:, :, layout.ends]
    _, explained = _project(gram, _by_equation(some, 1), n)
    rest = _through(K, _equations(grid, c, rows, explained[:, :, 0]))
    return _power(rest), rest, explained[:, :, 0]


def _linearise(grid: _Grid, c: FloatArray, power: FloatArray, ends: FloatArray) -> _Normal:
    """Normal equations of the output error at these coefficients, the outputs weighed by the given powers.

    `ends` is the last pass's: the free motion from them changes with the coefficients, too. Images' share by D's second
    term is left out of the sensitivities, where it is below 2e-3 at the band's end.
    """
    form, layout, weight = grid.form, _layout(grid.form), _weights(power)
    K, rows = inverse(form.denominator(grid.s, c)), _rows(form, c)
    residual, F = _equations(grid, c, rows, ends), grid.moving
    F[:, layout.outputs] = grid.measured - _through(K, residual)
    if form.order == 2:
        F[:, layout.derivatives] = grid.s[:, None] * F[:, layout.outputs]
    F[:, layout.targets] = residual
    gram = _gram(F, layout.own, _metric(K, weight), grid.room)
    n, flat = 2 * form.order, _by_equation(rows, layout.own)
    products, explained = _project(gram, flat, n)
    ends = ends + explained[:, :, 0]
    rest = _through(K, _equations(grid, c, rows, ends))
    left = flat[1:-n] - explained[:, :, 1:].transpose(0, 2, 1) @ flat[-n:]
    return _Normal(
        curvature=products[1:, 1:],
        gradient=products[1:, 0],
        power=_power(rest),
        rest=rest,
        ends=ends,
        rows=left,
        inverse=K,
        weight=weight,
    )


def _descend(
    grid: _Grid, c: FloatArray, power: FloatArray, ends: FloatArray, enough: tuple[float, float]
) -> tuple[FloatArray, _Normal]:
    """Gauss-Newton with step halving on sum log(power); ends with the last pass and the step that it promises."""
    here, weighed_by = _linearise(grid, c, power, ends), power
    for _ in range(STEPS):
        move = _solve(here.curvature, here.gradient)
        if not float(here.gradient @ move) > enough[0]:
            if np.all(np.abs(here.power - weighed_by) < enough[1] * here.power):
                return c + move, here
            here, weighed_by = _linearise(grid, c, here.power, here.ends), here.power
            continue
        goal, length = float(np.sum(np.log(here.power))), 1.0
        while True:
            there = _linearise(grid, c + length * move, here.power, here.ends)
            reached = float(np.sum(np.log(there.power)))
            if np.isfinite(reached) and reached < goal:
                break
            length /= 2
            if length < SMALLEST_LENGTH:
                return c, _linearise(grid, c, here.power, here.ends)
        c, here, weighed_by = c + length * move, there, here.power
    return c, here


def _covariance(grid: _Grid, stack: Stack, last: _Normal) -> FloatArray:
    """As `sysid.fit.estimate`, of the coefficients; the last pass's signals are still in the room."""
    e = np.sqrt(last.weight)[:, None] * last.rest
    cross = e[:, 0] * e[:, 1].conj()
    own = e.view(float) ** 2
    spectra = np.stack([*(own[..., ::2] + own[..., 1::2]).swapaxes(0, 1), cross.real, cross.imag], axis=-1)
    for run, part in enumerate(stack.slices):
        size = part.stop - part.start
        spectra[run, :size] = smooth(spectra[run, :size], stack.frequency_hz[part])
    WK = np.sqrt(last.weight)[:, None, None, None] * last.inverse
    between = spectra[..., 2] + 1j * spectra[..., 3]
    SK = np.stack([spectra[..., 0] * WK[0] + between * WK[1], between.conj() * WK[0] + spectra[..., 1] * WK[1]])
    gram = _gram(grid.moving, _layout(grid.form).own, _between(WK, SK), grid.room)
    variance = 0.5 * np.sum(last.rows @ gram @ last.rows.transpose(0, 2, 1), axis=0)
    size = np.sqrt(np.diag(last.curvature))
    if not np.all(size > 0):
        raise np.linalg.LinAlgError("a coefficient does not show")
    inner = np.linalg.inv(last.curvature / np.outer(size, size)) / np.outer(size, size)
    return np.asarray(inner @ variance @ inner)
