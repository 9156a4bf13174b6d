"""The checks an engineer makes before believing a fit: natural frequencies, agreement between runs, poles.

Each check gives what it found as a value. What is told of an unstable or a poor fit is in sentences: they go into a
fit's warnings, which its file keeps as text.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.airframe import Airframe, agreed
from sysid.data.dataset import Bins, Dataset, Runs, prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ, Spectrum
from sysid.data.record import Record
from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.check_kinds import (
    CheckFinding,
    FewChirps,
    InsideSweep,
    ModesDiffer,
    NoModes,
    NothingFree,
    OutsideSweep,
    ParametersMoved,
    RotorAbove,
    RotorUnknown,
    SetRefused,
    SetsDiffer,
    SweepUnknown,
)
from sysid.fit.clocks import thinned_commands
from sysid.fit.estimate import Estimate, Weights, estimate
from sysid.fit.gauss_newton import minimise
from sysid.fit.output_error import output_error
from sysid.fit.stable import Settled
from sysid.fit.start import START_THINNING, start
from sysid.model.base import bases
from sysid.model.polynomial import closed_form
from sysid.model.structure import FloatArray, Model, Structure

POOR_PERCENT = 70.0
SEPARATE = 4.0  # ratio of residual powers, both axes together
ROTOR_SEPARATION = 3.0  # the averaging of section 3 wants the modes well below one per revolution (paper: 5.5)
PAPER_FREQUENCY_CHANGE_PERCENT = 0.9
PAPER_DAMPING_CHANGE_PERCENT = 1.8
LARGEST_FREQUENCY_CHANGE_PERCENT = 3.0
LARGEST_DAMPING_CHANGE_PERCENT = 15.0
LARGEST_SPREAD = 3.0  # standard errors of a difference between two sets of runs
SLOWEST_HZ = 1e-3  # below it a mode is an integrator of attitude or speed


@dataclass(frozen=True)
class Check:
    """One check; `passed` is None where the data did not allow it."""

    name: str
    passed: bool | None
    finding: CheckFinding


@dataclass(frozen=True)
class Spread:
    """Parameters of sets of runs fitted apart, compared in standard errors of their difference."""

    sets: int
    moves: tuple[tuple[str, float], ...]
    """(name, largest difference between two sets over its standard error), the largest first; free parameters only."""

    @property
    def moved(self) -> tuple[str, ...]:
        return tuple(name for name, times in self.moves if times > LARGEST_SPREAD)

    def to_json(self) -> dict[str, Any]:
        return {"sets": self.sets, "standard_errors": dict(self.moves), "moved": list(self.moved)}


def eigenfrequency_checks(
    model: Model, runs: Runs, band_hz: tuple[float, float] = DEFAULT_BAND_HZ
) -> tuple[Check, ...]:
    """Modes inside the swept band, well below the rotor's frequency, and agreeing between sets of runs."""
    return fit_checks(model, runs, band_hz)[0][:EIGENFREQUENCY]


def fit_checks(
    model: Model,
    runs: Runs,
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    held: Collection[str] = (),
    weights: Weights = "residual spectrum",
) -> tuple[tuple[Check, ...], Spread | None]:
    """The eigenfrequency checks and whether the parameters stay between sets of runs; `held` ones were not fitted.

    The spread is None where the runs do not form sets that identify the model each for itself.
    """
    on = prepared(runs, band_hz)
    sets = _sets(model, on, held, weights)
    early = thinned_commands(model, on, {name: model[name] for name in held})
    spread = None if isinstance(sets, Check) else _spread(model.structure, sets)
    return (
        _inside_sweep(model, on.records),
        _below_rotor(model, on.records),
        sets if isinstance(sets, Check) else _agreement([one.model for one in sets]),
        *([] if spread is None else [_same_parameters(spread)]),
        *([] if early is None else [Check("time of commands", False, early)]),
    ), spread


def _inside_sweep(model: Model, records: Sequence[Record]) -> Check:
    bands = [record.swept_band_hz for record in records if record.swept_band_hz is not None]
    name = "inside the sweep"
    if not bands:
        return Check(name, None, SweepUnknown())
    low, high = max(band[0] for band in bands), min(band[1] for band in bands)
    found = [mode for mode in model.own_modes if mode.frequency_hz > SLOWEST_HZ]
    outside = tuple(mode.frequency_hz for mode in found if not low <= mode.frequency_hz <= high)
    if outside:
        return Check(name, False, OutsideSweep(outside, (low, high)))
    return Check(name, True, InsideSweep((low, high)))


def _below_rotor(model: Model, records: Sequence[Record]) -> Check:
    name = "below the rotor"
    speeds = [float(np.mean(record.channels["omega"])) for record in records if "omega" in record.channels]
    if not speeds or min(speeds) <= 0:
        return Check(name, None, RotorUnknown())
    rotor_hz = min(speeds) / (2 * np.pi)
    highest = max(mode.frequency_hz for mode in model.own_modes)
    ratio = rotor_hz / highest if highest > SLOWEST_HZ else math.inf
    return Check(name, ratio >= ROTOR_SEPARATION, RotorAbove(rotor_hz, ratio))


AGREEMENT = "agreement between runs"
EIGENFREQUENCY = 3
"""How many of the checks, the first ones, are the paper's on natural modes."""


def _sets(model: Model, on: Dataset, held: Collection[str], weights: Weights) -> list[Estimate] | Check:
    """The structure fitted to the first run of every axis, then to the second; or why that is not possible."""
    structure = model.structure
    by_axis: dict[str | None, list[Record]] = {}
    for record in on.records:
        by_axis.setdefault(record.axis, []).append(record)
    count = min((len(runs) for runs in by_axis.values()), default=0)
    if None in by_axis or len(by_axis) < 2 or count < 2:
        return Check(AGREEMENT, None, FewChirps())
    fixed = {name: model[name] for name in held}
    estimates = []
    for index in range(count):
        chosen = on.of([runs[index] for runs in by_axis.values()])
        try:
            bins = chosen.viewed(structure.inputs, structure.outputs)
            estimates.append(estimate(structure, bins, model, fixed, weights))
        except FitError as error:
            return Check(AGREEMENT, False, SetRefused(str(error)))
    return estimates


def _agreement(models: Sequence[Model]) -> Check:
    """Natural frequencies and damping ratios of the sets (the paper: 0.9 and 1.8 %); integrators do not count."""
    modes = [[mode for mode in model.own_modes if mode.frequency_hz > SLOWEST_HZ] for model in models]
    if len({len(found) for found in modes}) > 1:
        return Check(AGREEMENT, False, ModesDiffer())
    if not modes[0]:
        return Check(AGREEMENT, None, NoModes())
    frequencies = np.array([[mode.frequency_hz for mode in found] for found in modes])
    dampings = np.array([[mode.damping_ratio for mode in found] for found in modes])
    change_f = 100 * float(np.max(np.ptp(frequencies, axis=0) / np.mean(frequencies, axis=0)))
    change_z = 100 * float(np.max(np.ptp(dampings, axis=0) / np.max(np.abs(dampings), axis=0)))
    good = change_f <= LARGEST_FREQUENCY_CHANGE_PERCENT and change_z <= LARGEST_DAMPING_CHANGE_PERCENT
    return Check(AGREEMENT, good, SetsDiffer(len(models), change_f, change_z))


def _spread(structure: Structure, sets: Sequence[Estimate]) -> Spread:
    """How far each parameter moves between any two sets, in standard errors of the difference."""
    largest: dict[str, float] = {}
    for one, other in itertools.combinations(sets, 2):
        for index, name in enumerate(structure.names):
            variances = one.covariance[index, index], other.covariance[index, index]
            if min(variances) > 0:  # held, and on a bound, have none
                times = abs(float(one.model.values[index] - other.model.values[index])) / math.sqrt(sum(variances))
                largest[name] = max(largest.get(name, 0.0), times)
    return Spread(len(sets), tuple(sorted(largest.items(), key=lambda item: -item[1])))


def _same_parameters(spread: Spread) -> Check:
    """Runs of one vehicle give one set of numbers; where they do not, the structure lacks something."""
    name = "spread between runs"
    moved, count = len(spread.moved), len(spread.moves)
    if not spread.moves:
        return Check(name, None, NothingFree())
    return Check(name, not moved, ParametersMoved(moved, count, LARGEST_SPREAD, spread.moves[: max(moved, 1)]))


INTEGRATES = 1e-6
"""1/s, a pole's real part below which it is one of zero: damping that was held at none."""


def explain_instability(settled: Settled, bins: Bins) -> list[str]:
    """What to make of a fit with poles in the right half plane, in sentences.

    Rate dynamics of a flyable rotorcraft are seldom that unstable; feedback through a pilot or controller on
    data without independent excitation looks so. The refits show what stable poles and late commands would give.
    """
    model = settled.estimate.model
    real = max(pole.real for pole in np.linalg.eigvals(model.matrices.A))
    if real < INTEGRATES:
        return ["the model has a pole at zero: it integrates its commands, do not simulate it for long"]
    free = output_error(model, bins.stacks).nrmse_percent
    said = [
        f"the model is unstable (pole at {real:+.1f} 1/s): do not simulate it or design on it; "
        "a pilot or controller in the loop, without independent excitation, makes data look so"
    ]
    try:
        outputs = model.structure.outputs
        if settled.held is None:
            raise FitError(settled.refusal or "no stable model was found near the data")
        held = settled.held[1].nrmse_percent
        said.append(
            f"the best stable model near it explains {_percent(outputs, held)} (NRMSE fit), this one "
            f"{_percent(outputs, free)}"
        )
        if LATE_ALREADY.isdisjoint(one.id for one in model.structure.composed):
            late = lateness(model.structure.bare, bins)
            if late is not None:
                said.append(late)
    except FitError as error:
        said.append(f"no more can be said of why: {error}")
    said.append("fly a chirp with independent noise on every axis, with the excitation logged, and fit that")
    return said


LATE_ALREADY = frozenset((
    "servo_lag", "motor_lag", "lag_per_axis", "servo_second_order", "servo_acceleration_limit", "transport_delay",
    "gyro_lag", "gyro_filter",
))  # fmt: skip
HINT_TOLERANCE = 1e-3
"""Of the summed logarithms of residual power: a twentieth of a percent of a rate."""
LATENESS_S = (0.01, 0.02, 0.03, 0.04, 0.05, 0.065, 0.08, 0.1)
MUCH = 0.7
"""Of the residual power is left, or less, by what is worth a hint."""


def explain_poverty(model: Model, nrmse: FloatArray, bins: Bins) -> list[str]:
    """What to tell of a fit that leaves much unexplained: often something is late, and then its numbers lie.

    Not of a base that a larger one stands above: what that one has besides is what it leaves.
    """
    structure = model.structure
    simple = any(larger.reduces_to == structure.base for larger in bases().values())
    if structure.composed or simple or np.min(nrmse) >= POOR_PERCENT:
        return []
    said = [
        f"the model leaves much unexplained ({_percent(structure.outputs, nrmse)}): its standard errors do not hold"
    ]
    try:
        late = lateness(structure, bins, model)
    except FitError:
        late = None
    flew = agreed(one.segment.record.airframe for one in bins.spectra)
    lag = "motor_lag" if flew is Airframe.MULTIROTOR else "servo_lag"
    if late is not None:
        said.append(f"{late}: refit with --with {lag} or --with transport_delay")
    elif (both := _lag_and_delay(structure, bins, model)) is not None:
        said.append(f"{both}: refit with --with {lag},transport_delay")
    return said


def _lag_and_delay(structure: Structure, bins: Bins, fitted: Model) -> str | None:
    """Whether both together would explain much more, where neither does: alone each may fit no better than a vehicle
    that answers the wrong way round, in whose valley `fitted` may lie, so that each fit begins anew. None where they
    would not."""
    try:
        base, _ = _least(structure, bins, fitted)
        late_s, cost, model = _least_late(structure, bins, "both", None)
    except FitError:
        return None
    if cost > base + np.log(MUCH):
        return None
    late = _late(bins, "both", late_s).stacks
    lifted = output_error(_settled(model, late)[0], late).nrmse_percent
    return (
        f"something is late between command and rate: a lag of about {1000 * late_s:.0f} ms with a delay of half that "
        f"would lift it to {_percent(structure.outputs, lifted)}"
    )


def lateness(structure: Structure, bins: Bins, fitted: Model | None = None) -> str | None:
    """Whether commands that act late, by a lag or a delay, would explain much more; None where they would not.

    Without a closed form, which begins at the data, every fit begins at the one that is known, if any. It costs less
    than the fit that it is a hint for: a few fits of some of the bins, each beginning at the last.
    """
    begin = fitted if closed_form(structure) is None else None
    base, _ = _least(structure, bins, begin)
    parts, least = [], {}
    for kind in ("lag", "delay"):
        late_s, cost, model = _least_late(structure, bins, kind, begin)
        least[kind] = cost
        late = _late(bins, kind, late_s).stacks
        lifted = output_error(_settled(model, late)[0], late).nrmse_percent
        parts.append(f"a {kind} of about {1000 * late_s:.0f} ms would lift it to {_percent(structure.outputs, lifted)}")
    if min(least.values()) > base + np.log(MUCH):
        return None
    if abs(least["lag"] - least["delay"]) < np.log(SEPARATE):
        verdict = "these data do not separate the two"
    else:
        verdict = f"the {min(least, key=lambda kind: least[kind])} explains far more"
    return f"something is late between command and rate: {', '.join(parts)}; {verdict}"


def _least_late(structure: Structure, bins: Bins, kind: str, begin: Model | None) -> tuple[float, float, Model]:
    """The lateness of the least cost, s, found by steps to either side from the middle; the cost, and its model."""
    found: dict[int, tuple[float, Model]] = {}

    def cost(at: int) -> float:
        if not 0 <= at < len(LATENESS_S):
            return np.inf
        if at not in found:
            near = found[min(found, key=lambda other: abs(other - at))][1] if found else begin
            start_at = begin if begin is None else near
            found[at] = _least(structure, _late(bins, kind, LATENESS_S[at]), start_at)
        return found[at][0]

    at = len(LATENESS_S) // 2
    while cost(better := min((at - 1, at + 1), key=cost)) < cost(at):
        at = better
    return LATENESS_S[at], *found[at]


def _percent(outputs: Sequence[str], nrmse: FloatArray) -> str:
    """`p 92 / q 88 %`."""
    return " / ".join(f"{name} {value:.0f}" for name, value in zip(outputs, nrmse, strict=True)) + " %"


def _least(structure: Structure, bins: Bins, begin: Model | None) -> tuple[float, Model]:
    """The least cost of a bare base, judged on some of the bins, as what it is compared with; and its model."""
    stacks = [group.thinned(START_THINNING) for group in bins.stacks]
    if begin is not None:
        best, power = _settled(begin, stacks)
        return float(np.sum(np.log(power))), best
    best = start(structure, stacks, thorough=False)
    return float(np.sum(np.log(output_error(best, stacks).residual_power))), best


def _settled(begin: Model, stacks: Sequence[Stack]) -> tuple[Model, FloatArray]:
    """As good as a hint has to be."""
    return minimise(begin, stacks, output_error(begin, stacks).residual_power, tolerance=HINT_TOLERANCE)


def _late(bins: Bins, kind: str, late_s: float) -> Bins:
    """The same with inputs that act later, by a `lag`, a `delay`, or by `both`, the delay half of the lag."""

    def late(one: Spectrum) -> Spectrum:
        s = 2j * np.pi * one.frequency_hz
        lag, delay_s = 1 / (1 + s * late_s), late_s / 2 if kind == "both" else late_s
        return replace(one, U=one.U * (1 if kind == "delay" else lag) * (1 if kind == "lag" else np.exp(-s * delay_s)))

    return Bins(tuple(late(one) for one in bins.spectra))
