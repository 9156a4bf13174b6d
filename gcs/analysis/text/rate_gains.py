"""Gains of an ArduPilot's rate loops for people: old and new, and what each set holds."""

from __future__ import annotations

from gcs.analysis.clearance import Clearance
from gcs.analysis.quantities import amount_in
from gcs.analysis.rate_gains import ArdupilotGains
from gcs.analysis.text.blocks import wrapped
from gcs.analysis.text.clearance import clearance_text
from gcs.analysis.text.gains import measured_text
from gcs.logs.runs.rate_loop import FLOAT32_PERCENT
from sysid.control.rate_gains import MOST
from sysid.model.structure import Model

CHANGED = 1e-3
"""Of a gain: less is the parameter file's rounding."""


def rate_gains_text(gains: ArdupilotGains, vehicle: Model) -> str:
    """All of it, in 78 columns."""
    asked, gyro_hz = gains.gains.asked, gains.gains.flown.gyro_corner_hz
    lines = [
        f"rate loops of an ArduPilot {'helicopter' if gains.loops.helicopter else 'multicopter'} at "
        f"{gains.loops.loop_hz:g} Hz on {vehicle.structure.title}",
        f"  {'parameter':20} {'flown':>10} {'new':>10}",
        *(f"  {name:20} {old:10.4g} {new:10.4g}" for name, (old, new) in gains.changes.items()),
        *_judged("flown", gains.flown),
        *_judged("new", gains.new),
    ]
    said = [
        f"Asked: {asked.gain_db:g} dB, {asked.phase_deg:g}°, {asked.delay_ms:.0f} ms, no disturbance raised by more "
        f"than {asked.peak_db:.1f} dB, no gain above {MOST:g} times the flown one, on every model above and over the "
        "bounds; answers are to steps of the rate. Filters, angle gains and limits stay.",
        *(
            f"{axis}: {amount_in('rad/s', one.rate_per_command, one.error)} per full command, so that the feed-forward "
            f"would be {1 / one.rate_per_command:.3g}; "
            + (
                f"taken, to {MOST:g} times the flown one at most"
                if one.taken
                else "left, because rates would overshoot"
            )
            for axis, one in gains.feed_forward.items()
        ),
        *([] if _better(gains) else ["No gains near the flown ones reject more within what is asked: they stay."]),
        _repeated(gains),
        *([f"The gyro filter of {gyro_hz:g} Hz is in the loop."] if gyro_hz else []),
        *(f"The model has it as it was in this flight: {what}" for what in gains.loops.in_the_vehicle),
        "Small motion: limits, the slew limit and what the pilot's inputs are shaped by are not in it. Load the file "
        "on the ground, disarmed; keep the old one.",
    ]
    return "\n".join([*lines, *(line for text in said for line in wrapped(text))])


def _judged(which: str, found: Clearance) -> list[str]:
    measured = found.judgement.measured
    margins = found.judgement.models[0].loop.margins
    return [
        f"{which}:",
        *clearance_text(found).splitlines(),
        *([] if measured is None else measured_text(measured, margins).splitlines()),
    ]


def _better(gains: ArdupilotGains) -> bool:
    return any(abs(new - old) > CHANGED * abs(old) for old, new in gains.changes.values())


def _repeated(gains: ArdupilotGains) -> str:
    worst = max(gains.repeated, key=lambda one: one.residual_percent)
    size = "to rounding" if worst.residual_percent < FLOAT32_PERCENT else f"but for {worst.residual_percent:.1f} %"
    causes = f" ({'; '.join(worst.causes)})" if worst.causes else ""
    return f"These loops repeat the commands that the vehicle logged {size}{causes}."
