"""Records refuse what cannot be fitted, and keep what they are given."""

from __future__ import annotations

import random
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sysid.data.preprocess import DEFAULT_BAND_HZ, gaps, pieces, rate_hz
from sysid.data.record import Record, RecordError

T = np.arange(0, 10, 0.002)


def channels(**changed: np.ndarray) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    made = {name: rng.normal(size=T.size) for name in ("p", "q", "delta_x", "delta_y")}
    return {"t": T, **made, **changed}


def test_what_is_saved_comes_back(tmp_path: Path) -> None:
    one = Record(
        "log#1",
        channels(),
        maneuver="chirp",
        axis="roll",
        rate_source="SIDD",
        path="flight.BIN",
        sha256="ab" * 32,
        swept_band_hz=(0.5, 10.0),
        notes=("said",),
    )
    one.save(tmp_path / "r.npz")
    again = Record.load(tmp_path / "r.npz")
    assert (again.id, again.maneuver, again.axis, again.rate_source) == ("log#1", "chirp", "roll", "SIDD")
    assert (again.path, again.sha256, again.swept_band_hz, again.notes) == (
        "flight.BIN",
        "ab" * 32,
        (0.5, 10.0),
        ("said",),
    )
    for name, values in one.channels.items():
        np.testing.assert_array_equal(again.channels[name], values)
    assert [path.name for path in tmp_path.iterdir()] == ["r.npz"], "no half-written file is left"


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 cut"])
def test_what_is_no_record_is_said(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "r.npz"
    path.write_bytes(content)
    with pytest.raises(RecordError, match=r"r\.npz: not a record"):
        Record.load(path)


def test_what_inflates_to_gigabytes_is_refused_before_it_does(tmp_path: Path) -> None:
    path, zeros = tmp_path / "bomb.npz", bytes(1 << 20)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("t.npy", "w") as part:
        for _ in range(300):
            part.write(zeros)
    with pytest.raises(RecordError, match="inflates to more than 192 MB"):
        Record.load(path)
    with zipfile.ZipFile(path, "w") as archive, archive.open("t.npy", "w") as part:
        np.lib.format.write_array_header_1_0(part, {"descr": "<f8", "fortran_order": False, "shape": (1 << 60,)})
    with pytest.raises(RecordError, match="not a record"):
        Record.load(path)


def test_no_damage_is_a_traceback(tmp_path: Path) -> None:
    path, chance = tmp_path / "r.npz", random.Random(5)
    Record("x", {name: values[:300] for name, values in channels().items()}).save(path)
    raw, refused = path.read_bytes(), 0
    for _ in range(500):
        damaged = bytearray(raw)
        for _ in range(3):  # anywhere, or in the directory at the end
            damaged[chance.choice((chance.randrange(len(raw)), -chance.randrange(1, 400)))] = chance.randrange(256)
        path.write_bytes(damaged)
        try:
            Record.load(path)
        except RecordError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017
            refused += 1
    assert refused > 300


def test_bad_channels_are_named() -> None:
    bad = channels()["p"].copy()
    bad[7] = np.nan
    with pytest.raises(RecordError, match="channel p is not a finite number at sample 8"):
        Record("x", channels(p=bad))
    with pytest.raises(RecordError, match="channel q has shape"):
        Record("x", channels(q=np.zeros(3)))
    with pytest.raises(RecordError, match="time must increase"):
        Record("x", channels(t=np.where(T > 5, T - 1, T)))
    with pytest.raises(RecordError, match="delta_y missing"):
        Record("x", {name: values for name, values in channels().items() if name != "delta_y"})
    with pytest.raises(RecordError, match="unknown channel pitch"):
        Record("x", channels(pitch=T))


def test_a_window_cuts_by_the_record_s_own_time() -> None:
    one = Record("x", channels(t=T + 100))
    part = one.window(103.0, 104.0)
    assert part.t[0] == pytest.approx(103.0)
    assert part.t[-1] == pytest.approx(104.0)
    assert one.window(None, None).t.size == one.t.size
    with pytest.raises(RecordError, match="no samples between 200"):
        one.window(200.0, None)


def test_samples_cannot_be_changed_behind_a_record() -> None:
    one = Record("x", channels())
    with pytest.raises(ValueError, match="read-only"):
        one.channels["p"][0] = 1.0


def test_gaps_and_rate_follow_the_contract() -> None:
    """A gap is a spacing above max(3 medians, a quarter period of the band's end)."""
    keep = (T < 3) | (T > 3.017)  # 17 ms: longer than 1/(4 15 Hz) = 16.7 ms
    assert len(gaps(T[keep], 15.0)) == 1
    keep = (T < 3) | (T > 3.012)
    assert gaps(T[keep], 15.0) == ()
    slow = np.arange(0, 10, 0.02)  # 50 Hz: three medians are the longer
    holes = slow[~np.isin(np.arange(slow.size), [100, 101])]
    assert len(gaps(holes, 15.0)) == 0
    holes = slow[~np.isin(np.arange(slow.size), [100, 101, 102])]
    assert len(gaps(holes, 15.0)) == 1
    assert rate_hz(holes, gaps(holes, 15.0)) == pytest.approx(50.0, rel=1e-9)


def test_irregular_time_is_put_on_a_clock_and_counted() -> None:
    rng = np.random.default_rng(1)
    jitter = T + rng.uniform(-0.0008, 0.0008, T.size)
    wave = np.sin(2 * np.pi * 3 * jitter)
    step = (jitter >= 5.0).astype(float)
    one = Record("x", channels(t=jitter, p=wave, delta_x=step))
    (piece,), _ = pieces(one, DEFAULT_BAND_HZ)
    part = piece.segment(("p", "delta_x"))
    assert part.resampled > 100
    np.testing.assert_allclose(part.channels["p"], np.sin(2 * np.pi * 3 * part.t), atol=5e-3)
    held = part.channels["delta_x"]
    between = (held > 1e-6) & (held < 1 - 1e-6)
    assert between.sum() <= 1, "a held command is itself but in the sample in which it changes"
    last = one.t[-1] + part.dt
    assert held.sum() * part.dt == pytest.approx(last - one.t[np.argmax(one.t >= 5.0)], abs=part.dt / 2)


@pytest.mark.parametrize("overwriting", [False, True])
def test_a_full_disk_leaves_nothing_half_written(tmp_path: Path, overwriting: bool) -> None:
    resource = pytest.importorskip("resource")
    one, path = Record("r", channels()), tmp_path / "run.npz"
    if overwriting:
        one.save(path)
    before = path.read_bytes() if overwriting else b""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))  # as good as full
    try:
        with pytest.raises(OSError, match="too large"):
            one.save(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [entry.name for entry in tmp_path.iterdir()] == (["run.npz"] if overwriting else [])
    assert not overwriting or path.read_bytes() == before
