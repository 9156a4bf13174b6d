"""A rotor speed that is held, for flights at one speed after the other."""

from __future__ import annotations

import math

import pytest

from sitl.plants import make_plant
from sitl.plants.conditions import CONDITIONS, named_condition


@pytest.mark.parametrize("rpm", [1500.0, 1650.0])
def test_the_governor_holds_the_speed_that_is_asked_for(rpm: float) -> None:
    plant = make_plant("hover-ideal", 3, condition=named_condition("calm", rpm))
    for _ in range(1000):
        plant.step(0.0, 0.0, 0.0, 0.2)
    assert plant.omega * 60 / (2 * math.pi) == pytest.approx(rpm, rel=0.01)


def test_without_a_speed_it_is_the_condition_itself() -> None:
    assert named_condition("rpm") is CONDITIONS["rpm"]


@pytest.mark.parametrize("rpm", [0.0, 1000.0, 1e9, math.nan])
def test_a_speed_that_carries_nothing_is_refused(rpm: float) -> None:
    with pytest.raises(ValueError, match="turns at 1450 to 1750 RPM"):
        named_condition("calm", rpm)
