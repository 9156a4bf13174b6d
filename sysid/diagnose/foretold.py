"""What foretells better, of two candidates: play or a dead band, most of all.

Where an excitation is logged candidates are told apart by what was imposed, which no gust reaches. But where a servo
rests hangs on every gust before: what was imposed tells play from a dead band by little, all commands as they were
flown by much. A prediction error is no worse for feedback, with a logged excitation or without.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sysid.data.dataset import Dataset
from sysid.diagnose.evidence import Candidate, white_left
from sysid.fit.innovations import Innovations, innovations
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model


@lru_cache(maxsize=16)
def foretells_better_by(one: Candidate, other: Candidate) -> float:
    """Chi squared by which the first leaves less of what is new in every sample, in the noise of either; the less of
    both, and 0 where that is not known."""
    try:
        return min(less_left(one.model, other.model, by, by.dataset) for by in (one, other))
    except (RelaxationError, np.linalg.LinAlgError):
        return 0.0


def less_left(one: Model, other: Model, by: Candidate, on: Dataset) -> float:
    """Chi squared by which the first model leaves less of what is new in these runs, in the noise that a candidate
    leaves there; 0 where that is not known. Raises as `white_left`."""
    metric = _noise_beside(by, on)
    mine, his = (float(np.sum(white_left(each, metric) ** 2)) for each in (one, other))
    return his - mine if np.isfinite(his - mine) else 0.0


@lru_cache(maxsize=4)
def _noise_beside(one: Candidate, on: Dataset) -> Innovations:
    """What a candidate leaves in these runs; kept, for others are held against it one after the other."""
    return innovations(one.model, on.wider, one.free)
