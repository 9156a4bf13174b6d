"""What the runs say for each effect that a structure may lack: a quick score, a refit, and two refits compared.

The score asks how much of the residual an effect could explain, without refitting: its sensitivities at the parent's
values, less what the parent's own parameters would do as well, against the noise's spectrum (a Lagrange multiplier, or
Rao, test). Parameters that mean nothing at the null (a frequency, a time constant, a limit) go through their grids, and
terms that are not linear through their sizes.

Gusts reach the commands through the feedback, and with them every residual. So sensitivities and predictions that a
residual is asked with are those to the commands as the logged excitation alone moved them (instruments); the residual
itself is that of the commands as flown.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.data.instrument import FOLLOWING, Causes, caused_by, causes
from sysid.data.preprocess import ComplexArray, Spectrum, spectra
from sysid.data.record import COMMANDS, Record
from sysid.data.stacks import Stack, stack
from sysid.errors import FitError
from sysid.fit.estimate import Estimate, estimate
from sysid.fit.identifiable import structural
from sysid.fit.identify import means
from sysid.fit.noise import Division, divide
from sysid.fit.output_error import OutputError
from sysid.fit.rows import orthonormal, rows
from sysid.model.acting import jumping
from sysid.model.bases import compose
from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model, Structure

CYCLIC = ("delta_x", "delta_y")
CHANNELS_READ = ("omega", "airspeed", "alpha", "beta", "r", "phi", "theta")
"""Beside commands, what effects of the catalogue read."""
LEAST_MOTION = {"omega": 0.002, "airspeed": 0.01}
"""Relative spread from which on a flight condition can show anything."""
LEAST_COMMAND = 1e-3
STILL = 1e-12
SMALL_STEP = 0.1
"""Of the way from null to typical: where a linear effect's sensitivities are taken."""
WORST_SETTLING = 1.01
INDEPENDENT = 1e-7
"""Share of a sensitivity that the base's own must leave of it."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Runs as every candidate sees them: their bins with every input that any may read."""

    spectra: tuple[Spectrum, ...]
    stacks: tuple[Stack, ...]
    imposed: tuple[Stack, ...]
    """The same with commands, and channels that follow the motion, only as far as the excitation caused them."""
    causes: Causes
    available: frozenset[str]
    """Channels that all runs have and that move."""
    still: frozenset[str]
    """Channels that all runs have and that do not move."""
    constants: Mapping[str, float]
    """Omega_0, V_0: means over the fitted runs."""

    def viewed(self, structure: Structure) -> list[Spectrum]:
        """The bins with this structure's own inputs, as a fit wants them."""
        return [viewed(one, structure.inputs) for one in self.spectra]

    @property
    def samples(self) -> int:
        return sum(group.samples for group in self.stacks)


def viewed(one: Spectrum, inputs: tuple[str, ...]) -> Spectrum:
    """Bins with these inputs only."""
    if one.inputs == inputs:
        return one
    return replace(one, U=one.U[[one.inputs.index(name) for name in inputs]], inputs=inputs)


def ground(
    records: Sequence[Record],
    band_hz: tuple[float, float],
    like: Ground | None = None,
) -> Ground:
    """Prepare runs; `like` gives validation runs the channels of the fitted ones. Raises FitError without any data."""
    common = set.intersection(*(set(record.channels) for record in records))
    if like is None:
        moving = {name for name in (*COMMANDS, *CHANNELS_READ) if name in common and _moves(name, records)}
        still = {name for name in (*COMMANDS, *CHANNELS_READ) if name in common} - moving
    else:
        moving, still = set(like.available), set(like.still)
    always = ("delta_x", "delta_y", "t")  # time is what a drift is written in
    inputs = [name for name in (*COMMANDS, *CHANNELS_READ, "t") if name in moving or name in always]
    found, _ = spectra(records, inputs, ("p", "q"), band_hz)
    if not found:
        raise FitError("no run has 2 s of gap-free samples")
    stacks = stack(found)
    by = causes(stacks, [name for name in inputs if name in CYCLIC or f"excitation_{name[-1]}" in common])
    return Ground(
        tuple(found),
        tuple(stacks),
        tuple(_imposed(stacks, by)),
        by,
        frozenset({*moving, *(common & {"t", "p", "q"})}),
        frozenset(still),
        means(records) if like is None else like.constants,
    )


def _moves(name: str, records: Sequence[Record]) -> bool:
    whole = np.concatenate([record.channels[name] for record in records])
    spread, mean = float(np.std(whole)), abs(float(np.mean(whole)))
    if name in COMMANDS:
        return any(float(np.std(record.channels[name])) > LEAST_COMMAND for record in records)
    return spread > max(LEAST_MOTION.get(name, 0.0) * mean, STILL)


def _imposed(stacks: Sequence[Stack], by: Causes) -> list[Stack]:
    """Stacks whose commands are what the excitation caused, in frequency and in time."""
    made = []
    for group, caused in zip(stacks, by.caused, strict=True):
        U = group.U.copy()
        at = [group.inputs.index(name) for name in by.commands]
        U[at] = caused
        following = [i for i, name in enumerate(group.inputs) if name in FOLLOWING]
        if following:
            U[following] = caused_by(group.U[following], caused, group.scale, group.frequency_hz)
        changed = sorted({*at, *following})
        spectra = []
        for one, part in zip(group.spectra, group.slices, strict=True):
            channels = dict(one.segment.channels)
            for row, moving in zip(changed, one.in_time(U[changed, part]), strict=True):
                channels[group.inputs[row]] = np.mean(channels[group.inputs[row]]) + moving
            spectra.append(replace(one, segment=replace(one.segment, channels=channels), U=U[:, part]))
        made.append(replace(group, spectra=tuple(spectra), U=U))
    return made


# ------------------------------------------------------------------------------------------------ whitened rows


@dataclass(frozen=True, eq=False)
class Metric:
    """Turns outputs on the bins into rows whose noise is white, of unit variance, end states projected out."""

    stacks: tuple[Stack, ...]
    whitener: list[ComplexArray]
    """For every stack (bins, k, k)."""
    ends: list[list[FloatArray]]
    """For every stack and segment an orthonormal basis (r, 2 k bins) of whitened end states."""

    def __call__(self, outputs: Sequence[ComplexArray]) -> FloatArray:
        """For every stack (columns, k, bins), unscaled -> (columns, N)."""
        parts = []
        for group, whitener, bases, Y in zip(self.stacks, self.whitener, self.ends, outputs, strict=True):
            white = np.einsum("fij,cjf->cif", whitener, group.scale * Y)
            for part, basis in zip(group.slices, bases, strict=True):
                some = rows(white[..., part])
                parts.append(some - (some @ basis.T) @ basis)
        return np.concatenate(parts, axis=1)


def metric(model: Model, stacks: Sequence[Stack], division: Division) -> Metric:
    """By the noise's spectrum and the model's end states."""
    whitener: list[ComplexArray] = []
    ends = []
    for group in stacks:
        white = np.asarray(math.sqrt(2) * np.linalg.inv(np.linalg.cholesky(division.at(group.frequency_hz))))
        E = np.concatenate([respond(model.structure, model.values, group, False).E, _jumps(group)])
        E = np.einsum("fij,cjf->cif", white, group.scale * E)
        whitener.append(white)
        ends.append([orthonormal(rows(E[..., part])) for part in group.slices])
    return Metric(tuple(stacks), whitener, ends)


def _jumps(group: Stack) -> ComplexArray:
    """A jump and a bend of each output alone at a segment's ends, which gusts leave there, (2 k, k, bins)."""
    k = group.Y.shape[0]
    step = 1 / (group.z - 1)
    return np.concatenate([column * np.eye(k)[:, :, None] for column in (step, group.z * step**2)])


# ------------------------------------------------------------------------------------------------ the parent


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fit on the ground's runs, linearised: the parent, or what it becomes with effects added."""

    estimate: Estimate
    added: tuple[str, ...]
    """Effects beyond the parent's."""
    held: tuple[str, ...]
    free: tuple[str, ...]
    """Parameters that have a slope to follow: neither held, nor at a bound, nor a jump. The rows of J are theirs."""
    ground: Ground
    Y: list[ComplexArray]
    """Predicted from the commands as flown, for every stack (k, bins)."""
    Y_imposed: list[ComplexArray]
    """Predicted from the imposed commands."""
    J: list[ComplexArray]
    """Sensitivities of Y to the free parameters, for every stack (free, k, bins)."""
    J_imposed: list[ComplexArray]

    @property
    def model(self) -> Model:
        return self.estimate.model

    @cached_property
    def division(self) -> Division:
        """What it leaves, divided into what the commands explain and noise."""
        return divide(self.estimate.error, self.ground.stacks, self.ground.causes)

    @property
    def error_share(self) -> float:
        """Residual over measured power, summed over the outputs."""
        return error_share(self.estimate.error)

    @property
    def nrmse_percent(self) -> dict[str, float]:
        outputs = self.model.structure.outputs
        return dict(zip(outputs, map(float, self.estimate.error.nrmse_percent), strict=True))


def error_share(error: OutputError) -> float:
    """Residual over measured power, summed over the outputs."""
    return float(np.sum(error.residual_power / error.measured_power))


def candidate(found: Estimate, held: Collection[str], on: Ground, added: Sequence[str] = ()) -> Candidate:
    """Linearise a fit on its runs."""
    structure, values = found.model.structure, found.model.values
    fixed = {*held, *found.at_bound, *jumping(structure, values, on.stacks[0])}  # a jump has no slope to follow
    loose = [i for i, name in enumerate(structure.names) if name not in fixed]
    flown = [respond(structure, values, group, True) for group in on.stacks]
    J = [one.slopes for one in flown]
    Y_imposed, J_imposed = _imposed_answers(structure, values, on, [one.Y for one in flown], J)
    return Candidate(
        found,
        tuple(added),
        tuple(held),
        tuple(structure.names[i] for i in loose),
        on,
        [one.Y for one in flown],
        Y_imposed,
        [one[loose] for one in J],
        [one[loose] for one in J_imposed],
    )


def _imposed_answers(
    structure: Structure,
    values: FloatArray,
    on: Ground,
    Y: Sequence[ComplexArray],
    J: Sequence[ComplexArray] | None = None,
) -> tuple[list[ComplexArray], list[ComplexArray]]:
    """Answers to the imposed commands, from those to the commands as flown; and their sensitivities where J is given.

    Play, limits and dead bands do to small commands what the large ones that go with them decide. So there it is the
    answer to the commands as flown, less the linear answer to what the gusts caused of them.
    """
    if all(effect.samples is None for effect in structure.composed):
        found = [respond(structure, values, group, J is not None) for group in on.imposed]
        return [one.Y for one in found], [] if J is None else [one.slopes for one in found]
    steady = [one for one in structure.composed if one.linear and one.samples is None]
    smooth = compose(structure.base, steady, on.available, dict(structure.constants))
    inner = np.array([values[structure.names.index(name)] for name in smooth.names])
    rows = [structure.names.index(name) for name in smooth.names]
    Ys, Js = [], []
    for number, (group, imposed) in enumerate(zip(on.stacks, on.imposed, strict=True)):
        gusts = respond(smooth, inner, replace(group, U=group.U - imposed.U), J is not None)
        Ys.append(Y[number] - gusts.Y)
        if J is not None:
            changed = J[number].copy()
            changed[rows] -= gusts.slopes
            Js.append(changed)
    return Ys, Js


def refit(composed: Structure, parent: Candidate, added: Sequence[str]) -> Candidate:
    """Fit a composition that grows from the parent. Raises FitError where the runs do not determine it."""
    fixed = {name: parent.model[name] for name in parent.held}
    open_to_all = structural(composed, fixed)
    if open_to_all is not None:
        raise FitError(open_to_all)
    begin = parent.model if composed.base == parent.model.structure.base else None
    found = estimate(composed, parent.ground.viewed(composed), begin, fixed)
    return candidate(found, parent.held, parent.ground, added)


@dataclass(frozen=True, eq=False)
class Settled:
    """A candidate in a metric, its free parameters moved to where the imposed commands leave no residual to them.

    Fits weigh each output as a whole; here the noise's spectrum weighs, and candidates are compared at their best.
    """

    residual: FloatArray
    """(N,)"""
    imposed: FloatArray
    """(N,), predicted from the imposed commands."""
    moved: FloatArray
    """(b, N), sensitivities by the commands as flown."""
    asked: FloatArray
    """(b, N), by the imposed commands."""


def settle(one: Candidate, by: Metric) -> Settled:
    stacks = one.ground.stacks
    moved, asked = by(one.J), by(one.J_imposed)
    e = by([(group.Y - Y)[None] for group, Y in zip(stacks, one.Y, strict=True)])[0]
    imposed = by([Y[None] for Y in one.Y_imposed])[0]
    if len(moved):
        move = np.linalg.lstsq(asked @ moved.T, asked @ e, rcond=1e-10)[0]
        if np.sum((e - move @ moved) ** 2) < WORST_SETTLING * (e @ e):  # a jump has no slope to follow
            e, imposed = e - move @ moved, imposed + move @ asked
    return Settled(e, imposed, moved, asked)


def gain(better: Settled, worse: Settled) -> tuple[float, float]:
    """How much more likely one makes the data than the other, in chi squared, and their distance in the same measure.

    |e_2|^2 - |e_1|^2 is the product of what the models differ by and the sum of their residuals; the difference is
    taken from the imposed commands, so that gusts in the commands as flown favour neither.
    """
    apart = better.imposed - worse.imposed
    return float(apart @ (better.residual + worse.residual)), float(apart @ apart)


# ------------------------------------------------------------------------------------------------ the score


@dataclass(frozen=True)
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

    @property
    def log_p(self) -> float:
        """Logarithm of the chance that noise alone shows as much, the number of points counted in."""
        return min(0.0, log_chance(self.chi_squared, self.degrees) + math.log(self.tried))


def log_chance(chi_squared: float, degrees: int) -> float:
    """Logarithm of the chance that chi squared is larger, however small that is."""
    from scipy.stats import chi2

    found = float(chi2.logsf(chi_squared, degrees))
    if math.isfinite(found):
        return found
    half = 0.5 * degrees
    return -0.5 * chi_squared + (half - 1) * math.log(0.5 * chi_squared) - math.lgamma(half)


def score(effect: Effect, composed: Structure, of: Candidate, settled: Settled, by: Metric) -> Score | None:
    """None where the effect does nothing on these runs that the parent's own parameters would not do as well."""
    best: Score | None = None
    points = _points(composed, of)
    for nuisance, steps in points:
        found = _ask(effect, composed, of, settled, by, nuisance, steps, len(points))
        if found is not None and (best is None or found.log_p < best.log_p or _more(found, best)):
            best = found
    return best


def _more(one: Score, other: Score) -> bool:
    return one.log_p == other.log_p and one.chi_squared > other.chi_squared


Steps = Sequence[tuple[str, float]]


def _points(composed: Structure, of: Candidate) -> list[tuple[dict[str, float], Steps]]:
    """Values of all new parameters, and which of them step by how much from there; none where the point itself does."""
    known = set(of.model.structure.names)
    new = [one for one in composed.parameters if one.name not in known]
    linear = composed.linear
    begin: dict[str, float] = {}
    for effect in composed.composed:
        if effect.start is not None and any(one.name not in known for one in effect.parameters):
            named = dict(zip(of.model.structure.names, map(float, of.model.values), strict=True))
            begin.update({k: v for k, v in effect.start(named, dict(composed.constants)).items() if k not in known})

    def begins_at_null(one: Parameter) -> bool:
        return one.null is not None and math.isfinite(one.null) and (linear or not one.grid)

    sizes = [one for one in new if begins_at_null(one)]
    others = [one for one in new if not begins_at_null(one)]
    first = {one.name: begin.get(one.name, one.typical) for one in others}
    grids = [first]
    for one in others:
        if one.name not in begin:
            grids += [{**first, one.name: value} for value in one.grid if value != first[one.name]]
    steps = [(one.name, SMALL_STEP * (one.typical - float(one.null or 0.0))) for one in sizes]
    nulls = {one.name: float(one.null or 0.0) for one in sizes}
    # what is large may look otherwise than what is small: whole steps too, where the entry has a grid for them
    wide = {one.name: one.grid for one in sizes if one.grid}
    whole = [
        [
            (name, wide[name][min(i, len(wide[name]) - 1)] - nulls[name] if name in wide else step)
            for name, step in steps
        ]
        for i in range(max((len(grid) for grid in wide.values()), default=0))
    ]
    return [({**nulls, **point}, some) for point in grids for some in (steps, *whole)]


def _ask(
    effect: Effect,
    composed: Structure,
    of: Candidate,
    settled: Settled,
    by: Metric,
    point: Mapping[str, float],
    steps: Steps,
    tried: int,
) -> Score | None:
    known = dict(zip(of.model.structure.names, map(float, of.model.values), strict=True))
    named = {**{name: known[name] for name in composed.names if name in known}, **point}
    places: list[dict[str, float]] = []
    for name, step in steps:
        places.append({**named, name: named[name] + step})
    alone = not steps or effect.acts_at_null
    if alone:
        places.insert(0, dict(named))
    try:
        with np.errstate(all="ignore"):
            flown = [_predicted(composed, values, of.ground) for values in places]
            imposed = [
                _imposed_answers(composed, composed.vector(values), of.ground, Y)[0]
                for values, Y in zip(places, flown, strict=True)
            ]
    except (RelaxationError, np.linalg.LinAlgError):
        return None
    base, base_imposed = of.Y, of.Y_imposed
    D = by([np.stack([one[g] - base[g] for one in flown]) for g in range(len(base))])
    Z = by([np.stack([one[g] - base_imposed[g] for one in imposed]) for g in range(len(base))])
    if not (np.all(np.isfinite(D)) and np.all(np.isfinite(Z))):
        return None
    # less what the parent's own parameters would do: on the side that asks, and on the side that answers
    own = settled.asked @ settled.moved.T
    Z1 = Z - np.linalg.lstsq(own.T, settled.moved @ Z.T, rcond=1e-12)[0].T @ settled.asked
    size = np.einsum("ij,ij->i", Z, Z)
    keep = np.einsum("ij,ij->i", Z1, Z1) > INDEPENDENT * np.maximum(size, 1e-300)
    if not np.any(keep):
        return None
    Z1, D = Z1[keep], D[keep]
    gram = Z1 @ Z1.T
    scale = np.sqrt(np.diag(gram))
    inner, axes = np.linalg.eigh(gram / np.outer(scale, scale))
    rank = inner > 1e-9 * inner[-1]
    asked = (Z1 @ settled.residual) / scale
    along = axes[:, rank].T @ asked
    chi_squared = float(np.sum(along**2 / inner[rank]))
    names = [
        name
        for place, name in zip(keep, [*([""] if alone else []), *(name for name, _ in steps)], strict=True)
        if place
    ]
    answer = Z1 @ D.T
    at = dict(point)
    errors: dict[str, float] = {}
    try:
        inverse = np.linalg.inv(answer)
        move = inverse @ (Z1 @ settled.residual)
        spread = np.sqrt(np.maximum(np.diag(inverse @ gram @ inverse.T), 0))
        width = dict(steps)
        for name, times, error in zip(names, move, spread, strict=True):
            if name:
                at[name] = point[name] + float(times) * width[name]
                errors[name] = float(error) * abs(width[name])
    except np.linalg.LinAlgError:
        pass
    return Score(effect.path or effect.id, chi_squared, int(np.sum(rank)), tried, at, errors)


def _predicted(composed: Structure, named: Mapping[str, float], on: Ground) -> list[ComplexArray]:
    values = composed.vector(named)
    return [respond(composed, values, group, False).Y for group in on.stacks]
