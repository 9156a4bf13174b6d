"""How lively a flight is: rotor speed, airspeed, yaw and collective may move far more than a calm flight needs.

Some effects show only where such a thing moves. A condition is a matter of the flight, not of the vehicle: it can be
flown with and without an effect, and by itself it changes no answer of p and q to the cyclic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Condition:
    """The defaults are the calm flight: what the plants do by themselves."""

    collective: float = 0.01
    """Standard deviation of the collective about hover, of full command."""
    collective_pole: float = 0.99
    """Of its wander at 100 Hz: a corner near 0.16 Hz."""
    yaw: float = 0.0
    """Standard deviation of the pilot's yaw command to the tip propellers."""
    rpm: tuple[float, float] | None = None
    """The pilot steps the governor between these; None leaves the rotor speed to the plant."""
    airspeed: tuple[float, float] | None = None
    """m/s, wandering between; None leaves it to the plant. Forward flight only."""


CALM = Condition()

# 300 of 1650 RPM: between the lowest speed at which the paper's vehicle hovered and its motor's end.
RPM_BOUNDS = (1450.0, 1750.0)
_RPM = replace(CALM, rpm=RPM_BOUNDS)
# From just above the stall to a shallow dive.
_AIRSPEED = replace(CALM, airspeed=(13.0, 24.0))
# A pilot who turns the nose to and fro: r of 0.4 to 0.5 rad/s.
_YAW = replace(CALM, yaw=0.30)
# A pilot who works the height.
_COLLECTIVE = replace(CALM, collective=0.06, collective_pole=0.95)
_STIRRING = replace(_COLLECTIVE, yaw=_YAW.yaw)
_LIVELY = replace(_STIRRING, rpm=_RPM.rpm, airspeed=_AIRSPEED.airspeed)

CONDITIONS = {
    "calm": CALM,
    "rpm": _RPM,
    "airspeed": _AIRSPEED,
    "yaw": _YAW,
    "collective": _COLLECTIVE,
    "stirring": _STIRRING,
    "lively": _LIVELY,
}
"""By name; `stirring` is yaw and collective, `lively` is everything at once."""


def named_condition(name: str, rpm: float | None = None) -> Condition:
    """The condition of that name; with `rpm` the governor holds that rotor speed throughout.

    Raises ValueError for an unknown name, and for a speed at which this rotor carries nothing or bursts.
    """
    if name not in CONDITIONS:
        raise ValueError(f"unknown condition {name!r}; there are {', '.join(CONDITIONS)}")
    if rpm is None:
        return CONDITIONS[name]
    if not RPM_BOUNDS[0] <= rpm <= RPM_BOUNDS[1]:
        raise ValueError(f"the rotor turns at {RPM_BOUNDS[0]:g} to {RPM_BOUNDS[1]:g} RPM, not at {rpm:g}")
    return replace(CONDITIONS[name], rpm=(rpm, rpm))
