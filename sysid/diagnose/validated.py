"""How much of what can be explained on the validation runs each candidate explains.

Where their excitation is logged it is told by power. Where it is not, commands explain gusts there, too, and what a
right effect changes goes with the gusts by way of the feedback: a change that is right may leave more power. So it is
asked what is new in every sample (`sysid.fit.innovations`), of which the commands until then know nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import gusts_kept_out
from sysid.diagnose.candidates import SIGNIFICANT, Ranked, Reference
from sysid.diagnose.evidence import Candidate, error_share, white_left
from sysid.diagnose.score import log_chance
from sysid.fit.innovations import Innovations, innovations
from sysid.fit.noise import WINDOW_HZ, Division, divide
from sysid.fit.output_error import OutputError
from sysid.fit.whitening import Whitening
from sysid.model.acting import linear_dynamics
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray

SLACK = 2.0
"""Standard deviations."""
BINS_FOR_EACH = 3
"""Of validation runs, for each unknown of a window where their noise is measured."""

Told = tuple[float | None, float]
"""What a candidate explains of what can be explained, None where the runs cannot tell; and how far off that may be by
the chance of the noise."""


def validation_of(fits: Sequence[Ranked], best: Candidate, reference: Reference) -> ByPower | ByWhatIsNew | None:
    """The measure that these runs allow; None where there are none, or they do not tell their noise. `fits` are
    candidates that were refitted, `best` the likeliest, or the parent."""
    on = reference.validation
    if on is None:
        return None
    if gusts_kept_out(on.causes.references):
        return ByPower.of(fits, on, reference)
    try:
        with np.errstate(all="ignore"):
            return ByWhatIsNew.of(best, on, reference)
    except (RelaxationError, np.linalg.LinAlgError):
        return None


@dataclass(frozen=True, eq=False, kw_only=True)
class ByPower:
    """Runs whose excitation is logged: what can be explained there, by the same measure as on the fitted runs."""

    before: float
    """The parent's error share."""
    noise: float
    scatter: float
    """Of the noise's share from run to run, one standard deviation."""
    divisions: tuple[tuple[OutputError, Division], ...]
    """What each leaves there, divided: the parent, then the candidates."""

    @classmethod
    def of(cls, fits: Sequence[Ranked], on: Dataset, reference: Reference) -> ByPower:
        """The noise is what the excitation does not explain of the least that anything leaves of these very runs: the
        air was another when they were flown."""
        error = reference.error
        assert error is not None
        before = error_share(error)
        left = [one.validation_error for one in fits if one.validation_error is not None]
        divisions = [(each, reference.left(each)) for each in (error, *left)]
        noise, least, division = min(
            ((float(np.sum(each.shares * division.noise_share)), each, division) for each, division in divisions),
            key=lambda one: one[0],
        )
        level = [np.real(np.einsum("fkk->fk", division.at(group.frequency_hz))) for group in on.stacks]
        air = np.concatenate(level)  # (bins, k)
        scatter = float(np.sqrt(np.sum(np.sum(air**2, axis=0) / least.measured_power**2)))
        return cls(before=before, noise=min(noise, before), scatter=scatter, divisions=tuple(divisions))

    def share(self, one: Ranked) -> Told:
        """All of it, where the commands explain nothing of what is left: in gusts that is the sharper question."""
        assert one.validation_error is not None
        slack = SLACK * self.scatter / max(self.before - self.noise, 1e-300)
        if slack > 1:
            return None, slack
        left = next(division for error, division in self.divisions if error is one.validation_error)
        if log_chance(left.chi_squared, left.degrees) >= SIGNIFICANT:
            return 1.0, slack
        error = error_share(one.validation_error)
        return float(np.clip((self.before - error) / max(self.before - self.noise, 1e-300), -1, 1)), slack


@dataclass(frozen=True, eq=False, kw_only=True)
class ByWhatIsNew:
    """Runs in a loop whose excitation nobody logged.

    What can be explained there is not known. But of what a candidate changes, how much shows there is: all of it where
    it is right, and as much is added where nothing of it is there. Twice as much is missing as its size is too large.
    """

    metric: Innovations
    """By the noise that the likeliest candidate leaves of these runs."""
    fitted: Whitening
    """In which candidates are moved to where they foretell best what is new in the fitted runs."""
    before: FloatArray
    """White rows (N,) that the parent leaves, so moved;"""
    as_fitted: FloatArray
    """and as least squares has it: what is simulated in time is not moved, and feedback biases either's base alike."""

    @classmethod
    def of(cls, best: Candidate, on: Dataset, reference: Reference) -> ByWhatIsNew:
        fitted = reference.whitening
        metric = innovations(best.asked_in(fitted).model, on.wider, ())
        before = white_left(reference.parent.asked_in(fitted).model, metric)
        as_fitted = white_left(reference.parent.model, metric)
        return cls(metric=metric, fitted=fitted, before=before, as_fitted=as_fitted)

    def share(self, one: Ranked) -> Told:
        assert one.fit is not None
        before = self.before if linear_dynamics(one.fit.model.structure) else self.as_fitted
        try:
            after = white_left(one.fit.asked_in(self.fitted).model, self.metric)
        except (RelaxationError, np.linalg.LinAlgError):
            return None, math.inf
        change = float(np.sum((before - after) ** 2))
        told = 0 < change < math.inf and one.chi_squared > 0
        slack = SLACK * 2 * math.sqrt(1 / change + 1 / one.chi_squared) if told else math.inf
        if slack > 1:
            return None, slack
        return float(np.clip((np.sum(before**2) - np.sum(after**2)) / change, -1, 1)), slack


def divided(error: OutputError, on: Dataset) -> Division:
    """What is left of validation runs, divided."""
    return divide(error, on.stacks, on.causes, _window_hz(on))


def _window_hz(on: Dataset) -> float:
    """Of windows that have bins enough to tell noise from an answer, however short the runs."""
    unknown = 2 * len(on.causes.commands) + len(on.spectra)
    return max(WINDOW_HZ, BINS_FOR_EACH * unknown / sum(one.segment.duration_s for one in on.spectra))
