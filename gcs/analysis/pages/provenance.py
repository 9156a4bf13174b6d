"""Where a page's numbers come from: the flight, its runs and notes; logs with their hashes; settings; what was done."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs.analysis.identified import identified, simulated
from gcs.analysis.pages.parts import Facts, Part, Sentences, Table
from gcs.analysis.quantities import listed
from gcs.analysis.rungs import KeptFit
from gcs.analysis.text.blocks import Sentence, whole
from gcs.analysis.text.session import session_blocks
from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder
from gcs.flight.session_notes import told_session
from gcs.logs.words import printable
from gcs.vehicle.autopilots import rotorcraft
from sysid.data.record import Record
from sysid.fit.result import Fit

ABOUT = ("pilot", "place", "weather", "mass", "blades", "started", "ended", "card", "outcome")
"""Of flight.json, in this order, where it has them."""
VEHICLE = (("profile", "", ""), ("version", "version ", ""), ("system", "system ", ""))
"""Of its vehicle: the key, and what stands before and behind the value."""
AT_FIRST = (("battery_v", "battery ", " V"), ("rotor_rpm", "rotor ", " 1/min"))
"""When the card began."""
MOST_LINES = 80
"""Of the audit."""
LONGEST = 300
"""Characters of one value."""
TIME = re.compile(r"^(\d{4}-\d\d-\d\d)T(\d\d:\d\d)\S*$")


def flight_facts(folder: FlightFolder) -> tuple[tuple[str, str], ...]:
    """What flight.json tells of the flight and its vehicle; nothing where there is none."""
    about = _about(folder)
    told = about.get("vehicle")
    vehicle = told if isinstance(told, dict) else {}
    kind = vehicle.get("type")
    words = [rotorcraft(kind) if isinstance(kind, int) else ""]
    words += [f"{before}{said}{behind}" for name, before, behind in VEHICLE if (said := _said(vehicle.get(name)))]
    first = [f"{before}{said}{behind}" for name, before, behind in AT_FIRST if (said := _said(vehicle.get(name)))]
    facts = [("vehicle", ", ".join(filter(None, words))), ("at the start", ", ".join(first))]
    facts += [(name, _said(about.get(name))) for name in ABOUT]
    return tuple((name, said) for name, said in facts if said)


def flown_when(folder: FlightFolder) -> str:
    """`2026-05-04 12:30`, UTC; empty where flight.json does not tell."""
    started = _about(folder).get("started")
    return printable(started)[:16].replace("T", " ") if isinstance(started, str) else ""


def title_of(folder: FlightFolder, records: Sequence[Record]) -> str:
    """The name that its user gave the flight, else what flew what, and when: `Simulated helicopter, card hover,
    2026-05-04`."""
    if folder.name:
        return printable(folder.name)
    kind = next((str(one.airframe) for one in records if one.airframe is not None), "vehicle")
    paths = dict.fromkeys(Path(one.path) for one in records if one.path)
    vehicle = f"simulated {kind}" if simulated(paths) else kind
    card = _said(_about(folder).get("card"))
    told = [vehicle, f"card {card}" if card else _maneuvers(records), flown_when(folder)[:10]]
    title = ", ".join(filter(None, told))
    return title[:1].upper() + title[1:]


def about_of(folder: FlightFolder, records: Sequence[Record], models: Sequence[str]) -> str:
    """One line: when, of which runs, by which models."""
    when = flown_when(folder)
    logs = sorted({Path(one.path).name for one in records})
    runs = f"{len(records)} run{'s' if len(records) != 1 else ''} of {', '.join(logs)}"
    return printable(", ".join([*([f"flown {when} UTC"] if when else []), runs, *models]))


def _maneuvers(records: Sequence[Record]) -> str:
    """`roll and pitch chirps`, where all are of one kind; of an unknown one the logs' names."""
    kinds = {one.maneuver for one in records}
    axes = [axis for axis in dict.fromkeys(one.axis for one in records) if axis]
    if kinds == {"unknown"} or len(kinds) != 1 or not axes:
        return listed([printable(name) for name in dict.fromkeys(Path(one.path).name for one in records)])
    return f"{listed(axes)} {kinds.pop()}{'s' if len(records) > 1 else ''}"


def flight_parts(folder: FlightFolder) -> list[Part]:
    """The flight as it went: facts, what people said of it, verdicts."""
    parts: list[Part] = []
    facts = flight_facts(folder)
    if facts:
        parts.append(Facts(facts))
    for block in session_blocks(told_session(_about(folder))):
        first, *others = (whole(line) if isinstance(line, Sentence) else line for line in block.lines)
        parts.append(Sentences((f"{first[:1].upper()}{first[1:]}",)))
        parts += [Sentences(tuple(others), listed=True)] if others else []
    try:
        flown = folder.runs()
    except TippathError:
        flown = []
    if flown:
        parts.append(Sentences(tuple(_verdict(run) for run in flown), listed=True))
    return parts


def _verdict(run: Mapping[str, Any]) -> str:
    """`roll chirp 1/2: fly again: gust`."""
    verdict = run.get("verdict")
    reasons = verdict.get("reasons") if isinstance(verdict, dict) else None
    kept = isinstance(verdict, dict) and verdict.get("keep") is True
    why = "; ".join(map(str, reasons)) if isinstance(reasons, list) and reasons else str(run.get("reason", ""))
    return printable(f"{run.get('label', '')}: {'keep' if kept else f'fly again: {why}'}")


def runs_table(fit: Fit, records: Mapping[tuple[str, str], Record]) -> Table:
    """Each run with what it was used for."""
    rows = []
    for used, which in (("fitted", fit.records), ("validation", fit.validation)):
        for one in which:
            flown = records.get((one.path, one.id))
            begins = "" if flown is None or not flown.t.size else f"{float(flown.t[0]):.1f}"
            loop = "" if one.loop_rate_hz is None else f"{one.loop_rate_hz:.0f}"
            cells = (f"{one.duration_s:.1f}", f"{one.rate_hz:.0f}", loop, f"{one.samples}", f"{len(one.gaps)}")
            rows.append((printable(one.id), f"{one.axis or ''} {one.maneuver}".strip(), used, begins, *cells))
    return Table(
        "Runs, with the time in the log at which they begin, sample rate and the rate of the vehicle's loop.",
        ("run", "maneuver", "used", "from, s", "length, s", "rate, Hz", "loop, Hz", "samples", "gaps"),
        tuple(rows),
        words=(0, 1, 2),
    )


def source_parts(kept: KeptFit, folder: FlightFolder, files: Sequence[Path], version: str) -> list[Part]:
    """Versions, settings of the fit and of the vehicle, hashes of logs, and what was done."""
    fit = kept.fit
    logs = {one.path: one.sha256 for one in (*fit.records, *fit.validation)}
    hashes = Table(
        "Logs.",
        ("log", "SHA-256"),
        tuple((printable(Path(path).name), digest) for path, digest in logs.items()),
        words=(0, 1),
    )
    parts: list[Part] = [Facts(_settings(fit, files, version)), hashes]
    known = identified(fit)
    facts = []
    if known.battery_v is not None:
        facts.append(("battery in the runs", f"{known.battery_v[0]:.1f} to {known.battery_v[1]:.1f} V"))
    if known.rotor_rpm is not None:
        facts.append(("rotor in the runs", f"{known.rotor_rpm[0]:.0f} to {known.rotor_rpm[1]:.0f} 1/min"))
    if known.parameters:
        each = (f"{name} {value:g}" for name, value in known.parameters.items() if math.isfinite(value))
        facts.append(("vehicle's settings", printable(", ".join(each))))
    if known.changed:
        facts.append(("changed between runs", printable(", ".join(known.changed))))
    return [*parts, *([Facts(tuple(facts))] if facts else []), *audit_parts(folder)]


def _settings(fit: Fit, files: Sequence[Path], version: str) -> tuple[tuple[str, str], ...]:
    window = fit.window_s
    ends = "" if window is None else " to ".join("the end" if end is None else f"{end:g} s" for end in window)
    told = [
        ("tippath", version),
        ("fits", ", ".join(path.name for path in files)),
        ("band", f"{fit.band_hz[0]:g} to {fit.band_hz[1]:g} Hz"),
        ("weights over frequency", fit.weights),
        ("instrument", fit.instrument or ""),
        ("held", ", ".join(fit.fixed)),
        ("log profile", "" if fit.profile is None else Path(fit.profile).name),
        ("window", ends),
        ("airframe", fit.airframe or ""),
    ]
    return tuple((name, printable(str(said))) for name, said in told if said)


def audit_parts(folder: FlightFolder) -> list[Part]:
    """What was done, oldest first; the newest lines where there are many."""
    try:
        entries, damaged = folder.audited()
    except TippathError as error:
        return [Sentences((printable(str(error)),))]
    entries = [one for one in entries if not (one.command or "").startswith("tippath report ")]  # the same page again
    if not entries:
        return []
    rows = [
        (
            printable(one.time)[:19].replace("T", " "),
            printable(one.did)[:LONGEST],
            printable(one.command or "")[:LONGEST],
        )
        for one in entries[-MOST_LINES:]
    ]
    left = len(entries) - len(rows)
    more = f" The {left} before these are in {folder.audit_file.name}." if left else ""
    cut = f" {damaged} lines of it are damaged." if damaged else ""
    caption = f"What was done, UTC, and the command that does it again.{more}{cut}"
    return [Table(caption, ("time", "did", "command"), tuple(rows), words=(0, 1, 2))]


def _about(folder: FlightFolder) -> dict[str, Any]:
    try:
        return folder.read()
    except TippathError:
        return {}


def _said(value: Any) -> str:
    """Words and numbers; nothing of what is neither."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        return ""
    text = printable(f"{value:.4g}" if isinstance(value, float) else str(value))[:LONGEST]
    return TIME.sub(r"\1 \2", text)
