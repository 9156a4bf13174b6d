"""What may be wrong with runs before any structure is blamed: clipped gyros, mistaken axes, vehicles mixed.

A fit hides such mistakes. With rates clipped it finds a slower vehicle; with axes swapped or turned by 90 or 180
degrees a structure without bounds fits exactly as well, only its numbers mean something else; runs of two vehicles give
the mean of both. Each check here looks at what a mistake cannot hide: flat tops at one value; the axis that a run was
declared to be flown on beside the command that moved; the sign of the slowest answers, or without a logged excitation
of the fastest; residuals that every run's own linear response explains and a common one does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sysid.compare.finding_kinds import (
    Answers,
    Clipped,
    CommandsElsewhere,
    Mixed,
    NotSeparable,
    OtherAxisMoved,
    Suspicion,
    WrongSigns,
)
from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.record import CYCLIC, RATES, Record, axis_of
from sysid.errors import FitError
from sysid.fit.axes import refuse_still_channels
from sysid.model.structure import FloatArray, Structure
from sysid.response.values import Responses

FLAT_SAMPLES = 5
"""Times the usual hold, at the largest or smallest value: a flat top."""
FLAT_TOPS = 2
STEEP = 2.5
"""Steps of the gyro's resolution into a flat top; a slow peak of a coarse gyro is reached by single steps."""
OTHER_AXIS = 2.0
"""Root mean square of the other axis's command over that of the declared one."""
SLOWEST_HZ = 0.9
USUAL_LAG = np.exp(1j * np.pi / 6)
"""Slow answers of a rate lie about 30 degrees behind the command."""
FASTER_HZ, TIMES_FURTHER = 1.0, 4.0
"""Where fast answers begin, and how much further they have to be known: in a narrow band any lateness turns a sign."""
LATEST_S, LATENESS_STEP_S = 0.15, 0.005
"""By which motors, servos and links delay a vehicle's answer, at most, and the steps in which it is looked for."""
ALIGNED, CLEARLY = 0.8, 0.5
"""Share of a fast response that one lateness aligns with its command, and by how much more than with its opposite. Two
measured multirotors and a simulated one: 0.88 to 0.99, at most 0.3 for the opposite; a flapping rotor 0.7 and 0.9."""
OPPOSITE = -0.26
"""Cosine beside the usual phase from which on an answer counts as of the other sign: 105 degrees away."""
LEAST_DIRECT = 0.1
"""Of the largest answer; one below has no sign to speak of."""
FEWEST_POINTS = 3
CROSSED = 2.0
"""Product of the cross answers over that of the direct ones, from which on the axes look swapped."""
SEPARATE_SHARE = 0.2
"""Of the residual, that a response for every run explains beyond a common one. Play makes 0.04."""
SAME_SHARE = 0.1
"""Of two runs' residual: below it they may be of one vehicle."""
MOST_RUNS = 12
"""That are compared two by two."""


# ------------------------------------------------------------------------------------------------ the gyro


def clipped(records: Sequence[Record]) -> list[Suspicion]:
    """Rates that stand at their largest or smallest value again and again, reached in full motion."""
    found: dict[str, list[tuple[str, float, float]]] = {}
    for record in records:
        for name in RATES:
            share, limit = flat_tops(record.channels[name])
            if share > 0:
                found.setdefault(name, []).append((record.id, share, limit))
    return [
        Clipped(
            runs=tuple(run for run, _, _ in each),
            channel=name,
            limit=max(limit for _, _, limit in each),
            share=max(share for _, share, _ in each),
        )
        for name, each in found.items()
    ]


def flat_tops(values: FloatArray) -> tuple[float, float]:
    """Share of the samples (n,) in flat tops at the extremes, and the value's size there; zeros where there are none.

    Logged more slowly than sampled, every value is held for some samples: only longer than usual counts.
    """
    edges = np.flatnonzero(np.diff(values)) + 1
    starts, stops = np.concatenate([[0], edges]), np.concatenate([edges, [values.size]])
    if edges.size < 2:
        return 0.0, 0.0
    length = stops - starts
    least = FLAT_SAMPLES * float(np.median(length))
    steps = np.abs(np.diff(values[starts]))
    resolution = float(np.min(steps))
    count, limit = 0, 0.0
    for extreme in (float(values.max()), float(values.min())):
        at = np.flatnonzero((values[starts] == extreme) & (length >= least))
        inside = at[(at > 0) & (at < starts.size - 1)]
        into = np.concatenate([steps[inside - 1], steps[inside]])
        if at.size >= FLAT_TOPS and into.size and float(np.median(into)) >= STEEP * resolution:
            count += int(np.sum(length[at]))
            limit = max(limit, abs(extreme))
    return count / values.size, limit


# ------------------------------------------------------------------------------------------------ axes and signs


def mistaken_axes(records: Sequence[Record]) -> list[Suspicion]:
    """Runs whose declared axis is not the one that was moved, and excitations that moved another command."""
    found: list[Suspicion] = []
    letters = {"roll": "x", "pitch": "y"}
    for axis, letter in letters.items():
        other = "y" if letter == "x" else "x"
        wrong: dict[str, list[str]] = {}
        for record in records:
            if record.axis != axis:
                continue
            logged = [f"excitation_{one}" for one in letters.values()]
            moved = all(name in record.channels for name in logged) and any(
                np.any(record.channels[name]) for name in logged
            )
            kind = "excitation" if moved else "delta"
            own, beside = (float(np.std(record.channels[f"{kind}_{one}"])) for one in (letter, other))
            if beside > OTHER_AXIS * own:
                wrong.setdefault(f"{kind}_{other}", []).append(record.id)
        found += [OtherAxisMoved(tuple(runs), axis, name) for name, runs in wrong.items()]
    return found + _mistaken_commands(records)


def _mistaken_commands(records: Sequence[Record]) -> list[Suspicion]:
    """What was added to one command must show in it, with its sign."""
    names = ("excitation_x", "excitation_y")
    whole = [one for one in records if set(names) <= set(one.channels)]
    e = [np.stack([one.channels[name] for name in names]) for one in whole]
    d = [np.stack([one.channels[name] for name in ("delta_x", "delta_y")]) for one in whole]
    e, d = [one - one.mean(axis=1, keepdims=True) for one in e], [one - one.mean(axis=1, keepdims=True) for one in d]
    inner = np.sum([one @ one.T for one in e], axis=0) if e else np.zeros((2, 2))
    if np.linalg.matrix_rank(inner, 1e-6 * max(float(np.trace(inner)), 1e-300)) < 2:
        return []
    gain = np.sum([one @ other.T for one, other in zip(d, e, strict=True)], axis=0) @ np.linalg.inv(inner)
    answers = _answers(gain)
    if answers is None:
        return []
    return [CommandsElsewhere(tuple(one.id for one in whole), answers)]


def mistaken_signs(measured: Responses) -> list[Suspicion]:
    """Answers whose signs are not the convention's: rates and commands swapped, turned or of another sign.

    A positive roll (pitch) command gives a positive slow roll (pitch) rate, whatever the vehicle. Where feedback may
    have made the commands slow answers are those of the controller, turned by 180 degrees, and the angular
    accelerations of fast ones are looked at: late, they have the command's sign. Nothing is told where these are not
    clear, as of a rotor that flaps.
    """
    if not set(CYCLIC) <= set(measured.commands) or not set(RATES) <= set(measured.outputs):
        return []
    at = np.ix_([measured.outputs.index(name) for name in RATES], [measured.commands.index(name) for name in CYCLIC])
    H = measured.H[at]
    known = np.all(np.isfinite(H), axis=(0, 1))
    gain: ComplexArray | FloatArray | None
    if measured.closed_loop_safe:
        known &= measured.frequency_hz <= SLOWEST_HZ
        gain = np.mean(H[:, :, known], axis=2) * USUAL_LAG if np.count_nonzero(known) >= FEWEST_POINTS else None
    else:
        known &= measured.frequency_hz >= FASTER_HZ
        weighed = (H * measured.partial_coherence[at])[:, :, known]
        far = float(np.max(measured.frequency_hz[known], initial=0.0)) >= TIMES_FURTHER * FASTER_HZ
        gain = _fast_gain(2 * np.pi * measured.frequency_hz[known], weighed) if far else None
    answers = None if gain is None else _answers(gain)
    if answers is None:
        return []
    return [WrongSigns(answers, measured.closed_loop_safe)]


def _fast_gain(omega: FloatArray, H: ComplexArray) -> FloatArray | None:
    """Angular acceleration by command (2, 2), with signs, of responses H (2, 2, f) at `omega`, rad/s (f,).

    Whichever lateness aligns them best may be in it. None where a large one has no clear sign.
    """
    acceleration = 1j * omega * H
    size = np.sum(np.abs(acceleration), axis=2)
    early = np.exp(1j * np.outer(omega, np.arange(0, LATEST_S, LATENESS_STEP_S)))
    aligned = np.real(acceleration @ early) / np.maximum(size, 1e-300)[:, :, None]
    plus, minus = np.max(aligned, axis=2), np.max(-aligned, axis=2)
    clear = (np.maximum(plus, minus) >= ALIGNED) & (np.abs(plus - minus) >= CLEARLY)
    if not np.all(clear | (size < LEAST_DIRECT * np.max(size))):
        return None
    return np.asarray(np.where(clear, np.sign(plus - minus), 0.0) * size)


USUAL: Answers = ((0, 1), (1, 1))


def _answers(gain: ComplexArray | FloatArray) -> Answers | None:
    """What answers each input of a gain (2, 2), real or turned so that usual answers are; None where all is usual."""
    size = np.abs(gain)
    if not np.all(np.isfinite(size)) or not np.any(size):
        return None
    direct = np.diag(gain)
    opposite = (np.real(direct) < OPPOSITE * np.abs(direct)) & (np.abs(direct) > LEAST_DIRECT * np.max(size))
    if not np.any(opposite) and size[0, 1] * size[1, 0] <= CROSSED * size[0, 0] * size[1, 1]:
        return None
    choices = [((i, one), (1 - i, other)) for i in (0, 1) for one in (1, -1) for other in (1, -1)]
    best = max(
        choices,
        key=lambda each: sum(sign * float(np.real(gain[row, column])) for column, (row, sign) in enumerate(each)),
    )
    return None if best == USUAL else best


# ------------------------------------------------------------------------------------------------ vehicles


Explained = Callable[[Sequence[int]], FloatArray]
"""Numbers of runs -> (k,), what one common linear response explains of their residual."""


def mixed(
    ids: Sequence[str],
    kinds: Sequence[object],
    power: FloatArray,
    explained: Explained,
    *,
    across: bool,
    amplitudes: bool,
    outputs: Sequence[str] = RATES,
) -> list[Suspicion]:
    """Runs whose residuals want a linear response each: other vehicles, gains or flight conditions among them.

    power: (runs, k) of the residual. kinds: what was flown, of every run; without `across` runs are compared with those
    of their kind only. Nonlinear vehicles do this too where the `amplitudes` differ, and the text says so. `outputs`
    names the k.
    """
    groups = [[i for i, kind in enumerate(kinds) if kind == one] for one in dict.fromkeys(kinds)]
    together = [group for group in ([list(range(len(ids)))] if across else groups) if len(group) > 1]
    if not together:
        return []
    alone = np.array([explained([i]) for i in range(len(ids))])
    gain = np.sum([np.sum(alone[group], axis=0) - explained(group) for group in together], axis=0)
    beyond = gain / np.maximum(np.sum(power, axis=0), 1e-300)
    worst = int(np.argmax(beyond))
    if beyond[worst] < SEPARATE_SHARE:
        return []
    apart = []
    for group in groups:
        parts = _alike(group, alone, power, explained) if len(group) <= MOST_RUNS else [group]
        if len(parts) > 1:
            apart.append(tuple(tuple(ids[i] for i in part) for part in parts))
    return [
        Mixed(
            runs=tuple(ids),
            axis=axis_of(outputs[worst]),
            share=float(beyond[worst]),
            apart=tuple(apart),
            amplitudes=amplitudes,
        )
    ]


def _alike(numbers: Sequence[int], alone: FloatArray, power: FloatArray, explained: Explained) -> list[list[int]]:
    """Runs of one kind in groups that one response each explains."""
    groups: list[list[int]] = []
    for i in numbers:
        for group in groups:
            beyond = [
                (alone[i] + alone[j] - explained([i, j])) / np.maximum(power[i] + power[j], 1e-300) for j in group
            ]
            if np.max(beyond) < SAME_SHARE:
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def not_separable(structure: Structure, spectra: Sequence[Spectrum]) -> list[Suspicion]:
    """Whether these runs alone could identify anything."""
    try:
        refuse_still_channels(structure, spectra)
    except FitError as error:
        runs = tuple(dict.fromkeys(one.segment.record.id for one in spectra))
        return [NotSeparable(runs, str(error))]
    return []
