"""In a loop a growing mode answers before it is asked: what that costs, and who is named for it."""

from __future__ import annotations

import numpy as np
import pytest
from strangers.asking import ask
from strangers.flights import fly

from sysid.diagnose import growing_modes
from sysid.diagnose.verdict import Diagnosis

MOTORS_UNLOGGED = 4008535
"""A quadrotor whose motors lag by 79 ms; no excitation is logged, and least squares has it grow by 3.3 1/s."""
RIVALS = ("motor_lag", "attitude_stiffness", "transport_delay")


def asked() -> Diagnosis:
    return ask(fly(MOTORS_UNLOGGED)).first


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [RIVALS], indirect=True)
def test_slow_motors_in_a_loop_are_no_stiffness_that_pushes(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked()
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert found.winner is not None
    assert found.winner.fit is not None
    assert found.winner.fit.model.stable
    assert found.confidence > 0.9
    monkeypatch.setattr(growing_modes, "cost", lambda *_: 0.0)
    monkeypatch.setattr(growing_modes, "cost_slopes", lambda model, _: np.zeros(model.values.size))
    assert asked().verdict == "unexplained"
    monkeypatch.setattr(growing_modes, "SURELY", np.inf)  # nor is any fit looked at again
    found = asked()
    assert found.verdict == "unexplained"
    assert "attitude_stiffness" in found.chain
