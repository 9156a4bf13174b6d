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
RIVALS = ("motor_lag", "transport_delay")


def asked() -> Diagnosis:
    return ask(fly(MOTORS_UNLOGGED)).first


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [RIVALS], indirect=True)
def test_slow_motors_in_a_loop_are_told_from_what_feedback_makes(monkeypatch: pytest.MonkeyPatch) -> None:
    found = asked()
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert found.winner is not None
    assert found.winner.fit is not None
    assert found.winner.fit.model.stable
    assert found.confidence > 0.89  # the most where no excitation is logged, but for leads that leave no doubt
    parent, named = found.parent, found.winner.fit.estimate
    assert not parent.model.stable
    assert growing_modes.cost(parent.estimate, found.whitening) == 0  # whatever it lacks is not known
    structure = named.model.structure
    grows = named.model.values.copy()
    grows[[structure.names.index(name) for name in ("L_p", "L_q", "M_p", "M_q")]] = 3.0, 0.0, 0.0, -1.0
    flown_s = sum(one.samples * one.dt for one in parent.dataset.spectra)
    most = np.linalg.eigvals(structure.matrices(grows).A).real.max()
    assert growing_modes.cost(named, found.whitening, grows) == pytest.approx(2 * flown_s * most, rel=0.05)
    monkeypatch.setattr(growing_modes, "cost", lambda *_: 0.0)
    monkeypatch.setattr(growing_modes, "cost_slopes", lambda one, _, names: np.zeros(len(names)))
    monkeypatch.setattr(growing_modes, "misled", lambda *_: False)  # nor is any fit looked at again
    found = asked()
    assert found.winner is not None
    assert found.winner.fit is not None
    assert not found.winner.fit.model.stable
    assert found.confidence <= 0.5  # a feedback's doing, as likely as not
