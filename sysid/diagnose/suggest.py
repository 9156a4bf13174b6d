"""The best entries of the library as a user's effect: in memory, and as the file that a user would have written.

A suggestion says what the residual looks like, not what causes it. So the file names how it was found and which other
terms the runs cannot tell from it: physics, or another maneuver, must choose. Bounds are wide and no value is called
implausible, for nothing is known of the term but its size.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.diagnose.candidate_terms import STAGES
from sysid.diagnose.term_search import Term
from sysid.diagnose.terms import Entry, Expression, code, text, value
from sysid.errors import SysidError
from sysid.model.effect import Effect, Signals, Stage
from sysid.model.parameter import Parameter
from sysid.model.structure import Structure

WIDE = 100.0
"""Bounds, as multiples of the size found."""
MOST_NAMED = 2
"""Rivals that the file names; it counts the others."""
MOST_COEFFICIENTS = 4
"""What a file of some 25 lines has room for."""
WIDTH = 118
OWN_CHANNELS = ("omega", "airspeed", "r", "t", "delta_e", "delta_c", "delta_r", "delta_a")
"""Signals that an effect has only where it declares their channel."""
AFTER_OTHERS = 9.0
"""Order of an effect that reads rates, which are summed up by then, or that redefines what others have made."""


class SuggestionError(SysidError):
    """Nothing in the library is worth a file."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """An effect that explains what the catalogue does not."""

    effect: Effect
    text: str
    """The whole file. Whoever writes it minds what is there already."""
    terms: tuple[Term, ...]
    """That are in it."""
    left_out: tuple[Term, ...]
    """That act at another stage, are there already in part, or for which there was no room."""
    warning: str | None
    """Where other terms do as well on these runs."""


def suggest(terms: Sequence[Term], parent: Structure, runs: int) -> Suggestion:
    """The first term, and those of the others that fit into one file with it.

    parent: the structure whose residual was searched; runs: how many showed it. Raises SuggestionError
    where no term is significant.
    """
    telling = [term for term in terms if term.significant]
    if not telling:
        raise SuggestionError(
            "no term of the library explains more of the residual than noise would: there is nothing to write; "
            "fly longer or harder where the error is"
        )
    stage = _stage(telling[0].entry)
    taken: list[Term] = []
    for term in telling:
        names = [name for one in taken for name in one.entry.names]
        room = len(names) + term.degrees <= MOST_COEFFICIENTS
        if room and _stage(term.entry) is stage and not set(names) & set(term.entry.names):
            taken.append(term)
    warning = _warning(taken)
    effect = _effect(taken, parent)
    return Suggestion(
        effect,
        _file(effect, taken, parent.title, runs, warning),
        tuple(taken),
        tuple(term for term in telling if term not in taken),
        warning,
    )


def _stage(entry: Entry) -> Stage:
    return STAGES.get(entry.parts[0][0], Stage.DYNAMICS)


def _parts(terms: Sequence[Term]) -> list[tuple[str, str, Expression]]:
    """(row, name of the coefficient, expression) of all."""
    return [
        (row, name, expression)
        for term in terms
        for name, (row, expression) in zip(term.entry.names, term.entry.parts, strict=True)
    ]


def _warning(terms: Sequence[Term]) -> str | None:
    rivals = [term for term in terms if term.as_well]
    if not rivals:
        return None
    said = []
    for term in rivals:
        others = [_bare(entry) for entry in term.as_well[:MOST_NAMED]]
        more = len(term.as_well) - len(others)
        said.append(f"{_bare(term.entry)} from {', or '.join(others)}" + (f", or {more} more" if more else ""))
    return "these runs cannot tell " + ", nor ".join(said)


def _bare(entry: Entry) -> str:
    """Without coefficients: only which terms they are."""
    return " with ".join(f"{text(expression)} in {row}" for row, expression in entry.parts)


def _effect(terms: Sequence[Term], parent: Structure) -> Effect:
    parts = _parts(terms)
    factors = [factor for _, _, expression in parts for factor in expression]
    signals = {factor.signal for factor in factors} - {*parent.base_.commands, *parent.base_.states}
    sums = _sums(parts, lambda name, expression: f"{name} {text(expression)}")
    redefined = [row for row, _, _ in parts if row in STAGES]

    def equations(s: Signals) -> Mapping[str, Any]:
        found: dict[str, Any] = {row: getattr(s, row) for row in redefined}
        for row, name, expression in parts:
            found[row] = found.get(row, 0.0) + getattr(s, name) * value(expression, s)
        return found

    return Effect(
        id="_".join(["suggested", *dict.fromkeys(name for _, name, _ in parts)]),
        title=_bare(terms[0].entry) + (f" and {len(terms) - 1} more" if len(terms) > 1 else ""),
        group="user",
        equation=", ".join(f"{row} += {written}" for row, written in sums.items()),
        source="found in a residual, not derived",
        signature="as the residual it was found in",
        parameters=tuple(one for term in terms for one in _parameters(term)),
        stage=_stage(terms[0].entry),
        equations=equations,
        channels=tuple(name for name in OWN_CHANNELS if name in signals),
        order=AFTER_OTHERS if redefined or any(factor.signal.endswith("_dot") for factor in factors) else 0.0,
        linear=all(len(expression) == 1 and expression[0].form == "plain" for _, _, expression in parts),
    )


def _parameters(term: Term) -> list[Parameter]:
    entry = term.entry
    made = []
    for name, unit, (row, expression), found in zip(
        entry.names, entry.units, entry.parts, map(float, term.coefficients), strict=True
    ):
        typical = float(f"{found:.3g}")
        widest = float(f"{WIDE * abs(typical):.1g}")
        made.append(
            Parameter(name, unit, f"{row} per {text(expression)}", null=0.0, bounds=(-widest, widest), typical=typical)
        )
    return made


def _sums(parts: Sequence[tuple[str, str, Expression]], write: Callable[[str, Expression], str]) -> dict[str, str]:
    """What is added to each row, every coefficient and its expression as `write` puts them."""
    sums: dict[str, list[str]] = {}
    for row, name, expression in parts:
        sums.setdefault(row, []).append(write(name, expression))
    return {row: " + ".join(written) for row, written in sums.items()}


# ------------------------------------------------------------------------------------------------ the file


def _file(effect: Effect, terms: Sequence[Term], parent: str, runs: int, warning: str | None) -> str:
    best = terms[0]
    told = (
        f"Best of simple terms on what {parent} leaves of {runs} run{'s' * (runs != 1)}: chi squared "
        f"{best.chi_squared:.0f} with {best.degrees} coefficient{'s' * (best.degrees > 1)}. "
        "It says what the residual looks like, not what causes it."
    )
    if warning is not None:
        told += f" {warning[:1].upper()}{warning[1:]}: let physics or another maneuver choose."
    return "\n".join(
        [
            f'"""Suggested by a residual: {effect.title}.',
            "",
            *textwrap.wrap(f'{told}"""', WIDTH),
            "",
            *_imports(terms),
            "",
            "",
            *_equations(_parts(terms)),
            "",
            "",
            *_declaration(effect),
            "",
        ]
    )


def _imports(terms: Sequence[Term]) -> list[str]:
    forms = {factor.form for _, _, expression in _parts(terms) for factor in expression}
    names = ["Effect", "Stage", *(["magnitude"] if "magnitude" in forms else [])]
    lines = ["import numpy as np", ""] if "sign" in forms else []
    return [*lines, f"from sysid.model.effect import {', '.join(names)}", "from sysid.model.parameter import Parameter"]


def _equations(parts: Sequence[tuple[str, str, Expression]]) -> list[str]:
    sums = _sums(parts, lambda name, expression: f"s.{name} * {code(expression)}")
    items = [f'"{row}": {f"s.{row} + " if row in STAGES else ""}{written}' for row, written in sums.items()]
    together = f"    return {{{', '.join(items)}}}"
    if len(together) <= WIDTH:
        return ["def equations(s):", together]
    first, *others = items
    rows = [f"    return {{{first}", *(f"            {item}" for item in others)]
    return ["def equations(s):", ",\n".join(rows) + "}"]


def _declaration(effect: Effect) -> list[str]:
    words = [("id", effect.id), ("group", effect.group), ("title", effect.title), ("equation", effect.equation)]
    words += [("source", effect.source), ("signature", effect.signature)]
    parameters = [
        f'        Parameter("{one.name}", "{one.unit}", "{one.meaning}", null=0.0, '
        f"bounds=({one.bounds[0]:g}, {one.bounds[1]:g}), typical={one.typical:g}),"
        for one in effect.parameters
    ]
    last = [f"stage=Stage.{effect.stage.name}", "equations=equations", f"linear={effect.linear}"]
    if effect.channels:
        last.append("channels=({},)".format(", ".join(f'"{name}"' for name in effect.channels)))
    if effect.order:
        last.append(f"order={effect.order:g}")
    return [
        "EFFECT = Effect(",
        *_packed([_said(name, said) for name, said in words]),
        "    parameters=(",
        *parameters,
        "    ),",
        *_packed(last),
        ")",
    ]


def _said(name: str, words: str) -> str:
    """A keyword with its text, in several pieces where it is long."""
    whole = f'{name}="{words}"'
    if len(whole) < WIDTH - 6:
        return whole
    pieces = textwrap.wrap(words, WIDTH - 12, drop_whitespace=False)
    return "\n        ".join([f"{name}=(", *(f'"{piece}"' for piece in pieces)]) + "\n    )"


def _packed(items: Sequence[str]) -> list[str]:
    """As many arguments on each line as there is room for."""
    lines: list[str] = []
    for item in items:
        if lines and len(lines[-1]) + len(item) + 2 <= WIDTH and "\n" not in lines[-1] + item:
            lines[-1] += f" {item},"
        else:
            lines.append(f"    {item},")
    return lines
