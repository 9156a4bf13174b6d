"""Gains for an ArduPilot's own rate loops from a fit: what was flown, whether it is understood, what is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs.analysis.comparison import flown
from gcs.errors import TippathError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.opening import open_log
from gcs.logs.runs import systemid
from gcs.logs.runs.rate_loop import BEGINS_AFTER_S, FIELDS, LEAST_S, Repeated, repeats
from gcs.vehicle.rate_loops import AXES, RateLoops, gyro_filter_hz, name_of, rate_loops
from sysid.control.rate_gains import MOST, Asked, RateGains, faster
from sysid.control.sampled import SampledLoop, rate_step
from sysid.data.record import CYCLIC, RATES, FloatArray, Record
from sysid.fit.result import Fit, finite
from sysid.response.flown import NoResponseError, flown_responses

FORMAT = "tippath.rate_gains/1"
UNDERSTOOD_PERCENT, LACKING_PERCENT = 1.0, 20.0
"""Of the vehicle's own commands that its loops, by its parameters, may leave; the second where the log lacks loops: one
of every fourth leaves 2 %, one with a hundred gaps 8 %."""
STEADY_HZ = 1.0
"""Up to here a helicopter turns as fast as its command says."""
OVERSHOOT = 0.25
"""Of a step, or that of the gains that flew where it is more: a feed-forward that makes it more is left as it was."""
GAINS = {"P": "p", "I": "i", "D": "d", "FF": "ff"}


@dataclass(frozen=True, kw_only=True)
class Answer:
    """To a step of the rate's target."""

    rise_ms: float | None
    """Until nine tenths of it; None where it gets there in no two seconds."""
    overshoot: float
    coupling: float
    """Largest rate of the other axis; both of what was asked."""


Pair = tuple[Answer, Answer]
"""Of roll and pitch."""


@dataclass(frozen=True, kw_only=True)
class FeedForward:
    """One over how fast the vehicle turns for a command."""

    rate_per_command: float
    """rad/s per full command, measured."""
    error: float
    """Its standard error."""
    taken: bool = True
    """Whether the new set has it, or the flown one because the rates would overshoot."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ArdupilotGains:
    """What was flown and what is better, with what it rests on."""

    loops: RateLoops
    gains: RateGains
    repeated: tuple[Repeated, ...]
    """How well the loops repeat the vehicle's own commands, of each run and axis."""
    feed_forward: Mapping[str, FeedForward]
    """By axis; empty where none was flown, or none is measured."""
    gyro_hz: float
    """Of the filter between the model's rates and the loops; 0 where the model has it."""
    answers: tuple[Pair, Pair]
    """Flown, then new."""

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """Parameter -> value that was flown, new value (rounded as it is written)."""
        pairs = zip(AXES, self.gains.flown, self.gains.new, strict=True)
        return {
            name_of(axis, word): (getattr(old, field), float(f"{getattr(new, field):.4g}"))
            for axis, old, new in pairs
            for word, field in GAINS.items()
            if getattr(old, field) or getattr(new, field)
        }

    def to_json(self) -> dict[str, Any]:
        """The `tippath.rate_gains/1` document."""
        flown_answers, new_answers = self.answers
        return {
            "format": FORMAT,
            "parameters": {name: {"flown": old, "new": new} for name, (old, new) in self.changes.items()},
            "flown": _loop_json(self.gains.flown_loop, flown_answers),
            "new": _loop_json(self.gains.new_loop, new_answers),
            "asked": {
                "gain_db": self.gains.asked.gain_db,
                "phase_deg": self.gains.asked.phase_deg,
                "delay_ms": self.gains.asked.delay_ms,
                "peak_db": self.gains.asked.peak_db,
                "most_times_flown": MOST,
            },
            "feed_forward": {
                axis: {"rate_per_command": one.rate_per_command, "error": one.error, "taken": one.taken}
                for axis, one in self.feed_forward.items()
            },
            "repeated": [
                {
                    "axis": one.axis,
                    "start_s": one.start_s,
                    "stop_s": one.stop_s,
                    "residual_percent": finite(one.residual_percent),
                    "causes": list(one.causes),
                }
                for one in self.repeated
            ],
            "gyro_filter_hz": self.gyro_hz,
            "in_the_vehicle": list(self.loops.in_the_vehicle),
        }


def ardupilot_gains(fit: Fit, asked: Asked | None = None) -> ArdupilotGains:
    """From the fit, and the logs that it was made from.

    Raises TippathError where what acts on board is not known or not modelled, or the loops do not repeat what was
    flown; DesignError and NotSampledError as `faster` does.
    """
    structure = fit.model.structure
    if not (set(RATES) <= set(structure.outputs) and set(CYCLIC) <= set(structure.commands)):
        raise TippathError(
            f"{structure.title} has not both roll and pitch, and their loops are judged together: fit sweeps of both, "
            "such as --model multirotor or tpp"
        )
    records, _ = flown(fit)
    parameters, repeated = _flown_with([Path(one.path) for one in fit.records if one.path])
    loops = rate_loops(parameters)
    if loops.not_modelled:
        raise TippathError(
            f"no gains are designed while something acts that no model has: {'; '.join(loops.not_modelled)}"
        )
    for one in repeated:
        if not one.residual_percent <= (LACKING_PERCENT if one.lacking else UNDERSTOOD_PERCENT):
            raise TippathError(
                f"the loops that the parameters tell of do not repeat the vehicle's own {one.axis} command: "
                f"{one.residual_percent:.1f} % are left ({'; '.join(one.causes)}); no gains are designed on them"
            )
    gyro_hz = gyro_filter_hz(parameters, records[0].rate_source)
    ff = _feed_forward(records, fit.band_hz, loops)
    dt = 1 / loops.loop_hz
    told = {list(AXES).index(axis): 1 / one.rate_per_command for axis, one in ff.items()}

    def judged(feed_forward: Mapping[int, float]) -> tuple[RateGains, Pair, Pair]:
        found = faster(
            (loops.roll, loops.pitch),
            dt,
            fit.model,
            gyro_corner_hz=gyro_hz,
            feed_forward=feed_forward,
            asked=asked,
        )
        old, new = (_answers(rate_step(each, dt, fit.model, gyro_hz), dt) for each in (found.flown, found.new))
        return found, old, new

    gains, old, new = judged(told)
    if told and any(now.overshoot > max(OVERSHOOT, before.overshoot) for before, now in zip(old, new, strict=True)):
        gains, old, new = judged({})
        ff = {axis: replace(one, taken=False) for axis, one in ff.items()}
    return ArdupilotGains(
        loops=loops, gains=gains, repeated=repeated, feed_forward=ff, gyro_hz=gyro_hz, answers=(old, new)
    )


def _flown_with(paths: Sequence[Path]) -> tuple[dict[str, float], tuple[Repeated, ...]]:
    """The parameters that all these logs were flown with, and how well their loops repeat what was flown."""
    told: dict[str, float] = {}
    repeated: list[Repeated] = []
    for path in dict.fromkeys(paths):
        logs = [log for log, _ in open_log(path, None).parts if isinstance(log, DataFlashTables)]
        for log in logs:
            for span in systemid.find(log):
                if span.reasons or span.stop_s - span.start_s < BEGINS_AFTER_S + 2 * LEAST_S:
                    continue
                here = log.parameters(span.start_s)
                _refuse_changed(told or here, here, path)
                told = here
                repeated += [
                    repeats(log, axis, span.start_s, span.stop_s, injected=span.excites_command and span.axis == axis)
                    for axis in FIELDS
                ]
    if not told:
        raise TippathError(
            "no gains that were flown are known: the fit's runs are no sweeps of ArduPilot's own log (.BIN), which has "
            "its parameters; fit such a log"
        )
    return told, tuple(repeated)


def _refuse_changed(before: Mapping[str, float], now: Mapping[str, float], path: Path) -> None:
    changed = [
        name_of(axis, word)
        for axis in AXES
        for word in GAINS
        if before.get(name_of(axis, word)) != now.get(name_of(axis, word))
    ]
    if changed:
        raise TippathError(
            f"{path.name}: other gains than in the runs before ({', '.join(changed)}): fit the runs of one set of gains"
        )


def _feed_forward(records: Sequence[Record], band_hz: tuple[float, float], loops: RateLoops) -> dict[str, FeedForward]:
    """Of axes that were flown with one, where the runs measure it."""
    wanted = [axis for axis, loop in zip(AXES, (loops.roll, loops.pitch), strict=True) if loop.ff > 0]
    if not wanted:
        return {}
    try:
        responses = flown_responses(records, band_hz, CYCLIC).responses
    except NoResponseError:
        return {}
    low = responses.frequency_hz <= STEADY_HZ
    found = {}
    for axis in wanted:
        at = list(AXES).index(axis)
        H = responses.H[responses.outputs.index(RATES[at]), responses.commands.index(CYCLIC[at])][low]
        error = responses.error[responses.outputs.index(RATES[at]), responses.commands.index(CYCLIC[at])][low]
        known = np.isfinite(error) & (error < np.abs(H))
        if np.any(known):
            weight = 1 / error[known] ** 2
            size = float(np.sum(weight * np.abs(H[known])) / np.sum(weight))
            found[axis] = FeedForward(rate_per_command=size, error=float(np.max(error[known])))
    return found


def _answers(rates: FloatArray, dt: float) -> Pair:
    """Of `rate_step`."""
    each = []
    for axis in range(2):
        own = rates[axis, axis]
        there = np.flatnonzero(own >= 0.9)
        each.append(
            Answer(
                rise_ms=1000 * dt * float(there[0]) if there.size else None,
                overshoot=max(0.0, float(own.max()) - 1),
                coupling=float(np.abs(rates[axis, 1 - axis]).max()),
            )
        )
    return each[0], each[1]


def _loop_json(loop: SampledLoop, answers: Pair) -> dict[str, Any]:
    margins = loop.margins
    return {
        "held": loop.held,
        "margins": None
        if margins is None
        else {name: finite(getattr(margins, name)) for name in ("gain_db", "phase_deg", "delay_ms")},
        "peak_db": loop.peak_db,
        **{
            axis: {
                "rejection_hz": hz,
                "rise_ms": answer.rise_ms,
                "overshoot": answer.overshoot,
                "coupling": answer.coupling,
            }
            for axis, hz, answer in zip(AXES, loop.rejection_hz, answers, strict=True)
        },
    }


def parameter_file(changes: Mapping[str, tuple[float, float]]) -> str:
    """As ground stations load it: a name and its new value a line."""
    return "".join(f"{name},{new:g}\n" for name, (_, new) in changes.items())
