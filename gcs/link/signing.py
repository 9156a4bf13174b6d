"""MAVLink 2 signing: what we say is signed with the key, and what comes is believed only where it is.

A signature is the first 6 bytes of SHA-256 over the key, the frame, a link id and a time in units of 10 us since 2015
(MAVLink's own description). pymavlink's codec signs what goes out. What comes in is judged here: that codec notes the
time of a frame before it has looked at its signature, so that one forged frame of the far future would shut out the
vehicle; and it does not say why it refuses.
"""

from __future__ import annotations

import hashlib
import hmac
import threading
import time
from collections import Counter
from collections.abc import Callable
from enum import StrEnum
from typing import Any, Protocol

EPOCH_S = 1420070400
"""1 January 2015, seconds since 1970."""
UNITS_PER_S = 100_000
TOO_OLD = 60 * UNITS_PER_S
"""How far behind our own time a voice that was never heard may be."""
AHEAD = 20 * UNITS_PER_S
"""How far the time on disk runs before the signatures, so that it is not written all the time and holds after a crash.
Short: whoever hears a time takes it over, and another station's clock may not lag behind it by `TOO_OLD`."""
SIGNED = 0x01
SIGNATURE = 13
RADIO_STATUS = 109
"""A telemetry radio speaks this between two stations and has no key. It is displayed, and nothing follows from it."""
MOST_VOICES = 256
"""Whose last times are kept; only who has the key can be one of them."""


class Refusal(StrEnum):
    """Why a frame with a right checksum is not believed."""

    MAVLINK_1 = "MAVLink 1"
    UNSIGNED = "unsigned"
    WRONG = "wrongly signed"
    """By another key, or altered on its way: nobody can tell which."""
    REPLAYED = "replayed"
    """Not newer than the last of this voice; one that others overtook on its way looks the same."""
    TOO_OLD = "too old"


class Stamps(Protocol):
    """The time for signatures, kept over the end of the program."""

    link_id: int
    """0 to 255; of what is sent."""

    def at_least(self) -> int:
        """No signature of ours was ever later than this, nor earlier by more than `AHEAD`."""
        ...

    def keep(self, stamp: int) -> None:
        """Remember that signatures up to `stamp` may have been made. May write a file; raises nothing."""
        ...


def is_signed(frame: bytes) -> bool:
    """Whether a whole frame carries a signature, right or not."""
    return frame[0] == 0xFD and bool(frame[2] & SIGNED)


class Signing:
    """One key on one link: signs, judges, counts. `wall_clock` gives seconds since 1970."""

    def __init__(self, key: bytes, stamps: Stamps, *, wall_clock: Callable[[], float] = time.time) -> None:
        """Raises ValueError for a key that has not 32 bytes."""
        if len(key) != 32:
            raise ValueError("a key has 32 bytes")
        self.refused: Counter[Refusal] = Counter()
        """Frames with a right checksum that were not believed."""
        self._key = key
        self._stamps = stamps
        self._wall_clock = wall_clock
        self._lock = threading.Lock()
        self._latest = stamps.at_least()
        self._heard = self._latest - AHEAD
        self._voices: dict[tuple[int, int, int], int] = {}
        """(link id, system, component) -> time of the last frame that was believed."""

    def __repr__(self) -> str:
        return "Signing(…)"  # no key in any log

    def equip(self, mav: Any) -> None:
        """Let a pymavlink codec sign what it packs from now on; `stamp` before each frame."""
        mav.signing.secret_key = self._key
        mav.signing.link_id = self._stamps.link_id
        mav.signing.sign_outgoing = True

    def stamp(self, mav: Any) -> None:
        """Give the codec the next frame's time: the clock's, and never one that was used before."""
        with self._lock:
            self._latest = max(self._latest + 1, self._now())
            mav.signing.timestamp = self._latest

    def keep(self) -> None:
        """Remember how far the time has come. Not from a thread that must not wait for a disk."""
        self._stamps.keep(self._latest)

    def refusals(self) -> tuple[tuple[str, int], ...]:
        """Why frames were refused, and how many, the most first."""
        return tuple((str(why), count) for why, count in self.refused.most_common())

    def believes(self, frame: bytes, message_id: int) -> bool:
        """Whether a frame with a right checksum comes from somebody who has the key, and is new. Counts if not."""
        refusal = self._judge(frame)
        if refusal in (Refusal.UNSIGNED, Refusal.MAVLINK_1) and message_id == RADIO_STATUS:
            return True
        if refusal is not None:
            self.refused[refusal] += 1
        return refusal is None

    def _judge(self, frame: bytes) -> Refusal | None:
        if frame[0] != 0xFD:
            return Refusal.MAVLINK_1
        if not is_signed(frame):
            return Refusal.UNSIGNED
        told = hashlib.sha256(self._key + frame[:-6]).digest()[:6]
        if not hmac.compare_digest(told, frame[-6:]):
            return Refusal.WRONG
        voice, stamp = (frame[-SIGNATURE], frame[5], frame[6]), int.from_bytes(frame[-12:-6], "little")
        last = self._voices.get(voice)
        if last is not None and stamp <= last:
            return Refusal.REPLAYED
        if last is None and (stamp + TOO_OLD < max(self._heard, self._now()) or len(self._voices) >= MOST_VOICES):
            return Refusal.TOO_OLD
        self._voices[voice] = stamp
        self._heard = max(self._heard, stamp)
        with self._lock:
            self._latest = max(self._latest, stamp)
        return None

    def _now(self) -> int:
        return int((self._wall_clock() - EPOCH_S) * UNITS_PER_S)
