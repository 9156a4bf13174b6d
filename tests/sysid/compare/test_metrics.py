"""Differences of responses in dB and degrees, against closed forms and against the independent integrator's flights."""

from __future__ import annotations

from functools import cache

import control
import numpy as np
import pytest
from planted import PLANTED, TABLE_4, fly

from sysid.compare.metrics import integrated_cost, mismatch, response_difference
from sysid.data.dataset import prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import Record
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP, reduce_to_cd
from sysid.model.response import slopes, transfer
from sysid.model.structure import Model
from sysid.response.values import widest

FLIGHT = ("p", "q", "delta_x", "delta_y", "excitation_x", "excitation_y", "t")


def table_4(**changed: float) -> Model:
    return Model(TPP, TPP.vector({**TABLE_4, **changed}))


@cache
def flown(effect: str | None) -> tuple[Record, ...]:
    size = PLANTED[effect] if effect is not None else {}
    return tuple(
        Record(f"#{number}", {name: run[name] for name in FLIGHT})
        for number, run in enumerate(fly(effect, size, seed=11))
    )


def test_cost_by_hand() -> None:
    """1 dB everywhere at full coherence is 20 (1.58 (1 - 1/e))^2; 7.57 degrees count the same; 0.6 counts half."""
    at = np.geomspace(0.5, 10, 30)
    one, none = np.ones(30), np.zeros(30)
    assert integrated_cost(at, one, none, one) == pytest.approx(20 * (1.58 * (1 - np.exp(-1))) ** 2)
    assert integrated_cost(at, none, 7.57 * one, one) == pytest.approx(integrated_cost(at, one, none, one), rel=1e-3)
    assert integrated_cost(at, one, none, 0.6 * one) == pytest.approx(10, rel=0.03)
    assert np.isnan(integrated_cost(at[:0], one[:0], one[:0], one[:0]))


def test_the_widest_stretch() -> None:
    def points(text: str) -> list[int]:
        return list(np.flatnonzero(widest(np.array([mark == "x" for mark in text]))))

    assert points("xx......xxxx") == [8, 9, 10, 11]
    assert points("x......xx....x.") == [7, 8, 13], "a dip at a zero does not end the band"
    assert points("xx.........") == points("...") == []


def test_transfer_is_that_of_the_control_library() -> None:
    frequency = np.geomspace(0.2, 14, 25)
    model = table_4()
    theirs = control.ss(*model.matrices)(2j * np.pi * frequency)
    np.testing.assert_allclose(transfer(TPP, model.values, frequency), theirs, rtol=1e-9)


@pytest.mark.parametrize("effects", [(), ("transport_delay", "angular_damping"), ("servo_second_order", "gyro_lag")])
def test_slopes_are_differences(effects: tuple[str, ...]) -> None:
    structure = compose("tpp", effects)
    frequency = np.geomspace(0.2, 14, 12)
    values = np.array([{**TABLE_4}.get(one.name, one.typical) for one in structure.parameters])
    exact = slopes(structure, values, frequency)
    for index in range(values.size):
        step = np.zeros(values.size)
        step[index] = 1e-5 * abs(values[index])
        rough = (transfer(structure, values + step, frequency) - transfer(structure, values - step, frequency)) / (
            2 * step[index]
        )
        np.testing.assert_allclose(exact[index], rough, rtol=1e-5, atol=1e-6 * np.max(np.abs(rough)))


def test_twice_the_control_is_6_dB_and_a_delay_is_phase() -> None:
    twice = table_4(A_lat=2 * TABLE_4["A_lat"], B_lat=2 * TABLE_4["B_lat"])
    for one in response_difference(twice, table_4(), (0.5, 10.0)):
        expected = 20 * np.log10(2) if one.command == "delta_x" else 0.0
        assert one.rms == pytest.approx((expected, 0), abs=1e-9)
        assert one.band_hz == pytest.approx((0.5, 10.0))
    delayed = compose("tpp", ["transport_delay"])
    late = Model(delayed, delayed.vector({**TABLE_4, "T_d": 0.01}))
    for one in response_difference(late, table_4(), (0.5, 10.0)):
        assert one.largest == pytest.approx((0, 36), abs=1e-6)
        assert one.degrees[-1] < 0
    document = one.to_json()
    assert document["largest_deg"] == pytest.approx(36)


def test_tpp_and_its_cd_are_far_apart_where_the_rotor_moves() -> None:
    tpp = table_4()
    found = {(one.output, one.command): one for one in response_difference(tpp, reduce_to_cd(tpp), (0.2, 10.0))}
    assert abs(found["q", "delta_x"].decibels[0]) < 1
    assert found["q", "delta_x"].largest[0] > 6
    uncontrolled = Model(CD, np.array([-2.0, -8.0, 10.0, -5.0, 5.0, 0.0, 67.0, 0.0]))
    assert all(np.isinf(one.largest[0]) for one in response_difference(uncontrolled, tpp) if one.command == "delta_y")
    one = next(one for one in response_difference(uncontrolled, tpp) if one.command == "delta_y")
    assert one.to_json()["largest_db"] is None


def test_the_vehicle_that_flew_fits_its_own_responses() -> None:
    found = mismatch(table_4(), prepared(flown(None), DEFAULT_BAND_HZ).viewed(TPP.inputs))
    assert found.measured.closed_loop_safe
    for one in found.each:
        assert one.band_hz is not None
        assert one.band_hz[0] < 0.6
        assert one.band_hz[1] > 8
        assert one.rms[0] < 0.6
        assert one.rms[1] < 5
        assert one.cost < 10


def test_a_model_with_half_the_control_is_6_dB_low() -> None:
    half = table_4(A_lat=0.5 * TABLE_4["A_lat"], B_lat=0.5 * TABLE_4["B_lat"])
    for one in mismatch(half, prepared(flown(None), DEFAULT_BAND_HZ).viewed(TPP.inputs)).each:
        expected = -20 * np.log10(2) if one.command == "delta_x" else 0
        assert np.median(one.decibels) == pytest.approx(expected, abs=0.3)


def test_a_missing_lag_shows_as_phase_and_costs_more_than_the_guide() -> None:
    found = mismatch(table_4(), prepared(flown("servo_lag"), DEFAULT_BAND_HZ).viewed(TPP.inputs))
    for one in found.each:
        place = int(np.argmin(np.abs(one.frequency_hz - 3.0)))
        lag = np.degrees(np.arctan(2 * np.pi * one.frequency_hz[place] * PLANTED["servo_lag"]["tau_s"]))
        assert one.degrees[place] == pytest.approx(lag, abs=8), "the model leads by the lag that it lacks"
        assert one.cost > 100
