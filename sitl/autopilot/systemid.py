"""The mode SYSTEMID: which sweep its parameters ask for, and what is added in each sample of it.

ArduPilot's mode, with the paper's law and kinds beside its own. It ends by itself: at the sweep's end, on the ground,
beyond the largest lean, and where a write into it leaves nothing that can be flown.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from sitl.autopilot.clothes import OWN_CLOTHES, Axis, Clothes
from sitl.autopilot.excitation import Excitation, ExcitationSample, ExcitationSettings
from sitl.autopilot.modes import Mode, Severity
from sitl.autopilot.parameters import Parameters

_LEAD_S = 1.0  # of nothing before a maneuver
_LARGEST_SETTING = 1e6  # what is logged stays within float32 whatever the ground has written
_DEG = 180 / math.pi

_WITHOUT = {"SIDX_KIND": 0.0, "SIDX_LAW": 0.0, "SIDX_C1": 4.0, "SIDX_NOISE": 0.0, "SIDX_PULSE_S": 0.3, "SIDX_SEED": 0.0}
"""What flies where a vehicle does not have these parameters: ArduPilot's own chirp."""
_KINDS = {0: "chirp", 1: "doublet", 2: "quiet"}
_LAWS = {0: "ardupilot", 1: "tischler"}


@dataclass(kw_only=True)
class Sweep:
    """One stay in SYSTEMID."""

    excitation: Excitation | None
    """None once it is over, or where its settings were refused."""
    axis: Axis
    frequency_hz: float
    start_us: int
    tail_samples: int
    """From the maneuver's end to "Finished"."""
    writes: int
    """`Parameters.writes` when its settings were read."""
    sample: int = 0
    lead_out: int = 0
    """Samples since the maneuver's end."""
    running: bool = True

    @property
    def in_degrees(self) -> bool:
        """SID_MAGNITUDE and the logged target of this axis, where the target itself is in rad or rad/s."""
        return self.axis.place != "mixer"


class Added(NamedTuple):
    """What a sweep adds in one sample: to the commands of roll, pitch, elevator, tail and collective, or as targets."""

    x: float = 0.0
    y: float = 0.0
    e: float = 0.0
    tail: float = 0.0
    collective: float = 0.0
    rate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad/s, to what is asked for."""
    angle: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad."""
    target: float = 0.0


NOTHING = Added()


def _placed(axis: Axis, sample: ExcitationSample) -> Added:
    target = sample.target
    if axis.place == "mixer":
        if axis.channel == "yaw":
            return Added(tail=target, target=target)
        if axis.channel == "thrust":
            return Added(collective=target, target=target)
        return Added(sample.x, sample.y, sample.e, target=target)
    turn = (sample.x, sample.y, target if axis.channel == "yaw" else 0.0)
    return Added(rate=turn, target=target) if axis.place == "rate" else Added(angle=turn, target=target)


class SystemId:
    """One vehicle's stays in the mode, one after the other."""

    def __init__(
        self,
        parameters: Parameters,
        *,
        seed: int,
        dt: float,
        time_us: Callable[[], int],
        say: Callable[[Severity, str], None],
        write: Callable[..., None],
        clothes: Clothes = OWN_CLOTHES,
    ) -> None:
        """`write` takes a message of the log by its name and what follows its time."""
        self.sweep: Sweep | None = None
        """While the vehicle is in the mode."""
        self.first_s = math.inf
        """When the first sweep began; infinite before."""
        self._parameters = parameters
        self._seed = seed
        self._dt = dt
        self._time_us = time_us
        self._say = say
        self._write = write
        self._clothes = clothes
        self._lead_samples = round(_LEAD_S / dt)
        self._runs = 0

    def refusal(self, mode: Mode, landed: bool) -> str | None:
        """Why the mode cannot be entered from this one, or None."""
        axis = int(self._parameters["SID_AXIS"])
        if axis == 0:
            return "No axis selected, SID_AXIS = 0"
        if axis not in self._clothes.axes:
            return self._clothes.other_axis.format(axis)
        if landed:
            return "Aircraft must be flying"
        if mode is not Mode.STABILIZE:
            return "Axis requires manual throttle"
        return None

    def _get(self, name: str) -> float:
        return self._parameters[name] if name in self._parameters else _WITHOUT[name]

    def _settings(self, axis: int) -> tuple[ExcitationSettings, str | None]:
        """What the parameters ask for on an axis that there is, and why it cannot be flown, or None."""
        get = self._get
        kind, law = int(get("SIDX_KIND")), int(get("SIDX_LAW"))
        place = self._clothes.axes[axis]
        settings = ExcitationSettings(
            kind=_KINDS.get(kind, f"SIDX_KIND {kind}"),
            law=_LAWS.get(law, f"SIDX_LAW {law}"),
            axis=place.channel,
            # ArduPilot counts angles in degrees and rates in deg/s.
            magnitude=get("SID_MAGNITUDE") / _DEG if place.place != "mixer" else get("SID_MAGNITUDE"),
            f_start_hz=get("SID_F_START_HZ"),
            f_stop_hz=get("SID_F_STOP_HZ"),
            fade_in_s=get("SID_T_FADE_IN"),
            duration_s=get("SID_T_REC"),
            fade_out_s=get("SID_T_FADE_OUT"),
            c1=get("SIDX_C1"),
            noise=get("SIDX_NOISE"),
            pulse_s=get("SIDX_PULSE_S"),
            dt=self._dt,
        )
        if max(abs(settings.magnitude), settings.noise) > _LARGEST_SETTING:
            return settings, "magnitude or noise is absurd"
        return settings, settings.problem()

    def begin(self) -> None:
        """The mode was entered: fly what the parameters ask for."""
        axis = int(self._parameters["SID_AXIS"])
        settings, problem = self._settings(axis)
        self._runs += 1
        self.first_s = min(self.first_s, self._time_us() * 1e-6)
        drawn = random.Random(f"{self._seed} {self._runs}").getrandbits(31)
        seed = int(self._get("SIDX_SEED")) or drawn
        self._say(Severity.INFO, f"SystemID Starting: axis={axis}")
        self.sweep = Sweep(
            excitation=None if problem is not None else Excitation(settings, seed),
            axis=self._clothes.axes[axis],
            frequency_hz=settings.f_start_hz if settings.kind == "chirp" else 0.0,
            start_us=self._time_us(),
            tail_samples=round(self._tail_s(settings) / self._dt),
            writes=self._parameters.writes,
        )
        self._log(axis, settings)
        if problem is not None:
            self._refuse(self.sweep, problem)

    def _tail_s(self, settings: ExcitationSettings) -> float:
        if self._clothes.tail_s is not None:
            return self._clothes.tail_s
        constant_s = 2 / settings.f_start_hz if settings.f_start_hz > 0 else 0.0
        return settings.fade_in_s + constant_s + settings.fade_out_s

    def _log(self, axis: int, settings: ExcitationSettings) -> None:
        get = self._get
        kind, law = int(get("SIDX_KIND")), int(get("SIDX_LAW"))
        constant_s = 2 / settings.f_start_hz if law == 0 and settings.f_start_hz > 0 else 0.0
        self._write(
            "SIDS",
            axis,
            *(get("SID_" + name) for name in ("MAGNITUDE", "F_START_HZ", "F_STOP_HZ", "T_FADE_IN")),
            min(constant_s, 1e9),
            *(get("SID_" + name) for name in ("T_REC", "T_FADE_OUT")),
        )
        self._write("SIDY", kind & 0xFF, law & 0xFF, settings.c1, settings.noise, settings.pulse_s)

    def _change(self, sweep: Sweep) -> None:
        """A write into a running sweep acts at once: ArduPilot reads magnitude, axis and end in every loop."""
        sweep.writes = self._parameters.writes
        axis = int(self._parameters["SID_AXIS"])
        if axis not in self._clothes.axes:
            self._end(sweep, f"SystemID Stopped: axis = {axis}")
            return
        settings, problem = self._settings(axis)
        if problem is not None:
            self._refuse(sweep, problem)
            return
        sweep.axis = self._clothes.axes[axis]
        if sweep.excitation is not None:
            sweep.excitation.change(settings)

    def _refuse(self, sweep: Sweep, problem: str) -> None:
        self._end(sweep, "SystemID Parameter Error")
        if self._clothes.explains:
            self._say(Severity.INFO, f"SystemID: {problem}")

    def _end(self, sweep: Sweep, text: str) -> None:
        sweep.excitation = None
        sweep.running = False
        self._say(Severity.INFO, text)

    def excite(self, sweep: Sweep, landed: bool, phi: float, theta: float) -> Added:
        """What is added in this sample, and the bookkeeping of the stay in SYSTEMID."""
        n = sweep.sample
        sweep.sample += 1
        if sweep.running and sweep.writes != self._parameters.writes:
            self._change(sweep)
        if not sweep.running:
            return NOTHING
        lean_deg = math.acos(math.cos(phi) * math.cos(theta)) * _DEG
        limit_deg = self._parameters["ANGLE_MAX"] * 0.01
        if landed:
            self._end(sweep, "SystemID Stopped: Landed")
        elif lean_deg > limit_deg:
            self._end(sweep, f"SystemID Stopped: lean={lean_deg:f} max={limit_deg:f}")
        elif sweep.excitation is None:
            sweep.lead_out += 1
            if sweep.lead_out >= sweep.tail_samples:
                self._end(sweep, "SystemID Finished")
        elif n >= self._lead_samples:
            sample = sweep.excitation.step()
            if not sample.done:
                sweep.frequency_hz = sample.frequency_hz
                return _placed(sweep.axis, sample)
            sweep.excitation = None
        return NOTHING
