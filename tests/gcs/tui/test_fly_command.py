"""`tippath fly` where it cannot begin says so, before anything is started."""

from __future__ import annotations

import argparse

import pytest

from gcs.cli import fly
from gcs.errors import TippathError, UsageError


def parsed(*words: str) -> argparse.Namespace:
    top = argparse.ArgumentParser()
    fly.add_parser(top.add_subparsers())
    return top.parse_args(["fly", *words])


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
