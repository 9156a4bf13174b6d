"""MATLAB's .mat: arrays and structs of arrays, the two formats, objects, and what damage does to them."""

from __future__ import annotations

import builtins
import io
import random
import struct
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from injuries import FIRSTS, STEP, bounded, bounded_turns, injure
from scipy.io import savemat
from scipy.io.matlab import MatlabObject

from gcs.cli import main
from gcs.errors import TippathError
from gcs.logs import Run, Source, ingest
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.model.compose import compose

h5py = pytest.importorskip("h5py")

Saved = Callable[[bytes, str], Path]


def flight(count: int = 2000, rate_hz: float = 200.0) -> dict[str, np.ndarray]:
    t = np.arange(count) / rate_hz
    x, y = 0.1 * np.sin(2 * np.pi * t), 0.1 * np.cos(2 * np.pi * 1.3 * t)
    return {"t": t, "p": 3 * x, "q": 2 * y, "delta_x": x, "delta_y": y}


def v5(arrays: Mapping[str, Any], *, compressed: bool = False) -> bytes:
    stream = io.BytesIO()
    savemat(stream, dict(arrays), do_compression=compressed, oned_as="column")
    return stream.getvalue()


def v73(arrays: Mapping[str, Any]) -> bytes:
    """As MATLAB lays format 7.3 out: HDF5 behind 512 bytes of its own, arrays turned, structs as groups."""
    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512) as file:
        _fill(file, file, arrays)
    mark = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Nov 23 2026 HDF5 schema 1.00 ."
    return mark.ljust(116) + bytes(8) + struct.pack("<H", 0x0200) + b"IM" + bytes(384) + stream.getvalue()[512:]


def _fill(file: Any, group: Any, arrays: Mapping[str, Any]) -> None:
    for name, value in arrays.items():
        if isinstance(value, Mapping):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            _fill(file, inner, value)
        elif isinstance(value, list):  # a cell of arrays
            references = []
            for i, entry in enumerate(value):
                _fill(file, file.require_group("#refs#"), {f"{name}{i}": entry})
                references.append(file[f"#refs#/{name}{i}"].ref)
            made = group.create_dataset(name, data=np.array([references], dtype=h5py.ref_dtype).T)
            made.attrs["MATLAB_class"] = np.bytes_("cell")
        else:
            made = group.create_dataset(name, data=np.atleast_2d(value))
            made.attrs["MATLAB_class"] = np.bytes_("double")


FORMATS = [v5, v73]


def read(path: Path, profile: Path | None = None) -> tuple[Record, Run, Source]:
    found = ingest([path], profile)
    (run,), (source,) = found.runs, found.sources
    assert run.record is not None
    return run.record, run, source


def assert_same(record: Record, arrays: Mapping[str, np.ndarray]) -> None:
    for name, values in arrays.items():
        assert np.array_equal(record.channels[name], values), name


@pytest.mark.parametrize("write", FORMATS)
def test_arrays_of_the_channels_names_need_no_profile(saved: Saved, write: Callable[..., bytes]) -> None:
    record, run, source = read(saved(write(flight()), "f.mat"))
    assert run.usable
    assert source.kind == "mat"
    assert_same(record, flight())
    record, *_ = read(saved(write({"about": {"mass": 3.2}, "run": flight()}), "s.mat"))
    assert_same(record, flight())
    assert run.sources["p"] == "p"


@pytest.mark.parametrize("write", FORMATS)
def test_a_profile_takes_columns_of_matrices_in_structs(saved: Saved, write: Callable[..., bytes]) -> None:
    made = flight()
    rates = np.column_stack([made["p"], made["q"], 0 * made["p"]])
    slow = {"time": 1e3 * made["t"][::4], "u": [made["delta_x"][::4], made["delta_y"][::4]]}
    log = {"imu": {"time": 1e3 * made["t"], "gyro": np.rad2deg(rates)}, "ctl": slow, "note": np.array([1.0])}
    if write is v5:
        cell = np.empty(2, object)
        cell[:] = slow["u"]
        log["ctl"] = {**slow, "u": cell}
        log["title"] = "hover"
    profile = saved(
        b"""
        [time]
        source = "imu.time"
        scale = 1e-3
        [channels.p]
        source = "imu.gyro[0]"
        scale = 0.017453292519943295
        [channels.q]
        source = "imu.gyro[1] * pi / 180"
        [channels.delta_x]
        source = "ctl.u[0]"
        [channels.delta_y]
        source = "ctl.u[1]"
        """,
        "mine.toml",
    )
    record, run, source = read(saved(write(log), "f.mat"), profile)
    assert np.allclose(record.t, made["t"])
    assert np.allclose(record.channels["p"], made["p"])
    assert np.allclose(record.channels["delta_x"][::4], made["delta_x"][::4])
    assert run.sources["delta_x"] == "ctl.u[0]"
    assert {*source.fields} == {"imu.time", *(f"imu.gyro[{i}]" for i in range(3)), "ctl.time", "ctl.u[0]", "ctl.u[1]"}


def test_a_matrix_may_lie_either_way(saved: Saved) -> None:
    made = flight()
    text = '[channels.p]\nsource="y[0]"\n[channels.q]\nsource="y[1]"\n'
    profile = saved(
        (text + '[channels.delta_x]\nsource="u[0]"\n[channels.delta_y]\nsource="u[1]"\n').encode(), "m.toml"
    )
    lying = {"t": made["t"], "y": np.stack([made["p"], made["q"]]), "u": np.stack([made["delta_x"], made["delta_y"]]).T}
    assert_same(read(saved(v5(lying), "f.mat"), profile)[0], made)


@pytest.mark.parametrize("write", FORMATS)
def test_what_to_write_is_proposed(
    saved: Saved, write: Callable[..., bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    made = flight()
    sticks = np.column_stack([made["delta_x"], 2 + made["delta_y"]])
    log = {"time": made["t"], "roll_rate": made["p"], "pitch_rate": made["q"], "in": sticks}
    assert main(["ingest", str(saved(write(log), "f.mat")), "--explain"]) == 1
    said = capsys.readouterr().out
    assert 'source = "roll_rate"' in said
    assert "their lowest and highest values: in[0] -0.1..0.1, in[1] 1.9..2.1" in said
    assert '[time]\nsource = "time"' in said


def test_what_is_proposed_is_written_and_read_as_it_stands(saved: Saved, tmp_path: Path) -> None:
    """A struct with a `tout`: the proposal asked for a TIME_COLUMN, although the reader finds it."""
    made = flight()
    arrays = {"gyro": np.stack([made["p"], made["q"]], 1), "cmd": np.stack([made["delta_x"], made["delta_y"]], 1)}
    log, mine = saved(v5({"run": {"tout": made["t"], **arrays}}), "own.mat"), tmp_path / "mine.toml"
    assert main(["ingest", str(log), "--explain", "-o", str(mine)]) == 1
    assert '[time]\nsource = "run.tout"' in mine.read_text("utf-8")
    record, *_ = read(log, mine)
    assert_same(record, made)
    assert main(["ingest", str(log), "--explain", "-o", str(mine)]) == 2, "it is there already"
    other = saved(v5({"run": {"tout": made["t"], **arrays}}), "two.mat")
    assert main(["ingest", str(log), str(other), "--explain", "-o", str(mine), "--force"]) == 2, "of which?"


def test_without_a_time_the_log_says_so(saved: Saved) -> None:
    made = {name: values for name, values in flight().items() if name != "t"}
    with pytest.raises(TippathError, match="missing"):
        ingest([saved(v5(made), "f.mat")])


def test_objects_are_refused_in_a_sentence(saved: Saved) -> None:
    holds = MatlabObject(np.zeros((1, 1), dtype=[("Time", object), ("Data", object)]), "timeseries")
    with pytest.raises(TippathError, match=r"ts \(timeseries\): objects of MATLAB.*save what is in them as arrays"):
        ingest([saved(v5({"ts": holds}), "f.mat")])
    record, _, source = read(saved(v5({"ts": holds, **flight()}), "g.mat"))
    assert_same(record, flight())
    assert any("left out: ts (timeseries)" in hint for hint in source.hints)


def test_objects_of_the_newer_format_are_refused_in_a_sentence(saved: Saved, tmp_path: Path) -> None:
    path = saved(v73({"ts": np.zeros(6)}), "f.mat")
    with h5py.File(path, "r+") as file:
        file["ts"].attrs["MATLAB_class"] = np.bytes_("timeseries")
        file["ts"].attrs["MATLAB_object_decode"] = 3
    with pytest.raises(TippathError, match=r"ts \(timeseries\): objects of MATLAB"):
        ingest([path])


def test_without_h5py_one_line_says_what_to_install(saved: Saved, monkeypatch: pytest.MonkeyPatch) -> None:
    path = saved(v73(flight()), "f.mat")
    usual = builtins.__import__

    def without(name: str, *rest: Any, **named: Any) -> Any:
        if name == "h5py":
            raise ImportError(name)
        return usual(name, *rest, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(TippathError, match=r"h5py is not installed; install it: \S+ -m pip install h5py") as refused:
        ingest([path])
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("write", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.003, 0.05, 0.5, 0.99])
def test_a_cut_file_is_refused_or_read(saved: Saved, write: Callable[..., bytes], share: float) -> None:
    raw = write(flight())
    path = saved(raw[: int(share * len(raw))], "f.mat")
    with pytest.raises(TippathError, match=r"not a whole \.mat file|the file is empty|no array of numbers"):
        ingest([path])


def test_compressed_and_not(saved: Saved) -> None:
    for name, compressed in (("a.mat", False), ("b.mat", True)):
        assert_same(read(saved(v5(flight(), compressed=compressed), name))[0], flight())


def test_an_older_format_is_refused_with_what_to_do(saved: Saved) -> None:
    stream = io.BytesIO()
    savemat(stream, flight(), format="4")
    with pytest.raises(TippathError, match=r"save it in MATLAB as save\('flight.mat', '-v7'\)"):
        ingest([saved(stream.getvalue(), "f.mat")])


def test_no_numbers_are_refused(saved: Saved) -> None:
    with pytest.raises(TippathError, match="no array of numbers"):
        ingest([saved(v5({"title": "hover"}), "f.mat")])


@pytest.mark.parametrize("write", FORMATS)
@pytest.mark.parametrize("first", FIRSTS)
def test_no_damage_is_a_traceback(saved: Saved, write: Callable[..., bytes], first: int) -> None:
    small = {name: values[:60] for name, values in flight().items()}
    texts = {"title": "hover, µ"} if write is v5 else {}
    raw = write({**small, "s": {"inner": small}, **texts}, **({"compressed": first % 100 == 0} if write is v5 else {}))
    for seed in bounded_turns(STEP, first):
        chance = random.Random(seed)
        damaged = injure(raw[128:], chance, lambda chance: raw[128 : 128 + chance.randrange(200)], cut=True)
        path = saved(raw[:128] + damaged, "f.mat")
        try:
            ingest([path])
        except TippathError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017


def test_a_helicopter_flown_by_hand(shared_data: Path, saved: Saved) -> None:
    """Its rates answer the stick with first order: p in 0.07 to 0.10 s, q in 0.18 to 0.22 s."""
    path = shared_data / "measured" / "trex550_manual.mat"
    if not path.exists():
        pytest.skip(f"NOT CHECKED: {path} is absent")
    sources = {"p": "outr[2]", "q": "outr[3]", "delta_x": "inr[0]", "delta_y": "inr[1]"}
    text = "\n".join(f'[channels.{name}]\nsource = "{source}"' for name, source in sources.items())
    found = ingest([path], saved(text.encode(), "trex.toml"), (2.0, 83.0))
    fit = identify(compose("cd"), [run.record for run in found.usable], band_hz=(0.0, 15.0))
    value = dict(zip(fit.model.structure.names, fit.model.values, strict=True))
    assert 0.17 < -1 / value["M_q"] < 0.22
    assert 0.05 < -1 / value["L_p"] < 0.10


@pytest.mark.parametrize("kind", ["v5", "v7.3", "v7.3 of references"])
def test_a_small_file_that_becomes_gigabytes_is_refused(saved: Saved, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "bomb.mat"
    if kind == "v5":
        small = [(f"a{k}", np.zeros(1 << 20)) for k in range(8)]
        path.write_bytes(v5(dict(small), compressed=True))
    else:
        path.write_bytes(v73({"t": np.zeros(3)}))
        with h5py.File(path, "r+") as file:
            many = kind.endswith("references")
            one = file.create_dataset("#one", (1 << 20,), "f8", chunks=(1 << 16,), compression="gzip")
            if many:
                cell = file.create_dataset("cell", (1, 400), h5py.ref_dtype)
                cell[...] = one.ref
            else:
                file.create_dataset("wide", (1 << 30,), "f8", chunks=(1 << 16,), compression="gzip")
    assert path.stat().st_size < 200_000
    with bounded(), pytest.raises(TippathError, match="than what is measured packs to"):
        ingest([path])
