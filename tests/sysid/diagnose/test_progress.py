"""The ranking of a diagnosis while it is made: what is heard of candidates, put together."""

from __future__ import annotations

from sysid.diagnose.progress import Asking, FirstAnswer, Heard, Known, Progress, Ranking, Stage


def ranking(*news: Progress) -> Ranking:
    found = Ranking()
    for one in news:
        found = found.after(one)
    return found


def scored(name: str, promise: float) -> Heard:
    return Heard(effects=(name,), known=Known.SCORED, promise=promise)


def refitted(name: str, removed: float, avoidable: float | None = 0.1, implausible: tuple[str, ...] = ()) -> Heard:
    return Heard(
        effects=(name,), known=Known.REFITTED, removed=removed, avoidable=avoidable, implausible=implausible
    )  # fmt: skip


def shares(found: Ranking) -> list[tuple[str, float]]:
    return [(one.effects[0], round(one.share, 3)) for one in found.standings]


def test_scores_rank_by_what_the_best_promises_and_are_said_to_be_promises() -> None:
    found = ranking(scored("a", 100.0), scored("b", 400.0), scored("c", 0.0))
    assert shares(found) == [("b", 1.0), ("a", 0.25), ("c", 0.0)]
    assert all(one.promised for one in found.standings)
    assert found.best is None


def test_a_refit_stands_above_every_promise_and_sorts_itself() -> None:
    found = ranking(scored("a", 100.0), scored("b", 400.0), refitted("a", 0.05))
    assert shares(found) == [("a", 0.5), ("b", 1.0)]
    found = found.after(refitted("b", 0.09))
    assert shares(found) == [("b", 0.9), ("a", 0.5)]
    assert found.best is not None
    assert found.best.effects == ("b",)


def test_what_can_be_explained_is_by_the_last_word_on_it_whoever_is_heard_of_again() -> None:
    found = ranking(refitted("a", 0.05, 0.05), refitted("b", 0.08, 0.1), refitted("a", 0.05, None))
    assert shares(found) == [("b", 0.8), ("a", 0.5)]


def test_the_best_is_plausible() -> None:
    found = ranking(refitted("a", 0.09, implausible=("k_l",)), refitted("b", 0.05))
    assert found.best is not None
    assert found.best.effects == ("b",)


def test_the_first_answer_has_the_last_word_on_shares_and_no_number_breaks_it() -> None:
    first = FirstAnswer(verdict="missing", chain=("b",), confidence=0.9, shares={("a",): 0.2, ("b",): 0.7})
    found = ranking(refitted("a", 0.09), refitted("b", -3.0), first)
    assert shares(found) == [("b", 0.7), ("a", 0.2)]
    assert shares(ranking(refitted("a", 0.0, 0.0), refitted("b", 9.0))) == [("b", 1.0), ("a", 0.0)]


def test_a_question_is_kept_with_all_that_was_heard() -> None:
    asking = Asking(stage=Stage.REFITS, effects=("b",), number=2, of=3, done=0.5)
    found = ranking(scored("a", 1.0), asking)
    assert found.asking is asking
    assert shares(found) == [("a", 1.0)]
