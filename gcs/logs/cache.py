"""What was read from a log, kept beside it, so that it need not be read again.

A file `.tippath/NAME-HASH.runs` for every log and way of reading it: the hash is of the log's bytes, the profile, the
window, and the code that reads logs, so that a changed log, or a changed reader, is read anew. A file is written aside
and moved into place, and carries a keyed hash of itself: half of one counts as none, and so does one that somebody else
wrote, which may lie in any flight folder that one is sent. The key is this user's own, in a file of the user's cache
folder that nobody else may read; without one nothing is kept. A folder that cannot be written, or a full disk, costs
the cache and nothing else. `TIPPATH_CACHE=off` in the environment does without.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import os
import secrets
import stat
import tempfile
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
from platformdirs import user_cache_path

from gcs.files import put_in_place
from gcs.logs.runs.run import Run
from gcs.logs.source import Source

FOLDER = ".tippath"
SUFFIX = ".runs"
MOST_BYTES = 1 << 30  # a run file above it is not written: it would cost more to keep than to make
KEPT = 4  # ways of reading one log; older ones are removed
SWITCH = "TIPPATH_CACHE"
KEY_FOLDER = "tippath"
_DIGEST_BYTES = _KEY_BYTES = 32


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
    key = _own_key()
    if key is None or not hmac.compare_digest(_mark(body, key), digest):
        return None
    try:
        return unpacked(body)
    except (msgspec.MsgspecError, ValueError, TypeError):
        return None


def save(place: Path, content: Content) -> None:
    """Keep it, whole or not at all; a disk that does not take it is no error, nor a name that is no text."""
    key = _own_key()
    try:
        body = packed(content)
    except UnicodeEncodeError:
        return
    if key is None or len(body) > MOST_BYTES:
        return
    with contextlib.suppress(OSError):
        place.parent.mkdir(exist_ok=True)
        put_in_place(_mark(body, key) + body, place)
        _remove_old(place, content.source.path)


def _mark(body: bytes | memoryview, key: bytes) -> bytes:
    return hashlib.blake2b(body, key=key, digest_size=_DIGEST_BYTES).digest()


def _own_key() -> bytes | None:
    """32 secret bytes of this user, drawn when they are first needed; None where they cannot be kept.

    A file that others may read or that is not whole is no secret: another takes its place.
    """
    path = user_cache_path(KEY_FOLDER, appauthor=False) / "cache.key"
    with contextlib.suppress(OSError):
        return _read_key(path) or _new_key(path)
    return None


def _read_key(path: Path) -> bytes | None:
    try:
        with path.open("rb") as stream:
            about, key = os.fstat(stream.fileno()), stream.read(_KEY_BYTES + 1)
    except FileNotFoundError:
        return None
    private = os.name != "posix" or (about.st_uid == os.getuid() and not stat.S_IMODE(about.st_mode) & 0o077)
    return key if private and len(key) == _KEY_BYTES else None


def _new_key(path: Path) -> bytes | None:
    """Two programs that draw one at once keep what the later one wrote. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, aside = tempfile.mkstemp(dir=path.parent)  # for its owner alone
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(secrets.token_bytes(_KEY_BYTES))
        Path(aside).replace(path)
    except OSError:
        Path(aside).unlink(missing_ok=True)
        raise
    return _read_key(path)


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
