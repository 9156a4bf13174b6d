"""Fits moved on in the noise's own measure: least squares weighs gusts of the same power no less, and goes astray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.diagnose.evidence import (
    SHY,
    Candidate,
    White,
    as_loud,
    candidate,
    covariance,
    instrumental_step,
    power_left,
    residual_at,
    white_residual,
)
from sysid.fit.innovations import Innovations
from sysid.fit.output_error import output_error
from sysid.fit.whitening import Whitening
from sysid.model.acting import linear_dynamics
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model

MOST_MOVES_BY_NOISE = 8
PARTS = (1.0, 0.5, 0.25)
"""Of a step, tried one after the other."""
SURELY_BETTER = 4.0
"""Chi squared by which other values must foretell better than those of least squares to take their place."""
MISLED = 1.1
"""Times what one step in white rows leaves, that least squares leaves there, from which on one step is not enough: slow
gusts led it far off. (A lag of 78 ms had ended at none, at 3.1, one of 72 ms at 68, at 1.22; fits that were near at 1.0
to 1.07.)"""
MOST_WHITENINGS = 3
SETTLED = 0.02
"""Chi squared: a move by the noise that gains less is none; entries that predict the same have to end at the same."""
OF_THE_REST, ABOUT_NOISE = 2e-3, 1.5
"""Nor is one that gains less of what is left beyond noise, which is about 1 for each row and less than the second: what
leaves much is no answer to the last digit, and took a tenth of the time of the longest diagnoses."""


def predicting(fit: Candidate, parent: Candidate, begin: Model | None = None) -> Candidate:
    """In a loop the values that foretell best what is new, from typical ones of the effects that were added, or from
    where it is to begin; the fit where these do not foretell it better. Feedback may take least squares into another
    valley, and far off."""
    structure, metric = fit.model.structure, parent.metric
    if not (fit.dataset.in_a_loop and linear_dynamics(structure) and isinstance(metric, Innovations)):
        return fit
    usual = {one.name: one.typical for one in structure.parameters} | metric.model.by_name
    model = begin or Model(structure, structure.vector({name: usual[name] for name in structure.names}))
    there = replace(fit, estimate=replace(fit.estimate, at_bound=())).at(model.values)
    if there is None:
        return fit
    try:
        with np.errstate(all="ignore"):  # from where a model is not stable
            there = there.asked_in(metric)
            if not (
                there.model.stable
                and power_left(there, metric) < power_left(fit.asked_in(metric), metric) - SURELY_BETTER
            ):
                return fit
        found = replace(
            fit.estimate,
            model=there.model,
            at_bound=(),
            error=output_error(there.model, fit.dataset.stacks),
            covariance=covariance(there, metric),
            instrument="prediction error",
        )
        return candidate(found, fit.held, fit.dataset, fit.added)
    except (RelaxationError, np.linalg.LinAlgError):
        return fit


def by_the_noise(fit: Candidate, begin: Model, metric: Whitening, moves: int = MOST_MOVES_BY_NOISE) -> Candidate | None:
    """The fit's structure moved, from these values, to where the imposed commands leave nothing of its parameters in
    the noise's white rows, in so many moves at most; None where no response leads there.

    Least squares weighs what is small and narrow no more than gusts of the same power, and goes where these are.
    """
    here = replace(fit, estimate=replace(fit.estimate, at_bound=())).at(begin.values)
    if here is None:
        return None
    white = White.of(here, metric)
    for _ in range(moves):
        better = _moved(here, white, metric)
        if better is None:
            break
        here, white = better
    moved = replace(
        here.estimate,
        error=output_error(here.model, here.dataset.stacks),
        covariance=covariance(here, metric),
    )
    return candidate(moved, fit.held, fit.dataset, fit.added)


def misled(fit: Candidate, metric: Whitening) -> bool:
    """Whether least squares is far from where the noise's white rows have the fit's parameters, or so far that one step
    towards it is not to be taken; of linear structures whose excitation is logged."""
    if not (fit.division.measured and fit.model.structure.linear):
        return False
    stepped = instrumental_step(fit, metric)
    if stepped.shown is None:
        return False
    if not stepped.taken:
        return True
    before = stepped.shown.caused(white_residual(fit, metric))
    return float(before @ before) > MISLED * float(stepped.caused @ stepped.caused)


def by_its_own_noise(fit: Candidate, metric: Whitening) -> Candidate:
    """The fit moved to where the imposed commands leave nothing of its parameters, in white rows of this metric first
    and of what it leaves itself then: the noise beside a model that is far off is not that of the right one."""
    for _ in range(MOST_WHITENINGS):
        there = by_the_noise(fit, fit.model, as_loud(fit, metric))
        if there is None or np.array_equal(there.model.values, fit.model.values):
            break
        fit, metric = there, there.metric
    return fit


def _moved(one: Candidate, white: White, metric: Whitening) -> tuple[Candidate, White] | None:
    """So far along its move that it leaves less; None where it does not. Less than all the way to its bounds: a bound
    itself may have no response."""
    loose = [one.model.structure.names.index(name) for name in one.free]
    step = SHY * white.move(one)
    left = white.shows(white.residual)
    power = float(left @ left)
    least = power - max(SETTLED, OF_THE_REST * (power - ABOUT_NOISE * left.size))
    for part in PARTS:
        values = one.model.values.copy()
        values[loose] += part * step
        rest = residual_at(one, values, metric)  # derivatives cost many times as much
        if rest is not None and white.power(rest) < least:
            there = one.at(values)
            return None if there is None else (there, White.of(there, metric))
    return None
