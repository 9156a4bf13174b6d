"""The bank beside the controller that flies: what it would do is logged, and nothing of it is flown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from sitl.autopilot.modes import Reason
from sitl.autopilot.parameters import BANK_ORDER, bank_crc
from sitl.autopilot.vehicle import Vehicle, make_vehicle
from sitl.pilot import obey

Fly = Callable[[Vehicle, float], list[str]]
Reader = Callable[[Path], list[Any]]
SWEEP = {"SID_AXIS": 10, "SID_MAGNITUDE": 0.1, "SID_T_FADE_IN": 0, "SID_T_REC": 4, "SID_T_FADE_OUT": 0}


def swept(directory: Path, bank: tuple[float, ...], fly: Fly, **parameters: float) -> Vehicle:
    vehicle = make_vehicle("hover", 1, directory=directory, on_ground=True, parameters=SWEEP)
    for name, value in zip(BANK_ORDER, bank, strict=True):
        vehicle.write_parameter("LQS_" + name, value)
    vehicle.write_parameter("LQR_COMMIT", bank_crc(bank))
    for name, value in parameters.items():
        vehicle.write_parameter(name, value)
    obey(vehicle, "takeoff")
    fly(vehicle, 5)
    assert vehicle.set_mode(25, Reason.GROUND)
    fly(vehicle, 6)
    return vehicle


def messages(directory: Path, read_log: Reader, kind: str) -> list[Any]:
    (path,) = directory.glob("*.BIN")
    return [one for one in read_log(path) if one.get_type() == kind]


def test_it_puts_out_what_its_equations_say_and_flies_nothing(
    tmp_path: Path, fly: Fly, read_log: Reader, paper_bank: tuple[float, ...]
) -> None:
    for name, on in (("beside", 1), ("alone", 0)):
        (tmp_path / name).mkdir()
        swept(tmp_path / name, paper_bank, fly, LQR_LOG=on).close()
    assert not messages(tmp_path / "alone", read_log, "LQRO")
    rates = messages(tmp_path / "beside", read_log, "RATE")
    alone = messages(tmp_path / "alone", read_log, "RATE")
    assert [(one.R, one.ROut, one.POut) for one in rates] == [(one.R, one.ROut, one.POut) for one in alone]
    put_out = {one.TimeUS: one for one in messages(tmp_path / "beside", read_log, "LQRO")}
    rows = [one for one in rates if one.TimeUS in put_out][:1500]
    assert len(rows) == 1500
    K, L, g = (np.array(paper_bank[a:b]).reshape(s) for a, b, s in ((0, 8, (2, 4)), (8, 16, (4, 2)), (16, 20, (2, 2))))
    L_b, M_a, tau, A_b, B_a, *drive = paper_bank[20:]
    A = np.array([[0, 0, 0, L_b], [0, 0, M_a, 0], [0, -1, -1 / tau, A_b / tau], [-1, 0, B_a / tau, -1 / tau]])
    B = np.vstack([np.zeros((2, 2)), np.array(drive).reshape(2, 2) / tau])
    block = np.zeros((8, 8))
    block[:4] = np.hstack([A - L @ np.eye(2, 4), B, L])
    power = expm(0.002 * block)[:4]
    x = np.zeros(4)
    for row in rows:
        one, y = put_out[row.TimeUS], np.radians([row.R, row.P])
        wanted = g @ [one.PDes, one.QDes] - K @ x
        np.testing.assert_allclose([one.X, one.Y], wanted, rtol=1e-3, atol=2e-5)
        np.testing.assert_allclose([one.PInn, one.QInn], y - x[:2], rtol=1e-3, atol=2e-5)
        x = power @ np.concatenate([x, [row.ROut, row.POut], y])


def test_it_stands_still_where_the_lqr_flies_and_where_there_is_none(
    tmp_path: Path, fly: Fly, read_log: Reader, paper_bank: tuple[float, ...]
) -> None:
    vehicle = swept(tmp_path, paper_bank, fly, LQR_LOG=1)
    before = vehicle.time_us
    assert obey(vehicle, "lqr on") == "ok"
    fly(vehicle, 1)
    vehicle.close()
    assert max(one.TimeUS for one in messages(tmp_path, read_log, "LQRO")) <= before
    bare = make_vehicle("hover", 1, directory=tmp_path / "bare", parameters={"LQR_LOG": 1})
    fly(bare, 1)
    bare.close()
    assert not list((tmp_path / "bare").glob("*.BIN")) or not messages(tmp_path / "bare", read_log, "LQRO")


def test_its_state_begins_anew_with_a_new_bank(fly: Fly, paper_bank: tuple[float, ...], tmp_path: Path) -> None:
    vehicle = swept(tmp_path, paper_bank, fly, LQR_LOG=1)
    assert vehicle._controllers.beside is not None
    vehicle.write_parameter("LQR_LOG", 0)
    fly(vehicle, 0.01)
    assert vehicle._controllers.beside is None
    vehicle.write_parameter("LQR_LOG", 1)
    vehicle.step()
    beside = vehicle._controllers.beside
    assert beside is not None
    assert beside.innovation == pytest.approx(vehicle.gyro[:2])
    vehicle.close()
