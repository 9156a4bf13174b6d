"""What may stand in the place of an effect that is missing is told of the effect that it is meant for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from gcs.analysis.pages.discovery import told
from gcs.analysis.quantities import stands_in
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
        candidates=(), indistinguishable_pairs=(), not_told=tuple(dict.fromkeys((*alike, *others))), **same,
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


def test_a_moment_back_to_level_is_the_answer_on_a_tether_and_nothing_else_is() -> None:
    both = ("L_phi", "M_theta")
    assert "on a tether or a stand; in free flight" in stands_in("it", ["attitude_stiffness"], both)
    assert "on a tether or a stand" in stands_in("they", ["servo_lag", "attitude_stiffness"], both)
    for effects, outside in (
        (["attitude_stiffness"], (*both, "M_a")),  # what is implausible of the base, a tether does not explain
        (["dynamic_inflow"], ("k_l",)),
        (["of_a_user"], both),
        (["attitude_stiffness"], ()),
    ):
        assert "only at implausible values" in stands_in("it", effects, outside)
    candidate = {"effect": "attitude_stiffness", "implausible_parameters": ["L_phi", "M_theta"]}
    document = {"verdict": "unexplained", "chain": ["attitude_stiffness"], "stands_in": True, "candidates": [candidate]}
    kept = told(document)
    assert kept is not None
    assert "on a tether or a stand; in free flight it stands in" in kept.answer


def test_a_page_tells_the_pairs_that_do_together_what_the_answer_does() -> None:
    kept = told({
        "verdict": "missing", "chain": ["servo_second_order"], "confidence": 0.9, "indistinguishable": ["gyro_lag"],
        "indistinguishable_pairs": [["transport_delay", "dynamic_inflow"]],
    })  # fmt: skip
    assert kept is not None
    assert kept.answer == (
        "missing: servo_second_order (not to be told from gyro_lag and transport_delay with dynamic_inflow), "
        "confidence 0.90"
    )
