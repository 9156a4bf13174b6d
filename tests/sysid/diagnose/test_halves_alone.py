"""Halves of a chain that end in another valley alone: fitted once more from there, where the other may be nothing."""

from __future__ import annotations

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import halves

BESIDE_NOTHING = 4191024
"""A judged one with a tilted wake of 14 times what is detectable, which alone ended where it explains 0.59."""
WITH_TWO_MORE = ("slipstream_wing", "hub_gyroscopics", "angular_damping")


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [WITH_TWO_MORE], indirect=True)
def test_a_half_is_fitted_from_the_chain_where_the_other_may_be_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(BESIDE_NOTHING))
    found = ask_runs(runs, chains=True)
    assert (found.verdict, found.chain) == ("missing", ("slipstream_wing",))
    assert found.winner is not None
    assert found.winner.values["tau_w"] == pytest.approx(0.117, abs=0.01)
    with monkeypatch.context() as surely:
        surely.setattr(halves, "MAY_BE_NOTHING", 0.0)
        without = ask_runs(runs, chains=True)
    assert (without.verdict, without.chain) == ("missing", ("slipstream_wing", "hub_gyroscopics"))
    assert without.winner is not None
    assert halves._rest_may_be_nothing(without.winner, "slipstream_wing")
    assert not halves._rest_may_be_nothing(without.winner, "hub_gyroscopics"), "the wake is there"
