"""Slow gusts, louder in the lowest part of a window than all of it says, and known by few draws, are no alarm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from more_of_a_kind import thorough
from strangers.asking import ask
from strangers.flights import fly

from sysid.diagnose.steep import Steep

COUNT = 400


def known_by(values: float, power: float = 1.0) -> Steep:
    """The first half of rows in one cell of so many values, the rest in one of very many."""
    cell = np.repeat([0, 1], COUNT // 2)
    loud = np.where(cell == 0, power, 1.0)
    return Steep(loud, cell.astype(np.intp), np.array([values, 1e9]))


def test_what_shows_where_noise_is_known_by_few_values_is_less_sure() -> None:
    low, high = np.zeros((2, COUNT)), np.zeros((2, COUNT))
    low[0, 0] = low[1, 1] = high[0, -1] = high[1, -2] = 3.0
    assert known_by(1e9).surely(40.0, 2, low) == pytest.approx(40.0, rel=1e-3)
    assert known_by(30.0).surely(40.0, 2, high) == pytest.approx(40.0, rel=1e-3)
    # two values beside thirty: F(2, 30) is 20 by a chance of 3e-6
    chance = math.exp(-known_by(30.0).surely(40.0, 2, low) / 2)
    assert chance == pytest.approx((1 + 40.0 / 30) ** -15, rel=1e-6)
    assert np.diag(known_by(30.0, power=4.0).gram(low)) == pytest.approx([36.0, 36.0])
    assert np.diag(known_by(30.0, power=4.0).gram(high)) == pytest.approx([9.0, 9.0])


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [4070850, *thorough([4076336])])
def test_slow_gusts_are_no_drift_of_the_hover(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """By windows alone a drift, which is not there, had chances of 2e-5 and 2e-12."""
    flight = fly(seed)
    assert not flight.hidden.names
    assert ask(flight).first.verdict == "complete"
    monkeypatch.setattr(Steep, "surely", lambda _, chi_squared, degrees, rows: math.inf)
    assert ask(flight).first.verdict != "complete"
