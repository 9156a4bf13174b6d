"""Flights with a nonlinear term that no effect of the catalogue is, by the integrator of `planted`, and their parents.

All flights are integrated side by side, every one with its own term, and chirps are twice the usual size, so that
terms of a size that vehicles have show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
import planted
import pytest
from made_once import made_once
from planted import DT, REST_S, TABLE_4, TRIM, Array, equations
from planted_fits import records

from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose.candidate_terms import CandidateTerms, candidate_terms
from sysid.diagnose.evidence import Candidate, candidate
from sysid.diagnose.term_search import Selection, select
from sysid.fit.estimate import estimate
from sysid.fit.identify import on_runs
from sysid.fit.noise import divide
from sysid.fit.whitening import noise_whitening
from sysid.model.compose import compose

HUB_STIFFENING = 40.0
"""1/rad^2: hub moments L_b b (1 + k b^2), M_a a (1 + k a^2)."""
IN_COMMANDS = ("none", "asymmetric_control", "cubic_control", "drift")
IN_MOMENTS = ("cubic_hub", "quadratic_damping", "product")
TERMS = (*IN_COMMANDS, *IN_MOMENTS)
RUNS = 4
"""Of each flight."""
SECONDS = 10.0
"""Of each chirp; a second of rest before and after."""
MIDDLE_S = 16.0
"""Of each run, by its clock."""
LOST = 0.19
"""Of the commands' effect, by the end, to drift."""


def _moments(x: Mapping[str, Array]) -> dict[str, Array]:
    """What is added to p_dot and q_dot, each flight's own."""
    p, q = np.zeros_like(x["p"]), np.zeros_like(x["q"])
    hub, drag, product = (_runs_of(term, IN_MOMENTS) for term in IN_MOMENTS)
    p[hub] = TABLE_4["L_b"] * HUB_STIFFENING * x["b"][hub] ** 3
    q[hub] = TABLE_4["M_a"] * HUB_STIFFENING * x["a"][hub] ** 3
    p[drag] = -1.5 * x["p"][drag] * np.abs(x["p"][drag])
    q[drag] = -3.0 * x["q"][drag] * np.abs(x["q"][drag])
    p[product], q[product] = -1.0 * (x["p"] * x["q"])[product], 2.5 * (x["p"] * x["q"])[product]
    return {"p": p, "q": q}


def _runs_of(term: str, terms: Sequence[str]) -> slice:
    begin = RUNS * terms.index(term)
    return slice(begin, begin + RUNS)


class _Controls(planted._Actuators):
    """Commands that act as they are bent, or lose effectiveness with time, in the flights that plant it."""

    pass_on = False
    _samples = 0

    def pieces(self, command: Array, steps: int) -> list[tuple[float, Array]]:
        trim = np.array(TRIM)[:2, None]
        moved = command[:2] - trim
        asymmetric, cubic, drift = (_runs_of(term, IN_COMMANDS) for term in IN_COMMANDS[1:])
        moved[:, asymmetric] += 0.1 * np.abs(moved[:, asymmetric])
        moved[:, cubic] -= 3.0 * moved[:, cubic] ** 3
        moved[:, drift] *= 1 - LOST * self._samples * DT / (SECONDS + 2 * REST_S)
        self._samples += 1
        return super().pieces(np.concatenate([trim + moved, command[2:]]), steps)


def _with_moments(*words: object) -> planted._Equations:
    E = equations(*words)  # type: ignore[arg-type]
    E.nonlinear = _moments
    return E


@cache
def flights() -> Mapping[str, list[Record]]:
    """Two roll and two pitch chirps for each of TERMS; all in the same air."""
    return made_once(_flights)


def _flights() -> dict[str, list[Record]]:
    found = {}
    for terms, name, instead in (
        (IN_COMMANDS, "_Actuators", _Controls),
        (IN_MOMENTS, "equations", _with_moments),
    ):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(planted, name, instead)
            patch.setattr(planted, "SIZES", {axis: 2 * size for axis, size in planted.SIZES.items()})
            flown = planted.fly_many(None, {}, seeds=[4] * len(terms), duration_s=SECONDS, steps=2)
        for term, flight in zip(terms, flown, strict=True):
            found[term] = records([{**run, "t": run["t"] + MIDDLE_S - run["t"].mean()} for run in flight])
    return found


def parent_of(flown: Sequence[Record], base: str = "tpp", effects: Sequence[str] = ()) -> Candidate:
    """A fit as a diagnosis begins with it."""
    on = dataset(flown, (0.0, 15.0))
    structure = on_runs(base, effects, flown, flown)
    structure = compose(base, effects, on.available, dict(structure.constants))
    return candidate(estimate(structure, on.viewed(structure.inputs)), (), on)


@cache
def searched(term: str) -> tuple[Candidate, CandidateTerms, Selection]:
    """The bare TPP on a flight, its library, and what that selects."""
    parent = parent_of(flights()[term])
    on = parent.dataset
    known = candidate_terms(parent)
    whitening = noise_whitening(parent.model, on.stacks, divide(parent.estimate.error, on.stacks, on.causes))
    return parent, known, select(parent, whitening, known)
