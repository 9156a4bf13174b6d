"""Which airframe flew, as logs of real autopilots and profiles say."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.errors import TippathError
from gcs.logs.opening import open_log
from gcs.logs.profile.profiles import parse
from gcs.logs.runs.onboard import airframe_of
from sysid.data.airframe import Airframe


@pytest.mark.data
@pytest.mark.parametrize(
    ("log", "found"),
    [
        ("ardupilot/heli_axis12_yaw_mixer.BIN", Airframe.HELICOPTER),
        ("ardupilot/quad_sid_magnitude_15_in_mid_sweep.BIN", Airframe.MULTIROTOR),
        ("ardupilot/quad_pitch_from_vehicle.tlog", Airframe.MULTIROTOR),
        ("px4/sample.ulg", Airframe.MULTIROTOR),
        ("crazyflie/roll_pitch_pilot_mapped.csv", None),
    ],
)
def test_a_log_says_it_or_not(shared_data: Path, log: str, found: Airframe | None) -> None:
    (boot,) = open_log(shared_data / log, None).boots
    assert airframe_of(boot, 1e6) is found


def test_a_profile_may_say_it() -> None:
    text = '{}[channels.p]\nsource = "a"\n'
    assert parse(text.format('airframe = "multirotor"\n'), "x.toml").airframe is Airframe.MULTIROTOR
    assert parse(text.format(""), "x.toml").airframe is None
    with pytest.raises(TippathError, match=r"x\.toml.*airframe"):
        parse(text.format('airframe = "balloon"\n'), "x.toml")
