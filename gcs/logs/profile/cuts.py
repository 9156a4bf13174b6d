"""Where a log's own columns say that a maneuver was flown: [settings] of a profile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.tables import FloatArray, Log, Series
from gcs.logs.profile.mapping import onto
from gcs.logs.profile.profiles import Axis, Cut, Profile, Settings
from gcs.logs.profile.sources import bind


@dataclass(frozen=True, eq=False, kw_only=True)
class _Flown:
    """What the settings' fields hold, on the clock of `active`, shape (n,); None where no field is named."""

    t: FloatArray
    active: FloatArray
    axis: FloatArray | None
    f_start_hz: FloatArray | None
    f_stop_hz: FloatArray | None
    amplitude: FloatArray | None

    def stretches(self) -> list[tuple[int, int]]:
        """First sample of each stretch in which one axis is excited, and the sample behind its last; two at least."""
        on = np.isfinite(self.active) & (self.active != 0)
        changes = np.diff(on.astype(np.int8)) != 0
        if self.axis is not None:
            changes |= on[1:] & on[:-1] & (np.diff(self.axis) != 0)
        edges = [0, *(np.flatnonzero(changes) + 1).tolist(), on.size]
        return [(start, stop) for start, stop in pairwise(edges) if on[start] and stop - start >= 2]

    def cut(self, settings: Settings, start: int, stop: int) -> Cut:
        axis = None if self.axis is None else _axis_named(settings, self.axis[start])
        maneuver = "unknown" if axis == "other" else settings.maneuver
        band = None
        if self.f_start_hz is not None and self.f_stop_hz is not None:
            band = (float(self.f_start_hz[start]), float(self.f_stop_hz[start]))
        swept = band is not None and maneuver == "chirp" and 0 < band[0] < band[1] < math.inf
        return Cut(
            start_s=float(self.t[start]),
            stop_s=float(self.t[stop - 1]),
            maneuver=maneuver,
            axis=None if axis == "other" else axis,
            swept_band_hz=band if swept else None,
            law=settings.law,
            c1=settings.c1,
            fade_in_s=settings.fade_in_s,
            fade_out_s=settings.fade_out_s,
            amplitude=None if self.amplitude is None else float(self.amplitude[start]),
        )


def cuts_by_settings(profile: Profile, log: Log) -> tuple[tuple[Cut, ...], tuple[str, ...]]:
    """The stretches in which the profile's settings say that a maneuver was flown, and what to tell about them.

    Raises TippathError where a field that holds a setting is missing.
    """
    settings = profile.settings
    if settings is None:
        return (), ()
    flown = _flown(profile.name, settings, log)
    stretches = flown.stretches()
    if not stretches:
        return (), (f"{settings.active} is zero throughout: by its settings no maneuver was flown",)
    cuts = tuple(flown.cut(settings, start, stop) for start, stop in stretches)
    if flown.amplitude is None:
        return cuts, ()
    amplitudes = ", ".join(f"{float(flown.amplitude[start]):g}" for start, _ in stretches)
    return cuts, (f"amplitudes by the settings of the runs in order: {amplitudes}",)


def _flown(name: str, settings: Settings, log: Log) -> _Flown:
    for text in settings.sources:
        for key in bind(text, log).fields:
            if not log.has(key):
                raise TippathError(
                    f"{log.path}: {key} of [settings] in profile {name} is missing; the log has "
                    f"{', '.join(log.fields()[:12])}"
                )
    clock = log.series(bind(settings.active, log).fields[0])
    return _Flown(
        t=clock.t,
        active=_values(settings.active, clock, log),
        axis=_values_of(settings.axis, clock, log),
        f_start_hz=_values_of(settings.f_start_hz, clock, log),
        f_stop_hz=_values_of(settings.f_stop_hz, clock, log),
        amplitude=_values_of(settings.amplitude, clock, log),
    )


def _values_of(text: str | None, clock: Series, log: Log) -> FloatArray | None:
    return None if text is None else _values(text, clock, log)


def _values(text: str, clock: Series, log: Log) -> FloatArray:
    expression = bind(text, log)
    aligned = {key: onto(clock, log.series(key), held=True) for key in expression.fields}
    return np.broadcast_to(expression.evaluate(aligned), clock.t.shape)


def _axis_named(settings: Settings, value: float) -> Axis | Literal["other"]:
    place = int(value) if math.isfinite(value) else -1
    return settings.axes[place] if 0 <= place < len(settings.axes) else "other"
