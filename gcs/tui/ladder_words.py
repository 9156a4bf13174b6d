"""The ladder, as lines: what its top rung says, what may be the next, whether what was added is really there."""

from __future__ import annotations

from gcs.analysis.ladder import beats_placebo, short_names
from gcs.analysis.text.blocks import spaced
from gcs.desk.state import DeskState, Rung
from gcs.link.decode import sanitise
from gcs.tui.desk_words import FIT_RUNS, KEYS, TO_TYPE, Line, broken, candidates, indented, pair, short_name
from gcs.tui.fit_words import MARKS
from gcs.tui.ranking_words import candidates_of
from gcs.tui.words import fitted, justified

VERDICTS = {
    "complete": " ✓ complete: what is left is noise",
    "unexplained": " ? unexplained: no known effect does it",
    "missing": " ○ something is missing still",
}


def status_lines(desk: DeskState, width: int) -> list[Line]:
    """What was said of the top rung; its placebo, and the signs that it is really there."""
    rung = desk.current
    if rung is None:
        return [fitted(" 4 fits a flight first: the fit is the lowest rung", width)]
    lines = [VERDICTS.get(rung.verdict or "", " ○ not diagnosed yet: D")]
    if rung.verdict == "complete" and rung.answer is not None:
        if rung.answer.matters:
            lines = [" ○ complete, but what may hide could matter: E"]
        elif not rung.answer.noise_left:
            lines = [" ✓ complete: what is left and seen does not matter"]
    if rung.placebo is not None:
        name, percent, _ = rung.placebo
        if beats_placebo(rung.nrmse_percent, rung.validation_nrmse_percent, rung.placebo):
            lines.append(f"   placebo {sanitise(name)}: {pair(percent)} instead of {pair(rung.nrmse_percent)}")
        else:
            lines.append(f" ✗ its placebo removes as much: not proved ({sanitise(name)} {pair(percent)})")
    if rung.signs:
        lines.append("   " + "  ".join(f"{MARKS[one.seen]} {one.key}" for one in rung.signs))
    return [fitted(line, width) for line in lines]


def next_candidates(desk: DeskState, width: int, height: int) -> list[Line]:
    """What the top rung's diagnosis offers, with shares; how many could not be asked."""
    rung = desk.current
    if rung is None or (rung.answer is None and desk.ranking is None):
        return [(fitted(" next candidates", width), "underline"), fitted(" D: which effect is missing", width)]
    rows = [(short_name(one.effects), one.share, "") for one in candidates_of(desk)]
    if rung.answer is not None:
        rows = candidates(rung.answer)
    asked = [one for one in rows if one[1] is not None]
    untold = len(rows) - len(asked)
    head: Line = (justified(" next candidates", "share ", width), "underline")
    if rung.verdict == "complete":
        lines: list[Line] = [_none_offered(rung)]
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


def _none_offered(rung: Rung) -> str:
    if rung.answer is not None and rung.answer.matters:
        return " none, but what may hide could matter"
    if rung.answer is not None and not rung.answer.noise_left:
        return " none: what is left does not matter"
    return " none: what is left is noise"


def sign_lines(rung: Rung, width: int) -> list[Line]:
    """What was added and whether it is really there: the command's text, less what to type."""
    text = rung.addition_text
    if not text:
        return [
            "",
            " added when the flight was last open: U, then D and A again for its placebo"
            if rung.effect
            else " the lowest rung has no placebo: nothing was added",
        ]
    return broken(indented(spaced(text, KEYS, but=TO_TYPE)), width)


def teller_lines(rung: Rung, desk: DeskState, width: int) -> list[Line]:
    """Which maneuver would tell, and what could hide."""
    found = rung.answer
    if found is None:
        return ["", " not diagnosed yet: D asks, and then knows which maneuver would tell more"]
    lines: list[Line] = []
    if found.plan is not None:
        lines += [(f" to tell {' from '.join(short_names(found.plan.separates))}", "bold")]
        lines += [f"   {found.plan.maneuver}", f"   {found.plan.why}"]
        if found.plan.fit_runs:
            lines.append(f"   {FIT_RUNS}")
        elif found.plan.card is None:
            lines.append(f"   {found.plan.how or 'no card can hold that'}")
        else:
            lines.append("   6, then W writes it as a test card")
    else:
        lines.append(" no maneuver would tell more")
    if desk.card is not None:
        lines.append(f" written: {desk.card}; 2, then C flies it")
    lines += ["", *(f" {text}" for text in found.hiding)]
    return broken(lines, width)
