"""The runs of a log: where a maneuver was flown, and the record and health of each.

A DataFlash log says it in SIDS (settings, at entry of mode SYSTEMID) and SIDD (every loop): one second of nothing, the
maneuver, then zero input until the mode is left. The run is cut by the maneuver; up to 0.5 s before and 1 s after it
are kept, for trim and for the answer to die out. Where SIDS was lost, SIDD's own clock tells the entry. The swept band
is what was flown: of a chirp that ended early, or that a window cuts, SIDD.F tells how far it came. Logs without either
are asked in this order: what modes and texts tell of (`gcs.logs.runs.told`), what the excitation itself shows
(`gcs.logs.runs.excited`). A log in which none of them finds a maneuver is one stretch, and not usable unless the user
cuts it (--window, or [[runs]] in a profile) and so vouches for what is in it. A CSV is one run unless it is cut so, or
by its own columns ([settings] in a profile); a maneuver found in it gives the run its name, not its length.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import Log
from gcs.logs.profile import profiles
from gcs.logs.profile.profiles import Profile
from gcs.logs.runs import around, excited, health, latency, told
from gcs.logs.runs.span import Span
from gcs.logs.runs.systemid import find
from gcs.vehicle.autopilots import SYSTEMID
from sysid.data.record import Record, RecordError

FloatArray = NDArray[np.float64]
Window = tuple[float | None, float | None]

KEEP_BEFORE_S = 0.5
KEEP_AFTER_S = 1.0
FEW = 5
CUT_SHORT_S = 0.1  # a sweep that ends so much before its time did not reach its last frequency


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
    """What the flight's own verdict has against it, see `gcs.logs.runs.verdicts`; it is then among the reasons."""


def runs_of(
    boots: Sequence[tuple[Log, Profile]],
    name: str,
    sha256: str,
    window: Window | None = None,
    f_high_hz: float = health.F_HIGH_HZ,
) -> tuple[Run, ...]:
    """Every run of a log, boot by boot in order of time, numbered from 1.

    Those outside the window are left out, and the others keep their numbers. A boot without maneuvers is one run,
    unknown; so is a window in which none lies, on the user's word. `name` is the file's name, for the ids. Raises
    TippathError where a profile makes no sense.
    """
    low, high = _ends(window)
    found: list[Run] = []
    outside: list[profiles.OutsideLog] = []
    number = 1
    spans = [_spans(log, profile) for log, profile in boots]
    none_inside = not any(span.start_s <= high and span.stop_s >= low for its in spans for span in its)
    for (log, profile), its in zip(boots, spans, strict=True):
        numbered = [(number + i, span) for i, span in enumerate(its) if span.start_s <= high and span.stop_s >= low]
        if not its or (not numbered and none_inside):
            if isinstance(log, DataFlashTables) and log.sampled_s < health.SHORTEST_PIECE_S:
                found.append(_empty(log, f"{name}#{number + len(its)}"))
            else:
                numbered = [(number + len(its), _whole(log, profile, window))]
        number += len(its) or 1
        flown = [(span.start_s, span.stop_s) for span in its]
        for place, span in numbered:
            others = [other for other in flown if other != (span.start_s, span.stop_s)]
            try:
                run = _run(log, profile, span, f"{name}#{place}", sha256, (low, high), f_high_hz, others)
            except profiles.OutsideLog as error:
                outside.append(error)
            else:
                found.append(run)
    if not found and outside:
        raise outside[0]
    return tuple(found)


def _spans(log: Log, profile: Profile) -> list[Span]:
    if profile.cuts:
        return [
            Span(c.start_s, c.stop_s, c.start_s, c.stop_s, c.maneuver, c.axis, c.swept_band_hz) for c in profile.cuts
        ]
    return _found(log, profile)


def _whole(log: Log, profile: Profile, window: Window | None) -> Span:
    """All of a log in which no maneuver was found, or of the window."""
    reasons = (_no_maneuver(log),) if log.kind != "csv" and window is None else ()
    whole = Span(-math.inf, math.inf, -math.inf, math.inf, reasons=reasons)
    return _named(whole, excited.find(log, profile)) if log.kind == "csv" and not profile.cuts else whole


def _found(log: Log, profile: Profile) -> list[Span]:
    """The maneuvers of a log that is to be cut by them, in order of time."""
    if log.kind == "csv":
        return []
    if isinstance(log, DataFlashTables):
        spans = find(log)
        if spans:
            return spans
    shown = excited.find(log, profile)
    return told.find(log, shown) or shown


def _named(whole: Span, shown: Sequence[Span]) -> Span:
    """A CSV's one run, called after the maneuvers that its excitation shows where they are of one kind."""
    kinds = {span.maneuver for span in shown}
    if len(kinds) != 1:
        return whole
    axes = {span.axis for span in shown}
    bands = [span.swept_band_hz for span in shown if span.swept_band_hz is not None]
    band = (min(low for low, _ in bands), max(high for _, high in bands)) if bands else None
    where = ", ".join(f"{span.axis} {span.start_s:.1f}-{span.stop_s:.1f} s" for span in shown)
    return replace(
        whole,
        maneuver=kinds.pop(),
        axis=axes.pop() if len(axes) == 1 else None,
        swept_band_hz=band,
        notes=(f"{excited.NOTE} ({where})",),
        track=shown[0].track if len(shown) == 1 else None,
    )


def _no_maneuver(log: Log) -> str:
    if log.kind == "dataflash":
        entered = any(mode == SYSTEMID for _, mode in log.modes())
        what = "the log has no SIDS and no SIDD, " + (
            "though mode SYSTEMID was entered" if entered else "mode SYSTEMID was never entered"
        )
    else:
        what = "neither flight modes nor texts tell of one"
    return (
        f"no excitation maneuver: {what}, and the commands show no chirp; pilot and controller alone moved the "
        f"commands, and their feedback cannot be told from the vehicle: {health.SWEEP}; or name a stretch that was "
        "flown as one: --window START:STOP"
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
    others: Sequence[tuple[float, float]] = (),
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
            samples = "1 sample" if mapped.rows_dropped == 1 else f"{mapped.rows_dropped} samples"
            notes.append(f"{samples} left out: a channel had no value there, or an impossible one")
        record = Record(
            id,
            channels,
            maneuver=span.maneuver,
            axis=span.axis,
            rate_source=mapped.rate_source,
            path=log.path,
            sha256=sha256,
            swept_band_hz=band,
            notes=tuple(notes),
        )
    except (TippathError, RecordError) as error:
        if isinstance(error, profiles.OutsideLog) and (log.kind == "csv" or window != (-math.inf, math.inf)):
            raise
        if log.kind == "csv":
            raise TippathError(str(error)) from error
        return _without_record(log, profile, span, id, (start, stop), band, error, f_high_hz)
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
    found = _with_the_log(log, profile, found, mapped.sources, (start, stop), span, others)
    beside = [
        around.disarmed(log, start, stop),
        around.equal_motors(log, mapped.sources, found.excitation, start, stop),
    ]
    reasons = (*(reason for reason in beside if reason is not None), *span.reasons, *found.reasons)
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


def _without_record(
    log: Log,
    profile: Profile,
    span: Span,
    id: str,
    at: tuple[float, float],
    band: tuple[float, float] | None,
    error: TippathError | RecordError,
    f_high_hz: float,
) -> Run:
    """A maneuver of which no record can be cut, with all that stands against it."""
    start, stop = at
    why = around.disarmed(log, start, stop)
    missing = around.not_logged(log, profile, f_high_hz) if isinstance(error, profiles.ChannelsMissing) else []
    said = any(reason.startswith(around.NO_ACTUATORS) for reason in missing)
    finite = math.isfinite(start) and math.isfinite(stop)
    return Run(
        None,
        id,
        log.path,
        span.maneuver,
        span.axis,
        start if math.isfinite(start) else 0.0,
        max(0.0, stop - start) if finite else 0.0,
        None,
        (),
        False,
        (*([why] if why else []), *missing, *span.reasons, *([] if said else [str(error)])),
        span.notes,
        swept_band_hz=band,
        entered_s=span.entered_s,
    )


def _with_the_log(
    log: Log,
    profile: Profile,
    found: health.Health,
    sources: Mapping[str, str],
    at: tuple[float, float],
    span: Span,
    others: Sequence[tuple[float, float]],
) -> health.Health:
    """The health of a record, with what only the log around it tells."""
    late = latency.measure(log, profile, sources, found.excitation, *at)
    quiet: tuple[health.Quiet, ...] = ()
    if math.isfinite(span.start_s) and math.isfinite(span.stop_s):
        rms = max((rate for _, rate in found.excitation.values()), default=0.0)
        quiet = around.quiet(log, profile, span.start_s, span.stop_s, rms, others)
    notes = [
        f"{one.against} is {-1000 * one.late_s:.1f} ms later than {one.field}: a fitted delay or lag includes that"
        for one in late
        if one.late_s < 0
    ]
    return replace(found, quiet=quiet, latency=late, notes=(*found.notes, *notes))


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
    if span.swept_band_hz is not None and span.track is not None:
        t, frequency = span.track
        inside = frequency[(t >= start_s) & (t <= stop_s)]
        whole = start_s <= span.start_s and stop_s >= span.stop_s
        return span.swept_band_hz if whole or not inside.size else (float(inside.min()), float(inside.max()))
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
