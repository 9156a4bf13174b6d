"""A rate loop in small motion: a discrete linear system, and what it answers at a frequency.

Limits and the slew limit are not in it, and the integrator does not leak (it leaks only beyond ILMI). The attitude is
what the rates integrate to, before the filter that the loops' own rates are behind where these are told apart; and what
the attitude asks for is followed by the next loop, as on board.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.data.record import FloatArray
from sysid.rate_loop.settings import AxisLoop, Notch, low_pass


class Discrete(NamedTuple):
    """x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k], in steps of dt seconds."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    dt: float

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """(f, outputs, inputs). Raises LinAlgError at a pole on the unit circle, as an integrator has at 0 Hz."""
        z = np.exp(2j * np.pi * np.asarray(frequency_hz) * self.dt)
        inside = np.linalg.solve(z[:, None, None] * np.eye(len(self.A)) - self.A, self.B[None].astype(complex))
        return np.asarray(self.C @ inside + self.D)


def axis_system(loop: AxisLoop, dt: float, *, turns: bool = False) -> Discrete:
    """One axis: of target and rate, rad/s, to the output, full command.

    The output is that of the loop that measured the rate: it is held from then on until the next. With `turns` a third
    input is the rate that the attitude is the integral of; else it is the same rate.
    """
    signals = _Signals(3 if turns else 2)
    target, rate = signals.input(0), signals.input(1)
    turn = signals.input(2) if turns else rate
    attitude = signals.state()
    if loop.angle_p:
        target = target - loop.angle_p * attitude.now
    attitude.becomes(attitude.now + dt * turn)
    T = signals.state()
    target_now = T.now + low_pass(dt, loop.target_hz) * (_behind(signals, loop.target_notch, target, dt) - T.now)
    E = signals.state()
    error = _behind(signals, loop.error_notch, target_now - rate, dt)
    error_now = E.now + low_pass(dt, loop.error_hz) * (error - E.now)
    D = signals.state()
    derivative = D.now + low_pass(dt, loop.derivative_hz) * ((error_now - E.now) / dt - D.now)
    integrator = signals.state()
    integrated = integrator.now + loop.i * dt * error_now
    output = loop.p * error_now + loop.d * derivative + integrated + loop.ff * target_now
    output = output + loop.d_ff / dt * (target_now - T.now)
    for state, after in ((T, target_now), (E, error_now), (D, derivative), (integrator, integrated)):
        state.becomes(after)
    return signals.system(output, dt)


def controller(loops: tuple[AxisLoop, AxisLoop], dt: float, *, turns: bool = False) -> Discrete:
    """Both axes: of targets of roll and pitch, then rates p and q, to delta_x and delta_y; inputs (4), outputs (2).
    With `turns` two more inputs, of `axis_system`.

    Its feedback is positive: the rates enter as they are, and what they cause has the sign that it has on board.
    """
    roll, pitch = (axis_system(loop, dt, turns=turns) for loop in loops)
    n, m, k = len(roll.A), len(pitch.A), 2 * roll.B.shape[1]
    A, B, C, D = np.zeros((n + m, n + m)), np.zeros((n + m, k)), np.zeros((2, n + m)), np.zeros((2, k))
    for axis, one, states in ((0, roll, slice(0, n)), (1, pitch, slice(n, n + m))):
        inputs = list(range(axis, k, 2))
        A[states, states] = one.A
        B[states, inputs] = one.B
        C[axis, states] = one.C[0]
        D[axis, inputs] = one.D[0]
    return Discrete(A, B, C, D, dt)


def taken_from_commands(loops: tuple[AxisLoop, AxisLoop], dt: float, frequency_hz: FloatArray) -> ComplexArray:
    """What the loops take from the commands per rate, C(j w) with u = -C y, (f, 2, 2): the convention of
    `sysid.control.stability.from_rates`. The hold until the next loop is in it, so that it joins a continuous model.
    """
    f = np.asarray(frequency_hz, dtype=float)
    held = np.sinc(f * dt) * np.exp(-1j * np.pi * f * dt)
    return np.asarray(-controller(loops, dt).response(f)[:, :, 2:] * held[:, None, None])


class _State:
    """A value that is kept from loop to loop, as a row over all states and inputs."""

    def __init__(self, now: FloatArray) -> None:
        self.now = now
        self.after = now

    def becomes(self, after: FloatArray) -> None:
        self.after = after


class _Signals:
    """Signals as rows over states and inputs: what is linear in them is written down as it is computed on board."""

    MOST = 16
    """States there is room for."""

    def __init__(self, inputs: int) -> None:
        self._inputs = inputs
        self._states: list[_State] = []

    def input(self, number: int) -> FloatArray:
        row = np.zeros(self.MOST + self._inputs)
        row[self.MOST + number] = 1
        return row

    def state(self) -> _State:
        row = np.zeros(self.MOST + self._inputs)
        row[len(self._states)] = 1
        self._states.append(_State(row))
        return self._states[-1]

    def system(self, output: FloatArray, dt: float) -> Discrete:
        """Without states that do not act on the output, as an attitude that nobody asks for."""
        rows = np.array([state.after for state in self._states])
        n = len(rows)
        A, B, C, D = rows[:, :n], rows[:, self.MOST :], output[None, :n], output[None, self.MOST :]
        seen = np.any(C != 0, axis=0)
        for _ in range(n):
            seen |= np.any(A[seen] != 0, axis=0)
        return Discrete(A[np.ix_(seen, seen)], B[seen], C[:, seen], D, dt)


def _behind(signals: _Signals, notch: Notch | None, x: FloatArray, dt: float) -> FloatArray:
    """A signal behind a notch, in its transposed form: two states."""
    if notch is None:
        return x
    (b0, b1, b2), (a1, a2) = notch.coefficients(dt)
    first, second = signals.state(), signals.state()
    y = b0 * x + first.now
    first.becomes(b1 * x - a1 * y + second.now)
    second.becomes(b2 * x - a2 * y)
    return y
