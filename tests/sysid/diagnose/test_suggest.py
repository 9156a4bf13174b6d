"""A suggestion is a file that loads, fits, and keeps what the search promised."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from planted_terms import TERMS, flights, searched

from sysid.diagnose.suggest import Suggestion, SuggestionError, suggest
from sysid.diagnose.term_search import Term
from sysid.diagnose.terms import Entry, Factor
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.effect import Stage, load

PLANTED = tuple(term for term in TERMS if term != "none")
TPP = compose("tpp")
LIKE_ANOTHER = ("cubic_control", "quadratic_damping")
"""Of commands as two others are, and of moments."""


def suggested(term: str) -> Suggestion:
    return suggest(searched(term)[2].terms[:1], TPP, 4)


@pytest.fixture(scope="module")
def with_file(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Fit, Path]]:
    """The fit with the file that is suggested for a planted term, and the file."""

    @cache
    def fitted(term: str) -> tuple[Fit, Path]:
        path = _written(suggested(term), tmp_path_factory.mktemp(term) / "mine.py")
        return identify(compose("tpp"), flights()[term], effects=[str(path)]), path

    return fitted


def error_share(fit: Fit) -> float:
    return float(sum((1 - percent / 100) ** 2 for percent in fit.nrmse_percent.values()))


def noise_share(term: str) -> float:
    """What the same flight leaves without the term, over what was measured with it."""
    clean, measured = searched("none")[0].estimate.error, searched(term)[0].estimate.error
    return float(np.sum(clean.residual_power / measured.measured_power))


@pytest.mark.parametrize(
    "term", [pytest.param(term, marks=pytest.mark.thorough if term in LIKE_ANOTHER else ()) for term in PLANTED]
)
def test_the_written_file_explains_what_was_planted(term: str, with_file: Callable[[str], tuple[Fit, Path]]) -> None:
    parent, _, selection = searched(term)
    written = suggested(term)
    fit, _ = with_file(term)
    left = error_share(fit)
    assert (parent.error_share - left) / (parent.error_share - noise_share(term)) > 0.9
    assert left < 1.05 * selection.terms[0].error_share  # which is least squares', the fit weighs by the noise
    assert not fit.at_bound
    assert len(written.text.splitlines()) <= 26
    assert max(map(len, written.text.splitlines())) <= 120


def test_the_effect_in_memory_is_the_one_in_the_file(with_file: Callable[[str], tuple[Fit, Path]]) -> None:
    written = suggested("asymmetric_control")
    from_file, path = with_file("asymmetric_control")
    from_memory = identify(compose("tpp"), flights()["asymmetric_control"], effects=[written.effect])
    np.testing.assert_allclose(from_memory.model.values, from_file.model.values, rtol=1e-9)
    loaded = dataclasses.replace(load(path), path=None, sha256=None, equations=None)
    assert loaded == dataclasses.replace(written.effect, equations=None)


def test_several_terms_go_into_one_file(tmp_path: Path) -> None:
    written = suggest([searched(term)[2].terms[0] for term in ("quadratic_damping", "cubic_hub")], TPP, 4)
    assert len(written.terms) == 2
    effect = load(_written(written, tmp_path / "both.py"))
    assert len(effect.parameters) == sum(term.degrees for term in written.terms)
    assert effect.stage is Stage.DYNAMICS
    assert "and 1 more" in effect.title


def test_rivals_are_named_in_the_file_and_beside_it() -> None:
    written = suggested("drift")
    assert written.warning is not None
    assert "cannot tell" in written.warning
    assert "cannot tell" in written.text.replace("\n", " ")
    assert suggested("asymmetric_control").warning is None


def test_nothing_significant_is_not_written() -> None:
    with pytest.raises(SuggestionError, match="nothing to write"):
        suggest(searched("none")[2].terms, TPP, 4)


# ------------------------------------------------------------------------------------------ every kind of term


def term(*parts: tuple[str, tuple[Factor, ...]], as_well: tuple[Entry, ...] = ()) -> Term:
    sizes = np.linspace(-2.0, 3.0, len(parts))
    return Term(
        entry=Entry(parts),
        chi_squared=900.0,
        degrees=len(parts),
        log_p=-400.0,
        log_p_surely=-400.0,
        coefficients=sizes,
        standard_errors=0.01 * np.abs(sizes),
        error_share=0.01,
        as_well=as_well,
    )


def _written(one: Suggestion, path: Path) -> Path:
    path.write_text(one.text, encoding="utf-8")
    return path


P, Q, B = Factor("p"), Factor("q"), Factor("b")
KINDS = {
    "friction": term(("p_dot", (Factor("p", "sign", 0.02),)), ("q_dot", (Factor("q", "sign", 0.03),))),
    "sensor": term(("p_m", (P, Q)), ("q_m", (P, Q))),
    "rotor speed": term(("p_dot", (Factor("omega", "deviation"), B))),
    "rates": term(("a_dot", (Factor("q_dot"), Factor("p")))),
    "linear": term(("p_dot", (Factor("delta_c"),))),
    "command": term(("delta_x", (Factor("t", "deviation", 16.0), Factor("delta_x")))),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_term_makes_a_file_that_composes(kind: str, tmp_path: Path) -> None:
    written = suggest([KINDS[kind]], TPP, 1)
    path = _written(written, tmp_path / "mine.py")
    structure = compose("tpp", [str(path)], {"t", "p", "q", "omega", "delta_c"}, {"Omega_0": 170.0})
    assert set(written.effect.names) <= set(structure.names)
    assert written.effect.linear == (kind == "linear")
    rng = np.random.default_rng(2)
    signals = {name: rng.standard_normal(6) for name in (*structure.states, *structure.inputs)}
    values = {one.name: one.typical for one in structure.parameters}
    in_file = structure.evaluate(values, signals)
    in_memory = compose("tpp", [written.effect], {"t", "p", "q", "omega", "delta_c"}, {"Omega_0": 170.0})
    for mine, its in zip(in_memory.evaluate(values, signals), in_file, strict=True):
        for name, samples in mine.items():
            np.testing.assert_allclose(np.broadcast_to(its[name], 6), np.broadcast_to(samples, 6), rtol=1e-12)


def test_terms_of_another_stage_or_without_room_are_left_out() -> None:
    pair = [term(("p_dot", (P, P, B)), ("q_dot", (Q, Q, Factor("a")))), term(("p_dot", (P, Q)), ("q_dot", (P, Q)))]
    written = suggest([KINDS["friction"], KINDS["sensor"], *pair], TPP, 1)
    assert written.terms == (KINDS["friction"], pair[0])
    assert written.left_out == (KINDS["sensor"], pair[1])
    assert max(map(len, written.text.splitlines())) <= 120


def test_a_coefficient_is_written_once() -> None:
    pair, half = term(("p_dot", (B, B)), ("q_dot", (Factor("a"),) * 2)), term(("p_dot", (B, B)))
    written = suggest([pair, half], TPP, 1)
    assert written.terms == (pair,)
    assert written.left_out == (half,)


def test_names_of_the_base_are_left_alone(tmp_path: Path) -> None:
    written = suggest([term(("a_dot", (B,)), ("b_dot", (Factor("a"),)))], TPP, 1)
    assert compose("tpp", [str(_written(written, tmp_path / "mine.py"))]).names[-2:] == ("A_b1", "B_a1")


def test_many_rivals_are_counted() -> None:
    rivals = tuple(Entry((("p_dot", (P,) * n),)) for n in (2, 3)) * 4
    written = suggest([term(("p_dot", (P, Q)), as_well=rivals)], TPP, 1)
    assert written.warning is not None
    assert "6 more" in written.warning
    assert len(written.text.splitlines()) <= 26
