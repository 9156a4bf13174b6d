"""Whether commands act before their time stamps: a log that thins them, or clocks that differ.

A log slower than the vehicle's loop holds the last of several commands; taken as held for a whole sample it acts up to
half a sample early. What acts earlier than that was stamped late. One signed delay of all commands, estimated
beside the model's parameters, tells both; a delay that is positive is the vehicle's own affair.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.dataset import Dataset
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
from sysid.model.structure import Model, Structure

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
SLOW_S = 1 / 220
"""Samples of a log that no loop of a flying vehicle is likely to share."""
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


def thinned_loop(
    model: Model, runs: Dataset, fixed: Mapping[str, float] | None = None
) -> tuple[CommandsThinned, float] | None:
    """How early commands act and how long the loop held each, s, where a log that does not tell its loop thinned them;
    None where it did not, or where nothing can be told.

    A little is enough here: what a loop may have done speaks for no effect.
    """
    wider, records = _with_command_time(model), runs.records
    if wider is None or any(one.loop_dt_s is not None for one in records):
        return None
    stacks = runs.viewed(model.structure.inputs, model.structure.outputs).stacks
    if _first_look(model, wider, stacks) > -LITTLE_S:
        return None
    found, sample_s = _timed(model, wider, runs, fixed), max(group.dt for group in stacks)
    if found is None or found.early_s < max(LITTLE_S, LIKELY * found.error_s):
        return None
    what = _what(found.early_s, found.error_s, stacks)
    return (what, _loop_s(sample_s, sample_s, found.early_s)) if isinstance(what, CommandsThinned) else None


def loop_held_s(model: Model, runs: Dataset, fixed: Mapping[str, float] | None = None) -> float | None:
    """How long the loop held commands, s, by a model of runs that are taken so nearly; None where they do not tell."""
    wider = _with_command_time(model)
    found = None if wider is None else _timed(model, wider, runs, fixed)
    stacks = runs.viewed(model.structure.inputs, model.structure.outputs).stacks
    return None if found is None else _loop_s(max(one.dt for one in stacks), stacks[0].held_s, found.early_s)


def _loop_s(sample_s: float, held_s: float, early_s: float) -> float:
    return min(max(held_s - 2 * early_s, SHORTEST_S), sample_s)


@dataclass(frozen=True, slots=True)
class _Timed:
    early_s: float
    error_s: float
    """Standard error."""
    error: OutputError


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
    except FitError:
        return None
    place = wider.names.index("command_time")
    error_s = float(np.sqrt(found.covariance[place, place]))
    return None if found.at_bound else _Timed(-float(found.model.values[place]), error_s, found.error)


def thinned_commands(
    model: Model, runs: Dataset, fixed: Mapping[str, float] | None = None
) -> CommandsLate | CommandsThinned | None:
    """`early_commands` of a slow log that does not tell the loop's rate: what else may look so is more seldom there."""
    slow = any(piece.dt >= SLOW_S and piece.record.loop_dt_s is None for piece in runs.pieces)
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
