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
from sysid.fit.output_error import OutputError, axis_weights, output_error
from sysid.fit.start import START_THINNING
from sysid.model.acting import divided, linear_dynamics
from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter
from sysid.model.structure import Model, Structure

WORTH_A_LOOK_S = 8e-4
"""By which the commands seem to act early at a first look."""
LEAST_S = 1e-3
SURE = 5.0
"""Standard errors."""
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
    structure = model.structure
    late = any(effect.response is not None for effect in structure.composed)
    if late or not model.stable or not linear_dynamics(structure) or divided(structure)[0]:
        return None
    wider = replace(structure, composed=(COMMAND_TIME, *structure.composed))
    bins = runs.viewed(structure.inputs, structure.outputs)
    if _first_look(model, wider, bins.stacks) > -WORTH_A_LOOK_S:
        return None
    try:
        found = estimate(wider, bins, model, fixed)
    except FitError:
        return None
    place = wider.names.index("command_time")
    early_s, error_s = -float(found.model.values[place]), float(np.sqrt(found.covariance[place, place]))
    if found.at_bound or early_s < max(LEAST_S, SURE * error_s):
        return None
    return Early(_what(early_s, error_s, bins.stacks), found.error)


def thinned_commands(
    model: Model, runs: Dataset, fixed: Mapping[str, float] | None = None
) -> CommandsLate | CommandsThinned | None:
    """`early_commands` of a slow log that does not tell the loop's rate: what else may look so is more seldom there."""
    slow = any(piece.dt >= SLOW_S and piece.record.loop_dt_s is None for piece in runs.pieces)
    early = early_commands(model, runs, fixed) if slow else None
    return None if early is None else early.what


def _first_look(model: Model, wider: Structure, stacks: tuple[Stack, ...]) -> float:
    """How late the commands act, s, as one step of all parameters from the model has it."""
    few = [group.thinned(START_THINNING) for group in stacks]
    values = wider.vector({**model.by_name, "command_time": 0.0})
    here = normal_equations(wider, values, few, axis_weights(few, output_error(model, few).residual_power), True)
    return float(gauss_newton_step(here, np.ones(values.size, dtype=bool))[wider.names.index("command_time")])


def _what(early_s: float, error_s: float, stacks: tuple[Stack, ...]) -> CommandsLate | CommandsThinned:
    """Thinned where no run tells its loop, and a faster one would explain it."""
    samples = [group.dt for group in stacks]
    told = any(one.segment.record.loop_dt_s is not None for group in stacks for one in group.spectra)
    if told or early_s > THINNED * 0.5 * max(samples) + 2 * error_s:
        return CommandsLate(early_s, error_s)
    return CommandsThinned(early_s, error_s, max(samples))
