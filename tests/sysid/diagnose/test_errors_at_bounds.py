"""A candidate's value at a bound of what its effect may be is told with an error, as if it might move on."""

from __future__ import annotations

import math

import pytest
from planted import PLANTED, fly
from planted_fits import records
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly as fly_stranger

from sysid.diagnose import candidates
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.diagnose import diagnose
from sysid.model.compose import compose

FAST_INFLOW = 4180455
"""Of 11 ms, fitted at the least time that an inflow may have, and then too large."""
EXCITATION = ("excitation_x", "excitation_y", "excitation_e")


def at_bounds(one: Ranked) -> set[str]:
    asked = None if one.fit is None else one.fit.asked
    return set() if asked is None else {*asked.estimate.at_bound} & {*one.names} - {*asked.held}


@pytest.mark.parametrize("without", [(), EXCITATION], ids=["excitation logged", "in a loop"])
def test_values_at_bounds_have_errors(without: tuple[str, ...]) -> None:
    """A lag of the servos resembles many entries, at sizes that end where these do."""
    flight = records(fly("servo_lag", PLANTED["servo_lag"], seed=3, duration_s=8.0, gusts=0.05), *without)
    bounded = [one for one in diagnose(compose("tpp"), flight, chains=False).candidates if at_bounds(one)]
    assert bounded, "else nothing is asked here"
    for one in bounded:
        assert one.fit is not None
        told = one.to_json()["standard_errors"]
        for name in at_bounds(one) & {*told}:
            assert one.fit.asked.standard_errors[name] == 0.0, "by the fit itself"
            assert 0 < told[name] < math.inf
    assert any(at_bounds(one) & {*one.standard_errors} for one in bounded)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("dynamic_inflow", "structural_mode")], indirect=True)
def test_a_size_is_no_surer_than_what_stands_at_a_bound_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly_stranger(FAST_INFLOW))
    found = ask_runs(runs)
    inflow = next(one for one in found.candidates if one.effect == "dynamic_inflow")
    assert inflow.values["k_l"] > 0.6, "beyond what physics allows"
    assert at_bounds(inflow) == {"tau_l"}
    assert found.effect == "dynamic_inflow"
    assert inflow.implausible == ()
    monkeypatch.setattr(candidates, "_at_bound_beside", lambda *_: ())
    alone = next(one for one in ask_runs(runs).candidates if one.effect == "dynamic_inflow")
    assert alone.implausible == ("k_l",)
