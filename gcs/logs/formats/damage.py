"""What of a log could not be read, whatever its format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Damage:
    """What of a file could not be read."""

    total_bytes: int
    skipped_bytes: int
    """Bytes that belong to no message: cut, shifted, of an unknown type, or padding."""
    resyncs: int
    """How often the chain broke and was found again."""
    unknown: Mapping[int, int] = field(default_factory=dict)
    """Message ids without a (readable) format -> how often the chain met them."""
    tail_cut: bool = False
    """The file ends inside a message, or in bytes that are none."""

    @property
    def any(self) -> bool:
        return self.skipped_bytes > 0

    def describe(self) -> str:
        """One sentence; empty where there is no damage."""
        if not self.any:
            return ""
        parts = [f"{self.skipped_bytes:,} of {self.total_bytes:,} bytes could not be read"]
        if self.resyncs:
            times = "once" if self.resyncs == 1 else f"{self.resyncs:,} times"
            parts.append(f"the chain of messages broke {times} and was found again")
        if self.unknown:
            most = sorted(self.unknown, key=lambda id: (-self.unknown[id], id))[:8]
            ids = ", ".join(f"{id} ({self.unknown[id]:,} times)" for id in most)
            parts.append(f"no format for message id {ids}")
        if self.tail_cut:
            parts.append("the end is cut")
        return "; ".join(parts)
