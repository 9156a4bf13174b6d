"""What a base is: a structure before any effect, declared in a file of `bases/` or in one of a user's own."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any

from sysid.data.airframe import ANY, Airframe
from sysid.data.record import CHANNELS, CYCLIC, RATES, axis_of
from sysid.model.bases import NAMES
from sysid.model.declaration import declared_in
from sysid.model.effect import EffectError, Signals
from sysid.model.form import Form
from sysid.model.parameter import Parameter


class BaseError(EffectError):
    """A base that does not exist or cannot be read; whoever composes meets it as any effect that cannot act."""


@dataclass(frozen=True, kw_only=True)
class Base:
    """A structure before any effect. Raises ValueError where its parts do not fit each other."""

    name: str
    """`cd`, `tpp`; in the folder that of its file."""
    title: str
    """In words."""
    states: tuple[str, ...]
    outputs: tuple[str, ...] = RATES
    """Of its states those that are measured, each a channel of the records: what a fit explains."""
    commands: tuple[str, ...] = CYCLIC
    """That its equations read."""
    parameters: tuple[Parameter, ...]
    equations: Callable[[Signals], Mapping[str, Any]]
    """Rates by `<state>_dot`; may define signals that effects read (theta_s, theta_c)."""
    slots: tuple[tuple[str, Callable[[Signals], Mapping[str, Any]]], ...] = ()
    """Parts, by name, that one effect each may stand in for: evaluated after `equations` where none does."""
    uncoupled: tuple[float, ...]
    """A stable point without coupling or control, parameter by parameter, to begin from where the poles are to be held
    stable; and wherever there is no form."""
    contains: tuple[str, ...] = ()
    """Effects whose physics it has already: what needs them may act on it."""
    absorbs: tuple[str, ...] = ()
    """Effects that its own parameters do as well, so that they are not testable on it."""
    airframes: tuple[Airframe, ...] = ANY
    """That can be described so."""
    reduces_to: str | None = None
    """The base that it becomes when the states it has beyond that one's have settled; that one with an effect that this
    one contains is this one."""
    alone: tuple[tuple[str, ...], ...] = ()
    """What it is where one axis alone is fitted: a base and the effects that this one contains."""
    watched: tuple[str, ...] = ()
    """Parameters by which engineers know a vehicle: what hidden effects would do to them is told."""
    rank: int = 9
    """Where it stands among the bases, the simplest first; then the name decides."""
    form: Form | None = field(default=None, compare=False, repr=False)
    """The same equations as a matrix polynomial, which makes fits fast and begins them at the data."""
    path: str | None = None
    """Of a user's base; None in the folder."""
    sha256: str | None = None

    def __post_init__(self) -> None:
        if len(self.uncoupled) != len(self.parameters):
            raise ValueError(f"uncoupled has {len(self.uncoupled)} values for {len(self.parameters)} parameters")
        for name in self.outputs:
            if name not in self.states or name not in CHANNELS:
                raise ValueError(f"the output {name} is not both a state and a channel of the records")

    @property
    def word(self) -> str:
        """What names it: its name, or the path of a user's file."""
        return self.path or self.name

    @property
    def axes(self) -> tuple[str, ...]:
        """Of its commands, in words."""
        return tuple(axis_of(name) for name in self.commands)

    @property
    def label(self) -> str:
        """Short, for tables: `TPP`."""
        return self.name.upper()


@cache
def bases() -> Mapping[str, Base]:
    """Every base in the folder, by name, the simplest first."""
    found: dict[str, Base] = {}
    for stem in NAMES:
        base: Base = importlib.import_module(f"sysid.model.bases.{stem}").BASE
        if base.name != stem:
            raise BaseError(f"{stem}.py declares {base.name}: a base's file bears its name")
        found[stem] = base
    return dict(sorted(found.items(), key=lambda item: (item[1].rank, item[0])))


def find_base(word: str) -> Base:
    """A base by its name, or by the path of a user's file (its code runs). Raises BaseError."""
    known = bases()
    if word in known:
        return known[word]
    if word.endswith(".py"):
        return load_base(Path(word))
    close = get_close_matches(word.lower(), known, 1)
    hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(known)}, and files of your own (.py)"
    raise BaseError(f"no base {word!r}; {hint}")


def on_axes(base: Base, axes: Collection[str]) -> tuple[Base, tuple[str, ...]]:
    """What a base is on these axes alone, and the effects to compose onto that.

    Raises BaseError where it has no such part.
    """
    if set(axes) == set(base.axes):
        return base, ()
    parts = [(find_base(name), tuple(effects)) for name, *effects in base.alone]
    for part, effects in parts:
        if set(axes) in ({part.name}, set(part.axes)):
            return part, effects
    able = " or ".join([",".join(base.axes), *(part.name for part, _ in parts)])
    others = [
        one.name
        for one in bases().values()
        if any({*axes} in ({name}, {*find_base(name).axes}) for name, *_ in one.alone)
    ]
    hint = f"; --model {others[0]} can" if others else ""
    raise BaseError(f"{base.label} is fitted on {able}, not on {','.join(axes)}{hint}")


def load_base(path: Path, sha256: str | None = None) -> Base:
    """A user's base: a Python file that defines BASE. Raises BaseError for a file that does not, and before its code
    runs where it is not of this `sha256`."""
    base, found = declared_in(path, Base, BaseError, sha256)
    if base.name in bases():
        raise BaseError(f"{path}: the name {base.name} is taken: give the base one of its own")
    return replace(base, path=str(path), sha256=found)
