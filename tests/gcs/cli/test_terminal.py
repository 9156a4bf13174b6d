"""What a terminal would obey reaches none, whoever wrote it."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from textual.content import Content

from gcs.cli.counting import Counting
from gcs.cli.terminal import REDRAW, control, harmless_streams
from gcs.logs.words import harmless
from gcs.tui.widgets.lines import Lines

CODES = "\x1b[2J \r \x07 \x08 \x9b31m \u202e \u2066 \x00 \ud800"


def test_only_what_a_terminal_would_obey_is_replaced() -> None:
    kept = "a line\n\twith ✓, 3.4\u202fm/s², ζ and 日本\n"
    assert harmless(kept) == kept
    assert harmless(CODES) == "?[2J ? ? ? ?31m ? ? ? ?"


def test_both_streams_are_harmless_and_come_back(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout, sys.stderr
    with harmless_streams():
        print(CODES)
        print(CODES, file=sys.stderr)
        sys.stderr.writelines([CODES])
        control(sys.stdout, REDRAW)
    assert (sys.stdout, sys.stderr) == before
    out, err = capsys.readouterr()
    assert out == f"{harmless(CODES)}\n{REDRAW}"
    assert err == f"{harmless(CODES)}\n{harmless(CODES)}"


def test_a_closed_stream_stays_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    with harmless_streams():
        assert sys.stdout is None


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_line_is_still_redrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with harmless_streams(), Counting("asking") as counting:
        counting("a\x1b[2Jb")
    assert terminal.getvalue() == f"{REDRAW} asking 1: a?[2Jb{REDRAW}"


@pytest.mark.parametrize("words", [["reveal"], ["design"], ["ingest"], ["push", "--connect", "udpin:x:1"]])
def test_a_name_that_a_terminal_would_obey(words: list[str], tippath: Callable[..., tuple[int, str, str]]) -> None:
    status, out, err = tippath(words[0], "\x1b[2Jgone", *words[1:])
    assert status in (1, 2)
    assert "\x1b" not in out + err
    assert "gone" in err


def test_a_fit_s_format_and_warnings(tmp_path: Path, tippath: Callable[..., tuple[int, str, str]]) -> None:
    (tmp_path / "fit.json").write_text('{"format": "\\u001b[2J"}')
    status, out, err = tippath("design", tmp_path / "fit.json")
    assert status == 1
    assert "\x1b" not in out + err


def test_lines_of_the_app_are_harmless() -> None:
    lines = Lines("braille", "top")
    for line in (CODES, (CODES, "bold"), Content(CODES)):
        assert lines._content(line).plain.isprintable()
