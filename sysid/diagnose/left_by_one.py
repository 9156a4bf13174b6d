"""What a single effect leaves of what can be explained: whether a chain is looked for beside it."""

from __future__ import annotations

import numpy as np

from sysid.diagnose.candidates import REMAINDER, Ranked, Reference, noise_shares
from sysid.diagnose.likely import CHANCE, misfit
from sysid.diagnose.loop_change import Limit, seen
from sysid.diagnose.term_search import Selection

MUCH_BY_NOISE = 0.1
"""Share of chi squared that a named effect leaves, from which on no points are little: it took up a part of another's.
(A damping with the rates to the power of 1.1 left 0.11 and 0.08 points: a linear damping, and a lag of 2.9 ms.)"""
LITTLE_POINTS = 0.3
"""Of NRMSE, that an effect may leave for no chain to be looked for beside it, where that does not matter to the loop
that would be designed."""


def harmless(one: Ranked, points: float, limit: Limit) -> bool:
    """Whether so many points are little, and known to change no margin by more than this."""
    assert one.fit is not None
    change = seen(one.fit) if points < LITTLE_POINTS else None
    return change is not None and change.over(limit) <= 1


def points_left(one: Ranked, reference: Reference) -> float:
    """NRMSE that noise alone would allow beyond this effect's, in points, in the output that has most left; what the
    commands explain, and what simple terms do."""
    assert one.fit is not None
    fit = one.fit
    reached = np.sqrt(fit.estimate.error.shares)

    def left(terms: Selection | None) -> float:
        return float(np.max(100 * (reached - np.sqrt(noise_shares(fit, terms))), initial=0.0))

    linear = left(None)
    return linear if linear >= LITTLE_POINTS else max(linear, left(reference.simple(fit)))


def left_by_noise(one: Ranked, reference: Reference) -> float:
    """Share of what can be explained that this effect leaves, by the noise's own measure; 0 where no excitation is
    logged."""
    rest = misfit(one, CHANCE) if reference.parent.division.measured else 0.0
    return rest / max(one.chi_squared + rest, 1e-300)


def share_left(one: Ranked, reference: Reference) -> float:
    """Share of what can be explained that this effect leaves, as far as the commands or a simple term explain it: by
    power, or by the noise's own measure, where that is more."""
    assert one.fit is not None
    fit, parent = one.fit, reference.parent

    def left(terms: Selection | None) -> float:
        rest = fit.error_share - float(np.sum(noise_shares(fit, terms)))
        return rest / max(parent.error_share - fit.error_share + rest, 1e-300)

    linear = max(left(None), left_by_noise(one, reference))
    return linear if linear >= REMAINDER else left(reference.simple(fit))  # a limit leaves nothing linear
