"""A run cut out of a log: its record, its health, and what the log around it tells.

The run is cut by the maneuver; up to 0.5 s before and 1 s after it are kept, for trim and for the answer to die out.
The swept band is what was flown: of a chirp that ended early, or that a window cuts, SIDD.F or the sweep that was found
tells how far it came.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import TABLES, FloatArray, Log
from gcs.logs.profile import mapping
from gcs.logs.profile.profiles import Profile
from gcs.logs.runs import around, health, latency, onboard
from gcs.logs.runs.health import F_HIGH_HZ, Health
from gcs.logs.runs.loop import TOLD, held, loop_of
from gcs.logs.runs.run import AnyWindow, FromStart, Run
from gcs.logs.runs.span import Span
from gcs.vehicle.sweeps import ANY, ARDUPILOT, flies_cards, how_to_sweep
from sysid.data.chirp import with_excitation
from sysid.data.record import Record, RecordError

KEEP_BEFORE_S = 0.5
KEEP_AFTER_S = 1.0
BESIDE = ("excitation_c", "excitation_r")
"""Of axes that are fitted by themselves: a run in which they rest, of roll or pitch, has none."""
FEW = 5
CUT_SHORT_S = 0.1  # a sweep that ends so much before its time did not reach its last frequency


@dataclass(frozen=True, eq=False, kw_only=True)
class Cutting:
    """What runs are cut from, and between which times."""

    log: Log
    """One boot."""
    profile: Profile
    sha256: str
    """Of the file."""
    low_s: float
    """The window, of the log's own time; infinite where there is none."""
    high_s: float
    f_high_hz: float

    @property
    def windowed(self) -> bool:
        return (self.low_s, self.high_s) != (-math.inf, math.inf)

    def after(self, span: Span, window: FromStart) -> Cutting:
        """The same between two times from the start of a maneuver, or of the log where that is all one run.

        Raises OutsideLog where the maneuver is over before.
        """
        start, stop = span.start_s, span.stop_s
        if not (math.isfinite(start) and math.isfinite(stop)):
            t = mapping.apply(self.profile, self.log).channels["t"]
            start, stop = max(start, float(t[0])), min(stop, float(t[-1]))
        low, high = window.after(start)
        if low is not None and low >= stop:
            length = f"the run is over {stop - start:.1f} s after its start"
            raise mapping.OutsideLog(f"{self.log.path}: nothing lies in {window.mark}: {length}", start, stop)
        return replace(self, low_s=-math.inf if low is None else low, high_s=math.inf if high is None else high)

    def run(self, span: Span, id: str, others: Sequence[tuple[float, float]]) -> Run:
        """The run of one maneuver; `others`: start and stop of the log's other ones.

        Raises OutsideLog where the window leaves nothing of the log, or the log has no samples of the maneuver at all;
        TippathError where the profile makes no sense.
        """
        start, stop = max(span.start_s, self.low_s), min(span.stop_s, self.high_s)
        band = _flown_band(self.log, span, start, stop)
        try:
            mapped = self._mapped(span)
            record = self._record(span, id, band, mapped)
        except (TippathError, RecordError) as error:
            if isinstance(error, mapping.OutsideLog) and (self._elsewhere(span, error) or self.windowed):
                raise
            if self.log.kind in TABLES:
                raise TippathError(str(error)) from error
            return self._without_record(span, id, (start, stop), band, error)
        begin, end = float(record.t[0]), float(record.t[-1])
        start, stop = max(start, begin), min(stop, end)
        duration_s = max(0.0, stop - start)
        checked = health.check(
            record,
            planned_s=None if self.windowed else span.planned_s,
            maneuver_s=duration_s,
            slow_channels=mapped.spacing_s,
            f_high_hz=self.f_high_hz,
            sweep=how_to_sweep(self.profile.name, self.log.kind),
        )
        checked = self._with_the_log(checked, mapped.sources, (start, stop), span, others)
        beside = (
            around.disarmed(self.log, start, stop),
            around.equal_motors(self.log, mapped.sources, checked.excitation, start, stop),
        )
        found = () if span.explained else checked.reasons
        reasons = (*(reason for reason in beside if reason is not None), *span.reasons, *found)
        # The record carries what was noted about it to whoever fits it.
        thinned = held(record, checked.rate_hz)
        record = replace(record, notes=(*record.notes, *checked.notes, *([] if thinned is None else [thinned])))
        return Run(
            record=record,
            id=id,
            path=self.log.path,
            maneuver=span.maneuver,
            axis=span.axis,
            start_s=start,
            duration_s=duration_s,
            rate_hz=checked.rate_hz,
            gaps=checked.gaps,
            usable=not reasons,
            reasons=reasons,
            notes=record.notes,
            rate_source=mapped.rate_source,
            swept_band_hz=band,
            sources={name: source for name, source in mapped.sources.items() if name in record.channels},
            absent=mapped.absent,
            health=checked,
            entered_s=span.entered_s,
        )

    def _elsewhere(self, span: Span, error: mapping.OutsideLog) -> bool:
        """Whether nothing of a maneuver lies where the log has samples, its entry neither."""
        return self.log.kind in TABLES or span.first_s > error.last_s or span.stop_s < error.first_s

    def _mapped(self, span: Span) -> mapping.Mapped:
        low = max(span.first_s, span.start_s - KEEP_BEFORE_S, self.low_s)
        high = min(span.last_s, span.stop_s + KEEP_AFTER_S, self.high_s)
        loop = loop_of(self.log, self.profile, span.start_s)
        return mapping.apply(self.profile, self.log, low, high, loop_s=None if loop is None else loop.dt_s)

    def _record(self, span: Span, id: str, band: tuple[float, float] | None, mapped: mapping.Mapped) -> Record:
        channels = dict(mapped.channels)
        notes = [*span.notes, *self.profile.notes, *mapped.notes]
        if span.maneuver in ("chirp", "doublet") and not _excitation_known(channels, span):
            channels = {name: values for name, values in channels.items() if not name.startswith("excitation_")}
        channels = {name: values for name, values in channels.items() if name not in BESIDE or np.any(values)}
        if mapped.rows_dropped:
            samples = "1 sample" if mapped.rows_dropped == 1 else f"{mapped.rows_dropped} samples"
            notes.append(f"{samples} left out: a channel had no value there, or an impossible one")
        loop = loop_of(self.log, self.profile, span.start_s)
        record = Record(
            id=id,
            channels=channels,
            maneuver=span.maneuver,
            axis=span.axis,
            rate_source=mapped.rate_source,
            path=self.log.path,
            sha256=self.sha256,
            swept_band_hz=band,
            chirp_noise=span.chirp_noise,
            airframe=self.profile.airframe or onboard.airframe_of(self.log, span.start_s),
            notes=tuple(notes),
            vehicle=onboard.vehicle_of(self.log, span.start_s),
            loop_dt_s=None if loop is None else loop.dt_s,
            loop_told_by="" if loop is None else loop.told_by,
            onboard=span.onboard,
        )
        return _with_excitation(record, span)

    def _without_record(
        self,
        span: Span,
        id: str,
        at: tuple[float, float],
        band: tuple[float, float] | None,
        error: TippathError | RecordError,
    ) -> Run:
        """A maneuver of which no record can be cut, with all that stands against it."""
        start, stop = at
        slow = no_actuators = None
        if isinstance(error, mapping.ChannelsMissing):
            slow = around.slow_rates(self.log, self.profile, self.f_high_hz)
            no_actuators = around.no_actuators(self.log, self.profile)
        beside = (around.disarmed(self.log, start, stop), slow, no_actuators)
        finite = math.isfinite(start) and math.isfinite(stop)
        return Run(
            record=None,
            id=id,
            path=self.log.path,
            maneuver=span.maneuver,
            axis=span.axis,
            start_s=start if math.isfinite(start) else 0.0,
            duration_s=max(0.0, stop - start) if finite else 0.0,
            rate_hz=None,
            gaps=(),
            usable=False,
            reasons=(
                *(reason for reason in beside if reason is not None),
                *span.reasons,
                *([str(error)] if no_actuators is None else []),
            ),
            notes=span.notes,
            swept_band_hz=band,
            entered_s=span.entered_s,
        )

    def _with_the_log(
        self,
        checked: Health,
        sources: Mapping[str, str],
        at: tuple[float, float],
        span: Span,
        others: Sequence[tuple[float, float]],
    ) -> Health:
        """The health of a record, with what only the log around it tells."""
        late = latency.measure(self.log, self.profile, sources, checked.excitation, at)
        quiet: tuple[health.Quiet, ...] = ()
        if math.isfinite(span.start_s) and math.isfinite(span.stop_s):
            rms = max((rate for _, rate in checked.excitation.values()), default=0.0)
            quiet = around.quiet(self.log, self.profile, (span.start_s, span.stop_s), rms, others)
        notes = [
            f"{each.against} is {-1000 * each.late_s:.1f} ms later than {each.field}: "
            "a fitted delay or lag includes that"
            for each in late
            if each.late_s < 0
        ]
        lost = onboard.dropped(self.log, *at) if checked.gaps else None
        slow = onboard.thinned(self.log, at[0], checked.rate_hz)
        notes += [note for note in (lost, slow) if note is not None]
        return replace(checked, quiet=quiet, latency=late, notes=(*checked.notes, *notes))


def of_record(
    record: Record, window: AnyWindow | None = None, f_high_hz: float = F_HIGH_HZ, loop_rate_hz: float | None = None
) -> Run:
    """A record that was written before, checked again. Raises RecordError where the window leaves nothing of it."""
    if loop_rate_hz is not None:
        record = replace(record, loop_dt_s=1 / loop_rate_hz, loop_told_by=TOLD)
    mark = ""
    if isinstance(window, FromStart):
        mark, window = window.mark, window.after(float(record.t[0]))
    if window is not None:
        record = replace(record.window(*window), id=record.id + mark)
    sweep = ARDUPILOT if flies_cards(record.rate_source) else ANY
    checked = health.check(record, f_high_hz=f_high_hz, sweep=sweep)
    thinned = held(record, checked.rate_hz)
    record = replace(record, notes=_each_once(*record.notes, *checked.notes, *([] if thinned is None else [thinned])))
    return Run(
        record=record,
        id=record.id,
        path=record.path,
        maneuver=record.maneuver,
        axis=record.axis,
        start_s=float(record.t[0]),
        duration_s=record.duration_s,
        rate_hz=checked.rate_hz,
        gaps=checked.gaps,
        usable=checked.usable,
        reasons=checked.reasons,
        notes=record.notes,
        rate_source=record.rate_source,
        swept_band_hz=record.swept_band_hz,
        health=checked,
    )


def _each_once(*notes: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(notes))


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


def _with_excitation(record: Record, span: Span) -> Record:
    """The record, its excitation rebuilt where nobody logged it, its law is known and its command shows it."""
    known = span.law
    if known is None or span.maneuver != "chirp" or not span.excites_command:
        return record
    if any(name.startswith("excitation_") for name in record.channels):
        return record
    return with_excitation(record, known.chirp, span.start_s, known.within_s, known.source) or record


def _excitation_known(channels: Mapping[str, FloatArray], span: Span) -> bool:
    """A maneuver whose logged excitation is zero throughout was injected elsewhere than into the cyclic commands."""
    return span.excites_command and any(np.any(v) for c, v in channels.items() if c.startswith("excitation_"))
