"""Tables of monomials against the equations that they stand for, by complex steps."""

from __future__ import annotations

import numpy as np
import pytest
from planted import TABLE_4

from sysid.model import monomials
from sysid.model.compose import compose
from sysid.model.effect import EffectError, catalogue
from sysid.model.structure import COMPLEX_STEP, Structure, stepped

EVERY_CHANNEL = {"omega", "airspeed", "alpha", "beta", "r", "phi", "theta", "t", "delta_c", "delta_r", "delta_e"}
CONSTANTS = {"Omega_0": 170.0, "V_0": 12.0}


def _values(structure: Structure) -> np.ndarray:
    known = dict.fromkeys(structure.names, 0.0) | {one.name: 1.1 * one.typical for one in structure.parameters}
    return structure.vector({**known, **{name: TABLE_4[name] for name in structure.names if name in TABLE_4}})


@pytest.mark.parametrize("effect", [None, *catalogue()])
@pytest.mark.parametrize("base", ["tpp", "cd"])
def test_tables_say_what_equations_say(base: str, effect: str | None) -> None:
    try:
        structure = compose(base, [effect] if effect else [], EVERY_CHANNEL, CONSTANTS)
    except EffectError:
        pytest.skip("no such composition")
    values = _values(structure)
    found = monomials.linearised(structure, values)
    expected = structure.matrices(stepped(values))
    for here, moved, both in zip(*found, expected, strict=True):
        size = np.max(np.abs(both), initial=1.0)
        np.testing.assert_allclose(here, both[0].real, rtol=1e-12, atol=1e-13 * size)
        np.testing.assert_allclose(moved, both.imag / COMPLEX_STEP, rtol=1e-12, atol=1e-13 * size)


def test_most_of_the_catalogue_is_sums_of_monomials() -> None:
    """Beside them sines, and powers that are parameters."""
    assert monomials._table(compose("tpp", ["structural_mode"])) is not None
    assert monomials._table(compose("tpp", ["quadratic_damping"])) is None
