"""Compare's picture: what is guilty is told by shade and letters, and a cell is looked at closer."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_app import IDLE, app_on, screen_text, settle
from fake_desk import COMPARED_RUNG, DESKS
from rich.cells import cell_len

from gcs.tui.plot import STYLES, cell_at, heat, heat_plot
from gcs.tui.plot.heat import Cell, HeatPlot, HeatRow
from gcs.tui.state import joined
from gcs.tui.widgets.heat import Heat
from gcs.tui.widgets.traces import Traces

EDGES = (0.0, 0.5, 1.1, 2.1, 3.1, 6.3, 10.0, 15.0)
SHARES = {"q": (0.0, 0.07, 0.1, 0.14, 0.5, 0.11, 0.0), "p": (0.0, 0.2, 0.3, 0.12, 0.1, 0.01, 0.0)}
PLOT = HeatPlot(
    rows=tuple(
        HeatRow(
            output=output,
            axis=axis,
            names=(f"{axis} {output}", "NRMSE 81.1", "noise 92.6"),
            cells=tuple(Cell(beyond=x, words=(f"{100 * x:.0f} %", "3.0x"), said=f"{axis} {x}") for x in SHARES[output]),
        )
        for output, axis in (("q", "pitch"), ("p", "roll"))
    ),
    edges_hz=EDGES,
    outlined=(0, 3, 4),
    title="error beyond noise",
)


def texts(rows):
    return ["".join(text for text, _ in row) for row in rows]


@pytest.mark.parametrize("style", STYLES)
def test_the_guilty_cells_are_framed_and_shaded_by_their_share(style):
    rows = heat(PLOT, 80, 12, style, (0, 4))
    lines = texts(rows)
    assert [cell_len(line) for line in lines] == [80] * 12
    assert style != "ascii" or "".join(lines).isascii()
    frame, points = ("#=", "><") if style == "ascii" else ("┏━", "▶◀")
    top = next(y for y, line in enumerate(lines) if frame[0] in line)
    begin, end = lines[top].index(frame[0]), lines[top].rindex(frame[1])
    assert f"{points[0]}50 %{points[1]}" in "".join(lines)[80 * top :], "the cursor shows without colour"
    dark = {"ascii": "@"}.get(style, "█")
    assert any(dark in line[begin:end] for line in lines[top:])
    assert not any(dark in line[:begin] + line[end + 2 :] for line in lines[top : top + 3])
    assert lines[-1].startswith(" pitch 0.5"), "the cell under the cursor, in words"
    assert [float(word) for word in lines[-2].split()[1:]] == list(EDGES)


@pytest.mark.parametrize("size", [(1, 1), (5, 3), (20, 2), (41, 5), (80, 24), (120, 9), (200, 50)])
def test_a_picture_is_as_large_as_asked_and_every_place_knows_its_cell(size):
    width, height = size
    for style in STYLES:
        assert [cell_len(line) for line in texts(heat(PLOT, width, height, style, (1, 0)))] == [width] * height
    if width > 8 and height > 2:
        found = {cell_at(PLOT, width, height, x, y) for x in range(width) for y in range(height)} - {None}
        assert found == {(i, k) for i in range(2) for k in range(7)}


def test_the_worst_axis_comes_first_and_its_finding_is_outlined():
    found = COMPARED_RUNG.comparison
    plot = heat_plot(found)
    assert [row.axis for row in plot.rows] == ["pitch", "roll"]
    assert plot.outlined == (0, 1, 1)
    assert plot.darkest == (0, 1)
    assert [one.beyond for one in plot.rows[0].cells] == pytest.approx([0.16, 0.64])
    assert plot.rows[0].cells[1].words == ("64 %", "2.2x", "δx 0.90")
    short = replace(found.bands[0], noise_share=None)
    plot = heat_plot(type(found)(**{**vars(found), "bands": (short, *found.bands[1:])}))
    assert "too short" in plot.rows[1].cells[0].said


async def test_from_a_cell_down_to_time_response_and_spectra_and_back():
    app, _ = app_on(joined(IDLE, DESKS["compared"]))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("5")
        await settle(app)
        picture = app.screen.query_one("#heat", Heat)
        assert app.focused is picture
        assert picture.at == (0, 1)
        assert "pitch: 58 % of the error" in "\n".join(screen_text(app))
        await pilot.press("down", "left")
        assert picture.at == (1, 0)
        await pilot.press("x")
        assert picture.at == (0, 0)
        await pilot.press("right", "enter")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "q res" in text
        assert "in band" in text
        assert "p res" not in text, "that axis alone"
        titles = []
        for key in ("enter", "enter", "escape"):
            await pilot.press(key)
            await settle(app)
            titles.append("\n".join(screen_text(app)))
        assert "q from delta_x" in titles[0], "the command that the cell's error follows"
        assert "q: spectra" in titles[1]
        assert ["┊" in text for text in titles] == [True, True, False], "the band in each"
        assert "of its error" in titles[2]
        assert picture.at == (0, 1), "where the cursor was"


async def test_a_click_chooses_a_cell_and_a_second_looks_closer():
    app, _ = app_on(joined(IDLE, DESKS["compared"]))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("5")
        await settle(app)
        picture = app.screen.query_one("#heat", Heat)
        at = next(
            (x, y)
            for y in range(picture.size.height)
            for x in range(picture.size.width)
            if cell_at(heat_plot(COMPARED_RUNG.comparison), *picture.size, x, y) == (1, 0)
        )
        await pilot.click(picture, offset=at)
        assert picture.at == (1, 0)
        assert picture.display
        await pilot.click(picture, offset=at)
        await settle(app)
        assert not picture.display
        assert app.screen.query_one("#plot", Traces).display


async def test_without_a_comparison_there_is_no_picture():
    app, _ = app_on(joined(IDLE, DESKS["fitted"]))
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("5", "enter", "x", "g", "r", "v", "escape")
        await settle(app)
        assert "was not compared" in "\n".join(screen_text(app))
