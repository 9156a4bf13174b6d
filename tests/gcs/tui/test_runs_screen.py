"""Runs: what differs is said before the fit, and runs are cut, split and left out by keys."""

from __future__ import annotations

from dataclasses import replace

import pytest
from fake_app import IDLE, app_on, screen_text, settle
from fake_desk import DESKS, RUNS
from more_of_a_kind import thorough

from gcs.analysis.alike import alike
from gcs.tui import runs_words
from gcs.tui.draw_run import run_strip
from gcs.tui.next_step import MULTIROTOR_FIT, next_words
from gcs.tui.state import State, joined
from gcs.tui.widgets.traces import Traces
from sysid.data.airframe import Airframe

WORD = "flight-0007/flight.BIN#{}"


def on(moment: str) -> State:
    return joined(IDLE, DESKS[moment])


@pytest.mark.parametrize("size", [(80, 24), *thorough([((120, 40),)])])
async def test_two_vehicles_in_a_folder_are_told_with_what_to_do(size):
    app, engine = app_on(on("mixed"))
    async with app.run_test(size=size) as pilot:
        await pilot.press("3")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "! vehicle differs: frame HELI: flight.BIN#1, #3; frame QUAD" in text
        assert "A leaves out flight.BIN#4" in text
        assert "like  health" in text
        await pilot.press("a")
        assert engine.asked == ["desk use_alike"]
        engine.now = on("open")
        await settle(app)
        assert "differs" not in "\n".join(screen_text(app))


async def test_the_run_under_the_mark_is_drawn_and_cut_where_the_cursor_is():
    app, engine = app_on(on("open"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3", "c")
        await settle(app)
        assert "put the cursor on the strip first" in "\n".join(screen_text(app))
        assert engine.asked == []
        await pilot.press("right")
        cursor = app.screen.query_one("#plot", Traces).cursor
        assert cursor == pytest.approx(6.0, abs=0.2)
        await pilot.press("c", "e", "w", "h", "enter", "s")
        await app.workers.wait_for_complete()
        word = WORD.format(1)
        assert engine.asked == [
            f"desk cut {word} {cursor} None",
            f"desk cut {word} None {cursor}",
            f"desk take_whole {word}",
            f"desk halve {word}",
            f"desk fit_alone {word}",
            "desk alternate",
        ]
        await pilot.press("down")
        await settle(app)
        assert not app.screen.query_one("#drawn").display, "a run without samples"


async def test_a_key_that_changes_nothing_says_why():
    app, engine = app_on(on("open"))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3", "f")
        await settle(app)
        assert "flight.BIN#1 is used so already (fit); 4, then F fits" in "\n".join(screen_text(app))
        await pilot.press("down", "f")
        assert engine.asked == ["desk use flight-0007/flight.BIN#2 FIT"]


def test_a_multirotor_is_told_where_its_model_is_and_one_axis_where_the_other_comes_from():
    desk = DESKS["open"]
    quad = tuple(
        row if row.record is None else replace(row, record=replace(row.record, airframe=Airframe.MULTIROTOR))
        for row in desk.runs
    )
    of_quad = replace(desk, runs=quad)
    assert runs_words.airframe_lines(desk, 80) == []
    assert "neither TPP nor CD is" in str(runs_words.airframe_lines(of_quad, 80))
    assert MULTIROTOR_FIT in next_words(joined(IDLE, of_quad), "Fit")
    roll = replace(desk, runs=tuple(row for row in desk.runs if row.axis == "roll" and row.maneuver == "chirp"))
    assert "only roll is swept here: O" in next_words(joined(IDLE, roll), "Runs")
    assert "4 fits 2 runs" in next_words(joined(IDLE, desk), "Runs")


def test_sizes_have_units_and_a_long_name_shows_its_end():
    desk = replace(DESKS["open"], runs=(replace(RUNS[0], id="a-long-name-of-a-log.BIN#12@5:25"),))
    (line,) = runs_words.run_rows(desk, 0, 80, 5, alike([]))
    assert "#12@5:25 roll chirp" in line[0]
    assert " 7.0 %  " in line[0]
    said = [line if isinstance(line, str) else line[0] for line in runs_words.run_details(desk, 0, 79)]
    assert any("7.0 % of full command" in line for line in said)


def test_the_strip_counts_from_the_maneuver_and_both_rates_have_one_scale():
    row = replace(RUNS[2], start_s=2.0)
    plot = run_strip(row)
    assert plot is not None
    command, p, q = plot.panels
    assert (command.name, command.x[0], command.over) == ("δy", -2.0, None)
    assert p.fixed == q.fixed == (-0.5, 0.5)
    assert run_strip(replace(row, record=None)) is None
