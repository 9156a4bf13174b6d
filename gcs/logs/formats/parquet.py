"""Parquet, tables of columns as data pipelines keep them, as named arrays; read by pyarrow, its own project."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcs.errors import TippathError, to_install
from gcs.logs.formats.raw import most_inflated, unreadable
from gcs.logs.formats.tables import FloatArray
from gcs.logs.words import printable

MARK = b"PAR1"
INSTALL = to_install("pyarrow")
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


@dataclass(frozen=True, eq=False)
class ParquetFile:
    """What of a table are numbers."""

    columns: Mapping[str, FloatArray]
    """Name -> (n,), NaN where a cell is empty; time stamps in s. Of structs `imu.gyro`."""
    sha256: str


def recognises(head: bytes) -> bool:
    """Whether a file that begins with these bytes is one."""
    return head.startswith(MARK)


def read(path: Path) -> ParquetFile:
    """Raises TippathError for what cannot be read, holds no numbers, or needs pyarrow where that is not installed."""
    try:
        from pyarrow import parquet, types
    except ImportError as error:
        raise TippathError(f"{path}: a Parquet file, and what reads it is not installed: {INSTALL}") from error
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    columns: dict[str, FloatArray] = {}
    try:
        about = parquet.read_metadata(io.BytesIO(raw))
        if 8 * about.num_rows * about.num_columns > most_inflated(len(raw)):
            raise ValueError(f"{about.num_rows} rows of {about.num_columns} columns are far more than are packed so")
        table = parquet.read_table(io.BytesIO(raw), page_checksum_verification=True)
        while any(types.is_struct(one.type) for one in table.schema):
            table = table.flatten()
        for name, column in zip(table.column_names, table.columns, strict=True):
            kind = column.type
            if types.is_timestamp(kind):
                columns[printable(name)] = column.cast("int64").to_numpy().astype(np.float64) / PER_SECOND[kind.unit]
            elif types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind):
                columns[printable(name)] = column.to_numpy().astype(np.float64)
    except Exception as error:  # the library raises many kinds of error for a damaged file
        reason = printable(str(error).splitlines()[0][:100]) if str(error) else type(error).__name__
        raise TippathError(f"{path}: not a whole Parquet file ({reason}); copy it again") from error
    if not columns:
        raise TippathError(f"{path}: no column of numbers in it")
    return ParquetFile(columns, hashlib.sha256(raw).hexdigest())
