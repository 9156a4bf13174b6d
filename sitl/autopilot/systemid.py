"""The mode SYSTEMID: which sweep its parameters ask for, and what is added in each sample of it.

ArduPilot's mode, with the paper's law and kinds beside its own. It ends by itself: at the sweep's end, on the ground,
beyond the largest lean, and where a write into it leaves nothing that can be flown.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass

from sitl.autopilot.excitation import Excitation, ExcitationSettings
from sitl.autopilot.modes import Mode, Severity
from sitl.autopilot.parameters import Parameters

_LEAD_SAMPLES = 500  # of nothing before a maneuver, and from its end to "Finished"
_LARGEST_SETTING = 1e6  # what is logged stays within float32 whatever the ground has written
_DEG = 180 / math.pi

# ArduPilot ends at 19; 20 is this vehicle's own.
_AXES = {10: "roll", 11: "pitch", 7: "rate_roll", 8: "rate_pitch", 20: "elevator"}
_RATE_AXES = (7, 8)
_KINDS = {0: "chirp", 1: "doublet", 2: "quiet"}
_LAWS = {0: "ardupilot", 1: "tischler"}


@dataclass(kw_only=True)
class Sweep:
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
        self._runs = 0

    def refusal(self, mode: Mode, landed: bool) -> str | None:
        """Why the mode cannot be entered from this one, or None."""
        axis = int(self._parameters["SID_AXIS"])
        if axis == 0:
            return "No axis selected, SID_AXIS = 0"
        if axis not in _AXES:
            return f"SID_AXIS = {axis}: this vehicle has 7, 8, 10, 11, 20"
        if landed:
            return "Aircraft must be flying"
        if mode is not Mode.STABILIZE:
            return "Axis requires manual throttle"
        return None

    def _settings(self, axis: int) -> tuple[ExcitationSettings, str | None]:
        """What the parameters ask for on an axis that there is, and why it cannot be flown, or None."""
        get = self._parameters.__getitem__
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
        seed = int(self._parameters["SIDX_SEED"]) or drawn
        self._say(Severity.INFO, f"SystemID Starting: axis={axis}")
        self.sweep = Sweep(
            excitation=None if problem is not None else Excitation(settings, seed),
            on_rate=axis in _RATE_AXES,
            frequency_hz=settings.f_start_hz if settings.kind == "chirp" else 0.0,
            start_us=self._time_us(),
            writes=self._parameters.writes,
        )
        self._log(axis, settings)
        if problem is not None:
            self._refuse(self.sweep, problem)

    def _log(self, axis: int, settings: ExcitationSettings) -> None:
        get = self._parameters.__getitem__
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
        if axis not in _AXES:
            self._end(sweep, f"SystemID Stopped: axis = {axis}")
            return
        settings, problem = self._settings(axis)
        if problem is not None:
            self._refuse(sweep, problem)
            return
        sweep.on_rate = axis in _RATE_AXES
        if sweep.excitation is not None:
            sweep.excitation.change(settings)

    def _refuse(self, sweep: Sweep, problem: str) -> None:
        self._end(sweep, "SystemID Parameter Error")
        self._say(Severity.INFO, f"SystemID: {problem}")

    def _end(self, sweep: Sweep, text: str) -> None:
        sweep.excitation = None
        sweep.running = False
        self._say(Severity.INFO, text)

    def excite(self, sweep: Sweep, landed: bool, phi: float, theta: float) -> tuple[float, float, float, float]:
        """x, y, e and the target of this sample, and the bookkeeping of the stay in SYSTEMID."""
        n = sweep.sample
        sweep.sample += 1
        if sweep.running and sweep.writes != self._parameters.writes:
            self._change(sweep)
        if not sweep.running:
            return 0.0, 0.0, 0.0, 0.0
        lean_deg = math.acos(math.cos(phi) * math.cos(theta)) * _DEG
        limit_deg = self._parameters["ANGLE_MAX"] * 0.01
        if landed:
            self._end(sweep, "SystemID Stopped: Landed")
        elif lean_deg > limit_deg:
            self._end(sweep, f"SystemID Stopped: lean={lean_deg:f} max={limit_deg:f}")
        elif sweep.excitation is None:
            sweep.lead_out += 1
            if sweep.lead_out >= _LEAD_SAMPLES:
                self._end(sweep, "SystemID Finished")
        elif n >= _LEAD_SAMPLES:
            sample = sweep.excitation.step()
            if not sample.done:
                sweep.frequency_hz = sample.frequency_hz
                return sample.x, sample.y, sample.e, sample.target
            sweep.excitation = None
        return 0.0, 0.0, 0.0, 0.0
