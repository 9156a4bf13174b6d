"""A hover drift whose drag pushes: least squares goes there for slow gusts, and physics has a valley beside it."""

from __future__ import annotations

import pytest
from strangers.asking import ask, ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import reach

DRIFT = 4057507
"""That explains 137 of chi squared by a drag that pushes, and 121 by one that slows."""
DRIFT_BESIDE_A_DELAY = 4059867
"""That was told as a lag beside the drift: with the delay, in whose place it stood, the drag pushed."""


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("speed_stability", "sideslip")], indirect=True)
def test_a_drift_is_named_by_a_drag_that_slows_where_that_is_hardly_less_likely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs = fitted_runs(fly(DRIFT))
    found = ask_runs(runs)
    assert (found.verdict, found.effect) == ("missing", "speed_stability")
    assert found.winner is not None
    assert not found.winner.implausible
    assert found.winner.values["X_u"] < 0
    monkeypatch.setattr(reach, "_in_its_valley", lambda *_: None)
    by_slow_gusts = ask_runs(runs)
    assert (by_slow_gusts.verdict, by_slow_gusts.stands_in) == ("unexplained", True)
    assert by_slow_gusts.winner is not None
    assert by_slow_gusts.winner.values["X_u"] > 0


@pytest.mark.thorough
def test_the_delay_beside_the_drift_is_not_told_from_the_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = fly(DRIFT_BESIDE_A_DELAY)
    found = ask(flown).first
    assert found.verdict == "missing"
    assert {"speed_stability", "transport_delay"} <= {*found.chain, *found.not_told}
    both = next(one for one in found.pairs if {*one.effects} == {"speed_stability", "transport_delay"})
    assert both.values["Y_v"] < 0
    monkeypatch.setattr(reach, "_in_its_valley", lambda *_: None)
    pushed = ask(flown).first
    assert "transport_delay" not in {*pushed.chain, *pushed.not_told}
