"""Runs prepared once: their bins with every input that any model may read, and the excitation as an instrument.

Gusts reach the commands through the feedback, and with them every residual. So beside the bins as flown stand those of
the commands as the logged excitation alone moved them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.data.airframe import Airframe, agreed
from sysid.data.gyro_settings import told_filters
from sysid.data.instrument import FOLLOWING, Causes, caused_by, causes, instruments
from sysid.data.preprocess import EXCITATIONS, ComplexArray, Piece, Spectrum, excitation_of, pieces
from sysid.data.record import COMMANDS, CYCLIC, RATES, Record, axis_of
from sysid.data.stacks import Stack, stack
from sysid.errors import FitError

CHANNELS_READ = ("omega", "airspeed", "alpha", "beta", "r", "phi", "theta")
"""Beside commands, what effects of the catalogue read."""
LEAST_MOTION = {"omega": 0.002, "airspeed": 0.01}
"""Relative spread from which on a flight condition can show anything."""
LEAST_COMMAND = 1e-3
STILL = 1e-12
WIDER = 2.0
"""Times a band's upper end: so far bins reach where noise is predicted from its past, for beyond it a vehicle hardly
answers."""


@dataclass(frozen=True, eq=False)
class Bins:
    """The bins of all segments with the inputs and outputs of one structure, stacked once."""

    spectra: tuple[Spectrum, ...]
    _instruments: dict[tuple[str, ...], list[ComplexArray] | None] = field(default_factory=dict)
    _causes: dict[tuple[str, ...], Causes] = field(default_factory=dict)

    @cached_property
    def stacks(self) -> tuple[Stack, ...]:
        return tuple(stack(self.spectra))

    def instruments(self, commands: tuple[str, ...]) -> list[ComplexArray] | None:
        """As `sysid.data.instrument.instruments`."""
        if commands not in self._instruments:
            self._instruments[commands] = instruments(self.stacks, commands)
        return self._instruments[commands]

    def causes(self, commands: tuple[str, ...]) -> Causes:
        """As `sysid.data.instrument.causes`."""
        if commands not in self._causes:
            self._causes[commands] = causes(self.stacks, commands)
        return self._causes[commands]


@dataclass(frozen=True, eq=False, kw_only=True)
class Dataset:
    """Runs in a band, prepared once: whoever asks for inputs gets their bins, and what is made from these, for good."""

    records: tuple[Record, ...]
    band_hz: tuple[float, float]
    like: Dataset | None = None
    """The fitted runs, where these only judge: then channels and flight condition are theirs."""
    outputs: tuple[str, ...] = RATES
    """What is measured, where nobody says otherwise."""
    beyond: bool = False
    """Whether its bins reach beyond the band that is fitted."""
    _pieces: dict[Record, tuple[list[Piece], list[str]]] = field(default_factory=dict)
    _viewed: dict[tuple[tuple[str, ...], tuple[str, ...]], Bins] = field(default_factory=dict)
    _some: dict[tuple[Record, ...], Dataset] = field(default_factory=dict)
    _held: dict[float | None, Dataset] = field(default_factory=dict)

    def of(self, records: Sequence[Record]) -> Dataset:
        """Some of these runs; what was prepared of them is shared."""
        some = tuple(records)
        if some == self.records:
            return self
        if some not in self._some:
            self._some[some] = Dataset(
                records=some, band_hz=self.band_hz, like=self.like, outputs=self.outputs, _pieces=self._pieces
            )
        return self._some[some]

    @property
    def found_loop_s(self) -> float | None:
        """How long the loop held commands as runs showed, s; None where that was told, or is not known."""
        found = (one.loop_dt_s for one in self.records if not one.loop_known)
        return next((loop_s for loop_s in found if loop_s is not None), None)

    def held(self, loop_s: float | None) -> Dataset:
        """These runs as `Record.held`; prepared once for each."""
        records = tuple(one.held(loop_s) for one in self.records)
        if records == self.records:
            return self
        if loop_s not in self._held:
            self._held[loop_s] = self._with(records)
        return self._held[loop_s]

    def _with(self, records: tuple[Record, ...]) -> Dataset:
        """The same of other records, of which nothing is prepared yet."""
        return replace(self, records=records, _pieces={}, _viewed={}, _some={}, _held={})

    def without(self, names: frozenset[str]) -> Dataset:
        """These runs as if they had not logged these channels."""
        return self._with(tuple(one.without(names) for one in self.records)) if names else self

    def beside(self, fitted: Dataset) -> Dataset:
        """These runs as those that judge what was fitted to others."""
        return replace(self, like=fitted, _some={}, _held={})

    def measured_in(self, outputs: tuple[str, ...]) -> Dataset:
        """These runs with these outputs; what was prepared of them is shared."""
        return self if outputs == self.outputs else replace(self, outputs=outputs, _some={}, _held={})

    def _of(self, record: Record) -> tuple[list[Piece], list[str]]:
        if record not in self._pieces:
            self._pieces[record] = pieces(record, self.band_hz)
        return self._pieces[record]

    @property
    def pieces(self) -> list[Piece]:
        """Gap-free parts of at least 2 s, in the order of the runs."""
        return [piece for record in self.records for piece in self._of(record)[0]]

    @property
    def remarks(self) -> list[str]:
        """What was dropped."""
        return [remark for record in self.records for remark in self._of(record)[1]]

    def viewed(self, inputs: tuple[str, ...], outputs: tuple[str, ...] | None = None) -> Bins:
        """The bins with a structure's own inputs and outputs, without pieces too short for a frequency in the band."""
        outputs = outputs or self.outputs
        if (inputs, outputs) not in self._viewed:
            found = (piece.spectrum(inputs, outputs) for piece in self.pieces)
            self._viewed[inputs, outputs] = Bins(tuple(one for one in found if one.frequency_hz.size))
        return self._viewed[inputs, outputs]

    @cached_property
    def common(self) -> frozenset[str]:
        """Channels that all runs have."""
        return frozenset(set.intersection(*(set(record.channels) for record in self.records)))

    @cached_property
    def _moving(self) -> frozenset[str]:
        """Of all that effects read, what all runs have and what moves."""
        if self.like is not None:
            return self.like._moving
        read = (name for name in (*COMMANDS, *CHANNELS_READ) if name in self.common)
        return frozenset(name for name in read if moves(name, self.records))

    @property
    def available(self) -> frozenset[str]:
        """Channels that all runs have and that move."""
        return self._moving | (self.common & {"t", *RATES})

    @cached_property
    def still(self) -> frozenset[str]:
        """Channels that all runs have and that do not move."""
        if self.like is not None:
            return self.like.still
        return (self.common & {*COMMANDS, *CHANNELS_READ}) - self._moving

    @cached_property
    def airframe(self) -> Airframe | None:
        """What kind of rotorcraft all these runs are of, as far as they tell."""
        return agreed(record.airframe for record in self.records)

    @cached_property
    def constants(self) -> Mapping[str, float]:
        """Omega_0, V_0: means over the fitted runs; and filters that their logs tell of."""
        return means(self.records) if self.like is None else self.like.constants

    @cached_property
    def whole(self) -> Bins:
        """The bins with every input that any model may read."""
        always = (*self.own_commands, "t")  # time is what a drift is written in
        read = [name for name in (*COMMANDS, *CHANNELS_READ, "t") if name not in self.outputs]
        return self.viewed(tuple(name for name in read if name in self._moving or name in always))

    @property
    def own_commands(self) -> tuple[str, ...]:
        """Of the axes of the outputs; roll and pitch, which are flown together, have each other's."""
        if set(RATES) & set(self.outputs):
            return CYCLIC
        axes = {axis_of(name) for name in self.outputs}
        return tuple(name for name in COMMANDS if axis_of(name) in axes)

    @property
    def spectra(self) -> tuple[Spectrum, ...]:
        return self.whole.spectra

    @property
    def stacks(self) -> tuple[Stack, ...]:
        return self.whole.stacks

    @cached_property
    def causes(self) -> Causes:
        """What the excitation caused in each command that it can have caused."""
        own, inputs = self.own_commands, self.spectra[0].inputs
        excited = COMMANDS if own == CYCLIC else ()
        return self.whole.causes(
            tuple(name for name in inputs if name in own or (name in excited and excitation_of(name) in self.common))
        )

    @property
    def in_a_loop(self) -> bool:
        """Whether feedback may be in the commands, and no excitation of any is logged to tell it by."""
        return not self.beyond and not any(name in EXCITATIONS for name in self.causes.references)

    @cached_property
    def imposed(self) -> tuple[Stack, ...]:
        """The stacks with commands, and channels that follow the motion, only as far as the excitation caused them."""
        return tuple(_imposed(self.stacks, self.causes))

    @cached_property
    def surrogate(self) -> tuple[Stack, ...]:
        """The stacks in other gusts: what the excitation caused, and the rest of the commands in other phases.

        What is not linear does to a command what goes with it decides. So it is asked in gusts of the same spectrum,
        of which the residual knows nothing: the phases are drawn, the same every time.
        """
        rng = np.random.default_rng(0)
        return tuple(_rephased(*pair, rng) for pair in zip(self.stacks, self.imposed, strict=True))

    @cached_property
    def gusts(self) -> tuple[Stack, ...]:
        """Of `surrogate` what the excitation did not cause."""
        pairs = zip(self.surrogate, self.imposed, strict=True)
        return tuple(replace(group, U=group.U - imposed.U) for group, imposed in pairs)

    @cached_property
    def unexcited(self) -> Dataset:
        """The same runs as if no excitation had been logged: what they are asked so is what all commands foretell."""
        bare = self.without(frozenset(EXCITATIONS))
        return bare if self.like is None else bare.beside(self.like.unexcited)

    @property
    def samples(self) -> int:
        return sum(group.samples for group in self.stacks)

    @property
    def _swept_from_hz(self) -> float:
        """Where the lowest sweep begins; 0 where a run is of no sweep."""
        return min((one.swept_band_hz[0] if one.swept_band_hz else 0.0 for one in self.records), default=0.0)

    @cached_property
    def wider(self) -> Dataset:
        """The same runs with bins up to WIDER, as far as all of them are sampled: past is past there. None below the
        sweeps, where the loop alone moves the commands.

        A run's trim and jump are taken from all of it, what is new later among them; slow commands that answer to gusts
        would seem to foretell that: 2 standard deviations in every run, of motions that remember the gusts of seconds.
        """
        top = max(float(one.frequency_hz[-1]) for one in self.spectra)
        sampled = min(float((one.samples - 1) // 2) / (one.samples * one.dt) for one in self.spectra)
        high_hz = min(WIDER * top, sampled)
        return Dataset(
            records=self.records,
            band_hz=(max(self.band_hz[0], self._swept_from_hz), high_hz),
            like=self.like or self,
            outputs=self.outputs,
            beyond=True,
        )


Runs = Dataset | Sequence[Record]
"""Records, or what was prepared of them already."""


def prepared(runs: Runs, band_hz: tuple[float, float]) -> Dataset:
    """The runs in this band, prepared now unless they are."""
    if isinstance(runs, Dataset):
        return runs if runs.band_hz == band_hz else Dataset(records=runs.records, band_hz=band_hz)
    return Dataset(records=tuple(runs), band_hz=band_hz)


def dataset(
    runs: Runs, band_hz: tuple[float, float], like: Dataset | None = None, outputs: tuple[str, ...] = RATES
) -> Dataset:
    """Runs to diagnose on, measured in `outputs`; `like` gives validation runs the channels of the fitted ones.

    Raises FitError where no run has 2 s without a gap.
    """
    found = prepared(runs, band_hz).measured_in(outputs)
    if like is not None:
        found = found.beside(like)
    if not found.pieces:
        raise FitError("no run has 2 s of gap-free samples")
    return found


def viewed(one: Spectrum, inputs: tuple[str, ...]) -> Spectrum:
    """Bins with these inputs only."""
    if one.inputs == inputs:
        return one
    return replace(one, U=one.U[[one.inputs.index(name) for name in inputs]], inputs=inputs)


def moves(name: str, records: Sequence[Record]) -> bool:
    """Whether a channel of these runs moves enough to show anything."""
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
        made.append(_commanded(group, U, changed))
    return made


def _commanded(group: Stack, U: ComplexArray, changed: Sequence[int]) -> Stack:
    """A stack with bins U (m, bins) of its inputs, the rows `changed` of them in time too: there nothing else is left
    but their means."""
    spectra = []
    for one, part in zip(group.spectra, group.slices, strict=True):
        channels = dict(one.segment.channels)
        for row, moving in zip(changed, one.in_time(U[changed, part]), strict=True):
            channels[group.inputs[row]] = np.mean(channels[group.inputs[row]]) + moving
        spectra.append(replace(one, segment=replace(one.segment, channels=channels), U=U[:, part]))
    return replace(group, spectra=tuple(spectra), U=U)


def _rephased(group: Stack, imposed: Stack, rng: np.random.Generator) -> Stack:
    """What of the inputs was not imposed, with phases drawn anew: in every bin the same for all inputs."""
    rest = group.U - imposed.U
    changed = np.flatnonzero(np.any(rest != 0, axis=1)).tolist()
    if not changed:
        return group
    phases = np.exp(2j * np.pi * rng.random(rest.shape[1]))
    return _commanded(group, imposed.U + rest * phases, changed)


def means(records: Sequence[Record]) -> dict[str, float]:
    """The mean flight condition, Omega_0 and V_0, as far as every run logs it, and filters that all logs tell of."""
    return told_filters(records) | {
        name: float(np.mean(np.concatenate([record.channels[channel] for record in records])))
        for name, channel in (("Omega_0", "omega"), ("V_0", "airspeed"))
        if all(channel in record.channels for record in records)
    }
