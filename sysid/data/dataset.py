"""Runs prepared once: their bins with every input that any model may read, and the excitation as an instrument.

Gusts reach the commands through the feedback, and with them every residual. So beside the bins as flown stand those of
the commands as the logged excitation alone moved them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.instrument import FOLLOWING, Causes, caused_by, causes
from sysid.data.preprocess import Spectrum, spectra
from sysid.data.record import COMMANDS, CYCLIC, RATES, Record
from sysid.data.stacks import Stack, stack
from sysid.errors import FitError

CHANNELS_READ = ("omega", "airspeed", "alpha", "beta", "r", "phi", "theta")
"""Beside commands, what effects of the catalogue read."""
LEAST_MOTION = {"omega": 0.002, "airspeed": 0.01}
"""Relative spread from which on a flight condition can show anything."""
LEAST_COMMAND = 1e-3
STILL = 1e-12


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Runs as every candidate sees them: their bins with every input that any may read."""

    spectra: tuple[Spectrum, ...]
    stacks: tuple[Stack, ...]
    imposed: tuple[Stack, ...]
    """The same with commands, and channels that follow the motion, only as far as the excitation caused them."""
    causes: Causes
    available: frozenset[str]
    """Channels that all runs have and that move."""
    still: frozenset[str]
    """Channels that all runs have and that do not move."""
    constants: Mapping[str, float]
    """Omega_0, V_0: means over the fitted runs."""

    def viewed(self, inputs: tuple[str, ...]) -> list[Spectrum]:
        """The bins with a structure's own inputs, as a fit wants them."""
        return [viewed(one, inputs) for one in self.spectra]

    @property
    def samples(self) -> int:
        return sum(group.samples for group in self.stacks)


def viewed(one: Spectrum, inputs: tuple[str, ...]) -> Spectrum:
    """Bins with these inputs only."""
    if one.inputs == inputs:
        return one
    return replace(one, U=one.U[[one.inputs.index(name) for name in inputs]], inputs=inputs)


def dataset(
    records: Sequence[Record],
    band_hz: tuple[float, float],
    like: Dataset | None = None,
    outputs: Sequence[str] = RATES,
) -> Dataset:
    """Prepare runs that are measured in `outputs`.

    `like` gives validation runs the channels of the fitted ones. Raises FitError without any data.
    """
    common = set.intersection(*(set(record.channels) for record in records))
    if like is None:
        moving = {name for name in (*COMMANDS, *CHANNELS_READ) if name in common and _moves(name, records)}
        still = {name for name in (*COMMANDS, *CHANNELS_READ) if name in common} - moving
    else:
        moving, still = set(like.available), set(like.still)
    always = ("delta_x", "delta_y", "t")  # time is what a drift is written in
    inputs = [name for name in (*COMMANDS, *CHANNELS_READ, "t") if name in moving or name in always]
    found, _ = spectra(records, inputs, outputs, band_hz)
    if not found:
        raise FitError("no run has 2 s of gap-free samples")
    stacks = stack(found)
    made_by = causes(stacks, [name for name in inputs if name in CYCLIC or f"excitation_{name[-1]}" in common])
    return Dataset(
        spectra=tuple(found),
        stacks=tuple(stacks),
        imposed=tuple(_imposed(stacks, made_by)),
        causes=made_by,
        available=frozenset({*moving, *(common & {"t", "p", "q"})}),
        still=frozenset(still),
        constants=means(records) if like is None else like.constants,
    )


def _moves(name: str, records: Sequence[Record]) -> bool:
    whole = np.concatenate([record.channels[name] for record in records])
    spread, mean = float(np.std(whole)), abs(float(np.mean(whole)))
    if name in COMMANDS:
        return any(float(np.std(record.channels[name])) > LEAST_COMMAND for record in records)
    return spread > max(LEAST_MOTION.get(name, 0.0) * mean, STILL)


def _imposed(stacks: Sequence[Stack], made_by: Causes) -> list[Stack]:
    """Stacks whose commands are what the excitation caused, in frequency and in time."""
    made = []
    for group, caused in zip(stacks, made_by.caused, strict=True):
        U = group.U.copy()
        at = [group.inputs.index(name) for name in made_by.commands]
        U[at] = caused
        following = [i for i, name in enumerate(group.inputs) if name in FOLLOWING]
        if following:
            U[following] = caused_by(group.U[following], caused, group.scale, group.frequency_hz)
        changed = sorted({*at, *following})
        spectra = []
        for one, part in zip(group.spectra, group.slices, strict=True):
            channels = dict(one.segment.channels)
            for row, moving in zip(changed, one.in_time(U[changed, part]), strict=True):
                channels[group.inputs[row]] = np.mean(channels[group.inputs[row]]) + moving
            spectra.append(replace(one, segment=replace(one.segment, channels=channels), U=U[:, part]))
        made.append(replace(group, spectra=tuple(spectra), U=U))
    return made


def means(records: Sequence[Record]) -> dict[str, float]:
    """The mean flight condition, Omega_0 and V_0, as far as every run logs it."""
    return {
        name: float(np.mean(np.concatenate([record.channels[channel] for record in records])))
        for name, channel in (("Omega_0", "omega"), ("V_0", "airspeed"))
        if all(channel in record.channels for record in records)
    }
