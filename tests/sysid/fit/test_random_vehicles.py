"""The base is fitted without start values: whatever the vehicle, the fit ends where one begun at the truth ends.

20 vehicles here; `make study` takes 1,000.
"""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
import random_vehicles
from random_vehicles import A_HAIR, FACTORS, KINDS, RESIDUAL, above_the_optimum, flown


def test_20_random_vehicles_reach_the_optimum() -> None:
    vehicles = list(islice(flown(5), 20))
    assert {one.kind for one in vehicles} == set(KINDS)
    assert min(one.share for one in vehicles) < RESIDUAL[0] + 0.05
    assert max(one.share for one in vehicles) > RESIDUAL[1] - 0.05
    assert np.ptp([one.truth["M_a"] for one in vehicles]) > 0.8 * (FACTORS[1] - FACTORS[0]) * 713
    above = [above_the_optimum(one) for one in vehicles]
    assert max(above) < A_HAIR, np.argmax(above)


@pytest.mark.thorough
def test_long_runs_at_a_high_rate_reach_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """500 Hz for 32 s: the fit begins on some of the bins only."""
    monkeypatch.setattr(random_vehicles, "EVERY", 1)
    monkeypatch.setattr(random_vehicles, "DURATION_S", 32.0)
    assert max(above_the_optimum(one) for one in islice(flown(8), 6)) < A_HAIR
