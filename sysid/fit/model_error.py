"""How far a fit's values may be off because the model is not the vehicle: what its standard errors do not know of.

Standard errors are right where the structure is, and where clocks are. Here stands beside them, for each parameter, one
standard deviation of what speaks against that:

- clocks: the stamps of commands and of rates may each be off by half a period of the vehicle's loop (of the log, where
  the loop's rate is not known), which is also what one convention of holding commands is apart from another;
- frequencies: what octaves of the band disagree about, and runs what runs do, beyond chance: each is left out in turn
  (jackknife); of a few parts larger, so that twice it holds what twice a known standard deviation does (Student);
- validation: how far the values would move if the validation runs were fitted too, beyond chance.

All are single steps from the fit, on bins that are there already; nothing is fitted again. A model error that every run
and every octave shares is not seen: only clocks have a size of their own.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.data.dataset import Bins, Runs, prepared
from sysid.data.preprocess import ComplexArray
from sysid.fit.estimate import Weights, free_of, weights_at
from sysid.fit.low_edge import WORST_CONDITION, Part, parts_of
from sysid.fit.result import Fit, ModelError
from sysid.fit.rows import project, rows
from sysid.fit.scaled import scaled_inverse
from sysid.fit.whitening import weighed
from sysid.model.acting import jumping
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import AnyArray, FloatArray, Model

CLOCKS = 2
"""Those of the commands and of the rates;"""
OF_A_PERIOD = 1 / math.sqrt(12)
"""and the standard deviation of what each is off, somewhere within half a period on either side."""
LOWEST_OCTAVE_HZ = 0.5
"""Below it the band is one part."""
TWO_SIDED = 0.97725
"""What lies below two standard deviations."""
LEAST_FREEDOM = 2
"""Degrees of freedom at least: of two parts alone two would be seven."""
LOOSE = 5.0
"""Times its own standard error, that a value may be uncertain without some of the bins for these to count."""


def with_model_errors(fit: Fit, runs: Runs, validation: Runs = ()) -> Fit:
    """The fit with its model errors, on the runs that it was made from and those that only judged it."""
    structure = fit.model.structure
    bins, judging = (
        prepared(each, fit.band_hz).held(fit.found_loop_s).viewed(structure.inputs, structure.outputs)
        for each in (runs, validation)
    )
    return replace(fit, model_errors=model_errors(fit.model, bins, judging, fit.fixed, fit.weights))


def model_errors(
    model: Model,
    bins: Bins,
    validation: Bins | None = None,
    held: Collection[str] = (),
    weights: Weights = "residual spectrum",
) -> dict[str, ModelError]:
    """Of each free parameter of a fit that ended at this model, by these weights on its bins.

    `validation` are bins that were not fitted. Empty where there is no step to take.
    """
    free = free_of(model, held)
    if not free or jumping(model.structure, model.values, bins.stacks[0]):
        return {}
    try:
        cells = _Cells.of(model, bins, free, weights)
        judging = None if validation is None or not validation.spectra else _Cells.of(model, validation, free, weights)
    except (RelaxationError, np.linalg.LinAlgError):
        return {}
    whole = scaled_inverse(cells.curvature.sum(axis=0), WORST_CONDITION)
    if whole is None:
        return {}
    clocks = np.abs(whole @ cells.shift.sum(axis=0))
    frequencies, runs = _disagreement(cells, whole, cells.octave), _disagreement(cells, whole, cells.run)
    judged = np.zeros(len(free)) if judging is None else _moved_by(cells, whole, judging)
    return {
        model.structure.names[i]: ModelError(
            clocks=float(clocks[row]),
            frequencies=float(frequencies[row]),
            runs=float(runs[row]),
            validation=float(judged[row]),
        )
        for row, i in enumerate(free)
    }


class _Cells(NamedTuple):
    """Normal equations of a fit, apart for each segment and octave, (cells, ...)."""

    curvature: FloatArray
    """(c, free, free)"""
    gradient: FloatArray
    """(c, free), of what is left;"""
    variance: FloatArray
    """(c, free, free), of that by chance;"""
    shift: FloatArray
    """(c, free), of what the clocks may make, one standard deviation."""
    octave: NDArray[np.int64]
    run: NDArray[np.int64]

    @classmethod
    def of(cls, model: Model, bins: Bins, free: Sequence[int], kind: Weights) -> _Cells:
        weights = weights_at(model, bins, kind)
        parts = parts_of(model, bins, free, weights, bins.instruments(model.structure.commands))
        late = _late(model, bins, weights)
        numbers = _runs(bins)
        edges = _octaves(max(float(one.frequency_hz[-1]) for one in parts))
        found = []
        for part, shifted, number in zip(parts, late, numbers, strict=True):
            found += _cells(part, shifted, edges, number)
        return cls(*(np.array(each) for each in zip(*found, strict=True)))


def _late(model: Model, bins: Bins, weights: Sequence[AnyArray]) -> list[ComplexArray]:
    """For every segment the change of its weighted outputs, (1, k, bins), if stamps are off by a standard deviation."""
    found = []
    for group, weight in zip(bins.stacks, weights, strict=True):
        off_s = math.sqrt(CLOCKS) * OF_A_PERIOD * group.held_s
        Y = respond(model.structure, model.values, group, False).Y
        late = weighed(weight, (2j * np.pi * off_s * group.frequency_hz * Y)[None])
        found += [late[..., part] for part in group.slices]
    return found


def _runs(bins: Bins) -> list[int]:
    """For every segment, in the order of the stacks, the number of its run."""
    segments = [one.segment.record.id for group in bins.stacks for one in group.spectra]
    known = list(dict.fromkeys(segments))
    return [known.index(one) for one in segments]


def _octaves(high_hz: float) -> FloatArray:
    """Edges inside the band, Hz."""
    count = max(0, math.floor(math.log2(high_hz / LOWEST_OCTAVE_HZ)))
    return np.asarray(high_hz / 2.0 ** np.arange(count, 0, -1))


def _cells(part: Part, late: ComplexArray, edges: FloatArray, run: int) -> list[tuple[object, ...]]:
    """A segment's share of the normal equations, octave by octave: the fields of `_Cells` in their order."""
    count = part.columns.shape[0] // 2
    together = project(rows(part.E), rows(np.concatenate([part.columns, late])))
    bins = together.view(complex).reshape(len(together), -1, part.frequency_hz.size)
    octave = np.digitize(part.frequency_hz, edges)
    found: list[tuple[object, ...]] = []
    for number in np.unique(octave):
        here = octave == number
        each = rows(bins[..., here])
        J, Z, spectrum = each[1 : 1 + count], each[1 + count : -1], part.spectrum[..., here]
        noisy = rows(np.einsum("klf,blf->bkf", spectrum, np.ascontiguousarray(bins[1 + count : -1, :, here])))
        found.append((Z @ J.T, Z @ each[0], 0.5 * (Z @ noisy.T), Z @ each[-1], int(number), run))
    return found


def _disagreement(cells: _Cells, whole: FloatArray, label: NDArray[np.int64]) -> FloatArray:
    """Standard deviations (free,) of the estimate as bins of one label after the other left out have it, beyond chance.

    What is hardly determined without some bins says nothing there.
    """
    # half a second to load: only where errors are told
    from scipy.special import stdtrit

    labels = np.unique(label)
    H, V = cells.curvature.sum(axis=0), cells.variance.sum(axis=0)
    step = whole @ cells.gradient.sum(axis=0)
    errors = np.sqrt(np.maximum(np.diag(whole @ V @ whole.T), 0))
    beyond, counted = np.zeros(len(H)), np.zeros(len(H))
    for one in labels:
        here = label == one
        Hc, Vc = cells.curvature[here].sum(axis=0), cells.variance[here].sum(axis=0)
        rest = scaled_inverse(H - Hc, WORST_CONDITION)
        if rest is None:
            continue
        move = rest @ (cells.gradient[here].sum(axis=0) - Hc @ step)
        pull = Hc @ whole
        chance = np.diag(rest @ (Vc - pull @ Vc - Vc @ pull.T + pull @ V @ pull.T) @ rest.T)
        told = chance < (LOOSE * errors) ** 2
        beyond += np.where(told, move**2 - chance, 0.0)
        counted += told
    seldom = stdtrit(np.maximum(counted - 1, LEAST_FREEDOM), TWO_SIDED) / 2
    return np.asarray(seldom * np.sqrt(np.maximum(beyond, 0) * np.maximum(counted - 1, 0) / np.maximum(counted, 1)))


def _moved_by(cells: _Cells, whole: FloatArray, judging: _Cells) -> FloatArray:
    """By how much these other runs, fitted too, would move the estimate, beyond chance, (free,)."""
    H, V = cells.curvature.sum(axis=0), cells.variance.sum(axis=0)
    Hv, Vv = judging.curvature.sum(axis=0), judging.variance.sum(axis=0)
    both = scaled_inverse(H + Hv, WORST_CONDITION)
    if both is None:
        return np.zeros(len(H))
    pull = Hv @ whole
    move = both @ (judging.gradient.sum(axis=0) - pull @ cells.gradient.sum(axis=0))
    chance = np.diag(both @ (Vv + pull @ V @ pull.T) @ both.T)
    return np.asarray(np.sqrt(np.maximum(move**2 - chance, 0)))
