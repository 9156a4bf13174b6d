"""What takes long to make and is the same every time is made once for all processes of the suite."""

from __future__ import annotations

import atexit
import copyreg
import hashlib
import os
import pickle
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

T = TypeVar("T")
FOLDER = "TIPPATH_TESTS_MADE"
"""In the environment, for the processes that this one starts."""


def _read_only(mapping: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(mapping)


copyreg.pickle(MappingProxyType, lambda mapping: (_read_only, (dict(mapping),)))  # a record's channels


def share_what_is_made() -> None:
    """The first process makes the folder, and takes it away in the end."""
    if FOLDER not in os.environ:
        os.environ[FOLDER] = tempfile.mkdtemp(prefix="tippath-tests-")
        atexit.register(shutil.rmtree, os.environ[FOLDER], ignore_errors=True)


def made_once(make: Callable[..., T], *of: object) -> T:
    """What `make(*of)` gives, from whoever made it first; `of` are words and numbers, or tuples of them."""
    name = hashlib.sha256(repr((make.__module__, make.__qualname__, of)).encode()).hexdigest()
    path = Path(os.environ[FOLDER], name)
    if not path.exists():
        aside = path.with_suffix(f".{os.getpid()}")
        aside.write_bytes(pickle.dumps(make(*of)))
        aside.replace(path)
    made: T = pickle.loads(path.read_bytes())
    return made
