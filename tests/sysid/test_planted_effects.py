"""Every effect comes back from data that an independent integrator made with it: closed loop, gusts, sensor noise.

One flight each; `make study` flies many. The closed loop's gusts and the noise are those of `tests/planted.py`.
"""

from __future__ import annotations

import pytest
from planted import FORWARD, PLANTED, fly

from sysid.identify import identify
from sysid.record import Record
from sysid.result import Fit
from sysid.structures import compose

UNERRING = {"phi", "theta"}
NEEDS = {
    "airspeed_scaling": ["angular_damping", "elevator"],
}


def records(effect: str, seed: int) -> list[Record]:
    """The flight's runs, without attitude: it is logged without error there, and effects integrate it themselves."""
    runs = fly(effect, PLANTED[effect], seed=seed, forward=effect in FORWARD, vanes=effect == "disc_incidence")
    return [
        Record(f"{effect}#{number}", {name: values for name, values in run.items() if name not in UNERRING})
        for number, run in enumerate(runs, 1)
    ]


def fitted(effect: str, seed: int) -> Fit:
    base = ["angular_damping", "elevator"] if effect in FORWARD else []
    added = [one for one in [*base, *NEEDS.get(effect, []), effect] if one]
    return identify(compose("tpp"), records(effect, seed), effects=list(dict.fromkeys(added)))


@pytest.mark.parametrize("effect", sorted(PLANTED))
def test_a_planted_effect_comes_back(effect: str) -> None:
    fit = fitted(effect, 7)
    values = dict(zip(fit.model.structure.names, fit.model.values, strict=True))
    errors = dict(zip(fit.model.structure.names, fit.standard_errors, strict=True))
    for name, truth in PLANTED[effect].items():
        if name in values:
            assert name not in fit.at_bound
            assert abs(values[name] - truth) < 4 * errors[name], (
                f"{values[name]:.4g} ± {errors[name]:.2g}, planted {truth}"
            )
    assert len(fit.lineage) >= 2
    before, after = fit.lineage[-2].nrmse_percent, fit.lineage[-1].nrmse_percent
    assert sum(after.values()) > sum(before.values())
