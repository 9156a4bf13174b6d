"""What the diagnosis of a rung found, as parts of a page: of its document, kept or made just now."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from gcs.analysis.ladder import pair_names, short_names
from gcs.analysis.pages.diagnosis import DRAWN, diagnosis_picture
from gcs.analysis.pages.parts import Facts, Part, Picture, Sentences, Table
from gcs.analysis.pages.pictures import PAGE_WIDTH
from gcs.analysis.quantities import amount, listed, stands_in
from gcs.logs.words import printable
from sysid.compare.values import Densities
from sysid.diagnose.candidates import SIGNIFICANT
from sysid.document import Open, converted
from sysid.model.effect import catalogue

SHOWN = 0.005
"""Explained share that rounds to more than 0 %: less is not shown."""
IN_TABLE = 8
Percent = Mapping[str, float | None]


class _Candidate(Open, frozen=True, kw_only=True):
    effect: str
    """Of a chain both, `+` between them."""
    explained_share: float | None = None
    delta_bic: float | None = None
    nrmse_percent: dict[str, float | None] | None = None
    validation_nrmse_percent: dict[str, float | None] | None = None
    parameters: dict[str, float | None] = {}
    standard_errors: dict[str, float | None] = {}
    implausible_parameters: tuple[str, ...] = ()

    @property
    def chain(self) -> tuple[str, ...]:
        return tuple(self.effect.split("+"))


class _Explanation(Open, frozen=True, kw_only=True):
    what: tuple[str, ...] = ()
    why: tuple[str, ...] = ()
    changes: tuple[str, ...] = ()
    resembles: tuple[str, ...] = ()


class _Next(Open, frozen=True, kw_only=True):
    maneuver: str
    separates: tuple[str, ...] = ()
    why: str = ""


class _Character(Open, frozen=True, kw_only=True):
    findings: tuple[str, ...] = ()


class Told(Open, frozen=True, kw_only=True):
    """What a page needs of a `tippath.diagnosis/1` document."""

    verdict: str
    chain: tuple[str, ...] = ()
    stands_in: bool = False
    indistinguishable: tuple[str, ...] = ()
    indistinguishable_pairs: tuple[tuple[str, ...], ...] = ()
    equivalent: dict[str, tuple[str, ...]] = {}
    confidence: float | None = None
    explained_share: float | None = None
    needed_share: float | None = None
    candidates: tuple[_Candidate, ...] = ()
    pairs: tuple[_Candidate, ...] = ()
    placebo: str | None = None
    noise_floor_percent: dict[str, float] | None = None
    reason: str | None = None
    log10_chance: float | None = None
    explanation: _Explanation | None = None
    character: _Character = _Character()
    beyond: tuple[str, ...] = ()
    """What it may be that the catalogue does not have."""
    could_hide: tuple[str, ...] = ()
    next_maneuver: _Next | None = None
    warnings: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def only_noise(self) -> bool:
        """Whether it is complete because nothing that is left is more than noise."""
        chance = self.log10_chance
        return self.verdict == "complete" and chance is not None and chance * math.log(10) >= SIGNIFICANT

    @property
    def _outside(self) -> tuple[str, ...]:
        """Parameters of the answer that physics does not allow."""
        found = (one for one in (*self.candidates, *self.pairs) if set(one.chain) == set(self.chain))
        return next((one.implausible_parameters for one in found), ())

    @property
    def answer(self) -> str:
        """`missing: servo_lag (not to be told from gyro_lag), confidence 0.99`."""
        names = printable(listed(short_names(self.chain))) if self.chain else ""
        same = (*self.indistinguishable, *(name for others in self.equivalent.values() for name in others))
        alike = [*short_names(tuple(dict.fromkeys(same))), *pair_names(self.indistinguishable_pairs)]
        alike = [printable(name) for name in alike]
        sure = "" if self.confidence is None else f", confidence {self.confidence:.2f}"
        if self.verdict == "complete":
            return f"complete: what is left {'is noise' if self.only_noise else 'and seen does not matter'}{sure}"
        if self.verdict == "missing":
            return f"missing: {names}{f' (not to be told from {listed(alike)})' if alike else ''}{sure}"
        if self.stands_in:
            return f"unexplained: {stands_in(names, self.chain, self._outside)}{sure}"
        because = " (feedback alone could make what is left)" if self.reason == "feedback" else ""
        return f"unexplained: what is left is more than noise, and no known effect is it{because}{sure}"


def told(document: Any) -> Told | None:
    """None of what is no such document."""
    try:
        return converted(document, Told)
    except ValueError:
        return None


def discovery(found: Told, parent: Densities, best: Densities | None, outputs: Sequence[str]) -> list[Part]:
    """The answer, what each candidate explains, the residual before and with the best, and why.

    parent, best: spectra of the residual of the rung, and with what it lacks added (None where that is not known).
    """
    # of noise nothing is told: what seems to follow something in it does so by chance
    findings = () if found.only_noise else found.character.findings
    parts: list[Part] = [Sentences((f"{_capital(found.answer)}.", *(_ended(printable(one)) for one in findings)))]
    best_first = _ranked(found)
    if best_first and found.verdict != "complete":
        bars = [
            (_named(one.chain), one.explained_share, _note(one))
            for one in best_first[:DRAWN]
            if one.chain == found.chain or (one.explained_share or 0.0) >= SHOWN
        ]
        name = _named(found.chain)
        with_it = f"with {name}" if name else "with the best"
        needed = found.needed_share if 0 < (found.needed_share or 0.0) <= 1 else None  # a file may say anything
        figure = diagnosis_picture(bars, parent, best, with_it, outputs=outputs, width=PAGE_WIDTH, needed=needed)
        shown = "" if best is None else f", and {with_it} (dashed)"
        parts.append(
            Picture(
                figure,
                "Above: the share of the avoidable error that each candidate removes; empty bars are implausible, or "
                f"have another note. Below: amplitude spectrum of the residual now{shown}, over the noise (grey).",
            )
        )
        parts.append(_table(best_first[:IN_TABLE], outputs))
    for heading, sentences in _reasons(found):
        if sentences:
            parts.append(Facts(((heading, " ".join(_ended(printable(one)) for one in sentences)),)))
    return parts


def _ranked(found: Told) -> list[_Candidate]:
    """Those that were refitted; the answer first, then what explains most."""
    each = [one for one in (*found.pairs[:1], *found.candidates) if one.explained_share is not None]
    return sorted(each, key=lambda one: (one.chain != found.chain, -(one.explained_share or 0.0)))


def _reasons(found: Told) -> list[tuple[str, tuple[str, ...]]]:
    why = found.explanation or _Explanation()
    plan = found.next_maneuver
    return [
        ("what it is", why.what if found.chain else ()),
        ("why", why.why),
        ("what it changes", why.changes),
        ("what resembles it", why.resembles),
        ("beyond the catalogue", found.beyond),
        ("could hide here", found.could_hide),
        ("would tell more", () if plan is None else (f"{plan.maneuver}: {plan.why}" if plan.why else plan.maneuver,)),
        ("to be known", (*found.warnings, *found.remarks)),
    ]


def _table(candidates: Sequence[_Candidate], outputs: Sequence[str]) -> Table:
    judging = outputs if any(one.validation_nrmse_percent for one in candidates) else ()
    head = ("candidate", "removes", *(f"{name}, %" for name in outputs), *(f"{name} valid." for name in judging))
    rows = [
        (
            _named(one.chain),
            f"{100 * (one.explained_share or 0.0):.0f} %",
            *(_percent(one.nrmse_percent, name) for name in outputs),
            *(_percent(one.validation_nrmse_percent, name) for name in judging),
            _sizes(one),
        )
        for one in candidates
    ]
    runs = "fitted and on validation runs" if judging else "the fitted runs"
    return Table(
        f"Candidates, the likeliest first: the avoidable error that each removes, NRMSE fit on {runs}, and its size.",
        (*head, "size"),
        tuple(rows),
        words=(0, len(head)),
    )


def _sizes(one: _Candidate) -> str:
    """`tau_s = 22.1 ± 0.7 ms`, in the catalogue's units."""
    effects = [catalogue().get(name) for name in one.chain]  # a file of the user's is code, which nobody named
    known = {parameter.name: parameter for effect in effects if effect is not None for parameter in effect.parameters}
    said = []
    for name, value in one.parameters.items():
        if value is None:
            continue
        error = one.standard_errors.get(name)
        if name in known:
            said.append(f"{name} = {amount(known[name], value, error)}")
        else:
            said.append(printable(f"{name} = {value:.3g}"))
    return ", ".join(said) + (" (implausible)" if one.implausible_parameters else "")


def _note(one: _Candidate) -> str:
    names = ", ".join(one.implausible_parameters)
    return printable(f"implausible: {names}") if names else ""


def _named(chain: Sequence[str]) -> str:
    return printable(" + ".join(short_names(chain)))


def _percent(values: Percent | None, name: str) -> str:
    value = None if values is None else values.get(name)
    return "" if value is None else f"{value:.1f}"


def _ended(text: str) -> str:
    return text if text.endswith((".", "!", "?", ":")) else f"{text}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
