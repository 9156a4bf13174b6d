"""`tippath fly --serve`: where it is served, who may reach it, and that the same app is served."""

from __future__ import annotations

import argparse
import socket
import sys
from pathlib import Path

import pytest

from gcs.cli import fly, served
from gcs.errors import TippathError, UsageError


def parser() -> argparse.ArgumentParser:
    return fly.add_parser(argparse.ArgumentParser().add_subparsers())


def parsed(*words: str) -> argparse.Namespace:
    return parser().parse_args(words)


@pytest.mark.parametrize("word", ["0.0.0.0:8000", "0", "65536", "x"])
def test_it_is_served_on_loopback_only(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parsed("--serve", word)
    assert ended.value.code == 2
    assert "127.0.0.1 only" in capsys.readouterr().err


def test_serving_without_the_extra_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    with pytest.raises(TippathError, match="-m pip install aiohttp"):
        fly.run(parsed("--serve"))
    assert parsed("--serve").serve == 8000


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--serve", "--serve-host", "0.0.0.0"), "add --serve-token"),
        (("--serve", "--serve-token", "short"), "has 5 characters"),
        (("--serve-token", "twenty-letters-of-it"), "add --serve"),
        (("--serve-host", "0.0.0.0"), "add --serve"),
    ],
)
def test_nobody_is_let_in_by_mistake(words: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(served.TOKEN_VARIABLE, raising=False)
    with pytest.raises(UsageError, match=message):
        fly.run(parsed(*words))


def test_a_token_is_given_kept_in_the_environment_or_made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(served.TOKEN_VARIABLE, raising=False)
    assert served._token(parsed("--serve")) is None
    assert served._token(parsed("--serve", "--serve-token", "given")) == "given"
    made = {served._token(parsed("--serve", "--serve-token")) for _ in range(3)}
    assert len(made) == 3
    monkeypatch.setenv(served.TOKEN_VARIABLE, "of the environment")
    assert served._token(parsed("--serve")) == served._token(parsed("--serve", "--serve-token")) == "of the environment"


def test_what_is_served_is_the_same_app(tmp_path: Path) -> None:
    words = ("--sim", "hover", "--seed", "3", "-o", str(tmp_path), "--theme", "sun", "--no-probe", "--no-bell")
    more = ("--log", "card", "--leave-out", "--on-ground", "--plot", "ascii")
    args = parsed(*words, *more, "--serve", "8123", "--serve-token", "a" * 20)
    again = vars(parsed(*served.again(args, parser())))
    left_out = dict.fromkeys(served.LEFT_OUT)
    assert again == {**vars(args), **left_out}
    odd = parsed("--card=-x.toml", "--", "-flight")
    assert vars(parsed(*served.again(odd, parser()))) == vars(odd)
    assert served.again(parsed(), parser()) == []


@pytest.mark.realtime
def test_a_port_that_is_taken_is_told() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(TippathError, match=f"port {port} of 127.0.0.1 cannot be served"):
            fly.run(parsed("--serve", str(port)))


def test_a_served_app_knows_that_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    from gcs.browser.app_process import DRIVER

    monkeypatch.setenv("TEXTUAL_DRIVER", DRIVER)
    assert served.in_browser()
