"""Two effects that take each other back only stand in for a third."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import pytest
from planted import PLANTED, fly_many
from planted_fits import records

from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose import opposed, verdict
from sysid.diagnose.candidates import Ranked
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import Candidate, candidate
from sysid.diagnose.opposed import CANCEL, along_each_other, cancel_each_other
from sysid.fit.estimate import estimate
from sysid.fit.identify import on_runs
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

TURNED = 0.2
HUB_OF_RUBBER = {"L_p": -3.8, "M_q": -6.4, "L_w": -56.0, "M_w": -109.0, "tau_w": 0.0685}
"""As a pair; a simulated hub, half as stiff again for quick tilts, was fitted so."""


@pytest.fixture(scope="module")
def parent() -> Candidate:
    on = dataset(records(fly_many(None, {}, seeds=[31], duration_s=8.0)[0]), (0.0, 15.0))
    return candidate(estimate(TPP, on.viewed(TPP.inputs)), (), on)


def chain(parent: Candidate, effects: tuple[str, ...], sizes: Mapping[str, float]) -> Ranked:
    composed = compose("tpp", effects, parent.dataset.available)
    model = Model(composed, composed.vector({**parent.model.by_name, **sizes}))
    found = replace(parent.estimate, model=model)
    fit = candidate(found, (), parent.dataset, effects)
    return Ranked(effects=effects, score=None, not_testable=None, fit=fit)


def test_damping_and_a_wing_that_undoes_it_stand_in_for_a_hub_of_rubber(parent: Candidate) -> None:
    pair = chain(parent, ("angular_damping", "slipstream_wing"), HUB_OF_RUBBER)
    cosine = along_each_other(pair, parent, parent.metric)
    assert cosine is not None
    assert -1 <= cosine < CANCEL
    assert cancel_each_other(pair, parent, parent.metric)


@pytest.mark.parametrize("other", ["servo_lag", "servo_backlash"])
def test_effects_of_different_parts_do_not(parent: Candidate, other: str) -> None:
    pair = chain(parent, ("angular_damping", other), {**PLANTED["angular_damping"], **PLANTED[other]})
    cosine = along_each_other(pair, parent, parent.metric)
    assert cosine is not None
    assert CANCEL < cosine <= 1
    assert not cancel_each_other(pair, parent, parent.metric)


@pytest.mark.parametrize(
    ("other", "cancel"),
    [
        ("servo_backlash", False),
        ("servo_lag", False),
        ("transport_delay", False),
        ("gyro_lag", False),
        ("gyro_misalignment", True),
        ("hub_gyroscopics", True),
    ],
)
def test_what_servos_and_gyros_make_of_signals_stands_in_for_nothing_that_flies(
    other: str, cancel: bool, parent: Candidate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Play and lags take from commands what an inflow gives: a cosine of -0.7, and both were there."""
    monkeypatch.setattr(opposed, "along_each_other", lambda *_: -0.9)
    pair = chain(parent, ("angular_damping", other), {**PLANTED["angular_damping"], **PLANTED[other]})
    assert cancel_each_other(pair, parent, parent.metric) == cancel


def test_one_effect_has_nothing_to_cancel(parent: Candidate) -> None:
    one = chain(parent, ("angular_damping",), PLANTED["angular_damping"])
    assert along_each_other(one, parent, parent.metric) is None
    assert not cancel_each_other(one, parent, parent.metric)


@pytest.mark.parametrize("only_effects", [("servo_lag", "gyro_misalignment")], indirect=True)
@pytest.mark.usefixtures("only_effects")
def test_the_first_answer_stays_where_the_chain_only_stands_in(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = fly_many("servo_lag", PLANTED["servo_lag"], seeds=[31], duration_s=8.0, noise=0.004)[0]
    flight: list[Record] = records(
        [{**run, "p": run["p"] + TURNED * run["q"], "q": run["q"] - TURNED * run["p"]} for run in runs]
    )
    monkeypatch.setattr(verdict, "cancel_each_other", lambda chain, *_: len(chain.effects) == 2)
    found = diagnose(on_runs("tpp", (), flight, flight), flight)
    alone = diagnose(on_runs("tpp", (), flight, flight), flight, chains=False)
    assert found.pairs
    assert (found.verdict, found.chain) == (alone.verdict, alone.chain)
    assert len(found.chain) == 1
    assert math.isfinite(found.confidence)
