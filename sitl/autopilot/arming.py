"""What a stock autopilot asks before it arms: an attitude that has settled, and a log that can be written."""

from __future__ import annotations

from sitl.autopilot.clothes import Clothes
from sitl.autopilot.parameters import Parameters
from sitl.autopilot.recording import Recording

_ALL, _LOGGING = 1 << 0, 1 << 10  # bits of ARMING_CHECK


def refusal(clothes: Clothes, parameters: Parameters, recording: Recording, since_boot_s: float) -> str | None:
    """Why the vehicle does not arm, as its text says it, or None."""
    if since_boot_s < clothes.boots_for_s:
        return "PreArm: AHRS: EKF3 still initialising"
    if clothes.checks_logging and int(parameters["ARMING_CHECK"]) & (_ALL | _LOGGING) and recording.refuses_arming:
        return "PreArm: Logging failed"
    return None
