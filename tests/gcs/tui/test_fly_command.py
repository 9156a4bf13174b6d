"""`tippath fly` where it cannot begin says so, before anything is started."""

from __future__ import annotations

import argparse
import asyncio

import pytest

from gcs.cli import fly
from gcs.errors import TippathError, UsageError
from gcs.tui.ask_from import Paths, flights_in, quoted


def parsed(*words: str) -> argparse.Namespace:
    top = argparse.ArgumentParser()
    fly.add_parser(top.add_subparsers())
    return top.parse_args(["fly", *words])


def completed(value: str) -> str | None:
    return asyncio.run(Paths().get_suggestion(value))


def test_without_a_terminal_it_names_what_does_without(tmp_path):
    with pytest.raises(TippathError, match="tippath sweep"):
        fly.run(parsed("-o", str(tmp_path / "flights")))
    assert not (tmp_path / "flights").exists()


@pytest.mark.parametrize("words", [("--seed", "3"), ("--on-ground",)])
def test_a_real_vehicle_is_not_told_what_only_the_simulated_one_obeys(words):
    with pytest.raises(UsageError, match="simulated vehicle"):
        fly.run(parsed("--connect", "udpin:127.0.0.1:14550", *words))


def test_a_vehicle_is_real_or_simulated():
    with pytest.raises(SystemExit) as ended:
        parsed("--connect", "udpin:127.0.0.1:14550", "--sim", "hover")
    assert ended.value.code == 2


def test_the_command_is_there_with_its_function():
    assert parsed().run is fly.run
    assert parsed("--plot", "ascii", "--primary").plot == "ascii"


@pytest.mark.parametrize(
    ("words", "message"),
    [(("--connect", "nonsense"), "'nonsense' is no link"), (("--card", "nocard"), "no such card")],
)
def test_words_that_make_no_sense_are_wrong_usage_also_without_a_terminal(tmp_path, words, message):
    with pytest.raises(UsageError, match=message):
        fly.run(parsed(*words, "-o", str(tmp_path / "flights")))
    assert not (tmp_path / "flights").exists()


def test_a_plant_that_is_none_is_wrong_usage():
    with pytest.raises(SystemExit) as ended:
        parsed("--sim", "balloon")
    assert ended.value.code == 2


def test_a_flight_that_is_not_there_is_told(tmp_path):
    with pytest.raises(TippathError, match="no such folder or log"):
        fly.run(parsed(str(tmp_path / "none")))


def test_several_logs_are_opened_together_and_one_is_watched(tmp_path):
    assert parsed().flight == []
    assert parsed("roll.BIN", "pitch.BIN").flight == ["roll.BIN", "pitch.BIN"]
    with pytest.raises(UsageError, match="name one folder or log"):
        fly.run(parsed(str(tmp_path), str(tmp_path), "--replay"))


def test_two_logs_are_typed_with_a_blank_between(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a log.BIN").touch()
    assert flights_in("a log.BIN") == ["a log.BIN"]
    assert flights_in(f'roll.BIN "{tmp_path}/a log.BIN"') == ["roll.BIN", f"{tmp_path}/a log.BIN"]
    assert flights_in('roll.BIN "pitch') == ['roll.BIN "pitch']
    assert flights_in(quoted("a b/c") + " " + quoted("d")) == ["a b/c", "d"]
    assert completed("roll.BIN a") == "roll.BIN a log.BIN"
    assert completed("a") == "a log.BIN"
    assert completed("roll.BIN ") is None
