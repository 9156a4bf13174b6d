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
import random
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from pathlib import Path

from sitl.autopilot.blocks import BlockStream
from sitl.autopilot.control_laws import AttitudeController, LqrController, LqrGains, attitude_hold
from sitl.autopilot.excitation import Excitation, ExcitationSettings
from sitl.autopilot.logger import DataFlashLog, FileSink, Sink, next_log_path
from sitl.autopilot.parameters import Answer, Parameters
from sitl.clock import Clock
from sitl.hidden import Hidden
from sitl.plants import Plant, make_plant
from sitl.plants.conditions import CALM, CONDITIONS, Condition
from sitl.plants.rotorcraft import HOVER_COLLECTIVE
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

_LEAD_SAMPLES = 500  # of nothing before a maneuver, and from its end to "Finished"
_LARGEST_SETTING = 1e6  # what is logged stays within float32 whatever the ground has written
_YAW_POLE = 0.97  # at 100 Hz: corner near 0.5 Hz
_BATTERY_FULL_V = 24.6
_BATTERY_EMPTY_V = 21.0
_ENDURANCE_S = 1800.0

# Beyond these no pilot saves it, and the plant's small-angle attitude means nothing any more.
_CRASH_LEAN = 1.4  # rad
_CRASH_RATE = 25.0  # rad/s

_DEG = 180 / math.pi

_AIR_DENSITY = 1.225
_AIR_TEMPERATURE_CDEG = 1500


class Mode(IntEnum):
    STABILIZE = 0
    ALT_HOLD = 2
    RTL = 6
    LAND = 9
    SYSTEMID = 25


_MANUAL_THROTTLE = (Mode.STABILIZE, Mode.SYSTEMID)


class Reason(IntEnum):
    """Who asked for a mode: MODE.Rsn of the log."""

    PILOT = 1
    GROUND = 2
    GCS_FAILSAFE = 5
    START = 26


class Phase(Enum):
    DISARMED = "disarmed"
    SPOOLING = "spooling up"
    CLIMBING = "climbing"
    HOVERING = "hovering"
    DESCENDING = "descending"
    LANDED = "landed"


_FLYING = (Phase.CLIMBING, Phase.HOVERING, Phase.DESCENDING)


class Severity(IntEnum):
    """MAV_SEVERITY, the ones used here."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


class _Event(IntEnum):
    """EV.Id of the log."""

    ARMED = 10
    DISARMED = 11
    LANDED = 18
    AIRBORNE = 28


# ArduPilot ends at 19; 20 is this vehicle's own.
_AXES = {10: "roll", 11: "pitch", 7: "rate_roll", 8: "rate_pitch", 20: "elevator"}
_RATE_AXES = (7, 8)
_KINDS = {0: "chirp", 1: "doublet", 2: "quiet"}
_LAWS = {0: "ardupilot", 1: "tischler"}


@dataclass
class _Sweep:
    """One stay in SYSTEMID."""

    excitation: Excitation | None
    """None once it is over, or where its settings were refused."""
    on_rate: bool
    """Added to the rate command, not to the mixer."""
    frequency_hz: float
    start_us: int
    writes: int
    """`Parameters.writes` when its settings were read."""
    sample: int = 0
    lead_out: int = 0
    """Samples since the maneuver's end."""
    running: bool = True


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
        self.log: DataFlashLog | None = None
        self.stream: BlockStream | None = None
        self.offers_stream = True
        """Whether a START is answered with a stream of the log."""
        self.first_sweep_s = math.inf
        """When the first sweep began; infinite before."""
        self.yaw_command = 0.0
        """delta_r, to the tip propellers."""
        self._gyro = Gyro(seed, mounts)
        self._random = random.Random(f"pilot {seed}")
        self._yaw_hand = random.Random(f"{seed} yaw")
        self._condition = condition
        self._attitude = AttitudeController()
        self._lqr: LqrController | None = None
        self._lqr_flies = False
        self._sweep: _Sweep | None = None
        self._runs = 0
        self._rotor_angle = 0.0
        self._collective = 0.0
        self._phase_since_us = self.time_us
        self._rotor_speed = 0.0
        self._airborne_s = 0.0
        self._ground_heard_us: int | None = None
        self._ground_lost = False
        self._until_housekeeping = 1
        self._next_att_us = self._next_rpm_us = self._next_arsp_us = self.time_us
        if not on_ground:
            self._enter(Phase.HOVERING)
            self.height_m = HOVER_HEIGHT_M
        self._keep_logging()
        self.say(Severity.INFO, f"tippath vehicle, plant {name}")

    # What it is doing

    @property
    def time_s(self) -> float:
        return self.time_us * 1e-6

    @property
    def armed(self) -> bool:
        return self.phase is not Phase.DISARMED

    @property
    def landed(self) -> bool:
        return self.phase not in _FLYING

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
        return self._sweep is not None and self._sweep.running

    # What it is told

    def say(self, severity: Severity, text: str) -> None:
        """To every ground station and into the log."""
        self.texts.append((severity, text))
        if self.log is not None:
            self.log.write("MSG", self.time_us, text.encode("ascii", "replace"))

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
            refusal = self._sweep_refusal()
            if refusal is not None:
                self.say(Severity.WARNING, refusal)
                return False
        self._sweep = None
        self.mode = mode
        if mode is Mode.SYSTEMID:
            self._begin_sweep()
        self._write_mode(reason)
        if mode is Mode.LAND and self.phase in _FLYING:
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
        self._keep_logging()
        self._write_event(_Event.ARMED)
        self.say(Severity.INFO, "Arming motors")
        return None

    def land(self) -> str | None:
        """The pilot lowers the collective, or takes LAND where the autopilot holds it. Returns why not, or None."""
        if self.phase not in _FLYING:
            return f"not flying, but {self.phase.value}"
        if self.mode in _MANUAL_THROTTLE:
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
        if self.log is not None:
            self._write_parameter(name)
        self._keep_logging()
        return answer

    def hear_ground(self, system_id: int) -> None:
        """A ground station's heartbeat. Only the one in SYSID_MYGCS holds the failsafe."""
        if system_id != self.parameters["SYSID_MYGCS"]:
            return
        self._ground_heard_us = self.time_us
        if self._ground_lost:
            self._ground_lost = False
            self.say(Severity.WARNING, "GCS Failsafe Cleared")

    # Logs

    def start_stream(self) -> BlockStream | None:
        """A new log that also goes out as blocks; a stream under way ends. None where there is none to be had."""
        if not self.offers_stream or not int(self.parameters["LOG_BACKEND_TYPE"]) & 2:
            return None
        self._close_log()
        self.stream = BlockStream(int(self.parameters["LOG_MAV_BUFSIZE"]) * 1024, self.time_s)
        self._open_log(self.stream)
        return self.stream

    def stop_stream(self) -> None:
        """The streamed log ends whole; logging goes on in a new file while armed."""
        if self.stream is None:
            return
        self.stream = None
        self._close_log()
        self._keep_logging()

    def drop_stream(self, reason: str | None) -> None:
        """The stream cannot go on; its log does, in the file. None says nothing to anybody."""
        if self.stream is None:
            return
        if self.log is not None:
            self.log.detach(self.stream)
        self.stream.abandon()
        self.stream = None
        if reason is not None:
            self.say(Severity.WARNING, f"Log stream stopped: {reason}")
        self._keep_logging()

    def close(self) -> None:
        """End the log whole."""
        self.stream = None
        self._close_log()

    def _keep_logging(self) -> None:
        """Have a log open exactly while one is due."""
        due = self.armed or self.parameters["LOG_DISARMED"] != 0 or self.stream is not None
        if due and self.log is None:
            self._open_log(None)
        elif not due and self.log is not None:
            self._close_log()

    def _open_log(self, stream: BlockStream | None) -> None:
        sinks: list[Sink] = [] if stream is None else [stream]
        trouble = None
        if self.directory is not None and int(self.parameters["LOG_BACKEND_TYPE"]) & 1:
            try:
                sinks.append(FileSink(next_log_path(self.directory)))
            except OSError as error:
                trouble = error.strerror or type(error).__name__
        if sinks:
            self.log = DataFlashLog(sinks, self.time_us)
            for name in self.parameters.table:
                self._write_parameter(name)
            self._write_mode(Reason.START)
        if trouble is not None:
            self.say(Severity.CRITICAL, f"Logging failed: {trouble}")

    def _close_log(self) -> None:
        if self.log is not None:
            self.log.close()
            self.log = None

    def _write_parameter(self, name: str) -> None:
        if self.log is not None:
            default = self.parameters.table[name].default
            self.log.write("PARM", self.time_us, name.encode(), self.parameters[name], default)

    def _write_mode(self, reason: Reason) -> None:
        if self.log is not None:
            self.log.write("MODE", self.time_us, self.mode, self.mode, reason)

    def _write_event(self, event: _Event) -> None:
        if self.log is not None:
            self.log.write("EV", self.time_us, event)

    # Sweeps

    def _sweep_refusal(self) -> str | None:
        axis = int(self.parameters["SID_AXIS"])
        if axis == 0:
            return "No axis selected, SID_AXIS = 0"
        if axis not in _AXES:
            return f"SID_AXIS = {axis}: this vehicle has 7, 8, 10, 11, 20"
        if self.landed:
            return "Aircraft must be flying"
        if self.mode is not Mode.STABILIZE:
            return "Axis requires manual throttle"
        return None

    def _sweep_settings(self, axis: int) -> tuple[ExcitationSettings, str | None]:
        """What the parameters ask for on an axis that there is, and why it cannot be flown, or None."""
        get = self.parameters.__getitem__
        kind, law = int(get("SIDX_KIND")), int(get("SIDX_LAW"))
        settings = ExcitationSettings(
            kind=_KINDS.get(kind, f"SIDX_KIND {kind}"),
            law=_LAWS.get(law, f"SIDX_LAW {law}"),
            axis=_AXES[axis],
            # ArduPilot counts the rate axes in deg/s.
            magnitude=get("SID_MAGNITUDE") / _DEG if axis in _RATE_AXES else get("SID_MAGNITUDE"),
            f_start_hz=get("SID_F_START_HZ"),
            f_stop_hz=get("SID_F_STOP_HZ"),
            fade_in_s=get("SID_T_FADE_IN"),
            duration_s=get("SID_T_REC"),
            fade_out_s=get("SID_T_FADE_OUT"),
            c1=get("SIDX_C1"),
            noise=get("SIDX_NOISE"),
            pulse_s=get("SIDX_PULSE_S"),
            dt=DT,
        )
        if max(abs(settings.magnitude), settings.noise) > _LARGEST_SETTING:
            return settings, "magnitude or noise is absurd"
        return settings, settings.problem()

    def _begin_sweep(self) -> None:
        axis = int(self.parameters["SID_AXIS"])
        settings, problem = self._sweep_settings(axis)
        self._runs += 1
        self.first_sweep_s = min(self.first_sweep_s, self.time_s)
        drawn = random.Random(f"{self.seed} {self._runs}").getrandbits(31)
        seed = int(self.parameters["SIDX_SEED"]) or drawn
        self.say(Severity.INFO, f"SystemID Starting: axis={axis}")
        self._sweep = _Sweep(
            excitation=None if problem is not None else Excitation(settings, seed),
            on_rate=axis in _RATE_AXES,
            frequency_hz=settings.f_start_hz if settings.kind == "chirp" else 0.0,
            start_us=self.time_us,
            writes=self.parameters.writes,
        )
        self._log_sweep(axis, settings)
        if problem is not None:
            self._refuse_sweep(self._sweep, problem)

    def _log_sweep(self, axis: int, settings: ExcitationSettings) -> None:
        if self.log is None:
            return
        get = self.parameters.__getitem__
        kind, law = int(get("SIDX_KIND")), int(get("SIDX_LAW"))
        constant_s = 2 / settings.f_start_hz if law == 0 and settings.f_start_hz > 0 else 0.0
        self.log.write(
            "SIDS",
            self.time_us,
            axis,
            *(get("SID_" + name) for name in ("MAGNITUDE", "F_START_HZ", "F_STOP_HZ", "T_FADE_IN")),
            min(constant_s, 1e9),
            *(get("SID_" + name) for name in ("T_REC", "T_FADE_OUT")),
        )
        self.log.write("SIDY", self.time_us, kind & 0xFF, law & 0xFF, settings.c1, settings.noise, settings.pulse_s)

    def _change_sweep(self, sweep: _Sweep) -> None:
        """A write into a running sweep acts at once: ArduPilot reads magnitude, axis and end in every loop."""
        sweep.writes = self.parameters.writes
        axis = int(self.parameters["SID_AXIS"])
        if axis not in _AXES:
            self._end_sweep(sweep, f"SystemID Stopped: axis = {axis}")
            return
        settings, problem = self._sweep_settings(axis)
        if problem is not None:
            self._refuse_sweep(sweep, problem)
            return
        sweep.on_rate = axis in _RATE_AXES
        if sweep.excitation is not None:
            sweep.excitation.change(settings)

    def _refuse_sweep(self, sweep: _Sweep, problem: str) -> None:
        self._end_sweep(sweep, "SystemID Parameter Error")
        self.say(Severity.INFO, f"SystemID: {problem}")

    def _end_sweep(self, sweep: _Sweep, text: str) -> None:
        sweep.excitation = None
        sweep.running = False
        self.say(Severity.INFO, text)

    def _excite(self, sweep: _Sweep) -> tuple[float, float, float, float]:
        """x, y, e and the target of this sample, and the bookkeeping of the stay in SYSTEMID."""
        n = sweep.sample
        sweep.sample += 1
        if sweep.running and sweep.writes != self.parameters.writes:
            self._change_sweep(sweep)
        if not sweep.running:
            return 0.0, 0.0, 0.0, 0.0
        phi, theta = self.attitude
        lean_deg = math.acos(math.cos(phi) * math.cos(theta)) * _DEG
        limit_deg = self.parameters["ANGLE_MAX"] * 0.01
        if self.landed:
            self._end_sweep(sweep, "SystemID Stopped: Landed")
        elif lean_deg > limit_deg:
            self._end_sweep(sweep, f"SystemID Stopped: lean={lean_deg:f} max={limit_deg:f}")
        elif sweep.excitation is None:
            sweep.lead_out += 1
            if sweep.lead_out >= _LEAD_SAMPLES:
                self._end_sweep(sweep, "SystemID Finished")
        elif n >= _LEAD_SAMPLES:
            sample = sweep.excitation.step()
            if not sample.done:
                sweep.frequency_hz = sample.frequency_hz
                return sample.x, sample.y, sample.e, sample.target
            sweep.excitation = None
        return 0.0, 0.0, 0.0, 0.0

    # Flight

    def step(self) -> None:
        """Advance by 2 ms."""
        self._until_housekeeping -= 1
        if self._until_housekeeping <= 0:
            self._until_housekeeping = _HOUSEKEEPING_STEPS
            self._keep_house()
        plant = self.plant
        flying = self.phase in _FLYING
        sweep = self._sweep
        ex = ey = ee = target = rate_x = rate_y = 0.0
        if sweep is not None:
            ex, ey, ee, target = self._excite(sweep)
            if sweep.on_rate:
                rate_x, rate_y, ex, ey, ee = ex, ey, 0.0, 0.0, 0.0
        self._rotor_angle = (self._rotor_angle + DT * self._rotor_speed) % (2 * math.pi)
        if flying:
            self._rotor_speed = plant.omega
            self.gyro = self._gyro.measure(plant.p, plant.q, plant.r, self._rotor_angle)
            x, y, p_ref, q_ref = self._control(rate_x, rate_y, ex, ey)
            e = -1.0 if ee < -1.0 else 1.0 if ee > 1.0 else ee
            c = self._collective
        else:
            self.gyro = self._gyro.measure(0.0, 0.0, 0.0, 0.0)
            x = y = e = p_ref = q_ref = 0.0
            c = -1.0
        self.commands = (x, y, e, c)
        if self.log is not None:
            self._log_sample(sweep, target, (ex, ey, ee), p_ref, q_ref)
        if flying:
            plant.step(x, y, e, c, self.yaw_command)
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
        sweep: _Sweep | None,
        target: float,
        excitation: tuple[float, float, float],
        p_ref: float,
        q_ref: float,
    ) -> None:
        log = self.log
        if log is None:
            return
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
        log.write("RATE", time_us, p_ref * _DEG, p, x, q_ref * _DEG, q, y, 0.0, r, self.yaw_command, 0.0, 0.0, c, 0.0)
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
        self._watch_ground()
        if self.phase in _FLYING:
            self._airborne_s += _HOUSEKEEPING_STEPS * DT
            self._move_hands()
        log = self.log
        if log is not None:
            log.flush()
            if log.trouble is not None:
                trouble, log.trouble = log.trouble, None
                self.say(Severity.CRITICAL, f"Logging failed: {trouble}")

    def _move_hands(self) -> None:
        """The pilot's collective and yaw, as first-order wanders."""
        condition = self._condition
        pole = condition.collective_pole
        wander = self._collective - HOVER_COLLECTIVE
        drive = condition.collective * math.sqrt(1 - pole**2)
        self._collective = HOVER_COLLECTIVE + pole * wander + self._random.gauss(0.0, drive)
        if condition.yaw > 0:
            drive = condition.yaw * math.sqrt(1 - _YAW_POLE**2)
            yaw = _YAW_POLE * self.yaw_command + self._yaw_hand.gauss(0.0, drive)
            self.yaw_command = max(-1.0, min(1.0, yaw))

    def _enter(self, phase: Phase) -> None:
        if phase is Phase.HOVERING and self.phase is Phase.DISARMED:
            self._collective = HOVER_COLLECTIVE
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
                self._collective = HOVER_COLLECTIVE
                self._enter(Phase.CLIMBING)
                self._write_event(_Event.AIRBORNE)
        elif phase is Phase.CLIMBING:
            self.height_m = min(HOVER_HEIGHT_M, self.height_m + HOVER_HEIGHT_M * 0.01 / (_CLIMB_US * 1e-6))
            if self.height_m >= HOVER_HEIGHT_M:
                self._enter(Phase.HOVERING)
        elif phase is Phase.DESCENDING:
            self.height_m = max(0.0, self.height_m - HOVER_HEIGHT_M * 0.01 / (_DESCENT_US * 1e-6))
            if self.height_m <= 0.0:
                self._enter(Phase.LANDED)
                self._write_event(_Event.LANDED)
        elif phase is Phase.LANDED:
            self._rotor_speed = nominal * max(0.0, 1 - since_us / _DISARM_US)
            if since_us >= _DISARM_US:
                self._disarm()

    def _disarm(self) -> None:
        self._rotor_speed = 0.0
        self._enter(Phase.DISARMED)
        self._write_event(_Event.DISARMED)
        self.say(Severity.INFO, "Disarming motors")
        self._keep_logging()

    def _crash(self) -> None:
        self.say(Severity.CRITICAL, "Crash: Disarming")
        self.height_m = 0.0
        self.plant.reset()
        self._sweep = None
        self._disarm()

    def _watch_ground(self) -> None:
        """ArduPilot's ground station failsafe: it needs a station to have been there, and a vehicle in the air."""
        if self._ground_heard_us is None or self._ground_lost or self.parameters["FS_GCS_ENABLE"] == 0:
            return
        if self.time_us - self._ground_heard_us <= self.parameters["FS_GCS_TIMEOUT"] * 1e6:
            return
        self._ground_lost = True
        if int(self.parameters["FS_OPTIONS"]) & 16:
            self.say(Severity.WARNING, "GCS Failsafe: Continuing Pilot Control")
            return
        self.say(Severity.WARNING, "GCS Failsafe")
        if self.phase in _FLYING and self.mode is not Mode.LAND:
            self.set_mode(Mode.RTL, Reason.GCS_FAILSAFE)


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
