"""The logs of a flight off the vehicle: which they are, all of each or its runs alone, and a word in flight.json."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from gcs.errors import TippathError
from gcs.flight.fetching import pick
from gcs.flight.fetching.fetch import Fetched, Fetching, fetch
from gcs.flight.fetching.pick import Choice, run_times
from gcs.flight.fetching.ways import VehicleLog
from gcs.flight.fetching.windows import SLOW_FROM_S, Windows, fetch_runs, windows
from gcs.flight.folder import FlightFolder

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is to be fetched, and where it goes."""

    output: Path
    flight: FlightFolder | None = None
    """That `output` is of; None of any other folder."""
    log: int | None = None
    """This one, whatever flight it is of."""
    run: int | None = None
    """What is needed for this run of the flight, from 1."""
    whole: bool = False
    """However long it takes."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A log of the vehicle."""

    choice: Choice
    of: tuple[int, ...] | None = None
    """The runs that it may hold, by their places in flight.json, from 1; None where it was named itself."""


def choose(asked: Asked, fetching: Fetching, logs: Sequence[VehicleLog], say: Say) -> list[Wanted]:
    """One log, or for a flight that was resumed those of each part of it. Raises TippathError where there is none."""
    flight = asked.flight
    if asked.log is not None:
        return [Wanted(pick.numbered(logs, asked.log))]
    if flight is None:
        return [Wanted(pick.newest(logs))]
    runs = flight.runs()
    groups = pick.boots(runs) or [[]]
    if asked.run is not None:
        groups = [group for group in groups if asked.run in group]
    found: dict[int, Wanted] = {}
    failed: list[TippathError] = []
    for group in groups:
        of = [runs[place - 1] for place in group if asked.run in (None, place)]
        file = next((str(run["file"]) for run in of if isinstance(run.get("file"), str)), flight.log.name)
        booted_s = _booted_s(flight) if len(group) == len(runs) else pick.booted(of)
        try:
            choice = pick.of_flight(logs, of, flight.path / Path(file).name, fetching.reading, booted_s=booted_s)
        except TippathError as error:
            failed.append(error)
            continue
        before = found.get(choice.log.number)
        found[choice.log.number] = Wanted(choice, (*((before and before.of) or ()), *group))
    if not found:
        raise failed[0]
    for problem in failed:
        say(str(problem))
    return list(found.values())


def _booted_s(flight: FlightFolder) -> float | None:
    """When the vehicle's clock began, seconds since 1970; None where flight.json does not tell."""
    boot = flight.read().get("boot")
    with contextlib.suppress(TypeError, ValueError):
        return datetime.fromisoformat(boot["booted"]).timestamp() if isinstance(boot, dict) else None
    return None


def bring(asked: Asked, fetching: Fetching, wanted: Wanted, say: Say) -> Fetched:
    """A log into its folder: the whole, or on a slow link the runs alone. Raises TippathError as `fetch`."""
    log, flight = wanted.choice.log, asked.flight
    stem = f"{log.number:08}" if flight is None else f"fetched-{log.number:08}"
    whole = flight is None or asked.whole or (asked.log is not None and asked.run is None)
    alone = None if whole or flight is None else _alone(asked.run, fetching, wanted, flight)
    if alone is None:
        if fetching.rate is not None:
            say(f"about {time_words(log.size / fetching.rate)} at {size_words(round(fetching.rate))}/s")
        return fetch(fetching, log, asked.output, stem)
    numbers, pieces, rate = alone
    what = f"run {numbers[0]}" if len(numbers) == 1 else f"its {len(numbers)} runs"
    say(
        f"this link carries {size_words(round(rate))}/s: {what} alone, {size_words(pieces.size)}, in about "
        f"{time_words(pieces.size / rate)}"
    )
    say(f"(the whole log would take {time_words(log.size / rate)}: --whole)")
    name = f"run-{asked.run}-only" if asked.run is not None else "runs-only"
    return fetch_runs(fetching, log, pieces, asked.output, f"{stem}.{name}", numbers)


def _alone(
    run: int | None, fetching: Fetching, wanted: Wanted, flight: FlightFolder
) -> tuple[list[int], Windows, float] | None:
    """The runs to fetch alone, the pieces of the log, and the link's rate; None where the whole log is no matter, or
    its times are not known."""
    log, asked_for = wanted.choice.log, wanted.of if run is None else (run,)
    known = {
        number: times
        for number, times in enumerate(run_times(flight.runs()), 1)
        if times is not None and (asked_for is None or number in asked_for)
    }
    if not known or fetching.rate is None or log.size / fetching.rate < SLOW_FROM_S:
        return None
    pieces = windows(fetching, log, list(known.values()))
    return None if pieces is None else (list(known), pieces, fetching.rate)


def note(flight: FlightFolder, done: Fetched, of: Sequence[int] | None = None) -> None:
    """Name the file in flight.json, and the runs that it may hold, where that is known."""
    about = flight.read()
    before = about.get("fetched")
    kept = [one for one in before if isinstance(one, dict)] if isinstance(before, list) else []
    entry = {**done.to_json(), "file": done.path.name, "fetched": datetime.now(UTC).isoformat(timespec="seconds")}
    entry |= {} if of is None else {"of": list(of)}
    flight.write({**about, "fetched": [*(one for one in kept if one.get("file") != done.path.name), entry]})


def size_words(size: int) -> str:
    """Of bytes."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"


def time_words(seconds: float) -> str:
    """`80 s`, `3 minutes`."""
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} minutes"
