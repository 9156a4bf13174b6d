"""The parameter table, and the two banks of LQR gains that one write switches over.

Values are float32 as on the wire (C cast), so what is echoed is what is flown. As on ArduPilot there is no range
check, and a value that is not finite or a name that does not exist gets no answer. A refused write is answered with
the old value.

A set of gains arrives value by value in the shadow bank and is flown only as a whole: writing its CRC to LQR_COMMIT
makes it the active bank. Both switching parameters read 0 at all other times, so that a refusal (echo 0) differs from
a success even where the same CRC is written twice. On a lossy link a client repeats a write whose echo it missed:
a repeated commit of the bank that is active already, and a repeated revert with no other parameter traffic in
between, are answered as done and change nothing.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

_FLOAT32 = struct.Struct("<f")


class Kind(IntEnum):
    """MAV_PARAM_TYPE, the four that ArduPilot uses."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


_LIMITS = {Kind.INT8: 2**7, Kind.INT16: 2**15, Kind.INT32: 2**31}


@dataclass(frozen=True)
class Parameter:
    name: str
    """At most 16 characters."""
    default: float
    kind: Kind
    read_only: bool = False


BANK_ORDER = (
    *("K11", "K12", "K13", "K14", "K21", "K22", "K23", "K24"),
    *("L11", "L12", "L21", "L22", "L31", "L32", "L41", "L42"),
    *("G11", "G12", "G21", "G22"),
    *("L_B", "M_A", "TAU_F", "A_B", "B_A", "A_LAT", "A_LON", "B_LAT", "B_LON"),
)
"""What the 29 values of a bank are called after LQS_ or LQR_, in the order of the CRC."""
BANK_MORE = (
    *("K31", "K32", "K33", "K34", "G31", "G32", "L_P", "M_Q", "M_ELEV"),
    *("W1", "W2", "Z1", "Z2"),
    *("F11", "F12", "F13", "F14", "F21", "F22", "F23", "F24", "F31", "F32", "F33", "F34"),
)
"""And 25 behind them, of the elevator and of the prefilter's models: not in the CRC where all are 0."""

_SHADOW = tuple("LQS_" + name for name in (*BANK_ORDER, *BANK_MORE))
_ACTIVE = tuple("LQR_" + name for name in (*BANK_ORDER, *BANK_MORE))

HIDDEN_WITHOUT_AXIS = frozenset(
    {"SID_MAGNITUDE", "SID_F_START_HZ", "SID_F_STOP_HZ", "SID_T_FADE_IN", "SID_T_REC", "SID_T_FADE_OUT"}
)
"""Left out of the list while SID_AXIS is 0, as on ArduPilot; by name they always answer."""

_ALIASES = {"MAV_SYSID": "SYSID_THISMAV", "MAV_GCS_SYSID": "SYSID_MYGCS"}
"""ArduPilot renamed these in 4.7; a ground station may know either name."""

TABLE = (
    Parameter("SYSID_THISMAV", 1, Kind.INT16, read_only=True),
    Parameter("SYSID_MYGCS", 255, Kind.INT16),
    Parameter("MAV_SYSID", 1, Kind.INT16, read_only=True),
    Parameter("MAV_GCS_SYSID", 255, Kind.INT16),
    Parameter("FRAME_CLASS", 6, Kind.INT8, read_only=True),
    Parameter("SCHED_LOOP_RATE", 500, Kind.INT16, read_only=True),
    # RATE and SIDD carry the gyro as measured: nothing filters it on board.
    Parameter("INS_GYRO_FILTER", 0, Kind.INT16, read_only=True),
    Parameter("ANGLE_MAX", 3000, Kind.INT16),
    Parameter("FS_GCS_ENABLE", 1, Kind.INT8),
    Parameter("FS_GCS_TIMEOUT", 5, Kind.REAL32),
    Parameter("FS_OPTIONS", 0, Kind.INT32),
    # The simulated pilot's transmitter never fails, so this one is only there to be read.
    Parameter("FS_THR_ENABLE", 1, Kind.INT8),
    Parameter("H_RSC_MODE", 4, Kind.INT8, read_only=True),
    Parameter("H_RSC_GOV_RPM", 0, Kind.INT16, read_only=True),
    Parameter("H_RSC_RUNUP_TIME", 2, Kind.INT8, read_only=True),
    Parameter("LOG_BACKEND_TYPE", 3, Kind.INT8),
    Parameter("LOG_DISARMED", 0, Kind.INT8),
    Parameter("LOG_MAV_BUFSIZE", 1024, Kind.INT16),
    Parameter("SID_AXIS", 0, Kind.INT8),
    Parameter("SID_MAGNITUDE", 0.05, Kind.REAL32),
    Parameter("SID_F_START_HZ", 0.5, Kind.REAL32),
    Parameter("SID_F_STOP_HZ", 10, Kind.REAL32),
    Parameter("SID_T_FADE_IN", 5, Kind.REAL32),
    Parameter("SID_T_REC", 60, Kind.REAL32),
    Parameter("SID_T_FADE_OUT", 2, Kind.REAL32),
    Parameter("SIDX_KIND", 0, Kind.INT8),
    Parameter("SIDX_LAW", 0, Kind.INT8),
    Parameter("SIDX_C1", 4, Kind.REAL32),
    Parameter("SIDX_NOISE", 0.2, Kind.REAL32),
    Parameter("SIDX_PULSE_S", 0.3, Kind.REAL32),
    Parameter("SIDX_SEED", 0, Kind.INT32),
    *(Parameter(name, 0, Kind.REAL32) for name in _SHADOW),
    *(Parameter(name, 0, Kind.REAL32, read_only=True) for name in _ACTIVE),
    Parameter("LQR_COMMIT", 0, Kind.INT32),
    Parameter("LQR_REVERT", 0, Kind.INT8),
    Parameter("LQR_ACTIVE", 0, Kind.INT32, read_only=True),
    Parameter("LQR_SW", 0, Kind.INT8, read_only=True),
)


@dataclass(frozen=True)
class Answer:
    """What a write leads to."""

    name: str
    value: float
    """Echoed to the ground."""
    kind: Kind
    text: str | None = None
    """Why it was refused, where the reason is worth a STATUSTEXT."""
    bank_changed: bool = False
    """The active bank is another one now."""


def float32(value: float) -> float:
    """The nearest float32; beyond its range infinity, as a C cast gives."""
    try:
        rounded: float = _FLOAT32.unpack(_FLOAT32.pack(value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)
    return rounded


def cast(kind: Kind, value: float) -> float:
    """A finite value as the vehicle stores it: integers truncated, and held within their type."""
    if kind is Kind.REAL32:
        return float32(value)
    limit = _LIMITS[kind]
    # The hundredth keeps 2.9999998, a whole number that went through float32 arithmetic, from becoming 2.
    whole = int(value + math.copysign(0.01, value))
    return float32(max(-limit, min(limit - 1, whole)))


def bank_crc(values: Sequence[float]) -> int:
    """24 bits of the CRC-32 over the values as little-endian float32: a float32 parameter carries them exactly."""
    return zlib.crc32(struct.pack(f"<{len(values)}f", *values)) & 0xFFFFFF


_LOOP_RATES = (50.0, 1000.0)  # Hz; ArduPilot holds SCHED_LOOP_RATE within limits, too


def period_us(loop_rate_hz: float) -> int:
    """Of one loop, for a value of SCHED_LOOP_RATE."""
    low, high = _LOOP_RATES
    return round(1e6 / max(low, min(high, loop_rate_hz)))


class Parameters:
    """All parameters with their present values."""

    def __init__(
        self,
        check_bank: Callable[[Sequence[float]], object],
        defaults: Mapping[str, float] | None = None,
        *,
        table: Sequence[Parameter] = TABLE,
        after_reboot: Collection[str] = (),
    ) -> None:
        """`check_bank` raises ValueError with a reason where a bank cannot be flown.

        `defaults` replaces defaults of the table. Raises KeyError for a name that is not in it. What is written to a
        name of `after_reboot` acts only when the vehicle has booted again.
        """
        self._check_bank = check_bank
        self._after_reboot = frozenset(after_reboot)
        self.table = {parameter.name: parameter for parameter in table}
        self._aliases = {
            name: old if old in self.table else new for new, old in _ALIASES.items() for name in (new, old)
        }
        for name, value in (defaults or {}).items():
            self.table[name] = replace(self.table[name], default=cast(self.table[name].kind, value))
        self._values = {parameter.name: float32(parameter.default) for parameter in self.table.values()}
        self.writes = 0
        """Counts every write that may have changed something, for whoever holds values derived from them."""
        self.stored: Callable[[str, float], float | None] = lambda name, value: value
        """What becomes of a value that is written; None refuses it. For faults."""
        self._previous: tuple[float, ...] | None = None
        self._just_reverted = False
        self.boot()

    def __getitem__(self, name: str) -> float:
        return self._values[self._aliases.get(name, name)]

    def boot(self) -> None:
        """The vehicle starts: what was written until now acts."""
        self._booted = {name: self._values[name] for name in self._after_reboot}

    def acting(self, name: str) -> float:
        """The value that the vehicle goes by; a newer one may wait for a reboot."""
        return self._booted[name] if name in self._booted else self[name]

    def __contains__(self, name: str) -> bool:
        return name in self.table

    @property
    def count(self) -> int:
        """How many are in the list at present."""
        return len(self._visible())

    def visible(self) -> tuple[str, ...]:
        """The names in the list, by index. Their number changes with SID_AXIS."""
        self._just_reverted = False
        return self._visible()

    def _visible(self) -> tuple[str, ...]:
        if self._values["SID_AXIS"] != 0:
            return tuple(self.table)
        return tuple(name for name in self.table if name not in HIDDEN_WITHOUT_AXIS)

    def read(self, name: str) -> Answer | None:
        """What a read is answered with; None for a name that does not exist."""
        self._just_reverted = False
        if name not in self.table:
            return None
        return Answer(name, self[name], self.table[name].kind)

    def write(self, name: str, value: float, *, armed: bool) -> Answer | None:
        """What a write from the ground does and is answered with; None where there is no answer."""
        parameter = self.table.get(name)
        if parameter is None or not math.isfinite(value):
            return None
        if name == "LQR_REVERT":
            return self._revert(value, armed)
        self._just_reverted = False
        if name == "LQR_COMMIT":
            return self._commit(value, armed)
        stored = None if parameter.read_only else self.stored(name, value)
        if stored is not None:
            self.writes += 1
            self._values[self._aliases.get(name, name)] = cast(parameter.kind, stored)
        return Answer(name, self[name], parameter.kind)

    def show_switch(self, selected: bool) -> None:
        """LQR_SW follows the pilot's switch."""
        if "LQR_SW" in self._values:
            self._values["LQR_SW"] = 1.0 if selected else 0.0

    def active_bank(self) -> tuple[float, ...] | None:
        """The values that the LQR flies, 29 or with those of BANK_MORE 54, or None before the first commit."""
        return None if self._values.get("LQR_ACTIVE", 0.0) == 0 else self._bank(_ACTIVE)

    def _bank(self, names: Sequence[str]) -> tuple[float, ...]:
        values = tuple(self._values[name] for name in names)
        return values if any(values[len(BANK_ORDER) :]) else values[: len(BANK_ORDER)]

    def _activate(self, bank: Sequence[float]) -> None:
        self._values.update(dict.fromkeys(_ACTIVE, 0.0) | dict(zip(_ACTIVE, bank, strict=False)))
        self._values["LQR_ACTIVE"] = float(bank_crc(bank))

    def _commit(self, value: float, armed: bool) -> Answer:
        shadow = self._bank(_SHADOW)
        crc = bank_crc(shadow)
        reason = None
        if armed:
            reason = "armed"
        elif value != crc:
            reason = f"CRC {int(value):06x}, shadow bank {crc:06x}"
        elif shadow != self.active_bank():
            try:
                self._check_bank(shadow)
            except ValueError as error:
                reason = str(error)
        if reason is not None:
            return Answer("LQR_COMMIT", 0.0, Kind.INT32, f"LQR commit refused: {reason}")
        changed = shadow != self.active_bank()
        if changed:
            self._previous = self.active_bank()
            self._activate(shadow)
        return Answer("LQR_COMMIT", float(crc), Kind.INT32, bank_changed=changed)

    def _revert(self, value: float, armed: bool) -> Answer:
        done = Answer("LQR_REVERT", 1.0, Kind.INT8)
        if value == 1 and self._just_reverted and not armed:
            return done
        self._just_reverted = False
        if value != 1:
            return replace(done, value=0.0)
        reason = "armed" if armed else "no previous bank" if self._previous is None else None
        if reason is not None or self._previous is None:
            return replace(done, value=0.0, text=f"LQR revert refused: {reason}")
        previous, self._previous = self._previous, self.active_bank()
        self._activate(previous)
        self._just_reverted = True
        return replace(done, bank_changed=True)
