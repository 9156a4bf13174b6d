"""Runs of a card as the screens list them: asked for, flown before, and what became of them."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import CardRun, TestCard
from gcs.flight.resume import Earlier
from gcs.flight.run import RunProgress, RunResult, locked
from gcs.flight.run_state import Ending
from gcs.tui.state import Mark, Progress, RunView, Swept

BEFORE = "flown before"


def outcome(result: RunResult) -> tuple[Mark, tuple[str, ...], str]:
    """What became of a run, why in parts, and both in a sentence."""
    verdict = result.verdict
    if verdict is None:
        return Mark.SKIPPED, (result.reason,), result.reason
    if result.clean:
        return Mark.KEEP, verdict.figures, verdict.words
    if result.ending is Ending.FINISHED:
        return Mark.AGAIN, ("; ".join(verdict.reasons), *verdict.figures), verdict.words
    words = f"{result.ending.value}: {result.reason}"
    return Mark.AGAIN, (words,), words


def progress_view(progress: RunProgress) -> Progress:
    """How far a run is; of a chirp, how far along its frequencies."""
    maneuver, hertz = progress.plan.maneuver, progress.frequency_hz
    swept = None
    if maneuver.kind == "chirp" and hertz is not None:
        swept = Swept(maneuver.axis, maneuver.f_start_hz, maneuver.f_stop_hz, hertz)
    return Progress(progress.elapsed_s, maneuver.duration_s, hertz, progress.plan.words, swept)


def views(card: TestCard, earlier: Earlier | None = None) -> tuple[RunView, ...]:
    """A card's runs; of a flight that goes on those that were flown, too."""
    if earlier is None:
        return tuple(view_of(run) for run in card.runs())
    left = (view_of(run, earlier.kept) for run in earlier.left)
    return tuple(sorted((*flown_before(earlier), *left), key=lambda run: run.number))


def flown_before(earlier: Earlier, probes: int = 0) -> tuple[RunView, ...]:
    """What was flown before, with so many probes before the card."""
    runs = [run for run in earlier.card.runs() if run.number in earlier.kept]
    return tuple(replace(view_of(run), number=probes + run.number, mark=Mark.KEEP, why=(BEFORE,)) for run in runs)


def unlocked(
    views: Sequence[RunView], planned: Sequence[CardRun], flown: Sequence[RunResult], limits: Limits
) -> tuple[RunView, ...]:
    """Runs as they stand after what was flown: those whose step before is clean are free, or say what still holds."""
    clean = {one.run.number for one in flown if one.clean}
    by_number = {run.number: run for run in planned}
    found = []
    for view in views:
        run = by_number.get(view.number)
        if view.mark is Mark.LOCKED and run is not None and run.locked_by in clean:
            why = locked(run, flown, limits)
            still = (why.removeprefix(f"{run.label} stays locked: "),)
            view = replace(view, why=still) if why else replace(view, mark=Mark.WAITING, why=())
        found.append(view)
    return tuple(found)


def view_of(run: CardRun, kept: Container[int] = ()) -> RunView:
    """One run that is still to be flown; `kept` are the numbers of those that need not be."""
    locked = run.locked_by is not None and run.locked_by not in kept
    return RunView(
        number=run.number,
        label=run.label,
        numbers=run.maneuver.numbers,
        kind=run.maneuver.kind,
        size=run.maneuver.size,
        mark=Mark.LOCKED if locked else Mark.WAITING,
        why=(f"until {run.locked_by} is clean",) if locked else (),
    )
