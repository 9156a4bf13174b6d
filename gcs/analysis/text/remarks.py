"""What the runs cost the answer of a diagnosis, in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import assert_never

from gcs.analysis.diagnosis import (
    ClocksDiffer,
    InALoop,
    LoopUntold,
    NoExcitation,
    NoMargins,
    NotAdded,
    NotSure,
    NoValidation,
    OneRun,
    Remark,
    StepsLost,
    StoppedAsking,
)
from gcs.analysis.quantities import listed
from gcs.analysis.text.blocks import SHELL, Offers, Sentence, whole
from gcs.analysis.text.checks import early_text
from sysid.diagnose.unsearched import BudgetSpent, LittleLeft, MuchLeft, Unsearched


def remark_text(remark: Remark, offers: Offers = SHELL) -> str:
    """A remark with what a face offers."""
    return whole(remark_sentence(remark), offers)


def remark_sentence(remark: Remark, first: str = "", rest: str = "") -> Sentence:
    """The same, still to be broken."""
    offer = "validate some" if isinstance(remark, NoValidation) else ""
    return Sentence(_text(remark), first, rest, offer=offer)


def _text(remark: Remark) -> str:
    match remark:
        case NoExcitation():
            return (
                "no excitation is logged: gusts reach the commands through the feedback, and some of what these seem "
                "to explain is the loop's. Log what is added to the commands, and ask again"
            )
        case NoMargins():
            return (
                "no gains hold this model, so --matters has no margins to judge by: points of NRMSE alone decided what "
                "is told"
            )
        case NoValidation():
            return "no validation runs: whether it holds on others is open"
        case OneRun():
            return "one run only: what differs from run to run cannot show"
        case NotAdded(effect, values):
            return f"not added: with {effect} the fit goes to {listed(values)}, which physics does not allow"
        case NotSure(effect, confidence):
            return f"not added: {effect} has a confidence of {confidence:.2f} only, and nothing is asked beside a guess"
        case StoppedAsking(questions):
            return f"stopped after {questions} questions"
        case LittleLeft() | BudgetSpent() | MuchLeft():
            return _of_chains(remark)
        case InALoop(effects, pole):
            named = f" with {listed(effects)}" if effects else ""
            return (
                f"the model{named} is unstable (pole at {pole:+.1f} 1/s): so data look that were flown through a pilot "
                "or controller without excitation of their own. Kind and size of what was found hold only as far as "
                "that loop lets them: fly a chirp with noise on every axis, with the excitation logged, and ask that"
            )
        case ClocksDiffer(early):
            return f"{early_text(early)}. That explains what the model leaves, and no effect does it better"
        case LoopUntold(thinned):
            return f"{early_text(thinned)}. Effects were asked with commands held for as short as that"
        case StepsLost(runs):
            return (
                f"not judged by {listed([Path(one).name for one in runs])}: the log is slower than the loop and does "
                "not tell when their commands stepped. Log every loop, or validate by chirps"
            )
    assert_never(remark)


def _of_chains(unsearched: Unsearched) -> str:
    match unsearched:
        case LittleLeft(points):
            return f"chains of two were not searched: at most {_tenths_up(points)} points of NRMSE are left"
        case BudgetSpent(chains, firsts, interrupted):
            beside = [f"all beside {Path(name).name}" for name in firsts]
            if not chains and not beside:
                return "the search for chains of two was interrupted"
            why = "the search was interrupted" if interrupted else "they cost much and promised less"
            return f"chains of two not tried, because {why}: {listed([*map(_chain, chains), *beside])}"
        case MuchLeft(chain, explained):
            return (
                f"other chains of two were not searched: the best with the likeliest effect, {_chain(chain)}, explains "
                f"{100 * explained:.0f} % of what is there, and where a chain is the answer it is nearly all"
            )
    assert_never(unsearched)


def _chain(effects: Sequence[str]) -> str:
    return " + ".join(Path(name).name for name in effects)


def _tenths_up(points: float) -> str:
    """Rounded up to a tenth, so that "at most" holds."""
    return f"{math.ceil(10 * points - 1e-9) / 10:.1f}"
