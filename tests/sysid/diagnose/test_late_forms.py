"""A lag, a delay, a second order: forms of being late that explain nearly as much are one class."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from strangers.asking import ask_runs, fitted_runs
from strangers.flights import fly

from sysid.diagnose import likely
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.likely import LATE_APART, LATE_SHARE, USEFUL, Class, with_late

DELAYED = 4140166
"""Of a judgement: 8.5 ms in a loop, named a lag of the gyros at 0.97, or a filter or a lead-lag."""
AMONG = Class(alike=(), equivalent={}, named=1.0, whole=1.0)


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(likely, "same", lambda one, other, _: one.chi_squared == other.chi_squared)


def fitted(name: str, chi_squared: float, *implausible: str, measured: bool = False) -> Ranked:
    return Ranked(
        effects=(name,),
        score=None,
        not_testable=None,
        fit=cast("Any", SimpleNamespace(division=SimpleNamespace(measured=measured))),
        chi_squared=chi_squared,
        implausible=implausible,
    )


FILTER, SERVOS = fitted("gyro_filter", 500.0), fitted("servo_second_order", 500.0)
DELAY, LAG = fitted("transport_delay", 500.0 - 0.9 * LATE_APART), fitted("servo_lag", 490.0)


@pytest.mark.usefixtures("plain")
def test_the_other_forms_that_explain_nearly_as_much_are_in_the_class() -> None:
    found = with_late(AMONG, DELAY, [FILTER, SERVOS, DELAY, LAG])
    assert found.alike == ("servo_lag", "gyro_filter")
    assert found.equivalent == {"servo_lag": (), "gyro_filter": ("servo_second_order",)}
    assert with_late(AMONG, FILTER, [FILTER, DELAY]).alike == ("transport_delay",)
    logged = replace(FILTER, fit=fitted("gyro_filter", 500.0, measured=True).fit)
    assert with_late(AMONG, logged, [logged, DELAY, LAG]).alike == ("servo_lag",), "what is not surely told apart"
    ringing = [replace(one, implausible=("zeta",)) for one in (FILTER, SERVOS)]
    assert with_late(AMONG, LAG, ringing).alike == ("gyro_filter",), "how it rings is not told either"


@pytest.mark.usefixtures("plain")
def test_they_come_before_what_is_of_no_such_form_and_are_no_more_than_of_use() -> None:
    crowded = replace(AMONG, alike=("lead_lag", "servo_second_order"))
    found = with_late(crowded, LAG, [LAG, FILTER, SERVOS, DELAY])
    assert found.alike == ("servo_second_order", "transport_delay")
    assert len(found.alike) == USEFUL - 1


@pytest.mark.usefixtures("plain")
def test_so_they_are_beside_another_effect() -> None:
    """A filter of the gyros beside a coupling: a lag beside it explained 3,481 for its 3,476."""

    def beside(name: str, chi_squared: float, *more: str) -> Ranked:
        one = fitted(name, chi_squared, measured=True)
        return replace(one, effects=(name, *(more or ("input_coupling",))))

    chain = beside("servo_lag", 3481.0)
    filters = [beside("gyro_filter", 3476.0), beside("servo_second_order", 3476.0), beside("transport_delay", 3470.0)]
    found = with_late(AMONG, chain, [FILTER, DELAY], [chain, *filters])
    assert found.alike == ("gyro_filter",)
    assert found.equivalent == {"gyro_filter": ("servo_second_order",)}
    turned = replace(filters[0], effects=filters[0].effects[::-1])
    assert with_late(AMONG, chain, [], [chain, turned]).alike == ("gyro_filter",), "in either order"
    elsewhere = [beside("gyro_filter", 3480.0, "hub_gyroscopics"), beside("transport_delay", 3480.0, "lead_lag")]
    assert with_late(AMONG, chain, [], [chain, *elsewhere]) == AMONG, "beside something else"
    bare = replace(chain, effects=("hub_gyroscopics", "input_coupling"))
    assert with_late(AMONG, bare, [], [bare, filters[0]]) == AMONG, "where nothing is late"


@pytest.mark.parametrize(
    ("winner", "other"),
    [
        (fitted("gyro_filter", 500.0, measured=True), DELAY),
        (replace(FILTER, effects=("gyro_filter", "dynamic_inflow")), DELAY),
        (fitted("dynamic_inflow", 500.0), DELAY),
        (FILTER, fitted("transport_delay", 499.0 - LATE_APART)),
        (fitted("gyro_filter", 50.0), fitted("transport_delay", 49.0 - LATE_SHARE * 50)),
        (FILTER, fitted("servo_second_order", 499.0)),
        (LAG, fitted("gyro_filter", 500.0, "corner")),
        (FILTER, replace(DELAY, fit=None)),
        (FILTER, fitted("dynamic_inflow", 499.0)),
    ],
    ids=[
        *("logged", "a chain", "not late", "far behind", "behind by much of it", "its own form", "impossible"),
        *("not fitted", "of no form"),
    ],
)
def test_else_there_is_none(winner: Ranked, other: Ranked) -> None:
    assert with_late(AMONG, winner, [winner, other]) == AMONG


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_filter", "servo_lag", "lead_lag", "transport_delay")], indirect=True)
def test_a_delay_in_a_loop_is_in_the_class_of_a_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fitted_runs(fly(DELAYED))
    found = ask_runs(runs)
    assert found.effect == "servo_lag"
    assert "transport_delay" in found.indistinguishable
    monkeypatch.setattr(likely, "LATE_APART", 0.0)
    assert "transport_delay" not in ask_runs(runs).indistinguishable
