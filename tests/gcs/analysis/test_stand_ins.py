"""What may stand in the place of an effect that is missing is told of the effect that it is meant for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from gcs.analysis.text.verdict import answer, stand_ins


def ranked(*effects: str) -> Any:
    return SimpleNamespace(
        effects=effects, effect=effects[-1], fit=object(), implausible=(), explained_share=1.0, own=()
    )  # fmt: skip


def missing(chain: tuple[str, ...], alike: tuple[str, ...], pairs: tuple[Any, ...] = (), **more: Any) -> Any:
    winner = ranked(*chain)
    same = {"equivalent": {}, **more}
    others = [name for each in same["equivalent"].values() for name in each]
    return SimpleNamespace(
        verdict="missing", reason=None, winner=winner, chain=chain, indistinguishable=alike, pairs=(winner, *pairs),
        candidates=(), not_told=tuple(dict.fromkeys((*alike, *others))), **same,
    )  # fmt: skip


def test_of_a_single_effect_all_are_its_own() -> None:
    last = missing(("servo_lag",), ("gyro_lag",))
    assert stand_ins(last) == {"servo_lag": ("gyro_lag",)}
    assert answer(last) == "missing: servo_lag  (not to be told from gyro_lag)"


def test_of_a_chain_each_has_those_that_are_beside_the_other() -> None:
    chain = ("servo_backlash", "dynamic_inflow")
    pairs = (ranked("servo_backlash", "hub_gyroscopics"), ranked("gyro_misalignment", "servo_backlash"))
    last = missing(chain, ("hub_gyroscopics", "gyro_misalignment"), pairs)
    assert stand_ins(last) == {"servo_backlash": (), "dynamic_inflow": ("hub_gyroscopics", "gyro_misalignment")}
    assert answer(last) == (
        "missing: servo_backlash, and then dynamic_inflow (not to be told from hub_gyroscopics and gyro_misalignment)"
    )


def test_of_a_chain_the_larger_may_be_another_too() -> None:
    last = missing(("gyro_filter", "servo_backlash"), ("servo_lag",), (ranked("servo_lag", "servo_backlash"),))
    assert answer(last) == "missing: gyro_filter (not to be told from servo_lag), and then servo_backlash"


def test_what_predicts_the_same_stands_where_its_like_does() -> None:
    same = {"servo_backlash": ("play",), "hub_gyroscopics": ("hub",)}
    pairs = (ranked("servo_backlash", "hub_gyroscopics"),)
    last = missing(("servo_backlash", "dynamic_inflow"), ("hub_gyroscopics",), pairs, equivalent=same)
    assert stand_ins(last) == {"servo_backlash": ("play",), "dynamic_inflow": ("hub_gyroscopics", "hub")}
