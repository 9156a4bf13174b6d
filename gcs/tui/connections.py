"""Where to begin: simulated vehicles, recorded flights and links that this computer and earlier flights offer."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, is_kept
from gcs.link.decode import sanitise
from gcs.link.ports import SerialPort, serial_ports
from gcs.link.transport import LinkWordError, parse_link

ANY_UDP = "udpin:0.0.0.0:14550"
PLANTS = ("hover", "hover-ideal", "forward")
SECRET = "hover-ideal"
"""What flies where something is hidden."""
MOST_RECENT = 3
LOGS = frozenset({".bin", ".ulg", ".tlog", ".csv"})
"""Endings of logs that are offered to be opened, in small letters."""
MOST_FOLDERS = 30
"""Newest flights that are looked into for links."""
MOST_PORTS = 6
EPHEMERAL = 32768
FLOWN_WITH = "flown with before"


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """One line of the list."""

    name: str
    about: str = ""
    link: str | None = None
    """The LINK word; None for a simulated vehicle, and for none at all."""
    plant: str | None = None
    """Of the simulated vehicle."""
    hidden: bool = False
    """Something may be hidden in it."""
    seed: int | None = None
    on_ground: bool = False
    card: str = ""
    """To be flown there; empty for the one that was asked for."""
    guided: bool = False
    """With a guide that explains what is seen."""
    replay: Path | None = None
    """A recorded flight to watch again, in place of a link;"""
    speed: float = 1.0
    """so much faster than it was."""
    flight: Path | None = None
    """A flight folder or log to open, in place of a link."""

    @property
    def heading(self) -> str:
        """Above it in the list, with others of its kind."""
        if self.plant is not None:
            return "fly a simulated vehicle"
        return "connect to a vehicle" if self.link is not None else "open a recorded flight"

    @property
    def flies(self) -> str | None:
        """What State.plant shall say."""
        return f"{self.plant} + secret" if self.hidden else self.plant


NOWHERE = Connection(name="no vehicle", about="O opens any other flight folder or log")
GUIDED = Connection(
    name="first flight, guided",
    about="it says, line by line, what you see and what to do",
    plant="hover",
    card="quick",
    guided=True,
)
SIMULATED = (
    Connection(name="simulated hover", about="with physics that the models lack", plant="hover"),
    Connection(name="simulated hover-ideal", about="the paper's Table 4 exactly", plant="hover-ideal"),
    Connection(name="simulated forward", about="Table 5 in forward flight, with an elevator", plant="forward"),
    Connection(
        name="find a hidden effect",
        about="a secret in hover-ideal, or none; Z opens its answer",
        plant=SECRET,
        hidden=True,
    ),
)
UDP = Connection(name=ANY_UDP, about="whatever vehicle sends to this computer", link=ANY_UDP)


def connections(folder: Path) -> tuple[Connection, ...]:
    """All that is offered now, by kind. Looks at ports and at the flights in `folder`: milliseconds."""
    recent = tuple(Connection(name=word, about=FLOWN_WITH, link=word) for word in recent_links(folder))
    ports = tuple(of_port(one) for one in serial_ports()[:MOST_PORTS])
    first = (UDP, *recent, *ports)
    seen: dict[str | None, Connection] = {}
    for one in first:
        seen.setdefault(one.link, one)
    return (GUIDED, *SIMULATED, *recent_flights(folder), NOWHERE, *seen.values())


def first_marked(offered: Sequence[Connection]) -> int:
    """The line to begin on: a link that was flown with before, else the first."""
    return next((i for i, one in enumerate(offered) if one.about == FLOWN_WITH), 0)


def recent_flights(folder: Path) -> list[Connection]:
    """The newest flights in a folder, newest first, then the newest logs that lie there by themselves."""
    try:
        flights = _newest_flights(folder)[:MOST_RECENT]
        logs = [one for one in folder.iterdir() if one.suffix.lower() in LOGS and one.is_file()]
        logs.sort(key=lambda one: one.stat().st_mtime, reverse=True)
    except OSError:
        return []
    return [
        *(Connection(name=sanitise(one.name), about=_about_flight(one), flight=one) for one in flights),
        *(Connection(name=sanitise(one.name), about="a log", flight=one) for one in logs[:MOST_RECENT]),
    ]


def _newest_flights(folder: Path) -> list[Path]:
    """Raises OSError."""
    return sorted((one for one in folder.glob("flight-*") if one.is_dir()), reverse=True)


def _about_flight(path: Path) -> str:
    """`gusty: card hover, 6 of 8 runs kept, 2026-11-22`."""
    try:
        about = FlightFolder(path).read()
    except TippathError:
        return "what was flown is not told"
    name, card, started = (about.get(key) for key in ("name", "card", "started"))
    runs = [run for run in about.get("runs", ()) if isinstance(run, dict)]
    said = [f"card {card}"] if isinstance(card, str) else []
    said.append(f"{sum(map(is_kept, runs))} of {len(runs)} runs kept")
    if isinstance(started, str):
        said.append(started[:10])
    text = ", ".join(said)
    return sanitise(f"{name}: {text}" if isinstance(name, str) and name else text)


def of_port(port: SerialPort) -> Connection:
    """A serial port as a connection."""
    return Connection(name=sanitise(port.link), about=port.about or "serial port", link=port.link)


def typed(text: str) -> Connection:
    """A connection from what somebody typed: a LINK. Raises UsageError, with the words there are."""
    word = text.strip()
    parse_link(word)
    return Connection(name=word, about="", link=word)


def simulated(plant: str, *, seed: int | None = None, on_ground: bool = False) -> Connection:
    """The simulated vehicle with a plant by name."""
    return Connection(name=f"simulated {plant}", plant=plant, seed=seed, on_ground=on_ground)


def recent_links(folder: Path) -> list[str]:
    """Links of the newest flights, newest first, less those of simulated vehicles that are gone."""
    found: list[str] = []
    try:
        flights = _newest_flights(folder)
    except OSError:
        return []
    for path in flights[:MOST_FOLDERS]:
        try:
            about = FlightFolder(path).read()
        except TippathError:
            continue
        link = about.get("link")
        if isinstance(link, str) and link not in found and _may_be_there_again(link):
            found.append(link)
    return found[:MOST_RECENT]


def _may_be_there_again(word: str) -> bool:
    """A simulated vehicle of the app has another port every time."""
    try:
        link = parse_link(word)
    except LinkWordError:
        return False
    return link.kind == "serial" or link.host not in ("127.0.0.1", "::1") or link.port < EPHEMERAL


def vehicle_logs(folder: Path, hidden: bool) -> Path:
    """Where a simulated vehicle keeps its logs; a secret has a folder of its own, with its sealed answer."""
    if not hidden:
        return folder / "vehicle-logs"
    numbers = [int(m[1]) for one in folder.glob("vehicle-*") if (m := re.fullmatch(r"vehicle-(\d{4,})", one.name))]
    return folder / f"vehicle-{max(numbers, default=0) + 1:04d}"
