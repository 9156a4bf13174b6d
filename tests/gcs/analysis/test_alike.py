"""Runs that are not alike are told before a fit, with those that go together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs.analysis.alike import alike
from sysid.data.record import Record


def record(id: str, axis: str = "roll", *, seconds: float = 2.0, hz: float = 100.0, **more: float | str) -> Record:
    t = np.arange(0.0, seconds, 1 / hz)
    channels = {name: np.zeros(t.size) for name in ("p", "q", "delta_x", "delta_y")}
    channels |= {name: np.full(t.size, value) for name, value in more.items() if isinstance(value, float)}
    settings = {name: value for name, value in more.items() if isinstance(value, str)}
    return Record(id, {"t": t, **channels}, axis=axis, vehicle=settings)


def test_runs_that_are_alike_or_tell_nothing_are_one_group() -> None:
    found = alike([record("a#1", omega=172.0), record("a#2", omega=175.0), record("b#1", H_CYC_MAX="2500")])
    assert found.told == []
    assert found.odd == ()
    assert [found.letter(id) for id in ("a#1", "b#1")] == ["", ""]


def test_the_larger_group_goes_first_and_the_others_are_odd() -> None:
    found = alike([record("b#1", omega=160.0), record("a#1", omega=172.0), record("a#2", "pitch", omega=173.0)])
    assert found.groups == (("a#1", "a#2"), ("b#1",))
    assert found.odd == ("b#1",)
    assert [found.letter(id) for id in ("a#1", "a#2", "b#1", "c#1")] == ["A", "A", "B", ""]
    (told,) = found.told
    assert told.startswith("rotor speed differs: 160 rad/s: b#1; 172 rad/s: a#1, #2. ")


@pytest.mark.parametrize(
    ("one", "other", "kind"),
    [
        ({"hz": 500.0}, {"hz": 100.0}, "log rate"),
        ({"airspeed": 1.0}, {"airspeed": 14.0}, "airspeed"),
        ({"ATC_RAT_RLL_P": "0.1"}, {"ATC_RAT_RLL_P": "0.2"}, "gains"),
        ({"FRAME_CLASS": "6"}, {"FRAME_CLASS": "1"}, "vehicle"),
    ],
)
def test_each_kind_of_difference_is_told(one: dict[str, Any], other: dict[str, Any], kind: str) -> None:
    (difference,) = alike([record("a#1", **one), record("a#2", "pitch", **other)]).differences
    assert difference.kind == kind


def test_another_vehicle_has_other_gains_and_is_told_once() -> None:
    found = alike([record("a#1", frame="HELI", ATC_RAT_RLL_P="0.1"), record("b#1", frame="QUAD", ATC_RAT_RLL_P="0.2")])
    assert {one.kind for one in found.differences} == {"vehicle", "gains"}
    assert [told.partition(" differs")[0] for told in found.told] == ["vehicle"]
