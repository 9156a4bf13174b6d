"""ArduPilot's rate loop against what real ArduPilot code put out: RATE's outputs from its targets, rates and PARM."""

from __future__ import annotations

from pathlib import Path

import pytest
from more_of_a_kind import thorough

from gcs.errors import TippathError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.opening import open_log
from gcs.logs.runs import systemid
from gcs.logs.runs.rate_loop import FIELDS, FLOAT32_PERCENT, Repeated, repeats
from sitl.autopilot.modes import Mode, Reason
from sitl.autopilot.vehicle import make_vehicle

WHOLE = (
    "heli_axis7_roll_rate.BIN",
    "heli_pitch_sweep.BIN",
    "heli_roll_sweep.BIN",
    "quad_pitch_sweep.BIN",
    "quad_roll_pitch.BIN",
    "quad_roll_sweep.BIN",
    "quad_sid_magnitude_15_in_mid_sweep.BIN",
)


def opened(path: Path) -> DataFlashTables:
    (part,) = open_log(path, None).parts
    assert isinstance(part[0], DataFlashTables)
    return part[0]


def all_runs(log: DataFlashTables, later: int = 1) -> list[Repeated]:
    """Both axes of every maneuver that lasted."""
    return [
        repeats(
            log,
            axis,
            span.start_s,
            span.stop_s,
            injected=span.excites_command and span.axis == axis,
            later=later,
        )
        for span in systemid.find(log)
        if span.stop_s - span.start_s > 3.5
        for axis in FIELDS
    ]


@pytest.mark.data
@pytest.mark.parametrize("name", WHOLE)
def test_a_whole_log_is_repeated_to_rounding(shared_data: Path, name: str) -> None:
    """Naive, with targets and excitation of the row itself, 1.6 to 96 % were left: they are the next loop's."""
    log = opened(shared_data / "ardupilot" / name)
    runs = all_runs(log)
    assert len(runs) in (2, 4)
    for run in runs:
        assert run.residual_percent < 0.001, run
        assert run.causes == ()
        assert run.rows > 700
    for naive in all_runs(log, later=0):
        assert naive.residual_percent > 1, naive


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "most", "cause"),
    [
        ("heli_bitmask_changed_two_runs.BIN", (2.5, 2.5, 10, 4), ("one loop of 4", "one loop of 4", "gaps", "gaps")),
        ("heli_axis12_yaw_mixer.BIN", (0.05, 0.3), ("1 gaps of up to 40 ms", "1 gaps of up to 40 ms")),
    ],
)
def test_what_a_log_lacks_is_named_as_the_cause(
    shared_data: Path, name: str, most: tuple[float, ...], cause: tuple[str, ...]
) -> None:
    runs = all_runs(opened(shared_data / "ardupilot" / name))
    assert len(runs) == len(most)
    for run, percent, words in zip(runs, most, cause, strict=True):
        assert FLOAT32_PERCENT < run.residual_percent < percent, run
        assert words in run.causes[0]


@pytest.mark.data
def test_an_old_firmware_s_log_is_refused_in_a_line(shared_data: Path) -> None:
    with pytest.raises(TippathError, match="rate loops are not known"):
        repeats(opened(shared_data / "ardupilot" / "log171.bin"), "roll", 0.0, 1000.0, injected=False)


@pytest.mark.data
def test_too_short_a_stretch_is_refused(shared_data: Path) -> None:
    log = opened(shared_data / "ardupilot" / "quad_roll_sweep.BIN")
    with pytest.raises(TippathError, match="no stretch of 3 s"):
        repeats(log, "roll", 80.0, 81.0, injected=True)


HELI, QUAD = ("ardupilot-heli", "hover"), ("ardupilot-quad", "quad")
BUSY = {
    f"ATC_RAT_{axis}_{name}": value
    for axis in ("RLL", "PIT")
    for name, value in {"D_FF": 0.002, "FLTD": 15.0, "PDMX": 0.002, "I": 0.3, "IMAX": 0.01, "ILMI": 0.003}.items()
}


@pytest.mark.parametrize(
    ("like", "sid_axis", "magnitude", "settings"),
    [
        (HELI, 11, 0.05, BUSY),
        (QUAD, 8, 5.0, {}),
        *thorough([(HELI, 10, 0.05, {}), (HELI, 7, 5.0, {}), (QUAD, 11, 0.05, {})]),
    ],
)
def test_the_simulated_vehicle_s_own_loop_is_repeated(
    tmp_path: Path, like: tuple[str, str], sid_axis: int, magnitude: float, settings: dict[str, float]
) -> None:
    """Within 1 %: it was written independently, and its RATE tells the next loop's targets as the real one's does."""
    sweep = {"SID_AXIS": sid_axis, "SID_MAGNITUDE": magnitude, "SID_F_STOP_HZ": 10.0, "SID_T_REC": 8.0}
    fades = {"SID_T_FADE_IN": 1.0, "SID_T_FADE_OUT": 0.5, "LOG_BITMASK": 180223.0}
    vehicle = make_vehicle(like[1], 5, directory=tmp_path, parameters=sweep | fades | settings, like=like[0])
    assert vehicle.set_mode(Mode.SYSTEMID, Reason.GROUND)
    for _ in range(round(11 / vehicle.dt)):
        vehicle.step()
    vehicle.close()
    (path,) = tmp_path.rglob("*.BIN")
    runs = all_runs(opened(path))
    assert len(runs) == 2
    for run in runs:
        assert run.residual_percent < 1, run
        assert run.rows > 2000
    for naive in all_runs(opened(path), later=0):
        assert naive.residual_percent > 0.5, naive
