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
    if sum(bool(section.heading) for section in document.sections) > 2:
        sheet.ln(2)
        sheet.insert_toc_placeholder(_contents, pages=1 + len(document.sections) // 40)
    parts = numbered([section.parts for section in document.sections])
    for section, each in zip(document.sections, parts, strict=True):
        _section(sheet, section, each)
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


def _contents(sheet: Any, outline: Any) -> None:
    sheet.set_font("page", "", TEXT_PT)
    sheet.set_x(sheet.l_margin)
    for entry in outline:
        link = sheet.add_link(page=entry.page_number)
        page = str(entry.page_number)
        wide = sheet.epw - 12
        name = entry.name
        while name and sheet.get_string_width(name) > wide:
            name = name[:-1]
        sheet.cell(wide, 5.5, name, link=link)
        sheet.cell(12, 5.5, page, align="R", link=link, new_x="LMARGIN", new_y="NEXT")


def _section(sheet: Any, section: Section, parts: list[tuple[int, Part]]) -> None:
    if section.fresh and sheet.get_y() > 2 * MARGIN_MM:
        sheet.add_page()
    if section.heading:
        if sheet.will_page_break(40):  # no heading alone at a foot
            sheet.add_page()
        sheet.ln(3)
        sheet.start_section(section.heading)
        sheet.set_font("page", "B", 13)
        sheet.multi_cell(0, 7, section.heading, align="L", new_x="LMARGIN", new_y="NEXT")
        sheet.ln(1)
    for number, part in parts:
        match part:
            case Sentences():
                for line in part.lines:
                    _words(sheet, f"•  {line}" if part.listed else line)
            case Listing():
                _listing(sheet, part)
            case Facts():
                for name, value in part.rows:
                    _words(sheet, f"{name}: {value}")
            case Table():
                _table(sheet, number, part)
            case Picture():
                _picture(sheet, number, part)


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
    if sheet.will_page_break(25):
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
    room = sheet.h - 2 * MARGIN_MM - 4 * lines - 4
    scale = min(sheet.epw / wide, room / high)
    if sheet.will_page_break(high * scale + 4 * lines + 4):
        sheet.add_page()
    sheet.image(io.BytesIO(svg(part.figure, outlined=True).encode()), x="C", w=wide * scale, h=high * scale)
    _words(sheet, caption, size=SMALL_PT)
    sheet.ln(1)
