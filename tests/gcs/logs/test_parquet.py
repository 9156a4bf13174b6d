"""Parquet: columns of numbers and time stamps, structs, and damage."""

from __future__ import annotations

import io
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pytest
from injuries import COUNTS, bounded, bounded_turns, injure
from pyarrow import parquet

from gcs.errors import TippathError
from gcs.logs import ingest

Saved = Callable[[bytes, str], Path]


def flight(count: int = 1500) -> dict[str, np.ndarray]:
    t = np.arange(count) / 200
    x, y = 0.1 * np.sin(2 * np.pi * t), 0.1 * np.cos(2 * np.pi * 1.3 * t)
    return {"t": t, "p": 3 * x, "q": 2 * y, "delta_x": x, "delta_y": y}


def written(columns: dict[str, Any]) -> bytes:
    stream = io.BytesIO()
    parquet.write_table(pyarrow.table(columns), stream, write_page_checksum=True)
    return stream.getvalue()


def test_columns_of_the_channels_names_need_no_profile(saved: Saved) -> None:
    (run,) = ingest([saved(written(flight()), "f.parquet")]).runs
    assert run.usable
    for name, values in flight().items():
        assert np.array_equal(run.record.channels[name], values)


def test_structs_and_stamps(saved: Saved) -> None:
    made = flight()
    at = pyarrow.array((1e6 * made["t"]).round().astype("int64")).cast(pyarrow.timestamp("us"))
    rates = pyarrow.StructArray.from_arrays([pyarrow.array(made[name]) for name in "pq"], ["p", "q"])
    raw = written({"stamp": at, "imu": rates, "x": made["delta_x"], "y": made["delta_y"], "who": ["me"] * 1500})
    profile = b"""
    [time]
    source = "stamp"
    [channels.p]
    source = "imu.p"
    [channels.q]
    source = "imu.q"
    [channels.delta_x]
    source = "x"
    [channels.delta_y]
    source = "y"
    """
    (run,) = ingest([saved(raw, "f.parquet")], saved(profile, "p.toml")).runs
    assert np.allclose(run.record.t, made["t"], atol=1e-6)
    assert np.allclose(run.record.channels["q"], made["q"])


def test_empty_cut_and_without_numbers(saved: Saved) -> None:
    raw = written(flight())
    for broken in (b"", raw[:4], raw[: len(raw) // 2]):
        with pytest.raises(TippathError, match="not a whole Parquet file"):
            ingest([saved(broken, "f.parquet")])
    with pytest.raises(TippathError, match="no column of numbers"):
        ingest([saved(written({"who": ["me"]}), "f.parquet")])


@pytest.mark.parametrize("count", COUNTS)
def test_no_damage_is_a_traceback(saved: Saved, count: int) -> None:
    raw = written(flight(60))
    for seed in bounded_turns(count):
        damaged = injure(raw, random.Random(seed), lambda chance: raw[: chance.randrange(1, 300)], cut=True)
        try:
            ingest([saved(damaged, "f.parquet")])
        except TippathError as error:
            assert len(str(error).splitlines()) == 1  # noqa: PT017


def test_a_small_file_that_becomes_gigabytes_is_refused(saved: Saved) -> None:
    raw = written({name: np.zeros(2_000_000) for name in ("t", "p", "q", "delta_x", "delta_y")})
    assert len(raw) < 1e6
    with bounded(), pytest.raises(TippathError, match="2000000 rows of 5 columns are far more"):
        ingest([saved(raw, "f.parquet")])
