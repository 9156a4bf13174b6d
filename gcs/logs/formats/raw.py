"""The bytes of a log's file, and fields gathered out of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]
INFLATED = 20
"""Times its size; measured numbers become 2 to 5 times."""
LEAST_INFLATED = 32 << 20


def unreadable(path: Path | str, error: OSError) -> TippathError:
    """What to raise where the system does not hand out a file's bytes."""
    return TippathError(f"{path}: cannot be read ({error.strerror or error})")


def most_inflated(packed: int) -> int:
    """Bytes that a compressed log of so many may become: one that becomes more was made to fill a memory."""
    return max(LEAST_INFLATED, INFLATED * packed)


def read_padded(path: Path, pad: int, fill: int = 0) -> tuple[Bytes, int]:
    """A file's bytes with `pad` more of value `fill` behind them, and how many are the file's. Raises TippathError."""
    try:
        data = np.full(path.stat().st_size + pad, fill, np.uint8)
        with path.open("rb") as stream:
            size = stream.readinto(data[: data.size - pad].data)
    except OSError as error:
        raise unreadable(path, error) from error
    return data, size


def gathered(data: Bytes, offset: int, stored: Any, starts: NDArray[np.integer[Any]]) -> NDArray[Any]:
    """What stands `offset` bytes after each of the places, of any numpy type, shape (n,)."""
    dtype = np.dtype(stored)
    if starts.size == 0:
        return np.empty(0, dtype)
    # every byte as a possible first byte: the gather then copies the field alone
    count = data.size - offset - dtype.itemsize + 1
    everywhere = np.ndarray((count,), f"V{dtype.itemsize}", data, offset, (1,))
    values: NDArray[Any] = everywhere[starts].view(dtype)
    return values
