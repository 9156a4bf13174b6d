"""Files written whole or not at all: aside first, then moved into place; nothing is left of a failure."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from gcs.errors import TippathError


def put_in_place(content: bytes, path: Path, *, durable: bool = False) -> None:
    """A file with this content in place of what was there, with `durable` on the disk itself before that goes. Raises
    OSError where the disk does not take it."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")  # two programs may write the same file
    try:
        with part.open("wb") as stream:
            stream.write(content)
            if durable:
                stream.flush()
                os.fsync(stream.fileno())
        part.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise


def write_whole(content: bytes, path: Path) -> None:
    """As `put_in_place`. Raises TippathError with the reason."""
    try:
        put_in_place(content, path)
    except OSError as error:
        raise TippathError(f"{path}: cannot be written ({error.strerror or error})") from error
