"""Are `gcs`, `sysid` and `sitl` ours? The names are short, and another distribution may bring them too."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from gcs.errors import TippathError

OURS = ("gcs", "sysid", "sitl")
INSTALLED = re.compile(rb"^(gcs|sysid|sitl)/", re.MULTILINE)
"""In a distribution's list of files."""
INSTEAD = "install tippath in an environment of its own: python -m venv NAME"


class NamesakeError(TippathError):
    """Another distribution has a package of our name; the message says which, and what to do."""


def refuse_namesakes(root: Path | None = None) -> None:
    """Raises NamesakeError where a package of ours comes from elsewhere than this file does, or where another
    distribution has put its own of that name in the same folder. `root` is that folder."""
    root = root or Path(__file__).resolve().parents[2]
    for name in OURS:
        place = _place(name)
        if place is not None and place != root:
            raise NamesakeError(f"{place / name} stands before tippath's own package {name}; {INSTEAD}")
    for record in _others(root):
        found = INSTALLED.search(record.read_bytes())
        if found:
            other = record.parent.name.removesuffix(".dist-info")
            raise NamesakeError(f"{other} is installed over tippath's own package {found[1].decode()}; {INSTEAD}")


def _place(name: str) -> Path | None:
    """The folder that the package stands in; None where none is found, which its import will say."""
    spec = find_spec(name)
    return None if spec is None or spec.origin is None else Path(spec.origin).resolve().parents[1]


def _others(root: Path) -> Iterable[Path]:
    """Lists of files of the other distributions, where ours is installed beside them and no clone."""
    if not any(root.glob("tippath-*.dist-info")):
        return ()
    return (path for path in root.glob("*.dist-info/RECORD") if not path.parent.name.startswith("tippath-"))
