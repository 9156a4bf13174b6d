"""Better gains near those flown: within the margins asked for, by how much they may move, and when there are none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helicopter_loops import PITCH, ROLL, heli

from sysid.control.bounds import drawn
from sysid.control.judgement import Limits, judge
from sysid.control.rate_gains import MOST, TUNED, faster, share
from sysid.control.regulator import DesignError
from sysid.control.sampled import RateController, sampled_loop
from sysid.model.compose import compose
from sysid.model.structure import Model
from sysid.rate_loop.settings import AxisLoop

DT = 0.0025
QUAD = AxisLoop(p=0.135, i=0.135, d=0.0036, target_hz=20, derivative_hz=20, angle_p=4.5)


def quad(power: float, tau_m: float = 0.035) -> Model:
    structure = compose("multirotor", ())
    values = {"L_p": -1.5, "M_q": -1.8, "L_lat": power, "M_lon": power, "tau_m": tau_m}
    return Model(structure, structure.vector(values))


def flying(loop: AxisLoop = QUAD, gyro_hz: float = 20.0) -> RateController:
    return RateController((loop, loop), DT, gyro_hz)


def late(power: float, seconds: float) -> Model:
    structure = compose("multirotor", ("transport_delay",))
    return Model(structure, structure.vector({**quad(power).by_name, "T_d": seconds}))


@pytest.mark.parametrize("power", [90.0, 250.0, 700.0])
def test_new_gains_have_the_margins_and_stay_near_those_flown(power: float) -> None:
    found = faster(flying(), [quad(power)])
    assert share(found.asked, found.new_loop) >= 1
    again = sampled_loop(found.new.loops, DT, quad(power), gyro_corner_hz=20.0)
    assert again.margins == found.new_loop.margins
    assert judge(found.new, [("fit", quad(power))]).verdict != "fails"
    for old, new in zip(found.flown.loops, found.new.loops, strict=True):
        for name in TUNED:
            assert 0.1 < getattr(new, name) / getattr(old, name) <= MOST + 1e-9
        assert new.i / old.i >= new.p / old.p * (1 - 1e-9), "a steady disturbance is taken up as fast"
        assert replace(new, **{name: getattr(old, name) for name in TUNED}) == old, "the rest stays"


def test_weak_gains_become_faster_and_thin_margins_slower() -> None:
    weak = faster(flying(), [quad(90.0)])
    assert min(weak.new_loop.rejection_hz) > 1.15 * min(weak.flown_loop.rejection_hz)
    thin = faster(flying(), [quad(700.0)])
    assert share(thin.asked, thin.flown_loop) < 1
    assert thin.new.loops[0].p < QUAD.p


def test_a_feed_forward_is_taken_to_what_may_be_written() -> None:
    flown = flying(replace(QUAD, ff=0.1), 0.0)
    roll, pitch = faster(flown, [quad(90.0)], feed_forward={0: 0.12, 1: 0.5}).new.loops
    assert roll.ff == 0.12
    assert pitch.ff == pytest.approx(MOST * 0.1)


def test_half_of_the_vehicle_s_delay_is_asked_for() -> None:
    found = faster(flying(gyro_hz=0.0), [late(90.0, 0.04)])
    assert found.asked.delay_ms == pytest.approx(20.0)
    assert found.new_loop.margins is not None
    assert found.new_loop.margins.delay_ms >= 20.0


@pytest.mark.thorough
def test_gains_hold_what_is_left_open_and_those_of_the_bare_fit_do_not() -> None:
    """A vehicle that may be 30 ms late: the fit alone lets through what fails on that."""
    open_ = [quad(250.0), late(250.0, 0.030)]
    models = list(zip(("fit", "missing"), open_, strict=True))
    bare = faster(flying(), open_[:1])
    assert judge(bare.new, models).verdict == "fails"  # type: ignore[arg-type]
    both = faster(flying(), open_)
    assert judge(both.new, models).verdict != "fails"  # type: ignore[arg-type]
    assert min(both.new_loop.rejection_hz) < min(bare.new_loop.rejection_hz)


def test_gains_have_what_is_asked_over_the_fit_s_bounds() -> None:
    vehicle = quad(250.0)
    draws = drawn(vehicle, np.diag((0.15 * vehicle.values) ** 2), np.random.default_rng(2), 60)
    bare = faster(flying(), [vehicle])
    assert judge(bare.new, [("fit", vehicle)], draws=draws).verdict == "fails"
    found = faster(flying(), [vehicle], draws=draws)
    assert judge(found.new, [("fit", vehicle)], draws=draws).verdict != "fails"


@pytest.mark.thorough
def test_steps_overshoot_no_more_than_with_what_was_flown() -> None:
    """A helicopter that overshoots by 59 % as it flew: higher gains would by more, and there is nothing to gain."""
    flown = RateController((ROLL, PITCH), DT, 20.0)
    found = faster(flown, [heli()])
    loose = faster(flown, [heli()], limits=Limits(overshoot=9.0, coupling=9.0))
    assert max(one.overshoot for one in loose.new.answers(heli())) > max(one.overshoot for one in flown.answers(heli()))
    for old, new in zip(flown.answers(heli()), found.new.answers(heli()), strict=True):
        assert new.overshoot <= max(Limits().overshoot, old.overshoot) + 1e-9
        assert new.coupling <= max(Limits().coupling, old.coupling) + 1e-9
    assert sum(loose.new_loop.rejection_hz) > sum(found.new_loop.rejection_hz) >= sum(found.flown_loop.rejection_hz)


def test_a_model_that_no_command_turns_is_refused() -> None:
    still = Model(quad(90.0).structure, quad(90.0).structure.vector({**quad(90.0).by_name, "M_lon": 0.0}))
    with pytest.raises(DesignError, match="no command turns the pitch axis"):
        faster(flying(), [quad(90.0), still])


def test_an_unstable_vehicle_that_its_gains_hold_is_designed_for() -> None:
    loose = Model(quad(90.0).structure, quad(90.0).structure.vector({**quad(90.0).by_name, "L_p": 0.8}))
    found = faster(flying(), [loose])
    assert share(found.asked, found.new_loop) >= 1
    assert found.new.unstable_poles(loose) == 1


@pytest.mark.thorough
def test_without_any_such_gains_the_refusal_says_what_flew() -> None:
    with pytest.raises(DesignError, match=r"no gains between 0\.1 and 1\.3 times") as refusal:
        faster(flying(gyro_hz=0.0), [quad(90.0)], limits=Limits(gain_db=80.0))
    assert "those flown have gain margin" in str(refusal.value)
    with pytest.raises(DesignError, match="do not hold this model"):
        faster(flying(), [quad(30_000.0)])
    with pytest.raises(DesignError, match=r"on MULTI.* transport_delay: "):
        faster(flying(), [quad(250.0), late(250.0, 0.5)])
