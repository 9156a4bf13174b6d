"""What an error of a model's response does to the margins of the loop that would be designed on it.

What the commands explain of a fit's error is a difference of response, and is estimated in windows of frequency about
the crossings of that loop. To first order it moves the loop's eigenvalues there, and with them its margins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.control.regulator import DesignError, Gains, NotHeldError, design, designs_on
from sysid.control.stability import (
    SENSIBLE_GAIN_DB,
    SENSIBLE_PHASE_DEG,
    Margins,
    crossings_hz,
    from_rates,
    rates_per_command,
)
from sysid.data.record import CYCLIC, RATES
from sysid.diagnose.evidence import Candidate
from sysid.model.structure import FloatArray, Model

UPPER = 1.645
"""Standard errors to the upper 95 % limit."""
WINDOW_HZ = 0.5
"""About a crossing, within which an error of the response counts as one complex matrix;"""
FEWEST = 8
"""bins beyond its unknowns, and how the window grows until it has them."""
WIDER = 1.5
NEAR = 0.01
"""Of a frequency, to either side: the slope of a locus;"""
DB = 20 / math.log(10)
"""and dB of one in the logarithm of its size."""
LARGEST_GAIN_DB, LARGEST_PHASE_DEG = 40.0, 180.0
"""Margins beyond which more makes no difference."""


@dataclass(frozen=True, slots=True)
class Limit:
    """Changes of margins from which on an error matters: a sixth and a ninth of what leaves room for the unknown."""

    gain_db: float = SENSIBLE_GAIN_DB / 6
    phase_deg: float = SENSIBLE_PHASE_DEG / 9


@dataclass(frozen=True, kw_only=True, slots=True)
class MarginChange:
    """Of the loop that is designed on the fit."""

    gain_db: float
    phase_deg: float

    def over(self, limit: Limit) -> float:
        """The larger of both, over its limit."""
        return max(self.gain_db / limit.gain_db, self.phase_deg / limit.phase_deg)


def parse_limit(words: str) -> Limit:
    """`1dB,5deg`, either alone leaving the other as usual. Raises ValueError."""
    known = {"db": "gain_db", "deg": "phase_deg", "°": "phase_deg"}
    given: dict[str, float] = {}
    for word in words.split(","):
        text = word.strip().lower()
        unit = next((one for one in known if text.endswith(one)), None)
        size = float(text.removesuffix(unit)) if unit else math.nan
        if unit is None or not (size > 0 and math.isfinite(size)) or known[unit] in given:
            raise ValueError(word)
        given[known[unit]] = size
    return Limit(**given)


def held_gains(model: Model) -> Gains | None:
    """Gains that hold a model: the usual ones, else those that are offered instead; None where there are none."""
    if not designs_on(model.structure) or not model.structure.linear:
        return None
    try:
        return design(model)
    except NotHeldError as error:
        return error.instead
    except DesignError:
        return None


def seen(one: Candidate) -> MarginChange | None:
    """The 95 % limit of what the error that the commands explain does to margins of the loop designed on a fit.

    The error of the response is estimated about each crossing of the loop that lies in the band, and moves the loop's
    eigenvalues there to first order. None without gains that hold the model, or without a crossing in the band.
    """
    gains = held_gains(one.model)
    commands = one.dataset.causes.commands
    if gains is None or set(CYCLIC) - set(commands) or one.model.structure.outputs != RATES:
        return None
    units, reals = crossings_hz(gains, one.model)
    low, high = one.dataset.band_hz
    units, reals = (each[(each > low) & (each < high)] for each in (units, reals))
    if not units.size and not reals.size:
        return None
    bins = _Left.of(one)
    phase = _lost([_edge(gains, one.model, bins, float(hz), gain=False) for hz in units])
    gain = _lost([_edge(gains, one.model, bins, float(hz), gain=True) for hz in reals])
    return MarginChange(gain_db=float(gain), phase_deg=float(phase))


def _lost(edges: list[tuple[float, float]]) -> float:
    """Of the least of margins, each with how much smaller it may be; 0 of none."""
    if not edges:
        return 0.0
    return min(margin for margin, _ in edges) - min(margin - less for margin, less in edges)


@dataclass(frozen=True, eq=False)
class _Left:
    """What a fit leaves beside what the excitation caused in the commands, on all bins."""

    frequency_hz: FloatArray
    residual: Any
    """(outputs, bins)"""
    caused: Any
    """(commands, bins)"""

    @classmethod
    def of(cls, one: Candidate) -> _Left:
        stacks, causes = one.dataset.stacks, one.dataset.causes
        rows = [causes.commands.index(name) for name in CYCLIC]
        scale = np.concatenate([group.scale for group in stacks])
        return cls(
            np.concatenate([group.frequency_hz for group in stacks]),
            scale * np.concatenate(one.estimate.error.residuals, axis=1),
            scale * np.concatenate([each[rows] for each in causes.caused], axis=1),
        )

    def about(self, hz: float) -> tuple[Any, Any, Any]:
        """Error of the response (outputs, commands), spectrum of what it leaves, and inverse power of the commands."""
        half = 0.5 * WINDOW_HZ
        while np.count_nonzero(np.abs(self.frequency_hz - hz) <= half) < FEWEST + len(self.caused):
            half *= WIDER
        here = np.abs(self.frequency_hz - hz) <= half
        E, X = self.residual[:, here], self.caused[:, here]
        inverse = np.linalg.pinv(X @ X.conj().T, rcond=1e-9, hermitian=True)
        D = E @ X.conj().T @ inverse
        rest = E - D @ X
        return D, rest @ rest.conj().T / (E.shape[1] - len(X)), inverse


def _edge(gains: Gains, model: Model, left: _Left, hz: float, *, gain: bool) -> tuple[float, float]:
    """Margin of the eigenvalue of the loop that crosses the negative axis (gain, dB) or the unit circle (degrees) at
    this frequency, and the 95 % limit of its change: at the frequency where it crosses then."""
    s = 2j * np.pi * hz * np.array([1 - NEAR, 1.0, 1 + NEAR])
    controller = from_rates(gains, s)
    loop = controller @ rates_per_command(model, s)
    values, right = np.linalg.eig(loop[1])
    which = int(np.argmin(np.abs(np.angle(-values)) if gain else np.abs(np.log(np.abs(values)))))
    value = values[which]
    below, above = (each[np.argmin(np.abs(each - value))] for each in np.linalg.eigvals(loop[[0, 2]]))
    along = np.log(above / below)
    D, S, inverse = left.about(hz)
    a, b = (np.linalg.inv(right) @ controller[1])[which], right[:, which]
    spread = math.sqrt(float(np.real(a @ S @ a.conj())) * float(np.real(b.conj() @ inverse @ b))) / abs(value)
    moved, path = (each if gain else each / 1j for each in ((a @ D @ b) / value, along))
    # the real part of `moved` is the margin's, and what the other makes of it on the way to where it crosses
    slope = float(path.real / path.imag) if path.imag else math.inf
    less = abs(float(moved.real) - slope * float(moved.imag)) + UPPER * spread * math.hypot(1, slope) / math.sqrt(2)
    if gain:
        return -DB * math.log(abs(value)), DB * float(less)
    return math.degrees(abs(np.angle(-value))), min(math.degrees(float(less)), LARGEST_PHASE_DEG)


def of_margins(here: Margins, there: Margins) -> MarginChange:
    gain = [min(one.gain_db, LARGEST_GAIN_DB) for one in (here, there)]
    phase = [min(one.phase_deg, LARGEST_PHASE_DEG) for one in (here, there)]
    return MarginChange(gain_db=abs(gain[1] - gain[0]), phase_deg=abs(phase[1] - phase[0]))
