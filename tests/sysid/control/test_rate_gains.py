"""Better gains near those flown: within the margins asked for, by how much they may move, and when there are none."""

from __future__ import annotations

from dataclasses import replace

import pytest

from sysid.control.rate_gains import MOST, TUNED, Asked, faster
from sysid.control.regulator import DesignError
from sysid.control.sampled import sampled_loop
from sysid.model.compose import compose
from sysid.model.structure import Model
from sysid.rate_loop.settings import AxisLoop

DT = 0.0025
QUAD = AxisLoop(p=0.135, i=0.135, d=0.0036, target_hz=20, derivative_hz=20, angle_p=4.5)


def quad(power: float, tau_m: float = 0.035) -> Model:
    structure = compose("multirotor", ())
    values = {"L_p": -1.5, "M_q": -1.8, "L_lat": power, "M_lon": power, "tau_m": tau_m}
    return Model(structure, structure.vector(values))


@pytest.mark.parametrize("power", [90.0, 250.0, 700.0])
def test_new_gains_have_the_margins_and_stay_near_those_flown(power: float) -> None:
    found = faster((QUAD, QUAD), DT, quad(power), gyro_corner_hz=20.0)
    assert found.asked.met(found.new_loop)
    again = sampled_loop(found.new, DT, quad(power), gyro_corner_hz=20.0)
    assert again.margins == found.new_loop.margins
    for old, new in zip(found.flown, found.new, strict=True):
        for name in TUNED:
            assert 0.1 < getattr(new, name) / getattr(old, name) <= MOST + 1e-9
        assert replace(new, **{name: getattr(old, name) for name in TUNED}) == old, "the rest stays"


def test_weak_gains_become_faster_and_thin_margins_slower() -> None:
    weak = faster((QUAD, QUAD), DT, quad(90.0), gyro_corner_hz=20.0)
    assert min(weak.new_loop.rejection_hz) > 1.15 * min(weak.flown_loop.rejection_hz)
    thin = faster((QUAD, QUAD), DT, quad(700.0), gyro_corner_hz=20.0)
    assert not thin.asked.met(thin.flown_loop)
    assert thin.new[0].p < QUAD.p


def test_a_feed_forward_is_taken_to_what_may_be_written() -> None:
    flown = replace(QUAD, ff=0.1)
    roll, pitch = faster((flown, flown), DT, quad(90.0), feed_forward={0: 0.12, 1: 0.5}).new
    assert roll.ff == 0.12
    assert pitch.ff == pytest.approx(MOST * 0.1)


def test_half_of_the_vehicle_s_delay_is_asked_for() -> None:
    structure = compose("multirotor", ("transport_delay",))
    late = Model(structure, structure.vector({**quad(90.0).by_name, "T_d": 0.04}))
    loop = sampled_loop((QUAD, QUAD), DT, late)
    assert Asked().of(late, loop).delay_ms == pytest.approx(20.0)
    found = faster((QUAD, QUAD), DT, late)
    assert found.new_loop.margins is not None
    assert found.new_loop.margins.delay_ms >= 20.0


def test_without_any_such_gains_the_refusal_says_what_flew() -> None:
    with pytest.raises(DesignError, match=r"no gains between 0\.1 and 1\.3 times") as refusal:
        faster((QUAD, QUAD), DT, quad(90.0), asked=Asked(gain_db=80.0))
    assert "those flown have gain margin" in str(refusal.value)
    with pytest.raises(DesignError, match="do not hold this model"):
        faster((QUAD, QUAD), DT, quad(30_000.0), gyro_corner_hz=20.0)
