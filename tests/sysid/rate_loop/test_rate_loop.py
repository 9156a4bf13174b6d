"""The rate loop against python-control and closed forms: what it does in time, and in small motion."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from sysid.rate_loop.linear import Discrete, axis_system, controller, taken_from_commands
from sysid.rate_loop.settings import LEAK, AxisLoop, Notch, low_pass
from sysid.rate_loop.simulate import Loops, simulate

DT = 0.0025
MULTI = AxisLoop(p=0.135, i=0.135, d=0.0036, target_hz=20, derivative_hz=20, i_max=0.5)
HELI = AxisLoop(
    p=0.06, i=0.105, d=0.001, ff=0.21, d_ff=0.002, target_hz=20, error_hz=20, i_max=0.4, leak_min=0.1, output_max=1.0
)
NOTCHED = replace(
    MULTI,
    error_hz=30,
    target_notch=Notch(frequency_hz=15, quality=2, attenuation_db=20),
    error_notch=Notch(frequency_hz=40, quality=1.5, attenuation_db=40),
)


def seen(target: np.ndarray, rate: np.ndarray, injected: float = 0.0) -> Loops:
    n = target.size
    return Loops(dt=np.full(n, DT), target=target, rate=rate, injected=np.full(n, injected))


def by_transfer_functions(loop: AxisLoop) -> control.TransferFunction:
    """The same law from python-control's blocks, in z, of target and rate to the output."""
    z = control.tf([1, 0], [1], DT)

    def low(hz: float) -> control.TransferFunction:
        a = low_pass(DT, hz)
        return a * z / (z - (1 - a))

    def notch(n: Notch | None) -> control.TransferFunction:
        if n is None:
            return control.tf([1], [1], DT)
        b, a = n.coefficients(DT)
        return control.tf(b, (1, *a), DT)

    slope = (z - 1) / (z * DT)
    feedback = (loop.p + loop.i * DT * z / (z - 1) + loop.d * low(loop.derivative_hz) * slope) * low(loop.error_hz)
    feedback = feedback * notch(loop.error_notch)
    target = low(loop.target_hz) * notch(loop.target_notch)
    return (feedback + loop.ff + loop.d_ff * slope) * target, -feedback


@pytest.mark.parametrize("loop", [MULTI, HELI, NOTCHED])
def test_the_small_motion_system_is_what_python_control_makes_of_its_blocks(loop: AxisLoop) -> None:
    f = np.geomspace(0.05, 180, 60)
    system = axis_system(loop, DT)
    ours = system.response(f)[:, 0]
    judged = control.ss(system.A, system.B, system.C, system.D, DT)
    z = np.exp(2j * np.pi * f * DT)
    for column, block in enumerate(by_transfer_functions(loop)):
        theirs = np.array([block(at) for at in z])
        assert ours[:, column] == pytest.approx(theirs, rel=1e-6)
        assert np.array([judged(at)[0, column] for at in z]) == pytest.approx(theirs, rel=1e-6)


@pytest.mark.parametrize("loop", [MULTI, HELI, NOTCHED])
def test_in_time_it_does_what_its_small_motion_says(loop: AxisLoop) -> None:
    rng = np.random.default_rng(3)
    target, rate = 0.01 * rng.normal(size=(2, 800))
    target[0] = rate[0] = 0.0  # at rest, as the linear system begins
    in_time = simulate(loop, seen(target, rate)).output
    system = axis_system(loop, DT)
    x, linear = np.zeros(len(system.A)), []
    for u in np.stack([target, rate], axis=1):
        linear.append((system.C @ x + system.D @ u)[0])
        x = system.A @ x + system.B @ u
    assert in_time == pytest.approx(np.array(linear), abs=1e-12)


def test_a_notch_leaves_what_its_attenuation_says() -> None:
    notch = Notch(frequency_hz=25, quality=2, attenuation_db=30)
    b, a = notch.coefficients(DT)
    z = np.exp(2j * np.pi * np.array([25.0, 0.01]) * DT)
    gain = np.abs((b[0] + b[1] / z + b[2] / z**2) / (1 + a[0] / z + a[1] / z**2))
    assert 20 * math.log10(gain[0]) == pytest.approx(-30, abs=1e-6)
    assert gain[1] == pytest.approx(1, abs=1e-6)


def test_the_attitude_is_closed_through_the_rates_one_loop_later() -> None:
    angle = replace(HELI, angle_p=4.5)
    w = 2 * np.pi * 0.5
    z = np.exp(1j * w * DT)
    (with_angle,) = axis_system(angle, DT).response(np.array([0.5]))
    (without,) = axis_system(HELI, DT).response(np.array([0.5]))
    attitude = DT / (z - 1)  # what stood there before this loop's rate was added
    assert with_angle[0, 1] == pytest.approx(without[0, 1] - 4.5 * attitude * without[0, 0])
    assert with_angle[0, 0] == pytest.approx(without[0, 0])


def test_both_axes_stand_beside_each_other() -> None:
    f = np.array([0.3, 2.0, 9.0])
    both = controller((MULTI, HELI), DT).response(f)
    assert both.shape == (3, 2, 4)
    assert both[:, 0, [0, 2]] == pytest.approx(axis_system(MULTI, DT).response(f)[:, 0])
    assert both[:, 1, [1, 3]] == pytest.approx(axis_system(HELI, DT).response(f)[:, 0])
    assert not np.any(both[:, 0, [1, 3]])
    assert not np.any(both[:, 1, [0, 2]])
    taken = taken_from_commands((MULTI, HELI), DT, f)
    assert taken[:, 0, 0].real[0] > 0, "feedback takes away from the command"
    hold = (1 - np.exp(-2j * np.pi * f * DT)) / (2j * np.pi * f * DT)
    assert taken[:, 0, 0] == pytest.approx(-both[:, 0, 2] * hold)


def test_the_integrator_leaks_only_beyond_its_minimum_and_stays_below_its_maximum() -> None:
    n = 4000
    at_rest = seen(np.zeros(n), np.zeros(n))
    told = np.full(n, 0.3)
    leaked = simulate(replace(HELI, output_max=math.inf), at_rest, output=told).integrator
    assert leaked[0] == pytest.approx(0.3)
    assert leaked[1] == pytest.approx(0.3 - LEAK * 0.2)
    assert leaked[-1] == pytest.approx(0.1, abs=1e-9)
    assert np.all(simulate(replace(HELI, leak_min=None), at_rest, output=told).integrator == pytest.approx(0.3))
    wound = simulate(replace(HELI, leak_min=None, output_max=math.inf), seen(np.zeros(n), np.full(n, -3.0)))
    assert wound.integrator.max() == 0.4


def test_a_limited_output_lets_the_integrator_shrink_but_not_grow() -> None:
    n = 400
    rate = np.where(np.arange(n) < 200, -1.0, 1.0)  # the error is the other way in the second half
    wound = simulate(replace(HELI, leak_min=None), seen(np.zeros(n), rate, injected=2.0))
    assert wound.output[:150] == pytest.approx(1.0)
    assert wound.integrator[1:150] == pytest.approx(wound.integrator[0])
    assert wound.integrator[-1] < 0.01
    assert wound.limited >= 150


def test_p_and_d_together_stay_within_theirs() -> None:
    loop = AxisLoop(p=1.0, i=0.0, d=0.1, pd_max=0.2, ff=0.5, derivative_hz=20)
    n = 50
    out = simulate(loop, seen(np.full(n, 1.0), np.zeros(n)))
    assert out.output == pytest.approx(0.2 + 0.5)
    assert out.limited == n


def test_the_integrator_can_begin_where_the_output_says() -> None:
    rng = np.random.default_rng(5)
    n = 2000
    target, rate = np.cumsum(rng.normal(size=(2, n)) * 0.01, axis=1)
    truth = simulate(replace(MULTI, i_max=10.0), seen(target, rate))
    at = seen(target[500:], rate[500:])
    again = simulate(replace(MULTI, i_max=10.0), at, began=800, output=truth.output[500:])
    assert again.output[800:] == pytest.approx(truth.output[1300:], abs=1e-9)
    with pytest.raises(ValueError, match="loop 1500"):
        simulate(MULTI, at, began=1500, output=truth.output[500:])


def test_it_is_a_system_of_the_fields_standard_library() -> None:
    system = axis_system(HELI, DT)
    assert isinstance(system, Discrete)
    judged = control.ss(*system)
    assert judged.dt == DT
    assert judged.ninputs == 2
