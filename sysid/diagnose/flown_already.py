"""Runs that were flown and not fitted: what they would tell rivals apart by, were they fitted too.

Nothing is imagined of them: both rivals answer the commands that were flown. A maneuver's repeats go together, but
some runs are left to judge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.data.dataset import Dataset
from sysid.data.record import Record
from sysid.diagnose.maneuver_plans import Plan, flew
from sysid.diagnose.rivals import NEEDED, Rivals
from sysid.fit.noise import Division


@dataclass(frozen=True, eq=False)
class Group:
    """Runs of one maneuver on one axis."""

    records: tuple[Record, ...]
    each: tuple[float, ...]
    """Standard errors by which they would set each pair of rivals further apart."""

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(one.id for one in self.records)

    @property
    def tells(self) -> int:
        """How many rivals they tell from the winner."""
        return sum(sigma >= NEEDED for sigma in self.each)

    def flew(self, plan: Plan) -> bool:
        """Whether they are this maneuver already."""
        return all(flew(plan, one) for one in self.records)


def flown_already(pairs: Sequence[Rivals], runs: Dataset | None, division: Division) -> list[Group]:
    """What tells most first, of equals the shortest; none where feedback alone moves the commands."""
    if runs is None or runs.in_a_loop or any(pair.truth.dataset.beyond for pair in pairs):
        return []
    by_maneuver: dict[tuple[str, str | None], list[Record]] = {}
    for one in runs.records:
        by_maneuver.setdefault((one.maneuver, one.axis), []).append(one)
    found = []
    for every in by_maneuver.values():
        records = every if len(every) < len(runs.records) else every[: len(every) // 2]
        some = runs.of(records)
        if records and some.spectra:
            found.append(Group(tuple(records), tuple(pair.told_by_runs(some, division) for pair in pairs)))
    return sorted(found, key=lambda one: (-one.tells, sum(record.duration_s for record in one.records)))
