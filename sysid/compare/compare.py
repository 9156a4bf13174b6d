"""Where a model fails on flown runs: its error divided by frequency, time, amplitude and flight condition.

The error is what the fit's own criterion leaves: the residual in the band, trims and end states taken out, every sample
of every run counting the same. By Parseval its power is the same over frequency and over time, so all divisions add up
to one. Noise is told from error by what was recorded (`sysid.fit.noise`), and by quiet hover where it was flown: there
no command moves, and the residual is noise alone. What quiet hover does not show and the commands do not explain
linearly is the work of a nonlinearity, or of rougher air.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.compare.data_checks import Suspicion, clipped, mistaken_axes, mistaken_signs, mixed, not_separable
from sysid.compare.findings import findings
from sysid.compare.metrics import mismatch
from sysid.compare.spectrum import windows
from sysid.compare.values import (
    GROWTH_ERRORS,
    GROWTH_RATIO,
    BandError,
    Comparison,
    Densities,
    Growth,
    LevelError,
    ResponseError,
    RunError,
    Trace,
    Trend,
    WindowError,
)
from sysid.data.instrument import causes
from sysid.data.preprocess import ComplexArray, Spectrum, spectra
from sysid.data.record import AXIS_OF, Record
from sysid.data.stacks import Stack, stack
from sysid.errors import SysidError
from sysid.fit.noise import LEAST_FREEDOM, Division, divide
from sysid.fit.output_error import OutputError, output_error
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model

__all__ = ["CompareError", "Comparison", "band_edges", "compare"]
OCTAVE_PARTS = 2.5
"""Bands wider than this factor are cut."""
CLOSE_EDGES = 1.3
"""Edges of bands keep this factor between them."""
AROUND_MODE = 2**0.5
SLOWEST_HZ = 0.45
"""Below it drift and wind are more than the sweep."""
WINDOW_S = 2.0
ENVELOPE_S = 1.0
LEVELS = 4
CONDITIONS = {"omega": 0.005, "airspeed": 0.03}
"""Channel -> relative variation from which on a condition counts as varied."""
CONTROLS = ("delta_e", "delta_c", "delta_r", "delta_a", "r")
"""Logged channels that may move the vehicle beside the structure's own inputs."""
LEAST_CONTROL_SHARE, CONTROL_ERRORS = 0.05, 4.0
"""Of the error, and standard deviations of what noise would seem to explain, for a control to count."""
SIGNIFICANT = 0.01
SIGNIFICANT_AXIS = 2.6
"""Standard deviations of what noise alone would seem to explain: 0.5 % for each of two axes."""
TESTABLE = 0.5
"""Part of the windows that must have bins enough to tell noise from error."""
NOTICED = 3.0
"""Standard errors of a measured response."""
QUIET_ERRORS = 2.6
"""Standard errors of quiet hover's power by which it must lie below what the commands leave, to count as less."""
TREND_FACTOR, TREND_ERRORS, TREND_CORRELATION = 2.0, 4.0, 0.6
FEWEST_WINDOWS = 8


class CompareError(SysidError):
    """Runs that a model cannot be compared on; the message says why and what to do."""


# ------------------------------------------------------------------------------------------------ the whole


def compare(
    model: Model,
    records: Sequence[Record],
    band_hz: tuple[float, float],
    quiet: Sequence[Record] = (),
    *,
    own_runs: bool = True,
) -> Comparison:
    """Compare a model with flown runs.

    Runs of quiet hover, among the records or in `quiet`, measure the noise and are not compared on. `own_runs` says
    that the model was fitted to these records, so that what is left is not for its numbers to mend. Raises
    CompareError where nothing can be compared.
    """
    try:
        return _compared(model, records, band_hz, quiet, own_runs)
    except (RelaxationError, np.linalg.LinAlgError) as failure:
        raise CompareError(f"the model's response does not settle on these runs ({failure})") from failure


def _compared(
    model: Model, records: Sequence[Record], band_hz: tuple[float, float], quiet: Sequence[Record], own_runs: bool
) -> Comparison:
    structure = model.structure
    flown = [record for record in records if record.maneuver != "quiet"]
    still = [*quiet, *(record for record in records if record.maneuver == "quiet")]
    if not flown:
        raise CompareError("no run to compare on: quiet hover alone tells of noise only; name a chirp")
    _refuse_missing_channels(model, [*flown, *still])
    found, remarks = spectra(flown, structure.inputs, structure.outputs, band_hz)
    if not found:
        raise CompareError(f"no run has 2 s of gap-free samples: nothing to compare on. {'; '.join(remarks)}".strip())
    found = [one for one in found if one.frequency_hz.size]
    if not found:
        raise CompareError(f"no frequency lies in {band_hz[0]:g}-{band_hz[1]:g} Hz: widen the band or take longer runs")
    stacks = stack(found)
    parts = [one for group in stacks for one in group.spectra]
    error = output_error(model, stacks)
    if not np.all(error.measured_power > 0):
        dead = ", ".join(name for name, x in zip(structure.outputs, error.measured_power, strict=True) if not x > 0)
        raise CompareError(f"{dead} does not move at all in these runs: check the gyro's channel")
    by = causes(stacks, structure.commands)
    commanded = divide(error, stacks, by)
    alone = _Alone(model, parts, error)
    responses, suspected = _responses(model, found)
    power = _power(error, stacks)
    whole = np.maximum(error.residual_power, 1e-300)
    controls, division = _controls(model, flown, band_hz, stacks, error, commanded)
    levels = _Levels.of(division, stacks)
    calm = _quiet_levels(model, still, band_hz, division.edges_hz, remarks)
    noise = _Noise.of(division, commanded.measured, levels, calm, power)
    runs = alone.runs()
    growth = _growth(runs, alone, structure.outputs) if commanded.measured else ()
    mixture = mixed(
        alone.ids,
        [(one.axis, one.maneuver) for one in runs],
        alone.power,
        alone.explained,
        across=commanded.measured,
        amplitudes=bool(growth),
    )
    if mixture:
        # what a response of their own explains of the runs is no noise
        noise = noise.at_most(1 - np.sum([alone.explained([i]) for i in range(len(runs))], axis=0) / whole)
    bands = _bands(model, flown, band_hz, stacks, power, division, noise)
    traces = tuple(
        _trace(structure.commands, one, residual) for one, residual in zip(parts, error.residuals, strict=True)
    )
    in_time = _windows(traces, structure.outputs)
    suspicions = [
        *clipped(flown),
        *mistaken_axes(flown),
        *suspected,
        *mixture,
        *not_separable(structure, found),
    ]
    outputs = structure.outputs
    shares = None if noise.share is None else dict(zip(outputs, map(float, noise.share), strict=True))
    left = whole / error.measured_power
    floor = None if noise.share is None else 100 * (1 - np.sqrt(noise.share * left))
    result = Comparison(
        outputs,
        structure.commands,
        by.references,
        band_hz,
        dict(zip(outputs, map(float, error.nrmse_percent), strict=True)),
        shares,
        None if floor is None else dict(zip(outputs, map(float, floor), strict=True)),
        "measured" if commanded.measured or calm is not None else "upper bound, closed loop",
        noise.source,
        None if noise.ratio is None else dict(zip(outputs, map(float, noise.ratio), strict=True)),
        dict(zip(outputs, map(float, noise.distortion), strict=True)),
        dict(zip(outputs, map(bool, noise.more), strict=True)),
        noise.explained,
        bands,
        in_time,
        _by_level(traces, parts, _amplitudes(outputs)),
        _by_level(traces, parts, _varied(flown)),
        _trends(traces, parts, _varied(flown)),
        runs,
        growth,
        controls,
        responses,
        _densities(stacks, error, levels, noise),
        traces,
        tuple(suspicions),
        tuple(dict.fromkeys(remarks)),
        (),
    )
    return replace(result, findings=findings(result, own_runs))


def _refuse_missing_channels(model: Model, records: Sequence[Record]) -> None:
    for record in records:
        missing = [name for name in model.structure.inputs if name not in record.channels]
        if missing:
            needs = ", ".join(one.id for one in model.structure.composed if set(one.channels) & set(missing))
            raise CompareError(
                f"{record.id}: {', '.join(missing)} is not logged, which the fit's {needs or 'structure'} needs; "
                "compare on runs that have it, or fit without"
            )


def _power(error: OutputError, stacks: Sequence[Stack]) -> FloatArray:
    """(k, bins) of all stacks side by side, every sample counting the same."""
    scale = np.concatenate([group.scale for group in stacks])
    return np.asarray((scale * np.abs(np.concatenate(error.residuals, axis=1))) ** 2)


# ------------------------------------------------------------------------------------------------ noise


@dataclass(frozen=True, eq=False)
class _Levels:
    """The division's windows with the bins in them."""

    frequency_hz: FloatArray
    """(bins,), of all stacks."""
    window: FloatArray
    """(bins,), number of the window that each lies in."""
    count: FloatArray
    """(w,)"""
    noise: FloatArray
    """(w, k), power per bin that the commands do not explain."""
    unknowns: float
    """Per window."""
    testable: float
    """Part of the windows in which noise could be told from error."""

    @classmethod
    def of(cls, division: Division, stacks: Sequence[Stack]) -> _Levels:
        frequency = np.concatenate([group.frequency_hz for group in stacks])
        window = _window(frequency, division.edges_hz)
        w = division.power.shape[0]
        count = np.bincount(window, minlength=w).astype(float)
        noise = np.maximum(division.power - division.explained, 0) / np.maximum(count, 1)[:, None]
        unknowns = 2 * len(division.commands)
        filled = count[count > 0]
        return cls(frequency, window, count, noise, unknowns, float(np.mean(filled >= unknowns + LEAST_FREEDOM)))


def _window(frequency_hz: FloatArray, edges_hz: FloatArray) -> Any:
    return np.clip(np.searchsorted(edges_hz, frequency_hz, side="right") - 1, 0, edges_hz.size - 2)


@dataclass(frozen=True, eq=False)
class _Noise:
    """What of the error is noise, from the best source there is."""

    share: FloatArray | None
    """(k,), None where the runs are too short to tell and no quiet hover was flown."""
    levels: FloatArray
    """(w, k), power per bin."""
    source: str
    ratio: FloatArray | None
    """(k,), quiet hover's noise over what the commands leave."""
    distortion: FloatArray
    """(k,), share of the error that is neither as in quiet hover nor linear in the commands."""
    explained: bool | None
    axes: FloatArray
    """(k,), standard deviations by which the commands explain more than they would of noise alone."""

    @classmethod
    def of(cls, division: Division, measured: bool, levels: _Levels, calm: _Calm | None, power: FloatArray) -> _Noise:
        from scipy.special import chdtrc

        whole = np.maximum(np.sum(power, axis=1), 1e-300)
        left = np.sum(levels.noise * levels.count[:, None], axis=0)
        spread = np.sqrt(np.sum(levels.unknowns * levels.noise**2 * (levels.count > 0)[:, None], axis=0))
        axes = np.sum(division.explained, axis=0) / np.maximum(spread, 1e-300)
        testable = levels.testable >= TESTABLE
        explained = bool(chdtrc(division.degrees, division.chi_squared) < SIGNIFICANT) if testable else None
        source = "logged excitation" if measured else "commands"
        none = np.zeros(whole.size)
        if calm is None:
            share = division.noise_share if testable else None
            return cls(share, levels.noise, source, None, none, explained, axes)
        quiet = np.sum(calm.power * levels.count[:, None], axis=0)
        spread = np.sqrt(np.sum((calm.power * levels.count[:, None]) ** 2 / calm.count[:, None], axis=0))
        less = quiet + QUIET_ERRORS * spread < left
        # rougher air than in the sweeps must not hide what the logged excitation shows to be error
        use = less if measured and testable else np.ones(whole.size, dtype=bool)
        return cls(
            np.clip(np.where(use, quiet, left) / whole, 0, 1),
            np.where(use, calm.power, levels.noise),
            "quiet hover" if np.any(use) else source,
            quiet / np.maximum(left, 1e-300) if testable else None,
            np.where(less & testable, (left - quiet) / whole, 0.0),
            explained,
            axes,
        )

    @property
    def more(self) -> Any:
        """(k,), whether there is more than noise."""
        if self.explained is None:
            return np.ones(self.axes.size, dtype=bool)
        return self.explained & (self.axes > SIGNIFICANT_AXIS)

    def at_most(self, share: FloatArray) -> _Noise:
        """The same with less noise: more than that is known to be error."""
        if self.share is None:
            return self
        less = np.clip(np.minimum(self.share, share), 0, 1)
        levels = self.levels * less / np.maximum(self.share, 1e-12)
        return replace(self, share=less, levels=levels, explained=True, axes=np.full(less.size, np.inf))


@dataclass(frozen=True, eq=False)
class _Calm:
    """Quiet hover's noise in the division's windows."""

    power: FloatArray
    """(w, k), per bin: a bin's power does not depend on how long a run is, so it is the same in the sweeps."""
    count: FloatArray
    """(w,), bins that each was averaged over."""


def _quiet_levels(
    model: Model,
    still: Sequence[Record],
    band_hz: tuple[float, float],
    edges_hz: FloatArray,
    remarks: list[str],
) -> _Calm | None:
    """What the model leaves of quiet hover, the noise; None where there is none."""
    structure = model.structure
    found, said = spectra(still, structure.inputs, structure.outputs, band_hz)
    remarks += said
    found = [one for one in found if one.frequency_hz.size]
    if not found:
        return None
    stacks = stack(found)
    power = _power(output_error(model, stacks), stacks)
    window = _window(np.concatenate([group.frequency_hz for group in stacks]), edges_hz)
    w = edges_hz.size - 1
    count = np.bincount(window, minlength=w)
    if not np.any(count):
        return None
    sums = np.stack([np.bincount(window, row, w) for row in power], axis=-1)
    have = count > 0
    centres = 0.5 * (edges_hz[1:] + edges_hz[:-1])
    levels = [np.interp(centres, centres[have], sums[have, k] / count[have]) for k in range(power.shape[0])]
    return _Calm(np.stack(levels, axis=-1), np.maximum(count, 1).astype(float))


def _densities(stacks: Sequence[Stack], error: OutputError, levels: _Levels, noise: _Noise) -> Densities:
    """Spectra in the division's windows."""
    scale = np.concatenate([group.scale * np.sqrt(group.dt) for group in stacks])
    dt = float(np.sum([group.samples * group.dt for group in stacks]) / np.sum([group.samples for group in stacks]))
    count = np.maximum(levels.count, 1)[:, None]

    def density(rows: ComplexArray) -> FloatArray:
        power = np.abs(scale * rows) ** 2
        sums = np.stack([np.bincount(levels.window, row, levels.count.size) for row in power], axis=-1)
        return np.asarray(np.sqrt(sums / count))

    have = levels.count > 0
    sums = np.bincount(levels.window, levels.frequency_hz, levels.count.size)
    return Densities(
        (sums / count[:, 0])[have],
        density(np.concatenate([group.Y for group in stacks], axis=1))[have],
        density(np.concatenate(error.residuals, axis=1))[have],
        np.sqrt(noise.levels * dt)[have],
    )


# ------------------------------------------------------------------------------------------------ frequency


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


def _bands(
    model: Model,
    records: Sequence[Record],
    band_hz: tuple[float, float],
    stacks: Sequence[Stack],
    power: FloatArray,
    division: Division,
    noise: _Noise,
) -> tuple[BandError, ...]:
    frequency = np.concatenate([group.frequency_hz for group in stacks])
    window = _window(frequency, division.edges_hz)
    edges = band_edges(model, records, band_hz)
    band = np.clip(np.searchsorted(edges, frequency, side="left") - 1, 0, edges.size - 2)
    floor = np.maximum(division.power, 1e-300)
    found = []
    for k, output in enumerate(model.structure.outputs):
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
                    AXIS_OF[output],
                    float(edges[number]),
                    float(edges[number + 1]),
                    float(np.sum(here) / total),
                    None
                    if noise.share is None
                    else float(np.clip(np.sum(noise.levels[window[at], k]) / whole, 0, 1))
                    if np.any(at)
                    else 0.0,
                    {
                        name: share(division.by_command[:, k, m] / floor[:, k])
                        for m, name in enumerate(division.commands)
                    },
                    share(division.explained[:, k] / floor[:, k]),
                )
            )
    return tuple(found)


def _responses(model: Model, found: Sequence[Spectrum]) -> tuple[tuple[ResponseError, ...], list[Suspicion]]:
    """Every response beside the measured one with what noise allows, and what its signs look like."""
    structure = model.structure
    judged = mismatch(model, found)
    stacks = stack(found)
    cut = windows(stacks, structure.commands)
    modelled: ComplexArray = np.concatenate(
        [respond(structure, model.values, group, False).Y for group in stacks], axis=1
    )
    rest: ComplexArray = np.concatenate(output_error(model, stacks).residuals, axis=1)
    expected, _, _ = cut.solve(modelled)
    missing, noise, own = cut.solve(rest)
    each = []
    for one in judged.each:
        k, m = structure.outputs.index(one.output), structure.commands.index(one.command)
        with np.errstate(divide="ignore", invalid="ignore"):
            measured = expected[k, m] + missing[k, m]
            ratio = expected[k, m] / measured
            # of the measured response's own size
            allowed = NOTICED * np.sqrt(noise[k] / own[m]) / np.abs(measured)
            allowed = np.where(allowed < 1, allowed, np.nan)
            decibels, degrees = 20 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
            noticed = np.abs(missing[k, m]) > NOTICED * np.sqrt(noise[k] / own[m])
            each.append(
                ResponseError(
                    one,
                    cut.frequency_hz,
                    decibels,
                    degrees,
                    np.asarray(20 * np.log10(1 + allowed)),
                    np.asarray(np.degrees(np.arcsin(allowed))),
                    _stretches(cut.frequency_hz, noticed),
                    measured,
                )
            )
    return tuple(each), mistaken_signs(judged.measured)


def _stretches(frequency_hz: FloatArray, good: Any) -> tuple[tuple[float, float], ...]:
    """Bands of at least two neighbouring points, single points between them bridged."""
    at = np.flatnonzero(good)
    parts = np.split(at, np.flatnonzero(np.diff(at) > 2) + 1)
    return tuple((float(frequency_hz[one[0]]), float(frequency_hz[one[-1]])) for one in parts if one.size >= 2)


# ------------------------------------------------------------------------------------------------ time


def _trace(names: Sequence[str], one: Spectrum, residual: ComplexArray) -> Trace:
    commands = dict(zip(names, one.in_time(one.U[: len(names)]), strict=True))
    return Trace(one.segment.record.id, one.segment.t, one.in_time(one.Y), one.in_time(residual), commands)


def _windows(traces: Sequence[Trace], outputs: Sequence[str]) -> tuple[WindowError, ...]:
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
                found.append(WindowError(AXIS_OF[output], one.run, start, start + (end - begin) * step, share))
    return tuple(found)


def _amplitudes(outputs: Sequence[str]) -> dict[tuple[str, str], bool]:
    """(axis, channel) -> whether its size counts, not its value."""
    commands = {"roll": "delta_x", "pitch": "delta_y"}
    return {(AXIS_OF[output], channel): True for output in outputs for channel in (commands[AXIS_OF[output]], output)}


def _varied(records: Sequence[Record]) -> dict[tuple[str, str], bool]:
    """Flight conditions that every run has logged and that varied."""
    found = {}
    for name, least in CONDITIONS.items():
        if all(name in record.channels for record in records):
            values = np.concatenate([record.channels[name] for record in records])
            if np.std(values) > least * abs(float(np.mean(values))) > 0:
                found.update({(axis, name): False for axis in ("roll", "pitch")})
    return found


def _by_level(
    traces: Sequence[Trace], parts: Sequence[Spectrum], wanted: Mapping[tuple[str, str], bool]
) -> tuple[LevelError, ...]:
    """The error while each channel was small, middling and large, every level holding like numbers of samples."""
    found = []
    outputs = {"roll": 0, "pitch": 1}
    known: dict[str, tuple[FloatArray, FloatArray]] = {}
    for (axis, channel), size in wanted.items():
        if channel not in known:
            values = np.concatenate([_level(one, channel, size) for one in parts])
            known[channel] = values, np.quantile(values, np.linspace(0, 1, LEVELS + 1))
        values, edges = known[channel]
        if not edges[-1] > edges[0]:
            continue
        power = np.concatenate([one.residual[outputs[axis]] ** 2 for one in traces])
        number = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, LEVELS - 1)
        total = max(float(np.sum(power)), 1e-300)
        times, errors = np.bincount(number, minlength=LEVELS), np.bincount(number, power, LEVELS)
        found += [
            LevelError(axis, channel, float(low), float(high), float(time / power.size), float(part / total))
            for low, high, time, part in zip(edges[:-1], edges[1:], times, errors, strict=True)
        ]
    return tuple(found)


def _trends(
    traces: Sequence[Trace], parts: Sequence[Spectrum], wanted: Mapping[tuple[str, str], bool]
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
        k = {"roll": 0, "pitch": 1}[axis]
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
        found.append(Trend(axis, channel, low, high, factor, correlation, bool(significant)))
    return tuple(found)


def _level(one: Spectrum, channel: str, size: bool) -> FloatArray:
    """A channel on a segment's clock: its envelope over a second, or its value."""
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


# ------------------------------------------------------------------------------------------------ runs


class _Alone:
    """Every run divided for itself, and any of them together; each division is made once."""

    def __init__(self, model: Model, parts: Sequence[Spectrum], error: OutputError) -> None:
        self.model = model
        self.outputs = model.structure.outputs
        self.records: list[Record] = []
        self._parts: list[list[tuple[Spectrum, ComplexArray]]] = []
        for one, residual in zip(parts, error.residuals, strict=True):
            for number, record in enumerate(self.records):
                if record is one.segment.record:
                    self._parts[number].append((one, residual))
                    break
            else:
                self.records.append(one.segment.record)
                self._parts.append([(one, residual)])
        self.ids = [record.id for record in self.records]
        self._known: dict[tuple[int, ...], tuple[Division, _Levels]] = {}
        self.power = np.array(
            [np.sum([_energy(one, residual) for one, residual in each], axis=0) for each in self._parts]
        )
        """(runs, k) of the residual."""

    def divided(self, numbers: Sequence[int]) -> tuple[Division, _Levels]:
        key = tuple(sorted(numbers))
        if key not in self._known:
            chosen = [part for number in key for part in self._parts[number]]
            stacks = stack([one for one, _ in chosen])
            residuals = {id(one): residual for one, residual in chosen}
            error = OutputError(
                [residuals[id(one)] for group in stacks for one in group.spectra], np.ones(2), np.ones(2)
            )
            division = divide(error, stacks, causes(stacks, self.model.structure.commands))
            self._known[key] = division, _Levels.of(division, stacks)
        return self._known[key]

    def testable(self, number: int) -> bool:
        return self.divided([number])[1].testable >= TESTABLE

    def explained(self, numbers: Sequence[int]) -> FloatArray:
        """(k,), what one response of the commands explains of these runs' residual, slow drift left out.

        Drift that lies in a few of a window's bins looks explained to any few unknowns.
        """
        division, _ = self.divided(numbers)
        return np.asarray(np.sum(division.explained[division.edges_hz[:-1] >= SLOWEST_HZ], axis=0))

    def runs(self) -> tuple[RunError, ...]:
        """What each run has of the error."""
        total = np.maximum(np.sum(self.power, axis=0), 1e-300)
        found = []
        for number, (record, each) in enumerate(zip(self.records, self._parts, strict=True)):
            measured = np.maximum(np.sum([_energy(one, one.Y) for one, _ in each], axis=0), 1e-300)
            samples = sum(one.samples for one, _ in each)
            commands = self.model.structure.commands
            energy = np.sum([_energy(one, one.U[: len(commands)]) for one, _ in each], axis=0)
            noise = None
            if self.testable(number):
                noise = dict(zip(self.outputs, map(float, self.divided([number])[0].noise_share), strict=True))
            found.append(
                RunError(
                    record.id,
                    record.maneuver,
                    record.axis,
                    float(sum(one.segment.duration_s for one, _ in each)),
                    dict(
                        zip(self.outputs, map(float, 100 * (1 - np.sqrt(self.power[number] / measured))), strict=True)
                    ),
                    dict(zip(self.outputs, map(float, self.power[number] / total), strict=True)),
                    noise,
                    dict(zip(commands, map(float, np.sqrt(energy / samples)), strict=True)),
                    {name: float(np.mean(record.channels[name])) for name in CONDITIONS if name in record.channels},
                )
            )
        return tuple(found)


def _energy(one: Spectrum, rows: ComplexArray) -> FloatArray:
    """(r,), mean square times samples."""
    return np.asarray(2 / one.samples * np.sum(np.abs(rows) ** 2, axis=1))


def _growth(runs: Sequence[RunError], alone: _Alone, outputs: Sequence[str]) -> tuple[Growth, ...]:
    """The noise-free error against the command's amplitude, where an axis was flown with amplitudes that differ."""
    found = []
    for axis, command in (("roll", "delta_x"), ("pitch", "delta_y")):
        at = [i for i, one in enumerate(runs) if one.axis == axis and one.maneuver == "chirp" and alone.testable(i)]
        sizes = np.array([runs[i].command_rms[command] for i in at])
        if len(at) < 2 or sizes.max() < GROWTH_RATIO * max(sizes.min(), 1e-12):
            continue
        together = alone.explained(at)
        separate = np.sum([alone.explained([i]) for i in at], axis=0)
        for k, output in enumerate(outputs):
            seconds = np.array([runs[i].duration_s for i in at])
            values, variances = [], []
            for i in at:
                division, levels = alone.divided([i])
                part = np.maximum(division.explained[:, k], 0)
                level = levels.noise[:, k]
                values.append(float(np.sum(division.explained[:, k])))
                variances.append(float(np.sum(2 * part * level + levels.unknowns * level**2)))
            value, deviation = np.array(values), np.sqrt(np.array(variances))
            unseen = value < GROWTH_ERRORS * deviation
            if np.any(unseen[sizes > sizes.min() * np.sqrt(GROWTH_RATIO)]):
                continue
            # where nothing is seen in small motion, it is at most what noise would hide
            value = np.maximum(value, GROWTH_ERRORS * deviation)
            x, y = np.log2(sizes), 0.5 * np.log(value / seconds)
            spread = x - x.mean()
            slope = float(np.sum(spread * y) / np.sum(spread**2)) - float(np.log(2))
            sd = float(np.sqrt(np.sum((spread * 0.5 * deviation / value) ** 2)) / np.sum(spread**2))
            changes = float((separate[k] - together[k]) / np.sum(alone.power[at, k]))
            found.append(
                Growth(
                    AXIS_OF[output],
                    command,
                    bool(np.any(unseen)),
                    float(sizes.min()),
                    float(sizes.max()),
                    float(np.exp(slope)),
                    sd,
                    changes,
                )
            )
    return tuple(found)


def _controls(
    model: Model,
    records: Sequence[Record],
    band_hz: tuple[float, float],
    stacks: Sequence[Stack],
    error: OutputError,
    division: Division,
) -> tuple[dict[str, dict[str, float]], Division]:
    """What other logged controls explain of the error beyond the commands, and the division that counts them too."""
    structure = model.structure
    other = [
        name
        for name in CONTROLS
        if name not in structure.inputs and all(name in one.channels and np.ptp(one.channels[name]) for one in records)
    ]
    if not other:
        return {}, division
    found, _ = spectra(records, (*structure.inputs, *other), structure.outputs, band_hz)
    groups = stack([one for one in found if one.frequency_hz.size])
    whole = np.maximum(np.sum(division.power, axis=0), 1e-300)
    level = _Levels.of(division, stacks).noise
    chance = np.sqrt(np.sum(2 * level**2, axis=0)) / whole
    shares: dict[str, dict[str, float]] = {}
    strong = []
    for name in other:
        more = divide(error, groups, causes(groups, (*structure.commands, name)))
        gained = np.sum(more.explained - division.explained, axis=0) / whole
        shares[name] = dict(zip(structure.outputs, map(float, np.clip(gained, 0, 1)), strict=True))
        if np.any(gained > np.maximum(LEAST_CONTROL_SHARE, CONTROL_ERRORS * chance)):
            strong.append(name)
    if not strong:
        return shares, division
    return shares, divide(error, groups, causes(groups, (*structure.commands, *strong)))
