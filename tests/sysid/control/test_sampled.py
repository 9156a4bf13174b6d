"""A vehicle under rate loops, loop by loop: against finer steps, against what is flown, and at its own edges."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from helicopter_loops import HELI, PITCH, ROLL, heli
from scipy.signal import cont2discrete

from sitl.autopilot.vehicle import make_vehicle
from sitl.plants.stock import QUAD
from sysid.control.robustness import disk_sizes
from sysid.control.sampled import NotSampledError, RateController, sampled_loop, sampled_plant
from sysid.control.stability import rates_per_command
from sysid.model.compose import compose
from sysid.model.effect import load
from sysid.model.structure import Model
from sysid.rate_loop.settings import AxisLoop

DT = 0.0025
STOCK_QUAD = AxisLoop(p=0.135, i=0.135, d=0.0036, target_hz=20, derivative_hz=20, angle_p=4.5)


def quad() -> Model:
    """What the simulated quadrotor is made of."""
    structure = compose("multirotor", ())
    names = {"L_p": QUAD.L_p, "M_q": QUAD.M_q, "L_lat": QUAD.L_lat, "M_lon": QUAD.M_lon, "tau_m": QUAD.tau}
    return Model(structure, structure.vector(names))


def times(loop: AxisLoop, factor: float) -> AxisLoop:
    """All that feeds back, of rate and of attitude, by a factor."""
    return replace(loop, **{name: factor * getattr(loop, name) for name in ("p", "i", "d", "ff", "d_ff")})


@pytest.mark.parametrize("late_s", [0.0, 0.0073, 0.0075, 0.0508])
def test_the_plant_is_what_finer_steps_make_of_it(late_s: float) -> None:
    vehicle = heli(T_d=late_s)
    fine = 1e-4
    A, B, C, D = (np.asarray(x) for x in vehicle.matrices)
    Af, Bf, *_ = cont2discrete((A, B, C, D), fine)
    commands = np.random.default_rng(2).normal(size=(200, 2))
    plant = sampled_plant(vehicle, DT).system
    x, state, ours, theirs = np.zeros(len(plant.A)), np.zeros(len(A)), [], []
    each, late = round(DT / fine), round(late_s / fine)
    for k, u in enumerate(commands):
        ours.append(plant.C @ x)
        x = plant.A @ x + plant.B @ u
        theirs.append(C @ state)
        for step in range(each):
            at = k * each + step - late
            state = Af @ state + Bf @ (commands[at // each] if at >= 0 else np.zeros(2))
    assert np.array(ours) == pytest.approx(np.array(theirs), abs=1e-8 * np.abs(theirs).max())


def test_it_answers_as_the_vehicle_does_in_continuous_time() -> None:
    vehicle, f = heli(), np.array([0.5, 2.0, 8.0])
    held = np.sinc(f * DT) * np.exp(-1j * np.pi * f * DT)
    plant = sampled_plant(vehicle, DT)
    ours = plant.response(f)
    assert plant.loops_late == 20
    assert ours == pytest.approx(plant.system.response(f), rel=1e-9)
    assert ours == pytest.approx(rates_per_command(vehicle, 2j * np.pi * f) * held[:, None, None], rel=2e-3)
    w = 2 * np.pi * 20.0
    s = 2j * np.pi * f
    gyro = w**2 / (s**2 + math.sqrt(2) * w * s + w**2)
    behind = sampled_plant(vehicle, DT, gyro_corner_hz=20.0).response(f)
    assert behind == pytest.approx(ours * gyro[:, None, None], rel=5e-3)


@pytest.mark.parametrize("flown", [True, False])
def test_margins_are_where_the_loop_s_own_poles_leave_the_circle(flown: bool) -> None:
    loops = (ROLL, PITCH) if flown else (times(ROLL, 0.6), times(PITCH, 0.6))
    loop = sampled_loop(loops, DT, heli(), gyro_corner_hz=20.0)
    assert loop.margins is not None, "it flew"
    for part, held in ((0.98, True), (1.02, False)):
        gain = 10 ** (part * loop.margins.gain_db / 20)
        more = (times(loops[0], gain), times(loops[1], gain))
        assert sampled_loop(more, DT, heli(), gyro_corner_hz=20.0).held == held
        late = heli(T_d=HELI["T_d"] + part * loop.margins.delay_s)
        assert sampled_loop(loops, DT, late, gyro_corner_hz=20.0).held == held


def test_less_gain_rejects_less_and_leaves_more_margin() -> None:
    whole = sampled_loop((STOCK_QUAD, STOCK_QUAD), DT, quad(), gyro_corner_hz=20.0)
    half = sampled_loop((times(STOCK_QUAD, 0.5), times(STOCK_QUAD, 0.5)), DT, quad(), gyro_corner_hz=20.0)
    assert whole.margins is not None
    assert half.margins is not None
    assert half.margins.gain_db == pytest.approx(whole.margins.gain_db + 20 * math.log10(2), abs=0.01)
    assert half.rejection_hz[0] < whole.rejection_hz[0]
    assert half.rejection_hz[1] < whole.rejection_hz[1]
    assert not whole.drifts


def test_the_simulated_quadrotor_flies_below_its_gain_margin_and_not_above() -> None:
    """What flies it was written without any of this."""
    loop = sampled_loop((STOCK_QUAD, STOCK_QUAD), DT, quad(), gyro_corner_hz=20.0)
    assert loop.margins is not None
    edge = 10 ** (loop.margins.gain_db / 20)
    largest = []
    for factor in (0.85 * edge, 1.2 * edge):
        settings = {
            f"ATC_RAT_{axis}_{name}": factor * value
            for axis in ("RLL", "PIT")
            for name, value in (("P", 0.135), ("I", 0.135), ("D", 0.0036))
        }
        vehicle = make_vehicle("quad", 5, parameters=settings, like="ardupilot-quad")
        commands = []
        for _ in range(round(8 / vehicle.dt)):
            vehicle.step()
            commands.append(max(map(abs, vehicle.commands[:2])))
        largest.append(max(commands[len(commands) // 2 :]))
    assert largest[0] < 0.9
    assert largest[1] == 1.0, "it oscillates up to the limit of its commands"


def test_what_is_more_than_a_delay_is_refused(tmp_path: Path) -> None:
    effect = tmp_path / "smeared.py"
    source = Path(__file__).parents[3] / "sysid" / "effects" / "transport_delay.py"
    text = source.read_text("utf-8").replace('np.exp(-s * parameters["T_d"])', '1 / (1 + s * parameters["T_d"])')
    effect.write_text(text.replace('id="transport_delay"', 'id="smeared"'), "utf-8")
    structure = compose("tpp", (load(effect),))
    with pytest.raises(NotSampledError, match="more than a delay"):
        sampled_plant(Model(structure, structure.vector(HELI)), DT)


def test_disk_bandwidth_and_rejection_are_control_s() -> None:
    """python-control's discrete loops and sensitivities, and SLICOT's disk where it is there."""
    vehicle = heli(T_d=0.010)
    law = RateController((ROLL, PITCH), DT)
    found = law.robustness(vehicle)
    plant, feedback = (
        control.ss(one.A, one.B, one.C, one.D, DT) for one in (law.vehicle(vehicle).system, law.feedback)
    )
    w = 2 * np.pi * np.geomspace(0.02, 0.4999 / DT, 3000)
    both = np.vstack([np.eye(2), np.eye(2)])  # as measured, and as they turn: without a filter the same
    loop = plant * feedback
    left = control.feedback(control.ss([], [], [], np.eye(4), DT), loop, sign=1)(np.exp(1j * w * DT))
    left = np.einsum("ij,jkf->ikf", 0.5 * both.T, np.einsum("ijf,jk->ikf", left, both))
    for k, one in enumerate(found.handling):
        size = 20 * np.log10(np.abs(left[k, k]))
        assert one.rejection_peak_db == pytest.approx(size.max(), abs=1e-3)
        at = int(np.flatnonzero(size > -3)[0])
        assert one.rejection_hz == pytest.approx(w[at] / (2 * np.pi), rel=3e-3)
    L = -feedback * plant
    sizes = disk_sizes(np.moveaxis(np.asarray(L(np.exp(1j * w * DT))), -1, 0))
    assert found.disk.size == pytest.approx(sizes.min(), rel=1e-3)
    edges = law.edges(vehicle)
    assert edges.margins == law.held(vehicle).margins
    assert edges.gain_hz is not None
    values = np.linalg.eigvals(L(np.exp(2j * np.pi * edges.gain_hz * DT)))
    nearest = values[np.argmin(np.abs(np.angle(-values)))]
    assert -20 * math.log10(abs(nearest)) == pytest.approx(edges.margins.gain_db, abs=0.02)


def test_what_a_controller_takes_joins_a_continuous_model() -> None:
    law, vehicle, f = RateController((ROLL, PITCH), DT, 20.0), heli(), np.array([0.5, 2.0, 8.0])
    joined = law.from_rates(f) @ rates_per_command(vehicle, 2j * np.pi * f)
    ours = law.transfer(law.vehicle(vehicle), 2 * np.pi * f)
    assert joined == pytest.approx(ours, rel=8e-3)
