"""Two effects that do together what a single one does: both are asked, and neither is the answer alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask
from strangers.flights import fly

from gcs.analysis.text.verdict import answer
from sysid.diagnose import chains, verdict
from sysid.diagnose.candidates import Ranked
from sysid.model.effect import catalogue

LATE_WITH_INFLOW = 4043156
"""A delay of 22 ms beside an inflow, of which one second order explains all but one of 1,233."""
NOT_NAMED_ALONE = 4047441
"""A delay of 13 ms beside an inflow, which was told as a filter beside a slipstream's wing."""


def unasked(*effects: str, not_testable: str | None = None) -> Ranked:
    return Ranked(effects=effects, score=None, not_testable=not_testable)


def test_what_an_effect_is_made_of_is_in_the_catalogue() -> None:
    known = catalogue()
    made = {name: effect.made_of for name, effect in known.items() if effect.made_of}
    assert made
    for name, pairs in made.items():
        for pair in pairs:
            assert {*pair} <= known.keys() - {name}
        assert {known[same].made_of for same in known[name].same_as} <= {pairs}, "the same equations, the same parts"


@pytest.mark.parametrize("why_not", [None, "no rotor is logged"])
def test_its_parts_are_fitted_together_where_both_can_be_asked(
    why_not: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted: list[tuple[str, str]] = []
    monkeypatch.setattr(chains._Chains, "fitted_alone", lambda _, one: one)
    monkeypatch.setattr(chains._Chains, "fit", lambda _, one, other: fitted.append((one.effect, other.effect)))
    search = chains._Chains((), cast("Any", None), lambda _: None, None, answered=True)
    singles = [unasked("servo_second_order"), unasked("transport_delay"), unasked("servo_lag")]
    asked = [*singles, unasked("dynamic_inflow", not_testable=why_not)]
    assert search.parts_of(asked[0], asked) == [], "none has a fit here"
    assert fitted == ([] if why_not else [("transport_delay", "dynamic_inflow")])
    search.parts_of(unasked("servo_lag"), asked)
    both = search.found["dynamic_inflow", "transport_delay"] = unasked("transport_delay", "dynamic_inflow")
    assert search.parts_of(asked[0], asked) == ([] if why_not else [both])
    assert len(fitted) == (not why_not), "once, and nothing of what is made of nothing"


@pytest.mark.parametrize(
    ("half", "price", "made"), [("transport_delay", 2.0, 1), ("transport_delay", chains.DEAR, 0), ("servo_lag", 2.0, 0)]
)
def test_what_may_be_made_of_a_half_takes_its_place(
    half: str, price: float, made: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A filter of the gyros beside an inflow, which alone rang for both, was not fitted where a delay stood for it."""
    inflow = replace(unasked("dynamic_inflow"), fit=cast("Any", object()))
    monkeypatch.setattr(chains._Chains, "price_of", lambda *_: price)
    search = chains._Chains((inflow,), cast("Any", None), lambda _: None, None, answered=True)
    found = list(search.made_with(half, "dynamic_inflow"))
    assert len(found) == made
    for beside, one in found:
        assert beside is inflow
        assert one.effect in ("servo_second_order", "gyro_filter")
        search.found[tuple(sorted((one.effect, "dynamic_inflow")))] = one
    assert list(search.made_with(half, "dynamic_inflow")) == [], "once"
    assert list(search.made_with(half, "angular_damping")) == [], "which was not fitted alone"


def test_a_pair_is_part_of_a_single_effect_alone() -> None:
    pairs = [unasked("dynamic_inflow", "transport_delay"), unasked("gyro_lag", "dynamic_inflow")]
    assert verdict._parts_of(unasked("gyro_filter"), pairs) == pairs[:1]
    for other in (("servo_lag",), ("gyro_filter", "servo_backlash"), ("a_user_s_own",)):
        assert not verdict._parts_of(unasked(*other), pairs)


def test_it_is_said_in_the_verdict() -> None:
    winner = SimpleNamespace(effects=("servo_second_order",), fit=object(), implausible=(), explained_share=1.0, own=())
    last: Any = SimpleNamespace(
        verdict="missing", reason=None, winner=winner, chain=winner.effects, not_told=("gyro_filter",), equivalent={},
        indistinguishable_pairs=(("transport_delay", "dynamic_inflow"),), pairs=(),
    )  # fmt: skip
    assert answer(last) == (
        "missing: servo_second_order  (not to be told from gyro_filter and transport_delay with dynamic_inflow)"
    )


@pytest.mark.thorough
def test_a_delay_with_an_inflow_is_not_told_from_one_second_order() -> None:
    found = ask(fly(LATE_WITH_INFLOW)).first
    assert (found.verdict, found.effect) == ("missing", "servo_second_order")
    assert [set(pair) for pair in found.indistinguishable_pairs] == [{"transport_delay", "dynamic_inflow"}]
    assert found.to_json()["indistinguishable_pairs"] == [["transport_delay", "dynamic_inflow"]]
    assert not {"transport_delay", "dynamic_inflow"} & {*found.not_told}, "neither is the answer alone"


@pytest.mark.thorough
def test_a_delay_with_an_inflow_is_named_where_it_is_likelier(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = fly(NOT_NAMED_ALONE)
    found = ask(flown).first
    assert (found.verdict, set(found.chain)) == ("missing", {"transport_delay", "dynamic_inflow"})
    assert found.winner is not None
    assert found.winner.values["T_d"] == pytest.approx(flown.hidden.sizes[0]["T_d"], rel=0.15)
    monkeypatch.setattr(chains._Chains, "parts_of", lambda *_: [])
    assert set(ask(flown).first.chain) != {"transport_delay", "dynamic_inflow"}
