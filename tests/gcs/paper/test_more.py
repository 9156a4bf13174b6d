"""Eq. 1's K_c, the rotor speed, the LQR's following: what must come out where it is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.paper import control, rotor
from gcs.paper.coupling import DRAWN_GAIN, K_C, coupled, coupling_figure, coupling_table, growth, stepped
from gcs.paper.hover import HoverFlight
from gcs.paper.rotor import RATIO, scaled
from gcs.paper.rows import PRINTED
from sysid.control.regulator import design


def test_k_c_of_1_cancels_on_cd_and_0_75_diverges_on_tpp() -> None:
    tpp, cd = PRINTED["TPP"], PRINTED["CD"]
    assert coupled(cd, DRAWN_GAIN, 1.0) == pytest.approx(0, abs=1e-12)
    assert all(growth(cd, cd, DRAWN_GAIN, k_c) < 0 for k_c in K_C)
    on_tpp = [growth(tpp, cd, DRAWN_GAIN, k_c) for k_c in K_C]
    assert on_tpp[1] < -3
    assert -1 < on_tpp[2] < 0, "0.5 is barely stable"
    assert on_tpp[3] > 3
    assert growth(tpp, cd, 3.0, 0.5) > 0, "for gains up to about 2 1/s"


def test_k_c_in_time_says_the_same() -> None:
    tpp, cd = PRINTED["TPP"], PRINTED["CD"]
    _, cancelled = stepped(cd, cd, DRAWN_GAIN, 1.0)
    _, bare = stepped(cd, cd, DRAWN_GAIN, 0.0)
    assert np.max(np.abs(cancelled[:, 1])) < 1e-9 < np.max(np.abs(bare[:, 1]))
    ends = [float(np.max(np.abs(stepped(tpp, cd, DRAWN_GAIN, k_c)[1][-50:, 1]))) for k_c in (0.5, 0.75)]
    assert ends[0] < 1 < ends[1]
    assert [len(one.lines) for one in coupling_figure().panels] == [len(K_C), len(K_C)]


def test_the_table_says_what_its_rows_show() -> None:
    table = coupling_table(PRINTED["TPP"], PRINTED["CD"])
    assert "K_c = 0.5 is the most that flies" in table.why[1]
    assert "K_c = 1 is stable" in table.why[2], "with the numbers of the TPP's own reduction"


def test_scaling_by_theory_is_undone_by_the_inverse_speed() -> None:
    model = PRINTED["TPP"]
    faster = scaled(model, RATIO)
    assert faster["tau_f"] == pytest.approx(0.091 / 1.1)
    assert faster["A_b"] == pytest.approx(-1.338 / 1.21)
    assert faster["M_a"] == model["M_a"]
    np.testing.assert_allclose(scaled(faster, 1 / RATIO).values, model.values)


def test_two_rotor_speeds_of_one_vehicle(hover: HoverFlight, other_hover: HoverFlight) -> None:
    def at(flight: HoverFlight, rpm: float) -> HoverFlight:
        omega = np.full(flight.records[0].t.size, rpm * 2 * np.pi / 60)
        return HoverFlight([replace(one, channels={**one.channels, "omega": omega}) for one in flight.records])

    changes, law = rotor.rotor_tables(at(hover, 1500), at(other_hover, 1650), {"k": 0.0, "n": 0.0})
    assert [one.printed for one in changes.rows] == [185.0, 4.0, 28.0, 72.4, 67.1]
    k, n = law.rows
    for one in (k, n):  # both flights are of the same numbers, whatever the rotor's speed
        assert one.ours is not None
        assert one.error
        assert abs(one.ours) < 4 * one.error


def test_how_a_rate_followed_is_measured() -> None:
    t = np.arange(0.0, 6.0, 0.01)
    pulse = 0.3 * np.sign(np.sin(2 * np.pi * 0.5 * t))
    late = np.interp(t - 0.05, t, pulse)
    run = {"t": t, "pulse": pulse, "pDes": pulse, "p": late, "qDes": 0 * t, "q": 0.1 * late}
    (row,) = control.following_table([("roll", run)], design(PRINTED["TPP"])).rows
    assert row.beside["lag, ms"] == pytest.approx(50, abs=11)
    assert row.beside["steady, %"] == pytest.approx(100, abs=1)
    assert row.beside["other axis, %"] == pytest.approx(10, abs=0.5)
    figure = control.following_figure([("roll", run)])
    assert [line.label for line in figure.panels[0].lines] == ["commanded", "measured"]
