"""A narrow mode that gusts drown in power is found from the base alone, without that a diagnosis says where it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from more_of_a_kind import thorough
from planted import fly_many
from planted_fits import in_standard_errors, records

from sysid.errors import FitError
from sysid.fit import estimate
from sysid.fit.identify import identify
from sysid.fit.result import Fit
from sysid.model.compose import compose
from sysid.model.structure import Model

TWO_MODES = {
    "frequency_roll": 7.0, "zeta_roll": 0.03, "kappa_roll": 0.05,
    "frequency_pitch": 9.0, "zeta_pitch": 0.04, "kappa_pitch": 0.05,
}  # fmt: skip
LAG_MODE = {"frequency_lag": 10.4, "zeta_lag": 0.03, "gain": 0.02}
"""Between the points where a search begins."""
NEAR = 4.0
"""Standard errors."""
FAR = 0.5
"""Of a frequency."""


def fitted(effect: str, sizes: Mapping[str, float], seed: int) -> Fit:
    flight = records(fly_many(effect, sizes, seeds=[seed], duration_s=16.0)[0])
    return identify(compose("tpp"), flight, effects=(effect,))


def test_a_search_that_fails_leaves_the_fit_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    grown, failed = estimate.grow, []

    def fails(*asked: Any) -> Model:
        if len(asked) < 5:
            return grown(*asked)
        failed.append(asked)
        raise FitError("no start of lead_lag has a response that settles on these runs")

    monkeypatch.setattr(estimate, "grow", fails)
    stands = fitted("lead_lag", LAG_MODE, 82)
    assert failed
    monkeypatch.setattr(estimate, "_deeper", lambda found, *_: found)
    np.testing.assert_array_equal(stands.model.values, fitted("lead_lag", LAG_MODE, 82).model.values)


@pytest.mark.parametrize(
    ("effect", "sizes", "seed"), [("structural_mode", TWO_MODES, 87), *thorough([("lead_lag", LAG_MODE, 82)])]
)
def test_a_mode_that_power_does_not_show_is_found_by_the_noise(
    effect: str, sizes: Mapping[str, float], seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert max(map(abs, in_standard_errors(fitted(effect, sizes, seed), sizes).values())) < NEAR
    monkeypatch.setattr(estimate, "_deeper", lambda found, *_: found)  # by all power it is somewhere else
    by_power = fitted(effect, sizes, seed).model  # of a mode that is as good as gone no standard error is finite
    assert any(abs(by_power[name] - size) > FAR * size for name, size in sizes.items() if name.startswith("frequency"))
