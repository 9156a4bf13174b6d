"""Gains as lines: in the vehicle and proposed, side by side; what speaks against them; what a push changes. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from textual.content import Content

from gcs.desk.state import DeskState
from gcs.link.decode import sanitise
from gcs.tui.desk_words import Line as Words
from gcs.tui.desk_words import broken
from gcs.tui.next_step import full_name
from gcs.tui.state import State
from gcs.tui.widgets.lines import Line
from gcs.tui.words import bank_line, fitted

if TYPE_CHECKING:
    from gcs.analysis.clearance import Clearance
    from sysid.control.judgement import Judgement, Limits, OnModel, Quantity
    from sysid.control.loop import Answer, Following

NAME, COLUMN = 18, 17
FAILS, POOR = "bold $text-error", "bold $text-warning"
"""Beside signs and words, never in their place."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class Column:
    """One set of gains."""

    head: str
    under: str
    judgement: Judgement
    following: Following | None
    clearance: Clearance | None
    """None where bounds were not looked at yet."""


def columns(state: State) -> list[Column]:
    """Gains in the vehicle or flown, those that are kept, and what the sliders would make, as far as there are any."""
    found, desk = [], state.desk
    held, made, trial = desk.present, desk.designed, desk.trial
    if held is not None and held.found is not None:
        now = held.found
        head = "in the vehicle" if state.bank is not None and state.bank.active == held.crc else "flown"
        found.append(_column(head, f"{held.crc:06x}", now.judgement, now.following, None))
    if made is not None and not (held is not None and held.crc == made.crc and held.found is not None):
        cleared = made.clearance
        older = "" if made.rung == full_name(desk) or not desk.ladder else f" on {sanitise(made.rung)}"
        found.append(_column("designed", f"{made.crc:06x}{older}", cleared.judgement, made.following, cleared))
    if trial is not None and trial.found is not None and (made is None or trial.weights != made.weights):
        under = "not kept: D" if trial.weights == desk.weights else "…"
        one = trial.found
        whole = one.judgement if trial.clearance is None else trial.clearance.judgement
        found.append(_column("sliders", under, whole, one.following, trial.clearance))
    return found


def _column(
    head: str, under: str, judgement: Judgement, following: Following | None, clearance: Clearance | None
) -> Column:
    return Column(head=head, under=under, judgement=judgement, following=following, clearance=clearance)


def controller_lines(state: State, width: int, *, proof_first: bool = False) -> list[Line]:
    """What decides first: side by side; then what speaks against them; then matrices, files and commands. Above all
    what was flown against predicted, where that is looked at."""
    desk = state.desk
    beside = columns(state)
    lines: list[Line] = [*broken(proof_said(desk), width), ""] if proof_first and desk.proof is not None else []
    if desk.trial is not None and desk.trial.problem:
        lines += broken([(f" no gains of these weights: {desk.trial.problem}", "bold")], width)
    if beside:
        lines += table(beside, width)
    elif not lines:
        on = full_name(desk) or "a fitted TPP"
        lines += ["", f" no gains are designed yet; they will be on {on}"]
    if desk.present is not None and desk.present.fit is None:
        lines.append(fitted(f" {desk.present.crc:06x}: {sanitise(str(desk.present.path))}, on its own model", width))
    lines += broken(_standing_said(desk), width)
    lines += broken([*_shadow_said(desk), *([] if proof_first else ["", *proof_said(desk)])], width)
    made = desk.designed
    if made is None:
        return lines
    lines += ["", *broken(_cleared_said(made.clearance), width)]
    lines += broken(["", *(f" {line}" for line in made.text.splitlines())], width)
    kept = "NOT KEPT in any file yet" if made.path is None else f"kept in {made.path}"
    lines += broken(["", f" designed on {made.rung}: checksum {made.crc:06x}, {kept}"], width)
    return [*lines, *broken(["", " the same in a shell:", *(f"   {one}" for one in state.commands[-4:])], width)]


# ------------------------------------------------------------------------------------------------ side by side


@dataclass(frozen=True, slots=True)
class _Cell:
    text: str
    style: str = ""


def table(beside: Sequence[Column], width: int) -> list[Line]:
    """Margins and answers, what is asked of them behind; what falls short is marked by sign, word and colour."""
    limits = beside[-1].judgement.limits
    lines: list[Line] = [
        (_line("", [_Cell(one.head) for one in beside], "asked", width).plain, "underline"),
        _line("", [_Cell(one.under) for one in beside], "", width),
    ]
    lines += [_line(name, [cell(one, 0) for one in beside], asked, width) for name, asked, cell in _rows(limits)]
    lines.append(_line("verdict", [_verdict(one) for one in beside], "", width))
    completed = [one for one in beside if len(one.judgement.models) > 1]
    if completed:
        title = completed[0].judgement.models[1].model.structure.title
        lines += [(fitted(f" with what is missing: {sanitise(title)}", width), "bold")]
        lines += [
            _line(name, [cell(one, 1) for one in beside], asked, width) for name, asked, cell in _rows(limits)[:3]
        ]
    return lines


def _line(name: str, cells: Sequence[_Cell], asked: str, width: int) -> Content:
    parts: list[tuple[str, str]] = [(f" {name:<{NAME}}", "")]
    parts += [(f"{fitted(cell.text, COLUMN - 1):<{COLUMN}}", cell.style) for cell in cells]
    used = 1 + NAME + COLUMN * len(cells)
    return Content.assemble(*parts, fitted(asked, max(1, width - used)) if width > used else "")


Cell = Callable[[Column, int], _Cell]


def _rows(limits: Limits) -> list[tuple[str, str, Cell]]:
    """Name, what is asked, and the cell of a column on its n-th model."""
    return [
        ("gain margin", f"{limits.gain_db:g} dB or more", _margin("gain_db", 1, " dB")),
        ("phase margin", f"{limits.phase_deg:g} deg or more", _margin("phase_deg", 0, " deg")),
        ("delay margin", f"{limits.delay_ms:g} ms or more", _margin("delay_ms", 0, " ms")),
        ("rise roll/pitch", "", _rise),
        ("overshoot", f"{100 * limits.overshoot:g} % or less", _answer("overshoot", 100.0, " %")),
        ("other axis", f"{100 * limits.coupling:g} % or less", _answer("coupling", 100.0, " %")),
        ("disturbance", f"{limits.peak_db:g} dB or less", _answer("peak_db", 1.0, " dB")),
    ]


def _model(one: Column, number: int) -> OnModel | None:
    models = one.judgement.models
    return models[number] if number < len(models) else None


def _margin(quantity: Quantity, digits: int, unit: str) -> Cell:
    def cell(one: Column, number: int) -> _Cell:
        on = _model(one, number)
        if on is None:
            return _Cell("-")
        if on.loop.margins is None:
            return _Cell("✗ NOT HELD", FAILS)
        value = getattr(on.loop.margins, quantity)
        text = f"{value:.{digits}f}{unit}" if math.isfinite(value) else "any"
        low = any(short.quantity == quantity for short in on.shortfalls)
        return _Cell(f"{text} ✗ low", FAILS) if low else _Cell(text)

    return cell


def _answer(quantity: Quantity, size: float, unit: str) -> Cell:
    def cell(one: Column, number: int) -> _Cell:
        on = _model(one, number)
        value = None if on is None else getattr(on, quantity)
        if on is None or value is None:
            return _Cell("-")
        text = f"{size * value:.0f}{unit}"
        high = any(short.quantity == quantity for short in on.shortfalls)
        return _Cell(f"{text} ! high", POOR) if high else _Cell(text)

    return cell


def _rise(one: Column, number: int) -> _Cell:
    found = one.following if number == 0 else None
    if found is None:
        return _Cell("-")
    roll, pitch = (_risen(axis) for axis in (found.roll, found.pitch))
    return _Cell(f"{roll} / {pitch} ms")


def _risen(answer: Answer) -> str:
    """ms until nine tenths of what is asked; or how much of it is ever reached."""
    if answer.rise_s is not None:
        return f"{1000 * answer.rise_s:.0f}"
    return f"max {100 * float(np.max(np.abs(answer.own)) / np.max(np.abs(answer.asked))):.0f} %"


def _verdict(one: Column) -> _Cell:
    verdict = one.judgement.verdict
    if verdict == "holds" and one.clearance is not None and not one.clearance.standing.complete:
        return _Cell("! if complete", POOR)
    style = FAILS if verdict == "fails" else POOR if verdict in ("poor", "not measured") else ""
    sign = {"fails": "✗ FAILS", "poor": "! poor", "not measured": "! not measured"}.get(verdict, "✓ holds")
    return _Cell(sign if one.clearance is not None else f"{sign} (fit)", style)


# ------------------------------------------------------------------------------------------------ what stands against


def _standing_said(desk: DeskState) -> list[Words]:
    """What the margins stand on: a model that was asked what it lacks, or not."""
    cleared = desk.designed.clearance if desk.designed is not None else None
    if desk.trial is not None and desk.trial.clearance is not None:
        cleared = desk.trial.clearance
    name = full_name(desk)
    if cleared is not None and cleared.standing.complete:
        return []
    if cleared is not None and cleared.standing.state == "missing":
        lacks = " + ".join(cleared.standing.effects)
        return [(f" ! {name} lacks {lacks}: its own margins are an illusion; 7, then A adds it", POOR)]
    verdict = None if desk.current is None else desk.current.verdict
    if verdict == "complete" or not name:
        return []
    if verdict is None:
        return [(f" ! margins hold only if {name} is complete, and nobody asked: 6, then D", POOR)]
    return [(f" ! margins hold only if {name} is complete, and it is not: {verdict} (6)", POOR)]


def _cleared_said(found: Clearance) -> list[Words]:
    """What the gains are worth; what refuses a push, or is not known of the fit, in bold."""
    from gcs.analysis.text.clearance import clearance_told  # scipy comes along, which is there once gains are

    bold = {"judged": found.judgement.refused, "diagnosis": not found.standing.complete}
    return [(f" {name}: {words}", "bold" if bold.get(name) else "") for name, words in clearance_told(found)]


def _shadow_said(desk: DeskState) -> list[Words]:
    """The designed gains over the chosen runs."""
    made = desk.designed
    if made is None:
        return []
    if made.shadow is None:
        return [" shadow: not run yet; S runs these gains over the chosen runs without authority"]
    from gcs.analysis.text.shadow import VERDICTS, reasons  # as above

    verdict = made.shadow.verdict
    style = {"refused": FAILS, "not measured": POOR}.get(verdict, "bold")
    lines: list[Words] = [(f" shadow: {VERDICTS[verdict]} ({len(made.shadow.runs)} runs)", style)]
    return [*lines, *(f"   because: {text}" for text in reasons(made.shadow))]


def proof_said(desk: DeskState) -> list[Words]:
    """This flight against what its gains promised."""
    found = desk.proof
    if found is None:
        return []
    from gcs.analysis.text.proof import proof_text  # as above

    first, *rest = proof_text(found).splitlines()
    style = {"not accepted": FAILS, "too few to say": POOR}.get(found.proof.verdict, "bold")
    return [(f" flown against predicted: {first}", style), *(f" {line}" for line in rest)]


# ------------------------------------------------------------------------------------------------ the push


def push_lines(state: State) -> tuple[str, ...]:
    """What a push would change, and what is known of it."""
    desk, designed = state.desk, state.designed
    assert designed is not None
    bank = state.bank
    now = "none" if bank is None or not bank.active else f"{bank.active:06x}"
    lines = [f"gains {now} -> {designed.crc:06x} ({designed.path}), judged on {designed.rung}:"]
    held = desk.present
    before = held.found if held is not None and bank is not None and held.crc == bank.active else None
    for name, asked, cell in _rows(designed.clearance.judgement.limits):
        new = cell(_column("", "", designed.clearance.judgement, designed.following, designed.clearance), 0).text
        old = "" if before is None else cell(_column("", "", before.judgement, before.following, None), 0).text
        lines.append(f"  {name:<{NAME}}{f'{old} -> ' if old else ''}{new}{f'   (asked {asked})' if asked else ''}")
    lines += [_text(line).strip() for line in [*_standing_said(desk), *_shadow_said(desk)[:1]]]
    lines.append("They are read back bit for bit before they count; nothing flies by them until the pilot's switch.")
    return tuple(lines)


def _text(line: Words) -> str:
    return line if isinstance(line, str) else line[0]


def bank_title(state: State, width: int) -> tuple[str, str]:
    """What the vehicle holds."""
    if state.vehicle is None:
        return (fitted(" no vehicle: gains can be designed, and pushed once one is connected (1)", width), "bold")
    return (fitted(f" {bank_line(state.bank)}", width), "bold")
