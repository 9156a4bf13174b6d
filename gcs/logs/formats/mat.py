"""MATLAB's `.mat` as named arrays: format 5 by `gcs.logs.formats.mat5`, format 7.3, which is HDF5, by h5py.

Structs and cells are taken apart: `flight.imu.gyro`, `signals[1].values`, counted from 0. What is in objects
(timeseries, tables, figures) only MATLAB knows: they are left out by name.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import TippathError, to_install
from gcs.logs.formats import mat5
from gcs.logs.formats.raw import most_inflated, unreadable
from gcs.logs.words import printable

MARK = b"MATLAB 5.0 MAT-file"
MARK_73 = b"MATLAB 7.3 MAT-file"
INSTALL = f"install it: {to_install('h5py')}"
TOO_MUCH = "far more in it than what is measured packs to"
MOST_ARRAYS = 20_000
_NUMBERED = re.compile(r"\[\d+\]$")
NUMBERS = "biufc"
OBJECT, BOOLEANS = "MATLAB_object_decode", 2
"""An attribute of what is no plain array, and what it says of booleans, which are one."""


@dataclass(frozen=True, eq=False)
class MatFile:
    """What of a .mat are numbers."""

    arrays: Mapping[str, np.ndarray]
    """Name -> numbers of any shape, real or complex."""
    texts: Mapping[str, tuple[str, ...]]
    """Name -> texts; those of a cell by the cell's own name."""
    objects: tuple[str, ...]
    """Names of what is an object, with its class where the file tells."""
    sha256: str


def recognises(head: bytes) -> bool:
    """Whether a file that begins with these bytes is one of MATLAB's; format 4 has no mark."""
    return head.startswith((MARK, MARK_73))


def read(path: Path) -> MatFile:
    """Raises TippathError for what cannot be read, holds no numbers, or needs h5py where that is not installed."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error
    arrays: dict[str, np.ndarray] = {}
    texts: dict[str, tuple[str, ...]] = {}
    objects: list[str] = []
    for name, value in _of_hdf5(path) if raw.startswith(MARK_73) else _of_format_5(path, raw):
        if isinstance(value, str):
            objects.append(f"{printable(name)}{value and f' ({printable(value)})'}")
        elif value.dtype.kind == "U":
            cell = _NUMBERED.sub("", printable(name))
            texts[cell] = (*texts.get(cell, ()), *value.tolist())
        elif len(arrays) < MOST_ARRAYS:
            arrays[printable(name)] = value
    if objects and not arrays:
        raise TippathError(
            f"{path}: {_listed(objects)}: objects of MATLAB, which only MATLAB reads; save what is in them as arrays: "
            "t = ts.Time; x = ts.Data; save('flight.mat', 't', 'x')"
        )
    if not arrays:
        raise TippathError(f"{path}: no array of numbers in it; save time, rates and commands as arrays")
    return MatFile(arrays, texts, tuple(objects), hashlib.sha256(raw).hexdigest())


def left_out(file: MatFile) -> tuple[str, ...]:
    """A sentence on the objects, where there are any."""
    if not file.objects:
        return ()
    return (f"left out: {_listed(file.objects)}: objects of MATLAB; save what is in them as arrays (ts.Time, ts.Data)",)


def _listed(objects: list[str] | tuple[str, ...]) -> str:
    return ", ".join(objects[:6]) + (f" and {len(objects) - 6} more" if len(objects) > 6 else "")


def _damaged(path: Path, error: BaseException) -> TippathError:
    reason = printable(str(error).splitlines()[0][:100]) if str(error) else type(error).__name__
    return TippathError(f"{path}: not a whole .mat file ({reason}); copy it again, or save it again in MATLAB")


def _of_format_5(path: Path, raw: bytes) -> list[tuple[str, Any]]:
    if not raw:
        raise TippathError(f"{path}: the file is empty; copy it again")
    if not raw.startswith(MARK[:6]):
        raise TippathError(f"{path}: no .mat of format 5 or 7.3; save it in MATLAB as save('flight.mat', '-v7')")
    try:
        return list(mat5.parts(raw))
    except mat5.DamagedError as error:
        raise _damaged(path, error) from error


# ------------------------------------------------------------------------------------------------ format 7.3


def _of_hdf5(path: Path) -> list[tuple[str, Any]]:
    try:
        import h5py
    except ImportError as error:
        raise TippathError(
            f"{path}: a .mat of format 7.3, which h5py reads, and h5py is not installed; {INSTALL}, or save it with -v7"
        ) from error
    try:
        with h5py.File(path, "r") as file:
            most = most_inflated(path.stat().st_size)
            parts = []
            for name in file:
                for part in _nodes(file, name, file[name], most) if name[:1] != "#" else ():
                    parts.append(part)
                    most -= getattr(part[1], "nbytes", 0)
                    if most < 0:
                        raise ValueError(TOO_MUCH)
            return parts
    except Exception as error:  # the library raises nearly every kind of error for a damaged file
        raise _damaged(path, error) from error


def _nodes(file: Any, name: str, node: Any, most: int, depth: int = 0) -> Iterator[tuple[str, Any]]:
    """As `mat5.parts`; arrays are turned, for MATLAB writes them column by column.

    Raises ValueError for an array of more bytes than `most`.
    """
    import h5py

    kind = node.attrs.get("MATLAB_class", b"")
    kind = kind.decode("utf-8", "replace") if isinstance(kind, bytes) else str(kind)
    if depth > mat5.DEEPEST:
        return
    if OBJECT in node.attrs and node.attrs[OBJECT] != BOOLEANS:
        yield name, kind
        return
    if isinstance(node, h5py.Group):
        for key in node:
            yield from _nodes(file, f"{name}.{key}", node[key], most, depth + 1)
    elif "MATLAB_empty" in node.attrs or not node.size:
        return
    elif node.nbytes > most:
        raise ValueError(TOO_MUCH)
    elif kind == "char" and node.dtype.kind == "u":
        yield name, np.array([printable("".join(map(chr, row))) for row in np.atleast_2d(node[()].T)], dtype=str)
    elif node.dtype == h5py.ref_dtype:
        references = np.asarray(node[()]).T.ravel()
        for i, reference in enumerate(references[:MOST_ARRAYS]):
            if reference:
                yield from _nodes(
                    file, f"{name}[{i}]" if references.size > 1 else name, file[reference], most, depth + 1
                )
    elif node.dtype.names == ("real", "imag"):
        held = np.asarray(node[()]).T
        yield name, held["real"] + 1j * held["imag"]
    elif node.dtype.kind in NUMBERS:
        yield name, np.asarray(node[()]).T
