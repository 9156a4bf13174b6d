"""Where over frequency a model fails: in bands around its modes, and in each response beside the measured one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sysid.compare.data_checks import mistaken_signs
from sysid.compare.finding_kinds import Suspicion
from sysid.compare.metrics import ModelResponses, mismatches
from sysid.compare.noise import NoiseShare, window_of
from sysid.compare.on_runs import ModelOnRuns
from sysid.compare.values import BandError, ResponseError
from sysid.data.record import Record, axis_of
from sysid.fit.noise import Division
from sysid.model.structure import FloatArray, Model

OCTAVE_PARTS = 2.5
"""Bands wider than this factor are cut."""
CLOSE_EDGES = 1.3
"""Edges of bands keep this factor between them."""
AROUND_MODE = 2**0.5
NOTICED = 3.0
"""Standard errors of a measured response."""


def band_edges(model: Model, records: Sequence[Record], band_hz: tuple[float, float]) -> FloatArray:
    """Edges of bands in Hz: the sweep's ends, half an octave to either side of each mode, octaves between.

    Where the sweep is not known its place is taken by 0.5 Hz and the band's end.
    """
    low, high = band_hz
    swept = [record.swept_band_hz for record in records if record.swept_band_hz is not None]
    first = min((band[0] for band in swept), default=0.5)
    last = max((band[1] for band in swept), default=high)
    edges = [low, high]

    def add(edge: float) -> None:
        apart = all(max(edge, one) >= CLOSE_EDGES * min(edge, one) for one in edges if one > 0)
        if low < edge < high and apart:
            edges.append(edge)

    add(first)
    add(last)
    for mode in sorted(model.modes, key=lambda one: one.frequency_hz):
        if first < mode.frequency_hz < last and abs(mode.damping_ratio) < 1:
            add(mode.frequency_hz / AROUND_MODE)
            add(mode.frequency_hz * AROUND_MODE)
    edges.sort()
    found = [edges[0]]
    for edge in edges[1:]:
        ratio = edge / found[-1] if found[-1] > 0 else 1.0
        parts = max(1, int(np.ceil(np.log(ratio) / np.log(OCTAVE_PARTS) - 1e-9)))
        found += [found[-1] * ratio ** (i / parts) for i in range(1, parts)] + [edge]
    return np.array(found)


def band_errors(on: ModelOnRuns, division: Division, noise: NoiseShare) -> tuple[BandError, ...]:
    """The error in each band and output, and what of it noise and the commands make."""
    frequency, power = on.frequency_hz, on.power
    window = window_of(frequency, division.edges_hz)
    edges = band_edges(on.model, on.records, on.dataset.band_hz)
    band = np.clip(np.searchsorted(edges, frequency, side="left") - 1, 0, edges.size - 2)
    floor = np.maximum(division.power, 1e-300)
    found = []
    for k, output in enumerate(on.outputs):
        total = max(float(np.sum(power[k])), 1e-300)
        for number in range(edges.size - 1):
            at = band == number
            here = power[k, at]
            whole = max(float(np.sum(here)), 1e-300)

            def share(part: FloatArray, at: Any = at, here: FloatArray = here, whole: float = whole) -> float:
                """Of the band's error what a share (w,) of each window makes."""
                return float(np.clip(np.sum(here * part[window[at]]) / whole, 0, 1))

            found.append(
                BandError(
                    axis=axis_of(output),
                    low_hz=float(edges[number]),
                    high_hz=float(edges[number + 1]),
                    error_share=float(np.sum(here) / total),
                    noise_share=None
                    if noise.share is None
                    else float(np.clip(np.sum(noise.levels[window[at], k]) / whole, 0, 1))
                    if np.any(at)
                    else 0.0,
                    coherence={
                        name: share(division.by_command[:, k, m] / floor[:, k])
                        for m, name in enumerate(division.commands)
                    },
                    coherence_together=share(division.explained[:, k] / floor[:, k]),
                )
            )
    return tuple(found)


def response_errors(on: ModelOnRuns) -> tuple[tuple[ResponseError, ...], list[Suspicion]]:
    """Every response beside the measured one with what noise allows, and what its signs look like."""
    responses = ModelResponses.of(on.model, on.stacks, on.error)
    compared = mismatches(responses)
    cut, expected, left, each = responses.windows, responses.expected, responses.left, []
    for one in compared.each:
        k, m = on.outputs.index(one.output), cut.commands.index(one.command)
        with np.errstate(divide="ignore", invalid="ignore"):
            measured, missing = expected[k, m] + left.H[k, m], np.abs(left.H[k, m])
            ratio = expected[k, m] / measured
            chance = NOTICED * np.sqrt(left.variance[k, m])
            allowed = chance / np.abs(measured)  # of the measured response's own size
            allowed = np.where(allowed < 1, allowed, np.nan)
            decibels, degrees = 20 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
            noticed = missing > chance
            each.append(
                ResponseError(
                    mismatch=one,
                    frequency_hz=cut.frequency_hz,
                    decibels=decibels,
                    degrees=degrees,
                    allowed_db=np.asarray(20 * np.log10(1 + allowed)),
                    allowed_deg=np.asarray(np.degrees(np.arcsin(allowed))),
                    noticed=_stretches(cut.frequency_hz, noticed),
                    measured=measured,
                )
            )
    return tuple(each), mistaken_signs(compared.measured)


def _stretches(frequency_hz: FloatArray, good: Any) -> tuple[tuple[float, float], ...]:
    """Bands of at least two neighbouring points, single points between them bridged."""
    at = np.flatnonzero(good)
    parts = np.split(at, np.flatnonzero(np.diff(at) > 2) + 1)
    return tuple((float(frequency_hz[one[0]]), float(frequency_hz[one[-1]])) for one in parts if one.size >= 2)
