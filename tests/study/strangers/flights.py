"""A strange flight from a seed: its vehicle, its weather, its card, its log, and what it hides."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from planted import REST_S, Array

from strangers import air as weather_of
from strangers.air import GUSTS, ODDS, Maneuver, Weather
from strangers.detect import DETECTABLE, Ground
from strangers.flying import COLLECTIVE, Air, Loop, flown
from strangers.hiding import CATALOGUE, FOREIGN, NEWER, ON_MOTORS, Hidden, Sizes, may_stand_together, possible
from strangers.vehicles import Vehicle, drawn, quadrotor

STREAM = 14
"""Of all the random streams that a seed has, these flights'."""
KINDS = ("none", "catalogue", "beyond", "two")
SHARES = (0.35, 0.40, 0.17, 0.08)
EXCITATION_LOGGED = 0.7
CHIRP_S = (8.0, 120.0)
SHORTER = 1.5
"""Above 1 the shorter chirps are the likelier."""
GUST_SIZE = (0.5, 4.0)
RATES = (
    *((1000, every) for every in (1, 2, 4, 10)),
    *((500, every) for every in (1, 1, 2, 4, 5, 10)),
    *((400, every) for every in (1, 1, 2, 4, 8)),
    *((250, every) for every in (1, 2, 5)),
)
"""The loop's, Hz, and how many of its samples pass for each that is logged: 50 to 1000 Hz."""
FAST_LOOP_S = 40.0
"""Longest chirp of a loop of 1000 Hz."""
STIRRED = 0.2
"""Standard deviation of a collective that shows what a governor does; the usual one shows little."""
TARGETS: Mapping[str, tuple[float, float]] = {"catalogue": (-0.5, 2.3), "beyond": (0.3, 2.5), "two": (0.5, 2.3)}
"""Powers of ten, of how well the flight shows it."""
OLDER = [name for name in CATALOGUE if name not in NEWER]
NEAR = 1.3
SEARCHES = 6
HALVINGS = 8
LEAST_STRENGTH = 0.02


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What follows from the seed before anything is flown."""

    seed: int
    vehicle: Vehicle
    weather: Weather
    card: tuple[Maneuver, ...]
    """Fitted ones first."""
    loop_hz: int
    every: int
    excitation_logged: bool
    loop_told: bool
    logged: tuple[str, ...]
    """Channels besides the rates and commands."""
    kind: str
    names: tuple[str, ...]
    targets: tuple[float, ...]
    """How well the flight is to show each."""

    @property
    def log_hz(self) -> float:
        return self.loop_hz / self.every

    @property
    def samples(self) -> int:
        """Of all runs, logged."""
        return sum(round((one.duration_s + 2 * REST_S) * self.log_hz) for one in self.card)

    @property
    def fitted(self) -> int:
        return sum(one.fitted for one in self.card)

    def to_json(self) -> dict[str, Any]:
        return {
            "size": self.vehicle.size,
            "loop": self.vehicle.loop,
            "table": dict(self.vehicle.table),
            "gusts": self.weather.gusts,
            "gust_kind": self.weather.kind,
            "vibration": self.weather.vibration,
            "chirp_noise": self.weather.chirp_noise,
            "chirp_s": self.card[0].duration_s,
            "card": [f"{one.kind} {one.axis} {'fitted' if one.fitted else 'judging'}" for one in self.card],
            "loop_hz": self.loop_hz,
            "log_hz": self.log_hz,
            "samples": self.samples,
            "loop_told": self.loop_told,
            "excitation_logged": self.excitation_logged,
            "logged": list(self.logged),
            "kind": self.kind,
        }


@dataclass(frozen=True, kw_only=True)
class Stranger:
    """What was flown and logged."""

    plan: Plan
    hidden: Hidden
    runs: tuple[Mapping[str, Array], ...]
    """The card's, channels (n,) under the contract's names."""

    @cached_property
    def detectability(self) -> float | None:
        """Times DETECTABLE; of two the smaller, each alone and beside the other; None where nothing is missing."""
        missing = self.hidden.names and not self.hidden.absorbed
        return _detectability(ground_of(self.plan), self.hidden) if missing else None

    @property
    def dt(self) -> float:
        return 1 / self.plan.loop_hz


def planned(seed: int, only: tuple[str, ...] = ()) -> Plan:
    """`only`: what it is to hide, whatever the seed says. Raises ValueError for a negative seed."""
    rng = np.random.default_rng([STREAM, seed])
    vehicle = drawn(rng)
    loop_hz, every = RATES[int(rng.integers(len(RATES)))]
    longest = FAST_LOOP_S if loop_hz == 1000 else CHIRP_S[1]
    duration_s = round(CHIRP_S[0] * (longest / CHIRP_S[0]) ** float(rng.random() ** SHORTER), 1)
    weather = Weather(
        gusts=math.exp(rng.uniform(*np.log(GUST_SIZE))),
        kind=str(rng.choice(GUSTS, p=ODDS)),
        gyro=weather_of.GYRO * float(rng.uniform(0.5, 2.0)),
        vibration=float(rng.uniform(0.005, 0.03)) if rng.random() < 0.3 else 0.0,
        chirp_noise=0.0 if rng.random() < 0.3 else weather_of.NOISE_ON_CHIRP,
    )
    if vehicle.table["omega"] / (2 * math.pi) > 0.45 * loop_hz / every:
        weather = replace(weather, vibration=0.0)
    kind = str(rng.choice(KINDS, p=SHARES))
    names = _with_newer(np.random.default_rng([STREAM, seed, 3]), kind, _names(rng, kind))
    if only:
        kind, names = "beyond" if only[0] in FOREIGN else ("catalogue", "two")[len(only) - 1], only
    if ON_MOTORS in names:
        vehicle = quadrotor(np.random.default_rng([STREAM, seed, 4]))
    entries = [CATALOGUE[name] for name in names if name in CATALOGUE]
    wanted = {one for entry in entries for one in entry.needs}
    barred = {one for entry in entries for one in entry.unlogged}
    chance = {"omega": 0.5, "r": 0.5, "delta_c": 0.4, "delta_r": 0.4}
    draws = {name: rng.random() < share for name, share in chance.items()}
    return Plan(
        seed=seed,
        vehicle=vehicle,
        weather=weather,
        card=_card(rng, duration_s),
        loop_hz=loop_hz,
        every=every,
        excitation_logged=bool(rng.random() < EXCITATION_LOGGED),
        loop_told=bool(rng.random() < 0.7),
        logged=tuple(name for name in chance if name not in barred and (name in wanted or draws[name])),
        kind=kind,
        names=names,
        targets=tuple(10 ** float(rng.uniform(*TARGETS[kind])) for _ in names),
    )


def _names(rng: np.random.Generator, kind: str) -> tuple[str, ...]:
    if kind == "none":
        return ()
    if kind == "beyond":
        return (str(rng.choice(list(FOREIGN))),)
    if kind == "catalogue":
        return (str(rng.choice(OLDER)),)
    while True:
        pair = tuple(str(one) for one in rng.choice([name for name in OLDER if not CATALOGUE[name].fixed], 2))
        if may_stand_together(pair):
            return pair


def _with_newer(rng: np.random.Generator, kind: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """As drawn, or one of NEWER in place of the last, as often as it is one of the catalogue."""
    if kind not in ("catalogue", "two") or rng.random() >= len(NEWER) / len(CATALOGUE):
        return names
    others = [name for name in NEWER if len(names) == 1 or may_stand_together((names[0], name))]
    return (*names[:-1], str(rng.choice(others))) if others else names


def _card(rng: np.random.Generator, duration_s: float) -> tuple[Maneuver, ...]:
    """One or two chirps on each axis; then, in most flights, others to judge by."""
    pairs = 2 if rng.random() < 0.6 else 1
    fitted = [
        Maneuver(kind="chirp", axis=axis, amplitude=1.0, duration_s=duration_s, fitted=True) for axis in (0, 1)
    ] * pairs
    judging = str(rng.choice(["nothing", "chirps", "doublets", "both"], p=[0.15, 0.3, 0.15, 0.4]))
    shorter = max(6.0, round(duration_s / 2, 1))
    kinds = {"nothing": (), "both": ("chirp", "doublet")}.get(judging, (judging[:-1],))
    size = {"chirp": 0.5, "doublet": 1.0}
    late = [
        Maneuver(kind=kind, axis=axis, amplitude=size[kind], duration_s=min(shorter, 30.0), fitted=False)
        for kind in kinds
        for axis in (0, 1)
    ]
    return (*fitted, *late)


def fly(seed: int, only: tuple[str, ...] = ()) -> Stranger:
    """The flight of a seed, or one that hides `only` this. Raises RuntimeError where the vehicle cannot be held."""
    plan = planned(seed, only)
    loop = Loop(dt=1 / plan.loop_hz, fitted=plan.fitted)
    air = _air(plan)
    ground = _ground(plan, air, loop) if plan.names else None
    draws = np.random.default_rng([STREAM, seed, 2]).random((2, 8))
    sizes = []
    for i, name in enumerate(plan.names):
        assert ground is not None
        sizes.append(_sized(plan, ground, name, plan.targets[i], draws[i]))
    hidden = Hidden(plan.names, tuple(sizes))
    return as_planned(plan, hidden, air)


def _detectability(ground: Ground, hidden: Hidden) -> float:
    """How well the flight shows what is hidden, in times of DETECTABLE; the less of two, each by itself and beside the
    other, whatever its sizes, as far as they fly together."""
    each = [Hidden((name,), (size,)) for name, size in zip(hidden.names, hidden.sizes, strict=True)]
    found = [ground.shown(one) for one in each]
    if len(each) == 2:
        found += [one for one in (ground.shown_beside(known, hidden) for known in each) if math.isfinite(one)]
    return min(found) / DETECTABLE


def as_planned(plan: Plan, hidden: Hidden, air: Air | None = None) -> Stranger:
    """The plan flown with what is hidden, its names those of the plan. Raises RuntimeError as `fly`."""
    air = _air(plan) if air is None else air
    found = flown(plan.vehicle, hidden, air, Loop(dt=1 / plan.loop_hz, fitted=plan.fitted))
    if not found.holds:
        raise RuntimeError(f"stranger {plan.seed} does not hold")
    commands, measured = found.commands, found.measured + air.noise
    return Stranger(
        plan=plan,
        hidden=hidden,
        runs=tuple(_logged(plan, air, commands[..., i], measured[..., i], i) for i in range(len(plan.card))),
    )


def ground_of(plan: Plan) -> Ground:
    """What tells how well this flight shows something."""
    return _ground(plan, _air(plan), Loop(dt=1 / plan.loop_hz, fitted=plan.fitted))


def _air(plan: Plan) -> Air:
    dt = 1 / plan.loop_hz
    samples = round((max(one.duration_s for one in plan.card) + 2 * REST_S) / dt)
    columns = [_air_of_run(plan, number, samples, dt) for number in range(len(plan.card))]
    return Air(**{name: np.stack([one[name] for one in columns], axis=-1) for name in columns[0]})


def _air_of_run(plan: Plan, number: int, samples: int, dt: float) -> dict[str, Array]:
    rng = np.random.default_rng([STREAM, plan.seed, 1, number])
    omega, t = plan.vehicle.table["omega"], np.arange(samples) * dt
    turns = rng.uniform(0, 2 * math.pi, 2)
    wander = 0.6 * np.sin(2 * math.pi * 0.035 * t + turns[0]) + 0.4 * np.sin(2 * math.pi * 0.09 * t + turns[1])
    steady = "second_order_flapping" in plan.names
    return {
        "excitation": weather_of.excitation(
            rng, plan.vehicle, plan.card[number], plan.weather.chirp_noise, samples, dt
        ),
        "gust": weather_of.gusts(rng, plan.vehicle, plan.weather, samples, dt),
        "noise": weather_of.gyro_noise(rng, plan.vehicle, plan.weather, samples, dt),
        "r": 0.5 * weather_of.coloured(rng, 0.5, samples, dt),
        "omega": omega * (1 + (0.0 if steady else 0.05) * wander),
        "delta_c": COLLECTIVE
        + (STIRRED if "governor" in plan.names else 0.05) * weather_of.coloured(rng, 1.0, samples, dt),
        "delta_r": 0.1 * weather_of.coloured(rng, 2.0, samples, dt),
    }


def _ground(plan: Plan, air: Air, loop: Loop) -> Ground:
    high_hz = min(plan.vehicle.band_hz[1], plan.log_hz / 4)
    untold_s = 0.0 if plan.loop_told else (1 / plan.log_hz - loop.dt) / 2
    fitted = air.runs(slice(0, plan.fitted))
    return Ground.of(plan.vehicle, fitted, loop, high_hz, every=plan.every, untold_s=untold_s)


def _sized(plan: Plan, ground: Ground, name: str, target: float, draws: Array) -> Sizes:
    """Sizes that this flight shows about `target` times DETECTABLE, by slopes of the base, as far as vehicles have
    them."""
    entry = CATALOGUE.get(name) or FOREIGN[name]
    over_s = max(one.duration_s for one in plan.card) + 2 * REST_S

    def at(strength: float) -> tuple[Sizes, float]:
        sizes = dict(entry.sizes(plan.vehicle, strength, draws))
        if name in CATALOGUE:
            sizes = possible(sizes)
        if "over_s" in sizes:
            sizes["over_s"] = over_s
        return sizes, ground.chi_squared(Hidden((name,), (sizes,))) / DETECTABLE

    strength, most = 1.0, entry.most
    sizes, seen = at(strength)
    for _ in range(HALVINGS):
        if math.isfinite(seen):
            break
        strength, most = strength / 2, strength / 2
        sizes, seen = at(strength)
    if getattr(entry, "fixed", False):
        return sizes
    low, high = 0.0, math.inf
    for _ in range(SEARCHES):
        if target / NEAR < seen < target * NEAR:
            break
        low, high = (max(low, strength), high) if seen < target else (low, min(high, strength))
        factor = min(5.0, max(0.1, math.sqrt(target / max(seen, 1e-9))))
        wanted = min(most, max(LEAST_STRENGTH, strength * factor))
        if not low < wanted < high and low > 0 and high < math.inf:  # a limit is not met at all, or plain
            wanted = math.sqrt(low * high)
        if wanted == strength:
            break
        found, shown = at(wanted)
        if not math.isfinite(shown):
            most = (strength + wanted) / 2
            continue
        strength, sizes, seen = wanted, found, shown
    return sizes


def _logged(plan: Plan, air: Air, commands: Array, measured: Array, run: int) -> Mapping[str, Array]:
    """One run as it stands in the log: its own length, every so many samples of the loop."""
    length = round((plan.card[run].duration_s + 2 * REST_S) * plan.loop_hz)
    keep = slice(0, length, plan.every)
    channels = {
        "t": np.arange(length) / plan.loop_hz,
        "p": measured[:, 0],
        "q": measured[:, 1],
        "delta_x": commands[:, 0],
        "delta_y": commands[:, 1],
    }
    if plan.excitation_logged:
        channels["excitation_x"] = air.excitation[:, 0, run]
        channels["excitation_y"] = air.excitation[:, 1, run]
    channels |= {name: getattr(air, name)[:, run] for name in plan.logged}
    return {name: values[keep].copy() for name, values in channels.items()}
