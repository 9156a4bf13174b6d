"""The verdict in words: what is missing and how sure that is, how much it explains, the sizes found, and why."""

from __future__ import annotations

from collections.abc import Sequence

from gcs.analysis.diagnosis import FitDiagnosis, rival
from gcs.analysis.ladder import NO_CHANGE, Nrmse, pair_names, short_names, together
from gcs.analysis.quantities import listed, plausible_range, quantity, stands_in
from gcs.analysis.text.blocks import WIDTH, Line, Sentence, broken
from gcs.analysis.text.explanation import shown_text
from gcs.analysis.text.ladder import LEFT, nrmse_row
from gcs.analysis.text.matters import remainder_sentence, slight_sentence, trace_sentence
from gcs.analysis.text.progress import before_pairs_words
from sysid.data.airframe import Airframe
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.shares import least
from sysid.diagnose.thinned import noise_lost
from sysid.diagnose.verdict import SURE, Diagnosis
from sysid.model.effect import catalogue
from sysid.model.parameter import Parameter

REASONS = 2


def answer_lines(last: Diagnosis) -> list[str]:
    """What is missing, with the confidence at the right end where there is room."""
    lines = broken(Sentence(answer(last), "", "  "))
    sure = f"confidence {last.confidence:.2f}"
    if len(lines[-1]) + len(sure) + 2 > WIDTH:
        lines.append("")
    lines[-1] += sure.rjust(WIDTH - len(lines[-1]))
    return lines


def measures(found: FitDiagnosis, *, reasons: bool = True) -> list[Line]:
    """How much it explains on fitted and on other runs, the sizes, what comes near, and why."""
    last = found.last
    winner = last.winner
    before, floor = last.parent.nrmse_percent, last.noise_floor_percent
    if winner is None or winner.fit is None or last.verdict == "complete":
        return [
            *_first(last),
            _numbers("the fit", before),
            _numbers("noise alone would allow", floor),
            *_weighed(found),
            *_left(found),
            *_slight(found),
            *_before(found),
        ]
    share = f"removes {100 * (last.explained_share or 0.0):.0f} % of the avoidable error"
    lines: list[Line] = [
        *_first(last),
        *_which(winner, last.airframe),
        nrmse_row(share, before, winner.fit.nrmse_percent),
        *_by_the_noise(last),
    ]
    if winner.validation_nrmse_percent is not None and last.validation_nrmse_percent is not None:
        lines.append(nrmse_row("on validation runs", last.validation_nrmse_percent, winner.validation_nrmse_percent))
    lines += [nrmse_row("noise alone would allow", None, floor), *_weighed(found), *_slight(found)]
    lines += [*_sizes(winner), *_sizes_that_differ(last), *_others(last)]
    return [*lines, *(_why(found) if reasons else []), *_before(found)]


def _by_the_noise(last: Diagnosis) -> list[Line]:
    """What a name stands on where it removes less error than names need."""
    needed = least(last.division)
    if last.verdict != "missing" or (last.explained_share or 0.0) >= needed:
        return []
    said = (
        f"{100 * needed:.0f} % or more of what noise does not explain, by its spectrum: power alone does not tell here"
    )
    return [Sentence(said, "  ", "    ")]


def _first(last: Diagnosis) -> list[Line]:
    """What was answered before chains of two were searched, where that was another answer."""
    first = last.first
    if first is None or (first.verdict, set(first.chain)) == (last.verdict, {*last.chain}):
        return []
    return [Sentence(before_pairs_words(first), "  ", "    ")]


def _weighed(found: FitDiagnosis) -> list[Line]:
    """Why the fit's own numbers are others, where they are: candidates are compared in equal weights."""
    own, compared = found.fit.nrmse_percent, found.last.parent.nrmse_percent
    if all(round(own[name], 1) == round(value, 1) for name, value in compared.items()):
        return []
    said = ", ".join(f"{name} {value:.1f}" for name, value in own.items())
    text = f"compared with equal weights on all frequencies; the fit itself, weighed by its noise, has {said} %"
    return [Sentence(text, "  ", "    ")]


def stand_ins(last: Diagnosis) -> dict[str, tuple[str, ...]]:
    """Of each effect of the answer, what may stand in its place: of a chain, beside the other one."""
    chain = last.chain
    places: dict[str, list[str]] = {name: [] for name in chain}
    for name in last.not_told:
        places[_place(name, last)].append(name)
    return {name: tuple(others) for name, others in places.items()}


def _place(name: str, last: Diagnosis) -> str:
    """The effect of the answer that another may stand in for; the larger where both change."""
    if len(last.chain) == 1:
        return last.chain[0]
    leader = next((one for one, others in last.equivalent.items() if name in others), name)
    if leader in last.chain:
        return leader
    for pair in last.pairs:
        kept = set(pair.effects) & set(last.chain)
        if leader in pair.effects and len(kept) == 1:
            return next(one for one in last.chain if one not in kept)
    return last.chain[0]


def _alike(others: Sequence[str], gap: str = " ", pairs: Sequence[Sequence[str]] = ()) -> str:
    words = [*short_names(others), *pair_names(pairs)]
    return f"{gap}(not to be told from {listed(words)})" if words else ""


def _beside_the_other(name: str, last: Diagnosis) -> Ranked | None:
    """What stands in an answer's place: of a chain with the half that stays."""
    if len(last.chain) == 1:
        return next((one for one in last.candidates if one.effect == name), None)
    pairs = (one for one in last.pairs if name in one.effects and set(one.effects) & set(last.chain))
    return next(pairs, None)


def _left(found: FitDiagnosis) -> list[Line]:
    left = found.remainder
    return [] if left is None else [Sentence(remainder_sentence(left), "  ", "    ")]


def _slight(found: FitDiagnosis) -> list[Line]:
    if found.slight is None:
        return []
    words = trace_sentence if found.last.verdict == "complete" else slight_sentence
    return [Sentence(words(found.slight), "  ", "    ")]


def _numbers(name: str, percent: Nrmse) -> str:
    return f"  {name:{LEFT}}{'   '.join(f'{output} {value:5.1f}' for output, value in percent.items())} %"


def answer(last: Diagnosis) -> str:
    """The first line, without the confidence."""
    winner = last.winner
    if last.verdict == "complete":
        return f"complete: what is left {'is noise' if last.noise_left else 'and seen does not matter'}"
    if last.reason == "feedback":
        if noise_lost(last.parent.dataset):
            return "unexplained: no excitation is logged, and noise on chirps that the log lost could make it: log both"
        return "unexplained: no excitation is logged, and feedback alone could make what is left: log the excitation"
    if winner is None or winner.fit is None:
        what = "a trace more than noise is left, too little to be named" if a_trace(last) else "no known effect does it"
        return f"unexplained: {what}"
    names = named_effects(winner)
    if last.verdict == "missing":
        places = stand_ins(last)
        if len(last.chain) < 2:
            return f"missing: {names}{_alike(places[last.chain[0]], '  ', last.indistinguishable_pairs)}"
        each = [short_names([name])[0] + _alike(places[name]) for name in last.chain]
        return f"missing: {', and then '.join(each)}"
    if last.stands_in:
        return f"unexplained: {stands_in(names, last.chain, winner.implausible)}"
    if last.sizes_that_differ:
        return f"unexplained: {names} is nearest, and its size does not hold on the validation runs"
    if last.outdone:
        return f"unexplained: {names} is nearest, and more likely only resembles what is there"
    if (winner.explained_share or 0.0) >= least(last.division):
        return f"unexplained: {names} explains the fitted runs, but not the validation runs"
    return f"unexplained: {names} does most, and that is too little"


def a_trace(last: Diagnosis) -> bool:
    """Whether what is left is significant and next to nothing: shares of it would be shares of rounding."""
    if last.verdict != "unexplained" or last.chain:
        return False
    return together(last.noise_floor_percent) - together(last.parent.nrmse_percent) < NO_CHANGE


def _which(winner: Ranked, airframe: Airframe | None) -> list[Line]:
    """What the ids stand for."""
    assert winner.fit is not None
    known = (*catalogue().values(), *winner.fit.model.structure.composed)
    titles = {one.path or one.id: one.worded(airframe).title for one in known}
    said = [titles[name] for name in winner.effects if titles[name] != name]
    return [Sentence(f"which is: {', and '.join(said)}", "  ", "    ")] if said else []


def _others(last: Diagnosis) -> list[Line]:
    """The NRMSE of what the data cannot tell from the answer, of a near rival, and of the placebo."""
    lines: list[Line] = []
    named = {*last.not_told}
    second = rival(last)
    if last.verdict == "missing" and last.confidence < SURE and second is None:
        lines.append(f"  not sure: of 100 answers like this, {100 * last.confidence:.0f} were right where it was known")
    same = [_beside_the_other(name, last) for name in last.indistinguishable[:1]]
    for word, one in (*(("as well", one) for one in same), ("not sure", second), ("placebo", last.placebo)):
        if one is None or one.fit is None or (word != "as well" and one.effect in named) or last.verdict != "missing":
            continue
        lines.append(nrmse_row(f"{word}: {named_effects(one)} reaches", None, one.fit.nrmse_percent))
        named.add(one.effect)
    return lines


def _sizes(winner: Ranked) -> list[Line]:
    assert winner.fit is not None
    parameters = {one.name: one for one in winner.fit.model.structure.parameters}
    lines: list[Line] = []
    for name, value in winner.values.items():
        one = parameters[name]
        said = quantity(one, value, winner.standard_errors.get(name))
        lines.append(Sentence(f"{said:{LEFT - 1}} {_judged(one, name in winner.implausible)}".rstrip(), "  ", "    "))
    return lines


def _sizes_that_differ(last: Diagnosis) -> list[Line]:
    """The size that two sets of runs put differently."""
    if last.verdict != "unexplained" or not last.sizes_that_differ:
        return []
    one = last.sizes_that_differ[0]
    there = quantity(one.parameter, one.elsewhere, one.elsewhere_error)
    said = (
        f"the validation runs alone ask for {there}: one vehicle has one {one.parameter.name}, so this only resembles "
        "what is there"
    )
    return [Sentence(said, "  ", "    ")]


def _judged(one: Parameter, implausible: bool) -> str:
    """What physics says of the size; empty where it says nothing."""
    allowed = plausible_range(one)
    if not implausible:
        return f"plausible: {allowed}" if allowed else ""
    low, high = one.plausible
    return "implausible: there should be none" if low == high == one.null else f"implausible: physics allows {allowed}"


def _why(found: FitDiagnosis) -> list[Line]:
    """What these runs show most plainly, beside the effect's usual mark where that tells more than numbers."""
    winner, why = found.last.winner, found.explanation
    linear = winner is None or winner.fit is None or winner.fit.model.structure.linear
    shown = [shown_text(one) for one in why.shown]
    said = shown[:REASONS] if linear and shown else [*(f"{mark}." for mark in why.marks[:1]), *shown[-1:]]
    if not said:
        return []
    return [Sentence(" ".join([said[0][0].lower() + said[0][1:], *said[1:]]), "  why: ", "    ")]


def _before(found: FitDiagnosis) -> list[Line]:
    """Values of the fit in question that physics does not allow: a missing effect often shows so."""
    parent = found.last.parent
    model = parent.model
    off = [
        f"{quantity(one, float(value))} (physics allows {plausible_range(one)})"
        for one, value in zip(model.structure.parameters, model.values, strict=True)
        if one.implausible(float(value), parent.standard_errors[one.name]) and plausible_range(one)
    ]
    return [Sentence(f"implausible in the fit as it is: {', '.join(off)}", "  ", "    ")] if off else []


def named_effects(judged: Ranked) -> str:
    """`servo_lag + quadratic_damping`."""
    return " + ".join(short_names(judged.effects))
