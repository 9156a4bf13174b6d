"""Where a chain begins that takes its place beside another: at that one's values, no valley looked for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from sysid.diagnose import levelled
from sysid.diagnose.candidates import Ranked, Reference
from sysid.diagnose.levelled import as_alone, begun_at_rest, near_another
from sysid.model.compose import compose
from sysid.model.effect import catalogue
from sysid.model.paper import TPP
from sysid.model.structure import Model

ON = SimpleNamespace(constants={}, available=TPP.inputs)


def fitted(chi_squared: float, implausible: tuple[str, ...] = (), **own: float) -> Ranked:
    """Effects with their numbers, by the names of these, beside a base that has L_b = chi_squared."""
    known = [one for one in catalogue().values() if set(one.names) <= own.keys() and one.names]
    structure = compose(TPP.base_, known, TPP.inputs, {})
    typical = {one.name: one.typical for one in structure.parameters}
    model = Model(structure, structure.vector({**typical, "L_b": chi_squared, **own}))
    names = tuple(one.id for one in known)
    fit = SimpleNamespace(model=model, dataset=ON, told=(model, {}), added=names)
    return Ranked(
        effects=names,
        score=None,
        not_testable=None,
        fit=cast("Any", fit),
        implausible=implausible,
        chi_squared=chi_squared,
    )


PLAY = fitted(300.0, half_width=0.04)
LAG = fitted(400.0, tau_s=0.06)
DELAY = fitted(390.0, T_d=0.05)
CHAINS = {
    one.effects: one
    for one in (fitted(500.0, half_width=0.02, tau_s=0.03), fitted(900.0, ("zeta",), half_width=0.09, tau_g=0.001))
}


def near(more: str, begin: Ranked, single: dict[str, Ranked]) -> Model | None:
    asked = Ranked(effects=(more,), score=None, not_testable=None)
    return near_another(asked, begin, CHAINS, single, ())


def test_a_chain_begins_at_the_best_plausible_one_and_at_what_is_new_alone() -> None:
    there = near("servo_backlash", DELAY, {"transport_delay": DELAY})
    assert there is not None
    assert set(there.structure.effects) == {"servo_backlash", "transport_delay"}
    assert (there["half_width"], there["T_d"], there["L_b"]) == (0.02, 0.05, 500.0)


def test_that_is_so_whichever_of_the_two_is_fitted_to_the_other() -> None:
    there = near("transport_delay", PLAY, {"transport_delay": DELAY})
    assert there is not None
    assert (there["half_width"], there["T_d"]) == (0.02, 0.05)


@pytest.mark.parametrize(
    ("more", "begin", "single"),
    [
        ("servo_backlash", DELAY, {}),
        ("angular_damping", DELAY, {"transport_delay": DELAY}),
        ("servo_deadband", LAG, {"servo_deadband": fitted(200.0, width=0.03)}),
        ("servo_lag", DELAY, {"transport_delay": DELAY}),
    ],
    ids=["nothing known alone", "no chain with it", "what rests has valleys of its own", "linear ones look at all"],
)
def test_nothing_is_known_of_the_rest(more: str, begin: Ranked, single: dict[str, Ranked]) -> None:
    assert near(more, begin, single) is None


def test_a_chain_begins_at_what_both_halves_are_alone_where_its_score_led_away() -> None:
    band = fitted(200.0, width=0.03)
    asked = Ranked(effects=("servo_deadband",), score=None, not_testable=None)
    there = as_alone(asked, DELAY, {"servo_deadband": band}, ())
    assert there is not None
    assert (there["width"], there["T_d"], there["L_b"]) == (0.03, 0.05, DELAY.chi_squared)
    assert as_alone(asked, DELAY, {}, ()) is None, "nothing known alone"
    lag = Ranked(effects=("servo_lag",), score=None, not_testable=None)
    assert as_alone(lag, DELAY, {"servo_lag": LAG}, ()) is None, "linear ones look at all"


def test_play_and_a_dead_band_begin_once_more_where_the_other_ended_and_the_likelier_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    best = fitted(1061.0, half_width=0.0015, L_pp=-2.0, M_qq=-1.5, exponent=2.0)
    behind = fitted(990.0, width=0.005, L_pp=-2.0, M_qq=-1.5, exponent=2.0)
    apart = fitted(400.0, half_width=0.02, tau_s=0.03)
    begun: list[Model] = []

    def refit(*asked: Any) -> tuple[Any, str]:
        begun.append(asked[3])
        return SimpleNamespace(model=asked[3]), ""

    def ranked(one: Ranked, reference: Reference) -> Ranked:
        assert one.fit is not None
        return replace(one, implausible=implausible, chi_squared=1083.0 if "width" in one.fit.model.by_name else 1000.0)

    monkeypatch.setattr(levelled, "refit_or_reason", refit)
    monkeypatch.setattr(levelled, "ranked", ranked)
    chains = {tuple(sorted(one.effects)): one for one in (best, behind, apart)}
    reference = cast("Reference", SimpleNamespace(parent=None, users=()))
    implausible: tuple[str, ...] = ()
    found = begun_at_rest(chains, reference)
    names = tuple(sorted(behind.effects))
    assert {key: one.chi_squared for key, one in found.items()} == {names: 1083.0}, "the play begun anew is no likelier"
    band, play = begun
    assert band["width"] == pytest.approx(0.003, rel=0.05), "it stays behind by half of what play does"
    assert play["half_width"] == pytest.approx(0.0025, rel=0.05)
    assert band["L_b"] == 1061.0
    assert play["L_b"] == 990.0
    implausible = ("M_qq",)
    assert begun_at_rest(chains, reference) == {}, "what is likelier only where it is not plausible"
    none = {names: replace(behind, implausible=implausible)}
    assert begun_at_rest(none, reference) == {}, "no plausible chain to begin at"
