"""What is told of how sure a name is."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.diagnose.confidence import SURE_FROM, SURE_FROM_NOT_EXCITED, of_single
from sysid.diagnose.likely import Class

ALONE = Class(alike=(), equivalent={}, named=1.0, whole=1.0)
SURE = 0.9


def told(excited: bool, left: float = 0.0) -> list[float]:
    return [of_single(lead, left, ALONE, excited) for lead in np.linspace(-3, 6, 400).tolist()]


@pytest.mark.parametrize("excited", [True, False])
def test_more_lead_is_never_less_sure(excited: bool) -> None:
    each = told(excited)
    assert np.all(np.diff(each) >= 0)
    assert each[0] < 0.2
    assert each[-1] > 0.99


@pytest.mark.parametrize("excited", [True, False])
def test_only_names_that_were_right_wherever_they_were_known_are_told_to_be_sure(excited: bool) -> None:
    least = SURE_FROM if excited else SURE_FROM_NOT_EXCITED
    each = np.array(told(excited))
    assert np.all((each < SURE) | (each >= least))
    assert np.any((each > SURE - 0.01) & (each < SURE))


def test_the_same_lead_is_told_less_sure_where_no_excitation_is_logged() -> None:
    assert np.all(np.array(told(False)) <= np.array(told(True)))
