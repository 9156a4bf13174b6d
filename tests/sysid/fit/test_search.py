"""Where commands jump: a narrow cleft in the cost is found, also far above where averaged commands are best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from strangers.asking import ask
from strangers.flights import fly

from sysid.data.stacks import Stack
from sysid.fit.search import search_nonsmooth
from sysid.model.paper import CD
from sysid.model.structure import Model

NAME = "L_lat"
"""Any parameter: the cost below is not a vehicle's."""
ENDS = 0.002, 0.05
CLEFT = 0.006
"""Its width, as a share of where it is."""
BETWEEN_SCORES = 4037001
"""A helicopter of 90 kg with a dead band of 0.044: scored at 0.02 and 0.05 it promises less than play."""
FAR_ABOVE = 4045279
"""A small helicopter with inflow and a dead band of 0.0131, where averaged commands are best at 0.007."""


def model_at(value: float) -> Model:
    begin = dict.fromkeys(CD.names, 1.0)
    return Model(CD, CD.vector({**begin, NAME: value}))


def found(cleft: float, smooth: float) -> float:
    """What the search tells of a cost that is smooth, least at `smooth`, but for a cleft that averaging hides."""

    def cost(value: float) -> float:
        return float(np.log(value / smooth) ** 2)

    def with_cleft(value: float) -> float:
        return cost(value) - 10.0 * float(np.exp(-((np.log(value / cleft) / CLEFT) ** 2)))

    first_look = round(np.log(ENDS[1] / ENDS[0]) / np.log(1.2)) + 1
    tries: list[float] = []

    def tried(values: Mapping[str, float], _: Sequence[Stack]) -> tuple[float, Model]:
        tries.append(values[NAME])
        averaged = len(tries) <= first_look
        return (cost if averaged else with_cleft)(values[NAME]), model_at(values[NAME])

    best = search_nonsmooth(model_at(1.0), NAME, ENDS, lambda _: [], tried, lambda values: with_cleft(values[NAME]))
    return float(best[NAME])


@pytest.mark.parametrize("times", [0.75, 1.0, 1.3, 1.6, 1.9])
def test_a_cleft_is_found_near_the_best_of_averaged_commands_and_far_above_it(times: float) -> None:
    assert found(0.008 * times, 0.008) == pytest.approx(0.008 * times, rel=CLEFT / 10)


def test_where_there_is_no_cleft_in_reach_the_smooth_best_is_told() -> None:
    assert found(0.04, 0.008) == pytest.approx(0.008, rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [BETWEEN_SCORES, FAR_ABOVE])
def test_dead_bands_of_strangers_are_found_in_their_clefts(seed: int) -> None:
    flown = fly(seed)
    found = ask(flown).first
    assert set(found.chain) == set(flown.hidden.names)
    assert found.winner is not None
    width = next(sizes["width"] for sizes in flown.hidden.sizes if "width" in sizes)
    assert found.winner.values["width"] == pytest.approx(width, rel=0.01)
