"""The LQR with a dynamic prefilter, and in forward flight with the elevator: fitted, designed, committed, flown, and as
predicted. In still air, so that one doublet tells; the fit is from gusty chirps.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from flying import CHIRP, ELEVATOR, PITCH, ROLL, fly_maneuver, log_of
from more_of_a_kind import thorough
from rate_flights import Answered, answered, commit, fly_doublets

from gcs.logs import resolve_runs
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.plants.forward import ForwardPlant
from sitl.plants.hover import Gusts
from sysid.control.decoupling import decoupled
from sysid.control.regulator import Gains, design
from sysid.fit.identify import identify
from sysid.model.paper import TPP
from sysid.model.structure import Model

CHIRPS = {"hover-ideal": [(ROLL, 0.10), (PITCH, 0.15)], "forward": [(ROLL, 0.10), (PITCH, 0.15), (ELEVATOR, 0.30)]}
EFFECTS = {"hover-ideal": (), "forward": ("angular_damping", "elevator")}
LEAST_NRMSE = 85.0


@cache
def fitted(plant: str) -> Model:
    with TemporaryDirectory() as folder:
        vehicle = make_vehicle(plant, seed=6, directory=Path(folder))
        for axis, magnitude in CHIRPS[plant]:
            fly_maneuver(vehicle, CHIRP, axis, magnitude, 15.0)
        return identify(TPP, resolve_runs([str(log_of(vehicle, Path(folder)))]), effects=EFFECTS[plant]).model


def in_still_air(plant: str, folder: Path | None = None) -> Vehicle:
    if plant == "forward":
        return Vehicle(ForwardPlant(Gusts(0.0, 0.0, 1.5), 9), seed=9, directory=folder, name=plant, on_ground=True)
    return make_vehicle(plant, seed=9, directory=folder, on_ground=True, gust_scale=0.0)


def flown(plant: str, gains: Gains, folder: Path) -> tuple[Answered, Answered]:
    folder.mkdir()
    vehicle = in_still_air(plant, folder)
    commit(vehicle, gains)
    (roll,), (pitch,) = fly_doublets(vehicle, folder)
    return roll, pitch


@pytest.mark.parametrize(
    ("plant", "elevator"), [("hover-ideal", False), *thorough([("forward", False), ("forward", True)])]
)
def test_rates_are_followed_as_predicted_and_the_other_axis_is_left_alone(
    plant: str, elevator: bool, tmp_path: Path
) -> None:
    model = fitted(plant)
    steady = design(model, elevator=elevator)
    coupled = {}
    for name, gains in (("steady", steady), ("dynamic", decoupled(steady, [model]))):
        answers = flown(plant, gains, tmp_path / name)
        for axis, one in enumerate(answers):
            predicted = Answered(axis, one.asked, answered(gains, model, one.asked))
            own, told = one.rates[:, axis], predicted.rates[:, axis]
            nrmse = 100 * (1 - np.linalg.norm(own - told) / np.linalg.norm(own - own.mean()))
            assert nrmse > LEAST_NRMSE, (name, axis)
            assert one.rise_s == pytest.approx(predicted.rise_s, rel=0.15), (name, axis)
            assert one.coupling == pytest.approx(predicted.coupling, abs=0.05), (name, axis)
        coupled[name] = max(one.coupling for one in answers)
    assert coupled["steady"] > 0.35
    assert coupled["dynamic"] < 0.13
    if elevator:
        assert coupled["dynamic"] < 0.06, "three commands turn two rates without a remainder"


def test_the_elevator_takes_a_share_of_pitch() -> None:
    gains = design(fitted("forward"), elevator=True)
    assert gains.K.shape == (3, 4)
    steady = gains.prefilter
    assert abs(steady[2, 1]) > 0.1
    vehicle = in_still_air("forward")
    commit(vehicle, gains)
    assert vehicle.take_off() is None
    for _ in range(4000):
        vehicle.step()
    assert vehicle.select_lqr(True) is None
    vehicle.plant.q = 0.2
    vehicle.step()
    vehicle.step()
    assert vehicle.commands[2] * gains.K[2, 1] < 0, "it works against the rate"
