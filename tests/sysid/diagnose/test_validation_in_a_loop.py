"""Validation runs whose excitation nobody logged: what is new there tells whether an effect is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import planted
import pytest
from planted_fits import controlled, records

from sysid.data.record import Record
from sysid.diagnose import shares, validated
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import error_share
from sysid.diagnose.shares import VALIDATED
from sysid.diagnose.verdict import Diagnosis
from sysid.model.paper import TPP

EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
BAND = (0.5, 10.0)
DAMPING = {"L_p": -3.0, "M_q": -3.0}


def fly(
    effect: str | None,
    sizes: Mapping[str, float],
    seed: int,
    *,
    seconds: float,
    gusts: float,
    without: Sequence[str] = EXCITATIONS,
) -> list[Record]:
    """Chirps in a loop of double gain, their excitation not logged."""
    with controlled(loop=2):
        (flight,) = planted.fly_many(effect, sizes, seeds=range(seed, seed + 1), duration_s=seconds, gusts=gusts)
    return records(flight, *without)


@pytest.fixture(scope="module")
def fitted() -> list[Record]:
    return fly("angular_damping", DAMPING, 9101, seconds=12.0, gusts=2.0)


def asked(runs: list[Record], validation: list[Record]) -> Diagnosis:
    return diagnose(TPP, runs, validation, BAND, chains=False)


def left_before(found: Diagnosis) -> float:
    """The parent's error share on the validation runs."""
    assert found.validation_nrmse_percent is not None
    return sum((1 - percent / 100) ** 2 for percent in found.validation_nrmse_percent.values())


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping", "hub_gyroscopics")], indirect=True)
def test_an_effect_shows_in_what_is_new(fitted: list[Record]) -> None:
    found = asked(fitted, fly("angular_damping", DAMPING, 9301, seconds=8.0, gusts=3.0)[:2])
    assert (found.verdict, found.effect) == ("missing", "angular_damping")
    assert found.winner is not None
    assert found.winner.validation_share is not None
    assert found.winner.validation_share > VALIDATED


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping", "hub_gyroscopics")], indirect=True)
def test_an_effect_that_is_not_there_follows_gusts_and_is_told_all_the_same(fitted: list[Record]) -> None:
    found = asked(fitted, fly(None, {}, 9302, seconds=8.0, gusts=2.0)[:2])
    winner = found.winner
    assert winner is not None
    assert winner.validation_error is not None
    assert winner.effect == "angular_damping"
    assert error_share(winner.validation_error) < left_before(found), "less power is left with what is not there"
    assert winner.validation_share is not None
    assert winner.validation_share + winner.validation_slack < VALIDATED
    assert found.verdict == "unexplained"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping", "hub_gyroscopics")], indirect=True)
def test_runs_that_show_too_little_say_nothing(fitted: list[Record]) -> None:
    found = asked(fitted, fly(None, {}, 9302, seconds=8.0, gusts=16.0)[:1])
    assert found.winner is not None
    assert found.winner.validation_share is None
    assert found.verdict == "missing"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping", "hub_gyroscopics")], indirect=True)
@pytest.mark.parametrize("samples", [1010, 1100])
def test_a_run_hardly_longer_than_its_noise_s_past_ends_no_diagnosis(fitted: list[Record], samples: int) -> None:
    (run,) = fly(None, {}, 9302, seconds=2.0, gusts=2.0)[:1]
    short = replace(run, channels={name: values[:samples] for name, values in run.channels.items()})
    assert asked(fitted, [short]).verdict == "missing"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping",)], indirect=True)
def test_where_the_noise_of_the_runs_is_not_told_they_say_nothing(
    fitted: list[Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_noise(*_: object) -> None:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(validated, "innovations", no_noise)
    found = asked(fitted, fly(None, {}, 9302, seconds=8.0, gusts=2.0)[:2])
    assert found.winner is not None
    assert found.winner.validation_share is None
    assert found.verdict == "missing"


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping",)], indirect=True)
@pytest.mark.parametrize(
    ("without", "measure"),
    [(EXCITATIONS, validated.ByWhatIsNew), (("excitation_y",), validated.ByWhatIsNew), ((), validated.ByPower)],
)
def test_powers_tell_where_every_command_has_its_excitation(
    fitted: list[Record], monkeypatch: pytest.MonkeyPatch, without: Sequence[str], measure: type[object]
) -> None:
    made = []

    def kept(*of: Any) -> Any:
        made.append(validated.validation_of(*of))
        return made[-1]

    monkeypatch.setattr(shares, "validation_of", kept)
    asked(fitted, fly("angular_damping", DAMPING, 9301, seconds=8.0, gusts=3.0, without=without)[:2])
    assert {type(one) for one in made} == {measure}
