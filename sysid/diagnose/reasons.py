"""What an explanation is made of, a value for each kind of statement; sentences are made of them where they are shown.

Outputs are `p` and `q`, axes `roll` and `pitch`; shares lie between 0 and 1. Effects are named by their ids, or by the
paths of a user's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sysid.model.effect import Effect
from sysid.model.parameter import Parameter
from sysid.model.structure import Mode

Names = tuple[str, ...]
Nrmse = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Size:
    """A parameter's value, in its unit."""

    parameter: Parameter
    value: float
    error: float | None = None
    """Standard error."""


# ------------------------------------------------------------------------------------------------ what it is


@dataclass(frozen=True, slots=True)
class NothingMissing:
    """What the model leaves is noise."""

    nrmse_percent: Nrmse


@dataclass(frozen=True, slots=True)
class NothingKnown:
    """What the model leaves is more than noise, and no effect explains it."""

    nrmse_percent: Nrmse


@dataclass(frozen=True, slots=True)
class EffectFound:
    """An effect with the sizes found."""

    effect: Effect
    sizes: tuple[Size, ...]
    none: Names
    """Its parameters that are not to be told from none."""


What = NothingMissing | NothingKnown | EffectFound


# ------------------------------------------------------------------------------------------------ what the runs show


@dataclass(frozen=True, slots=True)
class PhaseFalls:
    """Without the effect the measured phase falls in proportion to frequency."""

    degrees: float
    """Lost at `top_hz`; positive."""
    top_hz: float
    late_s: Mapping[str, float]
    """Output -> lateness."""


@dataclass(frozen=True, slots=True)
class GainFalls:
    """The gain falls with the phase, as behind a lag."""

    lost_db: float


@dataclass(frozen=True, slots=True)
class GainStays:
    """The gain stays, as behind a delay."""

    within_db: float
    lag_would_lose_db: float


@dataclass(frozen=True, slots=True)
class NearerResponses:
    """Distance from the measured responses, (dB, degrees)."""

    without: tuple[float, float]
    with_it: tuple[float, float]


@dataclass(frozen=True, slots=True)
class OnOneAxis:
    """Most of the removed error is on one axis."""

    axis: str
    share: float


@dataclass(frozen=True, slots=True)
class InOneBand:
    """Most of what goes on an axis lies in a narrow band; from 0 Hz where it lies below."""

    axis: str
    share: float
    band_hz: tuple[float, float]


@dataclass(frozen=True, slots=True)
class NoLinearAnswer:
    """A part of the removed error is no linear answer to the commands."""

    share: float


@dataclass(frozen=True, slots=True)
class InStepWithCommand:
    """A command that the parent does not read explains a part of what goes on an axis."""

    axis: str
    share: float
    command: str


@dataclass(frozen=True, slots=True)
class GoesWithChannel:
    """The removed error comes and goes with a channel."""

    channel: str
    correlation: float


@dataclass(frozen=True, slots=True)
class GrowsWithCommand:
    """Twice the command makes more than twice the error."""

    command: str
    times: float


@dataclass(frozen=True, slots=True)
class BestLinear:
    """How far the best effect with constant coefficients gets."""

    effects: Names
    share: float


Shown = (
    PhaseFalls
    | GainFalls
    | GainStays
    | NearerResponses
    | OnOneAxis
    | InOneBand
    | NoLinearAnswer
    | InStepWithCommand
    | GoesWithChannel
    | GrowsWithCommand
    | BestLinear
)


@dataclass(frozen=True, slots=True)
class FitRises:
    """The fit's numbers without the effect and with it."""

    before: Nrmse
    after: Nrmse


# ------------------------------------------------------------------------------------------------ what changes


@dataclass(frozen=True, slots=True)
class ParametersMove:
    """Parameters of the parent that moved most, before and after."""

    moves: tuple[tuple[Size, Size], ...]
    more: int
    """That moved, too."""


@dataclass(frozen=True, slots=True)
class ModesMove:
    """Oscillations before and after, and those that the parent did not have."""

    moves: tuple[tuple[Mode, Mode], ...]
    new: tuple[Mode, ...]


@dataclass(frozen=True, kw_only=True)
class ImplausibleBefore:
    """A value of the parent that physics does not allow, and what makes it plausible."""

    size: Size
    cure: Names
    """Effects that do; empty where none that was refitted does."""
    added: bool = False
    """The cure is the answer itself."""
    now: Size | None = None
    """The value with the cure."""
    others: tuple[Names, ...] = ()
    """That would do as well."""


Change = ParametersMove | ModesMove | ImplausibleBefore


# ------------------------------------------------------------------------------------------------ what else looks so


@dataclass(frozen=True, kw_only=True)
class StandsIn:
    """An implausible winner, and what would bring its values back."""

    effects: Names
    outside: tuple[Size, ...]
    """Values that physics does not allow."""
    beside: Names = ()
    """Effects beside which its values would be plausible."""
    instead: Names = ()
    """Or another that explains nearly as much."""
    sizes: tuple[Size, ...] = ()
    """The plausible values, then."""


@dataclass(frozen=True, slots=True)
class Alike:
    """Effects that these runs cannot tell from the winner, with their sizes; None where they were not refitted."""

    effects: tuple[tuple[str, tuple[Size, ...] | None], ...]


@dataclass(frozen=True, slots=True)
class ComesNear:
    """An effect that comes near only at values that physics does not allow."""

    effects: Names
    share: float
    """Of the winner's chi squared."""
    outside: tuple[Size, ...]


Resemblance = StandsIn | Alike | ComesNear
