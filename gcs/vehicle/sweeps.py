"""How a chirp is flown with the autopilot that wrote a log: what a hint tells where nothing was excited.

By the name of the log's profile, where that is one of an autopilot, else by the kind of log. Sources: ArduPilot's mode
SystemID; betaflight/betaflight pull requests 13105 and 15113; PX4's multicopter autotune, which has no sweep
(PX4-Autopilot pull request 21857); paparazzi/paparazzi pull request 2374.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sysid.data.airframe import Airframe
from sysid.data.record import Record

AXES = "roll, then pitch (and elevator in forward flight)"
ARDUPILOT = f"fly a chirp: tippath sweep --connect LINK --axis {AXES}"
ANY = (
    f"fly a chirp, a sine that goes from 0.5 to 10 Hz in 30 s or more, added to the command of {AXES}, and log what is "
    "added (excitation_x, excitation_y)"
)
BETAFLIGHT = (
    "fly a chirp: Betaflight 2025.12 or later, built with CHIRP, has a mode CHIRP (each switching on sweeps the next "
    "axis); set debug_mode = CHIRP, chirp_frequency_end_deci_hz = 150, and log to the blackbox at 500 Hz or more"
)
PX4 = (
    "PX4 has no chirp for multicopters: sweep the stick by hand, from one motion in 3 s to as fast as you can, 60 s of "
    "roll, then 60 s of pitch, in Acro, with bit 3 of SDLOG_PROFILE set; its autotune (MC_AT_START) excites them, too"
)
CRAZYFLIE = (
    f"a Crazyflie has no chirp of its own: add one to the command of {AXES} in an app of its firmware, and log the "
    "command, what is added and the gyro with the uSD deck at 500 Hz or more"
)
PAPARAZZI = "fly a chirp: Paparazzi's module sys_id_chirp adds one to a command, and its message CHIRP tells the runs"
PAPARAZZI_RATES = ("IMU_GYRO", "STAB_ATTITUDE")
BY_PROFILE: Mapping[str, str] = {
    "arducopter": ARDUPILOT,
    "blackbox_rotorflight": ANY,
    "blackbox": BETAFLIGHT,
    "crazyflie": CRAZYFLIE,
    "mavros": PX4,
    "quadrotor": CRAZYFLIE,
    "paparazzi": PAPARAZZI,
    "px4": PX4,
    "tlog": ARDUPILOT,
}
"""The beginning of a bundled log profile's name -> what to do; the first that fits."""
BY_KIND: Mapping[str, str] = {"dataflash": ARDUPILOT, "tlog": ARDUPILOT, "ulog": PX4}
ARDUPILOT_THRUST = (
    "SID_AXIS 13 sweeps thrust: SID_MAGNITUDE {amplitude:.3g}, SID_F_START_HZ {start_hz:g}, SID_F_STOP_HZ {stop_hz:g}, "
    "SID_T_REC {duration_s:g}, then mode SystemID out of Stabilize, the pilot holding the height; no card does that"
)
BY_STICK = "by that stick: a pulse each way, {pulse_s:g} s each, with rest until the answer has died out"
BY_RATES: Mapping[Sequence[str], Mapping[str, str]] = {
    ("gyroADC",): {
        **dict.fromkeys(
            ("roll", "pitch", "yaw"), "mode CHIRP sweeps roll, pitch and yaw, one each time it is switched on"
        ),
        "thrust": "mode CHIRP does not sweep thrust: by the throttle stick, slow to fast",
    },
    ("vehicle_angular_velocity", "sensor_combined", "fmu_out", "mavros"): dict.fromkeys(
        ("roll", "pitch", "yaw", "thrust"), "PX4 has no chirp: by that stick, from slow to fast, for as long"
    ),
    ("fixedFrequency", "controller"): dict.fromkeys(
        ("roll", "pitch", "yaw", "thrust"), "by an app of the Crazyflie's firmware, which adds it to that command"
    ),
    PAPARAZZI_RATES: dict.fromkeys(
        ("roll", "pitch", "yaw", "thrust"), "by module sys_id_chirp, with that axis among its CHIRP_AXES"
    ),
}
"""The beginning of what a run's rates come from -> axis -> how a chirp on it is flown, where no card flies it."""


def flies_cards(rate_source: str) -> bool:
    """Whether a run whose rates come from this kind of message is an ArduPilot's, which alone `tippath sweep` flies.

    Its log's kinds and MAVLink's are in capitals, as are Paparazzi's, no others'.
    """
    return rate_source.isupper() and not rate_source.startswith(PAPARAZZI_RATES)


def chirps_only(record: Record) -> bool:
    """Whether it was flown by ArduPilot, which flies nothing but chirps, and these by its own law, without noise."""
    return flies_cards(record.rate_source) and record.chirp_noise == 0


def how_to_sweep(profile: str, kind: str) -> str:
    """For a log of this kind that was read by this profile."""
    named = (words for name, words in BY_PROFILE.items() if profile == name or profile.startswith(f"{name}_"))
    return next(named, BY_KIND.get(kind, ANY))


def how_to_fly(
    run: Record, axis: str, *, amplitude: float, band_hz: tuple[float, float], duration_s: float
) -> str | None:
    """How a chirp is flown that no card holds, by whoever flew this run; None where nobody knows."""
    if flies_cards(run.rate_source):
        numbers = {"amplitude": amplitude, "start_hz": band_hz[0], "stop_hz": band_hz[1], "duration_s": duration_s}
        return ARDUPILOT_THRUST.format(**numbers) if axis == "thrust" else None
    if run.airframe is Airframe.HELICOPTER:  # Rotorflight logs as Betaflight, and has no such mode
        return None
    ways = (ways for begins, ways in BY_RATES.items() if run.rate_source.startswith(tuple(begins)))
    return next(ways, {}).get(axis)
