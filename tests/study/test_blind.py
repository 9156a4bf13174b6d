"""Which cases the blind study flies, and that one that was stopped goes on where it was."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import blind
import pytest
from blind import ONE_IN, ROC, STRANGER, Case, done_already, mixed, of_sizes, run


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
