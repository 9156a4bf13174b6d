"""The script that holds a second set of rate gains behind the pilot's switch, by the parameters that it adds.

`scripts/tippath_gains.lua` is what goes onto the vehicle's card; what it does stands in it.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from gcs.vehicle.rate_loops import AXES, name_of

SCRIPT: Final = Path(__file__).parent / "scripts" / "tippath_gains.lua"
_GAINS: Final = ("P", "I", "D", "FF")
_PLACES: Final = tuple((axis, gain) for axis in AXES for gain in _GAINS)
SET: Final = tuple(name_of(axis, gain) for axis, gain in _PLACES)
"""What a set has, in the order of its checksum."""
NEW: Final = {name_of(axis, gain): f"TPG_{AXES[axis]}_{gain}" for axis, gain in _PLACES}
"""Gain -> where its new value is written."""
COMMIT: Final = "TPG_COMMIT"
"""Written with the checksum of the new set it takes it, with `FORGET` it forgets it; 0 again when that is done."""
FORGET: Final = -1.0
ACTIVE: Final = "TPG_ACTIVE"
"""Checksum of the set behind the switch; 0: none."""
FLIES: Final = "TPG_FLIES"
"""1 while the new set flies."""
FUNC: Final = "TPG_FUNC"
"""The option of the switch's channel."""
OPTIONS: Final = tuple(f"RC{n}_OPTION" for n in range(5, 17))


def checksum(values: Sequence[float]) -> int:
    """24 bits of CRC-32 over the set as float32: as many as a parameter carries exactly. Raises OverflowError."""
    return zlib.crc32(struct.pack(f"<{len(values)}f", *values)) & 0xFFFFFF


def channel_of(options: Mapping[str, float], wanted: float) -> int | None:
    """The first channel that has the switch's option."""
    found = (int(name[2:].split("_", 1)[0]) for name, value in options.items() if value == wanted)
    return next(found, None)
