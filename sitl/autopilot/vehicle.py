"""The vehicle: modes, safety, sweeps and logging around one plant and its control laws.

It needs no socket and no clock: `step` advances it by 2 ms, so a minute of flight takes a few seconds in a test.
A sample is one instant t_k: the gyro is read, the command computed from it and held until t_(k+1); both are logged
with t_k.

What is scripted, not modelled: taking off and landing (a few seconds each, in forward flight, too; on the ground the
plant stands still), height, position, and the battery. In RTL it stays where it is and does not land. The collective
holds a constant and wanders a little, as a pilot's hand does; how much, and what else moves, is the condition's.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from sitl.autopilot.control_laws import AttitudeController, LqrController, LqrGains, attitude_hold
from sitl.autopilot.failsafe import GroundFailsafe
from sitl.autopilot.hands import PilotHands
from sitl.autopilot.logger import DataFlashLog
from sitl.autopilot.modes import FLYING, MANUAL_THROTTLE, LogEvent, Mode, Phase, Reason, Severity
from sitl.autopilot.parameters import Answer, Parameters
from sitl.autopilot.recording import Recording
from sitl.autopilot.storage import LogStorage
from sitl.autopilot.systemid import Sweep, SystemId
from sitl.clock import Clock
from sitl.hidden import Hidden
from sitl.plants import Plant, make_plant
from sitl.plants.conditions import CALM, CONDITIONS, Condition
from sitl.plants.sensors import Gyro, Mount

PERIOD_US = 2000
DT = PERIOD_US * 1e-6

_FIRST_SAMPLE_US = 1_000_000  # a real autopilot has been up for a while, too, before its first sample
_HOUSEKEEPING_STEPS = 5
_ATT_US = 100_000
_RPM_US = 25_000
_ARSP_US = 20_000

_SPOOL_US = 2_000_000
_CLIMB_US = 2_000_000
_DESCENT_US = 3_000_000
_DISARM_US = 1_000_000
HOVER_HEIGHT_M = 2.0

_BATTERY_FULL_V = 24.6
_BATTERY_EMPTY_V = 21.0
_ENDURANCE_S = 1800.0

# Beyond these no pilot saves it, and the plant's small-angle attitude means nothing any more.
_CRASH_LEAN = 1.4  # rad
_CRASH_RATE = 25.0  # rad/s

_DEG = 180 / math.pi

_AIR_DENSITY = 1.225
_AIR_TEMPERATURE_CDEG = 1500


class Vehicle:
    """One vehicle. Everything it does is decided by its seed, its parameters and the calls made on it."""

    def __init__(
        self,
        plant: Plant,
        *,
        seed: int,
        directory: Path | None = None,
        on_ground: bool = False,
        name: str = "hover",
        parameters: Mapping[str, float] | None = None,
        mounts: Sequence[Mount] = (),
        condition: Condition = CALM,
    ) -> None:
        """`directory` takes the logs; None keeps none. `parameters` sets them as the ground could. `mounts` lie between
        airframe and gyro; `condition` is what the pilot's hands do besides.

        Raises KeyError for an unknown parameter or a value that is not finite. A log that cannot be written is
        said in a text, as in flight.
        """
        self.plant = plant
        self.name = name
        self.seed = seed
        self.directory = directory
        self.storage = LogStorage(directory)
        self.parameters = Parameters(LqrGains.from_values, {"H_RSC_GOV_RPM": plant.nominal_rpm})
        for parameter, value in (parameters or {}).items():
            if self.parameters.write(parameter, value, armed=False) is None:
                raise KeyError(parameter)
        self.time_us = _FIRST_SAMPLE_US
        self.mode = Mode.STABILIZE
        self.phase = Phase.DISARMED
        self.texts: deque[tuple[Severity, str]] = deque(maxlen=500)
        """What was said and not yet taken by a server, oldest first."""
        self.lqr_selected = False
        self.gyro = (0.0, 0.0, 0.0)
        """Measured rates, rad/s."""
        self.yaw = 0.0
        self.height_m = 0.0
        self.commands = (0.0, 0.0, 0.0, 0.0)
        """Sent to the servos in this sample: delta_x, delta_y, delta_e, delta_c."""
        self.hands = PilotHands(condition, seed)
        self.recording = self._recording()
        self.systemid = self._systemid()
        self.ground = GroundFailsafe(self.parameters, time_us=lambda: self.time_us, say=self.say)
        self._gyro = Gyro(seed, mounts)
        self._attitude = AttitudeController()
        self._lqr: LqrController | None = None
        self._lqr_flies = False
        self._rotor_angle = 0.0
        self._phase_since_us = self.time_us
        self._rotor_speed = 0.0
        self._airborne_s = 0.0
        self._until_housekeeping = 1
        self._next_att_us = self._next_rpm_us = self._next_arsp_us = self.time_us
        if not on_ground:
            self._enter(Phase.HOVERING)
            self.height_m = HOVER_HEIGHT_M
        self.recording.keep_on()
        self.say(Severity.INFO, f"tippath vehicle, plant {name}")

    def _recording(self) -> Recording:
        return Recording(
            self.directory,
            self.parameters,
            time_us=lambda: self.time_us,
            armed=lambda: self.armed,
            mode=lambda: self.mode,
            say=self.say,
        )

    def _systemid(self) -> SystemId:
        return SystemId(
            self.parameters,
            seed=self.seed,
            dt=DT,
            time_us=lambda: self.time_us,
            say=self.say,
            write=self.recording.write,
        )

    # What it is doing

    @property
    def time_s(self) -> float:
        return self.time_us * 1e-6

    @property
    def armed(self) -> bool:
        return self.phase is not Phase.DISARMED

    @property
    def landed(self) -> bool:
        return self.phase not in FLYING

    @property
    def attitude(self) -> tuple[float, float]:
        """phi, theta in rad; level on the ground."""
        return (0.0, 0.0) if self.landed else (self.plant.phi, self.plant.theta)

    @property
    def airspeed(self) -> float:
        """m/s; none on the ground."""
        return 0.0 if self.landed else self.plant.airspeed

    @property
    def rotor_rpm(self) -> float:
        return self._rotor_speed * 60 / (2 * math.pi)

    @property
    def battery_v(self) -> float:
        left = max(0.0, 1 - self._airborne_s / _ENDURANCE_S)
        return _BATTERY_EMPTY_V + (_BATTERY_FULL_V - _BATTERY_EMPTY_V) * left

    @property
    def battery_percent(self) -> int:
        return round(100 * max(0.0, 1 - self._airborne_s / _ENDURANCE_S))

    @property
    def sweeping(self) -> bool:
        """A maneuver is under way, its second of nothing before and after included."""
        sweep = self.systemid.sweep
        return sweep is not None and sweep.running

    # What it is told

    def say(self, severity: Severity, text: str) -> None:
        """To every ground station and into the log."""
        self.texts.append((severity, text))
        self.recording.write("MSG", text.encode("ascii", "replace"))

    def set_mode(self, number: int, reason: Reason) -> bool:
        """True where the vehicle is in that mode now. A refusal says why in a text."""
        try:
            mode = Mode(number)
        except ValueError:
            self.say(Severity.WARNING, f"No such mode: {number}")
            return False
        if mode is self.mode:
            return True
        if mode is Mode.SYSTEMID:
            refusal = self.systemid.refusal(self.mode, self.landed)
            if refusal is not None:
                self.say(Severity.WARNING, refusal)
                return False
        self.systemid.sweep = None
        self.mode = mode
        if mode is Mode.SYSTEMID:
            self.systemid.begin()
        self.recording.write_mode(reason)
        if mode is Mode.LAND and self.phase in FLYING:
            self._enter(Phase.DESCENDING)
        elif self.phase is Phase.DESCENDING:
            self._enter(Phase.CLIMBING)
        return True

    def take_off(self) -> str | None:
        """The pilot arms and lifts off into a hover. Returns why not, or None."""
        if self.phase is not Phase.DISARMED:
            return f"not on the ground and disarmed, but {self.phase.value}"
        if self.mode is not Mode.STABILIZE:
            self.set_mode(Mode.STABILIZE, Reason.PILOT)
        self.plant.reset()
        self._attitude.reset()
        self._enter(Phase.SPOOLING)
        self.recording.keep_on()
        self.recording.write_event(LogEvent.ARMED)
        self.say(Severity.INFO, "Arming motors")
        return None

    def land(self) -> str | None:
        """The pilot lowers the collective, or takes LAND where the autopilot holds it. Returns why not, or None."""
        if self.phase not in FLYING:
            return f"not flying, but {self.phase.value}"
        if self.mode in MANUAL_THROTTLE:
            self._enter(Phase.DESCENDING)
        else:
            self.set_mode(Mode.LAND, Reason.PILOT)
        return None

    def select_lqr(self, on: bool) -> str | None:
        """The pilot's switch between the attitude controller and the LQR. Returns why not, or None."""
        if on and self._lqr is None:
            return "no gains have been committed"
        if on != self.lqr_selected:
            self.lqr_selected = on
            self.parameters.show_switch(on)
            self.say(Severity.INFO, f"LQR {'on' if on else 'off'}")
        return None

    def write_parameter(self, name: str, value: float) -> Answer | None:
        """A write from the ground; None where there is no answer."""
        answer = self.parameters.write(name, value, armed=self.armed)
        if answer is None:
            return None
        if answer.text is not None:
            self.say(Severity.WARNING, answer.text)
        if answer.bank_changed:
            bank = self.parameters.active_bank()
            self._lqr = None if bank is None else LqrController(LqrGains.from_values(bank))
            self._lqr_flies = False
        self.recording.write_parameter(name)
        self.recording.keep_on()
        return answer

    def close(self) -> None:
        """End the log whole."""
        self.recording.close()

    # Flight

    def step(self) -> None:
        """Advance by 2 ms."""
        self._until_housekeeping -= 1
        if self._until_housekeeping <= 0:
            self._until_housekeeping = _HOUSEKEEPING_STEPS
            self._keep_house()
        plant = self.plant
        flying = self.phase in FLYING
        sweep = self.systemid.sweep
        ex = ey = ee = target = rate_x = rate_y = 0.0
        if sweep is not None:
            ex, ey, ee, target = self.systemid.excite(sweep, self.landed, *self.attitude)
            if sweep.on_rate:
                rate_x, rate_y, ex, ey, ee = ex, ey, 0.0, 0.0, 0.0
        self._rotor_angle = (self._rotor_angle + DT * self._rotor_speed) % (2 * math.pi)
        if flying:
            self._rotor_speed = plant.omega
            self.gyro = self._gyro.measure(plant.p, plant.q, plant.r, self._rotor_angle)
            x, y, p_ref, q_ref = self._control(rate_x, rate_y, ex, ey)
            e = -1.0 if ee < -1.0 else 1.0 if ee > 1.0 else ee
            c = self.hands.collective
        else:
            self.gyro = self._gyro.measure(0.0, 0.0, 0.0, 0.0)
            x = y = e = p_ref = q_ref = 0.0
            c = -1.0
        self.commands = (x, y, e, c)
        if self.recording.log is not None:
            self._log_sample(self.recording.log, sweep, target, (ex, ey, ee), p_ref, q_ref)
        if flying:
            plant.step(x, y, e, c, self.hands.yaw)
            self.yaw += DT * plant.r
            if not (abs(plant.phi) < _CRASH_LEAN and abs(plant.theta) < _CRASH_LEAN) or not (
                abs(plant.p) < _CRASH_RATE and abs(plant.q) < _CRASH_RATE
            ):
                self._crash()
        self.time_us += PERIOD_US

    def _control(self, rate_x: float, rate_y: float, ex: float, ey: float) -> tuple[float, float, float, float]:
        """Commands really sent, excitation and limits included, and the rates asked for."""
        plant, lqr = self.plant, self._lqr
        p, q, _ = self.gyro
        if self.lqr_selected and lqr is not None:
            if not self._lqr_flies:
                lqr.reset()
                self._lqr_flies = True
            p_ref, q_ref = attitude_hold(plant.phi, plant.theta)
            p_ref += rate_x
            q_ref += rate_y
            x, y = lqr.step(p, q, p_ref, q_ref)
        else:
            self._lqr_flies = False
            p_ref, q_ref = rate_x, rate_y
            x, y = self._attitude.step(plant.phi, plant.theta, p, q, p_ref, q_ref)
        x += ex
        y += ey
        x = -1.0 if x < -1.0 else 1.0 if x > 1.0 else x
        y = -1.0 if y < -1.0 else 1.0 if y > 1.0 else y
        if self._lqr_flies and lqr is not None:
            lqr.applied(x, y)
        return x, y, p_ref, q_ref

    def _log_sample(
        self,
        log: DataFlashLog,
        sweep: Sweep | None,
        target: float,
        excitation: tuple[float, float, float],
        p_ref: float,
        q_ref: float,
    ) -> None:
        time_us = self.time_us
        p, q, r = self.gyro
        p, q, r = p * _DEG, q * _DEG, r * _DEG
        x, y, e, c = self.commands
        if sweep is not None:
            plant = self.plant
            log.write(
                "SIDD",
                time_us,
                (time_us - sweep.start_us) * 1e-6,
                target * _DEG if sweep.on_rate else target,
                sweep.frequency_hz,
                p,
                q,
                r,
                plant.ax,
                plant.ay,
                plant.az,
            )
        log.write("RATE", time_us, p_ref * _DEG, p, x, q_ref * _DEG, q, y, 0.0, r, self.hands.yaw, 0.0, 0.0, c, 0.0)
        log.write("TPEX", time_us, *excitation, e, c)
        if time_us >= self._next_rpm_us:
            self._next_rpm_us = time_us - time_us % _RPM_US + _RPM_US
            log.write("RPM", time_us, 0, self.rotor_rpm, 1.0, 1)
        if self.plant.has_pitot and time_us >= self._next_arsp_us:
            self._next_arsp_us = time_us - time_us % _ARSP_US + _ARSP_US
            pressure = 0.5 * _AIR_DENSITY * self.airspeed**2
            air = (self.airspeed, pressure, _AIR_TEMPERATURE_CDEG, pressure)
            log.write("ARSP", time_us, 0, *air, 0.0, 1, 1, 1.0, 0.0, 0)
        if time_us >= self._next_att_us:
            self._next_att_us = time_us - time_us % _ATT_US + _ATT_US
            phi, theta = self.attitude
            yaw = self.yaw * _DEG % 360
            log.write("ATT", time_us, 0.0, phi * _DEG, 0.0, theta * _DEG, yaw, yaw, 3)

    # Once in 10 ms

    def _keep_house(self) -> None:
        self._follow_script()
        if self.ground.fires() and self.phase in FLYING and self.mode is not Mode.LAND:
            self.set_mode(Mode.RTL, Reason.GCS_FAILSAFE)
        if self.phase in FLYING:
            self._airborne_s += _HOUSEKEEPING_STEPS * DT
            self.hands.move()
        self.recording.flush()

    def _enter(self, phase: Phase) -> None:
        if phase is Phase.HOVERING and self.phase is Phase.DISARMED:
            self.hands.hover()
            self._rotor_speed = self.plant.omega
        self.phase = phase
        self._phase_since_us = self.time_us

    def _follow_script(self) -> None:
        """The phases that end by themselves."""
        since_us = self.time_us - self._phase_since_us
        phase = self.phase
        nominal = self.plant.nominal_rpm * 2 * math.pi / 60
        if phase is Phase.SPOOLING:
            self._rotor_speed = nominal * min(1.0, since_us / _SPOOL_US)
            if since_us >= _SPOOL_US:
                self.hands.hover()
                self._enter(Phase.CLIMBING)
                self.recording.write_event(LogEvent.AIRBORNE)
        elif phase is Phase.CLIMBING:
            self.height_m = min(HOVER_HEIGHT_M, self.height_m + HOVER_HEIGHT_M * 0.01 / (_CLIMB_US * 1e-6))
            if self.height_m >= HOVER_HEIGHT_M:
                self._enter(Phase.HOVERING)
        elif phase is Phase.DESCENDING:
            self.height_m = max(0.0, self.height_m - HOVER_HEIGHT_M * 0.01 / (_DESCENT_US * 1e-6))
            if self.height_m <= 0.0:
                self._enter(Phase.LANDED)
                self.recording.write_event(LogEvent.LANDED)
        elif phase is Phase.LANDED:
            self._rotor_speed = nominal * max(0.0, 1 - since_us / _DISARM_US)
            if since_us >= _DISARM_US:
                self._disarm()

    def _disarm(self) -> None:
        self._rotor_speed = 0.0
        self._enter(Phase.DISARMED)
        self.recording.write_event(LogEvent.DISARMED)
        self.say(Severity.INFO, "Disarming motors")
        self.recording.keep_on()

    def _crash(self) -> None:
        self.say(Severity.CRITICAL, "Crash: Disarming")
        self.height_m = 0.0
        self.plant.reset()
        self.systemid.sweep = None
        self._disarm()


def make_vehicle(
    plant: str,
    seed: int,
    *,
    directory: Path | None = None,
    on_ground: bool = False,
    parameters: Mapping[str, float] | None = None,
    hidden: Hidden | None = None,
    condition: str | None = None,
    gust_scale: float = 1.0,
) -> Vehicle:
    """A vehicle with the plant of that name, carrying what is hidden. Raises as `make_plant` and `Vehicle` do.

    `condition` is a name of `sitl.plants.conditions`; None takes the hidden effect's own, or the calm one. ValueError
    where that name does not exist, or where the effect was drawn for another plant.
    """
    if hidden is not None and hidden.plant != plant:
        raise ValueError(f"what is hidden was drawn for {hidden.plant}, not for {plant}")
    if condition is None:
        condition = "calm" if hidden is None else hidden.condition
    if condition not in CONDITIONS:
        raise ValueError(f"unknown condition {condition!r}; there are {', '.join(CONDITIONS)}")
    parts = None if hidden is None else hidden.build()
    flown = CONDITIONS[condition]
    return Vehicle(
        make_plant(plant, seed, parts=parts, condition=flown, gust_scale=gust_scale),
        seed=seed,
        directory=directory,
        on_ground=on_ground,
        name=plant,
        parameters=parameters,
        mounts=() if parts is None else parts.gyro,
        condition=flown,
    )


LATE_STEPS = 25
"""So many overdue steps before the link gets its turn."""
STANDSTILL_S = 2.0
"""Overdue by more (a suspended machine), the vehicle's time stands still instead: no sample is ever skipped."""


def run(vehicle: Vehicle, clock: Clock, between: Callable[[], None], ended: Callable[[], bool]) -> None:
    """Step the vehicle as the clock goes until `ended`; `between` steps it calls for the link and the pilot."""
    offset_s = vehicle.time_s - clock.now()
    while not ended():
        late_s = clock.now() + offset_s - vehicle.time_s
        if late_s > STANDSTILL_S:
            offset_s -= late_s
            late_s = 0.0
        for _ in range(min(LATE_STEPS, int(late_s / DT + 1e-6))):
            vehicle.step()
        between()
        clock.wait_until(vehicle.time_s + DT - offset_s)
