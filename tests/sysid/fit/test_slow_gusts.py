"""A quadrotor, which integrates, in slow gusts and a loop: least squares takes gusts for its answers."""

from __future__ import annotations

import pytest
from strangers.asking import records
from strangers.flights import Stranger, fly

from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.fit import estimate
from sysid.fit.identify import identify, on_runs

SEED = 2069
"""A training one: motors of 89 ms, 39 s chirps, slow gusts of 2.3 times the usual size."""


@pytest.fixture(scope="module")
def flown() -> Stranger:
    return fly(SEED)


@pytest.fixture(scope="module")
def runs(flown: Stranger) -> list[Record]:
    return records(flown)[: flown.plan.fitted]


def test_the_excitation_decides_where_least_squares_leaves_less(
    flown: Stranger, runs: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = flown.plan.vehicle.table
    fit = identify(on_runs("cd", (), runs, runs), runs, effects=["motor_lag"])
    assert fit.instrument == "excitation logged"
    assert fit.model["tau_m"] == pytest.approx(flown.hidden.sizes[0]["tau_m"], rel=0.1)
    assert fit.model["L_lat"] == pytest.approx(truth["L_lat"], rel=0.05)
    assert fit.model["M_lon"] == pytest.approx(truth["M_lon"], rel=0.05)
    monkeypatch.setattr(estimate, "_asks_less", lambda *_: False)
    before = identify(on_runs("cd", (), runs, runs), runs, effects=["motor_lag"])
    assert before.instrument == "commands"
    assert before.nrmse_percent["p"] > fit.nrmse_percent["p"]


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("motor_lag", "servo_rate_limit", "structural_mode")], indirect=True)
def test_what_is_missing_is_told_by_the_noise(runs: list[Record]) -> None:
    found = diagnose(on_runs("cd", (), runs, runs), runs, chains=False)
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert found.winner is not None
    assert found.winner.fit is not None
    assert found.winner.fit.error_share > found.parent.error_share
    assert found.explained_share is not None
    assert found.explained_share > 0.9
