"""An added effect in words: whether it helped, the ladder with the placebo, the parameters, the three signs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs.analysis.addition import Addition
from gcs.analysis.fits import assess
from gcs.analysis.ladder import NO_CHANGE, WORSE_POINTS, beats_placebo, change_text, rungs_of, together, worse
from gcs.analysis.text.blocks import WIDTH, Blocks, Sentence, block, command, text_of
from gcs.analysis.text.fit import judgement_document
from gcs.analysis.text.ladder import cut, ladder_text, moved_text

MARKS = {True: "✓", False: "✗", None: "?"}
"""Of a sign: seen, not seen, not to be seen in these runs."""


def addition_text(found: Addition, fit: str = "FIT.json", written: str | None = None) -> str:
    """All of it for a shell; 78 columns."""
    return text_of(addition_blocks(found, fit, written))


def addition_blocks(found: Addition, fit: str = "FIT.json", written: str | None = None) -> Blocks:
    """`answer`, `ladder`, `moved`, `signs`, `warning`s, and `next`, or `nothing` where it is not to be kept.

    fit, written: where the fit before lies, and where that with the effect does, if anywhere.
    """
    good, answer = outcome(found)
    rungs = rungs_of(found.after.model.structure.base_, found.after.lineage)
    wrong = found.placebo_rung
    if wrong is not None:
        rungs.append(("placebo", *wrong[1:]))
    signs = [Sentence(f"{one.name}: {one.text}", f" {MARKS[one.seen]} ", "   ") for one in found.signs]
    if not good:
        last = block("nothing", [f" nothing to keep: go on with {cut(fit, WIDTH - 30)}"])
    elif written is not None:
        last = block("next", command(f"tippath diagnose {written}"))
    else:
        last = block("next", [" next: the same with -o FIT2.json keeps it"])
    return (
        block("answer", [replace(answer, rest="  ")]),
        block("ladder", [*ladder_text(rungs, found.noise_floor_percent), *_placebo_sentences(found)]),
        block("moved", moved_text(found.before, found.after)),
        block("signs", signs),
        *(block("warning", [Sentence(f"warning: {text}", rest="  ")]) for text in found.after.warnings),
        last,
    )


def addition_document(found: Addition, folder: Path) -> dict[str, Any]:
    """The fit's document with what the ladder shows."""
    return {
        **found.after.to_json(folder),
        **judgement_document(assess(found.after, found.runs)),
        "noise_floor_percent": found.noise_floor_percent,
        "placebo": None if found.placebo is None else found.placebo.document,
        "signs": [sign.to_json() for sign in found.signs],
    }


def outcome(found: Addition) -> tuple[bool, Sentence]:
    """Whether to keep it, and that in a sentence."""
    name = Path(found.named).name
    before, after = found.before.nrmse_percent, found.after.nrmse_percent
    mixed = bool(worse(before, after))
    fall = f"{name}: {'' if mixed else 'the error falls, '}{change_text(before, after)}"
    signs = {one.key: one.seen for one in found.signs}
    if together(after) - together(before) < NO_CHANGE:
        return False, Sentence(f"{name} changes next to nothing here: the error stays as it was")
    was, now = found.before.validation_nrmse_percent, found.after.validation_nrmse_percent
    if was is not None and now is not None and together(now) - together(was) < -WORSE_POINTS:
        return False, Sentence(
            f"{fall}, but the error grows on runs that were not fitted: it follows the noise of the fitted ones"
        )
    if signs["plausible"] is False:
        return False, Sentence(f"{fall}, but only at implausible values: {name} stands in for something else")
    if signs["validation"] is False:
        return False, Sentence(f"{fall}, but not on runs that were not fitted: there is little of it, if anything")
    if signs["validation"] is None:
        return True, Sentence(f"{fall}; whether it would on other runs is open", offer="validate one")
    if was is not None and now is not None and (mixed or worse(was, now)):
        falls = "" if worse(was, now) else "the error falls, "
        return True, Sentence(f"{fall}; on runs that were not fitted {falls}{change_text(was, now)}")
    return True, Sentence(f"{fall}, and on runs that were not fitted too")


def _placebo_sentences(found: Addition) -> list[Sentence]:
    """What the placebo is, and what it proves."""
    wrong = found.placebo_rung
    if wrong is None:
        return []
    what = f"the placebo is {wrong[0]}, the best other effect with at most as many parameters"
    if beats_placebo(found.after.nrmse_percent, found.after.validation_nrmse_percent, wrong):
        said = f"{what}: mere freedom to follow the data would gain that much"
    else:
        said = f"{what}: ✗ it removes as much: not proved which of the two it is"
    return [Sentence(said, " ", "   ")]
