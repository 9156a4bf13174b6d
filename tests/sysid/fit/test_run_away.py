"""In a strong loop, or in strong gusts, least squares may run away, to where commands follow from rates."""

from __future__ import annotations

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import Stranger, fly

from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.errors import FitError
from sysid.fit import estimate
from sysid.fit.identify import identify, on_runs

SEED = 4100050
"""Of the 90 kg class: 10.9 s chirps in gusts of 3.4 times the usual size, and a drift that shows 70 times."""
QUADROTOR = 4110878
"""Its motors lag by 31 ms, and its excitation is logged: two chirps of 14.5 s in gusts of three times the usual."""


def test_it_is_fitted_from_a_stable_point_then(flown: Stranger, runs: list[Record]) -> None:
    fit = identify(on_runs("tpp", (), runs, runs), runs, effects=["speed_stability"])
    assert fit.instrument == "prediction error"
    truth = flown.plan.vehicle.table
    for name in ("L_b", "M_a", "tau_f"):
        assert fit.model[name] == pytest.approx(truth[name], rel=0.05)


def test_nor_need_it_end_there_where_the_excitation_is_logged() -> None:
    flown = fly(QUADROTOR)
    found = ask_runs(fitted_runs(flown), base="cd")
    assert found.verdict == "missing"
    assert "motor_lag" in (found.effect, *found.indistinguishable, *found.equivalent.get(str(found.effect), ()))
    assert found.winner is not None
    assert found.winner.fit is not None
    fitted = found.winner.fit.model
    assert fitted["tau_m"] == pytest.approx(flown.hidden.sizes[0]["tau_m"], rel=0.1)


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
