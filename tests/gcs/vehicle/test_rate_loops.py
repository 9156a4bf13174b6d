"""Parameters of an ArduPilot to its rate loops: what each one sets, and what is named because no loop has it."""

from __future__ import annotations

import math

import pytest

from gcs.errors import TippathError
from gcs.vehicle.rate_loops import AXES, gyro_filter_hz, rate_loops

MULTI = {
    f"ATC_RAT_{axis}_{gain}": value
    for axis in AXES.values()
    for gain, value in {
        "P": 0.135,
        "I": 0.13,
        "D": 0.0036,
        "FF": 0.0,
        "D_FF": 0.0,
        "IMAX": 0.5,
        "FLTT": 20.0,
        "FLTE": 0.0,
        "FLTD": 21.0,
        "SMAX": 0.0,
        "PDMX": 0.0,
        "NTF": 0.0,
        "NEF": 0.0,
    }.items()
} | {"ATC_ANG_RLL_P": 4.5, "ATC_ANG_PIT_P": 6.0, "SCHED_LOOP_RATE": 400.0, "MOT_THST_EXPO": 0.65}
HELI = MULTI | {"ATC_RAT_RLL_ILMI": 0.1, "ATC_RAT_PIT_ILMI": 0.05, "H_OPTIONS": 1.0, "H_SW_TYPE": 3.0}


def test_a_multicopter_s_loops() -> None:
    loops = rate_loops(MULTI)
    roll = loops.roll
    assert (roll.p, roll.i, roll.d, roll.i_max) == (0.135, 0.13, 0.0036, 0.5)
    assert (roll.target_hz, roll.error_hz, roll.derivative_hz) == (20.0, 0.0, 21.0)
    assert (roll.angle_p, loops.pitch.angle_p) == (4.5, 6.0)
    assert math.isinf(roll.pd_max)
    assert math.isinf(roll.output_max)
    assert roll.leak_min is None
    assert (loops.loop_hz, loops.helicopter, loops.not_modelled) == (400.0, False, ())
    assert loops.in_the_vehicle == ("thrust curve (MOT_THST_EXPO 0.65)",)


def test_a_helicopter_s_integrator_leaks_as_its_options_say() -> None:
    loops = rate_loops(HELI | {"SCHED_LOOP_RATE": 333.0})
    assert (loops.roll.leak_min, loops.pitch.leak_min) == (0.1, 0.05)
    assert loops.roll.output_max == 1.0
    assert loops.loop_hz == 333.0
    assert loops.in_the_vehicle == ("swashplate and its limits (H_SW_TYPE 3)",)
    assert rate_loops(HELI | {"H_OPTIONS": 2.0}).roll.leak_min is None


def test_a_notch_is_the_filter_that_is_pointed_to() -> None:
    told = {"FILT2_TYPE": 1.0, "FILT2_NOTCH_FREQ": 31.0, "FILT2_NOTCH_Q": 2.0, "FILT2_NOTCH_ATT": 40.0}
    loops = rate_loops(MULTI | told | {"ATC_RAT_PIT_NEF": 2.0})
    notch = loops.pitch.error_notch
    assert notch is not None
    assert (notch.frequency_hz, notch.quality, notch.attenuation_db) == (31.0, 2.0, 40.0)
    assert loops.roll.error_notch is None
    assert rate_loops(MULTI | {"ATC_RAT_RLL_NTF": 3.0}).roll.target_notch is None, "one that is not set up acts not"


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("ATC_RAT_PIT_SMAX", "slew limit takes P and D of pitch"),
        ("ATC_THR_G_BOOST", "throttle"),
        ("ATC_PIRO_COMP", "yaw"),
        ("H_FLYBAR_MODE", "flybar"),
        ("CC_TYPE", "custom controller"),
        ("FSTRATE_ENABLE", "faster"),
    ],
)
def test_what_is_active_and_in_no_loop_is_named(name: str, word: str) -> None:
    (said,) = rate_loops(MULTI | {name: 1.0}).not_modelled
    assert word in said
    assert name in said


def test_a_notch_that_follows_something_and_an_unknown_filter_are_named() -> None:
    follows = MULTI | {"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_MODE": 3.0}
    assert "INS_HNTCH_MODE 3" in rate_loops(follows).not_modelled[0]
    assert rate_loops(follows | {"INS_HNTCH_MODE": 0.0}).not_modelled == ()
    (said,) = rate_loops(MULTI | {"ATC_RAT_RLL_NTF": 1.0, "FILT1_TYPE": 7.0}).not_modelled
    assert "FILT1_TYPE 7" in said


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ATC_RAT_RLL_P": None}, "ATC_RAT_RLL_P is not among"),
        ({"ATC_RAT_RLL_D_FF": None}, "ArduCopter 4.5"),
        ({"ATC_RAT_PIT_I": math.nan}, "ATC_RAT_PIT_I is nan"),
        ({"ATC_RAT_PIT_D": None, "ATC_ANG_RLL_P": None}, "not whole: ATC_RAT_PIT_D, ATC_ANG_RLL_P not among"),
        ({"ATC_RAT_PIT_SMAX": math.nan}, "ATC_RAT_PIT_SMAX is nan"),
        ({"ATC_PIRO_COMP": math.nan}, "ATC_PIRO_COMP is nan"),
        ({"INS_HNTCH_ENABLE": math.nan}, "INS_HNTCH_ENABLE is nan"),
        ({"SCHED_LOOP_RATE": 0.0}, "SCHED_LOOP_RATE is 0"),
        ({"ATC_RAT_RLL_NTF": math.nan}, "ATC_RAT_RLL_NTF is nan"),
        ({"ATC_ANG_PIT_P": math.inf}, "ATC_ANG_PIT_P is inf"),
    ],
)
def test_what_is_no_such_loop_is_refused_in_a_line(change: dict[str, float | None], words: str) -> None:
    parameters = {name: value for name, value in (MULTI | change).items() if value is not None}
    with pytest.raises(TippathError, match=words) as refusal:
        rate_loops(parameters)
    assert "\n" not in str(refusal.value)


def test_without_parameters_the_log_is_to_blame() -> None:
    with pytest.raises(TippathError, match="no parameters are told"):
        rate_loops({})


def test_the_gyro_filter_is_in_the_loop_of_rates_before_it() -> None:
    told = {"INS_GYRO_FILTER": 20.0}
    assert gyro_filter_hz(told, "SIDD") == 20.0
    assert gyro_filter_hz(told, "RATE") == 0.0
    with pytest.raises(TippathError, match="INS_HNTC2_ENABLE"):
        gyro_filter_hz(told | {"INS_HNTC2_ENABLE": 1.0}, "SIDD")
