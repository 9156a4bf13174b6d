"""The runs of a log: where a maneuver was flown, and the record and health of each.

A DataFlash log says it in SIDS (settings, at entry of mode SYSTEMID) and SIDD (every loop): one second of nothing, the
maneuver, then zero input until the mode is left. The run is cut by the maneuver; up to 0.5 s before and 1 s after it
are kept, for trim and for the answer to die out. Where SIDS was lost, SIDD's own clock tells the entry.
The swept band is what was flown: of a chirp that ended early, or that a window cuts, SIDD.F tells how far it came.
A log without either has no maneuver: it is one stretch, and not usable unless the user cuts it (--window, or [[runs]]
in a profile) and so vouches for what is in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs import health, profiles
from gcs.logs.profiles import Profile
from gcs.logs.tables import DataFlashTables, Log, Series
from sysid.record import Record, RecordError

FloatArray = NDArray[np.float64]
Window = tuple[float | None, float | None]

SYSTEMID = 25
LEAD_S = 1.0  # of nothing before the maneuver
KEEP_BEFORE_S = 0.5
KEEP_AFTER_S = 1.0
AXES = {7: "roll", 10: "roll", 8: "pitch", 11: "pitch", 20: "elevator"}
"""SID_AXIS of ArduPilot; 20, the elevator, is the bundled vehicle's own."""
FEW = 5
CUT_SHORT_S = 0.1  # a sweep that ends so much before its time did not reach its last frequency
RATE_AXES = (7, 8)  # the excitation is added to the rate command: it is no part of the cyclic command
KINDS = {0: "chirp", 1: "doublet", 2: "quiet"}


@dataclass(frozen=True)
class Run:
    """One flown maneuver with its data, or why there is none."""

    record: Record | None
    id: str
    """`flight.BIN#2`."""
    path: str
    maneuver: str
    axis: str | None
    start_s: float
    """Of the maneuver, in the log's own time; the record also holds a little before and after."""
    duration_s: float
    """Of the maneuver."""
    rate_hz: float | None
    gaps: tuple[tuple[float, float], ...]
    usable: bool
    reasons: tuple[str, ...]
    """Why it is not usable, and what to do; empty where it is."""
    notes: tuple[str, ...] = ()
    """What else the user should know."""
    rate_source: str | None = None
    swept_band_hz: tuple[float, float] | None = None
    """First and last frequency that were flown, where known."""
    sources: Mapping[str, str] = field(default_factory=dict)
    """Channel -> field of the log."""
    absent: Mapping[str, str] = field(default_factory=dict)
    """Channel of the profile -> why the run does not have it."""
    health: health.Health | None = None
    entered_s: float | None = None
    """When the excitation mode was entered, in the log's own time, where the log tells."""
    verdict: str | None = None
    """What the flight's own verdict has against it, see `gcs.logs.verdicts`; it is then among the reasons."""


@dataclass(frozen=True)
class Span:
    """Where a maneuver lies in a log, before its data are looked at."""

    start_s: float
    stop_s: float
    first_s: float
    """The record may begin here at the earliest..."""
    last_s: float
    """... and end here at the latest."""
    maneuver: str = "unknown"
    axis: str | None = None
    swept_band_hz: tuple[float, float] | None = None
    planned_s: float | None = None
    excites_command: bool = True
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    entered_s: float | None = None


def runs_of(
    log: Log,
    profile: Profile,
    name: str,
    sha256: str,
    window: Window | None = None,
    f_high_hz: float = health.F_HIGH_HZ,
) -> tuple[Run, ...]:
    """Every run of a log, in order of time, numbered from 1.

    Those outside the window are left out, and the others keep their numbers. A window in which no maneuver lies is
    itself one run, unknown, on the user's word. `name` is the file's name, for the ids. Raises TippathError where the
    profile makes no sense.
    """
    low, high = _ends(window)
    if profile.cuts:
        spans = [
            Span(c.start_s, c.stop_s, c.start_s, c.stop_s, c.maneuver, c.axis, c.swept_band_hz) for c in profile.cuts
        ]
    else:
        spans = find(log) if isinstance(log, DataFlashTables) else []
    numbered = [(number, span) for number, span in enumerate(spans, 1) if span.start_s <= high and span.stop_s >= low]
    if not numbered:
        reasons: tuple[str, ...] = ()
        if isinstance(log, DataFlashTables) and log.sampled_s < health.SHORTEST_PIECE_S:
            return (_empty(log, f"{name}#{len(spans) + 1}"),)
        if isinstance(log, DataFlashTables) and window is None:
            entered = log.has("MODE.ModeNum") and np.any(log.series("MODE.ModeNum").values == SYSTEMID)
            reasons = (
                "no excitation maneuver: the log has no SIDS and no SIDD, "
                + ("though mode SYSTEMID was entered" if entered else "mode SYSTEMID was never entered")
                + "; pilot and controller alone moved the commands, and their feedback cannot be told from the "
                f"vehicle: {health.SWEEP}; or name a stretch that was flown as one: --window START:STOP",
            )
        numbered = [(len(spans) + 1, Span(-math.inf, math.inf, -math.inf, math.inf, reasons=reasons))]
    return tuple(
        _run(log, profile, span, f"{name}#{number}", sha256, (low, high), f_high_hz) for number, span in numbered
    )


def _ends(window: Window | None) -> tuple[float, float]:
    start, stop = window or (None, None)
    return -math.inf if start is None else start, math.inf if stop is None else stop


def _empty(log: DataFlashTables, id: str) -> Run:
    when = f"{log.sampled_s:.2f} s after its first sample" if log.sampled_s else "before any samples"
    reason = f"the log ends {when}: fetch it from the vehicle again, whole"
    return Run(None, id, log.path, "unknown", None, 0.0, 0.0, None, (), False, (reason,))


def _run(
    log: Log,
    profile: Profile,
    span: Span,
    id: str,
    sha256: str,
    window: tuple[float, float],
    f_high_hz: float,
) -> Run:
    low = max(span.first_s, span.start_s - KEEP_BEFORE_S, window[0])
    high = min(span.last_s, span.stop_s + KEEP_AFTER_S, window[1])
    start, stop = max(span.start_s, window[0]), min(span.stop_s, window[1])
    band = _flown_band(log, span, start, stop)
    try:
        mapped = profiles.apply(profile, log, low, high)
        channels = dict(mapped.channels)
        notes = [*span.notes, *profile.notes]
        if span.maneuver in ("chirp", "doublet") and not _excitation_known(channels, span):
            for channel in [c for c in channels if c.startswith("excitation_")]:
                del channels[channel]
        if mapped.rows_dropped:
            notes.append(f"{mapped.rows_dropped} samples left out: a required channel had no value at their time")
        record = Record(
            id,
            channels,
            span.maneuver,
            span.axis,
            mapped.rate_source,
            log.path,
            sha256,
            band,
            tuple(notes),
        )
    except (TippathError, RecordError) as error:
        if log.kind == "csv":
            raise TippathError(str(error)) from error
        reasons = (*span.reasons, str(error))
        finite = math.isfinite(start) and math.isfinite(stop)
        return Run(
            None,
            id,
            log.path,
            span.maneuver,
            span.axis,
            start if finite else 0.0,
            max(0.0, stop - start) if finite else 0.0,
            None,
            (),
            False,
            reasons,
            span.notes,
            swept_band_hz=band,
            entered_s=span.entered_s,
        )
    start = start if math.isfinite(start) else float(record.t[0])
    stop = stop if math.isfinite(stop) else float(record.t[-1])
    start, stop = max(start, float(record.t[0])), min(stop, float(record.t[-1]))
    found = health.check(
        record,
        planned_s=span.planned_s if window == (-math.inf, math.inf) else None,
        maneuver_s=max(0.0, stop - start),
        slow_channels=mapped.spacing_s,
        f_high_hz=f_high_hz,
    )
    reasons = (*span.reasons, *found.reasons)
    # The record carries what was noted about it to whoever fits it.
    record = replace(record, notes=(*notes, *found.notes))
    return Run(
        record,
        id,
        log.path,
        span.maneuver,
        span.axis,
        start,
        max(0.0, stop - start),
        found.rate_hz,
        found.gaps,
        not reasons,
        reasons,
        record.notes,
        mapped.rate_source,
        band,
        {name: source for name, source in mapped.sources.items() if name in channels},
        mapped.absent,
        found,
        span.entered_s,
    )


def of_record(record: Record, window: Window | None = None, f_high_hz: float = health.F_HIGH_HZ) -> Run:
    """A record that was written before, checked again. Raises RecordError where the window leaves nothing of it."""
    if window is not None:
        record = record.window(*window)
    found = health.check(record, f_high_hz=f_high_hz)
    return Run(
        record,
        record.id,
        record.path,
        record.maneuver,
        record.axis,
        float(record.t[0]),
        record.duration_s,
        found.rate_hz,
        found.gaps,
        found.usable,
        found.reasons,
        tuple(dict.fromkeys((*record.notes, *found.notes))),
        record.rate_source,
        record.swept_band_hz,
        health=found,
    )


def _flown_band(log: Log, span: Span, start_s: float, stop_s: float) -> tuple[float, float] | None:
    """The part of the sweep that lies between two times; the plan where nothing is cut, or the log does not tell."""
    if span.swept_band_hz is None or not isinstance(log, DataFlashTables) or not log.has("SIDD.F"):
        return span.swept_band_hz
    low, high = span.swept_band_hz
    flown = log.series("SIDD.F").part(start_s, stop_s).values
    flown = np.clip(flown[np.isfinite(flown) & (flown > 0)], low, high)
    if not flown.size:
        return span.swept_band_hz
    planned_stop_s = span.stop_s if span.planned_s is None else span.start_s + span.planned_s
    # Of a few samples the middle one: a single damaged value must not make a sweep.
    first = low if start_s <= span.start_s else float(np.median(flown[:FEW]))
    last = high if stop_s >= planned_stop_s - CUT_SHORT_S else float(np.median(flown[-FEW:]))
    return first, max(first, last)


def _excitation_known(channels: Mapping[str, FloatArray], span: Span) -> bool:
    """A maneuver whose logged excitation is zero throughout was injected elsewhere than into the cyclic commands."""
    return span.excites_command and any(np.any(v) for c, v in channels.items() if c.startswith("excitation_"))


# ------------------------------------------------------------------------------------- DataFlash: SIDS, SIDD


@dataclass(frozen=True)
class _Entry:
    """One entry into mode SYSTEMID."""

    t: float
    axis: int | None = None
    band: tuple[float, float] | None = None
    duration_s: float | None = None
    lost: bool = False
    """SIDS is missing; the entry was worked out from SIDD."""


def find(log: DataFlashTables) -> list[Span]:
    """The maneuvers of a DataFlash log, in order of time."""
    sidd = log.series("SIDD.Targ") if log.has("SIDD.Targ") and log.has("SIDD.Time") else None
    entries = _entries(log, sidd)
    leaving = _leaving(log)
    texts = log.texts("MSG", "Message")
    end_of_log = _end(log)
    spans = []
    for i, entry in enumerate(entries):
        end = min(
            entries[i + 1].t if i + 1 < len(entries) else math.inf,
            next((t for t in leaving if t > entry.t), math.inf),
            end_of_log,
        )
        spans.append(_span(log, entry, end, sidd, [(t, text) for t, text in texts if entry.t <= t <= end + 0.5]))
    return spans


def _entries(log: DataFlashTables, sidd: Series | None) -> list[_Entry]:
    entries = []
    if log.has("SIDS.Ax"):
        t = log.series("SIDS.Ax").t
        columns = {c: log.series(f"SIDS.{c}").values for c in ("Ax", "FSt", "FSp", "TR") if log.has(f"SIDS.{c}")}
        for i, at in enumerate(t.tolist()):
            low, high, duration = (float(columns[c][i]) if c in columns else math.nan for c in ("FSt", "FSp", "TR"))
            entries.append(
                _Entry(
                    at,
                    int(columns["Ax"][i]),
                    (low, high) if 0 < low < high < math.inf else None,
                    duration if 0 < duration < 3600 else None,
                )
            )
    if sidd is not None:
        clock = log.series("SIDD.Time").values
        for at in _restarts(sidd.t, clock):
            if not any(abs(at - entry.t) < 1.5 for entry in entries):
                entries.append(_Entry(at, lost=True))
    return sorted(entries, key=lambda entry: entry.t)


def _restarts(t: FloatArray, clock: FloatArray) -> list[float]:
    """When SIDD.Time was zero, for each stretch in which it ran on; single damaged samples do not count."""
    begun = t - clock
    good = np.isfinite(begun)
    t, begun = t[good], begun[good]
    edges = np.concatenate(([0], np.flatnonzero(np.abs(np.diff(begun)) > 0.5) + 1, [t.size]))
    found: list[tuple[float, float]] = []  # time zero of the stretch, at its first and last sample
    for first, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if stop - first < 25:
            continue
        if found and abs(begun[first] - found[-1][1]) < 0.25:
            found[-1] = (found[-1][0], float(begun[stop - 1]))
        else:
            found.append((float(begun[first]), float(begun[stop - 1])))
    return [zero for zero, _ in found]


def _leaving(log: DataFlashTables) -> list[float]:
    """When another mode than SYSTEMID was entered."""
    if not log.has("MODE.ModeNum"):
        return []
    modes = log.series("MODE.ModeNum")
    return [float(t) for t in modes.t[modes.values != SYSTEMID]]


def _end(log: DataFlashTables) -> float:
    ends = [log.series(key).t[-1] for key in ("SIDD.Targ", "RATE.R") if log.has(key)]
    return float(max(ends, default=math.inf))


def _span(
    log: DataFlashTables, entry: _Entry, end: float, sidd: Series | None, texts: Sequence[tuple[float, str]]
) -> Span:
    notes: list[str] = []
    reasons: list[str] = []
    maneuver = "chirp"
    if log.has("SIDY.Kind"):
        kinds = log.series("SIDY.Kind")
        nearest = int(np.argmin(np.abs(kinds.t - entry.t)))
        if abs(kinds.t[nearest] - entry.t) < 0.5:
            maneuver = KINDS.get(int(kinds.values[nearest]), "unknown")
            if maneuver == "chirp":
                notes.append(_law(log, nearest))
    elif not entry.lost:
        notes.append("ArduPilot's law, no noise")
    start = entry.t + LEAD_S
    stop = end if entry.duration_s is None else min(start + entry.duration_s, end)
    for at, text in texts:
        if text.startswith("SystemID Stopped"):
            stop = min(stop, at)
            notes.append(f"the vehicle ended it: {text}")
        elif text.startswith("SystemID Parameter Error"):
            reasons.append("the vehicle refused it: SystemID Parameter Error; SID_T_REC must exceed 2 / SID_F_START_HZ")
    band = entry.band
    moved = None if sidd is None else _moved(sidd, entry, end)
    if maneuver != "quiet" and moved is not None:
        if maneuver != "doublet" and (moved[1] < stop - 0.5 or entry.duration_s is None):
            stop = moved[1]  # a doublet rests in between, and at its end
        if entry.lost:
            start = max(start, moved[0]) if moved[0] - start > 5 else start
            frequency = log.series("SIDD.F").part(*moved).values if log.has("SIDD.F") else np.empty(0)
            swept = frequency[np.isfinite(frequency) & (frequency > 0)]
            if swept.size and swept.max() > 1.1 * swept.min():
                band = (float(swept.min()), float(swept.max()))
            else:
                maneuver = "unknown"
    elif maneuver != "quiet" and sidd is not None:
        reasons.append("it ended before the maneuver began: nothing was injected; fly it again")
        stop = start
    if entry.lost:
        notes.append("SIDS, the settings at the start, is missing from the log: axis and band worked out from the data")
    axis = AXES.get(entry.axis) if entry.axis is not None and maneuver != "quiet" else None
    if axis is None and maneuver != "quiet":
        axis = _excited_axis(log, start, stop)
    if entry.axis is not None and entry.axis not in AXES and axis is None and maneuver != "quiet":
        notes.append(f"SID_AXIS {entry.axis} excites neither roll nor pitch nor the elevator")
    stop = max(start, stop)
    planned = entry.duration_s
    return Span(
        start,
        stop,
        entry.t,
        end,
        maneuver,
        axis,
        band if maneuver in ("chirp", "unknown") else None,
        planned,
        entry.axis not in RATE_AXES,
        tuple(reasons),
        tuple(notes),
        entry.t,
    )


def _law(log: DataFlashTables, row: int) -> str:
    def setting(name: str) -> float:
        return float(log.series(f"SIDY.{name}").values[row]) if log.has(f"SIDY.{name}") else math.nan

    if setting("Law") == 1:
        return f"Tischler's law, C1 {setting('C1'):g}, noise {setting('Noise'):g}"
    return "ArduPilot's law"


def _moved(sidd: Series, entry: _Entry, end: float) -> tuple[float, float] | None:
    """First and last time at which something was injected."""
    latest = end if entry.duration_s is None else min(end, entry.t + LEAD_S + entry.duration_s + 0.5)
    part = sidd.part(entry.t, latest)
    moving = np.flatnonzero(np.isfinite(part.values) & (part.values != 0))
    return (float(part.t[moving[0]]), float(part.t[moving[-1]])) if moving.size else None


def _excited_axis(log: DataFlashTables, start_s: float, stop_s: float) -> str | None:
    """The axis with most of the logged excitation; without it, the command that follows SIDD.Targ best."""
    logged = {axis: f"TPEX.{name}" for axis, name in (("roll", "EX"), ("pitch", "EY"), ("elevator", "EE"))}
    if all(log.has(key) for key in logged.values()):
        power = {axis: float(np.std(_finite(log.series(key).part(start_s, stop_s)))) for axis, key in logged.items()}
        best = max(power, key=lambda axis: power[axis])
        return best if power[best] > 0 else None
    if not all(log.has(key) for key in ("SIDD.Targ", "RATE.ROut", "RATE.POut")):
        return None
    target = log.series("SIDD.Targ").part(start_s, stop_s)
    if target.t.size < 25:
        return None
    likeness = {}
    for axis, key in (("roll", "RATE.ROut"), ("pitch", "RATE.POut")):
        command = log.series(key)
        values = np.interp(target.t, command.t, command.values)
        with np.errstate(all="ignore"):
            likeness[axis] = abs(float(np.nan_to_num(np.corrcoef(target.values, values)[0, 1])))
    best = max(likeness, key=lambda axis: likeness[axis])
    return best if likeness[best] > 0.1 else None


def _finite(series: Series) -> FloatArray:
    values = series.values[np.isfinite(series.values)]
    return values if values.size else np.zeros(1)
