"""Every command that README and docs show is one that the program takes; those that read a flight run over a saved one.

What is live (a vehicle, a link) is flown by `make docs-check`; here its words are held against the parsers.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from flown_folder import fly_folder
from flying import TWO_CHIRPS

from gcs.cli import main, parser

pytestmark = pytest.mark.usefixtures("logs_kept")
ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
FENCED = re.compile(r"^```[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"(?<!`)`(tippath [^`]+)`(?!`)")
COMMENT = re.compile(r"\s+#\s.*$")
OVER_A_FLIGHT = """\
ingest flight-0001
ingest flight-0001/flight.BIN --explain
fit flight-0001 --model tpp -o tpp.json
compare tpp.json
response flight-0001/flight.BIN#1 flight-0001/flight.BIN#2 -o response.csv
fit flight-0001 --model cd -o cd.json
effects servo_lag
effects --how-to
"""
"""As the pages have them, in their order, but for what takes seconds."""


def shown(page: Path) -> list[str]:
    """Every line of a block that begins a command."""
    lines = [line for block in FENCED.findall(page.read_text(encoding="utf-8")) for line in block.splitlines()]
    lines += re.findall(r"^    (tippath .*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    bare = [COMMENT.sub("", line.removeprefix("$ ")).removesuffix(" &").split(" > ")[0] for line in lines]
    return [line for line in bare if line.startswith("tippath ")]


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_every_command_that_is_shown_is_taken(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for line in shown(page):
        assert taken(line), f"{line}\n{capsys.readouterr().err}"


def taken(line: str) -> bool:
    """Whether the parsers take it; `--help` ends well, too."""
    try:
        parser().parse_args(shlex.split(line)[1:])
    except SystemExit as end:
        return end.code == 0
    return True


def test_the_pages_show_commands() -> None:
    """So that the test above cannot pass by finding none."""
    assert len(shown(ROOT / "README.md")) > 40
    assert len(shown(ROOT / "docs" / "first-flight.md")) > 8


def test_options_that_are_named_in_running_text_exist() -> None:
    every = {
        word for page in PAGES for text in INLINE.findall(page.read_text(encoding="utf-8")) for word in text.split()
    }
    helps = " ".join(one.format_help() for one in parser()._subparsers._group_actions[0].choices.values())  # type: ignore[union-attr, attr-defined]
    options = {word.rstrip(".,;:)") for word in every if re.match(r"--[a-z]", word)} - {"--help", "--version"}
    assert options
    assert not {one for one in options if one.split("=")[0] not in helps}


def test_what_reads_a_flight_runs_over_a_saved_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fly_folder(tmp_path / "flight-0001", None, TWO_CHIRPS)
    monkeypatch.chdir(tmp_path)
    for line in OVER_A_FLIGHT.splitlines():
        assert main(shlex.split(line)) == 0, line


@pytest.mark.thorough
def test_the_notebook_runs() -> None:
    """One block after the other, as in a notebook; its own assertions judge."""
    text = (ROOT / "docs" / "notebook.md").read_text(encoding="utf-8")
    code = "\n".join(re.findall(r"^```python run\n(.*?)^```$", text, re.DOTALL | re.MULTILINE))
    assert code.count("assert ") >= 5
    exec(compile(code, "notebook.md", "exec"), {})
