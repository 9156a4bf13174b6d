"""What turns measured rates into commands: the attitude controller, or the LQR where the pilot's switch selects it."""

from __future__ import annotations

from collections.abc import Sequence

from sitl.autopilot.control_laws import AttitudeController, Beside, LqrController, LqrGains, attitude_hold
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.systemid import Added
from sitl.plants import Plant
from sitl.plants.actuators import clip


class Controllers:
    """Both, and which of them flies."""

    def __init__(self, parameters: Parameters) -> None:
        """`LQR_LOG` tells whether the LQR runs while it does not fly, without authority."""
        self._parameters = parameters
        self.beside: Beside | None = None
        """Of this sample; None where the LQR flies, or does not run."""
        self._attitude = AttitudeController()
        self._lqr: LqrController | None = None
        self._lqr_flies = False
        self.elevator = 0.0
        """What the law that flies asks of it, unclipped."""

    @property
    def has_lqr(self) -> bool:
        return self._lqr is not None

    def take_bank(self, bank: Sequence[float] | None) -> None:
        """The LQR's gains are these now, or none."""
        self.beside = None
        self._lqr = None if bank is None else LqrController(LqrGains.from_values(bank))
        self._lqr_flies = False

    def step(
        self, plant: Plant, gyro: tuple[float, float, float], added: Added, lqr_selected: bool
    ) -> tuple[float, float, float, float]:
        """Commands really sent, excitation and limits included, and the rates asked for."""
        lqr = self._lqr
        self.elevator = 0.0
        p, q, _ = gyro
        p_ref, q_ref, _ = added.rate
        if lqr_selected and lqr is not None:
            if not self._lqr_flies:
                lqr.reset()
                self._lqr_flies = True
            p_hold, q_hold = attitude_hold(plant.phi, plant.theta)
            p_ref, q_ref = p_hold + p_ref, q_hold + q_ref
            x, y, self.elevator = lqr.step(p, q, p_ref, q_ref)
        else:
            self._lqr_flies = False
            roll, pitch, _ = added.angle
            x, y = self._attitude.step(plant.phi - roll, plant.theta - pitch, p, q, p_ref, q_ref)
        self.beside = self._run_beside(plant, (p, q), added, (clip(x + added.x), clip(y + added.y)))
        x, y = clip(x + added.x), clip(y + added.y)
        if self._lqr_flies and lqr is not None:
            lqr.applied(x, y, clip(self.elevator + added.e))
        return x, y, p_ref, q_ref

    def _run_beside(
        self, plant: Plant, measured: tuple[float, float], added: Added, sent: tuple[float, float]
    ) -> Beside | None:
        """What the LQR would have done, had it flown; its observer gets the commands that are really sent. It holds no
        integrator, so nothing winds up."""
        lqr = self._lqr
        if lqr is None or self._lqr_flies or self._parameters["LQR_LOG"] == 0:
            return None
        if self.beside is None:
            lqr.reset()
        hold = attitude_hold(plant.phi, plant.theta)
        asked = hold[0] + added.rate[0], hold[1] + added.rate[1]
        innovation = measured[0] - lqr.state[0], measured[1] - lqr.state[1]
        x, y = lqr.step(*measured, *asked)[:2]
        lqr.applied(*sent, clip(added.e))
        return Beside(asked, (x, y), innovation)
