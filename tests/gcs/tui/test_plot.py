"""The renderer keeps every peak, draws no line over a gap, and fits its box."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from rich.cells import cell_len

from gcs.tui.plot import (
    STYLES,
    Bar,
    BarPlot,
    FrequencyPlot,
    Panel,
    TimePlot,
    View,
    bar,
    bars,
    chart,
    dots_across,
    envelope,
    picture,
    prepared,
    readings,
    response_names,
    response_plot,
    round_limit,
    spectra_plot,
    time_plot,
)
from gcs.tui.plot.layout import shaded_at, sheet_of
from gcs.tui.plot.ready import clamped, moved, zoomed
from sysid.compare.metrics import Mismatch
from sysid.compare.values import BandError, Densities, ResponseError, Trace


def drawn(line: str) -> bool:
    return any(character not in " ·-" for character in line)


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("spike_at", [1, 4321, 9998])
def test_a_spike_of_one_sample_is_drawn_to_its_height(style, spike_at):
    t = np.arange(10_000) / 500
    values = np.zeros(t.size)
    values[spike_at] = 1.0
    low, high = envelope(t, values, dots_across(60, style), 20.0, t[-1])
    lines = chart(low, high, 3, 60, 1.0, style)
    assert drawn(lines[0]), "the spike reaches the top row"
    assert not drawn(lines[2]), "and nothing reaches the bottom one"


@pytest.mark.parametrize("seed", range(5))
def test_the_envelope_holds_the_extremes_of_its_slices(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.001, 0.003, 5000))
    values = rng.standard_normal(t.size)
    low, high = envelope(t, values, 100, t[-1] + 1, t[-1])
    assert np.nanmax(high) == values.max()
    assert np.nanmin(low) == values.min()
    slots = np.floor(t / ((t[-1] + 1) / 100)).astype(int)
    slots += 99 - slots[-1]
    for slot in (50, 75, 99):
        inside = values[slots == slot]
        assert (low[slot], high[slot]) == (inside.min(), inside.max())


def test_a_gap_stays_empty_and_slow_telemetry_is_joined():
    t = np.concatenate((np.arange(0, 4, 0.1), np.arange(7, 10, 0.1)))
    low, _ = envelope(t, np.ones(t.size), 200, 10.0, 9.99)
    seconds = (np.arange(200) + 0.5) * 10 / 200
    assert np.isnan(low[(seconds > 4.1) & (seconds < 6.9)]).all()
    assert np.isfinite(low[(seconds > 0.1) & (seconds < 3.8)]).all()


def test_the_picture_moves_with_time_and_does_not_shimmer():
    t = np.arange(10_000) / 500
    values = np.sin(9 * t) + np.sin(61 * t)
    slice_s = 10.0 / 100
    now, _ = envelope(t, values, 100, 10.0, 15.05)
    later, _ = envelope(t, values, 100, 10.0, 15.05 + 7 * slice_s)
    np.testing.assert_array_equal(now[7:-1], later[:-8])


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("rows", [1, 2, 5])
def test_the_chart_is_as_large_as_asked_with_any_data(style, rows):
    for values in (np.array([]), np.array([np.nan]), np.array([np.inf, 1e300, -1e300]), np.full(50, 1e6)):
        low, high = envelope(np.arange(values.size) * 0.1, values, dots_across(33, style), 5.0, 5.0)
        lines = chart(low, high, rows, 33, 1.0, style)
        assert [len(line) for line in lines] == [33] * rows


def test_a_steep_signal_has_no_holes():
    t = np.arange(400) / 100
    values = np.where(t < 2, -1.0, 1.0)
    low, high = envelope(t, values, 20, 4.0, t[-1])
    lines = chart(low, high, 4, 20, 1.0, "ascii")
    column = ["".join(line[i] for line in lines) for i in range(20)]
    assert "||||" in column, column


def test_ascii_is_ascii():
    t = np.arange(400) / 100
    low, high = envelope(t, np.sin(t * 5), 40, 4.0, t[-1])
    assert "".join(chart(low, high, 4, 40, 1.0, "ascii")).isascii()
    assert bar(0.5, 8, "ascii") == "####...."


@pytest.mark.parametrize(
    ("largest", "limit"), [(0.0, 0.05), (0.04, 0.05), (0.2, 0.2), (0.21, 0.5), (7, 10), (np.nan, 0.05), (np.inf, 0.05)]
)
def test_scales_are_round_and_hold_the_signal(largest, limit):
    assert round_limit(largest, 0.05) == pytest.approx(limit)


def test_a_bar_shows_a_little_as_something_and_too_much_as_full():
    assert [bar(x, 4, "block") for x in (0.0, 0.01, 0.5, 1.0, 9.0, np.nan)] == [
        "░░░░",
        "▓░░░",
        "▓▓░░",
        "▓▓▓▓",
        "▓▓▓▓",
        "░░░░",
    ]


# ------------------------------------------------------------------------------------------------ panels over an axis


def rows_of(plot, width, height, style="braille", view=None, cursor=None):
    ready = prepared(plot)
    return picture(ready, ready.first if view is None else view, width, height, style, cursor)


def texts(rows):
    return ["".join(text for text, _ in row) for row in rows]


STEPS = np.arange(28.0)
"""One sample in each column of dots of a 20-cell braille row."""


RAMPS = {
    "braille": ([" p    ⢀⣀⣀⣀⡤⠤⠤⠤⠖⠒⠒⠒⠋⠉", " ±1   ⠉     ·     · "], [" p    ⢉⣉⣓⣒⡶⠶⠦⠤⠶⠶⣖⣒⣋⣉", " ±1   ⠉     ·     ·▝"]),
    "block": ([" p    ▄▄▄▄▄▄▄▄▄█▀▀▀▀", " ±1   ▀     ·     · "], [" p    ▌▌▌▌▌▌▖▖▖▌▌▌▌▌", " ±1   ▀     ·     ·¯"]),
    "ascii": ([" p    .........|''''", " +-1  '     -     - "], [" p    ######ooo#####", " +-1  '     -     -^"]),
}
"""Up from 0 to 1, and with a model that goes down."""


@pytest.mark.parametrize("style", STYLES)
def test_a_ramp_is_drawn_exactly(style):
    alone, crossed = RAMPS[style]
    axis = "    s |0            " if style == "ascii" else "    s │0            "
    assert texts(rows_of(TimePlot(panels=(Panel(name="p", x=STEPS, line=STEPS / 27, least=1.0),)), 20, 3, style)) == [
        *alone,
        axis,
    ]
    panel = Panel(name="p", x=STEPS, line=STEPS / 27, over=1 - STEPS / 27, least=1.0)
    rows = rows_of(TimePlot(panels=(panel,)), 20, 3, style)
    assert texts(rows) == [*crossed, axis]
    assert [ink for _, ink in rows[1]] == ["text", "measured", "grid", "model"]


@pytest.mark.parametrize(
    ("style", "signs"), [("braille", ("⠉⠉⠉", "▀▀▀")), ("block", ("▀▀▀", "¯¯¯")), ("ascii", ("'''", "^^^"))]
)
def test_model_and_measurement_are_told_apart_without_colour(style, signs):
    x = np.arange(240.0)
    top, bottom = np.full(x.size, 0.999), np.full(x.size, -0.999)
    apart = Panel(name="p", x=x, line=top, over=bottom, least=1.0)
    rows = rows_of(TimePlot(panels=(apart,), words=("measured", "model", "")), 60, 4, style)
    measured, model = rows[1], rows[2]
    assert {ink for text, ink in measured if signs[0] in text} == {"measured"}
    lower = {"⠉⠉⠉": "▄▄▄", "▀▀▀": "___", "'''": "___"}[signs[0]]
    assert {ink for text, ink in model if lower in text} == {"model"}
    same = Panel(name="p", x=x, line=top, over=top, least=1.0)
    assert "both" in {ink for _, ink in rows_of(TimePlot(panels=(same,)), 60, 4, style)[0]}


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("at", [0, 17, 5000, 9998, 9999])
@pytest.mark.parametrize("which", ["line", "over"])
def test_no_peak_is_lost_in_any_view_that_holds_it(style, at, which):
    t = np.arange(10_000) / 500
    quiet, spike = np.zeros(t.size), np.zeros(t.size)
    spike[at] = 1.0
    panel = (
        Panel(name="p", x=t, line=spike, over=quiet)
        if which == "line"
        else Panel(name="p", x=t, line=quiet, over=spike)
    )
    ready = prepared(TimePlot(panels=(panel,)))
    view = ready.whole
    for _ in range(12):
        upper = texts(picture(ready, view, 60, 5, style))[0]
        assert drawn(upper[9:51]), view
        view = zoomed(ready, view, 0.5, t[at])


@pytest.mark.parametrize("style", STYLES)
def test_a_gap_in_time_is_not_joined(style):
    t = np.concatenate((np.arange(0, 4, 0.01), np.arange(6, 10, 0.01)))
    rows = texts(rows_of(TimePlot(panels=(Panel(name="p", x=t, line=np.full(t.size, 0.5), least=1.0),)), 70, 5, style))
    line = next(row for row in rows if drawn(row[9:55]))[9:55]
    assert not line[20:26].strip(" ·-")
    assert line[:16].strip(" ·-")
    assert line[30:].strip(" ·-")


HOSTILE = {
    "nothing": (np.array([]), np.array([])),
    "one": (np.array([3.0]), np.array([1.0])),
    "one nan": (np.array([3.0]), np.array([np.nan])),
    "constant": (np.arange(50.0), np.full(50, 7.0)),
    "zero": (np.arange(50.0), np.zeros(50)),
    "infinite": (np.arange(5.0), np.array([np.inf, -np.inf, np.nan, 1.0, 2.0])),
    "huge": (np.arange(4.0), np.array([1e308, -1e308, 1.0, 0.0])),
    "tiny": (np.arange(4.0) * 1e-9, np.array([1e-308, -1e-300, 0.0, 1e-200])),
    "time stands still": (np.zeros(9), np.arange(9.0)),
    "time goes back": (np.array([5.0, 1.0, 4.0, 0.0]), np.arange(4.0)),
    "time is broken": (np.array([np.nan, np.inf, 1.0, -np.inf, 1e300, 2.0]), np.arange(6.0)),
    "far from zero": (1e9 + np.arange(20) * 0.002, np.arange(20.0)),
    "two": (np.array([0.0, 1.0]), np.array([-1.0, 1.0])),
}


BROKEN = ("one nan", "infinite", "time is broken")
"""In every style; the others in the finest."""
SIZES = [(1, 1), (5, 2), (20, 3), (33, 7), (64, 1), (3, 20)]
LARGE = [(80, 24), (120, 40), (7, 60)]


@pytest.mark.parametrize(
    ("style", "case"),
    [
        pytest.param(style, case, marks=pytest.mark.thorough if style != "braille" and case not in BROKEN else [])
        for style in STYLES
        for case in HOSTILE
    ],
)
def test_every_picture_is_as_large_as_asked(style, case):
    x, y = HOSTILE[case]
    panels = (
        Panel(name="p", x=x, line=y, over=y[::-1], unit="rad/s"),
        Panel(name="δx", x=x, line=y, reference=y, residual=True),
        Panel(name="dB", x=x, line=y, centred=False, least=1.0),
        Panel(name="psd", x=x, line=y, over=y, reference=y, centred=False, logarithmic=True, least=1.0, most=4.0),
        Panel(name="phase", x=x, line=y, wraps=True, fixed=(-180.0, 180.0)),
    )
    for plot in (
        TimePlot(panels=panels, title="title", words=("measured", "model", "noise")),
        TimePlot(panels=panels, span_s=20.0, stale="no link"),
        FrequencyPlot(
            panels=panels,
            title="title",
            words=("a", "b", "c"),
            low_hz=0.5,
            high_hz=15.0,
            marked=((1.0, 3.0), (-1.0, np.nan)),
        ),
        FrequencyPlot(panels=panels),
    ):
        ready = prepared(plot)
        for width, height in [*SIZES, *LARGE] if style == "braille" else SIZES:
            view = ready.first
            for factor, cursor in ((1.0, None), (0.3, moved(ready, view, None, 0.0)), (1e-9, ready.whole.low)):
                view = zoomed(ready, view, factor, cursor)
                rows = picture(ready, view, width, height, style, cursor)
                assert [cell_len(line) for line in texts(rows)] == [width] * height
                if style == "ascii":
                    assert "".join(texts(rows)).replace("δ", "d").isascii()


def test_scales_are_told():
    t = np.arange(100) / 10
    wave = np.sin(t)
    plot = TimePlot(
        panels=(
            Panel(name="p", x=t, line=0.8 * wave),
            Panel(name="own", x=t, line=0.1 * wave),
        )
    )
    told = [line[:9].strip() for line in texts(rows_of(plot, 80, 7))]
    assert told == ["p", "", "±1", "own", "", "±0.1", "s"]


def test_the_axis_has_round_labels_at_their_places():
    t = np.arange(0, 30.001, 0.01) + 512
    ready = prepared(TimePlot(panels=(Panel(name="p", x=t, line=np.sin(t)),), origin_s=512.0))
    line = texts(picture(ready, ready.first, 80, 4, "braille"))[-1]
    assert line.split() == ["s", "│0", "│5", "│10", "│15", "│20", "│25", "│30"] or "│30" not in line
    at = line.index("│15") - 9
    assert abs(at - 56 / 2) <= 1
    f = np.linspace(0.4, 15, 100)
    axis = texts(rows_of(FrequencyPlot(panels=(Panel(name="dB", x=f, line=f),), low_hz=0.5, high_hz=15.0), 80, 4))[-1]
    assert axis.split() == ["Hz", "│0.5", "│1", "│2", "│5", "│10"]


def test_the_cursor_reads_every_strip_at_one_time():
    t = np.arange(1000) / 100
    plot = TimePlot(
        panels=(
            Panel(name="p", x=t, line=t / 10, over=-t / 10),
            Panel(name="q", x=t[::2], line=t[::2]),
            Panel(name="r", x=t[:10], line=t[:10]),
        )
    )
    ready = prepared(plot)
    found = readings(ready, 5.0)
    assert [one.name for one in found] == ["p", "q", "r"]
    assert (found[0].line, found[0].over, found[1].line) == (pytest.approx(0.5), pytest.approx(-0.5), 5.0)
    assert np.isnan(found[2].line), "behind its end there is nothing"
    assert readings(ready, None) == ()
    rows = texts(picture(ready, ready.first, 80, 9, "braille", 5.0))
    assert "+0.50" in rows[0]
    assert "at 5.0" in rows[-1]


def test_the_cursor_steps_by_columns_and_at_last_by_samples():
    t = np.arange(1000) / 100
    ready = prepared(TimePlot(panels=(Panel(name="p", x=t, line=t),)))
    start = moved(ready, ready.first, None, 0.0)
    assert start in t
    assert moved(ready, ready.first, start, 0.5) == pytest.approx(start + 0.5)
    assert moved(ready, ready.first, start, 1e-6) == pytest.approx(start + 0.01)
    assert moved(ready, ready.first, start, -1e-6) == pytest.approx(start - 0.01)
    assert moved(ready, ready.first, t[-1], 3.0) == t[-1]
    assert moved(prepared(TimePlot(panels=(Panel(name="p", x=t[:0], line=t[:0]),))), ready.first, None, 1.0) is None


def test_zoom_stays_inside_and_ends_at_single_samples():
    t = 100 + np.arange(1000) / 100
    ready = prepared(TimePlot(panels=(Panel(name="p", x=t, line=t),)))
    view = ready.whole
    for _ in range(40):
        view = zoomed(ready, view, 0.5, 103.0)
        assert view.low <= 103.0 <= view.high
    assert view.span == pytest.approx(0.04)
    for _ in range(40):
        view = zoomed(ready, view, 2.0, 103.0)
    assert (view.low, view.high) == pytest.approx((ready.whole.low, ready.whole.high))
    assert clamped(ready, View(-5.0, 1.0)).low == ready.whole.low


def test_bands_are_marked_where_they_lie():
    f = np.linspace(0.5, 15, 200)
    plot = FrequencyPlot(
        panels=(Panel(name="dB", x=f, line=f),), low_hz=1.0, high_hz=10.0, marked=((1.0, 2.0), (9.0, 10.0))
    )
    line = next(row for row in texts(rows_of(plot, 79, 8, "ascii")) if "beyond" in row)[9:64]
    assert (line.find("="), len(line.rstrip())) == (0, 55)
    assert abs(line.index(" ") - 55 * np.log10(2)) <= 2


def test_what_noise_allows_is_drawn_on_both_sides_and_not_at_the_edge():
    f = np.linspace(1, 10, 300)
    allowed = np.where(f < 5, 5.0, 400.0)
    plot = FrequencyPlot(
        panels=(Panel(name="d dB", x=f, line=np.zeros(f.size), reference=allowed, least=10.0, most=20.0),)
    )
    rows = texts(rows_of(plot, 80, 10, "ascii"))
    across = [i for i, row in enumerate(rows[:-1]) if "~" in row]
    assert len(across) == 2
    assert all(row[9:65].rindex("~") < 45 for row in rows if "~" in row)


def test_a_phase_is_not_joined_over_its_turn():
    f = np.linspace(1, 10, 300)
    phase = (-60 * f + 180) % 360 - 180
    plot = FrequencyPlot(panels=(Panel(name="phase", x=f, line=phase, fixed=(-180.0, 180.0), wraps=True),))
    columns = ["".join(line) for line in zip(*[row[9:] for row in texts(rows_of(plot, 64, 9, "ascii"))], strict=True)]
    assert max(column.count("|") for column in columns) <= 3


# ------------------------------------------------------------------------------------------------ bars


def test_bars_are_as_long_as_their_share():
    plot = BarPlot(
        bars=(
            Bar(label="ab", parts=(0.5,), text="50 %"),
            Bar(label="c", parts=(0.25, 0.25, 0.5), text="x"),
            Bar(label="d", parts=(), text="not testable"),
        )
    )
    assert texts(bars(plot, 37, 3, "ascii")) == [
        " ab ##########           50 %        ",
        " c  #####=====.......... x           ",
        " d                       not testable",
    ]


def test_bars_have_marks_bounds_and_a_second_value():
    plot = BarPlot(
        bars=(Bar(label="a", parts=(50.0,), text="50", least=40.0, most=60.0, beside=20.0, chosen=True),),
        title="p",
        full=100.0,
        lines=((90.0, "noise"),),
    )
    (row,) = texts(bars(plot, 26, 1, "ascii"))
    assert row == " a ###o###<--->   |    50 "[:26] or "<" in row
    assert row.index("o") < row.index("<") < row.index(">") < row.index("|")


@pytest.mark.parametrize("style", STYLES)
def test_bars_fit_any_box(style):
    for lengths in ((), (np.nan,), (np.inf, 1.0), (-1.0, 0.0, 1e300), (0.2, 0.3, 0.4)):
        one = Bar(
            label="a long label of a candidate " * 2,
            parts=lengths,
            text="not testable: no airspeed",
            least=-np.inf,
            most=np.inf,
            beside=0.5,
        )
        plot = BarPlot(
            bars=(one,) * 9, title="title", lines=((0.8, "enough"), (np.nan, "")), words=("a", "b"), beside="validation"
        )
        for width, height in ((1, 1), (3, 2), (20, 3), (80, 24), (50, 9), (31, 60)):
            rows = bars(plot, width, height, style)
            assert [cell_len(line) for line in texts(rows)] == [width] * height
            assert style != "ascii" or "".join(texts(rows)).isascii()
    assert "7 more" in texts(bars(plot, 40, 3, style))[-1]


# ------------------------------------------------------------------------------------------------ from a comparison


@pytest.fixture
def comparison():
    t = 512 + np.arange(3000) / 100
    f = np.linspace(0.2, 15, 60)
    measured = np.stack([np.sin(t), np.cos(t)])
    mismatch = Mismatch("q", "delta_y", f[5:40], f[5:40], f[5:40], np.full(35, 0.9), 12.0)
    response = ResponseError(
        mismatch=mismatch,
        frequency_hz=f,
        decibels=0.1 * f,
        degrees=-2 * f,
        allowed_db=0.5 + 0 * f,
        allowed_deg=5 + 0 * f,
        noticed=((4.0, 8.0),),
        measured=np.exp(-1j * f),
    )
    densities = Densities(f, *(np.stack([1 / f, 2 / f], axis=1) * k for k in (1.0, 0.3, 0.1)))
    bands = (
        BandError(
            axis="roll",
            low_hz=0.5,
            high_hz=3.0,
            error_share=0.4,
            noise_share=0.25,
            coherence={},
            coherence_together=0.5,
        ),
        BandError(
            axis="roll",
            low_hz=3.0,
            high_hz=15.0,
            error_share=0.6,
            noise_share=None,
            coherence={},
            coherence_together=0.9,
        ),
        BandError(
            axis="pitch",
            low_hz=0.5,
            high_hz=15.0,
            error_share=1.0,
            noise_share=0.5,
            coherence={},
            coherence_together=0.0,
        ),
    )
    traces = (
        Trace("a#1", t, measured, 0.1 * measured, {"delta_x": measured[0]}),
        Trace("a#2", t, measured, 0.1 * measured[::-1] * [[1], [3]], {"delta_x": measured[0]}),
    )
    return SimpleNamespace(
        outputs=("p", "q"),
        commands=("delta_x", "delta_y"),
        band_hz=(0.0, 15.0),
        traces=traces,
        responses=(response,),
        densities=densities,
        bands=bands,
    )


def test_a_run_of_a_comparison(comparison):
    plot = time_plot(comparison, 1, commands={"δx": comparison.traces[0].measured[0]})
    assert [(one.name, one.residual, one.over is not None) for one in plot.panels] == [
        ("δx", False, False),
        ("p", False, True),
        ("p res", True, False),
        ("q", False, True),
        ("q res", True, False),
    ]
    assert (plot.title, plot.origin_s) == ("run a#2", 512.0)
    np.testing.assert_allclose(plot.panels[1].line - plot.panels[1].over, plot.panels[2].line)
    beside = time_plot(
        comparison, 0, outputs=[1], other=("CD", 0.5 * comparison.traces[0].measured), residual_least=(1, 2)
    )
    measured, residual = beside.panels
    np.testing.assert_allclose(residual.reference, 0.5 * measured.line)
    assert (residual.least, measured.mirrored, beside.words[2]) == (2, False, "CD")


def test_a_response_of_a_comparison(comparison):
    whole = response_plot(comparison, 0)
    assert [one.name for one in whole.panels] == ["dB", "phase", "Δ dB", "Δ deg", "coh"]
    assert whole.marked == ((4.0, 8.0),)
    assert (whole.low_hz, whole.high_hz) == (0.25, 15.0)
    f = comparison.responses[0].frequency_hz
    measured = comparison.responses[0].measured
    modelled = measured * 10 ** (0.1 * f / 20) * np.exp(-1j * np.radians(2 * f))
    np.testing.assert_allclose(whole.panels[0].over, 20 * np.log10(np.abs(modelled)))
    np.testing.assert_allclose(whole.panels[1].over, np.degrees(np.angle(modelled)))
    assert response_names(comparison) == ("q from delta_y",)


def test_spectra_of_a_comparison(comparison):
    (panel,) = spectra_plot(comparison, 1).panels
    np.testing.assert_allclose(panel.over, 0.3 * panel.line)
    np.testing.assert_allclose(panel.reference, 0.1 * panel.line)
    text = texts(rows_of(spectra_plot(comparison, 1), 80, 9))
    assert "1e1" in text[1]


def test_the_noise_stays_in_sight_where_the_residual_comes_down_to_it():
    f = np.geomspace(0.5, 10, 80)
    panel = Panel(name="p", x=f, line=10 / f, over=1 / f, reference=1 / f, logarithmic=True, centred=False)
    for style, dashes in (("braille", "▔─▁"), ("block", "·:"), ("ascii", "~=")):
        text = "".join(texts(rows_of(FrequencyPlot(panels=(panel,)), 80, 6, style)))
        assert sum(text.count(dash) for dash in dashes) >= 10, style


def test_a_band_that_is_looked_at_lies_between_its_edges():
    f = np.geomspace(1, 10, 60)
    plot = FrequencyPlot(panels=(Panel(name="dB", x=f, line=f),), low_hz=1.0, high_hz=10.0, shaded=((2.0, 5.0),))
    ready = prepared(plot)
    for style, edge in (("braille", "┊"), ("ascii", ":")):
        row = texts(picture(ready, ready.first, 80, 9, style))[1]
        columns = [x for x, sign in enumerate(row) if sign == edge]
        assert len(columns) == 2
        wanted = [9 + 56 * math.log10(2), 9 + 56 * math.log10(5)]
        assert columns == pytest.approx(wanted, abs=1)
    out_of_sight = sheet_of(ready, View(0.8, 1.0), 80, 9, "braille", None)
    assert shaded_at(out_of_sight) == ()
