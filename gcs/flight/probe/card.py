"""What a probe flies: a small step on each axis of its card."""

from __future__ import annotations

from gcs.cards.maneuver import Maneuver, TestCard
from gcs.flight.probe.values import LETTERS
from gcs.vehicle.profile import VehicleProfile

QUIET_S = 5.0
"""How much hover before the first step is read."""
FRACTION = 0.2
"""Of the card's amplitude."""
LEAST_AMPLITUDE = 0.002
"""Of full command: less is within the resolution of a servo. Never more than the card's own."""
PULSE_S = 0.5
DOUBLET_S = 6.0
"""Two doublets of half-second pulses, each with two seconds of rest."""
CHIRP_S = 5.0
CHIRP_HZ = (1.0, 2.0)
REST_S = 2.0


def probe_card(card: TestCard, profile: VehicleProfile, fraction: float = FRACTION) -> TestCard:
    """The small runs that a probe flies, one for each axis whose command the card excites, in the card's order.

    A doublet where the vehicle flies them, else a short narrow chirp; `fraction` of the card's largest amplitude on
    that axis. No maneuvers where the card excites no command or the vehicle has none of its axes.
    """
    largest: dict[str, float] = {}
    for maneuver in card.maneuvers:
        if (
            maneuver.kind != "quiet"
            and maneuver.target == "command"
            and maneuver.axis in profile.axes
            and maneuver.axis in LETTERS
        ):
            largest[maneuver.axis] = max(largest.get(maneuver.axis, 0.0), maneuver.amplitude)
    doublets = "doublet" in profile.kinds
    maneuvers = tuple(
        _small(axis, min(amplitude, max(LEAST_AMPLITUDE, fraction * amplitude)), doublets)
        for axis, amplitude in largest.items()
    )
    return TestCard(
        name=f"probe of {card.name}",
        maneuvers=maneuvers,
        description="a small step on each axis",
        rest_s=REST_S,
        limits=card.limits,
    )


def _small(axis: str, amplitude: float, doublet: bool) -> Maneuver:
    if doublet:
        return Maneuver(
            kind="doublet", axis=axis, amplitude=amplitude, duration_s=DOUBLET_S, pulse_s=PULSE_S, purpose="build-up"
        )
    low, high = CHIRP_HZ
    return Maneuver(
        kind="chirp",
        axis=axis,
        amplitude=amplitude,
        duration_s=CHIRP_S,
        f_start_hz=low,
        f_stop_hz=high,
        purpose="build-up",
    )
