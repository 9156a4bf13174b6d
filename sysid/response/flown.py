"""The responses that some runs show: of which commands they can tell, and of the others why not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from sysid.data.dataset import Dataset, moves
from sysid.data.preprocess import EXCITATIONS
from sysid.data.record import AXIS_OF, COMMANDS, CYCLIC, RATES, Record
from sysid.errors import SysidError
from sysid.response.measure import measure
from sysid.response.values import Responses

POINTS = 60
BEYOND = 0.7, 1.1
"""How far beyond the band bins are read, as factors: windows at its edges have both their sides."""
BY_DEFAULT = (*CYCLIC, "delta_e")
"""Commands that are taken for inputs where they move; others where they are named."""

LEAST_BESIDE = 0.1
"""Of the strongest command's motion, that one beside the cyclic ones has to be taken for an input by itself."""


class NoResponseError(SysidError):
    """Runs that show no response; the message says why and what to do."""


class Kept(Enum):
    """What keeps gusts out of the responses to a command."""

    LOGGED = "excitation logged"
    REBUILT = "excitation rebuilt"
    NOTHING = "commands"


class Why(Enum):
    """Why a pair has no band that can be trusted."""

    FOLLOWS = "command follows the others"
    FAINT = "no answer above noise"


@dataclass(frozen=True, eq=False, kw_only=True)
class FlownResponses:
    """Measured responses with the runs that they are of."""

    responses: Responses
    records: tuple[Record, ...]
    band_hz: tuple[float, float]
    remarks: tuple[str, ...]
    """What was dropped on the way."""

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """(output, command), the outputs of each command together."""
        return tuple((output, command) for command in self.responses.commands for output in self.responses.outputs)

    def kept(self, command: str) -> Kept:
        """What keeps gusts out of the responses to this command."""
        found = self.responses
        if found.references[found.commands.index(command)] not in EXCITATIONS:
            return Kept.NOTHING
        return Kept.REBUILT if any(record.excitation_from for record in self.records) else Kept.LOGGED

    def why_not(self, output: str, command: str) -> Why | None:
        """Why this pair has no band; None where it has one."""
        if self.responses.valid_hz(output, command) is not None:
            return None
        return Why.FAINT if self.responses.separates(output, command) else Why.FOLLOWS

    @property
    def not_swept(self) -> tuple[str, ...]:
        """Axes of the commands that no run swept, where runs tell what they swept; else of those that only follow."""
        told = {record.axis for record in self.records} - {None}
        commands = self.responses.commands
        unswept = [name for name in commands if AXIS_OF.get(name, name) not in told] if told else []
        follow = [one for one in commands if not any(self.responses.separates(k, one) for k in self.responses.outputs)]
        return tuple(AXIS_OF.get(name, name) for name in unswept or follow)


def flown_responses(
    records: Sequence[Record],
    band_hz: tuple[float, float],
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = RATES,
    points: int = POINTS,
) -> FlownResponses:
    """Responses of the outputs to the inputs, or to all that move of BY_DEFAULT, from all runs together.

    Raises NoResponseError where a channel is not there or does not move, or no run is long enough.
    """
    read_hz = BEYOND[0] * band_hz[0], BEYOND[1] * band_hz[1]
    dataset = Dataset(records=tuple(records), band_hz=read_hz)
    commands = _inputs(dataset, inputs)
    for name in outputs:
        if name not in dataset.common:
            raise NoResponseError(f"{name} is not logged in every run: name other --outputs, or runs that have it")
        if not any(float(np.ptp(record.channels[name])) > 0 for record in records):
            raise NoResponseError(f"{name} does not move at all in these runs: check its channel")
    spectra = dataset.viewed(commands, tuple(outputs)).spectra
    if not spectra:
        remarks = "; ".join(dataset.remarks) or f"no frequency of them lies in {band_hz[0]:g}-{band_hz[1]:g} Hz"
        raise NoResponseError(f"no run is long enough for a response: {remarks}")
    return FlownResponses(
        responses=measure(spectra, commands, tuple(outputs), points, within_hz=band_hz),
        records=dataset.records,
        band_hz=band_hz,
        remarks=tuple(dict.fromkeys(dataset.remarks)),
    )


def _inputs(dataset: Dataset, asked: Sequence[str]) -> tuple[str, ...]:
    """Commands as asked for, or those that move. Raises NoResponseError."""
    for name in asked:
        if name not in COMMANDS:
            raise NoResponseError(f"{name} is no command: there are {', '.join(COMMANDS)}")
        if name not in dataset.common:
            raise NoResponseError(f"{name} is not logged in every run: name other --inputs, or runs that have it")
        if not moves(name, dataset.records):
            raise NoResponseError(f"{name} does not move in these runs: there is no response to it; sweep its axis")
    moving = tuple(name for name in BY_DEFAULT if name in dataset.common and moves(name, dataset.records))
    strongest = max((_strongest(name, dataset.records) for name in moving), default=0.0)
    moving = tuple(
        name for name in moving if name in CYCLIC or _strongest(name, dataset.records) > LEAST_BESIDE * strongest
    )
    if not asked and not moving:
        raise NoResponseError("no command moves in these runs: there is no response to measure; fly a sweep")
    return tuple(dict.fromkeys(asked)) or moving


def _strongest(name: str, records: Sequence[Record]) -> float:
    """The largest standard deviation that a command has in any run."""
    return max(float(np.std(record.channels[name])) for record in records)
