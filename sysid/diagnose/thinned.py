"""A log slower than a loop that it does not tell of: how long commands were held is found before effects are asked.

Taken as held from sample to sample, commands act up to half a sample early, which many effects explain. So that much
is no evidence: the hold follows from the runs themselves, and effects are asked for what is left. What depends on how
large commands are is asked at the frequencies where such a log shows that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import SLOW_S, Piece, Spectrum, held_s, lost_commands
from sysid.diagnose.evidence import Candidate
from sysid.errors import FitError
from sysid.fit.check_kinds import CommandsThinned
from sysid.fit.clocks import found_hold
from sysid.fit.whitening import Whitening
from sysid.model.structure import FloatArray, Model

SAMPLES_OF_A_PERIOD = 20.0
"""That a thinned log must have of commands to tell how large small ones are: noise on the excitation moves them between
samples, too, and what is small seems to be answered less than what is large, as in play. Clean flights of small
helicopters logged at 50 Hz showed play, or a term, at up to log10 p -18 by all commands, and -3 by these; one logged
at 100 Hz -7 by those with 12, and -2 by these."""
FEW_SAMPLES = 6.0
"""The same to tell what they did at all: on a clean flight of a strong loop that was logged at 50 of 250 Hz a mode of
five samples showed at log10 p -7.9; those that were there had seven and more."""
FOLDED = 0.004
"""Of a command's power in the band, just below half the log's rate, from which on what folds back from beyond cannot be
neglected: doublets at 50 Hz had 0.025 to 0.07, and left 20 to 35 % of their answer unexplained by the truth itself;
chirps 0.002 and less. At 125 of 250 Hz doublets had 0.0076 and 0.01, and left more than ten times their noise."""
NEAR_THE_END = 0.8
"""Of half the rate: so far is just below."""
FEW_KEPT = 4.5
"""Commands for one in the log, beyond which that is so: two clean flights of 640 with noise and lost samples were
alarms, at log10 p -7.6 and -8.7, of 5 and of 8; four that hid something showed it at -4.5 to -10.9, of 2 and of 4."""
USUAL_LOOP_S = 1 / 400
"""How long a loop holds commands that nobody told of;"""
LIKELY_LOOPS_S = 5e-4
"""and how far, one standard deviation, others of 250 to 1000 Hz let them act from when this one does."""
AS_MUCH = 0.25
"""Of the most that any command moves, in power, that one has to for its spectrum to count."""
Fitted = Callable[[Dataset, Model], Candidate]


def as_held(
    parent: Candidate, fixed: Mapping[str, float], fitted: Fitted
) -> tuple[Candidate, CommandsThinned | None, float | None]:
    """The parent on its runs as the loop held their commands, fitted anew (`fitted`); what thinned them; and how long
    each was held, s. The parent itself, and None, where they tell of no other loop, or do not determine it by that."""
    hold = found_hold(parent.model, parent.dataset, fixed, lambda runs, near: fitted(runs, near).model)
    if hold is None:
        return parent, None, None
    try:
        return fitted(parent.dataset.held(hold.loop_s), hold.near), hold.what, hold.loop_s
    except FitError:
        return parent, None, None


@dataclass(frozen=True, eq=False, slots=True)
class TakenAs:
    """Runs taken as a loop would have held their commands, a usual one or one that they showed."""

    parent: Candidate
    """Fitted to them."""
    loop_s: float
    what: CommandsThinned


def by_a_usual_loop(parent: Candidate, fitted: Fitted) -> TakenAs | None:
    """The parent on its runs as a usual loop would have held their commands, fitted anew (`fitted`); None where the log
    has or tells every loop, or they are taken as held no longer than by likely ones, or do not determine it by that.

    What the runs show of a hold beside a parent that lacks something may be what it lacks: a delay, as of a slow loop.
    """
    runs = parent.dataset
    told = any(one.loop_known for one in runs.records)
    if told or max(held_s(piece.dt, piece.record) for piece in runs.pieces) < SLOW_S:
        return None
    sample_s = max(piece.dt for piece in runs.pieces)
    what = CommandsThinned(0.5 * (sample_s - USUAL_LOOP_S), LIKELY_LOOPS_S, sample_s)
    try:
        return TakenAs(fitted(runs.held(USUAL_LOOP_S), parent.model), USUAL_LOOP_S, what)
    except FitError:
        return None


def untold(runs: Dataset) -> bool:
    """Whether a log slower than any likely loop does not tell of it, though the runs may have shown it since."""
    return any(piece.dt >= SLOW_S and not piece.record.loop_known for piece in runs.pieces)


def samples_lost(runs: Dataset) -> bool:
    """Whether a log lost samples of its commands: it is slower than its loop, as far as that is known, or than any
    likely one."""
    return untold(runs) or any(lost_commands(piece.dt, piece.record) for piece in runs.pieces)


def noise_lost(runs: Dataset) -> bool:
    """Whether noise was flown with chirps whose every sample the log has not: what it did between those that are there,
    nobody knows, and what of it folds back the vehicle never got."""
    return samples_lost(runs) and any(piece.record.chirp_noise for piece in runs.pieces)


def noise_folded(runs: Dataset) -> bool:
    """Whether most of that noise in a log is what folded back, more than three times what was flown there: what small
    commands seem to do by such a log is no evidence."""
    return any(piece.record.chirp_noise and _given(piece) > FEW_KEPT for piece in runs.pieces)


def _given(piece: Piece) -> float:
    """Commands that the loop gave for one that the log has; a usual loop, where that is not known."""
    loop_s = USUAL_LOOP_S if piece.record.loop_dt_s is None else held_s(piece.dt, piece.record)
    return piece.dt / loop_s


def rows_that_tell_sizes(whitening: Whitening) -> FloatArray | None:
    """1 for rows (N,) at whose frequencies the log shows how large small commands are, else 0; None where it has every
    loop."""
    return _rows_of(whitening, SAMPLES_OF_A_PERIOD)


def rows_that_tell_commands(whitening: Whitening) -> FloatArray | None:
    """The same of what commands did between its samples."""
    return _rows_of(whitening, FEW_SAMPLES)


def _rows_of(whitening: Whitening, samples: float) -> FloatArray | None:
    """1 for rows (N,) of whose periods a log that lost commands has so many samples, else 0; None where none did."""
    if not any(group.thinned_log for group in whitening.stacks):
        return None
    parts = []
    for group in whitening.stacks:
        told = (not group.thinned_log) | (group.frequency_hz * group.dt * samples <= 1)
        parts += [np.tile(np.repeat(told[part], 2), len(group.Y)) for part in group.slices]
    return np.concatenate(parts).astype(float)


def telling(runs: Dataset) -> Dataset | None:
    """The runs whose samples tell what the commands did; None where none does.

    A log slower than the loop, or than any likely one where it does not tell, lost when a step was, and a model that is
    exact misses the answer by as much.
    """
    lost = {
        id(one.segment.record)
        for one in runs.spectra
        if lost_commands(one.dt, one.segment.record) and _folded(one, runs.own_commands)
    }
    kept = tuple(one for one in runs.records if id(one) not in lost)
    return runs.of(kept) if kept else None


def _folded(run: Spectrum, commands: Sequence[str]) -> bool:
    """Whether one of these commands that moves holds more beyond half the log's rate than can be neglected."""
    moving = [run.segment.channels[name] - np.mean(run.segment.channels[name]) for name in commands]
    most = max(float(np.mean(one**2)) for one in moving)
    window = np.hanning(run.samples)
    f = np.fft.rfftfreq(run.samples, run.dt)
    inside = (f >= run.frequency_hz[0]) & (f <= run.frequency_hz[-1])
    near = f > NEAR_THE_END * f[-1]
    for one in moving:
        if np.mean(one**2) < AS_MUCH * most:
            continue
        power = np.abs(np.fft.rfft(one * window)) ** 2
        if np.mean(power[near]) > FOLDED * np.mean(power[inside]):
            return True
    return False
