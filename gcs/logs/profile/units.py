"""Units as files write them, to the channels' own."""

from __future__ import annotations

import math

from gcs.errors import TippathError
from sysid.data.record import CHANNELS

_DEGREE = math.pi / 180
_RATE = {"rad/s": 1.0, "deg/s": _DEGREE, "dps": _DEGREE, "rpm": math.tau / 60, "hz": math.tau, "1/s": 1.0}
_RATE |= {"mrad/s": 1e-3, "rad/sec": 1.0, "deg/sec": _DEGREE}
FACTORS = {
    "s": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
    "rad/s": _RATE,
    "rad": {"rad": 1.0, "deg": _DEGREE, "mrad": 1e-3},
    "-1..1": {"-1..1": 1.0, "-": 1.0, "1": 1.0, "norm": 1.0, "%": 0.01},
    "m/s": {"m/s": 1.0, "km/h": 1 / 3.6, "kt": 1852 / 3600, "kn": 1852 / 3600, "cm/s": 0.01, "mm/s": 1e-3},
    "m/s^2": {"m/s^2": 1.0, "m/s2": 1.0, "m/s/s": 1.0, "m/s**2": 1.0, "g": 9.80665, "mg": 9.80665e-3},
}
"""Unit of a channel -> unit as written, in lower case -> factor."""


def factor(channel: str, unit: str) -> float | None:
    """What to multiply values in `unit` by to have the channel's own; None for a unit that is none of the channel's."""
    plain = unit.strip().lower().replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("²", "^2")
    plain = plain.replace(" ", "").replace("degrees", "deg").replace("radians", "rad").replace("s^-1", "/s")
    plain = plain.replace("deg//s", "deg/s").replace("rad//s", "rad/s").replace("*", "")
    known = FACTORS[CHANNELS[channel]]
    if channel in ("p", "q", "r") and plain in ("rpm", "hz"):
        return None  # a body rate in these is more likely something else
    return 1.0 if not plain else known.get(plain)


def factor_or_ask(channel: str, unit: str, where: str) -> float:
    """As `factor`. Raises TippathError that asks for a profile."""
    known = factor(channel, unit)
    if known is None:
        ours = CHANNELS[channel]
        raise TippathError(
            f"{where}: unit {unit!r} is not known for {channel}, which is in {ours}; write one of "
            f"{', '.join(FACTORS[ours])}, or give the scale in a profile: --profile FILE.toml"
        )
    return known
