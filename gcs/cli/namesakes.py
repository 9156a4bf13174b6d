"""Are `gcs`, `sysid` and `sitl` ours? The names are short, and another distribution may bring them too."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path

from gcs.errors import TippathError

OURS = ("gcs", "sysid", "sitl")
IN_RECORD = {name: f"\n{name}/".encode() for name in OURS}
"""How a file of the package begins in a distribution's list of files."""
INSTEAD = "install tippath in an environment of its own: python -m venv NAME"


class NamesakeError(TippathError):
    """Another distribution has a package of our name; the message says which, and what to do."""


def refuse_namesakes(root: Path | None = None) -> None:
    """Raises NamesakeError where a package of ours comes from elsewhere than this file does, or where another
    distribution has put its own of that name in the same folder. `root` is that folder."""
    root = root or Path(__file__).resolve().parents[2]
    for name in OURS:
        place = _place(name)
        if place is not None and place != root / name:
            raise NamesakeError(f"{place} stands before tippath's own package {name}; {INSTEAD}")
    for record in _others(root):
        files = b"\n" + record.read_bytes()
        for name, listed in IN_RECORD.items():
            if listed in files:
                other = record.parent.name.removesuffix(".dist-info")
                raise NamesakeError(f"{other} is installed over tippath's own package {name}; {INSTEAD}")


def _place(name: str) -> Path | None:
    """The package's folder, or the one file of a module; None where none is found, which its import will say."""
    spec = find_spec(name)
    if spec is None or spec.origin is None:
        return None
    origin = Path(spec.origin).resolve()
    return origin if spec.submodule_search_locations is None else origin.parent


def _others(root: Path) -> Iterable[Path]:
    """Lists of files of the other distributions, where ours is installed beside them and no clone."""
    if not any(root.glob("tippath-*.dist-info")):
        return ()
    return (path for path in root.glob("*.dist-info/RECORD") if not path.parent.name.startswith("tippath-"))
