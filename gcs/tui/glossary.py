"""The words of field and code, read from the one table that the documentation links to as well: `glossary.md` here."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

from rich.cells import cell_len

WORD_WIDTH = 22


@dataclass(frozen=True, slots=True)
class Word:
    """One entry."""

    heading: str
    word: str
    means: str


@cache
def glossary() -> tuple[Word, ...]:
    """Every word, in the order of the file."""
    text = (resources.files("gcs") / "tui" / "glossary.md").read_text("utf-8")
    return tuple(_words(text))


def _words(text: str) -> list[Word]:
    found: list[Word] = []
    heading = ""
    for line in text.splitlines():
        if line.startswith("## "):
            heading = line.removeprefix("## ")
        elif line.startswith("| ") and not line.startswith("| word |"):
            word, means = (cell.strip().replace("`", "") for cell in line.strip("|").split("|", 1))
            found.append(Word(heading, word, means))
    return found


def glossary_lines(words: Sequence[Word], width: int) -> list[str]:
    """As two columns under their headings, none wider than `width`."""
    lines = [" what the words mean"]
    heading = ""
    for one in words:
        if one.heading != heading:
            heading = one.heading
            lines += ["", f" {heading.lower()}"]
        told = textwrap.wrap(one.means, width - WORD_WIDTH - 3, break_on_hyphens=False)
        if cell_len(one.word) > WORD_WIDTH:
            lines.append(f"  {one.word}")
        else:
            lines.append(f"  {one.word:<{WORD_WIDTH}} {told.pop(0)}")
        lines += [f"  {'':<{WORD_WIDTH}} {piece}" for piece in told]
    return lines
