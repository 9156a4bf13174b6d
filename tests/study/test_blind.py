"""Which cases the blind study flies, and that one that was stopped goes on where it was."""

from __future__ import annotations

import fcntl
import json
import os
import time
from dataclasses import asdict
from pathlib import Path

import blind
import pytest
from blind import ONE_IN, ROC, STRANGER, Case, done_already, mixed, of_sizes, part, run, to_quotas
from workers import worked_off


def test_mixed_cases_follow_from_their_seeds_one_each() -> None:
    cases = list(mixed(3000, 60))
    assert cases == list(mixed(3000, 60))
    assert [case.seed for case in cases] == list(range(3000, 3060))
    assert sum(case.plant != STRANGER for case in cases) == 60 // ONE_IN
    assert {case.plant for case in cases} == {STRANGER, "hover-ideal", "forward"}
    assert list(mixed(3010, 5)) == cases[10:15]


def test_sizes_are_asked_for_beside_flights_that_hide_nothing() -> None:
    cases = list(of_sizes(0, 3, ROC))
    assert len(cases) == 3 * (len(ROC) + 1)
    assert sum(case.names == () for case in cases) == 3


def test_quotas_take_the_first_seeds_of_each_kind_and_spread_them() -> None:
    quotas = {("none", True): 10, ("two", False): 5}
    kinds = [("none", True), ("two", False), ("beyond", True)]
    cases = list(to_quotas(30, quotas, lambda seed: kinds[seed % 3]))
    assert sorted(case.seed for case in cases if case.seed % 3 == 0) == list(range(30, 60, 3))
    assert sorted(case.seed for case in cases if case.seed % 3 == 1) == list(range(31, 46, 3))
    assert [sum(case.seed % 3 == 1 for case in cases[:n]) for n in (3, 6, 9, 15)] == [1, 2, 3, 5]


def test_what_a_file_holds_is_not_flown_again(tmp_path: Path) -> None:
    """Lines of before there were keys, too; a line that was cut off is taken out and flown again."""
    first, old, cut = Case(STRANGER, (), 1), Case("forward", ("none",), 2), Case(STRANGER, (), 3)
    file = tmp_path / "blind.jsonl"
    lines = [{"case": asdict(first) | {"names": ["servo_lag"]}, "key": first.key}, {"case": asdict(old)}]
    file.write_text("".join(json.dumps(line) + "\n" for line in lines) + json.dumps({"key": cut.key})[:-3])
    assert done_already(file) == {first.key, old.key}
    assert len(file.read_text().splitlines()) == 2
    assert done_already(tmp_path / "none.jsonl") == set()


def test_a_case_that_fails_is_counted_and_keeps_its_key(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise ZeroDivisionError("no air")

    monkeypatch.setattr(blind, "_strange", refuse)
    case = Case(STRANGER, (), 5)
    answer = run(case)
    assert answer["failed"] == "ZeroDivisionError: no air"
    assert answer["key"] == case.key


def test_a_process_that_dies_costs_its_case_and_another_goes_on() -> None:
    found = dict(worked_off(["die", "fine", "slow"], behave, workers=2, longest_s=60))
    assert found == {"die": {"failed": "the process ended by itself (exit status 3)"}} | {
        word: {"said": word} for word in ("fine", "slow")
    }


def test_linear_algebra_has_one_thread_in_each_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """However the study was begun: with more, seconds of a diagnosis were counted several times."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert dict(worked_off(["threads"], behave, workers=1, longest_s=60)) == {"threads": {"said": "1"}}


def test_what_takes_too_long_is_ended_and_said() -> None:
    found = dict(worked_off(["hang"], behave, workers=1, longest_s=0.2))
    assert found == {"hang": {"failed": "took longer than 0.2 s"}}


def test_nothing_begins_when_the_time_is_spent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "blind.jsonl"
    assert blind.fly_all([Case(STRANGER, (), 1)], file, workers=1, budget_min=0) == 0
    assert file.read_text() == ""
    assert "The time is spent: 1 not flown" in capsys.readouterr().err


def test_a_file_has_one_writer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "blind.jsonl"
    with file.open("a") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        assert blind.fly_all([], file, workers=1) == 2
    assert "give this one a file of its own" in capsys.readouterr().err
    assert blind.fly_all([], file, workers=1) == 0


def test_parts_are_of_all_and_of_nothing_twice() -> None:
    assert part("2/3") == (2, 3)
    for wrong in ("0/2", "3/2", "2"):
        with pytest.raises(ValueError, match=r"part|unpack"):
            part(wrong)


def behave(case: str) -> dict[str, str]:
    """In another process."""
    if case == "die":
        os._exit(3)
    if case == "hang":
        time.sleep(60)
    if case == "threads":
        return {"said": os.environ.get("OPENBLAS_NUM_THREADS", "all")}
    return {"said": case}
