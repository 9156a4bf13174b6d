"""Gains of an ArduPilot's rate loops for people: old and new, and what each set holds."""

from __future__ import annotations

from gcs.analysis.rate_gains import Answer, ArdupilotGains
from gcs.analysis.text.blocks import wrapped
from gcs.logs.runs.rate_loop import FLOAT32_PERCENT
from gcs.vehicle.rate_loops import AXES
from sysid.control.rate_gains import MOST
from sysid.control.sampled import SampledLoop
from sysid.model.structure import Model


def rate_gains_text(gains: ArdupilotGains, vehicle: Model) -> str:
    """All of it, in 78 columns."""
    asked = gains.gains.asked
    lines = [
        f"rate loops of an ArduPilot {'helicopter' if gains.loops.helicopter else 'multicopter'} at "
        f"{gains.loops.loop_hz:g} Hz on {vehicle.structure.title}",
        f"  {'parameter':20} {'flown':>10} {'new':>10}",
        *(f"  {name:20} {old:10.4g} {new:10.4g}" for name, (old, new) in gains.changes.items()),
        *_loop("flown", gains.gains.flown_loop, gains.answers[0]),
        *_loop("new", gains.gains.new_loop, gains.answers[1]),
    ]
    said = [
        f"Asked: {asked.gain_db:g} dB, {asked.phase_deg:g}°, {asked.delay_ms:.0f} ms, no disturbance raised by more "
        f"than {asked.peak_db:.1f} dB, no gain above {MOST:g} times the flown one. Filters, angle gains and limits "
        "stay.",
        *(
            f"{axis}: {one.rate_per_command:.3g} ± {one.error:.2g} rad/s per full command, so that the feed-forward "
            f"would be {1 / one.rate_per_command:.3g}; "
            + (
                f"taken, to {MOST:g} times the flown one at most"
                if one.taken
                else "left, because rates would overshoot"
            )
            for axis, one in gains.feed_forward.items()
        ),
        _repeated(gains),
        *([f"The gyro filter of {gains.gyro_hz:g} Hz is in the loop."] if gains.gyro_hz else []),
        *(f"The model has it as it was in this flight: {what}" for what in gains.loops.in_the_vehicle),
        "Small motion: limits, the slew limit and what the pilot's inputs are shaped by are not in it. Load the file "
        "on the ground, disarmed; keep the old one.",
    ]
    return "\n".join([*lines, *(line for text in said for line in wrapped(text))])


def _loop(which: str, loop: SampledLoop, answers: tuple[Answer, Answer]) -> list[str]:
    if loop.margins is None:
        return [f"{which}: the model is not held"]
    return [
        f"{which}: {loop.margins.words}",
        f"  disturbances raised by {loop.peak_db:.1f} dB at most",
        *(
            f"  {axis:5} rejects to {hz:.2f} Hz; step: "
            + ("no rise in 2 s" if answer.rise_ms is None else f"rise {answer.rise_ms:.0f} ms")
            + f", overshoot {100 * answer.overshoot:.0f} %, other axis {100 * answer.coupling:.0f} %"
            for axis, hz, answer in zip(AXES, loop.rejection_hz, answers, strict=True)
        ),
    ]


def _repeated(gains: ArdupilotGains) -> str:
    worst = max(gains.repeated, key=lambda one: one.residual_percent)
    size = "to rounding" if worst.residual_percent < FLOAT32_PERCENT else f"but for {worst.residual_percent:.1f} %"
    causes = f" ({'; '.join(worst.causes)})" if worst.causes else ""
    return f"These loops repeat the commands that the vehicle logged {size}{causes}."
