"""The candidates of a diagnosis as lines: ranked while they are asked, and after it; what each of them is. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from textual.style import Style as TextStyle

from gcs.analysis.text.progress import asking_words, best_words, effects_words, first_words
from gcs.desk.state import Asked, DeskState, Nrmse
from gcs.link.decode import sanitise
from gcs.tui.next_step import full_name
from gcs.tui.plot import Style, bar
from gcs.tui.pressing import pressed
from gcs.tui.words import fitted
from sysid.diagnose.progress import Standing

if TYPE_CHECKING:
    from gcs.analysis.answer import Row

Line = str | tuple[str, str | TextStyle]

NAME_WIDTH = 34
STATE_WIDTH = 30
HEAD = "how much of the avoidable error each removes; enter tells about the marked one"
STAGES_SHOWN = 20
"""Columns of the bar of a stage's work."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """A line of the table."""

    effects: tuple[str, ...]
    share: float | None
    """Of what can be explained; None where it is not testable."""
    promised: bool = False
    """Whether that is a score's promise."""
    state: str = ""
    nrmse_percent: Nrmse | None = None
    validation_nrmse_percent: Nrmse | None = None
    sizes: tuple[str, ...] = ()
    implausible: tuple[str, ...] = ()
    not_testable: str = ""


def candidates_of(desk: DeskState) -> list[Candidate]:
    """Of the answer about the current rung; of a question under way, or called off, as far as they were heard of."""
    if desk.answer is not None:
        return [_answered(one) for one in desk.answer.candidates]
    return [] if desk.ranking is None else [_standing(one) for one in desk.ranking.ranking.standings]


def _answered(one: Row) -> Candidate:
    state = "not testable" if one.share is None else "implausible" if one.implausible else ""
    return Candidate(
        effects=one.effects,
        share=one.share,
        state=state or _numbers(one.nrmse_percent),
        nrmse_percent=one.nrmse_percent,
        validation_nrmse_percent=one.validation_nrmse_percent,
        sizes=one.sizes,
        implausible=one.implausible,
        not_testable=one.not_testable,
    )


def _standing(one: Standing) -> Candidate:
    heard = one.heard
    numbers = "" if one.promised else f"  {_numbers(heard.nrmse_percent)}"
    return Candidate(
        effects=one.effects,
        share=one.share,
        promised=one.promised,
        state=f"{one.known.value}{numbers}" + ("  implausible" if heard.implausible else ""),
        nrmse_percent=heard.nrmse_percent,
        validation_nrmse_percent=heard.validation_nrmse_percent,
        implausible=heard.implausible,
    )


def _numbers(percent: Nrmse | None) -> str:
    return "" if percent is None else "  ".join(f"{name} {value:.1f}" for name, value in percent.items())


def board(desk: DeskState, at: int, size: tuple[int, int], style: Style) -> list[Line]:
    """How the question goes, then the candidates, best first, the one at the cursor in sight."""
    width, height = size
    lines: list[Line] = [*question_lines(desk, width, style)]
    rows = candidates_of(desk)
    if not rows:
        return lines[:height]
    lines.append((fitted(f" {HEAD}", width), "underline"))
    room = max(1, height - len(lines) - 1)
    first = max(0, min(at - room // 2, len(rows) - room))
    name_width = min(NAME_WIDTH, max(12, width // 2 - 14))
    lines += [
        pressed(
            _row(one, number == at, (width, name_width), style),
            f"screen.mark({number})",
            "reverse" if number == at else "bold" if number == 0 else "",
        )
        for number, one in enumerate(rows[first : first + room], first)
    ]
    hidden = len(rows) - min(len(rows), room)
    if hidden:
        lines.append(fitted(f"   {hidden} more: up/down", width))
    return lines


def _row(one: Candidate, marked: bool, widths: tuple[int, int], style: Style) -> str:
    width, name_width = widths
    name = fitted(sanitise(effects_words(one.effects)), name_width)
    head = f" {'▶' if marked else ' '} {name:<{name_width}} "
    if one.share is None:
        return fitted(f"{head}not testable: {sanitise(one.not_testable)}", width)
    share = _share(one)
    room = width - len(head) - 8 - STATE_WIDTH
    drawn = bar(one.share, min(room, 40), style) if room >= 4 else ""
    return fitted(f"{head}{drawn} {share:>6}  {one.state}", width)


def _share(one: Candidate) -> str:
    return f"{'~' if one.promised else ''}{100 * (one.share or 0.0):.0f} %"


def question_lines(desk: DeskState, width: int, style: Style) -> list[Line]:
    """What is asked now, or that it was called off; nothing once there is an answer."""
    asked = desk.ranking
    if asked is None:
        return []
    ranking = asked.ranking
    lines: list[Line] = [_asked_now(asked, desk, width, style)]
    if ranking.first is not None:
        answer = first_words(ranking.first)
        lines.append(fitted(f" {answer}; {'two together were' if asked.over else 'now two together are'} tried", width))
    best = best_words(ranking)
    left = f"{desk.busy_s} s so far" + (f", {desk.left}" if desk.left else "")
    said = [best, "" if asked.over else left]
    lines.append(fitted(f" {'   '.join(one for one in said if one)}", width))
    return lines


def _asked_now(asked: Asked, desk: DeskState, width: int, style: Style) -> Line:
    if asked.over:
        text = " NOT A VERDICT: called off; how the candidates stood. D asks again, from the start"
        return (fitted(text, width), "bold")
    asking = asked.ranking.asking
    if asking is None:
        return (fitted(" the runs are prepared", width), "bold")
    done = f"{bar(asking.done, STAGES_SHOWN, style)} " if asking.done is not None and not asking.at_most else ""
    return (fitted(f" {done}{sanitise(asking_words(asking))}", width), "bold")


def unanswered(desk: DeskState) -> list[Line]:
    """Where there is no answer yet: what the last rung changed, and what to press."""
    name = full_name(desk)
    if desk.ranking is not None and not desk.ranking.over:
        return ["", f" {name} is being diagnosed: candidates stand in the table as they are asked"]
    lines: list[Line] = ["", f" {name} is not diagnosed yet"]
    rungs = desk.ladder
    if len(rungs) > 1 and rungs[-1].effect is not None:
        before, after = rungs[-2], rungs[-1]
        moved = [f"{axis} {before.nrmse_percent[axis]:.1f} → {now:.1f} %" for axis, now in after.nrmse_percent.items()]
        lines = ["", (f" {sanitise(effects_words((str(after.effect),)))} is added: NRMSE {', '.join(moved)}", "bold")]
        was, judged = before.validation_nrmse_percent, after.validation_nrmse_percent
        if was is not None and judged is not None:
            also = [f"{axis} {was[axis]:.1f} → {now:.1f} %" for axis, now in judged.items()]
            lines.append(f" on runs that were not fitted: {', '.join(also)}")
        lines += [f" {name} is not diagnosed yet; 7 shows the ladder, U takes it back"]
    return [
        *lines,
        "",
        " D diagnoses it: refits it with each effect of the catalogue, one by one, and judges by what noise allows "
        "and by the runs that were not fitted",
    ]


def about_lines(desk: DeskState, at: int) -> list[Line]:
    """What the candidate at the cursor is, what it would do, and what these runs say of it."""
    rows = candidates_of(desk)
    if not rows:
        return ["", " no candidates yet"]
    one = rows[max(0, min(at, len(rows) - 1))]
    lines: list[Line] = [(f" {sanitise(effects_words(one.effects))}", "bold")]
    if one.share is None:
        lines.append(f" not testable on these runs: {sanitise(one.not_testable)}")
    elif one.promised:
        lines.append(f" a first score promises about {100 * one.share:.0f} % of what the best promises; not refitted")
    else:
        lines.append(f" added, it removes {100 * one.share:.0f} % of the avoidable error")
    before = None if desk.current is None else (desk.answer or desk.current).nrmse_percent
    if one.nrmse_percent is not None and before is not None:
        moved = [f"{axis} {before[axis]:.1f} → {now:.1f} %" for axis, now in one.nrmse_percent.items()]
        lines.append(f" NRMSE on fitted runs, all frequencies weighing the same, {', '.join(moved)}")
    judged = None if desk.answer is None else desk.answer.validation_nrmse_percent
    if one.validation_nrmse_percent is not None and judged is not None:
        moved = [f"{axis} {judged[axis]:.1f} → {now:.1f} %" for axis, now in one.validation_nrmse_percent.items()]
        lines.append(f" on runs that were not fitted {', '.join(moved)}")
    if one.sizes:
        lines.append(f" at {sanitise(', '.join(one.sizes))}")
    if one.implausible:
        lines.append((f" physics does not allow its {sanitise(', '.join(one.implausible))}", "bold"))
    return [*lines, *_catalogued(one.effects), "", " escape: the answer again"]


def effects_offered(desk: DeskState) -> list[tuple[str, str]]:
    """Effects that may be added, each with what it is: the candidates, best first, else all of the catalogue."""
    rows = [one for one in candidates_of(desk) if len(one.effects) == 1 and one.share is not None]
    if rows:
        return [(one.effects[0], f"{_share(one)} of the avoidable error  {one.state}".rstrip()) for one in rows]
    from sysid.model.effect import catalogue  # NumPy comes along; what is fitted brought it

    return [] if desk.current is None else [(name, one.title) for name, one in catalogue().items()]


def _catalogued(effects: Sequence[str]) -> list[Line]:
    """What the catalogue says of them; a file of the user's own is code, and is not opened to be told about."""
    from sysid.model.effect import catalogue  # NumPy comes along; with candidates it is there

    lines: list[Line] = []
    for name in effects:
        known = catalogue().get(name)
        if known is None:
            continue
        lines += [
            "",
            (f" {known.title}", "bold"),
            f" {known.equation}",
            f" what its lack looks like: {known.signature}",
        ]
        lines += [f"   {one.name}: {one.meaning}" for one in known.parameters]
        lines.append(f" source: {known.source}")
    return lines
