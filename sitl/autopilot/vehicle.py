"""The vehicle: modes, safety, sweeps and logging around one plant and its control laws.

It needs no socket and no clock: `step` advances it by one loop, so a minute of flight takes a few seconds in a test.
A sample is one instant t_k: the gyro is read, the command computed from it and held until t_(k+1); both are logged
with t_k.

What is scripted, not modelled: taking off and landing (seconds each; on the ground the plant stands still), height,
position, battery. In RTL it stays where it is. The collective wanders a little, as the condition has it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sitl.autopilot import arming
from sitl.autopilot.clothes import CLOTHES, OWN_CLOTHES, Clothes, with_gain_switch
from sitl.autopilot.control_laws import LqrGains
from sitl.autopilot.failsafe import GroundFailsafe
from sitl.autopilot.flying import Controllers
from sitl.autopilot.gain_switch import LOW, GainSwitch
from sitl.autopilot.hands import PilotHands
from sitl.autopilot.modes import FLYING, MANUAL_THROTTLE, LogEvent, Mode, Phase, Reason, Severity
from sitl.autopilot.parameters import Answer, Parameters, period_us
from sitl.autopilot.recording import Recording
from sitl.autopilot.samples import Rates, Sample, SweepSample
from sitl.autopilot.stock_laws import StockControllers
from sitl.autopilot.storage import LogStorage
from sitl.autopilot.systemid import NOTHING, Added, SystemId
from sitl.hidden import Hidden
from sitl.plants import Plant, make_plant
from sitl.plants.actuators import clip
from sitl.plants.conditions import CALM, Condition, named_condition
from sitl.plants.sensors import Gyro, Mount, RateFilter
from sitl.plants.stock import make_stock_plant

_FIRST_SAMPLE_US = 1_000_000  # a real autopilot has been up for a while, too, before its first sample
_HOUSEKEEPING_S = 0.01
DT = 0.002

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
        clothes: Clothes = OWN_CLOTHES,
        rebuild: Callable[[float], Plant] | None = None,
    ) -> None:
        """`directory` takes the logs; None keeps none. `parameters` sets them as the ground could. `mounts` lie between
        airframe and gyro; `condition` is what the pilot's hands do besides. `rebuild` makes a plant for a loop of so
        many seconds; without it the plant has a step of its own.

        Raises KeyError for an unknown parameter or a value that is not finite. A log that cannot be written is
        said in a text, as in flight.
        """
        self.plant = plant
        self.name = name
        self.seed = seed
        self.directory = directory
        self.storage = LogStorage(directory)
        self.clothes = clothes
        of_plant = {"H_RSC_GOV_RPM": plant.nominal_rpm}
        defaults = {name: value for name, value in of_plant.items() if any(p.name == name for p in clothes.table)}
        self.parameters = Parameters(
            LqrGains.from_values, defaults, table=clothes.table, after_reboot=clothes.after_reboot
        )
        for parameter, value in (parameters or {}).items():
            if self.parameters.write(parameter, value, armed=False) is None:
                raise KeyError(parameter)
        self._rebuild = rebuild
        self._condition = condition
        self._mounts = mounts
        self._before_boot_us = 0
        self.texts: deque[tuple[Severity, str]] = deque(maxlen=500)
        """What was said and not yet taken by a server, oldest first."""
        self.lqr_selected = False
        self.gyro = (0.0, 0.0, 0.0)
        """Measured rates, rad/s."""
        self.yaw = self.height_m = 0.0
        self.switch = LOW  # the pilot's, of the gains
        self.commands = (0.0, 0.0, 0.0, 0.0)
        """Sent to the servos in this sample: delta_x, delta_y, delta_e, delta_c."""
        self._boot(on_ground)

    def _boot(self, on_ground: bool) -> None:
        """All that a power-up sets; parameters stay."""
        seed, clothes, parameters = self.seed, self.clothes, self.parameters
        parameters.boot()
        self.time_us = _FIRST_SAMPLE_US
        self.period_us = period_us(self.parameters.acting("SCHED_LOOP_RATE"))
        self.dt = self.period_us * 1e-6
        """Of one step, s."""
        if self._rebuild is not None:
            self.plant = self._rebuild(self.dt)
        self.mode = Mode.STABILIZE
        self.phase = Phase.DISARMED
        self.hands = PilotHands(self._condition, seed)
        self.recording = self._recording()
        self.systemid = self._systemid()
        self.ground = GroundFailsafe(self.parameters, time_us=lambda: self.time_us, say=self.say)
        self.rate_sensor = Gyro(seed, self._mounts, clothes.vibration)
        self._gyro_filter = RateFilter(self.parameters.__getitem__, self.dt)
        self._sampler = clothes.sampler(self.time_us, self.parameters.__getitem__, 1 / self.dt)
        self._controllers = StockControllers(parameters, self.dt) if clothes.stock_loops else Controllers(parameters)
        self._controllers.take_bank(self.parameters.active_bank())
        self._rotor_angle = 0.0
        self._phase_since_us = self.time_us
        self._rotor_speed = 0.0
        self._airborne_s = 0.0
        self._housekeeping_steps = max(1, round(_HOUSEKEEPING_S / self.dt))
        self._until_housekeeping = 1
        if not on_ground:
            self._enter(Phase.HOVERING)
            self.height_m = HOVER_HEIGHT_M
        self.texts.extend((Severity.INFO, text) for text in clothes.greeting)  # in every log already
        self.recording.keep_on()
        if not clothes.greeting:
            self.say(Severity.INFO, f"tippath vehicle, plant {self.name}")
        self.gain_switch = GainSwitch(self) if clothes.gain_switch else None

    def _recording(self) -> Recording:
        return self.clothes.recording(
            self.directory,
            self.parameters,
            time_us=lambda: self.time_us,
            armed=lambda: self.armed,
            mode=lambda: self.mode,
            say=self.say,
            dialect=self.clothes.dialect,
            greeting=self.clothes.greeting,
        )

    def _systemid(self) -> SystemId:
        return SystemId(
            self.parameters,
            seed=self.seed,
            dt=self.dt,
            time_us=lambda: self.time_us,
            say=self.say,
            write=self.recording.write,
            clothes=self.clothes,
        )

    # What it is doing

    @property
    def time_s(self) -> float:
        return self.time_us * 1e-6

    @property
    def elapsed_s(self) -> float:
        """As `time_s`, and never back: a reboot does not show in it."""
        return (self._before_boot_us + self.time_us) * 1e-6

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
        refusal = arming.refusal(self.clothes, self.parameters, self.recording, self.time_s)
        if refusal is not None:
            self.say(Severity.CRITICAL, refusal)
            return refusal
        if self.mode is not Mode.STABILIZE:
            self.set_mode(Mode.STABILIZE, Reason.PILOT)
        self.plant.reset()
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

    def reboot(self) -> str | None:
        """The pilot switches it off and on again. Returns why not, or None."""
        if self.armed:
            return f"armed, and {self.phase.value}"
        self.restart(on_ground=True)
        return None

    def restart(self, *, on_ground: bool) -> None:
        """In the air it flies on, armed, as after a watchdog's reset."""
        self.recording.close()
        self._before_boot_us += self.time_us - _FIRST_SAMPLE_US
        self.lqr_selected = False
        self.parameters.show_switch(False)
        self.yaw = self.height_m = 0.0
        self.plant.reset()
        self._boot(on_ground)

    def step_clock(self, seconds: float) -> None:
        """The vehicle's clock is another from now on; `elapsed_s` is not."""
        step_us = round(seconds * 1e6)
        self.time_us += step_us
        self._before_boot_us -= step_us

    def select_lqr(self, on: bool) -> str | None:
        """The pilot's switch between the attitude controller and the LQR. Returns why not, or None."""
        if on and not self._controllers.has_lqr:
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
            self._controllers.take_bank(self.parameters.active_bank())
        self.recording.write_parameter(name)
        self.recording.keep_on()
        return answer

    def close(self) -> None:
        """End the log whole."""
        self.recording.close()

    # Flight

    def step(self) -> None:
        """Advance by one loop of the autopilot, 2 ms on this project's own."""
        self._until_housekeeping -= 1
        if self._until_housekeeping <= 0:
            self._until_housekeeping = self._housekeeping_steps
            self._keep_house()
        plant = self.plant
        flying = self.phase in FLYING
        sweep = self.systemid.sweep
        added = NOTHING if sweep is None else self.systemid.excite(sweep, self.landed, *self.attitude)
        self._rotor_angle = (self._rotor_angle + self.dt * self._rotor_speed) % (2 * math.pi)
        yaw = self.hands.yaw
        if flying:
            self._rotor_speed = plant.omega
            raw = self.rate_sensor.measure(plant.p, plant.q, plant.r, self._rotor_angle)
            self.gyro = self._gyro_filter.step(raw)
            x, y, *wanted = self._controllers.step(plant, self.gyro, added, self.lqr_selected)
            e = clip(self._controllers.elevator + added.e)
            c = clip(self.hands.collective + added.collective)
            yaw = clip(yaw + added.tail + self.clothes.yaw_gain * (added.rate[2] + added.angle[2]))
        else:
            raw = self.rate_sensor.measure(0.0, 0.0, 0.0, 0.0)
            self.gyro = self._gyro_filter.step(raw)
            x = y = e = 0.0
            wanted = [0.0, 0.0]
            c = -1.0
        self.commands = (x, y, e, c)
        if self.recording.log is not None:
            p_ref, q_ref = wanted
            self._sampler.write(self.recording.log, self._sample(raw, (p_ref, q_ref, added.rate[2]), added, yaw))
        if flying:
            plant.step(x, y, e, c, yaw)
            self.yaw += self.dt * plant.r
            if not (abs(plant.phi) < _CRASH_LEAN and abs(plant.theta) < _CRASH_LEAN) or not (
                abs(plant.p) < _CRASH_RATE and abs(plant.q) < _CRASH_RATE
            ):
                self._crash()
        self.time_us += self.period_us

    def _sample(self, raw_gyro: Rates, wanted: Rates, added: Added, yaw: float) -> Sample:
        sweep, told = self.systemid.sweep, None
        if sweep is not None:
            target = added.target * _DEG if sweep.in_degrees else added.target
            time_s = (self.time_us - sweep.start_us) * 1e-6
            told = SweepSample(time_s=time_s, target=target, frequency_hz=sweep.frequency_hz)
        return Sample(
            time_us=self.time_us,
            sweep=told,
            raw_gyro=raw_gyro,
            gyro=self.gyro,
            wanted=wanted,
            commands=self.commands,
            yaw_command=yaw,
            excitation=added[:3],
            attitude=(*self.attitude, self.yaw),
            rotor_rpm=self.rotor_rpm,
            airspeed=self.airspeed,
            plant=self.plant,
            beside=self._controllers.beside,
        )

    # Once in 10 ms

    def _keep_house(self) -> None:
        self._follow_script()
        if self.ground.fires() and self.phase in FLYING and self.mode is not Mode.LAND:
            self.set_mode(Mode.RTL, Reason.GCS_FAILSAFE)
        if self.phase in FLYING:
            self._airborne_s += self._housekeeping_steps * self.dt
            self.hands.move()
        if self.gain_switch is not None:
            self.gain_switch.pass_by(self._housekeeping_steps * self.dt)
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
        self._rotor_speed = self._airborne_s = 0.0  # the pilot changes the battery
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
    rpm: float | None = None,
    like: str | None = None,
    gain_switch: bool = False,
) -> Vehicle:
    """A vehicle with the plant of that name, carrying what is hidden. Raises as `make_plant` and `Vehicle` do.

    `condition` is a name of `sitl.plants.conditions`; None takes the hidden effect's own, or the calm one. ValueError
    where that name does not exist, or where the effect was drawn for another plant. `rpm`: as `named_condition`.

    `like` is a name of `sitl.autopilot.clothes.CLOTHES`; such a vehicle hides nothing and is calm (ValueError).
    With `gain_switch` its card has the script of a second set of rate gains; others have a bank of their own.
    """
    flies: dict[str, Any] = {"name": plant, "seed": seed, "directory": directory, "on_ground": on_ground}
    flies |= {"parameters": parameters}
    if like is not None:
        if hidden is not None or rpm is not None or condition not in (None, "calm"):
            raise ValueError(f"{like} flies as it is: nothing is hidden in it, and no condition stirs it")
        if plant not in CLOTHES[like].plants:
            raise ValueError(f"{like} flies {' or '.join(CLOTHES[like].plants)}, not {plant}")
        return Vehicle(
            make_stock_plant(plant, seed, DT),
            **flies,
            clothes=with_gain_switch(CLOTHES[like]) if gain_switch else CLOTHES[like],
            rebuild=lambda dt: make_stock_plant(plant, seed, dt),
        )
    if hidden is not None and hidden.plant != plant:
        raise ValueError(f"what is hidden was drawn for {hidden.plant}, not for {plant}")
    if condition is None:
        condition = "calm" if hidden is None else hidden.condition
    parts = None if hidden is None else hidden.build()
    flown = named_condition(condition, rpm)
    return Vehicle(
        make_plant(plant, seed, parts=parts, condition=flown, gust_scale=gust_scale),
        **flies,
        mounts=() if parts is None else parts.gyro,
        condition=flown,
    )
