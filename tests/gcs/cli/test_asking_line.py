"""A diagnosis under way on a terminal: a line that says what is asked, the best so far and how long it will take."""

from __future__ import annotations

import io

from gcs.analysis.remaining import Remaining
from gcs.analysis.text.progress import asking_words
from gcs.cli.asking import AskingLine
from sysid.diagnose.progress import Asking, FirstAnswer, Heard, Known, Stage

NOISE = Asking(stage=Stage.NOISE, of=23)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def refits(number: int, done: float) -> Asking:
    return Asking(stage=Stage.REFITS, effects=("servo_lag",), number=number, of=4, done=done)


def tell(line: AskingLine, now: list[float]) -> None:
    line(NOISE)
    line(refits(1, 0.0))
    line(Heard(effects=("servo_lag",), known=Known.REFITTED, removed=0.09, avoidable=0.1, nrmse_percent={"p": 80.0}))
    now[0] = 2.0
    line(refits(2, 0.25))
    line(FirstAnswer(verdict="missing", chain=("servo_lag",), confidence=0.97, shares={("servo_lag",): 0.94}))


def test_it_says_what_is_asked_the_best_and_how_long(monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    out, now = Terminal(), [0.0]
    with AskingLine(out, lambda: now[0]) as line:
        tell(line, now)
    shown = out.getvalue()
    assert "checking the noise floor (1 of 23)" in shown
    assert "refitting with servo_lag (2 of 4)   best so far servo_lag, 90 %   about 6 s left" in shown
    assert "first answer: missing servo_lag, confidence 0.97; two together are looked for" in shown


def test_where_nobody_looks_nothing_is_said() -> None:
    out = io.StringIO()
    with AskingLine(out, lambda: 0.0) as line:
        tell(line, [0.0])
    assert out.getvalue() == ""


def test_what_is_left_is_told_by_the_stage_s_own_pace_and_ends_with_it() -> None:
    found = Remaining().heard(refits(1, 0.0), 10.0)
    assert found.left_s(11.0) is None
    found = found.heard(refits(2, 0.25), 12.0)
    assert found.left_s(12.0) == 6.0
    assert found.left_s(17.0) == 1.0
    assert found.left_s(19.0) is None  # it should be over: nothing is promised then
    chains = found.heard(Asking(stage=Stage.CHAINS, effects=("a", "b"), done=0.0, at_most=True), 19.0)
    assert chains.left_s(20.0) is None
    assert chains.at_most


def test_every_stage_has_its_words() -> None:
    for stage in Stage:
        assert asking_words(Asking(stage=stage, effects=("servo_lag",)))
