"""Does the vehicle hold gains: counted from its measured responses, where a model only stands below the sweeps.

The loop is broken at both commands. With C what the controller takes from the commands per rate, and H the measured
responses, det(I + C H) turns by pi for every pole of the open loop to the right, and back by pi for every root that the
closed loop has there (Nyquist's criterion of a loop of two; MacFarlane and Postlethwaite 1977). The way from 0 to
infinity has three parts:

- below the band stands the model. It may differ there by `SLACK` times what it differs where the band begins, and by no
  more does it turn otherwise: the difference, seen round the loop, stays below 1;
- in the band stands what was measured, and -1 lies outside its 95 % bound at every frequency;
- above the band nothing was measured. The vehicle is taken to answer there no more than at the band's end, whatever
  its phase, and the loop then has at most half of size 1, or what the asked gain margin leaves.

The controller is taken as it runs on board, loop by loop, exactly: gains that are large beside the loop rate can make
it unstable by itself. What is less certain than all that is not measured, and is never cleared. Sizes round the loop
are Perron roots of absolute values: a bound for whatever phases the elements have, and the same in any units.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sysid.control.judgement import OF_DELAY, Limits, Quantity, Shortfall
from sysid.control.measured_margins import FEWEST, Crossing, MeasuredMargins, measured_margins
from sysid.control.regulator import Gains
from sysid.control.robustness import DiskMargin, disk_sizes
from sysid.control.shadow import on_board
from sysid.control.stability import (
    WHOLE,
    frequencies,
    from_rates,
    loop_of,
    rates_per_command,
    roots_to_the_right,
    unstable_poles,
)
from sysid.data.preprocess import ComplexArray
from sysid.data.record import CYCLIC, RATES, FloatArray
from sysid.model.structure import Model
from sysid.response.values import PROBABILITY, Responses

Verdict = Literal["cleared", "refused", "not measured"]
Why = Literal["axes", "excitation", "low", "bound", "edge", "near"]
"""Why nothing can be told: commands that no response separates; excitation that is not logged, so that gusts come back
in the responses, which no bound knows; a model that does not meet what was measured where the band begins; a bound that
reaches -1; a loop that is not small where the band ends; a margin too near its limit."""
SLACK = 2.0
FINER = 8
"""Points between those measured: a response is smooth."""
LOW_END, HIGH_END = 2 ** (1 / 3), 2 ** (1 / 12)
"""Over so much of the band's ends is looked at what the vehicle answers there."""
BEYOND = 1.2
"""Of the frequency to which a sweep is asked for."""
FARTHEST_HZ = 1000.0
MARGINS: tuple[Quantity, ...] = ("gain_db", "phase_deg", "delay_ms")
DRAWS, SEED = 400, 17
"""Of the disk margin's error."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BrokenLoop:
    """Both sides of the loop where it was measured, finer than measured."""

    frequency_hz: FloatArray
    """(f,)"""
    loop_s: float
    """Of the controller; 0: continuous."""
    C: ComplexArray
    """(f, 2, 2), taken from the commands per rate;"""
    H: ComplexArray
    """(f, 2, 2), rates per command, measured,"""
    bound: FloatArray
    """(f, 2, 2), with what 95 of 100 errors are below,"""
    model: ComplexArray
    """(f, 2, 2): the whole loop of the model under the continuous controller."""

    @property
    def loop(self) -> ComplexArray:
        """(f, 2, 2), from the commands back to what is taken from them."""
        return np.asarray(self.C @ self.H)

    @property
    def reach(self) -> FloatArray:
        """(f,): the bound round the loop; from 1 on the loop may meet -1 within it."""
        return _round(self.loop, self.C, self.bound)

    def part(self, rows: slice) -> BrokenLoop:
        """Some of its frequencies."""
        return BrokenLoop(
            frequency_hz=self.frequency_hz[rows],
            loop_s=self.loop_s,
            C=self.C[rows],
            H=self.H[rows],
            bound=self.bound[rows],
            model=self.model[rows],
        )


@dataclass(frozen=True, kw_only=True)
class MeasuredDisk:
    """A disk margin by measured responses."""

    margin: DiskMargin
    low: float
    """Of its size alpha: 95 % of what the error leaves is between these."""
    high: float

    def to_json(self) -> dict[str, Any]:
        return self.margin.to_json() | {"low": self.low, "high": self.high}


@dataclass(frozen=True, kw_only=True)
class NotMeasured:
    """One thing that keeps gains from being cleared."""

    why: Why
    frequency_hz: float | None = None
    sweep_to_hz: float | None = None
    """What would tell, where a sweep does; for `low` from here."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredStability:
    """What the measured responses say of gains."""

    roots: int | None
    """Of the closed loop, to the right; None where that cannot be counted."""
    unstable_poles: int
    """Of the open loop, vehicle and controller, by the model."""
    margins: MeasuredMargins | None
    disk: MeasuredDisk | None
    thin: tuple[Shortfall, ...]
    """Margins that are measured to be less than asked, beyond their bounds."""
    not_measured: tuple[NotMeasured, ...]
    loop: BrokenLoop | None

    @property
    def verdict(self) -> Verdict:
        if self.roots or self.thin:
            return "refused"
        return "not measured" if self.not_measured or self.roots is None else "cleared"

    def to_json(self) -> dict[str, Any]:
        loop, margins = self.loop, self.margins
        return {
            "verdict": self.verdict,
            "roots_to_the_right": self.roots,
            "unstable_poles": self.unstable_poles,
            "band_hz": None if loop is None else [float(loop.frequency_hz[0]), float(loop.frequency_hz[-1])],
            "bound": None if loop is None else float(np.max(loop.reach)),
            "margins": None if margins is None else {name: _crossing(getattr(margins, name)) for name in MARGINS},
            "disk": None if self.disk is None else self.disk.to_json(),
            "shortfalls": [asdict(one) for one in self.thin],
            "not_measured": [asdict(one) for one in self.not_measured],
        }


def measured_stability(
    gains: Gains, model: Model, responses: Responses, limits: Limits, loop_s: float = 0.0
) -> MeasuredStability:
    """Gains in the loop with what was measured of a vehicle; the model is used below the band, and for its poles.

    `loop_s`: of one loop of the controller on board, s, over which it holds rates and commands; 0: it is continuous.
    """
    poles = _open_poles(gains, model, loop_s)
    known = _known(responses)
    if known is None:
        return MeasuredStability(
            roots=None,
            unstable_poles=poles,
            margins=None,
            disk=None,
            thin=(),
            not_measured=(NotMeasured(why="axes"),),
            loop=None,
        )
    f, H, error, bound = known
    whole = _broken(gains, model, f, H, bound, loop_s)
    end, edge = _end(gains, whole, limits)
    broken = whole.part(slice(_beginning(whole), end + 1))
    margins = measured_margins(gains, _as_on_board(gains, responses, loop_s))
    thin, near = _thin(margins, model, limits)
    roots, found = _counted(gains, model, broken, limits, edge)
    return MeasuredStability(
        roots=roots,
        unstable_poles=poles,
        margins=margins,
        disk=_disk(taken(gains, f, loop_s), f, H, error),
        thin=thin,
        not_measured=(*([] if responses.closed_loop_safe else [NotMeasured(why="excitation")]), *found, *near),
        loop=broken,
    )


def taken(gains: Gains, frequency_hz: FloatArray, loop_s: float) -> ComplexArray:
    """(f, 2, 2): what the controller takes from the commands per rate, as it runs in loops of so many seconds; the hold
    of its commands included."""
    s = np.asarray(2j * np.pi * frequency_hz, dtype=complex)
    if loop_s == 0:
        return from_rates(gains, s)
    A, B, L, _ = on_board(gains, loop_s)
    z = np.exp(s * loop_s)[:, None, None]
    hold = ((1 - np.exp(-s * loop_s)) / (s * loop_s))[:, None, None]
    inside = np.linalg.solve(z * np.eye(len(A)) - (A - B @ gains.K), L[None].astype(complex))
    return np.asarray(gains.K @ inside * hold)


def _open_poles(gains: Gains, model: Model, loop_s: float) -> int:
    """How many poles of vehicle and controller are unstable; the controller's are those of its loops."""
    if loop_s == 0:
        return unstable_poles(gains, model)
    A, B, _, _ = on_board(gains, loop_s)
    # of a controller that takes nothing the observer alone is left, and that is stable
    quiet = replace(gains, K=np.zeros_like(gains.K))
    return unstable_poles(quiet, model) + int(np.count_nonzero(np.abs(np.linalg.eigvals(A - B @ gains.K)) > 1))


def _as_on_board(gains: Gains, responses: Responses, loop_s: float) -> Responses:
    """Responses that make with the continuous controller the loop that these make with the one on board."""
    if loop_s == 0 or not _both(responses):
        return responses
    f = responses.frequency_hz
    continuous = from_rates(gains, np.asarray(2j * np.pi * f, dtype=complex))
    rows = _rows(responses)
    H = responses.H.copy()
    H[rows] = np.moveaxis(np.linalg.pinv(continuous) @ taken(gains, f, loop_s) @ np.moveaxis(H[rows], -1, 0), 0, -1)
    return replace(responses, H=H)


# ------------------------------------------------------------------------------------------------ what was measured


def _both(responses: Responses) -> bool:
    return set(RATES) <= set(responses.outputs) and set(CYCLIC) <= set(responses.commands)


def _rows(responses: Responses) -> tuple[NDArray[np.intp], ...]:
    """Of p and q to both commands."""
    return np.ix_(
        [responses.outputs.index(name) for name in RATES], [responses.commands.index(name) for name in CYCLIC]
    )


def _known(responses: Responses) -> tuple[FloatArray, ComplexArray, FloatArray, FloatArray] | None:
    """Frequencies (f,) without a hole at which all four responses are measured, these and their standard errors and
    95 % bounds, each (f, 2, 2); None where there are too few."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.special import fdtri

    if not _both(responses):
        return None
    rows = _rows(responses)
    H = np.moveaxis(responses.H[rows], -1, 0)
    error, freedom = (np.moveaxis(x[rows], -1, 0) for x in (responses.error, responses.freedom))
    known = np.flatnonzero(np.all(np.isfinite(H) & np.isfinite(error), axis=(1, 2)))
    at = max(np.split(known, np.flatnonzero(np.diff(known) > 1) + 1), key=len)
    if at.size < FEWEST:
        return None
    # of a complex number with so many degrees of freedom in its variance
    factor = np.sqrt(fdtri(2.0, np.maximum(freedom[at], 1.0), PROBABILITY))
    return responses.frequency_hz[at], H[at], error[at], error[at] * factor


def _broken(gains: Gains, model: Model, f: FloatArray, H: ComplexArray, bound: FloatArray, loop_s: float) -> BrokenLoop:
    """The loop between the measured points too."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.interpolate import CubicSpline

    x = np.log(f)
    fine = np.linspace(x[0], x[-1], FINER * (f.size - 1) + 1)
    rows = np.stack([H.real, H.imag, bound]).reshape(3, f.size, 4)
    real, imag = (CubicSpline(x, rows[k], axis=0)(fine).reshape(-1, 2, 2) for k in (0, 1))
    between = np.stack([np.interp(fine, x, rows[2, :, k]) for k in range(4)], axis=1).reshape(-1, 2, 2)
    hz = np.exp(fine)
    s = np.asarray(2j * np.pi * hz, dtype=complex)
    return BrokenLoop(
        frequency_hz=hz,
        loop_s=loop_s,
        C=taken(gains, hz, loop_s),
        H=np.asarray(real + 1j * imag),
        bound=between,
        model=np.asarray(from_rates(gains, s) @ rates_per_command(model, s)),
    )


def perron(x: FloatArray) -> FloatArray:
    """(f,), the largest eigenvalue of non-negative matrices (f, 2, 2)."""
    half = 0.5 * (x[:, 0, 0] - x[:, 1, 1])
    return np.asarray(0.5 * (x[:, 0, 0] + x[:, 1, 1]) + np.sqrt(half**2 + x[:, 0, 1] * x[:, 1, 0]))


def _round(loop: ComplexArray, C: ComplexArray, change: FloatArray) -> FloatArray:
    """(f,): by how much a change of the responses, at most so large, can count in a loop; from 1 on it may close it."""
    return perron(np.abs(np.linalg.inv(np.eye(2) + loop) @ C) @ change)


# ------------------------------------------------------------------------------------------------ counting


def _beginning(broken: BrokenLoop) -> int:
    """The first point, within an octave, at which the bound leaves -1 out."""
    clear = np.flatnonzero(broken.reach < 1)
    return int(clear[0]) if clear.size and broken.frequency_hz[clear[0]] <= 2 * broken.frequency_hz[0] else 0


def _end(gains: Gains, broken: BrokenLoop, limits: Limits) -> tuple[int, float]:
    """The last point, within an octave, from where on the loop is small enough, and what it is at most from there on;
    the last whose bound leaves -1 out where it is small enough nowhere.

    From there on the vehicle answers at most what it was measured to at that end, or what is sure of what was measured
    beyond it.
    """
    f, size = broken.frequency_hz, np.abs(broken.H)
    clear = np.flatnonzero(broken.reach < 1)
    ends = [int(at) for at in clear[::-1] if f[at] >= f[-1] / 2] or [f.size - 1]
    found = []
    for end in ends:
        near = (f >= f[end] / HIGH_END) & (f <= f[end])
        most = np.max((size + broken.bound)[near], axis=0)
        most = np.maximum(most, np.max((size - broken.bound)[end:], axis=0))
        found.append((end, float(np.max(perron(_beyond(gains, float(f[end]), broken.loop_s)[1] @ most)))))
        if found[-1][1] <= _left(limits):
            return found[-1]
    return found[0]


def _left(limits: Limits) -> float:
    """What a loop may be in size, whatever its phase, and leave the gain margin asked for."""
    return float(10 ** (-limits.gain_db / 20))


def _beyond(gains: Gains, from_hz: float, loop_s: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies from there on, and sizes of what is taken from the commands per rate; up to half of the loops."""
    f = np.geomspace(from_hz, max(0.5 / loop_s if loop_s else FARTHEST_HZ, 1.01 * from_hz), 200)
    return f, np.abs(taken(gains, f, loop_s))


def _counted(
    gains: Gains, model: Model, broken: BrokenLoop, limits: Limits, edge: float
) -> tuple[int | None, list[NotMeasured]]:
    """Roots to the right, and what keeps that from being sure; `edge`: what the loop is at most beyond the band."""
    f, found = broken.frequency_hz, []
    differs = np.abs(broken.loop - broken.model) + np.abs(broken.C) @ broken.bound
    unit = np.broadcast_to(np.eye(2), broken.loop.shape)
    low = SLACK * float(np.max(_round(broken.model, unit.astype(complex), differs)[f <= LOW_END * f[0]]))
    if low >= 1:
        found.append(NotMeasured(why="low", frequency_hz=float(f[0]), sweep_to_hz=float(f[0]) / 2))
    wide = np.flatnonzero(broken.reach >= 1)
    if wide.size:
        found.append(NotMeasured(why="bound", frequency_hz=float(f[wide[np.argmax(broken.reach[wide])]])))
    if edge > _left(limits):
        to = _sweep_to(gains, model, broken, _left(limits))
        found.append(NotMeasured(why="edge", frequency_hz=float(f[-1]), sweep_to_hz=to))
    return (None if low >= 1 or edge >= 1 else _roots(gains, model, broken)), found


def _roots(gains: Gains, model: Model, broken: BrokenLoop) -> int | None:
    of_model = roots_to_the_right(loop_of(gains, model))
    if of_model is None:
        return None
    below = np.pi * (unstable_poles(gains, model) - of_model) - _turn(gains, model, float(broken.frequency_hz[0]))
    there, poles = broken.loop, _open_poles(gains, model, broken.loop_s)
    meets = _angles(np.linalg.solve(np.eye(2) + broken.model[0], there[0] - broken.model[0]))
    inside = np.unwrap(np.angle(np.linalg.det(np.eye(2) + there)))
    whole = below + meets + float(inside[-1] - inside[0]) - _angles(there[-1])
    count = poles - whole / np.pi
    return round(count) if abs(count - round(count)) < WHOLE else None


def _turn(gains: Gains, model: Model, low_hz: float) -> float:
    """rad, by which the model's det(I + L) turns from a frequency to infinity."""
    w = frequencies(gains, loop_of(gains, model))
    w = np.concatenate([[2 * np.pi * low_hz], w[w > 2 * np.pi * low_hz]])
    w = np.exp(np.interp(np.arange(0, w.size - 1, 1 / FINER), np.arange(w.size), np.log(w)))
    s = np.asarray(1j * w, dtype=complex)
    turned = np.unwrap(np.angle(np.linalg.det(np.eye(2) + from_rates(gains, s) @ rates_per_command(model, s))))
    return float(turned[-1] - turned[0])


def _angles(x: ComplexArray) -> float:
    """rad, of det(I + x) of a matrix whose eigenvalues are smaller than 1, on the way from det(I) there."""
    return float(np.sum(np.angle(1 + np.linalg.eigvals(x))))


def _sweep_to(gains: Gains, model: Model, broken: BrokenLoop, left: float) -> float | None:
    """Hz, from where on the loop is small enough, by the model's answer there; None where it is that nowhere."""
    f, C = _beyond(gains, float(broken.frequency_hz[-1]), broken.loop_s)
    # a sweep's end is judged by the most that the vehicle answers near it
    H = np.abs(rates_per_command(model, np.asarray(2j * np.pi * f / HIGH_END, dtype=complex)))
    for at, there in enumerate(H):
        if float(np.max(perron(C[at:] @ there))) <= left:
            return float(math.ceil(BEYOND * f[at]))
    return None


# ------------------------------------------------------------------------------------------------ margins


def _crossing(one: Crossing | None) -> dict[str, float] | None:
    return None if one is None else one.to_json()


def _thin(
    margins: MeasuredMargins | None, model: Model, limits: Limits
) -> tuple[tuple[Shortfall, ...], tuple[NotMeasured, ...]]:
    """Margins that are less than asked whatever their error, and those of which that cannot be told."""
    if margins is None:
        return (), ()
    thin, near = [], []
    delay_ms = max(limits.delay_ms, 1000 * OF_DELAY * model.by_name.get("T_d", 0.0))
    for quantity, limit in zip(MARGINS, (limits.gain_db, limits.phase_deg, delay_ms), strict=True):
        one = getattr(margins, quantity)
        if one is None or one.value >= limit:
            continue
        if one.value + one.bound < limit:
            thin.append(Shortfall(quantity=quantity, value=one.value, limit=limit))
        else:
            near.append(NotMeasured(why="near", frequency_hz=one.frequency_hz))
    return tuple(thin), tuple(near)


def _disk(C: ComplexArray, f: FloatArray, H: ComplexArray, error: FloatArray) -> MeasuredDisk:
    """At the frequency where it is least."""
    sizes = disk_sizes(np.asarray(C @ H))
    at = int(np.argmin(sizes))
    rng = np.random.default_rng(SEED)
    shape = (2, DRAWS, 2, 2)
    real, imag = rng.standard_normal(shape) * error[at] / math.sqrt(2)
    drawn = disk_sizes(np.asarray(C[at] @ (H[at] + real + 1j * imag)))
    low, high = (float(x) for x in np.quantile(drawn, ((1 - PROBABILITY) / 2, (1 + PROBABILITY) / 2)))
    return MeasuredDisk(margin=DiskMargin(size=float(sizes[at]), frequency_hz=float(f[at])), low=low, high=high)
