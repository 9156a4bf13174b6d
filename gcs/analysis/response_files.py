"""Measured responses as files of other programs: CSV, JSON, MATLAB's `.mat`, and the columns that CIFER lists.

Pure: content as bytes; nothing is written here.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.model.structure import FloatArray

COLUMNS = (
    *("output", "input", "frequency_hz", "db", "deg", "coherence", "bound_db", "bound_deg"),
    *("real", "imaginary", "window_hz", "valid"),
)
NUMBERS = COLUMNS[2:-1]


def csv_bytes(document: Mapping[str, Any], columns: Sequence[str] = COLUMNS) -> bytes:
    """A row for each pair and frequency; empty where there is no number."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for pair in document["responses"]:
        each = {"frequency_hz": document["frequency_hz"], **pair}
        for at in range(len(document["frequency_hz"])):
            writer.writerow([_cell(each[name], at) for name in columns])
    return stream.getvalue().encode()


def _cell(column: Any, at: int) -> str:
    """Of one pair: the same word in every row, or this row's number."""
    if isinstance(column, str):
        return column
    number = column[at]
    return "" if number is None else f"{number:.6g}"


def json_bytes(document: Mapping[str, Any]) -> bytes:
    """The document itself."""
    return (json.dumps(document, indent=1, allow_nan=False) + "\n").encode()


def mat_bytes(document: Mapping[str, Any]) -> bytes:
    """MATLAB's format 5: `frequency_hz` (f,), the others (outputs, inputs, f) with NaN where there is no number."""
    outputs = document["outputs"]
    arrays = {name: cube(document, name) for name in (*NUMBERS[1:6], "window_hz", "valid")}
    arrays["multiple_coherence"] = np.array([[_number(x) for x in document["multiple_coherence"][k]] for k in outputs])
    return saved_mat(document, {"H": complex_cube(document), **arrays, "bounds_percent": document["bounds_percent"]})


def cube(document: Mapping[str, Any], name: str) -> FloatArray:
    """One column of all pairs, (outputs, inputs, f)."""
    each = {(pair["output"], pair["input"]): pair for pair in document["responses"]}
    rows = [[[_number(x) for x in each[k, m][name]] for m in document["inputs"]] for k in document["outputs"]]
    return np.array(rows, dtype=float)


def complex_cube(document: Mapping[str, Any], prefix: str = "") -> ComplexArray:
    """The responses themselves, (outputs, inputs, f)."""
    return np.asarray(cube(document, f"{prefix}real") + 1j * cube(document, f"{prefix}imaginary"))


def saved_mat(document: Mapping[str, Any], arrays: Mapping[str, Any]) -> bytes:
    """Arrays with the frequencies and the names that they stand for."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.io import savemat

    hertz = np.array([_number(x) for x in document["frequency_hz"]])
    stream = io.BytesIO()
    words = {name: np.array(document[name], dtype=object) for name in ("inputs", "outputs")}
    frequency = {"frequency_hz": hertz, "omega_rad_s": 2 * np.pi * hertz}
    savemat(stream, {**arrays, **frequency, **words}, oned_as="column")
    return stream.getvalue()


def cifer_bytes(document: Mapping[str, Any]) -> bytes:
    """A listing as CIFER's: for each pair rad/s, dB, degrees, coherence, and the normalised random error epsilon.

    The bounds are 95 %, about two random errors; points without a response are left out.
    """
    lines = ["! conditioned frequency responses, measured by tippath"]
    for pair in document["responses"]:
        lines += ["!", f"! INPUT : {pair['input']}", f"! OUTPUT: {pair['output']}"]
        if pair["reason"] is not None:
            lines.append(f"! {pair['reason']}")
        lines.append(f"!{'FREQ(rad/s)':>13}{'MAG(dB)':>14}{'PHASE(deg)':>14}{'COHERENCE':>14}{'ERROR':>14}")
        for at, hertz in enumerate(document["frequency_hz"]):
            row = [pair[name][at] for name in ("db", "deg", "coherence", "bound_db")]
            if None not in row:
                error = row[3] * np.log(10) / 20 / 2
                lines.append("".join(f"{x:14.6g}" for x in (2 * np.pi * hertz, *row[:3], error)))
    return ("\n".join(lines) + "\n").encode()


def _number(value: float | bool | None) -> float:
    return np.nan if value is None else float(value)


KINDS: Mapping[str, Callable[[Mapping[str, Any]], bytes]] = MappingProxyType(
    {".csv": csv_bytes, ".json": json_bytes, ".mat": mat_bytes, ".txt": cifer_bytes}
)
"""By the ending of a file's name."""
