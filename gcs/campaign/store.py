"""Outcomes on disk, one file each, named by what it depends on: whoever asks the same again finds it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import msgspec

from gcs import documents
from gcs.campaign.work import Outcome
from gcs.files import put_in_place
from gcs.logs.cache import digest_of

LARGEST = 4 << 20
_KEY = re.compile(r"[0-9a-f]{64}")


class _Hashed(documents.Open, frozen=True, kw_only=True):
    size: int
    mtime_ns: int
    sha256: str


class Store:
    """A campaign's folder: `logs/KEY.json`, and `files.json` with the digests of files that did not change since."""

    def __init__(self, folder: Path) -> None:
        """Raises OSError where the folder cannot be made."""
        self._logs, self._index = folder / "logs", folder / "files.json"
        self._logs.mkdir(parents=True, exist_ok=True)
        try:
            self._hashed = documents.read_json(self._index, dict[str, _Hashed], what="index of files")
        except documents.DocumentError:  # none yet, or damaged: hashed again
            self._hashed = {}

    def digest(self, path: Path) -> str:
        """SHA-256 of a file's bytes; not read again while size and time stay. Raises OSError."""
        about = path.stat()
        known = self._hashed.get(str(path.resolve()))
        if known is None or (known.size, known.mtime_ns) != (about.st_size, about.st_mtime_ns):
            known = _Hashed(size=about.st_size, mtime_ns=about.st_mtime_ns, sha256=digest_of(path))
            self._hashed[str(path.resolve())] = known
        return known.sha256

    def kept(self, key: str) -> Outcome | None:
        """What was worked out before; None where it was not, or the file is damaged."""
        path = self._place(key)
        try:
            found = documents.read_json(path, Outcome, what="outcome", largest=LARGEST)
        except documents.DocumentError:
            return None
        return found if found.key == key else None

    def keep(self, outcome: Outcome) -> None:
        """Whole or not at all. Raises OSError where the disk does not take it."""
        put_in_place(msgspec.json.format(msgspec.json.encode(outcome), indent=1), self._place(outcome.key))

    def keep_index(self) -> None:
        """Raises OSError."""
        put_in_place(msgspec.json.encode(self._hashed), self._index)

    def keys(self) -> Iterable[str]:
        """Of all that is kept."""
        return sorted(path.stem for path in self._logs.glob("*.json") if _KEY.fullmatch(path.stem))

    def _place(self, key: str) -> Path:
        if not _KEY.fullmatch(key):
            raise ValueError(f"{key!r} is no key")
        return self._logs / f"{key}.json"
