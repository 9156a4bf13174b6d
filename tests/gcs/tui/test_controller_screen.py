"""Controller: sets of gains side by side, sliders, what falls short in sign, word and colour, what a push changes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from fake_app import DESIGNED, IDLE, app_on, screen_text, settle
from fake_desk import CLEARED, DESKS, GAINS, PRESENT
from more_of_a_kind import thorough

from gcs.desk.state import Weights
from gcs.tui import gains_words
from gcs.tui.dialogs import Confirm
from gcs.tui.draw_gains import answers, flown
from gcs.tui.sliders import SLIDERS, slider_lines, value_words
from gcs.tui.state import Bank, joined

TRIED = joined(replace(IDLE, vehicle=None, bank=Bank(PRESENT.crc, None, False)), DESKS["tried"])


def plain(lines) -> list[str]:
    return [one.plain if hasattr(one, "plain") else one if isinstance(one, str) else one[0] for one in lines]


@pytest.mark.parametrize("size", [(80, 24), *thorough([((120, 40),)])])
async def test_sets_of_gains_stand_side_by_side_and_what_falls_short_is_marked(size):
    app, _ = app_on(TRIED)
    async with app.run_test(size=size) as pilot:
        await pilot.press("8")
        await settle(app)
        lines = screen_text(app)
        head = next(line for line in lines if "in the vehicle" in line)
        assert head.split() == ["in", "the", "vehicle", "designed", "sliders", "asked"]
        margin = next(line for line in lines if "gain margin" in line)
        assert margin.count("dB") == 4
        assert margin.count("✗ low") == 1
        assert any("! high" in line for line in lines if "overshoot" in line)
        assert any("✗ FAILS (fit)" in line and "! poor (fit)" in line for line in lines if "verdict" in line)


async def test_sliders_move_by_keys_and_by_a_press_and_gains_follow():
    app, engine = app_on(TRIED)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("8")
        await settle(app)
        engine.asked.clear()
        before = engine.desk.followed
        await pilot.press("right", "down", "left", "0")
        now = Weights(input_cost=10.0)
        sliders = app.screen.query_one("#sliders")
        await pilot.click(sliders, offset=(18, 3))  # the prefilter's track, its first place
        await app.run_action("screen.put(3, 1)")
        await app.workers.wait_for_complete()
        turned = [one for one in engine.asked if one.startswith("desk turn ")]
        assert turned[0] == f"desk turn {now}"
        assert turned[1] == f"desk turn {Weights(input_cost=8.0, flapping_cost=0.0005)}"
        assert turned[2] == f"desk turn {Weights()}"
        assert turned[-1] == f"desk turn {Weights(input_cost=8.0, dynamic=True)}"
        assert engine.desk.followed > before
        assert not any("design" in one for one in engine.asked), "nothing is kept"


def test_a_slider_stands_at_the_nearest_place_and_ends_where_it_ends():
    cost, flapping, observer, prefilter = SLIDERS
    assert cost.moved(Weights(input_cost=5.2), 1).input_cost == 6.0
    assert cost.moved(Weights(input_cost=0.1), -1).input_cost == 0.1
    assert flapping.at(Weights(), 0).flapping_cost == 1e-5
    assert observer.moved(Weights(observer=0.3), -5).observer == 0.0
    assert prefilter.moved(Weights(), 1).dynamic is True
    assert value_words(observer, Weights(observer=0.0)) == "Kalman filter"
    for width in (80, 120):
        assert all(len(line.plain) <= width for line in slider_lines(Weights(), 1, width, "ascii"))


def test_margins_of_a_model_that_nobody_asked_about_are_said_to_be():
    desk = DESKS["fitted"]
    lines = plain(gains_words.controller_lines(joined(IDLE, desk), 80))
    assert lines[1].startswith(" no gains are designed yet")
    (line,) = [one for one in lines if "only if TPP" in one]
    assert "nobody asked: 6, then D" in line
    lacking = replace(CLEARED, standing=replace(CLEARED.standing, state="missing", effects=("servo_lag",)))
    desk = replace(DESKS["tried"], trial=None, designed=replace(GAINS, clearance=lacking))
    assert any(
        "lacks servo_lag: its own margins are an illusion" in one
        for one in plain(gains_words.controller_lines(joined(IDLE, desk), 80))
    )


def test_an_answer_that_never_gets_there_says_how_far_it_comes():
    slow = SimpleNamespace(**{**vars(GAINS.following.roll), "rise_s": None, "own": 0.83 * GAINS.following.roll.asked})
    made = replace(GAINS, following=SimpleNamespace(roll=slow, pitch=GAINS.following.pitch))
    lines = plain(gains_words.controller_lines(joined(IDLE, replace(DESKS["designed"], designed=made)), 80))
    assert any(line.startswith(" rise roll/pitch   max 83 % / 74 ms") for line in lines)


def test_a_shadow_and_a_proof_stand_before_the_matrices():
    shadow = SimpleNamespace(
        verdict="refused",
        runs=("a",),
        faults=(),
        beside=(),
        stability=SimpleNamespace(roots=2, thin=(), not_measured=()),
    )
    desk = replace(DESKS["tried"], designed=replace(GAINS, shadow=shadow))
    lines = plain(gains_words.controller_lines(joined(IDLE, desk), 80))
    at = next(k for k, line in enumerate(lines) if "shadow: REFUSED" in line)
    assert "UNSTABLE: 2 roots" in lines[at + 1]
    assert at < next(k for k, line in enumerate(lines) if "LQR on TPP" in line)


async def test_a_push_says_what_changes_from_old_to_new():
    state = replace(DESIGNED, bank=Bank(PRESENT.crc, None, False))
    state = joined(state, replace(DESKS["tried"], busy=""))
    app, _ = app_on(state)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("8", "p")
        assert isinstance(app.screen, Confirm)
        await settle(app)
        text = "\n".join(screen_text(app))
        assert "gains 123456 -> abcdef" in text
        assert "low -> " in text
        assert "shadow: not run yet" in text
        assert "Y yes" in text


def test_answers_are_drawn_old_under_new_and_a_proof_as_the_papers_figure():
    beside = gains_words.columns(TRIED)
    plot = answers(beside, 1)
    assert plot is not None
    assert plot.words[:2] == ("sliders", "designed")
    assert all(panel.over is not None for panel in plot.panels)
    alone = answers(beside[:1], 0)
    assert alone is not None
    assert alone.words == ("in the vehicle", "asked for", "")
    t = np.arange(0.0, 2.0, 0.01)
    both = np.column_stack([np.sin(t), 0.1 * np.cos(t)])
    run: Any = SimpleNamespace(
        id="a#1", axis=1, t=t, asked=both, measured=both, predicted=0.9 * both, nrmse_percent=(90.0, 80.0)
    )
    proof: Any = SimpleNamespace(proof=SimpleNamespace(runs=(run,)))
    drawn = flown(proof, 3)
    assert [panel.name for panel in drawn.panels] == ["asked", "q", "p"]
    assert np.array_equal(drawn.panels[1].line, both[:, 1])
