"""What may be hidden: each entry of the catalogue in a strength, and what the catalogue does not have.

A strength of 1 is a size that is met in practice; sizes follow it so that nothing is left as it goes to 0.

What is right is what the log can tell, and the diagnosis itself has to say what it cannot: where two entries are one
to p and q (`gyro_filter` and `servo_second_order`, the same two poles; `gyro_lag` and `servo_lag`), the other one's
name is right only where the hidden one is declared beside it, in a class of at most three. `motor_lag` is `servo_lag`
on motors: what hides it is a quadrotor, on which servos are not offered. `swashplate_phase` is another cyclic of the
base's own four terms: nothing is missing then, and to name anything is an alarm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from planted import ACTUATOR_EFFECTS, NOMINAL_OMEGA, PLANTED, Array, _Actuators, _Equations, add_servo, equations
from scipy.signal import lfilter

from strangers.vehicles import Vehicle, base_of

Sizes = Mapping[str, float]
LARGEST: Sizes = MappingProxyType(
    {
        "tau_s": 0.075, "T_d": 0.055, "tau_g": 0.028, "half_width": 0.045, "width": 0.045, "L_pp": 9.5, "M_qq": 9.5,
        "k_l": 0.58, "k": 1.4, "L_v": 19.0, "M_u": 19.0, "k_p": 1.0, "k_q": 1.0,
        "k_b": 0.95, "d_b": 1.9, "tau_b": 0.95, "gain": 0.48, "L_w": 480.0, "M_w": 480.0,
        "k_g": 0.75, "tau_o": 1.5,
    }
)  # fmt: skip
"""Sizes beyond which no vehicle has them, as the catalogue's plausible ranges say;"""
LEAST: Sizes = MappingProxyType({"rate": 0.55, "limit": 0.055, "corner": 5.2})
"""and below which."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One thing that may be hidden."""

    sizes: Callable[[Vehicle, float, Array], Sizes]
    """Of a vehicle and a strength; the numbers of (8,) are drawn evenly from 0 to 1 once a flight."""
    most: float = 3.0
    """Largest strength: beyond it vehicles have no such thing, or do not fly."""
    needs: tuple[str, ...] = ()
    """Channels that must be logged;"""
    unlogged: tuple[str, ...] = ()
    """and such as must not be."""
    family: str = "body"
    """`body`, `rotor`, `actuator` or `sensor`: two at once are of two families."""
    alone: bool = False
    """Whether its equations cannot stand beside another's by adding rows."""
    fixed: bool = False
    """Whether it has no null to grow from: planted as it is."""
    absorbed: bool = False
    """Whether the base is free to be that by itself: then nothing is missing."""
    change: Callable[[_Equations, Vehicle, Sizes], None] | None = None
    """What it does to the equations, where `planted` does not have it."""


def possible(sizes: Sizes) -> dict[str, float]:
    """Sizes of a catalogue's entry, inside what vehicles have."""
    inside = {name: math.copysign(min(abs(value), LARGEST.get(name, math.inf)), value) for name, value in sizes.items()}
    return {name: max(value, LEAST[name]) if name in LEAST else value for name, value in inside.items()}


def _stretch(draw: float, factor: float = 1.5) -> float:
    """From 1/factor to factor."""
    return factor ** (2 * draw - 1)


def _of_planted(name: str, *scaled: str) -> Callable[[Vehicle, float, Array], Sizes]:
    """The sizes of `planted`, those named times the strength and a draw each, the others drawn around theirs."""

    def sizes(vehicle: Vehicle, strength: float, draws: Array) -> Sizes:
        return {
            key: value * (strength if key in scaled else 1.0) * _stretch(float(draws[i % draws.size]))
            for i, (key, value) in enumerate(PLANTED[name].items())
        }

    return sizes


def _accelerations(name: str, **scaled: str) -> Callable[[Vehicle, float, Array], Sizes]:
    """As `_of_planted` for moments, which also go with the vehicle's own: parameter to `L_b` or `M_a`."""
    plain = _of_planted(name, *scaled)
    usual = {"L_b": 147.5, "M_a": 713.4}

    def sizes(vehicle: Vehicle, strength: float, draws: Array) -> Sizes:
        found = dict(plain(vehicle, strength, draws))
        for key, of in scaled.items():
            found[key] *= math.sqrt(vehicle.table[of] / usual[of])
        return found

    return sizes


def _lateness(vehicle: Vehicle) -> float:
    """How long a servo of this vehicle may take, of the paper's vehicle's."""
    return vehicle.table["tau_f"] / 0.091


def _of_amplitude(vehicle: Vehicle) -> float:
    """The smaller chirp, of full command: what limits and play count by."""
    return min(vehicle.amplitudes)


def _flapping(vehicle: Vehicle, strength: float, draws: Array) -> Sizes:
    lock = 16 / (vehicle.table["tau_f"] * vehicle.table["omega"])
    return {"lock_number": lock, "flap_frequency_ratio": math.sqrt(1 + 0.5 * _coupling(vehicle) * lock / 4)}


def _coupling(vehicle: Vehicle) -> float:
    return (vehicle.table["B_a"] - vehicle.table["A_b"]) / 2


def _mode(vehicle: Vehicle, strength: float, draws: Array) -> Sizes:
    low, high = vehicle.band_hz[1] * 0.45, vehicle.band_hz[1] * 1.1
    found = {}
    for i, axis in enumerate(("roll", "pitch")):
        found[f"frequency_{axis}"] = max(3.0, low * (high / low) ** float(draws[i]))
        found[f"zeta_{axis}"] = 0.02 + 0.06 * float(draws[i + 2])
        found[f"kappa_{axis}"] = 0.15 * strength * _stretch(float(draws[i + 4]))
    return found


def _late_motors(E: _Equations, vehicle: Vehicle, size: Sizes) -> None:
    """tau_m v' = command - v in every motor."""
    for name in ("x", "y"):
        E.add(f"v_{name}", **{name: 1 / size["tau_m"], f"v_{name}": -1 / size["tau_m"]})
        for row in ("p", "q"):
            E.add(row, **{f"v_{name}": E.rows[row].pop(name)})


def _drag(vehicle: Vehicle, strength: float, draws: Array) -> Sizes:
    """The square's: other powers are other names' business."""
    found = _accelerations("quadratic_damping", L_pp="L_b", M_qq="M_a")(vehicle, strength, draws)
    return {**found, "exponent": 2.0}


def _regressive(vehicle: Vehicle, strength: float, draws: Array) -> Sizes:
    """A mode at a quarter to three fifths of the rotor's speed, where the chirps reach it."""
    turns, high = vehicle.table["omega"] / (2 * math.pi), min(15.0, 0.9 * vehicle.band_hz[1])
    low = min(max(3.0, 0.25 * turns), 0.7 * high)
    return {
        "frequency_lag": low * (min(high, max(0.6 * turns, low)) / low) ** float(draws[0]),
        "zeta_lag": 0.02 * 6.0 ** float(draws[1]),
        "gain": 0.12 * strength * _stretch(float(draws[2])),
    }


def _wake(vehicle: Vehicle, strength: float, draws: Array) -> Sizes:
    """A wing behind the rotor's centre or before it; across it the wing is short."""
    pitch = 120.0 * strength * math.sqrt(vehicle.table["M_a"] / 713.4) * _stretch(float(draws[0]))
    side = 1.0 if draws[1] < 0.7 else -1.0
    across = 0.3 * float(draws[2]) * math.sqrt(vehicle.table["L_b"] / vehicle.table["M_a"])
    return {"L_w": across * side * pitch, "M_w": side * pitch, "tau_w": 0.04 * 5.0 ** float(draws[3])}


CATALOGUE: Mapping[str, Entry] = MappingProxyType(
    {
        "second_order_flapping": Entry(
            sizes=_flapping, needs=("omega",), family="rotor", alone=True, fixed=True
        ),
        "dynamic_inflow": Entry(sizes=_of_planted("dynamic_inflow", "k_l"), most=1.5, family="rotor"),
        "rotor_speed": Entry(sizes=_of_planted("rotor_speed", "k", "n"), most=1.3, needs=("omega",), family="rotor"),
        "hub_gyroscopics": Entry(sizes=_of_planted("hub_gyroscopics", "h_p", "h_q"), most=3.0),
        "angular_damping": Entry(sizes=_accelerations("angular_damping", L_p="L_b", M_q="M_a"), most=6.0),
        "quadratic_damping": Entry(sizes=_drag, most=1.5),
        "attitude_stiffness": Entry(sizes=_accelerations("attitude_stiffness", L_phi="L_b", M_theta="M_a")),
        "speed_stability": Entry(sizes=_accelerations("speed_stability", L_v="L_b", M_u="M_a"), most=2.0),
        "inertia_coupling": Entry(sizes=_of_planted("inertia_coupling", "c_p"), most=2.0, alone=True),
        "yaw_coupling": Entry(sizes=_of_planted("yaw_coupling"), needs=("r",), fixed=True),
        "structural_mode": Entry(sizes=_mode, most=3.0, alone=True),
        "input_coupling": Entry(
            sizes=_accelerations(
                "input_coupling", L_delta_c="L_b", M_delta_c="M_a", L_delta_r="L_b", M_delta_r="M_a"
            ),
            most=6.0,
            needs=("delta_c", "delta_r"),
        ),
        "servo_lag": Entry(
            sizes=lambda vehicle, s, draws: {"tau_s": 0.025 * s * _lateness(vehicle)}, most=2.0, family="actuator"
        ),
        "servo_second_order": Entry(
            sizes=lambda vehicle, s, draws: {
                "frequency": 12.0 / (max(s, 1e-3) * _lateness(vehicle)), "zeta": 0.5 + 0.4 * float(draws[0]),
            },
            most=1.8,
            family="actuator",
        ),
        "transport_delay": Entry(
            sizes=lambda vehicle, s, draws: {"T_d": 0.02 * s * _lateness(vehicle)}, most=2.0, family="actuator"
        ),
        "servo_rate_limit": Entry(
            sizes=lambda vehicle, s, draws: {
                "rate": 0.6 * 2 * math.pi * vehicle.band_hz[1] * _of_amplitude(vehicle) / max(s, 1e-3),
            },
            most=2.5,
            family="actuator",
        ),
        "servo_saturation": Entry(
            sizes=lambda vehicle, s, draws: {"limit": max(vehicle.amplitudes) * 1.3 / (0.4 + max(s, 1e-3))},
            most=1.6,
            family="actuator",
        ),
        "servo_deadband": Entry(
            sizes=lambda vehicle, s, draws: {"width": 0.12 * s * _of_amplitude(vehicle)}, family="actuator"
        ),
        "servo_backlash": Entry(
            sizes=lambda vehicle, s, draws: {"half_width": 0.12 * s * _of_amplitude(vehicle)}, family="actuator"
        ),
        "gyro_lag": Entry(
            sizes=lambda vehicle, s, draws: {"tau_g": 0.01 * s * _lateness(vehicle)}, most=2.0, family="sensor"
        ),
        "gyro_misalignment": Entry(sizes=_of_planted("gyro_misalignment", "e"), most=1.6, family="sensor", alone=True),
        "gyro_filter": Entry(
            sizes=lambda vehicle, s, draws: {
                "corner": 18.0 / (max(s, 1e-3) * _lateness(vehicle)), "zeta": 0.5 + 0.4 * float(draws[0]),
            },
            most=2.5,
            family="sensor",
        ),
        "motor_lag": Entry(
            sizes=lambda vehicle, s, draws: {"tau_m": 0.015 * 7.0 ** float(draws[0])},
            family="actuator",
            alone=True,
            fixed=True,
            change=_late_motors,
        ),
        "stabiliser_bar": Entry(sizes=_of_planted("stabiliser_bar", "k_b", "d_b"), most=3.0, family="rotor"),
        "lead_lag": Entry(sizes=_regressive, most=3.0, family="rotor"),
        "slipstream_wing": Entry(sizes=_wake, most=3.0),
        "governor": Entry(
            sizes=_of_planted("governor", "k_g"), most=1.5, needs=("delta_c",), unlogged=("omega",), family="rotor"
        ),
        "swashplate_phase": Entry(
            sizes=lambda vehicle, s, draws: {"psi": (0.05 + 0.4 * float(draws[0])) * (1 if draws[1] < 0.5 else -1)},
            family="actuator",
            alone=True,
            fixed=True,
            absorbed=True,
        ),
    }
)  # fmt: skip
"""The catalogue's entries of hover."""
NEWER = (
    "gyro_filter", "motor_lag", "stabiliser_bar", "lead_lag", "slipstream_wing", "governor", "swashplate_phase",
)  # fmt: skip
"""Drawn apart, so that seeds that hide another are what they were before there were these."""
ON_MOTORS = "motor_lag"
"""What hides it is a quadrotor."""


# ------------------------------------------------------------------------------------------ not in the catalogue


@dataclass(frozen=True, kw_only=True)
class Foreign:
    """Something that no entry of the catalogue is."""

    change: Callable[[_Equations, Vehicle, Sizes], None] | None = None
    """What it adds to the equations."""
    bend: Callable[[Array, Array, float, Sizes, dict[str, Array]], Array] | None = None
    """(command less trim (3, runs), its earlier answer, dt, sizes, memory) -> what acts, less trim."""
    sizes: Callable[[Vehicle, float, Array], Sizes]
    most: float = 3.0
    resembles: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Entries that say the same at certain values of theirs."""
    answer: str | None = None
    """The entry that it is, of those that the catalogue got since; None while it has none."""


LAZY_STEPS = 16
"""Of such a servo in one sample of the loop."""


def _cubic_hub(E: _Equations, vehicle: Vehicle, size: Sizes) -> None:
    L_b, M_a = vehicle.table["L_b"], vehicle.table["M_a"]
    E.nonlinear = lambda s: {"p": size["k"] * L_b * s["b"] ** 3, "q": size["k"] * M_a * s["a"] ** 3}


def _cubic_damping(E: _Equations, vehicle: Vehicle, size: Sizes) -> None:
    E.nonlinear = lambda s: {"p": size["L_ppp"] * s["p"] ** 3, "q": size["M_qqq"] * s["q"] ** 3}


def _dry_friction(E: _Equations, vehicle: Vehicle, size: Sizes) -> None:
    """A hinge that sticks: a moment on the disc against its motion, nearly the same however fast."""
    E.nonlinear = lambda s: {
        "a": -size["c"] * np.tanh((s["a"]) / 0.003),
        "b": -size["c"] * np.tanh((s["b"]) / 0.003),
    }


def _product(E: _Equations, vehicle: Vehicle, size: Sizes) -> None:
    E.nonlinear = lambda s: {"p": size["k"] * s["q"] * np.abs(s["p"]), "q": -size["k"] * s["p"] * np.abs(s["q"])}


def _slung_load(E: _Equations, vehicle: Vehicle, size: Sizes) -> None:
    """A load that swings below, on both axes alike: its angle against the body's pulls at the body."""
    w, zeta = 2 * math.pi * size["frequency"], 0.05
    for axis, angle, moment in (("p", "phi", "L"), ("q", "theta", "M")):
        E.add(f"swing_{axis}", **{f"swung_{axis}": 1.0})
        E.add(f"swung_{axis}", **{f"swing_{axis}": -w * w, f"swung_{axis}": -2 * zeta * w, angle: w * w})
        E.add(axis, **{f"swing_{axis}": size[moment], angle: -size[moment]})


def _lag_per_axis(E: _Equations, vehicle: Vehicle, size: Sizes) -> None:
    for name in ("x", "y"):
        tau = size[f"tau_{name}"]
        E.add(f"v_{name}", **{name: 1 / tau, f"v_{name}": -1 / tau})
        for row in ("a", "b"):
            E.add(row, **{f"v_{name}": E.rows[row].pop(name)})


def _fading(command: Array, held: Array, dt: float, size: Sizes, memory: dict[str, Array]) -> Array:
    memory["t"] = memory.get("t", np.zeros(1)) + dt
    return np.asarray(command * (1 - size["share"] * memory["t"] / size["over_s"]))


def _lazy(command: Array, held: Array, dt: float, size: Sizes, memory: dict[str, Array]) -> Array:
    """Servos that run the slower the smaller their error, by its square root: no time constant fits. The mean over the
    sample; where it ends is kept."""
    position, acts = memory.get("position", held), np.zeros_like(held)
    for _ in range(LAZY_STEPS):
        error = command - position
        way = np.sign(error) * np.sqrt(np.abs(error) * size["usual"]) * dt / LAZY_STEPS / size["tau"]
        after = position + np.clip(way, -np.abs(error), np.abs(error))
        position, acts = after, acts + 0.5 * (position + after) / LAZY_STEPS
    memory["position"] = position
    return np.asarray(acts)


def _uneven(command: Array, held: Array, dt: float, size: Sizes, memory: dict[str, Array]) -> Array:
    """More control one way than the other."""
    return np.asarray(command + size["share"] * np.abs(command))


def _reverse(command: Array, held: Array, dt: float, size: Sizes, memory: dict[str, Array]) -> Array:
    """A link that gives way: cubic control power."""
    return np.asarray(command * (1 - size["share"] * (command / size["usual"]) ** 2))


FOREIGN: Mapping[str, Foreign] = MappingProxyType(
    {
        "cubic_hub": Foreign(change=_cubic_hub, sizes=lambda vehicle, s, draws: {"k": 40.0 * s}),
        "cubic_damping": Foreign(
            change=_cubic_damping,
            sizes=lambda vehicle, s, draws: {
                "L_ppp": -3.0 * s * math.sqrt(vehicle.table["L_b"] / 147.5),
                "M_qqq": -6.0 * s * math.sqrt(vehicle.table["M_a"] / 713.4),
            },
            most=2.0,
            resembles={"quadratic_damping": {"exponent": 3.0}},
        ),
        "sticking_hinge": Foreign(
            change=_dry_friction, sizes=lambda vehicle, s, draws: {"c": 0.02 * s / vehicle.table["tau_f"] * 0.3}
        ),
        "product_of_rates": Foreign(change=_product, sizes=lambda vehicle, s, draws: {"k": 4.0 * s}, most=2.0),
        "slung_load": Foreign(
            change=_slung_load,
            sizes=lambda vehicle, s, draws: {
                "frequency": 0.6 + 0.9 * float(draws[0]),
                "L": 0.10 * s * vehicle.table["L_b"] * 0.3,
                "M": 0.10 * s * vehicle.table["M_a"] * 0.3,
            },
        ),
        "lag_per_axis": Foreign(
            change=_lag_per_axis,
            sizes=lambda vehicle, s, draws: dict(
                zip(
                    ("tau_x", "tau_y") if draws[0] < 0.5 else ("tau_y", "tau_x"),
                    (0.004 * _lateness(vehicle), (0.004 + 0.03 * s) * _lateness(vehicle)),
                    strict=True,
                )
            ),
            most=1.5,
            answer="lag_per_axis",
        ),
        "fading_power": Foreign(
            bend=_fading, sizes=lambda vehicle, s, draws: {"share": 0.25 * s, "over_s": 0.0}, most=2.0
        ),
        "lazy_servos": Foreign(
            bend=_lazy,
            sizes=lambda vehicle, s, draws: {
                "tau": 0.02 * max(s, 1e-3) * _lateness(vehicle), "usual": _of_amplitude(vehicle),
            },
            most=2.0,
            answer="servo_acceleration_limit",
        ),
        "uneven_horns": Foreign(bend=_uneven, sizes=lambda vehicle, s, draws: {"share": 0.2 * s}, most=2.0),
        "giving_links": Foreign(
            bend=_reverse,
            sizes=lambda vehicle, s, draws: {"share": 0.2 * s, "usual": _of_amplitude(vehicle)},
            most=1.2,
        ),
    }
)  # fmt: skip


class _Bent(_Actuators):
    """Commands bent by something that is not in the catalogue."""

    pass_on = False

    def __init__(self, foreign: Foreign, size: Sizes, trim: Array, dt: float) -> None:
        super().__init__(None, {}, trim, dt)
        self._foreign, self._sizes, self._trim, self._acts = foreign, size, trim, np.zeros_like(trim)
        self._memory: dict[str, Array] = {}

    def pieces(self, command: Array, steps: int) -> list[tuple[float, Array]]:
        assert self._foreign.bend is not None
        self._acts = self._foreign.bend(command - self._trim, self._acts, self._dt, self._sizes, self._memory)
        return super().pieces(self._acts + self._trim, steps)


# ------------------------------------------------------------------------------------------ built into a vehicle


@dataclass(frozen=True)
class Hidden:
    """What a vehicle hides, each in its sizes."""

    names: tuple[str, ...]
    sizes: tuple[Sizes, ...]

    def equations(self, vehicle: Vehicle) -> _Equations:
        """The base with all of it; rows of several are added up."""
        found = base_of(vehicle.table)
        for name, size in zip(self.names, self.sizes, strict=True):
            change = (FOREIGN.get(name) or CATALOGUE[name]).change
            if change is not None:
                change(found, vehicle, size)
            elif name not in FOREIGN:
                found = _beside(found, equations(name, size, False, vehicle.table), vehicle)
        for name, size in zip(self.names, self.sizes, strict=True):
            if name in ("servo_lag", "servo_second_order"):
                _serve_others(found, name, size)
        return found

    def rotor_speed(self, omega: Array, collective: Array, dt: float) -> Array:
        """(n, runs) rad/s, of what nobody may log: as it is, or what a governor lets collective (n, runs) make of it.

        tau_o o' = collective - o, in the middle of each sample; `planted` counts from NOMINAL_OMEGA.
        """
        for name, size in zip(self.names, self.sizes, strict=True):
            if name == "governor":
                left, half = (math.exp(-part * dt / size["tau_o"]) for part in (1.0, 0.5))
                pulled = lfilter([0.0, 1 - left], [1.0, -left], collective, axis=0)
                return np.asarray(NOMINAL_OMEGA * (1 - size["k_g"] * (half * pulled + (1 - half) * collective)))
        return omega

    def others(self, commands: Array, dt: float) -> Array:
        """(n, commands, runs) of collective and yaw: what servos of the cyclic's make do to them sample by sample. A
        ring that ends the swashplate's tilt ends no collective."""
        for name, size in zip(self.names, self.sizes, strict=True):
            if name in ACTUATOR_EFFECTS and name != "servo_saturation" and "input_coupling" in self.names:
                servos = _Actuators(name, size, commands[0], dt)
                pieces = (servos.pieces(command, 1) for command in commands)
                return np.stack([sum(h * acting for h, acting in parts) / dt for parts in pieces])
        return commands

    def actuators(self, trim: Array, dt: float) -> _Actuators:
        for name, size in zip(self.names, self.sizes, strict=True):
            if name in FOREIGN and FOREIGN[name].bend is not None:
                return _Bent(FOREIGN[name], size, trim, dt)
            if name in ACTUATOR_EFFECTS:
                return _Actuators(name, size, trim, dt)
        return _Actuators(None, {}, trim, dt)

    def needs(self) -> set[str]:
        return {one for name in self.names if name in CATALOGUE for one in CATALOGUE[name].needs}

    @property
    def absorbed(self) -> bool:
        """Whether nothing is missing from the base for all that."""
        return all(name in CATALOGUE and CATALOGUE[name].absorbed for name in self.names)

    def to_json(self) -> list[dict[str, Any]]:
        """As the judge reads it."""
        return [
            {
                "id": name,
                "level": "none" if self.absorbed else "beyond" if answer is None else "catalogue",
                "answer": None if self.absorbed else answer,
                "accepts": [],
                "resembles": {key: dict(value) for key, value in FOREIGN[name].resembles.items()}
                if name in FOREIGN
                else {},
                "sizes": dict(size),
                "expect": {},
            }
            for name, size in zip(self.names, self.sizes, strict=True)
            for answer in (FOREIGN[name].answer if name in FOREIGN else name,)
        ] or [{"id": "none", "level": "none", "answer": None, "accepts": [], "sizes": {}, "expect": {}}]


NOTHING = Hidden((), ())


def _beside(found: _Equations, more: _Equations, vehicle: Vehicle) -> _Equations:
    """`found` with what `more` has beyond the base: exact for those that may stand together."""
    base = base_of(vehicle.table)
    if found.rows == base.rows and found.nonlinear is None and found.varying is None:
        return more
    for state in {**base.rows, **more.rows}:
        own, plain = more.rows.get(state, {}), base.rows.get(state, {})
        change = {name: own.get(name, 0.0) - plain.get(name, 0.0) for name in {**own, **plain}}
        found.add(state, **{name: value for name, value in change.items() if value})
    found.varying = found.varying or more.varying
    found.nonlinear = found.nonlinear or more.nonlinear
    if more.measured != base.measured:
        found.measured = more.measured
    return found


def _serve_others(E: _Equations, name: str, size: Sizes) -> None:
    """Put servos of the cyclic's make between collective and yaw commands and what reads them."""
    for signal in ("c", "r_command"):
        readers = [row for row in E.rows.values() if signal in row]
        for row in readers:
            row[f"v_{signal}"] = row.pop(signal)
        if readers:
            add_servo(E, name, size, signal)


LATE = frozenset({"servo_lag", "servo_second_order", "transport_delay", "gyro_lag", "gyro_filter"})
"""Two of these in a row are one to any log."""
MOVING = frozenset({"rotor_speed", "governor", "stabiliser_bar"})
"""Their rows read the command as it is, or as nothing but a loop's piece has changed it;"""
LAGGING = frozenset({"servo_lag", "servo_second_order", "quadratic_damping"})
"""and these change it in rows, or are no rows at all."""


def may_stand_together(names: Sequence[str]) -> bool:
    """Two of different families, neither of them one that changes the other's rows, and not both a lateness."""
    entries, both = [CATALOGUE[name] for name in names], set(names)
    apart = len({one.family for one in entries}) == len(entries) and not any(one.alone for one in entries)
    return apart and len(LATE & both) < 2 and not (MOVING & both and LAGGING & both)
