"""How much of a rate command goes to the other axis, and why; a prefilter that leaves it alone, as time tells."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from loops_in_time import LATE_BY, Late, Law, doublet, model_of, random_vehicles
from planted import TABLE_4

from sysid.control.decoupling import SPEEDS, decoupled
from sysid.control.judgement import Limits, judge
from sysid.control.loop import following
from sysid.control.prefilter import DynamicPrefilter
from sysid.control.regulator import DesignError, Gains, design, lqr
from sysid.control.stability import closed_loop
from sysid.model.paper import TPP
from sysid.model.structure import Model

PAPER = Model(TPP, TPP.vector(TABLE_4))
VEHICLES = len(LATE_BY)


def answers(gains: Gains, vehicle: Late) -> tuple[float, float]:
    """Largest overshoot and coupling of a doublet on either axis, by a simulation in time."""
    law = Law(gains.prefilter)
    if gains.dynamic is not None:
        law = Law(gains.prefilter, gains.dynamic.F, gains.dynamic.frequency, float(gains.dynamic.damping[0]))
    rates = [doublet(vehicle, gains.K, gains.observer_gain, law, axis) for axis in (0, 1)]
    return (
        max(float(np.max(np.abs(one[:, axis]))) - 1 for axis, one in enumerate(rates)),
        max(float(np.max(np.abs(one[:, 1 - axis]))) for axis, one in enumerate(rates)),
    )


def test_the_paper_s_prefilter_couples_without_any_error_of_model_or_observer() -> None:
    """On its own model the observer knows every state: what goes to the other axis is the closed loop's own."""
    gains = design(PAPER)
    over, other = answers(gains, Late(dict(TABLE_4)))
    assert (over, other) == pytest.approx((0.30, 0.41), abs=0.01)
    faster = lqr(PAPER, observer_poles=(-500.0, -500.0, -510.0, -510.0))
    assert answers(faster, Late(dict(TABLE_4))) == pytest.approx((over, other), abs=0.01)
    assert answers(gains, Late(dict(TABLE_4), {"T_d": 0.02}, ("transport_delay",)))[1] == pytest.approx(0.78, abs=0.02)


def test_models_that_are_followed_leave_the_other_axis_alone() -> None:
    gains = design(PAPER)
    found = decoupled(gains, [PAPER])
    over, other = answers(found, Late(dict(TABLE_4)))
    assert other < 0.01
    assert over < 0.035
    slower, faster = following(gains, PAPER), following(found, PAPER)
    assert faster.roll.rise_s is not None
    assert slower.roll.rise_s is not None
    assert faster.roll.rise_s < slower.roll.rise_s
    assert judge(gains, [("fit", PAPER)]).verdict == "poor"
    assert judge(found, [("fit", PAPER)]).verdict == "holds"


def test_margins_and_what_is_asked_in_the_long_run_stay() -> None:
    gains = design(PAPER)
    found = decoupled(gains, [PAPER])
    assert found.dynamic is not None
    assert closed_loop(found, PAPER).margins == gains.loop.margins
    for name in ("K", "observer_gain", "prefilter"):
        assert np.array_equal(getattr(found, name), getattr(gains, name))
    assert np.abs(found.dynamic.at(np.array([1e-7j]))).max() < 1e-6
    nothing = DynamicPrefilter(frequency=np.ones(2), damping=np.ones(2), F=np.zeros((2, 4)))
    bare = following(gains, PAPER)
    assert following(replace(gains, dynamic=nothing), PAPER).pitch.p == pytest.approx(bare.pitch.p, abs=1e-12)


def test_the_answer_predicted_is_what_time_shows() -> None:
    vehicle = Late(dict(TABLE_4), {"T_d": 0.01, "tau_s": 0.02}, ("transport_delay", "servo_lag"), 10.0)
    model = model_of(vehicle)
    found = decoupled(design(model, 10.0), [model])
    promised = following(found, model)
    over, other = answers(found, vehicle)
    assert max(promised.roll.overshoot, promised.pitch.overshoot) == pytest.approx(max(over, 0.0), abs=0.005)
    assert max(promised.roll.coupling, promised.pitch.coupling) == pytest.approx(other, abs=0.005)


@pytest.mark.thorough
def test_vehicles_late_in_every_way_couple_a_fraction_of_it() -> None:
    """Table 4's with other numbers, late by up to 60 ms: each halves at least, but where little is left anyway."""
    before, after = [], []
    for vehicle in islice(random_vehicles(71), VEHICLES):
        model = model_of(vehicle)
        gains = lqr(model, 20.0)
        if gains.loop.margins is None:
            continue
        found = decoupled(gains, [model])
        before.append(answers(gains, vehicle))
        after.append(answers(found, vehicle))
    assert len(after) > 0.8 * VEHICLES
    (over, other), (over_then, other_then) = np.array(before).T, np.array(after).T
    assert np.all((other_then < 0.5 * other) | (other_then < 0.1)), (other, other_then)
    assert np.median(other) > 0.6
    assert np.median(other_then) < 0.2
    assert np.all(over_then < np.maximum(over, 0.05))


def test_it_is_slower_where_faster_would_couple_too_much() -> None:
    model = model_of(Late(dict(TABLE_4), {"T_d": 0.03}, ("transport_delay",)))
    gains = design(model, 20.0)
    loose, strict = (decoupled(gains, [model], Limits(coupling=most)) for most in (0.9, 0.10))
    assert loose.dynamic is not None
    assert strict.dynamic is not None
    assert strict.dynamic.frequency[0] < loose.dynamic.frequency[0]
    answer = following(strict, model)
    assert max(answer.roll.coupling, answer.pitch.coupling) <= 0.10
    least = decoupled(gains, [model], Limits(coupling=1e-6))
    assert least.dynamic is not None
    assert least.dynamic.frequency[0] >= SPEEDS[-1] * loose.dynamic.frequency[0] - 1e-9


def test_one_prefilter_serves_every_model_that_is_left_open() -> None:
    late = model_of(Late(dict(TABLE_4), {"T_d": 0.03}, ("transport_delay",)))
    gains = design(late, 20.0)
    alone, both = decoupled(gains, [PAPER]), decoupled(gains, [PAPER, late])

    def worst(one: Gains) -> float:
        return max(axis.coupling for m in (PAPER, late) for axis in (following(one, m).roll, following(one, m).pitch))

    assert worst(both) < worst(alone)


def test_gains_that_hold_nothing_get_no_prefilter() -> None:
    model = model_of(Late(dict(TABLE_4), {"T_d": 0.2}, ("transport_delay",)))
    with pytest.raises(DesignError, match="hold none"):
        decoupled(design(PAPER), [model])
