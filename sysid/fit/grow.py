"""How a composition grows from its parent's fit: which valley its new effects begin in."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.data.stacks import Stack
from sysid.errors import FitError
from sysid.fit.gauss_newton import _step, minimise, normal_equations
from sysid.fit.output_error import axis_weights, output_error
from sysid.fit.search import Trial, cleft
from sysid.fit.start import START_THINNING
from sysid.model.acting import behind, divided, jumping, linear_dynamics
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model, Structure

TRIAL_STEPS = 3
LARGEST_SEARCH = 24
SEARCH_ROUNDS = 2
MOST_PROMISING = 2
NEAR_NULL = 0.9


def grow(parent: Model, structure: Structure, stacks: Sequence[Stack], held: Mapping[str, float]) -> Model:
    """The best model of a composition that begins at its parent's fit.

    Every new effect begins at its typical size and at each point of its grids; a few steps show which valley is
    deepest, and that one is followed to the bottom. What the parent knows already is taken from it; `held` parameters
    stay at their values.
    """
    known = dict(zip(parent.structure.names, map(float, parent.values), strict=True))
    first, choices = _beginnings(structure, known)
    first |= held
    choices = {name: values for name, values in choices.items() if name not in held}
    power = output_error(parent, stacks).residual_power
    linear = linear_dynamics(structure)
    front, rest = divided(structure) if linear else ((), structure)
    # which valley is deepest shows on some of the bins; a relaxation costs the same for few as for all
    few = [group.thinned(START_THINNING) for group in stacks] if linear else stacks
    without = [behind(parent.structure, parent.values, group).thinned(START_THINNING) for group in stacks if front]

    def acted(begin: Mapping[str, float]) -> list[Stack]:
        return [behind(structure, structure.vector({**known, **begin}), group) for group in stacks]

    def tried(begin: Mapping[str, float], groups: Sequence[Stack] | None = None) -> Trial:
        """What acts on samples stays as it begins, simulated once; the rest is fitted."""
        values = {**known, **begin}
        if groups is None:
            groups = [group.thinned(START_THINNING) for group in acted(begin)] if front else few
        try:
            # first the new parameters alone, then all: the parent's stay where they were fitted until it pays
            model, left = minimise(Model(rest, rest.vector(values)), groups, power, [*known, *held], TRIAL_STEPS)
            model, left = minimise(model, groups, left, tuple(held), TRIAL_STEPS)
        except (RelaxationError, np.linalg.LinAlgError):
            return np.inf, None
        cost = float(np.sum(np.log(left)))
        # where no sample is touched there is no derivative either, and nothing to begin at
        idle = bool(without) and all(np.array_equal(a.U[:2], b.U[:2]) for a, b in zip(groups, without, strict=True))
        whole = Model(structure, structure.vector({**values, **rest.named(model.values)}))
        return (cost if np.isfinite(cost) and not idle else np.inf), whole

    def promised(begin: Mapping[str, float]) -> float:
        """The cost that one step from there would reach if the response were linear in the parameters."""
        try:
            values = structure.vector({**known, **begin})
            with np.errstate(all="ignore"):
                here = normal_equations(structure, values, few, axis_weights(few, power), True)
        except (RelaxationError, np.linalg.LinAlgError):
            return np.inf
        loose = np.array([name not in held for name in structure.names])
        cost = float(np.sum(np.log(here.power)) - here.gradient @ _step(here, loose))
        return cost if np.isfinite(cost) else np.inf

    jumps = jumping(structure, structure.vector({**known, **first}), stacks[0]) if front else []
    rough = [name for name in jumps if name in choices and min(choices[name]) > 0]
    ends = {name: (min(choices[name]), max(choices.pop(name))) for name in rough}
    if not choices and not rough:
        return minimise(Model(structure, structure.vector({**known, **first})), stacks, power, tuple(held))[0]
    best = tried(first)
    if math.prod(len(values) for values in choices.values()) <= LARGEST_SEARCH:
        for values in itertools.product(*choices.values()):
            begin = {**first, **dict(zip(choices, values, strict=True))}
            if begin != first:
                best = min(best, tried(begin), key=lambda one: one[0])
    else:  # too many together: one parameter after the other, the others where they were best, and round again
        for _ in range(SEARCH_ROUNDS):
            before = best[0]
            for name, values in choices.items():
                others = [{**first, name: value} for value in values if value != first[name]]
                for begin in others if front else sorted(others, key=promised)[:MOST_PROMISING]:
                    again = tried(begin)
                    if again[0] < best[0]:
                        best, first = again, begin
            if best[0] == before:
                break
    if best[1] is None:
        raise FitError(f"no start of {', '.join(structure.effects)} has a response that settles on these runs")
    found = best[1]
    for name in rough:
        found = cleft(found, name, ends[name], acted, tried)
    return minimise(found, stacks, power, [*held, *rough])[0]


def _beginnings(
    structure: Structure, known: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, tuple[float, ...]]]:
    """Where the new parameters begin, and what to try for each whose cost may have several valleys."""
    first: dict[str, float] = {}
    choices: dict[str, tuple[float, ...]] = {}
    for effect in structure.composed:
        new = [parameter for parameter in effect.parameters if parameter.name not in known]
        if effect.start is not None and new:
            first.update(effect.start(known, dict(structure.constants)))
        for parameter in new:
            if parameter.name in first:
                continue
            first[parameter.name] = parameter.typical
            if parameter.grid:
                choices[parameter.name] = tuple(dict.fromkeys((*parameter.grid, parameter.typical)))
            elif parameter.null is not None and np.isfinite(parameter.null):
                # one valley that reaches to the null, where the parent stands
                first[parameter.name] += NEAR_NULL * (parameter.null - parameter.typical)
    return first, choices
