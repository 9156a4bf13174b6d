"""What gusts and gyro noise make of the commands: as flown, and what is foretold of gains that then fly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from more_of_a_kind import thorough

from sysid.control.command_noise import CommandNoise, Moved, RateDisturbance, rate_noise, servo_speed
from sysid.control.judgement import Limits, judge
from sysid.control.rate_gains import faster
from sysid.control.sampled import RateController
from sysid.data.record import FloatArray, Record
from sysid.model.compose import compose
from sysid.model.structure import Model
from sysid.rate_loop.linear import controller
from sysid.rate_loop.settings import AxisLoop

DT = 0.0025
LOOP = AxisLoop(p=0.135, i=0.135, d=0.0036, target_hz=20, derivative_hz=20, angle_p=4.5)
STRUCTURE = compose("multirotor", ())
VEHICLE = Model(STRUCTURE, STRUCTURE.vector({"L_p": -1.5, "M_q": -1.8, "L_lat": 90.0, "M_lon": 80.0, "tau_m": 0.035}))


def times(factor: float) -> RateController:
    loop = replace(LOOP, p=factor * LOOP.p, i=factor * LOOP.i, d=factor * LOOP.d)
    return RateController((loop, loop), DT, 20.0)


def hovered(law: RateController, seconds: float, seed: int) -> FloatArray:
    """(n, 4): measured p, q and both commands of the loop in time, disturbed by gusts and noise of every frequency."""
    rng = np.random.default_rng(seed)
    plant, board = law.vehicle(VEHICLE).system, controller(law.loops, DT, turns=True)
    x, state, gust = np.zeros(len(plant.A)), np.zeros(len(board.A)), np.zeros(2)
    filtered, kept = np.zeros((2, 2)), []
    w = np.tan(np.pi * 20.0 * DT)
    c = 1 + np.sqrt(2) * w + w**2
    b, a = w**2 / c * np.array([1, 2, 1]), np.array([2 * (w**2 - 1), 1 - np.sqrt(2) * w + w**2]) / c
    before, seen = np.zeros((2, 2)), np.zeros(2)
    for _ in range(round(seconds / DT)):
        gust = 0.98 * gust + 0.02 * rng.normal(size=2)
        disturbed = gust + 0.01 * rng.normal(size=2)
        rate = plant.C[2:] @ x + disturbed
        # the filter acts on what is disturbed, too: the plant's own has seen only the rest
        seen = b[0] * disturbed + b[1] * before[0] + b[2] * before[1] - a[0] * filtered[0] - a[1] * filtered[1]
        before, filtered = np.array([disturbed, before[0]]), np.array([seen, filtered[0]])
        measured = np.concatenate([np.zeros(2), plant.C[:2] @ x + seen, rate])
        command = board.C @ state + board.D @ measured
        state, x = board.A @ state + board.B @ measured, plant.A @ x + plant.B @ command
        kept.append([*rate, *command])
    return np.array(kept, dtype=np.float64)


def record(rows: FloatArray) -> Record:
    channels = dict(zip(("p", "q", "delta_x", "delta_y"), rows.T, strict=True))
    return Record("run", {"t": DT * np.arange(len(rows), dtype=np.float64), **channels}, maneuver="quiet")


def rms(rows: FloatArray, band_hz: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Of both commands and of their rates in a band, by Parseval."""
    f = np.fft.rfftfreq(len(rows), DT)
    inside = (f >= band_hz[0] - 0.125) & (f <= band_hz[1] + 0.125)
    power = 2 * np.abs(np.fft.rfft(rows[:, 2:], axis=0)[inside]) ** 2 / len(rows) ** 2
    step = np.abs(1 - np.exp(-2j * np.pi * f[inside] * DT))[:, None] / DT
    return np.sqrt(power.sum(axis=0)), np.sqrt((power * step**2).sum(axis=0))


@pytest.fixture(scope="module")
def noise() -> RateDisturbance:
    law = times(1.0)
    found = rate_noise([record(hovered(law, 80.0, 1))], law.vehicle(VEHICLE))
    assert found is not None
    return found


@pytest.mark.parametrize("factor", [0.4, *thorough([1.0, 2.5])])
def test_commands_move_as_foretold_from_another_gain_s_flight(noise: RateDisturbance, factor: float) -> None:
    law = times(factor)
    told = noise.commands(law, law.vehicle(VEHICLE))
    flown, fast = rms(hovered(law, 80.0, 2), told.band_hz)
    assert told.rms == pytest.approx(flown, rel=0.06)
    assert told.rate_rms == pytest.approx(fast, rel=0.06)


def test_commands_that_move_more_than_asked_make_gains_poor(noise: RateDisturbance) -> None:
    flown, new = (noise.commands(law, law.vehicle(VEHICLE)) for law in (times(1.0), times(1.3)))
    both = CommandNoise(own=new, flown=flown)
    assert both.times_flown is not None
    assert both.times_flown > 1.2
    models = [("fit", VEHICLE)]
    easy = Limits(noise=both.times_flown + 0.01)
    assert judge(times(1.3), models, easy, noise=both).verdict == "holds"  # type: ignore[arg-type]
    tight = judge(times(1.3), models, Limits(noise=1.1), noise=both)  # type: ignore[arg-type]
    assert tight.verdict == "poor"
    assert [one.quantity for one in tight.restless] == ["noise"]
    slow = replace(both, servo_speed=2.5 * max(both.own.rate_rms))
    assert [one.quantity for one in judge(times(1.3), models, easy, noise=slow).restless] == ["servos"]  # type: ignore[arg-type]


def test_new_gains_move_the_commands_no_more_than_asked(noise: RateDisturbance) -> None:
    flown = times(1.0)
    free = faster(flown, [VEHICLE], noise=noise)
    quiet = faster(flown, [VEHICLE], limits=Limits(noise=1.1), noise=noise)
    before, *after = (noise.commands(one, one.vehicle(VEHICLE)) for one in (flown, free.new, quiet.new))
    has = [CommandNoise(own=one, flown=before) for one in after]
    assert has[0].times_flown is not None
    assert has[1].times_flown is not None
    assert 1.1 < has[0].times_flown <= 1.3 + 1e-6
    assert has[1].times_flown <= 1.1 + 1e-6
    assert sum(flown.on(flown.vehicle(VEHICLE)).rejection_hz) < sum(quiet.new_loop.rejection_hz)


def test_a_servo_s_speed_is_the_slowest_that_a_model_knows() -> None:
    structure = compose("tpp", ("servo_rate_limit",))
    slow, fast = (
        Model(structure, structure.vector(dict.fromkeys(structure.names, 1.0) | {"rate": speed}))
        for speed in (2.0, 9.0)
    )
    assert servo_speed([VEHICLE, fast, slow]) == 2.0
    assert servo_speed([VEHICLE]) is None
    moved = Moved(rms=(0.1, 0.1), rate_rms=(0.5, 1.0), band_hz=(0.5, 90.0))
    assert CommandNoise(own=moved, flown=moved, servo_speed=2.0).of_servo_speed == 1.5


def test_runs_that_are_too_short_tell_nothing() -> None:
    law = times(1.0)
    assert rate_noise([record(hovered(law, 3.0, 1))], law.vehicle(VEHICLE)) is None
