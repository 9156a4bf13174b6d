"""Changes over many flights: found, dated and sized where they were planted, and not where nothing was."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from sysid.campaign.changes import changes_of
from sysid.campaign.claims import courses
from sysid.campaign.spread import line
from sysid.campaign.values import Estimate, by_day

BEGIN = 20_000
ORDERS = 2_000
"""Enough for chances of a thousandth."""


def flights(
    chance: np.random.Generator,
    count: int = 40,
    *,
    step: float = 0.0,
    drift: float = 0.0,
    between: float = 1.0,
    error: float = 1.0,
    days: int = 365,
) -> list[Estimate]:
    """A year's flights of one parameter: 100, a step from half the year on, a drift per year, spread between days."""
    when = np.sort(chance.integers(0, days, count))
    day_s = {int(day): chance.normal(0, between) for day in set(when)}
    made = []
    for number, day in enumerate(when):
        own = error * chance.uniform(0.5, 2.0)
        value = 100 + step * (day >= days // 2) + drift * day / 365.25 + day_s[int(day)] + chance.normal(0, own)
        made.append(Estimate(flight=f"{number}", day=BEGIN + int(day), value=value, error=own))
    return made


def test_a_step_is_found_dated_and_sized() -> None:
    inside, sizes = 0, []
    for seed in range(30):
        chance = np.random.default_rng(seed)
        changes = changes_of(by_day(flights(chance, step=5.0)), chance, ORDERS)
        assert changes is not None
        found = changes.step
        assert found.chance < 1e-3
        assert found.since_within is not None
        before, after = found.since_within
        inside += before < BEGIN + 182 <= after
        sizes.append((found.size - 5.0) / found.error)
        assert found.followed_by is not None
        assert found.followed_by[1] >= 0.7 * found.followed_by[0]
    assert inside >= 27
    assert np.std(sizes) < 1.3
    assert abs(np.mean(sizes)) < 0.6, "the best of all dates makes it a little large"


def test_a_drift_is_sized_and_told_from_a_step() -> None:
    kinds = []
    for seed in range(20):
        chance = np.random.default_rng(seed)
        found = changes_of(by_day(flights(chance, count=60, drift=10.0)), chance, ORDERS)
        assert found is not None
        assert found.drift.chance < 1e-3
        assert abs(found.drift.size - 10.0) < 4 * found.drift.error
        kinds.append(found.likelier.kind)
    assert kinds.count("drift") >= 16


def test_chances_are_right_where_nothing_changed() -> None:
    """Whatever the spread is like, and though a day's flights share their chances."""
    chances: dict[str, list[float]] = {"step": [], "drift": []}
    for seed in range(150):
        chance = np.random.default_rng(seed)
        made = [
            Estimate(flight=one.flight, day=one.day, value=100 + (one.value - 100) ** 3, error=one.error)
            for one in flights(chance, days=60, between=2.0)
        ]
        found = changes_of(by_day(made), chance)
        assert found is not None
        chances["step"].append(found.step.chance)
        chances["drift"].append(found.drift.chance)
    for each in chances.values():
        assert 0.02 <= np.mean(np.array(each) < 0.1) <= 0.17
        assert 0.4 < np.mean(each) < 0.6


def test_the_spread_between_days_is_told_from_the_errors_within() -> None:
    found = []
    for seed in range(60):
        days = by_day(flights(np.random.default_rng(seed), count=40, between=2.0, error=1.0))
        found.append(line(np.ones((len(days), 1)), days.value, days.error).between)
    assert np.median(found) == pytest.approx(2.0, rel=0.1)
    alone = by_day(flights(np.random.default_rng(1), count=200, between=0.0))
    assert line(np.ones((len(alone), 1)), alone.value, alone.error).between < 0.5


def test_the_spread_between_flights_of_a_day_is_told_from_both() -> None:
    """Days differ by 2, flights of one day by 1 beyond their errors of 0.5."""
    within, between = [], []
    for seed in range(40):
        chance = np.random.default_rng(seed)
        days = by_day(
            [
                Estimate(
                    flight=f"{day} {n}", day=day, value=float(at + chance.normal(0, np.hypot(1.0, 0.5))), error=0.5
                )
                for day, at in enumerate(chance.normal(100, 2, 20))
                for n in range(3)
            ]
        )
        within.append(days.within)
        between.append(line(np.ones((len(days), 1)), days.value, days.error).between)
    assert np.median(within) == pytest.approx(1.0, rel=0.1)
    assert np.median(between) == pytest.approx(2.0, rel=0.12)


def test_a_campaign_without_changes_claims_nothing_and_with_them_the_right_ones() -> None:
    def campaign(seed: int, planted: Sequence[tuple[str, str]]) -> dict[tuple[str, str], bool]:
        chance = np.random.default_rng(seed)
        made = {
            (vehicle, name): flights(chance, 30, step=8.0 * ((vehicle, name) in planted))
            for vehicle in ("A", "B")
            for name in ("L_b", "M_a", "T_d", "tau_f")
        }
        return {key: one.claimed for key, one in courses(made, chance).items()}

    assert sum(any(campaign(seed, ()).values()) for seed in range(12)) <= 1
    for seed in range(4):
        found = campaign(seed, [("B", "T_d")])
        assert [key for key, claimed in found.items() if claimed] == [("B", "T_d")]


def test_a_far_day_is_told_and_does_not_hide_itself() -> None:
    chance = np.random.default_rng(3)
    made = flights(chance, 30)
    far = made[11]
    made[11] = Estimate(flight=far.flight, day=far.day, value=far.value + 40, error=far.error)
    found = courses({("A", "M_a"): made}, chance)[("A", "M_a")]
    assert [one.flights for one in found.outliers if far.flight in one.flights]
    assert len(found.outliers) <= 1
    assert not found.claimed


@pytest.mark.parametrize("error", [0.0, -1.0, float("nan"), float("inf")])
def test_an_error_that_is_none_is_refused(error: float) -> None:
    with pytest.raises(ValueError, match="positive"):
        by_day([Estimate(flight="1", day=1, value=1.0, error=error)])


def test_few_days_tell_of_no_change() -> None:
    chance = np.random.default_rng(0)
    made = {("A", "M_a"): flights(chance, 4), ("A", "L_b"): flights(chance, 1)}
    found = courses(made, chance)
    assert list(found) == [("A", "M_a")]
    assert found["A", "M_a"].change is None
    assert not found["A", "M_a"].claimed
