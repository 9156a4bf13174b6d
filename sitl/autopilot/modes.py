"""Modes, phases of a flight, and who or what changed them: numbers as the link and the log carry them."""

from __future__ import annotations

from enum import Enum, IntEnum


class Mode(IntEnum):
    STABILIZE = 0
    ALT_HOLD = 2
    RTL = 6
    LAND = 9
    SYSTEMID = 25


MANUAL_THROTTLE = (Mode.STABILIZE, Mode.SYSTEMID)


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


FLYING = (Phase.CLIMBING, Phase.HOVERING, Phase.DESCENDING)


class Severity(IntEnum):
    """MAV_SEVERITY, the ones used here."""

    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    INFO = 6


class LogEvent(IntEnum):
    """EV.Id of the log."""

    ARMED = 10
    DISARMED = 11
    LANDED = 18
    AIRBORNE = 28
