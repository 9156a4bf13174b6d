"""A recorded flight as it would be watched again: its samples over the whole log, and its runs with their verdicts.

The samples are those that a fit is made of, of the boot that holds most; the runs are where `tippath ingest` finds
them, with the names and verdicts of flight.json where there is one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.cards.envelope import Limits, Peaks, Use, use
from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder, flight_of
from gcs.flight.live import LiveWindow
from gcs.logs import Run, ingest
from gcs.logs.formats.tables import Log
from gcs.logs.opening import open_log
from gcs.logs.profile.mapping import apply

FloatArray = NDArray[np.float64]
ENTERED_WITHIN_S = 3.0
"""A run of flight.json, which counts from the mode's entry, is the one that is excited at most so much later."""
FREQUENCY = "SIDD.F"
"""Where ArduPilot's logs tell the sweep's frequency."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PastRun:
    """One run of a recorded flight."""

    label: str
    numbers: str
    kind: str
    start_s: float
    """Of its excitation, on the log's clock,"""
    stop_s: float
    """and its end."""
    axis: str = ""
    band_hz: tuple[float, float] | None = None
    """What a chirp swept; None where it is not told."""
    keep: bool
    why: tuple[str, ...]
    """The verdict's reasons or figures."""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class PastFlight:
    """All of it."""

    name: str
    samples: LiveWindow
    """Of the whole log; `t` is the log's clock, s."""
    omega: FloatArray | None
    """rad/s, beside the samples; None where the log has none."""
    frequency: tuple[FloatArray, FloatArray] | None
    """Times and Hz of the sweeps; None where the log does not tell."""
    runs: tuple[PastRun, ...]
    card: str = ""
    limits: Limits = field(default_factory=Limits)

    @property
    def start_s(self) -> float:
        return float(self.samples.t[0])

    @property
    def stop_s(self) -> float:
        return float(self.samples.t[-1])

    def window(self, at_s: float, last_s: float) -> LiveWindow:
        """The samples of the last seconds before a moment, as they were seen then."""
        s = self.samples
        first, last = np.searchsorted(s.t, [at_s - last_s, at_s], side="right")
        part = slice(int(first), int(last))
        return LiveWindow(
            t=s.t[part],
            p=s.p[part],
            q=s.q[part],
            delta_x=s.delta_x[part],
            delta_y=s.delta_y[part],
            excitation_x=s.excitation_x[part],
            excitation_y=s.excitation_y[part],
            received=int(last),
            log_s=at_s,
        )

    def flying(self, at_s: float) -> int | None:
        """The place of the run that is excited at a moment, from 0."""
        return next((i for i, run in enumerate(self.runs) if run.start_s <= at_s < run.stop_s), None)

    def used(self, run: PastRun, at_s: float) -> Use:
        """How much of the limits the run had used by then; a log tells no attitude that could be compared."""
        seen = self.window(min(at_s, run.stop_s), min(at_s, run.stop_s) - run.start_s)
        return use(self.limits, Peaks().with_samples(seen.p, seen.q, seen.delta_x, seen.delta_y))

    def hertz(self, at_s: float) -> float | None:
        """The sweep's frequency at a moment."""
        if self.frequency is None:
            return None
        times, values = self.frequency
        place = int(np.searchsorted(times, at_s, side="right")) - 1
        return float(values[place]) if place >= 0 and at_s - times[place] < 0.5 else None

    def rpm(self, at_s: float) -> float | None:
        """Of the rotor."""
        place = int(np.searchsorted(self.samples.t, at_s, side="right")) - 1
        if self.omega is None or place < 0 or not math.isfinite(self.omega[place]):
            return None
        return float(self.omega[place]) * 30.0 / math.pi


def past_flight(path: Path) -> PastFlight:
    """From a flight folder or a log of any kind. Raises TippathError where there is nothing to be watched."""
    log_path = _log_of(path)
    opened = open_log(log_path, None)
    log, profile = max(opened.parts, key=lambda part: _samples(part[0], part[1].channels["p"].sources))
    channels = apply(profile, log).channels
    t = channels["t"]
    unknown = np.full(t.size, np.nan)
    samples = LiveWindow(
        t=t,
        p=channels["p"],
        q=channels["q"],
        delta_x=channels["delta_x"],
        delta_y=channels["delta_y"],
        excitation_x=channels.get("excitation_x", unknown),
        excitation_y=channels.get("excitation_y", unknown),
        received=t.size,
    )
    about = _about(path)
    runs = [run for run in ingest([log_path]).runs if t[0] <= run.start_s <= t[-1] and run.maneuver != "none"]
    told = [one for one in about.get("runs", ()) if isinstance(one, dict)]
    return PastFlight(
        name=path.name,
        samples=samples,
        omega=channels.get("omega"),
        frequency=_frequency(log),
        runs=tuple(_run(run, told) for run in sorted(runs, key=lambda run: run.start_s)),
        card=str(about.get("card", "")),
        limits=_limits(about.get("limits")),
    )


def _log_of(path: Path) -> Path:
    if not path.exists():
        raise TippathError(f"{path}: no such folder or log")
    if not path.is_dir():
        return path
    logs = [*FlightFolder(path).logs(), *sorted(path.glob("fetched-*.BIN"))]
    if not logs:
        raise TippathError(f"{path}: no log to replay lies in it; name the log itself")
    return max(logs, key=lambda log: log.stat().st_size)


def _about(path: Path) -> dict[str, Any]:
    try:
        return flight_of(path).read()
    except TippathError:
        return {}


def _samples(log: Log, sources: tuple[str, ...]) -> int:
    """Of a boot, by its rates."""
    return max((log.series(source).t.size for source in sources if log.has(source)), default=0)


def _frequency(log: Log) -> tuple[FloatArray, FloatArray] | None:
    if not log.has(FREQUENCY):
        return None
    series = log.series(FREQUENCY)
    return series.t, series.values


def _run(run: Run, told: list[dict[str, Any]]) -> PastRun:
    """A run by what flight.json says of it, or else by what its data say."""
    start, stop = run.start_s, run.start_s + run.duration_s
    label = f"{run.axis} {run.maneuver}" if run.axis else run.maneuver
    for one in told:
        entered = one.get("log_start_s")
        if isinstance(entered, int | float) and 0.0 <= start - entered <= ENTERED_WITHIN_S:
            keep, why = _verdict(one)
            maneuver = one.get("maneuver")
            return PastRun(
                label=str(one.get("label", label)),
                numbers=_numbers(maneuver if isinstance(maneuver, dict) else {}),
                kind=run.maneuver,
                axis=run.axis or "",
                band_hz=run.swept_band_hz,
                start_s=start,
                stop_s=stop,
                keep=keep,
                why=why,
            )
    why = run.reasons if not run.usable else (f"{run.rate_hz:.0f} Hz", f"gaps {len(run.gaps)}")
    return PastRun(
        label=label,
        numbers=f"{run.duration_s:.0f} s",
        kind=run.maneuver,
        axis=run.axis or "",
        band_hz=run.swept_band_hz,
        start_s=start,
        stop_s=stop,
        keep=run.usable,
        why=why,
    )


def _verdict(one: Mapping[str, Any]) -> tuple[bool, tuple[str, ...]]:
    """Whether a run of flight.json was kept, and why."""
    verdict = one.get("verdict")
    if not isinstance(verdict, dict):
        return False, (str(one.get("reason", "")),)
    figures = []
    coherent = verdict.get("coherent_hz")
    if isinstance(coherent, list) and len(coherent) == 2 and all(isinstance(x, int | float) for x in coherent):
        figures.append(f"coherence {coherent[0]:.1f}-{coherent[1]:.1f} Hz")
    if isinstance(verdict.get("gaps"), int):
        figures.append(f"gaps {verdict['gaps']}")
    used = verdict.get("percent_of_limits")
    known = [x for x in (used.values() if isinstance(used, dict) else ()) if isinstance(x, int | float)]
    figures += [f"{max(known):.0f} % of the limits"] if known else []
    if verdict.get("keep"):
        return True, tuple(figures)
    reasons = [str(reason) for reason in verdict.get("reasons", ())] or [str(one.get("reason", ""))]
    return False, ("; ".join(filter(None, reasons)), *figures)


def _numbers(maneuver: Mapping[str, Any]) -> str:
    """`0.5-10 Hz  15 s  A 0.10`, as far as they are told."""
    told = {key: value for key, value in maneuver.items() if isinstance(value, int | float)}
    parts = []
    if maneuver.get("kind") == "chirp" and {"f_start_hz", "f_stop_hz"} <= set(told):
        parts.append(f"{told['f_start_hz']:g}-{told['f_stop_hz']:g} Hz")
    parts += [f"{told['duration_s']:g} s"] if "duration_s" in told else []
    parts += [f"A {told['amplitude']:.2f}"] if told.get("amplitude") else []
    return "  ".join(parts)


def _limits(told: object) -> Limits:
    """As flight.json has them; what it does not tell is the default."""
    known = {key: float(x) for key, x in told.items() if isinstance(x, int | float)} if isinstance(told, dict) else {}
    default = Limits()
    return Limits(
        known.get("rate_rad_s", default.rate),
        math.radians(known.get("attitude_deg", math.degrees(default.attitude))),
        known.get("command", default.command),
    )
