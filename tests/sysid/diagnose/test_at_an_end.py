"""A name at an end of its range, of which a tether explains nearly as much: both stand in the class."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest

from sysid.diagnose.candidates import Ranked
from sysid.diagnose.likely import Class, with_tethers
from sysid.model.effect import catalogue

AMONG = Class(alike=(), equivalent={}, named=1.0, whole=1.0)
TETHER = ("L_phi", "M_theta")


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Ranked, "own", property(lambda one: tuple(catalogue()[name] for name in one.effects)))


def named(name: str, chi_squared: float, implausible: tuple[str, ...] = (), **at_bound: float) -> Ranked:
    fit = SimpleNamespace(model=at_bound, estimate=SimpleNamespace(at_bound=tuple(at_bound)))
    return Ranked(
        effects=(name,),
        score=None,
        not_testable=None,
        fit=cast("Any", fit),
        chi_squared=chi_squared,
        implausible=implausible,
    )


WAKE = named("slipstream_wing", 113.0, tau_w=1.0)
HELD = named("attitude_stiffness", 88.0, implausible=TETHER)


def test_a_wake_that_takes_as_long_as_may_be_may_be_a_tether() -> None:
    assert with_tethers(AMONG, WAKE, [WAKE, HELD]).alike == ("attitude_stiffness",)
    known = replace(AMONG, alike=("attitude_stiffness",))
    assert with_tethers(known, WAKE, [WAKE, HELD]) == known
    full = replace(AMONG, alike=("stabiliser_bar", "sideslip"))
    assert with_tethers(full, WAKE, [WAKE, HELD]) == full, "more would be of no use"


@pytest.mark.parametrize(
    ("winner", "other"),
    [
        (replace(WAKE, fit=named("slipstream_wing", 113.0).fit), HELD),
        (named("slipstream_wing", 113.0, tau_w=0.3), HELD),
        (replace(WAKE, effects=("slipstream_wing", "servo_lag")), HELD),
        (WAKE, replace(HELD, chi_squared=80.0)),
        (WAKE, replace(HELD, fit=None)),
        (WAKE, named("sideslip", 110.0)),
    ],
    ids=["inside its range", "where physics allows it", "a chain", "explains too little", "not fitted", "no tether"],
)
def test_else_there_is_none_in_the_class(winner: Ranked, other: Ranked) -> None:
    assert with_tethers(AMONG, winner, [winner, other]).alike == ()
