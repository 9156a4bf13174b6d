"""What lies on the desk, as lines: runs, fit, comparison, diagnosis, ladder, gains, report. Pure, as `words`.

The texts of tables and findings are the commands' own; here they are chosen, put in order and made harmless.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from rich.cells import cell_len
from textual.style import Style as TextStyle

from gcs.analysis.candidates import ranked, shows
from gcs.analysis.ladder import RungNumbers, short_names
from gcs.analysis.text.blocks import Blocks, spaced
from gcs.analysis.text.findings import finding_text, suspicion_text
from gcs.analysis.text.hidden import hidden_sentences
from gcs.analysis.text.maneuvers import how_text, proposal_text, why_text
from gcs.desk.state import Choice, DeskState, Nrmse, Rung
from gcs.link.decode import sanitise
from gcs.tui.next_step import chosen_anew, full_name
from gcs.tui.plot import Style, bar
from gcs.tui.state import State
from gcs.tui.words import fitted, justified, sanitise_line, wrapped

if TYPE_CHECKING:
    from gcs.analysis.diagnosis import FitDiagnosis

Line = str | tuple[str, str | TextStyle]

MOST_CANDIDATES = 12
KEYS = {
    "card": "; W writes that as a test card",
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
    text = f" {sanitise(desk.path.name or str(desk.path))}"
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
    text = f" {sanitise(desk.path.name or str(desk.path))} · base {sanitise(desk.base.words)}"
    if desk.ladder:
        name, percent = sanitise(desk.ladder[0].name), desk.ladder[0].nrmse_percent
        text += f" · {name}: NRMSE p {percent['p']:.1f}  q {percent['q']:.1f} %"
    if chosen_anew(desk):
        text += " · OF OTHER RUNS OR BASE THAN CHOSEN NOW"
    return (fitted(text, width), "bold")


def fit_lines(state: State, width: int) -> list[Line]:
    """The tables; warnings before them, because they say whether to read them."""
    found = state.fitted
    if found is None:
        runs = state.desk.chosen(Choice.FIT)
        chosen = [f"   {run.id} {run.axis or ''} {run.maneuver}" for run in runs]
        return broken(["", " nothing is fitted yet", *([" chosen to be fitted:", *chosen] if chosen else [])], width)
    lines: list[Line] = [
        f" fitted on {_runs(found.runs)}",
        f" judged on {_runs(found.validation) or 'the same runs: none was left to judge'}",
    ]
    lines += [(f" warning: {text}", "bold") for text in found.warnings]
    lines += ["", *(f" {line}" for line in found.tables.splitlines())]
    if found.commands:
        lines += ["", " the same in a shell:", *(f"   {command}" for command in found.commands)]
    return broken(lines, width)


def _runs(ids: Sequence[str]) -> str:
    """`flight.BIN#1, #2, #5`: a log's name once."""
    said, last = [], ""
    for one in ids:
        log, mark, number = one.rpartition("#")
        said.append(f"#{number}" if mark and log == last else one)
        last = log
    return ", ".join(said)


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
        lines += ["", *_indented(spaced(rung.comparison_text, KEYS, but=("findings",)))]  # those stand above
    return broken(lines, width)


# ------------------------------------------------------------------------------------------------ diagnosis


def verdict_lines(desk: DeskState, width: int) -> list[Line]:
    """The command's answer, less what to type next: that is a key here."""
    rung = desk.current
    if rung is None:
        return ["", " no fit yet"]
    if rung.diagnosis is None:
        return [
            "",
            f" {full_name(desk)} was not asked yet",
            "",
            " D refits it with each effect of the catalogue, one by one, and judges by",
            " what noise allows and by the runs that were not fitted",
        ]
    head, rest = _parted(rung.diagnosis_text, ("answer",))
    answer: list[Line] = [(line, "bold") for line in _indented(spaced(head, KEYS))]
    return broken([*answer, *_indented(spaced(rest, KEYS, but=TO_TYPE))], width)


def explained_lines(rung: Rung, width: int) -> list[Line]:
    """All reasons: they were asked for, and come right behind the answer."""
    if rung.diagnosis is None:
        return ["", " not asked yet"]
    from gcs.analysis.text.diagnosis import diagnosis_blocks  # scipy comes along; with a diagnosis it is there

    head, rest = _parted(diagnosis_blocks(rung.diagnosis, full=True), ("answer", "reasons"))
    return broken(_indented([*spaced(head, KEYS), "", *spaced(rest, KEYS, but=TO_TYPE)]), width)


def _parted(blocks: Blocks, keys: Collection[str]) -> tuple[Blocks, Blocks]:
    """The blocks of these keys, and the others."""
    return tuple(one for one in blocks if one.key in keys), tuple(one for one in blocks if one.key not in keys)


def _indented(lines: Sequence[str]) -> list[str]:
    return [f" {line}" for line in lines]


def candidates(found: FitDiagnosis | None) -> list[tuple[str, float | None, str]]:
    """(name, explained share or None where not testable, note): the answer first, then the likeliest."""
    if found is None:
        return []
    last = found.last
    rows: list[tuple[str, float | None, str]] = [
        (short_name(one.effects), one.explained_share or 0.0, "implausible" if one.implausible else "")
        for one in ranked(last)[:MOST_CANDIDATES]
        if shows(one, last)
    ]
    rows += [
        (short_name(one.effects), None, "")
        for one in last.candidates
        if one.not_testable is not None and not one.not_offered
    ]
    return rows


def short_name(effects: Sequence[str]) -> str:
    """Files without their folder."""
    return sanitise(" + ".join(short_names(effects)))


# ------------------------------------------------------------------------------------------------ the ladder


def ladder_title(desk: DeskState, width: int) -> tuple[str, str]:
    """The top rung: fitted, on other runs, and what noise allows."""
    rung = desk.current
    if rung is None:
        return (" no fit yet", "bold")
    text = f" {full_name(desk)}   fitted {_pair(rung.nrmse_percent)}"
    if rung.validation_nrmse_percent is not None:
        text += f"   valid. {_pair(rung.validation_nrmse_percent)}"
    if desk.noise_floor_percent is not None:
        text += f"   noise {_pair(desk.noise_floor_percent)}"
    return (fitted(text, width), "bold")


def _pair(percent: Nrmse) -> str:
    return f"{percent['p']:.1f} / {percent['q']:.1f}"


def rung_lines(desk: DeskState, width: int, style: Style) -> list[Line]:
    """Rung by rung: fitted and validated, a bar of the mean; what the last says; the placebo beside it."""
    lines: list[Line] = []
    wrong = None if desk.current is None else desk.current.placebo
    names = [sanitise(one.name) for one in desk.ladder] + ([] if wrong is None else [f"placebo {sanitise(wrong[0])}"])
    name_width = max(map(cell_len, names), default=0)
    name_width = min(max(name_width, 10), max(12, width - 38))
    room = max(0, width - name_width - 36)
    lines.append((fitted(f"   {'rungs':<{name_width}}  p fit valid   q fit valid", width), "underline"))
    for number, rung in enumerate(desk.ladder):
        top = number == len(desk.ladder) - 1
        lines.append((_rung(rung, name_width, room, style), "bold") if top else _rung(rung, name_width, room, style))
    current = desk.current
    if wrong is not None:
        name, percent, judged = wrong
        lines.append(_numbers("·", (f"placebo {name}", percent, judged), name_width, room, style))
    shares = explained_shares(desk)
    if shares is not None:
        drawn = "  ".join(f"{axis} {bar(one, 8, style)} {100 * one:.0f} %" for axis, one in shares.items())
        lines.append(f"   explained  {drawn}")
    if current is not None:
        said = {
            "complete": " ✓ complete: what is left is noise",
            "unexplained": " ? unexplained: no known effect does it",
            "missing": " ○ something is missing still",
        }
        lines.append(said.get(current.verdict or "", " ○ not asked yet what is missing: D"))
    return [fitted(one, width) if isinstance(one, str) else (fitted(one[0], width), one[1]) for one in lines]


def explained_shares(desk: DeskState) -> dict[str, float] | None:
    """Of the lowest rung's error less noise, what the rungs above explain; None where there are none, or no floor."""
    floor = desk.noise_floor_percent
    if floor is None or len(desk.ladder) < 2:
        return None
    found = {}
    for axis, top in desk.ladder[-1].nrmse_percent.items():
        first, now, least = (
            ((1 - value / 100) ** 2) for value in (desk.ladder[0].nrmse_percent[axis], top, floor[axis])
        )
        if first <= least:
            return None
        found[axis] = min(max((first - now) / (first - least), 0.0), 1.0)
    return found


def _rung(rung: Rung, name_width: int, room: int, style: Style) -> str:
    return _numbers("●", (rung.name, rung.nrmse_percent, rung.validation_nrmse_percent), name_width, room, style)


def _numbers(sign: str, rung: RungNumbers, name_width: int, room: int, style: Style) -> str:
    name, percent, judged = rung
    cells = "   ".join(f"{percent[k]:5.1f} " + (f"{judged[k]:5.1f}" if judged else "    -") for k in percent)
    drawn = f"  {bar(sum(percent.values()) / (100 * len(percent)), room, style)}" if room >= 6 else ""
    return f" {sign} {fitted(sanitise(name), name_width):<{name_width}}  {cells}{drawn}"


def next_candidates(desk: DeskState, width: int, height: int) -> list[Line]:
    """What the top rung's diagnosis offers, with shares; how many could not be asked."""
    rung = desk.current
    if rung is None or rung.diagnosis is None:
        return [(fitted(" next candidates", width), "underline"), fitted(" D asks which effect is missing", width)]
    rows = candidates(rung.diagnosis)
    asked = [one for one in rows if one[1] is not None]
    untold = len(rows) - len(asked)
    head: Line = (justified(" next candidates", "share ", width), "underline")
    if rung.verdict == "complete":
        lines: list[Line] = [" none: what is left is noise"]
    else:
        room = max(1, height - 1 - (untold > 0))
        lines = [
            justified(f" {name}{f' ({note})' if note else ''}", f"{share:.2f} ", width)
            for name, share, note in asked[:room]
            if share is not None
        ]
    if untold:
        lines.append(fitted(f" {untold} not testable: 6 says why", width))
    return [head, *lines]


def sign_lines(rung: Rung, width: int) -> list[Line]:
    """What was added and whether it is really there: the command's text, less what to type."""
    text = rung.addition_text
    if not text:
        return [
            "",
            " this rung was not added here: nothing is known of its placebo"
            if rung.effect
            else " the lowest rung has no placebo: nothing was added",
        ]
    return broken(_indented(spaced(text, KEYS, but=TO_TYPE)), width)


def teller_lines(rung: Rung, desk: DeskState, width: int) -> list[Line]:
    """Which maneuver would tell, and what could hide."""
    found = rung.diagnosis
    if found is None:
        return ["", " not asked yet: D asks, and then knows which maneuver would tell more"]
    lines: list[Line] = []
    if found.next is not None:
        lines += [(f" to tell {' from '.join(short_names(found.next.separates))}", "bold")]
        lines += [f"   {proposal_text(found.next.proposal)}", f"   {why_text(found.next.why)}"]
        if found.next.card is None:
            lines.append(f"   {how_text(found.next.proposal, found.runs.records) or 'no card can hold that'}")
        else:
            lines.append("   6, then W writes it as a test card")
    else:
        lines.append(" no maneuver would tell more")
    if desk.card is not None:
        lines.append(f" written: {desk.card}; 2, then C flies it")
    lines += ["", *(f" {text}" for text in hidden_sentences(found.hiding))]
    return broken(lines, width)


# ------------------------------------------------------------------------------------------------ report


def report_lines(state: State, audit: Sequence[str], width: int) -> list[Line]:
    """Where the page is, what was done, and the commands that do it again."""
    desk = state.desk
    lines: list[Line] = []
    if desk.report is not None:
        lines += [(f" the page: {desk.report}", "bold")]
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
