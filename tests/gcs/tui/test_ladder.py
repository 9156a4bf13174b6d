"""The Ladder: the error falls, the placebo is marked, spectra stand before and after, at any size."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from fake_app import IDLE, app_on, screen_text, settle
from fake_desk import ADDED, ASKED, COMPLETE, DESKS, OPEN, comparison

from gcs.tui.draw_desk import Look, fallen, residual_scales, run_strips, waterfall
from gcs.tui.ladder_words import next_candidates, status_lines
from gcs.tui.next_step import next_words
from gcs.tui.state import joined

SMALLER = comparison()
SMALLER.traces = tuple(
    type(one)(one.run, one.t, one.measured, 0.3 * one.residual, one.commands) for one in SMALLER.traces
)
PLACED = replace(
    ADDED,
    comparison=SMALLER,
    addition=SimpleNamespace(placebo_rung=("gyro_filter", {"p": 66.0, "q": 72.0}, None), signs=(), checks=()),  # type: ignore[arg-type]
)
DESK = replace(DESKS["added"], ladder=(ASKED, PLACED))


def test_the_error_falls_rung_by_rung_and_the_placebo_is_marked():
    first, second, *pitch = waterfall(DESK, 20).bars
    assert (first.parts, second.label) == ((1.0, 0.0), "p  + servo_lag")
    assert sum(second.parts) == pytest.approx(1.0), "what it left and what it took away"
    assert second.parts[0] < 0.1 < second.beside < 1.0
    assert second.text.startswith("81.0 / 80.3 ↑")
    assert [one.label for one in pitch] == ["q  TPP", "q  + servo_lag"]


@pytest.mark.parametrize(("reached", "proved"), [(66.0, True), (95.0, False)])
def test_a_rung_that_its_placebo_beats_is_not_proved(reached, proved):
    wrong = SimpleNamespace(placebo_rung=("gyro_filter", {"p": reached, "q": reached}, None), signs=())
    lines = status_lines(replace(DESK, ladder=(ASKED, replace(PLACED, addition=wrong))), 78)  # type: ignore[arg-type]
    assert any("✗ its placebo removes as much: not proved" in line for line in lines) is not proved


def test_a_complete_model_whose_rest_could_matter_is_told_so():
    could = replace(COMPLETE, answer=msgspec.structs.replace(COMPLETE.answer, matters=True))
    desk = replace(DESK, ladder=(ASKED, could))
    assert "○ complete, but what may hide could matter: E" in status_lines(desk, 78)[0]
    assert "could matter" in next_words(joined(IDLE, desk), "Ladder")
    assert "could matter" not in next_words(joined(IDLE, replace(desk, ladder=(ASKED, COMPLETE))), "Ladder")


def test_what_is_seen_and_does_not_matter_is_not_called_noise():
    seen = replace(COMPLETE, answer=msgspec.structs.replace(COMPLETE.answer, noise_left=False))
    desk = replace(DESK, ladder=(ASKED, seen))
    assert "✓ complete: what is left and seen does not matter" in status_lines(desk, 78)[0]
    assert " none: what is left does not matter" in next_candidates(desk, 40, 8)


def test_of_many_rungs_the_lowest_and_the_highest_are_shown():
    many = replace(DESK, ladder=(ASKED, *(replace(ADDED, name=f"+ {i}") for i in range(6))))
    assert [one.label for one in waterfall(many, 7).bars] == [
        f"{k}  {name}" for k in "pq" for name in ("TPP", "+ 4", "+ 5")
    ]


def test_spectra_before_and_after_the_last_rung():
    plot = fallen(DESK)
    assert (plot.words, [one.name for one in plot.panels]) == (("TPP", "+ servo_lag", "noise"), ["p", "q"])
    assert fallen(DESKS["compared"]).words == ("TPP", "", "noise")
    assert fallen(DESKS["fitted"]) is None


def test_a_residual_keeps_its_scale_as_it_falls():
    before, after = (run_strips(desk, Look()) for desk in (DESKS["compared"], DESK))
    for panels in zip(before.panels, after.panels, strict=True):
        if panels[0].residual:
            assert panels[0].least == panels[1].least >= np.abs(panels[0].line).max()
    assert residual_scales(DESK) == [0.05, 0.1]


def test_models_are_set_beside_each_other_on_one_scale():
    names = [run_strips(DESK, Look(beside=k)).words[2] for k in range(5)]
    assert names == ["", "TPP", "CD", "", ""], "alone, each other, all, and again"
    both = run_strips(DESK, Look(beside=1))
    residual = next(one for one in both.panels if one.residual)
    np.testing.assert_allclose(residual.reference, residual.line / 0.3)
    panels = [one for one in run_strips(DESK, Look(beside=3, output=0)).panels if one.residual]
    assert [one.name for one in panels] == ["p res", "TPP", "CD"]
    assert len({one.least for one in panels}) == 1


@pytest.mark.parametrize("size", [(80, 24), (120, 40)])
async def test_the_ladder_is_complete_at_any_size(size):
    app, _ = app_on(joined(IDLE, DESK))
    async with app.run_test(size=size) as pilot:
        await pilot.press("7")
        await settle(app)
        text = "\n".join(screen_text(app))
        for words in ("p  TPP", "q  + servo_lag", "residual spectra", "● placebo", "placebo gyro_filter: 66.0 / 72.0"):
            assert words in text
        assert "next candidates" in text
        await pilot.press("p", "escape")


async def test_an_empty_ladder_says_what_to_do():
    app, _ = app_on(joined(IDLE, OPEN))
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("7")
        await settle(app)
        assert "4 fits a flight first" in "\n".join(screen_text(app))
