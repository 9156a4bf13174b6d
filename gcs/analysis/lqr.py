"""The paper's controller on a fit, with what may be asked of it: another observer, prefilter, third command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gcs.analysis.comparison import flown
from sysid.control.decoupling import decoupled
from sysid.control.judgement import Limits
from sysid.control.observers import KALMAN, RateNoise, kalman_gain, rate_noise, white_noise, with_gain
from sysid.control.regulator import FLAPPING_COST, INPUT_COST, OBSERVER_POLES, Gains, design, lqr, require_held
from sysid.fit.result import Fit
from sysid.model.structure import Model

Observer = Sequence[float] | str
"""Poles in 1/s, or `KALMAN`."""


@dataclass(frozen=True, kw_only=True)
class AskedDesign:
    """What a design is asked for."""

    input_cost: float = INPUT_COST
    flapping_cost: float = FLAPPING_COST
    """Of tilting the tip-path plane, where a rate's is 1."""
    observer: Observer = OBSERVER_POLES
    dynamic: bool = False
    """Whether rates follow models of their own on the way."""
    elevator: bool = False


def noise_of(fit: Fit) -> RateNoise:
    """What the commands do not explain of the fit's own runs. Raises TippathError, DesignError."""
    records, _ = flown(fit)
    return rate_noise(fit.model, records)


def designed(
    fit: Fit,
    asked: AskedDesign,
    models: Sequence[Model],
    limits: Limits | None = None,
    noise: RateNoise | None = None,
) -> Gains:
    """Gains that hold the fit; a dynamic prefilter serves these models, too. Raises as `design` and `noise_of`."""
    gains = _with_observer(fit, asked, noise)
    return decoupled(gains, [fit.model, *models], limits) if asked.dynamic else gains


def at_costs(
    fit: Fit, asked: AskedDesign, models: Sequence[Model], limits: Limits | None, noise: RateNoise | None, cost: float
) -> Gains:
    """The same at another input cost, held or not."""
    gains = _observed(fit, replace(asked, input_cost=cost), noise)
    return decoupled(gains, [fit.model, *models], limits) if asked.dynamic and gains.loop.stable else gains


def _with_observer(fit: Fit, asked: AskedDesign, noise: RateNoise | None) -> Gains:
    if not isinstance(asked.observer, str):
        return design(
            fit.model, asked.input_cost, asked.observer, elevator=asked.elevator, flapping_cost=asked.flapping_cost
        )
    gains = _observed(fit, asked, noise)
    require_held(gains, fit.model)
    return gains


def _observed(fit: Fit, asked: AskedDesign, noise: RateNoise | None) -> Gains:
    poles = OBSERVER_POLES if isinstance(asked.observer, str) else asked.observer
    gains = lqr(fit.model, asked.input_cost, poles, elevator=asked.elevator, flapping_cost=asked.flapping_cost)
    if not isinstance(asked.observer, str):
        return gains
    known = noise_of(fit) if noise is None else noise
    return with_gain(gains, kalman_gain(gains.model, white_noise(gains.model, known)), fit.model)


def parse_observer(words: str | None) -> Observer:
    """`kalman`, or as many poles as the controller has states, in 1/s, with or without their minus.

    Raises ValueError.
    """
    if words is None:
        return OBSERVER_POLES
    if words.strip().lower() == KALMAN:
        return KALMAN
    poles = tuple(-abs(float(word)) for word in words.split(","))
    if len(poles) != len(OBSERVER_POLES) or not all(-1e4 <= pole < 0 for pole in poles):
        raise ValueError("four poles, each below 0 and above -10000")
    if max(poles.count(pole) for pole in poles) > 2:
        raise ValueError("each pole at most twice, for two rates are measured")
    return poles
