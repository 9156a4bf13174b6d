"""The best value of a parameter that the acting commands jump with, found without derivatives.

Where one jump of a dead band falls elsewhere, all that follow do. So the cost over its width is rough, with one narrow
cleft where the jumps are those that flew, at times 0.6 % of the width wide. Averaged over neighbouring widths the
commands are smooth again, and the cost shows near which width the cleft is; there it is looked for point by point, by
one step of what follows, and tried where that shows it. On all segments: where a log lost some of the samples a few of
them hardly show it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.data.stacks import Stack
from sysid.model.structure import Model

Trial = tuple[float, Model | None]
"""Cost and model; infinite and None where there is no response."""
WIDE, AROUND, ABOVE, FINE, NARROW, FINEST = 1.2, 1.4, 2.0, 1.004, 1.02, 1.0002
"""Ratios: between the values of the first look; from its best to the ends of the second, and up to that of a third,
because averaged commands are best at too small a width rather than at too large a one (four clefts of 107 dead bands on
strangers were 1.6 to 1.9 above it, none as far below); between the values of these; where halving the distance begins,
and where it ends."""
TRIED = 8
"""Values of either that are tried."""


def search_nonsmooth(
    begin: Model,
    name: str,
    ends: tuple[float, float],
    acted: Callable[[Mapping[str, float]], Sequence[Stack]],
    tried: Callable[[Mapping[str, float], Sequence[Stack]], Trial],
    glanced: Callable[[Mapping[str, float]], float],
) -> Model:
    """The model of lowest cost over one parameter, first between `ends` > 0; the others begin at `begin`.

    `acted` gives the stacks with the commands as they act, `tried` fits what follows to them: on all bins, because a
    simulation costs as much. `glanced` is a cost that is had at once, by one step.
    """

    def at(model: Model, value: float) -> dict[str, float]:
        return {**model.structure.named(model.values), name: value}

    def lowest(trials: Sequence[Trial]) -> tuple[float, Model]:
        cost, model = min(trials, key=lambda one: one[0])
        return cost, model or begin

    wide = np.geomspace(*ends, 1 + round(np.log(ends[1] / ends[0]) / np.log(WIDE))).tolist()
    seen = [acted(at(begin, value)) for value in wide]
    _, model = lowest(
        [tried(at(begin, value), _mean(seen[max(i - 1, 0) : i + 2])) for i, value in enumerate(wide)],
    )
    around, above = (round(np.log(end) / np.log(FINE)) for end in (AROUND, ABOVE))
    looks = (model[name] * FINE ** np.arange(-around, above + 1.0)).tolist()
    near = [
        value
        for part in (looks[: 2 * around + 1], looks[2 * around + 1 :])
        for value in sorted(part, key=lambda value: glanced(at(model, value)))[:TRIED]
    ]
    trials = [tried(at(model, value), stacks) for value, stacks in zip(wide, seen, strict=True)]
    best = lowest(trials + [tried(at(model, value), acted(at(model, value))) for value in near])
    ratio = NARROW
    while ratio > FINEST:
        ratio = ratio**0.5
        sides = [at(best[1], best[1][name] * factor) for factor in (1 / ratio, ratio)]
        best = lowest([best, *(tried(side, acted(side)) for side in sides)])
    return best[1]


def _mean(several: Sequence[Sequence[Stack]]) -> list[Stack]:
    """The stacks with the mean of their inputs."""
    return [replace(groups[0], U=np.mean([one.U for one in groups], axis=0)) for groups in zip(*several, strict=True)]
