"""Why a rate command moves the other axis, and a prefilter that keeps it from that.

Eq. 14 is right in the long run alone. On the way there the rotor couples, and LQR, which is asked for small rates and
small commands and not for uncoupled ones, lets it: of a roll doublet 41 % go to pitch on the paper's own model, without
any error of model or observer. Lag that the observer does not know of adds to that. A prefilter outside the loop mends
both, and takes nothing from the margins: F is what brings the rates nearest to models that do not couple, in least
squares over frequency and over every model given, each with its lag.

How fast these are: as the paper's prefilter lets them be, a step of the rate command jumping the commands as far; then
slower, each by itself, until no answer overshoots or couples more than `AIMED` of what is asked. Where none is slow
enough, the least of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.control.judgement import Limits
from sysid.control.loop import commands_per_added, following
from sysid.control.prefilter import DynamicPrefilter, followed, model_answers
from sysid.control.regulator import UNCONTROLLED, DesignError, Gains, cyclic_powers
from sysid.control.stability import closed_loop, rates_per_command
from sysid.data.preprocess import ComplexArray
from sysid.model.structure import AnyArray, FloatArray, Model

SPEEDS = (1.0, 0.85, 0.7, 0.6, 0.5, 0.4, 0.3)
"""Of the models that are followed."""
AIMED = 0.6
"""Of what is asked: a vehicle couples more than its model, which does not know of play and gusts."""
DAMPING = 0.8
"""Theirs: 1.5 % of overshoot."""
LOW_HZ, HIGH_HZ, POINTS = 0.05, 20.0, 120
"""Where the rates are brought near to them."""


def decoupled(gains: Gains, models: Sequence[Model], limits: Limits | None = None) -> Gains:
    """The same gains with a dynamic prefilter for all of these models that they hold.

    Raises DesignError where they hold none, or where a cyclic command moves nothing.
    """
    limits = limits or Limits()
    held = [one for one in models if closed_loop(gains, one).stable]
    if not held:
        raise DesignError("the gains hold none of the models: there is no answer to make uncoupled")
    fastest = _fastest(gains)
    best = _nearest(gains, held, fastest)
    least = np.full(2, np.inf)
    for speed in SPEEDS:
        found = _nearest(gains, held, speed * fastest)
        excess = np.max([_excess(replace(gains, dynamic=found), one, limits) for one in held], axis=0)
        better = (excess < least) & (least > AIMED)
        best, least = _by_axis(better, found, best), np.where(better, excess, least)
        if np.all(least <= AIMED):
            break
    return replace(gains, dynamic=best)


def _fastest(gains: Gains) -> FloatArray:
    """(2,), rad/s: commands jump as far for a step on each axis as the steady prefilter's do."""
    power = cyclic_powers(gains.model)
    size = np.linalg.svd(power, compute_uv=False)
    if not size[-1] > UNCONTROLLED * size[0]:
        raise DesignError("the model's cyclic turns one axis alone: there is no answer to make uncoupled")
    per_acceleration = np.linalg.inv(power)
    return np.asarray(
        np.sqrt(np.linalg.norm(gains.prefilter, axis=0) / np.linalg.norm(per_acceleration, axis=0)), dtype=np.float64
    )


def _nearest(gains: Gains, models: Sequence[Model], frequency: FloatArray) -> DynamicPrefilter:
    """In least squares: rates are H (g + F z), and ought to be the models', late as each vehicle is."""
    s: ComplexArray = np.asarray(2j * np.pi * np.geomspace(LOW_HZ, HIGH_HZ, POINTS), dtype=complex)
    damping = np.full(2, DAMPING)
    z, answers = followed(frequency, damping, s), model_answers(frequency, damping, s)
    rows, wanted = [], []
    for model in models:
        H = rates_per_command(model, s, gains.commands) @ commands_per_added(gains, model, s)
        target = answers[:, :, None] * np.eye(2) * np.exp(-s * _late_s(gains, model, frequency))[:, None, None]
        # row i, column j of H F z: the sum over m, n of H_im F_mn z_nj
        rows.append(np.einsum("fim,fnj->fijmn", H, z).reshape(4 * s.size, -1))
        wanted.append((target - H @ gains.prefilter).ravel())
    X, y = np.concatenate(rows), np.concatenate(wanted)
    F = np.linalg.lstsq(np.concatenate([X.real, X.imag]), np.concatenate([y.real, y.imag]), rcond=None)[0]
    return DynamicPrefilter(frequency=frequency, damping=damping, F=F.reshape(len(gains.K), 4))


def _late_s(gains: Gains, model: Model, frequency: FloatArray) -> float:
    """How much later a vehicle answers commands than the model in its controller, well below what is followed."""
    s: ComplexArray = np.array([0.5j * float(np.min(frequency))])
    whole, own = (np.linalg.det(rates_per_command(one, s)[0]) for one in (model, gains.model))
    return max(0.0, float(-np.angle(whole / own) / (2 * s[0].imag)))


def _by_axis(first: AnyArray, one: DynamicPrefilter, other: DynamicPrefilter) -> DynamicPrefilter:
    """Of two the one or the other for each axis that is asked for a rate, (2,)."""
    return DynamicPrefilter(
        frequency=np.where(first, one.frequency, other.frequency),
        damping=np.where(first, one.damping, other.damping),
        F=np.where(np.tile(first, 2), one.F, other.F),
    )


def _excess(gains: Gains, model: Model, limits: Limits) -> tuple[float, float]:
    """Of a rate asked for on each axis the larger of overshoot and coupling, as shares of what is allowed."""
    answer = following(gains, model)
    roll, pitch = (
        max(axis.overshoot / limits.overshoot, axis.coupling / limits.coupling) for axis in (answer.roll, answer.pitch)
    )
    return roll, pitch
