"""What a check of a fit finds, a value for each kind; sentences are made of them where they are shown."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SweepUnknown:
    """None of the runs is a chirp with its settings."""


@dataclass(frozen=True, slots=True)
class OutsideSweep:
    """Natural frequencies outside the swept band, Hz."""

    frequencies_hz: tuple[float, ...]
    swept_hz: tuple[float, float]


@dataclass(frozen=True, slots=True)
class InsideSweep:
    """Every mode is inside the swept band, Hz."""

    swept_hz: tuple[float, float]


@dataclass(frozen=True, slots=True)
class RotorUnknown:
    """The rotor speed is not logged."""


@dataclass(frozen=True, slots=True)
class RotorAbove:
    """The rotor's frequency, Hz, and how many times the highest mode's it is: infinite of integrators alone."""

    rotor_hz: float
    times: float


@dataclass(frozen=True, slots=True)
class FewChirps:
    """There are not two chirps on each axis."""


@dataclass(frozen=True, slots=True)
class SetRefused:
    """A set of runs alone does not identify the model."""

    refusal: str
    """The fit's error, as it would be raised."""


@dataclass(frozen=True, slots=True)
class ModesDiffer:
    """The sets of runs do not have the same number of modes."""


@dataclass(frozen=True, slots=True)
class SetsDiffer:
    """By how much sets of runs differ, percent."""

    sets: int
    frequency_percent: float
    damping_percent: float


@dataclass(frozen=True, slots=True)
class NoModes:
    """The model has integrators alone."""


@dataclass(frozen=True, slots=True)
class NothingFree:
    """No parameter is free in every set of runs."""


@dataclass(frozen=True, slots=True)
class ParametersMoved:
    """Parameters that moved beyond a limit between sets of runs."""

    moved: int
    of: int
    limit: float
    """Standard errors of the difference."""
    largest: tuple[tuple[str, float], ...]
    """Those that moved, or the one that moved most: name and standard errors."""


@dataclass(frozen=True, slots=True)
class CommandsThinned:
    """Commands act before their time stamps, as they would in a log of a faster loop."""

    early_s: float
    error_s: float
    """One standard error."""
    sample_s: float
    """Of the log, of which early_s is a half at most."""


@dataclass(frozen=True, slots=True)
class CommandsLate:
    """Commands act before their time stamps, more than any loop explains: clocks differ."""

    early_s: float
    error_s: float
    """One standard error."""


@dataclass(frozen=True, slots=True)
class LowEdgeHolds:
    """No parameter moves beyond chance where the band begins higher, Hz."""

    low_hz: float
    to_hz: float


@dataclass(frozen=True, slots=True)
class Move:
    """A parameter's value with the fit's own band, and the one furthest from it where the band begins higher."""

    name: str
    unit: str
    value: float
    other: float


@dataclass(frozen=True, slots=True)
class LowEdgeMoves:
    """Parameters that move beyond chance where the band begins higher, the surest first."""

    moves: tuple[Move, ...]
    low_hz: float
    to_hz: float
    instrumented: bool
    """The excitation is logged, so it is not the feedback."""


CheckFinding = (
    SweepUnknown
    | OutsideSweep
    | InsideSweep
    | RotorUnknown
    | RotorAbove
    | FewChirps
    | SetRefused
    | ModesDiffer
    | SetsDiffer
    | NoModes
    | NothingFree
    | ParametersMoved
    | CommandsThinned
    | CommandsLate
    | LowEdgeHolds
    | LowEdgeMoves
)
