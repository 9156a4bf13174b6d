"""What a vehicle's settings and counters say of its own log: whose it is, how fast it is, and what it dropped."""

from __future__ import annotations

from collections.abc import Mapping

from gcs.vehicle.autopilots import LOG_BACKEND, LOG_BITMASK, LOOP_RATE
from gcs.vehicle.identity import group_of
from sysid.data.airframe import Airframe
from sysid.data.gyro_settings import NOTCH_PREFIXES as NOTCHES
from sysid.data.gyro_settings import NOTCH_WORDS

SAMPLES_OF_A_PERIOD = 10.0
"""Of the highest frequency swept: fewer, and what moved between them is a large part of it."""
SLOWER = 0.8
"""Share of the loop's rate; a log that misses a few samples is not slow."""
ENOUGH_BUFFER = 50
"""LOG_MAV_BUFSIZE with which a link drops nothing; above 53 it overflows."""
EVERY_LOOP = 1
"""The bit of LOG_BITMASK that logs the rates in every control loop."""
LARGER_BUFFER = f"set LOG_MAV_BUFSIZE to {ENOUGH_BUFFER}"
_BY_LINK = 2
"""The bit of LOG_BACKEND_TYPE that sends the log over the link."""
LOG_EVERY_LOOP = "LOG_BITMASK bit 0 (ATTITUDE_FAST) logs every loop"
SYSTEM_IDS = ("MAV_SYSID", "SYSID_THISMAV")
LOOP_RATES = (LOOP_RATE, "IMU_GYRO_RATEMAX")
"""ArduPilot's and PX4's; zero is none."""
SETUP = ("FRAME_CLASS", "FRAME_TYPE", LOOP_RATE, "INS_GYRO_FILTER", "H_SW_TYPE", "H_CYC_MAX", "MOT_THST_EXPO")
"""Settings that make another vehicle of one, or another command of the same number."""
_CLASSES = {Airframe.MULTIROTOR: (1, 2, 3, 4, 5, 7, 12, 14), Airframe.HELICOPTER: (6, 11)}
"""ArduPilot's FRAME_CLASS: quad, hexa, octa, octaquad, Y6, tri, dodeca-hexa, deca; single and dual helicopter. What
steers with flaps or tilting rotors is neither."""
_FRAMES = {
    Airframe.MULTIROTOR: ("QUAD", "HEXA", "OCTA", "OCTAQUAD", "Y6", "TRI", "DODECAHEXA", "DECA"),
    Airframe.HELICOPTER: ("HELI", "HELI_DUAL"),
}
"""The same as it says them after `Frame:`, before the type."""
SWASHPLATE = "SWSH"
"""Its message of what goes to a swashplate."""
TYPES = ("HEARTBEAT.type", "vehicle_status.system_type")
"""Where telemetry and PX4 tell the MAV_TYPE."""
OVER_LINK, ON_CARD = DROPPED = ("DMS.Dp", "DSF.Dp")
"""Its counters of messages that it wrote neither to the link nor to the card."""


def loop_rate(settings: Mapping[str, float]) -> tuple[str, float] | None:
    """The setting that says how often the control loop gave a command, and how often, Hz; None where none does."""
    return next(((name, settings[name]) for name in LOOP_RATES if settings.get(name, 0.0) > 0), None)


def slower_than_loop(rate_hz: float, loop_hz: float) -> str:
    """What it means that a log has `rate_hz` of a loop's `loop_hz`."""
    return (
        f"logged at {rate_hz:.0f} Hz, the vehicle's loop runs at {loop_hz:.0f}: enough for a sweep to "
        f"{rate_hz / SAMPLES_OF_A_PERIOD:.0f} Hz, with {cost_of(rate_hz, loop_hz)}"
    )


def cost_of(rate_hz: float, loop_hz: float) -> str:
    """What a fit loses by a log of `rate_hz` of a loop's `loop_hz`."""
    wider = (loop_hz / rate_hz) ** 0.5  # so many fewer samples average the noise
    return f"error bounds up to {wider:.1f} times as wide"


def identity(settings: Mapping[str, float]) -> dict[str, str]:
    """What parameters say of the vehicle and how it was set up, by name."""
    known: dict[str, str] = {}
    system = next((settings[name] for name in SYSTEM_IDS if name in settings), None)
    if system is not None:
        known["system id"] = f"{system:g}"
    if settings.get("BRD_SERIAL_NUM"):
        known["BRD_SERIAL_NUM"] = f"{settings['BRD_SERIAL_NUM']:g}"
    setup = [
        *SETUP,
        *(f"{notch}_{word}" for notch in NOTCHES if settings.get(f"{notch}_ENABLE") for word in NOTCH_WORDS),
    ]
    gains = [name for name in settings if group_of(name) == "gains"]
    return known | {name: f"{settings[name]:g}" for name in (*setup, *gains) if name in settings}


def airframe(settings: Mapping[str, float], frame: str = "") -> Airframe | None:
    """What parameters and the frame's name, as ArduPilot gives them, say of the vehicle; None for nothing."""
    number, word = settings.get("FRAME_CLASS"), frame.partition("/")[0]
    for kind in Airframe:
        if number in _CLASSES[kind] if number else word in _FRAMES[kind]:
            return kind
    return None


def dropped(counts: Mapping[str, int], settings: Mapping[str, float]) -> str | None:
    """Why samples of a run are missing, where the vehicle itself did not write them; None where that is not known.

    counts: by how much each of `DROPPED` grew in the run, those that the log has.
    """
    buffer = settings.get("LOG_MAV_BUFSIZE")
    has = "" if buffer is None else f" (it is {buffer:g})"
    do = f"{LARGER_BUFFER}{has}, or take the vehicle's own file from its card"
    if over_link := counts.get(OVER_LINK):
        return (
            f"the vehicle itself dropped {over_link} messages of its log in this run ({OVER_LINK}), for want of room: "
            f"{do}"
        )
    if on_card := counts.get(ON_CARD):
        return (
            f"the vehicle itself dropped {on_card} messages of its log in this run ({ON_CARD}), because its card was "
            "too slow: raise LOG_FILE_BUFSIZE, log less beside the rates (LOG_BITMASK), or take a faster card"
        )
    sends = int(settings.get(LOG_BACKEND, 0.0)) & _BY_LINK
    if counts or not sends or buffer is None or buffer >= ENOUGH_BUFFER:
        return None
    return f"what is missing in gaps was most likely dropped by the vehicle itself, before it sent its log: {do}"


def thinned(rate_hz: float, settings: Mapping[str, float]) -> str | None:
    """What a log slower than the vehicle's loop is enough for, and what it costs; None where it has every loop."""
    loop_hz = settings.get(LOOP_RATE, 0.0)
    if not 0 < rate_hz < SLOWER * loop_hz:
        return None
    told = int(settings.get(LOG_BITMASK, EVERY_LOOP))
    do = "" if told & EVERY_LOOP else f"; {LOG_EVERY_LOOP}"
    return f"{slower_than_loop(rate_hz, loop_hz)}{do}"
