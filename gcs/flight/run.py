"""One run of a card: flown with an excitation, told of while it goes, judged after it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

from gcs.cards.envelope import Limits, Peaks, Use, use
from gcs.cards.maneuver import CardRun
from gcs.flight.connection import Clock, Connection
from gcs.flight.excitation import Excitation
from gcs.flight.probe import ProbeResult
from gcs.flight.rules import TICK_S, joined
from gcs.flight.run_state import Ending, Phase
from gcs.flight.verdict import Verdict, cut, judge, judge_by_telemetry
from gcs.vehicle.profile import Plan
from gcs.vehicle.snapshot import VehicleSnapshot

PEAKS = ("p", "q", "r", "roll", "pitch", "delta_x", "delta_y")
"""Those that flight.json tells."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunProgress:
    """A run under way, for a screen or a line."""

    run: CardRun
    plan: Plan
    phase: Phase
    elapsed_s: float
    """Of the maneuver itself; negative before it begins."""
    frequency_hz: float | None
    peaks: Peaks
    use: Use
    snapshot: VehicleSnapshot
    ending: Ending | None = None
    """Why it is being ended, once it is."""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class RunReady:
    """Its parameters are in the vehicle, bit for bit."""

    run: CardRun
    plan: Plan


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """A run that was flown, or not."""

    run: CardRun
    plan: Plan
    ending: Ending
    reason: str
    """What went otherwise than planned, empty where nothing did."""
    mode_after: str
    started: str
    """UTC."""
    duration_s: float
    """From entering the excitation mode to its end."""
    log_start_s: float | None
    """The log's own time of entering the mode; None where no samples came. Where the log stays on the card, by the
    link's clock."""
    log_start_within_s: float = 0.0
    """How far off that may be."""
    peaks: Peaks
    verdict: Verdict | None
    """None where nothing was flown."""
    file: str | None = None
    """The log in which it begins; None where the log stays on the card."""

    @property
    def clean(self) -> bool:
        return self.ending is Ending.FINISHED and self.verdict is not None and self.verdict.clean

    @property
    def why_early(self) -> str:
        """Why a card ends with it: of a run that nobody started, what ended the card."""
        never = self.verdict is None and self.ending is Ending.ABORTED and self.reason
        return self.reason if never else joined(f"{self.run.label} {self.ending.value}", self.reason)

    def to_json(self) -> dict[str, Any]:
        return {
            "number": self.run.number,
            "label": self.run.label,
            "purpose": self.run.maneuver.purpose,
            "probe": self.run.probe,
            "maneuver": self.run.maneuver.to_json(),
            "flew": self.plan.words,
            "parameters": dict(self.plan.writes),
            "ending": self.ending.value,
            "reason": self.reason,
            "mode_after": self.mode_after,
            "started": self.started,
            "duration_s": round(self.duration_s, 3),
            "file": self.file,
            "log_start_s": None if self.log_start_s is None else round(self.log_start_s, 6),
            "log_start_within_s": round(self.log_start_within_s, 3),
            "peaks": {name: _rounded(getattr(self.peaks, name)) for name in PEAKS},
            "verdict": None if self.verdict is None else self.verdict.to_json(),
        }


def _rounded(peak: float | None) -> float | None:
    return None if peak is None else round(peak, 5)


@dataclass(frozen=True, slots=True)
class Probed:
    """The probe was flown; where it is `wrong`, the card is not."""

    result: ProbeResult


@dataclass(frozen=True, slots=True)
class Note:
    """Something to tell the user."""

    words: str


Progress = Note | Probed | RunReady | RunProgress | RunResult


def fly_run(
    session: Connection,
    run: CardRun,
    flown: Excitation,
    *,
    clock: Clock,
    on_progress: Callable[[Progress], None],
    aborted: Callable[[], str | None],
    rate_hz: float | None,
    interruptions: Callable[[], int] = lambda: 0,
    blind: Callable[[], bool] = lambda: False,
) -> RunResult:
    """Fly one run whose parameters are in the vehicle, from the mode that the pilot left it in.

    `interruptions` counts how often somebody pressed Ctrl-C: once more while the link is lost, and it is not waited
    for any longer; `blind` says whether somebody wants its size set to 0 meanwhile. Afterwards `flown` is to be
    watched until it is cleared, before anything is written. Raises what `on_progress` raises, after the excitation
    ended.
    """
    started = datetime.now(UTC).isoformat(timespec="milliseconds")
    contradicted = False
    log, health = session.snapshot().recording, session.log_health()
    file = None if log is None or (health is not None and health.on_card) else log.name
    with flown:
        pressed_before: int | None = None  # the link was lost
        while flown.tick(
            aborted(), given_up=pressed_before is not None and interruptions() > pressed_before, blind=blind()
        ):
            if not flown.snapshot.lost:
                pressed_before = None
            elif pressed_before is None:
                pressed_before = interruptions()
            if flown.state.contradictions and not contradicted:
                contradicted = True
                on_progress(Note(contradiction(flown)))
            on_progress(_progress(run, flown))
            clock.sleep(TICK_S)
    state, ending, reason = flown.state, flown.state.ending, flown.state.reason
    assert ending is not None
    if ending is Ending.FINISHED and flown.other_settings:  # its answer came after the end
        ending, reason = Ending.SETTINGS, joined(reason, flown.other_settings)
    interruption = "" if ending is Ending.FINISHED else f"{ending.value}: {reason}"
    verdict = None if state.flying_since is None else _verdict(session, flown, rate_hz, interruption)
    return RunResult(
        run=run,
        plan=flown.plan,
        ending=ending,
        reason=joined(reason, contradiction(flown)),
        mode_after=state.mode_after,
        started=started,
        duration_s=flown.elapsed_s,
        log_start_s=flown.log_start_s,
        log_start_within_s=flown.log_start_within_s,
        peaks=flown.peaks,
        verdict=verdict,
        file=file,
    )


def _progress(run: CardRun, flown: Excitation) -> RunProgress:
    return RunProgress(
        run=run,
        plan=flown.plan,
        phase=flown.state.phase,
        elapsed_s=flown.elapsed_s - flown.plan.lead_s,
        frequency_hz=flown.frequency_hz,
        peaks=flown.peaks,
        use=use(flown.limits, flown.peaks, flown.snapshot.link_age_s),
        snapshot=flown.snapshot,
        ending=flown.state.ending,
        reason=flown.state.reason,
    )


def _verdict(session: Connection, flown: Excitation, rate_hz: float | None, interruption: str) -> Verdict:
    plan, start = flown.plan, flown.log_start_s
    health = session.log_health()
    window = session.samples(flown.elapsed_s + 5.0)
    first = math.inf if start is None else start + plan.lead_s
    if health is not None and health.on_card:
        came = window.t.size if start is None else int((window.t >= start).sum())
        if not interruption and flown.unanswered_settings:
            names = ", ".join(flown.unanswered_settings)
            interruption = f"whether it was flown as planned is not known: the vehicle no longer told its {names}"
        return judge_by_telemetry(flown.limits, flown.peaks, came, flown.elapsed_s, interruption=interruption or None)
    samples = cut(window, first, first + plan.maneuver.duration_s)
    return judge(plan, flown.limits, flown.peaks, samples, rate_hz, interruption=interruption or None, start_s=first)


def locked(
    run: CardRun, flown: Sequence[RunResult], limits: Limits, kept: Mapping[int, Peaks] = MappingProxyType({})
) -> str:
    """Why a build-up goes no further: the step before was not clean, or the next would leave the envelope; empty where
    it does. `kept` has by their numbers the runs that were flown before this flight was resumed."""
    if run.locked_by is None:
        return ""
    below = next((one for one in reversed(flown) if one.run.number == run.locked_by), None)
    if below is not None and not below.clean:
        why = "; ".join(below.verdict.reasons) if below.verdict is not None else below.reason
        return f"{run.label} stays locked: {below.run.label} was not clean ({why})"
    peaks = kept.get(run.locked_by) if below is None else below.peaks
    if peaks is None or peaks.rate is None:
        return f"{run.label} stays locked: how far the step before took the vehicle is not known"
    expected = use(limits, peaks).largest * run.unlocks_at
    if expected > 100:
        return f"{run.label} stays locked: from the step before it would reach {expected:.0f} % of the limits"
    return ""


def contradiction(flown: Excitation) -> str:
    """What heartbeats that contradict each other may mean; empty where they do not."""
    count = flown.state.contradictions
    if not count:
        return ""
    return f"heartbeats contradicted each other {count} time(s): two vehicles with id {flown.snapshot.system}?"
