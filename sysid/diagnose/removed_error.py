"""What these very runs show of an effect, measured by taking it out of the model that has it.

The rest is compared with the flown responses: the difference is what the effect does, unmixed with what the parent's
parameters did in its place. Nothing is told that was not measured: each statement has a number from these runs and a
threshold under which it is not made."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.compare.metrics import Mismatch, Mismatches, mismatch
from sysid.data.instrument import causes
from sysid.data.record import COMMANDS, CYCLIC, RATES, axis_of
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.reasons import (
    BestLinear,
    FitRises,
    GainFalls,
    GainStays,
    GoesWithChannel,
    GrowsWithCommand,
    InOneBand,
    InStepWithCommand,
    NearerResponses,
    NoLinearAnswer,
    OnOneAxis,
    PhaseFalls,
    Shown,
)
from sysid.fit.noise import divide
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model

DIRECT = dict(zip((*RATES, "r", "az"), (*CYCLIC, "delta_r", "delta_c"), strict=True))
STRAIGHT = 0.9
"""Share of a phase's square that a line through zero explains, from which on it falls in proportion to frequency."""
LEAST_PHASE_DEG = 8.0
LEAST_GAIN_DB = 1.0
GAIN_OF_LAG = 0.4
"""Of the gain that a first-order lag of that phase loses: less is a delay."""
MOST_OF_IT = 0.8
ONE_AXIS = 0.85
NARROW = 0.4
"""Of the whole band that holds MOST_OF_IT."""
NOT_LINEAR = 0.2
IN_STEP = 0.4
"""Correlation with a channel."""
SHARE_OF_COMMAND = 0.25
CLOSER = 1.5
"""Times nearer to the measured responses, in dB or degrees."""
WINDOW_S = 1.0
CELL_HZ = 0.5
GROWING = 1.3
DIFFERENT_SIZES = 1.4


def shown_by_runs(parent: Candidate, winner: Ranked, others: Sequence[Ranked]) -> tuple[Shown, ...]:
    """What these runs show of the effect, strongest first."""
    assert winner.fit is not None
    removed = RemovedError.of(parent, winner.fit)
    return (
        *_response(parent, winner.fit),
        *removed.where(),
        *_not_linear(parent, winner.fit, removed),
        *_in_step(parent, winner, removed),
        *removed.growth(),
        *_best_linear(winner, others),
    )


def rise(parent: Candidate, winner: Ranked) -> FitRises:
    """How the fit's numbers change."""
    assert winner.fit is not None
    return FitRises(parent.nrmse_percent, winner.fit.nrmse_percent)


def _response(parent: Candidate, fit: Candidate) -> list[Shown]:
    """What taking the effect out does to phase and gain, beside the measured responses."""
    if not fit.model.structure.linear:
        return []
    names = parent.model.structure.names
    without = parent.model
    if set(names) <= set(fit.model.structure.names):
        without = Model(parent.model.structure, np.array([fit.model[name] for name in names]))
    try:
        bare = mismatch(without, parent.dataset.viewed(without.structure.inputs))
        whole = mismatch(fit.model, fit.dataset.viewed(fit.model.structure.inputs))
    except (RelaxationError, np.linalg.LinAlgError):
        return []
    shown = _phase(bare)
    off, near = _rms(bare), _rms(whole)
    finite = all(math.isfinite(x) for x in (*off, *near))
    if finite and any(before >= CLOSER * after for before, after in zip(off, near, strict=True)):
        shown.append(NearerResponses(off, near))
    return shown


def _rms(all_of_them: Mismatches) -> tuple[float, float]:
    """dB and degrees over all responses, each point counting the same."""
    found = []
    for attribute in ("decibels", "degrees"):
        values = np.concatenate([getattr(one, attribute) for one in all_of_them.each])
        found.append(float(np.sqrt(np.mean(values**2))) if values.size else math.nan)
    return found[0], found[1]


def _phase(bare: Mismatches) -> list[Shown]:
    """Lag or delay: how phase and gain of the measured responses lie beside the model without the effect."""
    seen = [line for one in bare.each if DIRECT.get(one.output) == one.command and (line := _line(one)) is not None]
    if not seen or not all(straight >= STRAIGHT for _, _, straight, _, _ in seen):
        return []
    if not all(degrees <= -LEAST_PHASE_DEG for _, _, _, degrees, _ in seen):
        return []
    top = max(float(one.frequency_hz[-1]) for one in bare.each if one.frequency_hz.size)
    degrees = float(np.mean([each[3] for each in seen]))
    gain = float(np.mean([each[4] for each in seen]))
    shown: list[Shown] = [PhaseFalls(-degrees, top, {output: delay for output, delay, _, _, _ in seen})]
    of_lag = 20 * math.log10(max(math.cos(math.radians(min(-degrees, 80.0))), 1e-3))
    if gain <= min(-LEAST_GAIN_DB, GAIN_OF_LAG * of_lag):
        shown.append(GainFalls(-gain))
    elif gain > GAIN_OF_LAG * of_lag and of_lag < -LEAST_GAIN_DB:
        shown.append(GainStays(abs(gain), -of_lag))
    return shown


def _line(one: Mismatch) -> tuple[str, float, float, float, float] | None:
    """Output, lateness in s, how straight, degrees and dB at the upper end of the band; measured less modelled."""
    f = one.frequency_hz
    if not f.size:
        return None
    phase = -np.degrees(np.unwrap(np.radians(one.degrees)))
    slope = float(f @ phase) / float(f @ f)
    straight = 1 - float(np.sum((phase - slope * f) ** 2)) / max(float(np.sum(phase**2)), 1e-300)
    upper = f >= 0.7 * f[-1]
    return one.output, -slope / 360, straight, slope * float(f[-1]), -float(np.mean(one.decibels[upper]))


@dataclass(frozen=True, eq=False, kw_only=True)
class RemovedError:
    """The error that the winner takes away."""

    outputs: tuple[str, ...]
    frequency_hz: FloatArray
    power: FloatArray
    """(k, bins), (rad/s)^2; may be negative."""
    relative: FloatArray
    """(k,), of the measured power."""
    by_run: tuple[tuple[str, float, float], ...]
    """The largest command, its rms, and that of the removed error over it, for every segment."""
    waves: tuple[FloatArray, ...]
    """For every segment the removed error in time, (k, n), each output over its measured rms."""

    @classmethod
    def of(cls, parent: Candidate, fit: Candidate) -> RemovedError:
        outputs = parent.model.structure.outputs
        before, after = parent.estimate.error, fit.estimate.error
        frequency, power, runs, waves = [], [], [], []
        segments = (one for group in parent.dataset.stacks for one in group.spectra)
        size = np.sqrt(before.measured_power / max(parent.dataset.samples, 1))
        for one, e, rest in zip(segments, before.residuals, after.residuals, strict=True):
            frequency.append(one.frequency_hz)
            power.append((2 / one.samples) * (np.abs(e) ** 2 - np.abs(rest) ** 2))
            waves.append(one.in_time(e - rest) / size[:, None])
            sizes = {name: float(np.std(one.segment.channels[name])) for name in parent.model.structure.base_.commands}
            command = max(sizes, key=lambda name: sizes[name])
            runs.append((command, sizes[command], float(np.std(waves[-1])) / max(sizes[command], 1e-12)))
        together = np.concatenate(power, axis=1)
        relative = (before.residual_power - after.residual_power) / before.measured_power
        return cls(
            outputs=outputs,
            frequency_hz=np.concatenate(frequency),
            power=together,
            relative=relative,
            by_run=tuple(runs),
            waves=tuple(waves),
        )

    def where(self) -> list[Shown]:
        """In which axis and band the removed error lies."""
        share = np.maximum(self.relative, 0) / max(float(np.sum(np.maximum(self.relative, 0))), 1e-300)
        worst = int(np.argmax(share))
        axis = axis_of(self.outputs[worst])
        band = self._narrowest(self.power[worst])
        shown: list[Shown] = [OnOneAxis(axis, float(share[worst]))] if share[worst] >= ONE_AXIS else []
        return shown if band is None else [*shown, InOneBand(axis, MOST_OF_IT, band)]

    def _narrowest(self, power: FloatArray) -> tuple[float, float] | None:
        """The narrowest band with most of the power; None where that is half of everything."""
        top = float(self.frequency_hz.max())
        edges = np.arange(0.0, top + CELL_HZ, CELL_HZ)
        cells = np.maximum(np.histogram(self.frequency_hz, edges, weights=power)[0], 0)
        total = np.concatenate([[0.0], np.cumsum(cells)])
        wanted = MOST_OF_IT * total[-1]
        if wanted <= 0:
            return None
        spans = [
            (edges[stop] - edges[start], edges[start], edges[stop])
            for start in range(cells.size)
            if (stop := int(np.searchsorted(total, total[start] + wanted - 1e-12))) <= cells.size
        ]
        width, low, high = min(spans)
        return (float(low), float(high)) if width <= NARROW * top else None

    def growth(self) -> list[Shown]:
        """Whether twice the command makes more than twice the error."""
        for command in ("delta_x", "delta_y"):
            each = np.array([(size, ratio) for name, size, ratio in self.by_run if name == command and ratio > 0])
            if len(each) < 2 or each[:, 0].max() < DIFFERENT_SIZES * each[:, 0].min():
                continue
            growth = 2 ** float(np.polyfit(np.log(each[:, 0]), np.log(each[:, 1]), 1)[0])
            if growth >= GROWING:
                return [GrowsWithCommand(command, 2 * growth)]
        return []


def _not_linear(parent: Candidate, fit: Candidate, removed: RemovedError) -> list[Shown]:
    """How much of the removed error no linear answer to the commands explains."""
    if fit.model.structure.linear:
        return []
    division = parent.division
    linear = float(np.sum(np.maximum(np.sum(division.explained, axis=0), 0)))
    whole = float(np.sum(removed.power))
    share = 1 - linear / whole if whole > 0 else 0.0
    if share < NOT_LINEAR:
        return []
    return [NoLinearAnswer(min(share, 1.0))]


def _best_linear(winner: Ranked, others: Sequence[Ranked]) -> list[Shown]:
    """How near the best linear effect comes to one that is not."""
    assert winner.fit is not None
    if winner.fit.model.structure.linear:
        return []
    linear = [one for one in others if one.fit is not None and one.fit.model.structure.linear and not one.implausible]
    best = max(linear, key=lambda one: one.chi_squared, default=None)
    if best is None or not 0 < best.chi_squared < winner.chi_squared:
        return []
    return [BestLinear(best.effects, best.chi_squared / winner.chi_squared)]


def _in_step(parent: Candidate, winner: Ranked, removed: RemovedError) -> list[Shown]:
    """Channels that the effect reads: whether the removed error comes and goes with them."""
    assert winner.fit is not None
    inputs = [name for name in winner.fit.model.structure.inputs if name not in parent.model.structure.inputs]
    shown: list[Shown] = []
    for name in inputs:
        if name in COMMANDS:
            shown += _by_command(parent, name, removed)
            continue
        segments = [one for group in parent.dataset.stacks for one in group.spectra]
        values = [one.segment.channels[name] for one in segments]
        mean = float(np.mean(np.concatenate(values)))
        pairs = [
            _windowed(wave, np.abs(channel - mean), one.dt)
            for wave, channel, one in zip(removed.waves, values, segments, strict=True)
        ]
        error, far = (np.concatenate(each) for each in zip(*pairs, strict=True))
        with np.errstate(invalid="ignore"):
            together = float(np.corrcoef(error, far)[0, 1])
        if together >= IN_STEP:
            shown.append(GoesWithChannel(name, together))
    return shown


def _by_command(parent: Candidate, name: str, removed: RemovedError) -> list[Shown]:
    """How much of the removed error a command that the parent does not read explains by itself."""
    stacks = parent.dataset.stacks
    alone = divide(parent.estimate.error, stacks, causes(stacks, [name]))
    share = np.sum(alone.explained, axis=0) / np.maximum(np.sum(removed.power, axis=1), 1e-300)
    worst = int(np.argmax(share * removed.relative))
    if share[worst] < SHARE_OF_COMMAND:
        return []
    return [InStepWithCommand(axis_of(removed.outputs[worst]), min(float(share[worst]), 1.0), name)]


def _windowed(wave: FloatArray, channel: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Rms of the error (k, n) and mean of the channel (n,) in windows."""
    n = max(1, round(WINDOW_S / dt))
    count = channel.size // n
    square = np.sum(wave[:, : count * n] ** 2, axis=0).reshape(count, n)
    return np.sqrt(np.mean(square, axis=1)), np.mean(channel[: count * n].reshape(count, n), axis=1)
