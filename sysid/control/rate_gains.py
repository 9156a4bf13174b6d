"""Better gains for an autopilot's own rate loops: the fastest within asked limits, near those that were flown.

Only P, I and D move, each by a factor of its own, and filters, angle gain and limits stay as flown. I falls no further
than P: how fast a steady disturbance is taken up shows in no bandwidth of its rejection. The feed-forward is
no feedback: it is set first, from how fast the vehicle turns for a command, and is in the loop that is judged, because
an angle that is held asks for rates. Margins must be there on every model that is left open, and over the fit's bounds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.control.bounds import bounds_of
from sysid.control.command_noise import CommandNoise, RateDisturbance
from sysid.control.judgement import Limits, thin
from sysid.control.loop import AXES
from sysid.control.regulator import DesignError
from sysid.control.sampled import RateController, SampledLoop, SampledVehicle
from sysid.control.stability import Margins
from sysid.model.structure import FloatArray, Model
from sysid.rate_loop.settings import AxisLoop

MOST = 1.3
"""Of a flown gain: what one flight's model vouches for."""
STEP = MOST**0.5
LEAST_STEP = -16
"""About a tenth."""
MOST_STEP = 2
ROUNDS = 12
UNTURNED = 1e-9
"""rad/s per full command."""
TUNED = ("p", "i", "d")
BACK_OFFS = 8
"""How often more is asked of the fit, so that its bounds have what was asked."""
LEAST_MORE = Margins(0.2, 1.0, 0.0005)
"""At least, beside what the bounds fell short by;"""
NOT_HELD_MORE = Margins(2.0, 10.0, 0.0)
"""and where samples are not held at all."""
_P_I_D_AND_P_WITH_I = ((0,), (1,), (2,), (0, 1))
MOVED = tuple(
    tuple(at + axis for axis in axes for at in gains) for gains in _P_I_D_AND_P_WITH_I for axes in ((0,), (3,), (0, 3))
)
"""Which factors are moved at once."""
Loops = tuple[AxisLoop, AxisLoop]
Steps = tuple[int, ...]
"""Of p, i, d of roll, then of pitch: exponents of `STEP`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RateGains:
    """The flown loops and new ones, both on the first model."""

    flown: RateController
    new: RateController
    flown_loop: SampledLoop
    new_loop: SampledLoop
    asked: Limits
    """Of the first model: with half of its delay, and what the flown loop raised disturbances by where that is more."""


def share(asked: Limits, loop: SampledLoop) -> float:
    """Of what is asked, the part that a loop has where it has least; 1 and more where it has all."""
    margins = loop.margins
    if margins is None:
        return 0.0
    return min(
        margins.gain_db / asked.gain_db,
        margins.phase_deg / asked.phase_deg,
        margins.delay_ms / asked.delay_ms,
        asked.peak_db / max(loop.peak_db, 1e-9),
    )


def faster(
    flown: RateController,
    models: Sequence[Model],
    *,
    limits: Limits | None = None,
    feed_forward: Mapping[int, float] | None = None,
    draws: FloatArray | None = None,
    noise: RateDisturbance | None = None,
) -> RateGains:
    """The gains of which disturbances of both rates are rejected up to the highest frequencies, within limits.

    `models`: the fit, and what else the vehicle may be; `draws` (n, parameters): what the fit's numbers may be.
    `noise`: what disturbs the first model's rates, which moves the commands by no more than asked of the flown ones.
    `feed_forward`: by axis (0, 1), full command per rad/s; it is taken to at most `MOST` times the flown one. Steps
    overshoot and couple no more than asked or than with the flown gains, where any gains can. Raises DesignError where
    no gains near the flown ones have the margins, and NotSampledError as `sampled_plant` does.
    """
    told = feed_forward or {}
    roll, pitch = (
        replace(loop, ff=min(MOST * loop.ff, told.get(axis, loop.ff))) for axis, loop in enumerate(flown.loops)
    )
    search = _Search(flown, (roll, pitch), models, limits or Limits(), noise)
    search.require_turned()
    samples = [flown.vehicle(Model(models[0].structure, values)) for values in (() if draws is None else draws)]
    best = search.best()
    for _ in range(BACK_OFFS if samples else 0):
        law = search.controller(best)
        short = _short(search.asked[0], [law.on(one).margins for one in samples])
        if short is None:
            break
        search.ask_more(best, short)
        best = search.best()
    return RateGains(
        flown=flown,
        new=search.controller(best),
        flown_loop=search.as_flown[0],
        new_loop=search.on(best)[0],
        asked=search.asked[0],
    )


def _short(asked: Limits, found: Sequence[Margins | None]) -> Margins | None:
    """By how much the samples fall short of what is asked; None where they do not."""
    bounds = bounds_of(found)
    if bounds.not_held or bounds.least is None:
        return NOT_HELD_MORE
    if not thin(bounds.least, asked):
        return None
    least = bounds.least
    return Margins(
        max(0.0, asked.gain_db - least.gain_db),
        max(0.0, asked.phase_deg - least.phase_deg),
        max(0.0, asked.delay_ms - least.delay_ms) / 1000,
    )


class _Search:
    """Gains by steps, each judged once on every model."""

    def __init__(
        self,
        flown: RateController,
        begun: Loops,
        models: Sequence[Model],
        limits: Limits,
        noise: RateDisturbance | None,
    ) -> None:
        self._flown, self._begun, self._limits = flown, begun, limits
        self._titles = [one.structure.title for one in models]
        self._vehicles: list[SampledVehicle] = [flown.vehicle(one) for one in models]
        self.as_flown = [flown.on(one) for one in self._vehicles]
        self.asked = [
            replace(limits.of(one), peak_db=max(limits.peak_db, loop.peak_db if loop.held else 0.0))
            for one, loop in zip(models, self.as_flown, strict=True)
        ]
        self._first_asked = self.asked[0]
        self._noise = noise if self.as_flown[0].held else None
        self._flown_noise = None if self._noise is None else self._noise.commands(flown, self._vehicles[0])
        self._known: dict[Steps, list[SampledLoop]] = {}
        self._kind: dict[Steps, bool] = {}
        self._most = [
            [max(most, getattr(one, name)) for one in flown.steps(self._vehicles[0])]
            for name, most in (("overshoot", limits.overshoot), ("coupling", limits.coupling))
        ]

    def require_turned(self) -> None:
        """Raises DesignError for a model that commands do not turn: no gains are better than others on it."""
        for vehicle, title in zip(self._vehicles, self._titles, strict=True):
            for axis, name in enumerate(AXES):
                if not np.any(np.abs(vehicle.on_grid[:, axis]) > UNTURNED):
                    raise DesignError(
                        f"no command turns the {name} axis of {title}: no gains are designed on it; fit sweeps of both "
                        "axes"
                    )

    def controller(self, steps: Steps) -> RateController:
        return replace(self._flown, loops=_scaled(self._begun, steps))

    def on(self, steps: Steps) -> list[SampledLoop]:
        """The loops with each model."""
        if steps not in self._known:
            law = self.controller(steps)
            self._known[steps] = [law.on(one) for one in self._vehicles]
        return self._known[steps]

    def ask_more(self, best: Steps, short: Margins) -> None:
        """Of the first model, on which these gains have less than its bounds need."""
        has = self.on(best)[0].margins
        assert has is not None
        self._first_asked = replace(
            self._first_asked,
            **{
                name: getattr(has, name) + getattr(short, name) + getattr(LEAST_MORE, name)
                for name in ("gain_db", "phase_deg", "delay_ms")
                if getattr(short, name) > 0
            },
        )

    def best(self) -> Steps:
        """Raises DesignError where none has what is asked."""
        return self._climbed(kind=True) or self._climbed(kind=False) or self._refuse()

    def _climbed(self, *, kind: bool) -> Steps | None:
        alike: list[Steps] = [(step,) * 6 for step in range(MOST_STEP, LEAST_STEP - 1, -1)]
        best = self._first(alike, -np.inf, kind=kind)
        for _ in range(ROUNDS):
            better = None if best is None else self._first(_neighbours(best), self._worth(best), kind=kind)
            if better is None:
                break
            best = better
        return best if best is not None and self._worth(best) >= 0 else None

    def _first(self, steps: Iterable[Steps], beyond: float, *, kind: bool) -> Steps | None:
        """The best of them that is better than that; `kind` of those that answer steps well enough."""
        ordered = sorted(((self._worth(one), one) for one in steps), key=lambda one: -one[0])
        return next((one for worth, one in ordered if worth > beyond and not (kind and not self._is_kind(one))), None)

    def _worth(self, steps: Steps) -> float:
        """Hz, geometric mean of both axes on the worst model; without the margins negative, the more the more is
        short."""
        loops = self.on(steps)
        asked = [self._first_asked, *self.asked[1:]]
        least = min(share(one, loop) for one, loop in zip(asked, loops, strict=True))
        return min(float(np.sqrt(np.prod(one.rejection_hz))) for one in loops) if least >= 1 else least - 1

    def _is_kind(self, steps: Steps) -> bool:
        """Whether the first model's steps overshoot and couple no more than asked, or than with the flown gains, and
        its commands move no more than asked."""
        if steps not in self._kind:
            loop = self.on(steps)[0]
            answers = self.controller(steps).steps(self._vehicles[0]) if loop.held else ()
            self._kind[steps] = loop.held and all(
                getattr(one, name) <= most + 1e-9
                for name, each in zip(("overshoot", "coupling"), self._most, strict=True)
                for one, most in zip(answers, each, strict=True)
            )
            self._kind[steps] = self._kind[steps] and self._is_quiet(steps)
        return self._kind[steps]

    def _is_quiet(self, steps: Steps) -> bool:
        if self._noise is None or self._flown_noise is None:
            return True
        own = self._noise.commands(self.controller(steps), self._vehicles[0])
        found = CommandNoise(own=own, flown=self._flown_noise)
        return (found.times_flown or 0.0) <= self._limits.noise + 1e-9

    def _refuse(self) -> Steps:
        """Raises DesignError, of the model on which the flown gains have least."""
        shares = [share(asked, loop) for asked, loop in zip(self.asked, self.as_flown, strict=True)]
        worst = int(np.argmin(shares))
        raise DesignError(
            _refusal(self.asked[worst], self.as_flown[worst], self._titles[worst], self._first_asked != self.asked[0])
        )


def _neighbours(steps: Steps) -> Iterator[Steps]:
    """One factor moved, or that of P and I, of one axis or both."""
    for way in (-2, -1, 1, 2):
        for moved in MOVED:
            new = tuple(step + way if i in moved else step for i, step in enumerate(steps))
            quick_integrators = new[1] >= new[0] and new[4] >= new[3]
            if max(new) <= MOST_STEP and min(new) >= LEAST_STEP and quick_integrators:
                yield new


def _scaled(loops: Loops, steps: Steps) -> Loops:
    roll, pitch = (
        replace(loop, **{name: STEP**step * getattr(loop, name) for name, step in zip(TUNED, own, strict=True)})
        for loop, own in zip(loops, (steps[:3], steps[3:]), strict=True)
    )
    return roll, pitch


def _refusal(asked: Limits, flown: SampledLoop, title: str, over_bounds: bool) -> str:
    has = (
        "the flown gains do not hold this model" if flown.margins is None else f"those flown have {flown.margins.words}"
    )
    where = f"on {title}" + (" over the fit's bounds" if over_bounds else "")
    return (
        f"no gains between {STEP**LEAST_STEP:.1f} and {MOST:g} times the flown ones have the margins asked for "
        f"({asked.gain_db:g} dB, {asked.phase_deg:g}°, {asked.delay_ms:.0f} ms, no disturbance by more than "
        f"{asked.peak_db:.1f} dB) {where}: {has}; less delay, higher filter "
        "corners or a lower angle gain come first, or the model is not the vehicle's: `tippath diagnose` it"
    )
