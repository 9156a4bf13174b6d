"""Signing keys on disk: a file of 64 hexadecimal digits for its owner's eyes only, and beside it the time kept.

The key itself is never printed and never logged; people compare its id. `KEY.state` holds what must not go backwards,
and this station's own link id.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import stat
import threading
from dataclasses import dataclass, field
from pathlib import Path

from gcs.errors import LinkError, UsageError
from gcs.files import put_in_place
from gcs.link.signing import AHEAD, UNITS_PER_S, Signing

KEY_BYTES = 32
LATEST = (1 << 48) - 1
"""Of what the 48 bits of a signature's time hold."""


@dataclass(frozen=True, slots=True)
class Key:
    """32 secret bytes."""

    secret: bytes = field(repr=False)

    @property
    def id(self) -> str:
        """What two people may tell each other on the phone: it does not give the key away."""
        digits = hashlib.sha256(b"tippath key id" + self.secret).hexdigest()[:12]
        return " ".join(digits[at : at + 4] for at in range(0, 12, 4))


def of_passphrase(text: str) -> Key:
    """The key that MAVProxy, Mission Planner and QGroundControl make of the same words: their SHA-256."""
    return Key(hashlib.sha256(text.encode()).digest())


def drawn() -> Key:
    """A new one, of the system's own randomness."""
    return Key(secrets.token_bytes(KEY_BYTES))


def write_key(key: Key, path: Path) -> None:
    """A new file, readable by its owner only. Raises UsageError where there is one, LinkError where it cannot be."""
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as stream:
            stream.write(key.secret.hex() + "\n")
            stream.flush()
            os.fsync(stream.fileno())
    except FileExistsError:
        raise UsageError(f"{path} exists: a key is never overwritten; name another file") from None
    except OSError as error:
        raise LinkError(f"{path}: the key cannot be written ({error.strerror or error})") from error


def read_key(path: Path) -> Key:
    """Raises UsageError where it is no key, or others than its owner could read it."""
    try:
        with path.open("rb") as stream:
            mode = os.fstat(stream.fileno()).st_mode
            text = stream.read(4096)
    except OSError as error:
        raise UsageError(f"{path}: the key cannot be read ({error.strerror or error})") from error
    if os.name == "posix" and stat.S_IMODE(mode) & 0o077:
        raise UsageError(f"{path}: others may read this key; chmod 600 it, or make a new one: tippath key new")
    try:
        secret = bytes.fromhex(text.decode("ascii").strip())
    except ValueError:
        secret = b""
    if len(secret) != KEY_BYTES:
        raise UsageError(f"{path}: not a key (64 hexadecimal digits); make one: tippath key new")
    return Key(secret)


class KeptStamps:
    """The time for signatures, in `KEY.state`; a state that is damaged or not there begins anew."""

    def __init__(self, key_file: Path) -> None:
        self._path = key_file.with_name(key_file.name + ".state")
        self._kept, self.link_id = self._read()
        self._writing: threading.Thread | None = None
        self._tried = -UNITS_PER_S

    def _read(self) -> tuple[int, int]:
        try:
            state = json.loads(self._path.read_text(encoding="utf-8"))
            kept, link_id = state["latest"], state["link_id"]
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            kept = link_id = None
        if isinstance(kept, int) and isinstance(link_id, int) and 0 <= kept <= LATEST and 0 <= link_id <= 255:
            return kept, link_id
        return 0, secrets.randbelow(256)

    def at_least(self) -> int:
        """No signature of ours was ever later than this, nor earlier by more than `AHEAD`."""
        return self._kept

    def keep(self, stamp: int) -> None:
        """Writes ahead of `stamp`, and nothing while what stands there is still ahead of it by half.

        It is on the disk itself after the first time; later ones have ten seconds for that, and nobody waits.
        """
        first, busy = self._writing is None, self._writing is not None and self._writing.is_alive()
        if busy or stamp + AHEAD // 2 <= self._kept or stamp < self._tried + UNITS_PER_S:
            return
        self._tried = stamp
        kept = min(stamp + AHEAD, LATEST)
        self._writing = threading.Thread(target=self._write, args=(kept,), name="tippath key state", daemon=True)
        self._writing.start()
        if first:
            self._writing.join()

    def _write(self, kept: int) -> None:
        try:
            state = json.dumps({"latest": kept, "link_id": self.link_id}).encode()
            put_in_place(state, self._path, durable=True)
        except OSError:
            return  # the next start takes the clock's time, which is later unless somebody set it back
        self._kept = kept


def signing_with(path: Path) -> Signing:
    """What a link needs to sign and to judge with the key of a file. Raises UsageError."""
    return Signing(read_key(path).secret, KeptStamps(path))
