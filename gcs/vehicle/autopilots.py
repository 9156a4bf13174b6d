"""All that is an autopilot's own, beside the vehicle profiles and `readiness`: modes, texts, parameters, failsafes,
the bank.

Elsewhere nothing is known of these by name or number: other rooms take them from here or from the profile, and a
contract test looks that no string of theirs spells one. What crosses the wire is `gcs.link`'s.

ArduPilot's numbers and names are those of ArduCopter 4.5 to 4.7. The bank of gains and the switch are the parameters of
an autopilot that flies the LQR, as the bundled vehicle does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from sysid.data.airframe import Airframe

# ------------------------------------------------------------------------------------------------ what flies

ARDUPILOT: Final = 3
"""MAV_AUTOPILOT."""
AUTOPILOTS: Final = {ARDUPILOT: "ArduPilot", 12: "PX4", 0: "a generic autopilot", 9: "Paparazzi"}
KINDS: Final = {
    1: "aeroplane",
    2: "quadrotor",
    3: "coaxial helicopter",
    4: "helicopter",
    13: "hexarotor",
    14: "octorotor",
}
"""MAV_TYPE."""
_ROTORCRAFT: Final = {2, 3, 4, 13, 14, 15, 29, 35}
_ONE_ROTOR: Final = {4}
_COAXIAL: Final = {3}


def rotorcraft(vehicle_type: int) -> str:
    """`helicopter` or `multirotor`; empty for what is neither."""
    if vehicle_type in _ONE_ROTOR:
        return "helicopter"
    return "multirotor" if vehicle_type in _ROTORCRAFT else ""


def airframe_of_type(vehicle_type: int) -> Airframe | None:
    """What a MAV_TYPE says of how rotors are moved; None where it leaves that open (coaxial) or is no rotorcraft."""
    if vehicle_type in _ONE_ROTOR:
        return Airframe.HELICOPTER
    return Airframe.MULTIROTOR if vehicle_type in _ROTORCRAFT - _COAXIAL else None


IN_THE_AIR: Final = 4
"""MAV_STATE."""
_TROUBLED: Final = {
    1: "the autopilot is starting",
    2: "the autopilot is calibrating",
    5: "a failsafe is active (status CRITICAL); the vehicle's own messages say which, and the pilot clears it or lands",
    6: "an emergency is on (status EMERGENCY); the pilot lands",
    7: "the autopilot is powering off",
    8: "the flight is being terminated",
}


def state_trouble(status: int) -> str:
    """Why nothing is started in this MAV_STATE, in the air or on the ground; empty where it tells of no trouble."""
    return _TROUBLED.get(status, "")


PRIMARY_SYSTEM: Final = 255
"""The station whose heartbeats hold ArduPilot's ground failsafe, by default."""

# ------------------------------------------------------------------------------------------------ modes

STABILIZE, ALT_HOLD, RTL, LAND, SYSTEMID = 0, 2, 6, 9, 25
COPTER_MODES: Final = {
    0: "Stabilize",
    1: "Acro",
    2: "AltHold",
    3: "Auto",
    4: "Guided",
    5: "Loiter",
    6: "RTL",
    7: "Circle",
    9: "Land",
    11: "Drift",
    13: "Sport",
    14: "Flip",
    15: "AutoTune",
    16: "PosHold",
    17: "Brake",
    18: "Throw",
    19: "Avoid ADSB",
    20: "Guided NoGPS",
    21: "Smart RTL",
    22: "FlowHold",
    23: "Follow",
    24: "ZigZag",
    25: "SystemID",
    26: "Autorotate",
    27: "Auto RTL",
    28: "Turtle",
}
BY_ITSELF: Final = {3, 5, 6, 9, 11, 17, 20, 21, 26, 27}
"""Modes in which the autopilot flies where it will: Auto, RTL, Land and the like."""


def mode_name(mode: int, vehicle_type: int, autopilot: int) -> str:
    """What people call a mode. Numbers mean something only together with the autopilot and the kind of vehicle."""
    if autopilot == ARDUPILOT and vehicle_type in _ROTORCRAFT and mode in COPTER_MODES:
        return COPTER_MODES[mode]
    return f"mode {mode}"


# ------------------------------------------------------------------------------------------------ a sweep, in its words

SAYS: Final = "SystemID"
"""How every text on a sweep begins."""
STARTING: Final = "SystemID Starting"
FINISHED: Final = "SystemID Finished"
STOPPED: Final = "SystemID Stopped"
PARAMETER_ERROR: Final = "SystemID Parameter Error"
"""What ArduPilot says about a sweep; its only word on progress."""
NO_EXCITATION: Final = (
    "this vehicle offers no excitation on board: it has no SID_AXIS. On ArduPilot that is firmware built without "
    "the SystemID mode: put a build with it on the vehicle (custom.ardupilot.org, or a board of 2 MB). Other "
    "autopilots are not supported yet; their logs are read, once somebody has flown the maneuvers by hand"
)

# ------------------------------------------------------------------------------------------------ parameters around it

LOOP_RATE: Final = "SCHED_LOOP_RATE"
"""Hz, of the loop that flies and logs."""
AROUND_A_MANEUVER: Final = ("FS_GCS_ENABLE", "FS_OPTIONS", "FS_GCS_TIMEOUT", LOOP_RATE)
"""What decides about a lost link, and the loop's rate."""
RENAMED: Final = (("SYSID_MYGCS", "MAV_GCS_SYSID"), ("ANGLE_MAX", "ATC_ANGLE_MAX"))
"""Older and newer names; only one of each pair is there."""
LOG_TO_MAVLINK: Final = "set LOG_BACKEND_TYPE to 3 (file and MAVLink) and restart the autopilot"
NO_LOG: Final = "the vehicle must log to MAVLink (LOG_BACKEND_TYPE with bit 2, then reboot)"
LOG_BACKEND: Final = "LOG_BACKEND_TYPE"
"""Where the vehicle's log goes, in bits."""
_TO_FILE: Final = 1
_LOG_FAILED: Final = (
    "logging failed",
    "logging not started",
    "no sd card",
    "out of space for logging",
)
LOG_BITMASK: Final = "LOG_BITMASK"
"""Which of its records the vehicle writes."""


def no_card_log(backend: float | None) -> str:
    """Why a vehicle with this LOG_BACKEND_TYPE (None: it has none) keeps no log on its card; empty where it does."""
    if backend is None:
        return f"whether the vehicle keeps a log on its card is not known (it has no {LOG_BACKEND})"
    if int(backend) & _TO_FILE:
        return ""
    return (
        f"the vehicle keeps no log on its card ({LOG_BACKEND} is {backend:g}): set it to 1 (file), or 3 (file and "
        "MAVLink), and restart the autopilot"
    )


def says_log_failed(text: str) -> bool:
    """Whether a text of the vehicle says that it does not write its log."""
    return any(words in text.lower() for words in _LOG_FAILED)


_FAILSAFE_ACTIONS: Final = {
    1: "returns home",
    2: "returns home",
    3: "returns home",
    4: "returns home",
    5: "lands",
    6: "lands",
    7: "brakes",
}
_CONTINUE_PILOT_CONTROL: Final = 16
"""FS_OPTIONS bit 4."""


@dataclass(frozen=True, slots=True)
class LinkLoss:
    """What the vehicle does when it no longer hears the ground."""

    answer: str
    """`returns home after 5 s`, `the sweep does NOT stop (...)`."""
    ends_sweep: bool | None
    """None where the vehicle does not tell."""

    @property
    def words(self) -> str:
        """`if the link drops: returns home after 5 s`."""
        return f"if the link drops: {self.answer}"


def link_loss(parameters: Mapping[str, float], station: int) -> LinkLoss:
    """The vehicle's answer to a lost link, read from its parameters, for a ground station with this system id."""
    enabled = parameters.get("FS_GCS_ENABLE")
    if enabled is None:
        return LinkLoss("the vehicle does not tell what it would do (no FS_GCS_ENABLE)", None)
    if int(enabled) == 0:
        return LinkLoss("the sweep does NOT stop (FS_GCS_ENABLE 0: the vehicle does not notice)", False)
    primary = parameters.get("SYSID_MYGCS", parameters.get("MAV_GCS_SYSID"))
    if primary is not None and int(primary) != station:
        return LinkLoss(
            f"the sweep does NOT stop: the failsafe listens to station {int(primary)}, this is {station} (start with "
            "--primary)",
            False,
        )
    if int(parameters.get("FS_OPTIONS", 0)) & _CONTINUE_PILOT_CONTROL:
        return LinkLoss("the sweep does NOT stop (FS_OPTIONS 16: continuing pilot control)", False)
    after_s = parameters.get("FS_GCS_TIMEOUT", 5.0)
    action = _FAILSAFE_ACTIONS.get(int(enabled), f"does what FS_GCS_ENABLE {int(enabled)} means")
    return LinkLoss(f"{action} after {after_s:g} s", True)


LEAN_LIMIT: Final = "ANGLE_MAX"


def lean_limit_deg(parameters: Mapping[str, float]) -> float | None:
    """Beyond which lean, degrees, the vehicle ends a sweep by itself; None where it does not tell."""
    degrees = parameters.get("ATC_ANGLE_MAX")
    if degrees is None and LEAN_LIMIT in parameters:
        degrees = parameters[LEAN_LIMIT] / 100
    return degrees


# ------------------------------------------------------------------------------------------------ the bank of gains

SHADOW, ACTIVE = "LQS_", "LQR_"
"""Before the names of a bank's values: of the one that is written, and of the one that flies."""
BANK_KNOWN_BY: Final = "LQS_K11"
RUN_BESIDE: Final = "LQR_LOG"
"""1: the active bank runs while it does not fly, without authority, and is logged."""
COMMIT, REVERT = "LQR_COMMIT", "LQR_REVERT"
"""Parameters that act when written."""
ACTIVE_CRC: Final = "LQR_ACTIVE"
SWITCHED: Final = ("LQR off", "LQR on")
"""What the vehicle says when the pilot's switch is turned."""
SWITCH: Final = "LQR_SW"
"""1 where the pilot's switch selects the LQR."""
MORE_KNOWN_BY: Final = "LQS_F11"
"""Of a bank with an elevator and a dynamic prefilter."""
LESS_BANK: Final = (
    f"this vehicle's LQR has no elevator and no dynamic prefilter (it has no parameter {MORE_KNOWN_BY}): design these "
    "gains without them (`tippath design --prefilter steady`, and without --elevator); nothing was written"
)
NO_BANK: Final = (
    f"this vehicle offers no LQR bank (it has no parameter {BANK_KNOWN_BY}): gains can only be pushed to a vehicle "
    "whose autopilot runs the LQR"
)
