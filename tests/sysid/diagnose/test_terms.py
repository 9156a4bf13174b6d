"""The library finds what an independent integrator planted, and finds nothing where nothing is."""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np
import planted
import pytest
from more_of_a_kind import thorough
from planted_fits import records
from planted_terms import flights, parent_of, searched

from sysid.data.record import Record
from sysid.diagnose.candidate_terms import _within_reach, candidate_terms
from sysid.diagnose.evidence import Candidate, Stepped, instrumental_step
from sysid.diagnose.score import score
from sysid.diagnose.term_search import Term, search, select
from sysid.diagnose.terms import Entry, Factor, code, entries, expressions, text, value
from sysid.fit.noise import divide
from sysid.fit.whitening import Whitening, noise_whitening
from sysid.model.compose import compose
from sysid.model.effect import Signals, find, magnitude

FOUND = {
    "cubic_hub": {"p_dot += L_b3 b^3, q_dot += M_a3 a^3"},
    "quadratic_damping": {"p_dot += L_p_abs_p p|p|, q_dot += M_q_abs_q q|q|"},
    "product": {"p_dot += L_p_q p q, q_dot += M_p_q p q"},
    "asymmetric_control": {"delta_x += X_abs_delta_x |delta_x|, delta_y += Y_abs_delta_y |delta_y|"},
    "cubic_control": {"delta_x += X_delta_x3 delta_x^3, delta_y += Y_delta_y3 delta_y^3"},
    "drift": {
        "delta_x += X_dt_delta_x (t - 16) delta_x, delta_y += Y_dt_delta_y (t - 16) delta_y",
        "a_dot += A_dt_theta_s (t - 16) theta_s, b_dot += B_dt_theta_c (t - 16) theta_c",
    },
}
"""Planted -> how the library writes it; the drift of the whole cyclic in two ways."""


def asked(parent: Candidate) -> tuple[Stepped, Whitening]:
    on = parent.dataset
    whitening = noise_whitening(parent.model, on.stacks, divide(parent.estimate.error, on.stacks, on.causes))
    return instrumental_step(parent, whitening), whitening


def ranked(parent: Candidate) -> list[Term]:
    return search(parent, *asked(parent))


def equations(term: Term) -> set[str]:
    return {term.entry.equation, *(entry.equation for entry in term.as_well)}


@pytest.mark.parametrize("planted_term", [*list(FOUND)[:3], *thorough(list(FOUND)[3:])])
def test_what_was_planted_comes_first_or_cannot_be_told_from_the_first(planted_term: str) -> None:
    parent, known, selection = searched(planted_term)
    first = search(parent, *asked(parent), known)[0]
    assert FOUND[planted_term] <= equations(first)
    assert FOUND[planted_term] <= equations(selection.terms[0])
    assert first.significant
    assert len(first.as_well) < 4
    clean = searched("none")[0]
    assert selection.error_share < 1.3 * clean.error_share
    gone = parent.error_share - selection.terms[0].error_share
    assert gone > 0.9 * (parent.error_share - selection.error_share)


def test_sizes_are_those_planted() -> None:
    sizes = {name: searched(name)[2].terms[0].coefficients for name in FOUND}
    assert sizes["cubic_hub"] == pytest.approx(np.array([147.5, 713.4]) * 40.0, rel=0.15)
    assert sizes["quadratic_damping"] == pytest.approx([-1.5, -3.0], rel=0.15)
    assert sizes["product"] == pytest.approx([-1.0, 2.5], rel=0.05)
    assert sizes["asymmetric_control"] == pytest.approx([0.1, 0.1], rel=0.05)
    assert sizes["cubic_control"] == pytest.approx([-3.0, -3.0], rel=0.25)


def test_nothing_is_found_where_nothing_is() -> None:
    parent, known, selection = searched("none")
    assert selection.terms == ()
    assert selection.error_share == pytest.approx(parent.error_share, rel=1e-3)
    assert not search(parent, *asked(parent), known)[0].significant


def test_what_the_parents_own_parameters_would_explain_is_no_term() -> None:
    """Its step leaves them where the excitation tells, which need not be where these rows alone would have them."""
    parent, known, _ = searched("none")
    stepped, whitening = asked(parent)
    here = search(parent, stepped, whitening, known, most=1)[0]
    for row in range(len(stepped.J)):
        far = 10.0 * stepped.J[row] / np.linalg.norm(stepped.J[row])  # chi squared 100, all of it the parent's
        moved = search(parent, dataclasses.replace(stepped, residual=stepped.residual + far), whitening, known, most=1)[
            0
        ]
        assert moved.number == here.number
        assert moved.log_p == pytest.approx(here.log_p, abs=1e-3)


def test_false_alarms_are_as_rare_as_said() -> None:
    flown = planted.fly_many(None, {}, seeds=range(40, 50), duration_s=8.0, steps=1)
    chances = [ranked(parent_of(records(flight)))[0].log_p for flight in flown]
    assert min(chances) > math.log(0.01)
    assert np.mean(np.array(chances) < math.log(0.5)) <= 0.5


def test_products_of_matrices_give_the_score_of_the_effect_itself() -> None:
    parent, known, _ = searched("quadratic_damping")
    stepped, whitening = asked(parent)
    effect = find("quadratic_damping")
    composed = compose("tpp", [effect], parent.dataset.available, dict(parent.model.structure.constants))
    whole = score(effect, composed, parent, stepped, whitening)
    assert whole is not None
    term = search(parent, stepped, whitening, known)[0]
    assert term.chi_squared == pytest.approx(whole.chi_squared, rel=0.02)
    assert term.coefficients == pytest.approx([whole.at["L_pp"], whole.at["M_qq"]], rel=0.05)
    assert term.standard_errors == pytest.approx([whole.errors["L_pp"], whole.errors["M_qq"]], rel=0.1)


def test_the_whole_library_takes_a_moment() -> None:
    parent, _, _ = searched("product")
    stepped, whitening = asked(parent)
    began = time.process_time()
    found = search(parent, stepped, whitening, candidate_terms(parent))
    assert time.process_time() - began < 1.5  # 0.25 on an idle core
    assert found


# ------------------------------------------------------------------------------------------ other parents and runs


def test_cylinder_dynamics_has_a_library_of_its_own() -> None:
    parent = parent_of(flights()["product"], "cd")
    rows = {row for entry in candidate_terms(parent).entries for row, _ in entry.parts}
    assert rows == {"p_dot", "q_dot", "delta_x", "delta_y", "p_m", "q_m"}
    assert ranked(parent)[0].significant


def test_a_parent_with_servo_lag_and_delay_keeps_its_terms_apart() -> None:
    parent = parent_of(flights()["quadratic_damping"], "tpp", ("servo_lag", "transport_delay"))
    assert FOUND["quadratic_damping"] <= equations(ranked(parent)[0])


def test_a_parent_that_has_the_term_already_lacks_nothing() -> None:
    parent = parent_of(flights()["quadratic_damping"], "tpp", ("quadratic_damping",))
    assert not ranked(parent)[0].significant


def test_an_unstable_parent_is_searched_all_the_same() -> None:
    parent = parent_of(flights()["product"])
    values = parent.model.values.copy()
    names = parent.model.structure.names
    values[[names.index("A_b"), names.index("B_a")]] = 3.0
    model = dataclasses.replace(parent.model, values=values)
    unstable = dataclasses.replace(parent, estimate=dataclasses.replace(parent.estimate, model=model))
    assert not unstable.model.stable
    assert all(np.all(np.isfinite(terms)) for terms in candidate_terms(unstable).flown)


def test_a_term_that_runs_away_is_worth_nothing() -> None:
    flown, imposed = np.ones((4, 4), complex), np.ones((4, 4), complex)
    flown[0, 2], imposed[1, 3], imposed[2, 1] = 1e200j, np.nan, np.inf
    (flown,), (imposed,) = _within_reach([flown], [imposed])
    assert flown.tolist() == imposed.tolist() == [[0] * 4, [0] * 4, [0] * 4, [1] * 4]


def test_one_run_is_enough() -> None:
    parent = parent_of(flights()["quadratic_damping"][1:2])
    assert FOUND["quadratic_damping"] <= equations(ranked(parent)[0])


def test_runs_of_two_rates_are_searched_together() -> None:
    flown = flights()["product"]
    slow = [Record(run.id, {name: values[::2] for name, values in run.channels.items()}) for run in flown[2:]]
    assert FOUND["product"] <= equations(ranked(parent_of([*flown[:2], *slow]))[0])


def test_select_stops_at_the_number_asked_for() -> None:
    parent, known, _ = searched("cubic_hub")
    _, whitening = asked(parent)
    assert len(select(parent, whitening, known, 1).terms) == 1


# ------------------------------------------------------------------------------------------ words


def test_expressions_are_written_as_people_and_as_programs_write_them() -> None:
    cubic = (Factor("b"),) * 3
    drag = (Factor("p"), Factor("p", "magnitude"))
    drift = (Factor("t", "deviation", 16.0), Factor("delta_x"))
    faster = (Factor("omega", "deviation"), Factor("p"), Factor("p"))
    assert [text(one) for one in (cubic, drag, drift, faster)] == [
        "b^3",
        "p|p|",
        "(t - 16) delta_x",
        "(omega/Omega_0 - 1) p^2",
    ]
    assert code(drag) == "s.p * magnitude(s.p)"
    assert code(faster) == "(s.omega / s.Omega_0 - 1) * s.p**2"


def test_the_words_of_a_program_are_what_was_scored() -> None:
    rng = np.random.default_rng(1)
    names = ("p", "q", "a", "b", "p_dot", "delta_x", "theta_s", "omega", "t")
    s = Signals({name: rng.standard_normal(5) for name in names} | {"Omega_0": 2.0})
    for one in expressions(names, dict.fromkeys(names, 1.0), 3.0, 10.0):
        again = eval(code(one), {"s": s, "np": np, "magnitude": magnitude})
        np.testing.assert_allclose(again, value(one, s), rtol=1e-12)


def test_units_follow_from_the_signals() -> None:
    b, p, t = Factor("b"), Factor("p"), Factor("t", "deviation", 3.0)
    units = [Entry((("p_dot", one),)).units for one in ((b, b), (p, p), (p,), (p, p, p), (t, b))]
    assert units == [("1/s^2",), ("-",), ("1/s",), ("s",), ("1/s^3",)]


def test_pairs_mirror_each_other() -> None:
    names = ("p", "q", "a", "b", "delta_x", "delta_y", "theta_s", "theta_c")
    made = entries(expressions(names, dict.fromkeys(names, 1.0)), ["p_dot", "q_dot", "delta_x", "delta_y"])
    pairs = {entry.equation for entry in made if len(entry.parts) == 2}
    assert "p_dot += L_b2_delta_x b^2 delta_x, q_dot += M_a2_delta_y a^2 delta_y" in pairs
    assert all(row.startswith("delta") or row.endswith("dot") for entry in made for row, _ in entry.parts)
    own = {text(one) for entry in made for row, one in entry.parts if row == "delta_x"}
    assert own
    assert not any(letter in words.replace("delta", "") for words in own for letter in "pqab")


def test_a_drift_far_from_the_clocks_zero_leaves_states_out() -> None:
    names = ("p", "delta_x", "t")
    near, far = (
        {text(one) for one in expressions(names, dict.fromkeys(names, 1.0), mean, 30.0)} for mean in (15.0, 9000.0)
    )
    assert near - {"(t - 15) p", "(t - 15) delta_x"} == far - {"(t - 9000) delta_x"}
