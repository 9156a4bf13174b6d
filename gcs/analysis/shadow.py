"""Gains over recorded flights, without authority: what they would have commanded, whether the loop that was measured
holds them, and whether a bank that ran beside did what they say.

The measured loop clears or refuses. What ran beside can refuse, and never clears: nothing of it moved the vehicle.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs import documents
from gcs.errors import TippathError
from gcs.flight.gains import LARGEST, checksum
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.opening import open_log
from gcs.logs.runs.beside import RanBeside, ran_beside, seen_by_controllers
from sysid.control.judgement import Limits
from sysid.control.measured_stability import MeasuredStability, NotMeasured, Verdict, measured_stability
from sysid.control.regulator import Gains
from sysid.control.shadow import AXES, Fault, Output, faults_of, outputs, refused_by
from sysid.data.record import CYCLIC, Record
from sysid.model.structure import Model
from sysid.response.flown import FlownResponses, flown_responses

FORMAT = "tippath.shadow/1"
RATE_GAINS = "tippath.rate_gains/1"
ABOVE = 1.2
"""Of a band's end: from there on a command is noise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Beside:
    """A bank that ran beside on one flight, against what it should have put out."""

    path: str
    crc: int | None
    """Of the bank that ran; None where the log does not tell."""
    seconds: float
    outputs: tuple[Output, ...]
    """What it should have put out."""
    faults: tuple[Fault, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class ShadowFlight:
    """Gains judged over flights."""

    gains: Gains
    crc: int
    limits: Limits
    model: Model
    """What stands below the band;"""
    runs: tuple[str, ...]
    band_hz: tuple[float, float]
    loop_s: float
    stability: MeasuredStability
    outputs: tuple[Output, ...]
    """Over the runs."""
    targets_told: bool
    """Whether the runs' logs hold what was asked for; else nothing was asked for."""
    faults: tuple[Fault, ...]
    """What of that refuses."""
    beside: tuple[Beside, ...]

    @property
    def verdict(self) -> Verdict:
        faults = [*self.faults, *(fault for one in self.beside for fault in one.faults)]
        return "refused" if faults else self.stability.verdict

    def to_json(self) -> dict[str, Any]:
        """The `tippath.shadow/1` document."""
        return {
            "format": FORMAT,
            "verdict": self.verdict,
            "checksum": checksum(self.crc),
            "model": self.model.structure.title,
            "limits": self.limits.to_json(),
            "runs": list(self.runs),
            "band_hz": list(self.band_hz),
            "loop_s": self.loop_s,
            "measured": self.stability.to_json(),
            "outputs": [one.to_json() for one in self.outputs],
            "targets_told": self.targets_told,
            "faults": [one.to_json() for one in self.faults],
            "beside": [
                {
                    "path": one.path,
                    "checksum": None if one.crc is None else checksum(one.crc),
                    "seconds": one.seconds,
                    "outputs": [each.to_json() for each in one.outputs],
                    "faults": [each.to_json() for each in one.faults],
                }
                for one in self.beside
            ],
        }


def shadow_flight(
    designed: tuple[Gains, Model, Limits], crc: int, records: Sequence[Record], band_hz: tuple[float, float]
) -> ShadowFlight:
    """Gains with the model and limits that they were designed with, over runs of one vehicle.

    Raises TippathError where nothing is long enough, NoResponseError where the runs show no response.
    """
    gains, model, limits = designed
    if len(gains.K) != len(CYCLIC):
        raise TippathError("gains with more than the two cyclic commands are not run over flights: design without them")
    swept = [one for one in records if one.maneuver != "quiet"]
    if not swept:
        raise TippathError("quiet hover measures no loop: name the flight with the sweeps too")
    measured = flown_responses(swept, band_hz)
    logs = _logs(records)
    stretches, dt, told = seen_by_controllers(swept, logs)
    loop_s = max((one.loop_dt_s or dt for one in swept), default=dt)
    above_hz = ABOVE * band_hz[1]
    found = outputs(gains, dt, stretches, above_hz)
    ran = [one for each in logs.values() for log in each if (one := ran_beside(log)) is not None]
    return ShadowFlight(
        gains=gains,
        crc=crc,
        limits=limits,
        model=model,
        runs=tuple(one.id for one in swept),
        band_hz=band_hz,
        loop_s=loop_s,
        stability=_of_both_axes(measured, measured_stability(gains, model, measured.responses, limits, loop_s)),
        outputs=found,
        targets_told=told,
        faults=refused_by(found),
        beside=tuple(_beside(gains, crc, one, [run for run in swept if run.path != one.path], above_hz) for one in ran),
    )


def _of_both_axes(measured: FlownResponses, found: MeasuredStability) -> MeasuredStability:
    """What is told by noise and feedback alone of an axis that nobody swept neither clears nor refuses."""
    if set(measured.not_swept).isdisjoint(AXES):
        return found
    return replace(found, roots=None, thin=(), not_measured=(NotMeasured(why="axes"),))


def refuse_rate_gains(path: Path) -> None:
    """Raises TippathError for a file of an autopilot's rate gains, which are no bank's."""
    document = None
    with contextlib.suppress(documents.DocumentError):  # whoever reads the gains says what is wrong with the file
        document = documents.json_value(documents.read_text(path, "set of gains", LARGEST), str(path))
    if isinstance(document, dict) and document.get("format") == RATE_GAINS:
        raise TippathError(
            f"{path}: an ArduPilot's rate gains, and no LQR's: `tippath design FIT.json --for ardupilot` says what "
            "they hold; name a GAINS.json of `tippath design`"
        )


def _beside(gains: Gains, crc: int, ran: RanBeside, others: Sequence[Record], above_hz: float) -> Beside:
    """`others`: runs of other flights, whose innovations tell what is to be expected."""
    found = outputs(gains, ran.dt, ran.stretches, above_hz)
    predicted: tuple[Output, ...] = ()
    if others:
        stretches, dt, _ = seen_by_controllers(others, {})
        predicted = outputs(gains, dt, stretches, above_hz)
    other = ran.crc is not None and ran.crc != crc
    faults = (Fault(kind="other bank"),) if other else faults_of(gains, ran.dt, ran.stretches)
    return Beside(
        path=ran.path,
        crc=ran.crc,
        seconds=ran.dt * float(np.sum([len(one.rates) for one in ran.stretches])),
        outputs=found,
        faults=(*faults, *refused_by(found, predicted)),
    )


def _logs(records: Sequence[Record]) -> dict[str, list[DataFlashTables]]:
    """By path, of runs that were cut out of a log that tells what controllers saw."""
    paths = dict.fromkeys(one.path for one in records)
    found = {}
    for path in paths:
        if path and Path(path).is_file() and not path.endswith(".npz"):
            found[path] = [log for log, _ in open_log(Path(path), None).parts if isinstance(log, DataFlashTables)]
    return found
