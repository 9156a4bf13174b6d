"""A vehicle that is the printed model gives the printed tables back, and what is said of a difference is true."""

from __future__ import annotations

import pytest

from gcs.cards.maneuver import load_card
from gcs.paper import forward as forward_chapter
from gcs.paper import hover as hover_chapter
from gcs.paper.forward import TRUE_M_Q, ForwardFlight
from gcs.paper.hover import HoverFlight
from gcs.paper.rows import BACK, largest_change
from gcs.paper.values import PaperTable, Row


def row(table: PaperTable, name: str) -> Row:
    (found,) = (one for one in table.rows if one.name == name)
    return found


def test_table_1_is_the_bundled_card_s() -> None:
    for one in hover_chapter.chirp_table(load_card("hover")).rows:
        assert one.ours == pytest.approx(one.printed, rel=1e-3), one.name


def test_table_2_comes_back_from_table_4_s_vehicle(hover: HoverFlight) -> None:
    table = hover_chapter.modes_table(hover, hover)
    for name in ("TPP 1-2 frequency, Hz", "TPP 1-2 damping ratio", "TPP 3-4 frequency, Hz", "TPP 3-4 damping ratio"):
        assert row(table, name).ours == pytest.approx(row(table, name).printed, rel=0.02), name
    assert row(table, "CD 1-2 frequency, Hz").printed == 1.54


def test_table_3_puts_the_printed_models_on_the_same_runs(hover: HoverFlight) -> None:
    table = hover_chapter.nrmse_table(hover, hover)
    one = row(table, "chirps, TPP q")
    assert one.printed == 77.3
    assert one.ours is not None
    assert one.ours > 95
    assert one.beside["printed model, our runs"] == pytest.approx(one.ours, abs=0.1), "the printed TPP flew"
    cd = row(table, "chirps, CD q")
    theirs = cd.beside["printed model, our runs"]
    assert cd.ours is not None
    assert theirs is not None
    assert theirs < cd.ours < one.ours


def test_table_4_comes_back_and_says_so(hover: HoverFlight) -> None:
    table = hover_chapter.parameter_table(hover, hover)
    for name in ("L_b", "M_a", "tau_f", "A_b", "B_a", "A_lat", "A_lon", "B_lat", "B_lon"):
        one = row(table, f"TPP {name}")
        assert one.ours is not None
        assert one.printed is not None
        assert one.error
        assert abs(one.ours - one.printed) < BACK * one.error
    assert "the nine numbers come back" in table.why[0]


def test_figures_show_every_rate_measured_and_by_both_models(hover: HoverFlight) -> None:
    figures = hover_chapter.hover_figures(hover)
    assert [one.label for one in figures] == ["Figure 4", "Figure 6", "Figure 7"]
    command, p, q = figures[0].panels
    assert [line.label for line in command.lines] == ["delta_x", "delta_y"]
    for panel in (p, q):
        assert [line.label for line in panel.lines] == ["measured", "TPP", "CD"]
        assert all(len(line.x) == len(line.y) and line.x == tuple(sorted(line.x)) for line in panel.lines)
        measured, tpp, cd = (line.y for line in panel.lines)
        off = [sum((a - b) ** 2 for a, b in zip(measured, model, strict=True)) for model in (tpp, cd)]
        assert off[0] < off[1]


def test_two_sets_of_one_vehicle_differ_by_their_noise(hover: HoverFlight, other_hover: HoverFlight) -> None:
    table = hover_chapter.two_sets_table(hover, other_hover)
    assert [one.printed for one in table.rows] == [7.7, 0.9, 1.8]
    assert all(one.ours is not None and 0 < one.ours < 20 for one in table.rows)
    same = hover_chapter.two_sets_table(hover, hover)
    assert [one.ours for one in same.rows] == pytest.approx([0, 0, 0], abs=1e-9)


def test_table_5_comes_back_with_two_values_held(forward: ForwardFlight) -> None:
    table = forward_chapter.parameter_table(forward)
    assert row(table, "TPP L_b").error is None, "held"
    m_q = row(table, "TPP M_q")
    assert m_q.ours is not None
    assert m_q.error
    assert abs(m_q.ours - 4.691) < BACK * m_q.error
    assert "come back" in table.why[0]


def test_table_6_has_both_halves(forward: ForwardFlight) -> None:
    table = forward_chapter.nrmse_table(forward)
    assert [one.printed for one in table.rows] == [66.0, 54.7, 70.8, 21.7, 49.7, 47.1, 53.1, 17.0]
    for word in ("fitted", "validation"):
        tpp, cd = (row(table, f"{word}, {label} q").ours for label in ("TPP", "CD"))
        assert tpp is not None
        assert cd is not None
        assert tpp > cd


def test_a_lag_that_nobody_models_turns_the_sign_of_m_q(forward: ForwardFlight) -> None:
    found = [one.ours for one in forward_chapter.lag_table(forward).rows]
    assert found[0] == pytest.approx(TRUE_M_Q, abs=1e-3)
    assert found[2] is not None
    assert found[2] > 0


def test_the_largest_change_is_of_the_first() -> None:
    assert largest_change({"a": 2.0, "b": -4.0, "zero": 0.0}, {"a": 2.2, "b": -3.0, "zero": 9.0}) == ("b", 25.0)
