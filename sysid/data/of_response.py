"""A measured frequency response as a record: one period of a sweep that a vehicle of just this response would answer.

What fits, comparisons and diagnoses work on are Fourier bins of commands and rates. A response is bins already: the
command is given each bin of the response's range with the size by which it is to count, and phases of a sweep
(Schroeder, "Synthesis of low-peak-factor signals", 1970); the rates are the response times it. Periodic, so that no end
leaks; nothing lies beyond the range, and `sysid.data.preprocess.spectrum` takes no bin from there.

A response that was measured errs by a share of its size: sqrt((1 - c) / (2 c)) over the root of how many records were
averaged, c the coherence (Bendat and Piersol, "Random Data", ch. 9). Each bin counts by one over that error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.data.preprocess import MINIMUM_SEGMENT_S, RESPONSE, ComplexArray, excitation_of
from sysid.data.record import AXIS_OF, CYCLIC, RATES, FloatArray, Record, RecordError

FEWEST_POINTS = 8
MOST_BINS = 100
"""Responses are listed more densely than windows resolve: neighbours that err alike would count for more than one."""
SAMPLES_OF_A_PERIOD = 64
"""At the highest frequency: what holding and sampling fold back is then 0.1 % of a response."""
LEAST_ERROR = 0.05
"""Of a response's size: coherence near one says little of errors that all of it has in common."""
WIDEST_GAP = 2 ** (1 / 3)
"""From a point to the next, as a ratio of frequencies: what lies between them is read off their neighbours."""
PEAK = 0.1
"""Of the command that is made up."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Response:
    """One output per one command."""

    output: str
    command: str
    frequency_hz: FloatArray
    """(f,), in any order."""
    H: ComplexArray
    """(f,), output per full command; not finite where it is not known."""
    relative_error: FloatArray | None = None
    """(f,), standard error over size; None where nothing is told of it."""


def error_of_coherence(coherence: FloatArray) -> FloatArray:
    """Standard error of a response over its size, for one record, from its coherence; NaN where that is none."""
    c = np.where((coherence > 0) & (coherence <= 1), coherence, np.nan)
    return np.asarray(np.sqrt((1 - c) / (2 * c)))


def record_of(responses: Sequence[Response], id: str, path: str, sha256: str) -> Record:
    """The record of all outputs' responses to one command. Raises RecordError where too little of them is known."""
    command = responses[0].command
    if any(one.command != command for one in responses):
        raise ValueError("responses to more than one command")
    known = [_known(one, id) for one in responses]
    low = max(float(one.frequency_hz[0]) for one in known)
    high = min(float(one.frequency_hz[-1]) for one in known)
    inside = min(int(np.count_nonzero((one.frequency_hz >= low) & (one.frequency_hz <= high))) for one in known)
    if inside < FEWEST_POINTS:
        raise RecordError(f"{id}: {inside} points from {low:g} to {high:g} Hz; {FEWEST_POINTS} are the least for a fit")
    period_s = max(MINIMUM_SEGMENT_S, 1 / low, min(inside, MOST_BINS) / (high - low))
    rate_hz = SAMPLES_OF_A_PERIOD * high
    samples = int(np.ceil(period_s * rate_hz)) + 1  # what is a hair too short is no segment
    period_s = samples / rate_hz
    numbers = np.arange(int(np.ceil(low * period_s - 1e-9)), int(high * period_s + 1e-9) + 1)
    frequency_hz = numbers / period_s
    made = [_at(one, frequency_hz) for one in known]
    size = _sizes([H for H, _ in made], [error for _, error in made])
    U = size * np.exp(-1j * np.pi * np.arange(numbers.size) ** 2 / numbers.size)
    s = 2j * np.pi * frequency_hz
    hold = (1 - np.exp(-s / rate_hz)) / (s / rate_hz)
    rows = _in_time(np.stack([U, *(H * hold * U for H, _ in made)]), numbers, samples)
    rows *= PEAK / np.max(np.abs(rows[0]))
    still = np.zeros(samples)
    channels: Mapping[str, FloatArray] = {
        **dict.fromkeys((*RATES, *CYCLIC, *map(excitation_of, CYCLIC)), still),
        command: rows[0],
        excitation_of(command): rows[0],
        **{one.output: row for one, row in zip(known, rows[1:], strict=True)},
        "t": np.arange(samples) / rate_hz,
    }
    return Record(
        id,
        channels,
        maneuver=RESPONSE,
        axis=AXIS_OF.get(command),
        rate_source=RESPONSE,
        path=path,
        sha256=sha256,
        swept_band_hz=(low, high),
        notes=_notes(responses, known, (low, high), numbers.size),
    )


def _known(response: Response, id: str) -> Response:
    """In ascending order, without what is not known, between the widest gaps. Raises RecordError."""
    error = response.relative_error
    good = np.isfinite(response.frequency_hz) & (response.frequency_hz > 0) & np.isfinite(response.H)
    good &= np.abs(response.H) > 0
    if error is not None:
        good &= np.isfinite(error)
    order = np.flatnonzero(good)[np.argsort(response.frequency_hz[good], kind="stable")]
    f = response.frequency_hz[order]
    order = order[np.diff(f, prepend=0.0) > 0]  # of points at one frequency the first
    f = response.frequency_hz[order]
    pair = f"{response.output} per {response.command}"
    if f.size < FEWEST_POINTS:
        raise RecordError(f"{id}: {f.size} points of {pair} are known; {FEWEST_POINTS} are the least for a fit")
    edges = [0, *(np.flatnonzero(f[1:] > WIDEST_GAP * f[:-1]) + 1).tolist(), f.size]
    longest = int(np.argmax(np.diff(edges)))
    order = order[edges[longest] : edges[longest + 1]]
    if order.size < FEWEST_POINTS:
        raise RecordError(
            f"{id}: the points of {pair} are more than a third of an octave apart; measure it at more frequencies"
        )
    return Response(
        output=response.output,
        command=response.command,
        frequency_hz=response.frequency_hz[order],
        H=response.H[order],
        relative_error=None if error is None else error[order],
    )


def _at(response: Response, frequency_hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """The response and its relative error at these frequencies, (f,): the mean of the points nearest to each of them,
    where there are several, else what lies between its neighbours."""
    step = frequency_hz[1] - frequency_hz[0] if frequency_hz.size > 1 else np.inf
    f = response.frequency_hz
    parts = np.stack(
        [
            np.log(np.abs(response.H)),
            np.unwrap(np.angle(response.H)),
            np.ones(f.size) if response.relative_error is None else np.maximum(response.relative_error, LEAST_ERROR),
        ]
    )
    found = np.stack([np.interp(frequency_hz, f, row) for row in parts])
    for i, here in enumerate(frequency_hz):
        first, last = np.searchsorted(f, (here - 0.5 * step, here + 0.5 * step))
        near = slice(first, last)
        if last - first > 2:
            mean = np.mean(f[near])
            found[:, i] += np.mean(parts[:, near], axis=1) - np.array([np.interp(mean, f, row) for row in parts])
    return np.exp(found[0] + 1j * found[1]), found[2]


def _sizes(H: Sequence[ComplexArray], errors: Sequence[FloatArray]) -> FloatArray:
    """How large the command is to be at each frequency, (f,): one over the error of the answers.

    Of several outputs each counts alike on the whole; a command that shall suit all has the mean of their errors.
    """
    absolute = [np.abs(h) * error for h, error in zip(H, errors, strict=True)]
    squares = [(each / np.sqrt(np.mean(each**2))) ** 2 for each in absolute]
    return np.asarray(1 / np.sqrt(np.mean(squares, axis=0)))


def _in_time(bins: ComplexArray, numbers: NDArray[np.intp], samples: int) -> FloatArray:
    """Bins (rows, f) of these numbers as one period, (rows, samples)."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.fft import irfft

    whole = np.zeros((len(bins), samples // 2 + 1), dtype=complex)
    whole[:, numbers] = bins
    return np.asarray(irfft(whole, samples, axis=1))


def _notes(
    responses: Sequence[Response], known: Sequence[Response], band_hz: tuple[float, float], bins: int
) -> tuple[str, ...]:
    pairs = ", ".join(one.output for one in known)
    points = min(one.frequency_hz.size for one in known)
    told = all(one.relative_error is not None for one in known)
    by = "their errors" if told else "their size, for nothing tells their errors"
    notes = [
        f"a measured response of {pairs} per {known[0].command}: {points} points from {band_hz[0]:.3g} to "
        f"{band_hz[1]:.3g} Hz, weighed by {by}; fitted at {bins} frequencies"
    ]
    if any(one.frequency_hz.size < each.frequency_hz.size for one, each in zip(known, responses, strict=True)):
        notes.append("points without a number, or beyond a gap of more than a third of an octave, are left out")
    return tuple(notes)
