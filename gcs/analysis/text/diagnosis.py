"""A diagnosis in words: the answer first, one screen, 78 columns.

What decides the next step stands there: the verdict and how sure it is, what it explains on fitted and on other runs,
the sizes found, one or two reasons, the rivals, what could hide, and the command to type next. The reasons in full, the
harm that each hidden effect would do and why an effect could not be asked follow with `full` only: most people read
them once. The sentences about physics are in `explanation` and its neighbours; here they are chosen and set.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

from gcs.analysis.candidates import ranked, shows
from gcs.analysis.diagnosis import ClocksDiffer, FitDiagnosis, InALoop
from gcs.analysis.ladder import rungs_of, short_names
from gcs.analysis.text.beyond import beyond_sentences
from gcs.analysis.text.blocks import WIDTH, Blocks, Line, Sentence, block, command, text_of
from gcs.analysis.text.explanation import explanation_lines
from gcs.analysis.text.findings import finding_sentence, suspicion_text
from gcs.analysis.text.hidden import consequences, hidden_sentences, up_to
from gcs.analysis.text.ladder import cut, ladder_text
from gcs.analysis.text.maneuvers import how_text, maneuver_text, why_text
from gcs.analysis.text.remarks import remark_sentence
from gcs.analysis.text.verdict import a_trace, answer_lines, measures, named_effects
from sysid.control.regulator import designs_on
from sysid.data.airframe import Airframe
from sysid.data.record import Record
from sysid.diagnose.next_maneuver import NextManeuver
from sysid.diagnose.proposals import FitRuns
from sysid.diagnose.verdict import Diagnosis

SHOWN = 6
"""Candidates in the table,"""
SHOWN_FULL = 12
"""and in full."""


def diagnosis_text(
    found: FitDiagnosis, fit: str = "FIT.json", rest: str = "", written: str | None = None, *, full: bool = False
) -> str:
    """All of it for a shell; 78 columns."""
    return text_of(diagnosis_blocks(found, fit, rest, written, full=full))


def diagnosis_blocks(
    found: FitDiagnosis, fit: str = "FIT.json", rest: str = "", written: str | None = None, *, full: bool = False
) -> Blocks:
    """`ladder`, `answer`, `measures`, `suspicions`, `findings`, `candidates`, with full `reasons`, then `beside` and
    what to type: `next` and, unless full, `in full`. A block may have no lines.

    fit, rest: the words of the command that asked, for the one to type next; written: where the fit with what was
    found lies, if anywhere.
    """
    last = found.last
    trace = a_trace(last)
    nameless = not trace and last.verdict != "complete" and not last.chain
    rungs = rungs_of(found.fit.model.structure.base_, found.rungs) if len(found.rungs) > 1 else []
    suspicions = [Sentence(suspicion_text(one), " suspicion: ", "   ") for one in found.comparison.suspicions]
    findings = [finding_sentence(one, " ", "   ") for one in found.comparison.findings] if nameless else []
    reasons = [f" {line}" for line in explanation_lines(found.explanation, WIDTH - 1)] if full else []
    beside = [*_telling(found, full), *_hidden(found, full), *_untestable(last, full), *_remarks(found)]
    step = _next_step(found, fit, rest, written)
    return (
        block("ladder", ladder_text(rungs, last.noise_floor_percent) if rungs else []),
        block("answer", [*answer_lines(last), *_clocks(found)]),
        block("measures", measures(found, reasons=not full), joined=True),
        block("suspicions", suspicions),
        block("findings", findings),
        block("candidates", [] if trace else candidates_text(last, SHOWN_FULL if full else SHOWN)),
        block("reasons", reasons),
        block("beside", beside),
        block("next", step),
        block("in full", [] if full else [" in full: the same with --explain"], joined=bool(step)),
    )


def candidates_text(last: Diagnosis, most: int) -> list[str]:
    """What was refitted, the answer and then what explains most: explained share, NRMSE fit, name."""
    asked = [one for one in ranked(last) if shows(one, last)][:most]
    if not asked:
        return []
    outputs = last.parent.model.structure.outputs
    lines = [f"  explains  {'  '.join(f'{name}: fitted valid.' for name in outputs)}  candidates, the answer first"]
    for one in asked:
        assert one.fit is not None
        fitted, valid = one.fit.nrmse_percent, one.validation_nrmse_percent
        numbers = [
            f"{fitted[axis]:8.1f} " + (f"{'-':>6}" if valid is None else f"{valid[axis]:6.1f}") for axis in outputs
        ]
        mark = "✗" if one.implausible else " "
        share = f"{100 * (one.explained_share or 0.0):4.0f} %"
        row = f" {mark}{share}   {'  '.join(numbers)}    "
        lines.append(row + cut(named_effects(one), max(20, WIDTH - len(row))))
    if any(one.implausible for one in asked):
        lines.append("  ✗ only at values that physics does not allow")
    return lines


def _telling(found: FitDiagnosis, full: bool) -> list[Line]:
    """The maneuver that would tell rivals apart, and a simple term where nothing known explains."""
    lines: list[Line] = [Sentence(text, " ", "   ") for text in beyond_sentences(found.last)]
    if found.next is not None:
        told = f"to tell {' from '.join(short_names(found.next.separates))}: {maneuver_text(found.next)}"
        why = f" ({why_text(found.next.why)})" if full else ""
        lines.append(Sentence(told + why, " ", "   ", offer=_offer(found.next)))
        how = None if found.next.card is not None else how_text(found.next.proposal, found.runs.records)
        lines += [] if how is None else [Sentence(f"how: {how}", "   ", "     ")]
    return lines


def _offer(plan: NextManeuver) -> str:
    if isinstance(plan.proposal, FitRuns):
        return "fit runs"
    return "" if plan.card is None else "card"


def _hidden(found: FitDiagnosis, full: bool) -> list[Line]:
    """What these runs could not have seen; beside an error that nothing explains, of no use before that is found."""
    if not full and found.last.verdict == "unexplained":
        return []
    if full:
        return [Sentence(text, " ", "   ") for text in hidden_sentences(found.hiding)]
    groups = found.hiding.harmful
    if not groups:
        return [" nothing that could hide here would do harm"] if found.hiding.others else []
    worst, *others = groups
    said = f"could hide here: {worst[0].effect} {up_to(worst[0])}, {consequences(worst[0])}"
    if others:
        said += f"; also {', '.join(f'{one[0].effect} {up_to(one[0])}' for one in others)}"
    return [Sentence(said, " ", "   ")]


def _untestable(last: Diagnosis, full: bool) -> list[Line]:
    each = [one for one in last.candidates if one.not_testable is not None and not one.not_offered]
    elsewhere = _not_offered(last)
    if not each:
        return elsewhere
    if not full:
        names = short_names([one.effect for one in each])
        return [Sentence(f"not testable here: {', '.join(names)}", " ", "   "), *elsewhere]
    why = [Sentence(f"{Path(one.effect).name}: {one.not_testable}", "   ", "     ") for one in each]
    return [" not testable here", *why, *elsewhere]


def _not_offered(last: Diagnosis) -> list[Line]:
    """How much of the catalogue this airframe or this axis cannot have: what that is would only fill the page."""
    count = sum(one.not_offered for one in last.candidates)
    if not count:
        return []
    effects = "1 effect" if count == 1 else f"{count} effects"
    axes = last.parent.model.structure.base_.axes
    why = [f"that a {last.airframe} cannot have"] if last.airframe is Airframe.MULTIROTOR else []
    why += [f"of more than {axes[0]}"] if len(axes) == 1 else []
    return [Sentence(f"not asked: {effects} {' or '.join(why)}; --json names them", " ", "   ")]


def _remarks(found: FitDiagnosis) -> list[Line]:
    return [remark_sentence(one, " ", "   ") for one in found.remarks if not isinstance(one, ClocksDiffer)]


def _clocks(found: FitDiagnosis) -> list[Line]:
    return [remark_sentence(one, "  but ", "    ") for one in found.remarks if isinstance(one, ClocksDiffer)]


def next_file(fit: str) -> str:
    """`tpp-2.json` behind `tpp.json`, `tpp-3.json` behind that: a rung higher."""
    stem, mark, number = Path(fit).stem.rpartition("-")
    name = f"{stem}-{int(number) + 1}" if mark and re.fullmatch("[1-9][0-9]?", number) else f"{Path(fit).stem}-2"
    return str(Path(fit).with_name(f"{name}.json"))


def _next_step(found: FitDiagnosis, fit: str, rest: str, written: str | None) -> list[Line]:
    """The command to type next."""
    again = f" {rest}" if rest else ""
    if found.next is not None and isinstance(found.next.proposal, FitRuns) and not rest:
        return [*_one_step(found, fit, again, written), *_with_runs(found, found.next.proposal, fit)]
    return _one_step(found, fit, again, written)


def _with_runs(found: FitDiagnosis, proposal: FitRuns, fit: str) -> list[str]:
    """The same question on more runs."""
    judging = () if found.last.validation is None else found.last.validation.records
    runs = [*found.runs.records, *(one for one in judging if one.id in proposal.runs)]
    rest = [one for one in judging if one.id not in proposal.runs]
    words = [fit, *map(_word, runs), *(["--validate"] if rest else []), *map(_word, rest)]
    return command(f"tippath diagnose {' '.join(words)}", "or: ")


def _word(run: Record) -> str:
    """As a command names it."""
    _, mark, number = run.id.rpartition("#")
    path = shlex.quote(run.path)
    return f"{path}#{number}" if mark else path


def _one_step(found: FitDiagnosis, fit: str, again: str, written: str | None) -> list[Line]:
    last = found.last
    if last.verdict == "complete" or a_trace(last):
        return [*command(f"tippath design {written or fit}")] if designs_on(found.fit.model.structure) else []
    if written is not None:
        return [*command(f"tippath compare {written}")]
    if last.verdict == "missing" and last.effect is not None:
        add = f"tippath add {fit} {last.effect}{again} -o {next_file(fit)}"
        if any(isinstance(one, InALoop) for one in found.remarks):
            words = "fly a chirp with noise on every axis, with the excitation logged, and fit that; as it is:"
            return [Sentence(words, " next: ", "   "), f"   {add}"]
        return [*command(add)]
    if any(one.kind == "mixed" for one in found.comparison.suspicions):
        return [" next: fit the runs apart, and diagnose each fit"]
    if found.comparison.suspicions:
        return [" next: clear the suspicion, fit, and ask again"]
    if last.stands_in:
        return [*command(f"tippath add {fit} {last.effect}{again}")]
    return [*command(f"tippath diagnose {fit}{again} --suggest term.py")]
