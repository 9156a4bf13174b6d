"""What no chain was looked for, and why."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LittleLeft:
    """No chain was looked for: beside the best single effect no output could gain more."""

    points: float
    """Of NRMSE, in the output that has most left."""

    def to_json(self) -> dict[str, object]:
        """For the `tippath.diagnosis/1` document."""
        return {"reason": "little left", "points": self.points}


@dataclass(frozen=True, slots=True)
class BudgetSpent:
    """What promised less was left out, because the search had cost its budget, or somebody ended it."""

    chains: tuple[tuple[str, str], ...]
    """The first effect and the second, in the order in which they would have been tried."""
    firsts: tuple[str, ...] = ()
    """Effects beside which nothing was asked."""
    interrupted: bool = False
    """By Ctrl-C: what was found until then is the answer."""

    def to_json(self) -> dict[str, object]:
        """For the `tippath.diagnosis/1` document."""
        return {
            "reason": "interrupted" if self.interrupted else "budget",
            "chains": ["+".join(one) for one in self.chains],
            "firsts": list(self.firsts),
        }


@dataclass(frozen=True, slots=True)
class MuchLeft:
    """None was looked for but with the likeliest effect: the best of those leaves so much that no other is likely."""

    chain: tuple[str, ...]
    explained: float
    """Share of all chi squared beyond noise, by that one."""

    def to_json(self) -> dict[str, object]:
        """For the `tippath.diagnosis/1` document."""
        return {"reason": "much left", "chain": list(self.chain), "explained": self.explained}


Unsearched = LittleLeft | BudgetSpent | MuchLeft
