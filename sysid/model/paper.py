"""The paper's two structures, and how one becomes the other. Symbols are Table 4's, free of Omega."""

from __future__ import annotations

import numpy as np

from sysid.model.compose import compose
from sysid.model.structure import Model

CD = compose("cd")
"""Eq. 8-9, states p, q, eight parameters."""
TPP = compose("tpp")
"""Eq. 5-7, states p, q, a, b, nine parameters."""

TABLE_4 = {
    "tpp": (147.548, 713.378, 0.091, -1.338, 1.448, -0.282, 0.296, 0.524, -0.050),
    "cd": (-2.056, -7.900, 10.536, -4.777, -5.361, 9.917, -67.573, 11.136),
}
"""What the paper found on the real vehicle, in the order of these structures."""


def reduce_to_cd(model: Model) -> Model:
    """The Cylinder-Dynamics model that a TPP model becomes when its flapping has settled (section 3.3).

    Setting a' = b' = 0 and solving for a and b; raises ValueError where they have no steady state.
    """
    A, B, _, _ = model.matrices
    slow, fast = slice(0, 2), slice(2, 4)
    try:
        settled = -np.linalg.solve(A[fast, fast], np.hstack([A[fast, slow], B[fast]]))
    except np.linalg.LinAlgError as error:
        raise ValueError("this model's flapping has no steady state") from error
    A_cd = A[slow, slow] + A[slow, fast] @ settled[:, :2]
    B_cd = B[slow] + A[slow, fast] @ settled[:, 2:]
    return Model(CD, np.concatenate([A_cd.ravel(), B_cd.ravel()]))
