"""The folder of a flight: what it is called, what lies in it, and the file that says what was flown.

    flight-0007/
      flight.BIN     the vehicle's own log, byte for byte
      flight.tlog    the telemetry, both directions
      card.toml      the card as it was flown
      flight.json    the vehicle, the runs with their verdicts, how the samples came and how many are missing;
                     the flight's name and notes
      audit.jsonl    what was done, when, and the command that does it again; only ever appended to
      tpp.json ...   what was made of it: fits, comparisons, gains, reports, none of them overwritten

A folder that holds something is never flown into, but to go on with its flight (`gcs.flight.resume`). `flight.json` is
replaced whole after every run, so that a flight that ends badly is told as far as it went. A log that lies among
strangers (`X.BIN` in a folder that is no flight's) has its own `X.BIN.flight.json` and `X.BIN.audit.jsonl` beside it.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from gcs import documents
from gcs.errors import TippathError, UsageError
from gcs.files import put_in_place

FORMAT = "tippath.flight/1"
_NUMBERED = re.compile(r"flight-(\d{4,})")


class _About(documents.Open, frozen=True, kw_only=True):
    """What must be so of a flight.json that is believed; what else it holds is for those who look for it."""

    format: Literal["tippath.flight/1"]
    runs: tuple[dict[str, Any], ...] = ()


class _AuditLine(documents.Open, frozen=True, kw_only=True):
    time: str
    did: str
    command: str | None
    by: str


class NoFlightError(TippathError):
    """There is no flight.json, or it is another program's."""


USERS_KEYS = ("name", "notes")
"""Of flight.json, that nobody but the user writes."""
_WRITING = threading.RLock()
"""A note comes from another thread than the flight that is being written down."""


@dataclass(frozen=True, slots=True)
class AuditEntry:
    """One line of audit.jsonl."""

    time: str
    """ISO 8601, UTC."""
    did: str
    command: str | None
    """What does the same in a shell, where something does."""
    by: str
    """`app` or `command`."""


@dataclass(frozen=True, slots=True)
class FlightFolder:
    """One flight on disk."""

    path: Path
    of: str = ""
    """The file name of a log that is a flight by itself; empty where the folder is the flight."""

    @property
    def log(self) -> Path:
        return self.path / "flight.BIN"

    def logs(self) -> list[Path]:
        """All that were streamed into it, in the order in which they were."""
        found = [path for path in self.path.glob("flight*.BIN") if path.is_file()]
        return sorted(found, key=lambda path: (len(path.name), path.name))

    @property
    def tlog(self) -> Path:
        return self.path / "flight.tlog"

    @property
    def card(self) -> Path:
        return self.path / "card.toml"

    @property
    def about(self) -> Path:
        return self.path / (f"{self.of}.flight.json" if self.of else "flight.json")

    @property
    def audit_file(self) -> Path:
        return self.path / (f"{self.of}.audit.jsonl" if self.of else "audit.jsonl")

    def write(self, about: Mapping[str, Any]) -> None:
        """Write flight.json, whole or not at all; name and notes stay as the user wrote them last. Raises TippathError
        where the disk does not take it."""
        with _WRITING:
            users: dict[str, Any] = {}
            with contextlib.suppress(TippathError):  # nothing there yet, or nothing to be kept of
                users = {key: value for key, value in self.read().items() if key in USERS_KEYS}
            self._put({**about, **users})

    def _put(self, about: Mapping[str, Any]) -> None:
        document = {"format": FORMAT, **{key: value for key, value in about.items() if key != "format"}}
        text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False)
        try:
            put_in_place(f"{text}\n".encode(), self.about, durable=True)
        except OSError as error:
            raise TippathError(f"{self.about} cannot be written ({error.strerror or error})") from error

    def rename(self, name: str) -> None:
        """Give the flight a name. Raises TippathError where flight.json is damaged, or the disk does not take it."""
        with _WRITING:
            self._put({**self._known(), "name": name})

    def note(self, time: datetime, text: str, more: Mapping[str, Any] | None = None) -> None:
        """Add a note, with `more` about when it was written. Raises as `rename`; a flight that is being flown goes on
        writing its own part meanwhile."""
        with _WRITING:
            about = self._known()
            notes = about.get("notes")
            added = {"time": stamp(time), "text": text, **(more or {})}
            self._put({**about, "notes": [*(notes if isinstance(notes, list) else ()), added]})

    def _known(self) -> dict[str, Any]:
        """What flight.json says, nothing where there is none."""
        return self.read() if self.about.exists() else {}

    @property
    def name(self) -> str:
        """As the user gave it; empty where there is none, or flight.json cannot be read."""
        with contextlib.suppress(TippathError):
            name = self.read().get("name")
            return name if isinstance(name, str) else ""
        return ""

    def notes(self) -> list[tuple[str, str]]:
        """Time and text of each note, oldest first; none where flight.json cannot be read."""
        with contextlib.suppress(TippathError):
            notes = self.read().get("notes")
            return [
                (str(one.get("time", "")), str(one["text"]))
                for one in (notes if isinstance(notes, list) else ())
                if isinstance(one, dict) and isinstance(one.get("text"), str)
            ]
        return []

    def audit(self, time: datetime, did: str, command: str | None = None, *, by: str = "command") -> None:
        """Append what was done to audit.jsonl. Raises TippathError where the disk does not take it.

        A line that was cut off (the laptop died, the disk was full) stays as it is; the next begins on its own.
        """
        entry = {"time": stamp(time), "by": by, "did": did, "command": command}
        line = json.dumps(entry, ensure_ascii=False).encode() + b"\n"
        try:
            with self.audit_file.open("a+b") as stream:
                size = stream.seek(0, os.SEEK_END)
                if size:
                    stream.seek(size - 1)
                    line = line if stream.read(1) == b"\n" else b"\n" + line
                stream.write(line)
        except OSError as error:
            raise TippathError(f"{self.audit_file} cannot be written ({error.strerror or error})") from error

    def audited(self) -> tuple[list[AuditEntry], int]:
        """What was done, oldest first, and how many lines are damaged. Raises TippathError where it cannot be read."""
        try:
            lines = self.audit_file.read_bytes().split(b"\n")
        except FileNotFoundError:
            return [], 0
        except OSError as error:
            raise TippathError(f"{self.audit_file} cannot be read ({error.strerror or error})") from error
        found: list[AuditEntry] = []
        damaged = 0
        for line in filter(None, map(bytes.strip, lines)):
            try:
                entry = documents.parse_json(line.decode(), _AuditLine, self.audit_file.name)
                found.append(AuditEntry(entry.time, entry.did, entry.command, entry.by))
            except (UnicodeDecodeError, documents.DocumentError):
                damaged += 1
        return found, damaged

    def write_card(self, text: str) -> None:
        """Keep the card beside the log. Raises TippathError where the disk does not take it."""
        made = False
        try:
            with self.card.open("x", encoding="utf-8") as stream:
                made = True
                stream.write(text)
        except OSError as error:
            if made:
                self.card.unlink(missing_ok=True)
            raise TippathError(f"{self.card} cannot be written ({error.strerror or error})") from error

    def read(self) -> dict[str, Any]:
        """What flight.json says. Raises NoFlightError where there is none, DocumentError where it is damaged."""
        if not self.about.exists():
            raise NoFlightError(f"{self.path} is no flight folder: there is no {self.about.name} in it")
        text = documents.read_text(self.about, "flight", documents.LARGEST_JSON)
        about = documents.json_value(text, str(self.about))
        if isinstance(about, dict) and isinstance(about.get("format"), str) and about["format"] != FORMAT:
            raise NoFlightError(f"{self.about} is not a {FORMAT} file")
        documents.convert(about, _About, str(self.about))
        return dict(about)

    def runs(self) -> list[dict[str, Any]]:
        """The runs of flight.json, in the order flown. Raises as `read`."""
        return list(self.read().get("runs", ()))


def is_kept(run: Mapping[str, Any]) -> bool:
    """Whether a run of flight.json was flown to its end and nothing speaks against it, as far as was known then."""
    verdict = run.get("verdict")
    if not isinstance(verdict, dict) or run.get("ending") != "finished":
        return False
    return verdict.get("keep") is True or (verdict.get("log") == "card" and verdict.get("keep") is None)


def fetched_for(about: Mapping[str, Any]) -> dict[str, tuple[int, ...] | None]:
    """Name of each file that was fetched -> the runs that it may hold, by their places in flight.json, from 1;
    None where that is not told."""
    told = about.get("fetched")
    entries = [one for one in told if isinstance(one, dict)] if isinstance(told, list) else []
    named = [(Path(str(one.get("file"))).name, one.get("of")) for one in entries]
    return {name: tuple(i for i in of if isinstance(i, int)) if isinstance(of, list) else None for name, of in named}


def stamp(time: datetime) -> str:
    """As it is written: ISO 8601 in UTC, to the millisecond."""
    return time.astimezone(UTC).isoformat(timespec="milliseconds")


def flight_of(path: Path) -> FlightFolder:
    """The flight that a folder or a log is: the folder, the folder that the log belongs to, or the log by itself."""
    if path.is_dir():
        return FlightFolder(path)
    folder = FlightFolder(path.parent)
    of_flight = folder.about.is_file() and path.stem.lower().startswith("flight")
    return folder if of_flight else FlightFolder(path.parent, path.name)


def keep(document: Mapping[str, Any], path: Path) -> Path:
    """As `keep_text`, a JSON document."""
    return keep_text(json.dumps(document, indent=1, allow_nan=False) + "\n", path)


def keep_text(text: str, path: Path) -> Path:
    """Write a result beside the log, under the next free name where another one stands there already; where it stands.

    Raises TippathError where the disk does not take it; nothing is left of a failure.
    """
    number = 1
    while True:
        made = False
        target = path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
        try:
            with target.open("x", encoding="utf-8") as stream:
                made = True
                stream.write(text)
            return target
        except FileExistsError:
            with contextlib.suppress(OSError, ValueError):
                if target.read_text(encoding="utf-8") == text:
                    return target
            number += 1
        except OSError as error:
            if made:
                target.unlink(missing_ok=True)  # half a file would be taken for one
            raise TippathError(f"{target} cannot be written ({error.strerror or error})") from error


def create(given: Path | None, parent: Path | None = None) -> FlightFolder:
    """Make the folder of the next flight: `given`, or `flight-NNNN` with the next free number in `parent`.

    Raises UsageError where `given` holds something already, TippathError where no folder can be made.
    """
    if given is not None:
        return FlightFolder(_fresh(given))
    parent = Path() if parent is None else parent
    try:
        number = max(_numbered(parent), default=0) + 1
        while True:
            path = parent / f"flight-{number:04d}"
            try:
                path.mkdir()
                return FlightFolder(path)
            except FileExistsError:
                number += 1  # somebody else was faster
    except OSError as error:
        raise TippathError(
            f"no folder for the flight can be made in {parent.resolve()} ({error.strerror or error}); "
            "choose another with -o DIR"
        ) from error


def newest(parent: Path) -> Path | None:
    """The `flight-NNNN` with the highest number, None where there is none. Raises OSError."""
    numbered = _numbered(parent)
    return numbered[max(numbered)] if numbered else None


def _numbered(parent: Path) -> dict[int, Path]:
    return {int(m[1]): entry for entry in parent.iterdir() if (m := _NUMBERED.fullmatch(entry.name))}


def _fresh(path: Path) -> Path:
    """Make `path`, or take it where it is empty."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        occupied = next(path.iterdir(), None)
    except FileExistsError:
        raise UsageError(f"{path} is a file; choose a folder with -o DIR") from None
    except OSError as error:
        raise TippathError(f"{path} cannot be made ({error.strerror or error}); choose another with -o DIR") from error
    if occupied is not None:
        raise UsageError(
            f"{path} holds something already ({occupied.name}); flights are never overwritten: choose another -o DIR"
        )
    return path
