"""Who flies and who watches: pure, time passed in.

The first viewer flies; whoever comes later watches. A viewer is known by the identity that the page keeps while its tab
is open, so a reload gets the same seat again. When the one who flies is gone for RETURNS_S, another may take the seat,
and does so by asking: it is never given away by itself. Without any viewer for CLOSES_S the app is closed, which ends a
run that is under way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

RETURNS_S = 5.0
"""A reload takes a second, a tablet that changes networks a few."""
CLOSES_S = 10.0
"""The vehicle flies its excitation alone meanwhile, within its limits."""
Role = Literal["flies", "watches"]


@dataclass(slots=True)
class Seats:
    """Of one app process. Times are seconds of one clock that never goes back."""

    flying: str | None = None
    """The viewer who may type."""
    gone_s: float | None = None
    """When that one was last seen, while away."""
    empty_s: float | None = None
    """Since when nobody is there; None while somebody is."""
    here: set[str] = field(default_factory=set)

    def join(self, viewer: str) -> Role:
        """A viewer has come, or is back."""
        self.here.add(viewer)
        self.empty_s = None
        if self.flying is None:
            self.flying = viewer
        if self.flying == viewer:
            self.gone_s = None
        return self.role(viewer)

    def leave(self, viewer: str, now: float) -> None:
        """A viewer's connection has ended."""
        self.here.discard(viewer)
        if viewer == self.flying:
            self.gone_s = now
        if not self.here:
            self.empty_s = now

    def role(self, viewer: str) -> Role:
        """Whether it may type."""
        return "flies" if viewer == self.flying else "watches"

    def free(self, now: float) -> bool:
        """Whether the seat may be taken."""
        return self.gone_s is not None and now - self.gone_s >= RETURNS_S

    def take(self, viewer: str, now: float) -> bool:
        """A viewer who is there asks to fly; whether it does now."""
        if viewer in self.here and viewer != self.flying and self.free(now):
            self.flying, self.gone_s = viewer, None
            return True
        return False

    def closes(self, now: float) -> bool:
        """Whether nobody was there for too long."""
        return self.empty_s is not None and now - self.empty_s >= CLOSES_S
