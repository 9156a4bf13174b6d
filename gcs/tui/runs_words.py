"""The runs of a flight as lines: what each is used for, how they differ, why one is as it is. Pure, as `words`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from gcs.analysis.text.findings import listed_runs
from gcs.desk.state import Choice, DeskState, RunRow
from gcs.link.decode import sanitise
from gcs.tui.desk_words import Line, broken
from gcs.tui.next_step import MULTIROTOR_FIT
from gcs.tui.pressing import pressed
from gcs.tui.words import fitted, justified

if TYPE_CHECKING:
    from gcs.analysis.alike import Alike

SIGNS = {Choice.FIT: "●", Choice.VALIDATE: "○", Choice.OUT: " ", Choice.NOISE: "~"}
"""Beside the word, never in its place."""


def run_head(width: int, like: Alike) -> tuple[str, str]:
    head = "like  health" if like.groups[1:] else "health"
    return (fitted(_row(("", "run", "maneuver", "s", "rms", "used to", head), width), width), "underline")


def _row(cells: tuple[str, str, str, str, str, str, str], width: int) -> str:
    mark, run, maneuver, duration, size, use, health = cells
    wide = 28 if width >= 120 else 15
    name = run if len(run) <= wide else f"…{run[1 - wide :]}"  # its number and its window stand at the end
    return f" {mark:1} {name:<{wide}} {maneuver:<14} {duration:>5} {size:>6}  {use:<12}  {health}"


def run_rows(desk: DeskState, at: int, width: int, height: int, like: Alike) -> list[Line]:
    """The runs, at most `height`, the one under the cursor in sight."""
    rows = desk.runs
    if not rows:
        return [" no runs: O opens a flight folder or a log"] if desk.path is None else [" no runs in this log"]
    first = max(0, min(at - height // 2, len(rows) - height))
    lines: list[Line] = []
    for number, row in enumerate(rows[first : first + height], first):
        maneuver = " ".join(word for word in (row.axis, row.maneuver) if word)
        size = "" if row.size is None else f"{100 * row.size:.1f} %"
        use = f"{SIGNS[row.choice]} {row.choice.value}" if row.usable else "✗ not usable"
        health = sanitise(row.health)
        if like.groups[1:]:
            health = f"{like.letter(row.id):<4}  {health}"
        mark, name, duration = "▶" if number == at else " ", sanitise(row.id), f"{row.duration_s:.1f}"
        text = _row((mark, name, sanitise(maneuver), duration, size, use, health), width)
        lines.append(pressed(fitted(text, width), f"screen.mark({number})", "reverse" if number == at else ""))
    hidden = len(rows) - len(lines)
    if hidden:
        place = -1 if first == 0 else 0
        one = lines[place]
        text, style = (one, "") if isinstance(one, str) else one
        lines[place] = (justified(text, f"({hidden} more)", width), style)
    return lines


def airframe_lines(desk: DeskState, width: int) -> list[Line]:
    """That these runs are of what neither of the app's models is, and where its own is fitted."""
    if not desk.of_multirotor:
        return []
    return broken([f" ! of a multirotor, which neither TPP nor CD is: in a shell {MULTIROTOR_FIT}"], width)


def unlike_lines(like: Alike, width: int, height: int) -> list[Line]:
    """How the chosen runs differ and what to do, in at most so many lines; nothing where they are alike."""
    if not like.told:
        return []
    do = f" A leaves out {sanitise(listed_runs(like.odd))}"
    lines = broken([f" ! {text}" for text in like.told], width)
    if len(lines) >= height:
        lines = [*lines[: height - 2], (fitted(f"{_text(lines[height - 2])} …", width), "")]
    return [*lines, pressed(fitted(do, width), "screen.only_alike")]


def _text(line: Line) -> str:
    return line if isinstance(line, str) else line[0]


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
    if row.size is not None:
        lines.append(f"   size: {100 * row.size:.1f} % of full command, root mean square (a sweep's is 0.7 of its A)")
    lines += [f"   {text}" if number == 0 else f"     {text}" for number, text in enumerate(row.alone)]
    if row.verdict:
        lines.append(f"   verdict in flight: {row.verdict}")
    lines += [f"   note: {text}" for text in row.notes]
    if row.choice is Choice.NOISE:
        lines.append("   quiet hover: it tells the noise and enters no fit")
    elif row.choice is not row.default:
        lines.append(f"   by itself it would be: {row.default.value}")
    return lines


def strip_title(row: RunRow) -> str:
    """`flight.BIN#2@5:25, roll chirp`."""
    return sanitise(", ".join([row.id, " ".join(word for word in (row.axis, row.maneuver) if word)]))


def _time(stamp: str) -> str:
    return stamp[:16].replace("T", " ")


def chosen(rows: Sequence[RunRow]) -> list[RunRow]:
    """Those that are fitted or judge, with samples."""
    return [row for row in rows if row.choice in (Choice.FIT, Choice.VALIDATE) and row.record is not None]
