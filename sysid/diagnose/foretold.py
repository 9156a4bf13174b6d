"""What foretells better, of two where a servo rests: play or a dead band.

Where an excitation is logged candidates are told apart by what was imposed, which no gust reaches. But where a servo
rests hangs on every gust before: what was imposed tells play from a dead band by little, all commands as they were
flown by much. A prediction error is no worse for feedback, with a logged excitation or without.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sysid.diagnose.evidence import Candidate, white_left
from sysid.fit.innovations import Innovations, innovations
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model


@lru_cache(maxsize=16)
def foretells_better_by(one: Candidate, other: Candidate) -> float:
    """Chi squared by which the first leaves less of what is new in every sample, in the noise of either; the less of
    both, and 0 where that is not known."""
    try:
        return min(_less(one, other, by) for by in (one, other))
    except (RelaxationError, np.linalg.LinAlgError):
        return 0.0


def _less(one: Candidate, other: Candidate, by: Candidate) -> float:
    return less_left(one.model, other.model, innovations(by.model, by.dataset.wider, by.free))


def less_left(one: Model, other: Model, metric: Innovations) -> float:
    """Chi squared by which the first model leaves less of what is new in this metric; 0 where that is not known."""
    mine, his = (float(np.sum(white_left(each, metric) ** 2)) for each in (one, other))
    return his - mine if np.isfinite(his - mine) else 0.0
