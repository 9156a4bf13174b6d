"""What a diagnosis answered, as screens show it: of one that was just made, or of the document that is kept beside a
fit.

A kept answer is believed where it is of this fit (by the digest of its numbers and of its runs' logs) and was asked as
this version asks by itself: every entry of the catalogue, with the usual limits. Else the question is asked again.
"""

from __future__ import annotations

import math
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import msgspec

from gcs.analysis.candidates import ranked, shows
from gcs.analysis.diagnosis import FitDiagnosis
from gcs.analysis.quantities import quantity
from gcs.analysis.standing import diagnosis_beside
from gcs.analysis.text.blocks import Block, Blocks
from gcs.analysis.text.diagnosis import diagnosis_blocks
from gcs.analysis.text.hidden import hidden_sentences
from gcs.analysis.text.maneuvers import how_text, maneuver_text, why_text
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.proposals import FitRuns
from sysid.document import Open, converted
from sysid.fit.result import Fit, finite

MOST = 12
"""Candidates that are shown."""
TO_TYPE = ("next", "in full")
"""Blocks on what to type next in a shell, which is another thing on each face."""


class Row(Open, frozen=True, kw_only=True):
    """One candidate."""

    effects: tuple[str, ...]
    share: float | None
    """Of what can be explained; None where it is not testable."""
    nrmse_percent: dict[str, float] | None = None
    validation_nrmse_percent: dict[str, float] | None = None
    sizes: tuple[str, ...] = ()
    """`tau_s = 22.1 ± 0.7 ms`."""
    implausible: tuple[str, ...] = ()
    not_testable: str = ""


class Plan(Open, frozen=True, kw_only=True):
    """The maneuver that would tell more."""

    separates: tuple[str, ...]
    maneuver: str
    why: str
    how: str = ""
    """Where no card holds it."""
    card: str | None = None
    """TOML."""
    fit_runs: tuple[str, ...] = ()
    """Where nothing is to be flown: runs to be fitted that only judged."""


class Answer(Open, frozen=True, kw_only=True):
    """All that is shown of a diagnosis."""

    verdict: str
    chain: tuple[str, ...]
    effect: str | None
    confidence: float
    nrmse_percent: dict[str, float]
    """Of the fit that was asked, in the weights of the question;"""
    noise_floor_percent: dict[str, float]
    candidates: tuple[Row, ...]
    """The answer first, then what explains most, then those that could not be asked."""
    brief: tuple[Block, ...]
    full: tuple[Block, ...]
    plan: Plan | None
    hiding: tuple[str, ...]
    validation_nrmse_percent: dict[str, float] | None = None
    """of the same, on runs that were not fitted."""
    matters: bool | None = None
    """Whether what is left, seen or not, could; None where no loop tells, or something is missing by name."""
    noise_left: bool = True
    """Whether nothing is seen to be left but noise."""

    @property
    def missing(self) -> str:
        """The effect to add; empty where none is missing by name."""
        return self.effect or "" if self.verdict == "missing" else ""


def answer_of(found: FitDiagnosis) -> Answer:
    """Of a diagnosis that was just made."""
    last = found.last
    refitted = [_row(one) for one in ranked(last)[:MOST] if shows(one, last)]
    left = [one for one in last.candidates if one.not_testable is not None and not one.not_offered]
    unasked = [Row(effects=one.effects, share=None, not_testable=one.not_testable or "") for one in left]
    return Answer(
        verdict=last.verdict,
        chain=last.chain,
        effect=last.effect,
        confidence=finite(last.confidence) or 0.0,
        nrmse_percent=_percent(last.parent.nrmse_percent) or {},
        noise_floor_percent=_percent(last.noise_floor_percent) or {},
        candidates=(*refitted, *unasked),
        brief=_untyped(diagnosis_blocks(found)),
        full=_untyped(diagnosis_blocks(found, full=True)),
        plan=_plan(found),
        hiding=hidden_sentences(found.hiding),
        validation_nrmse_percent=_percent(last.validation_nrmse_percent),
        matters=None if found.remainder is None else found.remainder.matters,
        noise_left=last.noise_left,
    )


def shown_document(found: FitDiagnosis) -> dict[str, Any]:
    """`shown` and `asked`: what a diagnosis's document holds for who opens the flight again."""
    asked = {"version": version(), "as_usual": found.as_usual, "fixed": _fixed(found.fit)}
    return {"shown": msgspec.to_builtins(answer_of(found)), "asked": asked}


def kept_answer(folder: Path, fit: Fit) -> Answer | None:
    """The newest answer about a fit that a folder holds; None where there is none, or none that is to be believed."""
    document = diagnosis_beside(folder, fit)
    return None if document is None or not as_asked_now(document, fit) else _shown(document)


def as_asked_now(document: dict[str, Any], fit: Fit) -> bool:
    """Whether a kept diagnosis was asked as this version asks by itself, with the fit's values held that are."""
    try:
        asked = converted(document, _Document).asked
    except ValueError:
        return False
    if asked is None or not asked.as_usual:
        return False
    return asked.version == version() and asked.fixed == _fixed(fit)


def _shown(document: dict[str, Any]) -> Answer | None:
    try:
        return converted(document, _Kept).shown
    except ValueError:
        return None


class _Asked(Open, frozen=True, kw_only=True):
    version: str
    as_usual: bool
    fixed: dict[str, float]


class _Document(Open, frozen=True, kw_only=True):
    asked: _Asked | None = None


class _Kept(Open, frozen=True, kw_only=True):
    shown: Answer | None = None


def _fixed(fit: Fit) -> dict[str, float]:
    """Values that were held: the digest has them among all the others."""
    return {name: float(fit.model[name]) for name in fit.fixed}


@cache
def version() -> str:
    """Of this program."""
    return metadata.version("tippath")


def _row(one: Ranked) -> Row:
    parameters = [parameter for effect in one.own for parameter in effect.parameters]
    values, errors = one.values, one.standard_errors
    sizes = [
        quantity(parameter, values[parameter.name], errors.get(parameter.name))
        for parameter in parameters
        if parameter.name in values
    ]
    return Row(
        effects=one.effects,
        share=finite(one.explained_share or 0.0) or 0.0,
        nrmse_percent=None if one.fit is None else _percent(one.fit.nrmse_percent),
        validation_nrmse_percent=_percent(one.validation_nrmse_percent),
        sizes=tuple(sizes),
        implausible=one.implausible,
    )


def _percent(values: Any) -> dict[str, float] | None:
    """None where a number is missing: JSON has no other word."""
    if values is None or not all(math.isfinite(value) for value in values.values()):
        return None
    return {name: float(value) for name, value in values.items()}


def _untyped(blocks: Blocks) -> Blocks:
    return tuple(one for one in blocks if one.key not in TO_TYPE and one.lines)


def _plan(found: FitDiagnosis) -> Plan | None:
    plan = found.next
    if plan is None:
        return None
    how = how_text(plan.proposal, found.runs.records) if plan.card is None else None
    return Plan(
        separates=tuple(plan.separates),
        maneuver=maneuver_text(plan),
        why=why_text(plan.why),
        how=how or "",
        card=plan.toml,
        fit_runs=plan.proposal.runs if isinstance(plan.proposal, FitRuns) else (),
    )
