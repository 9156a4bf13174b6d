"""What could hide: effects too small for these runs to show, that would still do harm.

A clean verdict is worth what the runs could have seen. For every effect that the structure lacks this asks how large it
may be and stay unnoticed, and what leaving it out at that size does: to the fitted parameters, to the modes, and to the
margins of the gains that would be designed on the fit.

The size is the larger of two: the upper 95 % limit of the one-step estimate, and what the diagnosis, by its own
threshold, would find in 80 % of such flights. Both come from the effect's response under the noise's spectrum, less
what the structure's own parameters would do as well. An effect of several parameters is taken in the combination that
moves the fit most, inside what is plausible. The parameters' shift is one step of the fit's own criterion, which weighs
each output as a whole.

Effects without a null have no size and are left out, as are those of forward flight while nothing says that it is
flown; parameters that mean nothing at the null are taken as typical. What is not linear in its size is predicted at two
sizes, and the response between and beyond follows their power law: simulations are dear. For the same reason a small
effect beside a nonlinear one that the structure has is predicted beside the structure's linear part alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.control.regulator import DesignError, Gains, lqr
from sysid.control.stability import Margins, closed_loop
from sysid.data.preprocess import ComplexArray
from sysid.diagnose.candidates import SIGNIFICANT, counted, flies_forward
from sysid.diagnose.evidence import Candidate, Stepped
from sysid.diagnose.hidden import HARM, MOST, CouldHide, Hidden, grouped
from sysid.diagnose.score import INDEPENDENT
from sysid.fit.identifiable import size as whole
from sysid.fit.identify import beyond_responses
from sysid.fit.noise import Division
from sysid.fit.scaled import instrumental_inverse
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.compose import compose, not_testable
from sysid.model.effect import Effect, EffectError, catalogue
from sysid.model.parameter import Parameter
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Mode, Model, Structure

UPPER = 1.645
"""Standard errors to the upper 95 % limit."""
MISSED = 0.2
"""Of flights with an effect of the size that is told, those in which the diagnosis may miss it."""
FIRST_STEP = 0.003
"""Of the way from null to typical: where a linear effect's response is taken, small enough to be straight;"""
FIRST_STEP_NONLINEAR = 0.5
"""and where it grows otherwise than in proportion."""
NEAR = (0.8, 1.25)
"""Of the distance wanted: close enough."""
SLOPES = (0.5, 4.0)
"""Powers of the size with which a response may grow."""
DOUBLINGS = 4
MOST_SIZES = 2
LEAST_SIZE = 0.2
"""Of the largest, on the scale where typical is 1: smaller parameters of one effect are not told."""
MODE_STEPS = 8
"""In which modes are followed from the fit to the vehicle."""
NO_MARGINS = Margins(0.0, 0.0, 0.0)
"""Of gains that do not hold the vehicle."""


def could_hide(
    parent: Candidate, stepped: Stepped, whitening: Whitening, division: Division, users: Sequence[Effect] = ()
) -> CouldHide:
    """Ask every testable effect that the parent lacks; `division` is that of the metric's noise."""
    structures = _testable(parent, users)
    asking = _Asking.of(parent, stepped, whitening, division, len(structures))
    asked = [asking.ask(effect, composed) for effect, composed in structures]
    groups = grouped([one for one in asked if one is not None])
    harmful = sum(group[0].harm >= HARM for group in groups[:MOST])
    return CouldHide(tuple(groups[:harmful]), tuple(groups[harmful:]))


def _testable(parent: Candidate, users: Sequence[Effect]) -> list[tuple[Effect, Structure]]:
    structure, available = parent.model.structure, parent.dataset.available
    present = {one.id for one in structure.composed}
    linear = [one for one in structure.composed if one.linear]
    forward = flies_forward(structure, parent.dataset)
    found = []
    for effect in (*catalogue().values(), *users):
        if effect.id in present or not effect.has_null or effect.slot is not None:
            continue
        if effect.group == "forward" and not forward:
            continue
        if not effect.can_be_on(parent.dataset.airframe) or beyond_responses(effect, parent.dataset.records):
            continue
        if not_testable(effect, structure.base_, [*present, effect.id], available) is not None:
            continue
        try:
            composed = compose(
                structure.base_, [*linear, effect], available, dict(structure.constants), outputs=structure.outputs
            )
        except EffectError:
            continue  # it stands for a part that the structure has
        found.append((effect, composed))
    return found


@dataclass(frozen=True, eq=False, kw_only=True)
class _Asking:
    """What all questions share."""

    parent: Candidate
    stepped: Stepped
    whitening: Whitening
    by_fit: Whitening
    """The fit's own criterion."""
    answer: FloatArray
    """(free, N), from a change of the outputs in the fit's criterion to that of the parameters."""
    free: tuple[str, ...]
    base: list[ComplexArray]
    """Predicted by the structure's linear part from the imposed commands, for every stack (k, bins)."""
    own: FloatArray
    """(free, N): what the parent's own parameters, moved, answer to a change of the outputs in the noise's measure."""
    gains: Gains | None
    margins: Margins | None
    """Of the gains on the parent."""
    effects: int
    """How many are asked;"""
    raised: float
    """logarithm by which the chance of each is raised for all else that is asked."""

    @classmethod
    def of(cls, parent: Candidate, stepped: Stepped, whitening: Whitening, division: Division, effects: int) -> _Asking:
        structure, estimate = parent.model.structure, parent.estimate
        by_fit = whitening if estimate.weights == "residual spectrum" else _by_output(parent, division)
        moved = by_fit(parent.J)
        asked = by_fit(parent.J_imposed) if estimate.instrumented else moved
        try:
            gains = lqr(parent.model) if structure.linear else None
        except DesignError:
            gains = None
        return cls(
            parent=parent,
            stepped=stepped,
            whitening=whitening,
            by_fit=by_fit,
            answer=instrumental_inverse(asked, moved) @ asked,
            free=parent.free,
            base=_by_linear_part(parent),
            own=stepped.own.T @ stepped.J,
            gains=gains,
            margins=None if gains is None else gains.loop.margins,
            effects=effects,
            raised=counted(division),
        )

    def needed(self, degrees: int) -> float:
        """Standard errors from which on the diagnosis finds an effect of so many sizes four times in five, by its own
        chance of a false alarm, all effects and kinds of questions counted in, and less sure where no excitation is
        logged."""
        # heavier than NumPy itself to load: only where it is needed
        from scipy.special import chdtri, chndtrinc

        chance = math.exp(SIGNIFICANT - self.raised) / max(self.effects, 1)
        return math.sqrt(float(chndtrinc(chdtri(degrees, chance), degrees, MISSED)))

    def ask(self, effect: Effect, composed: Structure) -> Hidden | None:
        """None where the effect moves nothing, or has no response that settles."""
        known = self.parent.model.by_name
        new = [one for one in composed.parameters if one.name not in known]
        sized = tuple(one for one in new if one.sizes)
        if not sized:
            return None  # all of it is known
        point = _Point(composed, known, new, sized)
        try:
            with np.errstate(all="ignore"):
                found = self._largest(point)
        except (RelaxationError, np.linalg.LinAlgError):
            return None
        if found is None:
            return None
        x, change, visible = found
        told = sorted(range(len(sized)), key=lambda i: -abs(x[i]))[:MOST_SIZES]
        told = sorted(i for i in told if abs(x[i]) >= LEAST_SIZE * np.max(np.abs(x)))
        shift = dict(zip(self.free, map(float, self._shift(change)[0]), strict=True))
        watched = {name: shift[name] / whole(_of(composed, name), known[name]) for name in self._watched(shift)}
        size = {name: value for name, value in point.at(x).items() if name not in known}
        true = {**known, **{name: known[name] - moved for name, moved in shift.items()}, **size}
        vehicle = Model(composed, composed.vector(true))
        return Hidden(
            effect=effect.path or effect.id,
            title=effect.worded(self.parent.dataset.airframe).title,
            size=size,
            sized=tuple(sized[i] for i in told),
            visible=visible,
            shift=shift,
            relative=watched,
            modes=self._moved(point, x, shift),
            margins=self._margins(vehicle),
            distance=self._distance(change),
        )

    def _watched(self, shift: Mapping[str, float]) -> list[str]:
        return [name for name in self.parent.model.structure.base_.watched if name in shift]

    def _largest(self, point: _Point) -> tuple[FloatArray, list[ComplexArray], bool] | None:
        """The largest size that could hide, on the scale where null is 0 and typical 1; the change of the outputs."""
        columns = [self._column(point, unit) for unit in np.eye(len(point.sized))]
        together = [np.stack(parts) for parts in zip(*columns, strict=True)]
        Z = self.whitening(together)
        if not np.all(np.isfinite(Z)) or not np.any(Z):
            return None
        slopes = self._shift(together)
        watched = self._watched(dict.fromkeys(self.free, 0.0))
        values = [self.parent.model[name] for name in watched]
        g = np.array(
            [slopes[:, self.free.index(name)] / max(abs(v), 1e-300) for name, v in zip(watched, values, strict=True)]
        )
        Z1 = self._beyond(Z)
        kept = np.einsum("ij,ij->i", Z1, Z1) > INDEPENDENT * np.einsum("ij,ij->i", Z, Z)
        if not np.all(kept):  # whatever its size, the structure does it too
            x = np.where(kept, 0.0, point.largest_plausible)
            wanted = math.inf
        else:
            x, wanted = self._limit(point, Z1, g)
        if not np.any(x):
            return None
        x, change = self._in_full(point, x, wanted)
        return (x, change, bool(np.all(kept))) if np.any(x) else None

    def _column(self, point: _Point, unit: FloatArray) -> list[ComplexArray]:
        """The change of the outputs with one size, over that size."""
        step = FIRST_STEP if point.composed.linear else FIRST_STEP_NONLINEAR
        for _ in range(DOUBLINGS):
            change = self._change(point, step * unit)
            if point.composed.linear or any(np.any(one) for one in change):
                break
            step *= 2  # a limit beyond all that was flown
        return [one / step for one in change]

    def _limit(self, point: _Point, Z1: FloatArray, g: FloatArray) -> tuple[FloatArray, float]:
        """Sizes that move a watched parameter most, and how far from the structure they are in standard errors."""
        C = instrumental_inverse(Z1, Z1)
        guess = C @ (Z1 @ self.stepped.residual)
        needed = self.needed(len(Z1))
        best, most = np.zeros(len(Z1)), -1.0
        for each in g if np.any(g) else np.eye(len(Z1)):
            spread = math.sqrt(max(float(each @ C @ each), 1e-300))
            for sign in (1.0, -1.0):
                reach = max(sign * float(each @ guess) + UPPER * spread, needed * spread)
                x = point.plausible(sign * reach * (C @ each) / spread**2)
                moved = float(np.max(np.abs(g @ x))) if np.any(g) else float(np.max(np.abs(x)))
                if moved > most:
                    best, most = x, moved
        return best, float(np.linalg.norm(best @ Z1))

    def _in_full(self, point: _Point, x: FloatArray, wanted: float) -> tuple[FloatArray, list[ComplexArray]]:
        """The change of the outputs at that size; where the effect is not linear, at one that is as far as wanted."""
        change = self._change(point, x)
        if math.isinf(wanted):
            return x, change
        reached = self._distance(change)
        if NEAR[0] * wanted <= reached <= NEAR[1] * wanted or reached == 0:
            return x, change
        again = point.plausible(x * float(np.clip(wanted / reached, 0.1, 10.0)))
        closer = self._change(point, again)
        there = self._distance(closer)
        ratio = float(np.max(np.abs(again)) / np.max(np.abs(x)))
        if there == 0 or ratio == 1:
            return again, closer
        slope = math.log(there / reached) / math.log(ratio)
        if slope < SLOPES[0] and there > wanted:
            return np.zeros_like(x), closer  # a part of it has no size, and would be seen
        slope = float(np.clip(slope, *SLOPES))
        times = float(np.clip((wanted / there) ** (1 / slope), 0.1, 10.0))
        last = point.plausible(again * times)
        grown = (float(np.max(np.abs(last))) / float(np.max(np.abs(again)))) ** slope
        return last, [grown * one for one in closer]

    def _distance(self, change: Sequence[ComplexArray]) -> float:
        return float(np.linalg.norm(self._beyond(self.whitening([one[None] for one in change]))))

    def _change(self, point: _Point, x: FloatArray) -> list[ComplexArray]:
        return [one - base for one, base in zip(self._predicted(point, x), self.base, strict=True)]

    def _predicted(self, point: _Point, x: FloatArray) -> list[ComplexArray]:
        values = point.composed.vector(point.at(x))
        return [respond(point.composed, values, group, False).Y for group in self.parent.dataset.imposed]

    def _beyond(self, Z: FloatArray) -> FloatArray:
        """Less what the parent's own parameters would do."""
        return np.asarray(Z - (Z @ self.own.T) @ self.stepped.Z)

    def _shift(self, change: Sequence[ComplexArray]) -> FloatArray:
        """What a change of the outputs does to the fitted parameters, (columns, free)."""
        rows = self.by_fit([one[None] if one.ndim == 2 else one for one in change])
        return np.asarray(rows @ self.answer.T)

    def _moved(self, point: _Point, x: FloatArray, shift: Mapping[str, float]) -> tuple[tuple[Mode, Mode], ...]:
        """Each of the airframe's oscillations, and what becomes of it as the effect grows to its size: followed in
        steps, since the nearest pole at the end may be another's, or the effect's own."""
        here = [mode for mode in self.parent.model.own_modes if mode.pole.imag > 0]
        now = list(here)
        known, composed = self.parent.model.by_name, point.composed
        for part in np.linspace(0.0, 1.0, MODE_STEPS + 1)[1:]:
            values = point.at(part * x)
            values |= {name: known[name] - part * moved for name, moved in shift.items()}
            left = list(Model(composed, composed.vector(values)).modes)
            for i, mode in enumerate(now):
                now[i] = min(left, key=lambda other: abs(other.pole - mode.pole))
                left.remove(now[i])
        return tuple(zip(here, now, strict=True))

    def _margins(self, vehicle: Model) -> tuple[Margins, Margins] | None:
        if self.gains is None or self.margins is None or not vehicle.structure.linear:
            return None
        return self.margins, closed_loop(self.gains, vehicle).margins or NO_MARGINS


def _by_output(parent: Candidate, division: Division) -> Whitening:
    """Each output weighed as a whole."""
    power = np.diag(np.maximum(parent.estimate.error.residual_power, 1e-300))
    flat = replace(division, level=np.broadcast_to(power.astype(complex), division.level.shape))
    return noise_whitening(parent.model, parent.dataset.stacks, flat)


def _by_linear_part(parent: Candidate) -> list[ComplexArray]:
    structure = parent.model.structure
    if structure.linear:
        return parent.Y_imposed
    linear = [one for one in structure.composed if one.linear]
    core = compose(
        structure.base_, linear, parent.dataset.available, dict(structure.constants), outputs=structure.outputs
    )
    values = np.array([parent.model[name] for name in core.names])
    return [respond(core, values, group, False).Y for group in parent.dataset.imposed]


def _of(structure: Structure, name: str) -> Parameter:
    return structure.parameters[structure.names.index(name)]


@dataclass(frozen=True, eq=False)
class _Point:
    """A composition near its parent; sizes x are 0 at the null and 1 at typical, one over the value for a limit."""

    composed: Structure
    known: Mapping[str, float]
    new: Sequence[Parameter]
    sized: tuple[Parameter, ...]

    def at(self, x: FloatArray) -> dict[str, float]:
        values = {**self.known, **{one.name: one.typical for one in self.new}}
        for one, part in zip(self.sized, map(float, x), strict=True):
            null = one.null or 0.0
            if math.isinf(null):
                values[one.name] = one.typical / part if part > 0 else math.inf
            else:
                values[one.name] = null + part * (one.typical - null)
        return values

    def plausible(self, x: FloatArray) -> FloatArray:
        """Moved inside what is plausible."""
        low, high = self._range()
        return np.clip(x, low, high)

    @property
    def largest_plausible(self) -> FloatArray:
        """Of each size, or typical where that has no end."""
        low, high = self._range()
        far = np.where(np.abs(high) >= np.abs(low), high, low)
        return np.where(np.isfinite(far), far, 1.0)

    def _range(self) -> tuple[FloatArray, FloatArray]:
        ends = np.array([[self._scaled(one, value) for value in one.plausible] for one in self.sized])
        return np.minimum(ends.min(axis=1), 0.0), np.maximum(ends.max(axis=1), 0.0)

    def _scaled(self, one: Parameter, value: float) -> float:
        null = one.null or 0.0
        if math.isinf(null):
            return one.typical / value if value else math.inf
        return (value - null) / (one.typical - null)
