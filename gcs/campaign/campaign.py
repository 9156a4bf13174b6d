"""A campaign from logs to what is kept of it: worked on, dated, grouped, and written down in its folder.

campaign/
  campaign.json  what was made of which logs
  dataset/       the same as tables, see `gcs.campaign.dataset`
  logs/, predicted/, files.json   what is done and need not be done again
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import msgspec

from gcs.analysis.quantities import listed
from gcs.campaign.given import Given
from gcs.campaign.groups import copies, grouped, placed
from gcs.campaign.store import Store
from gcs.campaign.work import Outcome, Settings
from gcs.campaign.workers import Cluster, Progress, predict_through, work_through
from gcs.errors import TippathError, UsageError, to_install
from gcs.logs import logs_in

ABOUT = "campaign.json"
FORMAT = "tippath.campaign/1"


@dataclass(frozen=True, eq=False, kw_only=True)
class Campaign:
    """What came of it."""

    outcomes: tuple[Outcome, ...]
    """One of every log, in their order."""
    groups: Mapping[str, tuple[Outcome, ...]]
    """Of one vehicle and configuration each: the independent flights that were fitted, in the order of their time."""
    copies: Mapping[str, str]
    """Path of a log -> path of one that holds the same flight."""

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """Logs without a fit."""
        return tuple(one for one in self.outcomes if one.reason is not None)


def found_logs(words: Iterable[Path]) -> list[Path]:
    """The logs that files and folders name, each once; a campaign's own tables are none.

    Raises TippathError where a folder has none, or is not there.
    """
    logs: dict[Path, None] = {}
    for word in words:
        if not word.exists():
            raise TippathError(f"{word} is not there; name logs, or folders that hold some")
        try:
            found = logs_in(word) if word.is_dir() else [word]
        except OSError as error:
            raise TippathError(f"{word}: cannot be read ({error.strerror or error})") from error
        logs.update(dict.fromkeys(one for one in found if not _is_ours(one)))
    if not logs:
        raise TippathError("no log in what was named, but a campaign's own tables")
    return list(logs)


def _is_ours(path: Path) -> bool:
    return path.suffix == ".parquet" and (path.parent.parent / ABOUT).is_file()


def refuse_without_extra() -> None:
    """Before long work, whose results could not be written. Raises TippathError with what to install."""
    missing = [name for name in ("distributed", "pyarrow") if find_spec(name) is None]
    if missing:
        raise TippathError(
            f"a campaign needs {listed(missing)}, which {'is' if len(missing) == 1 else 'are'} not installed: "
            f"{to_install(*missing)}"
        )


def refuse_strangers(folder: Path) -> None:
    """Before long work: a campaign goes on in its own folder or begins in an empty one. Raises UsageError."""
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"-o {folder} is a file; name a folder")
    if folder.is_dir() and not (folder / ABOUT).is_file() and any(folder.iterdir()):
        raise UsageError(f"-o {folder} holds something, and no campaign: name another folder")


def run_campaign(
    logs: Sequence[Path],
    settings: Settings,
    given: Given,
    folder: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> Campaign:
    """Work on all logs that were not worked on before. Raises as `work_through`."""
    store = Store(folder)
    with Cluster(scheduler, workers) as cluster:
        outcomes = placed(work_through(logs, settings, store, cluster, on_progress=on_progress), given)
        again = copies(outcomes)
        groups = grouped(outcomes, given, again)
        predicted = predict_through(list(neighbours(groups)), store, cluster, on_progress=on_progress)

    def judged(flights: Iterable[Outcome]) -> tuple[Outcome, ...]:
        return tuple(msgspec.structs.replace(one, predicted=predicted.get(one.path)) for one in flights)

    return Campaign(
        outcomes=judged(outcomes), groups={name: judged(each) for name, each in groups.items()}, copies=again
    )


def neighbours(groups: Mapping[str, Sequence[Outcome]]) -> Iterator[tuple[Outcome, Outcome]]:
    """Each flight with the one before it in its group, the first with the second: later flights change none of them."""
    for flights in groups.values():
        for place, one in enumerate(flights):
            if len(flights) > 1:
                yield one, flights[place - 1 if place else 1]
