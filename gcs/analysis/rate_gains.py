"""Gains for an ArduPilot's own rate loops from a fit: what was flown, whether it is understood, what is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs.analysis.clearance import GAINS, RATE_GAINS, Clearance, by_measurement, clearance
from gcs.analysis.comparison import flown
from gcs.analysis.standing import Standing
from gcs.errors import TippathError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.opening import open_log
from gcs.logs.runs import systemid
from gcs.logs.runs.rate_loop import BEGINS_AFTER_S, FIELDS, LEAST_S, Repeated, repeats
from gcs.vehicle.rate_loops import AXES, RateLoops, gyro_filter_hz, name_of, rate_loops
from sysid.control.bounds import SAMPLES, SEED, drawn, uncertainty
from sysid.control.command_noise import CommandNoise, RateDisturbance, rate_noise, servo_speed
from sysid.control.judgement import Limits, OnModel
from sysid.control.rate_gains import MOST, RateGains, faster
from sysid.control.sampled import NotSampledError, RateController
from sysid.data.record import CYCLIC, RATES, Record
from sysid.fit.result import Fit, finite
from sysid.model.structure import Model
from sysid.response.flown import NoResponseError, flown_responses

UNDERSTOOD_PERCENT, LACKING_PERCENT = 1.0, 20.0
"""Of the vehicle's own commands that its loops, by its parameters, may leave; the second where the log lacks loops: one
of every fourth leaves 2 %, one with a hundred gaps 8 %."""
STEADY_HZ = 1.0
"""Up to here a helicopter turns as fast as its command says."""


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
    flown: Clearance
    new: Clearance
    """Each on every model that is left open, the new set as it is written."""

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """Parameter -> value that was flown, new value (rounded as it is written)."""
        pairs = zip(AXES, self.gains.flown.loops, self.gains.new.loops, strict=True)
        return {
            name_of(axis, word): (getattr(old, field), getattr(new, field))
            for axis, old, new in pairs
            for word, field in GAINS.items()
            if getattr(old, field) or getattr(new, field)
        }

    def to_json(self, folder: Path) -> dict[str, Any]:
        """The `tippath.rate_gains/1` document, for a folder."""
        judged = self.new.to_json(folder)
        gyro_hz = self.gains.flown.gyro_corner_hz
        roll, pitch = (one.to_json() for one in self.gains.flown.loops)
        judged["judged_on"]["loops"] = {
            "roll": roll,
            "pitch": pitch,
            "loop_hz": self.loops.loop_hz,
            "gyro_filter_hz": gyro_hz,
        }
        both = {"flown": self.flown.judgement, "new": self.new.judgement}
        return {
            "format": RATE_GAINS,
            "parameters": {name: {"flown": old, "new": new} for name, (old, new) in self.changes.items()},
            **{name: _loop_json(one.models[0]) for name, one in both.items()},
            "asked": {**self.gains.asked.to_json(), "most_times_flown": MOST},
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
            "gyro_filter_hz": gyro_hz,
            "in_the_vehicle": list(self.loops.in_the_vehicle),
            **judged,
            "judged_flown": self.flown.judgement.to_json(),
            **{
                name: one.measured.to_json()
                for name, one in (("margins_measured", both["new"]), ("margins_measured_flown", both["flown"]))
                if one.measured is not None
            },
            "command_noise": judged["judged"]["noise"],
        }


def ardupilot_gains(
    fit: Fit, standing: Standing, limits: Limits | None = None, *, measured: bool = False, samples: int = SAMPLES
) -> ArdupilotGains:
    """From the fit, what its diagnosis leaves open, and the logs that it was made from.

    `measured`: with margins by the runs' own responses. Raises TippathError where what acts on board is not known or
    not modelled, or the loops do not repeat what was flown; DesignError and NotSampledError as `faster` does.
    """
    _require_both_axes(fit)
    records, _ = flown(fit)
    parameters, repeated = _flown_with([Path(one.path) for one in fit.records if one.path])
    loops = _understood(parameters, repeated)
    law = RateController(
        (loops.roll, loops.pitch), 1 / loops.loop_hz, gyro_filter_hz(parameters, records[0].rate_source)
    )
    standing = _that_loops_can_hold(standing, law)
    ff = _feed_forward(records, fit.band_hz, loops)
    draws = drawn(fit.model, uncertainty(fit), np.random.default_rng(SEED), samples)
    models = [fit.model, *(model for _, model in standing.models)]
    disturbed = rate_noise(records, law.vehicle(fit.model))

    def better(told: Mapping[int, float]) -> RateGains:
        found = faster(law, models, limits=limits, feed_forward=told, draws=draws, noise=disturbed)
        return replace(found, new=_as_written(found.new))

    gains = better({list(AXES).index(axis): 1 / one.rate_per_command for axis, one in ff.items()})
    if ff and _overshoots_more(gains, fit, limits or Limits()):
        gains = better({})
        ff = {axis: replace(one, taken=False) for axis, one in ff.items()}

    responses = flown_responses(records, fit.band_hz, CYCLIC).responses if measured else None

    def cleared(one: RateController) -> Clearance:
        seen = (
            by_measurement(one, fit.model, responses) if responses is not None and one.held(fit.model).stable else None
        )
        return clearance(
            one, fit, standing, limits, measured=seen, noise=_moved(disturbed, one, law, models), samples=samples
        )

    return ArdupilotGains(
        loops=loops,
        gains=gains,
        repeated=repeated,
        feed_forward=ff,
        flown=cleared(law),
        new=cleared(gains.new),
    )


def _moved(
    disturbed: RateDisturbance | None, one: RateController, flown: RateController, models: Sequence[Model]
) -> CommandNoise | None:
    """What disturbances make of the commands, where both sets hold the fit."""
    if disturbed is None or not (one.held(models[0]).stable and flown.held(models[0]).stable):
        return None
    own, theirs = (disturbed.commands(law, law.vehicle(models[0])) for law in (one, flown))
    return CommandNoise(own=own, flown=theirs, servo_speed=servo_speed(models))


def _require_both_axes(fit: Fit) -> None:
    structure = fit.model.structure
    if not (set(RATES) <= set(structure.outputs) and set(CYCLIC) <= set(structure.commands)):
        raise TippathError(
            f"{structure.title} has not both roll and pitch, and their loops are judged together: fit sweeps of both, "
            "such as --model multirotor or tpp"
        )


def _understood(parameters: Mapping[str, float], repeated: Sequence[Repeated]) -> RateLoops:
    """The loops of these parameters, that repeat what was flown."""
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
    return loops


def _that_loops_can_hold(standing: Standing, law: RateController) -> Standing:
    """Without models that no loop of this kind is computed with; these are named."""
    models, lost = [], []
    for role, model in standing.models:
        try:
            law.vehicle(model)
        except NotSampledError:
            lost.append(model.structure.title)
        else:
            models.append((role, model))
    return replace(standing, models=tuple(models), not_modelled=(*standing.not_modelled, *lost))


def _as_written(law: RateController) -> RateController:
    """With gains rounded as the parameter file has them."""
    roll, pitch = (
        replace(loop, **dict[str, Any]((field, float(f"{getattr(loop, field):.4g}")) for field in GAINS.values()))
        for loop in law.loops
    )
    return replace(law, loops=(roll, pitch))


def _overshoots_more(gains: RateGains, fit: Fit, limits: Limits) -> bool:
    old, new = (one.answers(fit.model) for one in (gains.flown, gains.new))
    return any(now.overshoot > max(limits.overshoot, before.overshoot) for before, now in zip(old, new, strict=True))


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


def _loop_json(on: OnModel) -> dict[str, Any]:
    """Of the fit."""
    found = on.to_json()
    axes: dict[str, Any] = {
        one.axis: {
            "rise_ms": None if one.rise_s is None else 1000 * one.rise_s,
            "overshoot": one.overshoot,
            "coupling": one.coupling,
        }
        for one in on.answers or ()
    }
    for one in on.robustness.handling if on.robustness else ():
        axes[one.axis]["rejection_hz"] = one.rejection_hz
    return {"held": found["held"], "margins": found["margins"], "peak_db": on.peak_db, **axes}


def parameter_file(changes: Mapping[str, tuple[float, float]]) -> str:
    """As ground stations load it: a name and its new value a line."""
    return "".join(f"{name},{new:g}\n" for name, (_, new) in changes.items())
