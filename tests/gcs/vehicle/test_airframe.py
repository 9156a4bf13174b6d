"""What autopilots say of the airframe, by their own numbers and names."""

from __future__ import annotations

import pytest

from gcs.vehicle.autopilots import airframe_of_type
from gcs.vehicle.own_log import airframe
from sysid.data.airframe import Airframe

HELI, MULTI = Airframe.HELICOPTER, Airframe.MULTIROTOR


@pytest.mark.parametrize(
    ("settings", "frame", "found"),
    [
        ({"FRAME_CLASS": 1.0}, "", MULTI),
        ({"FRAME_CLASS": 6.0}, "", HELI),
        ({"FRAME_CLASS": 9.0}, "", None),  # one rotor above the other, steered by flaps
        ({"FRAME_CLASS": 6.0}, "QUAD/X", HELI),  # the parameter is what flies
        ({"FRAME_CLASS": 0.0}, "HEXA/X", MULTI),
        ({}, "QUAD/PLUS", MULTI),
        ({}, "HELI", HELI),
        ({}, "HELI_QUAD", None),
        ({}, "", None),
    ],
)
def test_ardupilot_s_frame(settings: dict[str, float], frame: str, found: Airframe | None) -> None:
    assert airframe(settings, frame) is found


@pytest.mark.parametrize(("number", "found"), [(2, MULTI), (4, HELI), (13, MULTI), (3, None), (1, None), (0, None)])
def test_mavlink_s_type(number: int, found: Airframe | None) -> None:
    assert airframe_of_type(number) is found
