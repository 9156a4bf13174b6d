"""Bad air for tests and rehearsals: packets that get lost, and outages, repeatable from a seed."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sitl.links import Address, Link


@dataclass(frozen=True)
class Outage:
    """Nothing passes, either way."""

    start_s: float
    stop_s: float


class Loss:
    """Which packets get lost. A fraction of 0 without outages loses none."""

    def __init__(self, fraction: float, seed: int, outages: Sequence[Outage] = ()) -> None:
        """Raises ValueError for a fraction outside 0..1."""
        if not 0 <= fraction <= 1:
            raise ValueError("the share of lost packets must lie between 0 and 1")
        self._fraction = fraction
        self._random = random.Random(f"faults {seed}")
        self._outages = tuple(outages)

    def loses(self, now_s: float) -> bool:
        """Whether the packet that passes now is lost."""
        if any(outage.start_s <= now_s < outage.stop_s for outage in self._outages):
            return True
        return self._random.random() < self._fraction


class LossyLink:
    """A datagram link with losses in both directions."""

    def __init__(self, link: Link, loss: Loss, now_s: Callable[[], float]) -> None:
        self._link = link
        self._loss = loss
        self._now_s = now_s
        self.name = link.name
        self.ground_link = link.ground_link
        self.known = link.known

    def receive(self) -> list[tuple[Address, bytes]]:
        return [packet for packet in self._link.receive() if not self._loss.loses(self._now_s())]

    def gone(self) -> list[Address]:
        return self._link.gone()

    def room(self, address: Address) -> bool:
        return self._link.room(address)

    def send(self, address: Address, data: bytes) -> None:
        if not self._loss.loses(self._now_s()):
            self._link.send(address, data)

    def close(self) -> None:
        self._link.close()
