"""Entries planted by integrators of other hands are named, or in a declared class of at most three.

Each is asked among those that come nearest to it; among the whole catalogue by `make study`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import planted
import pytest
from planted import PLANTED, fly_many
from planted_fits import UNLOGGED, records

from sitl.plants.stock import Quadrotor, make_stock_plant
from sysid.data.airframe import Airframe
from sysid.data.record import Record
from sysid.diagnose.candidates import SIGNIFICANT
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.score import log_chance
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.identify import on_runs

SECONDS = 10.0
LONGER = {"gyro_filter": 16.0}
"""In less it is not told from a delay."""
LATE = ("gyro_lag", "motor_lag", "servo_lag", "servo_second_order", "transport_delay")
SIZES: Mapping[str, Mapping[str, float]] = {**PLANTED, "cubic_damping": {"L_pp": -3.0, "M_qq": -6.0, "exponent": 3.0}}
NAMED = {
    "gyro_filter": ("gyro_filter", {"servo_second_order"}),
    "cubic_damping": ("quadratic_damping", set[str]()),
    "stabiliser_bar": ("stabiliser_bar", set[str]()),
    "lead_lag": ("lead_lag", set[str]()),
    "slipstream_wing": ("slipstream_wing", set[str]()),
    "governor": ("governor", set[str]()),
    "lag_per_axis": ("lag_per_axis", set[str]()),
    "servo_acceleration_limit": ("servo_acceleration_limit", set[str]()),
}
"""What flew -> its entry, and what no flight of these channels tells from it."""
RIVALS = {
    "gyro_filter": (*LATE, "gyro_filter"),
    "cubic_damping": ("angular_damping", "quadratic_damping"),
    "stabiliser_bar": ("angular_damping", "dynamic_inflow", "hub_gyroscopics", "stabiliser_bar"),
    "lead_lag": ("dynamic_inflow", "lead_lag", "structural_mode", "transport_delay"),
    "slipstream_wing": ("angle_of_attack", "angular_damping", "attitude_stiffness", "slipstream_wing"),
    "governor": ("angular_damping", "governor", "input_coupling"),
    "lag_per_axis": (*LATE, "lag_per_axis", "slipstream_wing"),
    "servo_acceleration_limit": ("servo_lag", "lag_per_axis", "servo_rate_limit", "servo_acceleration_limit"),
}
OF_EACH_KIND = ("gyro_filter", "cubic_damping", "slipstream_wing", "servo_acceleration_limit")
"""A lag, one that is not linear, a lagged moment, and one that acts on samples: `make study` asks the others too."""
COLLECTIVE = 0.2
"""Standard deviation of a collective that is stirred: the usual one shows no governor."""


def flown(flight: str, monkeypatch: pytest.MonkeyPatch) -> list[Record]:
    if flight == "governor":
        monkeypatch.setattr(planted, "COLLECTIVE", COLLECTIVE)
    entry = NAMED[flight][0]
    runs = fly_many(entry, SIZES[flight], seeds=[31], duration_s=LONGER.get(flight, SECONDS))[0]
    return records(runs, *UNLOGGED.get(entry, ()))


def judged(flight: list[Record], base: str = "tpp") -> Diagnosis:
    return diagnose(on_runs(base, (), flight, flight), flight)


def named(flight: str, found: Diagnosis) -> None:
    entry, alike = NAMED[flight]
    assert found.verdict == "missing"
    assert {found.effect, *found.not_told} == {entry, *alike}
    assert found.effect == entry
    winner = next(one for one in found.candidates if one.effect == entry)
    for name, value in SIZES[flight].items():
        assert winner.values[name] == pytest.approx(value, abs=4 * winner.standard_errors[name]), name


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize(
    ("only_effects", "flight"),
    [
        pytest.param(rivals, flight, id=flight, marks=[] if flight in OF_EACH_KIND else pytest.mark.thorough)
        for flight, rivals in RIVALS.items()
    ],
    indirect=["only_effects"],
)
def test_it_is_named_among_those_that_come_nearest(flight: str, monkeypatch: pytest.MonkeyPatch) -> None:
    named(flight, judged(flown(flight, monkeypatch)))


@pytest.mark.thorough
@pytest.mark.parametrize("flight", NAMED)
def test_it_is_named_among_the_whole_catalogue(flight: str, monkeypatch: pytest.MonkeyPatch) -> None:
    named(flight, judged(flown(flight, monkeypatch)))


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_filter", *LATE)], indirect=True)
def test_a_filter_that_the_log_tells_of_is_applied_and_not_fitted() -> None:
    runs = fly_many("gyro_filter", {"corner": 20.0, "zeta": math.sqrt(0.5)}, seeds=[31], duration_s=SECONDS)[0]
    told = [
        Record(one.id, one.channels, rate_source="RATE", vehicle={"INS_GYRO_FILTER": "20"}) for one in records(runs)
    ]
    found = judged(told)
    assert (found.verdict, found.effect) == ("missing", "gyro_filter")
    assert found.winner is not None
    assert found.winner.added == 0
    free = judged(records(runs)).winner
    assert free is not None
    assert found.winner.fit is not None
    left = found.winner.fit.division
    assert log_chance(left.chi_squared, left.degrees) > SIGNIFICANT, "as it is told, it leaves noise"
    assert found.winner.chi_squared > 0.99 * free.chi_squared


def motors(seed: int) -> list[Record]:
    """The stock quadrotor of the simulator, steered open loop by chirps; its motors lag by 35 ms."""
    dt, seconds = 0.0025, 10.0
    t: planted.Array = np.linspace(0.0, seconds, round(seconds / dt), endpoint=False)
    rng = np.random.default_rng(seed)
    found: list[Record] = []
    for axis in ("roll", "pitch") * 2:
        plant = make_stock_plant("quad", seed, dt)
        assert isinstance(plant, Quadrotor)
        chirp = 0.05 * np.sin(2 * np.pi * (0.5 * t + 9.5 * t**2 / (2 * seconds)))
        # an attitude controller's part, without which the chirp would turn it over
        channels: dict[str, planted.Array] = {name: np.zeros(t.size) for name in ("p", "q", "delta_x", "delta_y")}
        for k in range(t.size):
            added = (chirp[k], 0.0) if axis == "roll" else (0.0, chirp[k])
            channels["p"][k], channels["q"][k] = (plant.p, plant.q) + 0.004 * rng.standard_normal(2)
            channels["delta_x"][k] = added[0] - 0.06 * plant.phi - 0.02 * channels["p"][k]
            channels["delta_y"][k] = added[1] - 0.06 * plant.theta - 0.02 * channels["q"][k]
            plant.step(channels["delta_x"][k], channels["delta_y"][k], 0.0, 0.0)
        channels["excitation_x"], channels["excitation_y"] = (
            chirp if axis == "roll" else 0 * t,
            chirp if axis == "pitch" else 0 * t,
        )
        found.append(Record(f"#{len(found) + 1}", {"t": t, **channels}, airframe=Airframe.MULTIROTOR))
    return found


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [LATE], indirect=True)
def test_a_quadrotor_s_motors_are_named_as_motors() -> None:
    flight = motors(3)
    found = judged(flight, "cd")
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert set(found.not_told) <= {"gyro_lag"}
    assert found.winner is not None
    error = found.winner.standard_errors["tau_m"]
    assert found.winner.values["tau_m"] == pytest.approx(0.035, abs=4 * error)
    assert error < 0.002
    assert next(one for one in found.candidates if one.effect == "servo_lag").not_offered
    unknown = [Record(one.id, one.channels) for one in flight]
    assert {one.effect for one in judged(unknown, "cd").candidates} == set(LATE) - {"motor_lag"}
