"""What could hide is flown with it: the announced harm comes true, and a size beyond is seen."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from more_of_a_kind import thorough
from planted import fly_many
from planted_fits import records

from gcs.analysis.text.hidden import consequences, hidden_sentences, up_to
from sysid.control.regulator import design
from sysid.control.stability import closed_loop
from sysid.data.dataset import dataset
from sysid.diagnose.candidates import SIGNIFICANT, counted
from sysid.diagnose.could_hide import could_hide
from sysid.diagnose.evidence import Candidate, Stepped, candidate, instrumental_step
from sysid.diagnose.hidden import HARM, CouldHide, Hidden, grouped
from sysid.diagnose.score import score
from sysid.fit.estimate import estimate
from sysid.fit.noise import Division, divide
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.compose import compose
from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter
from sysid.model.structure import Model

SEEDS = (3, 4, 5, 6)
ROUGH = {"gusts": 6.0, "noise": 0.03, "duration_s": 10.0}
TOGETHER = 1.3
TWO_MOMENTS = {"hub_gyroscopics": 1.5}
"""Factor within which the announced bias comes true, else TOGETHER: two moments at once are large, and the bias is
worked out by one step."""


@cache
def rough(effect: str | None, size: tuple[tuple[str, float], ...] = ()) -> list[Candidate]:
    """Fits of the bare structure in rough air: the same gusts whatever is planted."""
    found = []
    for flight in fly_many(effect, dict(size), seeds=SEEDS, **ROUGH):
        on = dataset(records(flight), (0.0, 15.0))
        structure = compose("tpp", (), on.available, {"Omega_0": 171.2})
        found.append(candidate(estimate(structure, on.viewed(structure.inputs)), (), on))
    return found


def seen(parent: Candidate) -> tuple[Stepped, Whitening, Division]:
    division = divide(parent.estimate.error, parent.dataset.stacks, parent.dataset.causes)
    whitening = noise_whitening(parent.model, parent.dataset.stacks, division)
    return instrumental_step(parent, whitening), whitening, division


@cache
def hiding() -> CouldHide:
    (parent, *_) = rough(None)
    return could_hide(parent, *seen(parent))


def hidden(name: str) -> Hidden:
    return next(one for group in (*hiding().harmful, *hiding().others) for one in group if one.effect == name)


def planted(one: Hidden) -> tuple[tuple[str, float], ...]:
    return tuple(one.size.items())


@pytest.mark.parametrize("effect", ["servo_lag", *thorough(["hub_gyroscopics", "angular_damping", "transport_delay"])])
def test_the_announced_bias_comes_true(effect: str) -> None:
    one = hidden(effect)
    name = max(one.relative, key=lambda key: abs(one.relative[key]))
    pairs = zip(rough(None), rough(effect, planted(one)), strict=True)
    flown = np.mean([there.model[name] - here.model[name] for here, there in pairs])
    announced = one.shift[name]
    together = TWO_MOMENTS.get(effect, TOGETHER)
    assert 1 / together < flown / announced < together


def test_what_is_said_to_hide_is_at_the_edge_of_what_is_seen() -> None:
    one = hidden("servo_lag")

    def found(times: float) -> int:
        larger = tuple((name, times * value) for name, value in one.size.items())
        flights = rough("servo_lag", larger)
        count = 0
        for parent in flights:
            stepped, whitening, division = seen(parent)
            threshold = SIGNIFICANT - counted(division) - math.log(20)  # the verdict's own
            effect = compose("tpp", ("servo_lag",), parent.dataset.available, {})
            answer = score(effect.composed[0], effect, parent, stepped, whitening)
            count += answer is not None and answer.log_p < threshold
        return count

    assert found(1.0) >= len(SEEDS) - 1
    assert found(2.0) == len(SEEDS)
    assert found(0.5) <= 1


def test_more_can_hide_where_no_excitation_is_logged() -> None:
    """The diagnosis asks for more there before it tells of anything."""
    (parent, *_) = rough(None)
    stepped, whitening, division = seen(parent)
    assert division.measured
    unlogged = could_hide(parent, stepped, whitening, replace(division, references=division.commands))
    more = {one.effect: one.size for group in (*unlogged.harmful, *unlogged.others) for one in group if one.visible}
    assert 1.02 < more["servo_lag"]["tau_s"] / hidden("servo_lag").size["tau_s"] < 1.3
    assert 1.02 < more["transport_delay"]["T_d"] / hidden("transport_delay").size["T_d"] < 1.3


def test_the_worst_comes_first_and_the_rest_is_one_sentence() -> None:
    found = hiding()
    harm = [group[0].harm for group in (*found.harmful, *found.others)]
    assert harm == sorted(harm, reverse=True)
    assert found.harmful
    assert len(found.harmful) <= 5
    assert all(group[0].harm >= HARM for group in found.harmful)
    assert len(hidden_sentences(found)) == len(found.harmful) + 1
    assert "could hide here" in hidden_sentences(found)[0]
    assert any(" % high" in said for said in hidden_sentences(found))


def test_lags_and_delays_are_told_together() -> None:
    groups = [{one.effect for one in group} for group in (*hiding().harmful, *hiding().others)]
    assert any({"servo_lag", "transport_delay", "gyro_lag"} <= group for group in groups)


def test_a_limit_hides_downwards_and_stays_above_what_was_commanded() -> None:
    one = hidden("servo_saturation")
    assert up_to(one).startswith("down to limit")
    assert 0.15 < one.size["limit"] < 1.0


def test_forward_flight_is_not_asked_in_hover() -> None:
    asked = {one.effect for group in (*hiding().harmful, *hiding().others) for one in group}
    assert asked.isdisjoint({"angle_of_attack", "sideslip", "elevator"})


def test_a_calm_flight_hides_nothing_that_does_harm() -> None:
    (flight,) = fly_many(None, {}, seeds=[5], duration_s=15.0)
    on = dataset(records(flight), (0.0, 15.0))
    structure = compose("tpp", (), on.available, {"Omega_0": 171.2})
    parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
    found = could_hide(parent, *seen(parent))
    assert not found.harmful
    (said,) = hidden_sentences(found)
    assert said.startswith("nothing that could hide here would do harm")


def test_what_the_structure_can_do_itself_is_limited_by_plausibility_only() -> None:
    def equations(s: object) -> Mapping[str, object]:
        return {"q_dot": 0.01 * s.k * s.M_a * s.a}  # type: ignore[attr-defined]

    spring = Effect(
        id="spring", title="stiffer hub", group="user", equation="q_dot += k/100 M_a a", source="-", signature="-",
        parameters=(Parameter("k", "-", "percent", plausible=(0.0, 40.0), null=0.0, bounds=(0.0, 90.0), typical=5.0),),
        stage=Stage.DYNAMICS, equations=equations, path="spring.py",
    )  # fmt: skip
    (parent, *_) = rough(None)
    found = could_hide(parent, *seen(parent), users=[spring])
    one = next(each for group in (*found.harmful, *found.others) for each in group if each.effect == "spring.py")
    assert not one.visible
    assert one.size["k"] == pytest.approx(40.0)
    # one step, taken where the fit is, leads to 0.4; the whole of it would be 0.4/1.4
    assert 0.4 / 1.4 / TOGETHER < one.relative["M_a"] < 0.4 * 1.05
    assert "only what is plausible limits it" in consequences(one)


def test_margins_agree_with_the_regulator_and_a_delay_takes_its_own_length() -> None:
    (parent, *_) = rough(None)
    gains = design(parent.model)
    here = closed_loop(gains, parent.model).margins
    assert here is not None
    assert here.delay_ms == pytest.approx(1000 * gains.margins.delay_s, abs=0.3)
    assert here.gain_db == pytest.approx(gains.margins.gain_db, abs=0.3)
    assert here.phase_deg == pytest.approx(gains.margins.phase_deg, abs=1.0)
    late = compose("tpp", ("transport_delay",))
    values = {**dict(zip(parent.model.structure.names, parent.model.values, strict=True)), "T_d": 0.01}
    there = closed_loop(gains, Model(late, late.vector(values))).margins
    assert there is not None
    assert here.delay_ms - there.delay_ms == pytest.approx(10.0, abs=0.3)


def test_modes_are_the_airframes_each_followed_to_its_own_place() -> None:
    """Beside two like servos, whose pairs lie on each other: neither is told, and no mode becomes another's."""
    flight = fly_many("servo_second_order", {"frequency": 12.0, "zeta": 0.7}, seeds=[3], **ROUGH)[0]
    on = dataset(records(flight), (0.0, 15.0))
    structure = compose("tpp", ("servo_second_order",), on.available, {"Omega_0": 171.2})
    parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
    found = could_hide(parent, *seen(parent))
    own = {mode.frequency_hz for mode in parent.model.own_modes}
    assert own < {mode.frequency_hz for mode in parent.model.modes}
    for one in (each for group in (*found.harmful, *found.others) for each in group):
        assert {here.frequency_hz for here, _ in one.modes} <= own
        assert len({there.pole for _, there in one.modes}) == len(one.modes)
        for here, there in one.modes:  # small sizes move a mode a little, and never onto a pole of the servos
            assert 0.5 < there.frequency_hz / here.frequency_hz < 2.0


def test_effects_that_change_something_without_bound_are_alike() -> None:
    """Beside a parameter that was fitted to nothing: no difference of two infinities is taken."""

    def hidden(effect: str, change: float) -> Hidden:
        shift = {"A_lat": change}
        return Hidden(
            effect=effect,
            title="",
            size={},
            sized=(),
            visible=True,
            shift=shift,
            relative=shift,
            modes=(),
            margins=None,
        )

    groups = grouped([hidden("one", math.inf), hidden("other", math.inf), hidden("third", 0.2)])
    assert [[one.effect for one in group] for group in groups] == [["one", "other"], ["third"]]
