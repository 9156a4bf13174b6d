"""Play and limits in a loop whose excitation is not logged: least squares by power gives them another size, and what
foretells best the one that is there."""

from __future__ import annotations

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import evidence, refits
from sysid.diagnose.verdict import Diagnosis

LIMIT, RATE, BESIDE = 4051453, 4049718, 4044988
"""Training strangers of other code: a limit alone, one of rates beside a hub, one beside a drift."""
CUBIC = 4089097
"""A judged one's: a damping that grows with the cube of the rates, 8 times what is detectable."""


def size_told(found: Diagnosis, effect: str) -> tuple[float, float]:
    """And its standard error."""
    one = next(one for one in found.candidates if one.effect == effect)
    assert one.fit is not None
    values, errors = one.fit.told
    name = one.names[-1]
    return values[name], errors[name]


def asked(seed: int, chains: bool = False) -> Diagnosis:
    flown = fly(seed)
    assert not flown.plan.excitation_logged
    return ask_runs(fitted_runs(flown), chains=chains)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_saturation",)], indirect=True)
def test_a_limit_is_as_large_as_foretells_best(monkeypatch: pytest.MonkeyPatch) -> None:
    size, error = size_told(asked(LIMIT), "servo_saturation")
    assert abs(size - 0.14984) < 2 * error
    monkeypatch.setattr(evidence.Candidate, "_moved_in", lambda one, _: one.asked)
    size, error = size_told(asked(LIMIT), "servo_saturation")
    assert abs(size - 0.14984) > 3 * error


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("quadratic_damping",)], indirect=True)
def test_what_is_simulated_in_time_is_told_as_it_foretells_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gusts go into a power of the rates; by least squares it was 3.95 where 3 was true, at errors of 0.27."""
    power, error = size_told(asked(CUBIC), "quadratic_damping")
    assert abs(power - 3.0) < 2 * error < 0.5
    monkeypatch.setattr(evidence.Candidate, "_moved_in", lambda one, _: one.asked)
    power, error = size_told(asked(CUBIC), "quadratic_damping")
    assert power - 3.0 > 0.9
    assert error > 0.7, "by least squares, too"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_rate_limit",)], indirect=True)
def test_a_limit_of_rates_begins_where_its_score_was(monkeypatch: pytest.MonkeyPatch) -> None:
    assert size_told(asked(RATE), "servo_rate_limit")[0] == pytest.approx(9.07, rel=0.1)
    monkeypatch.setattr(refits, "predicting", lambda fit, *_: fit)
    assert size_told(asked(RATE), "servo_rate_limit")[0] > 2 * 9.07


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_saturation", "speed_stability")], indirect=True)
def test_what_loses_its_slope_on_the_way_stays_where_it_is() -> None:
    """A limit that no command reached where the search came by: a traceback."""
    assert "servo_saturation" in asked(BESIDE, chains=True).chain
