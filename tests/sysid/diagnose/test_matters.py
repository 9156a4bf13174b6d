"""What is left and what it could do, against vehicles that flew with it; and the answers that follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import pytest
from planted import TABLE_4, fly
from planted_fits import records

from gcs.analysis.text.blocks import WIDTH, Sentence, broken
from gcs.analysis.text.matters import remainder_sentence
from sysid.control.stability import closed_loop
from sysid.data.dataset import dataset
from sysid.diagnose import matters
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import candidate
from sysid.diagnose.hidden import CouldHide
from sysid.diagnose.loop_change import Limit, MarginChange, held_gains, of_margins, parse_limit, seen
from sysid.diagnose.matters import FAINT_RIGHT, HIDES, Remainder, judged, may_not_matter, remainder
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.estimate import estimate
from sysid.model.compose import compose
from sysid.model.structure import Model

NONE = CouldHide((), ())
LEFT = Remainder(
    within_points=0.21,
    seen=MarginChange(gain_db=0.3, phase_deg=1.0),
    margins=None,
    margins_by=None,
    mode_hz=0.0,
    mode_damping=0.0,
    mode_by=None,
    limit=Limit(),
    unseen=0.0,
)


@pytest.mark.parametrize(
    ("effect", "size"), [("servo_lag", {"tau_s": 0.003}), ("gyro_misalignment", {"e": 0.05})], ids=["phase", "coupling"]
)
def test_the_error_that_is_seen_is_what_an_effect_does_to_margins(effect: str, size: dict[str, float]) -> None:
    """Gains are designed on a fit without the effect, and flown on the vehicle that has it."""
    on = dataset(records(fly(effect, size, seed=3, gusts=0.1, noise=0.001, duration_s=15.0, steps=4)), (0.0, 15.0))
    structure = compose("tpp", (), on.available, {"Omega_0": 171.2})
    parent = candidate(estimate(structure, on.viewed(structure.inputs), weights="constant"), (), on)
    gains, change = held_gains(parent.model), seen(parent)
    assert gains is not None
    assert change is not None
    flown = compose("tpp", [effect])
    there = closed_loop(gains, Model(flown, flown.vector({**TABLE_4, **size}))).margins
    assert there is not None
    true = of_margins(gains.margins, there)
    assert true.over(Limit()) > 1
    assert true.gain_db < 1.1 * change.gain_db
    assert true.phase_deg < 1.1 * change.phase_deg
    assert change.over(Limit()) < 1.5 * true.over(Limit())


@pytest.fixture(scope="module")
def clean() -> Diagnosis:
    """Nothing hidden, and two effects asked of which both are small."""
    flight = records(fly(None, {}, seed=5, duration_s=8.0))
    return diagnose(compose("tpp"), flight, chains=False)


@pytest.mark.usefixtures("few_effects_in_module")
def test_complete_means_that_nothing_that_matters_is_left(clean: Diagnosis) -> None:
    assert clean.verdict == "complete"
    left = remainder(clean, NONE)
    assert left.seen is None  # noise is not called an error
    assert 0 < left.within_points < 2
    assert judged(clean, left).confidence == clean.confidence
    assert judged(clean, replace(left, unseen=0.5)).confidence == pytest.approx((1 - 0.5 * HIDES) * clean.confidence)


@pytest.mark.usefixtures("few_effects_in_module")
def test_what_nothing_explains_and_does_not_matter_is_complete(
    clean: Diagnosis, monkeypatch: pytest.MonkeyPatch
) -> None:
    unexplained = replace(clean, verdict="unexplained", log_chance=-50.0)
    answer = judged(unexplained, LEFT)
    assert (answer.verdict, answer.confidence) == ("complete", 0.95)
    large = replace(LEFT, seen=MarginChange(gain_db=3.0, phase_deg=1.0))
    for left in (replace(LEFT, within_points=0.5), large):
        assert judged(unexplained, left) is unexplained
    assert judged(unexplained, replace(LEFT, within_points=0.5), asked=True).verdict == "complete"
    assert judged(unexplained, large, asked=True).verdict == "unexplained"
    feedback = replace(unexplained, reason="feedback")
    assert judged(feedback, LEFT) is feedback
    monkeypatch.setattr(matters, "noise_lost", lambda _: True)  # which moved the vehicle, and is bounded as all else
    assert (judged(feedback, LEFT).verdict, judged(feedback, LEFT).reason) == ("complete", None)
    assert judged(feedback, large) is feedback


@pytest.mark.usefixtures("few_effects_in_module")
def test_a_trace_that_no_entry_is_likelier_for_is_complete_though_margins_hardly_tell(clean: Diagnosis) -> None:
    """Noise on chirps folds back in a log of 50 Hz: 0.02 points of fit at 1e-5, of unknown margins."""
    trace = replace(clean, verdict="unexplained", log_chance=math.log(1e-5))
    unknown = replace(LEFT, seen=MarginChange(gain_db=4.0, phase_deg=1.0))
    answer = judged(trace, unknown)
    assert (answer.verdict, answer.confidence) == ("complete", 0.85)
    for other in (replace(trace, log_chance=math.log(1e-8)), replace(trace, chain=("x",))):
        assert judged(other, unknown) is other
    assert judged(trace, replace(unknown, within_points=0.45)).verdict == "complete"
    assert judged(trace, replace(unknown, within_points=0.55)) is trace
    more = replace(clean, verdict="unexplained", log_chance=math.log(1e-9), chain=("x",))
    assert judged(more, replace(LEFT, within_points=0.4)) is more, "what is plainly seen, or resembles an entry"


@pytest.mark.usefixtures("few_effects_in_module")
def test_what_has_a_name_is_missing_unless_a_limit_was_asked_for(clean: Diagnosis) -> None:
    named = replace(clean, verdict="missing", effect="servo_lag", chain=("servo_lag",), log_chance=-50.0)
    assert judged(named, LEFT) is named
    assert judged(named, LEFT, asked=True) is named  # and without a fit of it nothing is known


@pytest.mark.usefixtures("few_effects_in_module")
@pytest.mark.parametrize(
    ("log10_chance", "confidence", "chain", "verdict"),
    [
        (-6.0, 0.88, ("x",), "complete"),
        (-8.0, 0.88, ("x",), "missing"),
        (-6.0, 0.91, ("x",), "missing"),
        (-6.0, 0.6, ("x", "y"), "complete"),
        (-6.0, 0.7, ("x", "y"), "missing"),
    ],
    ids=[
        "a guess at what is hardly seen",
        "plainly seen",
        "surely named",
        "a guess at two",
        "two, of which few are sure",
    ],
)
def test_a_guess_at_what_is_hardly_seen_and_does_not_matter_is_none(
    clean: Diagnosis,
    monkeypatch: pytest.MonkeyPatch,
    log10_chance: float,
    confidence: float,
    chain: tuple[str, ...],
    verdict: str,
) -> None:
    chance = log10_chance * math.log(10)
    answer = replace(clean, verdict="missing", effect="x", chain=chain, log_chance=chance, confidence=confidence)
    change = MarginChange(gain_db=0.1, phase_deg=0.5)
    monkeypatch.setattr(matters, "winner_change", lambda _: change)
    said = judged(answer, LEFT)
    assert said.verdict == verdict
    if verdict == "complete":
        assert said.confidence <= 0.85
        assert judged(answer, replace(LEFT, within_points=0.4)).verdict == "missing"
        monkeypatch.setattr(matters, "winner_change", lambda _: None)  # no loop tells what it does
        assert judged(answer, LEFT).verdict == "missing"


@dataclass(frozen=True)
class Grown:
    """What a refit with one effect says, as far as it is asked."""

    nrmse_percent: dict[str, float]
    model: Model
    linear: bool = False


def faintly(clean: Diagnosis, log10_chance: float, gained: float, moved: float) -> Diagnosis:
    """One effect missing that gains so many points in pitch and makes M_a so much larger."""
    parent = clean.parent
    at = parent.model.values.copy()
    at[parent.model.structure.names.index("M_a")] *= 1 + moved
    reached = {**parent.nrmse_percent, "q": parent.nrmse_percent["q"] + gained}
    winner = replace(clean.candidates[0], fit=Grown(reached, Model(parent.model.structure, at)))  # type: ignore[arg-type]
    named = replace(clean, verdict="missing", effect=winner.effect, chain=(winner.effect,), candidates=(winner,))
    return replace(named, log_chance=log10_chance * math.log(10), confidence=0.96)


@pytest.mark.usefixtures("few_effects_in_module")
@pytest.mark.parametrize(
    ("log10_chance", "gained", "moved", "verdict"),
    [
        (-8.0, 0.3, 0.02, "complete"),
        (-12.0, 0.3, 0.02, "missing"),
        (-8.0, 0.7, 0.02, "missing"),
        (-8.0, 0.3, 0.08, "missing"),
        (-8.0, 0.3, -0.08, "missing"),
    ],
    ids=["slight", "plainly seen", "much fit", "another model", "another model, smaller"],
)
def test_one_effect_that_is_faintly_seen_and_does_little_is_nothing_that_matters(
    clean: Diagnosis,
    monkeypatch: pytest.MonkeyPatch,
    log10_chance: float,
    gained: float,
    moved: float,
    verdict: str,
) -> None:
    """Play, which no margin tells of, however wide the bound on what is left is in these gusts."""
    monkeypatch.setattr(matters, "winner_change", lambda _: None)
    answer, wide = faintly(clean, log10_chance, gained, moved), replace(LEFT, within_points=4.0)
    assert may_not_matter(answer) is (verdict == "complete")
    assert judged(answer, wide).verdict == verdict
    assert judged(replace(answer, chain=("x", "y")), wide).verdict == "missing", "two are no trace"
    if verdict == "complete":
        assert judged(answer, wide).confidence == FAINT_RIGHT
        monkeypatch.setattr(matters, "winner_change", lambda _: MarginChange(gain_db=0.1, phase_deg=9.0))
        assert judged(answer, wide) is answer, "where a loop tells that it could matter"


def test_limits_are_read_in_decibels_and_degrees() -> None:
    assert parse_limit("2dB") == Limit(gain_db=2.0)
    assert parse_limit("0.5 db, 3deg") == Limit(0.5, 3.0)
    assert Limit() == Limit(1.0, 5.0)
    for words in ("1", "1dB,2dB", "-1dB", "deg", "nandB", ""):
        with pytest.raises(ValueError, match=r".*"):
            parse_limit(words)


def test_it_is_told_in_78_columns() -> None:
    lines = broken(Sentence(remainder_sentence(LEFT), "  ", "    "))
    assert lines == [
        "  what is left, seen or not, could change at most 0.21 points of fit, margins",
        "    by 0.3 dB, 1.0°: it does not matter (below 1 dB, 5°)",
    ]
    assert max(map(len, lines)) <= WIDTH
    assert "it could matter (from 0.1 dB, 5°)" in remainder_sentence(replace(LEFT, limit=Limit(0.1, 5.0)))
    assert "no loop is designed" in remainder_sentence(replace(LEFT, seen=None))
