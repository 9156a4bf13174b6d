"""An autopilot's names and numbers stand in `gcs.vehicle`: no other room's strings spell them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

GCS = Path(__file__).resolve().parents[2] / "gcs"
NAMES = re.compile(
    r"\b(SID|SIDX|LQR|LQS|FS|SYSID|ANGLE|ATC|SCHED|ARMING|LOG|MAV|BRD|RC\d)_[A-Z][A-Z0-9_]*\b"
    r"|\bSystemID (Start|Finish|Stop|Param)|\b(Stabilize|AltHold|Loiter)\b"
)
TELLS = {
    "logs/runs/systemid.py",  # what an ArduPilot log says, to its reader
    "logs/runs/told.py",
    "logs/runs/settings.py",
    "logs/runs/health.py",
    "cli/check.py",  # help: what is looked at
    "cli/fetch.py",  # help: MAVLink's names of the ways
    "cli/sim.py",
}
"""Sentences that name a setting to the user; they decide nothing by it."""


def _strings(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of every string of a module that is no docstring and no description of a field."""
    tree = ast.parse(path.read_text("utf-8"))
    loose = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in loose:
            yield node.lineno, node.value


def _rooms() -> list[str]:
    """Every module outside `link` and `vehicle`."""
    names = (path.relative_to(GCS).as_posix() for path in GCS.rglob("*.py"))
    return sorted(name for name in names if name.split("/")[0] not in ("link", "vehicle"))


@pytest.mark.parametrize("name", [name for name in _rooms() if name not in TELLS])
def test_no_other_room_spells_an_autopilot_s_parameters_texts_or_modes(name: str) -> None:
    spelt = [f"line {line}: {text[:60]!r}" for line, text in _strings(GCS / name) if NAMES.search(text)]
    assert spelt == []


def test_the_room_that_may_does() -> None:
    """The pattern finds what it looks for."""
    assert sum(NAMES.search(text) is not None for _, text in _strings(GCS / "vehicle" / "autopilots.py")) > 15


def test_no_other_room_compares_with_an_autopilot_s_numbers() -> None:
    """`vehicle.mode == 25`: such a number has a name in `gcs.vehicle.autopilots`."""
    numbered = []
    for name in _rooms():
        for node in ast.walk(ast.parse((GCS / name).read_text("utf-8"))):
            if isinstance(node, ast.Compare):
                sides = [node.left, *node.comparators]
                asked = [ast.unparse(side) for side in sides if isinstance(side, ast.Attribute)]
                bare = any(isinstance(side, ast.Constant) and type(side.value) is int for side in sides)
                if bare and any(word.endswith((".mode", ".status", ".autopilot", ".vehicle_type")) for word in asked):
                    numbered.append(f"{name}:{node.lineno} {ast.unparse(node)}")
    assert numbered == []
