"""Whether runs that are taken together are of one vehicle: by what their logs say of it, and by the fit itself.

A system id, a frame or a setting that differs is told before any number is believed. Where the logs say nothing, runs
of several logs that no one model answers are a hint.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs.analysis.text.findings import listed_runs
from gcs.errors import TippathError
from gcs.vehicle.identity import group_of
from sysid.data.record import Record
from sysid.fit.result import Fit

ANSWERED, LEFT = 30.0, 30.0
"""NRMSE in percent: one output is answered at most so badly, and another so much worse."""


def different_vehicles(records: Sequence[Record]) -> str | None:
    """That the logs of these runs tell of different vehicles, or of one that was set up differently; else None."""
    keys = dict.fromkeys(key for record in records for key in record.vehicle if group_of(key) != "gains")
    differing = []
    for key in keys:
        runs: dict[str, list[str]] = {}
        for record in records:
            if key in record.vehicle:
                runs.setdefault(record.vehicle[key], []).append(record.id)
        if len(runs) > 1:
            differing.append((key, runs))
    if not differing:
        return None
    key, runs = differing[0]
    apart = "; ".join(f"{key} {value}: {listed_runs(ids)}" for value, ids in runs.items())
    others = ", ".join(key for key, _ in differing[1:])
    return (
        f"these runs are of different vehicles, or of one that was set up differently ({apart}"
        f"{f'; {others} too' if others else ''}): no model can answer for both, fit them apart"
    )


def refuse_two_airframes(records: Sequence[Record]) -> None:
    """Raises TippathError where some of the runs are a helicopter's and others a multirotor's."""
    runs: dict[str, list[str]] = {}
    for record in records:
        if record.airframe is not None:
            runs.setdefault(str(record.airframe), []).append(record.id)
    if len(runs) > 1:
        apart = "; ".join(f"a {kind}'s: {listed_runs(ids)}" for kind, ids in runs.items())
        raise TippathError(
            f"these runs are of two vehicles ({apart}): no model answers for both, name those of one (or --airframe, "
            "where a log says the wrong one)"
        )


def doubted(records: Sequence[Record]) -> list[str]:
    """`different_vehicles` as a list, empty where there is nothing to tell."""
    doubt = different_vehicles(records)
    return [] if doubt is None else [doubt]


def not_of_one_model(fit: Fit, records: Sequence[Record]) -> list[str]:
    """That runs of several logs, fitted together, contradict each other; empty where nothing points to that."""
    logs = dict.fromkeys(record.sha256 or record.path for record in records)
    values = [value for value in fit.nrmse_percent.values() if value is not None]
    if len(logs) < 2 or not values:
        return []
    answered, left = min(values), max(values)
    structure = fit.model.structure
    strange = [
        one.name
        for one, value in zip(structure.parameters, fit.model.values, strict=True)
        if one.name not in fit.fixed and one.implausible(float(value))
    ]
    if not strange or answered > ANSWERED or left < answered + LEFT:
        return []
    return [
        f"the runs are of {len(logs)} logs, and one model answers some of them only ({answered:.0f} % against "
        f"{left:.0f} %, {', '.join(strange)} outside what physics allows): are they of one vehicle, set up alike? "
        "Fit them apart and compare the numbers"
    ]
