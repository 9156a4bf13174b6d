"""Which maneuver, or which measurement, would tell rivals apart that these runs cannot.

Every maneuver that a card can hold is imagined: the commands by the chirp's law with its noise, both rivals answering.
What one of them cannot imitate of the other, its parameters refitted to the flown runs and the imagined ones together,
is compared with the noise's spectrum of the flown runs: a separation in standard errors, of which only what the new run
adds counts. The cheapest card that adds NEEDED is proposed: seconds of flight, dearer with amplitude. Amplitudes stay
within twice what was flown and inside the envelope as the flown peaks grow with them.

Where no card helps, signals are imagined logged: the servo's position, the flapping, the attitude by another sensor;
then what a hand may do meanwhile: yaw, move the collective, change the rotor speed. That a lag in all servos and one in
both gyros need such a thing is computed here, not listed: every input that a card moves passes the servos, the
elevator's too, and every answer the gyros.

Ignored: the controller, which changes the commands below some 1 Hz; so separations are good to about a factor of two.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sysid.data.preprocess import ComplexArray, Spectrum, spectra
from sysid.data.record import CHANNELS, Record
from sysid.data.stacks import Stack, stack
from sysid.diagnose.evidence import Candidate, Ground, Metric, metric
from sysid.diagnose.explain import quantity
from sysid.fit.noise import Division
from sysid.model.acting import in_time
from sysid.model.bases import compose
from sysid.model.effect import Effect, EffectError, Stage, catalogue
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.response import transfer
from sysid.model.structure import FloatArray, Model, Structure

NEEDED = 3.0
"""Standard errors between rivals from which on they count as told apart."""
HOPELESS = 1e-3
"""Linear rivals to which one maneuver on the cyclic adds no more are equal on it, however it is moved."""
SAME_WHATEVER = 0.3
"""Below it in every maneuver, the rivals are the same on these channels."""
MOST_TIMES = 2.0
"""The amplitude flown, at most."""
MOST_REPEATS = 4
LARGEST_RATE = 0.8 * 3.0
"""rad/s, of what a card's default limits allow;"""
LARGEST_ATTITUDE = 0.8 * math.radians(25)
LARGEST_COMMAND = 0.8 * 0.9
SLOWEST_HZ = 0.25
"""Below it, rates are not integrated to attitude: noise would drift."""
LAW_C1, LAW_NOISE = 4.0, 0.2
SWEPT_HZ = (0.5, 10.0)
REST_S = 1.0
DOUBLET_S, PULSE_S, PULSES = 6.0, 0.25, 6
RISK = 1.0
"""How much dearer a flight is for each amplitude beyond the flown one."""
ELEVATOR_AMPLITUDE = 0.3
"""Where none was flown: the bundled forward card's."""
LETTERS = {"roll": "x", "pitch": "y", "elevator": "e"}
NOISE_OF = {"servo": 0.01, "flapping": 0.02, "attitude": 0.01}
"""Of sensors that may be fitted: full command and rad, white at the log's rate."""
WORDS_OF = {
    "servo": "log the servo's position",
    "flapping": "measure the flapping (a and b)",
    "attitude": "log the attitude by another sensor than these gyros",
}
STEP = 1e-4


@dataclass(frozen=True)
class NextManeuver:
    """What to do next."""

    maneuver: str
    separates: tuple[str, ...]
    """Rivals, the winner first."""
    why: str
    sigma: float | None
    """Expected separation, in standard errors; None where it cannot be foretold."""
    card: Mapping[str, Any] | None
    """A test card as its TOML reads, where a card can hold it."""

    @property
    def toml(self) -> str | None:
        """The card as text."""
        return None if self.card is None else _toml(self.card)

    @property
    def sentence(self) -> str:
        return f"to separate {' from '.join(self.separates)}: {self.maneuver} ({self.why})"

    def to_json(self) -> dict[str, Any]:
        return {
            "maneuver": self.maneuver,
            "separates": list(self.separates),
            "why": self.why,
            "sigma": None if self.sigma is None or not math.isfinite(self.sigma) else self.sigma,
            "card": None if self.card is None else dict(self.card),
        }


def next_maneuver(rivals: Sequence[Candidate], division: Division, by: Metric) -> NextManeuver | None:
    """For the winner and what the data cannot tell from it, the winner first; None where nothing imagined helps."""
    if len(rivals) < 2:
        return None
    winner, *others = rivals
    flown = _Flown.of(winner.ground)
    pairs = [_Pair.of(winner, other, by) for other in others]
    found = _imagined(_plans(flown, rivals), pairs, flown, division)
    chosen = _cheapest(found)
    if chosen is not None:
        return _proposal(*chosen, pairs)
    most = [max((each[i][0] for _, each in found), default=0.0) for i in range(len(pairs))]
    measured = _measurement(pairs, most)
    if measured is not None:
        return measured
    chosen = _cheapest(_imagined(_by_hand(flown, rivals), pairs, flown, division))
    return _own_signal(pairs) if chosen is None else _proposal(*chosen, pairs)


def _imagined(
    plans: Sequence[_Plan], pairs: Sequence[_Pair], flown: _Flown, division: Division
) -> list[tuple[_Plan, list[Told]]]:
    """What each plan would tell, the cheapest first; once one tells everything, dearer ones are not asked."""
    found: list[tuple[_Plan, list[Told]]] = []
    enough = math.inf
    linear = all(one.model.structure.linear for pair in pairs for one in (pair.truth, pair.rival))
    hopeless = False
    for plan in sorted(plans, key=lambda one: one.cost):
        if plan.cost >= enough:
            break
        if hopeless and plan.effect is None:
            continue
        each = [pair.told_by(plan, flown, division) for pair in pairs]
        found.append((plan, each))
        hopeless |= linear and plan.effect is None and all(sigma < HOPELESS for sigma, _ in each)
        if all(sigma >= NEEDED for sigma, _ in each):
            enough = min(enough, replace(plan, repeats=max(repeats for _, repeats in each)).cost)
    return found


def linear_or_not(parent: Candidate, division: Division) -> NextManeuver | None:
    """For an error that nothing explains: the same chirp at half the amplitude, against what was flown.

    A linear error halves; one that grows with the square is a quarter. `division` is that of the parent's residual.
    """
    flown = _Flown.of(parent.ground)
    axis = max(flown.amplitude, key=lambda name: flown.amplitude[name], default=None)
    if axis is None:
        return None
    share = np.sum(np.maximum(np.sum(division.explained, axis=0), 0)) / max(float(np.sum(division.power)), 1e-300)
    beyond = max(division.chi_squared - division.degrees, 0.0) / max(len(parent.ground.spectra), 1)
    worst = int(np.argmax(parent.estimate.error.residual_power / parent.estimate.error.measured_power))
    wanted = {"p": "roll", "q": "pitch"}[parent.model.structure.outputs[worst]]
    axis = wanted if wanted in flown.amplitude else axis
    plans = [_Plan("chirp", axis, part * flown.amplitude[axis], *flown.band_hz, flown.duration_s) for part in (0.5, 1)]
    sigma = 0.25 * math.sqrt(beyond)
    said = f"{axis} chirps at half the amplitude ({plans[0].amplitude:.3g}) and at the flown one, twice each"
    why = (
        "a linear error halves with the amplitude, a nonlinear one does not, and the repeats tell both from noise; "
        f"{100 * share:.0f} % of what is left now looks like a linear answer to the commands"
    )
    table = [replace(one, repeats=2).table() for one in plans]
    return NextManeuver(said, ("linear", "nonlinear"), why, sigma if sigma > 0 else None, _card("half and full", table))


# ------------------------------------------------------------------------------------------------ what was flown


@dataclass(frozen=True, eq=False)
class _Flown:
    """The flown runs, as far as a new one is made from them."""

    amplitude: Mapping[str, float]
    """Axis -> of its excitation, part of full command."""
    band_hz: tuple[float, float]
    duration_s: float
    dt: float
    most_times: float
    """The amplitude that the envelope allows, over the flown one."""
    ground: Ground

    @classmethod
    def of(cls, ground: Ground) -> _Flown:
        segments = [one.segment for one in ground.spectra]
        amplitude: dict[str, float] = {}
        for segment in segments:
            moved = {axis: _excitation(segment.channels, letter) for axis, letter in LETTERS.items()}
            sizes = {axis: float(np.std(values)) for axis, values in moved.items() if values is not None}
            axis = max(sizes, key=lambda name: sizes[name])
            values = moved[axis]
            if values is not None and sizes[axis] > 0:
                amplitude[axis] = max(amplitude.get(axis, 0.0), float(np.quantile(np.abs(values), 0.95)))
        swept = [one.record.swept_band_hz for one in segments if one.record.swept_band_hz is not None]
        band = (min(low for low, _ in swept), max(high for _, high in swept)) if swept else SWEPT_HZ
        longest = max(segments, key=lambda one: one.duration_s)
        return cls(
            {axis: _rounded(size) for axis, size in amplitude.items()},
            band,
            float(max(10.0, round(longest.duration_s - 2 * REST_S))),
            longest.dt,
            min(MOST_TIMES, _headroom(ground.spectra)),
            ground,
        )

    @property
    def logged(self) -> frozenset[str]:
        """Channels of all runs, moving or not."""
        return self.ground.available | self.ground.still

    def channel(self, name: str, n: int) -> FloatArray:
        """A logged channel, as long as wanted."""
        longest = max(self.ground.spectra, key=lambda one: one.samples)
        return np.resize(longest.segment.channels[name], n)


def _excitation(channels: Mapping[str, FloatArray], letter: str) -> FloatArray | None:
    for name in (f"excitation_{letter}", f"delta_{letter}"):
        if name in channels:
            return np.asarray(channels[name] - np.mean(channels[name]))
    return None


def _rounded(size: float) -> float:
    """To a number that people would write into a card."""
    return round(size, 2) if abs(round(size, 2) - size) <= 0.05 * size else round(size, 3)


def _headroom(found: Sequence[Spectrum]) -> float:
    """How much larger the flown peaks may grow."""
    rate = attitude = command = 1e-9
    for one in found:
        channels = one.segment.channels
        rate = max(rate, *(float(np.max(np.abs(channels[name]))) for name in ("p", "q")))
        command = max(command, *(float(np.max(np.abs(channels[name]))) for name in ("delta_x", "delta_y")))
        slow = np.where(one.frequency_hz >= SLOWEST_HZ, one.Y / (2j * np.pi * one.frequency_hz), 0)
        attitude = max(attitude, float(np.max(np.abs(one.in_time(slow)))))
    return min(LARGEST_RATE / rate, LARGEST_ATTITUDE / attitude, LARGEST_COMMAND / command)


# ------------------------------------------------------------------------------------------------ what may be flown


@dataclass(frozen=True)
class _Plan:
    """One maneuver to imagine."""

    kind: str
    axis: str
    amplitude: float
    f_start_hz: float
    f_stop_hz: float
    duration_s: float
    times: float = 1.0
    """Its amplitude over the flown one."""
    repeats: int = 1
    by_hand: str = ""
    """What the pilot does meanwhile, for people."""
    effect: str | None = None
    """The catalogue entry through which that acts."""
    channel: str | None = None

    @property
    def cost(self) -> float:
        """Seconds of flight, dearer with amplitude."""
        return self.repeats * self.duration_s * (1 + RISK * max(0.0, self.times - 1))

    @property
    def words(self) -> str:
        band = f" {self.f_start_hz:g}-{self.f_stop_hz:g} Hz," if self.kind == "chirp" else f" of {PULSE_S:g} s pulses,"
        often = ("", "", " twice", " three times", " four times")[self.repeats]
        also = f", while {self.by_hand}" if self.by_hand else ""
        larger = f" ({self.times:g} times the flown one)" if self.times != 1 else ""
        return (
            f"{self.axis} {self.kind}{band} {self.duration_s:g} s, amplitude {self.amplitude:.3g}{larger}{often}{also}"
        )

    def table(self) -> dict[str, Any]:
        found: dict[str, Any] = {"kind": self.kind, "axis": self.axis, "amplitude": round(self.amplitude, 4)}
        found["duration_s"] = self.duration_s
        if self.kind == "chirp":
            found |= {"f_start_hz": self.f_start_hz, "f_stop_hz": self.f_stop_hz}
        else:
            found["pulse_s"] = PULSE_S
        return {**found, "repeat": self.repeats}

    def excitation(self, dt: float) -> FloatArray:
        """Samples (3, n) on roll, pitch, elevator, with a second of rest before and after."""
        n, rest = round(self.duration_s / dt), round(REST_S / dt)
        row = list(LETTERS).index(self.axis)
        found = np.zeros((3, n + 2 * rest))
        if self.kind == "doublet":
            found[row, rest : rest + n] = _doublets(self.amplitude, n, dt)
        else:
            found[:, rest : rest + n] = _noise(self, n, dt)
            found[row, rest : rest + n] += chirp(self.amplitude, self.f_start_hz, self.f_stop_hz, n, dt)
        return found


def chirp(amplitude: float, start_hz: float, stop_hz: float, n: int, dt: float) -> FloatArray:
    """The paper's Table 1, without its noise: A sin of the integral of a frequency that grows exponentially, (n,)."""
    t, T = dt * np.arange(n), n * dt
    share = (T / LAW_C1 * np.expm1(LAW_C1 * t / T) - t) / math.expm1(LAW_C1)
    return np.asarray(amplitude * np.sin(2 * np.pi * (start_hz * t + (stop_hz - start_hz) * share)))


def _noise(plan: _Plan, n: int, dt: float) -> FloatArray:
    """Table 1's noise, independent on every axis, the same each time it is asked for."""
    from scipy.signal import lfilter

    corner = 2 * np.pi * plan.f_stop_hz * dt
    part = corner / (1 + corner)
    white = np.random.default_rng(1).normal(0.0, LAW_NOISE * plan.amplitude, (3, n))
    white[2] *= plan.axis == "elevator"
    return np.asarray(lfilter([part], [1.0, part - 1.0], white, axis=1))


def _doublets(amplitude: float, n: int, dt: float) -> FloatArray:
    phase = np.floor(dt * np.arange(n) / PULSE_S) % PULSES
    return np.asarray(amplitude * (np.where(phase == 0, 1.0, 0.0) - np.where(phase == 1, 1.0, 0.0)))


def _plans(flown: _Flown, rivals: Sequence[Candidate]) -> list[_Plan]:
    """What to imagine: fewer where answers must be simulated in time."""
    linear = all(one.model.structure.linear for one in rivals)
    larger = [times for times in (1.5, math.floor(10 * flown.most_times) / 10) if 1 < times <= flown.most_times]
    top = max(float(one.frequency_hz[-1]) for one in flown.ground.spectra)
    low, high = flown.band_hz
    found = []
    for axis, size in flown.amplitude.items():
        same = _Plan("chirp", axis, size, low, high, flown.duration_s)
        found.append(same)
        found.append(_Plan("doublet", axis, size, low, high, DOUBLET_S))
        if linear:
            wide = replace(same, f_stop_hz=round(min(1.5 * high, top), 2))
            found += [wide, *(replace(wide, amplitude=times * size, times=times) for times in larger)]
            slow, middle = max(round(0.4 * low, 2), 0.1), round(0.3 * high, 2)
            long = max(flown.duration_s, math.ceil(2.5 / slow))  # a card wants two periods and more
            found.append(replace(same, f_start_hz=slow, f_stop_hz=middle, duration_s=float(long)))
            found.append(replace(same, f_start_hz=middle))
        found += [
            replace(same, amplitude=times * size, times=times) for times in (larger if linear else (0.5, *larger[-1:]))
        ]
    if linear and found and "elevator" not in flown.amplitude and "delta_e" in flown.logged:
        found.append(
            replace(found[0], axis="elevator", amplitude=ELEVATOR_AMPLITUDE, effect="elevator", channel="delta_e")
        )
    return found


def _by_hand(flown: _Flown, rivals: Sequence[Candidate]) -> list[_Plan]:
    """A chirp as flown, while something else of what these logs have is moved."""
    axis = next(iter(flown.amplitude), None)
    if axis is None or not all(one.model.structure.linear for one in rivals):
        return []
    same = _Plan("chirp", axis, flown.amplitude[axis], *flown.band_hz, flown.duration_s)
    return [
        replace(same, by_hand=words, effect=effect, channel=channel)
        for channel, words, effect in (
            ("delta_c", "the collective is moved gently", "input_coupling"),
            ("r", "the pilot yaws to and fro, some 0.6 rad/s", "yaw_coupling"),
            ("omega", "the rotor speed is changed by 4 % to and fro", "rotor_speed"),
        )
        if channel in flown.logged
    ]


def _moved(channel: str, flown: _Flown, n: int, dt: float) -> FloatArray:
    """What a hand does to a channel."""
    t = dt * np.arange(n)
    slow = 0.7 * np.sin(2 * np.pi * 0.13 * t) + 0.7 * np.sin(2 * np.pi * 0.41 * t + 1)
    if channel == "omega":
        return np.asarray(dict(flown.ground.constants).get("Omega_0", 172.8) * (1 + 0.04 * slow))
    return np.asarray({"r": 0.6, "delta_c": 0.05}[channel] * slow)


# ------------------------------------------------------------------------------------------------ two rivals


@dataclass(frozen=True, eq=False)
class _Pair:
    """The winner, taken for the truth, and a rival that is refitted to it."""

    truth: Candidate
    rival: Candidate
    apart: FloatArray
    """(N,), predicted by the truth less by the rival on the flown runs."""
    J: FloatArray
    """(free, N), what the rival's parameters can do there."""

    @classmethod
    def of(cls, truth: Candidate, rival: Candidate, by: Metric) -> _Pair:
        ours, theirs = (by([Y[None] for Y in one.Y_imposed])[0] for one in (truth, rival))
        return cls(truth, rival, ours - theirs, by(rival.J_imposed))

    @property
    def names(self) -> tuple[str, str]:
        return _name(self.truth), _name(self.rival)

    @cached_property
    def flown(self) -> float:
        """Standard errors between them on the flown runs."""
        return _left(self.apart, self.J, np.zeros(0), np.zeros((len(self.J), 0)), 0)

    def told_by(self, plan: _Plan, flown: _Flown, division: Division) -> tuple[float, int]:
        """Standard errors that flying the plan would add, and how often it must be flown; 0 where it cannot be."""
        try:
            with np.errstate(all="ignore"):
                apart, J, old = self._imagined(plan, flown, division)
        except (EffectError, RelaxationError, np.linalg.LinAlgError, KeyError):
            return 0.0, 1
        before = self.flown
        for repeats in range(1, MOST_REPEATS + 1):
            added = math.sqrt(max(_left(self.apart, old, apart, J, repeats) ** 2 - before**2, 0.0))
            if added >= NEEDED:
                break
        return added, repeats

    def _imagined(self, plan: _Plan, flown: _Flown, division: Division) -> tuple[FloatArray, FloatArray, FloatArray]:
        """On the plan's run: truth less rival (N,), what the rival can do (free, N), and the same on the flown runs."""
        truth, rival = (_with(one.model, plan, flown.ground) for one in (self.truth, self.rival))
        stacks = _synthesised(plan, flown, [truth.structure, rival.structure], truth)
        by = metric(truth, stacks, division)
        ours = by([respond(truth.structure, truth.values, group, False).Y[None] for group in stacks])[0]
        answers = [respond(rival.structure, rival.values, group, True) for group in stacks]
        theirs = by([one.Y[None] for one in answers])[0]
        added = [name for name in rival.structure.names if name not in self.rival.model.structure.names]
        at = [rival.structure.names.index(name) for name in (*self.rival.free, *added)]
        J = by([one.slopes[at] for one in answers])
        old = np.concatenate([self.J, np.zeros((len(added), self.J.shape[1]))])
        return ours - theirs, J, old


def _left(old: FloatArray, J_old: FloatArray, new: FloatArray, J_new: FloatArray, repeats: int) -> float:
    """Length of what the rival cannot imitate, the new run flown so many times."""
    G = J_old @ J_old.T + repeats * (J_new @ J_new.T)
    b = J_old @ old + repeats * (J_new @ new)
    scale = np.sqrt(np.maximum(np.diag(G), 1e-300))
    move = np.linalg.lstsq(G / np.outer(scale, scale), b / scale, rcond=1e-11)[0] / scale
    rest = float(old @ old) + repeats * float(new @ new) - 2 * float(move @ b) + float(move @ G @ move)
    return math.sqrt(max(rest, 0.0))


def _name(one: Candidate) -> str:
    return " + ".join(one.added)


def _with(model: Model, plan: _Plan, ground: Ground) -> Model:
    """The model with what the plan moves besides acting at its usual size."""
    structure = model.structure
    effect: Effect | None = None if plan.effect is None else catalogue()[plan.effect]
    if effect is None or effect.id in {one.id for one in structure.composed}:
        return model
    available = {"t", "p", "q", *structure.inputs, plan.channel or ""}
    constants = {"Omega_0": 172.8, **dict(ground.constants), **dict(structure.constants)}
    composed = compose(structure.base, [*structure.composed, effect], available, constants)
    known = dict(zip(structure.names, map(float, model.values), strict=True))
    return Model(composed, composed.vector({**{one.name: one.typical for one in composed.parameters}, **known}))


def _synthesised(plan: _Plan, flown: _Flown, structures: Sequence[Structure], truth: Model) -> list[Stack]:
    """The plan's run as the truth would answer it."""
    excitation = plan.excitation(flown.dt)
    n = excitation.shape[1]
    names = list(dict.fromkeys(("delta_x", "delta_y", *(name for one in structures for name in one.inputs))))
    channels: dict[str, FloatArray] = {"t": np.asarray(flown.dt * np.arange(n)), "p": np.zeros(n), "q": np.zeros(n)}
    for name in names:
        letter = name.removeprefix("delta_")
        if letter in LETTERS.values():
            channels[name] = excitation[list(LETTERS.values()).index(letter)]
        elif name == plan.channel:
            channels[name] = _moved(name, flown, n, flown.dt)
        else:
            channels[name] = flown.channel(name, n)
    top = max(float(one.frequency_hz[-1]) for one in flown.ground.spectra)
    found, _ = spectra([Record("imagined", channels)], names, ("p", "q"), (0.0, top))
    # the free motion of a nonlinear answer is taken from the measured rates: they must be like the answer
    H = transfer(truth.structure, truth.values, found[0].frequency_hz)
    rows = [found[0].inputs.index(name) for name in truth.structure.inputs]
    begin = replace(found[0], Y=np.einsum("kmf,mf->kf", H, found[0].U[rows]))
    (first,) = stack([begin])
    if truth.structure.linear:
        return [first]
    return stack([replace(begin, Y=respond(truth.structure, truth.values, first, False).Y)])


# ------------------------------------------------------------------------------------------------ the choice

Told = tuple[float, int]


def _cheapest(found: Sequence[tuple[_Plan, list[Told]]]) -> tuple[_Plan, list[Told]] | None:
    """Of the plans that tell most rivals from the winner, the cheapest."""
    best: tuple[tuple[int, float], _Plan, list[Told]] | None = None
    for plan, each in found:
        told = [one for one in each if one[0] >= NEEDED]
        if told:
            repeated = replace(plan, repeats=max(repeats for _, repeats in told))
            key = (-len(told), repeated.cost)
            if best is None or key < best[0]:
                best = (key, repeated, each)
    return None if best is None else best[1:]


def _proposal(plan: _Plan, each: Sequence[Told], pairs: Sequence[_Pair]) -> NextManeuver:
    told = [(pair, sigma) for pair, (sigma, _) in zip(pairs, each, strict=True) if sigma >= NEEDED]
    least = min(sigma for _, sigma in told)
    before = min(pair.flown for pair, _ in told)
    rest = [pair.names[1] for pair, (sigma, _) in zip(pairs, each, strict=True) if sigma < NEEDED]
    why = f"it sets them {least:.1f} standard errors of the noise further apart; these runs set them {before:.1f} apart"
    if plan.effect is not None:
        usual = [quantity(one, one.typical) for one in catalogue()[plan.effect].parameters]
        why += f"; taken that it acts as usual ({', '.join(usual)})" if len(usual) <= 2 else ""
    if rest:
        why += f"; {', '.join(rest)} would still look the same"
    names = (pairs[0].names[0], *(pair.names[1] for pair, _ in told))
    card = None if plan.by_hand else _card(f"separate {' from '.join(names)}", [plan.table()])
    return NextManeuver(plan.words, names, why, least, card)


def _card(name: str, tables: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {"name": name, "maneuver": [dict(one) for one in tables]}


def _toml(card: Mapping[str, Any]) -> str:
    lines = [f"name = {_quoted(card['name'])}"]
    for table in card["maneuver"]:
        lines += ["", "[[maneuver]]"]
        lines += [f"{key} = {_quoted(x) if isinstance(x, str) else repr(x)}" for key, x in table.items()]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A JSON string is a TOML string: a user's effect is named by its path."""
    return json.dumps(text, ensure_ascii=False)


# ------------------------------------------------------------------------------------------------ other signals


def _measurement(pairs: Sequence[_Pair], most: Sequence[float]) -> NextManeuver | None:
    """The signal that tells most rivals from the winner when the flown maneuvers are flown again with it logged."""
    best: tuple[tuple[int, float], str, list[float]] | None = None
    for signal in NOISE_OF:
        each = [_told_by_signal(pair, signal) for pair in pairs]
        reached = [sigma for sigma in each if sigma >= NEEDED]
        if reached and (best is None or (len(reached), min(reached)) > best[0]):
            best = ((len(reached), min(reached)), signal, each)
    if best is None:
        return None
    (_, least), signal, each = best
    told = [i for i, sigma in enumerate(each) if sigma >= NEEDED]
    names = (pairs[0].names[0], *(pairs[i].names[1] for i in told))
    same = all(most[i] < SAME_WHATEVER for i in told)
    begin = "whatever these inputs do, they answer alike in p and q" if same else "no maneuver of a card does enough"
    words = WORDS_OF[signal] + ", and fly the same again"
    why = f"{begin}; that signal sets them {_apart_words(least)}"
    return NextManeuver(words, names, why, least, None)


def _apart_words(sigma: float) -> str:
    return f"{sigma:.0f} standard errors apart" if sigma < 100 else "more than 100 standard errors apart"


def _told_by_signal(pair: _Pair, signal: str) -> float:
    """Standard errors that the signal adds when logged on runs like those flown."""
    truth, rival = pair.truth.model, pair.rival.model
    free = pair.rival.free
    apart, slopes = [], []
    for group in pair.truth.ground.imposed:
        here, there = _signal(truth, signal, group), _signal(rival, signal, group)
        if here is None or there is None:
            return 0.0
        weight = group.scale / NOISE_OF[signal]
        apart.append(_real(weight * (here - there)))
        slopes.append(np.stack([_real(weight * _slope(rival, name, signal, group, there)) for name in free]))
    J = np.concatenate(slopes, axis=1)
    after = _left(pair.apart, pair.J, np.concatenate(apart), J, 1)
    return math.sqrt(max(after**2 - pair.flown**2, 0.0))


def _real(x: ComplexArray) -> FloatArray:
    return np.asarray(np.ascontiguousarray(x).reshape(-1).view(float))


def _slope(model: Model, name: str, signal: str, group: Stack, here: ComplexArray) -> ComplexArray:
    """Of a signal to one parameter."""
    structure = model.structure
    if signal == "servo" and all(name not in one.names for one in structure.composed if one.stage is Stage.COMMAND):
        return np.zeros_like(here)
    index = structure.names.index(name)
    step = STEP * max(abs(model[name]), 0.1 * abs(structure.parameters[index].typical))
    moved = model.values.copy()
    moved[index] += step
    there = _signal(Model(structure, moved), signal, group)
    assert there is not None
    return (there - here) / step


def _signal(model: Model, signal: str, group: Stack) -> ComplexArray | None:
    """A signal that is not logged, two rows on a stack's bins; None where the model does not foretell it."""
    structure = model.structure
    U = _acting(model, group)
    if signal == "servo":
        return U[:2]
    if not structure.linear:
        return None
    outer = replace(structure, composed=tuple(one for one in structure.composed if one.stage is not Stage.COMMAND))
    A, B, _, _ = outer.matrices(np.array([model[name] for name in outer.names]))
    s = 2j * np.pi * group.frequency_hz
    X = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, (B @ U).T[..., None])[..., 0].T
    at = {name: X[i] for i, name in enumerate(outer.states)}
    if signal == "attitude":
        return np.stack([at["p"] / s, at["q"] / s])
    return np.stack([at["a"], at["b"]]) if "a" in at else None


def _acting(model: Model, group: Stack) -> ComplexArray:
    """The structure's inputs behind all that lies between command and swashplate."""
    structure = model.structure
    named = dict(zip(structure.names, map(float, model.values), strict=True))
    U = group.U[[group.inputs.index(name) for name in structure.inputs]].copy()
    commands = len(structure.commands)
    front = [one for one in structure.composed if one.samples is not None or one.per_command]
    if front:
        for one, part in zip(group.spectra, group.slices, strict=True):
            U[:commands, part] = one.transform(in_time(structure, front, one.segment, named))
    for effect in structure.composed:
        if effect.response is not None:
            s = 2j * np.pi * group.frequency_hz
            U[:commands] *= effect.response(s, {name: named[name] for name in effect.names})
    return U


def _own_signal(pairs: Sequence[_Pair]) -> NextManeuver | None:
    """A quantity that one rival is about and the log could hold: measured, it need not be guessed."""
    for pair in pairs:
        for one in (pair.truth, pair.rival):
            known = one.ground.available
            own = [name for name in one.model.structure.states if name in CHANNELS and name not in ("p", "q", "a", "b")]
            missing = [name for name in own if name not in known]
            if missing:
                why = f"{_name(one)} is about it: measured, it is no longer to be guessed from the rates"
                return NextManeuver(f"log {' and '.join(missing)}, and fly the same again", pair.names, why, None, None)
    return None
