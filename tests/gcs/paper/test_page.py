"""paper.json as a page and as text: what is shown of a small one."""

from __future__ import annotations

import msgspec
import pytest

from gcs.paper.page import cells, head, paper_page
from gcs.paper.values import Chapter, FlightTold, Line, Panel, PaperDocument, PaperFigure, PaperTable, Row
from gcs.paper.words import paper_text

NASTY = "<script>alert(1)</script> & $x$"
TABLE = PaperTable(
    label="Table 2",
    caption=NASTY,
    columns=("beside",),
    rows=(
        Row(name="frequency, Hz", printed=1.64, ours=1.558, error=0.0123, beside={"beside": 1.634}),
        Row(name="nothing", digits=1),
    ),
    why=("because of a lag",),
)
FIGURE = PaperFigure(
    label="Figure 6",
    caption="drawn",
    panels=(Panel(y="p, rad/s", lines=(Line(label=NASTY, x=(0.0, 1.0), y=(0.0, 1.0)),)),),
)
DOCUMENT = PaperDocument(
    format="tippath.paper/1",
    quick=True,
    flights=(FlightTold(name="hover-1", what="Tables", folder="hover-1", sha256="ab" * 32),),
    chapters=(Chapter(heading="Hover", inputs="x", said=("said",), tables=(TABLE,), figures=(FIGURE,)),),
)


def test_a_row_has_a_cell_for_each_column() -> None:
    assert head(TABLE) == ["", "printed", "ours", "difference, %", "beside"]
    assert cells(TABLE, TABLE.rows[0]) == ["frequency, Hz", "1.640", "1.558 ± 0.012", "-5.0", "1.634"]
    assert cells(TABLE, TABLE.rows[1]) == ["nothing", "–", "–", "–", "–"]


def test_the_page_holds_all_and_runs_nothing() -> None:
    page = paper_page(DOCUMENT)
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    for words in ("<b>Table 2.</b>", "<b>Figure 6.</b>", "1.558 ± 0.012", "because of a lag", "quick", "ab" * 32):
        assert words in page, words
    assert page.count("<svg") == 1
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page
    assert 'http-equiv="Content-Security-Policy" content="default-src \'none\'' in page


def test_the_text_has_the_tables_in_columns() -> None:
    lines = paper_text(DOCUMENT).splitlines()
    (row,) = (line for line in lines if line.startswith("  frequency"))
    assert row.split() == ["frequency,", "Hz", "1.640", "1.558", "±", "0.012", "-5.0", "1.634"]
    assert "  - because of a lag" in lines


def test_the_document_is_read_again_as_it_was_written() -> None:
    again = msgspec.json.decode(msgspec.json.encode(DOCUMENT), type=PaperDocument)
    assert again == DOCUMENT
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(
            b'{"format": "another/1", "quick": false, "flights": [], "chapters": []}', type=PaperDocument
        )
