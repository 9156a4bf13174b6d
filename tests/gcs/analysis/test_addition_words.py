"""What an added effect did, axis by axis, and what the change is counted from."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gcs.analysis.addition import _validated
from gcs.analysis.ladder import change_text
from gcs.analysis.text.addition import outcome
from sysid.fit.result import Rung
from sysid.model.base import find_base

STEPS = [
    ((), {"p": 89.9, "q": 87.7}, {"p": 88.2, "q": 86.0}),
    (("angular_damping",), {"p": 89.7, "q": 90.9}, {"p": 87.6, "q": 89.1}),
    (("angular_damping", "servo_lag"), {"p": 92.0, "q": 93.0}, {"p": 90.2, "q": 91.0}),
]
LINEAGE = tuple(Rung(*step) for step in STEPS)


def fit(rungs: int) -> Any:
    effects, fitted, judged = STEPS[rungs - 1]
    structure = SimpleNamespace(base_=find_base("tpp"), effects=effects)
    return SimpleNamespace(
        model=SimpleNamespace(structure=structure), nrmse_percent=fitted, validation_nrmse_percent=judged,
        lineage=LINEAGE[:rungs],
    )  # fmt: skip


def addition(rungs: int) -> Any:
    before, after = fit(rungs - 1), fit(rungs)
    signs = [_validated(before, after), SimpleNamespace(key="plausible", seen=True)]
    return SimpleNamespace(named=after.model.structure.effects[-1], before=before, after=after, signs=signs)


@pytest.mark.parametrize(
    ("after", "text"),
    [
        ({"p": 91.0, "q": 87.74}, "p 89.9 → 91.0, q 87.7 → 87.7 %"),
        ({"p": 89.7, "q": 90.9}, "q better 87.7 → 90.9, p slightly worse 89.9 → 89.7 %"),
        ({"p": 85.0, "q": 87.7}, "q same 87.7 → 87.7, p worse 89.9 → 85.0 %"),
    ],
)
def test_an_axis_that_got_worse_is_said_so(after: dict[str, float], text: str) -> None:
    assert change_text({"p": 89.9, "q": 87.7}, after) == text


def test_the_error_does_not_fall_where_it_rose_on_one_axis() -> None:
    kept, said = outcome(addition(2))
    assert kept
    assert said.text == (
        "angular_damping: q better 87.7 → 90.9, p slightly worse 89.9 → 89.7 %; on runs that were not fitted q better "
        "86.0 → 89.1, p slightly worse 88.2 → 87.6 %"
    )
    assert outcome(addition(3))[1].text.startswith("servo_lag: the error falls, p 89.7 → 92.0, q 90.9 → 93.0 %, and on")


def test_a_change_on_other_runs_names_what_it_is_counted_from() -> None:
    assert _validated(fit(2), fit(3)).text == (
        "p 87.6 → 90.2, q 89.1 → 91.0 %, from the rung + angular_damping; TPP had p 88.2, q 86.0 %"
    )
    assert "from the rung" not in _validated(fit(1), fit(2)).text
