"""Verdicts on flights of an independent integrator; the blind study (`make study`) counts many more."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from planted import PLANTED, Run, fly_many
from planted_fits import FORWARD_FLIGHT, records

from gcs.analysis.text.verdict import answer
from sysid.data.record import Record
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.identify import on_runs
from sysid.model.effect import load

SECONDS = 14.0
LIMIT, TURNED = 0.065, 0.2


@cache
def flown(effect: str | None, seed: int = 31, *, forward: bool = False, noise: float = 0.004) -> list[Run]:
    size = {} if effect is None else PLANTED[effect]
    return fly_many(effect, size, seeds=[seed], duration_s=SECONDS, forward=forward, noise=noise)[0]


def asked(runs: list[Run], *effects: str, base: str = "tpp", validation: list[Record] | None = None) -> Diagnosis:
    flight = records(runs)
    return diagnose(on_runs(base, effects, flight, flight), flight, validation or ())


@pytest.mark.parametrize(
    ("effect", "also"),
    [
        pytest.param("servo_lag", "gyro_lag", marks=pytest.mark.thorough),
        pytest.param("transport_delay", None, marks=pytest.mark.thorough),
        pytest.param("inertia_coupling", "gyro_misalignment", marks=pytest.mark.thorough),
        pytest.param("hub_gyroscopics", None, marks=pytest.mark.thorough),
        pytest.param("dynamic_inflow", None, marks=pytest.mark.thorough),
        pytest.param("servo_backlash", None, marks=pytest.mark.thorough),
        pytest.param("quadratic_damping", None, marks=pytest.mark.thorough),
        pytest.param("rotor_speed", None, marks=pytest.mark.thorough),
    ],
)
def test_a_planted_effect_is_named(effect: str, also: str | None) -> None:
    found = asked(flown(effect))
    assert found.verdict == "missing"
    assert found.effect == effect or (found.effect == also and effect in found.indistinguishable)
    assert found.explained_share is not None
    assert found.explained_share > 0.9
    assert found.confidence > 0.6
    assert not found.stands_in
    winner = next(one for one in found.candidates if one.effect == effect)
    for name, value in PLANTED[effect].items():
        assert winner.values[name] == pytest.approx(value, abs=4 * winner.standard_errors[name])
    assert found.candidates[0].fit is not None
    assert min(found.noise_floor_percent.values()) > min(found.parent.nrmse_percent.values())


@pytest.mark.parametrize("seed", [41, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in (42, 43))])
def test_where_nothing_is_missing_the_model_is_complete(seed: int) -> None:
    found = asked(flown(None, seed))
    assert found.verdict == "complete"
    assert found.effect is None
    assert found.explained_share is None
    assert found.winner is None
    document = found.to_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document


def test_the_paper_s_own_discovery() -> None:
    """Cylinder dynamics on hover data lack flapping; the hover structure in forward flight lacks the elevator."""
    hover = asked(flown(None), base="cd")
    assert (hover.verdict, hover.effect) == ("missing", "flapping")
    forward = asked(flown("elevator", forward=True))
    assert (forward.verdict, forward.effect) == ("missing", "elevator")


@pytest.mark.thorough
def test_what_physics_does_not_allow_stands_in() -> None:
    """A hovering vehicle has no spring to the horizon; one that is tethered is told so."""
    found = asked(flown("attitude_stiffness"))
    assert found.verdict == "unexplained"
    assert found.stands_in
    assert found.effect == "attitude_stiffness"
    assert "on a tether or a stand; in free flight it stands in" in answer(found)


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("gyro_lag", "servo_lag", "transport_delay")], indirect=True)
def test_validation_runs_judge() -> None:
    runs = flown("servo_lag", 51)
    other = records(flown("servo_lag", 52))
    found = asked(runs, validation=other)
    winner = found.winner
    assert winner is not None
    assert winner.validation_share is not None
    assert winner.validation_share > 0.9
    assert found.validation_nrmse_percent is not None
    assert winner.validation_nrmse_percent is not None
    for axis in ("p", "q"):
        assert winner.validation_nrmse_percent[axis] > found.validation_nrmse_percent[axis]


@pytest.mark.thorough
@pytest.mark.usefixtures("few_effects")
def test_a_gain_that_other_runs_do_not_share_is_demoted() -> None:
    """Validation runs of a vehicle without the lag: what helps on the fitted runs makes these worse."""
    found = asked(flown("servo_lag", 53), validation=records(flown(None, 54)))
    assert found.verdict == "unexplained"


@pytest.mark.usefixtures("few_effects")
@pytest.mark.parametrize("few_effects", [("yaw_coupling", "rotor_speed")], indirect=True)
def test_what_cannot_be_asked_says_why() -> None:
    runs = [{name: values for name, values in run.items() if name not in ("r", "omega")} for run in flown(None)]
    reasons = {one.effect: one.not_testable for one in asked(runs).candidates}
    assert "r" in str(reasons["yaw_coupling"])
    assert "not logged" in str(reasons["yaw_coupling"])
    assert "omega" in str(reasons["rotor_speed"])
    still = [{**run, "r": np.zeros_like(run["r"])} for run in flown(None)]
    reasons = {one.effect: one.not_testable for one in asked(still).candidates}
    assert "hardly moves" in str(reasons["yaw_coupling"])


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("angular_damping", "quadratic_damping", "servo_lag")], indirect=True)
def test_a_user_s_effect_is_asked_beside_the_catalogue(tmp_path: Path) -> None:
    path = tmp_path / "bent_shaft.py"
    path.write_text(
        '"""p feeds q through a bent shaft."""\n'
        "from sysid.model.effect import Effect, Stage\n"
        "from sysid.model.parameter import Parameter\n"
        "EFFECT = Effect(\n"
        '    id="bent_shaft", title="bent shaft", group="user", equation="q_dot += k q|q|", source="", signature="",\n'
        '    parameters=(Parameter("k_bent", "-", "share", plausible=(-20.0, 20.0), null=0.0, typical=1.0),),\n'
        "    stage=Stage.DYNAMICS, equations=lambda s: {'q_dot': s.k_bent * s.q * abs(s.q)}, linear=False,\n"
        ")\n"
    )
    flight = records(flown("quadratic_damping"))
    found = diagnose(on_runs("tpp", (), flight, flight), flight, effects=[load(path)])
    assert any(one.effect == str(path) and one.score is not None for one in found.candidates)
    assert found.effect == "quadratic_damping"


def test_forward_flight_is_complete_with_its_own_structure() -> None:
    assert asked(flown(None, 61, forward=True), *FORWARD_FLIGHT).verdict == "complete"


@pytest.mark.thorough
def test_a_limit_is_found_beside_a_turned_gyro_and_what_could_stand_in_its_place_is_told() -> None:
    runs = fly_many("servo_saturation", {"limit": LIMIT}, seeds=[71], duration_s=SECONDS)[0]
    turned = [{**run, "p": run["p"] + TURNED * run["q"], "q": run["q"] - TURNED * run["p"]} for run in runs]
    found = asked(turned)
    assert found.verdict == "missing"
    assert set(found.chain) in ({"servo_saturation", "gyro_misalignment"}, {"servo_saturation", "inertia_coupling"})
    assert "gyro_misalignment" in {*found.chain, *found.indistinguishable}
    assert found.winner is not None
    assert found.winner.values["limit"] == pytest.approx(LIMIT, rel=0.05)
