"""Normal equations of parameters and noise together, against differences of what is left."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import planted
import pytest
from planted_fits import controlled, records

from sysid.data.dataset import prepared
from sysid.fit.estimate import estimate
from sysid.fit.output_error import output_error
from sysid.fit.prediction_error import Equations, Noise, _blocks
from sysid.model.paper import TPP


@pytest.fixture(scope="module")
def begun() -> Any:
    """A fit of one flight in a loop, the noise that it leaves, and the bins."""
    with controlled(2, 1):
        (flight,) = planted.fly_many(None, {}, seeds=[77], duration_s=8.0, gusts=2.0)
    runs = prepared(records(flight, "excitation_x", "excitation_y", "excitation_e"), (0.0, 15.0))
    bins = runs.viewed(TPP.inputs, TPP.outputs)
    model = estimate(TPP, bins).model
    return model, Noise.of(output_error(model, bins.stacks), bins.stacks, 30.0), bins.stacks


def left(model: Any, noise: Noise, stacks: Any) -> float:
    """The squares of what is new."""
    return sum(float(np.sum(block.left**2)) for block in _blocks(model, noise, stacks))


def test_the_gradient_is_what_differences_of_what_is_left_say(begun: Any) -> None:
    model, noise, stacks = begun
    here, n = Equations.at(model, noise, stacks), model.values.size
    draw = np.random.default_rng(1)
    for _ in range(4):
        along, size = draw.normal(size=noise.lags.shape), 1e-5
        ends = [left(model, replace(noise, lags=noise.lags + sign * size * along), stacks) for sign in (1, -1)]
        assert -0.5 * (ends[0] - ends[1]) / (2 * size) == pytest.approx(here.gradient[n:] @ along.ravel(), rel=1e-5)


def test_products_with_the_past_are_those_of_its_rows(begun: Any) -> None:
    model, noise, stacks = begun
    curvature, size = np.zeros((model.values.size + noise.lags.size,) * 2), noise.lags.size
    for block in _blocks(model, noise, stacks):
        past = block.past.combined(np.eye(size))
        np.testing.assert_allclose(block.past.among, past @ past.T, atol=1e-10 * np.max(np.abs(past @ past.T)))
        past = past - (past @ block.basis.T) @ block.basis
        whole = np.concatenate([block.slopes, past])
        curvature += whole @ whole.T
    found = Equations.at(model, noise, stacks).curvature
    unit = np.sqrt(np.diag(curvature))
    np.testing.assert_allclose(found / np.outer(unit, unit), curvature / np.outer(unit, unit), atol=1e-9)
