"""Two rivals on an imagined run: how many standard errors it would set them further apart.

What one of them cannot imitate of the other, its parameters refitted to the flown runs and the imagined ones together,
is compared with the noise's spectrum of the flown runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import ComplexArray, spectra
from sysid.data.record import CYCLIC, RATES, Record
from sysid.data.stacks import Stack, stack
from sysid.diagnose.evidence import Candidate, imposed_answers
from sysid.diagnose.maneuver_plans import LETTERS, Flown, Plan, moved_by_hand
from sysid.fit.noise import Division
from sysid.fit.scaled import scaled_solve
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.compose import compose
from sysid.model.effect import Effect, EffectError, catalogue
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.response import transfer
from sysid.model.structure import FloatArray, Model, Structure

NEEDED = 3.0
"""Standard errors between rivals from which on they count as told apart."""
MOST_REPEATS = 4


@dataclass(frozen=True, eq=False)
class Rivals:
    """The winner, taken for the truth, and a rival that is refitted to it."""

    truth: Candidate
    rival: Candidate
    apart: FloatArray
    """(N,), predicted by the truth less by the rival on the flown runs."""
    J: FloatArray
    """(free, N), what the rival's parameters can do there."""
    _known: dict[Plan, tuple[FloatArray, FloatArray, FloatArray]] = field(default_factory=dict)

    @classmethod
    def of(cls, truth: Candidate, rival: Candidate, whitening: Whitening) -> Rivals:
        ours, theirs = (whitening([Y[None] for Y in one.Y_imposed])[0] for one in (truth, rival))
        return cls(truth, rival, ours - theirs, whitening(rival.J_imposed))

    @property
    def names(self) -> tuple[str, str]:
        return name_of(self.truth), name_of(self.rival)

    @cached_property
    def flown(self) -> float:
        """Standard errors between them on the flown runs."""
        return left_unimitated(self.apart, self.J, np.zeros(0), np.zeros((len(self.J), 0)), 0)

    def told_by(self, plan: Plan, flown: Flown, division: Division) -> tuple[float, int]:
        """Standard errors that flying the plan would add, and how often it must be flown; 0 where it cannot be."""
        try:
            with np.errstate(all="ignore"):
                apart, J, old = self._scaled(plan, flown, division)
        except (EffectError, RelaxationError, np.linalg.LinAlgError, KeyError):
            return 0.0, 1
        before = self.flown
        for repeats in range(1, MOST_REPEATS + 1):
            added = math.sqrt(max(left_unimitated(self.apart, old, apart, J, repeats) ** 2 - before**2, 0.0))
            if added >= NEEDED:
                break
        return added, repeats

    def told_by_runs(self, runs: Dataset, division: Division) -> float:
        """Standard errors that these flown runs would add, were they fitted too; 0 where that cannot be had."""
        try:
            with np.errstate(all="ignore"):
                whitening = noise_whitening(self.truth.model, runs.stacks, division)
                ours, theirs = (_answers(one, runs) for one in (self.truth, self.rival))
        except (RelaxationError, np.linalg.LinAlgError):
            return 0.0
        apart = whitening([(a - b)[None] for a, b in zip(ours[0], theirs[0], strict=True)])[0]
        together = left_unimitated(self.apart, self.J, apart, whitening(theirs[1]), 1)
        return math.sqrt(max(together**2 - self.flown**2, 0.0))

    def _scaled(self, plan: Plan, flown: Flown, division: Division) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As `_imagined`; where all that answers is linear, and moved by the plan alone, from the same at full command,
        imagined once."""
        structures = [one.model.structure for one in (self.truth, self.rival)]
        if plan.effect is not None or not all(one.linear and flown.moved.issuperset(one.inputs) for one in structures):
            return self._imagined(plan, flown, division)
        full = replace(plan, amplitude=1.0, times=1.0)
        if full not in self._known:
            self._known[full] = self._imagined(full, flown, division)
        apart, J, old = self._known[full]
        return plan.amplitude * apart, plan.amplitude * J, old

    def _imagined(self, plan: Plan, flown: Flown, division: Division) -> tuple[FloatArray, FloatArray, FloatArray]:
        """On the plan's run: truth less rival (N,), what the rival can do (free, N), and the same on the flown runs."""
        truth, rival = (_with(one.model, plan, flown.dataset) for one in (self.truth, self.rival))
        if not set(self.rival.free) <= set(rival.structure.names):
            raise EffectError("what the plan moves stands for a part of the rival")
        stacks = _synthesised(plan, flown, [truth.structure, rival.structure], truth)
        whitening = noise_whitening(truth, stacks, division)
        ours = whitening([respond(truth.structure, truth.values, group, False).Y[None] for group in stacks])[0]
        answers = [respond(rival.structure, rival.values, group, True) for group in stacks]
        theirs = whitening([one.Y[None] for one in answers])[0]
        added = [name for name in rival.structure.names if name not in self.rival.model.structure.names]
        at = [rival.structure.names.index(name) for name in (*self.rival.free, *added)]
        J = whitening([one.slopes[at] for one in answers])
        old = np.concatenate([self.J, np.zeros((len(added), self.J.shape[1]))])
        return ours - theirs, J, old


def _answers(one: Candidate, runs: Dataset) -> tuple[list[ComplexArray], list[ComplexArray]]:
    """To what was imposed on these runs: for every stack (k, bins), and its sensitivities to the free parameters."""
    structure, values = one.model.structure, one.model.values
    flown = [respond(structure, values, group, True) for group in runs.stacks]
    Y, J = imposed_answers(structure, values, runs, [each.Y for each in flown], [each.slopes for each in flown])
    rows = [structure.names.index(name) for name in one.free]
    return Y, [slopes[rows] for slopes in J]


def left_unimitated(old: FloatArray, J_old: FloatArray, new: FloatArray, J_new: FloatArray, repeats: int) -> float:
    """Length of what the rival cannot imitate, the new run flown so many times."""
    G = J_old @ J_old.T + repeats * (J_new @ J_new.T)
    b = J_old @ old + repeats * (J_new @ new)
    move = scaled_solve(G, b)
    rest = float(old @ old) + repeats * float(new @ new) - 2 * float(move @ b) + float(move @ G @ move)
    return math.sqrt(max(rest, 0.0))


def name_of(one: Candidate) -> str:
    return " + ".join(one.added)


def _with(model: Model, plan: Plan, dataset: Dataset) -> Model:
    """The model with what the plan moves besides acting at its usual size."""
    structure = model.structure
    effect: Effect | None = None if plan.effect is None else catalogue()[plan.effect]
    if effect is None or effect.id in {one.id for one in structure.composed}:
        return model
    available = {"t", *RATES, *structure.inputs, plan.channel or ""}
    constants = {"Omega_0": 172.8, **dict(dataset.constants), **dict(structure.constants)}
    composed = compose(structure.base_, [*structure.composed, effect], available, constants, outputs=structure.outputs)
    known = structure.by_name(model.values)
    return Model(composed, composed.vector({**{one.name: one.typical for one in composed.parameters}, **known}))


def _synthesised(plan: Plan, flown: Flown, structures: Sequence[Structure], truth: Model) -> list[Stack]:
    """The plan's run as the truth would answer it."""
    excitation = plan.excitation(flown.dt)
    n = excitation.shape[1]
    names = list(dict.fromkeys(name for one in structures for name in one.inputs))
    channels: dict[str, FloatArray] = {"t": np.asarray(flown.dt * np.arange(n))}
    channels |= {name: np.zeros(n) for name in (*RATES, *CYCLIC, *truth.structure.outputs)}
    for name in names:
        if name in flown.moved:
            channels[name] = excitation[list(LETTERS.values()).index(name.removeprefix("delta_"))]
        elif name == plan.channel:
            channels[name] = moved_by_hand(name, flown, n, flown.dt)
        else:
            channels[name] = flown.channel(name, n)
    top = max(float(one.frequency_hz[-1]) for one in flown.dataset.spectra)
    found, _ = spectra([Record("imagined", channels)], names, truth.structure.outputs, (0.0, top))
    # the free motion of a nonlinear answer is taken from the measured rates: they must be like the answer
    H = transfer(truth.structure, truth.values, found[0].frequency_hz)
    rows = [found[0].inputs.index(name) for name in truth.structure.inputs]
    begin = replace(found[0], Y=np.einsum("kmf,mf->kf", H, found[0].U[rows]))
    (first,) = stack([begin])
    if truth.structure.linear:
        return [first]
    return stack([replace(begin, Y=respond(truth.structure, truth.values, first, False).Y)])
