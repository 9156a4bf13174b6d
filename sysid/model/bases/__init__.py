"""The bases: one file each, a structure before any effect; the folder is the registry. docs/how-to/base.md adds one.

Loads nothing, so that a command's help may list them.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent
NAMES = tuple(sorted(path.stem for path in FOLDER.glob("[a-z]*.py")))
"""Of the bases in the folder, by letters; `sysid.model.base.bases` has them in their own order."""
DEFAULT = "tpp"
"""Where nobody says which: the Tip-Path Plane, on which gains are designed."""
