"""The line that is always visible: link, mode and who commands it, armed and in the air, battery, rotor, and F12.

Where it does not fit, what matters least goes first; the abort key never goes. Colours repeat what a word or a shape
says already.
"""

from __future__ import annotations

import math

from rich.cells import cell_len
from textual.content import Content, Span

from gcs.flight.preflight import LAG_LIMIT_S, LOW_BATTERY
from gcs.link.clock import LOST_AFTER_S
from gcs.link.decode import sanitise
from gcs.tui.field_words import minutes
from gcs.tui.pressing import pressed
from gcs.tui.state import Replaying, Stage, State
from gcs.tui.words import fitted, justified
from gcs.vehicle.autopilots import BY_ITSELF, SYSTEMID
from gcs.vehicle.snapshot import VehicleSnapshot

ABORT = "F12 ABORT"
SOON_LOW = 0.4
"""Of the battery: from here on it is marked."""
CELLS = 4
"""Of the battery's bar."""
LEVELS = 7
"""In so many steps the line gives way."""
Part = tuple[str, str]
"""Text and style."""


def top_line(state: State, width: int) -> Content:
    """The line at any width."""
    room = width - len(ABORT) - 2
    if room < 1:
        return Content.assemble(pressed(ABORT[:width], "app.abort", "bold reverse"))
    alarm = state.vehicle is None or state.lost or late(state.vehicle)
    style = "bold reverse" if alarm else "bold"
    parts: list[Part] = []
    for level in range(LEVELS):
        parts = _parts(state, level)
        text = " " + "  ".join(text for text, _ in parts)
        if cell_len(text) <= room:
            break
    line = justified(text, ABORT + " ", width)[: -len(ABORT) - 1]
    spans = [Span(0, len(line), style)]
    at = 1
    for part, colour in parts:
        if colour and at < len(line):
            spans.append(Span(at, min(at + len(part), len(line)), colour))
        at += len(part) + 2
    return Content.assemble(Content(line, spans=spans), pressed(ABORT, "app.abort", "bold reverse"), (" ", style))


def who(state: State) -> str:
    """Who commands the vehicle's mode, as far as can be told."""
    vehicle = state.vehicle
    assert vehicle is not None
    if vehicle.lost:
        return "last heard"
    if vehicle.mode == SYSTEMID:
        return "tippath" if state.stage in (Stage.FLYING, Stage.ABORTING) else "excitation"
    return "autopilot" if vehicle.mode in BY_ITSELF else "pilot"


def _parts(state: State, level: int) -> list[Part]:
    vehicle = state.vehicle
    if state.replay is not None:
        return _replay(state, state.replay, level)
    if vehicle is None:
        return [("NO VEHICLE", ""), (fitted(state.link, 40), "")]
    if vehicle.lost:
        link = f"LINK LOST {_age(vehicle.link_age_s)}"
    else:
        link = f"LINK {vehicle.link_age_s:.1f}{_lag(vehicle, level)}"
    commands = who(state)
    mode = f"{sanitise(vehicle.mode_name)} ({commands})"
    colour = {"tippath": "$text-success", "excitation": "$text-error", "autopilot": "$text-warning"}.get(commands, "")
    parts = [(link, ""), (mode if level >= 1 else f"MODE {mode}", colour)]
    parts += _controller(state, level)
    parts.append(_armed(state, vehicle, level))
    if level >= 6:
        return parts
    rotor = _rotor(state, vehicle, level)
    return [*parts, *([(rotor, "")] if rotor else []), battery_part(vehicle, level)]


def _replay(state: State, replay: Replaying, level: int) -> list[Part]:
    """Loudly: what is seen is over, and nothing can be sent."""
    goes = "PAUSED" if replay.paused else f"{replay.speed:g}x"
    parts = [("REPLAY", "reverse"), (fitted(sanitise(replay.name), 30 if level < 2 else 12), ""), (goes, "")]
    parts.append((f"{minutes(replay.at_s)} of {minutes(replay.of_s)}", ""))
    vehicle = state.vehicle
    if vehicle is not None and level < 3:
        parts += [(vehicle.mode_name, ""), *([(_rotor(state, vehicle, 3), "")] if vehicle.rpm is not None else [])]
    return parts


def _armed(state: State, vehicle: VehicleSnapshot, level: int) -> Part:
    """Armed or not, with the time in the air behind it."""
    text, colour = ("ARMED", "$text-warning") if vehicle.armed else ("disarmed", "")
    if state.air_s is None or (level >= 3 and not vehicle.armed):
        return text, colour
    at_least = "" if state.air_known else ">"
    return f"{text}{'  AIR' if level < 1 else ''} {at_least}{minutes(state.air_s)}", colour


def _controller(state: State, level: int) -> list[Part]:
    """Whether the LQR flies, where there is one to fly."""
    bank = state.bank
    if bank is None or not bank.active or bank.switch_on is None:
        return []
    if bank.switch_on:
        return [("LQR ON", "$text-accent")]
    return [("LQR off", "")] if level < 3 else []


def _rotor(state: State, vehicle: VehicleSnapshot, level: int) -> str:
    if level >= 4:
        return ""
    rpm = "RPM ?" if vehicle.rpm is None else f"RPM {vehicle.rpm:.0f}"
    if vehicle.rpm is not None and state.rpm_reference and level < 3:
        rpm += f" {100 * (vehicle.rpm / state.rpm_reference - 1):+.1f} %"
    return rpm


def battery_part(vehicle: VehicleSnapshot, level: int = 0) -> Part:
    """Volts, what is left as bar and percent, and LOW where it is too low to fly on."""
    volts = "?" if vehicle.battery_v is None else f"{vehicle.battery_v:.1f} V"
    left = vehicle.battery_remaining
    if left is None:
        return f"BAT {volts}", ""
    full = max(0, min(CELLS, math.ceil(CELLS * left)))
    shape = "▓" * full + "░" * (CELLS - full)
    words = [f"{100 * left:.0f} %", *(["LOW"] if left < LOW_BATTERY else [])]
    text = " ".join(words if level >= 5 else [shape, *words])
    colour = "$text-error" if left < LOW_BATTERY else "$text-warning" if left < SOON_LOW else "$text-success"
    return (f"BAT {volts} {text}" if level < 2 else f"BAT {text}"), colour


def _lag(vehicle: VehicleSnapshot, level: int) -> str:
    """How late the link is, behind its age: in full where there is room, or where it is too late to fly on."""
    if deaf(vehicle):
        return " s NO ANSWER"
    if vehicle.lag_s is None:
        return " s"
    if vehicle.lag_s > LAG_LIMIT_S:
        return f" s LATE {vehicle.lag_s:.1f} s"
    return f" s lag {vehicle.lag_s:.2f} s" if level < 1 else f"|{vehicle.lag_s:.1f}"


def deaf(vehicle: VehicleSnapshot) -> bool:
    """Whether it is heard, has answered before, and does so no more."""
    return not vehicle.lost and vehicle.lag_s is not None and vehicle.answer_age_s > LOST_AFTER_S


def late(vehicle: VehicleSnapshot) -> bool:
    """Whether orders come too late, or not at all."""
    return deaf(vehicle) or (vehicle.lag_s is not None and vehicle.lag_s > LAG_LIMIT_S)


def _age(age_s: float) -> str:
    return "" if math.isinf(age_s) else f"{age_s:.1f} s" if age_s < 60 else f"{age_s / 60:.0f} min"
