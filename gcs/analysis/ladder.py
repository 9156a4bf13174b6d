"""The ladder: fits that grew from each other, one effect a rung, with what each reached on fitted and on other runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from sysid.model.base import Base, find_base

Nrmse = Mapping[str, float]
"""Percent by output, `p` and `q` of most models; 100 is perfect."""
RungNumbers = tuple[str, Nrmse, Nrmse | None]
"""A rung's name, its NRMSE fit on fitted runs and on validation runs."""

WORSE_POINTS = 0.2
"""NRMSE on validation runs, by which an effect must change them to count."""
SLIGHT = 1.0
"""NRMSE points, below which one output's change is slight."""
NO_CHANGE = 0.1
"""NRMSE points on fitted runs that are next to nothing."""


class Rung(Protocol):
    """A step of a fit's lineage, or of a repeated diagnosis."""

    @property
    def effects(self) -> tuple[str, ...]: ...
    @property
    def nrmse_percent(self) -> Nrmse: ...
    @property
    def validation_nrmse_percent(self) -> Nrmse | None: ...


@dataclass(frozen=True, kw_only=True)
class Step:
    """One rung of the ladder that a repeated question climbs."""

    effects: tuple[str, ...]
    nrmse_percent: dict[str, float]
    validation_nrmse_percent: dict[str, float] | None
    verdict: str | None
    """What was said of it; None where it was not asked."""
    effect: str | None
    confidence: float | None

    def to_json(self) -> dict[str, Any]:
        return {
            "effects": list(self.effects),
            "nrmse_percent": self.nrmse_percent,
            "validation_nrmse_percent": self.validation_nrmse_percent,
            "verdict": self.verdict,
            "effect": self.effect,
            "confidence": self.confidence,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorLeft:
    """What a rung leaves of one output's error. Shares are of the lowest rung's error power beyond noise."""

    output: str
    left: float
    """1 on the lowest rung, 0 where nothing but noise is left."""
    before: float
    """What the rung below left."""
    placebo: float | None
    """What the best wrong effect in this one's place left; None where none was tried."""
    nrmse_percent: float
    validation_percent: float | None
    better: bool | None
    """On the validation runs beside the rung below; None where it is much the same, or not known."""


def errors_left(
    rungs: Sequence[RungNumbers], placebos: Sequence[Nrmse | None], floor: Nrmse | None
) -> list[list[ErrorLeft]]:
    """For each rung, lowest first, what it leaves on each output; `floor` is the NRMSE of noise alone, None: not known.

    Where the lowest rung leaves nothing but noise, so do all.
    """
    found: list[list[ErrorLeft]] = []
    for (_, fitted, validated), wrong in zip(rungs, placebos, strict=True):
        each = []
        for k, (output, percent) in enumerate(fitted.items()):
            noise = 0.0 if floor is None else _power(floor[output])
            whole = _power(rungs[0][1][output]) - noise

            def share(percent: float, noise: float = noise, whole: float = whole) -> float:
                return min(max((_power(percent) - noise) / whole, 0.0), 1.0) if whole > 0 else 0.0

            below = rungs[len(found) - 1][2] if found else None
            change = 0.0 if validated is None or below is None else validated[output] - below[output]
            each.append(
                ErrorLeft(
                    output=output,
                    left=share(percent),
                    before=found[-1][k].left if found else share(percent),
                    placebo=None if wrong is None else share(wrong[output]),
                    nrmse_percent=percent,
                    validation_percent=None if validated is None else validated[output],
                    better=None if abs(change) < WORSE_POINTS else change > 0,
                )
            )
        found.append(each)
    return found


def _power(nrmse_percent: float) -> float:
    return (1 - nrmse_percent / 100) ** 2


def together(nrmse_percent: Mapping[str, float]) -> float:
    """NRMSE fit in percent of all outputs as one: error shares are added over axes, as the diagnosis adds them."""
    shares = [(1 - value / 100) ** 2 for value in nrmse_percent.values()]
    return 100 * (1 - math.sqrt(sum(shares) / len(shares)))


def worse(before: Nrmse, after: Nrmse) -> list[str]:
    """Outputs whose NRMSE fit is lower than before, as it is told."""
    return [output for output, value in after.items() if round(value, 1) < round(before[output], 1)]


def change_text(before: Nrmse, after: Nrmse) -> str:
    """`p 87.0 → 91.8, q 80.7 → 92.6 %`; where an output got worse, the best first,
    `q better 87.7 → 90.9, p slightly worse 89.9 → 89.7 %`.
    """
    numbers = {output: f"{before[output]:.1f} → {value:.1f}" for output, value in after.items()}
    if not worse(before, after):
        return ", ".join(f"{output} {told}" for output, told in numbers.items()) + " %"

    def word(output: str) -> str:
        change = round(after[output], 1) - round(before[output], 1)
        if change == 0:
            return "same"
        return f"{'slightly ' if abs(change) < SLIGHT else ''}{'better' if change > 0 else 'worse'}"

    best_first = sorted(after, key=lambda output: before[output] - after[output])
    return ", ".join(f"{output} {word(output)} {numbers[output]}" for output in best_first) + " %"


def beats_placebo(fitted: Nrmse, validated: Nrmse | None, placebo: RungNumbers) -> bool:
    """Whether a rung removes more error than its placebo, on fitted runs and, where both were judged, on others."""
    _, wrong, judged = placebo
    beyond = [together(fitted) - together(wrong)]
    if validated is not None and judged is not None:
        beyond.append(together(validated) - together(judged))
    return min(beyond) > WORSE_POINTS


def rung_names(base: Base, effects: Sequence[Sequence[str]]) -> list[str]:
    """`TPP`, `+ servo_lag`: the base with the effects it began with, then what each rung added."""
    bottom = _before(base, effects) or base.label
    if effects:
        bottom = " + ".join([bottom, *short_names(effects[0])])
    return [bottom, *(f"+ {name}" for name in added(base, effects))]


def added(base: Base, effects: Sequence[Sequence[str]]) -> list[str]:
    """What each rung above the lowest added. `flapping` turns CD into TPP, and leaves no effect to be named by."""
    from_smaller = _before(base, effects) is not None
    pairs = itertools.pairwise(effects[1:] if from_smaller else effects)
    names = [", ".join(short_names([one for one in now if one not in before])) for before, now in pairs]
    return [", ".join(base.contains), *names] if from_smaller else names


def _before(base: Base, effects: Sequence[Sequence[str]]) -> str | None:
    """The label of the smaller base that the ladder began with, where it did."""
    if base.reduces_to is None or len(effects) < 2 or len(effects[0]) != len(effects[1]):
        return None
    return find_base(base.reduces_to).label


def rungs_of(base: Base, rungs: Sequence[Rung]) -> list[RungNumbers]:
    """Rungs with their names, as pictures and tables want them."""
    names = rung_names(base, [one.effects for one in rungs])
    return [(name, one.nrmse_percent, one.validation_nrmse_percent) for name, one in zip(names, rungs, strict=True)]


def short_names(effects: Sequence[str]) -> list[str]:
    """Catalogue ids as they are, files without their folder."""
    return [Path(one).name for one in effects]


def pair_names(pairs: Sequence[Sequence[str]]) -> list[str]:
    """Of two effects that do together what one does: `transport_delay with dynamic_inflow`."""
    return [" with ".join(short_names(pair)) for pair in pairs]
