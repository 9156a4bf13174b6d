"""A candidate's value at a bound of what its effect may be is told with an error, as if it might move on."""

from __future__ import annotations

import math

import pytest
from planted import PLANTED, fly
from planted_fits import records

from sysid.diagnose.candidates import Ranked
from sysid.diagnose.diagnose import diagnose
from sysid.model.compose import compose

EXCITATION = ("excitation_x", "excitation_y", "excitation_e")


def at_bounds(one: Ranked) -> set[str]:
    asked = None if one.fit is None else one.fit.asked
    return set() if asked is None else {*asked.estimate.at_bound} & {*one.names} - {*asked.held}


@pytest.mark.parametrize("without", [(), EXCITATION], ids=["excitation logged", "in a loop"])
def test_values_at_bounds_have_errors(without: tuple[str, ...]) -> None:
    """A lag of the servos resembles many entries, at sizes that end where these do."""
    flight = records(fly("servo_lag", PLANTED["servo_lag"], seed=3, duration_s=8.0, gusts=0.05), *without)
    bounded = [one for one in diagnose(compose("tpp"), flight, chains=False).candidates if at_bounds(one)]
    assert bounded, "else nothing is asked here"
    for one in bounded:
        assert one.fit is not None
        told = one.to_json()["standard_errors"]
        for name in at_bounds(one) & {*told}:
            assert one.fit.asked.standard_errors[name] == 0.0, "by the fit itself"
            assert 0 < told[name] < math.inf
    assert any(at_bounds(one) & {*one.standard_errors} for one in bounded)
