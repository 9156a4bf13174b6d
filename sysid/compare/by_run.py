"""On which runs a model fails, each divided into noise and error for itself, and how the error grows with amplitude."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.compare.by_time import CONDITIONS
from sysid.compare.data_checks import mixed
from sysid.compare.finding_kinds import Suspicion
from sysid.compare.noise import TESTABLE, Levels
from sysid.compare.on_runs import ModelOnRuns
from sysid.compare.values import GROWTH_ERRORS, GROWTH_RATIO, Growth, RunError
from sysid.data.instrument import causes
from sysid.data.preprocess import ComplexArray, Spectrum
from sysid.data.record import Record, axis_of
from sysid.data.stacks import stack
from sysid.fit.noise import Division, divide
from sysid.fit.output_error import OutputError
from sysid.model.structure import FloatArray

SLOWEST_HZ = 0.45
"""Below it drift and wind are more than the sweep."""


class RunsAlone:
    """Every run divided for itself, and any of them together; each division is made once."""

    def __init__(self, on: ModelOnRuns) -> None:
        self.model = on.model
        self.outputs = on.outputs
        self._references = on.causes.references
        self.records: list[Record] = []
        self._parts: list[list[tuple[Spectrum, ComplexArray]]] = []
        for one, residual in zip(on.spectra, on.error.residuals, strict=True):
            for number, record in enumerate(self.records):
                if record is one.segment.record:
                    self._parts[number].append((one, residual))
                    break
            else:
                self.records.append(one.segment.record)
                self._parts.append([(one, residual)])
        self.ids = [record.id for record in self.records]
        self._known: dict[tuple[int, ...], tuple[Division, Levels]] = {}
        self.power = np.array(
            [np.sum([_energy(one, residual) for one, residual in each], axis=0) for each in self._parts]
        )
        """(runs, k) of the residual."""

    def divided(self, numbers: Sequence[int]) -> tuple[Division, Levels]:
        key = tuple(sorted(numbers))
        if key not in self._known:
            chosen = [part for number in key for part in self._parts[number]]
            stacks = stack([one for one, _ in chosen])
            residuals = {id(one): residual for one, residual in chosen}
            ones = np.ones(len(self.outputs))
            error = OutputError([residuals[id(one)] for group in stacks for one in group.spectra], ones, ones)
            division = divide(error, stacks, causes(stacks, self.model.structure.commands, self._references))
            self._known[key] = division, Levels.of(division, stacks)
        return self._known[key]

    def testable(self, number: int) -> bool:
        return self.divided([number])[1].testable >= TESTABLE

    def explained(self, numbers: Sequence[int]) -> FloatArray:
        """(k,), what one response of the commands explains of these runs' residual, slow drift left out.

        Drift that lies in a few of a window's bins looks explained to any few unknowns.
        """
        division, _ = self.divided(numbers)
        return np.asarray(np.sum(division.explained[division.edges_hz[:-1] >= SLOWEST_HZ], axis=0))

    @property
    def explained_apart(self) -> FloatArray:
        """(k,), what a response of their own explains of the runs: it is no noise."""
        return np.asarray(np.sum([self.explained([i]) for i in range(len(self.records))], axis=0))

    def mixture(self, runs: Sequence[RunError], *, across: bool, amplitudes: bool) -> list[Suspicion]:
        """Whether these runs look like those of different vehicles; `across` kinds of maneuvers too."""
        kinds = [(one.axis, one.maneuver) for one in runs]
        return mixed(
            self.ids,
            kinds,
            self.power,
            self.explained,
            across=across,
            amplitudes=amplitudes,
            outputs=self.outputs,
        )

    def runs(self) -> tuple[RunError, ...]:
        """What each run has of the error."""
        total = np.maximum(np.sum(self.power, axis=0), 1e-300)
        found = []
        for number, (record, each) in enumerate(zip(self.records, self._parts, strict=True)):
            measured = np.maximum(np.sum([_energy(one, one.Y) for one, _ in each], axis=0), 1e-300)
            samples = sum(one.samples for one, _ in each)
            commands = self.model.structure.commands
            energy = np.sum([_energy(one, one.U[: len(commands)]) for one, _ in each], axis=0)
            noise = None
            if self.testable(number):
                noise = dict(zip(self.outputs, map(float, self.divided([number])[0].noise_share), strict=True))
            found.append(
                RunError(
                    id=record.id,
                    maneuver=record.maneuver,
                    axis=record.axis,
                    duration_s=float(sum(one.segment.duration_s for one, _ in each)),
                    nrmse_percent=dict(
                        zip(self.outputs, map(float, 100 * (1 - np.sqrt(self.power[number] / measured))), strict=True)
                    ),
                    error_share=dict(zip(self.outputs, map(float, self.power[number] / total), strict=True)),
                    noise_share=noise,
                    command_rms=dict(zip(commands, map(float, np.sqrt(energy / samples)), strict=True)),
                    conditions={
                        name: float(np.mean(record.channels[name])) for name in CONDITIONS if name in record.channels
                    },
                )
            )
        return tuple(found)


def _energy(one: Spectrum, rows: ComplexArray) -> FloatArray:
    """(r,), mean square times samples."""
    return np.asarray(2 / one.samples * np.sum(np.abs(rows) ** 2, axis=1))


def growth_with_amplitude(runs: Sequence[RunError], alone: RunsAlone, outputs: Sequence[str]) -> tuple[Growth, ...]:
    """The noise-free error against the command's amplitude, where an axis was flown with amplitudes that differ."""
    found = []
    for axis, command in (("roll", "delta_x"), ("pitch", "delta_y")):
        at = [i for i, one in enumerate(runs) if one.axis == axis and one.maneuver == "chirp" and alone.testable(i)]
        sizes = np.array([runs[i].command_rms[command] for i in at])
        if len(at) < 2 or sizes.max() < GROWTH_RATIO * max(sizes.min(), 1e-12):
            continue
        together = alone.explained(at)
        separate = np.sum([alone.explained([i]) for i in at], axis=0)
        for k, output in enumerate(outputs):
            seconds = np.array([runs[i].duration_s for i in at])
            values, variances = [], []
            for i in at:
                division, levels = alone.divided([i])
                part = np.maximum(division.explained[:, k], 0)
                level = levels.noise[:, k]
                values.append(float(np.sum(division.explained[:, k])))
                variances.append(float(np.sum(2 * part * level + levels.unknowns * level**2)))
            value, deviation = np.array(values), np.sqrt(np.array(variances))
            unseen = value < GROWTH_ERRORS * deviation
            if np.any(unseen[sizes > sizes.min() * np.sqrt(GROWTH_RATIO)]):
                continue
            # where nothing is seen in small motion, it is at most what noise would hide
            value = np.maximum(value, GROWTH_ERRORS * deviation)
            x, y = np.log2(sizes), 0.5 * np.log(value / seconds)
            spread = x - x.mean()
            slope = float(np.sum(spread * y) / np.sum(spread**2)) - float(np.log(2))
            sd = float(np.sqrt(np.sum((spread * 0.5 * deviation / value) ** 2)) / np.sum(spread**2))
            changes = float((separate[k] - together[k]) / np.sum(alone.power[at, k]))
            found.append(
                Growth(
                    axis=axis_of(output),
                    command=command,
                    at_least=bool(np.any(unseen)),
                    low=float(sizes.min()),
                    high=float(sizes.max()),
                    per_doubling=float(np.exp(slope)),
                    standard_error=sd,
                    changes=changes,
                )
            )
    return tuple(found)
