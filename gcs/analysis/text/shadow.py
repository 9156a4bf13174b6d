"""Gains over recorded flights in words: cleared, refused, or not measured, and why."""

from __future__ import annotations

import math
from pathlib import Path

from gcs.analysis.shadow import Beside, ShadowFlight
from gcs.analysis.text.blocks import wrapped
from gcs.analysis.text.clearance import NAMES
from gcs.flight.gains import checksum
from gcs.vehicle.autopilots import RUN_BESIDE
from sysid.control.measured_margins import Crossing
from sysid.control.measured_stability import MeasuredStability, NotMeasured, Verdict
from sysid.control.shadow import FULL, Fault, FaultKind, Output, Place

VERDICTS: dict[Verdict, str] = {
    "cleared": "CLEARED: the measured loop holds these gains, with the margins asked for",
    "refused": "REFUSED: do not fly these gains",
    "not measured": "NOT MEASURED: neither cleared nor refused",
}
PLACES: dict[Place, str] = {
    "rates": "rate that the bank takes for measured",
    "commands": "command that its observer takes for sent",
    "targets": "rate that it is asked for",
    "output": "output",
}
WHOLE: dict[FaultKind, str] = {
    "own command": "its observer takes its own output for the command that was sent: feed it what the servos got",
    "no answer": "it put out nothing: is the bank committed, and does it run?",
    "other bank": "another set of gains ran: push this one, and fly again",
}
NONE_RAN = (
    "in none of these flights did the vehicle run the bank without authority: signs, scales and timing on board are "
    f"not checked; a vehicle with the bank does so with {RUN_BESIDE} 1 while the pilot's switch is off"
)


def shadow_text(found: ShadowFlight) -> str:
    """For people; 78 columns."""
    return "\n".join(line for name, words in shadow_told(found) for line in wrapped(f"{name:14}{words}", rest=" " * 14))


def shadow_told(found: ShadowFlight) -> list[tuple[str, str]]:
    """What each sentence is about, and the sentence."""
    low, high = found.band_hz
    told = [
        ("gains", f"{checksum(found.crc)} over {len(found.runs)} run{'s' if len(found.runs) > 1 else ''}, "
         f"{low:.2g} to {high:.2g} Hz; nothing of it was flown"),
        ("verdict", VERDICTS[found.verdict]),
        *(("because", words) for words in reasons(found)),
        *_measured(found.stability, found.model.structure.title),
        *((one.axis, _output(one)) for one in found.outputs),
    ]  # fmt: skip
    if not found.targets_told:
        told.append(("", "what rates were asked for is not logged: as if none had been"))
    told += [("ran beside", _ran(one)) for one in found.beside]
    if not found.beside:
        told.append(("ran beside", NONE_RAN))
    return told


def reasons(found: ShadowFlight) -> list[str]:
    """Why gains are refused, or not cleared; nothing where they are."""
    stability = found.stability
    said = []
    if stability.roots:
        said.append(f"the measured loop is UNSTABLE: {stability.roots} roots to the right")
    for one in stability.thin:
        name, unit, _ = NAMES[one.quantity]
        digits = 1 if one.quantity == "gain_db" else 0
        said.append(f"measured {name} {one.value or 0:.{digits}f}{unit} (asked {one.limit or 0:g})")
    said += [_fault(one, "these gains: ") for one in found.faults]
    for beside in found.beside:
        said += [_fault(one, f"{Path(beside.path).name}: ") for one in beside.faults]
    return said or [_not_measured(one) for one in stability.not_measured]


def _not_measured(one: NotMeasured) -> str:
    at = "" if one.frequency_hz is None else f"{one.frequency_hz:.2g} Hz"
    sweep = "sweep further" if one.sweep_to_hz is None else f"sweep to {one.sweep_to_hz:.2g} Hz"
    return {
        "axes": "the flights do not show the four responses of both axes: sweep roll and pitch, each for itself",
        "excitation": "what was added to the commands is not logged: gusts that came back through the controller are "
        "in the responses; log the excitation",
        "low": f"the model is not the vehicle's where what was measured begins ({at}), and it would have to stand "
        "below: "
        f"{sweep.replace(' to ', ' from ')} on, or fit and design on this vehicle's own flights",
        "bound": f"the response's error allows for instability at {at}: sweep longer, or with more amplitude",
        "edge": f"the loop is not small where the sweeps end ({at}), and nothing is known beyond: {sweep}",
        "near": f"a margin at {at} is nearer to its limit than its error: sweep longer, or design with more",
    }[one.why]


def _measured(found: MeasuredStability, model: str) -> list[tuple[str, str]]:
    loop = found.loop
    if loop is None:
        return []
    poles = f"{found.unstable_poles or 'no'} unstable poles in the open loop, by the model"
    count = "not counted" if found.roots is None else f"{found.roots or 'no'} roots to the right"
    low, high = float(loop.frequency_hz[0]), float(loop.frequency_hz[-1])
    told = [("Nyquist", f"{count}, measured from {low:.2g} to {high:.2g} Hz, {model} below; {poles}; the 95 % bound "
             f"reaches {100 * float(max(loop.reach)):.0f} % of the way to -1")]  # fmt: skip
    if found.margins is not None and found.roots == 0:
        each = (
            ("phase", found.margins.phase_deg, "°", 0),
            ("gain", found.margins.gain_db, " dB", 1),
            ("delay", found.margins.delay_ms, " ms", 0),
        )
        told.append(("margins", "; ".join(_margin(*one) for one in each)))
    if found.disk is not None and found.roots == 0:
        disk = found.disk
        gain = f"{disk.margin.gain_db:.1f} dB" if math.isfinite(disk.margin.gain_db) else "any gain"
        told.append(
            (
                "disk margin",
                f"{gain} or {disk.margin.phase_deg:.0f}° in both commands, each its own way; alpha "
                f"{disk.margin.size:.2f} ({disk.low:.2f} to {disk.high:.2f}) at {disk.margin.frequency_hz:.1f} Hz",
            )
        )
    return told


def _margin(name: str, one: Crossing | None, unit: str, digits: int) -> str:
    if one is None:
        return f"{name}: crosses nowhere in the band"
    return f"{name} {one.value:.{digits}f} ± {one.bound:.{digits}f}{unit} at {one.frequency_hz:.1f} Hz"


def _output(one: Output) -> str:
    return (
        f"would have commanded {one.rms:.3f} rms, at most {one.largest:.2f} of {FULL:g} (flown {one.flown_rms:.3f}); "
        f"{one.rate:.2f}/s rms, {one.largest_rate:.1f}/s at most (flown {one.flown_rate:.2f}/s rms); noise beyond the "
        f"sweeps {one.noise:.4f} (flown {one.flown_noise:.4f}); beyond full {100 * one.saturated:.1f} % of the time"
        f"{_rest(one)}; innovations {100 * one.innovation:.0f} % of the rate"
    )


def _rest(one: Output) -> str:
    return "" if one.saturated_at_rest is None else f" ({100 * one.saturated_at_rest:.1f} % while nothing was excited)"


def _ran(one: Beside) -> str:
    which = "" if one.crc is None else f", bank {checksum(one.crc)}"
    said = "differs from what these gains say" if one.faults else "as these gains say; that alone clears nothing"
    return f"{Path(one.path).name}, {one.seconds:.0f} s{which}: {said}"


def _fault(one: Fault, before: str) -> str:
    if one.kind in WHOLE:
        return before + WHOLE[one.kind]
    axis = f" of {one.axis}" if one.axis else ""
    value = one.value or 0.0
    place = "output" if one.place is None else PLACES[one.place]
    return (
        before
        + {
            "sign": f"the {place}{axis} has the wrong sign",
            "swapped": f"the {place}: roll and pitch are swapped",
            "scale": f"the {place}{axis} is {value:.3g} times too large{_degrees(value)}",
            "late": f"the {place} is {abs(1000 * value):.0f} ms {'late' if value > 0 else 'early'}",
            "other": f"{100 * value:.0f} % of its output is not what these gains say, and no sign, scale or time "
            "of one signal explains it",
            "saturates": f"the command{axis} would have been beyond full for {100 * value:.1f} % of the time, and "
            "nothing was excited",
            "innovations": f"the observer's innovations{axis} are {value:.1f} times what the other flights predict: is "
            "it the same vehicle?",
        }[one.kind]
    )


def _degrees(value: float) -> str:
    return " (degrees for radians?)" if abs(value - math.degrees(1)) < 1 or abs(value - math.radians(1)) < 1e-3 else ""
