"""Do gains hold what they will meet: every model that a fit's diagnosis leaves open, against asked limits.

Gains are designed on one fit, and the vehicle may be another: what a diagnosis names as missing, and what it could not
tell from that. Each is a model of its own, in the loop with the same gains; and the fit itself may be off by all that
its bounds say. Beside margins the answer to a doublet of the rate command is judged: a loop may hold and fly badly.

Cross-coupling is asked to be at most ADS-33E-PRF's Level 1 in hover (3.3.9.1: off-axis peak over on-axis 0.25, there of
attitudes). A second-order loop overshoots by as much at 40 degrees of phase margin.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, get_args

from sysid.control.bounds import OverBounds, margins_json, over_bounds
from sysid.control.command_noise import CommandNoise
from sysid.control.controllers import AnyGains, Controller, controller_of
from sysid.control.loop import AxisAnswer
from sysid.control.measured_margins import MeasuredMargins
from sysid.control.robustness import Robustness
from sysid.control.stability import SENSIBLE_GAIN_DB, SENSIBLE_MS, SENSIBLE_PHASE_DEG, ClosedLoop, Margins
from sysid.model.structure import FloatArray, Model

Role = Literal["fit", "missing", "not told apart"]
ROLES: tuple[Role, ...] = get_args(Role)
"""The fit itself; with what its diagnosis names as missing; with what it could not tell from that."""
Quantity = Literal["held", "gain_db", "phase_deg", "delay_ms", "overshoot", "coupling", "peak_db", "noise", "servos"]
Verdict = Literal["holds", "poor", "not measured", "fails"]
"""`fails` where any model is not held or has less margin than asked; `not measured` where measured margins were asked
for and one that the model has lies outside the measured band; `poor` where all have, and an answer overshoots or
couples more than asked, disturbances are raised by more, or move the commands by more."""
REFUSED: tuple[Verdict, ...] = ("fails", "not measured")
"""What is not to be flown."""
OF_DELAY = 0.5
"""Of the delay that a model has: as much more is asked to be held."""
ROUNDING = 1e-3
"""Of gains, as a parameter file has them."""
QUALITY: tuple[Quantity, ...] = ("overshoot", "coupling", "peak_db", "noise", "servos")
"""What makes a loop poor, and does not refuse it."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What is asked of every model."""

    gain_db: float = SENSIBLE_GAIN_DB
    phase_deg: float = SENSIBLE_PHASE_DEG
    delay_ms: float = SENSIBLE_MS
    """Or half of the delay that the model has, where that is more."""
    overshoot: float = 0.25
    """Of the rate asked for;"""
    coupling: float = 0.25
    """the same, of the other axis."""
    peak_db: float = 5.0
    """The most by which a disturbance of a rate may be raised; ADS-33's of disturbance rejection."""
    noise: float = 1.3
    """Of what gusts and gyro noise moved the commands by with the gains that flew, and of how fast."""

    def of(self, model: Model) -> Limits:
        """With at least half of the delay that the model has."""
        return replace(self, delay_ms=max(self.delay_ms, 1000 * OF_DELAY * max(model.input_delay_s)))

    def or_stricter(self, other: Limits) -> Limits:
        """The stricter of each."""
        return Limits(
            gain_db=max(self.gain_db, other.gain_db),
            phase_deg=max(self.phase_deg, other.phase_deg),
            delay_ms=max(self.delay_ms, other.delay_ms),
            overshoot=min(self.overshoot, other.overshoot),
            coupling=min(self.coupling, other.coupling),
            peak_db=min(self.peak_db, other.peak_db),
            noise=min(self.noise, other.noise),
        )

    def to_json(self) -> dict[str, float]:
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class Shortfall:
    """One limit that one model breaks."""

    quantity: Quantity
    value: float | None
    """None of a loop that is not held."""
    limit: float | None

    @property
    def fails(self) -> bool:
        """Whether it refuses; else the vehicle flies poorly."""
        return self.quantity not in QUALITY


@dataclass(frozen=True, eq=False, kw_only=True)
class OnModel:
    """Gains in the loop with one model."""

    role: Role
    model: Model
    loop: ClosedLoop
    answers: tuple[AxisAnswer, AxisAnswer] | None
    """Of roll and pitch to what is asked of their rate; None where it is not held;"""
    robustness: Robustness | None
    """the same."""
    shortfalls: tuple[Shortfall, ...]

    @property
    def overshoot(self) -> float | None:
        """The larger of both axes."""
        return None if self.answers is None else max(one.overshoot for one in self.answers)

    @property
    def coupling(self) -> float | None:
        """The larger of both axes."""
        return None if self.answers is None else max(one.coupling for one in self.answers)

    @property
    def peak_db(self) -> float | None:
        """The larger of both axes."""
        return None if self.robustness is None else max(one.rejection_peak_db for one in self.robustness.handling)

    def to_json(self) -> dict[str, Any]:
        margins = self.loop.margins
        return {
            "role": self.role,
            "model": self.model.structure.title,
            "held": self.loop.stable,
            "margins": None if margins is None else margins_json(margins),
            "overshoot": self.overshoot,
            "coupling": self.coupling,
            "rise_ms": None if self.answers is None else [_ms(one.rise_s) for one in self.answers],
            "robustness": None if self.robustness is None else self.robustness.to_json(),
            "without": list(self.loop.left_out),
            "shortfalls": [asdict(one) for one in self.shortfalls],
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class Judgement:
    """Gains judged on every model that is left open."""

    limits: Limits
    models: tuple[OnModel, ...]
    """The fit first."""
    bounds: OverBounds | None
    """Over what the fit's numbers may be; None where nobody drew any."""
    measured: MeasuredMargins | None = None
    """By measured responses; None where nobody asked."""
    noise: CommandNoise | None = None
    """Of the commands, beside that of the gains that flew; None where that is not known."""

    @property
    def restless(self) -> tuple[Shortfall, ...]:
        """What disturbances move the commands by, beyond what is asked."""
        if self.noise is None:
            return ()
        each: tuple[tuple[Quantity, float | None, float], ...] = (
            ("noise", self.noise.times_flown, self.limits.noise * (1 + ROUNDING)),
            ("servos", self.noise.of_servo_speed, 1.0),
        )
        return tuple(_more(each))

    @property
    def thin_bounds(self) -> tuple[Shortfall, ...]:
        """What is less than asked over the fit's bounds: in any sample not held, in one of 20 thinner."""
        if self.bounds is None:
            return ()
        if self.bounds.not_held or self.bounds.least is None:
            return (Shortfall(quantity="held", value=None, limit=None),)
        return tuple(thin(self.bounds.least, self.limits.of(self.models[0].model)))

    @property
    def thin_measured(self) -> tuple[Shortfall, ...]:
        """What is measured to be less than asked. What is not measured clears nothing, and refuses nothing."""
        if self.measured is None:
            return ()
        at = {
            "gain_db": self.measured.gain_db,
            "phase_deg": self.measured.phase_deg,
            "delay_ms": self.measured.delay_ms,
        }
        gain, phase, delay = (math.inf if one is None else one.value for one in at.values())
        return tuple(thin(Margins(gain, phase, delay / 1000), self.limits.of(self.models[0].model)))

    @property
    def verdict(self) -> Verdict:
        found = [
            *self.thin_bounds,
            *self.thin_measured,
            *self.restless,
            *(one for model in self.models for one in model.shortfalls),
        ]
        if any(one.fails for one in found):
            return "fails"
        if self.measured is not None and self.measured.missing:
            return "not measured"
        return "poor" if found else "holds"

    @property
    def answers_poorly(self) -> bool:
        """Whether it is `poor`, and by its answers."""
        short = (one.quantity for model in self.models for one in model.shortfalls)
        return self.verdict == "poor" and any(one in ("overshoot", "coupling") for one in short)

    @property
    def refused(self) -> bool:
        """Whether nobody is to fly them who does not say why."""
        return self.verdict in REFUSED

    def to_json(self) -> dict[str, Any]:
        """`verdict`, `limits`, `models`."""
        return {
            "verdict": self.verdict,
            "limits": self.limits.to_json(),
            "models": [one.to_json() for one in self.models],
            "bounds": None if self.bounds is None else self.bounds.to_json(),
            "bounds_shortfalls": [asdict(one) for one in self.thin_bounds],
            "measured_shortfalls": [asdict(one) for one in self.thin_measured],
            "measured": None if self.measured is None else self.measured.lacks(),
            "noise": None if self.noise is None else self.noise.to_json(),
            "noise_shortfalls": [asdict(one) for one in self.restless],
        }


def judge(
    gains: AnyGains,
    models: Sequence[tuple[Role, Model]],
    limits: Limits | None = None,
    draws: FloatArray | None = None,
    measured: MeasuredMargins | None = None,
    noise: CommandNoise | None = None,
) -> Judgement:
    """Gains in the loop with each of these models, delays included.

    `draws` (n, parameters) are values of the first model, `measured` the margins by responses without any, `noise` what
    disturbances make of the commands.
    """
    limits, controller = limits or Limits(), controller_of(gains)
    return Judgement(
        limits=limits,
        models=tuple(_on(controller, role, model, limits) for role, model in models),
        bounds=None if draws is None or not len(draws) else over_bounds(gains, models[0][1], draws),
        measured=measured,
        noise=noise,
    )


_NUMBER = r"(\d+\.?\d*|\.\d+)"
_WORDS = {
    rf"{_NUMBER} ?db": ("gain_db", 1.0),
    rf"{_NUMBER} ?(deg|°)": ("phase_deg", 1.0),
    rf"{_NUMBER} ?ms": ("delay_ms", 1.0),
    rf"peak={_NUMBER} ?(db)?": ("peak_db", 1.0),
    rf"noise={_NUMBER}": ("noise", 1.0),
    rf"overshoot={_NUMBER}%?": ("overshoot", 0.01),
    rf"coupling={_NUMBER}%?": ("coupling", 0.01),
}


def parse_limits(words: str) -> Limits:
    """`6dB,45deg,10ms,overshoot=25,coupling=25`, each alone leaving the others as usual. Raises ValueError."""
    given: dict[str, float] = {}
    for word in words.split(","):
        text = word.strip().lower()
        found = next((one for pattern, one in _WORDS.items() if re.fullmatch(pattern, text)), None)
        key, unit = found or ("", 1.0)
        value = unit * float(re.sub(r"[^0-9.]", "", text) or "nan") if found else math.nan
        if key in given or not 0 < value < math.inf:
            raise ValueError(f"{word.strip()!r} is no limit, or one that was given already")
        given[key] = value
    return replace(Limits(), **given)


def _on(controller: Controller, role: Role, model: Model, limits: Limits) -> OnModel:
    loop = controller.held(model)
    answers = controller.answers(model) if loop.stable else None
    holds = controller.robustness(model) if loop.stable else None
    found = OnModel(role=role, model=model, loop=loop, answers=answers, robustness=holds, shortfalls=())
    return replace(found, shortfalls=tuple(_shortfalls(found, limits)))


def _shortfalls(one: OnModel, limits: Limits) -> list[Shortfall]:
    margins = one.loop.margins
    if margins is None:
        return [Shortfall(quantity="held", value=None, limit=None)]
    most: tuple[tuple[Quantity, float | None, float], ...] = (
        ("overshoot", one.overshoot, limits.overshoot),
        ("coupling", one.coupling, limits.coupling),
        ("peak_db", one.peak_db, limits.peak_db),
    )
    return [*thin(margins, limits.of(one.model)), *_more(most)]


def _more(most: Iterable[tuple[Quantity, float | None, float]]) -> list[Shortfall]:
    """What is more than asked."""
    return [
        Shortfall(quantity=q, value=value, limit=limit)
        for q, value, limit in most
        if value is not None and value > limit
    ]


def thin(margins: Margins, limits: Limits) -> list[Shortfall]:
    """The margins that are less than asked."""
    least: tuple[tuple[Quantity, float, float], ...] = (
        ("gain_db", margins.gain_db, limits.gain_db),
        ("phase_deg", margins.phase_deg, limits.phase_deg),
        ("delay_ms", margins.delay_ms, limits.delay_ms),
    )
    return [Shortfall(quantity=q, value=value, limit=limit) for q, value, limit in least if value < limit]


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else 1000 * seconds
