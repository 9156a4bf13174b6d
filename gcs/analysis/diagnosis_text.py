"""A diagnosis and an added effect in words: the answer first, one screen, 78 columns.

What decides the next step stands there: the verdict and how sure it is, what it explains on fitted and on other runs,
the sizes found, one or two reasons, the rivals, what could hide, and the command to type next. The reasons in full, the
harm that each hidden effect would do and why an effect could not be asked follow with `full` only: most people read
them once. The sentences about physics are `sysid.diagnose.explain`'s and its neighbours'; here they are chosen and set.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs.analysis.diagnosis import (
    LEAST_SHARE,
    WORSE_POINTS,
    Addition,
    FitDiagnosis,
    ladder_of,
    placebo_of,
    rival,
    rung_names,
    together,
)
from gcs.analysis.fits import wrapped
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.quantities import amount, listed, plausible_range, quantity
from sysid.diagnose.verdict import EXPLAINED, SURE, Diagnosis
from sysid.fit.result import Fit
from sysid.model.effect import catalogue
from sysid.model.parameter import Parameter

WIDTH = 78
LEFT = 40
"""Columns of what a number is; the numbers follow."""
SHOWN = 6
"""Candidates in the table,"""
SHOWN_FULL = 12
"""and in full."""
REASONS = 2
MARK = "Its mark: "
"""How `sysid.diagnose.explain` begins the sentence on an effect's usual signature."""
NO_CHANGE = 0.1
"""NRMSE points on fitted runs that are next to nothing."""

Nrmse = Mapping[str, float]


# ------------------------------------------------------------------------------------------------ a diagnosis


def diagnosis_text(
    found: FitDiagnosis, fit: str = "FIT.json", rest: str = "", written: str | None = None, *, full: bool = False
) -> str:
    """The answer first, then what it stands on, then the next step.

    fit, rest: the words of the command that asked, for the one to type next; written: where the fit with what was
    found lies, if anywhere.
    """
    last = found.last
    blocks: list[list[str]] = []
    if len(found.rungs) > 1:
        names = rung_names(found.fit.model.structure.base, [one.effects for one in found.rungs])
        rungs = [
            (name, one.nrmse_percent, one.validation_nrmse_percent)
            for name, one in zip(names, found.rungs, strict=True)
        ]
        blocks.append(ladder_text(rungs, last.noise_floor_percent))
    blocks.append(verdict_text(found, reasons=not full))
    blocks.append([line for one in found.comparison.suspicions for line in _set(one.text, " suspicion: ", "   ")])
    if not _trace(last):
        if last.verdict != "complete" and not last.chain:
            blocks.append([line for said in found.comparison.findings for line in _set(said, " ", "   ")])
        blocks.append(candidates_text(last, SHOWN_FULL if full else SHOWN))
    if full:
        blocks.append([f" {line}" for line in found.explanation.lines(WIDTH - 1)])
    blocks.append([*_telling(found, full), *_hidden(found, full), *_untestable(last, full), *_remarks(found)])
    blocks.append(_next_step(found, fit, rest, written))
    if not full:
        blocks[-1] += [" in full: the same with --explain"]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def verdict_text(found: FitDiagnosis, *, reasons: bool = True) -> list[str]:
    """What is missing, how sure that is, how much it explains, and why."""
    last = found.last
    winner = last.winner
    before, floor = last.parent.nrmse_percent, last.noise_floor_percent
    lines = _head(_answer(last), f"confidence {last.confidence:.2f}")
    if winner is None or winner.fit is None or last.verdict == "complete":
        return [
            *lines,
            f"  {'the fit':{LEFT}}p {before['p']:5.1f}   q {before['q']:5.1f} %",
            f"  {'noise alone would allow':{LEFT}}p {floor['p']:5.1f}   q {floor['q']:5.1f} %",
            *_before(found),
        ]
    now = winner.fit.nrmse_percent
    lines += _which(winner)
    lines.append(_row(f"explains {100 * (last.explained_share or 0.0):.0f} % of what can be explained", before, now))
    if winner.validation_nrmse_percent is not None and last.validation_nrmse_percent is not None:
        lines.append(_row("on validation runs", last.validation_nrmse_percent, winner.validation_nrmse_percent))
    lines.append(_row("noise alone would allow", None, floor))
    lines += _sizes(winner)
    lines += _unheld(last)
    lines += _others(last)
    if reasons:
        lines += _why(found)
    return [*lines, *_before(found)]


def _answer(last: Diagnosis) -> str:
    winner = last.winner
    if last.verdict == "complete":
        return "complete: what is left is noise"
    if winner is None or winner.fit is None:
        what = "a trace more than noise is left, too little to be named" if _trace(last) else "no known effect does it"
        return f"unexplained: {what}"
    names = _name(winner)
    same = [_short(one) for one in last.indistinguishable]
    alike = f"  (not to be told from {listed(same)})" if same else ""
    if last.verdict == "missing":
        return "missing: " + (", and then ".join(map(_short, last.chain)) if len(last.chain) == 2 else names) + alike
    if last.stands_in:
        return f"unexplained: {names} would do it, but only at implausible values: it stands in"
    if last.sizes_that_differ:
        return f"unexplained: {names} is nearest, and its size does not hold on the validation runs"
    if (winner.explained_share or 0.0) >= EXPLAINED:
        return f"unexplained: {names} explains the fitted runs, but not the validation runs"
    return f"unexplained: {names} does most, and that is too little"


def _trace(last: Diagnosis) -> bool:
    """Whether what is left is significant and next to nothing: shares of it would be shares of rounding."""
    if last.verdict != "unexplained" or last.chain:
        return False
    return together(last.noise_floor_percent) - together(last.parent.nrmse_percent) < NO_CHANGE


def _head(text: str, sure: str) -> list[str]:
    """The first line, with the confidence at its right end where there is room."""
    lines = _set(text, "", "  ")
    if len(lines[-1]) + len(sure) + 2 > WIDTH:
        lines.append("")
    lines[-1] += sure.rjust(WIDTH - len(lines[-1]))
    return lines


def _set(text: str, first: str = "", rest: str = "") -> list[str]:
    """Sentences to lines; a value stays with its name and its error."""
    for mark in ("=", "±", "→"):
        text = text.replace(f" {mark} ", f"\N{NO-BREAK SPACE}{mark}\N{NO-BREAK SPACE}")
    return [line.replace("\N{NO-BREAK SPACE}", " ") for line in wrapped(text, first, rest)]


def _command(words: str) -> list[str]:
    """What to type next; on several lines in a way that a shell takes."""
    *lines, last = textwrap.wrap(
        f"next: {words}",
        WIDTH - 2,
        initial_indent=" ",
        subsequent_indent="   ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [*(f"{line} \\" for line in lines), last]


def _row(name: str, before: Nrmse | None, now: Nrmse) -> str:
    """NRMSE fit of both outputs, from and to where there is a from."""
    cells = [
        f"{axis} " + (f"{'':8}{now[axis]:5.1f}" if before is None else f"{before[axis]:5.1f} → {now[axis]:5.1f}")
        for axis in ("p", "q")
    ]
    return f"  {_cut(name, LEFT - 1):{LEFT}}{'   '.join(cells)} %"


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1] + "…"


def _short(effect: str) -> str:
    """A catalogue id as it is, a file without its folder."""
    return Path(effect).name


def _name(judged: Ranked) -> str:
    return " + ".join(map(_short, judged.effects))


def _which(winner: Ranked) -> list[str]:
    """What the ids stand for."""
    assert winner.fit is not None
    titles = {one.path or one.id: one.title for one in (*catalogue().values(), *winner.fit.model.structure.composed)}
    said = [titles[name] for name in winner.effects if titles[name] != name]
    return _set(f"which is: {', and '.join(said)}", "  ", "    ") if said else []


def _others(last: Diagnosis) -> list[str]:
    """The NRMSE of what the data cannot tell from the answer, of a near rival, and of the placebo."""
    lines, named = [], {*last.indistinguishable}
    second = rival(last)
    if last.verdict == "missing" and last.confidence < SURE and second is None:
        lines.append(f"  not sure: of 100 answers like this, {100 * last.confidence:.0f} were right where it was known")
    by_name = {one.effect: one for one in last.candidates}
    same = [by_name[name] for name in last.indistinguishable[:1]]
    for word, one in (*(("as well", one) for one in same), ("not sure", second), ("placebo", last.placebo)):
        if one is None or one.fit is None or (word != "as well" and one.effect in named) or last.verdict != "missing":
            continue
        lines.append(_row(f"{word}: {_name(one)} reaches", None, one.fit.nrmse_percent))
        named.add(one.effect)
    return lines


def _sizes(winner: Ranked) -> list[str]:
    assert winner.fit is not None
    parameters = {one.name: one for one in winner.fit.model.structure.parameters}
    lines = []
    for name, value in winner.values.items():
        one = parameters[name]
        said = quantity(one, value, winner.standard_errors.get(name))
        lines += _set(f"{said:{LEFT - 1}} {_judged(one, value)}".rstrip(), "  ", "    ")
    return lines


def _unheld(last: Diagnosis) -> list[str]:
    """The size that two sets of runs put differently."""
    if last.verdict != "unexplained" or not last.sizes_that_differ:
        return []
    one = last.sizes_that_differ[0]
    there = quantity(one.parameter, one.elsewhere, one.elsewhere_error)
    return _set(
        f"the validation runs alone ask for {there}: one vehicle has one {one.parameter.name}, so this only resembles "
        "what is there",
        "  ",
        "    ",
    )


def _judged(one: Parameter, value: float) -> str:
    """What physics says of the size; empty where it says nothing."""
    allowed = plausible_range(one)
    if not one.implausible(value):
        return f"plausible: {allowed}" if allowed else ""
    low, high = one.plausible
    return "implausible: there should be none" if low == high == one.null else f"implausible: physics allows {allowed}"


def _why(found: FitDiagnosis) -> list[str]:
    """What these runs show most plainly, beside the effect's usual mark where that tells more than numbers."""
    winner = found.last.winner
    why = found.explanation.why
    marks = [said.removeprefix(MARK) for said in why if said.startswith(MARK)]
    # the last sentence repeats the NRMSE, which stands above
    shown = [said for said in why if not said.startswith(MARK)][:-1]
    linear = winner is None or winner.fit is None or winner.fit.model.structure.linear
    said = shown[:REASONS] if linear and shown else [*marks[:1], *shown[-1:]]
    if not said:
        return []
    return _set(" ".join([said[0][0].lower() + said[0][1:], *said[1:]]), "  why: ", "    ")


def _before(found: FitDiagnosis) -> list[str]:
    """Values of the fit in question that physics does not allow: a missing effect often shows so."""
    model = found.last.parent.model
    off = [
        f"{quantity(one, float(value))} (physics allows {plausible_range(one)})"
        for one, value in zip(model.structure.parameters, model.values, strict=True)
        if one.implausible(float(value)) and plausible_range(one)
    ]
    return _set(f"implausible in the fit as it is: {', '.join(off)}", "  ", "    ") if off else []


def candidates_text(last: Diagnosis, most: int) -> list[str]:
    """What was refitted, the answer and then the likeliest first: explained share, NRMSE fit, name."""
    winner = last.winner
    asked = sorted(
        (one for one in (*last.candidates, *last.pairs) if one.fit is not None),
        key=lambda one: (one is not winner, one.delta_bic),
    )
    asked = [one for one in asked if one is winner or (one.explained_share or 0.0) >= LEAST_SHARE][:most]
    if not asked:
        return []
    lines = ["  explains  p: fitted valid.  q: fitted valid.  candidates, the answer first"]
    for one in asked:
        assert one.fit is not None
        fitted, valid = one.fit.nrmse_percent, one.validation_nrmse_percent
        numbers = [
            f"{fitted[axis]:8.1f} " + (f"{'-':>6}" if valid is None else f"{valid[axis]:6.1f}") for axis in ("p", "q")
        ]
        mark = "✗" if one.implausible else " "
        share = f"{100 * (one.explained_share or 0.0):4.0f} %"
        lines.append(f" {mark}{share}   {numbers[0]}  {numbers[1]}    {_cut(_name(one), 34)}")
    if any(one.implausible for one in asked):
        lines.append("  ✗ only at values that physics does not allow")
    return lines


def _telling(found: FitDiagnosis, full: bool) -> list[str]:
    """The maneuver that would tell rivals apart, and a simple term where nothing known explains."""
    lines: list[str] = []
    terms = found.last.terms
    if terms is not None and terms.terms and found.last.verdict == "unexplained":
        term = terms.terms[0]
        others = f" ({len(term.as_well)} others do as well)" if term.as_well else ""
        lines += _set(f"a simple term would do much: {term.entry.equation}{others}", " ", "   ")
    if found.next is not None:
        card = "; --card CARD.toml writes that as a test card" if found.next.card is not None else ""
        said = f"to tell {' from '.join(map(_short, found.next.separates))}: {found.next.maneuver}"
        lines += _set(f"{said}{f' ({found.next.why})' if full else ''}{card}", " ", "   ")
    return lines


def _hidden(found: FitDiagnosis, full: bool) -> list[str]:
    """What these runs could not have seen; beside an error that nothing explains, of no use before that is found."""
    if not full and found.last.verdict == "unexplained":
        return []
    if full:
        return [line for said in found.hiding.sentences for line in _set(said, " ", "   ")]
    groups = found.hiding.harmful
    if not groups:
        return [" nothing that could hide here would do harm"] if found.hiding.others else []
    worst, *others = groups
    said = f"could hide here: {worst[0].effect} {worst[0].up_to}, {worst[0].consequences}"
    if others:
        said += f"; also {', '.join(f'{one[0].effect} {one[0].up_to}' for one in others)}"
    return _set(said, " ", "   ")


def _untestable(last: Diagnosis, full: bool) -> list[str]:
    each = [one for one in last.candidates if one.not_testable is not None]
    if not each:
        return []
    if not full:
        return _set(f"not testable here: {', '.join(_short(one.effect) for one in each)}", " ", "   ")
    lines = [" not testable here"]
    for one in each:
        lines += _set(f"{_short(one.effect)}: {one.not_testable}", "   ", "     ")
    return lines


def _remarks(found: FitDiagnosis) -> list[str]:
    return [line for text in found.remarks for line in _set(text, " ", "   ")]


def _next_step(found: FitDiagnosis, fit: str, rest: str, written: str | None) -> list[str]:
    """The command to type next."""
    last = found.last
    again = f" {rest}" if rest else ""
    if last.verdict == "complete" or _trace(last):
        return _command(f"tippath design {written or fit}") if found.fit.model.structure.base == "tpp" else []
    if written is not None:
        return _command(f"tippath compare {written}")
    if last.verdict == "missing" and last.effect is not None:
        return _command(f"tippath add {fit} {last.effect}{again} -o {Path(fit).with_name(Path(fit).stem + '-2.json')}")
    if any(one.kind == "mixed" for one in found.comparison.suspicions):
        return [" next: fit the runs apart, and diagnose each fit"]
    if found.comparison.suspicions:
        return [" next: clear the suspicion, fit, and ask again"]
    if last.stands_in:
        return _command(f"tippath add {fit} {last.effect}{again}")
    return _command(f"tippath diagnose {fit}{again} --suggest term.py")


# ------------------------------------------------------------------------------------------------ an added effect


def addition_text(found: Addition, fit: str = "FIT.json", written: str | None = None) -> str:
    """Whether it helped, the ladder with the placebo, the parameters, the three signs, and the next step."""
    good, answer = _outcome(found)
    rungs, floor = ladder_of(found)
    wrong = placebo_of(found)
    if wrong is not None:
        rungs.append(("placebo", *wrong[1:]))
    blocks = [_set(answer, "", "  "), ladder_text(rungs, floor)]
    blocks[-1] += _placebo_said(found)
    blocks.append(moved_text(found.before, found.after))
    marks = {True: "✓", False: "✗", None: "?"}
    blocks.append(
        [line for one in found.signs for line in _set(f"{one.name}: {one.text}", f" {marks[one.seen]} ", "   ")]
    )
    blocks += [_set(f"warning: {text}", rest="  ") for text in found.after.warnings]
    if not good:
        blocks.append([f" nothing to keep: go on with {_cut(fit, WIDTH - 30)}"])
    elif written is not None:
        blocks.append(_command(f"tippath diagnose {written}"))
    else:
        blocks.append([" next: the same with -o FIT2.json keeps it"])
    return "\n\n".join("\n".join(block) for block in blocks if block)


def _outcome(found: Addition) -> tuple[bool, str]:
    """Whether to keep it, and the first line."""
    name = _short(found.named)
    before, after = found.before.nrmse_percent, found.after.nrmse_percent
    fall = f"{name}: the error falls, p {before['p']:.1f} → {after['p']:.1f}, q {before['q']:.1f} → {after['q']:.1f} %"
    signs = {one.key: one.seen for one in found.signs}
    if together(after) - together(before) < NO_CHANGE:
        return False, f"{name} changes next to nothing here: the error stays as it was"
    was, now = found.before.validation_nrmse_percent, found.after.validation_nrmse_percent
    if was is not None and now is not None and together(now) - together(was) < -WORSE_POINTS:
        return False, f"{fall}, but it grows on runs that were not fitted: it follows the noise of the fitted ones"
    if signs["plausible"] is False:
        return False, f"{fall}, but only at implausible values: {name} stands in for something else"
    if signs["validation"] is False:
        return False, f"{fall}, but not on runs that were not fitted: there is little of it, if anything"
    if signs["validation"] is None:
        return True, f"{fall}; whether it would on other runs is open: name one with --validate"
    return True, f"{fall}, and on runs that were not fitted too"


def _placebo_said(found: Addition) -> list[str]:
    wrong = placebo_of(found)
    if wrong is None:
        return []
    name, other, judged = wrong
    own = found.after.nrmse_percent
    if found.after.validation_nrmse_percent is not None and judged is not None:
        own, other = found.after.validation_nrmse_percent, judged
    beyond = together(own) - together(other)
    what = f"the placebo is {name}, the best other effect with at most as many parameters"
    if beyond > WORSE_POINTS:
        said = f"{what}: mere freedom to follow the data would gain that much"
    else:
        said = f"{what}: it does as well, so that the error falls says little about which of the two it is"
    return _set(said, " ", "   ")


def moved_text(before: Fit, after: Fit) -> list[str]:
    """Parameters with their errors, before and after."""
    lines = [f"  {'parameter':20}{'before':>22}{'after':>26}"]
    known = dict(
        zip(before.model.structure.names, zip(before.model.values, before.standard_errors, strict=True), strict=True)
    )
    for one, value, error in zip(
        after.model.structure.parameters, after.model.values, after.standard_errors, strict=True
    ):
        was = known.get(one.name)
        first = "" if was is None else amount(one, float(was[0]), float(was[1]))
        second = amount(one, float(value), float(error))
        if one.name in after.fixed:
            second += " held"
        elif one.name in after.at_bound:
            second += " at its limit"
        mark = "  implausible" if one.implausible(float(value)) else ""
        lines.append(f"  {one.name:20}{first:>22}{second:>26}{mark}".rstrip())
    return lines


# ------------------------------------------------------------------------------------------------ the ladder


def ladder_text(rungs: Sequence[tuple[str, Any, Any]], floor: Any | None) -> list[str]:
    """(name, fitted NRMSE, validation NRMSE or None) by output, with bars of their mean; at most 78 columns."""
    beside = "" if floor is None else f"noise {floor['p']:.1f} / {floor['q']:.1f}"
    lines = [f"{'ladder':25}p: fitted valid.  q: fitted valid.  {beside}".rstrip()]
    for name, fitted, validated in rungs:
        numbers = [
            f"{fitted[axis]:9.1f} " + (f"{'-':>6}" if validated is None else f"{validated[axis]:6.1f}")
            for axis in ("p", "q")
        ]
        mean = 0.5 * (fitted["p"] + fitted["q"])
        lines.append(f"{_cut(name, 24):25}{numbers[0]}  {numbers[1]}  {bar(mean / 100, 18)}".rstrip())
    return lines


def bar(share: float, width: int = 20) -> str:
    """A bar of eighths, at most `width` long."""
    eighths = round(8 * width * min(max(share, 0.0), 1.0))
    return "█" * (eighths // 8) + " ▏▎▍▌▋▊▉"[eighths % 8].strip()
