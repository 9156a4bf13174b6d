"""`tippath fly` where it cannot begin says so, before anything is started."""

from __future__ import annotations

import argparse
import sys

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


@pytest.mark.parametrize("word", ["0.0.0.0:8000", "0", "65536", "x"])
def test_it_is_served_on_loopback_only(word, capsys):
    with pytest.raises(SystemExit) as ended:
        parsed("--serve", word)
    assert ended.value.code == 2
    assert "127.0.0.1 only" in capsys.readouterr().err


def test_serving_without_the_extra_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "textual_serve.server", None)
    with pytest.raises(TippathError, match="-m pip install textual-serve"):
        fly.run(parsed("--serve"))
    assert parsed("--serve").serve == 8000


def test_what_is_served_is_the_same_app(tmp_path):
    args = parsed("--sim", "hover", "--seed", "3", "-o", str(tmp_path), "--theme", "sun", "--serve", "8123")
    again = parsed(*fly._again(args))
    assert (again.sim, again.seed, again.output, again.theme, again.serve) == ("hover", 3, tmp_path, "sun", None)
