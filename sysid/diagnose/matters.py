"""Does it matter: what is left of a fit's error, in points of fit, and what it could do to modes and margins.

What is left and seen is measured, as an error of the model's response in windows of frequency, with its 95 % limit: at
the crossings of the loop that would be designed on the fit it becomes, to first order, a change of that loop's margins.
What is not seen is bounded by what could hide: each effect at the largest size that these runs would not show, in the
loop. The sizes of both are held against a limit, which margins that count as sensible set unless the user does.

It is a bound on small motion, where something was flown: a crossing beyond the band has no bound but that of the
effects that could hide, and play and limits have no margins.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.control.stability import Margins, closed_loop
from sysid.diagnose.confidence import COMPLETE_RIGHT
from sysid.diagnose.hidden import CouldHide, Hidden
from sysid.diagnose.left_by_one import LITTLE_POINTS
from sysid.diagnose.loop_change import UPPER, Limit, MarginChange, held_gains, of_margins, seen
from sysid.diagnose.thinned import noise_lost
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.result import finite

WELL_KNOWN = 0.95
"""Confidence at most, where something is left that is seen and bounded by its 95 % limit;"""
IN_DOUBT = 0.85
"""where it is hardly seen: all of 15 on strangers of five judgements were right."""
HIDES = 0.04
"""How often something hides behind a fit that is called complete: in 6 of 378 strangers of which three in five lacked
nothing, in 32 of 286 where one in three did."""
TRACE_POINTS = 0.5
"""Of NRMSE, that may be left of what is hardly seen and no entry is likelier for: of four strangers of which such a
trace was unexplained the one that hid nothing had 0.44, the others 0.55 to 2.2."""
HARDLY_SEEN, HARDLY_NAMED, HARDLY_BOTH = math.log(1e-7), 0.89, 0.65
"""Logarithm of the chance of noise, and confidence of one effect and of two, below which a name is no better than none:
of 383 clean training strangers two showed one, at chances of 1e-4 and 1e-6, of 0.89 and less; of 170 that hid an effect
five, three of them rightly. Where more is seen, names of so little confidence are mostly right."""

FAINT = math.log(1e-10)
"""Logarithm of the chance of noise, above which one effect that has a name is faintly seen;"""
FAINT_POINTS, FAINT_SHIFT = 0.5, 0.05
"""and up to how many points of NRMSE it then gains, and moves a watched number by, relative, for nothing that matters
to be missing. Of 14 such strangers of two judgements two hid nothing and three had another name than what they hid; by
the truth it cost all of these at most 0.5 points and 5 %, too. Six that gain or move more had the right name."""
FAINT_RIGHT = 0.95
"""Confidence at most, of `complete` then: all of 37 of a judgement were right."""


@dataclass(frozen=True, kw_only=True)
class Remainder:
    """What is left, and what it could do."""

    within_points: float
    """Of NRMSE fit, that could still be gained at most, in the output that has most left."""
    seen: MarginChange | None
    """By what the commands explain of the error, where that is significant; None without gains that hold the model, or
    without bins there."""
    margins: MarginChange | None
    """By the effect that could hide and changes them most; None where none has any."""
    margins_by: Hidden | None
    mode_hz: float
    """Change of a mode's frequency, and"""
    mode_damping: float
    """of its damping ratio, by the effects that could hide and change them most."""
    mode_by: Hidden | None
    limit: Limit
    unseen: float
    """Chance that an effect would not show at the size from which on it matters, where there is one."""

    @property
    def matters(self) -> bool | None:
        """Whether what is left could; None where no loop tells."""
        told = [one.over(self.limit) for one in (self.seen, self.margins) if one is not None]
        return max(told) > 1 if told else None

    def to_json(self) -> dict[str, Any]:
        """Keys of the `tippath.diagnosis/1` document."""
        return {
            "within_points": finite(self.within_points),
            "remainder": {
                "seen": None if self.seen is None else _margins_json(self.seen),
                "margins": None if self.margins is None else _margins_json(self.margins),
                "margins_effect": None if self.margins_by is None else self.margins_by.effect,
                "modes": {"frequency_hz": finite(self.mode_hz), "damping_ratio": finite(self.mode_damping)},
                "modes_effect": None if self.mode_by is None else self.mode_by.effect,
                "limit": {"gain_db": self.limit.gain_db, "phase_deg": self.limit.phase_deg},
                "matters": self.matters,
            },
        }


def _margins_json(one: MarginChange) -> dict[str, float | None]:
    return {"gain_db": finite(one.gain_db), "phase_deg": finite(one.phase_deg)}


def remainder(answer: Diagnosis, hiding: CouldHide, limit: Limit | None = None) -> Remainder:
    """Of a diagnosis about its parent, beside which this could hide."""
    limit = limit or Limit()
    hidden = [one for group in (*hiding.harmful, *hiding.others) for one in group]
    moved = [(one, of_margins(*one.margins)) for one in hidden if one.margins is not None]
    by, most = max(moved, key=lambda each: each[1].over(limit), default=(None, None))
    modes = [(one, *_of_modes(one)) for one in hidden if one.modes]
    return Remainder(
        within_points=within_points(answer),
        seen=None if answer.noise_left else seen(answer.parent),
        margins=most,
        margins_by=by,
        mode_hz=max((hz for _, hz, _ in modes), default=0.0),
        mode_damping=max((damping for *_, damping in modes), default=0.0),
        mode_by=max(modes, key=lambda each: each[1], default=(None,))[0],
        limit=limit,
        unseen=max((_chance(one, change, limit) for one, change in moved), default=0.0),
    )


def judged(answer: Diagnosis, left: Remainder, *, asked: bool = False) -> Diagnosis:
    """The diagnosis as what matters has it.

    `complete` then says that nothing that matters is left. What nothing explains and does not matter is nothing, where
    it is little, or what is hardly seen and no entry is likelier for, however vaguely it is known what that does to
    margins; what is missing by name only where it is hardly seen, too, or the limit was asked for (`asked`).
    """
    if answer.verdict == "complete":
        return replace(answer, confidence=answer.confidence * (1 - HIDES * left.unseen))
    confidence = _that_nothing_matters(answer, left, asked)
    if confidence is None or (answer.reason is not None and not noise_lost(answer.parent.dataset)):
        return answer
    return replace(
        answer,
        verdict="complete",
        reason=None,
        effect=None,
        stands_in=False,
        chain=(),
        indistinguishable=(),
        indistinguishable_pairs=(),
        equivalent={},
        explained_share=None,
        lead=None,
        sizes=(),
        confidence=min(COMPLETE_RIGHT * (1 - HIDES * left.unseen), confidence),
    )


def _that_nothing_matters(answer: Diagnosis, left: Remainder, asked: bool) -> float | None:
    """How sure it is at most, of an answer that names or leaves something; None where it may matter."""
    change = winner_change(answer) if answer.verdict == "missing" else left.seen
    harmless = change is not None and change.over(left.limit) <= 1
    if slight_and_faint(answer) and (change is None or harmless):
        return FAINT_RIGHT
    trace = not answer.chain and answer.log_chance > HARDLY_SEEN
    hardly = trace or (hardly_seen(answer) and harmless)
    nothing = hardly or (answer.verdict == "unexplained" and (harmless or change is None))
    little = left.within_points <= (TRACE_POINTS if trace else LITTLE_POINTS) and nothing
    if not (little or (asked and harmless)):
        return None
    return IN_DOUBT if hardly else WELL_KNOWN


def hardly_seen(answer: Diagnosis) -> bool:
    """Whether the name of what is missing is little surer than that anything is."""
    least = HARDLY_BOTH if len(answer.chain) > 1 else HARDLY_NAMED
    return answer.verdict == "missing" and answer.log_chance > HARDLY_SEEN and answer.confidence < least


def slight_and_faint(answer: Diagnosis) -> bool:
    """Whether one effect is missing by name that is faintly seen, gains little fit and moves no number much that gains
    are designed by."""
    winner, parent = answer.winner, answer.parent
    if answer.verdict != "missing" or len(answer.chain) != 1 or answer.log_chance <= FAINT:
        return False
    if winner is None or winner.fit is None:
        return False
    gained = max(winner.fit.nrmse_percent[name] - value for name, value in parent.nrmse_percent.items())
    return gained <= FAINT_POINTS and shift(answer) <= FAINT_SHIFT


def shift(answer: Diagnosis) -> float:
    """By how much of itself the winner moves a number of the base that gains hang on, at most."""
    before, winner = answer.parent.model, answer.winner
    if winner is None or winner.fit is None:
        return 0.0
    after = winner.fit.model
    both = [one for one in before.structure.base_.watched if one in before.by_name and one in after.by_name]
    return max((abs(after[name] / before[name] - 1) for name in both if before[name]), default=0.0)


def may_not_matter(answer: Diagnosis) -> bool:
    """Whether what matters is asked of this answer, no limit being given: of all but what is missing for sure."""
    return answer.verdict != "missing" or hardly_seen(answer) or slight_and_faint(answer)


def within_points(answer: Diagnosis) -> float:
    """NRMSE that could still be gained, at the 95 % limit of what the commands explain of the error, and by what the
    best candidate or a simple term reaches."""
    parent, division = answer.parent, answer.parent.division
    share = parent.estimate.error.shares
    whole = np.maximum(np.sum(division.power, axis=0), 1e-300)
    own = np.real(np.einsum("wkk->wk", division.level))
    unknowns = division.degrees / (2 * len(whole) * len(own)) if division.measured else 2.0 * len(division.references)
    chance = np.sqrt(unknowns * np.sum(own**2, axis=0))
    explained = np.maximum(np.sum(division.explained, axis=0), 0) + UPPER * chance
    left = share * (1 - np.clip(explained / whole, 0, 1))
    points = 100 * (np.sqrt(share) - np.sqrt(left))
    reached = [answer.noise_floor_percent[name] - value for name, value in parent.nrmse_percent.items()]
    return float(max(*points, *reached, 0.0))


def winner_change(answer: Diagnosis) -> MarginChange | None:
    """What the effect that is missing does to margins of the loop designed without it."""
    winner, gains = answer.winner, held_gains(answer.parent.model)
    if winner is None or winner.fit is None or gains is None or not winner.fit.model.structure.linear:
        return None
    there = closed_loop(gains, winner.fit.model).margins
    return of_margins(gains.margins, there or Margins(0.0, 0.0, 0.0))


def _of_modes(one: Hidden) -> tuple[float, float]:
    """Largest changes of a frequency, Hz, and of a damping ratio."""
    return (
        max(abs(there.frequency_hz - here.frequency_hz) for here, there in one.modes),
        max(abs(there.damping_ratio - here.damping_ratio) for here, there in one.modes),
    )


def _chance(one: Hidden, change: MarginChange, limit: Limit) -> float:
    """That it hides at a size that matters: its size in standard errors, in proportion to what it changes."""
    if not one.visible or not math.isfinite(one.distance):
        return 0.0
    errors = one.distance / max(change.over(limit), 1e-300)
    return math.erfc(errors / math.sqrt(2))
