"""What a diagnosis asks now, and how the candidates stand so far, in words."""

from __future__ import annotations

from collections.abc import Callable

from gcs.analysis.ladder import short_names
from sysid.diagnose.progress import Asking, FirstAnswer, Listener, Progress, Ranking, Stage, Standing

_OF_ALL = {
    Stage.NOISE: "checking the noise floor",
    Stage.SLOW: "looking for slow modes",
    Stage.TERMS: "looking for simple terms beyond the catalogue",
    Stage.WEIGHING: "weighing what is noise and what is not",
    Stage.HIDING: "what could hide on these runs",
    Stage.FAILS: "where the model fails",
    Stage.REASONS: "why the answer is this one",
    Stage.MANEUVER: "which maneuver would tell more",
}
_OF_ONE = {
    Stage.SCORES: "asking {}",
    Stage.REFITS: "refitting with {}",
    Stage.VALIDATION: "checking {} on all runs",
    Stage.SECONDS: "asking what comes beside {}",
    Stage.CHAINS: "two together: {}",
    Stage.ALONE: "what {} does alone",
}


def asking_words(asking: Asking) -> str:
    """`refitting with servo_lag (3 of 12)`."""
    words = _OF_ALL.get(asking.stage) or _OF_ONE[asking.stage].format(effects_words(asking.effects))
    if asking.of is not None:
        return f"{words} ({asking.number} of {asking.of})"
    return f"{words} (the {_ordinal(asking.number)} try)" if asking.stage is Stage.CHAINS else words


def effects_words(effects: tuple[str, ...]) -> str:
    """`servo_lag + servo_backlash`; files without their folder."""
    return " + ".join(short_names(effects))


def best_words(ranking: Ranking) -> str:
    """`best so far gyro_filter, 94 %`; empty where nothing was refitted yet."""
    best = ranking.best
    return "" if best is None else f"best so far {effects_words(best.effects)}, {share_words(best)}"


def share_words(one: Standing) -> str:
    """`94 %`; `~40 %` of what only a score promises."""
    return f"{'~' if one.promised else ''}{100 * one.share:.0f} %"


def first_words(first: FirstAnswer) -> str:
    """`first answer: missing gyro_filter, confidence 0.98`."""
    return f"first answer: {_answered(first)}"


def before_pairs_words(first: FirstAnswer) -> str:
    """`first, one effect at a time: unexplained (nearest: gyro_filter), confidence 0.70; then pairs were searched`."""
    return f"first, one effect at a time: {_answered(first)}; then pairs were searched"


def _answered(first: FirstAnswer) -> str:
    chain = effects_words(first.chain)
    what = f" {chain}" if first.verdict == "missing" else f" (nearest: {chain})" if chain else ""
    return f"{first.verdict}{what}, confidence {first.confidence:.2f}"


def left_words(left_s: float | None, *, at_most: bool) -> str:
    """`about 12 s left`, `at most 2 min`; empty where that cannot be told."""
    if left_s is None:
        return ""
    time = f"{max(1, round(left_s))} s" if left_s < 100 else f"{left_s / 60:.0f} min"
    return f"at most {time} more" if at_most else f"about {time} left"


def spoken(say: Callable[[str], None]) -> Listener:
    """A listener that says what is asked, and nothing else."""

    def heard(news: Progress) -> None:
        if isinstance(news, Asking):
            say(asking_words(news))

    return heard


def _ordinal(number: int) -> str:
    ending = "th" if 10 < number % 100 < 14 else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
