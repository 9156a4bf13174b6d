"""How far a diagnosis is, told while it is made: what is asked now, and what is known of each candidate so far.

Values handed to whoever listens; a `Ranking` puts them together. None of it is a verdict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

Effects = tuple[str, ...]
"""One effect, or a chain of two."""


class Stage(Enum):
    """What is asked, in this order; a stage may be left out."""

    NOISE = "noise"
    """The structure as it is: what of its error is noise."""
    SCORES = "scores"
    """Every entry of the catalogue, by one step from the structure."""
    SLOW = "slow modes"
    TERMS = "simple terms"
    REFITS = "refits"
    VALIDATION = "validation"
    """Held against the noise, and on runs that were not fitted where there are any."""
    WEIGHING = "weighing"
    """What of the error is noise, what simple terms explain beside the best, and the verdict."""
    SECONDS = "seconds"
    """Every entry once more, beside one of the best;"""
    CHAINS = "chains"
    """and chains of two refitted,"""
    ALONE = "alone"
    """and what only a chain found, alone."""
    HIDING = "hiding"
    """What could hide,"""
    FAILS = "fails"
    """where the model fails,"""
    REASONS = "reasons"
    """why the answer is this one,"""
    MANEUVER = "maneuver"
    """and what would tell more."""


class Known(Enum):
    """How far a candidate has come."""

    SCORED = "asked"
    REFITTED = "refitted"
    VALIDATED = "validated"


@dataclass(frozen=True, slots=True, kw_only=True)
class Asking:
    """What is asked now."""

    stage: Stage
    effects: Effects = ()
    number: int = 1
    """From 1, of so many as far as is known; None where that is not known."""
    of: int | None = None
    done: float | None = None
    """Share of the stage's work that lies behind, by prices known beforehand; None where these are not known."""
    at_most: bool = False
    """Whether the stage ends earlier as a rule: it has a budget."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """What is known of one candidate now."""

    effects: Effects
    known: Known
    promise: float = 0.0
    """Chi squared of its score."""
    removed: float | None = None
    """Error share less than the structure's, once refitted;"""
    avoidable: float | None = None
    """and that which is no noise, as far as the best refit tells."""
    nrmse_percent: Mapping[str, float] | None = None
    validation_nrmse_percent: Mapping[str, float] | None = None
    implausible: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstAnswer:
    """What single effects make of it, before chains of two are looked for."""

    verdict: str
    chain: Effects
    confidence: float
    shares: Mapping[Effects, float]
    """Of what can be explained, by candidate."""


Progress = Asking | Heard | FirstAnswer
Listener = Callable[[Progress], None]


def unheard(_: Progress) -> None:
    """Nobody listens."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """A candidate in the ranking."""

    effects: Effects
    known: Known
    share: float
    """0..1 of what can be explained, as far as is known; of a score, of what the best score promises."""
    heard: Heard

    @property
    def promised(self) -> bool:
        """Whether the share is a score's promise and no refit's."""
        return self.heard.removed is None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranking:
    """All that was heard, best first: what was refitted by what it explains, then the others by their scores."""

    asking: Asking | None = None
    first: FirstAnswer | None = None
    heard: Mapping[Effects, Heard] = field(default_factory=dict)
    avoidable: float | None = None
    """Error share, as far as the best refit tells."""
    standings: tuple[Standing, ...] = ()

    def after(self, news: Progress) -> Ranking:
        """With one thing more."""
        match news:
            case Asking():
                return replace(self, asking=news)
            case FirstAnswer():
                return _ranked(replace(self, first=news))
            case Heard():
                avoidable = self.avoidable if news.avoidable is None else news.avoidable
                return _ranked(replace(self, heard={**self.heard, news.effects: news}, avoidable=avoidable))

    @property
    def best(self) -> Standing | None:
        """What explains most of what was refitted at plausible values."""
        able = (one for one in self.standings if not one.promised and not one.heard.implausible)
        return next(able, None)


def _ranked(ranking: Ranking) -> Ranking:
    heard = ranking.heard.values()
    promised = max((one.promise for one in heard), default=0.0)
    final = {} if ranking.first is None else ranking.first.shares

    def share(one: Heard) -> float:
        if one.effects in final:
            return final[one.effects]
        part, whole = (one.promise, promised) if one.removed is None else (one.removed, ranking.avoidable or 0.0)
        return min(1.0, max(0.0, part / whole)) if whole > 0 else 0.0

    rows = [Standing(effects=one.effects, known=one.known, share=share(one), heard=one) for one in heard]
    rows.sort(key=lambda one: (one.promised, -one.share))
    return replace(ranking, standings=tuple(rows))
