"""The plots as widgets: keys move cursor and view, only what changed is drawn again, nothing leaves its box."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from more_of_a_kind import thorough
from textual.app import App
from textual.strip import Strip

from gcs.flight.live import LiveWindow
from gcs.tui.plot import STYLES, Bar, BarPlot, FrequencyPlot, Panel, TimePlot, compared
from gcs.tui.widgets.bars import Bars
from gcs.tui.widgets.charts import Charts
from gcs.tui.widgets.traces import Response, Traces

T = np.arange(4000) / 100
WAVE = np.sin(2 * T)
RUN = TimePlot(panels=compared("p", T, WAVE, 0.9 * WAVE), title="run 3", words=("measured", "model", ""))
F = np.linspace(0.3, 15, 200)
RESPONSE = FrequencyPlot(
    panels=(Panel(name="dB", x=F, line=-F, reference=0.1 * F),),
    title="p from delta_x",
    words=("mismatch", "", "allowed"),
)


class Shown(App[None]):
    """One widget, as large as the terminal."""

    def __init__(self, widget: Traces | Bars) -> None:
        super().__init__()
        self.widget = widget

    def compose(self):
        yield self.widget


def counted(widget: Traces) -> list[int]:
    """The rows that are rendered from now on."""
    rows: list[int] = []
    render = widget.render_line

    def render_line(y: int) -> Strip:
        rows.append(y)
        return render(y)

    widget.render_line = render_line
    return rows


async def test_keys_move_the_cursor_and_the_view():
    traces = Traces("braille", "t")
    async with Shown(traces).run_test(size=(80, 20)) as pilot:
        traces.show(RUN)
        await pilot.pause()
        assert traces.cursor is None
        await pilot.press("right")
        start = traces.cursor
        assert start == pytest.approx(20.0, abs=0.02)
        assert [one.name for one in traces.readings()] == ["p", "p res"]
        assert traces.readings()[0].over == pytest.approx(0.9 * traces.readings()[0].line)
        await pilot.press("right")
        step = traces.cursor - start
        assert step == pytest.approx(40 / 56, abs=0.02), "a column"
        await pilot.press("left", "shift+right")
        assert traces.cursor == pytest.approx(start + 10 * step, abs=0.1)
        here = traces.cursor
        await pilot.press("plus", "plus", "equals_sign")
        assert traces.view.span == pytest.approx(40 / 8, rel=0.01)
        assert traces.view.low < here == traces.cursor < traces.view.high
        for _ in range(12):
            await pilot.press("plus")
        await pilot.press("right")
        assert traces.cursor == pytest.approx(here + 0.01), "one sample"
        await pilot.press("home")
        assert traces.cursor == 0.0 == traces.view.low
        await pilot.press("end")
        assert traces.cursor == T[-1] == traces.view.high
        before = traces.view
        await pilot.press("left_square_bracket")
        assert traces.view.high == pytest.approx(before.high - before.span / 2)
        await pilot.press("0")
        assert traces.cursor is None
        assert (traces.view.low, traces.view.high) == (0.0, T[-1])
        for _ in range(3):
            await pilot.press("minus")
        assert (traces.view.low, traces.view.high) == (0.0, T[-1])


async def test_the_same_over_frequency_and_a_look_at_a_band():
    response = Response("ascii", "r")
    async with Shown(response).run_test(size=(80, 12)) as pilot:
        response.show(RESPONSE)
        await pilot.press("right", "plus", "right")
        assert response.view.low < response.cursor < response.view.high
        assert response.readings()[0].line == pytest.approx(-response.cursor)
        assert f"at {response.cursor:.4g} Hz" in response.shown
        response.look_at(2.0, 4.0)
        assert (response.view.low, response.view.high) == (pytest.approx(2.0), pytest.approx(4.0))
        assert response.cursor == pytest.approx(2 * 2**0.5, abs=0.1)
        await pilot.press("home")
        assert response.cursor == pytest.approx(0.3)
        assert response.shown.isascii()


async def test_a_click_puts_the_cursor():
    traces = Traces("braille", "t")
    async with Shown(traces).run_test(size=(80, 20)) as pilot:
        traces.show(RUN)
        await pilot.click(traces, offset=(9, 3))
        assert traces.cursor == pytest.approx(0.4, abs=0.4)
        await pilot.click(traces, offset=(2, 3))
        assert traces.cursor < 1


async def test_keys_before_any_data_do_nothing():
    traces = Traces("braille", "t")
    async with Shown(traces).run_test(size=(80, 20)) as pilot:
        keys = ("left", "right", "home", "end", "plus", "minus", "left_square_bracket", "0")
        await pilot.press(*keys)
        assert (traces.shown, traces.cursor, traces.view, traces.readings()) == ("", None, None, ())
        traces.show(TimePlot(panels=(Panel(name="p", x=T[:0], line=T[:0]),)))
        await pilot.press(*keys)
        assert traces.cursor is None
        assert "no samples" in traces.shown


async def test_only_rows_that_changed_are_drawn_again():
    traces = Traces("braille", "t")
    async with Shown(traces).run_test(size=(80, 20)) as pilot:
        traces.show(RUN)
        await pilot.pause()
        rows = counted(traces)
        traces.show(RUN)
        traces.show(replace(RUN))
        await pilot.pause()
        assert rows == []
        traces.show(replace(RUN, title="run 4"))
        await pilot.pause()
        assert set(rows) == {0}


async def test_a_live_plot_moves_along_until_it_is_zoomed():
    traces = Traces("braille", "t")

    def until(end: int) -> TimePlot:
        return TimePlot(panels=(Panel(name="p", x=T[:end], line=WAVE[:end]),), span_s=10.0)

    async with Shown(traces).run_test(size=(80, 10)) as pilot:
        traces.show(until(2000))
        await pilot.pause()
        assert (traces.view.low, traces.view.high) == (pytest.approx(9.99), pytest.approx(19.99))
        await pilot.press("right")
        held = traces.cursor
        traces.show(until(2200))
        assert traces.view.high == pytest.approx(21.99)
        assert traces.cursor == held
        traces.show(until(3500))
        assert traces.cursor is None, "the view has left it behind"
        await pilot.press("right", "plus")
        view = traces.view
        traces.show(until(3600))
        assert traces.view == view
        await pilot.press("0")
        assert traces.view.high == pytest.approx(35.99)


@pytest.mark.parametrize("style", ["braille", *thorough(style for style in STYLES if style != "braille")])
async def test_nothing_leaves_its_box_at_any_size(style):
    traces = Traces(style, "t")
    async with Shown(traces).run_test(size=(80, 24)) as pilot:
        traces.show(RUN)
        for size in ((20, 3), (33, 5), (79, 24), (200, 50), (41, 1), (5, 9), (120, 40)):
            await pilot.resize_terminal(*size)
            await pilot.press("right")
            await pilot.pause()
            assert [len(line) for line in traces.shown.splitlines()] == [size[0]] * size[1]
            assert [traces.render_line(y).cell_length for y in range(size[1])] == [size[0]] * size[1]


@pytest.mark.parametrize("style", STYLES)
async def test_hostile_names_are_harmless(style):
    evil = "[red]a[/]\x1b[31m\x07\u202e界界\n"
    plot = TimePlot(
        panels=(Panel(name=evil, x=T, line=WAVE, over=WAVE, unit=evil),), title=evil, words=(evil, evil, evil)
    )
    traces, bars = Traces(style, "t"), Bars(style, "b")
    async with Shown(traces).run_test(size=(80, 12)) as pilot:
        traces.show(plot)
        await pilot.press("right")
        await pilot.pause()
        assert "\x1b" not in traces.shown
        assert "[red]" in traces.shown
        assert [traces.render_line(y).cell_length for y in range(12)] == [80] * 12
        assert style != "ascii" or traces.shown.isascii()
    async with Shown(bars).run_test(size=(60, 5)) as pilot:
        bars.show(
            BarPlot(
                bars=(Bar(label=evil, parts=(0.5,), text=evil),),
                title=evil,
                lines=((0.5, evil),),
                words=(evil,),
                beside=evil,
            )
        )
        await pilot.pause()
        assert "\x1b" not in bars.shown
        assert [bars.render_line(y).cell_length for y in range(5)] == [60] * 5


async def test_without_colours_the_model_is_bold_and_the_cursor_reversed(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    traces = Traces("block", "t")
    x = np.arange(300.0)
    top = np.full(x.size, 0.99)
    async with Shown(traces).run_test(size=(80, 6)) as pilot:
        traces.show(TimePlot(panels=(Panel(name="p", x=x, line=top, over=-top, least=1.0),)))
        await pilot.press("right")
        await pilot.pause()
        styles = {text: style for y in range(5) for text, style, _ in traces.render_line(y)}
        assert next(style for text, style in styles.items() if "▀▀▀" in text).bold is not True
        assert next(style for text, style in styles.items() if "___" in text).bold
        assert next(style for text, style in styles.items() if text == "│").reverse


async def test_what_is_looked_at_stands_on_another_ground_and_keeps_its_signs():
    traces = Traces("braille", "t")
    async with Shown(traces).run_test(size=(80, 12)) as pilot:
        traces.show(RESPONSE)
        await pilot.pause()
        plain = [traces.render_line(y).text for y in range(12)]
        traces.show(replace(RESPONSE, shaded=((2.0, 20.0), (0.1, 0.4))))
        for width in (80, 30, 12, 120):
            await pilot.resize_terminal(width, 12)
            await pilot.pause()
            strips = [traces.render_line(y) for y in range(12)]
            assert [one.cell_length for one in strips] == [width] * 12
            grounds = [{style.bgcolor for _, style, _ in one} for one in strips]
            assert [len(one) > 1 for one in grounds] == [False, *[True] * 10, False]
        await pilot.resize_terminal(80, 12)
        await pilot.pause()
        signs = str.maketrans("┊·", "  ")  # edges stand before the grid
        assert [traces.render_line(y).text.translate(signs) for y in range(12)] == [
            one.translate(signs) for one in plain
        ]


async def test_another_theme_gives_other_colours():
    traces = Traces("braille", "t")
    app = Shown(traces)
    async with app.run_test(size=(80, 10)) as pilot:
        traces.show(RUN)
        await pilot.pause()
        dark = {style.color for _, style, _ in traces.render_line(1)}
        app.theme = "textual-light"
        await pilot.pause()
        assert {style.color for _, style, _ in traces.render_line(1)}.isdisjoint(dark)


async def test_the_live_charts_say_where_no_value_is_now():
    charts = Charts("braille", "charts")
    nothing = np.full(T.size, np.nan)
    window = LiveWindow(
        t=T, p=WAVE, q=WAVE, delta_x=nothing, delta_y=nothing, excitation_x=nothing, excitation_y=nothing
    )
    async with Shown(charts).run_test(size=(80, 8)) as pilot:
        charts.draw(window, 20.0)
        await pilot.pause()
        lines = charts.shown.splitlines()
        assert [line[:4].strip() for line in lines[::2]] == ["p", "q", "δx", "δy"] or "δx" in charts.shown
        assert f"{WAVE[-1]:+.2f} rad/s" in charts.shown
        assert "peak 1.00" in charts.shown
        assert charts.shown.count("shown once recording starts") == 2
        charts.draw(window, 20.0, stale=True)
        assert "no link" in charts.shown
        assert "rad/s" not in charts.shown


@pytest.mark.parametrize("style", STYLES)
async def test_bars_are_shown_and_what_does_not_fit_is_counted(style):
    bars = Bars(style, "b")
    async with Shown(bars).run_test(size=(60, 4)) as pilot:
        bars.show(
            BarPlot(
                bars=tuple(Bar(label=f"effect {i}", parts=(1 - i / 10,)) for i in range(9)), title="what is missing"
            )
        )
        await pilot.pause()
        assert bars.shown.splitlines()[-1].strip() == "6 more"
        await pilot.resize_terminal(60, 12)
        await pilot.pause()
        assert "what is missing" in bars.shown
        assert "effect 8" in bars.shown


async def test_the_plot_that_has_the_keys_is_underlined():
    traces = Traces("braille", "t")

    def title_underlined() -> bool:
        return bool(next(style for text, style, _ in traces.render_line(0) if "run 3" in text).underline)

    async with Shown(traces).run_test(size=(80, 12)) as pilot:
        traces.show(RUN)
        traces.focus()
        await pilot.pause()
        assert title_underlined()
        traces.blur()
        await pilot.pause()
        assert not title_underlined()
