"""Whether commands act before their time stamps: a log that thins them, or clocks that differ.

A log slower than the vehicle's loop holds the last of several commands; taken as held for a whole sample it acts up to
half a sample early. What acts earlier than that was stamped late. One signed delay of all commands, estimated
beside the model's parameters, tells both; a delay that is positive is the vehicle's own affair.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import RESPONSE, SLOW_S
from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.check_kinds import CommandsLate, CommandsThinned
from sysid.fit.estimate import estimate
from sysid.fit.gauss_newton import gauss_newton_step, normal_equations
from sysid.fit.output_error import OutputError, output_error
from sysid.fit.weights import spectral_weights
from sysid.model.acting import divided, linear_dynamics
from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter
from sysid.model.structure import FloatArray, Model, Structure

WORTH_A_LOOK_S = 8e-4
"""By which the commands seem to act early at a first look."""
LEAST_S = 1e-3
SURE = 5.0
"""Standard errors."""
LITTLE_S, LIKELY = 3e-4, 3.0
"""The same where a loop that nobody told of may have done it."""
SHORTEST_S = 1e-3
"""That a loop holds commands, at least: a shorter hold would move them by half a millisecond at most, which no log so
slow tells, and what acts on samples is simulated on the loop's."""
THINNED = 1.25
"""Half samples: what is earlier than that no loop explains."""


def _response(s: Any, parameters: Mapping[str, Any]) -> Any:
    """exp(-s T), of the shape of s."""
    return np.exp(-s * parameters["command_time"])


COMMAND_TIME = Effect(
    id="command_time",
    title="time of the commands against the rates",
    group="actuators",
    equation="v(t) = delta(t - T) on every command channel, T of either sign",
    source="a log slower than the loop, or another clock",
    signature="phase rises or falls in proportion to frequency, alike on both axes",
    parameters=(
        Parameter(
            "command_time",
            "s",
            "how late commands act after their time stamps",
            plausible=(-0.1, 0.1),
            null=0.0,
            bounds=(-0.1, 0.1),
            typical=0.005,
        ),
    ),
    stage=Stage.COMMAND,
    response=_response,
)


@dataclass(frozen=True, eq=False)
class Early:
    """Commands that act before their time stamps."""

    what: CommandsLate | CommandsThinned
    error: OutputError
    """What the model leaves with its commands moved."""


def early_commands(model: Model, runs: Dataset, fixed: Mapping[str, float] | None = None) -> Early | None:
    """Commands that act before their time stamps; None where they do not, or where nothing can be told.

    Of stable models without a delay of their own whose commands nothing moves in time before they act.
    """
    wider = _with_command_time(model)
    if wider is None:
        return None
    stacks = runs.viewed(model.structure.inputs, model.structure.outputs).stacks
    if _first_look(model, wider, stacks) > -WORTH_A_LOOK_S:
        return None
    found = _timed(model, wider, runs, fixed)
    if found is None or found.early_s < max(LEAST_S, SURE * found.error_s):
        return None
    return Early(_what(found.early_s, found.error_s, stacks), found.error)


@dataclass(frozen=True, eq=False, slots=True)
class Hold:
    """How long a loop that nobody told of held commands, as runs showed."""

    what: CommandsThinned
    """Taken as held from sample to sample."""
    loop_s: float
    near: Model
    """That showed it, of the runs taken nearly so or otherwise: a fit begins there."""


def found_hold(
    model: Model, runs: Dataset, fixed: Mapping[str, float] | None, fitted: Callable[[Dataset, Model], Model]
) -> Hold | None:
    """The hold of a log that does not tell its loop and thinned its commands, by a model that was fitted to it and is
    fitted again (`fitted`); None where the log did not, or where nothing can be told.

    A little is enough here: what a loop may have done speaks for no effect.
    """
    thinned = _thinned(model, runs, fixed)
    if thinned is None:
        return None
    what, sample_s = thinned
    loop_s = _loop_s(sample_s, sample_s, what.early_s)
    try:
        near = fitted(runs.held(loop_s), model)
    except FitError:  # what the runs determine by a whole sample alone stays so
        return None
    second = _by(near, runs.held(loop_s), fixed)
    return Hold(what, loop_s if second is None else _loop_s(sample_s, loop_s, second.early_s), near)


def untold_sample_s(runs: Dataset) -> float | None:
    """The sample, s, of a log that does not tell its loop and may have thinned its commands; None of others."""
    if any(one.loop_known or one.maneuver == RESPONSE for one in runs.records):
        return None
    sample_s = max(piece.dt for piece in runs.pieces)
    return sample_s if sample_s - SHORTEST_S > 2 * LITTLE_S else None


def hold_beside(model: Model, runs: Dataset, fixed: Mapping[str, float] | None) -> Hold | None:
    """The hold that a model shows, fitted to runs that are held otherwise; None where it shows none, or the same."""
    sample_s = untold_sample_s(runs)
    found = None if sample_s is None else _by(model, runs, fixed)
    if sample_s is None or found is None or abs(found.early_s) < max(LITTLE_S, LIKELY * found.error_s):
        return None
    held_s = runs.found_loop_s or sample_s
    loop_s = _loop_s(sample_s, held_s, found.early_s)
    if same_hold(loop_s, held_s):
        return None
    return Hold(CommandsThinned(0.5 * (sample_s - loop_s), found.error_s, sample_s), loop_s, model)


def same_hold(one_s: float | None, other_s: float | None) -> bool:
    """Whether two holds, s, None of a whole sample, move commands alike as far as logs tell."""
    if one_s is None or other_s is None:
        return one_s is other_s
    return abs(one_s - other_s) < 2 * LITTLE_S


def shared_error(model: Model, runs: Dataset, fixed: Mapping[str, float] | None = None) -> FloatArray | None:
    """(p, p): what the error of a hold that the runs showed adds to the covariance of a model's parameters, fitted to
    runs that are held so; None where none showed, or where they do not tell any more."""
    found = None if runs.found_loop_s is None else _by(model, runs, fixed)
    return None if found is None else found.shared


def _thinned(model: Model, runs: Dataset, fixed: Mapping[str, float] | None) -> tuple[CommandsThinned, float] | None:
    """How early commands act, and the log's sample, s."""
    wider, records = _with_command_time(model), runs.records
    if wider is None or any(one.loop_dt_s is not None or one.maneuver == RESPONSE for one in records):
        return None
    stacks = runs.viewed(model.structure.inputs, model.structure.outputs).stacks
    if _first_look(model, wider, stacks) > -LITTLE_S:
        return None
    found, sample_s = _timed(model, wider, runs, fixed), max(group.dt for group in stacks)
    if found is None or found.early_s < max(LITTLE_S, LIKELY * found.error_s):
        return None
    what = _what(found.early_s, found.error_s, stacks)
    return (what, sample_s) if isinstance(what, CommandsThinned) else None


def _by(model: Model, runs: Dataset, fixed: Mapping[str, float] | None) -> _Timed | None:
    wider = _with_command_time(model)
    return None if wider is None else _timed(model, wider, runs, fixed)


def _loop_s(sample_s: float, held_s: float, early_s: float) -> float:
    return min(max(held_s - 2 * early_s, SHORTEST_S), sample_s)


@dataclass(frozen=True, slots=True)
class _Timed:
    early_s: float
    error_s: float
    """Standard error."""
    error: OutputError
    shared: FloatArray
    """(p, p): what that adds to the covariance of the model's own parameters."""


def _with_command_time(model: Model) -> Structure | None:
    structure = model.structure
    late = any(effect.response is not None for effect in structure.composed)
    if late or not model.stable or not linear_dynamics(structure) or divided(structure)[0]:
        return None
    return replace(structure, composed=(COMMAND_TIME, *structure.composed))


def _timed(model: Model, wider: Structure, runs: Dataset, fixed: Mapping[str, float] | None) -> _Timed | None:
    """How early commands act, beside the model's parameters."""
    try:
        found = estimate(wider, runs.viewed(model.structure.inputs, model.structure.outputs), model, fixed)
    except (FitError, np.linalg.LinAlgError):
        return None
    place = wider.names.index("command_time")
    variance = found.covariance[place, place]
    if "command_time" in found.at_bound or variance <= 0:
        return None
    own = [wider.names.index(name) for name in model.structure.names]
    with_time = found.covariance[own, place]
    shared = np.asarray(np.outer(with_time, with_time) / variance)
    return _Timed(-float(found.model.values[place]), float(np.sqrt(variance)), found.error, shared)


def thinned_commands(
    model: Model, runs: Dataset, fixed: Mapping[str, float] | None = None
) -> CommandsLate | CommandsThinned | None:
    """`early_commands` of a slow log that does not tell the loop's rate: what else may look so is more seldom there."""
    slow = any(piece.dt >= SLOW_S and not piece.record.loop_known for piece in runs.pieces)
    early = early_commands(model, runs, fixed) if slow else None
    return None if early is None else early.what


def _first_look(model: Model, wider: Structure, stacks: tuple[Stack, ...]) -> float:
    """How late the commands act, s, as one step of all parameters from the model has it; in the spectrum of what is
    left, for gusts that are strong where the vehicle answers most turn the sign."""
    values = wider.vector({**model.by_name, "command_time": 0.0})
    weights = spectral_weights(output_error(model, stacks), stacks, None)
    here = normal_equations(wider, values, stacks, weights, True)
    return float(gauss_newton_step(here, np.ones(values.size, dtype=bool))[wider.names.index("command_time")])


def _what(early_s: float, error_s: float, stacks: tuple[Stack, ...]) -> CommandsLate | CommandsThinned:
    """Thinned where no run tells its loop, and a faster one would explain it."""
    samples = [group.dt for group in stacks]
    told = any(one.segment.record.loop_dt_s is not None for group in stacks for one in group.spectra)
    if told or early_s > THINNED * 0.5 * max(samples) + 2 * error_s:
        return CommandsLate(early_s, error_s)
    return CommandsThinned(early_s, error_s, max(samples))
