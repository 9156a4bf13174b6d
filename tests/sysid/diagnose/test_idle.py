"""What acts on commands and ended where it moves none of them is no answer, and no half of one."""

from __future__ import annotations

import math

import pytest
from strangers.asking import ask
from strangers.flights import fly

LATE_GYROS = 4011684
"""A vehicle whose gyros lag by 9.6 ms; every fifth sample is logged, and nobody tells of the loop."""


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "servo_acceleration_limit")], indirect=True)
def test_a_limit_that_is_never_reached_is_no_half_of_a_chain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside it the lag was fitted elsewhere, and seemed likelier: accelerations of 1e17 were named beside it. (In its
    rough air no chain is looked for any more; here it is taken for steady.)"""
    monkeypatch.setattr("sysid.fit.bursts.ROUGH", math.inf)
    found = ask(fly(LATE_GYROS)).first
    assert (found.verdict, found.chain) == ("missing", ("gyro_lag",))
    assert found.pairs == ()
    monkeypatch.setattr("sysid.diagnose.refits.idle", lambda *_: False)
    (pair,) = ask(fly(LATE_GYROS)).first.pairs
    assert pair.fit is not None
    assert pair.fit.model["acceleration"] > 1e9
