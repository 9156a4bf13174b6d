"""What may be flown or logged next, and why, a value for each kind; sentences are made of them where they are shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.model.parameter import Parameter

if TYPE_CHECKING:
    from sysid.diagnose.maneuver_plans import Plan

Names = tuple[str, ...]


# ------------------------------------------------------------------------------------------------ what to do


@dataclass(frozen=True, slots=True)
class HalfAndFull:
    """A chirp as flown, twice, and twice at half its amplitude."""

    full: Plan


@dataclass(frozen=True, slots=True)
class LogSignal:
    """The flown maneuvers again, with another signal logged."""

    signal: str
    """`servo`, or `motors` in its place on a multirotor; `flapping`, `attitude`."""


@dataclass(frozen=True, slots=True)
class LogChannels:
    """The flown maneuvers again, with channels logged that a rival is about."""

    channels: Names


@dataclass(frozen=True, slots=True)
class FitRuns:
    """Nothing: runs that were flown and not fitted tell the rivals apart, once they are fitted too."""

    runs: Names
    """Their ids."""
    maneuver: str
    """`chirp`, `doublet` or `unknown`;"""
    axis: str | None
    """and on which axis; None where that is not known."""


# ------------------------------------------------------------------------------------------------ why


@dataclass(frozen=True, kw_only=True)
class FurtherApart:
    """It sets the rivals so many standard errors of the noise further apart."""

    sigma: float
    before: float
    """As the flown runs set them apart."""
    usual: tuple[tuple[Parameter, float], ...] = ()
    """Taken that what a hand moves acts so."""
    rest: Names = ()
    """Rivals that would still look the same."""
    repeats: Names = ()
    """Runs that flew just this, fitted or not: it is flown again."""
    too_little: tuple[Names, float] | None = None
    """Runs that flew just this and were not fitted, and the standard errors that they alone would add."""


@dataclass(frozen=True, slots=True)
class LinearHalves:
    """A linear error halves with the amplitude, another one does not."""

    linear_share: float
    """Of what is left, that looks like a linear answer now."""


@dataclass(frozen=True, slots=True)
class SignalTells:
    """A signal sets the rivals apart where no maneuver does."""

    sigma: float
    same_whatever: bool
    """Whatever the inputs do, the rivals answer alike in p and q."""


@dataclass(frozen=True, slots=True)
class MeasuredNotGuessed:
    """A rival is about what would be logged."""

    rival: str


Why = FurtherApart | LinearHalves | SignalTells | MeasuredNotGuessed


if TYPE_CHECKING:
    Proposal = Plan | HalfAndFull | LogSignal | LogChannels | FitRuns
