"""Bases and effects put together: what can be composed, on which runs, and why something cannot."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from sysid.data.record import CHANNELS, COMMANDS, RATES
from sysid.model.base import Base, bases, find_base
from sysid.model.effect import Effect, EffectError, Surroundings, find
from sysid.model.structure import Structure


def compose(
    base: str | Base,
    effects: Sequence[str | Effect] = (),
    available: Collection[str] = (),
    constants: Mapping[str, float] | None = None,
    *,
    outputs: Sequence[str] | None = None,
) -> Structure:
    """A base with effects, in the order of physics whatever the order they are named in.

    `available` are the channels that every run has; `outputs` are states of the base that are measured, its own choice
    where none are named. `cd` with `flapping` is `tpp`. Raises EffectError where an effect cannot act: twice, on a base
    that contains it, without what it needs, or without its channel; BaseError where there is no such base.
    """
    declared = [one if isinstance(one, Effect) else find(one) for one in effects]
    base, declared = _grown(as_base(base), declared)
    found = _declared(declared, base, available, constants or {})
    _refuse_clashes(base, found)
    measured = base.outputs if outputs is None else _measurable(base, outputs)
    structure = _composed(base, found, available, constants or {}, measured)
    if structure.files:
        _refuse_broken(structure)
    return structure


def _composed(
    base: Base,
    found: Sequence[Effect],
    available: Collection[str],
    constants: Mapping[str, float],
    outputs: tuple[str, ...],
) -> Structure:
    """Effects, as they are declared for each other, in the order of physics, with the channels that they read."""
    ordered = sorted(found, key=lambda one: (one.stage, one.order, one.id))
    needed = [name for one in ordered for name in one.channels]
    wanted = ("phi", "theta") if any(one.attitude for one in ordered) else ()
    attitude = tuple(name for name in wanted if name not in base.states)
    if set(attitude) <= set(available):  # logged, else states of their own
        needed, attitude = [*needed, *attitude], ()
    return Structure(
        base_=base,
        composed=tuple(ordered),
        outputs=outputs,
        commands=tuple(name for name in COMMANDS if name in (*base.commands, *needed)),
        channels=tuple(dict.fromkeys(name for name in needed if name not in (*COMMANDS, *base.states))),
        attitude_states=attitude,
        constants=tuple(sorted(constants.items())),
    )


def as_base(base: str | Base) -> Base:
    """A base as it is, or by its name or path. Raises BaseError."""
    return base if isinstance(base, Base) else find_base(base)


def _grown(base: Base, effects: list[Effect]) -> tuple[Base, list[Effect]]:
    """The base that this one becomes with an effect that only that one contains, and the effects that are left."""
    for larger in bases().values():
        if larger.reduces_to == base.name and any(one.id in larger.contains for one in effects):
            return larger, [one for one in effects if one.id not in larger.contains]
    return base, effects


def _measurable(base: Base, outputs: Sequence[str]) -> tuple[str, ...]:
    """The outputs, each once and a channel of its own. Raises EffectError for what is no state of the base."""
    unknown = [name for name in outputs if name not in base.states or name not in CHANNELS]
    if unknown or not outputs or len(set(outputs)) != len(outputs):
        measurable = ", ".join(name for name in base.states if name in CHANNELS)
        named = ", ".join(outputs) or "none"
        raise EffectError(f"{base.name} can be measured in {measurable}, each once: its outputs cannot be {named}")
    return tuple(outputs)


def _declared(
    effects: Sequence[Effect], base: Base, available: Collection[str], known: Collection[str]
) -> list[Effect]:
    """The effects as they are declared for each other, this base and these runs. Raises EffectError where one cannot
    act."""
    ids = [one.id for one in effects]
    for one in effects:
        if ids.count(one.id) > 1:
            raise EffectError(f"{one.id} is named twice")
        reason = not_testable(one, base, ids, available)
        if reason is not None:
            raise EffectError(f"{one.id} cannot act here: {reason}")
    return [adapted(one, base, ids, available, known) for one in effects]


def _refuse_clashes(base: Base, effects: Sequence[Effect]) -> None:
    """Raises EffectError for effects that stand in each other's way: a slot, a parameter's name or a state twice, one
    that contains another."""
    slots = [one.slot for one in effects if one.slot is not None]
    if len(slots) != len(set(slots)):
        raise EffectError(f"two effects for the same slot: {', '.join(one.id for one in effects if one.slot)}")
    taken, ids = {one.name for one in base.parameters}, {one.id for one in effects}
    for one in effects:
        inside = ids & set(one.contains)
        if inside:
            raise EffectError(f"{one.id} contains {', '.join(sorted(inside))}: name one of them")
        clash = taken & set(one.names)
        if clash:
            raise EffectError(f"{one.id}: the name {', '.join(sorted(clash))} is taken on {base.name}")
        taken |= set(one.names)
    owners: dict[tuple[str, bool], str] = {}
    for one in effects:
        for state in one.states:
            other = owners.setdefault((state, one.per_command), one.id)
            if other != one.id:
                raise EffectError(f"{other} and {one.id} stand for the same part (state {state}): name one of them")


def _refuse_broken(structure: Structure) -> None:
    """Evaluate a composition with a user's base or effects once, so that their slips are said before a fit begins."""
    users = ", ".join(structure.files)
    typical = np.array([one.typical for one in structure.parameters])
    named = structure.by_name(typical)
    try:
        with np.errstate(all="ignore"):
            matrices = structure.matrices(typical)
            for one in structure.composed:
                if one.path is None:
                    continue
                own = {name: named[name] for name in one.names}
                if one.samples is not None:
                    rows = np.zeros((structure.given_to(one), 8))
                    if np.shape(one.samples(rows, 0.002, own)) != rows.shape:
                        raise ValueError("samples must return as many samples as it is given")
                if one.response is not None and np.shape(one.response(np.array([1j, 2j]), own)) not in ((2,), ()):
                    raise ValueError("response must return one factor for each frequency")
    except Exception as error:  # a user's code may fail in any way
        raise EffectError(f"{users}: its equations fail ({type(error).__name__}: {error})") from error
    if not all(np.all(np.isfinite(matrix)) for matrix in matrices):
        raise EffectError(f"{users}: its equations give no finite numbers at their typical parameters")


def adapted(
    effect: Effect,
    base: str | Base,
    others: Collection[str],
    available: Collection[str],
    known: Collection[str] = (),
) -> Effect:
    """The effect as it is declared for this base, with these effects, on runs with these channels and constants."""
    if effect.adapt is None:
        return effect
    composed = tuple(sorted({effect.id, *others}))
    made = effect.adapt(Surroundings(as_base(base).name, composed, frozenset(available), frozenset(known)))
    return made if effect.path is None else replace(made, path=effect.path, sha256=effect.sha256)


def not_testable(effect: Effect, base: str | Base, others: Collection[str], available: Collection[str]) -> str | None:
    """Why an effect cannot act on this base, with these effects, on runs with these channels; None where it can."""
    base = as_base(base)
    effect = adapted(effect, base, others, available)
    if base.name in effect.absorbed_by or effect.id in (*base.contains, *base.absorbs):
        return f"not testable on {base.name}: its parameters are the base's own there"
    for need in effect.needs:
        names = need.split("|")
        if not any(name in others or name in base.contains for name in names):
            return f"it needs {' or '.join(names)}"
    measured = [name for name in effect.unless_logged if name in available]
    if measured:
        return f"{', '.join(measured)} is logged: what it would work out is measured"
    logged = {*base.states, *base.commands, *available}
    missing = [name.replace("|", " or ") for name in effect.channels if logged.isdisjoint(name.split("|"))]
    if missing:
        return f"channel {', '.join(missing)} is not logged on every run, so it is not testable on these"
    if effect.path is None and not effect.needs and not acts_on(effect, base):
        return f"not testable on {base.name}: it acts on motions or parameters that are not in it"
    return None


@cache
def acts_on(effect: Effect, base: Base) -> bool:
    """Whether an effect of the catalogue reads and moves nothing but what a base has, all channels being logged."""
    if not set(effect.replaces) <= {one.name for one in base.parameters}:
        return False
    if set(RATES) <= set(base.states):  # what all entries may count on
        return True
    try:
        structure = _composed(base, [effect], frozenset(CHANNELS), {"Omega_0": 1.0, "V_0": 1.0}, base.outputs)
        structure.matrices(np.array([one.typical for one in structure.parameters]))
    except (AttributeError, KeyError, ValueError):
        return False
    return True
