"""Simple terms that might explain what no effect of the catalogue does: a library, and how it is ranked.

Terms are products, powers and magnitudes of what the parent model simulates and of the commands, added to one row of
its equations, or, since physics mostly acts on both axes alike, to a row and to its mirror image with coefficients of
their own. They are scored as effects are in `evidence`: by one step from the parent, less what the parent's own
parameters would do, asked with the commands as the logged excitation alone moved them. Simulated signals stand for the
motion throughout: measured ones carry gusts, and a term of them fakes a damping.

The answer to a term is linear, a transfer function times the term's spectrum. So nothing is simulated term by term:
signals come once on a coarse clock (they are limited to 30 Hz, and their cubes do not fold back into the band), and
all inner products of all terms and rows are a few products of matrices. The parent's end states do not count in the
simulated signals, and of a parent that is not linear itself the transfer is that of small motions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.record import COMMANDS
from sysid.diagnose.evidence import Candidate, Metric, Settled, error_share, metric
from sysid.fit.noise import divide
from sysid.fit.output_error import OutputError
from sysid.fit.rows import rows
from sysid.model.acting import divided, in_time
from sysid.model.bases import compose
from sysid.model.effect import Effect, Signals, Stage, magnitude
from sysid.model.predict import respond
from sysid.model.relaxation import RELAXATION_HZ
from sysid.model.structure import AnyArray, FloatArray, Structure

MIRROR = {"p": "q", "a": "b", "delta_x": "delta_y", "theta_s": "theta_c", "p_dot": "q_dot", "a_dot": "b_dot"}
MIRROR |= {other: name for name, other in MIRROR.items()} | {"p_m": "q_m", "q_m": "p_m"}
STAGES = {"delta_x": Stage.COMMAND, "delta_y": Stage.COMMAND, "p_m": Stage.MEASUREMENT, "q_m": Stage.MEASUREMENT}
"""Of rows that are redefined instead of added to."""
CONDITIONS = {"omega": "Omega_0", "airspeed": "V_0"}
"""Channels that count by how far they are from their means, and the names of those."""
POWERS = {"p": 1, "q": 1, "r": 1, "p_m": 1, "q_m": 1, "p_dot": 2, "q_dot": 2, "a_dot": 1, "b_dot": 1, "t": -1}
"""Of 1/s in the unit of a signal; angles and commands have none."""
CORE = ("p", "q", "a", "b", "delta_x", "delta_y", "theta_s", "theta_c")
"""Signals of which there are all products of two and three."""
FARTHEST = 2.0
"""Spans of the runs' time that its zero may be off."""
SMOOTHED = 0.1
"""Of a signal's rms: how wide the step of its sign is."""
SETTLING = 20
SETTLED = 1e-4
LEAST_LEFT = 1e-4
"""Share of a term that the parent's own parameters must leave of it; less needs absurd coefficients."""
LEAST_APART = 1e-4
"""1 - correlation^2 of the two terms of a pair."""
LARGEST_BIN = 1e60
"""Of what a term may be in any bin: its square, and that by another, must stay a number."""
RANK = 1e-9
LOOKED_AT = 120
"""Best entries that are compared one by one."""
SIGNIFICANT = math.log(0.01)
TELLING = 2.33
"""Standard deviations that tell one entry from another."""
BY_CHANCE = {1: 6.6, 2: 9.2}
"""By coefficients: chi squared that noise adds to one of two that are both true, once in a hundred."""
INEXACT = 0.01
"""Share of chi squared that one step, which leaves out what a term does to its own signals, cannot be held to."""
EQUAL = 2.0
"""In log p: what an entry in fewer signals may lack of the best to speak for it."""
MOST_TERMS = 4


# ------------------------------------------------------------------------------------------------ what a term is


@dataclass(frozen=True)
class Factor:
    """One signal in a product: itself, its magnitude, its sign, or how far it is from its mean."""

    signal: str
    form: str = "plain"
    """plain, magnitude, sign or deviation."""
    at: float = 0.0
    """Where a sign's step ends, or the mean time; of no meaning else."""

    @property
    def text(self) -> str:
        if self.form == "deviation":
            return f"({self.signal} - {self.at:g})" if self.signal == "t" else f"({self.signal}/{self._mean} - 1)"
        return {"plain": "{}", "magnitude": "|{}|", "sign": "sign({})"}[self.form].format(self.signal)

    @property
    def code(self) -> str:
        """The same in an effect's file."""
        name = f"s.{self.signal}"
        if self.form == "deviation":
            return f"({name} - {self.at:g})" if self.signal == "t" else f"({name} / s.{self._mean} - 1)"
        sign = f"{name} / np.sqrt({name}**2 + {self.at:g}**2)"
        return {"plain": name, "magnitude": f"magnitude({name})", "sign": sign}[self.form]

    @property
    def mirrored(self) -> Factor:
        return replace(self, signal=MIRROR.get(self.signal, self.signal))

    @property
    def _mean(self) -> str:
        return CONDITIONS[self.signal]

    def value(self, s: Signals) -> Any:
        x = getattr(s, self.signal)
        match self.form:
            case "magnitude":
                return magnitude(x)
            case "sign":
                return x / np.sqrt(x * x + self.at**2)
            case "deviation":
                return x - self.at if self.signal == "t" else x / getattr(s, self._mean) - 1
        return x


Expression = tuple[Factor, ...]
"""A product."""


def text(expression: Expression) -> str:
    """As people write it: `b^3`, `p|p|`, `p q`."""
    words = [
        factor.text + (f"^{count}" if (count := len(list(same))) > 1 else "")
        for factor, same in itertools.groupby(expression)
    ]
    return " ".join(words).replace(" |", "|")


def code(expression: Expression) -> str:
    """As an effect's equations say it."""
    words = [
        factor.code + (f"**{count}" if (count := len(list(same))) > 1 else "")
        for factor, same in itertools.groupby(expression)
    ]
    return " * ".join(words)


def value(expression: Expression, s: Signals) -> Any:
    """What it is for an effect that reads these signals."""
    found = expression[0].value(s)
    for factor in expression[1:]:
        found = found * factor.value(s)
    return found


@dataclass(frozen=True)
class Entry:
    """One term in one row, or in a row and its mirror image."""

    parts: tuple[tuple[str, Expression], ...]
    """(row, what is added to it times a coefficient). Rows are the states' rates, the commands that act (`delta_x`,
    `delta_y`) and what is measured (`p_m`, `q_m`)."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of its coefficients, one for each part."""
        return tuple(f"{_LETTERS[row]}_{_short(expression)}" for row, expression in self.parts)

    @property
    def equation(self) -> str:
        return ", ".join(
            f"{row} += {name} {text(expression)}"
            for name, (row, expression) in zip(self.names, self.parts, strict=True)
        )

    @property
    def signals(self) -> int:
        """How many signals it is made of; rates, which are sums of others, count twice."""
        _, expression = self.parts[0]
        return sum(2 if name.endswith("_dot") else 1 for name in {factor.signal for factor in expression})

    @property
    def units(self) -> tuple[str, ...]:
        return tuple(_unit(row, expression) for row, expression in self.parts)


_LETTERS = {"p_dot": "L", "q_dot": "M", "a_dot": "A", "b_dot": "B"}
_LETTERS |= {"p_m": "P", "q_m": "Q", "delta_x": "X", "delta_y": "Y"}
_SHORT = {"plain": "", "magnitude": "abs_", "sign": "sign_", "deviation": "d"}


def _short(expression: Expression) -> str:
    """For a name; a signal alone takes a 1, since names like `A_b` and `L_p` are the base's or the catalogue's."""
    if len(expression) == 1 and expression[0].form == "plain":
        return f"{expression[0].signal}1"
    words = []
    for factor, same in itertools.groupby(expression):
        count = len(list(same))
        words.append(f"{_SHORT[factor.form]}{factor.signal}" + (str(count) if count > 1 else ""))
    return "_".join(words)


def _unit(row: str, expression: Expression) -> str:
    power = POWERS.get(row, 0)
    for factor in expression:
        if factor.form != "sign" and (factor.form != "deviation" or factor.signal == "t"):
            power -= POWERS.get(factor.signal, 0)
    seconds = "s" if abs(power) == 1 else f"s^{abs(power)}"
    return "-" if power == 0 else seconds if power < 0 else f"1/{seconds}"


def expressions(
    names: Sequence[str], rms: Mapping[str, float], mean_time_s: float = 0.0, span_s: float = 0.0
) -> list[Expression]:
    """Every expression of these signals; of rates of states only what few terms of physics have."""
    still = [*CONDITIONS, "t"]
    core = [name for name in names if name in CORE]
    moving = [name for name in names if name not in still]
    plain = {name: Factor(name) for name in names}
    found: list[Expression] = [(plain[name],) for name in moving]
    found += [(plain[x], plain[y]) for x, y in itertools.combinations_with_replacement(moving, 2)]
    found += [(plain[x], plain[y], plain[z]) for x, y, z in itertools.combinations_with_replacement(core, 3)]
    found += [(plain[name],) * 3 for name in moving if name not in core]
    for x in moving:
        size = Factor(x, "magnitude")
        found += [(size,), (Factor(x, "sign", _rounded(SMOOTHED * rms[x], 1)),)]
        found += [(plain[y], size) for y in (core if x in core else [x])]
    for name in CONDITIONS:
        if name in names:
            found += [(Factor(name, "deviation"), plain[x]) for x in core]
    if "t" in names:
        off = Factor("t", "deviation", _rounded(mean_time_s, 4))
        # matrices are those of t = 0: a state's coefficient must not run away on the way there
        near = abs(mean_time_s) < FARTHEST * span_s
        found += [(off, plain[x]) for x in core if near or x not in ("p", "q", "a", "b")]
    # a gyro that is tilted a little shows p and q in r, gusts and all: r alone explains noise by itself
    return [one for one in found if any(factor.signal != "r" for factor in one)]


def _rounded(x: float, digits: int) -> float:
    return float(f"{x:.{digits}g}")


def entries(found: Sequence[Expression], at: Sequence[str]) -> list[Entry]:
    """Every expression in every row, and those that have a mirror image together with it, each pair once."""
    known = set(found)
    mirrored = {one: _mirrored(one, known) for one in found}
    ordered = [one for one in found if all(factor.signal in (*COMMANDS, *CONDITIONS, "t") for factor in one)]
    made = []
    pairs = []
    for row in at:
        for one in ordered if row in COMMANDS else found:
            other = mirrored[one]
            made.append(Entry(((row, one),)))
            if other is not None and row in ("p_dot", "a_dot", "p_m", "delta_x"):
                pairs.append(Entry(((row, one), (MIRROR[row], other))))
    return made + pairs


def _mirrored(one: Expression, known: set[Expression]) -> Expression | None:
    """The expression of the other axis, its factors in the library's order; a sign's step is not scaled."""
    turned = tuple(factor.mirrored for factor in one)
    for order in itertools.permutations(turned):
        if order in known:
            return order
    if len(one) == 1 and one[0].form == "sign":
        return next((two for two in known if len(two) == 1 and replace(two[0], at=one[0].at) == turned[0]), None)
    return None


# ------------------------------------------------------------------------------------------------ signals and answers


@dataclass(frozen=True, eq=False)
class Library:
    """All entries on a candidate's runs: what every expression is on the bins, and how rows answer."""

    entries: tuple[Entry, ...]
    flown: list[ComplexArray]
    """For every stack the expressions' bins (expressions, bins), by the commands as flown."""
    imposed: list[ComplexArray]
    """By the imposed commands."""
    transfer: list[ComplexArray]
    """For every stack (rows, k, bins): outputs per unit of what is added to a row."""
    plain: Metric
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


def library(parent: Candidate) -> Library:
    """Every expression in every row, on the parent's runs. Which there are depends on the channels that move there."""
    on, model = parent.ground, parent.model
    probe = _listening(parent)
    named = dict(zip(model.structure.names, map(float, model.values), strict=True))
    with np.errstate(all="ignore"):  # a parent that is not linear may run away: nothing is finite then, nor ranked
        flown = [[_signals(probe, named, one) for one in group.spectra] for group in on.stacks]
        imposed = [[_signals(probe, named, one) for one in group.spectra] for group in on.imposed]
        found = _expressions_on([one for group in flown for one in group])
        constants = dict(model.structure.constants)

        def bins(signals: Sequence[Sequence[Mapping[str, FloatArray]]]) -> list[ComplexArray]:
            return [
                np.hstack([_bins(found, said, constants, one) for one, said in zip(group.spectra, parts, strict=True)])
                for group, parts in zip(on.stacks, signals, strict=True)
            ]

        terms = _within_reach(bins(flown), bins(imposed))
    at = [f"{name}_dot" for name in ("p", "q", "a", "b") if name in model.structure.states]
    at += ["delta_x", "delta_y", "p_m", "q_m"]
    made = entries(found, at)
    place = {one: i for i, one in enumerate(found)}

    def numbered(parts: Sequence[tuple[str, Expression]]) -> tuple[AnyArray, AnyArray]:
        numbers = np.array([(at.index(row), place[one]) for row, one in parts], int).reshape(-1, 2)
        return numbers[:, 0], numbers[:, 1]

    return Library(
        tuple(made),
        terms[0],
        terms[1],
        [_transfer(parent, at, group.frequency_hz) for group in on.stacks],
        _plain(parent),
        numbered([one.parts[0] for one in made]),
        numbered([one.parts[1] for one in made if len(one.parts) == 2]),
    )


def _within_reach(
    flown: list[ComplexArray], imposed: list[ComplexArray]
) -> tuple[list[ComplexArray], list[ComplexArray]]:
    """Terms of shape (terms, bins); one that runs away, a power of a state that a model does not hold, is nothing."""
    far = ~np.all([np.abs(Z).max(axis=1, initial=0.0) < LARGEST_BIN for Z in (*flown, *imposed)], axis=0)
    if not far.any():
        return flown, imposed
    return [np.where(far[:, None], 0.0, Z) for Z in flown], [np.where(far[:, None], 0.0, Z) for Z in imposed]


def _expressions_on(segments: Sequence[Mapping[str, FloatArray]]) -> list[Expression]:
    moving = [name for name in segments[0] if any(bool(np.ptp(one[name]) > 0) for one in segments)]
    rms = {name: max(float(np.sqrt(np.mean(one[name] ** 2))) for one in segments) for name in moving}
    t = np.concatenate([one["t"] for one in segments])
    return expressions(moving, rms, float(np.mean(t)), float(np.ptp(t)))


def _bins(
    found: Sequence[Expression], signals: Mapping[str, FloatArray], constants: Mapping[str, float], one: Spectrum
) -> ComplexArray:
    """What expressions are on a segment's bins, as the transform of all its samples would be."""
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


# ------------------------------------------------------------------------------------------------ the parent, opened


@dataclass(frozen=True, eq=False)
class _Probe:
    """The parent's structure with an effect that acts after all others on the rates and notes what it may read."""

    structure: Structure
    heard: dict[str, Any]
    """Signals by name, of the last evaluation."""


def _listening(parent: Candidate) -> _Probe:
    on, constants = parent.ground, dict(parent.model.structure.constants)
    channels = [name for name in (*COMMANDS[2:], "r") if name in on.available]
    channels += [name for name, mean in CONDITIONS.items() if name in on.available and mean in constants]
    rotor = [name for name in ("a", "b") if name in parent.model.structure.states]
    states = ["p", "q", *rotor]
    wanted = [*states, *(f"{name}_dot" for name in states), *COMMANDS[:2], "theta_s", "theta_c", *channels]
    heard: dict[str, Any] = {}

    def listen(s: Signals) -> Mapping[str, Any]:
        heard.update({name: getattr(s, name) for name in wanted if s.has(name)})
        return {}

    return _Probe(_opened(parent, [_probing("listening", Stage.DYNAMICS, listen, channels)]), heard)


def _transfer(parent: Candidate, at: Sequence[str], frequency_hz: FloatArray) -> ComplexArray:
    """(rows, k, bins) from what is added to a row to the outputs."""

    def into(rows: Sequence[str]) -> Any:
        return lambda s: {row: getattr(s, row) + getattr(s, f"into_{row}") for row in rows}

    rates = [row for row in at if row not in STAGES]
    probes = [_probing("moving", Stage.DYNAMICS, lambda s: {row: getattr(s, f"into_{row}") for row in rates}, rates)]
    for stage in (Stage.COMMAND, Stage.MEASUREMENT):
        redefined = [row for row in at if STAGES.get(row) is stage]
        probes.append(_probing(stage.name, stage, into(redefined), redefined))
    opened = _opened(parent, [replace(one, channels=tuple(f"into_{row}" for row in one.channels)) for one in probes])
    _, rest = divided(opened)
    named = dict(zip(parent.model.structure.names, map(float, parent.model.values), strict=True))
    A, B, C, D = rest.matrices(rest.vector(named))
    columns = [rest.inputs.index(f"into_{row}") for row in at]
    s = 2j * np.pi * frequency_hz
    inside = np.linalg.solve(s[:, None, None] * np.eye(A.shape[0]) - A, B[:, columns].astype(complex))
    return np.asarray(np.moveaxis(C @ inside + D[:, columns], 0, -1).transpose(1, 0, 2))


def _probing(name: str, stage: Stage, equations: Any, channels: Sequence[str]) -> Effect:
    return Effect(
        name, "", "user", "", "", "", (), stage, equations, channels=tuple(channels), order=math.inf, linear=True
    )


def _opened(parent: Candidate, probes: Sequence[Effect]) -> Structure:
    had = parent.model.structure
    available = {*parent.ground.available, *(name for one in probes for name in one.channels)}
    composed = [replace(one, adapt=None) for one in had.composed]  # declared for these runs already
    return compose(had.base, [*composed, *probes], available, dict(had.constants))


def _signals(probe: _Probe, named: Mapping[str, float], one: Spectrum) -> dict[str, FloatArray]:
    """Time histories (grid,) of all that the library reads, simulated by the commands of this segment."""
    from scipy.fft import irfft, next_fast_len, rfft

    front, rest = divided(probe.structure)
    segment, n, m = one.segment, len(rest.states), len(rest.commands)
    length = segment.samples * segment.dt
    bins = min(int(max(RELAXATION_HZ, float(one.frequency_hz[-1])) * length), (segment.samples - 1) // 2)
    grid = next_fast_len(4 * bins)
    s = 2j * np.pi * np.arange(bins + 1) / length
    hold = np.sinc(np.arange(bins + 1) / segment.samples) * np.exp(-0.5 * s * segment.dt)

    def on_grid(spectrum: ComplexArray) -> FloatArray:
        return np.asarray(irfft(spectrum, grid, axis=-1) * (grid / segment.samples))

    U = rfft(in_time(probe.structure, front, segment, named), axis=1)[:, : bins + 1] * hold
    U[:, 0] = 0
    for effect in rest.composed:
        if effect.response is not None:
            U *= effect.response(s, {name: named[name] for name in effect.names})
    u = on_grid(U)
    channels = {name: on_grid(rfft(segment.channels[name])[: bins + 1]) for name in rest.channels}
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
    t = segment.start_s + length / grid * np.arange(grid)
    return {**{name: np.broadcast_to(value, grid) for name, value in probe.heard.items()}, "t": t}


# ------------------------------------------------------------------------------------------------ the score


def _score(known: Library, settled: Settled, by: Metric) -> FloatArray:
    """Chi squared of every entry; NaN where the parent's own parameters do the same, or the terms of a pair do."""
    products = _products(known, settled, by)
    single, first, second = known.single, known.first_of_pairs, known.second
    size = products.gram_single
    with np.errstate(all="ignore"):
        alone = np.where(products.left > LEAST_LEFT, products.e / np.sqrt(size), np.nan)
        one, two = alone[first], alone[second]
        correlation = products.gram_pair / np.sqrt(size[first] * size[second])
        apart = 1 - correlation**2
        both = (one**2 + two**2 - 2 * correlation * one * two) / np.where(apart > LEAST_APART, apart, np.nan)
    return np.concatenate([alone[known.first[0][:single], known.first[1][:single]] ** 2, both])


@dataclass(frozen=True, eq=False)
class _Products:
    """Inner products of whitened sensitivities by the imposed commands, less what the parent would do."""

    e: FloatArray
    """(rows, expressions), with the residual."""
    gram_single: FloatArray
    """(rows, expressions), with themselves."""
    left: FloatArray
    """(rows, expressions), share of themselves that the parent's own parameters leave."""
    gram_pair: FloatArray
    """(pairs,), of the first part with the second."""


def _products(known: Library, settled: Settled, by: Metric) -> _Products:
    """Without forming one sensitivity: <h t, v> is the real part of conj(t) times what h makes of v, bin by bin."""
    Z = np.concatenate(known.imposed, axis=1)
    h = np.concatenate(
        [
            group.scale * np.einsum("fij,rjf->rif", white, T)
            for group, white, T in zip(by.stacks, by.whitener, known.transfer, strict=True)
        ],
        axis=2,
    )
    sizes = [part.stop - part.start for group in by.stacks for part in group.slices]
    bases = [basis for group in by.ends for basis in group]
    b, k = len(settled.moved), h.shape[1]
    others = _inner(Z, h, _complex(np.concatenate([settled.residual[None], settled.moved, settled.asked]), sizes, k))
    e, moved, asked = others[..., 0], others[..., 1 : 1 + b], others[..., 1 + b :]
    own = moved @ _inverse(settled.asked, settled.moved)
    edges = np.cumsum([0, *sizes])
    ends = np.concatenate(
        [
            _inner(Z[:, i:j], h[..., i:j], _complex(basis, [j - i], k))
            for i, j, basis in zip(edges[:-1], edges[1:], bases, strict=True)
        ],
        axis=2,
    )
    crossed = settled.asked @ settled.asked.T
    whole = (Z.real**2 + Z.imag**2) @ np.sum(np.abs(h) ** 2, axis=1).T
    whole = whole.T - np.sum(ends**2, axis=2)
    rest = whole - 2 * np.sum(own * asked, axis=2) + np.sum((own @ crossed) * own, axis=2)
    one, two = known.first_of_pairs, known.second
    pairs = np.empty(two[0].size)
    for i in np.unique(one[0]):
        here = one[0] == i
        j = two[0][here][0]
        pairs[here] = np.real((Z[one[1][here]].conj() * Z[two[1][here]]) @ np.sum(h[i].conj() * h[j], axis=0))
    pairs -= np.sum(ends[one] * ends[two], axis=1)
    pairs -= np.sum(own[one] * asked[two] + asked[one] * own[two], axis=1)
    pairs += np.sum((own[one] @ crossed) * own[two], axis=1)
    return _Products(e, rest, rest / np.maximum(whole, 1e-300), pairs)


def _inverse(asked: FloatArray, moved: FloatArray) -> FloatArray:
    """Of asked moved^T; the sizes of sensitivities, which are many powers of ten apart, do not matter."""
    sizes = [np.maximum(np.sqrt(np.einsum("ij,ij->i", one, one)), 1e-300) for one in (moved, asked)]
    return np.asarray(np.linalg.pinv((asked @ moved.T) / np.outer(sizes[1], sizes[0]), RANK) / np.outer(*sizes))


def _complex(vectors: FloatArray, sizes: Sequence[int], k: int) -> ComplexArray:
    """Rows of a metric (v, N) back to bins (v, k, bins)."""
    edges = np.cumsum([0, *(2 * k * size for size in sizes)])
    return np.concatenate(
        [
            np.ascontiguousarray(vectors[:, i:j]).view(complex).reshape(len(vectors), k, -1)
            for i, j in itertools.pairwise(edges)
        ],
        axis=2,
    )


def _inner(terms: ComplexArray, h: ComplexArray, vectors: ComplexArray) -> FloatArray:
    """(rows, terms, vectors)"""
    weighed = np.einsum("rkf,vkf->rvf", h.conj(), vectors)
    real = np.ascontiguousarray(weighed).view(float).reshape(-1, 2 * terms.shape[1])
    found = np.ascontiguousarray(terms).view(float) @ real.T
    return np.asarray(found.reshape(len(terms), len(h), -1).transpose(1, 0, 2))


# ------------------------------------------------------------------------------------------------ search and selection


@dataclass(frozen=True, eq=False)
class Term:
    """An entry, and what the runs say for it."""

    entry: Entry
    chi_squared: float
    degrees: int
    log_p: float
    """Logarithm of the chance that noise alone shows as much in any of the library's entries, taken as independent:
    neighbours are not, so the chance is about a third of that."""
    coefficients: FloatArray
    """(degrees,), by one step from the parent."""
    standard_errors: FloatArray
    error_share: float
    """Residual over measured power, summed over the outputs, that one step would leave."""
    as_well: tuple[Entry, ...] = ()
    """Entries that these runs cannot tell from it, best first."""
    number: int = -1
    """In its library."""

    @property
    def significant(self) -> bool:
        return self.log_p < SIGNIFICANT


@dataclass(frozen=True, eq=False)
class Selection:
    """Entries one after the other until nothing significant is left: the most that this library explains."""

    terms: tuple[Term, ...]
    """In the order of choice, each as it was scored beside those before it; empty where nothing is significant."""
    error: OutputError
    """What one step with all of them leaves: noise, as far as the library reaches."""
    metric: Metric
    """By the noise's spectrum, the one in which they were chosen."""
    settled: Settled
    """The parent in that metric."""

    @property
    def error_share(self) -> float:
        """Residual over measured power that is left, summed over the outputs."""
        return error_share(self.error)


def search(
    parent: Candidate,
    settled: Settled,
    by: Metric,
    known: Library | None = None,
    most: int = 10,
    beside: Sequence[Term] = (),
) -> list[Term]:
    """The best entries by one step from the parent, best first; those that runs cannot tell apart make one Term.

    `known` is the parent's library where it was made already. `beside`: terms that stay in; `settled` has them too.
    Of entries as good as the best the one in the fewest signals speaks for all.
    """
    known = known or library(parent)
    order, log_p, tried = _ranked(known, settled, by)
    steps = _steps(known, order[:LOOKED_AT], settled, by)
    found: list[Term] = []
    while steps and len(found) < most:
        best = steps[0]
        alike = [one for one in steps if one is best or _as_well(best, one)]
        equal = [one for one in alike if log_p[one.number] < log_p[best.number] + EQUAL]
        head = min(equal, key=lambda one: (known.entries[one.number].signals, log_p[one.number]))
        found.append(
            Term(
                known.entries[head.number],
                head.chi_squared,
                len(head.coefficients),
                min(0.0, float(log_p[head.number]) + math.log(tried)),
                head.coefficients,
                head.standard_errors,
                error_share(_left(parent, known, [*(term.number for term in beside), head.number])),
                tuple(known.entries[one.number] for one in alike if one is not head),
                head.number,
            )
        )
        steps = [one for one in steps if all(one is not other for other in alike)]
    return found


def select(parent: Candidate, by: Metric, known: Library | None = None, most: int = MOST_TERMS) -> Selection:
    """Greedy forward selection, twice: what the first leaves is the noise by whose spectrum the second chooses."""
    known = known or library(parent)
    on = parent.ground
    rough: list[int] = []
    while len(rough) < most:
        order, log_p, tried = _ranked(known, _settled(parent, known, rough, by), by)
        if not order or log_p[order[0]] + math.log(tried) > SIGNIFICANT:
            break
        rough.append(order[0])
    by = metric(parent.model, on.stacks, divide(_left(parent, known, rough), on.stacks, on.causes))
    terms: list[Term] = []
    while len(terms) < most:
        settled = _settled(parent, known, [term.number for term in terms], by)
        best = search(parent, settled, by, known, 1, terms)
        if not best or not best[0].significant:
            break
        terms.append(best[0])
    left = _left(parent, known, [term.number for term in terms])
    return Selection(tuple(terms), left, by, _settled(parent, known, [], by))


def _ranked(known: Library, settled: Settled, by: Metric) -> tuple[list[int], FloatArray, int]:
    """Numbers of entries, best first; the logarithm of each one's chance; and how many there were to choose from."""
    chi_squared = _score(known, settled, by)
    degrees = np.where(np.arange(chi_squared.size) < known.single, 1, 2)
    valid = np.isfinite(chi_squared)
    log_p = np.where(valid, log_chances(np.where(valid, chi_squared, 0.0), degrees), 0.0)
    order = np.lexsort((-np.where(valid, chi_squared, -np.inf), log_p))
    return [int(number) for number in order if valid[number]], log_p, max(1, int(np.count_nonzero(valid)))


def log_chances(chi_squared: FloatArray, degrees: AnyArray) -> FloatArray:
    """Logarithm of the chance that chi squared of one or two degrees is larger."""
    from scipy.special import log_ndtr

    return np.where(degrees == 2, -0.5 * chi_squared, math.log(2) + log_ndtr(-np.sqrt(chi_squared)))


@dataclass(frozen=True, eq=False)
class _Step:
    """One entry's step from the parent."""

    number: int
    coefficients: FloatArray
    standard_errors: FloatArray
    explains: FloatArray
    """(N,) of the residual, as the imposed commands show it."""

    @property
    def chi_squared(self) -> float:
        return float(self.explains @ self.explains)


def _steps(known: Library, numbers: Sequence[int], settled: Settled, by: Metric) -> list[_Step]:
    if not numbers:
        return []
    D = by(_together([known.answers(number) for number in numbers]))
    Z = by(_together([known.answers(number, True) for number in numbers]))
    Z = Z - (Z @ settled.moved.T) @ _inverse(settled.asked, settled.moved) @ settled.asked
    found = []
    begin = 0
    for number in numbers:
        z = Z[begin : begin + len(known.entries[number].parts)]
        d = D[begin : begin + len(z)]
        begin += len(z)
        gram, e = z @ z.T, z @ settled.residual
        inverse = np.linalg.pinv(z @ d.T)
        spread = np.sqrt(np.maximum(np.diag(inverse @ gram @ inverse.T), 0))
        found.append(_Step(number, inverse @ e, spread, np.linalg.pinv(gram, hermitian=True) @ e @ z))
    return found


def _together(answers: Sequence[list[ComplexArray]]) -> list[ComplexArray]:
    return [np.concatenate(parts) for parts in zip(*answers, strict=True)]


def _as_well(better: _Step, other: _Step) -> bool:
    """Whether the runs, if the other were true, could show the better one as much better as they do.

    |f_1|^2 - |f_2|^2 of what two explain has then the mean -d and the deviation 2 sqrt(d), d their distance squared.
    """
    gain = better.chi_squared - other.chi_squared
    apart = better.explains - other.explains
    d = float(apart @ apart)
    chance = BY_CHANCE[len(better.coefficients)]
    return gain < max(2 * TELLING * math.sqrt(d) - d, chance, INEXACT * better.chi_squared)


def _settled(parent: Candidate, known: Library, numbers: Sequence[int], by: Metric) -> Settled:
    """As `settle` does, with entries among the parameters."""
    moved = by(_together([parent.J, *(known.answers(number) for number in numbers)]))
    asked = by(_together([parent.J_imposed, *(known.answers(number, True) for number in numbers)]))
    e = by(_residual(parent))[0]
    imposed = by([Y[None] for Y in parent.Y_imposed])[0]
    move = _inverse(asked, moved) @ (asked @ e)
    return Settled(e - move @ moved, imposed + move @ asked, moved, asked)


def _residual(parent: Candidate) -> list[ComplexArray]:
    return [(group.Y - Y)[None] for group, Y in zip(parent.ground.stacks, parent.Y, strict=True)]


def _left(parent: Candidate, known: Library, numbers: Sequence[int]) -> OutputError:
    """What the parent with these entries leaves after one step of all parameters, by the least squares of a fit."""
    plain, stacks = known.plain, parent.ground.stacks
    e = plain(_residual(parent))[0]
    if numbers:
        J = plain(_together([parent.J, *(known.answers(number) for number in numbers)]))
        e = e - (_inverse(J, J) @ (J @ e)) @ J
    residuals, power, begin = [], np.zeros(2), 0
    for group, whitener in zip(stacks, plain.whitener, strict=True):
        weight = np.diag(whitener[0]).real
        for part in group.slices:
            size = 4 * (part.stop - part.start)  # real and imaginary parts of p and q
            bins = e[begin : begin + size].view(complex).reshape(2, -1) / weight[:, None]
            power += np.sum(np.abs(bins) ** 2, axis=1)
            residuals.append(bins / group.scale[part])
            begin += size
    return OutputError(residuals, parent.estimate.error.measured_power, power)


def _plain(parent: Candidate) -> Metric:
    """Every output by its own residual power, as a fit weighs them."""
    stacks, model = parent.ground.stacks, parent.model
    weight = np.diag(1 / np.sqrt(np.maximum(parent.estimate.error.residual_power, 1e-300))).astype(complex)
    whitener = [np.broadcast_to(weight, (group.z.size, 2, 2)) for group in stacks]
    ends = []
    for group, white in zip(stacks, whitener, strict=True):
        E = np.einsum("fij,cjf->cif", white, group.scale * respond(model.structure, model.values, group, False).E)
        ends.append([np.linalg.qr(rows(E[..., part]).T)[0].T for part in group.slices])
    return Metric(stacks, whitener, ends)
