"""What commands do between the samples of a log slower than the loop, where play and dead bands follow every move."""

from __future__ import annotations

import numpy as np
from planted import DT, _Actuators

from sysid.data.preprocess import Segment, spectra
from sysid.data.record import FloatArray, Record
from sysid.effects import servo_backlash

EVERY = 4
"""Loops in a sample: 125 Hz of a loop of 500."""
HALF = 0.009


def logged(command: FloatArray) -> Segment:
    """A log of every so many samples of a command, (n,)."""
    t = DT * np.arange(command.size)
    few = slice(None, None, EVERY)
    zero = np.zeros_like(t)
    channels = {"t": t, "p": zero, "q": zero, "delta_x": command, "delta_y": zero}
    record = Record("one", {name: values[few] for name, values in channels.items()}, loop_dt_s=DT)
    return spectra([record], ["delta_x", "delta_y"], ["p", "q"], (0.5, 10.0))[0][0].segment


def played(command: FloatArray) -> FloatArray:
    """(n,), where play leaves the servo: by the independent simulator."""
    servos = _Actuators("servo_backlash", {"half_width": HALF}, np.array([command[0]]))
    return np.array([servos.pieces(np.array([one]), 1)[0][1][0] for one in command])


def test_play_does_not_follow_a_spline_beyond_the_steps_of_a_doublet() -> None:
    """The command creeps on between its steps, as a loop moves it."""
    t = DT * np.arange(6000)
    size = np.where((t > 3.0) & (t < 4.0), 0.08, 0.0) - np.where((t >= 4.0) & (t < 5.0), 0.08, 0.0)
    command = size + 0.002 * np.sin(2 * np.pi * 0.3 * t)
    segment = logged(command)
    found = servo_backlash.samples(segment.as_held(["delta_x"]).copy(), segment.loop_dt, {"half_width": HALF})[0]
    true = played(command)
    steps = (3.0, 4.0, 5.0)
    rest = np.all([np.abs(t - step) > 2 * EVERY * DT for step in steps], axis=0)[: found.size]
    assert np.max(np.abs(found - true[: found.size])[rest]) < 0.02 * HALF
    assert np.max(found) < np.max(true) + 0.02 * HALF
    assert np.min(found) > np.min(true) - 0.02 * HALF


def test_a_chirp_keeps_its_turns_between_samples() -> None:
    """At 10 Hz, 12 samples a turn: straight lines between them would miss 3 % of it."""
    t = DT * np.arange(6000)
    command = 0.1 * np.sin(2 * np.pi * (0.5 * t + 0.4 * t * t))
    segment = logged(command)
    held = segment.as_held(["delta_x"])[0]
    inside = slice(50, held.size - 50)
    assert np.max(np.abs(held - command[: held.size])[inside]) < 2e-3 * 0.1
