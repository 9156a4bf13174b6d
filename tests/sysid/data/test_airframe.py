"""Which airframe flew travels with a run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from sysid.data.airframe import Airframe, agreed
from sysid.data.dataset import prepared
from sysid.data.record import Record

T = np.arange(0, 5, 0.01)
CHANNELS = {"t": T, **{name: np.sin(T) for name in ("p", "q", "delta_x", "delta_y")}}
QUAD = Record("quad", CHANNELS, airframe=Airframe.MULTIROTOR, chirp_noise=0.0)


def test_a_record_keeps_it_in_its_file_and_in_a_part(tmp_path: Path) -> None:
    QUAD.save(tmp_path / "quad.npz")
    for one in (Record.load(tmp_path / "quad.npz"), QUAD.window(1, 2)):
        assert (one.airframe, one.chirp_noise) == (Airframe.MULTIROTOR, 0.0)


def test_a_record_of_before_is_of_no_known_one(tmp_path: Path) -> None:
    path = tmp_path / "old.npz"
    QUAD.save(path)
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    about = json.loads(bytes(arrays["about"]))
    del about["airframe"], about["chirp_noise"]
    np.savez(path, **{**arrays, "about": np.frombuffer(json.dumps(about).encode(), np.uint8)})  # type: ignore[arg-type]
    assert (Record.load(path).airframe, Record.load(path).chirp_noise) == (None, None)


def test_runs_agree_or_nothing_is_known() -> None:
    heli, unknown = Airframe.HELICOPTER, Record("x", CHANNELS)
    assert agreed([None, heli, heli]) is heli
    assert agreed([heli, Airframe.MULTIROTOR]) is None
    assert agreed([]) is None
    assert prepared([QUAD, unknown], (0.5, 10)).airframe is Airframe.MULTIROTOR
