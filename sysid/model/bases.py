"""The paper's structures as compositions: Cylinder Dynamics (eq. 8-9), Tip-Path Plane (eq. 5-7), and effects on them.

Symbols are Table 4's, free of Omega: tau_f = tau_fn/Omega, A_b = A_bn/Omega^2, B_a = B_an/Omega^2. Forward flight
(eq. 15-16) is the TPP with `angular_damping` and `elevator`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.data.record import COMMANDS
from sysid.model.effect import Effect, EffectError, Signals, Surroundings, find
from sysid.model.parameter import Parameter
from sysid.model.structure import Base, Model, Structure


def _tpp_equations(s: Signals) -> Mapping[str, Any]:
    theta_s = s.A_lat * s.delta_x + s.A_lon * s.delta_y
    theta_c = s.B_lat * s.delta_x + s.B_lon * s.delta_y
    return {"theta_s": theta_s, "theta_c": theta_c, "p_dot": s.L_b * s.b, "q_dot": s.M_a * s.a}


def _tpp_rotor(s: Signals) -> Mapping[str, Any]:
    return {
        "a_dot": -s.q + (-s.a + s.A_b * s.b + s.theta_s) / s.tau_f,
        "b_dot": -s.p + (-s.b + s.B_a * s.a + s.theta_c) / s.tau_f,
    }


TPP_BASE = Base(
    name="tpp",
    states=("p", "q", "a", "b"),
    parameters=(
        Parameter("L_b", "1/s^2", "roll acceleration per lateral flapping", (10.0, 1e4), typical=150.0),
        Parameter("M_a", "1/s^2", "pitch acceleration per longitudinal flapping", (10.0, 1e4), typical=700.0),
        Parameter("tau_f", "s", "time constant of the tip-path plane", (0.005, 0.5), typical=0.09),
        Parameter("A_b", "-", "longitudinal flapping from lateral", (-5.0, 5.0), typical=-1.3),
        Parameter("B_a", "-", "lateral flapping from longitudinal", (-5.0, 5.0), typical=1.4),
        Parameter("A_lat", "rad", "longitudinal flapping per roll cyclic", (-5.0, 5.0), typical=-0.3),
        Parameter("A_lon", "rad", "longitudinal flapping per pitch cyclic", (0.0, 5.0), typical=0.3),
        Parameter("B_lat", "rad", "lateral flapping per roll cyclic", (0.0, 5.0), typical=0.5),
        Parameter("B_lon", "rad", "lateral flapping per pitch cyclic", (-5.0, 5.0), typical=-0.05),
    ),
    equations=_tpp_equations,
    slots=(("rotor", _tpp_rotor),),
    uncoupled=(150.0, 150.0, 0.1, 0, 0, 0, 0.1, 0.1, 0),
)


def _cd_equations(s: Signals) -> Mapping[str, Any]:
    return {
        "p_dot": s.L_p * s.p + s.L_q * s.q + s.L_lat * s.delta_x + s.L_lon * s.delta_y,
        "q_dot": s.M_p * s.p + s.M_q * s.q + s.M_lat * s.delta_x + s.M_lon * s.delta_y,
    }


CD_BASE = Base(
    name="cd",
    states=("p", "q"),
    parameters=(
        Parameter("L_p", "1/s", "roll damping"),
        Parameter("L_q", "1/s", "roll acceleration per pitch rate"),
        Parameter("M_p", "1/s", "pitch acceleration per roll rate"),
        Parameter("M_q", "1/s", "pitch damping"),
        Parameter("L_lat", "1/s^2", "roll acceleration per roll cyclic"),
        Parameter("L_lon", "1/s^2", "roll acceleration per pitch cyclic"),
        Parameter("M_lat", "1/s^2", "pitch acceleration per roll cyclic"),
        Parameter("M_lon", "1/s^2", "pitch acceleration per pitch cyclic"),
    ),
    equations=_cd_equations,
    slots=(),
    uncoupled=(-5.0, 0, 0, -5.0, 0, 0, 0, 0),
)
BASES = {"cd": CD_BASE, "tpp": TPP_BASE}


def compose(
    base: str,
    effects: Sequence[str | Effect] = (),
    available: Collection[str] = (),
    constants: Mapping[str, float] | None = None,
) -> Structure:
    """A base with effects, in the order of physics whatever the order they are named in.

    `available` are the channels that every run has. `cd` with `flapping` is `tpp`. Raises EffectError where an effect
    cannot act: twice, on a base that contains it, without what it needs, or without its channel.
    """
    declared = [one if isinstance(one, Effect) else find(one) for one in effects]
    if base == "cd" and any(one.id == "flapping" for one in declared):
        declared = [one for one in declared if one.id != "flapping"]
        base = "tpp"
    found = _declared(declared, base, available)
    _refuse_clashes(BASES[base], found)
    ordered = sorted(found, key=lambda one: (one.stage, one.order, one.id))
    needed = [name for one in ordered for name in one.channels]
    attitude = ("phi", "theta") if any(one.attitude for one in ordered) else ()
    if set(attitude) <= set(available):  # logged, else states of their own
        needed, attitude = [*needed, *attitude], ()
    structure = Structure(
        base_=BASES[base],
        composed=tuple(ordered),
        commands=tuple(name for name in COMMANDS if name in ("delta_x", "delta_y", *needed)),
        channels=tuple(dict.fromkeys(name for name in needed if name not in COMMANDS)),
        attitude_states=attitude,
        constants=tuple(sorted((constants or {}).items())),
    )
    if any(one.path is not None for one in ordered):
        _refuse_broken(structure)
    return structure


def _declared(effects: Sequence[Effect], base: str, available: Collection[str]) -> list[Effect]:
    """The effects as they are declared for each other, this base and these runs. Raises EffectError where one cannot
    act."""
    ids = [one.id for one in effects]
    for one in effects:
        if ids.count(one.id) > 1:
            raise EffectError(f"{one.id} is named twice")
        reason = not_testable(one, base, ids, available)
        if reason is not None:
            raise EffectError(f"{one.id} cannot act here: {reason}")
    return [adapted(one, base, ids, available) for one in effects]


def _refuse_clashes(base: Base, effects: Sequence[Effect]) -> None:
    """Raises EffectError for effects that stand in each other's way: a slot, a parameter's name or a state twice."""
    slots = [one.slot for one in effects if one.slot is not None]
    if len(slots) != len(set(slots)):
        raise EffectError(f"two effects for the same slot: {', '.join(one.id for one in effects if one.slot)}")
    taken = {one.name for one in base.parameters}
    for one in effects:
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
    """Evaluate a composition with users' effects once, so that their slips are said before a fit begins."""
    users = ", ".join(one.path for one in structure.composed if one.path is not None)
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
                    rows = np.zeros((len(structure.commands), 8))
                    if np.shape(one.samples(rows, 0.002, own)) != rows.shape:
                        raise ValueError("samples must return as many samples as it is given")
                if one.response is not None and np.shape(one.response(np.array([1j, 2j]), own)) not in ((2,), ()):
                    raise ValueError("response must return one factor for each frequency")
    except Exception as error:  # a user's code may fail in any way
        raise EffectError(f"{users}: its equations fail ({type(error).__name__}: {error})") from error
    if not all(np.all(np.isfinite(matrix)) for matrix in matrices):
        raise EffectError(f"{users}: its equations give no finite numbers at their typical parameters")


def adapted(effect: Effect, base: str, others: Collection[str], available: Collection[str]) -> Effect:
    """The effect as it is declared for this base, with these effects, on runs with these channels."""
    if effect.adapt is None:
        return effect
    made = effect.adapt(Surroundings(base, tuple(sorted({effect.id, *others})), frozenset(available)))
    return made if effect.path is None else replace(made, path=effect.path, sha256=effect.sha256)


def not_testable(effect: Effect, base: str, others: Collection[str], available: Collection[str]) -> str | None:
    """Why an effect cannot act on this base, with these effects, on runs with these channels; None where it can."""
    effect = adapted(effect, base, others, available)
    if base in effect.absorbed_by:
        return f"not testable on {base}: its parameters are the base's own there"
    for need in effect.needs:
        names = need.split("|")
        if not any(name in others or (name == "flapping" and base == "tpp") for name in names):
            return f"it needs {' or '.join(names)}"
    logged = {"delta_x", "delta_y", *available}
    missing = [name.replace("|", " or ") for name in effect.channels if logged.isdisjoint(name.split("|"))]
    if missing:
        return f"channel {', '.join(missing)} is not logged on every run, so it is not testable on these"
    return None


CD = compose("cd")
"""Eq. 8-9, states p, q, eight parameters."""
TPP = compose("tpp")
"""Eq. 5-7, states p, q, a, b, nine parameters."""


def reduce_to_cd(model: Model) -> Model:
    """The Cylinder-Dynamics model that a TPP model becomes when its flapping has settled (section 3.3).

    Setting a' = b' = 0 and solving for a and b; raises ValueError where they have no steady state.
    """
    A, B, _, _ = model.matrices
    slow, fast = slice(0, 2), slice(2, 4)
    try:
        settled = -np.linalg.solve(A[fast, fast], np.hstack([A[fast, slow], B[fast]]))
    except np.linalg.LinAlgError as error:
        raise ValueError("this model's flapping has no steady state") from error
    A_cd = A[slow, slow] + A[slow, fast] @ settled[:, :2]
    B_cd = B[slow] + A[slow, fast] @ settled[:, 2:]
    return Model(CD, np.concatenate([A_cd.ravel(), B_cd.ravel()]))
