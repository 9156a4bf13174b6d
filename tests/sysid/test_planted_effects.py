"""Every effect comes back from data that an independent integrator made with it: closed loop, gusts, sensor noise.

One flight each; `make study` flies many. The closed loop's gusts and the noise are those of `tests/planted.py`.
"""

from __future__ import annotations

import pytest
from planted import FORWARD, PLANTED, fly
from planted_fits import fitted, in_standard_errors


@pytest.mark.parametrize("effect", sorted(PLANTED))
def test_a_planted_effect_comes_back(effect: str) -> None:
    fit = fitted(effect, fly(effect, PLANTED[effect], seed=7, forward=effect in FORWARD))
    off = in_standard_errors(fit, PLANTED[effect])
    assert off
    assert max(map(abs, off.values())) < 4, off
    assert len(fit.lineage) >= 2
    before, after = fit.lineage[-2].nrmse_percent, fit.lineage[-1].nrmse_percent
    assert sum(after.values()) > sum(before.values())
