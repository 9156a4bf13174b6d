"""The book is true of the house: every folder stands on the map, every link leads somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "docs" / "site"
"""Whose own pages link to generated ones: Sphinx looks after those links."""
PAGES = sorted(
    [
        *(page for page in (ROOT / "docs").rglob("*.md") if page.parent != SITE),
        ROOT / "README.md",
        ROOT / "CONTRIBUTING.md",
    ]
)
MOST_ROOMS = 12
"""On the way of a signal from a file, or from the wire, to a verdict."""


def test_the_map_names_every_folder() -> None:
    text = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")
    for package in ("gcs", "sysid", "sitl"):
        section = text.split(f"## `{package}/`")[1].split("\n## ")[0]
        folders = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
        assert folders <= {name.rstrip("/") for name in re.findall(r"`(\w+/)`", section)}, package


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_a_signals_way_is_short_and_every_room_of_it_is_there() -> None:
    drawings = re.findall(r"```mermaid\n(.*?)```", (ROOT / "docs" / "house.md").read_text(encoding="utf-8"), re.DOTALL)
    assert len(drawings) == 2
    for drawing in drawings:
        rooms = re.findall(r"\[\"((?:gcs|sysid)/[\w/]+)", drawing)
        assert len(set(rooms)) == len(rooms) <= MOST_ROOMS, "no room twice"
        assert all((ROOT / room).is_dir() for room in rooms)
        assert rooms.index("sysid/data") < rooms.index("sysid/fit") < rooms.index("sysid/diagnose")
