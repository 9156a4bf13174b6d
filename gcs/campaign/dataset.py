"""A campaign's results as Parquet files, a table each, for pandas, polars and DuckDB."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.campaign.work import CONDITIONS, Numbers, Outcome

if TYPE_CHECKING:
    import pyarrow

FOLDER = "dataset"
TEXTS, NUMBERS = "list<text>", "list<number>"
Columns = Mapping[str, str]
LOG: Columns = {"key": "text", "log": "text"}
"""In every table: `key` joins them; `log` is the path from the campaign's folder."""
TABLES: Mapping[str, Columns] = {
    "logs": {
        **LOG,
        "sha256": "text",
        "version": "text",
        "group": "text",
        "copy_of": "text",
        "flown": "time",
        "flown_told_by": "text",
        "airframe": "text",
        "reason": "text",
        "words": "text",
        **dict.fromkeys(CONDITIONS, "number"),
    },
    "runs": {
        **LOG,
        "run": "text",
        "maneuver": "text",
        "axis": "text",
        "start_s": "number",
        "duration_s": "number",
        "usable": "flag",
        "reasons": TEXTS,
    },
    "health": {
        **LOG,
        "run": "text",
        "rate_hz": "number",
        "gaps": "count",
        "gaps_s": "number",
        "jitter": "number",
        "saturated_share": "number",
        "axis": "text",
        "follows_low_hz": "number",
        "follows_high_hz": "number",
        "follows_share": "number",
    },
    "fits": {
        **LOG,
        "group": "text",
        "structure": "text",
        "base": "text",
        "effects": TEXTS,
        "band_low_hz": "number",
        "band_high_hz": "number",
        "output": "text",
        "nrmse_percent": "number",
        "validation_nrmse_percent": "number",
        "predicted_by": "text",
        "predicted_nrmse_percent": "number",
        "warnings": TEXTS,
    },
    "parameters": {
        **LOG,
        "group": "text",
        "place": "count",
        "parameter": "text",
        "unit": "text",
        "value": "number",
        "standard_error": "number",
        "model_error": "number",
        "covariance": NUMBERS,
    },
    "verdicts": {
        **LOG,
        "group": "text",
        "verdict": "text",
        "effect": "text",
        "stands_in": "flag",
        "indistinguishable": TEXTS,
        "indistinguishable_pairs": TEXTS,
        "confidence": "number",
        "explained_share": "number",
    },
}
"""Table -> column -> kind. `health` has a row for each excited axis of a run, `fits` one for each output;
`covariance` is the parameter's row of the matrix, in the order of `place`."""
Row = dict[str, Any]


def write_dataset(
    outcomes: Sequence[Outcome],
    groups: Mapping[str, Sequence[Outcome]],
    copies: Mapping[str, str],
    folder: Path,
) -> list[Path]:
    """`FOLDER/dataset/TABLE.parquet`, whole or not at all. Raises OSError."""
    group_of = {one.path: name for name, each in groups.items() for one in each}
    rows: dict[str, list[Row]] = {name: [] for name in TABLES}
    for one in outcomes:
        log = {"key": one.key, "log": _from(folder, one.path)}
        group = group_of.get(one.path)
        copy_of = copies.get(one.path)
        about = {**log, "group": group, "copy_of": None if copy_of is None else _from(folder, copy_of)}
        rows["logs"].append({**about, **_log_row(one)})
        rows["runs"] += [{**log, "run": run.id, **_fields(run, TABLES["runs"])} for run in one.runs]
        rows["health"] += [{**log, **row} for row in _health_rows(one)]
        if one.fit is not None:
            rows["fits"] += [{**log, "group": group, **row} for row in _fit_rows(one, one.fit)]
            rows["parameters"] += [{**log, "group": group, **row} for row in _parameter_rows(one.fit)]
        if one.verdict is not None:
            rows["verdicts"].append({**log, "group": group, **_fields(one.verdict, TABLES["verdicts"])})
    (folder / FOLDER).mkdir(exist_ok=True)
    return [_write(rows[name], columns, folder / FOLDER / f"{name}.parquet") for name, columns in TABLES.items()]


def _from(folder: Path, path: str) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return Path(path).as_posix()


def _fields(value: object, columns: Columns) -> Row:
    return {name: getattr(value, name) for name in columns if hasattr(value, name)}


def _log_row(one: Outcome) -> Row:
    return {
        **{name: getattr(one, name) for name in ("sha256", "version", "airframe", "reason")},
        "words": one.words or None,
        "flown": None if one.when is None else one.when.time,
        "flown_told_by": None if one.when is None else one.when.told_by,
        **{name: one.conditions.get(name) for name in CONDITIONS},
    }


def _health_rows(one: Outcome) -> Iterator[Row]:
    for run in one.runs:
        row = {"run": run.id, **_fields(run, TABLES["health"]), "axis": None}
        if not run.follows:
            yield row
        for axis, follows in run.follows.items():
            yield {
                **row,
                "axis": axis,
                "follows_low_hz": follows.low_hz,
                "follows_high_hz": follows.high_hz,
                "follows_share": follows.share,
            }


def _fit_rows(one: Outcome, fit: Numbers) -> Iterator[Row]:
    by = one.predicted
    predicted = {} if by is None or by.nrmse_percent is None else by.nrmse_percent
    for output, nrmse in fit.nrmse_percent.items():
        yield {
            "structure": fit.structure,
            "base": fit.base,
            "effects": fit.effects,
            "warnings": fit.warnings,
            "band_low_hz": fit.band_hz[0],
            "band_high_hz": fit.band_hz[1],
            "output": output,
            "nrmse_percent": nrmse,
            "validation_nrmse_percent": (fit.validation_nrmse_percent or {}).get(output),
            "predicted_by": None if by is None else by.by,
            "predicted_nrmse_percent": predicted.get(output),
        }


def _parameter_rows(fit: Numbers) -> Iterator[Row]:
    for place, ((name, number), row) in enumerate(zip(fit.parameters.items(), fit.covariance, strict=True)):
        yield {"place": place, "parameter": name, **_fields(number, TABLES["parameters"]), "covariance": row}


def _write(rows: Sequence[Row], columns: Columns, path: Path) -> Path:
    import pyarrow
    from pyarrow import parquet

    kinds: dict[str, pyarrow.DataType] = {
        "text": pyarrow.string(),
        "number": pyarrow.float64(),
        "count": pyarrow.int64(),
        "flag": pyarrow.bool_(),
        "time": pyarrow.timestamp("s", "UTC"),
        TEXTS: pyarrow.list_(pyarrow.string()),
        NUMBERS: pyarrow.list_(pyarrow.float64()),
    }
    schema = pyarrow.schema([(name, kinds[kind]) for name, kind in columns.items()])
    part = path.with_name(f"{path.name}.part")
    parquet.write_table(pyarrow.Table.from_pylist(list(rows), schema=schema), part)
    part.replace(path)
    return path
