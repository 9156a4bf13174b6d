"""What a physical effect is: a declaration and one pure function, composed with others in the order of physics.

`equations(s)` writes the effect in the paper's letters. It is evaluated three ways without the author's help: on unit
vectors, which gives the matrices of a linear structure; on unit vectors with a complex step, which gives their exact
derivatives; and on whole time histories, which gives nonlinear and time-varying responses. So it may use arithmetic,
powers and NumPy's elementwise functions, and no branches on values; `magnitude` is |x| for all three.

It returns a mapping. A key ending in `_dot` is *added* to that state's rate. Any other key *redefines* the signal or
the parameter of that name for all that comes after.
"""

from __future__ import annotations

import enum
import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from sysid.data.airframe import ANY, Airframe
from sysid.data.record import FloatArray
from sysid.errors import SysidError
from sysid.model.declaration import declared_in
from sysid.model.parameter import Parameter


class EffectError(SysidError):
    """An effect that does not exist, cannot be read, or cannot act on this base or these data."""


class Stage(enum.IntEnum):
    """When an effect acts within one instant; within a stage `order` decides, then the id."""

    SCHEDULE = 0
    """Redefines parameters with the flight condition."""
    COMMAND = 1
    """Between the logged command and the swashplate."""
    DYNAMICS = 2
    """Adds to the rates of the vehicle's states."""
    INERTIA = 3
    """Redefines p_dot and q_dot once all moments are known."""
    MEASUREMENT = 4
    """Redefines the measured rates p_m and q_m."""


class Signals:
    """The names an effect may read: parameters, states, commands, channels, the rates summed so far, constants.

    Constants: `g` (m/s^2), `Omega_0` (rad/s) and `V_0` (m/s), the means over the fitted runs where they are logged; and
    what the runs' settings tell of filters (`sysid.data.gyro_settings`).
    """

    def __init__(self, values: dict[str, Any]) -> None:
        self._values = values

    def __getattr__(self, name: str) -> Any:
        try:
            return self._values[name]
        except KeyError:
            raise AttributeError(name) from None

    def has(self, name: str) -> bool:
        """Whether this composition has a parameter, state, channel or constant of that name."""
        return name in self._values


def magnitude(x: Any) -> Any:
    """`|x|` that a complex step passes through: it has the derivative sign(x)."""
    return np.sqrt(x * x)


Equations = Callable[[Signals], Mapping[str, Any]]


@dataclass(frozen=True)
class Surroundings:
    """What an effect is composed into."""

    base: str
    """Its name: `cd`, `tpp`, or one of a user's own."""
    effects: tuple[str, ...]
    """Ids of all effects composed, its own too, sorted."""
    available: frozenset[str]
    """Channels that every run has."""
    known: frozenset[str] = frozenset()
    """Constants of these runs, by name: means, and what their settings tell."""


@dataclass(frozen=True, slots=True)
class Words:
    """What an effect is called on another airframe than the one it was written for."""

    title: str
    source: str


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One entry of the catalogue."""

    id: str
    title: str
    group: str
    """rotor, fuselage, forward, actuators, sensors, or user."""
    equation: str
    """For people, in the paper's letters."""
    source: str
    signature: str
    """What the residual looks like where the effect is missing."""
    parameters: tuple[Parameter, ...]
    stage: Stage
    equations: Equations | None = None
    states: tuple[str, ...] = ()
    """Its own; each needs a `<state>_dot`."""
    channels: tuple[str, ...] = ()
    """That the log must have; a member may name alternatives as `a|b`, and `adapt` then chooses."""
    unless_logged: tuple[str, ...] = ()
    """Channels that measure what it would have to work out: on runs that have one it is not asked."""
    attitude: bool = False
    """Reads phi and theta: logged ones where there are, else integrated from p and q."""
    needs: tuple[str, ...] = ()
    """Effects that must be there too; a tuple's member may name alternatives as `a|b`."""
    airframes: tuple[Airframe, ...] = ANY
    """That can have it, as it is written here: on others it is not offered."""
    on_multirotor: Words | None = None
    """For people, where those of a helicopter are wrong there."""
    contains: tuple[str, ...] = ()
    """Entries that it is at certain values of its own: it stands beside none of them, and where it explains no more
    than one it is no other answer."""
    same_as: tuple[str, ...] = ()
    """Entries whose equations do the same to all that is measured, on a linear vehicle whose commands pass alike."""
    made_of: tuple[tuple[str, str], ...] = ()
    """Pairs of other entries that may do together nearly what it does: where both are as likely, runs do not tell."""
    absorbed_by: tuple[str, ...] = ()
    """Bases that contain it already, beside those that say so themselves."""
    replaces: tuple[str, ...] = ()
    """Parameters of the base that it does away with."""
    slot: str | None = None
    """The part of the base that it stands in for instead of adding to it (`rotor`)."""
    order: float = 0.0
    linear: bool = True
    """Whether the response stays linear in states and inputs with constant coefficients."""
    per_command: bool = False
    """`equations` is written for one command `delta` with states of its own, and repeated for every command."""
    samples: Callable[[FloatArray, float, Mapping[str, float]], FloatArray] | None = None
    """For what equations cannot say (play, limits): commands (c, n), dt in s, parameters -> acting samples (c, n).

    Absolute commands, not centred; rows in the structure's order, delta_x and delta_y first. The result is held over
    each sample.
    """
    spares_others: bool = False
    """Whether `samples` is given the base's own commands alone, and those that another effect reads act as they are."""
    rests_within: str | None = None
    """The parameter that says how far from the command `samples` may hold still, as it may have before a run began."""
    response: Callable[[Any, Mapping[str, Any]], Any] | None = None
    """For what no finite state can say (delay): frequency response of every command at s = j omega."""
    adapt: Callable[[Surroundings], Effect] | None = None
    """The declaration that fits the logged channels and the other effects, where one declaration cannot fit all.

    Equal surroundings must give the same object (`functools.cache`), so that equal structures compare equal.
    """
    start: Callable[[Mapping[str, float], Mapping[str, float]], Mapping[str, float]] | None = None
    """Where to begin, from the parent's parameter values and the constants; without it, `typical` and the grids."""
    null_tolerance: float = 1e-9
    """At the null, or 1e-9 of typical from one that divides by zero, the response is the base's to this tolerance."""
    acts_at_null: bool = False
    """Whether a part of it has no parameter, so that it does something with all of them at their nulls."""
    path: str | None = None
    """Of a user's effect; None in the catalogue."""
    sha256: str | None = field(default=None)

    def __hash__(self) -> int:
        return hash((self.id, self.path))  # of all that it declares it took a hundredth of a diagnosis

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    def can_be_on(self, airframe: Airframe | None) -> bool:
        """Whether such an airframe can have it; an unknown one can have all that a helicopter can."""
        return (airframe or Airframe.HELICOPTER) in self.airframes

    def worded(self, airframe: Airframe | None) -> Effect:
        """With its words for people as they are right on this airframe."""
        words = self.on_multirotor
        if words is None or airframe is not Airframe.MULTIROTOR:
            return self
        return replace(self, title=words.title, source=words.source)

    @property
    def has_null(self) -> bool:
        return any(parameter.null is not None for parameter in self.parameters)


FOLDER = Path(__file__).parents[1] / "effects"


@cache
def catalogue() -> Mapping[str, Effect]:
    """Every effect in the folder, by id, in the order of groups and ids."""
    found: dict[str, Effect] = {}
    for path in sorted(FOLDER.glob("[a-z]*.py")):
        effect: Effect = importlib.import_module(f"sysid.effects.{path.stem}").EFFECT
        if effect.id != path.stem:
            raise EffectError(f"{path.name} declares {effect.id}: an effect's file bears its id")
        found[effect.id] = effect
    groups = ("rotor", "fuselage", "forward", "actuators", "sensors")
    return dict(sorted(found.items(), key=lambda item: (groups.index(item[1].group), item[0])))


def parts_of(name: str) -> tuple[tuple[str, str], ...]:
    """Pairs of entries that an entry may be made of; none of a user's own."""
    known = catalogue().get(name)
    return () if known is None else known.made_of


def tied(names: Iterable[str]) -> frozenset[str]:
    """Parameters of these entries that physics allows none of in free flight: on a tether or a stand there may be."""
    known = [catalogue()[name] for name in names if name in catalogue()]
    return frozenset(each.name for effect in known for each in effect.parameters if each.tied)


def find(word: str) -> Effect:
    """A catalogue id, or the path of a user's effect file (its code runs). Raises EffectError."""
    known = catalogue()
    if word in known:
        return known[word]
    if word.endswith(".py"):
        return load(Path(word))
    plain = word.replace("-", "_").lower()
    close = [name for name in known if plain in name] or get_close_matches(plain, known, 3)
    hint = f"; did you mean {', '.join(close)}" if close else "; `tippath effects` lists them"
    raise EffectError(f"no effect {word!r}{hint}")


def load(path: Path, sha256: str | None = None) -> Effect:
    """A user's effect: a Python file that defines EFFECT. Raises EffectError for a file that does not, and before its
    code runs where it is not of this `sha256`."""
    effect, found = declared_in(path, Effect, EffectError, sha256)
    return replace(effect, path=str(path), sha256=found)


def named_effect(name: str, users: Sequence[Effect]) -> Effect:
    """An effect of the catalogue by its id, or one of a user's own by its path."""
    known = catalogue()
    return known[name] if name in known else next(effect for effect in users if effect.path == name)


def at_null(effect: Effect) -> dict[str, float]:
    """Parameter values at which the base is unchanged; infinite ones stay infinite, ones without a null are typical."""
    return {
        parameter.name: parameter.typical if parameter.null is None else parameter.null
        for parameter in effect.parameters
    }
