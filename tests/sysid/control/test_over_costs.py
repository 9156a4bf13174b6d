"""K over input cost: the paper's section 5, on its own model and on one that is late."""

from __future__ import annotations

import control
import numpy as np
import pytest
from planted import TABLE_4

from sysid.control.over_costs import over_costs
from sysid.control.regulator import DesignError, design
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

PAPER = Model(TPP, TPP.vector(TABLE_4))
LATE = compose("tpp", ["transport_delay"], TPP.inputs)


@pytest.mark.thorough
def test_each_k_is_control_s_lqr_and_margins_are_the_least_of_all_models() -> None:
    late = Model(LATE, LATE.vector({**TABLE_4, "T_d": 0.030}))
    found = over_costs([("fit", PAPER), ("missing", late)], asked=7.0)
    costs = [one.gains.input_cost for one in found]
    assert costs == sorted(costs)
    assert 7.0 in costs
    A, B, _, _ = (np.asarray(x, dtype=float) for x in PAPER.matrices)
    for one in found:
        K, _, _ = control.lqr(A, B[:, :2], np.diag([1, 1, 1e-3, 1e-3]), one.gains.input_cost * np.eye(2))
        assert pytest.approx(K, rel=1e-6, abs=1e-9) == one.gains.K
        alone, behind = (model.loop.margins for model in one.judgement.models)
        assert alone is not None
        if behind is None:
            assert one.least is None
        else:
            assert one.least is not None
            assert one.least.delay_s == pytest.approx(alone.delay_s - 0.030, abs=1e-4) or one.least.delay_s == np.inf
    assert found[0].least is None, "an input cost of 1 bears 26 ms, and there are 30"
    assert np.all(np.diff([one.rate_gain for one in found]) < 0)


def test_a_flapping_cost_is_control_s_too_and_stands_with_the_gains() -> None:
    A, B, _, _ = (np.asarray(x, dtype=float) for x in PAPER.matrices)
    K, _, _ = control.lqr(A, B[:, :2], np.diag([1, 1, 2.0, 2.0]), 5.0 * np.eye(2))
    gains = design(PAPER, flapping_cost=2.0)
    assert pytest.approx(K, rel=1e-6, abs=1e-9) == gains.K
    assert gains.to_json()["weights"] == {"rates": 1.0, "flapping": 2.0, "inputs": 5.0}
    with pytest.raises(DesignError, match="flapping cost must be a number"):
        design(PAPER, flapping_cost=-1.0)
