"""The candidates of a diagnosis in the order in which they are shown, wherever that is."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:  # scipy comes along, and the app shows a desk before anything was asked
    from sysid.diagnose.candidates import Ranked
    from sysid.diagnose.verdict import Diagnosis

LEAST_SHARE = 0.005
"""Explained share that rounds to more than 0 %: less is not shown."""


def ranked(last: Diagnosis, pairs: int | None = 1) -> list[Ranked]:
    """What was refitted, with so many chains of two: the answer first, then what explains most."""
    winner = last.winner
    others = (one for one in (*last.pairs[:pairs], *last.candidates) if one.fit is not None and one is not winner)
    best_first = sorted(others, key=lambda one: (-(one.explained_share or 0.0), one.delta_bic))
    return best_first if winner is None or winner.fit is None else [winner, *best_first]


def shows(judged: Ranked, last: Diagnosis) -> bool:
    """Whether a candidate's share is worth a line."""
    return judged is last.winner or (judged.explained_share or 0.0) >= LEAST_SHARE
