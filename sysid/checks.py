"""The checks an engineer makes before believing a fit: natural frequencies, agreement between runs, poles.

Each check says in a sentence what it found, so that a screen or a report can show it as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.fit import FitError, estimate, held_stable, output_error, start
from sysid.model import Model, Structure
from sysid.predict import stack
from sysid.preprocess import DEFAULT_BAND_HZ, Spectrum, spectra
from sysid.record import Record

ROTOR_SEPARATION = 3.0  # the averaging of section 3 wants the modes well below one per revolution (paper: 5.5)
PAPER_FREQUENCY_CHANGE_PERCENT = 0.9
PAPER_DAMPING_CHANGE_PERCENT = 1.8
LARGEST_FREQUENCY_CHANGE_PERCENT = 3.0
LARGEST_DAMPING_CHANGE_PERCENT = 15.0


@dataclass(frozen=True)
class Check:
    """One finding; `passed` is None where the data did not allow the check."""

    name: str
    passed: bool | None
    text: str


def eigenfrequency_checks(
    model: Model, records: Sequence[Record], band_hz: tuple[float, float] = DEFAULT_BAND_HZ
) -> tuple[Check, ...]:
    """Modes inside the swept band, well below the rotor's frequency, and agreeing between sets of runs."""
    return (_inside_sweep(model, records), _below_rotor(model, records), _agreement(model.structure, records, band_hz))


def _inside_sweep(model: Model, records: Sequence[Record]) -> Check:
    bands = [record.swept_band_hz for record in records if record.swept_band_hz is not None]
    name = "inside the sweep"
    if not bands:
        return Check(name, None, "swept band not known: none of the runs is a chirp with its settings")
    low, high = max(band[0] for band in bands), min(band[1] for band in bands)
    outside = [mode for mode in model.modes if not low <= mode.frequency_hz <= high]
    if outside:
        listed = ", ".join(f"{mode.frequency_hz:.2f} Hz" for mode in outside)
        return Check(name, False, f"{listed} outside the swept {low:g}-{high:g} Hz: extrapolated, sweep there too")
    return Check(name, True, f"every mode inside the swept {low:g}-{high:g} Hz")


def _below_rotor(model: Model, records: Sequence[Record]) -> Check:
    name = "below the rotor"
    speeds = [float(np.mean(record.channels["omega"])) for record in records if "omega" in record.channels]
    if not speeds or min(speeds) <= 0:
        return Check(name, None, "rotor speed not logged: compare the modes with it by hand")
    rotor_hz = min(speeds) / (2 * np.pi)
    highest = max(mode.frequency_hz for mode in model.modes)
    ratio = rotor_hz / highest
    text = f"rotor {rotor_hz:.1f} Hz, {ratio:.1f} times the highest mode"
    if ratio < ROTOR_SEPARATION:
        return Check(name, False, f"{text}: averaging over a revolution does not hold")
    return Check(name, True, text)


def _agreement(structure: Structure, records: Sequence[Record], band_hz: tuple[float, float]) -> Check:
    """Fit the first run of every axis, then the second, and compare the modes (the paper: 0.9 and 1.8 %)."""
    name = "agreement between runs"
    by_axis: dict[str | None, list[Record]] = {}
    for record in records:
        by_axis.setdefault(record.axis, []).append(record)
    count = min((len(runs) for runs in by_axis.values()), default=0)
    if None in by_axis or len(by_axis) < 2 or count < 2:
        return Check(name, None, "needs two chirps on each axis: fly each twice")
    try:
        models = []
        for index in range(count):
            chosen = [runs[index] for runs in by_axis.values()]
            found, _ = spectra(chosen, structure.inputs, structure.outputs, band_hz)
            models.append(estimate(structure, found).model)
    except FitError as error:
        return Check(name, False, f"a set of runs alone does not identify the model: {error}")
    if len({len(model.modes) for model in models}) > 1:
        return Check(name, False, "the sets of runs do not even agree on which modes oscillate")
    frequencies = np.array([[mode.frequency_hz for mode in model.modes] for model in models])
    dampings = np.array([[mode.damping_ratio for mode in model.modes] for model in models])
    change_f = 100 * float(np.max(np.ptp(frequencies, axis=0) / np.mean(frequencies, axis=0)))
    change_z = 100 * float(np.max(np.ptp(dampings, axis=0) / np.abs(np.mean(dampings, axis=0))))
    text = (
        f"{count} sets of runs differ by {change_f:.1f} % in natural frequency, {change_z:.1f} % in damping "
        f"(paper {PAPER_FREQUENCY_CHANGE_PERCENT} and {PAPER_DAMPING_CHANGE_PERCENT} %)"
    )
    good = change_f <= LARGEST_FREQUENCY_CHANGE_PERCENT and change_z <= LARGEST_DAMPING_CHANGE_PERCENT
    return Check(name, good, text)


def explain_instability(model: Model, found: Sequence[Spectrum]) -> list[str]:
    """What to make of a fit with poles in the right half plane, in sentences.

    Rate dynamics of a flyable rotorcraft are seldom that unstable; feedback through a pilot or controller on
    data without independent excitation looks so. The refits show what stable poles and late commands would give.
    """
    real = max(pole.real for pole in np.linalg.eigvals(model.matrices.A))
    stacks = stack(found)
    free = output_error(model, stacks).nrmse_percent
    said = [
        f"the model is unstable (pole at {real:+.1f} 1/s): do not simulate it or design on it; "
        "a pilot or controller in the loop, without independent excitation, makes data look so"
    ]
    try:
        p, q = held_stable(model, stacks)[1].nrmse_percent
        said.append(
            f"with the poles held stable it reaches only p {p:.0f} / q {q:.0f} %, "
            f"free p {free[0]:.0f} / q {free[1]:.0f} %"
        )
        late = lateness(Structure(model.structure.base_), found)
        if late is not None:
            said.append(late)
    except FitError as error:
        said.append(f"no more can be said of why: {error}")
    said.append("fly a chirp with independent noise on every axis, with the excitation logged, and fit that")
    return said


LATENESS_S = (0.01, 0.02, 0.03, 0.04, 0.05, 0.065, 0.08, 0.1)


def lateness(structure: Structure, found: Sequence[Spectrum]) -> str | None:
    """Whether commands that act late, by a lag or a delay, would explain much more; None where they would not."""
    base = _cost(structure, found)
    parts, least = [], np.inf
    for kind in ("lag", "delay"):
        costs = []
        for late_s in LATENESS_S:
            delayed = [_late(one, kind, late_s) for one in found]
            costs.append(_cost(structure, delayed))
        late_s = LATENESS_S[int(np.argmin(costs))]
        least = min(least, *costs)
        p, q = estimate(structure, [_late(one, kind, late_s) for one in found]).error.nrmse_percent
        parts.append(f"a {kind} of about {1000 * late_s:.0f} ms would lift it to p {p:.0f} / q {q:.0f} %")
    if least > base + np.log(0.7):
        return None
    return f"something is late between command and rate: {', '.join(parts)}; these data do not separate the two"


def _cost(structure: Structure, found: Sequence[Spectrum]) -> float:
    stacks = stack(found)
    return float(np.sum(np.log(output_error(start(structure, stacks), stacks).residual_power)))


def _late(one: Spectrum, kind: str, late_s: float) -> Spectrum:
    s = 2j * np.pi * one.frequency_hz
    factor = 1 / (1 + s * late_s) if kind == "lag" else np.exp(-s * late_s)
    return replace(one, U=one.U * factor)
