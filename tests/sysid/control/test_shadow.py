"""A controller run over what was flown, and what a bank that ran wrongly is told from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from planted import DT
from shadow_vehicles import FAULTS, Bank, asked_for, bank, good, ran, swept, vehicle

from sysid.control.regulator import Gains
from sysid.control.shadow import Fault, Output, OverStretch, RanStretch, faults_of, outputs, put_out, refused_by
from sysid.control.stability import ClosedLoop
from sysid.model.paper import TPP
from sysid.model.structure import Model

Flown = tuple[Bank, Gains, dict[str, Any]]


@pytest.fixture(scope="module")
def flown() -> Flown:
    rng = np.random.default_rng(7)
    flies = vehicle(rng, "servo")
    run = swept(flies, rng, seconds=12.0)[0]
    one = next(one for one in (bank(flies.numbers, rng) for _ in range(99)) if good(flies, one))
    none = np.zeros(4)
    gains = Gains(
        model=Model(TPP, TPP.vector(one.model)), K=one.K, observer_gain=one.L, prefilter=one.prefilter, poles=none,
        observer_poles=none, input_cost=1.0, loop=ClosedLoop(None),
    )  # fmt: skip
    return one, gains, run


def stretch(run: dict[str, Any], **more: Any) -> OverStretch:
    return OverStretch(
        rates=np.stack([run["p"], run["q"]], axis=1),
        commands=np.stack([run["delta_x"], run["delta_y"]], axis=1),
        targets=asked_for(run),
        **more,
    )


def found(flown: Flown, fault: str | None) -> tuple[Fault, ...]:
    one, gains, run = flown
    over = stretch(run)
    beside = RanStretch(rates=over.rates, commands=over.commands, targets=over.targets, output=ran(one, run, fault))
    return faults_of(gains, DT, [beside])


def test_it_puts_out_what_another_writing_of_it_does(flown: Flown) -> None:
    one, gains, run = flown
    np.testing.assert_allclose(put_out(gains, DT, stretch(run)).output, ran(one, run), rtol=1e-4, atol=1e-6)
    assert found(flown, None) == ()
    assert faults_of(gains, DT, []) == ()


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("rates: roll's sign", [("sign", "rates", "roll", None)]),
        ("commands: pitch's sign", [("sign", "commands", "pitch", None)]),
        ("output: swapped", [("swapped", "output", None, None)]),
        ("rates: swapped", [("swapped", "rates", None, None)]),
        ("rates: degrees", [("scale", "rates", axis, pytest.approx(57.296, rel=1e-3)) for axis in ("roll", "pitch")]),
        ("targets: 1.1", [("scale", "targets", axis, pytest.approx(1.1, rel=1e-3)) for axis in ("roll", "pitch")]),
        ("output: roll alone 1.2", [("scale", "output", "roll", pytest.approx(1.2, rel=1e-3))]),
        ("rates: 1 late", [("late", "rates", None, pytest.approx(DT))]),
        ("commands: 5 late", [("late", "commands", None, pytest.approx(5 * DT))]),
        ("output: 12 late", [("late", "output", None, pytest.approx(12 * DT))]),
        ("its own command", [("own command", "commands", None, None)]),
        ("nothing put out", [("no answer", "output", None, None)]),
    ],
)
def test_a_fault_is_called_by_its_name(flown: Flown, fault: str, said: list[tuple[Any, ...]]) -> None:
    assert [(one.kind, one.place, one.axis, one.value) for one in found(flown, fault)] == said


@pytest.mark.parametrize("fault", FAULTS[::3])
def test_every_fault_is_refused(flown: Flown, fault: str) -> None:
    assert found(flown, fault)


def test_another_bank_is_not_explained_by_a_sign_a_scale_or_a_time(flown: Flown) -> None:
    assert [one.kind for one in found(flown, "another bank")] == ["other"]


def test_commands_beyond_full_refuse_only_where_nothing_is_excited(flown: Flown) -> None:
    _, gains, run = flown
    excitation = np.stack([run["excitation_x"], run["excitation_y"]], axis=1)
    wild = replace(gains, K=1e3 * gains.K)
    rolling, _ = outputs(gains, DT, [stretch(run, excitation=excitation)], 12.0)
    assert rolling.saturated_at_rest is None, "a sweep ends with a second of rest"
    hover = {name: values[: round(5 / DT)] * 1.0 for name, values in run.items()}
    quiet = np.zeros((round(5 / DT), 2))
    loud = outputs(wild, DT, [stretch(hover, excitation=quiet)], 12.0)
    assert [one.kind for one in refused_by(loud)] == ["saturates", "saturates"]
    assert refused_by(outputs(wild, DT, [stretch(run)], 12.0)) == (), "nothing tells what was excited"
    assert refused_by([rolling]) == ()


def test_what_a_controller_adds_is_measured(flown: Flown) -> None:
    _, gains, run = flown
    roll, pitch = outputs(gains, DT, [stretch(run)], 12.0)
    doubled, _ = outputs(replace(gains, K=2 * gains.K, prefilter=2 * gains.prefilter), DT, [stretch(run)], 12.0)
    for name in ("rms", "largest", "rate", "largest_rate", "noise"):
        assert getattr(doubled, name) == pytest.approx(2 * getattr(roll, name))
    assert doubled.flown_rms == roll.flown_rms == pytest.approx(np.std(run["delta_x"][250:]), rel=0.05)
    assert 0 < pitch.innovation < 1


def test_innovations_beyond_what_other_flights_predict_refuse(flown: Flown) -> None:
    _, gains, run = flown
    usual = outputs(gains, DT, [stretch(run)], 12.0)
    strange: list[Output] = [replace(one, innovation=2.5 * one.innovation + 0.06) for one in usual]
    assert refused_by(usual, usual) == ()
    assert [(one.kind, one.axis) for one in refused_by(strange, usual)] == [
        ("innovations", "roll"),
        ("innovations", "pitch"),
    ]
