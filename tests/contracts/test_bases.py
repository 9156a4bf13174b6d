"""Every base of the folder, whatever it is, keeps the same promises; and a user's file says what is wrong with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.model.base import Base, BaseError, bases, find_base
from sysid.model.bases import DEFAULT, NAMES
from sysid.model.compose import compose, not_testable
from sysid.model.effect import EffectError, catalogue
from sysid.model.response import transfer
from sysid.model.structure import Model

EACH = [pytest.param(base, id=name) for name, base in bases().items()]
FREQUENCY_HZ = np.geomspace(0.2, 12.0, 9)


def test_the_paper_s_bases_come_first_and_the_simplest_before_the_larger() -> None:
    assert list(bases())[:2] == ["cd", "tpp"], "a base of another rank stands behind them"
    assert set(NAMES) == set(bases())
    assert DEFAULT in bases()


@pytest.mark.parametrize("base", EACH)
def test_what_it_names_exists(base: Base) -> None:
    assert set(base.contains) | set(base.absorbs) <= set(catalogue())
    assert base.reduces_to is None or base.reduces_to in bases()
    assert set(base.watched) <= {one.name for one in base.parameters}
    for name in (*base.contains, *base.absorbs):
        assert "not testable" in (not_testable(catalogue()[name], base, [name], ()) or "")


@pytest.mark.parametrize("base", EACH)
def test_its_uncoupled_point_is_stable(base: Base) -> None:
    model = Model(compose(base), np.array(base.uncoupled, float))
    assert np.all(np.linalg.eigvals(model.matrices.A).real < 0)


@pytest.mark.parametrize("base", [one for one in EACH if bases()[str(one.id)].form is not None])
def test_its_form_says_the_same_as_its_equations(base: Base) -> None:
    form = base.form
    assert form is not None
    values = np.array([one.typical for one in base.parameters]) * np.linspace(0.8, 1.3, len(base.parameters))
    coefficients = form.of_parameters(values)
    np.testing.assert_allclose(form.to_parameters(coefficients), values, rtol=1e-12)
    s = np.asarray(2j * np.pi * FREQUENCY_HZ, dtype=np.complex128)
    D = np.array(form.denominator(s, coefficients)).reshape(2, 2, -1)
    answer = np.linalg.solve(np.moveaxis(D, -1, 0), coefficients[-4:].reshape(2, 2)[None].astype(complex))
    np.testing.assert_allclose(np.moveaxis(answer, 0, -1), transfer(compose(base), values, FREQUENCY_HZ), rtol=1e-9)


@pytest.mark.parametrize("larger", [one for one in EACH if bases()[str(one.id)].reduces_to is not None])
def test_an_effect_that_a_larger_base_contains_makes_that_base_of_the_smaller(larger: Base) -> None:
    assert larger.reduces_to is not None
    for name in larger.contains:
        grown = compose(larger.reduces_to, [name])
        assert (grown.base, grown.effects) == (larger.name, ())


SLIPS = {
    "BASE = 3": "BASE is not a Base but int",
    "x = 1": "not a base file .*no attribute 'BASE'",
    "raise SystemExit(3)": r"not a base file \(SystemExit: 3\)",
    "def f(:": "not a base file .*SyntaxError",
}
WHOLE = """
from sysid.model.base import Base
from sysid.model.parameter import Parameter
BASE = Base(name="{name}", title="mine", states=("p", "q"), outputs={outputs}, parameters=(Parameter("k", "1/s", "k"),),
            equations=lambda s: {equations}, uncoupled={uncoupled})
"""
GOOD = {
    "name": "mine",
    "outputs": ("p", "q"),
    "equations": '{"p_dot": s.k * s.p, "q_dot": s.k * s.q}',
    "uncoupled": (-1,),
}
WRONG = {
    "name": ("tpp", "the name tpp is taken"),
    "outputs": (("p", "a"), "the output a is not both a state and a channel"),
    "uncoupled": ((), "uncoupled has 0 values for 1 parameters"),
}


@pytest.mark.parametrize("text", SLIPS)
def test_a_file_that_is_no_base_is_refused_in_a_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(BaseError, match=SLIPS[text]):
        find_base(str(path))


@pytest.mark.parametrize("part", WRONG)
def test_a_base_whose_parts_do_not_fit_is_refused(tmp_path: Path, part: str) -> None:
    path = tmp_path / "mine.py"
    path.write_text(WHOLE.format(**{**GOOD, part: WRONG[part][0]}), encoding="utf-8")
    with pytest.raises(BaseError, match=WRONG[part][1]):
        find_base(str(path))


def test_a_user_s_base_is_known_by_its_path_and_its_hash(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(WHOLE.format(**GOOD), encoding="utf-8")
    structure = compose(str(path))
    assert (structure.base, structure.base_.label, structure.files) == (str(path), "MINE", (str(path),))
    assert len(structure.base_.sha256 or "") == 64


def test_equations_that_fail_are_said_before_a_fit_begins(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(WHOLE.format(**{**GOOD, "equations": '{"p_dot": s.nothing, "q_dot": s.q}'}), encoding="utf-8")
    with pytest.raises(EffectError, match=r"mine\.py: its equations fail \(AttributeError: nothing\)"):
        compose(str(path))


def test_an_unknown_word_is_answered_with_what_there_is() -> None:
    with pytest.raises(BaseError, match="did you mean tpp"):
        find_base("ttp")
    with pytest.raises(BaseError, match=r"there are cd, tpp.*files of your own"):
        find_base("blimp")
    with pytest.raises(BaseError, match="cannot be read"):
        find_base("nowhere.py")


def test_outputs_are_states_that_records_can_hold() -> None:
    assert compose("tpp", outputs=("q", "a")).outputs == ("q", "a")
    for outputs in ((), ("p", "p"), ("p", "omega"), ("nothing",)):
        with pytest.raises(EffectError, match="can be measured in p, q, a, b"):
            compose("tpp", outputs=outputs)
    with pytest.raises(EffectError, match="can be measured in p, q, each once"):
        compose("cd", outputs=("p", "q", "a"))
