"""Every effect comes back from data that an independent integrator made with it: closed loop, gusts, sensor noise.

One flight each; `make study` flies many. The closed loop's gusts and the noise are those of `tests/planted.py`.
"""

from __future__ import annotations

import pytest
from planted import FORWARD, PLANTED, TABLE_4, fly
from planted_fits import READ_FROM_THE_BASE, fitted, in_standard_errors, records
from strangers.asking import records as logged
from strangers.flights import fly as fly_strange
from study_findings import FIRST_SEED, Setting, flown

from sysid.fit.identify import identify
from sysid.model.compose import compose

SECONDS = 15.0
OF_EACH_KIND = {
    *("second_order_flapping", "hub_gyroscopics", "angle_of_attack"),
    *("servo_lag", "servo_backlash", "transport_delay", "gyro_lag"),
}


@pytest.mark.parametrize(
    "effect",
    [
        pytest.param(effect, marks=() if effect in OF_EACH_KIND else pytest.mark.thorough, id=effect)
        for effect in sorted(PLANTED.keys() - READ_FROM_THE_BASE)
    ],
)
def test_a_planted_effect_comes_back(effect: str) -> None:
    fit = fitted(effect, fly(effect, PLANTED[effect], seed=7, duration_s=SECONDS, forward=effect in FORWARD))
    off = in_standard_errors(fit, PLANTED[effect])
    assert off
    assert max(map(abs, off.values())) < 4, off
    assert len(fit.lineage) >= 2
    before, after = fit.lineage[-2].nrmse_percent, fit.lineage[-1].nrmse_percent
    assert sum(after.values()) > sum(before.values())


@pytest.mark.parametrize("width", [0.0083, pytest.param(0.0184, marks=pytest.mark.thorough)])
def test_a_dead_band_is_found_between_the_points_of_its_grid(width: float) -> None:
    fit = fitted("servo_deadband", fly("servo_deadband", {"width": width}, seed=7, duration_s=SECONDS))
    assert fit.model["width"] == pytest.approx(width, rel=2e-3)


def test_a_dead_band_is_found_whose_cleft_is_half_a_hundredth_of_its_width() -> None:
    """Two hundredths from point to point passed it over, and play was named for it."""
    runs = logged(flown(Setting(seconds=12.0), FIRST_SEED + 1, "servo_deadband", {"width": 0.03}))
    fit = identify(compose("tpp"), runs, effects=["servo_deadband"])
    assert fit.model["width"] == pytest.approx(0.03, rel=1e-3)


def test_a_dead_band_is_found_in_a_log_that_has_every_second_sample_of_its_loop() -> None:
    """Some jumps fall elsewhere there than they did: the busiest segment of each command did not show the cleft, and a
    width of 0.019 was found beside gyros that lag."""
    strange = fly_strange(4024348)
    fit = identify(compose("tpp"), logged(strange)[: strange.plan.fitted], effects=["gyro_lag", "servo_deadband"])
    assert strange.hidden.sizes[0]["width"] == pytest.approx(0.02632, rel=1e-3)
    assert fit.model["width"] == pytest.approx(strange.hidden.sizes[0]["width"], rel=0.01)


def test_what_is_held_is_held_while_the_rest_is_fitted() -> None:
    """A new parameter at a value of the user's: the others come to their best beside it."""
    runs = records(fly("servo_backlash", PLANTED["servo_backlash"], seed=7, duration_s=SECONDS))
    held = {"half_width": 0.012}
    fit = identify(compose("tpp"), runs, effects=["servo_backlash"], fixed=held)
    off = in_standard_errors(fit, TABLE_4)
    assert fit.model["half_width"] == 0.012
    assert max(map(abs, off.values())) < 4, off
