"""Simple terms that might explain what no effect of the catalogue does: what they are, and which there are.

Terms are products, powers and magnitudes of what the parent model simulates and of the commands, added to one row of
its equations, or, since physics mostly acts on both axes alike, to a row and to its mirror image with coefficients of
their own. Simulated signals stand for the motion throughout: measured ones carry gusts, and a term of them fakes a
damping.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.data.record import COMMANDS
from sysid.model.effect import Signals, magnitude

MIRROR = {"p": "q", "a": "b", "delta_x": "delta_y", "theta_s": "theta_c", "p_dot": "q_dot", "a_dot": "b_dot"}
MIRROR |= {other: name for name, other in MIRROR.items()} | {"p_m": "q_m", "q_m": "p_m"}
CONDITIONS = {"omega": "Omega_0", "airspeed": "V_0"}
"""Channels that count by how far they are from their means, and the names of those."""
POWERS = {"p": 1, "q": 1, "r": 1, "p_m": 1, "q_m": 1, "p_dot": 2, "q_dot": 2, "a_dot": 1, "b_dot": 1, "t": -1}
POWERS |= {"r_dot": 2, "w": 1, "az": 2, "az_dot": 3}
"""Of 1/s in the unit of a signal; angles and commands have none."""
METRES = ("w", "az", "az_dot")
"""Signals that have a metre in their unit."""
STATES = ("p", "q", "a", "b", "r", "w", "az")
"""Of bases, that terms are made of."""
CORE = ("p", "q", "a", "b", "delta_x", "delta_y", "theta_s", "theta_c")
"""Signals of which there are all products of two and three, where roll and pitch are simulated;"""
CORE_OF = {"r": ("r", "delta_r"), "az": ("w", "az", "delta_c")}
"""and where yaw or heave alone is, by its output."""
FARTHEST = 2.0
"""Spans of the runs' time that its zero may be off."""
SMOOTHED = 0.1
"""Of a signal's rms: how wide the step of its sign is."""


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
    def linear(self) -> bool:
        return all(len(factors) == 1 and factors[0].form == "plain" for _, factors in self.parts)

    @property
    def bends(self) -> bool:
        """Whether it bends commands by odd powers of their own: what gives way does, both ways alike. (A limit that a
        trimmed command meets on one side resembles a square.)"""
        commands = {row for row, _ in self.parts} <= {*COMMANDS}
        powers = all({(x.signal, x.form) for x in one} == {(row, "plain")} for row, one in self.parts)
        return commands and powers and all(len(one) > 1 and len(one) % 2 == 1 for _, one in self.parts)

    @property
    def signals(self) -> int:
        """How many signals it is made of; rates, which are sums of others, count twice."""
        _, expression = self.parts[0]
        return sum(2 if name.endswith("_dot") else 1 for name in {factor.signal for factor in expression})

    @property
    def units(self) -> tuple[str, ...]:
        return tuple(_unit(row, expression) for row, expression in self.parts)


_LETTERS = {"p_dot": "L", "q_dot": "M", "a_dot": "A", "b_dot": "B", "r_dot": "N", "az_dot": "Z"}
_LETTERS |= {"p_m": "P", "q_m": "Q", "delta_x": "X", "delta_y": "Y", "delta_r": "R", "delta_c": "C"}
ROWS = tuple(_LETTERS)
"""To which terms are added."""
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
    seconds, metres = POWERS.get(row, 0), int(row in METRES)
    for factor in expression:
        if factor.form != "sign" and (factor.form != "deviation" or factor.signal == "t"):
            seconds -= POWERS.get(factor.signal, 0)
            metres -= factor.signal in METRES
    powers = {"m": metres, "s": -seconds}
    above, below = (
        " ".join(
            unit if abs(power) == 1 else f"{unit}^{abs(power)}" for unit, power in powers.items() if side * power > 0
        )
        for side in (1, -1)
    )
    if not below:
        return above or "-"
    return f"{above or 1}/{below if ' ' not in below else f'({below})'}"


def expressions(
    names: Sequence[str],
    rms: Mapping[str, float],
    mean_time_s: float = 0.0,
    span_s: float = 0.0,
    *,
    core_of: Sequence[str] = CORE,
) -> list[Expression]:
    """Every expression of these signals; of rates of states only what few terms of physics have."""
    core = [name for name in names if name in core_of]
    moving = [name for name in names if name not in (*CONDITIONS, "t")]
    found = [*_products(moving, core), *_uneven(moving, core, rms), *_conditional(names, core)]
    if "t" in names:
        off = Factor("t", "deviation", rounded(mean_time_s, 4))
        # matrices are those of t = 0: a state's coefficient must not run away on the way there
        near = abs(mean_time_s) < FARTHEST * span_s
        found += [(off, Factor(x)) for x in core if near or x not in STATES]
    if "r" in core_of:
        return found
    # a gyro that is tilted a little shows p and q in r, gusts and all: r alone explains noise by itself
    return [one for one in found if any(factor.signal != "r" for factor in one)]


def _products(moving: Sequence[str], core: Sequence[str]) -> list[Expression]:
    """Signals alone, all products of two, and products of three as far as physics has them."""
    plain = {name: Factor(name) for name in moving}
    found: list[Expression] = [(plain[name],) for name in moving]
    found += [(plain[x], plain[y]) for x, y in itertools.combinations_with_replacement(moving, 2)]
    found += [(plain[x], plain[y], plain[z]) for x, y, z in itertools.combinations_with_replacement(core, 3)]
    found += [(plain[name],) * 3 for name in moving if name not in core]
    return found


def _uneven(moving: Sequence[str], core: Sequence[str], rms: Mapping[str, float]) -> list[Expression]:
    """Magnitudes and signs, and magnitudes times a signal."""
    found: list[Expression] = []
    for x in moving:
        size = Factor(x, "magnitude")
        found += [(size,), (Factor(x, "sign", rounded(SMOOTHED * rms[x], 1)),)]
        found += [(Factor(y), size) for y in (core if x in core else [x])]
    return found


def _conditional(names: Sequence[str], core: Sequence[str]) -> list[Expression]:
    """How far a flight condition is from its mean, times a signal."""
    return [(Factor(name, "deviation"), Factor(x)) for name in CONDITIONS if name in names for x in core]


def rounded(x: float, digits: int) -> float:
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
            if other is not None and row in ("p_dot", "a_dot", "p_m", "delta_x") and MIRROR[row] in at:
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
