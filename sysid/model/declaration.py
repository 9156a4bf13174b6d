"""Files that declare one thing: what a user's file defines is read by running it, and any slip in it is said."""

from __future__ import annotations

import hashlib
import importlib.util
from pathlib import Path
from typing import TypeVar

from sysid.errors import SysidError

Declared = TypeVar("Declared")


def declared_in(
    path: Path, kind: type[Declared], error: type[SysidError], sha256: str | None = None
) -> tuple[Declared, str]:
    """What a user's Python file (its code runs) defines as EFFECT, an `Effect`, or BASE, a `Base`; and its sha256.

    Where a `sha256` is given, code of any other does not run. Raises `error` for such a file, and for one that cannot
    be read, fails, or defines no such thing.
    """
    name, word = kind.__name__.upper(), kind.__name__.lower()
    article = "an" if word[0] in "aeiou" else "a"
    try:
        content = path.read_bytes()
    except OSError as cause:
        raise error(f"{path}: cannot be read ({cause.strerror or cause})") from cause
    found = hashlib.sha256(content).hexdigest()
    if sha256 is not None and found != sha256:
        raise error(f"the {word} file {path} has changed since this fit was made; its code was not run")
    spec = importlib.util.spec_from_file_location(f"user_{word}_{path.stem}", path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    try:
        exec(compile(content, str(path), "exec"), module.__dict__)  # these bytes: the file may be another by now
        declared = getattr(module, name)
    except (Exception, SystemExit) as cause:  # a user's file may fail in any way; it must not take the tool down
        raise error(f"{path}: not {article} {word} file ({type(cause).__name__}: {cause})") from cause
    if not isinstance(declared, kind):
        raise error(f"{path}: {name} is not {article} {kind.__name__} but {type(declared).__name__}")
    return declared, found
