"""The explanation says what was planted, from what the flights show, in lines that fit a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from types import MappingProxyType

import planted
import pytest
from planted import PLANTED, TABLE_5, fly
from planted_fits import records

from gcs.analysis.quantities import amount, plausible_range, quantity
from gcs.analysis.text.explanation import explanation_document, explanation_lines
from sysid.data.dataset import dataset
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.evidence import Candidate, candidate, gain, instrumental_step, refit
from sysid.diagnose.explain import Explanation, explain
from sysid.fit.estimate import estimate
from sysid.fit.noise import divide
from sysid.fit.whitening import noise_whitening
from sysid.model.compose import compose
from sysid.model.effect import find
from sysid.model.parameter import Parameter


def outside(one: Candidate) -> set[str]:
    model = one.model
    return {p.name for p in model.structure.parameters if p.implausible(model[p.name])}


def judged(parent: Candidate, names: Sequence[str]) -> list[Ranked]:
    """Refits of the parent with each effect, in the order named, weighed in the first one's noise."""
    structure = parent.model.structure
    constants = dict(structure.constants)
    fits = [
        refit(compose("tpp", [*structure.composed, name], parent.dataset.available, constants), parent, [name])
        for name in names
    ]
    whitening = noise_whitening(
        fits[0].model,
        parent.dataset.stacks,
        divide(fits[0].estimate.error, parent.dataset.stacks, parent.dataset.causes),
    )
    before = instrumental_step(parent, whitening)
    return [
        Ranked(
            effects=(name,),
            score=None,
            not_testable=None,
            fit=fit,
            stepped=instrumental_step(fit, whitening),
            chi_squared=gain(instrumental_step(fit, whitening), before)[0],
            implausible=tuple(sorted(outside(fit) - outside(parent))),
            resolved=tuple(sorted(outside(parent) - outside(fit))),
        )
        for name, fit in zip(names, fits, strict=True)
    ]


@cache
def flown(effect: str | None, base: tuple[str, ...] = (), **held: float) -> Candidate:
    size = PLANTED[effect] if effect is not None else {}
    return fitted(fly(effect, size, seed=5, duration_s=10.0), base, held)


def fitted(flight: Sequence[planted.Run], base: Sequence[str], held: Mapping[str, float]) -> Candidate:
    on = dataset(records(flight), (0.0, 15.0))
    structure = compose("tpp", base, on.available, {"Omega_0": 171.2, "V_0": 18.2})
    return candidate(estimate(structure, on.viewed(structure.inputs), None, held), tuple(held), on)


def explained(effect: str, names: Sequence[str], alike: Sequence[str] = ()) -> Explanation:
    parent = flown(effect)
    winner, *others = judged(parent, names)
    return explain(parent, winner, [winner, *others], alike)


def told(explanation: Explanation) -> dict[str, list[str]]:
    """The sentences of each part."""
    return explanation_document(explanation)


def test_a_lag_is_told_by_phase_and_gain() -> None:
    found = explained("servo_lag", ["servo_lag", "gyro_lag"], ["gyro_lag"])
    (what,) = told(found)["what"]
    assert what.startswith("First-order lag of the servos")
    assert "plausible: 0 to 80 ms" in what
    assert any(said.startswith("The phase falls in proportion to frequency") for said in told(found)["why"])
    assert any("as behind a lag: a pure delay would keep it" in said for said in told(found)["why"])
    assert any("M_a 4" in said and "→ 7" in said for said in told(found)["changes"])
    assert any(said.startswith("Modes: 1.") for said in told(found)["changes"])
    assert told(found)["resembles"][0].startswith("These runs cannot tell it from gyro_lag (tau_g = ")
    assert all(len(line) <= 78 for line in explanation_lines(found))
    assert told(found)["effects"] == ["servo_lag"]


def test_a_delay_keeps_the_gain() -> None:
    found = explained("transport_delay", ["transport_delay"])
    assert any("p 13 ms, q 13 ms late" in said for said in told(found)["why"])
    assert any("as behind a delay: a first-order lag would lose" in said for said in told(found)["why"])


def test_what_stands_in_is_named_with_its_value() -> None:
    found = explained("inertia_coupling", ["inertia_coupling", "angular_damping"])
    (said,) = told(found)["resembles"]
    assert said.startswith("angular_damping comes near")
    assert "M_q = +" in said
    assert said.endswith("it stands in.")
    assert any("of the roll error it removes" in each for each in told(found)["why"])


def test_an_implausible_winner_is_said_to_stand_in_and_what_does_so_at_plausible_values() -> None:
    parent = flown("inertia_coupling")
    right, wrong = judged(parent, ["inertia_coupling", "angular_damping"])
    found = explain(parent, wrong, [wrong, right])
    assert "NOT plausible" in told(found)["what"][0]
    assert "stands in for something else" in told(found)["resembles"][0]
    assert "inertia_coupling explains nearly as much at plausible values: c_p = " in told(found)["resembles"][0]


def test_a_nonlinear_effect_is_set_beside_the_best_linear_one() -> None:
    found = explained("quadratic_damping", ["quadratic_damping", "angular_damping"])
    assert any("constant coefficients, angular_damping, gets" in said for said in told(found)["why"])


def test_a_command_that_the_model_does_not_read_is_named() -> None:
    found = explained("input_coupling", ["input_coupling"])
    assert any("in step with delta_" in said for said in told(found)["why"])
    assert "not to be told from none" in told(found)["what"][0]


def test_a_parent_that_stands_in_names_what_makes_it_plausible(monkeypatch: pytest.MonkeyPatch) -> None:
    """The paper's M_q: held L_b and M_a and a lag of 20 ms turn a damping of -2 into a gain."""
    monkeypatch.setattr(planted, "TABLE_5", MappingProxyType({**TABLE_5, "M_q": -2.0}))
    flight = fly("servo_lag", {"tau_s": 0.02}, seed=5, duration_s=10.0, forward=True)
    held = {"L_b": TABLE_5["L_b"], "M_a": TABLE_5["M_a"]}
    parent = fitted(flight, ("angular_damping", "elevator"), held)
    assert parent.model["M_q"] > 0
    candidates = judged(parent, ["servo_lag"])
    (said,) = [one for one in told(explain(parent, None, candidates))["changes"] if one.startswith("M_q")]
    assert "is not plausible (-50 to 0 1/s): it stands in for something" in said
    assert "servo_lag would make it plausible: -" in said
    winner = candidates[0]
    (said,) = [one for one in told(explain(parent, winner, candidates))["changes"] if one.startswith("M_q")]
    assert "With servo_lag it becomes -" in said


def test_a_complete_model_says_so_shortly() -> None:
    found = explain(flown(None), None, complete=True)
    (said,) = told(found)["what"]
    assert [part for part, said in told(found).items() if said] == ["what"]
    assert said.startswith("Nothing is missing that these runs could show")
    assert found.effects == ()


def test_an_error_that_nothing_explains_is_not_called_noise() -> None:
    (said,) = told(explain(flown("servo_lag"), None))["what"]
    assert "more than noise" in said


def test_numbers_are_rounded_by_their_errors() -> None:
    (tau,) = find("servo_lag").parameters
    assert quantity(tau, 0.03123, 0.00042) == "tau_s = 31.2 ± 0.4 ms"
    assert quantity(tau, 0.03123) == "tau_s = 31.2 ms"
    assert plausible_range(tau) == "0 to 80 ms"
    (limit,) = find("servo_saturation").parameters
    assert plausible_range(limit) == "at least 0.05"
    assert amount(limit, math.inf) == "no limit"
    assert plausible_range(Parameter("x", "-", "anything")) == ""
    assert amount(Parameter("x", "1/s", "rate"), 713.4, 1.26) == "713.4 ± 1.3 1/s"
    assert amount(Parameter("x", "1/s", "rate"), 713.4, 26.0) == "713 ± 26 1/s"
