"""The fit of a bare base in a few milliseconds: the same criterion as `sysid.fit`, written for speed.

All runs lie side by side in padded arrays, so that a pass over the data is some twenty NumPy calls whatever their
number: the equation error's reweighted solutions on every fourth bin, Gauss-Newton there, then two passes over all
bins. Sums over runs, end states projected out, are small Gram matrices. `sysid.fit` is the reference that the tests
hold this against; where this does not apply, or ends in a poor fit, that one is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sysid.model import COMPLEX_STEP, AnyArray, FloatArray, Structure, stepped
from sysid.polynomial import FORMS, Form, exact_enough
from sysid.predict import Stack
from sysid.preprocess import ComplexArray

THINNING = 4
FEWEST_BINS = 200
"""Of all runs together after thinning."""
CORNER = 3.0  # rad/s
SLOPES = (0.0, 1.0)
REWEIGHTINGS = 3
STEPS = 20
ROUGH = 1e-3
FINE = 1e-6
"""Promised gain in summed logarithms of residual power at which to stop: on the thinned bins, on all."""
SMALLEST_LENGTH = 1e-3
RIDGE = 1e-11
SETTLED = 0.02
"""Relative change of residual power from which on the outputs are weighed anew."""


class FastFit(NamedTuple):
    """The optimum and what its surroundings say; powers as in `sysid.fit.OutputError`."""

    values: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    coefficient_covariance: FloatArray
    measured_power: FloatArray
    residual_power: FloatArray

    @property
    def vagueness(self) -> FloatArray:
        """(2,): how well each command's effect is known at best, its standard error over itself."""
        found = np.sqrt(np.maximum(np.diag(self.coefficient_covariance)[-4:], 0)) / np.abs(self.coefficients[-4:])
        return np.asarray(np.min(found.reshape(2, 2), axis=0))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Bins of all runs, padded to equal number: arrays (runs, bins); the mask is zero in the padding."""

    s: ComplexArray
    Y: ComplexArray
    """(2, runs, bins)"""
    held: ComplexArray
    images: ComplexArray
    jump: ComplexArray
    bend: ComplexArray
    scale: FloatArray
    """(runs, bins): sqrt(2/n), zero in the padding."""
    room: ComplexArray
    """(runs, rows, 2, bins), written anew in every pass."""

    def thin(self) -> _Grid:
        def some(x: AnyArray) -> AnyArray:
            return np.ascontiguousarray(x[..., ::THINNING])

        return _Grid(
            some(self.s),
            some(self.Y),
            some(self.held),
            some(self.images),
            some(self.jump),
            some(self.bend),
            some(self.scale),
            some(self.room),
        )


class _Pass(NamedTuple):
    curvature: FloatArray
    gradient: FloatArray
    power: FloatArray
    rest: ComplexArray
    """(runs, 2, bins): the residual, weighted, end states projected out."""
    ends: FloatArray
    """(runs, end states, 1 + coefficients): how much of each row the end states explain."""
    free: ComplexArray
    """(2, runs, bins): the motion that the end states account for."""


def applies(structure: Structure, stacks: list[Stack]) -> bool:
    return not structure.composed and len(stacks) == 1 and exact_enough(stacks[0])


def fit(structure: Structure, stack: Stack) -> FastFit | None:
    """None where no solution is found; the caller then takes the long way."""
    form = FORMS[structure.base]
    whole = _grid(form, stack)
    measured = np.sum((whole.scale * np.abs(whole.Y)) ** 2, axis=(1, 2))
    if not np.all(measured > 0):
        return None
    thin = whole.thin() if stack.z.size >= THINNING * FEWEST_BINS else whole
    try:
        c = _start(form, thin, measured)
        if c is None:
            return None
        c, last = _descend(form, thin, c, measured, ROUGH)
        c, last = _descend(form, whole, c, last.power * (measured / _measured(thin)), FINE)
        covariance = _covariance(form, whole, stack, last)
        values = form.to_parameters(c)
        to = form.of_parameters(stepped(values)).imag / COMPLEX_STEP
        back = np.linalg.inv(to.T)
    except np.linalg.LinAlgError:
        return None
    return FastFit(values, c, back @ covariance @ back.T, covariance, measured, last.power)


def _grid(form: Form, stack: Stack) -> _Grid:
    at = stack.sampling(form.order)
    runs, bins = len(stack.slices), max(part.stop - part.start for part in stack.slices)
    images, held = at.images * stack.U[:2], at.hold * stack.U[:2]
    equal = all(part.stop - part.start == bins for part in stack.slices)

    def padded(x: AnyArray, filling: complex = 0.0) -> AnyArray:
        if equal:
            return x.reshape(*x.shape[:-1], runs, bins)
        found = np.full((*x.shape[:-1], runs, bins), filling, dtype=x.dtype)
        for run, part in enumerate(stack.slices):
            found[..., run, : part.stop - part.start] = x[..., part]
        return found

    rows = 1 + form.coefficients + 2 * form.order
    return _Grid(
        padded(at.s, 1j),
        padded(stack.Y),
        padded(held),
        padded(images),
        padded(at.jump),
        padded(at.bend),
        padded(stack.scale),
        np.empty((runs, rows, 2, bins), dtype=complex),
    )


def _measured(grid: _Grid) -> FloatArray:
    return np.asarray(np.sum((grid.scale * np.abs(grid.Y)) ** 2, axis=(1, 2)))


def _axis_weights(power: FloatArray) -> FloatArray:
    return 1 / np.sqrt(np.maximum(power, 1e-12 * max(float(power.max()), 1e-300)))


def _inverse(form: Form, s: ComplexArray, c: FloatArray) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    d00, d01, d10, d11 = form.denominator(s, c)
    scale = 1 / (d00 * d11 - d01 * d10)
    return d11 * scale, -d01 * scale, -d10 * scale, d00 * scale


def _fill(
    form: Form, grid: _Grid, inner: tuple[AnyArray, ...], Y: ComplexArray, with_images: FloatArray | None
) -> None:
    """Rows of all coefficients and end states into the room, from weighted D^-1 entries and the outputs Y."""
    room, s = grid.room, grid.s
    w00, w01, w10, w11 = inner
    column = (np.stack([w00, w10]), np.stack([w01, w11]))  # (axis, runs, bins) for a unit in either equation

    def put(row: int, axis: int, factor: AnyArray) -> None:
        np.multiply(column[axis].transpose(1, 0, 2), factor[:, None], out=room[:, row])

    if form.order == 2:
        put(1, 0, -Y[0])
        put(2, 1, -Y[1])
        np.add(room[:, 1], room[:, 2], out=room[:, 3])
        room[:, 3] *= s[:, None]
        put(4, 0, s * Y[1])
        put(5, 1, s * Y[0])
        row = 6
    else:
        put(1, 0, Y[0])
        put(2, 0, Y[1])
        put(3, 1, Y[0])
        put(4, 1, Y[1])
        row = 5
    for axis in (0, 1):
        for held in grid.held:
            put(row, axis, held)
            row += 1
    if with_images is not None:
        for axis in (0, 1):
            for number in (0, 1):
                room[:, row - 4 + 2 * axis + number, axis] += with_images[axis] * grid.images[number]
    for axis in (0, 1):
        room[:, row + axis] = column[axis].transpose(1, 0, 2)
    if form.order == 2:
        np.multiply(room[:, row : row + 2], s[:, None, None], out=room[:, row + 2 : row + 4])


def _reduce(form: Form, grid: _Grid) -> tuple[FloatArray, FloatArray]:
    """Inner products of the rows, (1 + coefficients) square, and what of each the end states explain."""
    room = grid.room
    flat = room.reshape(*room.shape[:2], -1).view(float)
    gram = flat @ flat.transpose(0, 2, 1)
    n = 2 * form.order
    size = np.sqrt(np.einsum("rii->ri", gram[:, -n:, -n:]))
    size = np.where(size > 0, size, 1.0)
    inner = gram[:, -n:, -n:] / (size[:, :, None] * size[:, None, :]) + RIDGE * np.eye(n)
    cross = gram[:, -n:, :-n] / size[:, :, None]
    solved = np.linalg.solve(inner, cross)
    left = gram[:, :-n, :-n] - cross.transpose(0, 2, 1) @ solved
    return left.sum(axis=0), solved / size[:, :, None]


def _solve(H: FloatArray, g: FloatArray) -> FloatArray:
    size = np.sqrt(np.maximum(np.diag(H), 1e-300))
    return np.asarray(np.linalg.solve(H / np.outer(size, size) + 1e-14 * np.eye(size.size), g / size) / size)


def _equation_error(form: Form, grid: _Grid, measured: FloatArray, last: FloatArray | None, slope: float) -> FloatArray:
    """Coefficients of the linear equation error, weighted by the last denominator or a power of frequency."""
    w = grid.scale[None] / np.sqrt(measured)[:, None, None]
    if last is None:
        flat = (CORNER + np.abs(grid.s)) ** -slope
        zero = np.zeros_like(grid.s)
        entries: tuple[AnyArray, ...] = (flat + zero, zero, zero, flat + zero)
    else:
        entries = _inverse(form, grid.s, last)
    inner = (w[0] * entries[0], w[0] * entries[1], w[1] * entries[2], w[1] * entries[3])
    _fill(form, grid, inner, grid.Y, None)
    target = grid.s**form.order * grid.Y
    grid.room[:, 0, 0] = inner[0] * target[0] + inner[1] * target[1]
    grid.room[:, 0, 1] = inner[2] * target[0] + inner[3] * target[1]
    gram, _ = _reduce(form, grid)
    return _solve(gram[1:, 1:], gram[1:, 0])


def _start(form: Form, grid: _Grid, measured: FloatArray) -> FloatArray | None:
    best: tuple[float, FloatArray] | None = None

    def judge(c: FloatArray) -> None:
        nonlocal best
        with np.errstate(all="ignore"):
            sound = np.all(np.isfinite(c)) and np.all(np.isfinite(form.to_parameters(c)))
        if sound:
            cost = float(np.sum(np.log(_linearise(form, grid, c, measured).power)))
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = (cost, c)

    for slope in SLOPES:
        judge(_equation_error(form, grid, measured, None, slope))
    if best is None:
        return None
    c = best[1]
    for _ in range(REWEIGHTINGS):
        c = _equation_error(form, grid, measured, c, 0.0)
        if not np.all(np.isfinite(c)):
            break
    judge(c)
    return best[1]


def _linearise(form: Form, grid: _Grid, c: FloatArray, power: FloatArray, free: ComplexArray | float = 0.0) -> _Pass:
    """Residual and sensitivities of the output error at these coefficients, weighed by the given powers.

    `free` is the last pass's free motion: it changes with the coefficients, too.
    """
    i00, i01, i10, i11 = _inverse(form, grid.s, c)
    N = c[-4:]
    d0 = N[0] * grid.held[0] + N[1] * grid.held[1]
    d1 = N[2] * grid.held[0] + N[3] * grid.held[1]
    Y = np.stack([i00 * d0 + i01 * d1, i10 * d0 + i11 * d1])
    weight = _axis_weights(power)
    w = weight[:, None, None] * grid.scale
    _fill(form, grid, (w[0] * i00, w[0] * i01, w[1] * i10, w[1] * i11), Y + free, w)
    room, n = grid.room, 2 * form.order
    for axis in (0, 1):
        room[:, -2 + axis, axis] += w[axis] * grid.jump
    second = form.second(c)
    for axis in (0, 1):
        for output in (0, 1):
            room[:, -2 + axis, output] += second[output, axis] * w[output] * grid.bend
        if form.order == 2:
            room[:, -4 + axis, axis] += w[axis] * grid.bend
    for axis in (0, 1):
        seen = Y[axis] + N[2 * axis] * grid.images[0] + N[2 * axis + 1] * grid.images[1]
        room[:, 0, axis] = w[axis] * (grid.Y[axis] - seen)
    gram, ends = _reduce(form, grid)
    rest = room[:, 0] - np.einsum("re,rekb->rkb", ends[:, :, 0], room[:, -n:])
    left = np.sum(np.abs(rest) ** 2, axis=(0, 2)) / weight**2
    moved = (room[:, 0] - rest).transpose(1, 0, 2) / np.where(w > 0, w, 1.0)
    return _Pass(gram[1:, 1:], gram[1:, 0], left, rest, ends, moved)


def _descend(form: Form, grid: _Grid, c: FloatArray, power: FloatArray, enough: float) -> tuple[FloatArray, _Pass]:
    """Gauss-Newton with step halving on sum log(power); ends with the pass at the last coefficients."""
    here, weighed_by = _linearise(form, grid, c, power), power
    for _ in range(STEPS):
        if not np.allclose(weighed_by, here.power, rtol=SETTLED):
            here, weighed_by = _linearise(form, grid, c, here.power, here.free), here.power
        move = _solve(here.curvature, here.gradient)
        if not float(here.gradient @ move) > enough:
            break
        goal, length = float(np.sum(np.log(here.power))), 1.0
        while True:
            there = _linearise(form, grid, c + length * move, here.power, here.free)
            reached = float(np.sum(np.log(there.power)))
            if np.isfinite(reached) and reached < goal:
                break
            length /= 2
            if length < SMALLEST_LENGTH:
                return c, _linearise(form, grid, c, here.power, here.free)
        c, here, weighed_by = c + length * move, there, here.power
    return c, here


def _covariance(form: Form, grid: _Grid, stack: Stack, last: _Pass) -> FloatArray:
    """As `sysid.fit._covariance`, of the coefficients."""
    from sysid.fit import smooth

    n, count = 2 * form.order, form.coefficients
    room = grid.room
    J = room[:, 1 : 1 + count] - np.einsum("rec,rekb->rckb", last.ends[:, :, 1:], room[:, -n:], optimize=True)
    variance = np.zeros((count, count))
    for run, part in enumerate(stack.slices):
        size = part.stop - part.start
        e = last.rest[run, :, :size]
        cross = np.stack([np.abs(e[0]) ** 2, np.abs(e[1]) ** 2, *_parts(e[0] * e[1].conj())], axis=1)
        S = smooth(cross, stack.frequency_hz[part]).T
        between = S[2] + 1j * S[3]
        mine = J[run, :, :, :size]
        SJ = np.stack(
            [S[0] * mine[:, 0] + between * mine[:, 1], between.conj() * mine[:, 0] + S[1] * mine[:, 1]], axis=1
        )
        flat = np.ascontiguousarray(mine).reshape(count, -1).view(float)
        variance += 0.5 * (flat @ SJ.reshape(count, -1).view(float).T)
    size = np.sqrt(np.diag(last.curvature))
    if not np.all(size > 0):
        raise np.linalg.LinAlgError("a coefficient does not show")
    inverse = np.linalg.inv(last.curvature / np.outer(size, size)) / np.outer(size, size)
    return np.asarray(inverse @ variance @ inverse)


def _parts(x: ComplexArray) -> tuple[FloatArray, FloatArray]:
    return x.real, x.imag
