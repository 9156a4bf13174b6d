"""Sizes on runs of another amplitude: those of what is there agree, those of what only resembles it do not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from planted import fly_many
from planted_fits import records
from strangers.asking import ask
from strangers.flights import fly

from sysid.data.dataset import dataset
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.data.record import Record
from sysid.diagnose import size_check
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.size_check import Size, sizes
from sysid.diagnose.verdict import LARGEST_DIFFERENCE, Diagnosis
from sysid.fit.identify import on_runs
from sysid.model.effect import catalogue
from sysid.model.parameter import Parameter

SECONDS = 20.0
TAU_S = 0.03
LESS = 0.75
IN_BURSTS = 4065461
"""A hover's drift: slow gusts of the runs that judge are taken for a drag that pushes, by six standard errors."""
OF_A_MODE = 4098711
"""Of 5.5 and 6.6 Hz, in an untold loop: of the one in roll the doublets that judge tell little."""
MOVING = ("delta_x", "delta_y", "p", "q")


@cache
def lagging(tau_s: float, seed: int) -> tuple[Record, ...]:
    return tuple(records(fly_many("servo_lag", {"tau_s": tau_s}, seeds=[seed], duration_s=SECONDS)[0]))


def asked(other: float) -> Diagnosis:
    """A vehicle with a lag, judged by runs of one with another lag."""
    flight = lagging(TAU_S, 71)
    return diagnose(on_runs("tpp", (), flight, flight), flight, lagging(other, 72), chains=False)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "servo_lag", "transport_delay")], indirect=True)
def test_one_size_holds() -> None:
    found = asked(TAU_S)
    assert found.verdict == "missing"
    assert [one.parameter.name for one in found.sizes] in (["tau_s"], ["tau_g"])
    assert found.sizes[0].off == 0
    assert found.sizes[0].elsewhere == pytest.approx(TAU_S, abs=4 * found.sizes[0].elsewhere_error)
    assert not found.sizes_that_differ


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "servo_lag", "transport_delay")], indirect=True)
def test_an_effect_whose_size_differs_elsewhere_only_resembles_what_is_there() -> None:
    """It explains most of the error there, too: that alone would not show it."""
    found = asked(LESS * TAU_S)
    assert found.winner is not None
    assert found.winner.validation_share is not None
    assert found.winner.validation_share > 0.6
    assert (found.verdict, found.effect) == ("unexplained", None)
    assert len(found.chain) == 1
    (size,) = found.sizes_that_differ
    assert size.off == pytest.approx(1 - LESS, abs=0.1)
    assert found.to_json()["sizes"][0]["validation"] == pytest.approx(LESS * TAU_S, rel=0.1)


@pytest.mark.usefixtures("few_effects")
@pytest.mark.parametrize("few_effects", [("servo_saturation",)], indirect=True)
def test_runs_that_do_not_determine_a_size_say_nothing() -> None:
    """A limit that no command reaches is not contradicted."""
    flight = records(fly_many("servo_saturation", {"limit": 0.12}, seeds=[73], duration_s=SECONDS)[0])
    found = diagnose(on_runs("tpp", (), flight, flight), flight, chains=False)
    assert found.effect == "servo_saturation"
    assert found.winner is not None
    assert found.winner.fit is not None
    gentle = [
        Record(
            one.id, {**one.channels, **{name: 0.3 * one.channels[name] for name in ("delta_x", "delta_y", "p", "q")}}
        )
        for one in flight
    ]
    other = dataset(gentle, DEFAULT_BAND_HZ, found.parent.dataset)
    assert sizes(found.winner.fit, ("servo_saturation",), other) == ()
    (same,) = sizes(found.winner.fit, ("servo_saturation",), found.parent.dataset)
    assert same.elsewhere == pytest.approx(same.fitted, rel=0.02)


@pytest.mark.parametrize(("elsewhere", "error", "off"), [(0.8, 0.01, 0.17), (0.8, 0.1, 0.0), (-1.0, 0.0, 2.0)])
def test_chance_is_taken_off(elsewhere: float, error: float, off: float) -> None:
    parameter = catalogue()["servo_lag"].parameters[0]
    size = Size(parameter=parameter, fitted=1.0, error=0.0, elsewhere=elsewhere, elsewhere_error=error)
    assert size.off == pytest.approx(off)
    assert (size.off > LARGEST_DIFFERENCE) is (off > LARGEST_DIFFERENCE)


def test_what_follows_other_runs_as_well_as_it_was_fitted_is_not_off() -> None:
    parameter = catalogue()["servo_lag"].parameters[0]
    size = Size(parameter=parameter, fitted=1.0, error=0.0, elsewhere=0.5, elsewhere_error=0.01)
    assert size.off > LARGEST_DIFFERENCE
    assert replace(size, by_chance=True).off == 0


def test_what_a_coupling_adds_elsewhere_is_held_against_all_of_it() -> None:
    minor = next(one for one in catalogue()["input_coupling"].parameters if one.name == "L_delta_c")
    alone = Size(parameter=minor, fitted=-5.1, error=0.8, elsewhere=1.0, elsewhere_error=0.8)
    assert alone.off > LARGEST_DIFFERENCE
    assert replace(alone, whole=17.0).off < LARGEST_DIFFERENCE
    assert replace(alone, whole=2.0).off == alone.off


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("speed_stability", "attitude_stiffness")], indirect=True)
def test_a_kind_that_is_not_possible_elsewhere_contradicts_none(monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = fly(IN_BURSTS)
    found = ask(stranger).first
    assert (found.verdict, found.effect) == ("missing", "speed_stability")
    assert "Y_v" not in {one.parameter.name for one in found.sizes}
    monkeypatch.setattr(Parameter, "sizes", property(lambda _: True))
    sizes.cache_clear()
    contradicted = ask(stranger).first
    assert contradicted.verdict == "unexplained"
    (drag,) = contradicted.sizes_that_differ
    assert (drag.parameter.name, drag.elsewhere > 0) == ("Y_v", True)
    sizes.cache_clear()


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("structural_mode", "dynamic_inflow")], indirect=True)
def test_what_loses_little_of_all_that_it_explains_elsewhere_is_not_off(monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = fly(OF_A_MODE)
    found = ask(stranger).first
    assert (found.verdict, found.effect) == ("missing", "structural_mode")
    (roll,) = [one for one in found.sizes if one.parameter.name == "frequency_roll"]
    truth = stranger.hidden.sizes[0]["frequency_roll"]
    assert roll.fitted == pytest.approx(truth, rel=0.02)
    assert roll.elsewhere > 1.5 * truth, "another valley, in which a little is lost"
    sizes.cache_clear()
    monkeypatch.setattr(size_check, "LITTLE", 0.0)
    before = ask(stranger).first
    assert before.verdict == "unexplained"
    assert [one.parameter.name for one in before.sizes_that_differ] == ["frequency_roll"]
    sizes.cache_clear()


def test_of_many_sizes_one_is_soon_another_by_chance() -> None:
    """The drag of a hover's drift, one of four numbers, was of the other sign on doublets in slow gusts."""
    parameter = Parameter("M_u", "rad/s/m", "", plausible=(-10.0, 10.0))
    alone = Size(parameter=parameter, fitted=6.37, error=1.13, elsewhere=-5.62, elsewhere_error=3.3)
    assert alone.off > LARGEST_DIFFERENCE
    assert replace(alone, asked=4).off < LARGEST_DIFFERENCE
