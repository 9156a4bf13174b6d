"""A fitted model as files of other programs, its responses beside those that its runs show: JSON, MATLAB, CSV.

Pure: content as bytes; nothing is written here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from gcs.analysis.response_files import COLUMNS, complex_cube, csv_bytes, cube, json_bytes, saved_mat
from gcs.analysis.text.response import numbers, pair_document
from sysid.data.dataset import moves
from sysid.data.preprocess import ComplexArray
from sysid.data.record import CHANNELS, COMMANDS, Record
from sysid.fit.result import Fit
from sysid.model.response import transfer
from sysid.model.structure import FloatArray
from sysid.response.flown import POINTS, FlownResponses, NoResponseError, flown_responses

FORMAT = "tippath.model/1"
LOWEST_HZ = 0.1
"""Where a grid of frequencies begins that no measurement gives, and whose band begins at zero."""
OF_MODEL = ("model_db", "model_deg", "model_real", "model_imaginary")
MEASURED = COLUMNS[3:-1]


def shown_by(fit: Fit, records: Sequence[Record]) -> FlownResponses | str:
    """What the runs show of the model's inputs and outputs, or why they show nothing."""
    inputs = [name for name in fit.model.structure.commands if moves(name, records)]
    try:
        return flown_responses(records, fit.band_hz, inputs, fit.model.structure.outputs)
    except NoResponseError as error:
        return str(error)


def model_document(fit: Fit, measured: FlownResponses | str, relative_to: Path) -> dict[str, Any]:
    """The `tippath.model/1` document: what is no number is null. Paths are relative to the folder it will stand in."""
    structure = fit.model.structure
    frequency = _grid(fit) if isinstance(measured, str) else measured.responses.frequency_hz
    modelled = transfer(structure, fit.model.values, frequency)
    saved = fit.to_json(relative_to)
    return {
        "format": FORMAT,
        "base": saved["structure"]["base"],
        "effects": saved["structure"]["effects"],
        "states": list(structure.states),
        "inputs": list(structure.inputs),
        "outputs": list(structure.outputs),
        **saved["matrices"],
        "linear": structure.linear,
        "outside_matrices": saved["outside_matrices"],
        "parameters": saved["parameters"],
        "band_hz": list(fit.band_hz),
        "frequency_hz": numbers(frequency),
        "responses": [
            _pair(measured, output, command, modelled[k, m])
            for m, command in enumerate(structure.inputs)
            for k, output in enumerate(structure.outputs)
        ],
        "warnings": list(fit.warnings),
        "version": saved["version"],
    }


def _grid(fit: Fit) -> FloatArray:
    low, high = fit.band_hz
    return np.geomspace(max(low, LOWEST_HZ), high, POINTS) if high > LOWEST_HZ else np.array([high])


def _pair(measured: FlownResponses | str, output: str, command: str, modelled: ComplexArray) -> dict[str, Any]:
    """One response (f,) of the model, and as it was measured where it was."""
    with np.errstate(divide="ignore"):
        decibels = 20 * np.log10(np.abs(modelled))
    degrees = np.degrees(np.unwrap(np.angle(modelled)))
    found = (decibels, degrees, modelled.real, modelled.imag)
    return {
        **_measured(measured, output, command, modelled.size),
        **{name: numbers(column) for name, column in zip(OF_MODEL, found, strict=True)},
    }


def _measured(measured: FlownResponses | str, output: str, command: str, points: int) -> dict[str, Any]:
    if not isinstance(measured, str) and command in measured.responses.commands:
        return pair_document(measured, output, command)
    if command not in COMMANDS:
        why = f"{command} is no command: nothing was swept through it"
    else:
        why = measured if isinstance(measured, str) else f"{command} does not move in these runs"
    return {
        "output": output,
        "input": command,
        "unit": CHANNELS[output],
        "valid_hz": None,
        "reason": why,
        **{name: [None] * points for name in MEASURED},
        "valid": [False] * points,
    }


def csv_of_model(document: Mapping[str, Any]) -> bytes:
    """The responses: those of `tippath response`, and OF_MODEL behind them."""
    return csv_bytes(document, (*COLUMNS, *OF_MODEL))


def mat_of_model(document: Mapping[str, Any]) -> bytes:
    """MATLAB's format 5: A, B, C, D, `input_delay_s` (inputs,), `H_model` and, NaN where there is no number, `H`,
    `coherence`, `bound_db`, `bound_deg`, `valid` (outputs, inputs, f), and parameters by `parameter_names`."""
    parameters = document["parameters"]
    errors = [one["standard_error"] for one in parameters.values()]
    return saved_mat(
        document,
        {
            **{name: np.array(document[name], dtype=float) for name in (*"ABCD", "input_delay_s")},
            **{name: cube(document, name) for name in ("coherence", "bound_db", "bound_deg", "valid")},
            "H": complex_cube(document),
            "H_model": complex_cube(document, "model_"),
            "states": np.array(document["states"], dtype=object),
            "outside_matrices": np.array(document["outside_matrices"], dtype=object),
            "parameter_names": np.array(list(parameters), dtype=object),
            "parameter_values": np.array([one["value"] for one in parameters.values()], dtype=float),
            "parameter_units": np.array([one["unit"] for one in parameters.values()], dtype=object),
            "parameter_standard_errors": np.array([np.nan if one is None else one for one in errors], dtype=float),
        },
    )


KINDS: Mapping[str, Callable[[Mapping[str, Any]], bytes]] = MappingProxyType(
    {".csv": csv_of_model, ".json": json_bytes, ".mat": mat_of_model}
)
"""By the ending of a file's name."""
