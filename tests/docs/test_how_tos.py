"""The how-tos are carried out as they are written, in a copy of the repository; then its contract tests run there.

What a page's code blocks mean stands behind the language:

    ```python file PATH            a new file with this content
    ```python PATH after `LINE`    these lines behind that line, in that file, or in the one file below that folder
    ```python PATH instead of `LINE`
    ```python run                  a program that must end well, in the copy's folder
    ```sh                          commands, one a line: `tippath ...` and `python ...`
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
BLOCK = re.compile(r"^```(\w+) ?([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
EDIT = re.compile(r"(\S+) (after|instead of) `(.*)`")


@dataclass(frozen=True)
class Block:
    language: str
    order: str
    text: str


def blocks(page: Path) -> list[Block]:
    return [Block(*parts) for parts in BLOCK.findall(page.read_text(encoding="utf-8"))]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the repository; pages are carried out in it one after the other."""
    folder = tmp_path_factory.mktemp("clone")
    for name in ("gcs", "sysid", "sitl", "tests", "docs"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, folder / name)
    return folder


def carried_out(command: list[str], folder: Path) -> str:
    surroundings = os.environ | {"PYTHONPATH": str(folder), "TIPPATH_CACHE": "off", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def edit(folder: Path, order: str, text: str) -> None:
    where, way, line = EDIT.fullmatch(order).groups()  # type: ignore[union-attr]
    files = [folder / where] if (folder / where).is_file() else sorted((folder / where).rglob("*.py"))
    holding = [path for path in files if line in path.read_text(encoding="utf-8").splitlines()]
    assert len(holding) == 1, f"{where} has the line {line!r} in {len(holding)} files"
    lines = holding[0].read_text(encoding="utf-8").splitlines()
    place = lines.index(line)
    lines[place : place + 1] = [line, *text.splitlines()] if way == "after" else text.splitlines()
    holding[0].write_text("\n".join(lines) + "\n", encoding="utf-8")


def carry_out(block: Block, folder: Path) -> None:
    if block.language == "sh":
        for line in filter(None, block.text.splitlines()):
            program, *words = shlex.split(line, comments=True)
            module = {"tippath": ["-m", "gcs.cli"], "python": []}[program]
            carried_out([sys.executable, *module, *words], folder)
    elif block.order == "run":
        carried_out([sys.executable, "-c", block.text], folder)
    elif block.order.startswith("file "):
        path = folder / block.order.removeprefix("file ")
        assert not path.exists(), f"{path.name} exists"
        path.write_text(block.text, encoding="utf-8")
    elif block.order:
        edit(folder, block.order, block.text)


def test_there_is_a_page_for_everything_that_is_added_or_handed_on() -> None:
    names = {page.stem for page in PAGES}
    added = {"effect", "base", "log-format", "log-profile", "vehicle-profile", "card", "screen"}
    assert names == added | {"rate-gains", "response", "signing"}
    for page in PAGES:
        assert f"how-to/{page.name}" in (ROOT / "docs" / "README.md").read_text(encoding="utf-8")


LONG = ("response", "base", "effect", "screen", "log-format", "log-profile")
"""Pages that take five seconds and more; what they do is tested elsewhere, too."""


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, id=page.stem, marks=[pytest.mark.thorough] if page.stem in LONG else []) for page in PAGES],
)
def test_a_page_can_be_carried_out(page: Path, copy: Path) -> None:
    there = blocks(page)
    assert there, "nothing to carry out"
    for block in there:
        carry_out(block, copy)


@pytest.mark.thorough
def test_every_contract_test_stays_green_with_all_that_was_added(copy: Path) -> None:
    """All but what no addition reaches and takes long: commands on a CSV, fresh interpreters, examples, old files."""
    added: list[str] = []
    for page in PAGES:
        there = blocks(page)
        files = [block.order.split()[1] for block in there if block.order.startswith("file ")]
        if not all((copy / name).exists() for name in files):  # where this test runs without that of the pages
            for block in there:
                carry_out(block, copy)
        added += files
    any_of_them = " or ".join(Path(name).stem for name in added)
    reached = f"(not test_cli or explains or top_help) and (not test_autopilots or {any_of_them})"
    reached += " and not examples_run and not fresh_interpreter and not test_sizes"
    chosen = ["tests/contracts", "-k", reached, "-p", "no:cacheprovider"]
    carried_out([sys.executable, "-m", "pytest", "-q", "-x", *chosen], copy)
