"""Flights in a loop without a logged excitation: the vehicle, not the controller, or nothing at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import planted
import pytest
from planted_fits import controlled, records

from sysid.data.dataset import prepared
from sysid.errors import FitError
from sysid.fit import feedback, prediction_error
from sysid.fit.estimate import Estimate, estimate
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP
from sysid.model.structure import Model, Structure

EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
BAND = (0.0, 15.0)


def fly(*, seeds: range, loop: float, gusts: float, size: float) -> list[list[planted.Run]]:
    """Chirps of that part of the usual size, in gusts and with a controller of that part of the usual gain."""
    with controlled(loop, size):
        return planted.fly_many(None, {}, seeds=seeds, duration_s=15.0, gusts=gusts)


@pytest.fixture(scope="module")
def stormy() -> list[list[planted.Run]]:
    return fly(seeds=range(40, 43), loop=2.0, gusts=4.0, size=0.6)


@pytest.fixture(scope="module")
def fits(stormy: Sequence[Sequence[planted.Run]]) -> list[Fit]:
    return [identify(TPP, records(flight, *EXCITATIONS)) for flight in stormy]


TRUTH = np.array([planted.TABLE_4[name] for name in TPP.names])


def rms(found: Sequence[Estimate] | Sequence[Fit]) -> float:
    """Of what the values are off, in their standard errors."""
    return float(np.sqrt(np.mean([(one.model.values - TRUTH) ** 2 / np.diag(one.covariance) for one in found])))


def test_standard_errors_hold_in_a_strong_loop_without_the_excitation(
    stormy: Sequence[Sequence[planted.Run]], fits: Sequence[Fit]
) -> None:
    assert {fit.instrument for fit in fits} == {"prediction error"}
    assert 0.7 < rms(fits) < 1.3
    prepared_runs = [prepared(records(flight, *EXCITATIONS), BAND) for flight in stormy]
    before = [estimate(TPP, runs.viewed(TPP.inputs, TPP.outputs)) for runs in prepared_runs]
    assert {one.instrument for one in before} == {"commands"}
    assert rms(before) > 1.5 * rms(fits)


def test_the_fit_says_how_feedback_was_kept_out(fits: Sequence[Fit], tmp_path: Path) -> None:
    document = fits[0].to_json(tmp_path)
    assert document["instrument"] == "prediction error"
    assert Fit.from_json(document, tmp_path).instrument == "prediction error"
    assert Fit.from_json({**document, "instrument": "a hunch"}, tmp_path).instrument is None
    del document["instrument"]
    assert Fit.from_json(document, tmp_path).instrument is None


def test_held_parameters_stay(stormy: Sequence[Sequence[planted.Run]]) -> None:
    fit = identify(TPP, records(stormy[0], *EXCITATIONS), fixed={"tau_f": 0.09})
    assert fit.instrument == "prediction error"
    assert fit.model["tau_f"] == 0.09
    assert fit.standard_errors[TPP.names.index("tau_f")] == 0


def test_effects_with_a_delay_are_freed_of_feedback_too(stormy: Sequence[Sequence[planted.Run]]) -> None:
    fit = identify(compose("tpp"), records(stormy[1], *EXCITATIONS), effects=("transport_delay",))
    assert fit.instrument == "prediction error"
    assert fit.model["T_d"] < 0.006


def test_without_a_loop_there_is_nothing_to_predict() -> None:
    (flight,) = fly(seeds=range(1), loop=0.0, gusts=0.3, size=0.3)
    bins = prepared(records(flight, *EXCITATIONS), BAND).viewed(TPP.inputs, TPP.outputs)
    assert prediction_error.prediction_error(estimate(TPP, bins), bins) is None


def test_constant_weights_are_the_papers(stormy: Sequence[Sequence[planted.Run]]) -> None:
    fit = identify(TPP, records(stormy[0], *EXCITATIONS), weights="constant")
    assert (fit.instrument, fit.weights) == ("commands", "constant")


@pytest.fixture(scope="module")
def gusts_alone() -> list[planted.Run]:
    return fly(seeds=range(1), loop=2.0, gusts=2.0, size=0.0)[0]


@pytest.mark.parametrize("structure", [TPP, CD], ids=["tpp", "cd"])
def test_a_controller_is_not_taken_for_a_vehicle(gusts_alone: Sequence[planted.Run], structure: Structure) -> None:
    for without in ((), EXCITATIONS):
        with pytest.raises(FitError, match=r"feedback alone \(delta_x 100 %, delta_y 100 %"):
            identify(structure, records(gusts_alone, *without))


def test_nor_is_it_on_one_axis(gusts_alone: Sequence[planted.Run]) -> None:
    with pytest.raises(FitError, match=r"feedback alone \(delta_x \d+ % of their power"):
        identify(compose("roll"), records(gusts_alone, *EXCITATIONS))


def test_a_vehicle_that_follows_its_commands_is_no_controller() -> None:
    (flight,) = fly(seeds=range(1), loop=0.0, gusts=0.0, size=0.3)
    # quasi-steady: rates in step with the commands
    calm = [{**run, "p": 8 * run["delta_x"], "q": 6 * run["delta_y"]} for run in flight]
    bins = prepared(records(calm, *EXCITATIONS), BAND).viewed(TPP.inputs, TPP.outputs)
    assert np.min(feedback._fed_back(bins, TPP.base_.commands, 0.0)[0]) > feedback.ALONE
    feedback.refuse_feedback_alone(TPP, bins)


def test_a_step_to_a_bound_that_rounding_loses_ends_there(monkeypatch: pytest.MonkeyPatch) -> None:
    structure = compose("tpp", ["servo_rate_limit"])
    model = Model(structure, structure.vector({**dict(planted.TABLE_4), "rate": 1e16}))
    place = structure.names.index("rate")
    least = structure.parameters[place].bounds[0]
    move = np.zeros(model.values.size)
    move[place] = least - 1e16
    assert model.values[place] + move[place] == 0, "which has no response"
    tried: list[Model] = []
    here = SimpleNamespace(new=np.eye(2), samples=1, cost=0.0)

    def at(one: Model, *_: object) -> SimpleNamespace:
        tried.append(one)
        return here

    monkeypatch.setattr(prediction_error.Equations, "at", at)
    noise = prediction_error.Noise(np.zeros((1, 2, 2)), np.eye(2), 20.0)
    prediction_error.lower(model, noise, (), cast("Any", here), move, np.zeros((1, 2, 2)))
    assert tried[0]["rate"] == least
