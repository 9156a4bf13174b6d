"""How a composition grows from its parent's fit: which valley its new effects begin in."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import FEWEST_BINS, Stack
from sysid.errors import FitError
from sysid.fit.gauss_newton import gauss_newton_step, minimise, normal_equations
from sysid.fit.output_error import axis_weights, output_error
from sysid.fit.search import Trial, search_nonsmooth
from sysid.fit.start import START_THINNING, start
from sysid.model.acting import behind, divided, jumping, linear_dynamics
from sysid.model.effect import Effect
from sysid.model.polynomial import closed_form
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import AnyArray, FloatArray, Model, Structure

TRIAL_STEPS = 3
LARGEST_SEARCH = 24
SEARCH_ROUNDS = 2
MOST_PROMISING = 2
NEAR_NULL = 0.9
LATE_S = (0.02, 0.06)
"""How late commands may act on a vehicle whose bare base comes out unstable."""
SLOW_HZ = 1.0
"""Below which a vehicle swings with its attitude and its speed;"""
ASTRAY = 2.0
"""times the power that a base fitted above leaves there, beyond which another is astray (2.1 to 6.7 where base fits had
gone for slow modes, 1.0 to 1.8 else), and sizes are looked for"""
FINER = 3.0
"""times smaller, too: from a base that is right none may be far too large."""


def grow(
    parent: Model,
    structure: Structure,
    stacks: Sequence[Stack],
    fixed: Mapping[str, float],
    spectral: Sequence[ComplexArray] | None = None,
) -> Model:
    """The best model of a composition that begins at its parent's fit; by `spectral` weights, where there are such.

    Every new effect begins at its typical size and at each point of its grids; a few steps show which valley is
    deepest, and that one is followed to the bottom. What the parent knows already is taken from it; `fixed` parameters
    stay at their values.
    """
    known = parent.by_name
    first, choices = _beginnings(structure, known)
    first |= fixed
    choices = {name: values for name, values in choices.items() if name not in fixed}
    valleys = _Valleys.of(parent, structure, stacks, fixed, spectral)
    begin = structure.vector({**known, **first})
    jumps = jumping(structure, begin, stacks[0]) if valleys.front else []
    rough = [name for name in jumps if name in choices and min(choices[name]) > 0]
    ranges = {name: (min(choices[name]), max(choices.pop(name))) for name in rough}
    bare = not parent.structure.composed
    one_beginning = bare and closed_form(parent.structure) is None
    if not choices and not rough and not one_beginning:
        return minimise(Model(structure, begin), stacks, valleys.power, tuple(fixed), spectral=spectral)[0]
    trials = [valleys.deepest(first, choices)]
    if one_beginning or (bare and not parent.stable):
        trials += [each.deepest(first, choices) for each in valleys.afresh()]
    if bare:
        trials += [each.deepest(first, _finer(choices)) for each in valleys.above_slow_modes()]
    _, found = min(trials, key=lambda trial: trial[0])
    if found is None:
        raise FitError(f"no start of {', '.join(structure.effects)} has a response that settles on these runs")
    for name in rough:
        found = search_nonsmooth(found, name, ranges[name], valleys.acted, valleys.tried, valleys.glanced)
    return minimise(found, stacks, valleys.power, [*fixed, *rough], spectral=spectral)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Valleys:
    """The cost of a composition, looked at from many beginnings."""

    structure: Structure
    stacks: Sequence[Stack]
    fixed: Mapping[str, float]
    known: Mapping[str, float]
    """The parent's values by name."""
    power: FloatArray
    """(k,), what the parent leaves: the first weights."""
    front: tuple[Effect, ...]
    """What acts on the commands' samples, simulated before anything is fitted;"""
    rest: Structure
    """and what follows it, fitted."""
    few: Sequence[Stack]
    """Bins enough for a first look: a relaxation costs the same for few as for all."""
    without: Sequence[Stack]
    """The same with the commands as they act in the parent, where anything acts on samples."""
    spectral: Sequence[ComplexArray] | None
    """Weights of those few bins, where it is not what is left of all power that counts."""

    @classmethod
    def of(
        cls,
        parent: Model,
        structure: Structure,
        stacks: Sequence[Stack],
        fixed: Mapping[str, float],
        spectral: Sequence[ComplexArray] | None,
    ) -> _Valleys:
        linear = linear_dynamics(structure)
        front, rest = divided(structure) if linear else ((), structure)
        return cls(
            structure=structure,
            stacks=stacks,
            fixed=fixed,
            known=parent.by_name,
            power=output_error(parent, stacks).residual_power,
            front=front,
            rest=rest,
            few=[group.thinned(START_THINNING) for group in stacks] if linear else stacks,
            without=[
                behind(parent.structure, parent.values, group).thinned(START_THINNING) for group in stacks if front
            ],
            spectral=None
            if spectral is None
            else [
                weight[..., np.concatenate(group.kept_of(START_THINNING))] if linear else weight
                for group, weight in zip(stacks, spectral, strict=True)
            ],
        )

    def acted(self, begin: Mapping[str, float]) -> list[Stack]:
        """The stacks with the commands as they act at this beginning."""
        values = self.structure.vector({**self.known, **begin})
        return [behind(self.structure, values, group) for group in self.stacks]

    def tried(self, begin: Mapping[str, float], groups: Sequence[Stack] | None = None) -> Trial:
        """What acts on samples stays as it begins, simulated once; the rest is fitted in a few steps."""
        values, rest, fixed, weights = {**self.known, **begin}, self.rest, tuple(self.fixed), self.spectral
        if groups is None:
            groups = [group.thinned(START_THINNING) for group in self.acted(begin)] if self.front else self.few
        try:
            # first the new parameters alone, then all: the parent's stay where they were fitted until it pays
            model, left = minimise(
                Model(rest, rest.vector(values)),
                groups,
                self.power,
                [*self.known, *fixed],
                TRIAL_STEPS,
                spectral=weights,
            )
            model, left = minimise(model, groups, left, fixed, TRIAL_STEPS, spectral=weights)
        except (RelaxationError, np.linalg.LinAlgError):
            return np.inf, None
        cost = float(np.sum(np.log(left) if weights is None else left))
        whole = Model(self.structure, self.structure.vector({**values, **rest.named(model.values)}))
        return (cost if np.isfinite(cost) and not self._idle(groups) else np.inf), whole

    def glanced(self, begin: Mapping[str, float]) -> float:
        """The cost that one step of what follows would reach, what acts on samples as it begins."""
        groups = self.acted(begin)
        return self._after_a_step(self.rest, {**self.known, **begin}, groups, axis_weights(groups, self.power))

    def _idle(self, groups: Sequence[Stack]) -> bool:
        """Whether no sample is touched: there is no derivative then either, and nothing to begin at."""
        commands = len(self.structure.base_.commands)
        return bool(self.without) and all(
            np.array_equal(here.U[:commands], before.U[:commands])
            for here, before in zip(groups, self.without, strict=True)
        )

    def afresh(self) -> list[_Valleys]:
        """The same from bare bases that were fitted to later commands.

        Without its lateness a late vehicle may come out unstable, far from any valley with it; or, where the bare base
        begins at one point and not at the data, with the opposite sign.
        """
        linear = [one for one in self.structure.composed if one.response is not None or one.per_command]
        if not linear or self.front or self.few is self.stacks:
            return []
        found = []
        for late_s in LATE_S:
            with contextlib.suppress(FitError):
                bare = start(self.structure.bare, [_later(group, late_s) for group in self.few], thorough=False)
                found.append(replace(self, known={**bare.by_name, **self.fixed}))
        return found

    def above_slow_modes(self) -> list[_Valleys]:
        """The same from a bare base that was fitted where slow modes hardly show, if the parent is astray there.

        Of these the bare base has none, and where they are loud its own parameters may have gone anywhere for them.
        """
        slow = any(effect.attitude for effect in self.structure.composed)
        if self.front or self.few is self.stacks or not slow:
            return []
        fast = [fast for group in self.few if (fast := group.above(SLOW_HZ)).frequency_hz.size >= FEWEST_BINS]
        if not fast:
            return []
        bare = self.structure.bare
        with contextlib.suppress(FitError):
            found = start(bare, fast, thorough=False)
            here, there = (
                output_error(Model(bare, bare.vector(known)), fast).residual_power
                for known in (self.known, found.by_name)
            )
            if np.mean(np.log(here / there)) > np.log(ASTRAY):
                return [replace(self, known={**found.by_name, **self.fixed})]
        return []

    def promised(self, begin: Mapping[str, float]) -> float:
        """The cost that one step from there would reach if the response were linear in the parameters."""
        weights = axis_weights(self.few, self.power) if self.spectral is None else self.spectral
        return self._after_a_step(self.structure, {**self.known, **begin}, self.few, weights)

    def _after_a_step(
        self, structure: Structure, values: Mapping[str, float], groups: Sequence[Stack], weights: Sequence[AnyArray]
    ) -> float:
        try:
            with np.errstate(all="ignore"):
                here = normal_equations(structure, structure.vector(values), groups, weights, True)
        except (RelaxationError, np.linalg.LinAlgError):
            return np.inf
        free = np.array([name not in self.fixed for name in structure.names])
        cost = float(here.cost - here.gradient @ gauss_newton_step(here, free))
        return cost if np.isfinite(cost) else np.inf

    def deepest(self, first: Mapping[str, float], choices: Mapping[str, tuple[float, ...]]) -> Trial:
        """The lowest trial of `first` and all combinations of choices, or a round of each where these are many."""
        if math.prod(len(values) for values in choices.values()) > LARGEST_SEARCH:
            return self._one_after_another(first, choices)
        begins = [
            {**first, **dict(zip(choices, values, strict=True))} for values in itertools.product(*choices.values())
        ]
        trials = [self.tried(first), *(self.tried(begin) for begin in begins if begin != first)]
        return min(trials, key=lambda trial: trial[0])

    def _one_after_another(self, first: Mapping[str, float], choices: Mapping[str, tuple[float, ...]]) -> Trial:
        """One parameter after the other, the others where they were best, and round again."""
        best = self.tried(first)
        for _ in range(SEARCH_ROUNDS):
            before = best[0]
            for name, values in choices.items():
                others = [{**first, name: value} for value in values if value != first[name]]
                for begin in others if self.front else sorted(others, key=self.promised)[:MOST_PROMISING]:
                    again = self.tried(begin)
                    if again[0] < best[0]:
                        best, first = again, begin
            if best[0] == before:
                break
        return best


def _finer(choices: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
    """Beside each choice one that is FINER times smaller."""
    return {name: (*values, *(value / FINER for value in values)) for name, values in choices.items()}


def _later(group: Stack, late_s: float) -> Stack:
    """The bins with every input so much later."""
    return replace(group, U=group.U * np.exp(-2j * np.pi * late_s * group.frequency_hz))


def looks(structure: Structure, known: Mapping[str, float]) -> int:
    """How many beginnings a composition with these parameters known is looked at from; 0 where there is only one."""
    _, choices = _beginnings(structure, known)
    if not choices:
        return 0
    every = math.prod(len(values) for values in choices.values())
    return every if every <= LARGEST_SEARCH else SEARCH_ROUNDS * MOST_PROMISING * len(choices)


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
