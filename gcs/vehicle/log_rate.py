"""What a log that is slower than the vehicle's loop is good for."""

from __future__ import annotations

SAMPLES_OF_A_PERIOD = 10.0
"""Of the highest frequency swept: fewer, and the hold between them is a large part of the phase."""
SLOWER = 0.8
"""Share of the loop's rate; a log that misses a few samples is not slow."""
ENOUGH_BUFFER = 50
"""LOG_MAV_BUFSIZE with which a link drops nothing; above 53 it overflows."""
EVERY_LOOP = 1
"""The bit of LOG_BITMASK that logs the rates in every control loop."""
LARGER_BUFFER = f"set LOG_MAV_BUFSIZE to {ENOUGH_BUFFER}"
LOG_EVERY_LOOP = "LOG_BITMASK bit 0 (ATTITUDE_FAST) logs every loop"


def slower_than_loop(rate_hz: float, loop_hz: float) -> str:
    """What it means that a log has `rate_hz` of a loop's `loop_hz`."""
    wider = (loop_hz / rate_hz) ** 0.5  # so many fewer samples average the noise
    return (
        f"logged at {rate_hz:.0f} Hz, the vehicle's loop runs at {loop_hz:.0f}: enough for a sweep to "
        f"{rate_hz / SAMPLES_OF_A_PERIOD:.0f} Hz, with error bounds up to {wider:.1f} times as wide"
    )
