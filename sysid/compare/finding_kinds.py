"""What a comparison may find, a value for each kind: where an error sits, what it follows, and mistakes in the data.

Axes are `roll` and `pitch`, bands in Hz, shares of the axis's error between 0 and 1. Sentences are made of these where
they are shown.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

COHERENT, PARTLY = 0.5, 0.2
ONE_COMMAND = 0.8
"""Of what all commands explain; a command that explains this much alone is named alone."""
MOST_OF_IT = 0.5

Band = tuple[float, float]


@dataclass(frozen=True, slots=True)
class NoiseKnown:
    """From what the noise is known."""

    source: str
    """`quiet hover`, `logged excitation` or `commands`."""
    quiet_agrees: bool
    """Quiet hover shows as much as the logged excitation leaves."""

    @property
    def at_least(self) -> bool:
        """Whether there may be more of it: feedback carries noise into the commands."""
        return self.source == "commands"


@dataclass(frozen=True, slots=True)
class OnlyNoise:
    """What is left is noise, on one axis or, where none is named, on all."""

    noise: NoiseKnown
    axis: str | None = None


@dataclass(frozen=True, slots=True)
class TooShort:
    """The runs are too short to tell noise from error; where most of both sits."""

    axis: str
    band_hz: Band
    error_share: float


@dataclass(frozen=True, slots=True)
class NearlyNoise:
    """Noise explains nearly all of an axis's error; the little beyond it sits in a band."""

    axis: str
    band_hz: Band
    """Of what noise does not explain."""
    noise_share: float
    noise: NoiseKnown


@dataclass(frozen=True, kw_only=True)
class ErrorInBand:
    """Where most of an axis's error sits that noise does not explain, and what it follows."""

    axis: str
    band_hz: Band
    error_share: float
    noise_within: float
    """Noise's share of the error inside the band."""
    coherence: Mapping[str, float]
    """Command -> share of the band's error that it explains alone."""
    coherence_together: float
    noise_share: float
    """Of the axis's whole error."""
    noise: NoiseKnown
    distortion: float | None
    """Share that is neither as in quiet hover nor linear in the commands, where it is large enough to be told."""
    mixed: bool
    """The runs do not agree with each other."""
    own_runs: bool
    """The model was fitted to these runs: what is left is not for its numbers to mend."""

    @property
    def follows_commands(self) -> bool:
        return self.coherence_together >= PARTLY

    @property
    def follows_something_else(self) -> bool:
        """The commands explain a part of it only."""
        return self.coherence_together < COHERENT

    @property
    def command(self) -> str | None:
        """The command that explains nearly all that the commands do; None where no single one does."""
        name, alone = max(self.coherence.items(), key=lambda item: item[1])
        return name if alone >= ONE_COMMAND * self.coherence_together else None

    @property
    def mostly_noise(self) -> bool:
        return self.noise_within > MOST_OF_IT


@dataclass(frozen=True, kw_only=True)
class LeavesBounds:
    """Which of an axis's responses lies outside what noise allows, and where, most of them all."""

    axis: str
    output: str
    command: str
    bands_hz: tuple[Band, ...]
    furthest_hz: float
    """Where the two are furthest apart in the responses' unit,"""
    decibels: float
    """the model's less the measured one's there,"""
    degrees: float
    """and its phase less the measured one's."""


@dataclass(frozen=True, kw_only=True)
class GrowsWithAmplitude:
    """An axis's error grows faster, or more slowly, than a command."""

    axis: str
    command: str
    per_doubling: float
    """Beyond the linear; below 1 the error counts most in small motion."""
    at_least: bool
    low: float
    high: float
    """Root mean squares of the command, smallest and largest."""


@dataclass(frozen=True, slots=True)
class ChangesWithAmplitude:
    """An axis's response to a command is another one at another amplitude."""

    axis: str
    command: str
    share: float


@dataclass(frozen=True, slots=True)
class FollowsControl:
    """A logged control explains a part of an axis's error beyond the commands."""

    axis: str
    channel: str
    share: float


@dataclass(frozen=True, kw_only=True)
class AtTheEnds:
    """An axis's error sits in the first or in the last seconds of the runs."""

    axis: str
    share: float
    first: bool
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Burst:
    """An axis's error sits in one place of one run."""

    axis: str
    share: float
    run: str
    start_s: float
    """From the run's start,"""
    stop_s: float
    """as this."""


@dataclass(frozen=True, kw_only=True)
class GoesWithCondition:
    """An axis's error goes with a flight condition."""

    axis: str
    channel: str
    factor: float
    """Of the error's power from `low` to `high`."""
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class WorseRun:
    """A run's error on an axis is far above that of the others of its kind."""

    run: str
    axis: str
    times: float
    """Theirs."""
    mostly_noise: bool


# ---------------------------------------------------------------------------------- mistakes that runs look like


Answers = tuple[tuple[int, int], tuple[int, int]]
"""For each of two inputs the row that really answers it, and with which sign."""


@dataclass(frozen=True, kw_only=True)
class Clipped:
    """A rate stands at its largest or smallest value again and again."""

    runs: tuple[str, ...]
    channel: str
    limit: float
    """rad/s"""
    share: float
    """Of the samples, in the worst run."""
    kind: ClassVar[str] = "clipped"


@dataclass(frozen=True, slots=True)
class OtherAxisMoved:
    """Runs declared on one axis that moved another command most."""

    runs: tuple[str, ...]
    axis: str
    """As declared."""
    channel: str
    """That moved most."""
    kind: ClassVar[str] = "axes"


@dataclass(frozen=True, slots=True)
class CommandsElsewhere:
    """What was added to the commands shows in others, or with another sign."""

    runs: tuple[str, ...]
    answers: Answers
    """Rows of `delta_x`, `delta_y` for `excitation_x`, `excitation_y`."""
    kind: ClassVar[str] = "axes"


@dataclass(frozen=True, slots=True)
class WrongSigns:
    """Answers whose signs are not the convention's: slow ones, or without a logged excitation fast ones."""

    answers: Answers
    """Rows of `p`, `q` for `delta_x`, `delta_y`."""
    excitation_logged: bool
    runs: tuple[str, ...] = ()
    """All of them."""
    kind: ClassVar[str] = "signs"


@dataclass(frozen=True, kw_only=True)
class Mixed:
    """Runs that want a linear response each."""

    runs: tuple[str, ...]
    axis: str
    """The worse one."""
    share: float
    """Of its error, that goes away when every run may answer for itself."""
    apart: tuple[tuple[tuple[str, ...], ...], ...]
    """For each kind of maneuver the groups of runs that one response each explains, where there are several."""
    amplitudes: bool
    """They were flown with different amplitudes: a nonlinearity does this too."""
    kind: ClassVar[str] = "mixed"


@dataclass(frozen=True, slots=True)
class NotSeparable:
    """These runs alone could not identify anything."""

    runs: tuple[str, ...]
    refusal: str
    """The fit's error, as it would be raised."""
    kind: ClassVar[str] = "not separable"


Suspicion = Clipped | OtherAxisMoved | CommandsElsewhere | WrongSigns | Mixed | NotSeparable
Finding = (
    OnlyNoise
    | TooShort
    | NearlyNoise
    | ErrorInBand
    | LeavesBounds
    | GrowsWithAmplitude
    | ChangesWithAmplitude
    | FollowsControl
    | AtTheEnds
    | Burst
    | GoesWithCondition
    | WorseRun
    | Suspicion
)
