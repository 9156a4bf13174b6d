"""State to lines of text: what each line of each screen says. Pure, so that every moment can be tested.

Nothing is told by colour or by a sign alone. Text from the vehicle and from files is made harmless once more here and
is never markup. Where a line does not fit, what matters least goes first; the abort key never goes.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

from rich.cells import cell_len
from textual.content import Content
from textual.style import Style

from gcs.cards.envelope import Limits
from gcs.flight.preflight import Check
from gcs.link.decode import sanitise
from gcs.tui.actions import ANYWHERE, PILOT, footer
from gcs.tui.next_step import current
from gcs.tui.plot import Style as PlotStyle
from gcs.tui.plot import bar
from gcs.tui.pressing import pressed
from gcs.tui.state import Bank, Mark, Progress, RunView, Stage, State
from gcs.tui.swept_so_far import coherence_bar

_PLAIN = str.maketrans(
    {
        "δ": "d", "▶": ">", "✓": "+", "✗": "x", "●": "*", "○": "o", "·": "-", "°": " deg", "±": "+-", "─": "-",
        "→": "->", "σ": "sigma", "█": "#", "▏": "", "▎": "", "▍": "", "▌": "", "▋": "", "▊": "", "▉": "#", "←": "<-",
        "…": "~", "│": "|", "²": "2", "–": "-", "−": "-", "▓": "#", "░": ".", "↑": "+", "↓": "-",
    }
)  # fmt: skip


def plain(text: str, style: PlotStyle) -> str:
    """Only ASCII where the terminal's font has no more."""
    return text.translate(_PLAIN).encode("ascii", "replace").decode() if style == "ascii" else text


def fitted(text: str, width: int) -> str:
    """Cut to `width` cells, with an ellipsis where something was cut."""
    if cell_len(text) <= width:
        return text
    cut = ""
    used = 1
    for character in text:
        used += cell_len(character)
        if used > width:
            break
        cut += character
    return cut + "…" if width > 0 else ""


def justified(left: str, right: str, width: int) -> str:
    """Left and right on one line; the left is cut where both do not fit."""
    room = width - cell_len(right) - 1
    left = fitted(left, room)
    return left + " " * (width - cell_len(left) - cell_len(right)) + right


def too_small(size: tuple[int, int], smallest: tuple[int, int]) -> str:
    """That the terminal is too small, in what fits there."""
    needed = f"{smallest[0]}x{smallest[1]}"
    for text in (f" too small: {size[0]}x{size[1]}, enlarge the terminal to {needed}", f" too small: {needed}"):
        if cell_len(text) <= size[0]:
            return text
    return fitted("too small", size[0])


SCREENS = ("Connect", "Fly", "Runs", "Fit", "Compare", "Diagnose", "Ladder", "Controller", "Report")
"""In the order of the work; the first is on key 1."""


def screens_line(state: State, here: str, width: int) -> Content:
    """The screens, where we are, and, where there is room, what we are connected to."""
    gap = "  " if width >= 100 else " "
    parts: list[str | tuple[str, Style]] = [" "]
    for key, name in (*((str(i), name) for i, name in enumerate(SCREENS, 1)), ("?", "help" if width >= 90 else "")):
        text = f"{key} {name}" if width >= 100 and name else f"{key}{name}"
        is_here = name == here or (key == "?" and here == "help")
        show = f"app.screen('{(name if key != '?' else 'help').lower()}')"
        parts += [pressed(f"[{text}]", show, "bold reverse") if is_here else pressed(text, show), gap]
    left = "".join(part if isinstance(part, str) else part[0] for part in parts)
    room = max(0, width - cell_len(left) - 1)
    where = sanitise(connection_words(state))
    if state.simulated and cell_len(where) > room:  # what it is stands in full at the bottom
        where = "SIMULATED"
    right = fitted(where, room) if width >= 120 else ""
    return Content.assemble(*parts, " " * (width - cell_len(left) - cell_len(right) - 1), right)


def connection_words(state: State) -> str:
    """Where we are connected to."""
    return f"SIMULATED {state.plant}" if state.simulated else state.link or "no link"


def with_general(keys: str, width: int) -> str:
    """The footer: a screen's keys, then those that work everywhere."""
    text = f" {keys}"
    for act in ANYWHERE:
        one = footer([act])
        if cell_len(text) + 2 + cell_len(one) <= width:
            text += f"  {one}"
    return text


def pilot_line(state: State, width: int) -> str:
    """The simulated pilot's keys; nothing on any other link."""
    if not state.simulated:
        return ""
    return fitted(f" SIMULATED {sanitise(str(state.plant))} · its pilot: {footer(PILOT)}", width)


def card_line(state: State, width: int) -> str:
    """The card, the run it is at, and what is really flown; its numbers give way where there is no room."""
    text = f" card {sanitise(state.card)}"
    run = current(state)
    if run is None:
        return fitted(text, width)
    text += f" {run.number}/{len(state.runs)} · {run.label}"
    flown = "" if state.progress is None else f" · {state.progress.words}"
    full = f"{text}  {run.numbers}{flown}"
    return full if cell_len(full) <= width else fitted(text + flown, width)


def progress_line(state: State, width: int, style: PlotStyle, followed: tuple[float | None, ...] = ()) -> str:
    """How far the run is; `followed`: coherence so far, over the frequencies of the sweep."""
    match state.stage:
        case Stage.FLYING if state.progress is not None:
            run = current(state)
            return fitted(
                f" ▶ {_progress(state.progress, amplitude(run), _gone(state.progress, width, style, followed))}", width
            )
        case Stage.ABORTING if state.lost:
            return fitted(" LINK LOST IN THE RUN: nothing is sent until it is heard, unless you press F12", width)
        case Stage.ABORTING:
            return " ENDING EARLY: asking for the mode before, until the vehicle shows it"
        case Stage.READY:
            run = current(state)
            return fitted(f" ● READY: {run.label if run else ''} · nothing moves until S", width)
        case Stage.CHECKING:
            return _with_so_far(" looking at the vehicle", state, width)
        case Stage.HELD:
            run = current(state)
            return _with_so_far(f" ○ next: {run.label if run else ''}", state, width)
        case Stage.CLOSING:
            return _with_so_far(" the log is completed", state, width)
        case _ if state.desk.fitted is not None:  # which knows more
            return " no run under way"
        case _:
            return _with_so_far(" no run under way", state, width)


def _with_so_far(text: str, state: State, width: int) -> str:
    """With what the runs that were kept say of the vehicle."""
    return fitted(f"{text} · {state.so_far}" if state.so_far else text, width)


def amplitude(run: RunView | None) -> str:
    """`A 0.10`; empty where it has none."""
    return "" if run is None else run.size


def _gone(progress: Progress, width: int, style: PlotStyle, followed: tuple[float | None, ...]) -> str:
    """Time as a bar; of a sweep its frequencies, each as high as the rate follows it."""
    if progress.swept is not None and any(value is not None for value in followed):
        swept = progress.swept
        name = "coherence " if width >= 100 else ""
        return f"{name}{swept.low_hz:g} {coherence_bar(followed, style)} {swept.high_hz:g} Hz"
    share = min(max(progress.elapsed_s / progress.duration_s, 0.0), 1.0) if progress.duration_s else 0.0
    return bar(share, 20 if width < 100 else 40, style)


def _progress(progress: Progress, size: str, gone: str) -> str:
    elapsed = min(max(progress.elapsed_s, 0.0), progress.duration_s)
    left = progress.duration_s - elapsed
    text = f"{elapsed:4.1f} s of {progress.duration_s:g}  {gone}  {left:.0f} s left"
    return "  ".join(
        [text, *([f"{progress.frequency_hz:.1f} Hz"] if progress.frequency_hz else []), *filter(None, [size])]
    )


def limits_line(state: State, width: int, style: PlotStyle) -> str:
    """Peaks of the run in percent of the limits."""
    limits: Limits = state.limits
    use = state.use
    names = (
        ("p, q", None if use is None else use.rate, f"{limits.rate:g} rad/s"),
        ("attitude", None if use is None else use.attitude, f"{math.degrees(limits.attitude):.0f}°"),
        ("command", None if use is None else use.command, f"{100 * limits.command:.0f} %"),
    )
    wide = width >= 100
    size = 10 if wide else 4
    parts = []
    for name, percent, limit in names:
        shown = "  - %" if percent is None else f"{percent:3.0f} %" + ("!" if percent > 100 else "")
        parts.append(f"{name} {bar((percent or 0) / 100, size, style)} {shown}" + (f" of {limit}" if wide else ""))
    return fitted((" limits:  " if wide else " of limit:  ") + "  ".join(parts), width)


def caution(state: State, width: int) -> str:
    """What a lost link does, in full, before a start where the line about it was cut; empty otherwise."""
    waits = state.stage in (Stage.READY, Stage.HELD)
    return state.link_loss if waits and state.link_loss not in recording_line(state, width) else ""


def recording_line(state: State, width: int) -> str:
    """What lands on disk, what is missing, and what a lost link does."""
    vehicle = state.vehicle
    if state.replay is not None:
        return fitted(" recorded before, and watched again: nothing is recorded now, and nothing is sent", width)
    parts = []
    if vehicle is not None and vehicle.recording is not None:
        name = "" if width < 100 else "log " if state.flight is None else f"log {state.flight.name}: "
        came = f"{state.samples:,} samples · {vehicle.blocks_open} blocks missing"
        parts.append(f"{name}{'telemetry only, the log stays on the card' if vehicle.log_on_card else came}")
        if vehicle.recording_problem:
            parts[-1] = f"NOT KEPT: {sanitise(vehicle.recording_problem)}"
    else:
        parts.append("not recording: the log begins with R")
    if state.disk_free is not None and width >= 100:
        parts.append(f"disk {state.disk_free / 1e9:.0f} GB")
    if state.link_loss:
        parts.append(state.link_loss)
    return fitted(" " + " · ".join(parts), width)


OF_FLYING = ("Connect", "Fly", "help")
"""Screens on which what was said of a recorded flight is out of place."""


def notice(state: State, screen: str, width: int) -> str:
    """What stands above the bottom lines: why there is no vehicle, what a lost link does, what was said last."""
    if screen == "Fly" and state.vehicle is None and state.trouble:
        return state.trouble
    cautious = caution(state, width) if screen in ("Fly", "Connect") else ""
    of_desk = state.said_by_desk and screen in OF_FLYING
    return cautious or ("" if of_desk else state.said)


def notice_lines(text: str, width: int, height: int) -> list[str]:
    """What was said last, in at most `height` lines; none where nothing was."""
    text = sanitise(text)
    if not text:
        return []
    lines = textwrap.wrap(text, width - 2, break_on_hyphens=False)
    if len(lines) > height:
        lines = [*lines[: height - 1], fitted(" ".join(lines[height - 1 :]), width - 2)]
    return [f" {line}" for line in lines]


def run_lines(state: State, width: int, height: int) -> list[tuple[str, Style]]:
    """The card's runs, at most `height` of them, the current one in sight; one that is pressed is the next."""
    runs = state.runs
    flown = [i for i, run in enumerate(runs) if run.mark in (Mark.KEEP, Mark.AGAIN)]
    at = next((i for i, run in enumerate(runs) if run.number == state.current), flown[-1] if flown else 0)
    first = max(0, min(at - height // 2, len(runs) - height))
    label_width = max((cell_len(run.label) for run in runs), default=0)
    numbers_width = max((cell_len(run.numbers) for run in runs), default=0)
    lines = []
    for run in runs[first : first + height]:
        head = f" {run.number:2d}  {run.label:<{label_width}}  "
        outcome = f"{run.mark.sign} {run.mark.word}"
        why = ", ".join(run.why)
        if why:
            outcome += f"  {why}"
        text = f"{head}{run.numbers:<{numbers_width}}  {outcome}"
        if why and cell_len(text) > width:  # what became of it matters more than what was asked
            text = head + outcome
        bold = run.mark in (Mark.FLYING, Mark.READY, Mark.NEXT)
        line = fitted(sanitise_line(text), width)
        lines.append(pressed(line, f"app.choose_run({run.number})", "bold" if bold else ""))
    hidden = len(runs) - len(lines)
    if hidden and lines:
        more = f"({hidden} more)"
        line, line_style = lines[-1] if first == 0 else lines[0]
        lines[-1 if first == 0 else 0] = (justified(line, more, width), line_style)
    return lines


def wrapped(text: str, width: int, hang: int = 2) -> list[str]:
    """Broken into lines of at most `width`, further ones `hang` further in; lines that fit are left as they are."""
    if cell_len(text) <= width:
        return [text]
    indent = " " * (len(text) - len(text.lstrip(" ")) + hang)
    return textwrap.wrap(text, max(width, 20), subsequent_indent=indent, break_on_hyphens=False) or [""]


def sanitise_line(text: str) -> str:
    """As `sanitise`, keeping the blanks in front."""
    return " " * (len(text) - len(text.lstrip(" "))) + sanitise(text)


def looked_at(checks: Sequence[Check], width: int, height: int) -> list[str]:
    """What was seen before the start: in full where it fits, else what was looked at and what is wrong."""
    in_full = " · ".join(f"{'' if one.ok else 'NOT '}{one.name}: {one.words}" for one in checks)
    wrong = [f"NOT {one.name}: {one.words}" for one in checks if not one.ok]
    names = [one.name for one in checks if one.ok]
    briefly = " · ".join([*wrong, *([f"in order: {', '.join(names)}"] if names else [])])
    lines: list[str] = []
    for text in (f"looked at: {in_full}", briefly, f"{len(names)} of {len(checks)} checks in order"):
        lines = textwrap.wrap(sanitise(text), width - 2, subsequent_indent="  ", break_on_hyphens=False)
        if len(lines) <= height:
            break
    return [f" {line}" for line in lines[:height]]


def said_lines(state: State, width: int, height: int) -> list[str]:
    """The last texts of the vehicle, newest last."""
    if state.replay is not None:
        return []
    lines = []
    if state.stage in (Stage.READY, Stage.HELD) and state.checks:
        lines = looked_at(state.checks, width, height)
    texts = [] if state.vehicle is None else [sanitise(text.text) for text in state.vehicle.texts]
    if not texts and not lines:
        return [" no text message came from the vehicle yet"]
    room = height - len(lines)
    return [*(fitted(f" vehicle: {text}", width) for text in (texts[-room:] if room > 0 else ())), *lines]


def bank_line(bank: Bank | None) -> str:
    """What the vehicle holds."""
    if bank is None:
        return "vehicle's bank: not read yet (P or R reads it)"
    active = f"{bank.active:06x}" if bank.active else "none"
    before = "" if bank.previous is None else f" · before: {f'{bank.previous:06x}' if bank.previous else 'none'}"
    switch = {True: "the LQR", False: "the autopilot", None: "not told"}[bank.switch_on]
    return f"the vehicle's LQR: {active}{before} · the pilot's switch: {switch}"
