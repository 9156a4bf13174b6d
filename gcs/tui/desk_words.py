"""What lies on the desk, as lines: runs, fit, comparison, diagnosis, ladder, gains, report. Pure, as `words`.

The texts of tables and findings are the commands' own; here they are chosen, put in order and made harmless.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from rich.cells import cell_len
from textual.style import Style as TextStyle

from gcs.analysis.ladder import RungNumbers, short_names
from gcs.analysis.text.blocks import Blocks, spaced
from gcs.analysis.text.findings import finding_text, suspicion_text
from gcs.desk.state import Choice, DeskState, Nrmse, Rung, RunRow
from gcs.link.decode import sanitise
from gcs.tui.next_step import chosen_anew, full_name
from gcs.tui.plot import Style, bar
from gcs.tui.pressing import pressed
from gcs.tui.ranking_words import candidates_of, unanswered
from gcs.tui.state import State
from gcs.tui.words import bank_line, fitted, justified, sanitise_line, wrapped

if TYPE_CHECKING:
    from gcs.analysis.answer import Answer
    from gcs.analysis.clearance import Clearance

Line = str | tuple[str, str | TextStyle]

SIGNS = {Choice.FIT: "●", Choice.VALIDATE: "○", Choice.OUT: " ", Choice.NOISE: "~"}
"""Beside the word, never in its place."""
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


# ------------------------------------------------------------------------------------------------ runs


def run_head(width: int) -> tuple[str, str]:
    return (fitted(_row(("", "run", "maneuver", "s", "size", "used to", "health"), width), width), "underline")


def _row(cells: tuple[str, str, str, str, str, str, str], width: int) -> str:
    mark, run, maneuver, duration, size, use, health = cells
    wide = 28 if width >= 120 else 15
    name = fitted(run, wide)
    return f" {mark:1} {name:<{wide}} {maneuver:<14} {duration:>5} {size:>5}  {use:<12}  {health}"


def run_rows(desk: DeskState, at: int, width: int, height: int) -> list[Line]:
    """The runs, at most `height`, the one under the cursor in sight."""
    rows = desk.runs
    if not rows:
        return [" no runs: O opens a flight folder or a log"] if desk.path is None else [" no runs in this log"]
    first = max(0, min(at - height // 2, len(rows) - height))
    lines: list[Line] = []
    for number, row in enumerate(rows[first : first + height], first):
        maneuver = " ".join(word for word in (row.axis, row.maneuver) if word)
        size = "" if row.size is None else f"{row.size:.2f}"
        use = f"{SIGNS[row.choice]} {row.choice.value}" if row.usable else "✗ not usable"
        mark, name, duration = "▶" if number == at else " ", sanitise(row.id), f"{row.duration_s:.1f}"
        text = _row((mark, name, sanitise(maneuver), duration, size, use, sanitise(row.health)), width)
        lines.append(pressed(fitted(text, width), f"screen.mark({number})", "reverse" if number == at else ""))
    hidden = len(rows) - len(lines)
    if hidden:
        place = -1 if first == 0 else 0
        one = lines[place]
        text, style = (one, "") if isinstance(one, str) else one
        lines[place] = (justified(text, f"({hidden} more)", width), style)
    return lines


def run_details(desk: DeskState, at: int, width: int) -> list[Line]:
    """Why the run under the cursor is as it is; then the flight's notes."""
    lines: list[Line] = []
    if 0 <= at < len(desk.runs):
        lines += _run_said(desk.runs[at])
    lines += [f" not read: {text}" for text in desk.unread]
    if desk.unkept:
        lines.append((f" NOT KEPT: {', '.join(desk.unkept)}; D keeps them in another folder", "bold"))
    lines += [f" note {_time(one.time)}: {one.text}" for one in desk.notes]
    return broken(lines, width - 1)


def _run_said(row: RunRow) -> list[Line]:
    lines: list[Line] = [(f" {row.id}" if row.reasons else f" {row.id}: {row.health}", "bold")]
    lines += [f"   against it: {text}" for text in row.reasons]
    if row.verdict:
        lines.append(f"   whoever flew it: {row.verdict}")
    lines += [f"   note: {text}" for text in row.notes]
    if row.choice is Choice.NOISE:
        lines.append("   quiet hover: it tells the noise and enters no fit")
    elif row.choice is not row.default:
        lines.append(f"   by itself it would be: {row.default.value}")
    return lines


def _time(stamp: str) -> str:
    return stamp[:16].replace("T", " ")


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
    if rung.answer is None:
        return broken(unanswered(desk), width)
    head, rest = _parted(rung.answer.brief, ("answer",))
    answer: list[Line] = [(line, "bold") for line in _indented(spaced(head, KEYS))]
    return broken([*answer, *_indented(spaced(rest, KEYS, but=TO_TYPE))], width)


def explained_lines(rung: Rung, width: int) -> list[Line]:
    """All reasons: they were asked for, and come right behind the answer."""
    if rung.answer is None:
        return ["", " not diagnosed yet"]
    head, rest = _parted(rung.answer.full, ("answer", "reasons"))
    return broken(_indented([*spaced(head, KEYS), "", *spaced(rest, KEYS, but=TO_TYPE)]), width)


def _parted(blocks: Blocks, keys: Collection[str]) -> tuple[Blocks, Blocks]:
    """The blocks of these keys, and the others."""
    return tuple(one for one in blocks if one.key in keys), tuple(one for one in blocks if one.key not in keys)


def _indented(lines: Sequence[str]) -> list[str]:
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
    if rung is None or (rung.answer is None and desk.ranking is None):
        return [(fitted(" next candidates", width), "underline"), fitted(" D asks which effect is missing", width)]
    rows = [(short_name(one.effects), one.share, "") for one in candidates_of(desk)]
    if rung.answer is not None:
        rows = candidates(rung.answer)
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
    found = rung.answer
    if found is None:
        return ["", " not diagnosed yet: D asks, and then knows which maneuver would tell more"]
    lines: list[Line] = []
    if found.plan is not None:
        lines += [(f" to tell {' from '.join(short_names(found.plan.separates))}", "bold")]
        lines += [f"   {found.plan.maneuver}", f"   {found.plan.why}"]
        if found.plan.card is None:
            lines.append(f"   {found.plan.how or 'no card can hold that'}")
        else:
            lines.append("   6, then W writes it as a test card")
    else:
        lines.append(" no maneuver would tell more")
    if desk.card is not None:
        lines.append(f" written: {desk.card}; 2, then C flies it")
    lines += ["", *(f" {text}" for text in found.hiding)]
    return broken(lines, width)


# ------------------------------------------------------------------------------------------------ gains


def controller_lines(state: State, width: int) -> list[Line]:
    """Margins first, then the matrices, where they are kept, and the command."""
    designed, desk = state.designed, state.desk
    if designed is None:
        on = full_name(desk) or "a fitted TPP"
        return ["", f" no gains are designed yet; they will be on {on}"]
    lines: list[Line] = []
    made = desk.designed
    if made is not None:
        lines.append((f" on {made.rung}: {made.gains.margins.words}", "bold"))
        lines += _cleared_said(made.clearance)
        lines += _following_said(state)
    lines += ["", *(f" {line}" for line in designed.text.splitlines())]
    lines += ["", f" checksum {designed.crc:06x}, kept in {designed.path}"]
    lines += ["", " the same in a shell:", *(f"   {command}" for command in state.commands[-4:])]
    return broken(lines, width)


def _cleared_said(found: Clearance) -> list[Line]:
    """What the gains are worth; what refuses a push, or is not known of the fit, in bold."""
    from gcs.analysis.text.clearance import clearance_told  # scipy comes along, which is there once gains are

    bold = {"judged": found.judgement.refused, "diagnosis": not found.standing.complete}
    return [(f" {name}: {words}", "bold" if bold.get(name) else "") for name, words in clearance_told(found)]


def _following_said(state: State) -> list[Line]:
    made = state.desk.designed
    if made is None:
        return []
    said: list[Line] = []
    for one in (made.following.roll, made.following.pitch):
        rise = "never reaches nine tenths" if one.rise_s is None else f"rises in {1000 * one.rise_s:.0f} ms"
        said.append(
            f" {one.axis} doublet: {rise}, overshoot {100 * one.overshoot:.0f} %, other axis {100 * one.coupling:.0f} %"
        )
    return said


def bank_title(state: State, width: int) -> tuple[str, str]:
    if state.vehicle is None:
        return (fitted(" no vehicle: gains can be designed, and pushed once one is connected (1)", width), "bold")
    return (fitted(f" {bank_line(state.bank)}", width), "bold")


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
