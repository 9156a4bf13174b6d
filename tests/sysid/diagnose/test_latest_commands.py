"""In a loop at a band's edge the latest command knows a little of what is new: what it alone explains is no effect."""

from __future__ import annotations

from collections.abc import Sequence

import planted
import pytest
from planted_fits import controlled, records
from strangers.asking import records as records_of
from strangers.flights import as_planned, planned
from strangers.hiding import NOTHING
from study_stronger_loops import CASES, harder

from sysid.data.band import USUAL, swept_band
from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import Candidate, candidate
from sysid.diagnose.score import log_chance
from sysid.diagnose.shares import OLDER, latest_alone
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.estimate import estimate
from sysid.fit.innovations import Innovations
from sysid.model.paper import TPP

SEED = 70045
"""A training one: a small helicopter that hides nothing, 500 Hz; a strong loop doubled, fourfold gusts."""
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")


@pytest.fixture(scope="module")
def clean() -> Sequence[Record]:
    return records_of(as_planned(harder(planned(SEED), CASES[SEED % len(CASES)]), NOTHING))


def band_hz(runs: Sequence[Record]) -> tuple[float, float]:
    return (swept_band(runs) or USUAL).hz


def asked(runs: Sequence[Record]) -> Diagnosis:
    return diagnose(TPP, runs[:4], (), band_hz(runs), chains=False)


def without_effects(runs: Sequence[Record]) -> Candidate:
    fitted = dataset(runs[:4], band_hz(runs))
    return candidate(estimate(TPP, fitted.viewed(TPP.inputs), weights="constant"), (), fitted)


def older(parent: Candidate) -> tuple[float, int]:
    assert isinstance(parent.metric, Innovations)
    step = parent.stepped
    return parent.metric.surprise(step.residual, step.J, parent.division.commands, youngest=2)


def test_what_the_latest_command_alone_explains_is_the_loops(clean: Sequence[Record]) -> None:
    parent = without_effects(clean)
    left = parent.division
    assert log_chance(left.chi_squared, left.degrees) < -50
    chi_squared, degrees = older(parent)
    assert chi_squared - degrees < 0.8 * OLDER * (left.chi_squared - left.degrees)
    assert latest_alone(parent)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("servo_lag", "lead_lag", "angular_damping")], indirect=True)
def test_that_is_no_alarm(clean: Sequence[Record], monkeypatch: pytest.MonkeyPatch) -> None:
    assert (found := asked(clean)).verdict == "unexplained"
    assert found.reason == "feedback"
    monkeypatch.setattr("sysid.diagnose.shares.OLDER", -1.0)
    assert asked(clean).reason is None, "what is significant would be an alarm"


def test_what_an_effect_shows_older_commands_explain_too() -> None:
    with controlled(loop=2):
        (flight,) = planted.fly_many(
            "angular_damping", {"L_p": -3.0, "M_q": -3.0}, seeds=[9101], duration_s=12.0, gusts=2.0
        )
    parent = without_effects(records(flight, *EXCITATIONS))
    left = parent.division
    chi_squared, degrees = older(parent)
    assert chi_squared - degrees > 2 * OLDER * (left.chi_squared - left.degrees)
    assert not latest_alone(parent)
