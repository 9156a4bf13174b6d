"""Fits moved on in the noise's own measure: how little a move may gain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sysid.diagnose import by_noise, evidence
from sysid.diagnose.evidence import residual_at
from sysid.model.paper import TPP
from sysid.model.relaxation import RelaxationError

ROWS = 100


@pytest.mark.parametrize(
    ("power", "gain", "moves"),
    [(1.0, 0.03, True), (1.0, 0.01, False), (100.0, 15.0, False), (100.0, 25.0, True)],
    ids=["beside noise a little counts", "less does not", "nor does it beside much", "more does"],
)
def test_a_move_by_the_noise_gains_something_beside_what_is_left(
    power: float, gain: float, moves: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = np.full(ROWS, np.sqrt(power))
    there = np.full(ROWS, np.sqrt(power - gain / ROWS))
    structure = SimpleNamespace(names=("x",))
    one = SimpleNamespace(
        free=("x",), model=SimpleNamespace(structure=structure, values=np.ones(1)), at=lambda _: structure
    )
    white = SimpleNamespace(
        residual=here, shows=lambda row: row, move=lambda _: np.ones(1), power=lambda row: float(row @ row)
    )
    monkeypatch.setattr(by_noise, "residual_at", lambda *_: there)
    monkeypatch.setattr(by_noise, "White", SimpleNamespace(of=lambda *_: white))
    found = by_noise._moved(cast(Any, one), cast(Any, white), cast(Any, None))
    assert (found is not None) == moves


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("singular"), RelaxationError("the response does not settle")])
def test_a_move_to_where_nothing_answers_is_not_taken(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a rotor speed a lag of all motors, begun where one of each axis had ended, went on to where nothing
    settled, and the diagnosis ended there."""

    def fails(*_: object) -> None:
        raise error

    monkeypatch.setattr(evidence, "respond", fails)
    one = SimpleNamespace(model=SimpleNamespace(structure=TPP))
    metric = SimpleNamespace(stacks=[SimpleNamespace(Y=np.zeros((2, 4)))])
    assert residual_at(cast(Any, one), np.zeros(len(TPP.names)), cast(Any, metric)) is None
