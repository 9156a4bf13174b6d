"""Which of a vehicle's parameters a model and its gains stand on: where one of them is another, neither is proved.

Names alone; who compares them is `gcs.flight.identified`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final, Literal

Group = Literal["vehicle", "gains", "filters", "loop rate", "rotor speed", "controls"]
_PATTERNS: Final[dict[Group, str]] = {
    "vehicle": r"SYSID_THISMAV|MAV_SYSID|BRD_SERIAL_NUM|FRAME_CLASS|FRAME_TYPE|H_SW_TYPE",
    "filters": r"INS_GYRO_FILTER|INS_HNTC[H2]_(ENABLE|MODE|FREQ|BW|ATT|HMNCS)|FILT\d_\w+|"
    r"ATC_RAT_(RLL|PIT)_(FLT[TED]|NTF|NEF)",
    "gains": r"ATC_RAT_(RLL|PIT)_(P|I|D|FF|D_FF|IMAX|ILMI|PDMX|SMAX)|ATC_ANG_(RLL|PIT)_P",
    "loop rate": r"SCHED_LOOP_RATE|FSTRATE_ENABLE",
    "rotor speed": r"H_RSC_(MODE|SETPOINT|GOV_RPM)",
    "controls": r"H_SW_(PHANG|H3_PHANG)|H_CYC_MAX|MOT_(THST_EXPO|SPIN_MIN|SPIN_MAX|BAT_VOLT_MAX|BAT_VOLT_MIN)|"
    r"SERVO[1-4]_(MIN|MAX|REVERSED|FUNCTION)",
}
SYSTEM: Final = ("SYSID_THISMAV", "MAV_SYSID")
"""Two names of one parameter: the vehicle's own system id."""
_GROUP_OF: Final[dict[Group, re.Pattern[str]]] = {name: re.compile(text) for name, text in _PATTERNS.items()}


def group_of(name: str) -> Group | None:
    """What a parameter means for a model; None where it means nothing."""
    return next((group for group, pattern in _GROUP_OF.items() if pattern.fullmatch(name)), None)


def standing_on(parameters: Mapping[str, float]) -> dict[str, float]:
    """Of all that a vehicle has, what a model and its gains stand on."""
    return {name: value for name, value in parameters.items() if group_of(name) is not None}


SIMULATORS: Final = ("SIM_", "SIDX_")
"""How names begin that only simulated vehicles have: ArduPilot's own simulator, and the one that comes along."""


def is_simulated(names: Iterable[str]) -> bool:
    """Whether a vehicle with parameters of these names flies in a computer."""
    return any(name.startswith(SIMULATORS) for name in names)
