"""Whether two effects only stand in for a third: what one does, the other takes back.

Two free effects can take the place of one that is not in the catalogue: a hub of rubber is damping with a wing in the
wake that undoes most of that damping, to the last digit. Nothing in the data tells such a pair from two that are there;
but effects that have nothing to do with each other do not cancel each other either.
"""

from __future__ import annotations

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.evidence import Candidate, imposed_answers
from sysid.fit.whitening import Whitening
from sysid.model.compose import compose
from sysid.model.effect import Effect, EffectError
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray

CANCEL = -0.65
"""Cosine between what both do, below which they take each other back. Hubs of rubber, on four simulated vehicles with
seeds below 10,000, gave -0.80 to -0.90 and the slung load of a training stranger -0.80; of 21 training strangers with
two effects one with play gave -0.47, the others -0.2 to 0.6. Damping beside gyroscopics of the other sign gives -0.78,
though both are there: such a pair is not named either."""


def cancel_each_other(chain: Ranked, parent: Candidate, whitening: Whitening) -> bool:
    """Whether the two effects of a chain do; what servos and gyros make of signals takes the place of nothing that
    flies. (Of two strangers that hid a lag or a filter beside an inflow, either was told alone.)"""
    if any(_on_the_way(effect) for effect in chain.own):
        return False
    cosine = along_each_other(chain, parent, whitening)
    return cosine is not None and cosine < CANCEL


def _on_the_way(effect: Effect) -> bool:
    """Whether it holds up commands or measurements, or acts on their samples."""
    holds = bool(effect.states) or effect.response is not None or effect.samples is not None
    return effect.group in ("actuators", "sensors") and holds


def along_each_other(chain: Ranked, parent: Candidate, whitening: Whitening) -> float | None:
    """Cosine between what each of two effects does beside the other, in white rows and beyond what the parent's own
    parameters would do as well; None where one cannot act without the other, or its response does not settle."""
    if chain.fit is None or len(chain.own) != 2:
        return None
    fit = chain.fit.asked_in(whitening)
    both = whitening([Y[None] for Y in fit.Y_imposed])[0]
    done = []
    for one in chain.own:
        answers = _without(one, fit)
        if answers is None:
            return None
        done.append(both - whitening([Y[None] for Y in answers])[0])
    own = [i for i, name in enumerate(fit.free) if name in parent.model.structure.names]
    first, second = _beyond(whitening([J[own] for J in fit.J_imposed]), np.array(done)) if own else done
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float(first @ second) / size if size > 0 and np.isfinite(size) else None


def _without(effect: Effect, fit: Candidate) -> list[ComplexArray] | None:
    """Answers to the imposed commands of the rest of its model, its values kept."""
    structure, on, named = fit.model.structure, fit.dataset, fit.model.by_name
    kept = [one for one in structure.composed if one is not effect]
    try:
        rest = compose(structure.base_, kept, on.available, dict(structure.constants), outputs=structure.outputs)
        if not set(rest.names) <= set(named):
            return None
        values = rest.vector({name: named[name] for name in rest.names})
        with np.errstate(all="ignore"):
            Y = [respond(rest, values, group, False).Y for group in on.stacks]
            return imposed_answers(rest, values, on, Y)[0]
    except (EffectError, RelaxationError, np.linalg.LinAlgError):
        return None


def _beyond(J: FloatArray, rows: FloatArray) -> FloatArray:
    """Rows (c, N) less what these sensitivities (b, N) explain of them."""
    return np.asarray(rows - np.linalg.lstsq(J.T, rows.T, rcond=1e-10)[0].T @ J)
