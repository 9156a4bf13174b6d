"""How long a loop that nobody told of held commands, as what explains the runs shows it: the parent alone, which lacks
that, had it otherwise."""

from __future__ import annotations

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import Stranger, fly

from sysid.diagnose import diagnose as asking
from sysid.diagnose.diagnose import Diagnosis

IN_THE_WAKE = 4065483
"""A wing in the slipstream, 2.2 times what is just detectable, at 125 of 500 Hz: the parent alone shows 3.1 ms."""
A_BAR = 4065349
"""A stabiliser bar at 125 of 250 Hz: the parent shows 1 ms, by which the bar explains a quarter of what it does."""

BESIDE_OTHERS = ("stabiliser_bar", "transport_delay", "lead_lag", "gyro_filter", "servo_second_order")
"""Of these it is not one of the few likeliest by that."""


def loop_s(found: Diagnosis) -> float | None:
    return found.parent.dataset.found_loop_s


def flown(seed: int) -> Stranger:
    stranger = fly(seed)
    assert not stranger.plan.loop_told
    return stranger


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("slipstream_wing", "stabiliser_bar", "lead_lag")], indirect=True)
def test_the_hold_is_that_beside_what_explains_the_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = flown(IN_THE_WAKE)
    runs = fitted_runs(stranger)
    found = ask_runs(runs)
    assert (found.verdict, found.effect) == ("missing", "slipstream_wing")
    assert loop_s(found) == pytest.approx(stranger.dt, abs=0.5e-3)
    assert found.thinned is not None
    assert found.thinned.early_s == pytest.approx(0.5 * (1 / stranger.plan.log_hz - stranger.dt), abs=0.3e-3)
    monkeypatch.setattr(asking, "held_anew", lambda *_: None)
    by_the_parent = ask_runs(runs)
    assert loop_s(by_the_parent) == pytest.approx(3.1e-3, abs=0.1e-3)
    assert by_the_parent.winner is not None
    assert found.winner is not None
    assert by_the_parent.winner.delta_bic > found.winner.delta_bic + 5


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [BESIDE_OTHERS], indirect=True)
def test_a_delay_beside_an_effect_is_another_hold_where_that_explains_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = flown(A_BAR)
    runs = fitted_runs(stranger)
    found = ask_runs(runs, chains=True)
    assert (found.verdict, found.chain) == ("missing", ("stabiliser_bar",))
    assert loop_s(found) == pytest.approx(stranger.dt, abs=0.2e-3)
    monkeypatch.setattr(asking, "_searched", lambda _: False)
    assert {*ask_runs(runs, chains=True).chain} == {"transport_delay", "stabiliser_bar"}


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [BESIDE_OTHERS], indirect=True)
def test_whoever_ends_the_search_has_what_was_found_until_then(monkeypatch: pytest.MonkeyPatch) -> None:
    ended = []

    def by_another_hold(singles: object, pairs: tuple[object, ...], *_: object) -> None:
        if pairs:
            ended.append(pairs)
            raise KeyboardInterrupt

    monkeypatch.setattr(asking, "held_anew", by_another_hold)
    found = ask_runs(fitted_runs(flown(A_BAR)), chains=True)
    assert len(ended) == 1
    assert {*found.chain} == {"transport_delay", "stabiliser_bar"}
