"""A card being flown, in lines on standard error: what is ready, how it goes, what it was worth."""

from __future__ import annotations

import math
import sys
import time
from typing import TextIO

from gcs.cards.envelope import Limits
from gcs.cli.terminal import BELL, REDRAW, control
from gcs.flight.flown_card import Briefing
from gcs.flight.probe import result_words
from gcs.flight.rules import LOST_PATIENCE_S
from gcs.flight.run import Note, Probed, Progress, RunProgress, RunReady, RunResult
from gcs.flight.run_state import Ending, Phase
from gcs.link.clock import LOST_AFTER_S
from gcs.logs.words import printable
from gcs.vehicle.snapshot import VehicleSnapshot

EVERY_S = 5.0
"""Between two lines of progress where the output is no terminal."""
REDRAW_S = 0.2


class ProgressLines:
    """Prints each `Progress`; on a terminal the line of a run under way is drawn over itself."""

    def __init__(self, limits: Limits, stream: TextIO | None = None, *, bell: bool = True) -> None:
        self._limits = limits
        self._stream = stream or sys.stderr
        self._terminal = self._stream.isatty()
        self._bell = bell and self._terminal
        self._next = 0.0
        self._open = False
        self._link_loss = "the vehicle's own answer to a lost link is not known"
        self._lost = False
        self._told_end = False

    def __call__(self, progress: Progress) -> None:
        match progress:
            case Note():
                self._line(f" {printable(progress.words)}")
            case Probed():
                result = progress.result
                mark = "✗" if result.wrong else "✓" if result.ok else "?"
                for words in result_words(result):
                    self._line(f" {mark} probe   {printable(words)}")
            case RunReady():
                maneuver = progress.run.maneuver
                self._line(f" ready   {progress.run.label}   {maneuver.numbers}   {progress.plan.words}")
                self._next = time.monotonic() + EVERY_S
            case RunProgress():
                self._running(progress)
            case RunResult():
                self._line(f" {result_line(progress)}", bell=self._bell)

    def briefing(self, briefing: Briefing) -> None:
        """What is about to be flown, and what was found in order."""
        self._line(f" card {briefing.card.name}: {len(briefing.plans)} runs, about {_duration(briefing.duration_s)}")
        for check in briefing.checks:
            self._line(f"   {'✓' if check.ok else '✗'} {check.name}: {printable(check.words)}")
        self._line(f"   {briefing.link_loss.words}")
        self._link_loss = f"the vehicle's own answer to a lost link: {briefing.link_loss.answer}"
        flown = sorted({plan.words for run, plan in briefing.plans if run.maneuver.kind == "chirp"})
        if flown:
            self._line(f"   chirps: {'; '.join(flown)}")

    def _running(self, progress: RunProgress) -> None:
        now = time.monotonic()
        peaks, snapshot = progress.peaks, progress.snapshot
        if snapshot.lost and not self._lost:
            self._line(" ✗ LINK LOST: no abort reaches the vehicle. PILOT: take over, any other mode ends the sweep")
            self._line(f"   {self._link_loss}")
            self._line(
                f"   waiting up to {LOST_PATIENCE_S:.0f} s for the vehicle, to end the sweep if it is heard again; "
                "Ctrl-C ends the wait"
            )
            self._next = now + (REDRAW_S if self._terminal else EVERY_S)
        self._lost = snapshot.lost
        ended = progress.ending is not None and progress.ending is not Ending.FINISHED and not snapshot.lost
        if ended and progress.ending is not None and not self._told_end:
            self._line(f" ✗ {progress.ending.value}: {printable(progress.reason)}", bell=self._bell)
        self._told_end = ended
        if now < self._next:
            return
        self._next = now + (REDRAW_S if self._terminal else EVERY_S)
        if snapshot.lost:
            left_s = max(0.0, LOST_PATIENCE_S + LOST_AFTER_S - snapshot.link_age_s)
            text = f" ✗ link lost for {snapshot.link_age_s:.0f} s, waiting {left_s:.0f} s more; pilot: take over"
        elif progress.phase is Phase.RETURNING:
            text = f" … back to the pilot's mode (now {printable(snapshot.mode_name)})"
        else:
            hertz = f"  {progress.frequency_hz:.1f} Hz" if progress.frequency_hz else ""
            duration_s = progress.plan.maneuver.duration_s
            attitude = "-" if peaks.attitude is None else f"{math.degrees(peaks.attitude):.1f}°"
            text = (
                f" ▶ {min(max(0.0, progress.elapsed_s), duration_s):4.1f} s of {duration_s:g}{hertz}"
                f"   p {peaks.p or 0:.2f}  q {peaks.q or 0:.2f} rad/s"
                f"   attitude {attitude} of {math.degrees(self._limits.attitude):.0f}°"
                f"   {_arriving(snapshot)}"
                f"   lag {'?' if snapshot.lag_s is None else f'{snapshot.lag_s:.2f} s'}"
            )
        if self._terminal:
            control(self._stream, REDRAW)
            self._stream.write(text)
            self._open = True
        else:
            self._stream.write(text + "\n")
        self._stream.flush()

    def _line(self, text: str, *, bell: bool = False) -> None:
        if self._open:
            control(self._stream, REDRAW)
            self._open = False
        self._stream.write(text)
        if bell:
            control(self._stream, BELL)
        self._stream.write("\n")
        self._stream.flush()


def _arriving(snapshot: VehicleSnapshot) -> str:
    if snapshot.log_on_card:
        return "log on the card"
    return f"blocks {snapshot.blocks_received:,} open {snapshot.blocks_open}"


def result_line(result: RunResult) -> str:
    """One run in one line: `✓ roll chirp 1/2   keep   coherence 0.5-9.6 Hz   gaps 0`."""
    mark = "✓" if result.clean else "✗"
    if result.verdict is None:
        return f"{mark} {result.run.label}   {result.ending.value}: {printable(result.reason)}"
    words = printable(result.verdict.words)
    if result.ending is not Ending.FINISHED:
        return f"{mark} {result.run.label}   {words}   mode now {printable(result.mode_after)}"
    return f"{mark} {result.run.label}   {words}"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.1f} minutes"
