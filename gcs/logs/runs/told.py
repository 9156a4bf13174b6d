"""Maneuvers that a log tells of in words or by the flight mode, without the settings that SIDS and SIDD hold.

Telemetry and text logs have ArduPilot's mode 25 and its texts; other autopilots say in texts when an excitation starts
and ends. They tell of the entry and the end; between them the excitation itself shows start, stop and band
(`gcs.logs.runs.excited`), where the commands are logged fast enough.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from gcs.logs.formats.tables import Log
from gcs.logs.runs.span import Span
from gcs.logs.runs.systemid import AXES, LEAD_S, RATE_AXES, other_axis
from gcs.vehicle.autopilots import SAYS, SYSTEMID

SAME_S = 2.0
"""Between a mode's change and the text about it; telemetry tells of modes once a second."""
OTHER_VEHICLES = ("ArduPlane", "ArduRover", "ArduSub", "APM:Plane", "APM:Rover", "ArduBoat")
"""Their mode 25 is another."""
SHORTEST_S = 1.0

_WHAT = r"(?:system ?id|sys[_ ]?id|chirp|sweep|doublet|3211|excitation)"
_STARTS = re.compile(rf"\b{_WHAT}\w*\b.*\b(?:start\w*|begin\w*|activ\w+|running|on)\b", re.I)
_ENDS = re.compile(
    rf"\b{_WHAT}\w*\b.*\b(?:finish\w*|done|end\w*|stop\w*|complete\w*|abort\w*|inactiv\w*|deactiv\w*|off|error)\b", re.I
)
_FINISHED = re.compile(r"finish|done|complete|\boff\b|inactiv|deactiv", re.I)
_NUMBER = re.compile(r"\baxis\s*[=: ]\s*(\d+)", re.I)
_WORD = re.compile(r"\b(roll|pitch|elevator)\b", re.I)


@dataclass(frozen=True, kw_only=True)
class _Told:
    """An excitation of which the log tells."""

    t: float
    stop_s: float
    lead_s: float
    axis: str | None = None
    number: int | None = None
    """ArduPilot's SID_AXIS."""
    maneuver: str = "chirp"
    ended: str = ""
    """The text that ended it, if another than that it finished."""


def find(log: Log, shown: Sequence[Span] = ()) -> list[Span]:
    """The maneuvers that modes and texts tell of, in order of time; `shown` are those that the excitation shows."""
    spans: list[Span] = []
    for told in _all(log):
        inside = [span for span in shown if told.t - SAME_S <= (span.start_s + span.stop_s) / 2 <= told.stop_s + SAME_S]
        spans += [_refined(told, span, log.kind == "dataflash") for span in inside] or [_alone(told)]
    spans.sort(key=lambda span: span.start_s)
    return [replace(span, last_s=min(span.last_s, after.start_s)) for span, after in pairwise([*spans, _beyond()])]


def _beyond() -> Span:
    return Span(start_s=math.inf, stop_s=math.inf, first_s=math.inf, last_s=math.inf)


def _refined(told: _Told, shown: Span, prompt: bool) -> Span:
    """Where the excitation shows it, but within what was told; telemetry tells late, a vehicle's own log at once."""
    earliest = told.t + told.lead_s if prompt else told.t - SAME_S
    start, stop = max(shown.start_s, earliest), min(shown.stop_s, told.stop_s + (0.0 if prompt else SAME_S))
    axis = told.axis or shown.axis
    return replace(
        shown,
        start_s=start,
        stop_s=max(start, stop),
        first_s=min(start, told.t),
        last_s=max(stop, told.stop_s),
        axis=axis,
        excites_command=told.number not in RATE_AXES,
        notes=(*shown.notes, *_notes(told)),
        entered_s=told.t,
    )


def _alone(told: _Told) -> Span:
    start = min(told.t + told.lead_s, told.stop_s)
    note = "start and end as the log's modes and texts tell them; band not known: the log has no settings"
    return Span(
        start_s=start,
        stop_s=told.stop_s,
        first_s=told.t,
        last_s=told.stop_s,
        maneuver=told.maneuver,
        axis=told.axis,
        excites_command=told.number not in RATE_AXES,
        notes=(note, *_notes(told)),
        entered_s=told.t,
    )


def _notes(told: _Told) -> list[str]:
    notes = [f"the vehicle ended it: {told.ended}"] if told.ended else []
    if told.number is not None and told.number not in AXES:
        notes.append(other_axis(told.number))
    return notes


def _all(log: Log) -> list[_Told]:
    """Texts and modes about the same excitation become one."""
    by_text = _in_texts(log.texts())
    excitations: list[_Told] = []
    for mode in _in_modes(log):
        about = [text for text in by_text if mode.t - SAME_S <= text.t <= mode.stop_s]
        for text in about:
            by_text.remove(text)
        if not about:
            excitations.append(mode)
        for text in about:
            later = [other.t for other in about if other.t > text.t]
            excitations.append(replace(text, stop_s=min(text.stop_s, mode.stop_s, *later)))
    excitations += by_text
    excitations.sort(key=lambda told: told.t)
    return [told for told in excitations if told.stop_s - told.t >= SHORTEST_S]


def _in_modes(log: Log) -> list[_Told]:
    """Stretches in ArduPilot's mode SYSTEMID."""
    if log.kind not in ("dataflash", "tlog"):
        return []
    if any(text.startswith(OTHER_VEHICLES) for _, text in log.texts()):
        return []
    stretches: list[_Told] = []
    entered: float | None = None
    for t, mode in log.modes():
        if mode == SYSTEMID:
            entered = t if entered is None else entered
        elif entered is not None:
            stretches.append(_Told(t=entered, stop_s=t, lead_s=LEAD_S))
            entered = None
    if entered is not None:
        stretches.append(_Told(t=entered, stop_s=math.inf, lead_s=LEAD_S))
    return stretches


def _in_texts(texts: Sequence[tuple[float, str]]) -> list[_Told]:
    """From each text that an excitation starts to the next about one."""
    ended: list[_Told] = []
    running: _Told | None = None
    for t, text in texts:
        starts, ends = _STARTS.search(text) is not None, _ENDS.search(text) is not None
        if running is not None and (starts or ends):
            as_planned = starts or _FINISHED.search(text) is not None
            ended.append(replace(running, stop_s=t, ended="" if as_planned else text))
            running = None
        if starts and not ends:
            running = _started(t, text)
    return ended if running is None else [*ended, running]


def _started(t: float, text: str) -> _Told:
    ardupilot = text.startswith(SAYS)
    number = _NUMBER.search(text) if ardupilot else None
    word = _WORD.search(text)
    named = word[1].lower() if word else None
    return _Told(
        t=t,
        stop_s=math.inf,
        lead_s=LEAD_S if ardupilot else 0.0,
        axis=named if number is None else AXES.get(int(number[1])),
        number=None if number is None else int(number[1]),
        maneuver="doublet" if re.search("doublet|3211", text, re.I) else "chirp",
    )
