"""Outcomes on disk, one file each, named by what it depends on: whoever asks the same again finds it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TypeVar

import msgspec

from gcs import documents
from gcs.campaign.identity import contents
from gcs.campaign.work import Outcome, Predicted
from gcs.files import put_in_place
from gcs.logs.cache import digest_of

LARGEST = 4 << 20
Kept = TypeVar("Kept", Outcome, Predicted)
_KEY = re.compile(r"[0-9a-f]{64}")


class _Hashed(documents.Open, frozen=True, kw_only=True):
    size: int
    mtime_ns: int
    sha256: str


class Store:
    """A campaign's folder: `logs/KEY.json`, `predicted/KEY.json`, and `files.json` with the digests of files that did
    not change since."""

    def __init__(self, folder: Path) -> None:
        """Raises OSError where the folder cannot be made."""
        self._folders = {Outcome: folder / "logs", Predicted: folder / "predicted"}
        self._index = folder / "files.json"
        for each in self._folders.values():
            each.mkdir(parents=True, exist_ok=True)
        try:
            self._hashed = documents.read_json(self._index, dict[str, _Hashed], what="index of files")
        except documents.DocumentError:  # none yet, or damaged: hashed again
            self._hashed = {}

    def digest(self, path: Path) -> str:
        """Of a log's contents; a file is not read again while size and time stay. Raises OSError."""
        return contents(path, self._digest)

    def _digest(self, path: Path) -> str:
        about = path.stat()
        known = self._hashed.get(str(path.resolve()))
        if known is None or (known.size, known.mtime_ns) != (about.st_size, about.st_mtime_ns):
            known = _Hashed(size=about.st_size, mtime_ns=about.st_mtime_ns, sha256=digest_of(path))
            self._hashed[str(path.resolve())] = known
        return known.sha256

    def kept(self, key: str, kind: type[Kept]) -> Kept | None:
        """What was worked out before; None where it was not, or the file is damaged."""
        path = self._place(key, kind)
        try:
            found = documents.read_json(path, kind, what="outcome", largest=LARGEST)
        except documents.DocumentError:
            return None
        return found if found.key == key else None

    def keep(self, found: Outcome | Predicted) -> None:
        """Whole or not at all. Raises OSError where the disk does not take it."""
        body = msgspec.json.format(msgspec.json.encode(found), indent=1)
        put_in_place(body, self._place(found.key, type(found)))

    def keep_index(self) -> None:
        """Raises OSError."""
        put_in_place(msgspec.json.encode(self._hashed), self._index)

    def _place(self, key: str, kind: type[Outcome] | type[Predicted]) -> Path:
        if not _KEY.fullmatch(key):
            raise ValueError(f"{key!r} is no key")
        return self._folders[kind] / f"{key}.json"
