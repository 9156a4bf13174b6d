"""The app's Diagnose screen offers keys, and never what one types in a shell, whatever is to be told apart how."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Callable, Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from fake_desk import ASKED, OPEN
from msgspec import structs

from gcs.analysis.answer import answer_of
from gcs.analysis.candidates import ranked
from gcs.analysis.diagnosis import Slight, _slight, remarks_on
from gcs.analysis.text.diagnosis import diagnosis_blocks, diagnosis_text
from gcs.analysis.text.maneuvers import maneuver_text, proposal_text
from gcs.analysis.text.matters import slight_sentence
from gcs.tui import desk_words
from sysid.compare.finding_kinds import AtTheEnds
from sysid.diagnose.explain import Explanation
from sysid.diagnose.loop_change import Limit, MarginChange
from sysid.diagnose.maneuver_plans import Plan
from sysid.diagnose.next_maneuver import NextManeuver
from sysid.diagnose.progress import FirstAnswer
from sysid.diagnose.proposals import FitRuns, FurtherApart, HalfAndFull, LinearHalves
from sysid.diagnose.slow_modes import SlowMode
from sysid.model.effect import catalogue

CHIRP = Plan(kind="chirp", axis="roll", amplitude=0.1, f_start_hz=0.5, f_stop_hz=10.0, duration_s=30.0)
PLANS = [
    replace(CHIRP, axis=axis, kind=kind, duration_s=duration_s, times=times, repeats=repeats)
    for axis, (kind, duration_s), times, repeats in itertools.product(
        ("roll", "pitch", "elevator"), (("chirp", 30.0), ("doublet", 6.0)), (1.0, 1.41), (1, 2, 3)
    )
]
WHY = FurtherApart(sigma=4.0, before=1.0)
HALVES = NextManeuver(HalfAndFull(CHIRP), ("linear", "nonlinear"), LinearHalves(0.2), 4.0, None)


def unexplained(proposal: NextManeuver) -> Any:
    """A diagnosis of which nothing is known but what to fly next."""
    nrmse = {"p": 60.0, "q": 60.0}
    structure = SimpleNamespace(base="tpp", effects=(), parameters=())
    parent = SimpleNamespace(nrmse_percent=nrmse, model=SimpleNamespace(structure=structure, values=()))
    last = SimpleNamespace(
        verdict="unexplained", winner=None, chain=(), candidates=(), pairs=(), indistinguishable=(), parent=parent,
        noise_floor_percent={"p": 90.0, "q": 90.0}, confidence=0.5, terms=None, term=None, mode=None, stands_in=False,
        effect=None, reason=None, first=None, validation_nrmse_percent=None, noise_left=False,
    )  # fmt: skip
    return SimpleNamespace(
        fit=SimpleNamespace(model=SimpleNamespace(structure=structure), nrmse_percent=nrmse), rungs=(None,), last=last,
        remarks=(),
        comparison=SimpleNamespace(suspicions=(), findings=()), next=proposal, added=None,
        hiding=SimpleNamespace(harmful=(), others=()), explanation=Explanation(effects=(), what=()),
        remainder=None, slight=None, runs=SimpleNamespace(records=()),
    )  # fmt: skip


EMPTY = answer_of(unexplained(HALVES))


def of_every_length(pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """One pair for every length of the words: what is broken into lines differs with it, and with nothing else."""
    return [*{(len(one), len(other)): (one, other) for one, other in pairs}.values()]


@pytest.mark.parametrize("some", [of_every_length, pytest.param(list, marks=pytest.mark.thorough)])
@pytest.mark.parametrize("plan", PLANS, ids=proposal_text)
def test_every_proposal_offers_the_key_and_never_the_option(
    plan: Plan, some: Callable[[Iterable[tuple[str, str]]], list[tuple[str, str]]]
) -> None:
    shell, keys = [], []
    for separates in some(itertools.permutations(catalogue(), 2)):
        diagnosis = unexplained(NextManeuver(plan, separates, WHY, 4.0, {"name": "card", "maneuver": []}))
        rung = replace(ASKED, answer=structs.replace(EMPTY, brief=diagnosis_blocks(diagnosis)))
        lines = desk_words.verdict_lines(replace(OPEN, ladder=(rung,)), 80)
        words = " ".join(" ".join(line if isinstance(line, str) else line[0] for line in lines).split())
        shell += [separates] if "CARD.toml" in words else []
        keys += [] if "; W writes that as a test card" in words else [separates]
    assert not shell
    assert not keys


def shown(diagnosis: Any) -> str:
    """What the Diagnose and the Compare screens show of it, brief and in full, on one line."""
    rung = replace(ASKED, answer=answer_of(diagnosis), comparison=diagnosis.comparison)
    desk = replace(OPEN, ladder=(rung,))
    screens = (
        desk_words.verdict_lines(desk, 80),
        desk_words.explained_lines(rung, 80),
        desk_words.compare_lines(desk, 80, full=False),
    )
    return " ".join(" ".join(line if isinstance(line, str) else line[0] for each in screens for line in each).split())


def test_without_validation_runs_the_app_names_its_keys_and_a_shell_the_option() -> None:
    diagnosis = unexplained(HALVES)
    diagnosis.remarks = remarks_on([], [])
    words = shown(diagnosis)
    assert "whether it holds on others is open; 3, then V marks some, and 4, then F fits again" in words
    assert "--" not in words
    shell = " ".join(diagnosis_text(diagnosis).split())
    assert "whether it holds on others is open; name some with --validate" in shell


def test_a_slow_mode_is_told_with_its_frequency() -> None:
    diagnosis = unexplained(HALVES)
    diagnosis.last.mode = SlowMode(frequency_hz=0.759, chi_squared=85.0, log_p=-35.0)
    assert "a slow mode at 0.76 Hz would do much: a load that swings, fuel that sloshes" in shown(diagnosis)


def test_an_error_at_the_ends_is_cut_off_in_a_shell_and_looked_at_in_the_app() -> None:
    diagnosis = unexplained(HALVES)
    diagnosis.comparison.findings = (AtTheEnds(axis="roll", share=0.4, first=True, seconds=2.0),)
    words = shown(diagnosis)
    assert words.count("of the error sits in the first 2 s of the runs: look at what happens there") == 3
    assert "--" not in words
    shell = " ".join(diagnosis_text(diagnosis).split())
    assert "of the runs: cut them off with --window, or look at what happens there" in shell


def test_a_shell_is_told_the_option() -> None:
    proposal = NextManeuver(PLANS[0], ("servo_lag", "gyro_lag"), WHY, 4.0, {"name": "card", "maneuver": []})
    words = " ".join(diagnosis_text(unexplained(proposal)).split())
    assert (
        f"to tell servo_lag from gyro_lag: {proposal_text(PLANS[0])}; --card CARD.toml writes that as a test card"
        in words
    )
    without = diagnosis_text(unexplained(replace(proposal, card=None)))
    assert "CARD.toml" not in without


def test_what_was_flown_and_only_judges_is_to_be_fitted_and_not_flown_again() -> None:
    runs = FitRuns(("flight.BIN#5", "flight.BIN#6"), "doublet", "roll")
    diagnosis = unexplained(NextManeuver(runs, ("servo_lag", "gyro_lag"), WHY, 4.0, None))
    flown = [
        SimpleNamespace(id=f"flight.BIN#{number}", path="my own flights of this summer/flight.BIN")
        for number in (1, 5, 6, 7)
    ]
    diagnosis.runs.records, diagnosis.last.validation = flown[:1], SimpleNamespace(records=flown[1:])
    use = "use flight.BIN#5, #6 in the fit too: they were flown already (roll doublet), and only judge so far"
    words = shown(diagnosis)
    assert f"to tell servo_lag from gyro_lag: {use}; 3, then F marks them, and 4, then F fits again" in words
    assert "tippath" not in words
    shell = diagnosis_text(diagnosis, "FIT.json")
    asked = shlex.split(shell[shell.index("or: ") + 4 : shell.index("in full")].replace("\\\n", ""))
    named = [f"my own flights of this summer/flight.BIN#{number}" for number in (1, 5, 6)]
    assert asked == [
        "tippath",
        "diagnose",
        "FIT.json",
        *named,
        "--validate",
        "my own flights of this summer/flight.BIN#7",
    ]


def test_it_is_said_where_a_maneuver_was_flown_already() -> None:
    again = NextManeuver(PLANS[0], ("a", "b"), replace(WHY, repeats=("flight.BIN#1", "flight.BIN#2")), 4.0, None)
    assert maneuver_text(again) == f"{proposal_text(PLANS[0])}, once more after flight.BIN#1, #2"
    few = replace(again, why=replace(WHY, too_little=(("flight.BIN#5",), 1.26)))
    assert "beside flight.BIN#5, flown so, only judging, and telling too little (1.3 of 3 standard" in maneuver_text(
        few
    )


def test_what_was_answered_before_pairs_were_searched_stays() -> None:
    diagnosis = unexplained(HALVES)
    diagnosis.last.first = FirstAnswer(verdict="unexplained", chain=(), confidence=0.7, shares={})
    assert "first, one effect at a time" not in shown(diagnosis)
    diagnosis.last.first = replace(diagnosis.last.first, verdict="missing", chain=("servo_lag",))
    line = "first, one effect at a time: missing servo_lag, confidence 0.70; then pairs were searched"
    assert line in shown(diagnosis)


def test_candidates_stand_by_what_they_explain_the_answer_first() -> None:
    def one(name: str, share: float, bic: float) -> Any:
        return SimpleNamespace(effects=(name,), fit=object(), explained_share=share, delta_bic=bic)

    each = [one("a", 0.6, -9.0), one("b", 0.9, -8.0), one("c", 0.2, -7.0), one("d", 0.9, -8.5)]
    last: Any = SimpleNamespace(pairs=(one("e", 0.7, 0.0), one("f", 1.0, 0.0)), candidates=each, winner=each[2])
    assert [one.effects[0] for one in ranked(last)] == ["c", "d", "b", "e", "a"]
    last.winner = last.pairs[1]
    assert [one.effects[0] for one in ranked(last)] == ["f", "d", "b", "e", "a", "c"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            MarginChange(gain_db=0.1, phase_deg=0.44),
            "moves margins by 0.1 dB, 0.4°: it hardly matters (below 1 dB, 5°)",
        ),
        (MarginChange(gain_db=0.1, phase_deg=6.0), "moves margins by 0.1 dB, 6.0°: it could matter (from 1 dB, 5°)"),
        (None, "no loop is designed on it that tells whether that matters"),
    ],
)
def test_what_gains_little_fit_is_said_to_matter_or_hardly(change: MarginChange | None, said: str) -> None:
    words = slight_sentence(Slight("servo_lag", 0.23, 0.02, change, Limit()))
    assert words.startswith("it gains 0.2 points of fit only")
    assert words.endswith(said)


def test_what_gains_much_fit_needs_no_word_on_whether_it_matters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gcs.analysis.diagnosis.winner_change", lambda answer: None)
    fit = SimpleNamespace(nrmse_percent={"p": 98.0, "q": 99.0})
    asked: Any = SimpleNamespace(verdict="missing", chain=("servo_lag",), winner=SimpleNamespace(fit=fit), parent=fit)
    monkeypatch.setattr("gcs.analysis.diagnosis.shift", lambda answer: 0.0)
    assert _slight(asked, Limit()) == Slight("servo_lag", 0.0, 0.0, None, Limit())
    asked.parent = SimpleNamespace(nrmse_percent={"p": 90.0, "q": 99.0})
    assert _slight(asked, Limit()) is None
    asked.verdict, asked.parent = "unexplained", fit
    assert _slight(asked, Limit()) is None
