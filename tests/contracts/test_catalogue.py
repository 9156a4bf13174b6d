"""Every effect of the catalogue, whatever it is, keeps the same promises; one walk over the folder."""

from __future__ import annotations

import math
import re
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planted import fly
from planted_fits import records

import sysid.model.effect
from gcs.analysis.fits import PAPER_PARAMETERS
from sysid.data.airframe import Airframe
from sysid.data.dataset import prepared
from sysid.data.record import CHANNELS
from sysid.model.compose import compose, not_testable
from sysid.model.effect import FOLDER, Effect, EffectError, Signals, Stage, catalogue, find, load
from sysid.model.paper import CD, TPP
from sysid.model.predict import respond
from sysid.model.structure import COMPLEX_STEP, FloatArray, Matrices, Model, Structure, stepped

IDS = [
    "flapping", "second_order_flapping", "dynamic_inflow", "rotor_speed", "hub_gyroscopics", "disc_incidence",
    "angular_damping", "quadratic_damping", "attitude_stiffness", "speed_stability", "inertia_coupling", "yaw_coupling",
    "structural_mode", "input_coupling", "elevator", "angle_of_attack", "sideslip", "airspeed_scaling",
    "servo_lag", "servo_second_order", "transport_delay", "servo_rate_limit", "servo_saturation", "servo_deadband",
    "servo_backlash", "gyro_lag", "gyro_misalignment", "gyro_filter", "motor_lag", "swashplate_phase",
    "stabiliser_bar", "lead_lag", "slipstream_wing", "governor", "lag_per_axis",
    "servo_acceleration_limit",
]  # fmt: skip
"""What users, files and JSON name: it may grow and never shrinks. A new effect needs no line here: what it declares is
held against what it does, as for these; these besides against what is known of them, below."""

NEED_A_DISC = {
    "second_order_flapping", "dynamic_inflow", "rotor_speed", "disc_incidence", "speed_stability", "inertia_coupling",
    "lead_lag", "slipstream_wing", "governor",
}  # fmt: skip
ABSORBED_BY_BOTH = {"swashplate_phase"}
ABSORBED_BY_CD = {"angular_damping", "hub_gyroscopics", "gyro_misalignment"} | ABSORBED_BY_BOTH
COMMAND_ORDER = [
    {"servo_saturation"},
    {"transport_delay"},
    {"servo_deadband"},
    {"servo_lag", "motor_lag", "lag_per_axis", "servo_second_order", "servo_rate_limit", "servo_acceleration_limit"},
    {"servo_backlash"},
    {"swashplate_phase"},
    {"stabiliser_bar"},
]
KNOWN_SEQUENTIAL = {
    "servo_saturation", "servo_deadband", "servo_rate_limit", "servo_backlash", "servo_acceleration_limit",
}  # fmt: skip
KNOWN_NONLINEAR = KNOWN_SEQUENTIAL | {
    "quadratic_damping", "yaw_coupling", "rotor_speed", "airspeed_scaling", "governor",
}  # fmt: skip
SEQUENTIAL = {name for name, one in catalogue().items() if one.samples is not None}
NONLINEAR = {name for name, one in catalogue().items() if not one.linear}

COMPANIONS = {"disc_incidence": ["angle_of_attack"], "airspeed_scaling": ["elevator", "angular_damping"]}
"""What must be composed too; the companions stand at their typical sizes."""
EVERYTHING = tuple(name for name in CHANNELS if name not in ("phi", "theta", "alpha", "beta"))
CONSTANTS = {"Omega_0": 172.8, "V_0": 18.0}
S = 2j * np.pi * np.geomspace(0.1, 15.0, 25)

EFFECTS = [pytest.param(effect, id=name) for name, effect in catalogue().items()]
WITH_EQUATIONS = [
    one for one in EFFECTS if one.id != "flapping" and (catalogue()[str(one.id)].equations or one.id in IDS)
    and one.id not in SEQUENTIAL | {"transport_delay"}
]  # fmt: skip


def logged(effect: Effect) -> tuple[str, ...]:
    """Everything but what it would work out itself."""
    return tuple(name for name in EVERYTHING if name not in effect.unless_logged)


def composed(effect: Effect, base: str = "tpp") -> Structure:
    companions = [one for one in COMPANIONS.get(effect.id, []) if not (base == "cd" and one in ABSORBED_BY_CD)]
    if effect.id == "flapping":
        base = "cd"
    return compose(base, [*companions, effect], logged(effect), CONSTANTS)


def absorbed_by(base: str) -> list[str]:
    """The effects that a base contains already, as they declare it."""
    return [one.id for one in catalogue().values() if base in one.absorbed_by]


def values(structure: Structure, **given: float) -> FloatArray:
    """The paper's base, effects at typical sizes, and what is given."""
    base = {"tpp": TPP, "cd": CD}[structure.base]
    known = dict(zip(base.names, PAPER_PARAMETERS[structure.base], strict=True))
    typical = {one.name: one.typical for one in structure.parameters}
    return structure.vector({**typical, **known, **given})


def nulls(effect: Effect) -> dict[str, float]:
    """Its null, or as near to it as its equations allow where they divide by it or it is infinite."""
    near = {}
    for one in effect.parameters:
        if one.null is None:
            continue
        if math.isinf(one.null):
            near[one.name] = 1e9 * one.typical
        elif one.bounds[0] == one.null and effect.states:
            near[one.name] = one.null + 1e-9 * one.typical
        else:
            near[one.name] = one.null
    return near


def response(matrices: Matrices, inputs: int | None = None) -> Any:
    """(bins, outputs, inputs) at S."""
    A, B, C, D = matrices
    return (C @ np.linalg.solve(S[:, None, None] * np.eye(A.shape[-1]) - A, B) + D)[..., :inputs]


def histories(structure: Structure, n: int = 40) -> dict[str, FloatArray]:
    """Something of everything that the equations read, (n,) each."""
    rng = np.random.default_rng(7)
    found = {name: 0.3 * rng.standard_normal(n) for name in (*structure.states, *structure.inputs)}
    for name, mean in (("omega", 172.8), ("airspeed", 18.0)):
        if name in found:
            found[name] = mean * (1 + 0.05 * rng.standard_normal(n))
    return found


# ---------------------------------------------------------------------------------------------- declarations


def test_the_folder_is_the_catalogue_and_never_shrinks() -> None:
    assert len(IDS) == len(set(IDS)) == 36
    assert sorted(catalogue()) == sorted(path.stem for path in FOLDER.glob("[a-z]*.py"))
    assert set(IDS) <= set(catalogue())


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_field_says_something(effect: Effect) -> None:
    for text in (effect.title, effect.equation, effect.source, effect.signature):
        assert text.strip() == text != ""
    assert len(effect.title) <= 40
    assert len(effect.signature.split()) >= 6, "one physical sentence"
    assert effect.group in ("rotor", "fuselage", "forward", "actuators", "sensors")
    assert effect.parameters
    assert effect.path is None
    for one in effect.parameters:
        assert one.unit
        assert len(one.meaning) > 4, one.name
        assert one.name.isidentifier()
        if effect.id not in ("second_order_flapping", "structural_mode", "input_coupling"):
            assert one.name in effect.equation or one.name == "zeta"
    for channel in effect.channels:
        assert set(channel.split("|")) <= set(CHANNELS)
    source = (FOLDER / f"{effect.id}.py").read_text(encoding="utf-8")
    assert source.startswith('"""')


@pytest.mark.parametrize("effect", EFFECTS)
def test_limits_are_nested(effect: Effect) -> None:
    for one in effect.parameters:
        low, high = one.bounds
        assert low <= one.plausible[0] <= one.plausible[1], one.name
        assert one.plausible[1] <= high or math.isinf(one.plausible[1]), one.name
        assert not math.isnan(one.typical)
        for value in (one.typical, *one.grid):
            assert low <= value <= high, one.name
        if one.null is not None and math.isfinite(one.null):
            assert low <= one.null <= high, one.name
            assert not one.implausible(one.null), f"{one.name}: nothing at all is plausible"
        if effect.id != "attitude_stiffness":  # which physics does not allow in free flight
            assert not one.implausible(one.typical), one.name
    if effect.id in ("flapping", "second_order_flapping"):
        assert effect.slot == "rotor"
        assert not effect.has_null
    else:
        assert effect.has_null


@pytest.mark.parametrize("effect", EFFECTS)
def test_what_the_null_does_not_tell_is_searched_on_a_grid(effect: Effect) -> None:
    """An infinite null, or a parameter that has no meaning at the null of another."""
    if effect.has_null:
        for one in effect.parameters:
            if one.null is None or math.isinf(one.null):
                assert one.grid, f"{one.name}: give values to begin from, grid=(...)"


def test_the_order_is_that_of_physics() -> None:
    orders = [{catalogue()[name].order for name in names} for names in COMMAND_ORDER]
    assert all(len(one) == 1 for one in orders)
    assert all(max(a) < min(b) for a, b in pairwise(orders))
    assert all(catalogue()[name].stage is Stage.COMMAND for names in COMMAND_ORDER for name in names)
    assert {name for name in IDS if catalogue()[name].stage is Stage.COMMAND} == set().union(*COMMAND_ORDER)
    # for a part that another has
    apart = {"flapping", "second_order_flapping", "servo_second_order", "motor_lag", "lag_per_axis"}
    apart |= {"governor"} | ABSORBED_BY_BOTH  # where all is logged, and where the cyclic is free
    everything = [one for one in catalogue() if one not in apart]
    forward = compose("tpp", everything, EVERYTHING, CONSTANTS)
    assert forward.effects == compose("tpp", everything[::-1], EVERYTHING, CONSTANTS).effects
    stages = [one.stage for one in forward.composed]
    assert stages == sorted(stages)
    rates, outputs = forward.evaluate(forward.named(values(forward)), histories(forward))
    for value in (*rates.values(), *outputs.values()):
        assert np.all(np.isfinite(value))


def test_which_are_nonlinear() -> None:
    assert NONLINEAR & set(IDS) == KNOWN_NONLINEAR
    assert SEQUENTIAL & set(IDS) == KNOWN_SEQUENTIAL
    assert {name for name in IDS if catalogue()[name].response is not None} == {"transport_delay"}
    assert SEQUENTIAL <= NONLINEAR


# ---------------------------------------------------------------------------------------------- composition


@pytest.mark.parametrize("base", ["tpp", "cd"])
@pytest.mark.parametrize("effect", EFFECTS)
def test_it_composes_or_says_why_not(effect: Effect, base: str) -> None:
    refused = {"tpp": {"flapping"} | ABSORBED_BY_BOTH, "cd": NEED_A_DISC | ABSORBED_BY_CD}[base]
    others = COMPANIONS.get(effect.id, [])
    reason = not_testable(effect, base, others, logged(effect))
    if effect.id in refused or (effect.id not in IDS and reason is not None):
        assert reason is not None
        absorbed = ABSORBED_BY_CD | {"flapping"} if effect.id in IDS else {effect.id} & set(absorbed_by(base))
        assert ("not testable on" in reason) == (effect.id in absorbed)
        with pytest.raises(EffectError, match=effect.id):
            compose(base, [*(one for one in others if one not in ABSORBED_BY_CD), effect], logged(effect), CONSTANTS)
        return
    assert reason is None
    structure = composed(effect, base)
    if effect.id == "flapping":
        assert (structure.base, structure.composed, structure.names) == ("tpp", (), TPP.names)
        return
    assert structure == composed(effect, base), "equal compositions are equal, adapted or not"
    assert structure == compose(base, structure.composed, logged(effect), CONSTANTS), "adapted effects compose again"
    assert structure.linear == all(one not in NONLINEAR for one in structure.effects)
    assert not set(effect.replaces) & set(structure.names)
    matrices = structure.matrices(values(structure))
    n, m = len(structure.states), len(structure.inputs)
    assert [one.shape for one in matrices] == [(n, n), (n, m), (2, n), (2, m)]
    assert all(np.all(np.isfinite(one)) for one in matrices)
    stack = structure.matrices(np.stack([values(structure)] * 3))
    assert [one.shape for one in stack] == [(3, n, n), (3, n, m), (3, 2, n), (3, 2, m)]
    np.testing.assert_array_equal(stack.A[1], matrices.A)


@pytest.mark.parametrize("effect", EFFECTS)
def test_a_missing_channel_is_named(effect: Effect) -> None:
    others = COMPANIONS.get(effect.id, [])
    reason = not_testable(effect, "tpp", others, ())
    if effect.channels:
        assert reason is not None
        assert "not logged" in reason
        assert effect.channels[0].split("|")[0] in reason
    elif effect.id not in {"flapping"} | ABSORBED_BY_BOTH:
        assert reason is None


# ---------------------------------------------------------------------------------------------- the null


@pytest.mark.parametrize("base", ["tpp", "cd"])
@pytest.mark.parametrize("effect", [one for one in WITH_EQUATIONS if one.id != "second_order_flapping"])
def test_at_its_null_the_base_is_unchanged(effect: Effect, base: str) -> None:
    if not_testable(effect, base, COMPANIONS.get(effect.id, []), logged(effect)) is not None:
        return
    structure = composed(effect, base)
    without = compose(base, [one for one in structure.composed if one.id != effect.id], logged(effect), CONSTANTS)
    at = nulls(next(one for one in structure.composed if one.id == effect.id))
    assert at
    new = response(structure.matrices(values(structure, **at)))
    old = response(without.matrices(values(without)))
    kept = [structure.inputs.index(name) for name in without.inputs]
    scale = np.abs(old).max(axis=(1, 2), keepdims=True)
    assert np.max(np.abs(new[:, :, kept] - old) / scale) <= effect.null_tolerance
    added = [i for i in range(len(structure.inputs)) if i not in kept]
    assert np.max(np.abs(new[:, :, added]), initial=0.0) == 0.0
    if not effect.linear:
        signals = histories(structure)
        if "r" in signals:  # yaw turns the disc by itself: it has no null of its own
            signals["r"] = 0.0 * signals["r"]
        rates, _ = structure.evaluate(structure.named(values(structure, **at)), signals)
        rates_without, _ = without.evaluate(without.named(values(without)), signals)
        for key, value in rates_without.items():
            np.testing.assert_allclose(rates[key], value, rtol=1e-12)


def commands(n: int) -> FloatArray:
    t = np.arange(n) * 0.002
    wave = 0.1 * np.sin(2 * np.pi * t) + 0.05 * np.sin(2 * np.pi * 7.3 * t)
    return np.stack([wave + 0.02, 0.7 * wave[::-1] - 0.03, 0.5 * np.roll(wave, 50)])


@pytest.mark.parametrize("effect", [one for one in EFFECTS if one.id in SEQUENTIAL])
def test_samples_pass_at_the_null_and_act_at_the_typical_size(effect: Effect) -> None:
    assert effect.samples is not None
    (parameter,) = effect.parameters
    assert parameter.null is not None
    given = commands(4000)
    untouched = given.copy()
    np.testing.assert_array_equal(effect.samples(given, 0.002, {parameter.name: parameter.null}), given)
    acting = effect.samples(given, 0.002, {parameter.name: parameter.grid[0]})
    np.testing.assert_array_equal(given, untouched)
    assert acting.shape == given.shape
    assert np.all(np.isfinite(acting))
    assert not np.allclose(acting, given, atol=1e-4)


@pytest.mark.parametrize("effect", [one for one in EFFECTS if one.id in SEQUENTIAL])
def test_samples_are_quick(effect: Effect) -> None:
    """10 ms for a command of 60,000 samples; the best of five, and some room for a busy machine."""
    assert effect.samples is not None
    (parameter,) = effect.parameters
    given = commands(60_000)[:2]
    best = math.inf
    for _ in range(5):
        begin = time.process_time()
        effect.samples(given, 0.002, {parameter.name: parameter.typical})
        best = min(best, time.process_time() - begin)
    assert best / 2 < 0.03


def test_delay_passes_at_the_null() -> None:
    effect = find("transport_delay")
    assert effect.response is not None
    np.testing.assert_array_equal(effect.response(S, {"T_d": 0.0}), np.ones(S.size))
    np.testing.assert_allclose(np.angle(effect.response(S, {"T_d": 0.01})), -S.imag * 0.01, rtol=1e-12)


# ---------------------------------------------------------------------------------------------- derivatives


@pytest.mark.parametrize("base", ["tpp", "cd"])
@pytest.mark.parametrize("effect", WITH_EQUATIONS)
def test_complex_steps_are_derivatives(effect: Effect, base: str) -> None:
    """Of the matrices for linear structures, of the rates on time histories for the others: against differences."""
    if not_testable(effect, base, COMPANIONS.get(effect.id, []), logged(effect)) is not None:
        return
    structure = composed(effect, base)
    here = values(structure)
    signals = histories(structure)

    def everything(x: Any) -> Any:
        """(parameters, ...) -> (parameters, numbers)."""
        if structure.linear:
            return np.concatenate([one.reshape(len(x), -1) for one in structure.matrices(x)], axis=1)
        rates, outputs = structure.evaluate({k: v[:, None] for k, v in structure.named(x).items()}, signals)
        return np.concatenate([np.broadcast_to(v, (len(x), 40)) for v in (*rates.values(), *outputs.values())], axis=1)

    exact = everything(stepped(here)).imag / COMPLEX_STEP
    step = 1e-6 * np.maximum(np.abs(here), 1e-3)
    difference = (everything(here + np.diag(step)) - everything(here - np.diag(step))) / (2 * step[:, None])
    scale = np.abs(difference).max(axis=1, keepdims=True)
    assert np.all(scale > 0), "a parameter that changes nothing"
    np.testing.assert_allclose(exact / scale, difference / scale, rtol=0, atol=1e-5)


def test_magnitude_passes_a_complex_step() -> None:
    for x in (-2.0, 0.5):
        stepped_x = sysid.model.effect.magnitude(np.array(x + 1j * COMPLEX_STEP))
        assert stepped_x.real == pytest.approx(abs(x), rel=1e-15)
        assert stepped_x.imag / COMPLEX_STEP == pytest.approx(math.copysign(1.0, x), rel=1e-12)


@pytest.mark.parametrize("name", sorted(NONLINEAR - SEQUENTIAL))
def test_matrices_of_nonlinear_effects_are_those_of_small_motions(name: str) -> None:
    structure = composed(find(name))
    given = values(structure)
    n = len(structure.states)
    rest = {one: np.zeros(n) for one in structure.inputs} | {"omega": np.full(n, 172.8), "airspeed": np.full(n, 18.0)}
    slopes = {}
    for size in (1e-6, -1e-6):
        unit = size * np.eye(n)
        signals = {**rest, **{state: unit[i] for i, state in enumerate(structure.states)}}
        rates, _ = structure.evaluate(structure.named(given), signals)
        slopes[size] = np.stack([np.broadcast_to(rates[f"{state}_dot"], (n,)) for state in structure.states])
    A = (slopes[1e-6] - slopes[-1e-6]) / 2e-6
    np.testing.assert_allclose(structure.matrices(given).A, A, rtol=1e-6, atol=1e-4)


# ---------------------------------------------------------------------------------------------- single effects


def second_order(**given: float) -> tuple[Structure, FloatArray]:
    structure = compose("tpp", ["second_order_flapping"])
    return structure, values(structure, **given)


def test_second_order_flapping_of_table_4() -> None:
    """By hand from Table 4: Lock number near 1.0, nu^2 - 1 near 0.18, modes 1.62 Hz/.425 and 4.87 Hz/.219."""
    effect = find("second_order_flapping")
    assert effect.start is not None
    begin = effect.start(dict(zip(TPP.names, PAPER_PARAMETERS["tpp"], strict=True)), {})
    assert begin["lock_number"] == pytest.approx(1.0, abs=0.03)
    assert begin["flap_frequency_ratio"] ** 2 - 1 == pytest.approx(0.18, abs=0.005)
    structure, given = second_order(**begin)
    slow, fast, nutation = Model(structure, given).modes
    assert (slow.frequency_hz, slow.damping_ratio) == pytest.approx((1.62, 0.425), abs=0.005)
    assert (fast.frequency_hz, fast.damping_ratio) == pytest.approx((4.87, 0.219), abs=0.005)
    assert nutation.frequency_hz == pytest.approx(2 * 27.5, rel=0.06), "the disc nods at twice the rotor's speed"


def test_second_order_flapping_settles_where_the_first_order_does() -> None:
    """With the coupling that A_b = -B_a stands for, both rotors have the same steady tilt for the same command."""
    tau_f, coupling, Omega = 0.091, 1.4, 1650 * np.pi / 30
    lock = 16 / (tau_f * Omega)
    structure, given = second_order(lock_number=lock, flap_frequency_ratio=math.sqrt(1 + coupling * lock / 8))
    first = values(TPP, A_b=-coupling, B_a=coupling)
    held = []
    for matrices in (structure.matrices(given), TPP.matrices(first)):
        A, B = matrices.A[2:, 2:], matrices.B[2:]  # rates held at zero
        held.append(-np.linalg.solve(A, B)[:2])
    np.testing.assert_allclose(held[0], held[1], rtol=1e-9)


def test_a_rotor_that_turns_the_other_way_has_the_opposite_coupling() -> None:
    """Seen in a mirror: a, q and the pitch cyclic keep their signs, b, p and the roll cyclic change theirs."""
    given = {"A_lat": -0.282, "A_lon": 0.296, "B_lat": 0.524, "B_lon": -0.050}
    mirrored = {**given, "A_lat": 0.282, "B_lon": 0.050}
    one = compose("tpp", ["second_order_flapping"], (), {"Omega_0": 172.8})
    other = compose("tpp", ["second_order_flapping"], (), {"Omega_0": -172.8})
    mirror = np.diag([-1.0, 1.0])
    expected = mirror @ response(one.matrices(values(one, **given))) @ mirror
    np.testing.assert_allclose(response(other.matrices(values(other, **mirrored))), expected, rtol=1e-9)


def test_rotor_speed_reaches_second_order_flapping() -> None:
    structure = compose("tpp", ["rotor_speed", "second_order_flapping"], ["omega"], CONSTANTS)
    assert {"k", "n", "lock_number"} <= set(structure.names)
    signals = histories(structure)
    still, fast = (
        structure.evaluate(structure.named(values(structure, k=k, n=0.0)), signals)[0]["a_rate_dot"] for k in (0.0, 1.0)
    )
    reference = compose("tpp", ["second_order_flapping"], (), CONSTANTS)
    plain = reference.evaluate(reference.named(values(reference)), signals)[0]["a_rate_dot"]
    np.testing.assert_allclose(still, plain, rtol=1e-12)
    assert not np.allclose(fast, plain, rtol=1e-3)


def test_theory_of_rotor_speed_is_the_papers() -> None:
    """Section 4.3: with k = 1 and n = 0, tau_f = tau_fn/Omega, A_b = A_bn/Omega^2, B_a = B_an/Omega^2."""
    structure = compose("tpp", ["rotor_speed"], ["omega"], CONSTANTS)
    signals = {name: np.array([0.01 * i]) for i, name in enumerate(structure.states, 1)}
    signals |= {"delta_x": np.array([0.03]), "delta_y": np.array([-0.02]), "omega": np.array([160.0])}
    rates, _ = structure.evaluate(structure.named(values(structure, k=1.0, n=0.0)), signals)
    ratio = 160.0 / CONSTANTS["Omega_0"]
    by_hand = values(TPP, tau_f=0.091 / ratio, A_b=-1.338 / ratio**2, B_a=1.448 / ratio**2)
    expected, _ = TPP.evaluate(TPP.named(by_hand), signals)
    for key, value in expected.items():
        np.testing.assert_allclose(rates[key], value, rtol=1e-12)


def test_input_coupling_takes_every_logged_command_and_leaves_the_elevator_to_its_own() -> None:
    structure = compose("tpp", ["input_coupling"], ["delta_c", "delta_a"])
    assert structure.commands == ("delta_x", "delta_y", "delta_c", "delta_a")
    assert structure.names[9:] == ("L_delta_c", "M_delta_c", "L_delta_a", "M_delta_a")
    B = structure.matrices(values(structure, L_delta_c=3.0, M_delta_a=-7.0)).B
    assert (B[0, 2], B[1, 3]) == (3.0, -7.0)
    both = compose("tpp", ["input_coupling", "elevator"], ["delta_c", "delta_e"])
    assert both.names[9:] == ("M_elev", "L_delta_c", "M_delta_c")


@pytest.mark.parametrize(("name", "angle"), [("angle_of_attack", "alpha"), ("sideslip", "beta")])
def test_a_logged_flow_angle_takes_the_place_of_the_state(name: str, angle: str) -> None:
    without, logged = compose("tpp", [name]), compose("tpp", [name], [angle])
    assert angle in without.states
    assert angle not in logged.states
    assert logged.channels == (angle,)
    assert len(logged.parameters) == len(without.parameters) - 1
    assert logged.matrices(values(logged)).B[:2, 2].any()


def test_disc_incidence_takes_alpha_from_the_log_or_from_its_own_state() -> None:
    assert compose("tpp", ["disc_incidence"], ["alpha"]).channels == ("alpha",)
    assert compose("tpp", ["disc_incidence", "angle_of_attack"]).states == ("p", "q", "a", "b", "alpha")
    with pytest.raises(EffectError, match="it needs angle_of_attack"):
        compose("tpp", ["disc_incidence"])


def test_attitude_is_logged_or_integrated() -> None:
    assert compose("tpp", ["attitude_stiffness"]).states[-2:] == ("phi", "theta")
    logged = compose("tpp", ["attitude_stiffness"], ["phi", "theta"])
    assert logged.states == TPP.states
    assert logged.channels == ("phi", "theta")


def test_airspeed_scales_aerodynamics_and_not_a_rotors_cd() -> None:
    on_cd = compose("cd", ["airspeed_scaling", "elevator"], EVERYTHING, CONSTANTS)
    given = on_cd.named(values(on_cd, m=1.0, M_elev=10.0))
    signals = {**dict.fromkeys((*on_cd.states, *on_cd.inputs), np.array([0.0])), "airspeed": np.array([36.0])}
    rates, _ = on_cd.evaluate(given, {**signals, "delta_e": np.array([0.1])})
    assert rates["q_dot"] == pytest.approx(4 * 10.0 * 0.1)
    rates, _ = on_cd.evaluate(given, {**signals, "p": np.array([1.0])})
    assert rates["p_dot"] == pytest.approx(-2.056)
    with pytest.raises(EffectError, match="it needs"):
        compose("tpp", ["airspeed_scaling"], EVERYTHING, CONSTANTS)


def test_a_clamped_structural_mode_swings_at_its_frequency_and_a_free_one_faster() -> None:
    structure = compose("tpp", ["structural_mode"])
    given = values(structure, frequency_roll=9.0, zeta_roll=0.05, kappa_roll=0.44, L_b=0.0, M_a=0.0)
    poles = np.linalg.eigvals(structure.matrices(given).A)
    expected = 2 * np.pi * 9.0 * math.sqrt(1.44)
    assert np.min(np.abs(np.abs(poles) - expected)) < 1e-6 * expected


def test_saturation_is_a_ring_for_the_cyclic_and_a_limit_for_the_others() -> None:
    effect = find("servo_saturation")
    assert effect.samples is not None
    given = np.array([[0.3, 0.03, 0.0, -0.5], [0.4, 0.04, 0.0, 0.0], [0.3, -0.3, 0.1, 0.0]])
    acting = effect.samples(given, 0.002, {"limit": 0.25})
    np.testing.assert_allclose(acting[:2, 0], [0.15, 0.2])
    np.testing.assert_allclose(acting[:2, 1:], [[0.03, 0.0, -0.25], [0.04, 0.0, 0.0]])
    np.testing.assert_allclose(acting[2], [0.25, -0.25, 0.1, 0.0])


def test_sequential_effects_by_hand() -> None:
    def act(name: str, value: float, row: list[float]) -> list[float]:
        effect = find(name)
        assert effect.samples is not None
        return list(effect.samples(np.array([row]), 0.1, {effect.parameters[0].name: value})[0])

    assert act("servo_deadband", 0.25, [0.0, 0.2, 0.3, 0.5, 0.0]) == [0.0, 0.0, 0.3, 0.3, 0.0]
    assert act("servo_backlash", 0.25, [0.0, 0.2, 0.5, 0.25, -0.5]) == [0.0, 0.0, 0.25, 0.25, -0.25]
    # a step of 0.25 at 1/s takes two and a half samples; each value is the ramp's mean over its sample
    assert act("servo_rate_limit", 1.0, [0.0, 0.25, 0.25, 0.25, 0.25]) == pytest.approx(
        [0.0, 0.05, 0.15, 0.2375, 0.25], abs=1e-12
    )
    # of 0.16 the root falls by 1 a second: 0.4, 0.3, 0.2, ...; each value is the mean over its sample
    left = [(root**3 - (root - 0.1) ** 3) / 0.3 for root in (0.4, 0.3, 0.2, 0.1)]
    assert act("servo_acceleration_limit", 2.0, [0.0, *[0.16] * 5]) == pytest.approx(
        [0.0, *(0.16 - one for one in left), 0.16], abs=1e-12
    )


def test_a_turned_swashplate_is_the_bases_cyclic_turned() -> None:
    """Nothing else of the base changes: so it is a reading of the cyclic's four terms and no effect beside them."""
    equations = find("swashplate_phase").equations
    assert equations is not None
    turned = equations(Signals({"psi": 0.3, "delta_x": 0.1, "delta_y": -0.2}))
    assert complex(turned["delta_x"], turned["delta_y"]) == pytest.approx(complex(0.1, -0.2) * np.exp(0.3j))
    for base in ("cd", "tpp"):
        reason = not_testable(find("swashplate_phase"), base, [], EVERYTHING)
        assert reason == f"not testable on {base}: its parameters are the base's own there"


def test_a_governor_is_asked_where_the_rotor_speed_is_not_logged() -> None:
    assert "omega is logged" in str(not_testable(find("governor"), "tpp", [], ["delta_c", "omega"]))
    assert not_testable(find("governor"), "tpp", [], ["delta_c"]) is None
    both = compose("tpp", ["governor", "second_order_flapping"], ["delta_c"])
    signals = histories(both)
    slow, still = (
        both.evaluate(both.named(values(both, k_g=0.3)), {**signals, "loaded": loaded})[0]["a_rate_dot"]
        for loaded in (0.3, 0.0)
    )
    assert not np.allclose(slow, still, rtol=1e-3)


# ---------------------------------------------------------------------------------------------- a user's own


def readme_example() -> str:
    (example,) = re.findall(r"```python\n(.*?)```", (FOLDER / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    return str(example)


def test_the_readmes_example_works_by_path(tmp_path: Path) -> None:
    example = readme_example()
    assert len(example.splitlines()) <= 25
    path = tmp_path / "tail_drag.py"
    path.write_text(example, encoding="utf-8")
    effect = load(path)
    assert effect.path == str(path)
    assert effect.sha256 is not None
    structure = compose("tpp", [str(path), "servo_lag"])
    assert structure.effects == ("servo_lag", str(path))
    signals = histories(structure)
    rates, _ = structure.evaluate(structure.named(values(structure, M_tail=-2.0)), signals)
    plain = compose("tpp", ["servo_lag"])
    before, _ = plain.evaluate(plain.named(values(plain)), signals)
    np.testing.assert_allclose(rates["q_dot"] - before["q_dot"], -2.0 * signals["q"] * np.abs(signals["q"]), atol=1e-12)


@pytest.mark.parametrize(
    ("content", "says"),
    [("x = 1", "EFFECT"), ("EFFECT = 3", "not an Effect"), ("def f(:", "SyntaxError"), ("raise OSError('no')", "no")],
)
def test_a_users_broken_file_is_an_error_and_not_a_crash(content: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.py"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(EffectError, match=says):
        load(path)


# ---------------------------------------------------------------------------------------------- airframes


@pytest.mark.parametrize("airframe", list(Airframe))
def test_what_needs_an_effect_that_an_airframe_cannot_have_is_not_on_it(airframe: Airframe) -> None:
    known = catalogue()
    for effect in known.values():
        for need in effect.needs:
            possible = any(known[name].can_be_on(airframe) for name in need.split("|"))
            assert possible or not effect.can_be_on(airframe), f"{effect.id} on a {airframe} needs {need}"


def test_a_multirotor_has_no_disc_no_linkage_and_no_wing() -> None:
    absent = {one.id for one in catalogue().values() if not one.can_be_on(Airframe.MULTIROTOR)}
    wing = {one.id for one in catalogue().values() if one.group == "forward"}
    linkage = {"servo_lag", "servo_backlash", "servo_deadband", "swashplate_phase", "stabiliser_bar"}
    assert absent == NEED_A_DISC | wing | linkage | {"flapping"}
    motors = {one.id for one in catalogue().values() if not one.can_be_on(Airframe.HELICOPTER)}
    assert motors == {one.id for one in catalogue().values() if not one.can_be_on(None)} == {"motor_lag"}


def test_on_a_multirotor_words_say_motors() -> None:
    for effect in catalogue().values():
        if not effect.can_be_on(Airframe.MULTIROTOR):
            continue
        there = effect.worded(Airframe.MULTIROTOR)
        said = f"{there.title} {there.source} {there.signature}"
        assert not re.search(r"servo|swash|linkage|cyclic|disc\b", said), f"{effect.id}: {said}"
        assert effect.worded(Airframe.HELICOPTER) is effect
        assert effect.worded(None) is effect
    assert catalogue()["servo_second_order"].worded(Airframe.MULTIROTOR).title == "second-order lag of the motors"


@pytest.mark.parametrize(
    ("name", "corner"),
    [
        ("lead_lag", {"frequency_lag": 5.0, "zeta_lag": None, "gain": 0.0}),
        ("structural_mode", {"frequency_roll": 5.0, "zeta_roll": None, "kappa_roll": 0.0}),
    ],
)
def test_a_mode_at_its_least_damping_has_an_answer_on_every_bin(name: str, corner: dict[str, float | None]) -> None:
    """A search that ended without damping divided by zero where a bin lay at the mode's frequency."""
    effect = find(name)
    structure = compose("tpp", [name])
    low = {one.name: one.bounds[0] for one in effect.parameters}
    known = dict(zip(TPP.names, PAPER_PARAMETERS["tpp"], strict=True))
    values = known | {one.name: one.typical for one in effect.parameters}
    values |= {key: low[key] if value is None else value for key, value in corner.items()}
    runs = records(fly(None, {}, seed=1, duration_s=3.0))
    bins = prepared(runs, (0.0, 15.0)).viewed(structure.inputs)
    response = respond(structure, structure.vector(values), bins.stacks[0], sensitivities=True)
    assert 5.0 in bins.stacks[0].frequency_hz
    assert np.all(np.isfinite(response.Y))
    assert np.all(np.isfinite(response.slopes))
