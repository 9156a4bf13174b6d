"""Chirps by their law, and the excitation of a run rebuilt from one: what was flown, where nobody logged it.

A rebuilt chirp is as good an instrument as a logged one, for no gust had a part in it. Its start is known from the log
to a fraction of a second and is found in the command it was added to; what a few milliseconds are off is no harm, for
the loop from excitation to command is measured anyway. Noise that was flown with the chirp stays unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sysid.data.record import FloatArray, Record

Law = Literal["ardupilot", "tischler"]
LETTERS = {"roll": "x", "pitch": "y", "elevator": "e"}
STEP_CYCLES = 0.1
"""Of the highest frequency, between the starts that are tried."""
LEAST_SHARE = 0.1
"""Of the command's power while it was flown, that the chirp must explain to be believed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Chirp:
    """A sweep from one frequency to a higher one, faded in and out by a cosine."""

    axis: str
    """`roll`, `pitch` or `elevator`."""
    law: Law
    """`ardupilot`: two periods of the first frequency, then exponential; `tischler`: with `c1`, by Table 1."""
    f_start_hz: float
    f_stop_hz: float
    duration_s: float
    amplitude: float | None = None
    """Of full command; None: as the command shows it."""
    fade_in_s: float = 0.0
    fade_out_s: float = 0.0
    c1: float = 4.0
    flown_s: float = math.inf
    """How far it came, where it ended early."""

    @property
    def makes_sense(self) -> bool:
        """Whether there is such a chirp."""
        held = 2 / self.f_start_hz if self.law == "ardupilot" and self.f_start_hz > 0 else 0.0
        numbers = (self.f_start_hz, self.f_stop_hz, self.duration_s, self.fade_in_s, self.fade_out_s, self.c1)
        return all(map(math.isfinite, numbers)) and (
            0 < self.f_start_hz < self.f_stop_hz
            and self.duration_s > held
            and min(self.fade_in_s, self.fade_out_s) >= 0
            and 0 < self.c1 < 50
            and self.axis in LETTERS
        )

    def wave(self, since_s: FloatArray) -> FloatArray:
        """At times since its start, of amplitude one; zero before and after, shape (n,)."""
        t, T = since_s, self.duration_s
        flown = (t >= 0) & (t < min(T, self.flown_s))
        t = np.clip(t, 0.0, T)
        low, high = 2 * math.pi * self.f_start_hz, 2 * math.pi * self.f_stop_hz
        if self.law == "tischler":
            phase = low * t + (high - low) * (T / self.c1 * np.expm1(self.c1 * t / T) - t) / math.expm1(self.c1)
        else:
            held_s = 2 / self.f_start_hz
            growth = math.log(high / low) / (T - held_s)
            phase = low * np.where(t < held_s, t - held_s, np.expm1(growth * np.maximum(t - held_s, 0)) / growth)
        size = flown.astype(np.float64)
        for fade_s, after in ((self.fade_in_s, t), (self.fade_out_s, T - t)):
            if fade_s > 0:
                size *= 0.5 - 0.5 * np.cos(math.pi * np.clip(after / fade_s, 0.0, 1.0))
        return np.asarray(size * np.sin(phase))


@dataclass(frozen=True, slots=True)
class Placed:
    """Where a chirp lies in a run."""

    start_s: float
    error_s: float
    """Of it, by chance, by feedback, and by what was known before."""
    amplitude: float
    share: float
    """Of the command's power while it was flown, that the chirp explains."""


def placed(chirp: Chirp, t: FloatArray, command: FloatArray, start_s: float, within_s: float) -> Placed | None:
    """A chirp found in the command (n,) that it was added to, its start being known to `within_s`.

    None where the command does not show it there.
    """
    spacing = STEP_CYCLES / chirp.f_stop_hz
    during = (t >= start_s - within_s) & (t <= start_s + within_s + min(chirp.duration_s, chirp.flown_s))
    if np.count_nonzero(during) < 8:
        return None
    t, u = t[during], command[during] - float(np.mean(command[during]))
    count = max(2, math.ceil(within_s / spacing))
    starts = start_s + spacing * np.arange(-count, count + 1)
    explained = np.array([_explained(chirp.wave(t - start), u) for start in starts])
    at = int(np.argmax(explained))
    if not 0 < at < starts.size - 1:
        return None
    before, best, after = map(float, explained[at - 1 : at + 2])
    bend = 2 * best - before - after
    start = float(starts[at] + (0.5 * spacing * (after - before) / bend if bend > 0 else 0.0))
    wave = chirp.wave(t - start)
    share = _explained(wave, u) / max(float(u @ u), 1e-300)
    size = float(wave @ u) / max(float(wave @ wave), 1e-300)
    if share < LEAST_SHARE or size <= 0:
        return None
    slope = float(np.mean(np.gradient(wave, t) ** 2))
    left = (1 - share) * float(u @ u) / t.size
    # what is left changes about as fast as the chirp: so many values of it are independent
    alone = max(2.0, 2 * chirp.f_stop_hz * float(t[-1] - t[0]))
    by_chance = math.sqrt(left / (size**2 * max(slope, 1e-300) * alone))
    # or it is feedback, which follows the chirp a quarter period late at worst
    by_feedback = math.atan2(math.sqrt(1 - share), math.sqrt(share)) * math.sqrt(float(np.mean(wave**2)) / slope)
    variance, known = by_chance**2 + by_feedback**2, (0.5 * within_s) ** 2
    start = (start * known + start_s * variance) / (known + variance)
    return Placed(start, math.sqrt(variance * known / (known + variance)), size, share)


def _explained(wave: FloatArray, u: FloatArray) -> float:
    return max(float(wave @ u), 0.0) ** 2 / max(float(wave @ wave), 1e-300)


def with_excitation(record: Record, chirp: Chirp, start_s: float, within_s: float, source: str) -> Record | None:
    """The run with the chirp as its excitation, as `source` tells of it; None where its command does not show it.

    Other axes were excited by nothing that is known.
    """
    command = f"delta_{LETTERS[chirp.axis]}"
    if command not in record.channels:
        return None
    place = placed(chirp, record.t, record.channels[command], start_s, within_s)
    if place is None:
        return None
    amplitude = place.amplitude if chirp.amplitude is None else chirp.amplitude
    nothing = np.zeros(record.t.size)
    made = {f"excitation_{letter}": nothing for letter in LETTERS.values() if f"delta_{letter}" in record.channels}
    made[f"excitation_{LETTERS[chirp.axis]}"] = amplitude * chirp.wave(record.t - place.start_s)
    note = (
        f"excitation rebuilt from {source}: from {place.start_s:.3f} ± {place.error_s:.3f} s, "
        f"{100 * place.share:.0f} % of {command}"
    )
    return replace(record, channels={**record.channels, **made}, excitation_from=source, notes=(*record.notes, note))
