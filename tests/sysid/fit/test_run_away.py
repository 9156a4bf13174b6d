"""In a strong loop whose excitation is not logged least squares may run away, to where commands follow from rates."""

from __future__ import annotations

import pytest
from strangers.flights import Stranger

from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.errors import FitError
from sysid.fit import estimate
from sysid.fit.identify import identify, on_runs

SEED = 4100050
"""Of the 90 kg class: 10.9 s chirps in gusts of 3.4 times the usual size, and a drift that shows 70 times."""


def test_it_is_fitted_from_a_stable_point_then(flown: Stranger, runs: list[Record]) -> None:
    fit = identify(on_runs("tpp", (), runs, runs), runs, effects=["speed_stability"])
    assert fit.instrument == "prediction error"
    truth = flown.plan.vehicle.table
    for name in ("L_b", "M_a", "tau_f"):
        assert fit.model[name] == pytest.approx(truth[name], rel=0.05)


@pytest.mark.thorough
def test_what_is_missing_is_asked_from_there(runs: list[Record]) -> None:
    found = diagnose(on_runs("tpp", (), runs, runs), runs, chains=False)
    assert (found.verdict, found.effect) == ("missing", "speed_stability")


def test_what_was_wrong_first_is_told_where_no_fit_is_determined(
    runs: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    tried: list[str] = []

    def refused(*_: object) -> None:
        tried.append("fit")
        raise FitError(f"the data do not determine the model, fit {len(tried)}")

    monkeypatch.setattr(estimate, "_weighed", refused)
    with pytest.raises(FitError, match="the model, fit 1"):
        identify(on_runs("tpp", (), runs, runs), runs)
    assert len(tried) == 2
