"""The diagnosis of a strange flight, by one who knows its log alone; the only place here that knows the package."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from strangers.flights import Stranger
from sysid.data.airframe import Airframe
from sysid.data.band import USUAL, swept_band
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import Record
from sysid.diagnose.clocks import clocks
from sysid.diagnose.could_hide import could_hide
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import instrumental_step
from sysid.diagnose.matters import judged, may_not_matter, remainder
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.identify import identify, on_runs
from sysid.fit.result import Fit
from sysid.model.effect import tied
from sysid.model.structure import Structure

AXES = ("roll", "pitch")


def records(stranger: Stranger) -> list[Record]:
    """The card's runs, in order."""
    plan = stranger.plan
    return [
        Record(
            f"#{number}",
            dict(run),
            maneuver=maneuver.kind,
            axis=AXES[maneuver.axis],
            swept_band_hz=plan.vehicle.band_hz if maneuver.kind == "chirp" else None,
            chirp_noise=plan.weather.chirp_noise if maneuver.kind == "chirp" else None,
            loop_dt_s=1 / plan.loop_hz if plan.loop_told else None,
            airframe=None if plan.vehicle.flaps else Airframe.MULTIROTOR,
        )
        for number, (run, maneuver) in enumerate(zip(stranger.runs, plan.card, strict=True), 1)
    ]


@dataclass(frozen=True, slots=True)
class Answer:
    """What is said of a flight."""

    first: Diagnosis
    second: Diagnosis | None
    """With the answer added, as `tippath add` fits it, where two are hidden."""
    clocks: str | None
    """What is said of the time of the commands, where it explains what is left: `CommandsThinned`, `CommandsLate`."""
    seconds: float
    """Of computing, of the first."""
    whole: Diagnosis | None
    """The first before it was asked what matters, where that changed it."""


class _Question(NamedTuple):
    """A flight's runs, as they are asked."""

    base: str
    runs: list[Record]
    fitted: list[Record]
    judging: list[Record]
    band_hz: tuple[float, float]

    @classmethod
    def of(cls, stranger: Stranger) -> _Question:
        runs = records(stranger)
        fitted, judging = runs[: stranger.plan.fitted], runs[stranger.plan.fitted :]
        base = "tpp" if stranger.plan.vehicle.flaps else "cd"
        return cls(base, runs, fitted, judging, (swept_band(fitted) or USUAL).hz)


def fit(stranger: Stranger) -> Fit:
    """The base as `tippath fit` has it."""
    base, runs, fitted, judging, band_hz = _Question.of(stranger)
    return identify(on_runs(base, (), runs, fitted), fitted, judging, band_hz)


def ask(stranger: Stranger) -> Answer:
    """What is said of a strange flight, by its log and card."""
    base, runs, fitted, judging, band_hz = _Question.of(stranger)
    begin = time.process_time()
    whole = diagnose(on_runs(base, (), runs, fitted), fitted, judging, band_hz)
    found = weighed(whole)
    early = clocks(found)
    taken = time.process_time() - begin
    second = None
    if len(stranger.hidden.names) == 2 and found.effect is not None and _is_added(found):
        second = asked_with((found.effect,), on_runs(base, (), runs, fitted), fitted, judging, band_hz)
    changed = whole if whole.verdict != found.verdict else None
    return Answer(found, second, None if early is None else type(early).__name__, taken, changed)


def fitted_runs(stranger: Stranger) -> list[Record]:
    """Those of its runs that are fitted, as records."""
    return records(stranger)[: stranger.plan.fitted]


def ask_runs(runs: Sequence[Record], chains: bool = False, base: str = "tpp") -> Diagnosis:
    """What is said of runs, all of them fitted and none to judge, by the band that they sweep."""
    swept = swept_band(runs) or USUAL
    return diagnose(on_runs(base, (), runs, runs), runs, band_hz=swept.hz, chains=chains)


def asked_with(
    effects: Sequence[str],
    bare: Structure,
    fitted: Sequence[Record],
    judging: Sequence[Record],
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
) -> Diagnosis:
    """What is said with these effects added, as `tippath add` fits them, and asked from there."""
    added = identify(bare, fitted, judging, band_hz, effects=effects)
    return diagnose(added.model.structure, fitted, judging, band_hz, begin=added.model)


def _is_added(found: Diagnosis) -> bool:
    """Whether the user adds the effect: one that is named, or stands in and is none in free flight alone. Whoever flies
    knows whether there is a tether."""
    return found.verdict == "missing" or (found.stands_in and bool(tied([str(found.effect)])))


def weighed(answer: Diagnosis) -> Diagnosis:
    """By what matters, as `tippath diagnose` says it."""
    if not may_not_matter(answer):
        return answer
    last, whitening = answer.parent, answer.whitening
    hiding = could_hide(last.asked, instrumental_step(last.asked, whitening), whitening, answer.division)
    return judged(answer, remainder(answer, hiding))
