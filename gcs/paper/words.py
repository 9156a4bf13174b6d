"""`paper.json` as text: the tables in columns, each with its differences below."""

from __future__ import annotations

from gcs.analysis.text.blocks import wrapped
from gcs.paper.page import cells, head
from gcs.paper.values import PaperDocument, PaperTable


def paper_text(document: PaperDocument) -> str:
    """All tables, one after the other."""
    return "\n\n".join(table_text(table) for chapter in document.chapters for table in chapter.tables)


def table_text(table: PaperTable) -> str:
    """One table, its columns as wide as they need to be."""
    rows = [head(table), *(cells(table, row) for row in table.rows)]
    wide = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = ["  " + "  ".join([row[0].ljust(wide[0]), *_right(row, wide)]).rstrip() for row in rows]
    said = [line for words in table.why for line in wrapped(words, "  - ", "    ")]
    return "\n".join([*wrapped(f"{table.label}. {table.caption}"), *lines, *said])


def _right(row: list[str], wide: list[int]) -> list[str]:
    return [cell.rjust(width) for cell, width in zip(row[1:], wide[1:], strict=True)]
