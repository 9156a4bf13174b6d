"""A script on the card that holds a second set of rate gains behind the pilot's switch, as its description says.

Imitated, not run: written from what the script promises, so that whoever pushes to it is judged by another hand. Ten
times a second it looks at what was committed and at the switch. What it sets is not saved: a restart flies the old set.
"""

from __future__ import annotations

import struct
import zlib
from typing import Protocol

from sitl.autopilot.modes import Severity
from sitl.autopilot.parameters import Kind, Parameter, Parameters

PERIOD_S = 0.1
GAINS = tuple(f"{axis}_{gain}" for axis in ("RLL", "PIT") for gain in ("P", "I", "D", "FF"))
FLOWN = tuple("ATC_RAT_" + name for name in GAINS)
NEW = tuple("TPG_" + name for name in GAINS)
OLD = tuple("TPG_O_" + name for name in GAINS)
OPTION = 300
"""Scripting1."""
CHANNELS = range(5, 17)
LOW, MIDDLE, HIGH = ("low", "middle", "high")

TABLE = (
    *(Parameter(name, 0, Kind.REAL32) for name in (*NEW, *OLD)),
    *(Parameter(f"TPG_{name}", value, Kind.REAL32) for name, value in (("COMMIT", 0), ("ACTIVE", 0), ("FLIES", 0))),
    Parameter("TPG_FUNC", OPTION, Kind.REAL32),
    Parameter("SCR_ENABLE", 1, Kind.INT8),
    *(Parameter(f"RC{n}_OPTION", OPTION if n == 9 else 0, Kind.INT16) for n in CHANNELS),
)
"""What it adds to the vehicle's parameters; the last two are the autopilot's own."""


class Carrier(Protocol):
    """The vehicle, as a script sees it."""

    parameters: Parameters
    switch: str
    """The pilot's: `low`, `middle`, `high`."""

    @property
    def armed(self) -> bool: ...
    def say(self, severity: Severity, text: str) -> None: ...


class GainSwitch:
    """The script since the last boot."""

    def __init__(self, carrier: Carrier) -> None:
        self._carrier = carrier
        self._parameters = parameters = carrier.parameters
        self._flying = self._was_low = self._told = False
        self._set: tuple[float, ...] | None = None
        self._until_look_s = 0.0
        self._beside = self._values(OLD)
        crc = parameters["TPG_ACTIVE"]
        if crc and crc != _crc(self._values(NEW)):
            self._put("TPG_ACTIVE", 0.0)
            self._tell(Severity.WARNING, f"set {int(crc):06x} is damaged, and forgotten")
        elif crc:
            self._set = self._values(NEW)

    def pass_by(self, seconds: float) -> None:
        """So much time has passed."""
        self._until_look_s -= seconds
        if self._until_look_s <= 0:
            self._until_look_s += PERIOD_S
            self._look(self._carrier.switch)

    def _look(self, position: str) -> None:
        wanted = self._parameters["TPG_COMMIT"]
        if wanted:
            self._take(wanted)
            self._put("TPG_COMMIT", 0.0)
        option = self._parameters["TPG_FUNC"]
        there = any(self._parameters[f"RC{n}_OPTION"] == option for n in CHANNELS)
        if there and position == LOW:
            self._was_low = True
        if not there or position != HIGH or self._set is None:
            self._fly_old()
            self._told = False
        elif not self._flying and not self._told:
            self._told = True
            self._fly_new(self._set)

    def _fly_new(self, new: tuple[float, ...]) -> None:
        if not self._was_low:
            self._tell(Severity.WARNING, "switch was not low since the commit: old set flies")
        elif self._values(FLOWN) != self._beside:
            self._tell(Severity.WARNING, "gains are others than at the commit: nothing is switched")
        else:
            self._fly(new)
            self._flying = True
            self._put("TPG_FLIES", 1.0)
            self._tell(Severity.INFO, "new set flies")

    def _fly_old(self) -> None:
        if self._flying:
            self._fly(self._beside)
            self._flying = False
            self._put("TPG_FLIES", 0.0)
            self._tell(Severity.INFO, "old set flies")

    def _take(self, wanted: float) -> None:
        if self._carrier.armed:
            self._tell(Severity.WARNING, "commit refused: armed")
            return
        self._fly_old()
        self._was_low = self._told = False
        new = self._values(NEW)
        if wanted == -1:
            self._set = None
            self._put("TPG_ACTIVE", 0.0)
            self._tell(Severity.INFO, "no new set")
        elif wanted != _crc(new):
            self._tell(Severity.WARNING, f"commit refused: CRC {int(wanted):06x}, new set {_crc(new):06x}")
        else:
            self._set, self._beside = new, self._values(FLOWN)
            for name, value in zip(OLD, self._beside, strict=True):
                self._put(name, value)
            self._put("TPG_ACTIVE", float(_crc(new)))
            self._tell(Severity.INFO, f"set {_crc(new):06x} is behind the switch")

    def _values(self, names: tuple[str, ...]) -> tuple[float, ...]:
        return tuple(self._parameters[name] for name in names)

    def _fly(self, values: tuple[float, ...]) -> None:
        for name, value in zip(FLOWN, values, strict=True):
            self._parameters.put(name, value, saved=False)

    def _put(self, name: str, value: float) -> None:
        self._parameters.put(name, value, saved=name != "TPG_FLIES")

    def _tell(self, severity: Severity, text: str) -> None:
        self._carrier.say(severity, f"tippath gains: {text}")


def _crc(values: tuple[float, ...]) -> int:
    return zlib.crc32(struct.pack("<8f", *values)) & 0xFFFFFF
