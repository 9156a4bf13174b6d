"""A vehicle under a discrete controller, exactly as its loops come: whether they hold it, and by how much.

The controller answers once a loop and its commands are held until the next, so that vehicle, hold and delay together
are a discrete system without any approximation: over a loop the matrix exponential, and the commands of the loops that
a delay spans as states. Stable is what has its poles inside the unit circle. Margins are those of the loop broken at
both commands together, as in `sysid.control.stability`; what they leave out is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sysid.control.stability import Margins, margins_by_loci, rates_by_commands
from sysid.data.gyro_settings import BUTTERWORTH
from sysid.data.preprocess import ComplexArray
from sysid.data.record import FloatArray
from sysid.errors import SysidError
from sysid.model.response import behind_commands
from sysid.model.structure import DRIFT_RAD_S, AnyArray, Model
from sysid.rate_loop.linear import Discrete, controller
from sysid.rate_loop.settings import AxisLoop

LOWEST_HZ = 1e-3
POINTS = 600
ON_THE_CIRCLE = 1e-9
REJECTED = 10 ** (-3 / 20)
"""ADS-33's bandwidth of disturbance rejection: up to where less than this of a disturbance is left."""
PROBED_RAD_S = np.array([0.5, 5.0, 50.0])


class NotSampledError(SysidError):
    """The vehicle has something that no loop of this kind can hold exactly; the message says what."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SampledLoop:
    """A vehicle under rate loops: small motion."""

    margins: Margins | None
    """None where the loop is not held."""
    rejection_hz: tuple[float, float]
    """Of roll and pitch: up to where a disturbance of the rate is left by less than 3 dB; 0 where nowhere."""
    peak_db: float
    """By which a disturbance of either rate is raised at most; ADS-33's peak of disturbance rejection."""
    drifts: bool
    """Whether it drifts off, slower than the hover's drift."""

    @property
    def held(self) -> bool:
        return self.margins is not None


class SampledPlant(NamedTuple):
    """Of delta_x and delta_y, held over a loop, to p and q at its loops."""

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
            C = np.hstack([C, np.zeros((2, 2))])
        return Discrete(A, B, C, D, dt)

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """(f, 2, 2)."""
        f = np.asarray(frequency_hz)
        late = np.exp(-2j * np.pi * f * self.core.dt * self.loops_late)
        return np.asarray(self.core.response(f) * late[:, None, None])


def sampled_plant(vehicle: Model, dt: float, gyro_corner_hz: float = 0.0) -> SampledPlant:
    """A vehicle as loops of dt seconds see it, its delay included.

    `gyro_corner_hz`: of the Butterworth filter of second order between the vehicle's rates and the controller; 0 where
    the model has it already, as one of filtered rates has. Raises NotSampledError for what is more than a delay.
    """
    # heavier than NumPy itself to load: only where it is needed
    from scipy.linalg import expm

    (A, B, C, D), _, _ = rates_by_commands(vehicle)
    if gyro_corner_hz > 0:
        A, B, C, D = _filtered(A, B, C, D, gyro_corner_hz)
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
    return SampledPlant(Discrete(A_d, B_d, np.hstack([C, D]), np.zeros((2, 2)), dt), whole)


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


def sampled_loop(
    loops: tuple[AxisLoop, AxisLoop], dt: float, vehicle: Model, gyro_corner_hz: float = 0.0
) -> SampledLoop:
    """The vehicle under these loops of roll and pitch. Raises NotSampledError as `sampled_plant` does."""
    plant = sampled_plant(vehicle, dt, gyro_corner_hz)
    law = controller(loops, dt)
    feedback = Discrete(law.A, law.B[:, 2:], law.C, law.D[:, 2:], dt)
    unseen, attitude = rates_by_commands(vehicle)[1:]
    roots = np.concatenate([_rates_of(closed_poles(feedback, plant.system), dt), unseen])
    slow = np.abs(roots) < (DRIFT_RAD_S if attitude else 0.0)
    unstable = roots.real > -ON_THE_CIRCLE / dt
    margins = None
    w = 2 * np.pi * np.geomspace(LOWEST_HZ, 0.4999 / dt, POINTS)

    def transfer(at: FloatArray) -> ComplexArray:
        f = at / (2 * np.pi)
        return -feedback.response(f) @ plant.response(f)

    if not np.any(unstable & ~slow):
        margins = margins_by_loci(transfer, w, np.inf)
    f = w / (2 * np.pi)
    left = np.asarray(np.linalg.inv(np.eye(2) - plant.response(f) @ feedback.response(f)), dtype=np.complex128)
    return SampledLoop(
        margins=margins,
        rejection_hz=(_rejection(w, left[:, 0, 0]), _rejection(w, left[:, 1, 1])),
        peak_db=float(20 * np.log10(np.abs(left[:, [0, 1], [0, 1]]).max())),
        drifts=bool(np.any(unstable & slow)),
    )


def rate_step(
    loops: tuple[AxisLoop, AxisLoop], dt: float, vehicle: Model, gyro_corner_hz: float = 0.0, seconds: float = 2.0
) -> FloatArray:
    """Rates after a step of one rate's target, attitude let go: (asked, measured, n), per rad/s asked."""
    roll, pitch = (replace(loop, angle_p=0.0) for loop in loops)
    law, plant = controller((roll, pitch), dt), sampled_plant(vehicle, dt, gyro_corner_hz).system
    rates = np.zeros((2, 2, round(seconds / dt)))
    for asked in range(2):
        of_law, of_plant = np.zeros(len(law.A)), np.zeros(len(plant.A))
        for k in range(rates.shape[2]):
            rates[asked, :, k] = plant.C @ of_plant
            seen = np.concatenate([np.eye(2)[asked], rates[asked, :, k]])
            command = law.C @ of_law + law.D @ seen
            of_law, of_plant = law.A @ of_law + law.B @ seen, plant.A @ of_plant + plant.B @ command
    return rates


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


def _rejection(w: FloatArray, left: ComplexArray) -> float:
    """Hz, up to where less than `REJECTED` is left, from the lowest frequency on."""
    more = np.flatnonzero(np.abs(left) > REJECTED)
    return 0.0 if more.size and more[0] == 0 else float(w[more[0] if more.size else -1] / (2 * np.pi))
