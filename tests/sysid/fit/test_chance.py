"""Chances of chi squared against SciPy's, and beyond where SciPy's are zero."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.fft import next_fast_len
from scipy.special import chdtrc, chdtri, chndtrinc, log_ndtr

from sysid.data.preprocess import fast_length
from sysid.fit.chance import exceeded_by, log_chance, log_chance_of_normal, noncentrality


@pytest.mark.parametrize("degrees", [1, 2, 3, 8, 51, 400])
def test_chances_are_those_of_tables(degrees: int) -> None:
    for chi_squared in (1e-3, 0.7, 5.0, 40.0, 300.0, 900.0):
        expected = float(chdtrc(degrees, chi_squared))
        if expected > 1e-290:
            assert log_chance(chi_squared, degrees) == pytest.approx(math.log(expected), rel=1e-10, abs=1e-12)


def test_no_chance_is_too_small_to_tell() -> None:
    assert log_chance(1e6, 4) == pytest.approx(-0.5e6 + math.log(0.5e6 + 1))
    assert log_chance(0.0, 4) == 0.0


def test_of_normal_deviates_too() -> None:
    for deviation in (0.0, 0.3, 4.0, 27.0, 28.3, 29.0, 500.0):
        assert log_chance_of_normal(deviation) == pytest.approx(math.log(2) + float(log_ndtr(-deviation)), rel=1e-9)


@pytest.mark.parametrize("degrees", [1, 2, 6])
def test_limits_and_what_passes_them(degrees: int) -> None:
    limit = exceeded_by(1e-6, degrees)
    assert limit == pytest.approx(float(chdtri(degrees, 1e-6)))
    assert noncentrality(limit, degrees, 0.2) == pytest.approx(float(chndtrinc(limit, degrees, 0.2)))


def test_lengths_of_quick_transforms() -> None:
    assert [fast_length(n) for n in (1, 13, 997, 4801)] == [next_fast_len(n) for n in (1, 13, 997, 4801)]
    assert all(fast_length(n) == next_fast_len(n) for n in np.random.default_rng(0).integers(1, 50_000, 20).tolist())
