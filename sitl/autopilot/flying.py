"""What turns measured rates into commands: the attitude controller, or the LQR where the pilot's switch selects it."""

from __future__ import annotations

from collections.abc import Sequence

from sitl.autopilot.control_laws import AttitudeController, LqrController, LqrGains, attitude_hold
from sitl.autopilot.systemid import Added
from sitl.plants import Plant
from sitl.plants.actuators import clip


class Controllers:
    """Both, and which of them flies."""

    def __init__(self) -> None:
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
        x, y = clip(x + added.x), clip(y + added.y)
        if self._lqr_flies and lqr is not None:
            lqr.applied(x, y, clip(self.elevator + added.e))
        return x, y, p_ref, q_ref
