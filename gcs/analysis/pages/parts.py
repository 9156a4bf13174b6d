"""What a page is made of, as values: `page` sets it as HTML, `pdf` for paper. Figures and tables are numbered by both.

Texts are plain: whoever sets them makes them harmless.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Sentences:
    """Set as paragraphs, or with marks before them."""

    lines: tuple[str, ...]
    listed: bool = False


@dataclass(frozen=True, slots=True)
class Listing:
    """Text in columns, whose spaces count."""

    text: str


@dataclass(frozen=True, slots=True)
class Facts:
    """Names with their values."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Table:
    """Numbered, with a caption above it. The first column is text, the others are set to the right."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: tuple[int, ...] = (0,)
    """Columns that are text."""


@dataclass(frozen=True, eq=False, slots=True)
class Picture:
    """Numbered, with a caption below it."""

    figure: Any
    """Matplotlib's."""
    caption: str


Part = Sentences | Listing | Facts | Table | Picture


@dataclass(frozen=True, eq=False, slots=True)
class Section:
    """A heading with what stands under it; no heading, no place in the contents."""

    heading: str
    parts: tuple[Part, ...]
    fresh: bool = False
    """Begins a sheet of its own where it is printed."""


@dataclass(frozen=True, eq=False, slots=True)
class Document:
    """A page."""

    title: str
    about: str
    """One line below the title."""
    sections: tuple[Section, ...]


def numbered(section_parts: Sequence[Sequence[Part]]) -> Iterator[list[tuple[int, Part]]]:
    """Of each section its parts with the numbers of figures and tables, counted over the document; 0 for others."""
    figures = tables = 0
    for parts in section_parts:
        found: list[tuple[int, Part]] = []
        for part in parts:
            figures += isinstance(part, Picture)
            tables += isinstance(part, Table)
            number = figures if isinstance(part, Picture) else tables if isinstance(part, Table) else 0
            found.append((number, part))
        yield found
