"""What is left of a fit's error, and what it could do, in one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.analysis.text.hidden import up_to

if TYPE_CHECKING:
    from gcs.analysis.diagnosis import Slight
    from sysid.diagnose.matters import Remainder


def remainder_sentence(left: Remainder) -> str:
    """`what is left, seen or not, could change at most 0.1 points of fit, margins by 0.6 dB, 1.0° (at worst servo_lag
    up to tau_s = 0.4 ms): it does not matter (below 1 dB, 5°)`."""
    done = [f"at most {left.within_points:.2g} points of fit"]
    told = [one for one in (left.seen, left.margins) if one is not None]
    if told:
        gain, phase = max(one.gain_db for one in told), max(one.phase_deg for one in told)
        done.append(f"margins by {gain:.1f} dB, {phase:.1f}°")
    if left.mode_by is not None:
        done.append(f"modes by {left.mode_hz:.2g} Hz, damping by {left.mode_damping:.2g}")
    worst = left.margins_by or left.mode_by
    named = "" if worst is None else f" (at worst {worst.effect} {up_to(worst)})"
    return f"what is left, seen or not, could change {', '.join(done)}{named}: {_matter(left)}"


def slight_sentence(found: Slight) -> str:
    """`it gains 0.2 points of fit only, and moves margins by 0.1 dB, 0.4°: it hardly matters (below 1 dB, 5°)`."""
    gain = f"it gains {found.points:.1f} points of fit only"
    if found.change is None:
        moved = f"moves no number of the model by more than {100 * found.shift:.0f} %"
        return f"{gain}, and {moved}; no loop is designed on it that tells whether that matters"
    limit = f"{found.limit.gain_db:g} dB, {found.limit.phase_deg:g}°"
    matters = f"it could matter (from {limit})" if found.matters else f"it hardly matters (below {limit})"
    return f"{gain}, and moves margins by {found.change.gain_db:.1f} dB, {found.change.phase_deg:.1f}°: {matters}"


def trace_sentence(found: Slight) -> str:
    """`servo_lag is faintly seen: it gains ...`, beside what is complete."""
    return f"{found.effect} is faintly seen: {slight_sentence(found)}"


def _matter(left: Remainder) -> str:
    limit = f"{left.limit.gain_db:g} dB, {left.limit.phase_deg:g}°"
    if left.matters is None:
        return "no loop is designed on it that tells whether that matters"
    return f"it could matter (from {limit})" if left.matters else f"it does not matter (below {limit})"
