"""What the data leave open is said, with its direction and with the right reason, and gets no number."""

from __future__ import annotations

import itertools
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from planted import PLANTED, TABLE_4, fly

from sysid.data.record import CHANNELS, Record
from sysid.errors import FitError
from sysid.fit.identifiable import structural, undetermined, vague
from sysid.fit.identify import identify
from sysid.model.compose import compose
from sysid.model.effect import EffectError, catalogue, find
from sysid.model.paper import TPP
from sysid.model.response import transfer
from sysid.model.structure import Structure

CONSTANTS = {"Omega_0": 172.8, "V_0": 18.0}
EVERYTHING = set(CHANNELS)
CYCLIC = {"delta_x", "delta_y"}

STRUCTURAL = {
    # both lags commute with a linear vehicle
    ("tpp", "servo_lag", "gyro_lag", True),
    ("tpp", "servo_lag", "gyro_lag", False),
    ("cd", "servo_lag", "gyro_lag", True),
    ("cd", "servo_lag", "gyro_lag", False),
    ("tpp", "motor_lag", "gyro_lag", True),
    ("tpp", "motor_lag", "gyro_lag", False),
    ("cd", "motor_lag", "gyro_lag", True),
    ("cd", "motor_lag", "gyro_lag", False),
    # a response of this order has 12 coefficients, these need 13
    ("tpp", "hub_gyroscopics", "angular_damping", True),
    ("tpp", "hub_gyroscopics", "angular_damping", False),
    # alpha is integrated from q where no vane shows it
    ("tpp", "disc_incidence", "angle_of_attack", False),
}


@cache
def flown(effect: str | None) -> tuple[Record, ...]:
    size = PLANTED[effect] if effect is not None else {}
    return tuple(
        Record(f"#{number}", {name: values for name, values in run.items() if name not in ("phi", "theta")})
        for number, run in enumerate(fly(effect, size, seed=7))
    )


def numerical_rank(structure: Structure) -> int:
    """Of the response's slopes at a random place, by differences in extended steps: nothing of ours but `transfer`."""
    rng = np.random.default_rng(9)
    values = np.array([one.typical for one in structure.parameters]) * rng.uniform(0.7, 1.4, len(structure.parameters))
    frequency = np.geomspace(0.2, 12, 30)
    columns = []
    for index in range(values.size):
        step = np.zeros(values.size)
        step[index] = 1e-4 * values[index]
        moved = [transfer(structure, values + times * step, frequency).ravel() for times in (-2, -1, 1, 2)]
        column = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / 12
        columns.append(np.concatenate([column.real, column.imag]) / np.linalg.norm(column))
    return int(np.linalg.matrix_rank(np.array(columns), tol=1e-7))


@pytest.mark.parametrize("base", ["tpp", "cd"])
@pytest.mark.parametrize("logged", [True, False])
def test_which_pairs_no_flight_tells_apart(base: str, logged: bool) -> None:
    """Walks the catalogue: no single effect is hopeless, and only the known pairs are."""
    found = set()
    for count in (1, 2):
        for effects in itertools.combinations(catalogue(), count):
            try:
                structure = compose(base, effects, EVERYTHING if logged else CYCLIC, CONSTANTS)
            except EffectError:
                continue
            if structural(structure) is not None:
                found.add((base, *effects, logged))
    assert found == {one for one in STRUCTURAL if one[0] == base and one[-1] == logged}


@pytest.mark.parametrize(
    ("effects", "short"),
    [
        (["hub_gyroscopics", "angular_damping"], 1),
        (["inertia_coupling", "gyro_misalignment", "angular_damping"], 1),
        (["inertia_coupling", "gyro_misalignment"], 0),
        (["servo_lag", "transport_delay"], 0),
        (["attitude_stiffness", "speed_stability"], 0),
    ],
)
def test_rank_is_what_differences_say(effects: list[str], short: int) -> None:
    structure = compose("tpp", effects, CYCLIC)
    assert numerical_rank(structure) == len(structure.parameters) - short
    assert (structural(structure) is not None) == (short > 0)


def test_two_lags_that_may_change_places_get_no_numbers() -> None:
    for effects in (["servo_lag", "gyro_lag"], ["gyro_lag", "servo_lag"]):
        with pytest.raises(FitError, match=r"change places.*tau_s from tau_g \(structural\).*--fix"):
            identify(TPP, flown("servo_lag"), effects=effects)


def test_one_lag_held_frees_the_other() -> None:
    fit = identify(TPP, flown("servo_lag"), effects=["servo_lag", "gyro_lag"], fixed={"tau_g": 0.0005})
    assert fit.model["tau_s"] == pytest.approx(PLANTED["servo_lag"]["tau_s"], abs=0.002)
    assert fit.undetermined == ()
    assert structural(compose("tpp", ["servo_lag", "gyro_lag"]), ["tau_g"]) is None


def test_a_double_of_an_effect_is_named_with_its_direction(tmp_path: Path) -> None:
    path = tmp_path / "more_damping.py"
    path.write_text(
        "from sysid.model.effect import Effect, Stage\n"
        "from sysid.model.parameter import Parameter\n"
        "EFFECT = Effect(id='more_damping', title='again', group='user', equation='p_dot += 2 L_x p',\n"
        "    source='s', signature='s', parameters=(Parameter('L_x', '1/s', 'm', null=0.0, typical=-1.0),),\n"
        "    stage=Stage.DYNAMICS, equations=lambda s: {'p_dot': 2 * s.L_x * s.p})\n"
    )
    said = structural(compose("tpp", ["angular_damping", find(str(path))]))
    assert said is not None
    assert "(structural)" in said
    (_, first, _, second) = said.split(" along ")[1].split(", whatever")[0].replace(",", "").split()
    numbers = sorted(abs(float(x)) for x in (first, second))
    assert numbers[1] == pytest.approx(2 * numbers[0], rel=0.01), "L_p +2 against L_x -1"
    assert float(first) * float(second) < 0
    assert "L_x" in said
    assert "L_p" in said


def test_a_parameter_that_never_shows_is_named(tmp_path: Path) -> None:
    path = tmp_path / "idle.py"
    path.write_text(
        "from sysid.model.effect import Effect, Stage\n"
        "from sysid.model.parameter import Parameter\n"
        "EFFECT = Effect(id='idle', title='idle', group='user', equation='e', source='s', signature='s',\n"
        "    parameters=(Parameter('K_idle', '-', 'm'),), stage=Stage.DYNAMICS,\n"
        "    equations=lambda s: {'p_dot': 0.0 * s.K_idle * s.p})\n"
    )
    said = structural(compose("tpp", [find(str(path))]))
    assert said is not None
    assert "K_idle does not show in the response, whatever is flown" in said


def test_stiffness_and_speed_stability_together_are_practically_open() -> None:
    """Equations tell them apart, a flight without either does not: said, with the direction, and no number."""
    fit = identify(TPP, flown(None), effects=["attitude_stiffness", "speed_stability"])
    assert {"Y_v", "X_u"} & set(fit.undetermined)
    assert not set(TABLE_4) & set(fit.undetermined), "the base stays known"
    said = [text for text in fit.warnings if "practical" in text]
    assert said
    for text in said:
        assert any(name in text for name in fit.undetermined)
        assert "one standard error moves" in text
    document = fit.to_json(Path.cwd())
    assert {name for name, one in document["parameters"].items() if not one["determined"]} == set(fit.undetermined)


def test_vague_directions_by_hand() -> None:
    """Two parameters known only by their sum: the direction is their difference, one standard error long."""
    values = TPP.vector(dict(TABLE_4))
    errors = 0.01 * np.abs(values)
    covariance = np.diag(errors**2)
    i, j = TPP.names.index("A_lat"), TPP.names.index("A_lon")
    covariance[np.ix_([i, j], [i, j])] += 4.0 * np.array([[1, -1], [-1, 1]])
    (direction,) = vague(TPP, values, covariance)
    moves = dict(direction.moves)
    assert set(moves) == {"A_lat", "A_lon"}
    assert moves["A_lat"] == pytest.approx(-moves["A_lon"], rel=0.05)
    assert abs(moves["A_lat"]) == pytest.approx(2.0, rel=0.05)
    assert undetermined(TPP, values, covariance) == ("A_lat", "A_lon")
    assert vague(TPP, values, np.diag(errors**2)) == ()


def test_a_rotor_speed_that_never_changes_determines_no_exponent() -> None:
    steady = [
        Record(one.id, {**one.channels, "omega": np.full(one.t.size, 172.8)}, maneuver=one.maneuver, axis=one.axis)
        for one in flown(None)
    ]
    with pytest.raises(FitError, match="k, n does not show in the response on these runs"):
        identify(TPP, steady, effects=["rotor_speed"])


def test_correlated_pairs_are_named() -> None:
    fit = identify(TPP, flown(None), effects=["dynamic_inflow"])
    assert len(fit.correlations) > 1
    assert all(abs(value) > 0.9 for _, _, value in fit.correlations)
    assert fit.correlations[0][2] == pytest.approx(max((x for *_, x in fit.correlations), key=abs))
    plain = identify(TPP, flown(None))
    (pair,) = plain.correlations
    assert abs(pair[2]) <= 0.9
    scale = np.sqrt(np.diag(plain.covariance))
    correlation = np.abs(plain.covariance / np.outer(scale, scale)) - np.eye(9)
    assert abs(pair[2]) == pytest.approx(correlation.max())
