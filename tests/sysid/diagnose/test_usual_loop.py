"""A log that does not tell how long commands were held: a usual loop is asked first, and little of the other."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
from planted import PLANTED, fly_many
from planted_fits import records

import sysid.diagnose.diagnose as whole
from sysid.data.record import Record
from sysid.diagnose.progress import unheard
from sysid.fit.check_kinds import CommandsThinned
from sysid.fit.identify import on_runs

HERE, USUAL = cast("Any", SimpleNamespace(name="here")), (cast("Any", SimpleNamespace(name="usual")), None)


def either(
    monkeypatch: pytest.MonkeyPatch, usual: str, here: str, likely: tuple[bool, bool]
) -> tuple[str, bool, list[str]]:
    """Which answer is given, whether it is the usual loop's, and what was asked for it: by these verdicts, and by
    whether the usual one is as likely as the few of the other, and as all."""
    done: list[str] = []
    few, all_of_it = object(), object()

    def asked(scored: Any, *_: object) -> Any:
        done.append(scored.name)
        verdict = usual if scored.name == "usual" else here
        return SimpleNamespace(name=scored.name, answer=SimpleNamespace(verdict=verdict), likeliest=all_of_it)

    def the_likeliest(*_: object) -> object:
        done.append("few")
        return few

    monkeypatch.setattr(whole, "_asked", asked)
    monkeypatch.setattr(whole, "_the_likeliest", the_likeliest)
    monkeypatch.setattr(whole, "_as_likely", lambda _, there: likely[0] if there is few else likely[1])
    found, by_usual = whole._by_either(HERE, None, USUAL, unheard)
    return cast("Any", found).name, by_usual, done


def test_what_a_usual_loop_names_is_held_against_few_others(monkeypatch: pytest.MonkeyPatch) -> None:
    assert either(monkeypatch, "missing", "missing", (True, True)) == ("usual", True, ["usual", "few"])


def test_all_of_the_other_is_asked_where_one_of_the_few_is_likelier(monkeypatch: pytest.MonkeyPatch) -> None:
    everything = ["usual", "few", "here"]
    assert either(monkeypatch, "missing", "missing", (False, True)) == ("usual", True, everything)
    assert either(monkeypatch, "missing", "missing", (False, False)) == ("here", False, everything)


@pytest.mark.parametrize("verdict", ["complete", "unexplained"])
def test_what_names_nothing_is_held_against_all_others(verdict: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert either(monkeypatch, verdict, "missing", (True, True)) == ("usual", True, ["usual", "here"])
    assert either(monkeypatch, verdict, "missing", (True, False)) == ("here", False, ["usual", "here"])


def test_where_nothing_explains_the_runs_either_way_they_stay_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    assert either(monkeypatch, "unexplained", "unexplained", (True, True)) == ("here", False, ["usual", "here"])


def test_a_log_that_tells_its_loop_is_asked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole, "_asked", lambda scored, *_: scored)
    assert whole._by_either(HERE, None, None, unheard) == (HERE, False)


@pytest.fixture(scope="module")
def thinned() -> list[Record]:
    """A lag of the servos, every fifth sample of a loop of 500 Hz."""
    runs = fly_many("servo_lag", PLANTED["servo_lag"], seeds=[31], duration_s=10.0, noise=0.004)[0]
    return records([{name: values[::5] for name, values in run.items()} for run in runs])


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    "only_effects",
    [("servo_lag", "transport_delay", "stabiliser_bar", "hub_gyroscopics", "angular_damping")],
    indirect=True,
)
def test_the_answer_is_that_of_all_of_both(thinned: list[Record], monkeypatch: pytest.MonkeyPatch) -> None:
    structure = on_runs("tpp", (), thinned, thinned)
    quick = whole.diagnose(structure, thinned)
    the_likeliest, few = whole._the_likeliest, []
    monkeypatch.setattr(whole, "_the_likeliest", lambda *each: few.append(the_likeliest(*each)))
    monkeypatch.setattr(whole, "_as_likely", lambda _, there: there is not None)
    whole_answer = whole.diagnose(structure, thinned)
    assert len(few) == 1
    assert isinstance(quick.thinned, CommandsThinned)
    assert (quick.verdict, quick.effect, quick.thinned) == ("missing", "servo_lag", whole_answer.thinned)
    assert (whole_answer.verdict, whole_answer.effect) == ("missing", "servo_lag")
    assert quick.confidence == pytest.approx(whole_answer.confidence)
