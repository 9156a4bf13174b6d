"""Which candidate terms explain most of a residual: scored all at once, the best compared one by one, then selected.

Terms are scored as effects are: by one step from the parent, less what the parent's own parameters would do, asked with
the commands as the logged excitation alone moved them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from sysid.data.preprocess import ComplexArray
from sysid.diagnose.candidate_terms import CandidateTerms, candidate_terms
from sysid.diagnose.evidence import Candidate, Stepped, error_share
from sysid.diagnose.score import in_bursts
from sysid.diagnose.terms import Entry
from sysid.diagnose.thinned import rows_that_tell_sizes
from sysid.fit.innovations import Innovations
from sysid.fit.noise import divide
from sysid.fit.output_error import OutputError
from sysid.fit.rows import bins
from sysid.fit.scaled import instrumental_inverse
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.structure import AnyArray, FloatArray

LEAST_LEFT = 1e-4
"""Share of a term that the parent's own parameters must leave of it; less needs absurd coefficients."""
LEAST_APART = 1e-4
"""1 - correlation^2 of the two terms of a pair."""
LOOKED_AT = 120
"""Best entries that are compared one by one."""
SIGNIFICANT = math.log(0.01)
TELLING = 2.33
"""Standard deviations that tell one entry from another."""
BY_CHANCE = {1: 6.6, 2: 9.2}
"""By coefficients: chi squared that noise adds to one of two that are both true, once in a hundred."""
INEXACT = 0.01
"""Share of chi squared that one step, which leaves out what a term does to its own signals, cannot be held to."""
FAR = 15.0
"""In log p: more than what `BY_CHANCE`, and a second coefficient, are worth."""
EQUAL = 2.0
"""In log p: what an entry in fewer signals may lack of the best to speak for it."""
BEYOND_BURSTS = math.log(1e-12)
"""Chance below which no burst explains the best of so many terms: of a clean flight one had 2e-10, and 1 as far as it
is sure in bursts."""
MOST_TERMS = 4


def _score(known: CandidateTerms, stepped: Stepped, whitening: Whitening) -> FloatArray:
    """Chi squared of every entry; NaN where the parent's own parameters do the same, or the terms of a pair do."""
    if not known.entries:  # of a user's base that moves something else
        return np.empty(0)
    products = _products(known, stepped, whitening)
    single, first, second = known.single, known.first_of_pairs, known.second
    size = products.gram_single
    with np.errstate(all="ignore"):
        alone = np.where(products.left > LEAST_LEFT, products.e / np.sqrt(size), np.nan)
        one, two = alone[first], alone[second]
        correlation = products.gram_pair / np.sqrt(size[first] * size[second])
        apart = 1 - correlation**2
        both = (one**2 + two**2 - 2 * correlation * one * two) / np.where(apart > LEAST_APART, apart, np.nan)
    return np.concatenate([alone[known.first[0][:single], known.first[1][:single]] ** 2, both])


@dataclass(frozen=True, eq=False)
class _Products:
    """Inner products of whitened sensitivities by the imposed commands, less what the parent would do."""

    e: FloatArray
    """(rows, expressions), with the residual, wherever the parent was moved to."""
    gram_single: FloatArray
    """(rows, expressions), with themselves."""
    left: FloatArray
    """(rows, expressions), share of themselves that the parent's own parameters leave."""
    gram_pair: FloatArray
    """(pairs,), of the first part with the second."""


@dataclass(frozen=True, eq=False, kw_only=True)
class _InMetric:
    """All of the inner products that no fit has a part in."""

    Z: ComplexArray
    """(expressions, bins), by the imposed commands."""
    h: ComplexArray
    """(rows, k, bins), what a row makes of them, whitened."""
    sizes: list[int]
    """Bins of each segment."""
    ends: FloatArray
    """(rows, expressions, end states), with what is projected out."""
    whole: FloatArray
    """(rows, expressions), with themselves, less that;"""
    pairs: FloatArray
    """(pairs,), and of the first part with the second."""
    _known: dict[bytes, FloatArray] = field(default_factory=dict)

    def with_vectors(self, vectors: FloatArray) -> FloatArray:
        """(rows, expressions, vectors), with vectors (v, N). Kept: from term to term all but a few are the same."""
        keys = [vector.tobytes() for vector in vectors]
        new = [i for i, key in enumerate(keys) if key not in self._known]
        if new:
            found = _inner(self.Z, self.h, bins(vectors[new], self.sizes, self.h.shape[1]))
            self._known.update({keys[i]: found[..., number] for number, i in enumerate(new)})
        return np.stack([self._known[key] for key in keys], axis=2)


@lru_cache(maxsize=2)
def _in_metric(known: CandidateTerms, whitening: Whitening) -> _InMetric:
    """Kept: a selection asks term after term in one metric."""
    Z = np.concatenate(known.imposed, axis=1)
    h = np.concatenate(
        [
            group.scale * np.einsum("fij,rjf->rif", white, T)
            for group, white, T in zip(whitening.stacks, whitening.whitener, known.transfer, strict=True)
        ],
        axis=2,
    )
    sizes = [part.stop - part.start for group in whitening.stacks for part in group.slices]
    bases = [basis for group in whitening.ends for basis in group]
    edges = np.cumsum([0, *sizes])
    ends = np.concatenate(
        [
            _inner(Z[:, i:j], h[..., i:j], bins(basis, [j - i], h.shape[1]))
            for i, j, basis in zip(edges[:-1], edges[1:], bases, strict=True)
        ],
        axis=2,
    )
    whole = (Z.real**2 + Z.imag**2) @ np.sum(np.abs(h) ** 2, axis=1).T
    one, two = known.first_of_pairs, known.second
    pairs = np.empty(two[0].size)
    for i in np.unique(one[0]):
        here = one[0] == i
        j = two[0][here][0]
        pairs[here] = np.real((Z[one[1][here]].conj() * Z[two[1][here]]) @ np.sum(h[i].conj() * h[j], axis=0))
    pairs -= np.sum(ends[one] * ends[two], axis=1)
    whole = whole.T - np.sum(ends**2, axis=2)
    return _InMetric(Z=Z, h=h, sizes=sizes, ends=ends, whole=whole, pairs=pairs)


def _products(known: CandidateTerms, stepped: Stepped, whitening: Whitening) -> _Products:
    """Without forming one sensitivity: <h t, v> is the real part of conj(t) times what h makes of v, bin by bin."""
    fixed, b = _in_metric(known, whitening), len(stepped.J)
    others = fixed.with_vectors(np.concatenate([stepped.residual[None], stepped.J, stepped.Z]))
    e, moved, asked = others[..., 0], others[..., 1 : 1 + b], others[..., 1 + b :]
    own = moved @ stepped.own
    e = e - own @ (stepped.Z @ stepped.residual)  # where the parent was moved by less than all of its instruments
    crossed = stepped.Z @ stepped.Z.T
    rest = fixed.whole - 2 * np.sum(own * asked, axis=2) + np.sum((own @ crossed) * own, axis=2)
    one, two = known.first_of_pairs, known.second
    pairs = fixed.pairs - np.sum(own[one] * asked[two] + asked[one] * own[two], axis=1)
    pairs += np.sum((own[one] @ crossed) * own[two], axis=1)
    return _Products(e, rest, rest / np.maximum(fixed.whole, 1e-300), pairs)


def _inner(terms: ComplexArray, h: ComplexArray, vectors: ComplexArray) -> FloatArray:
    """(rows, terms, vectors)"""
    weighed = np.einsum("rkf,vkf->rvf", h.conj(), vectors)
    real = np.ascontiguousarray(weighed).view(float).reshape(-1, 2 * terms.shape[1])
    found = np.ascontiguousarray(terms).view(float) @ real.T
    return np.asarray(found.reshape(len(terms), len(h), -1).transpose(1, 0, 2))


@dataclass(frozen=True, eq=False, kw_only=True)
class Term:
    """An entry, and what the runs say for it."""

    entry: Entry
    chi_squared: float
    degrees: int
    log_p: float
    """Logarithm of the chance that noise alone shows as much in any of the library's entries, taken as independent:
    neighbours are not, so the chance is about a third of that."""
    log_p_surely: float
    """The same of no more than what is sure in bursts: an alarm."""
    coefficients: FloatArray
    """(degrees,), by one step from the parent."""
    standard_errors: FloatArray
    error_share: float
    """Residual over measured power, summed over the outputs, that one step would leave."""
    as_well: tuple[Entry, ...] = ()
    """Entries that these runs cannot tell from it, best first."""
    number: int = -1
    """In its library."""

    @property
    def significant(self) -> bool:
        return self.log_p < SIGNIFICANT


@dataclass(frozen=True, eq=False)
class Selection:
    """Entries one after the other until nothing significant is left: the most that this library explains."""

    terms: tuple[Term, ...]
    """In the order of choice, each as it was scored beside those before it; empty where nothing is significant."""
    error: OutputError
    """What one step with all of them leaves: noise, as far as the library reaches."""

    @property
    def error_share(self) -> float:
        """Residual over measured power that is left, summed over the outputs."""
        return error_share(self.error)


def search(
    parent: Candidate,
    stepped: Stepped,
    whitening: Whitening,
    known: CandidateTerms | None = None,
    most: int = 10,
    beside: Sequence[Term] = (),
) -> list[Term]:
    """The best entries by one step from the parent, best first; those that runs cannot tell apart make one Term.

    `known` is the parent's library where it was made already. `beside`: terms that stay in; `stepped` has them too.
    Of entries as good as the best the one in the fewest signals speaks for all.
    """
    known = known or candidate_terms(parent)
    order, log_p, tried = _ranked(known, stepped, whitening)
    order = order[:LOOKED_AT] if most > 1 else _near_the_best(order[:LOOKED_AT], log_p)
    steps = _steps(known, order, stepped, whitening)
    found: list[Term] = []
    while steps and len(found) < most:
        best = steps[0]
        alike = [one for one in steps if one is best or _as_well(best, one)]
        equal = [one for one in alike if log_p[one.number] < log_p[best.number] + EQUAL]
        head = min(equal, key=lambda one: (known.entries[one.number].signals, log_p[one.number]))
        at_least = _at_least(head, known.entries[head.number], stepped, whitening)
        usual = surely = min(0.0, _log_chance(head, at_least, log_p) + math.log(tried))
        if usual >= BEYOND_BURSTS:
            least = min(at_least, in_bursts(head.rows, stepped.residual, stepped.envelope(whitening)))
            surely = min(0.0, _log_chance(head, least, log_p) + math.log(tried))
        found.append(
            Term(
                entry=known.entries[head.number],
                chi_squared=head.chi_squared,
                degrees=len(head.coefficients),
                log_p=usual,
                log_p_surely=surely,
                coefficients=head.coefficients,
                standard_errors=head.standard_errors,
                error_share=error_share(_left(parent, known, [*(term.number for term in beside), head.number])),
                as_well=tuple(known.entries[one.number] for one in alike if one is not head),
                number=head.number,
            )
        )
        steps = [one for one in steps if all(one is not other for other in alike)]
    return found


def select(
    parent: Candidate, whitening: Whitening, known: CandidateTerms | None = None, most: int = MOST_TERMS
) -> Selection:
    """Greedy forward selection, twice: what the first leaves is the noise by whose spectrum the second chooses. Once
    where past noise foretells: that is the noise already."""
    known = known or candidate_terms(parent)
    if not isinstance(whitening, Innovations):
        on = parent.dataset
        left = _left(parent, known, _rough(parent, known, whitening, most))
        whitening = noise_whitening(parent.model, on.stacks, divide(left, on.stacks, on.causes))
    terms: list[Term] = []
    while len(terms) < most:
        stepped = _settled(parent, known, [term.number for term in terms], whitening)
        best = search(parent, stepped, whitening, known=known, most=1, beside=terms)
        if not best or not best[0].significant:
            break
        terms.append(best[0])
    left = _left(parent, known, [term.number for term in terms])
    return Selection(tuple(terms), left)


def _rough(parent: Candidate, known: CandidateTerms, whitening: Whitening, most: int) -> list[int]:
    """Numbers of the entries of a first selection, each the best of all by one step."""
    found: list[int] = []
    while len(found) < most:
        order, log_p, tried = _ranked(known, _settled(parent, known, found, whitening), whitening)
        if not order or log_p[order[0]] + math.log(tried) > SIGNIFICANT:
            break
        found.append(order[0])
    return found


def _near_the_best(order: Sequence[int], log_p: FloatArray) -> list[int]:
    """Of entries, best first, those that the runs may not tell from the first: no other can speak for it."""
    return [number for number in order if log_p[number] <= (1 - 2 * INEXACT) * log_p[order[0]] + FAR]


def _ranked(known: CandidateTerms, stepped: Stepped, whitening: Whitening) -> tuple[list[int], FloatArray, int]:
    """Numbers of entries, best first; the logarithm of each one's chance; and how many there were to choose from."""
    chi_squared = _score(known, stepped, whitening)
    degrees = np.where(np.arange(chi_squared.size) < known.single, 1, 2)
    valid = np.isfinite(chi_squared)
    log_p = np.where(valid, log_chances(np.where(valid, chi_squared, 0.0), degrees), 0.0)
    order = np.lexsort((-np.where(valid, chi_squared, -np.inf), log_p))
    return [int(number) for number in order if valid[number]], log_p, max(1, int(np.count_nonzero(valid)))


def log_chances(chi_squared: FloatArray, degrees: AnyArray) -> FloatArray:
    """Logarithm of the chance that chi squared of one or two degrees is larger."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.special import log_ndtr

    return np.where(degrees == 2, -0.5 * chi_squared, math.log(2) + log_ndtr(-np.sqrt(chi_squared)))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Step:
    """One entry's step from the parent."""

    number: int
    coefficients: FloatArray
    standard_errors: FloatArray
    explains: FloatArray
    """(N,) of the residual, as the imposed commands show it."""
    rows: FloatArray
    """(parts, N), what asks it of the residual."""

    @property
    def chi_squared(self) -> float:
        return float(self.explains @ self.explains)


def _steps(known: CandidateTerms, numbers: Sequence[int], stepped: Stepped, whitening: Whitening) -> list[_Step]:
    if not numbers:
        return []
    D = whitening(_together([known.answers(number) for number in numbers]))
    Z = D if known.as_flown else whitening(_together([known.answers(number, True) for number in numbers]))
    Z = Z - (Z @ stepped.J.T) @ stepped.own @ stepped.Z
    found = []
    begin = 0
    for number in numbers:
        z = Z[begin : begin + len(known.entries[number].parts)]
        d = D[begin : begin + len(z)]
        begin += len(z)
        gram, e = z @ z.T, z @ stepped.residual
        inverse = np.linalg.pinv(z @ d.T)
        spread = np.sqrt(np.maximum(np.diag(inverse @ gram @ inverse.T), 0))
        found.append(
            _Step(
                number=number,
                coefficients=inverse @ e,
                standard_errors=spread,
                explains=np.linalg.pinv(gram, hermitian=True) @ e @ z,
                rows=z,
            )
        )
    return found


def _at_least(step: _Step, entry: Entry, stepped: Stepped, whitening: Whitening) -> float:
    """Chi squared of an entry by the noise's power when it acts, where noise comes in bursts; of what is not linear by
    frequencies at which a thinned log tells how large commands are; the less of both."""
    envelope, told, z = stepped.envelope(whitening), rows_that_tell_sizes(whitening), step.rows
    least = math.inf
    if envelope.rough:
        least = envelope.surely(_quadratic(z @ stepped.residual, envelope.gram(z)), len(z), z)
    if told is not None and not entry.linear:
        least = min(least, _quadratic((z * told) @ stepped.residual, (z * told) @ z.T))
    return least


def _quadratic(e: FloatArray, covariance: FloatArray) -> float:
    return float(e @ np.linalg.pinv(covariance, hermitian=True) @ e)


def _log_chance(step: _Step, at_least: float, log_p: FloatArray) -> float:
    """Of one entry; by what is sure of it, where that is the more likely."""
    usual = float(log_p[step.number])
    if not math.isfinite(at_least):
        return usual
    return max(usual, float(log_chances(np.array(at_least), np.array(len(step.coefficients)))))


def _together(answers: Sequence[list[ComplexArray]]) -> list[ComplexArray]:
    return [np.concatenate(parts) for parts in zip(*answers, strict=True)]


def _as_well(better: _Step, other: _Step) -> bool:
    """Whether the runs, if the other were true, could show the better one as much better as they do.

    |f_1|^2 - |f_2|^2 of what two explain has then the mean -d and the deviation 2 sqrt(d), d their distance squared.
    """
    gain = better.chi_squared - other.chi_squared
    apart = better.explains - other.explains
    d = float(apart @ apart)
    chance = BY_CHANCE[len(better.coefficients)]
    return gain < max(2 * TELLING * math.sqrt(d) - d, chance, INEXACT * better.chi_squared)


def _settled(parent: Candidate, known: CandidateTerms, numbers: Sequence[int], whitening: Whitening) -> Stepped:
    """As `instrumental_step` does, with entries among the parameters, wherever their bounds are."""
    moved = whitening(_together([parent.J, *(known.answers(number) for number in numbers)]))
    asked = moved
    if not (known.as_flown and parent.J_imposed is parent.J):
        asked = whitening(_together([parent.J_imposed, *(known.answers(number, True) for number in numbers)]))
    e = whitening(_residual(parent))[0]
    imposed = whitening([Y[None] for Y in parent.Y_imposed])[0]
    move = instrumental_inverse(asked, moved) @ (asked @ e)
    return Stepped(residual=e - move @ moved, imposed=imposed + move @ asked, J=moved, Z=asked)


def _residual(parent: Candidate) -> list[ComplexArray]:
    return [(group.Y - Y)[None] for group, Y in zip(parent.dataset.stacks, parent.Y, strict=True)]


def _left(parent: Candidate, known: CandidateTerms, numbers: Sequence[int]) -> OutputError:
    """What the parent with these entries leaves after one step of all parameters, by the least squares of a fit."""
    plain, stacks = known.plain, parent.dataset.stacks
    e = plain(_residual(parent))[0]
    if numbers:
        J = plain(_together([parent.J, *(known.answers(number) for number in numbers)]))
        e = e - (instrumental_inverse(J, J) @ (J @ e)) @ J
    residuals, power, begin = [], np.zeros(len(parent.model.structure.outputs)), 0
    for group, whitener in zip(stacks, plain.whitener, strict=True):
        weight = np.diag(whitener[0]).real
        for part in group.slices:
            size = 2 * power.size * (part.stop - part.start)  # real and imaginary parts of every output
            left = e[begin : begin + size].view(complex).reshape(power.size, -1) / weight[:, None]
            power += np.sum(np.abs(left) ** 2, axis=1)
            residuals.append(left / group.scale[part])
            begin += size
    return OutputError(residuals, parent.estimate.error.measured_power, power)
