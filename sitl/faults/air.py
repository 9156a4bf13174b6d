"""Bad air: what befalls packets on their way, and a link that has it.

A stage is one fault of one direction. It is asked with the packets that come in now, and with none, too, so that
what waits can leave; it answers with those that come out now. Stages follow each other like pieces of a line. One
stage object serves one direction of one link, except `Loss`, which knows both.
"""

from __future__ import annotations

import heapq
import math
import random
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

from sitl.autopilot.vehicle import Vehicle
from sitl.faults.windows import ALWAYS, Outage, Way, Window
from sitl.protocol.links import Address, Link

LONGEST_FRAME = 280
"""Bytes of a signed MAVLink 2 frame with a full payload."""
QUEUE_BYTES = 16384
_ROUNDING_S = 1e-9
IMPOSTOR = ("impostor", 0)
"""His address, where he has one of his own."""

Packet = tuple[Address, bytes]
Stage = Callable[[Sequence[Packet], float], list[Packet]]
"""(packets that come in, seconds) -> packets that come out. The seconds never go backwards."""
Voice = Callable[[float], list[bytes]]
"""Seconds -> frames that somebody else sends now."""
Trouble = Callable[[Vehicle], None]
"""Asked about once a sample; does to the vehicle what is due."""


class Forger(Protocol):
    """A voice that is somebody else's."""

    @property
    def up(self) -> bool:
        """Whether it speaks to the vehicle."""

    def __call__(self, now_s: float) -> list[bytes]: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """All that goes wrong in one flight."""

    up: tuple[Stage, ...] = ()
    """From the ground to the vehicle, in the order in which packets meet them."""
    down: tuple[Stage, ...] = ()
    vehicles: tuple[Voice, ...] = ()
    """Other vehicles that the ground hears on this link, whatever befalls the packets of this one."""
    stations: tuple[Voice, ...] = ()
    """Other ground stations that the vehicle hears on this link, each from an address of its own."""
    forged: tuple[Forger, ...] = ()
    """Who speaks on this link as somebody else: from the same address to the ground, from the ground's to the
    vehicle."""
    spoofed: tuple[Forger, ...] = ()
    """The same from an address of his own."""
    on_board: tuple[Trouble, ...] = ()
    """For the server: a link has no part in them."""


class FaultyLink:
    """A link with faults. `now_s` is the clock of all of them: the vehicle's, or a test's own."""

    def __init__(self, link: Link, faults: Faults, now_s: Callable[[], float]) -> None:
        self._link = link
        self._faults = faults
        self._now_s = now_s
        self._stations = {("other station", number): voice for number, voice in enumerate(faults.stations)}
        self._others = {*self._stations, IMPOSTOR}
        self._spoken_to = dict.fromkeys(link.known)
        self._hung_up: set[Address] = set()
        self.name = link.name
        self.ground_link = link.ground_link
        self.known = link.known

    def receive(self) -> list[Packet]:
        """Also lets leave what waits in the other direction: to be called all the time, as the server does."""
        now_s = self._now_s()
        self._send_down([], now_s)
        for frame in [frame for voice in self._faults.vehicles for frame in voice(now_s)]:
            for address in self._spoken_to:
                self._link.send(address, frame)
        packets = _through(self._faults.up, self._link.receive(), now_s)
        packets += [(address, frame) for address, voice in self._stations.items() for frame in voice(now_s)]
        packets += self._impostors(now_s)
        return [packet for packet in packets if packet[0] not in self._hung_up]

    def _impostors(self, now_s: float) -> list[Packet]:
        """What they say to the vehicle; what they say to the ground is on its way."""
        packets: list[Packet] = []
        for send, own, forgers in (
            (self._link.send, None, self._faults.forged),
            (self._link.send_beside, IMPOSTOR, self._faults.spoofed),
        ):
            for forger in forgers:
                for frame in forger(now_s):
                    if forger.up:
                        packets += [(own or address, frame) for address in self._spoken_to][: 1 if own else None]
                    else:
                        for address in self._spoken_to:
                            send(address, frame)
        return packets

    def gone(self) -> list[Address]:
        gone = self._link.gone()
        self._hung_up.update(gone)
        for address in gone:
            self._spoken_to.pop(address, None)
        return gone

    def room(self, address: Address) -> bool:
        """As the link says: a vehicle does not see into the queue of a radio without flow control."""
        return self._link.room(address)

    def send_beside(self, address: Address, data: bytes) -> None:
        self._link.send_beside(address, data)

    def send(self, address: Address, data: bytes) -> None:
        if address not in self._others:
            self._spoken_to[address] = None
            self._send_down([(address, data)], self._now_s())

    def close(self) -> None:
        """What is still on its way is lost."""
        self._link.close()

    def _send_down(self, packets: list[Packet], now_s: float) -> None:
        for address, data in _through(self._faults.down, packets, now_s):
            self._link.send(address, data)


def _through(stages: Iterable[Stage], packets: list[Packet], now_s: float) -> list[Packet]:
    for stage in stages:
        packets = stage(packets, now_s)
    return packets


class During:
    """A stage that is there only in a window; what it holds back still comes after it."""

    def __init__(self, stage: Stage, window: Window) -> None:
        self._stage = stage
        self._window = window

    def __call__(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        if self._window.covers(now_s):
            return self._stage(packets, now_s)
        return [*self._stage([], now_s), *packets]


# What gets lost


class Loss:
    """Which packets get lost. A fraction of 0 without outages loses none. `up` and `down` are its stages."""

    def __init__(self, fraction: float, seed: int, outages: Sequence[Outage] = ()) -> None:
        """Raises ValueError for a fraction outside 0..1."""
        self._fraction = _share(fraction, "lost")
        self._random = random.Random(f"faults {seed}")
        self._outages = tuple(outages)

    def loses(self, now_s: float, way: Way = Way.BOTH) -> bool:
        """Whether the packet that passes now is lost."""
        if any(outage.way.includes(way) and outage.covers(now_s) for outage in self._outages):
            return True
        return self._random.random() < self._fraction

    def up(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        return [packet for packet in packets if not self.loses(now_s, Way.UP)]

    def down(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        return [packet for packet in packets if not self.loses(now_s, Way.DOWN)]


class LossyLink(FaultyLink):
    """A datagram link with losses in both directions, and nothing else."""

    def __init__(self, link: Link, loss: Loss, now_s: Callable[[], float]) -> None:
        super().__init__(link, Faults(up=(loss.up,), down=(loss.down,)), now_s)


# What comes late


class _Waiting:
    """Packets until they are due; those of one moment in the order in which they came."""

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Packet]] = []
        self._count = 0

    def put(self, due_s: float, packet: Packet) -> None:
        heapq.heappush(self._heap, (due_s, self._count, packet))
        self._count += 1

    def due(self, now_s: float) -> list[Packet]:
        packets = []
        while self._heap and self._heap[0][0] <= now_s + _ROUNDING_S:
            packets.append(heapq.heappop(self._heap)[2])
        return packets


class Lag:
    """Everything comes later by `delay_s`, in order; with jitter by up to `jitter_s` more, and packets may swap.

    When the window ends, what comes after it does not overtake what still waits.
    """

    def __init__(self, delay_s: float, *, jitter_s: float = 0.0, window: Window = ALWAYS, seed: int = 0) -> None:
        """Raises ValueError for a time that is negative or not finite."""
        self._delay_s = _seconds(delay_s, "lag")
        self._jitter_s = _seconds(jitter_s, "jitter")
        self._window = window
        self._random = random.Random(f"lag {seed}")
        self._waiting = _Waiting()
        self._last_s = -math.inf

    def __call__(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        late = self._window.covers(now_s)
        for packet in packets:
            self._last_s = max(self._last_s, now_s + self._delay_s if late else now_s)
            more_s = self._random.uniform(0, self._jitter_s) if late and self._jitter_s else 0.0
            self._waiting.put(self._last_s + more_s, packet)
        return self._waiting.due(now_s)


class Bandwidth:
    """So many bytes pass in a second; the others queue up in order, and what the queue cannot hold is lost."""

    def __init__(self, bytes_per_s: float, *, queue_bytes: int = QUEUE_BYTES, window: Window = ALWAYS) -> None:
        """Raises ValueError for a rate that is not positive or a queue too short for one frame."""
        if not (bytes_per_s > 0 and math.isfinite(bytes_per_s)):
            raise ValueError("the bandwidth must be a positive number of bytes per second")
        if queue_bytes < LONGEST_FRAME:
            raise ValueError(f"the queue must hold at least one frame, {LONGEST_FRAME} bytes")
        self._bytes_per_s = bytes_per_s
        self._queue_bytes = queue_bytes
        self._window = window
        self._queue: deque[tuple[float, Packet]] = deque()
        self._free_s = -math.inf
        self.queued_bytes = 0
        """Not yet through."""
        self.dropped = 0
        """Packets that found no room."""

    def __call__(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        through = self._leave(now_s)
        slow = self._window.covers(now_s)
        for packet in packets:
            size = len(packet[1])
            if self.queued_bytes + size > self._queue_bytes:
                self.dropped += 1
                continue
            self.queued_bytes += size
            self._free_s = max(self._free_s, now_s) + (size / self._bytes_per_s if slow else 0.0)
            self._queue.append((self._free_s, packet))
        return through + self._leave(now_s)

    def _leave(self, now_s: float) -> list[Packet]:
        packets = []
        while self._queue and self._queue[0][0] <= now_s + _ROUNDING_S:
            packet = self._queue.popleft()[1]
            self.queued_bytes -= len(packet[1])
            packets.append(packet)
        return packets


# What comes twice, out of order or damaged


class Duplicates:
    """A share of the packets comes twice, the copy at any time within `within_s` after the first."""

    def __init__(self, share: float, seed: int, *, within_s: float = 0.0) -> None:
        """Raises ValueError for a share outside 0..1 or a time that is negative or not finite."""
        self._share = _share(share, "duplicated")
        self._within_s = _seconds(within_s, "time within which a copy comes")
        self._random = random.Random(f"duplicates {seed}")
        self._waiting = _Waiting()

    def __call__(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        for packet in packets:
            self._waiting.put(now_s, packet)
            if self._random.random() < self._share:
                self._waiting.put(now_s + self._random.uniform(0, self._within_s), packet)
        return self._waiting.due(now_s)


class Reordering:
    """A share of the packets is held for `hold_s`, and what comes meanwhile overtakes it."""

    def __init__(self, share: float, seed: int, *, hold_s: float = 0.05) -> None:
        """Raises ValueError for a share outside 0..1 or a time that is negative or not finite."""
        self._share = _share(share, "reordered")
        self._hold_s = _seconds(hold_s, "time for which a packet is held")
        self._random = random.Random(f"reordering {seed}")
        self._waiting = _Waiting()

    def __call__(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        for packet in packets:
            held = self._random.random() < self._share
            self._waiting.put(now_s + self._hold_s if held else now_s, packet)
        return self._waiting.due(now_s)


class Corruption:
    """In a share of the packets one byte is another."""

    def __init__(self, share: float, seed: int) -> None:
        """Raises ValueError for a share outside 0..1."""
        self._share = _share(share, "corrupted")
        self._random = random.Random(f"corruption {seed}")

    def __call__(self, packets: Sequence[Packet], now_s: float) -> list[Packet]:
        return [
            (address, self._damaged(data) if data and self._random.random() < self._share else data)
            for address, data in packets
        ]

    def _damaged(self, data: bytes) -> bytes:
        place = self._random.randrange(len(data))
        return data[:place] + bytes([data[place] ^ self._random.randrange(1, 256)]) + data[place + 1 :]


def _share(value: float, what: str) -> float:
    if not 0 <= value <= 1:
        raise ValueError(f"the share of {what} packets must lie between 0 and 1")
    return value


def _seconds(value: float, what: str) -> float:
    if not (value >= 0 and math.isfinite(value)):
        raise ValueError(f"the {what} must be a number of seconds, 0 or more")
    return value
