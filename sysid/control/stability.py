"""Whether gains hold a whole model, delay included, and by how much: exactly, and margins only of a loop that is held.

The loop z' = M0 z + M1 F(s) z, of vehicle and controller together, is a linear system with its commands late: F is
what no matrix holds, exp(-s T_d) for a delay. Its characteristic function det(s I - M0 - M1 F(s)) has as many zeros to
the right of the imaginary axis as its argument, followed from 0 to j infinity, falls short of n quarter turns (the
principle of the argument; Mikhailov). No rational approximation comes in, and no open-loop poles need be counted. The
argument is followed in steps over which it provably cannot lose a turn: of N = s I - M0 - M1 F, and E = N^-1 dN,
|log det(I + E) - tr E| <= -log(1 - r) - r where the norm r of E is below 1 on the whole step. Steps that are too long
for that are halved; where they shrink to nothing there is a root on the path, and the loop is at its edge: not held.

What is left out is named: play, limits and products (it is small motion), and what a logged air angle feeds back. The
loop is continuous: holding the commands between the vehicle's own samples is half a sample more delay, 1 ms at 500 Hz.

Where the attitude has a part in the model, roots slower than `DRIFT_RAD_S` are the hover's drift. Rates say nothing of
it, the pilot holds it, and it does not count; that it is there is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.record import CYCLIC, RATES
from sysid.model.response import behind_commands
from sysid.model.structure import DRIFT_RAD_S, AnyArray, FloatArray, Matrices, Model

ATTITUDE = (("phi", "p"), ("theta", "q"))
COMMANDS = (*CYCLIC, "delta_e")
"""Of a controller, as many as its K has rows."""
ON_THE_AXIS = 1e-9
"""1/s, and of the frequency: nearer to the axis no root is told from one on it."""
LONGEST = 0.8
"""Norm r over one step; the argument is then known to within 0.81 rad before it is taken from the determinant."""
SENSIBLE_GAIN_DB, SENSIBLE_PHASE_DEG, SENSIBLE_MS = 6.0, 45.0, 10.0
"""Margins that leave room for what no model has; a cost that is offered has them where one can."""
WHOLE = 0.1
"""How far from a whole number the count may come out."""
STEPS = 64
MOST_STEPS = 100_000
GRID = 500
LOWEST = 1e-6
"""Of the path's end, where its steps and the loci's frequencies begin."""
ZOOM, ZOOMS = 32, 2
"""Times finer, and how often, where a locus crosses."""
WIDTHS = np.tan(np.linspace(-1.5, 1.5, 41))
"""Of a resonance, on either side of it: where its locus is looked at."""
REAL = 1e-9
"""Imaginary over absolute value, at rest."""


class Feedback(Protocol):
    """What a loop is closed with: commands -K x_hat of an observer that runs on a model of its own."""

    @property
    def model(self) -> Model: ...

    @property
    def K(self) -> FloatArray:
        """(commands, states)"""

    @property
    def observer_gain(self) -> FloatArray:
        """(states, outputs)"""


@dataclass(frozen=True)
class Margins:
    """Of the loop broken at all commands together, observer included."""

    gain_db: float
    """How much the loop gain may rise before it oscillates or runs away."""
    phase_deg: float
    delay_s: float
    """Extra lateness, equal in all commands, at which the loop becomes unstable."""

    @property
    def delay_ms(self) -> float:
        return 1000 * self.delay_s

    @property
    def sensible(self) -> bool:
        """Whether what no model has is likely to be held as well."""
        least = (SENSIBLE_GAIN_DB, SENSIBLE_PHASE_DEG, SENSIBLE_MS)
        return all(
            here >= wanted for here, wanted in zip((self.gain_db, self.phase_deg, self.delay_ms), least, strict=True)
        )

    @property
    def words(self) -> str:
        """`gain margin 17.3 dB, phase 99°, delay 48 ms`; `any` where no amount makes the loop unstable."""
        gain, phase, delay = (
            f"{value:.{digits}f}{unit}" if math.isfinite(value) else "any"
            for value, digits, unit in (
                (self.gain_db, 1, " dB"),
                (self.phase_deg, 0, "°"),
                (self.delay_ms, 0 if self.delay_ms >= SENSIBLE_MS else 1, " ms"),
            )
        )
        return f"gain margin {gain}, phase {phase}, delay {delay}"


@dataclass(frozen=True)
class ClosedLoop:
    """A vehicle under gains: small motion, in the mean flight condition."""

    margins: Margins | None
    """None where the loop is unstable or on its edge: it has none."""
    effects: tuple[str, ...] = ()
    """Of the vehicle, that are in the loop."""
    left_out: tuple[str, ...] = ()
    """Of the vehicle, that small motion does not show or that a logged channel carries."""
    drifts: bool = False
    """Whether it drifts off, slower than `DRIFT_RAD_S`, as a hover does that only its rates are held in."""

    @property
    def stable(self) -> bool:
        return self.margins is not None


class Loop(NamedTuple):
    """z' = (now + late F) z, z of the vehicle's states, as far as its rates show them, and then the controller's."""

    now: FloatArray
    late: FloatArray
    vehicle: Model
    plant: Matrices
    """Of the controller's commands to p and q, without states that these do not see."""
    unseen: AnyArray
    """Poles of those states."""
    drift: float
    """Roots slower than this do not count; rad/s, 0 where all do."""

    def F(self, s: AnyArray) -> ComplexArray:
        return behind_commands(self.vehicle.structure, self.vehicle.values, s)


def closed_loop(gains: Feedback, vehicle: Model) -> ClosedLoop:
    """A vehicle, whatever its states and its delay, under gains designed on another model."""
    loop = loop_of(gains, vehicle)
    inside, outside = in_the_loop(vehicle)
    poles = loop.unseen[np.abs(loop.unseen) >= loop.drift]
    if np.any(poles.real > ON_THE_AXIS) or roots_to_the_right(loop) != 0:
        return ClosedLoop(None, inside, outside)
    drifts = loop.drift > 0 and roots_to_the_right(loop._replace(drift=0.0)) != 0
    return ClosedLoop(_margins(gains, loop), inside, outside, drifts)


def in_the_loop(vehicle: Model) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Its effects that small motion shows in a loop, and the others."""
    structure = vehicle.structure
    carried = {*structure.channels} - {name for name, _ in ATTITUDE}
    names = structure.effects
    inside = tuple(
        name
        for name, one in zip(names, structure.composed, strict=True)
        if one.linear and carried.isdisjoint(one.channels)
    )
    return inside, tuple(name for name in names if name not in inside)


def loop_of(gains: Feedback, vehicle: Model) -> Loop:
    """The equations of vehicle and controller together."""
    plant, unseen, attitude = rates_by_commands(vehicle, commands_of(gains))
    A, B, C, D = plant
    a, b, c = _own(gains)
    K, L = gains.K, gains.observer_gain
    n, m = len(A), len(a)
    now = np.block([[A, np.zeros((n, m))], [L @ C, a - L @ c - b @ K]])
    late = np.block([[np.zeros((n, n)), -B @ K], [np.zeros((m, n)), -L @ D @ K]])
    now, late = _balanced(now, late)
    return Loop(now=now, late=late, vehicle=vehicle, plant=plant, unseen=unseen, drift=DRIFT_RAD_S if attitude else 0.0)


def commands_of(gains: Feedback) -> tuple[str, ...]:
    """Which it gives."""
    return COMMANDS[: len(gains.K)]


def rates_by_commands(vehicle: Model, commands: Sequence[str] = CYCLIC) -> tuple[Matrices, AnyArray, bool]:
    """Commands to rates, poles that the rates do not show, and whether the attitude has a part.

    A logged attitude is what the rates integrate to: it closes a loop, whatever stood in the log.
    """
    structure = vehicle.structure
    A, B, C, D = (np.asarray(x, dtype=float) for x in vehicle.matrices)
    logged = [(name, rate) for name, rate in ATTITUDE if name in structure.channels]
    columns = [structure.inputs.index(name) for name, _ in logged]
    n, k = len(A), len(logged)
    rows = np.zeros((k, n + k))
    for i, (_, rate) in enumerate(logged):
        rows[i, structure.states.index(rate)] = 1
    given = [structure.inputs.index(name) for name in commands]
    A, B = np.vstack([np.hstack([A, B[:, columns]]), rows]), np.vstack([B[:, given], np.zeros((k, len(given)))])
    at = [structure.outputs.index(name) for name in RATES]  # what the controller on board measures
    C, D = np.hstack([C[at], D[at][:, columns]]), D[np.ix_(at, given)]
    seen = np.any(C != 0, axis=0)
    for _ in range(len(A)):
        seen |= np.any(A[seen] != 0, axis=0)
    unseen = np.linalg.eigvals(A[np.ix_(~seen, ~seen)])
    attitude = bool(logged or structure.attitude_states)
    return Matrices(A[np.ix_(seen, seen)], B[seen], C[:, seen], D), unseen, attitude


def _balanced(now: FloatArray, late: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same in units that make rows and columns alike: the roots stay, the norms shrink."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.linalg import matrix_balance

    scale = matrix_balance(np.abs(now) + np.abs(late), permute=False, separate=True)[1][0]
    return now * scale / scale[:, None], late * scale / scale[:, None]


# ------------------------------------------------------------------------------------------------ counting roots


def roots_to_the_right(loop: Loop) -> int | None:
    """How many roots have a positive real part, those slower than the drift left out.

    None where it cannot be told: one is on the edge, or the numbers are not finite.
    """
    try:
        with np.errstate(all="ignore"):
            end = _end(loop)
            turned = _turned_in_all(loop, end)
            M = loop.now + loop.late * loop.F(np.array([1j * end]))[0]
            beyond = float(np.sum(np.angle(1 - np.linalg.eigvals(M) / (1j * end))))
    except np.linalg.LinAlgError:
        return None
    if turned is None:
        return None
    count = len(M) / 2 + (beyond - turned) / np.pi
    return round(count) if abs(count - round(count)) < WHOLE else None


def _turned_in_all(loop: Loop, end: float) -> float | None:
    """rad, from the real axis to j `end`; None with a root on the way."""
    low, high = _path(loop, end)
    turned = 0.0
    while low.size:
        if low.size > MOST_STEPS or np.any(high - low < ON_THE_AXIS * (1 + np.abs(low))):
            return None
        sure, turn = _turned(loop, low, high)
        turned += float(np.sum(turn[sure]))
        low, high = low[~sure], high[~sure]
        middle = 0.5 * (low + high)
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return turned


def _end(loop: Loop) -> float:
    """rad/s, beyond which no root can be."""
    norm = [float(np.linalg.norm(one)) for one in (loop.now, loop.late)]
    w = np.geomspace(1e-3, 1e6, 91)
    return 2 * (norm[0] + norm[1] * max(1.0, float(np.max(np.abs(loop.F(1j * w))))))


def _path(loop: Loop, end: float) -> tuple[FloatArray, FloatArray]:
    """First steps from the real axis to `end`: low and high ends, lengths along the path from where the axis begins."""
    axis = np.concatenate([[0.0], np.geomspace(LOWEST, 1, STEPS) * (end - loop.drift)])
    around = np.linspace(-0.5 * np.pi * loop.drift, 0, STEPS // 4)[:-1] if loop.drift else np.zeros(0)
    marks = np.concatenate([around, axis])
    return marks[:-1], marks[1:]


def _on_path(loop: Loop, t: FloatArray) -> ComplexArray:
    """s: along the quarter of a circle round the drift, then up the imaginary axis; |ds/dt| = 1."""
    r = loop.drift
    axis = 1j * (r + t)
    return np.asarray(np.where(t < 0, r * np.exp(1j * (0.5 * np.pi + t / r)), axis) if r else axis)


def _turned(loop: Loop, low: FloatArray, high: FloatArray) -> tuple[AnyArray, FloatArray]:
    """For each step whether its turn is sure, and the turn of the determinant in rad."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    s = [_on_path(loop, t) for t in (low, middle, high)]
    F = [loop.F(at) for at in s]
    unit = np.eye(len(loop.now))
    N = [at[:, None, None] * unit - loop.now - loop.late * f[:, None, None] for at, f in zip(s, F, strict=True)]
    inverse = np.linalg.inv(N[1])
    late = inverse @ loop.late
    steepest = np.max([_slope(loop, t, half) for t in (low, middle, high)], axis=0)
    size = half * (np.linalg.norm(inverse, axis=(1, 2)) + steepest * np.linalg.norm(late, axis=(1, 2)))
    trace, trace_late = (np.trace(x, axis1=1, axis2=2) for x in (inverse, late))
    sign = [np.linalg.slogdet(x)[0] for x in N]
    turn = np.zeros(low.size)
    for k, way in ((0, -1), (2, 1)):
        about = np.imag((s[k] - s[1]) * trace - (F[k] - F[1]) * trace_late)
        rest = np.angle(sign[k] / sign[1] * np.exp(-1j * about))
        turn += way * (about + rest)
    return size < LONGEST, turn


def _slope(loop: Loop, t: FloatArray, half: FloatArray) -> FloatArray:
    """|dF/dt| along the path."""
    step = 1e-4 * half
    change = loop.F(_on_path(loop, t + step)) - loop.F(_on_path(loop, t - step))
    return np.asarray(np.abs(change) / (2 * step))


# ------------------------------------------------------------------------------------------------ margins


def _margins(gains: Feedback, loop: Loop) -> Margins:
    return margins_by_loci(lambda w: _transfer(gains, loop, 1j * w), frequencies(gains, loop), _at_rest(gains, loop))


class Edges(NamedTuple):
    """Margins, and the frequency at which each of them is decided, Hz; None where nothing at a frequency does."""

    margins: Margins
    gain_hz: float | None = None
    phase_hz: float | None = None
    delay_hz: float | None = None


def edges(gains: Feedback, vehicle: Model) -> Edges:
    """Of a loop that is held."""
    loop = loop_of(gains, vehicle)
    w = frequencies(gains, loop)
    return edges_by_loci(lambda at: _transfer(gains, loop, 1j * at), w, _at_rest(gains, loop))


def margins_by_loci(transfer: Callable[[FloatArray], ComplexArray], w: FloatArray, at_rest: float) -> Margins:
    """Of a loop that is held, as `edges_by_loci`."""
    return edges_by_loci(transfer, w, at_rest).margins


def edges_by_loci(transfer: Callable[[FloatArray], ComplexArray], w: FloatArray, at_rest: float) -> Edges:
    """Where the loci of a loop that is held, broken at the commands, meet -1 with more gain, phase or delay.

    A common gain, phase or delay in both commands moves every eigenvalue alike, so the first to meet it is the edge.
    `transfer` is (f, 2, 2) at frequencies in rad/s, of which `w` are the first; `at_rest` the gain margin at 0 Hz, dB.
    """
    values = eigenvalues(transfer(w))
    loci = branches(values)
    for _ in range(ZOOMS):
        crossed = np.flatnonzero(np.any(unit_passed(loci) | negative_axis_met(loci), axis=1))
        between = np.linspace(w[crossed], w[crossed + 1], ZOOM, endpoint=False)[1:].ravel()
        w = np.concatenate([w, between])
        values = np.concatenate([values, eigenvalues(transfer(between))])
        order = np.argsort(w)
        w, values = w[order], values[order]
        loci = branches(values)
    gains: list[_Met] = [(at_rest, None)]
    phases: list[_Met] = [(math.inf, None)]
    delays: list[_Met] = [(math.inf, None)]
    for branch in loci.T:
        size, turn = np.log(np.abs(branch)), np.mod(np.angle(branch) - np.pi, 2 * np.pi)
        for i in np.flatnonzero(unit_passed(branch)):
            part = size[i] / (size[i] - size[i + 1])
            angle = turn[i] + part * ((turn[i + 1] - turn[i] + np.pi) % (2 * np.pi) - np.pi)
            at = float(w[i] + part * (w[i + 1] - w[i]))
            phases.append((float(np.degrees(min(angle, 2 * np.pi - angle))), at))
            delays.append((float(angle / at), at))
        met = np.flatnonzero(negative_axis_met(branch) & (size[:-1] < 0))
        gains += [(-20 / math.log(10) * float(size[i]), float(w[i])) for i in met]
    (gain, gain_at), (phase, phase_at), (delay, delay_at) = (
        min(each, key=_first_of) for each in (gains, phases, delays)
    )
    return Edges(
        Margins(gain, phase, delay),
        *(None if at is None else at / (2 * math.pi) for at in (gain_at, phase_at, delay_at)),
    )


_Met = tuple[float, float | None]
"""A margin, and the rad/s at which it is."""


def _first_of(met: _Met) -> float:
    return met[0]


def crossings_hz(gains: Feedback, vehicle: Model) -> tuple[FloatArray, FloatArray]:
    """Where loci of the loop have the size 1, which decides its phase margin, and where they are negative and smaller,
    which decides its gain margin."""
    loop = loop_of(gains, vehicle)
    w = frequencies(gains, loop)
    loci = branches(eigenvalues(_transfer(gains, loop, 1j * w)))
    smaller = np.abs(loci[:-1]) < 1
    units, reals = (np.any(each, axis=1) for each in (unit_passed(loci), negative_axis_met(loci) & smaller))
    middle = np.sqrt(w[:-1] * w[1:]) / (2 * np.pi)
    return middle[units], middle[reals]


def unstable_poles(gains: Feedback, vehicle: Model) -> int:
    """How many poles of the open loop, vehicle and controller, have a positive real part; the drift left out."""
    loop = loop_of(gains, vehicle)
    poles = np.concatenate([np.linalg.eigvals(loop.plant.A), np.linalg.eigvals(_inner(gains))])
    return int(np.count_nonzero((poles.real > ON_THE_AXIS) & (np.abs(poles) >= loop.drift)))


def from_rates(gains: Feedback, s: AnyArray) -> ComplexArray:
    """Of the controller: what it takes from the commands per rate, (f, commands, rates)."""
    inner = _inner(gains)
    gain = gains.observer_gain.astype(complex)
    return np.asarray(gains.K @ np.linalg.solve(s[:, None, None] * np.eye(len(inner)) - inner, gain))


def frequencies(gains: Feedback, loop: Loop) -> FloatArray:
    """rad/s: close together, and closest about every resonance of vehicle and controller."""
    end = _end(loop)
    poles = np.concatenate([np.linalg.eigvals(x) for x in (loop.plant.A, _inner(gains))])
    near = np.abs(poles.imag)[:, None] + np.abs(poles.real)[:, None] * WIDTHS
    lowest = max(loop.drift, LOWEST * end)
    w = np.concatenate([np.geomspace(lowest, end, GRID), near.ravel()])
    return np.asarray(np.unique(w[(w >= lowest) & (w <= end)]))


def _inner(gains: Feedback) -> FloatArray:
    """The controller's own matrix, from measured rates to its states."""
    a, b, c = _own(gains)
    return np.asarray(a - gains.observer_gain @ c - b @ gains.K)


def _own(gains: Feedback) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The observer's matrices, of the controller's commands."""
    a, b, c, _ = gains.model.matrices
    return a, b[:, : len(gains.K)], c


def rates_per_command(vehicle: Model, s: AnyArray, commands: Sequence[str] = CYCLIC) -> ComplexArray:
    """p and q per command of a vehicle on its own, delay included, (f, 2, commands); an attitude is closed."""
    (A, B, C, D), _, _ = rates_by_commands(vehicle, commands)
    inside = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, B[None].astype(complex))
    return np.asarray((C @ inside + D) * behind_commands(vehicle.structure, vehicle.values, s)[:, None, None])


def _transfer(gains: Feedback, loop: Loop, s: AnyArray) -> ComplexArray:
    """(f, 2, 2), round the loop from the rates to the rates.

    From commands to commands, which may be three, it has the same eigenvalues, and nothings beside them.
    """
    return np.asarray(rates_per_command(loop.vehicle, s, commands_of(gains)) @ from_rates(gains, s))


def branches(values: ComplexArray) -> ComplexArray:
    """(f, 2), each column one branch: neighbours change places as often as they did."""
    straight = np.abs(np.diff(values, axis=0)).sum(axis=1)
    crossed = np.abs(values[1:, ::-1] - values[:-1]).sum(axis=1)
    odd = np.concatenate([[False], np.cumsum(crossed < straight) % 2 == 1])
    return np.where(odd[:, None], values[:, ::-1], values)


def eigenvalues(x: ComplexArray) -> ComplexArray:
    """(f, 2) of matrices (f, 2, 2)."""
    half = 0.5 * (x[:, 0, 0] + x[:, 1, 1])
    apart = np.sqrt(half**2 - x[:, 0, 0] * x[:, 1, 1] + x[:, 0, 1] * x[:, 1, 0])
    return np.stack([half + apart, half - apart], axis=1)


def unit_passed(loci: ComplexArray) -> AnyArray:
    """Between which neighbours the absolute value passes 1."""
    return np.diff(np.abs(loci) > 1, axis=0)


def negative_axis_met(loci: ComplexArray) -> AnyArray:
    """Between which neighbours the negative real axis is met."""
    return np.diff(loci.imag > 0, axis=0) & (loci.real[:-1] < 0)


def _at_rest(gains: Feedback, loop: Loop) -> float:
    """dB until a root passes through the origin, which no crossing of the axis shows."""
    if loop.drift:
        return math.inf
    try:
        values = eigenvalues(_transfer(gains, loop, np.zeros(1, dtype=complex)))[0]
    except np.linalg.LinAlgError:
        return math.inf
    met = [abs(x) for x in values if x.real < 0 and abs(x.imag) <= REAL * abs(x) and abs(x) < 1]
    return min((-20 * math.log10(size) for size in met if size > 0), default=math.inf)
