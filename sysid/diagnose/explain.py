"""Why a diagnosis says what it says, in the words of somebody who flies.

Four parts. What the effect is, with the numbers found and what is plausible for them. Why the evidence points to it:
its signature, and beside it what these very runs show, measured by taking the effect out of the model that has it and
comparing the rest with the flown responses; the difference is what the effect does, unmixed with what the parent's
parameters did in its place. What changes: parameters and modes before and after, and implausible values that became
plausible. What else could look so: effects that the data cannot tell from it, and those that come near only at values
that physics does not allow.

Nothing is said that was not measured: each sentence has a number from these runs and a threshold under which it is not
spoken.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.compare.metrics import Mismatch, Mismatches, mismatch
from sysid.diagnose.evidence import Candidate
from sysid.fit.noise import causes, divide
from sysid.fit.output_error import AXIS_OF
from sysid.model.bases import COMMANDS
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.predict import RelaxationError
from sysid.model.structure import FloatArray, Mode, Model

if TYPE_CHECKING:
    from sysid.diagnose.diagnose import Judged

WIDTH = 78
DIRECT = {"p": "delta_x", "q": "delta_y"}
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
SMALL = 2.0
"""Standard errors from its null, up to which one of several parameters is not told."""
MOVED = 3.0
"""Standard errors by which a parameter must move to be told,"""
MOVED_SHARE = 0.01
"""and of its own value."""
MOST_TOLD = 4
NEARLY = 0.9
"""Of the winner's chi squared."""


# ------------------------------------------------------------------------------------------------ words for numbers


def quantity(parameter: Parameter, value: float, error: float | None = None) -> str:
    """`tau_s = 31.2 ± 0.4 ms`; times below a second in milliseconds."""
    return f"{parameter.name} = {amount(parameter, value, error)}"


def amount(parameter: Parameter, value: float, error: float | None = None) -> str:
    """The value with its unit."""
    if not math.isfinite(value):
        return "no limit"
    times, unit = _unit(parameter, value)
    if error is None or not (error > 0 and math.isfinite(error)):
        return f"{times * value:.3g}{unit}"
    digits = max(0, 1 - math.floor(math.log10(times * error)))
    digits -= digits > 0 and times * error * 10**digits >= 20  # one digit of an error is enough above 2
    return f"{times * value:.{digits}f} ± {times * error:.{digits}f}{unit}"


def plausible_range(parameter: Parameter) -> str:
    """`0 to 80 ms`; empty where anything goes."""
    low, high = parameter.plausible
    ends = [x for x in (low, high) if math.isfinite(x)]
    if not ends:
        return ""
    times, unit = _unit(parameter, max(ends, key=abs))
    if low == high:
        return f"{times * low:g}{unit}"
    if len(ends) == 2:
        return f"{times * low:g} to {times * high:g}{unit}"
    return f"{'at least' if math.isfinite(low) else 'at most'} {times * ends[0]:g}{unit}"


def _unit(parameter: Parameter, value: float) -> tuple[float, str]:
    if parameter.unit == "s" and abs(value) < 1:
        return 1000.0, " ms"
    return 1.0, "" if parameter.unit == "-" else f" {parameter.unit}"


def listed(words: Sequence[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


# ------------------------------------------------------------------------------------------------ the explanation


@dataclass(frozen=True)
class Explanation:
    """Sentences by part; empty parts have nothing to say."""

    effects: tuple[str, ...]
    """Empty where there is no winner."""
    what: tuple[str, ...]
    why: tuple[str, ...]
    changes: tuple[str, ...]
    resembles: tuple[str, ...]
    marks: tuple[str, ...] = ()
    """Of `why`: the effects' usual signatures, and"""
    shown: tuple[str, ...] = ()
    """what these runs show, strongest first, less that the fit's numbers change."""

    @property
    def sentences(self) -> tuple[str, ...]:
        return (*self.what, *self.why, *self.changes, *self.resembles)

    def lines(self, width: int = WIDTH) -> list[str]:
        """As text, a heading for each part, continued lines indented."""
        found = []
        for heading, part in (
            ("what it is", self.what),
            ("why", self.why),
            ("what changes", self.changes),
            ("what else could look so", self.resembles),
        ):
            if part:
                found.append(heading)
                for said in part:
                    found += textwrap.wrap(said, width, initial_indent="  ", subsequent_indent="    ")
        return found

    def to_json(self) -> dict[str, Any]:
        return {
            "effects": list(self.effects),
            "what": list(self.what),
            "why": list(self.why),
            "changes": list(self.changes),
            "resembles": list(self.resembles),
        }


def explain(
    parent: Candidate,
    winner: Judged | None,
    others: Sequence[Judged] = (),
    alike: Sequence[str] = (),
    *,
    complete: bool = False,
) -> Explanation:
    """Explain the winner, or why there is none. `others` are all candidates, `alike` the ids not told from it.

    `complete`: what the parent leaves is noise; whatever was refitted, nothing won.
    """
    if complete or winner is None or winner.fit is None:
        return Explanation((), _no_winner(parent, complete), (), _implausible_parent(parent, None, others), ())
    marks, shown = tuple(f"{one.signature}." for one in _own(winner)), _shown(parent, winner, others)
    return Explanation(
        winner.effects,
        tuple(_what(winner.fit, effect) for effect in _own(winner)),
        (*(f"Its mark: {mark}" for mark in marks), *shown, _fall(parent, winner)),
        (*_changes(parent, winner.fit), *_implausible_parent(parent, winner, others)),
        _resembles(winner, others, alike),
        marks,
        shown,
    )


def _own(judged: Judged) -> list[Effect]:
    assert judged.fit is not None
    composed = judged.fit.model.structure.composed
    by_name = {one.path or one.id: one for one in composed}
    return [by_name[name] for name in judged.effects if name in by_name]


def _no_winner(parent: Candidate, complete: bool) -> tuple[str, ...]:
    reached = ", ".join(f"{name} {value:.1f} %" for name, value in parent.nrmse_percent.items())
    if complete:
        return (f"Nothing is missing that these runs could show: what the model leaves (fit {reached}) is noise.",)
    return (f"What the model leaves (fit {reached}) is more than noise, and no effect of the catalogue explains it.",)


def _errors(of: Candidate) -> dict[str, float]:
    spread = np.sqrt(np.maximum(np.diag(of.estimate.covariance), 0))
    return dict(zip(of.model.structure.names, map(float, spread), strict=True))


def _what(fit: Candidate, effect: Effect) -> str:
    names, errors = fit.model.structure.names, _errors(fit)
    found, small = [], []
    for one in effect.parameters:
        if one.name not in names:
            continue
        value, error = fit.model[one.name], errors[one.name]
        if one.null is not None and len(effect.parameters) > 1 and abs(value - one.null) < SMALL * error:
            small.append(one.name)
            continue
        allowed = plausible_range(one)
        judged = f" ({'NOT ' if one.implausible(value) else ''}plausible: {allowed})" if allowed else ""
        found.append(quantity(one, value, error) + judged)
    if small:
        found.append(f"not to be told from none: {listed(small)}")
    title = effect.title[0].upper() + effect.title[1:]
    return f"{title}: {effect.equation}; {', '.join(found)}. Source: {effect.source}."


# ------------------------------------------------------------------------------------------------ what the runs show


def _shown(parent: Candidate, winner: Judged, others: Sequence[Judged]) -> tuple[str, ...]:
    """What these runs show of the effect, strongest first."""
    assert winner.fit is not None
    found = [*_response(parent, winner.fit)]
    removed = _Removed.of(parent, winner.fit)
    found += [*removed.where(), *_not_linear(parent, winner.fit, removed), *_in_step(parent, winner, removed)]
    return (*found, *removed.growth(), *_best_linear(winner, others))


def _fall(parent: Candidate, winner: Judged) -> str:
    """How the fit's numbers change."""
    assert winner.fit is not None
    before, after = parent.nrmse_percent, winner.fit.nrmse_percent
    fall = ", ".join(f"{name} {before[name]:.1f} → {after[name]:.1f} %" for name in before)
    return f"With it the fit goes from {fall}."


def _response(parent: Candidate, fit: Candidate) -> list[str]:
    """What taking the effect out does to phase and gain, beside the measured responses."""
    if not fit.model.structure.linear:
        return []
    names = parent.model.structure.names
    without = parent.model
    if set(names) <= set(fit.model.structure.names):
        without = Model(parent.model.structure, np.array([fit.model[name] for name in names]))
    try:
        bare = mismatch(without, parent.ground.viewed(without.structure))
        whole = mismatch(fit.model, fit.ground.viewed(fit.model.structure))
    except (RelaxationError, np.linalg.LinAlgError):
        return []
    found = _phase(bare)
    near = [_rms(each) for each in (bare, whole)]
    finite = all(math.isfinite(x) for pair in near for x in pair)
    if finite and any(before >= CLOSER * after for before, after in zip(*near, strict=True)):
        found.append(
            f"Without it the responses are {near[0][0]:.1f} dB and {near[0][1]:.1f} degrees off, "
            f"with it {near[1][0]:.1f} dB and {near[1][1]:.1f} degrees."
        )
    return found


def _rms(all_of_them: Mismatches) -> tuple[float, float]:
    """dB and degrees over all responses, each point counting the same."""
    found = []
    for attribute in ("decibels", "degrees"):
        values = np.concatenate([getattr(one, attribute) for one in all_of_them.each])
        found.append(float(np.sqrt(np.mean(values**2))) if values.size else math.nan)
    return found[0], found[1]


def _phase(bare: Mismatches) -> list[str]:
    """Lag or delay: how phase and gain of the measured responses lie beside the model without the effect."""
    seen = [line for one in bare.each if DIRECT.get(one.output) == one.command and (line := _line(one)) is not None]
    if not seen or not all(straight >= STRAIGHT for _, _, straight, _, _ in seen):
        return []
    if not all(degrees <= -LEAST_PHASE_DEG for _, _, _, degrees, _ in seen):
        return []
    late = ", ".join(f"{output} {1000 * delay:.0f} ms" for output, delay, _, _, _ in seen)
    top = max(float(one.frequency_hz[-1]) for one in bare.each if one.frequency_hz.size)
    degrees = float(np.mean([each[3] for each in seen]))
    gain = float(np.mean([each[4] for each in seen]))
    said = [f"The phase falls in proportion to frequency, by {-degrees:.0f} degrees up to {top:.1f} Hz: {late} late."]
    of_lag = 20 * math.log10(max(math.cos(math.radians(min(-degrees, 80.0))), 1e-3))
    if gain <= min(-LEAST_GAIN_DB, GAIN_OF_LAG * of_lag):
        said.append(f"The gain falls too, by {-gain:.1f} dB there, as behind a lag: a pure delay would keep it.")
    elif gain > GAIN_OF_LAG * of_lag and of_lag < -LEAST_GAIN_DB:
        said.append(
            f"The gain stays within {max(abs(gain), 0.1):.1f} dB, as behind a delay: a first-order lag would lose "
            f"{-of_lag:.1f} dB."
        )
    return said


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


@dataclass(frozen=True, eq=False)
class _Removed:
    """The error that the winner takes away."""

    outputs: tuple[str, ...]
    frequency_hz: FloatArray
    power: FloatArray
    """(k, bins), (rad/s)^2; may be negative."""
    relative: FloatArray
    """(k,), of the measured power."""
    by_run: tuple[tuple[str, float, float], ...]
    """Axis, command and rms of the removed error over that of the command, for every segment."""
    waves: tuple[FloatArray, ...]
    """For every segment the removed error in time, (k, n), each output over its measured rms."""

    @classmethod
    def of(cls, parent: Candidate, fit: Candidate) -> _Removed:
        outputs = parent.model.structure.outputs
        before, after = parent.estimate.error, fit.estimate.error
        frequency, power, runs, waves = [], [], [], []
        segments = ((group, one) for group in parent.ground.stacks for one in group.spectra)
        size = np.sqrt(before.measured_power / max(parent.ground.samples, 1))
        for (_, one), e, rest in zip(segments, before.residuals, after.residuals, strict=True):
            frequency.append(one.frequency_hz)
            power.append((2 / one.samples) * (np.abs(e) ** 2 - np.abs(rest) ** 2))
            waves.append(one.in_time(e - rest) / size[:, None])
            sizes = {name: float(np.std(one.segment.channels[name])) for name in ("delta_x", "delta_y")}
            command = max(sizes, key=lambda name: sizes[name])
            runs.append((command, sizes[command], float(np.std(waves[-1])) / max(sizes[command], 1e-12)))
        together = np.concatenate(power, axis=1)
        relative = (before.residual_power - after.residual_power) / before.measured_power
        return cls(outputs, np.concatenate(frequency), together, relative, tuple(runs), tuple(waves))

    def where(self) -> list[str]:
        """In which axis and band the removed error lies."""
        share = np.maximum(self.relative, 0) / max(float(np.sum(np.maximum(self.relative, 0))), 1e-300)
        worst = int(np.argmax(share))
        found = []
        if share[worst] >= ONE_AXIS:
            found.append(
                f"{100 * share[worst]:.0f} % of the error that it takes away is in {AXIS_OF[self.outputs[worst]]}."
            )
        band = self._narrowest(self.power[worst])
        if band is not None:
            axis = AXIS_OF[self.outputs[worst]]
            where = f"in {band[0]:.1f}-{band[1]:.1f} Hz" if band[0] > 0 else f"below {band[1]:.1f} Hz"
            found.append(f"{100 * MOST_OF_IT:.0f} % of what goes in {axis} lies {where}.")
        return found

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

    def growth(self) -> list[str]:
        """Whether twice the command makes more than twice the error."""
        for command in ("delta_x", "delta_y"):
            each = np.array([(size, ratio) for name, size, ratio in self.by_run if name == command and ratio > 0])
            if len(each) < 2 or each[:, 0].max() < DIFFERENT_SIZES * each[:, 0].min():
                continue
            growth = 2 ** float(np.polyfit(np.log(each[:, 0]), np.log(each[:, 1]), 1)[0])
            if growth >= GROWING:
                return [
                    f"Twice the command ({command}) makes {2 * growth:.1f} times the error: it grows with amplitude."
                ]
        return []


def _not_linear(parent: Candidate, fit: Candidate, removed: _Removed) -> list[str]:
    """How much of the removed error no linear answer to the commands explains."""
    if fit.model.structure.linear:
        return []
    division = parent.division
    linear = float(np.sum(np.maximum(np.sum(division.explained, axis=0), 0)))
    whole = float(np.sum(removed.power))
    share = 1 - linear / whole if whole > 0 else 0.0
    if share < NOT_LINEAR:
        return []
    return [f"{100 * min(share, 1.0):.0f} % of the error that it takes away is no linear answer to the commands."]


def _best_linear(winner: Judged, others: Sequence[Judged]) -> list[str]:
    """How near the best linear effect comes to one that is not."""
    assert winner.fit is not None
    if winner.fit.model.structure.linear:
        return []
    linear = [one for one in others if one.fit is not None and one.fit.model.structure.linear and not one.implausible]
    best = max(linear, key=lambda one: one.chi_squared, default=None)
    if best is None or not 0 < best.chi_squared < winner.chi_squared:
        return []
    share = 100 * best.chi_squared / winner.chi_squared
    return [f"The best effect with constant coefficients, {_name(best)}, gets {share:.0f} % of the way."]


def _in_step(parent: Candidate, winner: Judged, removed: _Removed) -> list[str]:
    """Channels that the effect reads: whether the removed error comes and goes with them."""
    assert winner.fit is not None
    inputs = [name for name in winner.fit.model.structure.inputs if name not in parent.model.structure.inputs]
    found = []
    for name in inputs:
        if name in COMMANDS:
            found += _by_command(parent, name, removed)
            continue
        segments = [one for group in parent.ground.stacks for one in group.spectra]
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
            found.append(f"The error comes and goes with {name} (correlation {together:.2f}).")
    return found


def _by_command(parent: Candidate, name: str, removed: _Removed) -> list[str]:
    """How much of the removed error a command that the parent does not read explains by itself."""
    stacks = parent.ground.stacks
    alone = divide(parent.estimate.error, stacks, causes(stacks, [name]))
    share = np.sum(alone.explained, axis=0) / np.maximum(np.sum(removed.power, axis=1), 1e-300)
    worst = int(np.argmax(share * removed.relative))
    if share[worst] < SHARE_OF_COMMAND:
        return []
    part, axis = 100 * min(float(share[worst]), 1.0), AXIS_OF[removed.outputs[worst]]
    return [f"{part:.0f} % of what goes in {axis} is in step with {name}."]


def _windowed(wave: FloatArray, channel: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Rms of the error (k, n) and mean of the channel (n,) in windows."""
    n = max(1, round(WINDOW_S / dt))
    count = channel.size // n
    square = np.sum(wave[:, : count * n] ** 2, axis=0).reshape(count, n)
    return np.sqrt(np.mean(square, axis=1)), np.mean(channel[: count * n].reshape(count, n), axis=1)


# ------------------------------------------------------------------------------------------------ before and after


def _changes(parent: Candidate, fit: Candidate) -> list[str]:
    structure = fit.model.structure
    before, after = _errors(parent), _errors(fit)
    moved = []
    for one in parent.model.structure.parameters:
        if one.name not in structure.names:
            continue
        old, new = parent.model[one.name], fit.model[one.name]
        spread = max(before[one.name], after[one.name])
        if abs(new - old) > max(MOVED * spread, MOVED_SHARE * abs(old)):
            share = abs(new - old) / max(abs(old), 1e-300)
            words = _turned(amount(one, old, before[one.name]), amount(one, new, after[one.name]), one)
            moved.append((-min(share, 10.0), f"{one.name} {words}"))
    found = []
    if moved:
        found.append(f"Before and after: {'; '.join(words for _, words in sorted(moved)[:MOST_TOLD])}.")
        if len(moved) > MOST_TOLD:
            found[-1] = found[-1][:-1] + f"; {len(moved) - MOST_TOLD} more."
    turned = [_mode(old, _nearest(old, fit.model.modes)) for old in parent.model.modes if abs(old.damping_ratio) < 1]
    if turned:
        found.append(f"Modes: {', '.join([*turned, *_new_modes(parent, fit)])}.")
    return found


def _turned(old: str, new: str, one: Parameter) -> str:
    """`459 ± 2 → 709 ± 4 1/s^2`: the unit once where it is the same."""
    unit = next((each for each in (" ms", f" {one.unit}") if old.endswith(each) and new.endswith(each)), "")
    return f"{old.removesuffix(unit)} → {new}"


def _nearest(mode: Mode, others: Sequence[Mode]) -> Mode:
    return min(others, key=lambda other: abs(other.pole - mode.pole))


def _new_modes(parent: Candidate, fit: Candidate) -> list[str]:
    """Oscillations in the band that the parent did not have."""
    taken = [_nearest(old, fit.model.modes) for old in parent.model.modes]
    top = max(float(one.frequency_hz[-1]) for one in parent.ground.spectra)
    found = [
        f"new {one.frequency_hz:.2f} Hz {one.damping_ratio:.2f}"
        for one in fit.model.modes
        if abs(one.damping_ratio) < 1 and one.frequency_hz < top and one not in taken
    ]
    return list(dict.fromkeys(found))  # equal servos have equal modes


def _mode(old: Mode, new: Mode) -> str:
    return f"{old.frequency_hz:.2f} Hz {old.damping_ratio:.2f} → {new.frequency_hz:.2f} Hz {new.damping_ratio:.2f}"


def _implausible_parent(parent: Candidate, winner: Judged | None, others: Sequence[Judged]) -> tuple[str, ...]:
    """The parent's own implausible values, and which effects make them plausible."""
    found = []
    for one in parent.model.structure.parameters:
        value = parent.model[one.name]
        if not one.implausible(value):
            continue
        begin = f"{amount_signed(one, value)} is not plausible ({plausible_range(one)}): it stands in for something"
        if winner is not None and one.name in winner.resolved and winner.fit is not None:
            now = amount(one, winner.fit.model[one.name], _errors(winner.fit)[one.name])
            found.append(f"{begin}. With {' and '.join(winner.effects)} it becomes {now}.")
            continue
        cures = [
            each
            for each in sorted(others, key=lambda other: -other.chi_squared)
            if each.fit is not None and one.name in each.resolved and not each.implausible
        ]
        if cures:
            best = cures[0]
            assert best.fit is not None
            now = amount(one, best.fit.model[one.name], _errors(best.fit)[one.name])
            more = f" So would {listed([_name(each) for each in cures[1:4]])}." if len(cures) > 1 else ""
            found.append(f"{begin}. {_name(best)} would make it plausible: {now}.{more}")
        else:
            found.append(f"{begin}, and no effect that was refitted makes it plausible.")
    return tuple(found)


def amount_signed(one: Parameter, value: float) -> str:
    """`M_q = +4.69 1/s`: where the sign is the news."""
    said = quantity(one, value)
    return said.replace("= ", "= +", 1) if value > 0 else said


def _name(judged: Judged) -> str:
    return " + ".join(judged.effects)


# ------------------------------------------------------------------------------------------------ what else


def _resembles(winner: Judged, others: Sequence[Judged], alike: Sequence[str]) -> tuple[str, ...]:
    assert winner.fit is not None
    found = []
    if winner.implausible:
        found.append(_stands_in(winner, others))
    if alike:
        by_name = {one.effects: one for one in others}
        each = [by_name.get((name,)) for name in alike]
        values = [f"{name}{_values(one)}" for name, one in zip(alike, each, strict=True)]
        found.append(f"These runs cannot tell it from {listed(values)}.")
    for one in sorted(others, key=lambda other: -other.chi_squared):
        near = one.chi_squared >= NEARLY * winner.chi_squared
        if one.fit is None or not one.implausible or len(one.effects) > 1 or one.effects == winner.effects or not near:
            continue
        share = min(100.0, 100 * one.chi_squared / max(winner.chi_squared, 1e-300))
        found.append(f"{_name(one)} comes near ({share:.0f} %), but only with {_outside(one)}: it stands in.")
        if len(found) >= MOST_TOLD:
            break
    return tuple(found)


def _values(judged: Judged | None) -> str:
    if judged is None or judged.fit is None:
        return ""
    model, errors = judged.fit.model, _errors(judged.fit)
    said = [quantity(p, model[p.name], errors[p.name]) for e in _own(judged) for p in e.parameters]
    return f" ({', '.join(said)})"


def _outside(judged: Judged) -> str:
    assert judged.fit is not None
    model = judged.fit.model
    by_name = {one.name: one for one in model.structure.parameters}
    said = []
    for name in judged.implausible[:2]:
        one = by_name[name]
        said.append(f"{amount_signed(one, model[name])} (plausible: {plausible_range(one)})")
    return listed(said)


def _stands_in(winner: Judged, others: Sequence[Judged]) -> str:
    """An implausible winner, and what beside it would bring its values back."""
    assert winner.fit is not None
    begin = f"{_outside(winner)}: {_name(winner)} stands in for something else."
    for one in sorted(others, key=lambda other: -other.chi_squared):
        both = len(one.effects) > len(winner.effects) and set(winner.effects) < set(one.effects)
        if both and one.fit is not None and not one.implausible:
            beside = " + ".join(name for name in one.effects if name not in winner.effects)
            return f"{begin} Beside {beside} its values would be plausible: {_values(one)[2:-1]}."
    instead = [
        one
        for one in sorted(others, key=lambda other: -other.chi_squared)
        if one.fit is not None and not one.implausible and one.chi_squared >= NEARLY * winner.chi_squared
    ]
    if instead:
        return f"{begin} {_name(instead[0])} explains nearly as much at plausible values: {_values(instead[0])[2:-1]}."
    return begin
