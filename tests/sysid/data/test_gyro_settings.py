"""What ArduPilot's parameters tell of the filters before the logged rates, and what a structure makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sysid.data.gyro_settings import told_filters
from sysid.data.record import Record
from sysid.model.compose import compose
from sysid.model.response import transfer

T = np.arange(0, 5, 0.01)
CHANNELS = {"t": T, **{name: np.sin(T) for name in ("p", "q", "delta_x", "delta_y")}}
NOTCH = {"ENABLE": 1, "MODE": 0, "OPTS": 0, "HMNCS": 1, "FREQ": 27.5, "BW": 14, "ATT": 40}
HZ = np.array([1.0, 5.0, 10.0, 20.0, 27.5])


def logged(settings: dict[str, float], source: str = "RATE") -> Record:
    return Record("x", CHANNELS, rate_source=source, vehicle={name: f"{value:g}" for name, value in settings.items()})


def notch(**changed: float) -> dict[str, float]:
    return {f"INS_HNTCH_{name}": value for name, value in {**NOTCH, **changed}.items()}


def test_the_low_pass_is_told_of_rates_behind_it_alone() -> None:
    filtered = {"INS_GYRO_FILTER": 20.0}
    assert told_filters([logged(filtered), logged(filtered)]) == {"gyro_corner_hz": 20.0}
    assert told_filters([logged(filtered, "SIDD")]) == {}  # angles that the sensor turned by, before any filter
    assert told_filters([logged(filtered), logged({"INS_GYRO_FILTER": 40.0})]) == {}
    assert told_filters([logged({"INS_GYRO_FILTER": 0.0}), logged({})]) == {}
    assert told_filters([]) == {}


@pytest.mark.parametrize("changed", [{"ENABLE": 0}, {"MODE": 1}, {"OPTS": 1}, {"BW": 0}, {"BW": 60}])
def test_a_notch_that_moves_or_is_not_plain_is_not_told(changed: dict[str, float]) -> None:
    assert told_filters([logged(notch())]).keys() == {
        "gyro_notch1_hz", "gyro_notch1_width_hz", "gyro_notch1_left"
    }  # fmt: skip
    assert told_filters([logged(notch(**changed))]) == {}


def test_harmonics_have_the_first_one_s_width_in_proportion() -> None:
    told = told_filters([logged(notch(HMNCS=0b101))])
    assert told["gyro_notch2_hz"] == 82.5
    assert told["gyro_notch2_width_hz"] == pytest.approx(3 * told["gyro_notch1_width_hz"])
    assert told["gyro_notch1_left"] == pytest.approx(0.01)


def test_what_is_told_is_applied_without_parameters() -> None:
    """ArduPilot's own filters, written out: Q and A as its NotchFilter works them out, Butterworth's low-pass."""
    told = told_filters([logged({"INS_GYRO_FILTER": 20.0, **notch()})])
    structure = compose("cd", ["gyro_filter"], (), told)
    bare = compose("cd")
    assert structure.names == bare.names
    values = np.array([one.typical for one in bare.parameters])
    found = transfer(structure, values, HZ) / transfer(bare, values, HZ)
    s, low, w = 2j * math.pi * HZ, 2 * math.pi * 20.0, 2 * math.pi * 27.5
    octaves = 2 * math.log2(27.5 / (27.5 - 7.0))
    Q, A = math.sqrt(2**octaves) / (2**octaves - 1), 10 ** (-40 / 40)
    expected = low**2 / (s * s + math.sqrt(2) * low * s + low**2)
    expected *= (s * s + s * w / Q * A * A + w * w) / (s * s + s * w / Q + w * w)
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=1e-9)


def test_a_notch_told_of_alone_is_applied_and_no_low_pass_is_guessed_beside_it() -> None:
    structure, bare = compose("cd", ["gyro_filter"], (), told_filters([logged(notch())])), compose("cd")
    assert structure.names == bare.names
    assert structure == compose("cd", structure.composed, (), dict(structure.constants))
    values = np.array([one.typical for one in bare.parameters])
    found = abs(transfer(structure, values, HZ) / transfer(bare, values, HZ))
    assert np.all(found[:, :, 0] > 0.99)
    assert np.all(found[:, :, HZ == 27.5] < 0.02)
