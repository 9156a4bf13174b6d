"""Fits of planted flights, and how far their estimates are from what was planted, in standard errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import planted
import pytest
from planted import FORWARD, PLANTED, TABLE_4, TABLE_5, Run

from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.compose import compose

ATTITUDE = {"phi", "theta"}
"""Logged without error in planted flights, so it is left out: effects integrate it themselves."""
UNLOGGED = {"governor": ("omega",)}
"""What is not logged where an effect is to be found."""
READ_FROM_THE_BASE = {"swashplate_phase"}
"""What the bases contain: there is nothing to add."""
FORWARD_FLIGHT = ("angular_damping", "elevator")


def records(flight: Sequence[Run], *without: str) -> list[Record]:
    """A flight's runs without attitude and the channels named."""
    left_out = ATTITUDE | set(without)
    return [
        Record(f"#{number}", {name: values for name, values in run.items() if name not in left_out})
        for number, run in enumerate(flight, 1)
    ]


@contextmanager
def controlled(loop: float, size: float = 1.0) -> Iterator[None]:
    """Planted flights with a controller of that part of the usual gain, and chirps of that part of the usual size."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planted, "RATE_GAIN", loop * planted.RATE_GAIN)
        patch.setattr(planted, "ATTITUDE_GAIN", loop * planted.ATTITUDE_GAIN)
        patch.setattr(planted, "SIZES", {axis: size * one for axis, one in planted.SIZES.items()})
        yield


def effects_with(effect: str) -> tuple[str, ...]:
    """The effect, behind those of forward flight where it belongs there."""
    before = FORWARD_FLIGHT if effect in FORWARD else ()
    return tuple(dict.fromkeys((*before, effect)))


def fitted(effect: str, flight: Sequence[Run]) -> Fit:
    return identify(compose("tpp"), records(flight, *UNLOGGED.get(effect, ())), effects=effects_with(effect))


def planted_values(effect: str) -> Mapping[str, float]:
    """What flew: the paper's table with the effect's own parameters."""
    return {**(TABLE_5 if effect in FORWARD else TABLE_4), **PLANTED[effect]}


def in_standard_errors(fit: Fit, truth: Mapping[str, float]) -> dict[str, float]:
    """(estimate - truth)/standard error of each parameter whose truth is known; infinite at a bound."""
    names = fit.model.structure.names
    return {
        name: (value - truth[name]) / error if error > 0 and name not in fit.at_bound else math.inf
        for name, value, error in zip(names, map(float, fit.model.values), fit.standard_errors, strict=True)
        if name in truth
    }
