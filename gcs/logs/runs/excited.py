"""Maneuvers found by their excitation alone, in logs that say nothing about them.

Chirps (`gcs.logs.runs.sweeps`) and doublets (`gcs.logs.runs.doublets`) are looked for in every command. The commands
include what the controller adds, so the axis is the one whose command is strongest at the high end, where vehicles
hardly answer and feedback is weakest; a logged excitation goes before them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.tables import FloatArray, Log
from gcs.logs.profile import mapping
from gcs.logs.profile.profiles import Profile
from gcs.logs.runs.doublets import trains_in
from gcs.logs.runs.span import Span
from gcs.logs.runs.sweeps import SHORTEST_S, Sweep, sweeps_in

NOTE = "found by its excitation, no settings in the log"
COMMANDS = (("delta_x", "roll"), ("delta_y", "pitch"), ("delta_e", "elevator"))
EXCITATIONS = tuple((name.replace("delta_", "excitation_"), axis) for name, axis in COMMANDS)

SLOWEST_S = 0.1
"""Commands that come more seldom show no chirp; times in other units than seconds look so, too."""
LONGEST_LOG_S = 6 * 3600.0
"""No battery lasts longer: the clock of such a log has jumped, and the grid over it would fill the memory."""
REST_S = 0.5
"""A logged excitation that is zero for so long has ended; a sweep passes through zero within a sample."""
NEAR_S = 3.0
"""What the edges found may be off the true ones by, with a fade."""


def find(log: Log, profile: Profile) -> list[Span]:
    """The maneuvers that the mapped commands of a log show, in order of time; none where they are not logged."""
    channels = commands(log, profile)
    return [] if channels is None else find_in(channels)


def commands(log: Log, profile: Profile) -> Mapping[str, FloatArray] | None:
    """Rates, commands and logged excitations on one clock, (n,) each; None where the profile does not find them."""
    wanted = {"p", "q", *(name for name, _ in (*COMMANDS, *EXCITATIONS))}
    only = {name: source for name, source in profile.channels.items() if name in wanted}
    try:
        return mapping.apply(replace(profile, channels=only), log).channels
    except TippathError:
        return None


def find_in(channels: Mapping[str, FloatArray]) -> list[Span]:
    """The maneuvers in channels of shape (n,) on one clock `t`."""
    t = channels["t"]
    length_s = float(t[-1] - t[0])
    if t.size < 8 or not SHORTEST_S <= length_s <= LONGEST_LOG_S or float(np.median(np.diff(t))) > SLOWEST_S:
        return []
    logged = {axis: channels[name] for name, axis in EXCITATIONS if name in channels and np.any(channels[name])}
    signals = logged or {axis: channels[name] for name, axis in COMMANDS if name in channels}
    spans = _chirps(t, signals, exact=bool(logged))
    spans += [span for span in _doublets(t, signals) if not any(_overlap(span, chirp) for chirp in spans)]
    spans.sort(key=lambda span: span.start_s)
    edges = [-math.inf, *((a.stop_s + b.start_s) / 2 for a, b in pairwise(spans)), math.inf]
    return [replace(span, first_s=edges[i], last_s=edges[i + 1]) for i, span in enumerate(spans)]


def _overlap(a: Span, b: Span) -> bool:
    return a.start_s < b.stop_s and b.start_s < a.stop_s


def _strongest(spans: Sequence[tuple[Span, float]]) -> list[Span]:
    """Of spans at the same time the one of the greatest strength."""
    kept: list[Span] = []
    for span, _ in sorted(spans, key=lambda each: -each[1]):
        if not any(_overlap(span, other) for other in kept):
            kept.append(span)
    return kept


def _chirps(t: FloatArray, signals: Mapping[str, FloatArray], exact: bool) -> list[Span]:
    """Of each time the axis with most power at its high end. `exact`: the signals are zero outside a maneuver."""
    spans = []
    for axis, values in signals.items():
        for sweep in sweeps_in(t, values):
            placed = _where_it_is_not_zero(sweep, t, values) if exact else sweep
            spans.append((_as_span(placed, axis), sweep.high_power))
    return _strongest(spans)


def _doublets(t: FloatArray, signals: Mapping[str, FloatArray]) -> list[Span]:
    """Of each time the axis with the highest jumps."""
    spans = [
        (_span(start, stop, maneuver="doublet", axis=axis, notes=(NOTE,)), height)
        for axis, values in signals.items()
        for start, stop, height in trains_in(t, values)
    ]
    return _strongest(spans)


def _where_it_is_not_zero(sweep: Sweep, t: FloatArray, put_in: FloatArray) -> Sweep:
    """A logged excitation is exactly zero before and after: the sweep from its first sample to its last."""
    on = np.flatnonzero(put_in)
    parts = np.split(on, np.flatnonzero(np.diff(t[on]) > REST_S) + 1)
    middle = (sweep.start_s + sweep.stop_s) / 2
    for part in parts:
        start, stop = float(t[part[0]]), float(t[part[-1]])
        if start <= middle <= stop and max(sweep.start_s - start, stop - sweep.stop_s) < NEAR_S:
            return replace(sweep, start_s=start, stop_s=stop)
    return sweep


def _as_span(sweep: Sweep, axis: str) -> Span:
    band = sweep.band_hz
    note = f"{NOTE}; swept about {band[0]:.1f}-{band[1]:.1f} Hz"
    span = _span(sweep.start_s, sweep.stop_s, maneuver="chirp", axis=axis, notes=(note,))
    return replace(span, swept_band_hz=band, track=(sweep.times, sweep.frequency_hz))


def _span(start_s: float, stop_s: float, *, maneuver: str, axis: str, notes: tuple[str, ...]) -> Span:
    """With edges that nothing is known of."""
    return Span(
        start_s=start_s,
        stop_s=stop_s,
        first_s=-math.inf,
        last_s=math.inf,
        maneuver=maneuver,
        axis=axis,
        notes=notes,
    )
