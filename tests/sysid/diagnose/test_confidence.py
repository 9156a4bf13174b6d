"""What is told of how sure a name is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.diagnose.candidates import SIGNIFICANT
from sysid.diagnose.confidence import UNEXPLAINED_RIGHT, of_named, of_single, of_unexplained
from sysid.diagnose.likely import Class
from sysid.diagnose.verdict import _sure

ALONE = Class(alike=(), equivalent={}, named=1.0, whole=1.0)


def told(excited: bool, left: float = 0.0) -> list[float]:
    return [of_single(lead, left, ALONE, excited) for lead in np.linspace(-3, 6, 400).tolist()]


@pytest.mark.parametrize("excited", [True, False])
def test_more_lead_is_never_less_sure(excited: bool) -> None:
    each = told(excited)
    assert np.all(np.diff(each) >= 0)
    assert each[0] < 0.2
    assert each[-1] > 0.99


@pytest.mark.parametrize("excited", [True, False])
def test_a_name_is_told_as_sure_as_such_names_were_right(excited: bool) -> None:
    """0.98 of those of strangers that came out at 0.88 to 0.965, and without an excitation 0.99 at 0.7 to 0.95."""
    assert of_named(0.5, 0.0, ALONE) < 0.6
    assert 0.93 < of_single(0.5, 0.0, ALONE, excited) < 0.96


def test_the_same_lead_is_told_less_sure_where_no_excitation_is_logged() -> None:
    assert np.all(np.array(told(False)) <= np.array(told(True)))


def test_what_hardly_shows_is_less_surely_unexplained() -> None:
    each = [of_unexplained(None, SIGNIFICANT - further, 0.0) for further in (1e-9, 1.0, 4.0, 20.0, 200.0)]
    assert each == sorted(each)
    assert 0.6 < each[0] < 0.7 < each[2] < 0.86 < each[3] < each[4] == UNEXPLAINED_RIGHT
    assert of_unexplained(None, SIGNIFICANT + 1e-9, 0.0) == 0


@pytest.mark.parametrize(("measured", "most"), [(True, 0.89), (False, 0.5)])
def test_what_is_found_unstable_is_told_less_sure_least_of_all_in_a_loop(measured: bool, most: float) -> None:
    parent: Any = SimpleNamespace(division=SimpleNamespace(measured=measured))
    for stable, said in ((True, 0.97), (False, most)):
        winner: Any = SimpleNamespace(fit=SimpleNamespace(model=SimpleNamespace(stable=stable)))
        assert _sure(winner, 0.97, parent) == said
        assert _sure(winner, 0.3, parent) == 0.3
    assert _sure(SimpleNamespace(fit=None), 0.97, parent) == 0.97  # type: ignore[arg-type]
