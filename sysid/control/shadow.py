"""Gains run over what was flown, without authority: what they would have commanded, and whether a vehicle that ran them
so did it right.

The controller of eq. 11 and 13 as it runs on board, loop by loop: rates and the command that was really sent are held
over a loop, and the observer is advanced exactly. It has no integrator. What it puts out is linear in the rates, the
commands and the rates asked for, each with two axes; a vehicle that got one of these wrong, or its output, differs by a
matrix of two by two and some loops, and that is looked for at each place in turn. What is left then is another
controller.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from sysid.control.in_time import followed_in_loops, observer_in_loops
from sysid.control.regulator import Gains
from sysid.data.record import FloatArray

Place = Literal["rates", "commands", "targets", "output"]
PLACES: tuple[Place, ...] = get_args(Place)
"""Where a vehicle can have got an axis, a sign, a scale or the time wrong; commands are those that its observer takes
for sent."""
FaultKind = Literal[
    "sign", "swapped", "scale", "late", "own command", "other", "saturates", "innovations", "no answer", "other bank"
]
FORGOTTEN_S = 0.5
"""By then an observer of the paper's poles knows nothing of its beginning."""
FORGOTTEN = 1e-18
"""Of what a state was, that is left of it."""
SHORTEST_S = 2.0
ALIKE = 0.0003
"""Rms of the difference over that of the output: less is rounding in a log."""
EXACT = 0.005
"""Of a matrix's elements, from what they should be."""
LAGS = range(-5, 26)
"""Loops that something is searched to be late by."""
MOST_ROWS = 2000
"""Samples by which causes are told apart."""
FULL = 1.0
REST_S = 1.0
MOST_SATURATED = 0.01
"""Of the samples; beyond it a loop is not the one whose margins were measured."""
MORE_INNOVATION, BESIDE = 2.0, 0.05
"""Times what is predicted, and so much of the rates beside it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OverStretch:
    """What one stretch without a gap holds for the controller, loop by loop; arrays of shape (n, 2)."""

    rates: FloatArray
    """Measured, rad/s."""
    commands: FloatArray
    """Really sent, of full command."""
    targets: FloatArray
    """Rates asked for, rad/s."""
    excitation: FloatArray | None = None
    """Added to the commands; None where nothing tells."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RanStretch(OverStretch):
    """The same where a bank ran beside what flew."""

    output: FloatArray
    """That it put out, of full command."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PutOut:
    """What the controller does over one stretch."""

    output: FloatArray
    """(n, 2), of full command, unclipped."""
    innovation: FloatArray
    """(n, 2), rad/s."""


@dataclass(frozen=True, kw_only=True)
class Output:
    """What gains would have commanded over some flights, beside what was commanded."""

    axis: str
    rms: float
    largest: float
    """Of full command."""
    saturated: float
    """Share of the samples beyond full command: a sweep drives the vehicle as the gains would not;"""
    saturated_at_rest: float | None
    """the same a second after the last excitation and later; None where nothing tells of such a time."""
    rate: float
    """Rms of its change, of full command per second;"""
    largest_rate: float
    """999 of 1000 samples change by less."""
    noise: float
    """Rms beyond the sweeps' frequencies, of full command;"""
    flown_rms: float
    flown_rate: float
    flown_noise: float
    """the same of the command that was sent."""
    innovation: float
    """Rms of the observer's over that of the rate: what its model does not know of the vehicle."""

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One thing that a vehicle did otherwise than the gains say, or that refuses them."""

    kind: FaultKind
    place: Place | None = None
    axis: str | None = None
    """None: both."""
    value: float | None = None
    """Of a scale: its factor; late: s; saturates: share of the samples; innovations: times what is predicted; other:
    share of the output that nothing explains."""

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


AXES = ("roll", "pitch")


def put_out(gains: Gains, dt: float, over: OverStretch) -> PutOut:
    """The controller over one stretch, from rest. Its loop is dt seconds."""
    A, B, L, C = on_board(gains, dt)
    rates, commands, targets = over.rates, over.commands, over.targets
    states = _states(A, (commands @ B.T + rates @ L.T)[:, :, None])[:, :, 0]
    return PutOut(output=_forward(gains, dt, targets) - states @ gains.K.T, innovation=rates - states @ C.T)


def _forward(gains: Gains, dt: float, targets: FloatArray) -> FloatArray:
    """(n, 2): what the rates asked for (n, 2) put out by themselves, the models that follow them included."""
    steady = targets @ gains.prefilter.T
    if gains.dynamic is None:
        return np.asarray(steady)
    ahead = followed_in_loops(gains.dynamic, dt)
    z = _states(ahead[:, :4], (targets @ ahead[:, 4:].T)[:, :, None])[:, :, 0]
    z[:, :2] -= targets
    return np.asarray(steady + z @ gains.dynamic.F.T)


def outputs(gains: Gains, dt: float, stretches: Sequence[OverStretch], above_hz: float) -> tuple[Output, ...]:
    """Of each axis, over all stretches. Raises ValueError where there is none."""
    after = round(FORGOTTEN_S / dt)
    each = [(over, put_out(gains, dt, over)) for over in stretches]
    new = [one.output[after:] for _, one in each]
    sent = [over.commands[after:] for over, _ in each]
    innovation = np.concatenate([one.innovation[after:] for _, one in each])
    rates = np.concatenate([over.rates[after:] for over, _ in each])
    rest = np.concatenate([_at_rest(over, dt)[after:] for over in stretches])
    found = []
    for k, axis in enumerate(AXES):
        own, flown = ([x[:, k] for x in rows] for rows in (new, sent))
        whole, change = np.concatenate(own), np.concatenate([np.diff(x) for x in own]) / dt
        found.append(
            Output(
                axis=axis,
                rms=_rms(whole),
                largest=float(np.max(np.abs(whole))),
                saturated=float(np.mean(np.abs(whole) > FULL)),
                saturated_at_rest=float(np.mean(np.abs(whole[rest]) > FULL)) if np.sum(rest) * dt > REST_S else None,
                rate=_rms(change),
                largest_rate=float(np.quantile(np.abs(change), 0.999)),
                noise=_rms(np.concatenate([_above(x, dt, above_hz) for x in own])),
                flown_rms=_rms(np.concatenate(flown)),
                flown_rate=_rms(np.concatenate([np.diff(x) for x in flown]) / dt),
                flown_noise=_rms(np.concatenate([_above(x, dt, above_hz) for x in flown])),
                innovation=_rms(innovation[:, k]) / max(_rms(rates[:, k] - rates[:, k].mean()), 1e-12),
            )
        )
    return tuple(found)


def _at_rest(over: OverStretch, dt: float) -> NDArray[np.bool_]:
    """(n,), whether nothing was excited for a while; nowhere where nothing tells."""
    rows = np.arange(len(over.rates))
    if over.excitation is None:
        return np.zeros(rows.size, dtype=bool)
    moved = np.any(over.excitation != 0, axis=1)
    last = np.maximum.accumulate(np.where(moved, rows, -rows.size))
    return np.asarray(rows - last > REST_S / dt)


def refused_by(found: Sequence[Output], predicted: Sequence[Output] = ()) -> tuple[Fault, ...]:
    """What of a controller's output refuses it, where nothing was excited; `predicted`: the same over other flights."""
    faults = [
        Fault(kind="saturates", place="output", axis=one.axis, value=one.saturated_at_rest)
        for one in found
        if one.saturated_at_rest is not None and one.saturated_at_rest > MOST_SATURATED
    ]
    faults += [
        Fault(kind="innovations", axis=one.axis, value=one.innovation / max(before.innovation, 1e-12))
        for one, before in zip(found, predicted, strict=False)
        if one.innovation > MORE_INNOVATION * before.innovation + BESIDE
    ]
    return tuple(faults)


def faults_of(gains: Gains, dt: float, stretches: Sequence[RanStretch]) -> tuple[Fault, ...]:
    """What a vehicle did otherwise that ran these gains; none where it did as they say."""
    shares = [_left(over.output, put_out(gains, dt, over).output, dt) for over in stretches]
    if max(shares, default=0.0) <= ALIKE:
        return ()
    worst = stretches[int(np.argmax(shares))]
    if _rms(worst.output) == 0:
        return (Fault(kind="no answer", place="output"),)
    if _left(worst.output, _on_its_own(gains, dt, worst), dt) <= ALIKE:
        return (Fault(kind="own command", place="commands"),)
    tried = list(_tried(gains, dt, worst))
    share, place, lag, M = min(tried, key=lambda one: one[0])
    if share > ALIKE:
        return (Fault(kind="other", place="output", value=max(shares)),)
    late = [Fault(kind="late", place=place, value=lag * dt)] if lag else []
    return (*late, *_told(M, place)) or (Fault(kind="other", place="output", value=max(shares)),)


def _tried(gains: Gains, dt: float, over: RanStretch) -> Iterator[tuple[float, Place, int, FloatArray]]:
    """Share that is left, with a matrix of two by two and a lag at one place."""
    expected, logged = put_out(gains, dt, over).output, over.output
    after, n = round(FORGOTTEN_S / dt), len(logged)
    rows = np.arange(max(after, LAGS.stop), n + LAGS.start, max(1, n // MOST_ROWS))
    size = _rms(logged[rows])
    for place in PLACES:
        parts = _parts(gains, dt, over, place, expected)
        fixed = expected - parts[0] - parts[3]
        for lag in LAGS:
            columns = parts[:, rows - lag].reshape(4, -1).T
            wanted = (logged - fixed)[rows].ravel()
            if _rms(columns.ravel()) == 0:
                continue
            solved, *_ = np.linalg.lstsq(columns, wanted, rcond=1e-9)
            left = float(np.sqrt(np.mean((wanted - columns @ solved) ** 2)))
            yield left / size, place, lag, solved.reshape(2, 2)


def _parts(gains: Gains, dt: float, over: OverStretch, place: Place, expected: FloatArray) -> FloatArray:
    """(4, n, 2): what a place puts out by itself, its axes where they belong and crossed: into roll from roll and from
    pitch, then into pitch."""
    crossed = [(i, k) for i in (0, 1) for k in (0, 1)]
    if place == "output":
        return np.stack([np.outer(expected[:, k], np.eye(2)[i]) for i, k in crossed])
    if place == "targets":
        return np.stack([_forward(gains, dt, np.outer(over.targets[:, k], np.eye(2)[i])) for i, k in crossed])
    A, B, L, _ = on_board(gains, dt)
    into = B if place == "commands" else L
    driven = np.stack([np.outer(getattr(over, place)[:, k], into[:, i]) for i, k in crossed], axis=2)
    return np.moveaxis(-gains.K @ _states(A, driven), 2, 0)


def _states(A: FloatArray, driven: FloatArray) -> FloatArray:
    """(n, states, m), of m observers from rest, driven by (n, states, m): x' = A x + driven, all samples at once, by
    sums over twice as many samples each time."""
    sums, power, step = driven.copy(), A, 1
    with np.errstate(all="ignore"):  # what is not stable goes beyond all numbers
        while step < len(sums) and np.any(np.abs(power) > FORGOTTEN):
            sums[step:] += power @ sums[:-step]
            power, step = power @ power, 2 * step
    return np.concatenate([np.zeros_like(sums[:1]), sums[:-1]])


def _told(M: FloatArray, place: Place) -> list[Fault]:
    """What a matrix of two by two at a place means; nothing where it is 1."""
    size = np.abs(M)
    faults = []
    if size[0, 1] * size[1, 0] > size[0, 0] * size[1, 1]:
        faults.append(Fault(kind="swapped", place=place))
        M = M[:, ::-1]
    for k, axis in enumerate(AXES):
        if M[k, k] < 0:
            faults.append(Fault(kind="sign", place=place, axis=axis))
        if abs(abs(M[k, k]) - 1) > EXACT:
            faults.append(Fault(kind="scale", place=place, axis=axis, value=float(abs(M[k, k]))))
    return faults


def _on_its_own(gains: Gains, dt: float, over: OverStretch) -> FloatArray:
    """Output of an observer that takes its own output for the command that was sent."""
    A, B, L, _ = on_board(gains, dt)
    asked = _forward(gains, dt, over.targets)
    states = _states(A - B @ gains.K, (asked @ B.T + over.rates @ L.T)[:, :, None])[:, :, 0]
    return np.asarray(asked - states @ gains.K.T)


def on_board(gains: Gains, dt: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of the observer over one loop: states on states, on commands, on rates; and rates of states."""
    C = np.asarray(gains.model.matrices.C, dtype=float)
    return *observer_in_loops(gains.model, gains.observer_gain, dt), C


def _left(logged: FloatArray, expected: FloatArray, dt: float) -> float:
    """Rms of the difference over that of what was expected, once the beginning is forgotten."""
    after = round(FORGOTTEN_S / dt)
    return _rms((logged - expected)[after:]) / max(_rms(expected[after:]), 1e-12)


def _above(x: FloatArray, dt: float, low_hz: float) -> FloatArray:
    """What of a signal is faster."""
    bins = np.fft.rfft(x - x.mean())
    bins[np.fft.rfftfreq(x.size, dt) <= low_hz] = 0
    return np.asarray(np.fft.irfft(bins, x.size))


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if x.size else 0.0
