"""Effects that could hide, at the largest size that these runs would not show, and the harm of leaving them out."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.control.stability import Margins
from sysid.model.parameter import Parameter
from sysid.model.structure import FloatArray, Mode

HARM = 0.1
"""Relative change of a watched parameter, or of the delay margin, that matters for gains."""
TOLD = 0.3 * HARM
MOST = 5
ALIKE = 0.1
"""Relative difference of what two effects do to a fit, below which they are told together."""


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One effect at the largest size that could hide."""

    effect: str
    title: str
    size: Mapping[str, float]
    """Parameter -> value; those that mean nothing at the null as typical."""
    sized: tuple[Parameter, ...]
    """Parameters that have a null, and with it a size; the largest of them."""
    visible: bool
    """False where these runs show nothing of it that the structure could not do itself: only plausibility limits it."""
    shift: Mapping[str, float]
    """Fitted parameter -> what leaving the effect out adds to it, in its unit."""
    relative: Mapping[str, float]
    """Watched parameter -> the same over the fitted value."""
    modes: tuple[tuple[Mode, Mode], ...]
    """Each of the airframe's oscillations in the fit, and what it is in the vehicle with the effect."""
    margins: tuple[Margins, Margins] | None
    """Of the gains designed on the fit: on the fit, and on the vehicle with the effect."""
    distance: float = math.inf
    """Of the fit with the effect from that without it, in standard errors of what these runs tell."""

    @property
    def delay_loss_ms(self) -> float:
        """Of the delay margin; 0 where there are no gains, or where any delay could be held."""
        if self.margins is None or not math.isfinite(self.margins[0].delay_ms):
            return 0.0
        return self.margins[0].delay_ms - self.margins[1].delay_ms

    @property
    def delay_loss(self) -> float:
        """The same as a share of the delay margin; 1 where the vehicle is not held."""
        if self.margins is None:
            return 0.0
        here, there = (one.delay_ms for one in self.margins)
        return 1.0 if there <= 0 else self.delay_loss_ms / here

    @property
    def harm(self) -> float:
        """The largest relative change of a watched parameter, or loss of delay margin."""
        return float(max([*np.abs(self.done[:-1]), self.done[-1]]))

    @property
    def changed(self) -> dict[str, float]:
        """Of `relative`, what is large enough to be told, the largest first."""
        largest_first = sorted(self.relative.items(), key=lambda item: -abs(item[1]))
        return {name: change for name, change in largest_first if abs(change) >= TOLD}

    @property
    def moved_modes(self) -> tuple[tuple[Mode, Mode], ...]:
        """Of `modes`, those whose frequency is another."""
        return tuple(each for each in self.modes if abs(each[1].frequency_hz / each[0].frequency_hz - 1) >= HARM)

    @property
    def costs_margin(self) -> bool:
        """Whether the loss of delay margin is large enough to be told."""
        return self.margins is not None and self.delay_loss >= TOLD

    @property
    def done(self) -> FloatArray:
        """What leaving it out does, as relative changes: watched parameters, delay margin."""
        return np.array([*self.relative.values(), self.delay_loss])


@dataclass(frozen=True)
class CouldHide:
    """All that could hide. Effects that do the same to the fit stand together: nobody need tell them apart."""

    harmful: tuple[tuple[Hidden, ...], ...]
    """The worst first, at most MOST; of each the worst of its kind first."""
    others: tuple[tuple[Hidden, ...], ...]
    """The rest, the worst first."""

    @property
    def harmful_others(self) -> tuple[tuple[Hidden, ...], ...]:
        """Of the others, those that would do harm, too."""
        return tuple(group for group in self.others if group[0].harm >= HARM)


def grouped(found: Sequence[Hidden]) -> list[tuple[Hidden, ...]]:
    """The worst first; effects that do the same together."""
    groups: list[list[Hidden]] = []
    for one in sorted(found, key=lambda each: -each.harm):
        for group in groups:
            first = group[0]
            if _alike(one, first):
                group.append(one)
                break
        else:
            groups.append([one])
    return [tuple(group) for group in groups]


def _alike(one: Hidden, first: Hidden) -> bool:
    """Whether both do the same; changes without bound are the same, and no others are."""
    apart = one.done != first.done
    within = min(ALIKE * first.harm, sys.float_info.max)
    return bool(np.all(np.abs(one.done[apart] - first.done[apart]) <= within))
