"""Readiness as a page of text, as a parameter file for a pilot's own station, and as JSON."""

from __future__ import annotations

import textwrap
from typing import Any

from gcs.flight.readiness import Readiness
from gcs.vehicle.readiness import Item, Standing

FORMAT = "tippath.check/1"
WIDTH = 78
_MARKS = {Standing.MUST: "✗", Standing.BETTER: "~", Standing.FINE: "✓"}


def page(found: Readiness, width: int = WIDTH) -> list[str]:
    """Lines of at most `width`: what must be changed first, and of that the log."""
    way = "over the link" if found.stream else "from the vehicle's card afterwards"
    lines = [*_wrapped(f" {found.vehicle}", width, 2), *_wrapped(f" card {found.card}; its log comes {way}", width, 2)]
    for standing in Standing:
        its = [item for item in found.items if item.standing is standing]
        if its:
            lines.append(f" {standing.value}")
        lines += [line for item in its for line in item_lines(item, width)]
    return lines


def item_lines(item: Item, width: int = WIDTH) -> list[str]:
    """One item: as it is, what to set, and why."""
    head = " ".join([item.name, item.value])
    if item.wanted:
        head += f"   set {', '.join(f'{name} {value:g}' for name, value in item.wanted)}"
        head += " and restart the autopilot" if item.restart else ""
    text = f"   {_MARKS[item.standing]} {head}" + (f": {item.words}" if item.words else "")
    return _wrapped(text, width, 4)


def closing(found: Readiness) -> str:
    """What follows."""
    if found.ready:
        return "the card can be flown as the vehicle is set; nothing was set"
    count = sum(item.standing is Standing.MUST for item in found.items)
    return f"{count} thing{'s' if count > 1 else ''} must be changed before this card is flown; nothing was set"


def parameter_file(found: Readiness) -> str:
    """The proposed changes as ground stations load them: NAME,VALUE, with `#` before what is said.

    What must be changed stands as it is; what would only be better stands behind a `#`, for the pilot to decide.
    """
    lines = [f"# {found.vehicle}", f"# proposed by tippath check for card {found.card}; nothing was set"]
    if found.restart:
        lines.append("# restart the autopilot after loading these")
    for item in found.items:
        for name, value in item.wanted:
            lines += [f"# {line}" for line in textwrap.wrap(f"{item.name} is {item.value}: {item.words}", 76)]
            lines.append(f"{'' if item.standing is Standing.MUST else '#'}{name},{value:g}")
    if not found.changes and not found.better:
        lines.append("# nothing to change")
    return "\n".join(lines) + "\n"


def document(found: Readiness, written: str | None) -> dict[str, Any]:
    """The `tippath.check/1` document; `written` is the parameter file."""
    return {
        "format": FORMAT,
        "link": found.link,
        "vehicle": found.vehicle,
        "card": found.card,
        "log": "stream" if found.stream else "card",
        "ready": found.ready,
        "reason": "" if found.ready else closing(found),
        "changes": found.changes,
        "better": found.better,
        "restart": found.restart,
        "parameter_file": written,
        "items": [
            {
                "name": item.name,
                "standing": item.standing.value,
                "value": item.value,
                "words": item.words,
                "set": dict(item.wanted),
                "restart": item.restart,
            }
            for item in found.items
        ],
    }


def _wrapped(text: str, width: int, hang: int) -> list[str]:
    indent = " " * (len(text) - len(text.lstrip(" ")) + hang - 2)
    return textwrap.wrap(text, width, subsequent_indent=indent, break_on_hyphens=False)
