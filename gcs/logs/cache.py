"""What was read from a log, kept beside it, so that it need not be read again.

A file `.tippath/NAME-HASH.runs` for every log and way of reading it: the hash is of the log's bytes, the profile, the
window, and the code that reads logs, so that a changed log, or a changed reader, is read anew. A file is written aside
and moved into place, and carries a hash of itself: half of one counts as none. A folder that cannot be written, or a
full disk, costs the cache and nothing else. `TIPPATH_CACHE=off` in the environment does without.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gcs.files import put_in_place
from gcs.logs.runs.run import Run
from gcs.logs.source import Source

FOLDER = ".tippath"
SUFFIX = ".runs"
MOST_BYTES = 1 << 30  # a run file above it is not written: it would cost more to keep than to make
KEPT = 4  # ways of reading one log; older ones are removed
SWITCH = "TIPPATH_CACHE"
_DIGEST_BYTES = 32


@dataclass(frozen=True)
class Content:
    """Everything that reading a log gave, before what a flight.json says of it."""

    source: Source
    runs: tuple[Run, ...]


def wanted() -> bool:
    return os.environ.get(SWITCH, "").lower() not in ("off", "0", "no")


def digest_of(path: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal, read in pieces. Raises OSError."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def place(path: Path, sha256: str, ways: Sequence[object]) -> Path:
    """Where what was read of this log, this way, is kept. `ways`: what else the result depends on."""
    key = hashlib.blake2b(digest_size=12)
    for part in (sha256, str(path), _reader(), *ways):
        text = repr(part).encode()
        key.update(len(text).to_bytes(8, "little") + text)
    return path.parent / FOLDER / f"{path.name}-{key.hexdigest()}{SUFFIX}"


def packed(content: Content) -> bytes:
    """As bytes that `unpacked` takes, in a file or from one process to another."""
    return msgspec.msgpack.encode(content, enc_hook=_pack)


def unpacked(body: bytes | memoryview) -> Content:
    """Raises msgspec.MsgspecError, ValueError or TypeError for what `packed` did not make."""
    return msgspec.msgpack.decode(body, type=Content, dec_hook=_unpack)


def load(place: Path) -> Content | None:
    """What was kept there; None where nothing is, or it cannot be trusted."""
    try:
        raw = place.read_bytes()
    except OSError:
        return None
    digest, body = raw[:_DIGEST_BYTES], memoryview(raw)[_DIGEST_BYTES:]
    if hashlib.sha256(body).digest() != digest:
        return None
    try:
        return unpacked(body)
    except (msgspec.MsgspecError, ValueError, TypeError):
        return None


def save(place: Path, content: Content) -> None:
    """Keep it, whole or not at all; a disk that does not take it is no error, nor a name that is no text."""
    try:
        body = packed(content)
    except UnicodeEncodeError:
        return
    if len(body) > MOST_BYTES:
        return
    with contextlib.suppress(OSError):
        place.parent.mkdir(exist_ok=True)
        put_in_place(hashlib.sha256(body).digest() + body, place)
        _remove_old(place, content.source.path)


def _remove_old(place: Path, log: str) -> None:
    name = Path(log).name
    length = len(place.name) - len(name)
    others = [path for path in place.parent.glob("*" + SUFFIX) if path.name[:-length] == name and path != place]
    others.sort(key=lambda path: path.stat().st_mtime, reverse=True)
    for path in others[KEPT - 1 :]:
        _unlink(path)


def _unlink(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return


@cache
def _reader() -> str:
    """A hash of the code and the profiles that reading depends on."""
    digest = hashlib.blake2b(digest_size=12)
    logs = resources.files("gcs.logs")
    rooms = (logs, *(logs / name for name in ("formats", "runs", "profile")), logs / "profile" / "bundled")
    for room in (*rooms, resources.files("gcs.link"), resources.files("sysid.data")):
        for entry in sorted(room.iterdir(), key=lambda entry: entry.name):
            if entry.name.endswith((".py", ".toml")):
                digest.update(entry.name.encode() + b"\0" + entry.read_bytes())
    for name in ("autopilots.py", "own_log.py"):
        digest.update((resources.files("gcs.vehicle") / name).read_bytes())
    digest.update((resources.files("gcs") / "documents.py").read_bytes())
    return digest.hexdigest()


def _pack(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return np.ascontiguousarray(value, np.float64).tobytes()
    if isinstance(value, MappingProxyType):
        return dict(value)
    raise NotImplementedError(f"{type(value)} is nothing that a run holds")


def _unpack(kind: type, value: Any) -> NDArray[np.float64]:
    return np.frombuffer(value, np.float64)
