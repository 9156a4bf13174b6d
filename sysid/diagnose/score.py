"""How much of a residual an effect could explain, without refitting: the quick question asked of every entry.

The sensitivities at the parent's values, less what the parent's own parameters would do as well, are held against the
residual under the noise's spectrum (a Lagrange multiplier, or Rao, test). Parameters that mean nothing at the null (a
frequency, a time constant, a limit) go through their grids, and terms that are not linear through their sizes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import ComplexArray
from sysid.diagnose.evidence import Candidate, Stepped, imposed_answers
from sysid.diagnose.steep import Steep, steep
from sysid.diagnose.thinned import rows_that_tell_commands, rows_that_tell_sizes
from sysid.fit.bursts import Envelope
from sysid.fit.innovations import Innovations
from sysid.fit.whitening import Whitening
from sysid.model.acting import linear_dynamics
from sysid.model.compose import compose
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Structure

SMALL_STEP = 0.1
"""Of the way from null to typical: where a linear effect's sensitivities are taken."""
INDEPENDENT = 1e-7
"""Share of a sensitivity that the base's own must leave of it."""
WORTH_A_LOOK = math.log(0.01)
"""Chance, from which on it is asked what bursts of the noise, or a thinned log, would make of it."""
BEYOND_BURSTS = math.log(1e-9)
"""Chance, by the noise's power over time, below which no burst explains it: what a model fails at is loud there, too.
One clean flight with a burst of 15 times the power had 1e-5."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """How much of the residual an effect would explain, by one step from the parent."""

    effect: str
    chi_squared: float
    """Of `degrees` where nothing is missing, at the best of `tried` points."""
    degrees: int
    tried: int
    at: Mapping[str, float]
    """The point of the grids, and the one-step estimates of parameters that begin at their null."""
    errors: Mapping[str, float]
    """Standard errors of those estimates."""
    times: float = 1.0
    """How often the residual shows what the effect does at that point, where the point itself acts: below zero it shows
    the opposite."""
    at_least: float = math.inf
    """Chi squared by the noise's power when the effect acts, where noise comes in bursts; of what acts on the commands'
    samples that of the frequencies at which a thinned log tells these; where that is less."""
    surely: float = math.inf
    """The same where a loud burst counts as one draw of noise: what is there shows in the calm, too."""

    @property
    def log_p(self) -> float:
        """Logarithm of the chance that noise alone shows as much, the number of points counted in."""
        return min(0.0, self.log_p_there + math.log(self.tried))

    @property
    def log_p_there(self) -> float:
        """The same at its best point, had no other been asked."""
        return log_chance(min(self.chi_squared, self.at_least), self.degrees)

    @property
    def log_p_surely(self) -> float:
        """`log_p` with no more than what is sure in bursts, where these may make as much."""
        if self.log_p < BEYOND_BURSTS:
            return self.log_p
        there = log_chance(min(self.chi_squared, self.at_least, self.surely), self.degrees)
        return min(0.0, there + math.log(self.tried))


def log_chance(chi_squared: float, degrees: int) -> float:
    """Logarithm of the chance that chi squared is larger, however small that is."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.special import chdtrc

    found = float(chdtrc(degrees, chi_squared))
    if found > 0:
        return math.log(found)
    half = 0.5 * degrees
    return -0.5 * chi_squared + (half - 1) * math.log(0.5 * chi_squared) - math.lgamma(half)


Steps = Sequence[tuple[str, float]]
"""Parameters that step, and by how much."""


def score(effect: Effect, composed: Structure, of: Candidate, stepped: Stepped, whitening: Whitening) -> Score | None:
    """None where the effect does nothing on these runs that the parent's own parameters would not do as well."""
    question = _Question.asked(effect, composed, of, stepped, whitening)
    first, lines, ways = _points(composed, of)
    tried = math.prod(1 + len(line) for line in lines) * len(ways)
    if tried == 1:
        return question.at(first, ways[0], tried)
    # what an effect does to the commands as flown tells only how large it is: it is worked out where it explains most
    best: tuple[Score, dict[str, float], Steps] | None = None
    here = first
    unchanged: list[dict[str, float]] = [{}]
    for line in (unchanged, *lines):  # each from the best of the ones before: a mode in pitch beside the one in roll
        for change in line:
            for steps in ways:
                point = {**here, **change}
                found = question.at(point, steps, tried, sized=False)
                if found is not None and (best is None or _shows_more(found, best[0])):
                    best = found, point, steps
        here = here if best is None else best[1]
    return None if best is None else question.at(*best[1:], tried) or best[0]


def _shows_more(one: Score, other: Score) -> bool:
    """By chance; by what it explains, where no burst makes either: what fails most is loud, and likest to a burst."""
    if one.log_p == other.log_p or max(one.log_p, other.log_p) < BEYOND_BURSTS:
        return one.chi_squared > other.chi_squared
    return one.log_p < other.log_p


def _points(composed: Structure, of: Candidate) -> tuple[dict[str, float], list[list[dict[str, float]]], list[Steps]]:
    """Values of all new parameters to begin with; the lines along which each is changed, one after the other; and the
    ways in which some step from each point by how much, none where the point itself does."""
    known = set(of.model.structure.names)
    new = [one for one in composed.parameters if one.name not in known]
    sizes = [one for one in new if _begins_at_null(one, composed.linear)]
    begin = _begun_from(composed, of)
    held = [one for one in new if one not in sizes]
    first = {one.name: begin.get(one.name, one.typical) for one in held}
    lines = [
        [{one.name: value} for value in one.grid if value != first[one.name]] for one in held if one.name not in begin
    ]
    steps = [(one.name, SMALL_STEP * (one.typical - float(one.null or 0.0))) for one in sizes]
    nulls = {one.name: float(one.null or 0.0) for one in sizes}
    return {**nulls, **first}, [line for line in lines if line], [steps, *_whole_steps(sizes, steps)]


def _begins_at_null(one: Parameter, linear: bool) -> bool:
    return one.sizes and math.isfinite(one.null or 0.0) and (linear or not one.grid)


def _begun_from(composed: Structure, of: Candidate) -> dict[str, float]:
    """What new effects make of the parent's values for a beginning."""
    named = of.model.by_name
    begin: dict[str, float] = {}
    for effect in composed.composed:
        if effect.start is not None and any(one.name not in named for one in effect.parameters):
            started = effect.start(named, dict(composed.constants))
            begin.update({name: value for name, value in started.items() if name not in named})
    return begin


def _whole_steps(sizes: Sequence[Parameter], steps: Steps) -> list[Steps]:
    """What is large may look otherwise than what is small: whole steps too, where the entry has a grid for them."""
    wide = {one.name: [value - float(one.null or 0.0) for value in one.grid] for one in sizes if one.grid}
    return [
        [(name, wide[name][min(i, len(wide[name]) - 1)] if name in wide else step) for name, step in steps]
        for i in range(max((len(grid) for grid in wide.values()), default=0))
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Question:
    """One effect, asked of one candidate."""

    effect: Effect
    composed: Structure
    of: Candidate
    stepped: Stepped
    whitening: Whitening
    Y: Sequence[ComplexArray]
    """What the candidate predicts, for every stack (k, bins);"""
    Y_imposed: Sequence[ComplexArray]
    """and from the imposed commands."""
    _imposed: dict[tuple[float, ...], list[ComplexArray]] = field(default_factory=dict)

    @classmethod
    def asked(
        cls, effect: Effect, composed: Structure, of: Candidate, stepped: Stepped, whitening: Whitening
    ) -> _Question:
        """A linear effect does to a motion that is not linear nearly what it does to its linear part, and for that no
        response has to settle."""
        structure, Y, Y_imposed = of.model.structure, of.Y, of.Y_imposed
        if effect.linear and not linear_dynamics(structure):
            composed, steady = (_steady(one, of.dataset) for one in (composed, structure))
            values = steady.vector(of.model.by_name)
            Y = _predicted(steady, of.model.by_name, of.dataset)
            Y_imposed = imposed_answers(steady, values, of.dataset, Y)[0]
        return cls(
            effect=effect,
            composed=composed,
            of=of,
            stepped=stepped,
            whitening=whitening,
            Y=Y,
            Y_imposed=Y_imposed,
        )

    def at(self, point: Mapping[str, float], steps: Steps, tried: int, sized: bool = True) -> Score | None:
        """The score at one point, these parameters stepping from there; without their sizes unless `sized`."""
        alone = not steps or self.effect.acts_at_null
        answers = self._answers(point, steps, alone, sized)
        if answers is None:
            return None
        D, Z = answers
        stepped = self.stepped
        # less what the parent's own parameters would do: on the side that asks, and on the side that answers
        Z1 = Z - (Z @ stepped.J.T) @ stepped.own @ stepped.Z
        size = np.einsum("ij,ij->i", Z, Z)
        keep = np.einsum("ij,ij->i", Z1, Z1) > INDEPENDENT * np.maximum(size, 1e-300)
        if not np.any(keep):
            return None
        Z1 = Z1[keep]
        chi_squared, degrees, at_least, surely = self._explained(Z1, sized)
        names = [name for place, name in zip(keep, [*([""] if alone else []), *dict(steps)], strict=True) if place]
        moves, errors, times = ({}, {}, 1.0) if D is None else self._moves(names, D[keep], Z1, dict(steps))
        return Score(
            effect=self.effect.path or self.effect.id,
            chi_squared=chi_squared,
            degrees=degrees,
            tried=tried,
            at={**point, **{name: point[name] + move for name, move in moves.items()}},
            errors=errors,
            times=times,
            at_least=at_least,
            surely=surely,
        )

    def _answers(
        self, point: Mapping[str, float], steps: Steps, alone: bool, sized: bool
    ) -> tuple[FloatArray | None, FloatArray] | None:
        """What each step (and the point itself, where it acts alone) adds to the prediction, by the commands as flown,
        where it is `sized`, and by the imposed ones, (steps, N); None where there is no response."""
        of, composed, whitening = self.of, self.composed, self.whitening
        known = of.model.by_name
        named = {**{name: known[name] for name in composed.names if name in known}, **point}
        places = [named] if alone else []
        places += [{**named, name: named[name] + step} for name, step in steps]
        try:
            with np.errstate(all="ignore"):
                flown = [_Flown(composed, values, of.dataset) for values in places]
                imposed = [self._imposed_at(values, Y) for values, Y in zip(places, flown, strict=True)]
                D = None
                if sized and not of.dataset.beyond:
                    D = whitening([np.stack([Y[g] - base for Y in flown]) for g, base in enumerate(self.Y)])
        except (RelaxationError, np.linalg.LinAlgError):
            return None
        Z = whitening([np.stack([Y[g] - base for Y in imposed]) for g, base in enumerate(self.Y_imposed)])
        if sized and of.dataset.beyond:  # there the imposed commands are those as flown
            D = Z
        return (D, Z) if np.all(np.isfinite(Z)) and (D is None or np.all(np.isfinite(D))) else None

    def _imposed_at(self, values: Mapping[str, float], flown: Sequence[ComplexArray]) -> list[ComplexArray]:
        """The answer to the imposed commands at these values; worked out once."""
        vector = self.composed.vector(values)
        key = tuple(vector.tolist())
        if key not in self._imposed:
            self._imposed[key] = imposed_answers(self.composed, vector, self.of.dataset, flown)[0]
        return self._imposed[key]

    def _explained(self, Z: FloatArray, sized: bool) -> tuple[float, int, float, float]:
        """Chi squared of the residual along these rows, its degrees of freedom, and what of it is sure (`at_least`, and
        `surely` where that is asked for)."""
        residual = self.stepped.residual
        chi_squared, degrees = along(Z, residual)
        if log_chance(chi_squared, degrees) > WORTH_A_LOOK:
            return chi_squared, degrees, math.inf, math.inf
        told = self._rows_that_tell()
        at_least = math.inf if told is None else along(Z * told, residual * told)[0]
        envelope = self.stepped.envelope_beside(Z, self.whitening)
        noises: list[Envelope | Steep] = [envelope] if envelope.rough else []
        if not isinstance(self.whitening, Innovations):  # of what is new in every sample noise is known well
            noises.append(steep(self.stepped, self.whitening, self.of.dataset.causes))
        for noise in noises:
            at_least = min(at_least, noise.surely(*along(Z, residual, noise.gram(Z)), Z))
        return chi_squared, degrees, at_least, in_bursts(Z, residual, envelope) if sized else math.inf

    def _rows_that_tell(self) -> FloatArray | None:
        """1 for rows (N,) at whose frequencies a log that lost commands tells what this effect makes of them, else 0;
        None where all do. What loops make by such a log where no excitation is logged is asked elsewhere."""
        if self.effect.samples is not None:
            return rows_that_tell_sizes(self.whitening)
        return None if isinstance(self.whitening, Innovations) else rows_that_tell_commands(self.whitening)

    def _moves(
        self, names: Sequence[str], D: FloatArray, Z: FloatArray, width: Mapping[str, float]
    ) -> tuple[dict[str, float], dict[str, float], float]:
        """One-step estimates of the parameters that step, less their values now, standard errors, and what there is of
        the point itself (1 where it does not act)."""
        try:
            inverse = np.linalg.inv(Z @ D.T)
        except np.linalg.LinAlgError:
            return {}, {}, 1.0
        move = inverse @ (Z @ self.stepped.residual)
        spread = np.sqrt(np.maximum(np.diag(inverse @ (Z @ Z.T) @ inverse.T), 0))
        each = [(name, float(times), float(error)) for name, times, error in zip(names, move, spread, strict=True)]
        moves = {name: times * width[name] for name, times, _ in each if name}
        here = next((times for name, times, _ in each if not name), 1.0)
        return moves, {name: error * abs(width[name]) for name, _, error in each if name}, here


def in_bursts(Z: FloatArray, residual: FloatArray, envelope: Envelope) -> float:
    """Chi squared of a residual (N,) along rows (c, N), as far as it is sure by the noise's power when they act, a loud
    burst counted as one draw; infinite where that power is the same all the time."""
    if not envelope.rough:
        return math.inf
    return envelope.surely(*along(Z, residual, envelope.covariance(Z, residual)), Z)


def along(Z: FloatArray, residual: FloatArray, covariance: FloatArray | None = None) -> tuple[float, int]:
    """Chi squared of a residual (N,) along rows (c, N), and its degrees of freedom; `covariance` (c, c) of their inner
    products with noise where that is not white."""
    gram = Z @ Z.T
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inner, axes = np.linalg.eigh(gram / np.outer(scale, scale))
    rank = inner > 1e-9 * inner[-1]
    along = axes[:, rank].T @ ((Z @ residual) / scale)
    if covariance is None:
        return float(np.sum(along**2 / inner[rank])), int(np.sum(rank))
    spread = axes[:, rank].T @ (covariance / np.outer(scale, scale)) @ axes[:, rank]
    return float(along @ np.linalg.solve(spread, along)), int(np.sum(rank))


def _steady(structure: Structure, on: Dataset) -> Structure:
    """Without what makes the response settle only in time."""
    kept = [one for one in structure.composed if one.linear or one.samples is not None]
    return compose(structure.base_, kept, on.available, dict(structure.constants), outputs=structure.outputs)


class _Flown(Sequence[ComplexArray]):
    """What a structure predicts from the commands as flown, for every stack, when it is asked."""

    def __init__(self, composed: Structure, named: Mapping[str, float], on: Dataset) -> None:
        self._composed, self._values, self._stacks = composed, composed.vector(named), on.stacks
        self._known: dict[int, ComplexArray] = {}

    def __len__(self) -> int:
        return len(self._stacks)

    @overload
    def __getitem__(self, number: int) -> ComplexArray: ...
    @overload
    def __getitem__(self, number: slice) -> list[ComplexArray]: ...
    def __getitem__(self, number: int | slice) -> ComplexArray | list[ComplexArray]:
        if isinstance(number, slice):
            return [self[place] for place in range(*number.indices(len(self)))]
        if number >= len(self):
            raise IndexError(number)
        if number not in self._known:
            self._known[number] = respond(self._composed, self._values, self._stacks[number], False).Y
        return self._known[number]


def _predicted(composed: Structure, named: Mapping[str, float], on: Dataset) -> list[ComplexArray]:
    values = composed.vector(named)
    return [respond(composed, values, group, False).Y for group in on.stacks]
