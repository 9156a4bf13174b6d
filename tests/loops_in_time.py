"""Loops simulated in time, many at once, by nothing of the code that judges them: does what is small grow?

Vehicles are Table 4's with other numbers, and late in one way or several: a delay, servos of first or second order, a
filter on the gyros. Their equations are written out here again, the controller's too; commands between the steps are
straight lines, a step is at most half a millisecond and the delay a whole number of steps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from planted import DT, SIZES, TABLE_4, chirp
from scipy.linalg import expm, solve_continuous_are
from scipy.signal import lsim, place_poles

from sysid.data.record import Record
from sysid.model.compose import compose
from sysid.model.structure import Model

FloatArray = np.ndarray
STEP_S = 0.0005
LONGEST = 4 + 4 + 2 + 4
"""States: vehicle, servos, gyros, controller."""
SPAN = (0.45, 2.2)
"""Times Table 4's."""
COSTS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
OBSERVER = np.array([-50.0, -50.0, -51.0, -51.0])
LATE_BY = (
    ("transport_delay",),
    ("servo_lag",),
    ("servo_second_order",),
    ("gyro_lag",),
    ("transport_delay", "servo_lag"),
    ("transport_delay", "servo_second_order"),
    ("servo_lag", "gyro_lag"),
    ("transport_delay", "servo_lag", "gyro_lag"),
)
SECONDS_EACH = 1.0
"""After which what has grown is told and scaled back."""


@dataclass(frozen=True)
class Late:
    """A vehicle, and what makes it late; names and units are the catalogue's."""

    parameters: dict[str, float]
    """Table 4's nine."""
    lag: dict[str, float] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    input_cost: float = 5.0


def tip_path_plane(values: dict[str, float]) -> tuple[FloatArray, FloatArray]:
    """A and B, states p, q, a, b (NOTES: the paper's eq. 5-7 in Table 4's symbols)."""
    tau = values["tau_f"]
    A = [
        [0, 0, 0, values["L_b"]],
        [0, 0, values["M_a"], 0],
        [0, -1, -1 / tau, values["A_b"] / tau],
        [-1, 0, values["B_a"] / tau, -1 / tau],
    ]
    B = [[0, 0], [0, 0], [values["A_lat"], values["A_lon"]], [values["B_lat"], values["B_lon"]]]
    return np.array(A), np.array(B) / np.array([[1], [1], [tau], [tau]])


def random_vehicles(seed: int) -> Iterator[Late]:
    """Without end: of stable ones each way of being late in turn, 0 to 60 ms in all."""
    rng = np.random.default_rng(seed)
    number = 0
    while True:
        values = {name: float(value * rng.uniform(*SPAN)) for name, value in TABLE_4.items()}
        if np.max(np.linalg.eigvals(tip_path_plane(values)[0]).real) > -0.5:
            continue
        effects = LATE_BY[number % len(LATE_BY)]
        yield Late(values, _lag(effects, rng), effects, float(rng.choice(COSTS)))
        number += 1


def _lag(effects: Sequence[str], rng: np.random.Generator) -> dict[str, float]:
    parts = rng.dirichlet(np.ones(len(effects))) * rng.uniform(0.0, 0.060)
    lag: dict[str, float] = {}
    for name, part in zip(effects, map(float, parts), strict=True):
        match name:
            case "transport_delay":
                lag["T_d"] = max(part, STEP_S)
            case "servo_lag":
                lag["tau_s"] = max(part, 1e-3)
            case "gyro_lag":
                lag["tau_g"] = max(part, 1e-3)
            case "servo_second_order":  # late by 2 zeta/w at low frequency
                lag["zeta"] = float(rng.uniform(0.3, 1.2))
                lag["frequency"] = 2 * lag["zeta"] / (2 * np.pi * max(part, 2e-3))
    return lag


def model_of(vehicle: Late) -> Model:
    """The same as a composition, which a design is asked for."""
    structure = compose("tpp", vehicle.effects)
    return Model(structure, structure.vector({**vehicle.parameters, **vehicle.lag}))


def late_of(model: Model, input_cost: float) -> Late:
    """The other way round."""
    values = dict(zip(model.structure.names, map(float, model.values), strict=True))
    own = {name: values.pop(name) for name in TABLE_4}
    return Late(own, values, model.structure.effects, input_cost)


def gains_of(vehicle: Late) -> tuple[FloatArray, FloatArray]:
    """K and observer gain of the vehicle's tip-path plane, from the Riccati equation."""
    A, B = tip_path_plane(vehicle.parameters)
    P = solve_continuous_are(A, B, np.diag([1.0, 1.0, 1e-3, 1e-3]), vehicle.input_cost * np.eye(2))
    return B.T @ P / vehicle.input_cost, place_poles(A.T, np.eye(4, 2), OBSERVER).gain_matrix.T


def _system(vehicle: Late, K: FloatArray, L: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(A, B) of vehicle, servos, gyros and controller, from the commands that arrive; and u = -F z."""
    lag = vehicle.lag
    A, B = np.zeros((LONGEST, LONGEST)), np.zeros((LONGEST, 2))
    own, drive = tip_path_plane(vehicle.parameters)
    A[:4, :4] = own
    servo, gyro, controller = slice(4, 6), slice(8, 10), slice(10, 14)
    two = np.eye(2)
    if "tau_s" in lag:
        A[:4, servo], A[servo, servo], B[servo] = drive, -two / lag["tau_s"], two / lag["tau_s"]
    elif "frequency" in lag:
        w, rate = 2 * np.pi * lag["frequency"], slice(6, 8)
        A[:4, servo], A[servo, rate] = drive, two
        A[rate, servo], A[rate, rate], B[rate] = -(w**2) * two, -2 * lag["zeta"] * w * two, w**2 * two
    else:
        B[:4] = drive
    measured = np.zeros((2, LONGEST))
    measured[:, :2] = two
    if "tau_g" in lag:
        A[gyro, :2], A[gyro, gyro] = two / lag["tau_g"], -two / lag["tau_g"]
        measured = np.zeros((2, LONGEST))
        measured[:, gyro] = two
    A[controller] += L @ measured
    A[controller, controller] += own - L @ np.eye(2, 4) - drive @ K
    F = np.zeros((2, LONGEST))
    F[:, controller] = K
    return A, B, F


def flown(vehicle: Late, axis: str, duration_s: float = 20.0) -> Record:
    """A chirp on one axis without controller, with a little noise; the delay a whole number of its samples."""
    rng = np.random.default_rng(("roll", "pitch").index(axis))
    A, B, _ = _system(vehicle, np.zeros((2, 4)), np.zeros((4, 2)))
    size = SIZES[axis]
    u = 0.02 * size * rng.standard_normal((round(duration_s / DT), 2))
    sweep = chirp(size, duration_s)
    u = u[: sweep.size]
    u[:, ("roll", "pitch").index(axis)] += sweep
    late = round(vehicle.lag.get("T_d", 0.0) / DT)
    arriving = np.vstack([np.zeros((late, 2)), u[: len(u) - late]])
    t = DT * np.arange(len(u))
    C = np.zeros((2, 10))
    C[:, slice(8, 10) if "tau_g" in vehicle.lag else slice(0, 2)] = np.eye(2)
    y = lsim((A[:10, :10], B[:10], C, np.zeros((2, 2))), arriving, t, interp=False)[1]
    y += 0.02 * y.std(axis=0) * rng.standard_normal(y.shape)
    channels = {"t": t, "p": y[:, 0], "q": y[:, 1], "delta_x": u[:, 0], "delta_y": u[:, 1]}
    return Record(axis, channels, maneuver="chirp", axis=axis)


def growth(loops: Sequence[tuple[Late, FloatArray, FloatArray]], seconds: int = 16) -> FloatArray:
    """1/s, of what is left in the second half of a simulation from a random state, for vehicles with K and L."""
    systems = [_system(vehicle, K, L) for vehicle, K, L in loops]
    delays = [vehicle.lag.get("T_d", 0.0) for vehicle, _, _ in loops]
    late = np.array([max(1, int(np.ceil(T / STEP_S))) for T in delays])
    dt = np.array([T / n if T > 0 else STEP_S for T, n in zip(delays, late, strict=True)])
    held = [_held(*one, h, T) for one, h, T in zip(systems, dt, delays, strict=True)]
    step, now, then = (np.stack(x) for x in zip(*held, strict=True))
    F = np.stack([one[2] for one in systems])
    kept, index = int(late.max()) + 2, np.arange(len(loops))
    past = np.zeros((kept, len(loops), 2))
    there = np.stack([np.any(A != 0, axis=1) for A, _, _ in systems])  # a state that a vehicle lacks stays nothing
    z = (there * np.random.default_rng(0).standard_normal(there.shape))[:, :, None]
    logs, each = [], round(SECONDS_EACH / STEP_S)
    for second in range(seconds):
        largest = np.zeros(len(loops))
        for k in range(second * each, (second + 1) * each):
            past[k % kept] = -(F @ z)[:, :, 0]
            before, after = past[(k - late) % kept, index], past[(k + 1 - late) % kept, index]
            z = step @ z + now @ before[:, :, None] + then @ after[:, :, None]
            largest = np.maximum(largest, np.abs(past[k % kept]).max(axis=1))
        scale = np.maximum(largest, 1e-280)
        logs.append(np.log(scale) + (logs[-1] if logs else 0))
        z, past = z / scale[:, None, None], past / scale[:, None]
    half = np.array(logs)[seconds // 2 :]
    return np.polyfit(np.arange(len(half)), half, 1)[0] / (SECONDS_EACH * dt / STEP_S)


@dataclass(frozen=True)
class Law:
    """What a controller asks for beside its feedback: g r + F z, z of models of r (frequency in rad/s)."""

    g: FloatArray
    F: FloatArray = field(default_factory=lambda: np.zeros((2, 4)))
    frequency: FloatArray = field(default_factory=lambda: np.ones(2))
    damping: float = 1.0


def doublet(
    vehicle: Late, K: FloatArray, L: FloatArray, law: Law, axis: int, *, pulse_s: float = 0.5, seconds: float = 1.6
) -> FloatArray:
    """(n, 2): measured p and q every `STEP_S`, of a unit doublet of one rate command, in small motion."""
    A, B, F = _system(vehicle, K, L)
    _, drive = tip_path_plane(vehicle.parameters)
    B_asked = np.zeros_like(B)
    B_asked[10:14] = drive
    late = round(vehicle.lag.get("T_d", 0.0) / STEP_S)
    block = np.zeros((LONGEST + 4, LONGEST + 4))
    block[:LONGEST] = np.hstack([A, B, B_asked]) * STEP_S
    step = expm(block)[:LONGEST]
    w, zeta = law.frequency[axis], law.damping
    follow = expm(np.array([[0, 1, 0], [-w * w, -2 * zeta * w, w * w], [0, 0, 0]]) * STEP_S)
    measured = np.zeros((2, LONGEST))
    measured[:, slice(8, 10) if "tau_g" in vehicle.lag else slice(0, 2)] = np.eye(2)
    z, followed, waiting, out = np.zeros(LONGEST), np.zeros(2), [np.zeros(2)] * late, []
    for t in STEP_S * np.arange(round(seconds / STEP_S)):
        r = 1.0 if t < pulse_s - 1e-9 else -1.0 if t < 2 * pulse_s - 1e-9 else 0.0
        models = np.zeros(4)
        models[[axis, 2 + axis]] = followed[0] - r, followed[1]
        asked = law.g[:, axis] * r + law.F @ models
        waiting.append(asked - F @ z)
        out.append(measured @ z)
        z = step @ np.concatenate([z, waiting.pop(0), asked])
        followed = (follow @ np.array([*followed, r]))[:2]
    return np.array(out)


def _held(A: FloatArray, B: FloatArray, F: FloatArray, dt: float, delay: float) -> tuple[FloatArray, ...]:
    """One step, exact for commands that are straight lines; without delay they are the state's own."""
    if delay == 0:
        return expm((A - B @ F) * dt), np.zeros((LONGEST, 2)), np.zeros((LONGEST, 2))
    block = np.zeros((LONGEST + 4, LONGEST + 4))
    block[:LONGEST, :LONGEST], block[:LONGEST, LONGEST : LONGEST + 2] = A * dt, B * dt
    block[LONGEST : LONGEST + 2, LONGEST + 2 :] = np.eye(2)
    whole = expm(block)[:LONGEST]
    slope = whole[:, LONGEST + 2 :]
    return whole[:, :LONGEST], whole[:, LONGEST : LONGEST + 2] - slope, slope
