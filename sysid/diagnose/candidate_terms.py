"""Candidate terms on a parent's runs: what every one is on the bins, and how the outputs answer to it.

The answer to a term is linear, a transfer function times the term's spectrum. So nothing is simulated term by term:
signals come once on a coarse clock (they are limited to 30 Hz, and their cubes do not fold back into the band), and
all inner products of all terms and rows are a few products of matrices. The parent's end states do not count in the
simulated signals, and of a parent that is not linear itself the transfer is that of small motions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.record import COMMANDS, RATES
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.terms import CONDITIONS, CORE, CORE_OF, ROWS, STATES, Entry, Expression, entries, expressions
from sysid.fit.rows import rows
from sysid.fit.whitening import Whitening
from sysid.model.acting import divided, in_time
from sysid.model.compose import compose
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.predict import respond
from sysid.model.relaxation import bins_in_reach
from sysid.model.structure import AnyArray, FloatArray, Structure

STAGES = {
    **dict.fromkeys(("delta_x", "delta_y", "delta_r", "delta_c"), Stage.COMMAND),
    **dict.fromkeys(("p_m", "q_m"), Stage.MEASUREMENT),
}
"""Of rows that are redefined instead of added to."""
SETTLING = 20
SETTLED = 1e-4
LARGEST_BIN = 1e60
"""Of what a term may be in any bin: its square, and that by another, must stay a number."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateTerms:
    """All entries on a candidate's runs: what every expression is on the bins, and how rows answer."""

    entries: tuple[Entry, ...]
    flown: list[ComplexArray]
    """For every stack the expressions' bins (expressions, bins), by the commands as flown."""
    imposed: list[ComplexArray]
    """By the imposed commands; `flown` itself where nothing else is asked."""
    transfer: list[ComplexArray]
    """For every stack (rows, k, bins): outputs per unit of what is added to a row."""
    plain: Whitening
    """Every output by its own residual power, as a fit weighs them."""
    first: tuple[AnyArray, AnyArray]
    """(entries,) numbers of row and expression of each entry's first part."""
    second: tuple[AnyArray, AnyArray]
    """The same of the second part of pairs, which come last."""

    @property
    def single(self) -> int:
        """How many entries have one part."""
        return int(self.first[0].size - self.second[0].size)

    @property
    def first_of_pairs(self) -> tuple[AnyArray, AnyArray]:
        return self.first[0][self.single :], self.first[1][self.single :]

    @property
    def as_flown(self) -> bool:
        """Whether answers to the imposed commands are those to the commands as flown."""
        return self.imposed is self.flown

    def answers(self, number: int, imposed: bool = False) -> list[ComplexArray]:
        """An entry's sensitivities as `respond` gives them: for every stack (parts, k, bins)."""
        parts = [(self.first[0][number], self.first[1][number])]
        if number >= self.single:
            parts.append((self.second[0][number - self.single], self.second[1][number - self.single]))
        spectra = self.imposed if imposed else self.flown
        return [
            np.stack([T[row] * terms[one] for row, one in parts])
            for T, terms in zip(self.transfer, spectra, strict=True)
        ]


def candidate_terms(parent: Candidate) -> CandidateTerms:
    """Every expression in every row, on the parent's runs. Which there are depends on the channels that move there."""
    on, model = parent.dataset, parent.model
    found, flown, imposed = _spectra(parent)
    at = [f"{name}_dot" for name in _states(model.structure) if f"{name}_dot" in ROWS]
    # a measurement reaches the command of its own sample: there no past tells which was first
    at += [name for name in ROWS if name in model.structure.base_.commands]
    at += [f"{name}_m" for name in RATES if name in model.structure.states and not on.beyond]
    made = entries(found, at)
    place = {one: i for i, one in enumerate(found)}

    def numbered(parts: Sequence[tuple[str, Expression]]) -> tuple[AnyArray, AnyArray]:
        numbers = np.array([(at.index(row), place[one]) for row, one in parts], int).reshape(-1, 2)
        return numbers[:, 0], numbers[:, 1]

    return CandidateTerms(
        entries=tuple(made),
        flown=flown,
        imposed=imposed,
        transfer=transfers(parent, at),
        plain=_plain(parent),
        first=numbered([one.parts[0] for one in made]),
        second=numbered([one.parts[1] for one in made if len(one.parts) == 2]),
    )


def _spectra(parent: Candidate) -> tuple[list[Expression], list[ComplexArray], list[ComplexArray]]:
    """Expressions, and their bins for every stack (expressions, bins): by the commands as flown, and as imposed."""
    on, probe, named = parent.dataset, _listening(parent), parent.model.by_name
    constants = dict(parent.model.structure.constants)
    with np.errstate(all="ignore"):  # a parent that is not linear may run away: nothing is finite then, nor ranked
        flown = [[_signals(probe, named, one) for one in group.spectra] for group in on.stacks]
        found = _expressions_on([one for group in flown for one in group], parent.model.structure)

        def bins(signals: Sequence[Sequence[Mapping[str, FloatArray]]]) -> list[ComplexArray]:
            return [
                np.hstack([_bins(found, said, constants, one) for one, said in zip(group.spectra, parts, strict=True)])
                for group, parts in zip(on.stacks, signals, strict=True)
            ]

        spectra = bins(flown)
        if on.beyond:  # what is new knows no command
            return found, *_within_reach(spectra, spectra)
        imposed = [[_signals(probe, named, one) for one in group.spectra] for group in on.imposed]
        return found, *_within_reach(spectra, bins(imposed))


def _within_reach(
    flown: list[ComplexArray], imposed: list[ComplexArray]
) -> tuple[list[ComplexArray], list[ComplexArray]]:
    """Terms of shape (terms, bins); one that runs away, a power of a state that a model does not hold, is nothing."""
    far = ~np.all([np.abs(Z).max(axis=1, initial=0.0) < LARGEST_BIN for Z in (*flown, *imposed)], axis=0)
    if not far.any():
        return flown, imposed
    near = [np.where(far[:, None], 0.0, Z) for Z in flown]
    return near, near if imposed is flown else [np.where(far[:, None], 0.0, Z) for Z in imposed]


def _expressions_on(segments: Sequence[Mapping[str, FloatArray]], structure: Structure) -> list[Expression]:
    moving = [name for name in segments[0] if any(bool(np.ptp(one[name]) > 0) for one in segments)]
    rms = {name: max(float(np.sqrt(np.mean(one[name] ** 2))) for one in segments) for name in moving}
    t = np.concatenate([one["t"] for one in segments])
    return expressions(moving, rms, float(np.mean(t)), float(np.ptp(t)), core_of=_core(structure))


def _core(structure: Structure) -> Sequence[str]:
    return next((CORE_OF[name] for name in structure.base_.outputs if name in CORE_OF), CORE)


def _states(structure: Structure) -> list[str]:
    """Those that terms are made of."""
    return [name for name in _core(structure) if name in STATES and name in structure.states]


def _bins(
    found: Sequence[Expression], signals: Mapping[str, FloatArray], constants: Mapping[str, float], one: Spectrum
) -> ComplexArray:
    """What expressions are on a segment's bins, as the transform of all its samples would be."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.fft import rfft

    grid = next(iter(signals.values())).size
    said = Signals({**signals, **constants})
    values = {factor: factor.value(said) for factor in {f for each in found for f in each}}
    products = np.empty((len(found), grid))
    for row, expression in zip(products, found, strict=True):
        row[:] = values[expression[0]]
        for factor in expression[1:]:
            row *= values[factor]
    kept = rfft(products, axis=1)[:, one.first : one.first + one.frequency_hz.size]
    return np.asarray(kept * (one.samples / grid))


@dataclass(frozen=True, eq=False)
class _Probe:
    """The parent's structure with an effect that acts after all others on the rates and notes what it may read."""

    structure: Structure
    heard: dict[str, Any]
    """Signals by name, of the last evaluation."""


def _listening(parent: Candidate) -> _Probe:
    on, constants = parent.dataset, dict(parent.model.structure.constants)
    base = parent.model.structure.base_
    known = {*base.commands, *base.states, *COMMANDS[:2]}
    channels = [name for name in (*COMMANDS[2:], "r") if name in on.available and name not in known]
    channels += [name for name, mean in CONDITIONS.items() if name in on.available and mean in constants]
    states = _states(parent.model.structure)
    wanted = [*states, *(f"{name}_dot" for name in states), *base.commands, "theta_s", "theta_c", *channels]
    heard: dict[str, Any] = {}

    def listen(s: Signals) -> Mapping[str, Any]:
        heard.update({name: getattr(s, name) for name in wanted if s.has(name)})
        return {}

    return _Probe(_opened(parent, [_probing("listening", Stage.DYNAMICS, listen, channels)]), heard)


def transfers(parent: Candidate, at: Sequence[str]) -> list[ComplexArray]:
    """For every stack (rows, k, bins), from what is added to a row to the outputs."""

    def into(rows: Sequence[str]) -> Any:
        return lambda s: {row: getattr(s, row) + getattr(s, f"into_{row}") for row in rows}

    rates = [row for row in at if row not in STAGES]
    probes = [_probing("moving", Stage.DYNAMICS, lambda s: {row: getattr(s, f"into_{row}") for row in rates}, rates)]
    for stage in (Stage.COMMAND, Stage.MEASUREMENT):
        redefined = [row for row in at if STAGES.get(row) is stage]
        probes.append(_probing(stage.name, stage, into(redefined), redefined))
    opened = _opened(parent, [replace(one, channels=tuple(f"into_{row}" for row in one.channels)) for one in probes])
    _, rest = divided(opened)
    named = parent.model.by_name
    A, B, C, D = rest.matrices(rest.vector(named))
    columns = [rest.inputs.index(f"into_{row}") for row in at]

    def answer(frequency_hz: FloatArray) -> ComplexArray:
        s = 2j * np.pi * frequency_hz
        inside = np.linalg.solve(s[:, None, None] * np.eye(A.shape[0]) - A, B[:, columns].astype(complex))
        return np.asarray(np.moveaxis(C @ inside + D[:, columns], 0, -1).transpose(1, 0, 2))

    return [answer(group.frequency_hz) for group in parent.dataset.stacks]


def _probing(name: str, stage: Stage, equations: Any, channels: Sequence[str]) -> Effect:
    return Effect(
        id=name,
        title="",
        group="user",
        equation="",
        source="",
        signature="",
        parameters=(),
        stage=stage,
        equations=equations,
        channels=tuple(channels),
        order=math.inf,
        linear=True,
    )


def _opened(parent: Candidate, probes: Sequence[Effect]) -> Structure:
    had = parent.model.structure
    available = {*parent.dataset.available, *(name for one in probes for name in one.channels)}
    composed = [replace(one, adapt=None) for one in had.composed]  # declared for these runs already
    return compose(had.base_, [*composed, *probes], available, dict(had.constants), outputs=had.outputs)


def _signals(probe: _Probe, named: Mapping[str, float], one: Spectrum) -> dict[str, FloatArray]:
    """Time histories (grid,) of all that the library reads, simulated by the commands of this segment."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.fft import irfft, next_fast_len, rfft

    front, rest = divided(probe.structure)
    segment, n, m = one.segment, len(rest.states), len(rest.commands)
    bins = bins_in_reach(one)
    grid = next_fast_len(4 * bins)
    s = 2j * np.pi * np.arange(bins + 1) / segment.duration_s
    held_s = segment.held_s
    hold = np.sinc(np.arange(bins + 1) / segment.samples * (held_s / segment.dt)) * np.exp(-0.5 * s * held_s)

    def on_grid(spectrum: ComplexArray) -> FloatArray:
        return np.asarray(irfft(spectrum, grid, axis=-1) * (grid / segment.samples))

    acting = in_time(probe.structure, front, segment, named)
    U = segment.changed_bins(probe.structure.commands, acting, bins + 1) * hold
    U[:, 0] = 0
    for effect in rest.composed:
        if effect.response is not None:
            U *= effect.response(s, {name: named[name] for name in effect.names})
    u = on_grid(U)
    channels = {name: on_grid(segment.logged_bins([name], bins + 1)[0]) for name in rest.channels}
    A, B, _, _ = rest.matrices(rest.vector(named))
    transfer = np.linalg.inv(s[1:, None, None] * np.eye(n) - A)
    forced = np.zeros((n, bins + 1), dtype=complex)
    forced[:, 1:] = np.einsum("fij,jf->if", transfer, B[:, :m] @ U[:, 1:])
    X = forced
    for _ in range(SETTLING):
        x = on_grid(X)
        known = {**dict(zip(rest.states, x, strict=True)), **dict(zip(rest.commands, u, strict=True)), **channels}
        rates, _ = rest.evaluate({name: named[name] for name in rest.names}, known)
        rhs = np.stack([np.broadcast_to(rates[f"{state}_dot"], grid) for state in rest.states])
        other = rfft(rhs - A @ x - B[:, :m] @ u, axis=1)[:, : bins + 1] * (segment.samples / grid)
        new = forced.copy()
        new[:, 1:] += np.einsum("fij,jf->if", transfer, other[:, 1:])
        change = float(np.max(np.abs(new - X)) / max(float(np.max(np.abs(new))), 1e-300))
        X = new
        if change < SETTLED:
            break
    t = segment.start_s + segment.duration_s / grid * np.arange(grid)
    return {**{name: np.broadcast_to(value, grid) for name, value in probe.heard.items()}, "t": t}


def _plain(parent: Candidate) -> Whitening:
    """Every output by its own residual power, as a fit weighs them."""
    stacks, model = parent.dataset.stacks, parent.model
    weight = np.diag(1 / np.sqrt(np.maximum(parent.estimate.error.residual_power, 1e-300))).astype(complex)
    whitener = [np.broadcast_to(weight, (group.z.size, *weight.shape)) for group in stacks]
    ends = []
    for group, white in zip(stacks, whitener, strict=True):
        E = np.einsum("fij,cjf->cif", white, group.scale * respond(model.structure, model.values, group, False).E)
        ends.append([np.linalg.qr(rows(E[..., part]).T)[0].T for part in group.slices])
    return Whitening(stacks, whitener, ends)
