"""Flights of the printed models, answered without a vehicle: what the tables must give back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gcs.paper.forward import ForwardFlight, printed_model
from gcs.paper.hover import HoverFlight
from gcs.paper.rows import PRINTED
from sysid.data.record import Record
from sysid.model.structure import Model
from sysid.notebook import simulate

NOISE = 0.002
"""rad/s, of the gyro: so that standard errors mean something."""
LENGTH_S = 10.0


def answered(model: Model, axes: Sequence[str], maneuver: str, seed: int) -> list[Record]:
    """A run for each axis: a chirp to 8 Hz, or doublets."""
    source = np.random.default_rng(seed)
    t = np.arange(0.0, LENGTH_S, 0.005)
    within = (t > 0.5) & (t < LENGTH_S - 1.5)
    chirp = np.sin(2 * np.pi * (0.4 * t + 0.45 * t**2))
    wave = chirp if maneuver == "chirp" else np.sign(np.sin(2 * np.pi * 0.9 * t))
    channel = {"roll": "delta_x", "pitch": "delta_y", "elevator": "delta_e"}
    runs = []
    for number, axis in enumerate(axes):
        clean = simulate(f"run#{number}", model, t, {channel[axis]: 0.1 * wave * within}, maneuver=maneuver)
        noisy = {name: clean.channels[name] + NOISE * source.standard_normal(t.size) for name in ("p", "q")}
        runs.append(replace(clean, channels={**clean.channels, **noisy}, axis=axis))
    return runs


def hover_flight(seed: int) -> HoverFlight:
    """Two chirps and two doublets of Table 4's TPP."""
    model, axes = PRINTED["TPP"], ("roll", "pitch")
    return HoverFlight([*answered(model, axes, "chirp", seed), *answered(model, axes, "doublet", seed + 1)])


@pytest.fixture(scope="session")
def hover() -> HoverFlight:
    return hover_flight(1)


@pytest.fixture(scope="session")
def other_hover() -> HoverFlight:
    return hover_flight(11)


@pytest.fixture(scope="session")
def forward() -> ForwardFlight:
    """Six chirps of Table 5's TPP."""
    axes = ("roll", "pitch", "elevator")
    return ForwardFlight(answered(printed_model("tpp"), (*axes, *axes), "chirp", 21))
