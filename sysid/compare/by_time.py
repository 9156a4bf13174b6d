"""When a model fails: in windows of time, at small and large amplitude, and as the flight condition changes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.compare.values import LevelError, Trace, Trend, WindowError
from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.record import CYCLIC, RATES, Record, axis_of
from sysid.model.structure import FloatArray

WINDOW_S = 2.0
ENVELOPE_S = 1.0
LEVELS = 4
CONDITIONS = {"omega": 0.005, "airspeed": 0.03}
"""Channel -> relative variation from which on a condition counts as varied."""
TREND_FACTOR, TREND_ERRORS, TREND_CORRELATION = 2.0, 4.0, 0.6
FEWEST_WINDOWS = 8


def trace_of(names: Sequence[str], one: Spectrum, residual: ComplexArray) -> Trace:
    commands = dict(zip(names, one.in_time(one.U[: len(names)]), strict=True))
    return Trace(one.segment.record.id, one.segment.t, one.in_time(one.Y), one.in_time(residual), commands)


def window_errors(traces: Sequence[Trace], outputs: Sequence[str]) -> tuple[WindowError, ...]:
    total = np.maximum(np.sum([np.sum(one.residual**2, axis=1) for one in traces], axis=0), 1e-300)
    found = []
    for k, output in enumerate(outputs):
        for one in traces:
            step = float(one.t[1] - one.t[0])
            count = max(1, round(one.t.size * step / WINDOW_S))
            edges = np.linspace(0, one.t.size, count + 1).astype(int)
            for begin, end in itertools.pairwise(edges):
                share = float(np.sum(one.residual[k, begin:end] ** 2) / total[k])
                start = float(one.t[begin])
                found.append(WindowError(axis_of(output), one.run, start, start + (end - begin) * step, share))
    return tuple(found)


def amplitudes(outputs: Sequence[str]) -> dict[tuple[str, str], bool]:
    """(axis, channel) -> whether its size counts, not its value."""
    commands = dict(zip(RATES, CYCLIC, strict=True))
    return {
        (axis_of(output), channel): True
        for output in outputs
        for channel in (commands.get(output), output)
        if channel is not None
    }


def varied_conditions(records: Sequence[Record], outputs: Sequence[str]) -> dict[tuple[str, str], bool]:
    """Flight conditions that every run has logged and that varied."""
    found = {}
    for name, least in CONDITIONS.items():
        if all(name in record.channels for record in records):
            values = np.concatenate([record.channels[name] for record in records])
            if np.std(values) > least * abs(float(np.mean(values))) > 0:
                found.update({(axis, name): False for axis in map(axis_of, outputs)})
    return found


def level_errors(
    traces: Sequence[Trace],
    parts: Sequence[Spectrum],
    wanted: Mapping[tuple[str, str], bool],
    outputs: Sequence[str],
) -> tuple[LevelError, ...]:
    """The error while each channel was small, middling and large, every level holding like numbers of samples."""
    found = []
    rows = {axis_of(output): k for k, output in enumerate(outputs)}
    known: dict[str, tuple[FloatArray, FloatArray]] = {}
    for (axis, channel), size in wanted.items():
        if channel not in known:
            values = np.concatenate([_level(one, channel, size) for one in parts])
            known[channel] = values, np.quantile(values, np.linspace(0, 1, LEVELS + 1))
        values, edges = known[channel]
        if not edges[-1] > edges[0]:
            continue
        power = np.concatenate([one.residual[rows[axis]] ** 2 for one in traces])
        number = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, LEVELS - 1)
        total = max(float(np.sum(power)), 1e-300)
        times, errors = np.bincount(number, minlength=LEVELS), np.bincount(number, power, LEVELS)
        found += [
            LevelError(
                axis=axis,
                channel=channel,
                low=float(low),
                high=float(high),
                time_share=float(time / power.size),
                error_share=float(part / total),
            )
            for low, high, time, part in zip(edges[:-1], edges[1:], times, errors, strict=True)
        ]
    return tuple(found)


def trends(
    traces: Sequence[Trace],
    parts: Sequence[Spectrum],
    wanted: Mapping[tuple[str, str], bool],
    outputs: Sequence[str],
) -> tuple[Trend, ...]:
    """The logarithm of the error's power in windows of repeated runs, against the difference of their conditions."""
    pairs = [
        (i, j)
        for i, j in itertools.combinations(range(len(parts)), 2)
        if (a := parts[i].segment.record) is not (b := parts[j].segment.record)
        and (a.axis, a.maneuver) == (b.axis, b.maneuver)
        and abs(parts[i].samples - parts[j].samples) < 0.05 * parts[i].samples
    ]
    found = []
    for axis, channel in wanted:
        k = [axis_of(output) for output in outputs].index(axis)
        values = [_level(one, channel, False) for one in parts]
        x, y = [], []
        for i, j in pairs:
            n = min(parts[i].samples, parts[j].samples)
            edges = np.linspace(0, n, max(1, round(n * parts[i].dt / WINDOW_S)) + 1).astype(int)[:-1]
            length = np.diff(np.append(edges, n))
            x.append((np.add.reduceat(values[i][:n], edges) - np.add.reduceat(values[j][:n], edges)) / length)
            power = [np.maximum(np.add.reduceat(traces[one].residual[k, :n] ** 2, edges), 1e-300) for one in (i, j)]
            y.append(np.log(power[0] / power[1]))
        apart, ratio = (np.concatenate(one) if one else np.zeros(0) for one in (x, y))
        if apart.size < FEWEST_WINDOWS or not np.any(apart):
            continue
        low, high = (float(edge) for edge in np.quantile(np.concatenate(values), (0.05, 0.95)))
        correlation = float(apart @ ratio / np.sqrt(max((apart @ apart) * (ratio @ ratio), 1e-300)))
        factor = float(np.exp(np.clip(apart @ ratio / (apart @ apart) * (high - low), -20, 20)))
        errors = abs(correlation) * np.sqrt(apart.size / max(1 - correlation**2, 1e-12))
        significant = (
            errors > TREND_ERRORS and abs(correlation) > TREND_CORRELATION and max(factor, 1 / factor) > TREND_FACTOR
        )
        found.append(
            Trend(
                axis=axis,
                channel=channel,
                low=low,
                high=high,
                factor=factor,
                correlation=correlation,
                significant=bool(significant),
            )
        )
    return tuple(found)


def _level(one: Spectrum, channel: str, size: bool) -> FloatArray:
    """A channel on a segment's clock: its envelope over a second, or its value."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.ndimage import maximum_filter1d

    segment = one.segment
    if channel in segment.channels:
        values = segment.channels[channel]
    else:
        record = segment.record
        values = np.interp(segment.t, record.t, record.channels[channel])
    if not size:
        return values
    width = max(1, round(ENVELOPE_S / segment.dt))
    return np.asarray(maximum_filter1d(np.abs(values - np.mean(values)), width))
