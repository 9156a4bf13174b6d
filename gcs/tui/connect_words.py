"""Connect: where to, what is heard, what to check, as lines."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.flight.readiness import client_words
from gcs.flight.readiness_words import closing, page
from gcs.link.decode import sanitise
from gcs.link.events import RadioStatus
from gcs.link.log_answer import LogClient
from gcs.link.transport import parse_link
from gcs.tui.connections import Connection
from gcs.tui.desk_words import Line, broken
from gcs.tui.pressing import pressed
from gcs.tui.state import STARTING, Stage, State
from gcs.tui.words import connection_words, fitted, justified, sanitise_line
from gcs.vehicle.autopilots import AUTOPILOTS, KINDS, PRIMARY_SYSTEM
from gcs.vehicle.snapshot import VehicleSnapshot

TO_CHECK = {
    "udpin": (
        "is the vehicle (or MAVProxy, mavlink-router) told to send to this computer's address, port {port}?",
        "same network? does a firewall let UDP in? is another ground station on that port?",
    ),
    "udpout": ("is that the vehicle's address and port?", "does a firewall let the answer back in?"),
    "tcp": ("does something listen there? `tcp:` connects, it does not wait",),
    "serial": (
        "is the radio's other end powered, and both on one net id?",
        "is the baud rate that of SERIALn_BAUD, and SERIALn_PROTOCOL 2 (MAVLink 2)?",
    ),
}
"""Where nothing is heard, by the kind of link."""


def connection_lines(offered: Sequence[Connection], at: int, here: str, width: int, height: int) -> list[Line]:
    """The list under its headings, the marked line in sight."""
    if not offered:
        return [" this app was started on one link; q, then `tippath fly` chooses another"]
    wide = min(36, max(len(one.name) for one in offered) + 1)
    lines: list[Line] = []
    marked_at, heading = 0, ""
    for number, one in enumerate(offered):
        if one.heading != heading:
            heading = one.heading
            lines.append((f" {heading}", "bold"))
        if number == at:
            marked_at = len(lines)
        mark = "▶" if number == at else " "
        now = "(here) " if one.name == here else ""
        text = f" {mark} {fitted(sanitise(one.name), wide):<{wide}} {now}{sanitise(one.about)}"
        lines.append(pressed(fitted(text, width), f"screen.mark({number})", "reverse" if number == at else ""))
    first = max(0, min(marked_at - height // 2, len(lines) - height))
    hidden = len(lines) - height
    lines = lines[first : first + height]
    if hidden > 0:
        place = -1 if first == 0 else 0
        one_line = lines[place]
        text, style = (one_line, "") if isinstance(one_line, str) else one_line
        lines[place] = (justified(text, f"({hidden} more)", width), style)
    return lines


def list_height(offered: Sequence[Connection]) -> int:
    """Lines of the whole list, headings included."""
    return max(1, len(offered) + len({one.heading for one in offered}))


def heard_lines(state: State, width: int) -> list[Line]:
    """What is heard; or what to check, where nothing is."""
    vehicle = state.vehicle
    lines: list[Line] = [(f" link: {connection_words(state)}", "bold")]
    if state.unfinished is not None and not state.stage.under_way:
        lines.append(
            (f" {state.unfinished.name} is not flown to its end ({state.left}): 2, then C goes on with it", "bold")
        )
    if vehicle is None:
        if not state.link:
            lines.append(" no vehicle is looked for; recorded flights can be worked on (3)")
        else:
            lines += [f" heard: {state.trouble or 'nothing yet'}", *_checks(state)]
        return broken(lines, width)
    lines.append(f" vehicle: {_who(vehicle)}")
    lines.append(_heard(vehicle))
    lines.append(_stations(state, vehicle))
    if vehicle.newcomer:
        lines.append((f" {vehicle.newcomer_words}: T takes it for the vehicle", "bold"))
    if vehicle.signs:
        lines.append((" it signs what it says, and obeys only who has its key: start again with --key FILE", "bold"))
    if vehicle.radio is not None:
        lines.append(_radio(vehicle.radio))
    if vehicle.lost:
        lines += _checks(state)
    if vehicle.link_problem:
        lines.append((f" the link: {vehicle.link_problem}", "bold"))
    if state.link_loss:
        lines.append(f" {state.link_loss}")
    if vehicle.log_client is not LogClient.NOBODY:
        lines.append((f" {client_words(vehicle.log_client)}", "bold"))
    if state.stage.under_way and state.stage is not Stage.NO_VEHICLE:
        lines.append((" a card is being flown: the link stays until it is over", "bold"))
    return broken(lines, width)


def readiness_lines(state: State, width: int) -> list[Line]:
    """What was looked at, the worst first; or why nothing was."""
    found = state.readiness
    if found is None:
        waits = " the vehicle is asked; a radio takes some seconds" if state.busy else " nothing was looked at yet"
        return [waits if state.vehicle is not None else " there is no vehicle to look at: C goes back to the links"]
    lines: list[Line] = [(f" {closing(found)}", "bold")]
    if state.vehicle is not None and state.vehicle.log_client is not LogClient.NOBODY:
        lines.append(f" {client_words(state.vehicle.log_client)}")
    lines += [
        f" {sanitise_line(line)}" if line.startswith("  ") else sanitise_line(line) for line in page(found, width - 1)
    ]
    return broken(lines, width)


def _who(vehicle: VehicleSnapshot) -> str:
    autopilot = AUTOPILOTS.get(vehicle.autopilot, f"autopilot {vehicle.autopilot}")
    kind = KINDS.get(vehicle.vehicle_type, f"vehicle of type {vehicle.vehicle_type}")
    version = f" {vehicle.version}" if vehicle.version else ""
    signed = ", signed" if vehicle.signed else ""
    return f"system {vehicle.system}, {autopilot}{version}, {kind}, {vehicle.mode_name}{signed}"


def _heard(vehicle: VehicleSnapshot) -> str:
    garbled = f"{vehicle.bad_bytes:,} garbled bytes" if vehicle.bad_bytes else "no garbled bytes"
    text = f" heard: {vehicle.frames:,} messages, {garbled}"
    if vehicle.strangers:
        text += f", {vehicle.strangers:,} packets of other addresses dropped"
    if vehicle.refused:
        text += ", not believed: " + ", ".join(f"{count:,} {why}" for why, count in vehicle.refused)
    if vehicle.lag_s is not None:
        text += f"; {vehicle.lag_s:.2f} s late"
    return text


def _radio(radio: RadioStatus) -> str:
    """As it says it: other radios have other units."""
    there = f"there {radio.there}, noise {radio.noise_there}"
    return f" radio: here {radio.here}, noise {radio.noise_here}; {there}; {radio.errors:,} packets damaged on the air"


def _stations(state: State, vehicle: VehicleSnapshot) -> str:
    others = []
    if vehicle.other_stations:
        others.append(f"{vehicle.other_stations} other ground station{'s' if vehicle.other_stations > 1 else ''}")
    if vehicle.other_vehicles:
        others.append(f"{vehicle.other_vehicles} other vehicle{'s' if vehicle.other_vehicles > 1 else ''}")
    with_us = ", ".join(others) or "no other station or vehicle"
    if state.station is None:
        return f" on this link: {with_us}"
    holds = "whose heartbeat holds the failsafe" if state.station == PRIMARY_SYSTEM else "which holds no failsafe"
    return f" we are station {state.station}, {holds}; {with_us}"


def _checks(state: State) -> list[Line]:
    """What to look at, for the kind of link."""
    if state.simulated:
        waits = (
            "takes some seconds to start" if state.trouble == STARTING else "is not there: choose a line to begin again"
        )
        return [f"   the simulated vehicle {waits}"]
    link = parse_link(state.link)
    return ["   check:", *(f"   - {text.format(port=link.port)}" for text in TO_CHECK[link.kind])]
