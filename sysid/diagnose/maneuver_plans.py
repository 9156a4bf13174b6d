"""Maneuvers that may be flown next, made from those flown: what a card can hold, or a hand may do meanwhile."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from sysid.data.chirp import Chirp
from sysid.data.dataset import Dataset
from sysid.data.preprocess import Spectrum
from sysid.data.record import CYCLIC, RATES, Record
from sysid.diagnose.evidence import Candidate
from sysid.model.structure import FloatArray, recursion

MOST_TIMES = 2.0
"""The amplitude flown, at most."""
LARGEST_RATE = 0.8 * 3.0
"""rad/s, of what a card's default limits allow;"""
LARGEST_ATTITUDE = 0.8 * math.radians(25)
LARGEST_COMMAND = 0.8 * 0.9
LARGEST_FORCE = 0.8 * 0.5 * 9.81
"""m/s^2 beside the weight: rotors stay loaded."""
LARGEST_CLIMB = 0.8 * 2.0
"""m/s, at which the pilot still holds the height."""
SLOWEST_HZ = 0.25
"""Below it, rates are not integrated to attitude, nor forces to climb: noise would drift."""
LAW_NOISE = 0.2
SWEPT_HZ = (0.5, 10.0)
REST_S = 1.0
DOUBLET_S, PULSE_S, PULSES = 6.0, 0.25, 6
RISK = 1.0
"""How much dearer a flight is for each amplitude beyond the flown one."""
ELEVATOR_AMPLITUDE = 0.3
"""Where none was flown: the bundled forward card's."""
ALIKE = 0.1
"""Part by which numbers of a maneuver that was flown already may differ."""
LETTERS = {"roll": "x", "pitch": "y", "elevator": "e", "yaw": "r", "thrust": "c"}


@dataclass(frozen=True, eq=False, kw_only=True)
class Flown:
    """The flown runs, as far as a new one is made from them."""

    amplitude: Mapping[str, float]
    """Axis -> of its excitation, part of full command."""
    band_hz: tuple[float, float]
    duration_s: float
    dt: float
    most_times: float
    """The amplitude that the envelope allows, over the flown one."""
    axes: tuple[str, ...]
    """That a plan may move: those of the structure, and the elevator beside roll and pitch."""
    dataset: Dataset

    @classmethod
    def of(cls, one: Candidate) -> Flown:
        """By what flew, and the axes of a structure's base."""
        dataset, base, outputs = one.dataset, one.model.structure.base_, one.model.structure.outputs
        wanted = {*base.commands, *(["delta_e"] if set(CYCLIC) <= set(base.commands) else [])}
        axes = tuple(axis for axis, letter in LETTERS.items() if f"delta_{letter}" in wanted)
        segments = [one.segment for one in dataset.spectra]
        amplitude: dict[str, float] = {}
        for segment in segments if axes else ():
            moved = {axis: _excitation(segment.channels, LETTERS[axis]) for axis in axes}
            sizes = {axis: float(np.std(values)) for axis, values in moved.items() if values is not None}
            axis = max(sizes, key=lambda name: sizes[name])
            values = moved[axis]
            if values is not None and sizes[axis] > 0:
                amplitude[axis] = max(amplitude.get(axis, 0.0), _amplitude(values))
        swept = [one.record.swept_band_hz for one in segments if one.record.swept_band_hz is not None]
        band = (min(low for low, _ in swept), max(high for _, high in swept)) if swept else SWEPT_HZ
        longest = max(segments, key=lambda one: one.duration_s)
        return cls(
            amplitude={axis: _rounded(size) for axis, size in amplitude.items()},
            band_hz=band,
            duration_s=float(max(10.0, round(longest.duration_s - 2 * REST_S))),
            dt=longest.dt,
            most_times=min(MOST_TIMES, *(_headroom(each, axes, outputs) for each in dataset.spectra)),
            axes=axes,
            dataset=dataset,
        )

    def chirp(self, axis: str, part: float = 1.0) -> Plan:
        """A chirp on an axis as flown, at that part of its amplitude."""
        low, high = self.band_hz
        return Plan(
            kind="chirp",
            axis=axis,
            amplitude=part * self.amplitude[axis],
            f_start_hz=low,
            f_stop_hz=high,
            duration_s=self.duration_s,
        )

    @property
    def moved(self) -> frozenset[str]:
        """Commands that a plan may move."""
        return frozenset(f"delta_{LETTERS[axis]}" for axis in self.axes)

    @property
    def logged(self) -> frozenset[str]:
        """Channels of all runs, moving or not."""
        return self.dataset.available | self.dataset.still

    def channel(self, name: str, n: int) -> FloatArray:
        """A logged channel, as long as wanted."""
        longest = max(self.dataset.spectra, key=lambda one: one.samples)
        return np.resize(longest.segment.channels[name], n)


def _excitation(channels: Mapping[str, FloatArray], letter: str) -> FloatArray | None:
    for name in (f"excitation_{letter}", f"delta_{letter}"):
        if name in channels:
            return np.asarray(channels[name] - np.mean(channels[name]))
    return None


def _amplitude(excitation: FloatArray) -> float:
    return float(np.quantile(np.abs(excitation), 0.95))


def _rounded(size: float) -> float:
    """To a number that people would write into a card."""
    return round(size, 2) if abs(round(size, 2) - size) <= 0.05 * size else round(size, 3)


def _headroom(one: Spectrum, axes: Sequence[str], outputs: Sequence[str]) -> float:
    """How much larger the flown peaks of these axes may grow."""
    channels = one.segment.channels
    slow = np.where(one.frequency_hz >= SLOWEST_HZ, one.Y / (2j * np.pi * one.frequency_hz), 0)
    summed = dict(zip(outputs, one.in_time(slow), strict=True))
    rates = {"roll": RATES, "pitch": RATES, "yaw": ("r",)}
    peaks = [(LARGEST_RATE, channels[name]) for axis in axes for name in rates.get(axis, ()) if name in channels]
    peaks += [(LARGEST_ATTITUDE, summed[name]) for name in RATES if name in summed]
    for command in (f"delta_{LETTERS[axis]}" for axis in axes if axis not in ("elevator", "thrust")):
        peaks.append((LARGEST_COMMAND, channels[command]))
    if "thrust" in axes:
        hover, force = (float(np.mean(channels[name])) for name in ("delta_c", "az"))
        peaks += [(LARGEST_COMMAND - abs(hover), channels["delta_c"] - hover)]
        peaks += [(LARGEST_FORCE, channels["az"] - force), (LARGEST_CLIMB, summed["az"])]
    return min(largest / max(float(np.max(np.abs(values))), 1e-9) for largest, values in peaks)


@dataclass(frozen=True, kw_only=True)
class Plan:
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
    pulse_s: float = PULSE_S
    """Of a doublet."""
    effect: str | None = None
    """The catalogue entry through which acts what else is moved,"""
    channel: str | None = None
    """and on which channel."""
    by_hand: bool = False
    """Whether the pilot does that meanwhile: no card holds it."""

    @property
    def on_card(self) -> bool:
        """Whether a card can hold it: none sweeps thrust, for the pilot holds the height."""
        return not self.by_hand and self.axis != "thrust"

    @property
    def cost(self) -> float:
        """Seconds of flight, dearer with amplitude."""
        return self.repeats * self.duration_s * (1 + RISK * max(0.0, self.times - 1))

    def table(self) -> dict[str, Any]:
        found: dict[str, Any] = {"kind": self.kind, "axis": self.axis, "amplitude": round(self.amplitude, 4)}
        found["duration_s"] = self.duration_s
        if self.kind == "chirp":
            found |= {"f_start_hz": self.f_start_hz, "f_stop_hz": self.f_stop_hz}
        else:
            found["pulse_s"] = self.pulse_s
        return {**found, "repeat": self.repeats}

    def _law(self, duration_s: float) -> Chirp:
        """The paper's Table 1, without its noise."""
        return Chirp(
            axis=self.axis,
            law="tischler",
            f_start_hz=self.f_start_hz,
            f_stop_hz=self.f_stop_hz,
            duration_s=duration_s,
        )

    def excitation(self, dt: float) -> FloatArray:
        """Samples (axes, n) in the order of `LETTERS`, with a second of rest before and after."""
        n, rest = round(self.duration_s / dt), round(REST_S / dt)
        row = list(LETTERS).index(self.axis)
        found = np.zeros((len(LETTERS), n + 2 * rest))
        if self.kind == "doublet":
            found[row, rest : rest + n] = _doublets(self.amplitude, n, dt)
        else:
            found[:, rest : rest + n] = _noise(self, n, dt)
            found[row, rest : rest + n] += self.amplitude * self._law(n * dt).wave(np.asarray(dt * np.arange(n), float))
        return found


def _noise(plan: Plan, n: int, dt: float) -> FloatArray:
    """Table 1's noise, independent on roll, pitch and its own axis, the same each time it is asked for."""
    corner = 2 * np.pi * plan.f_stop_hz * dt
    part = corner / (1 + corner)
    white = np.random.default_rng(1).normal(0.0, LAW_NOISE * plan.amplitude, (len(LETTERS), n))
    for row, axis in enumerate(LETTERS):
        white[row] *= axis in ("roll", "pitch", plan.axis)
    return recursion(np.array([[1 - part]]), part * white[:, None])[:, 0]


def _doublets(amplitude: float, n: int, dt: float) -> FloatArray:
    phase = np.floor(dt * np.arange(n) / PULSE_S) % PULSES
    return np.asarray(amplitude * (np.where(phase == 0, 1.0, 0.0) - np.where(phase == 1, 1.0, 0.0)))


def flew(plan: Plan, run: Record) -> bool:
    """Whether a run was this maneuver: kind, axis, amplitude, and band or pulses within ALIKE, however long."""
    if (run.maneuver, run.axis) != (plan.kind, plan.axis) or plan.by_hand or plan.channel is not None:
        return False
    excitation = _excitation(run.channels, LETTERS[plan.axis])
    if excitation is None or not math.isclose(_amplitude(excitation), plan.amplitude, rel_tol=ALIKE):
        return False
    if plan.kind == "doublet":
        return math.isclose(_pulse_s(excitation, run.t), plan.pulse_s, rel_tol=ALIKE)
    wanted = plan.f_start_hz, plan.f_stop_hz
    swept = run.swept_band_hz
    return swept is not None and all(math.isclose(*each, rel_tol=ALIKE) for each in zip(swept, wanted, strict=True))


def _pulse_s(excitation: FloatArray, t: FloatArray) -> float:
    """For how long it stays beyond half its amplitude, at most, s."""
    beyond = np.abs(excitation) > 0.5 * _amplitude(excitation)
    signs = np.where(beyond, np.sign(excitation), 0.0)
    edges = np.flatnonzero(np.diff(signs, prepend=np.nan, append=np.nan) != 0)
    pulses = [stop - start for start, stop in pairwise(edges) if signs[start] != 0]
    return float(max(pulses, default=0) * np.median(np.diff(t)))


def possible_plans(flown: Flown, rivals: Sequence[Candidate], *, doublets: bool = True) -> list[Plan]:
    """What to imagine, doublets where the vehicle flies them: fewer where answers must be simulated in time."""
    linear = all(one.model.structure.linear for one in rivals)
    larger = [times for times in (1.5, math.floor(10 * flown.most_times) / 10) if 1 < times <= flown.most_times]
    top = max(float(one.frequency_hz[-1]) for one in flown.dataset.spectra)
    low, high = flown.band_hz
    found = []
    for axis, size in flown.amplitude.items():
        same = flown.chirp(axis)
        found += [same, *([replace(same, kind="doublet", duration_s=DOUBLET_S)] if doublets else [])]
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
    if linear and found and "elevator" in {*flown.axes} - {*flown.amplitude} and "delta_e" in flown.logged:
        found.append(
            replace(found[0], axis="elevator", amplitude=ELEVATOR_AMPLITUDE, effect="elevator", channel="delta_e")
        )
    return found


def plans_by_hand(flown: Flown, rivals: Sequence[Candidate]) -> list[Plan]:
    """A chirp as flown, while something else of what these logs have is moved."""
    axis = next(iter(flown.amplitude), None)
    if axis is None or not all(one.model.structure.linear for one in rivals):
        return []
    same = flown.chirp(axis)
    return [
        replace(same, effect=effect, channel=channel, by_hand=True)
        for channel, effect in (("delta_c", "input_coupling"), ("r", "yaw_coupling"), ("omega", "rotor_speed"))
        if channel in flown.logged
    ]


def moved_by_hand(channel: str, flown: Flown, n: int, dt: float) -> FloatArray:
    """What a hand does to a channel."""
    t = dt * np.arange(n)
    slow = 0.7 * np.sin(2 * np.pi * 0.13 * t) + 0.7 * np.sin(2 * np.pi * 0.41 * t + 1)
    if channel == "omega":
        return np.asarray(dict(flown.dataset.constants).get("Omega_0", 172.8) * (1 + 0.04 * slow))
    return np.asarray({"r": 0.6, "delta_c": 0.05}[channel] * slow)
