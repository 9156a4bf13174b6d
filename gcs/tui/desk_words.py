"""What lies on the desk, as lines: runs, fit, comparison, diagnosis, ladder, gains, report. Pure, as `words`.

The texts of tables and findings are the commands' own; here they are chosen, put in order and made harmless.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from textual.style import Style as TextStyle

from gcs.analysis.ladder import short_names
from gcs.analysis.text.blocks import Blocks, spaced
from gcs.analysis.text.findings import finding_text, suspicion_text
from gcs.desk.state import DeskState, Nrmse, Rung
from gcs.link.decode import sanitise
from gcs.tui.next_step import chosen_anew, full_name
from gcs.tui.ranking_words import unanswered
from gcs.tui.state import State
from gcs.tui.words import fitted, sanitise_line, wrapped

if TYPE_CHECKING:
    from gcs.analysis.answer import Answer

Line = str | tuple[str, str | TextStyle]

FIT_RUNS = "3, then F marks them, and 4, then F fits again"
KEYS = {
    "card": "; W writes that as a test card",
    "fit runs": f"; {FIT_RUNS}",
    "validate some": "; 3, then V marks some, and 4, then F fits again",
    "validate one": "; 3, then V marks one, and 4, then F fits again",
}
"""What the app offers where a shell offers an option."""
TO_TYPE = ("next", "in full")
"""Blocks on what to type next: those are keys here."""


def flight_line(state: State, width: int) -> tuple[str, str]:
    """What is open."""
    desk = state.desk
    if desk.path is None:
        return (" no flight is open", "bold")
    text = f" {sanitise(desk.opened)}"
    if desk.name:
        text += f" · {sanitise(desk.name)}"
    if desk.vehicle:
        text += f" · {sanitise(desk.vehicle)}"
    if desk.home is not None and desk.home != desk.path and desk.home != desk.path.parent:
        text += f" · results in {sanitise(str(desk.home))}"
    return (fitted(text, width), "bold")


def broken(lines: Sequence[Line], width: int) -> list[Line]:
    """Every line broken to the width, made harmless."""
    found: list[Line] = []
    for line in lines:
        text, style = (line, "") if isinstance(line, str) else line
        found += [(piece, style) if style else piece for piece in wrapped(sanitise_line(text), width)]
    return found


# ------------------------------------------------------------------------------------------------ fit


def fit_title(state: State, width: int) -> tuple[str, str]:
    """The flight, the base, and whether the fit is of what is chosen now."""
    desk = state.desk
    if desk.path is None:
        return flight_line(state, width)
    text = f" {sanitise(desk.opened)} · base {sanitise(desk.base.words)}"
    if desk.current is not None:
        percent = desk.current.nrmse_percent
        text += f" · {full_name(desk)}: NRMSE p {percent['p']:.1f}  q {percent['q']:.1f} %"
    if chosen_anew(desk):
        text += " · OF OTHER RUNS OR BASE THAN CHOSEN NOW"
    return (fitted(text, width), "bold")


# ------------------------------------------------------------------------------------------------ comparison


def compare_lines(desk: DeskState, width: int, *, full: bool = True) -> list[Line]:
    """Findings first; with `full` the tables."""
    rung = desk.current
    if rung is None:
        return ["", " no fit yet"]
    found = rung.comparison
    if found is None:
        return ["", f" {full_name(desk)} was not compared with its runs yet"]
    lines: list[Line] = [(f" suspicion: {suspicion_text(one)}", "bold") for one in found.suspicions]
    lines += [f" {finding_text(one, KEYS)}" for one in found.findings] or [
        " nothing to tell: what is left looks like noise"
    ]
    if full:
        lines += ["", *indented(spaced(rung.comparison_text, KEYS, but=("findings",)))]  # those stand above
    return broken(lines, width)


# ------------------------------------------------------------------------------------------------ diagnosis


def verdict_lines(desk: DeskState, width: int) -> list[Line]:
    """The command's answer, less what to type next: that is a key here."""
    rung = desk.current
    if rung is None:
        return ["", " no fit yet"]
    if rung.answer is None:
        return broken(unanswered(desk), width)
    head, rest = _parted(rung.answer.brief, ("answer",))
    answer: list[Line] = [(line, "bold") for line in indented(spaced(head, KEYS))]
    return broken([*answer, *indented(spaced(rest, KEYS, but=TO_TYPE))], width)


def explained_lines(rung: Rung, width: int) -> list[Line]:
    """All reasons: they were asked for, and come right behind the answer."""
    if rung.answer is None:
        return ["", " not diagnosed yet"]
    head, rest = _parted(rung.answer.full, ("answer", "reasons"))
    return broken(indented([*spaced(head, KEYS), "", *spaced(rest, KEYS, but=TO_TYPE)]), width)


def _parted(blocks: Blocks, keys: Collection[str]) -> tuple[Blocks, Blocks]:
    """The blocks of these keys, and the others."""
    return tuple(one for one in blocks if one.key in keys), tuple(one for one in blocks if one.key not in keys)


def indented(lines: Sequence[str]) -> list[str]:
    """A blank before each."""
    return [f" {line}" for line in lines]


def candidates(found: Answer | None) -> list[tuple[str, float | None, str]]:
    """(name, explained share or None where not testable, note): the answer first, then the likeliest."""
    rows = () if found is None else found.candidates
    return [(short_name(one.effects), one.share, "implausible" if one.implausible else "") for one in rows]


def short_name(effects: Sequence[str]) -> str:
    """Files without their folder."""
    return sanitise(" + ".join(short_names(effects)))


# ------------------------------------------------------------------------------------------------ the ladder


def ladder_title(desk: DeskState, width: int) -> tuple[str, str]:
    """The top rung: fitted, on other runs, and what noise allows."""
    rung = desk.current
    if rung is None:
        return (" no fit yet", "bold")
    text = f" {full_name(desk)}   fitted {pair(rung.nrmse_percent)}"
    if rung.validation_nrmse_percent is not None:
        text += f"   valid. {pair(rung.validation_nrmse_percent)}"
    if desk.noise_floor_percent is not None:
        text += f"   noise {pair(desk.noise_floor_percent)}"
    return (fitted(text, width), "bold")


def pair(percent: Nrmse) -> str:
    """`64.1 / 70.9`."""
    return f"{percent['p']:.1f} / {percent['q']:.1f}"


# ------------------------------------------------------------------------------------------------ report


def report_lines(state: State, audit: Sequence[str], width: int) -> list[Line]:
    """Where the page is, what was done, and the commands that do it again."""
    desk = state.desk
    lines: list[Line] = []
    if desk.report is not None:
        paper = " P writes it anew, and as PDF for paper" if desk.printed is None else f" for paper: {desk.printed}"
        lines += [(f" the page: {desk.report}", "bold"), paper]
    elif desk.path is not None:
        lines += [" no page is written yet"]
    if desk.home is not None:
        lines.append(f" results are kept in {desk.home}")
    if desk.unkept:
        lines.append((f" NOT KEPT: {', '.join(desk.unkept)}", "bold"))
    commands = state.commands or desk.commands
    lines += ["", (" the same in a shell, oldest first", "underline")]
    lines += [f"   {command}" for command in commands] or ["   nothing was done yet"]
    if audit:
        lines += ["", (" audit of this flight, newest first", "underline"), *(f"   {text}" for text in audit)]
    return broken(lines, width)
