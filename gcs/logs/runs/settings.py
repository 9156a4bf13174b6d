"""Chirps by settings that do not stand where SIDS would: the vehicle's parameters in the log, or flight.json.

A log that lost SIDS still has the parameters that the chirp was flown by, and the folder of a flight the card's run and
what was set for it. Either tells the chirp's law; the command must show it, or nothing is rebuilt.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import Log
from gcs.logs.runs.run import Run
from gcs.logs.runs.span import Known, Span
from gcs.logs.runs.systemid import AXES, LEAD_S, RATE_AXES
from sysid.data.chirp import LETTERS, Chirp, Law, placed, with_excitation
from sysid.data.record import Record

ENTERED_WITHIN_S = 0.5
"""What the time of an entry, as modes and texts tell it, may be off."""
SHOWN_WITHIN_S = 5.0
"""And what the excitation alone shows of a start."""
NUMBERS = ("SID_MAGNITUDE", "SID_F_START_HZ", "SID_F_STOP_HZ", "SID_T_REC")
FADES = ("SID_T_FADE_IN", "SID_T_FADE_OUT")


def by_parameters(parameters: Mapping[str, Any]) -> Chirp | None:
    """ArduPilot's chirp by SID_AXIS and the others; None where not all are there, or they add to no cyclic command."""
    number, *values = (_number(parameters.get(name)) for name in ("SID_AXIS", *NUMBERS))
    if number is None or int(number) in RATE_AXES or None in values:
        return None
    amplitude, low, high, duration_s = (value or 0.0 for value in values)
    fades = [_number(parameters.get(name)) or 0.0 for name in FADES]
    chirp = Chirp(
        axis=AXES.get(int(number), ""),
        law="ardupilot",
        f_start_hz=low,
        f_stop_hz=high,
        duration_s=duration_s,
        amplitude=amplitude,
        fade_in_s=fades[0],
        fade_out_s=fades[1],
    )
    return chirp if amplitude > 0 and chirp.makes_sense else None


def by_maneuver(maneuver: Mapping[str, Any], law: Law) -> Chirp | None:
    """The chirp of a card's run, as flight.json has it; None where it is another maneuver, or of a rate."""
    wanted = ("amplitude", "f_start_hz", "f_stop_hz", "duration_s", "c1", "fade_in_s", "fade_out_s")
    if maneuver.get("kind") != "chirp" or maneuver.get("target", "command") != "command":
        return None
    numbers = {name: value for name in wanted if (value := _number(maneuver.get(name))) is not None}
    if len(numbers) < len(wanted):
        return None
    chirp = Chirp(axis=str(maneuver.get("axis")), law=law, **numbers)
    return chirp if numbers["amplitude"] > 0 and chirp.makes_sense else None


def with_laws(log: Log, spans: Sequence[Span]) -> list[Span]:
    """Maneuvers of which modes, texts or the excitation tell, with the law that the log's parameters give theirs."""
    return [_with_law(log, span) if isinstance(log, DataFlashTables) else span for span in spans]


def _with_law(log: DataFlashTables, span: Span) -> Span:
    if span.law is not None or span.maneuver not in ("chirp", "unknown") or not span.excites_command:
        return span
    chirp = by_parameters(log.parameters(span.start_s))
    if chirp is None or (span.axis is not None and span.axis != chirp.axis):
        return span
    if span.entered_s is None:
        return replace(span, law=Known(chirp, SHOWN_WITHIN_S, "PARM"))
    start_s = span.entered_s + LEAD_S
    return replace(
        span,
        start_s=start_s,
        stop_s=max(start_s, min(start_s + chirp.duration_s, span.last_s)),
        axis=chirp.axis,
        swept_band_hz=(chirp.f_start_hz, chirp.f_stop_hz),
        track=None,
        planned_s=chirp.duration_s,
        law=Known(replace(chirp, flown_s=max(0.0, span.last_s - start_s)), ENTERED_WITHIN_S, "PARM"),
    )


def with_settings(run: Run, entry: Mapping[str, Any]) -> Run:
    """A run, the same as this one of a flight.json, with the excitation that was flown; as it is where that is known,
    or its command does not show it."""
    record = run.record
    if record is None or run.maneuver != "chirp" or any(name.startswith("excitation_") for name in record.channels):
        return run
    start_s = run.start_s if run.entered_s is None else run.entered_s + LEAD_S
    within_s = ENTERED_WITHIN_S + (_number(entry.get("log_start_within_s")) or 0.0)
    shares = [(_share(record, chirp, start_s, within_s), chirp) for chirp in _chirps(entry)]
    if not shares:
        return run
    share, chirp = max(shares, key=lambda one: one[0])
    if (run.axis is not None and run.axis != chirp.axis) or share <= 0:
        return run
    rebuilt = with_excitation(record, chirp, start_s, within_s, "flight.json")
    return run if rebuilt is None else replace(run, record=rebuilt, notes=(*run.notes, rebuilt.notes[-1]))


def _chirps(entry: Mapping[str, Any]) -> Iterator[Chirp]:
    """By what was set, and by the card; which of two laws the vehicle flies shows in its command."""
    parameters, maneuver = entry.get("parameters"), entry.get("maneuver")
    made = [by_parameters(parameters) if isinstance(parameters, Mapping) else None]
    if isinstance(maneuver, Mapping):
        made += [by_maneuver(maneuver, "tischler"), by_maneuver(maneuver, "ardupilot")]
    return (chirp for chirp in made if chirp is not None)


def _share(record: Record, chirp: Chirp, start_s: float, within_s: float) -> float:
    command = record.channels.get(f"delta_{LETTERS[chirp.axis]}")
    place = None if command is None else placed(chirp, record.t, command, start_s, within_s)
    return 0.0 if place is None else place.share


def _number(value: Any) -> float | None:
    """None where it is none."""
    told = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if told else None
