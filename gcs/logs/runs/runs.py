"""The runs of a log: where a maneuver was flown; what is cut there says `gcs.logs.runs.cutting`.

A DataFlash log says it in SIDS (settings, at entry of mode SYSTEMID) and SIDD (every loop), see
`gcs.logs.runs.systemid`. Logs without either are asked in this order: PX4's autotune (`gcs.logs.runs.autotune`), what
modes and texts tell of (`gcs.logs.runs.told`), what the excitation itself shows (`gcs.logs.runs.excited`). A log in
which none of them finds a maneuver is one stretch, and not usable unless the user cuts it (--window, or [[runs]] in a
profile) and so vouches for what is in it. A CSV is one run unless it is cut so, or by its own columns ([settings] in a
profile); a maneuver found in it gives the run its name, not its length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import TABLES, Log
from gcs.logs.profile.mapping import OutsideLog
from gcs.logs.profile.profiles import Cut, Profile
from gcs.logs.runs import autotune, excited, systemid, told
from gcs.logs.runs.around import disarmed
from gcs.logs.runs.cutting import Cutting
from gcs.logs.runs.health import F_HIGH_HZ, SHORTEST_PIECE_S
from gcs.logs.runs.run import AnyWindow, FromStart, Run, unread
from gcs.logs.runs.settings import with_laws
from gcs.logs.runs.span import Known, Span
from gcs.logs.runs.stretch import flown_stretch
from gcs.vehicle.autopilots import SYSTEMID
from gcs.vehicle.sweeps import how_to_sweep
from sysid.data.chirp import Chirp

CUT_WITHIN_S = 1.0
"""By which a chirp may begin beside where a profile says that it does."""


@dataclass(frozen=True)
class Flown:
    """The runs of a log."""

    runs: tuple[Run, ...]
    elsewhere: tuple[str, ...] = ()
    """What the log tells of maneuvers whose samples it does not hold, a sentence for each boot that has such."""


def runs_of(
    boots: Sequence[tuple[Log, Profile]],
    name: str,
    sha256: str,
    window: AnyWindow | None = None,
    f_high_hz: float = F_HIGH_HZ,
) -> Flown:
    """Every run of a log, boot by boot in order of time, numbered from 1.

    Those outside the window, and those of which the file has no samples, are left out, and the others keep their
    numbers. A boot without maneuvers is one run, unknown; so is a window in which none lies, on the user's word. A
    window from each run's start marks the ids. `name` is the file's name, for the ids. Raises TippathError where a
    profile makes no sense.
    """
    low, high = _ends(window)
    mark = window.mark if isinstance(window, FromStart) else ""
    runs: list[Run] = []
    outside: list[OutsideLog] = []
    elsewhere: list[str] = []
    flown = _numbered(boots)
    none_inside = not any(each.within(low, high) for each in flown)
    for boot in flown:
        log, profile = boot.log, boot.profile
        numbered = boot.within(low, high)
        if not boot.spans or (not numbered and none_inside):
            number = boot.first + len(boot.spans)
            if isinstance(log, DataFlashTables) and log.sampled_s < SHORTEST_PIECE_S:
                runs.append(_empty(log, f"{name}#{number}"))
            else:
                numbered = [(number, _whole(log, profile, window))]
        cutting = Cutting(log=log, profile=profile, sha256=sha256, low_s=low, high_s=high, f_high_hz=f_high_hz)
        beyond: list[tuple[int, Span, OutsideLog]] = []
        for number, span in numbered:
            try:
                cut = cutting.after(span, window) if isinstance(window, FromStart) else cutting
                runs.append(cut.run(span, f"{name}#{number}{mark}", boot.others(span)))
            except OutsideLog as error:
                beyond.append((number, span, error))
        outside += [error for _, _, error in beyond]
        if beyond and window is None and log.kind not in TABLES:
            elsewhere.append(_elsewhere(beyond))
            if len(beyond) == len(numbered):
                whole = replace(_whole(log, profile, window), reasons=(NOTHING_WHOLE,))
                runs.append(cutting.run(whole, f"{name}#{boot.first + len(boot.spans)}", ()))
    if not runs and outside:
        raise max(outside, key=lambda error: error.last_s - error.first_s)
    return Flown(tuple(runs), tuple(elsewhere))


NOTHING_WHOLE = (
    "no maneuver lies in the samples of this file: those that the log tells of were flown before or after; take the "
    "whole log from the vehicle, or name a stretch that was flown as one: --window START:STOP"
)


def _elsewhere(beyond: Sequence[tuple[int, Span, OutsideLog]]) -> str:
    """`8 maneuvers of this boot lie outside the samples of this file: 114.57 to 1164.28 s (...)`."""
    spans, error = [span for _, span, _ in beyond], beyond[0][2]
    first, last = min(span.start_s for span in spans), max(span.start_s for span in spans)
    many = len(spans) > 1
    when = f"{first:.2f} to {last:.2f} s" if many else f"at {first:.2f} s"
    numbers = ", ".join(f"#{number}" for number, _, _ in beyond)
    return (
        f"{len(spans)} maneuver{'s' if many else ''} of this boot {'lie' if many else 'lies'} outside the samples of "
        f"this file: {when} ({numbers}; its samples run from {error.first_s:.2f} to {error.last_s:.2f} s): "
        "the whole log has them"
    )


@dataclass(frozen=True, eq=False)
class _Boot:
    """A boot with the maneuvers flown in it."""

    log: Log
    profile: Profile
    spans: list[Span]
    first: int
    """Number of the first of them, or of the whole boot where there is none."""

    def within(self, low_s: float, high_s: float) -> list[tuple[int, Span]]:
        """Those that reach into a window, with their numbers."""
        numbered = enumerate(self.spans, self.first)
        return [(number, span) for number, span in numbered if span.start_s <= high_s and span.stop_s >= low_s]

    def others(self, span: Span) -> list[tuple[float, float]]:
        """Start and stop of the other maneuvers, s."""
        flown = [(each.start_s, each.stop_s) for each in self.spans]
        return [other for other in flown if other != (span.start_s, span.stop_s)]


def _numbered(boots: Sequence[tuple[Log, Profile]]) -> list[_Boot]:
    numbered: list[_Boot] = []
    number = 1
    for log, profile in boots:
        spans = _spans(log, profile)
        numbered.append(_Boot(log, profile, spans, number))
        number += len(spans) or 1
    return numbered


def _spans(log: Log, profile: Profile) -> list[Span]:
    if profile.cuts:
        return [
            Span(
                start_s=cut.start_s,
                stop_s=cut.stop_s,
                first_s=cut.start_s,
                last_s=cut.stop_s,
                maneuver=cut.maneuver,
                axis=cut.axis,
                swept_band_hz=cut.swept_band_hz,
                law=_known(cut),
            )
            for cut in profile.cuts
        ]
    return _maneuvers(log, profile)


def _known(cut: Cut) -> Known | None:
    """The chirp that a profile tells of; None where it does not tell all."""
    if cut.law is None or cut.axis is None or cut.swept_band_hz is None:
        return None
    chirp = Chirp(
        axis=cut.axis,
        law=cut.law,
        f_start_hz=cut.swept_band_hz[0],
        f_stop_hz=cut.swept_band_hz[1],
        duration_s=cut.stop_s - cut.start_s,
        amplitude=cut.amplitude,
        fade_in_s=cut.fade_in_s,
        fade_out_s=cut.fade_out_s,
        c1=cut.c1,
    )
    return Known(chirp, CUT_WITHIN_S, "the profile's settings") if chirp.makes_sense else None


def _whole(log: Log, profile: Profile, window: AnyWindow | None) -> Span:
    """All of a log in which no maneuver was found, or of the window."""
    reasons = (_no_maneuver(log, profile),) if log.kind not in TABLES and window is None else ()
    whole = Span(start_s=-math.inf, stop_s=math.inf, first_s=-math.inf, last_s=math.inf, reasons=reasons)
    return _named(whole, excited.find(log, profile)) if log.kind in TABLES and not profile.cuts else whole


def _maneuvers(log: Log, profile: Profile) -> list[Span]:
    """The maneuvers of a log that is to be cut by them, in order of time."""
    if log.kind in TABLES:
        return []
    if isinstance(log, DataFlashTables):
        spans = systemid.find(log)
        if spans:
            return spans
    tuned = autotune.find(log)
    if tuned:
        return tuned
    shown = excited.find(log, profile)
    return with_laws(log, told.find(log, shown) or shown)


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


def _no_maneuver(log: Log, profile: Profile) -> str:
    if log.kind == "dataflash":
        entered = any(mode == SYSTEMID for _, mode in log.modes())
        what = "the log has no SIDS and no SIDD, " + (
            "though mode SYSTEMID was entered" if entered else "mode SYSTEMID was never entered"
        )
    elif log.kind == "blackbox":
        what = "its debug fields are no chirp's (debug_mode CHIRP)"
    else:
        what = "neither flight modes nor texts tell of one"
    sweep = how_to_sweep(profile.name, log.kind)
    return (
        f"no excitation maneuver: {what}, and the commands show no chirp; pilot and controller alone moved the "
        f"commands, and their feedback cannot be told from the vehicle: {sweep}; {_stretch_to_name(log, profile)}"
    )


def _stretch_to_name(log: Log, profile: Profile) -> str:
    """`... --window 52:92 --band 1:15`: where the vehicle moved, from where on it shows more than its controller."""
    channels = excited.commands(log, profile)
    stretch = None if channels is None else flown_stretch(channels)
    named = "or name a stretch that was flown as one: --window"
    if stretch is not None:
        return f"{named} {stretch[0]:g}:{stretch[1]:g} --band 1:15, where it moved (below 1 Hz a controller shows)"
    never = disarmed(log, -math.inf, math.inf) is not None
    return "it has no stretch to name instead, for nothing flew" if never else f"{named} START:STOP"


def _ends(window: AnyWindow | None) -> tuple[float, float]:
    """In the log's own time; infinite where it is open, or from each run's start."""
    start, stop = (None, None) if window is None or isinstance(window, FromStart) else window
    return -math.inf if start is None else start, math.inf if stop is None else stop


def _empty(log: DataFlashTables, id: str) -> Run:
    when = f"{log.sampled_s:.2f} s after its first sample" if log.sampled_s else "before any samples"
    reason = f"the log ends {when}: fetch it from the vehicle again, whole"
    return unread(id, log.path, "unknown", reason)
