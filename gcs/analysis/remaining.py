"""How long a stage of a diagnosis will take yet, by how long its part so far took; times are handed in, in seconds."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.diagnose.progress import Asking, Stage

LEAST_DONE, LEAST_S = 0.08, 0.5
"""Share of the stage's work and time, before which nothing can be told."""


@dataclass(frozen=True, slots=True)
class Remaining:
    """What is known of the stage under way."""

    stage: Stage | None = None
    began_s: float = 0.0
    ends_s: float | None = None
    """When it will be over; None where that cannot be told."""
    at_most: bool = False

    def heard(self, asking: Asking, now_s: float) -> Remaining:
        """With the next question."""
        began_s = self.began_s if asking.stage is self.stage else now_s
        took_s, done = now_s - began_s, asking.done or 0.0
        ends_s = began_s + took_s / done if done >= LEAST_DONE and took_s >= LEAST_S else None
        return Remaining(asking.stage, began_s, ends_s, asking.at_most)

    def left_s(self, now_s: float) -> float | None:
        """Seconds to the end of the stage; None where that cannot be told, or it should be over."""
        left_s = None if self.ends_s is None else self.ends_s - now_s
        return left_s if left_s is not None and left_s > 0 else None
