"""ArduPilot's mode SYSTEMID in a DataFlash log: what SIDS, SIDD, MODE and MSG tell about the maneuvers flown.

SIDS holds the settings at the entry of the mode, SIDD every loop: one second of nothing, the maneuver, then zero input
until the mode is left. Where SIDS was lost, SIDD's own clock tells the entry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import FloatArray, Series
from gcs.logs.runs.health import SHORTEST_RUN_S
from gcs.logs.runs.span import Known, Span
from gcs.vehicle.autopilots import PARAMETER_ERROR, STOPPED, SYSTEMID
from sysid.data.chirp import Chirp

LEAD_S = 1.0  # of nothing before the maneuver
START_WITHIN_S = 0.06
"""What the time of the entry, and a loop of another length than it counts, may be off."""
AXES = {7: "roll", 10: "roll", 8: "pitch", 11: "pitch", 20: "elevator"} | {
    **dict.fromkeys((3, 6, 9, 12), "yaw"),
    13: "thrust",
}
"""SID_AXIS of ArduPilot; 20, the elevator, is the bundled vehicle's own."""
RATE_AXES = (3, 6, 7, 8, 9)  # the excitation is added to what the rate loop is to follow: it is no part of the command
MAGNITUDE_CHANGED = 3.0
"""Times the magnitude that was set: Tischler's noise adds to the chirp, but not as much."""
FEWEST_BEYOND = 10
"""Samples; fewer may be damaged ones."""
KINDS = {0: "chirp", 1: "doublet", 2: "quiet"}


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """One entry into mode SYSTEMID."""

    t: float
    axis: int | None = None
    magnitude: float | None = None
    band: tuple[float, float] | None = None
    duration_s: float | None = None
    fades_s: tuple[float, float] = (0.0, 0.0)
    """In and out."""
    lost: bool = False
    """SIDS is missing; the entry was worked out from SIDD."""


def find(log: DataFlashTables) -> list[Span]:
    """The maneuvers of a DataFlash log, in order of time."""
    sidd = log.series("SIDD.Targ") if log.has("SIDD.Targ") and log.has("SIDD.Time") else None
    entries = _entries(log, sidd)
    leaving = _leaving(log)
    texts = log.texts()
    end_of_log = _end(log)
    spans = []
    for i, entry in enumerate(entries):
        end = min(
            entries[i + 1].t if i + 1 < len(entries) else math.inf,
            next((t for t in leaving if t > entry.t), math.inf),
            end_of_log,
        )
        its_texts = [(t, text) for t, text in texts if entry.t <= t <= end + 0.5]
        spans.append(_Flown(log, entry, end, sidd).span(its_texts))
    return spans


def _entries(log: DataFlashTables, sidd: Series | None) -> list[_Entry]:
    entries = []
    if log.has("SIDS.Ax"):
        t = log.series("SIDS.Ax").t
        names = ("Ax", "Mag", "FSt", "FSp", "TR", "TFin", "TFout")
        columns = {c: log.series(f"SIDS.{c}").values for c in names if log.has(f"SIDS.{c}")}
        for i, at in enumerate(t.tolist()):
            magnitude, low, high, duration = (
                float(columns[c][i]) if c in columns else math.nan for c in ("Mag", "FSt", "FSp", "TR")
            )
            entries.append(
                _Entry(
                    t=at,
                    axis=_number(columns["Ax"][i]),
                    magnitude=magnitude if 0 < magnitude < math.inf else None,
                    band=(low, high) if 0 < low < high < math.inf else None,
                    duration_s=duration if 0 < duration < 3600 else None,
                    fades_s=(_fade(columns, "TFin", i), _fade(columns, "TFout", i)),
                )
            )
    if sidd is not None:
        clock = log.series("SIDD.Time").values
        for at in _restarts(sidd.t, clock):
            if not any(abs(at - entry.t) < 1.5 for entry in entries):
                entries.append(_Entry(t=at, lost=True))
    return sorted(entries, key=lambda entry: entry.t)


def _fade(columns: Mapping[str, FloatArray], name: str, row: int) -> float:
    value = float(columns[name][row]) if name in columns else 0.0
    return value if 0 < value < 3600 else 0.0


def _number(value: float) -> int:
    """A setting that is a number of something; -1, which is nothing's, where a damaged format made it none."""
    return int(value) if math.isfinite(value) else -1


def _restarts(t: FloatArray, clock: FloatArray) -> list[float]:
    """When SIDD.Time was zero, for each stretch in which it ran on; single damaged samples do not count."""
    begun = t - clock
    good = np.isfinite(begun)
    t, begun = t[good], begun[good]
    edges = np.concatenate(([0], np.flatnonzero(np.abs(np.diff(begun)) > 0.5) + 1, [t.size]))
    zeros: list[tuple[float, float]] = []  # time zero of the stretch, at its first and last sample
    for first, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        if stop - first < 25:
            continue
        if zeros and abs(begun[first] - zeros[-1][1]) < 0.25:
            zeros[-1] = (zeros[-1][0], float(begun[stop - 1]))
        else:
            zeros.append((float(begun[first]), float(begun[stop - 1])))
    return [zero for zero, _ in zeros]


def _leaving(log: DataFlashTables) -> list[float]:
    """When another mode than SYSTEMID was entered."""
    if not log.has("MODE.ModeNum"):
        return []
    modes = log.series("MODE.ModeNum")
    return [float(t) for t in modes.t[modes.values != SYSTEMID]]


def _end(log: DataFlashTables) -> float:
    ends = [log.series(key).t[-1] for key in ("SIDD.Targ", "RATE.R") if log.has(key)]
    return float(max(ends, default=math.inf))


@dataclass(frozen=True, kw_only=True)
class _Maneuver:
    """What was flown after an entry, as far as it is known."""

    kind: str
    start_s: float
    stop_s: float
    band: tuple[float, float] | None
    noise: float | None = None
    """Over the chirp's amplitude."""
    c1: float | None = None
    """Of Tischler's law; None: ArduPilot's."""
    last_s: float | None = None
    """The record must end here, where that is before the mode was left."""
    notes: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()
    explained: bool = False


@dataclass(frozen=True, eq=False)
class _Flown:
    """An entry into the mode, with what the log holds until its end."""

    log: DataFlashTables
    entry: _Entry
    end_s: float
    """When the mode was left, entered again, or the log ended."""
    sidd: Series | None

    def span(self, texts: Sequence[tuple[float, str]]) -> Span:
        """Where the maneuver lies; `texts`: what the vehicle said meanwhile."""
        entry = self.entry
        maneuver = self._until_changed(self._as_it_moved(self._as_told(self._as_set(), texts)))
        notes = list(maneuver.notes)
        if entry.lost:
            notes.append(
                "SIDS, the settings at the start, is missing from the log: axis and band worked out from the data"
            )
        axis = self._axis(maneuver)
        if entry.axis is not None and entry.axis not in AXES and axis is None and maneuver.kind != "quiet":
            notes.append(other_axis(entry.axis))
        return Span(
            start_s=maneuver.start_s,
            stop_s=max(maneuver.start_s, maneuver.stop_s),
            first_s=entry.t,
            last_s=self.end_s if maneuver.last_s is None else maneuver.last_s,
            maneuver=maneuver.kind,
            axis=axis,
            swept_band_hz=maneuver.band if maneuver.kind in ("chirp", "unknown") else None,
            chirp_noise=maneuver.noise,
            planned_s=entry.duration_s,
            excites_command=entry.axis not in RATE_AXES,
            reasons=maneuver.reasons,
            explained=maneuver.explained,
            notes=tuple(notes),
            entered_s=entry.t,
            law=self._known(maneuver),
        )

    def _known(self, maneuver: _Maneuver) -> Known | None:
        """The chirp by the settings at the entry, which SIDD repeats sample by sample where it is logged."""
        entry = self.entry
        if maneuver.kind != "chirp" or entry.band is None or entry.duration_s is None:
            return None
        chirp = Chirp(
            axis=AXES.get(-1 if entry.axis is None else entry.axis, ""),
            law="ardupilot" if maneuver.c1 is None else "tischler",
            f_start_hz=entry.band[0],
            f_stop_hz=entry.band[1],
            duration_s=entry.duration_s,
            amplitude=entry.magnitude,
            fade_in_s=entry.fades_s[0],
            fade_out_s=entry.fades_s[1],
            flown_s=maneuver.stop_s - maneuver.start_s,
            c1=4.0 if maneuver.c1 is None else maneuver.c1,
        )
        return Known(chirp, START_WITHIN_S, "SIDS") if chirp.makes_sense else None

    def _as_set(self) -> _Maneuver:
        """By the settings at the entry."""
        log, entry = self.log, self.entry
        kind = "chirp"
        notes: list[str] = []
        noise: float | None = None
        c1: float | None = None
        if log.has("SIDY.Kind"):
            kinds = log.series("SIDY.Kind")
            nearest = int(np.argmin(np.abs(kinds.t - entry.t)))
            if abs(kinds.t[nearest] - entry.t) < 0.5:
                kind = KINDS.get(_number(kinds.values[nearest]), "unknown")
                law, noise, c1 = _law(log, nearest)
                notes += [law] if kind == "chirp" else []
        elif not entry.lost:
            notes.append("ArduPilot's law, no noise")
            noise = 0.0
        start = entry.t + LEAD_S
        stop = self.end_s if entry.duration_s is None else min(start + entry.duration_s, self.end_s)
        return _Maneuver(kind=kind, start_s=start, stop_s=stop, band=entry.band, noise=noise, c1=c1, notes=tuple(notes))

    def _as_told(self, maneuver: _Maneuver, texts: Sequence[tuple[float, str]]) -> _Maneuver:
        """By the vehicle's own words about its end."""
        stop, notes, reasons = maneuver.stop_s, list(maneuver.notes), list(maneuver.reasons)
        for at, text in texts:
            if text.startswith(STOPPED):
                stop = min(stop, at)
                notes.append(f"the vehicle ended it: {text}")
            elif text.startswith(PARAMETER_ERROR):
                reasons.append(
                    "the vehicle refused it: SystemID Parameter Error; SID_T_REC must exceed 2 / SID_F_START_HZ"
                )
        return replace(maneuver, stop_s=stop, notes=tuple(notes), reasons=tuple(reasons))

    def _as_it_moved(self, maneuver: _Maneuver) -> _Maneuver:
        """By what was injected, where the log has it."""
        if maneuver.kind == "quiet" or self.sidd is None:
            return maneuver
        moved = _moved(self.sidd, self.entry, self.end_s)
        if moved is None:
            reason = "it ended before the maneuver began: nothing was injected; fly it again"
            if not self.sidd.part(self.entry.t, self.end_s).t.size:
                reason = "SIDD has no samples of it, so that what was injected is not known: take the whole log"
            return replace(maneuver, stop_s=maneuver.start_s, reasons=(*maneuver.reasons, reason))
        ended = moved[1] < maneuver.stop_s - 0.5 or self.entry.duration_s is None
        if maneuver.kind != "doublet" and ended:  # a doublet rests in between, and at its end
            maneuver = replace(maneuver, stop_s=moved[1])
        return self._without_settings(maneuver, moved) if self.entry.lost else maneuver

    def _until_changed(self, maneuver: _Maneuver) -> _Maneuver:
        """Until more was injected than the magnitude that was set: SID_MAGNITUDE acts at once, also in mid-sweep."""
        if maneuver.kind == "quiet" or self.sidd is None or self.entry.magnitude is None:
            return maneuver
        part = self.sidd.part(maneuver.start_s, maneuver.stop_s)
        with np.errstate(invalid="ignore"):
            beyond = np.flatnonzero(np.abs(part.values) > MAGNITUDE_CHANGED * self.entry.magnitude)
        if beyond.size < FEWEST_BEYOND:
            return maneuver
        at = float(part.t[beyond[0]])
        largest = float(np.nanmax(np.abs(self.sidd.part(at, self.end_s).values)))
        what = (
            f"the magnitude was changed in mid-sweep: {self.entry.magnitude:g} at its start (SIDS.Mag), and from "
            f"{at:.2f} s of the log SIDD.Targ reaches {largest:.4g}"
        )
        changed = replace(maneuver, stop_s=at, last_s=at)
        if at - maneuver.start_s >= SHORTEST_RUN_S:
            return replace(changed, notes=(*maneuver.notes, f"{what}: only what was flown before is taken"))
        reason = f"{what}: fly it again, and let no other station write SID_MAGNITUDE while a sweep runs"
        return replace(changed, reasons=(*maneuver.reasons, reason), explained=True)

    def _without_settings(self, maneuver: _Maneuver, moved: tuple[float, float]) -> _Maneuver:
        """Start and band by the data alone."""
        late = moved[0] - maneuver.start_s > 5
        start = max(maneuver.start_s, moved[0]) if late else maneuver.start_s
        frequency = self.log.series("SIDD.F").part(*moved).values if self.log.has("SIDD.F") else np.empty(0)
        swept = frequency[np.isfinite(frequency) & (frequency > 0)]
        if swept.size and swept.max() > 1.1 * swept.min():
            return replace(maneuver, start_s=start, band=(float(swept.min()), float(swept.max())))
        return replace(maneuver, start_s=start, kind="unknown")

    def _axis(self, maneuver: _Maneuver) -> str | None:
        if maneuver.kind == "quiet":
            return None
        named = None if self.entry.axis is None else AXES.get(self.entry.axis)
        return _excited_axis(self.log, maneuver.start_s, maneuver.stop_s) if named is None else named


def other_axis(number: int) -> str:
    """That a sweep of that SID_AXIS, none of `AXES`, is of no axis that is fitted."""
    return f"SID_AXIS {number} excites neither roll nor pitch nor yaw, nor thrust or the elevator"


def _law(log: DataFlashTables, row: int) -> tuple[str, float, float | None]:
    """In words, its noise over its amplitude, and C1 where it is Tischler's."""

    def setting(name: str) -> float:
        return float(log.series(f"SIDY.{name}").values[row]) if log.has(f"SIDY.{name}") else math.nan

    if setting("Law") == 1:
        noise = setting("Noise")
        return f"Tischler's law, C1 {setting('C1'):g}, noise {noise:g}", noise, setting("C1")
    return "ArduPilot's law", 0.0, None


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
