"""A document as PDF: A4, figures as vectors, a contents page, headings as bookmarks, page numbers.

Set by fpdf2, which draws Matplotlib's SVG itself and needs neither a browser nor a library of the system; the fonts
are those that Matplotlib brings. Letters that these lack stand as boxes.
"""

from __future__ import annotations

import io
import logging
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs.analysis.pages.page import svg
from gcs.analysis.pages.parts import Document, Facts, Listing, Part, Picture, Section, Sentences, Table, numbered

MARGIN_MM = 16.0
LINE_MM = 5.5
FRESH_MM = 120.0
"""Where less is left of a sheet, a section that wants one of its own gets it."""
ROW_MM, SHEET_MM = 4.6, 200.0
LONG = 1200
"""Characters of a value that is read once, if at all: set small."""
SMALLER = 0.8
"""A figure is set so much smaller, at most, to stand with the text that it belongs to."""
TEXT_PT, SMALL_PT, LISTING_PT = 9.5, 8.0, 7.0
INCH_MM = 25.4
FONTS = (("", "DejaVuSans.ttf"), ("B", "DejaVuSans-Bold.ttf"))
MONO = "DejaVuSansMono.ttf"
GREY = (90, 90, 90)


def pdf(document: Document, now: datetime) -> bytes:
    """The bytes of a PDF file that says it was made `now`, and tells the same of the same document."""
    sheet = _sheet(document)
    sheet.set_creation_date(now)
    sheet.set_font("page", "B", 17)
    sheet.multi_cell(0, 8, document.title, align="L", new_x="LMARGIN", new_y="NEXT")
    _words(sheet, document.about, GREY)
    headings = [section.heading for section in document.sections if section.heading]
    entries = _contents(sheet, headings) if len(headings) > 2 else []
    parts = numbered([section.parts for section in document.sections])
    pages = [_section(sheet, section, each) for section, each in zip(document.sections, parts, strict=True)]
    begun = [page for page, section in zip(pages, document.sections, strict=True) if section.heading]
    _number(sheet, entries, begun)
    return bytes(sheet.output())


def _sheet(document: Document) -> Any:
    # a fifth of a second to load, with Matplotlib a second: only where a page is made
    from fpdf import FPDF
    from matplotlib import get_data_path

    logging.getLogger("fpdf").setLevel(logging.ERROR)  # of SVG's metadata, and of letters that the fonts lack

    class Sheet(FPDF):
        def footer(self) -> None:
            self.set_y(-11)
            self.set_font("page", "", SMALL_PT)
            self.set_text_color(*GREY)
            self.cell(0, 4, f"{self.page_no()}", align="C")
            self.set_text_color(0)

    sheet = Sheet(format="A4")
    folder = Path(get_data_path()) / "fonts" / "ttf"
    for style, name in FONTS:
        sheet.add_font("page", style, str(folder / name))
    sheet.add_font("mono", "", str(folder / MONO))
    sheet.set_margins(MARGIN_MM, MARGIN_MM)
    sheet.set_auto_page_break(True, MARGIN_MM)
    sheet.set_title(document.title)
    sheet.add_page()
    sheet.set_font("page", "", TEXT_PT)
    return sheet


Entry = tuple[int, float, int]
"""Where a line of the contents stands, page and height, and its link."""


def _contents(sheet: Any, headings: list[str]) -> list[Entry]:
    """The headings, still without their pages."""
    sheet.set_font("page", "", TEXT_PT)
    sheet.ln(1)
    entries = []
    for heading in headings:
        wide, name = sheet.epw - 12, heading
        while name and sheet.get_string_width(name) > wide:
            name = name[:-1]
        link = sheet.add_link()
        entries.append((sheet.page, sheet.get_y(), link))
        sheet.cell(wide, LINE_MM, name, link=link, new_x="LMARGIN", new_y="NEXT")
    return entries


def _number(sheet: Any, entries: list[Entry], pages: list[int]) -> None:
    """The pages behind the contents, once they are known."""
    last, y = sheet.page, sheet.get_y()
    for (at, height, link), page in zip(entries, pages, strict=False):
        sheet.page = at
        sheet.set_font("mono", "", TEXT_PT)  # whatever that page ended with: the next one is written out
        sheet.set_font("page", "", TEXT_PT)
        sheet.set_xy(sheet.l_margin + sheet.epw - 12, height)
        sheet.set_link(link, page=page)
        sheet.cell(12, LINE_MM, str(page), align="R", link=link)
    sheet.page = last
    sheet.set_y(y)


def _section(sheet: Any, section: Section, parts: list[tuple[int, Part]]) -> int:
    """The page on which it begins."""
    if section.fresh and sheet.get_y() > sheet.h - FRESH_MM:
        sheet.add_page()
    if section.heading:
        if sheet.will_page_break(_least(sheet, parts)):  # no heading alone at a foot
            sheet.add_page()
        sheet.ln(3)
    begun: int = sheet.page
    if section.heading:
        sheet.start_section(section.heading)
        sheet.set_font("page", "B", 13)
        sheet.multi_cell(0, 7, section.heading, align="L", new_x="LMARGIN", new_y="NEXT")
        sheet.ln(1)
    for number, part in parts:
        _part(sheet, number, part)
    return begun


def _least(sheet: Any, parts: list[tuple[int, Part]]) -> float:
    """Room that a heading wants, mm: with the figure that it begins with."""
    match parts[:1]:
        case [(_, Picture(figure=figure))]:
            wide, high = figure.get_size_inches()
            return float(25 + SMALLER * sheet.epw * high / wide)
    return 40.0


def _part(sheet: Any, number: int, part: Part) -> None:
    match part:
        case Sentences():
            for line in part.lines:
                _words(sheet, f"•  {line}" if part.listed else line)
        case Listing():
            _listing(sheet, part)
        case Facts():
            for name, value in part.rows:
                _fact(sheet, name, value)
        case Table():
            _table(sheet, number, part)
        case Picture():
            _picture(sheet, number, part)


def _fact(sheet: Any, name: str, value: str) -> None:
    """The name in bold, and the value behind it."""
    size = TEXT_PT if len(value) < LONG else SMALL_PT
    sheet.set_font("page", "B", size)
    sheet.write(0.5 * size, f"{name}: ")
    sheet.set_font("page", "", size)
    sheet.write(0.5 * size, value)
    sheet.ln(0.5 * size + 1)


def _words(sheet: Any, text: str, colour: tuple[int, int, int] = (0, 0, 0), size: float = TEXT_PT) -> None:
    if not text:
        return
    sheet.set_font("page", "", size)
    sheet.set_text_color(*colour)
    sheet.multi_cell(0, 0.5 * size, text, align="L", new_x="LMARGIN", new_y="NEXT")
    sheet.set_text_color(0)
    sheet.ln(1)


def _listing(sheet: Any, part: Listing) -> None:
    sheet.set_font("mono", "", LISTING_PT)
    for line in part.text.splitlines():
        sheet.multi_cell(0, 3.2, line or " ", align="L", new_x="LMARGIN", new_y="NEXT")
    sheet.ln(2)


def _table(sheet: Any, number: int, part: Table) -> None:
    from fpdf.enums import TableBordersLayout
    from fpdf.fonts import FontFace

    sheet.ln(1)
    high = ROW_MM * (len(part.rows) + 2)
    if sheet.will_page_break(high if high < SHEET_MM else 25):  # no table is broken that has room on a sheet
        sheet.add_page()
    _words(sheet, f"Table {number}. {part.caption}", size=SMALL_PT)
    sheet.set_font("page", "", SMALL_PT)
    widths = _widths(sheet, part)
    with sheet.table(
        width=sum(widths),
        col_widths=tuple(widths),
        align="LEFT",
        text_align=tuple("LEFT" if k in part.words else "RIGHT" for k in range(len(part.head))),
        borders_layout=TableBordersLayout.HORIZONTAL_LINES,
        headings_style=FontFace(emphasis="BOLD"),
        line_height=4,
    ) as table:
        for cells in (part.head, *part.rows):
            row = table.row()
            for cell in cells:
                row.cell(cell)
    sheet.ln(2)


def _widths(sheet: Any, part: Table) -> list[float]:
    """Each column as wide as its widest cell, the widest ones narrower where all do not fit."""
    wanted = [
        max(sheet.get_string_width(cell) * (1.15 if n == 0 else 1.0) for n, cell in enumerate(cells)) + 4
        for cells in zip(part.head, *part.rows, strict=True)
    ]
    widths, room = dict.fromkeys(range(len(wanted)), 0.0), sheet.epw
    for left, k in enumerate(sorted(widths, key=wanted.__getitem__)):  # narrow ones are not cut for wide ones
        widths[k] = min(wanted[k], room / (len(wanted) - left))
        room -= widths[k]
    return [widths[k] for k in range(len(wanted))]


def _picture(sheet: Any, number: int, part: Picture) -> None:
    """The figure with its caption, together on one sheet, smaller where it would not fit on one."""
    wide, high = (float(inches) * INCH_MM for inches in part.figure.get_size_inches())
    caption = f"Figure {number}. {part.caption}" if part.caption else ""
    sheet.set_font("page", "", SMALL_PT)
    lines = len(sheet.multi_cell(0, 4, caption, dry_run=True, output="LINES")) if caption else 0
    beside = 4 * lines + 4
    full = min(sheet.epw / wide, (sheet.h - 2 * MARGIN_MM - beside) / high)
    here = (sheet.h - MARGIN_MM - sheet.get_y() - beside) / high
    scale = min(full, here)
    if scale < SMALLER * full:
        sheet.add_page()
        scale = full
    sheet.image(io.BytesIO(svg(part.figure, outlined=True).encode()), x="C", w=wide * scale, h=high * scale)
    _words(sheet, caption, size=SMALL_PT)
    sheet.ln(1)
