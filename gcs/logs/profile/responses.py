"""Frequency responses as files: columns of frequency, response and coherence, in CSV, MATLAB's `.mat`, the JSON of
`tippath response`, and the text that CIFER lists.

Which columns are what is told by their names, or by [response] of a profile; which output answers which command, by
columns of those names, or by the profile. Rows may rise or fall in frequency.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.errors import TippathError
from gcs.logs.formats.csv_layout import Layout, layout_of
from gcs.logs.formats.mat import MatFile
from gcs.logs.profile.profiles import ResponseTable
from sysid.data.of_response import Response, error_of_coherence
from sysid.data.record import CHANNELS, COMMANDS, FloatArray

FORMAT = "tippath.response/1"
NAMES: Mapping[str, tuple[str, ...]] = {
    "hz": ("frequency_hz", "freq_hz", "f_hz", "hz", "f", "frequency", "freq"),
    "omega": ("omega", "omega_rad_s", "w", "rad_s", "freq_rad_s", "frequency_rad_s"),
    "real": ("real", "re"),
    "imaginary": ("imaginary", "imag", "im"),
    "db": ("db", "mag_db", "magnitude_db", "gain_db"),
    "magnitude": ("mag", "magnitude", "gain", "abs"),
    "deg": ("deg", "phase_deg", "degrees", "phase"),
    "coherence": ("coherence", "coh", "gamma2", "partial_coherence"),
    "bound_db": ("bound_db",),
    "error": ("error", "random_error", "epsilon"),
    "valid": ("valid",),
    "response": ("response", "h"),
}
"""What a column is -> its names, in lower case."""
BOUND_OF_ERROR = 20 / np.log(10) * 2
"""dB that 95 of 100 errors are below, for each unit of relative standard error."""
CIFER = re.compile(rb"^!\s*INPUT\s*:", re.MULTILINE)
FEWEST_NUMBERS = 0.5  # of the rows, so that a file is one of numbers at all
LISTED = 8
HEAD = 1 << 14
"""Bytes that tell whether a file is one: a log may be large."""


class NoResponseError(Exception):
    """The file is none of these; it may be something else."""


Columns = Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class _Pair:
    output: str
    command: str
    columns: Columns


def of_csv(raw: bytes, path: str, table: ResponseTable | None) -> list[Response]:
    """Raises NoResponseError for what is no response, TippathError for one that cannot be read."""
    if table is None and CIFER.search(raw[:HEAD]):
        pairs = list(_of_cifer(raw.decode("utf-8", "replace")))
        if not pairs:
            raise TippathError(f"{path}: names of a response and no row of it; write it again, whole")
        return [_response(pair, path) for pair in pairs]
    if table is not None and table.columns:
        raw = ",".join(table.columns).encode() + b"\n" + _commas(raw)
    if table is None and not _begins_as_response(raw, path):
        raise NoResponseError
    layout = layout_of(raw, path)
    names = layout.names
    kinds = _kinds(names, layout.units, table)
    if not _is_response(kinds):
        raise TippathError(f"{path}: no frequency with its response in columns {', '.join(names[:LISTED])}; {_WANTED}")
    return [
        _response(_named(output, command, columns, path, table), path, table)
        for (output, command), columns in _by_pair(layout, kinds).items()
    ]


def _by_pair(layout: Layout, kinds: Mapping[str, int]) -> dict[tuple[str, str], Columns]:
    """The rows of each output per input; all are of one, without a name, where no columns are called so."""
    lower = [name.lower() for name in layout.names]
    at = [lower.index(word) if word in lower else None for word in ("output", "input")]
    pairs: dict[tuple[str, str], list[list[str]]] = {}
    try:
        rows = list(csv.reader(io.StringIO(layout.body), delimiter=layout.separator))
    except csv.Error as error:
        raise TippathError(f"{layout.path}: cannot be read ({error}); is it a CSV file?") from error
    for row in rows:
        output, command = ("" if i is None or i >= len(row) else row[i].strip() for i in at)
        pairs.setdefault((output, command), []).append(row)
    return {
        pair: {kind: np.array([_number(row, i) for row in rows]) for kind, i in kinds.items()}
        for pair, rows in pairs.items()
    }


def _begins_as_response(raw: bytes, path: str) -> bool:
    try:
        layout = layout_of(raw[:HEAD], path)
    except TippathError:
        return False
    return _is_response(_kinds(layout.names, layout.units, None))


_WANTED = (
    "it needs frequency_hz or omega, then real and imaginary, or db and deg; name its columns in a profile: [response]"
)


def of_mat(file: MatFile, path: str, table: ResponseTable | None) -> list[Response]:
    """As `of_csv`; `H` of several outputs and inputs is (outputs, inputs, frequencies), beside their names."""
    names = list(file.arrays)
    kinds = _kinds(names, [""] * len(names), table)
    arrays = {kind: np.squeeze(file.arrays[names[i]]) for kind, i in kinds.items()}
    if not _is_response(kinds):
        if table is None:
            raise NoResponseError
        raise TippathError(f"{path}: no frequency with its response among {', '.join(names[:LISTED])}; {_WANTED}")
    size = arrays["hz" if "hz" in arrays else "omega"].size
    outputs, inputs = (list(file.texts.get(word, ())) for word in ("outputs", "inputs"))
    shape = (len(outputs) or 1, len(inputs) or 1, size)
    cubes = {kind: array.reshape(shape) for kind, array in arrays.items() if array.size == math.prod(shape)}
    cubes |= {kind: np.broadcast_to(arrays[kind].ravel(), shape) for kind in ("hz", "omega") if kind in arrays}
    if not _is_response(cubes) or size == 0:
        raise TippathError(f"{path}: frequency and response differ in size; give each frequency its response")
    found = []
    for k, m in np.ndindex(shape[:2]):
        columns = {kind: cube[k, m] for kind, cube in cubes.items()}
        named = (outputs[k] if outputs else "", inputs[m] if inputs else "")
        found.append(_response(_named(*named, columns, path, table), path, table))
    return found


def of_json(raw: bytes, path: str) -> list[Response]:
    """The document of `tippath response`. Raises TippathError for any other."""
    try:
        document = json.loads(raw)
        if document["format"] != FORMAT:
            raise ValueError(f"format {document['format']}")
        frequency_hz = document["frequency_hz"]
        pairs = [
            _Pair(
                str(one["output"]),
                str(one["input"]),
                {
                    "hz": _numbers(frequency_hz),
                    **{kind: _numbers(one[kind]) for kind in ("real", "imaginary", "bound_db", "coherence", "valid")},
                },
            )
            for one in document["responses"]
        ]
        if any(column.shape != pair.columns["hz"].shape for pair in pairs for column in pair.columns.values()):
            raise ValueError("columns of unequal length")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise TippathError(
            f"{path}: not a {FORMAT} document, which is what of .json is read as runs; write one by "
            "tippath response RUN... -o FILE.json"
        ) from error
    return [_response(pair, path) for pair in pairs]


def _of_cifer(text: str) -> Iterator[_Pair]:
    """Pairs as CIFER lists them: `! INPUT : delta_x`, `! OUTPUT: p`, then rad/s, dB, degrees, coherence, error."""
    kinds = ("omega", "db", "deg", "coherence", "error")
    command = output = ""
    rows: list[list[float]] = []
    for line in [*text.splitlines(), "! INPUT : "]:
        told = re.match(r"!\s*(INPUT|OUTPUT)\s*:\s*(\S*)", line)
        if told is not None and told[1] == "INPUT":
            if rows:
                yield _Pair(output, command, dict(zip(kinds, np.array(rows).T, strict=False)))
            command, rows = told[2], []
        elif told is not None:
            output = told[2]
        elif line.strip() and not line.startswith("!"):
            row = line.split()
            rows.append([_number(row, i) for i in range(len(kinds))])


def _commas(raw: bytes) -> bytes:
    """Rows of numbers as a CSV separates them."""
    lines = raw.replace(b"\r\n", b"\n").split(b"\n")
    return b"\n".join(re.sub(rb"[ \t;]+", b",", line.strip()) for line in lines if not line.startswith((b"#", b"%")))


def _kinds(names: Sequence[str], units: Sequence[str], table: ResponseTable | None) -> dict[str, int]:
    """What a column is -> its place."""
    kinds: dict[str, int] = {}
    for place, (name, unit) in enumerate(zip(names, units, strict=True)):
        plain = re.sub(r"[ .-]+", "_", name.strip().lower())
        kind = next((kind for kind, known in NAMES.items() if plain in known), None)
        turn = unit.strip().lower().replace(" ", "")
        if kind == "hz" and turn in ("rad/s", "rad/sec"):
            kind = "omega"
        elif kind == "magnitude" and turn == "db":
            kind = "db"
        if kind is not None:
            kinds.setdefault(kind, place)
    for kind, named in {} if table is None else _told(table).items():
        if named in names:
            kinds[kind] = names.index(named)
    return kinds


def _told(table: ResponseTable) -> dict[str, str]:
    """What a profile says that columns are."""
    told = {kind: getattr(table, kind) for kind in ("real", "imaginary", "db", "deg", "coherence", "response")}
    told["omega" if table.unit == "rad/s" else "hz"] = table.frequency
    return {kind: name for kind, name in told.items() if name is not None}


def _is_response(kinds: Mapping[str, Any]) -> bool:
    size = "db" in kinds or "magnitude" in kinds
    answered = {"real", "imaginary"} <= set(kinds) or (size and "deg" in kinds) or "response" in kinds
    return answered and ("hz" in kinds or "omega" in kinds)


def _named(output: str, command: str, columns: Columns, path: str, table: ResponseTable | None) -> _Pair:
    """Raises TippathError where nothing tells of what this is the response."""
    output, command = output or (table.output if table else ""), command or (table.input if table else "")
    if not output or not command:
        raise TippathError(
            f"{path}: a frequency response, and nothing tells of what: name it in a profile: [response] "
            'input = "delta_y", output = "q"'
        )
    return _Pair(output, command, columns)


def _response(pair: _Pair, path: str, table: ResponseTable | None = None) -> Response:
    """Raises TippathError for channels that there are not, and for a file that holds no numbers."""
    columns = pair.columns
    if pair.command not in COMMANDS or pair.output not in CHANNELS or pair.output in COMMANDS or pair.output == "t":
        raise TippathError(
            f"{path}: {pair.output[:40]} per {pair.command[:40]} is no output per command: commands are "
            f"{', '.join(COMMANDS)}, outputs p, q or another channel"
        )
    frequency_hz = np.real(columns["hz"] if "hz" in columns else columns["omega"] / (2 * np.pi)).astype(float)
    if np.mean(np.isfinite(frequency_hz)) < FEWEST_NUMBERS:
        raise TippathError(f"{path}: most rows hold no frequency; {_WANTED}")
    with np.errstate(all="ignore"):
        H = (1.0 if table is None else table.scale) * _complex(columns)
        error = _error(columns)
    if "valid" in columns:
        H = np.where(np.real(columns["valid"]) > 0, H, np.nan)
    return Response(output=pair.output, command=pair.command, frequency_hz=frequency_hz, H=H, relative_error=error)


def _complex(columns: Columns) -> Any:
    if "response" in columns:
        return np.asarray(columns["response"], complex)
    if {"real", "imaginary"} <= set(columns):
        return columns["real"] + 1j * columns["imaginary"]
    size = columns["magnitude"] if "magnitude" in columns else 10 ** (columns["db"] / 20)
    return size * np.exp(1j * np.deg2rad(columns["deg"]))


def _error(columns: Columns) -> FloatArray | None:
    """Relative standard error, from bounds, from errors, else from coherence; None where nothing tells."""
    if "bound_db" in columns:
        return np.asarray(np.real(columns["bound_db"]) / BOUND_OF_ERROR)
    if "error" in columns:
        return np.real(columns["error"])
    return error_of_coherence(np.real(columns["coherence"])) if "coherence" in columns else None


def _number(row: Sequence[str], place: int) -> float:
    try:
        return float(row[place])
    except (ValueError, IndexError):
        return np.nan


def _numbers(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else float(value) for value in values])
