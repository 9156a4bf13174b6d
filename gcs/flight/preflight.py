"""What is looked at before a maneuver may start, each with its answer in words.

Pure: it is given what is known and says what follows. A check that fails blocks the flight; one that cannot be made
says so. The pilot arms, takes off and flies; here it is only looked whether he has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs.cards.envelope import Limits
from gcs.flight.live import LiveWindow
from gcs.flight.log_health import SWEEP_RECORD_BYTES, LogHealth
from gcs.link.clock import LOST_AFTER_S
from gcs.vehicle.autopilots import (
    IN_THE_AIR,
    LEAN_LIMIT,
    LOG_BACKEND,
    LOG_BITMASK,
    LOG_TO_MAVLINK,
    SWITCH,
    lean_limit_deg,
    mode_name,
    state_trouble,
)
from gcs.vehicle.profile import Plan, VehicleProfile
from gcs.vehicle.readiness import LEAST_NEED, log_need, streams_log, tells_of_log, too_slow
from gcs.vehicle.snapshot import VehicleSnapshot

LAG_LIMIT_S = 0.5
"""A link that is later is not started on, and ends a run."""
LOG_RATE = 300_000
"""Bytes a second of ArduPilot's whole fast log; a vehicle that logs less needs less."""
SPARE_BYTES = 200_000_000
LEVEL = math.radians(10.0)
CALM = 0.3
"""rad/s, deviation of p and q in hover."""
CENTRED = 0.25
"""Of full command: more trim leaves too little room on one side."""
LOW_BATTERY = 0.25
EMPTY_BATTERY = 0.05
AGAIN = ", then fly this again"


@dataclass(frozen=True, slots=True)
class Check:
    """One thing looked at."""

    name: str
    words: str
    ok: bool = True
    """False blocks the flight."""


def flying(snapshot: VehicleSnapshot, profile: VehicleProfile | None) -> tuple[Check, ...]:
    """Whether the pilot has the vehicle in the air, in a mode from which a maneuver of this profile may start."""
    checks = [
        Check("link", f"heard {snapshot.link_age_s:.1f} s ago", True)
        if not snapshot.lost
        else Check("link", f"nothing heard for {snapshot.link_age_s:.1f} s", False)
    ]
    trouble = state_trouble(snapshot.status)
    if trouble:
        checks.append(Check("state", f"nothing is started: {trouble}", False))
    if not snapshot.armed:
        checks.append(Check("in the air", f"not armed: the pilot arms and takes off{AGAIN}", False))
    elif trouble:
        checks.append(Check("in the air", "armed; in this state the vehicle does not tell whether it flies"))
    elif snapshot.status != IN_THE_AIR:
        checks.append(Check("in the air", f"armed, but not in the air: the pilot takes off{AGAIN}", False))
    else:
        checks.append(Check("in the air", "armed and in the air"))
    if profile is not None:
        checks.append(_mode(snapshot, profile))
    if snapshot.battery_remaining is not None or snapshot.battery_v is not None:
        checks.append(_battery(snapshot))
    if snapshot.other_stations:
        checks.append(Check("stations", f"{snapshot.other_stations} other ground station(s) on this link"))
    return tuple(checks)


def _battery(snapshot: VehicleSnapshot) -> Check:
    """What is left, and what to do where that is too little."""
    volts = "" if snapshot.battery_v is None else f"{snapshot.battery_v:.1f} V"
    left = "" if snapshot.battery_remaining is None else f" {100 * snapshot.battery_remaining:.0f} %"
    told = (volts + left).strip()
    if snapshot.battery_remaining is None or snapshot.battery_remaining >= LOW_BATTERY:
        return Check("battery", told)
    empty = "empty" if snapshot.battery_remaining < EMPTY_BATTERY else "low"
    return Check("battery", f"{empty} ({told}): {'land and ' if snapshot.armed else ''}change it", False)


def _mode(snapshot: VehicleSnapshot, profile: VehicleProfile) -> Check:
    manual = profile.manual_throttle_modes
    names = " or ".join(mode_name(mode, snapshot.vehicle_type, snapshot.autopilot) for mode in manual)
    if snapshot.mode == profile.excitation_mode:
        return Check("mode", f"{snapshot.mode_name}: an excitation is on already; `tippath abort` ends it", False)
    if snapshot.mode not in manual:
        return Check("mode", f"{snapshot.mode_name}: a sweep needs {names}; the pilot chooses it", False)
    return Check("mode", snapshot.mode_name)


def lag(snapshot: VehicleSnapshot) -> tuple[Check, ...]:
    """Whether orders reach the vehicle, and what is seen of it is not old. Both must be known."""
    if snapshot.lag_s is None:
        words = (
            "the vehicle is heard but answers nothing (no TIMESYNC): a link that carries one way only, or a vehicle "
            "that accepts signed messages only"
        )
        return (Check("lag", words, False),)
    if snapshot.answer_age_s > LOST_AFTER_S:
        return (
            Check("lag", f"the vehicle is heard, but has answered nothing for {snapshot.answer_age_s:.0f} s", False),
        )
    late = snapshot.lag_s > LAG_LIMIT_S
    words = f"{snapshot.lag_s:.2f} s"
    if late:
        words += f": an abort would come too late (at most {LAG_LIMIT_S:g} s); use a faster link, or stream less"
    return (Check("lag", words, not late),)


def lean_stop(parameters: Mapping[str, float]) -> Check:
    """Beyond which lean the vehicle ends a sweep by itself, whatever becomes of the link."""
    degrees = lean_limit_deg(parameters)
    if degrees is None:
        words = f"the vehicle does not tell at which lean it ends a sweep by itself (no {LEAN_LIMIT})"
    else:
        words = f"the vehicle ends a sweep by itself beyond {degrees:.0f}° ({LEAN_LIMIT})"
    return Check("lean stop", words)


def controller(lqr_switch: float | None) -> tuple[Check, ...]:
    """Whether the LQR is there to follow a commanded rate. `lqr_switch` is None where there is no such switch."""
    if lqr_switch is None:
        return (Check("controller", f"the vehicle does not tell which one follows the rates (no {SWITCH})"),)
    if lqr_switch != 1:
        words = f"the LQR is not selected ({SWITCH} is 0): the pilot switches it on, then fly this again"
        return (Check("controller", words, False),)
    return (Check("controller", "the pilot's switch selects the LQR"),)


def streamed(settings: Mapping[str, float], carries: float | None = None) -> tuple[Check, ...]:
    """Whether the vehicle sends its log at all, as far as it tells, over a link that carries so many bytes a second at
    most (None: its kind does not tell): known before anything is armed."""
    if too_slow(settings, carries):
        need = (log_need(settings) or LEAST_NEED) / 1e3
        words = (
            f"the link carries {(carries or 0.0) / 1e3:.1f} kB/s and the log needs about {need:.0f}: orders would wait "
            "behind it; use a faster link (USB, UDP), or let the vehicle keep its log on its card "
            f"({LOG_BACKEND} 1) and fly `tippath sweep --log card`"
        )
        return (Check("log rate", words, False),)
    if not tells_of_log(settings) or streams_log(settings):
        return ()
    return (Check("log", f"the vehicle keeps its log to itself: {LOG_TO_MAVLINK}", False),)


def recording(
    before: VehicleSnapshot, now: VehicleSnapshot, disk_free: int | None, duration_s: float
) -> tuple[Check, ...]:
    """Whether the log arrives (blocks came between two snapshots) and fits on the disk."""
    came = now.blocks_received - before.blocks_received
    checks = []
    if now.recording_problem is not None:
        checks.append(Check("log", now.recording_problem, False))
    elif came <= 0:
        checks.append(
            Check(
                "log",
                f"no log blocks arrive: {LOG_TO_MAVLINK}",
                False,
            )
        )
    else:
        checks.append(Check("log", f"arrives: {now.blocks_received} blocks, {now.blocks_open} open"))
    return (*checks, disk(disk_free, round(LOG_RATE * duration_s) + SPARE_BYTES))


def disk(free: int | None, needed: int) -> Check:
    """Whether so many bytes are free; None where the system does not tell."""
    if free is None:
        return Check("disk", "the system does not tell how much is free")
    words = f"{_size(free)} free"
    return Check("disk", words if free > needed else f"{words}, {_size(needed)} needed: make room", free > needed)


def carried(health: LogHealth | None, loop_hz: float | None) -> tuple[Check, ...]:
    """Whether the link carries what the vehicle logs: what does not arrive now is missing later."""
    counted = None if health is None else health.capacity
    if counted is None:
        return (Check("log rate", "not known: too little of the log came to count it", False),)
    needed, sweep = counted.needed / 1e3, SWEEP_RECORD_BYTES * (loop_hz or 0.0) / 1e3
    more = f" (a sweep adds {sweep:.0f})" if sweep else ""
    if counted.enough:
        return (Check("log rate", f"{counted.carried / 1e3:.0f} kB/s arrive of the {needed:.0f} that it needs{more}"),)
    words = (
        f"the link carries {counted.carried / 1e3:.1f} kB/s and the log needs {needed:.0f}{more}: "
        f"use a faster link (USB, UDP), let the vehicle log less ({LOG_BITMASK}), or take the log from its card "
        "afterwards (`tippath sweep --log card`)"
    )
    return (Check("log rate", words, False),)


def hover(
    snapshot: VehicleSnapshot, window: LiveWindow, plans: Sequence[Plan], limits: Limits, *, telemetry: bool = False
) -> tuple[Check, ...]:
    """Whether it hovers quietly, with room for the amplitudes planned. `window` holds the last seconds of the log, or
    of telemetry, which tells no commands and so no trim."""
    checks = []
    if snapshot.roll is not None and snapshot.pitch is not None:
        lean = max(abs(snapshot.roll), abs(snapshot.pitch))
        steep = lean > LEVEL
        words = f"{math.degrees(lean):.0f}° lean"
        checks.append(Check("attitude", words + (": hover level first" if steep else ""), not steep))
    if window.t.size < (10 if telemetry else 100):
        checks.append(Check("trim", "not known: no samples of the log yet"))
        return tuple(checks)
    spread = float(max(window.p.std(), window.q.std()))
    checks.append(
        Check("rates", f"vary by {spread:.2f} rad/s" + (": not a quiet hover" if spread > CALM else ""), spread <= CALM)
    )
    if telemetry:
        return (
            *checks,
            Check("trim", "not known by telemetry: the pilot trims the swashplate, with room for the card"),
        )
    amplitude = max((plan.maneuver.amplitude for plan in plans if plan.maneuver.target == "command"), default=0.0)
    trims = (float(window.delta_x.mean()), float(window.delta_y.mean()))
    trim = max(map(abs, trims))
    words = f"delta_x {trims[0]:+.2f}, delta_y {trims[1]:+.2f}"
    if trim > CENTRED:
        checks.append(Check("trim", f"{words}: trim the swashplate first", False))
    elif trim + amplitude > limits.command:
        checks.append(
            Check("trim", f"{words}: with amplitude {amplitude:g} beyond the limit {limits.command:g}", False)
        )
    else:
        checks.append(Check("trim", words))
    return tuple(checks)


def _size(count: int) -> str:
    return f"{count / 1e9:.1f} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"
