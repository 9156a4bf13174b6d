"""A vehicle under a discrete controller, exactly as its loops come: whether they hold it, and by how much.

The controller answers once a loop and its commands are held until the next, so that vehicle, hold and delay together
are a discrete system without any approximation: over a loop the matrix exponential, and the commands of the loops that
a delay spans as states. Stable is what has its poles inside the unit circle. Margins are those of the loop broken at
both commands together, as in `sysid.control.stability`; what they leave out is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sysid.control.loop import AXES, AxisAnswer
from sysid.control.robustness import (
    HIGHEST_HZ,
    Rejection,
    Robustness,
    disk_margin,
    handling,
    rejection,
)
from sysid.control.robustness import LOWEST_HZ as REJECTED_FROM_HZ
from sysid.control.robustness import POINTS as HANDLING_POINTS
from sysid.control.stability import (
    ClosedLoop,
    Edges,
    Margins,
    branches,
    edges_by_loci,
    eigenvalues,
    in_the_loop,
    margins_by_loci,
    rates_by_commands,
    unit_passed,
)
from sysid.data.gyro_settings import BUTTERWORTH
from sysid.data.preprocess import ComplexArray
from sysid.data.record import FloatArray
from sysid.errors import SysidError
from sysid.model.response import behind_commands
from sysid.model.structure import DRIFT_RAD_S, AnyArray, Model, Structure
from sysid.rate_loop.linear import Discrete, controller
from sysid.rate_loop.settings import AxisLoop

LOWEST_HZ = 1e-3
POINTS = 600
ON_THE_CIRCLE = 1e-9
BELOW_NYQUIST = 0.4999
"""Of the loops' rate: how far a discrete loop has frequencies."""
STEP_S = 2.0
"""Of the target: for as long its answer is looked at."""
RISEN = 0.9
_STILL = 1e-6
"""1/s: slower open-loop roots are integrators."""
PROBED_RAD_S = np.array([0.5, 5.0, 50.0])


class NotSampledError(SysidError):
    """The vehicle has something that no loop of this kind can hold exactly; the message says what."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledLoop:
    """A vehicle under rate loops: small motion."""

    margins: Margins | None
    """None where the loop is not held."""
    rejections: tuple[Rejection, Rejection]
    """Of disturbances of p and q."""
    drifts: bool
    """Whether it drifts off, slower than the hover's drift."""

    @property
    def held(self) -> bool:
        return self.margins is not None

    @property
    def rejection_hz(self) -> tuple[float, float]:
        """Of roll and pitch; 0 where nothing is rejected."""
        roll, pitch = self.rejections
        return roll.hz or 0.0, pitch.hz or 0.0

    @property
    def peak_db(self) -> float:
        """By which a disturbance of either rate is raised at most."""
        return max(one.peak_db for one in self.rejections)


class SampledPlant(NamedTuple):
    """Of delta_x and delta_y, held over a loop, to p and q at its loops (twice where `sampled_plant` is asked so)."""

    core: Discrete
    """Without the whole loops by which it is late."""
    loops_late: int

    @property
    def system(self) -> Discrete:
        """With these, the commands on their way as states."""
        A, B, C, D, dt = self.core
        for _ in range(self.loops_late):
            n = len(A)
            A = np.block([[A, B], [np.zeros((2, n + 2))]])
            B = np.vstack([np.zeros((n, 2)), np.eye(2)])
            C = np.hstack([C, np.zeros((len(C), 2))])
        return Discrete(A, B, C, D, dt)

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """(f, outputs, 2)."""
        f = np.asarray(frequency_hz)
        late = np.exp(-2j * np.pi * f * self.core.dt * self.loops_late)
        return np.asarray(self.core.response(f) * late[:, None, None])


def sampled_plant(vehicle: Model, dt: float, gyro_corner_hz: float = 0.0, *, turns: bool = False) -> SampledPlant:
    """A vehicle as loops of dt seconds see it, its delay included. With `turns` its outputs are p and q twice: as the
    loops measure them, and as they turn it.

    `gyro_corner_hz`: of the Butterworth filter of second order between the vehicle's rates and the controller; 0 where
    the model has it already, as one of filtered rates has. Raises NotSampledError for what is more than a delay.
    """
    # heavier than NumPy itself to load: only where it is needed
    from scipy.linalg import expm

    (A, B, C, D), _, _ = rates_by_commands(vehicle)
    own, at_once = C, D
    if gyro_corner_hz > 0:
        A, B, C, D = _filtered(A, B, C, D, gyro_corner_hz)
    if turns:
        own = np.hstack([own, np.zeros((2, len(A) - own.shape[1]))])
        C, D = np.vstack([C, own]), np.vstack([D, at_once])
    late = _delay(vehicle)
    whole = int(late / dt + 1e-9)
    rest = max(0.0, late - whole * dt)
    n = len(A)
    block = np.zeros((n + 2, n + 2))
    block[:n, :n], block[:n, n:] = A, B
    (first, by_older), (then, by_newer) = (
        (power[:n, :n], power[:n, n:]) for power in (expm(block * rest), expm(block * (dt - rest)))
    )
    # states: x, and the command of the loop before, which acts until the newer one arrives
    A_d = np.block([[then @ first, then @ by_older], [np.zeros((2, n + 2))]])
    B_d = np.vstack([by_newer, np.eye(2)])
    # what a command does at once is seen by the next loop: this one has measured before it answers
    return SampledPlant(Discrete(A_d, B_d, np.hstack([C, D]), np.zeros((len(C), 2)), dt), whole)


def _filtered(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, corner_hz: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The same behind a Butterworth filter on each rate."""
    w, n = 2 * np.pi * corner_hz, len(A)
    one, none = np.eye(2), np.zeros((2, 2))
    inner = np.block([[none, one], [-(w**2) * one, -2 * BUTTERWORTH * w * one]])
    entry = np.vstack([none, w**2 * one])
    return (
        np.block([[A, np.zeros((n, 4))], [entry @ C, inner]]),
        np.vstack([B, entry @ D]),
        np.hstack([np.zeros((2, n)), one, none]),
        none,
    )


def _delay(vehicle: Model) -> float:
    """s, of both commands."""
    late = vehicle.input_delay_s[0]
    s = 1j * PROBED_RAD_S
    if not np.allclose(behind_commands(vehicle.structure, vehicle.values, s), np.exp(-s * late), atol=1e-6):
        raise NotSampledError(
            f"{vehicle.structure.title} has more than a delay before its commands act, which the loops of an autopilot "
            "are not computed with yet; fit it with transport_delay or a servo lag instead"
        )
    return late


class SampledVehicle(NamedTuple):
    """A vehicle as loops of one length see it, its rates as measured and as they turn it, computed once for any number
    of controllers."""

    plant: SampledPlant
    system: Discrete
    unseen: AnyArray
    """Poles that the rates do not show, 1/s."""
    drift: float
    """Slower roots do not count, rad/s; 0 where all do."""
    on_grid: ComplexArray
    """(f, 4, 2) at `grid_hz`."""


def sampled_vehicle(vehicle: Model, dt: float, gyro_corner_hz: float = 0.0) -> SampledVehicle:
    """Raises NotSampledError as `sampled_plant` does."""
    plant = sampled_plant(vehicle, dt, gyro_corner_hz, turns=True)
    unseen, attitude = rates_by_commands(vehicle)[1:]
    return SampledVehicle(plant, plant.system, unseen, DRIFT_RAD_S if attitude else 0.0, plant.response(grid_hz(dt)))


def grid_hz(dt: float) -> FloatArray:
    """(f,): where loops of dt seconds are looked at first."""
    return np.geomspace(LOWEST_HZ, BELOW_NYQUIST / dt, POINTS)


@dataclass(frozen=True, eq=False)
class RateController:
    """Rate loops of roll and pitch on board, in small motion."""

    loops: tuple[AxisLoop, AxisLoop]
    dt: float
    gyro_corner_hz: float = 0.0
    """Of the filter between a model's rates and these loops; 0 where the model has it."""
    seen: dict[tuple[Structure, bytes], SampledVehicle] = field(default_factory=dict, repr=False)
    """Vehicles as loops of this length see them, kept for other gains, too: most of what a loop costs."""

    @cached_property
    def law(self) -> Discrete:
        """Of targets of roll and pitch, rates as measured, and as they turn the attitude, to both commands."""
        return controller(self.loops, self.dt, turns=True)

    @cached_property
    def feedback(self) -> Discrete:
        """The part that answers rates, as measured and as they turn."""
        return self.law._replace(B=self.law.B[:, 2:], D=self.law.D[:, 2:])

    @cached_property
    def _on_grid(self) -> ComplexArray:
        return self.feedback.response(grid_hz(self.dt))

    def vehicle(self, model: Model) -> SampledVehicle:
        """Raises NotSampledError as `sampled_plant` does."""
        key = (model.structure, model.values.tobytes())
        if key not in self.seen:
            self.seen[key] = sampled_vehicle(model, self.dt, self.gyro_corner_hz)
        return self.seen[key]

    def on(self, vehicle: SampledVehicle) -> SampledLoop:
        """The loop with a vehicle of these loops' length."""
        f = grid_hz(self.dt)
        round_trip = self._on_grid @ vehicle.on_grid
        roots = np.concatenate([_rates_of(closed_poles(self.feedback, vehicle.system), self.dt), vehicle.unseen])
        slow = np.abs(roots) < vehicle.drift
        unstable = roots.real > -ON_THE_CIRCLE / self.dt
        margins = None

        def transfer(w: FloatArray) -> ComplexArray:
            return -round_trip if w.size == f.size else self.transfer(vehicle, w)

        if not np.any(unstable & ~slow):
            margins = margins_by_loci(transfer, 2 * np.pi * f, np.inf)
        seen = f >= REJECTED_FROM_HZ
        left = self._left(f[seen], vehicle.on_grid[seen], self._on_grid[seen])
        roll, pitch = (rejection(f[seen], left[:, k, k]) for k in range(2))
        return SampledLoop(margins=margins, rejections=(roll, pitch), drifts=bool(np.any(unstable & slow)))

    def _left(self, f: FloatArray, plant: ComplexArray, feedback: ComplexArray) -> ComplexArray:
        """Of a disturbance that turns the vehicle, (f, 2, 2): through the gyro's filter to the loops, and to the
        attitude."""
        inside = np.linalg.solve(np.eye(2) - feedback @ plant, self._of_turning(f, feedback))
        return np.asarray(np.eye(2) + plant[:, 2:] @ inside, dtype=np.complex128)

    def _of_turning(self, f: FloatArray, feedback: ComplexArray) -> ComplexArray:
        """Commands by the vehicle's own rates, (f, 2, 2)."""
        return np.asarray(feedback[:, :, :2] * self._gyro(f)[:, None, None] + feedback[:, :, 2:])

    def taken_of_disturbance(self, vehicle: SampledVehicle, f: FloatArray) -> ComplexArray:
        """Commands by a disturbance that turns the vehicle, the loop closed, (f, 2, 2) at Hz."""
        feedback = self.feedback.response(f)
        return np.asarray(
            np.linalg.solve(np.eye(2) - feedback @ vehicle.plant.response(f), self._of_turning(f, feedback))
        )

    def _gyro(self, f: FloatArray) -> ComplexArray:
        x = f / self.gyro_corner_hz if self.gyro_corner_hz > 0 else np.zeros(f.size)
        return np.asarray(1 / (1 - x**2 + 2j * BUTTERWORTH * x))

    def steps(self, vehicle: SampledVehicle) -> tuple[AxisAnswer, AxisAnswer]:
        """Answers of roll and pitch to a step of the rate's target, attitude let go."""
        rates = rate_step(self.loops, vehicle.system)
        roll, pitch = (_step_answer(axis, rates[k, k], rates[k, 1 - k], self.dt) for k, axis in enumerate(AXES))
        return roll, pitch

    def transfer(self, vehicle: SampledVehicle, w: FloatArray) -> ComplexArray:
        """(f, 2, 2) at rad/s: round the loop, broken at both commands; what is taken from them counts as positive."""
        f = w / (2 * np.pi)
        return np.asarray(-self.feedback.response(f) @ vehicle.plant.response(f))

    # ---------------------------------------------------------------------------- as `sysid.control.judgement` asks

    def held(self, model: Model) -> ClosedLoop:
        found = self.on(self.vehicle(model))
        return ClosedLoop(found.margins, *in_the_loop(model), found.drifts)

    def answers(self, model: Model) -> tuple[AxisAnswer, AxisAnswer]:
        """To a step of the rate's target, attitude let go."""
        return self.steps(self.vehicle(model))

    def robustness(self, model: Model) -> Robustness:
        vehicle = self.vehicle(model)
        loci = branches(eigenvalues(-self._on_grid @ vehicle.on_grid))
        units = np.flatnonzero(np.any(unit_passed(loci), axis=1))
        f = np.geomspace(REJECTED_FROM_HZ, min(HIGHEST_HZ, BELOW_NYQUIST / self.dt), HANDLING_POINTS)
        plant, law = vehicle.plant.response(f), self.law.response(f)
        asked = plant[:, 2:] @ np.linalg.solve(np.eye(2) - law[:, :, 2:] @ plant, law[:, :, :2])
        return Robustness(
            disk=disk_margin(lambda w: self.transfer(vehicle, w), 2 * np.pi * grid_hz(self.dt)),
            crossover_hz=float(grid_hz(self.dt)[units[-1]]) if units.size else None,
            handling=handling(f, np.asarray(asked), self._left(f, plant, law[:, :, 2:])),
        )

    def from_rates(self, frequency_hz: FloatArray) -> ComplexArray:
        """C(j w), u = -C y, of the rates of a model, gyro filter and hold included, (f, 2, 2)."""
        f = np.asarray(frequency_hz, dtype=float)
        held = np.sinc(f * self.dt) * np.exp(-1j * np.pi * f * self.dt)
        return -self._of_turning(f, self.feedback.response(f)) * held[:, None, None]

    def edges(self, model: Model) -> Edges:
        vehicle = self.vehicle(model)
        return edges_by_loci(lambda w: self.transfer(vehicle, w), 2 * np.pi * grid_hz(self.dt), np.inf)

    def unstable_poles(self, model: Model) -> int:
        """Of vehicle and loops apart, drift and integrators left out."""
        vehicle = self.vehicle(model)
        roots = np.concatenate(
            [
                *(_rates_of(np.linalg.eigvals(one.A).astype(complex), self.dt) for one in (vehicle.system, self.law)),
                vehicle.unseen,
            ]
        )
        return int(np.count_nonzero((roots.real > ON_THE_CIRCLE / self.dt) & (np.abs(roots) >= _STILL)))


def sampled_loop(
    loops: tuple[AxisLoop, AxisLoop], dt: float, vehicle: Model, gyro_corner_hz: float = 0.0
) -> SampledLoop:
    """The vehicle under these loops of roll and pitch. Raises NotSampledError as `sampled_plant` does."""
    law = RateController(loops, dt, gyro_corner_hz)
    return law.on(law.vehicle(vehicle))


def rate_step(loops: tuple[AxisLoop, AxisLoop], plant: Discrete, seconds: float = STEP_S) -> FloatArray:
    """Rates of a `SampledVehicle`'s system after a step of one rate's target, attitude let go: (asked, turned, n), per
    rad/s asked."""
    roll, pitch = (replace(loop, angle_p=0.0) for loop in loops)
    law = controller((roll, pitch), plant.dt, turns=True)
    n = len(law.A)
    target, rate = law.B[:, :2], law.B[:, 2:]
    A = np.block(
        [
            [law.A, rate @ plant.C],
            [plant.B @ law.C, plant.A + plant.B @ law.D[:, 2:] @ plant.C],
        ]
    )
    B = np.vstack([target, plant.B @ law.D[:, :2]])
    rates = np.zeros((2, 2, round(seconds / plant.dt)))
    x = np.zeros((len(A), 2))
    for k in range(rates.shape[2]):
        rates[:, :, k] = (plant.C[2:] @ x[n:]).T
        x = A @ x + B
    return rates


def _step_answer(axis: str, own: FloatArray, other: FloatArray, dt: float) -> AxisAnswer:
    there = np.flatnonzero(own >= RISEN)
    return AxisAnswer(
        axis=axis,
        rise_s=dt * float(there[0]) if there.size else None,
        overshoot=max(0.0, float(own.max()) - 1),
        coupling=float(np.abs(other).max()),
    )


def closed_poles(feedback: Discrete, plant: Discrete) -> AnyArray:
    """Of both in a loop, u = feedback(y), y = plant(u), in the plane of z. The feedback sees the rate of its own loop,
    which no command of that loop has changed yet."""
    whole = np.block(
        [
            [feedback.A, feedback.B @ plant.C],
            [plant.B @ feedback.C, plant.A + plant.B @ feedback.D @ plant.C],
        ]
    )
    return np.asarray(np.linalg.eigvals(whole))


def _rates_of(poles: AnyArray, dt: float) -> AnyArray:
    """1/s; poles at the origin are as fast as can be."""
    with np.errstate(divide="ignore"):
        return np.where(np.abs(poles) < 1e-12, -1 / dt, np.log(np.where(poles == 0, 1, poles).astype(complex)) / dt)
