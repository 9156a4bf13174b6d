"""A fit that saves itself, and the explanations that go with an unstable one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from contract_schemas import FIT
from jsonschema import validate
from more_of_a_kind import thorough

from sysid import effects
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.fit.result import Fit, ResultError
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP
from sysid.model.structure import Model

Card = tuple[list[Record], list[Record]]


def test_a_saved_fit_is_the_same_fit(ideal_card: Card, tmp_path: Path) -> None:
    chirps, doublets = ideal_card
    fit = identify(TPP, chirps, doublets, window_s=(None, 40.0))
    document = fit.to_json(tmp_path)
    again = Fit.from_json(json.loads(json.dumps(document, allow_nan=False)), tmp_path)
    np.testing.assert_array_equal(again.model.values, fit.model.values)
    np.testing.assert_array_equal(again.covariance, fit.covariance)
    assert again.records == fit.records
    assert again.window_s == (None, 40.0)
    assert again.to_json(tmp_path) == document


def test_saved_matrices_carry_the_delay_of_the_commands(ideal_tpp: Fit, tmp_path: Path) -> None:
    """Whoever takes them elsewhere has the vehicle whole; a lag of the servos is in A already, and r has no delay."""
    structure = compose("tpp", ["servo_lag", "transport_delay", "yaw_coupling"], ["r"])
    values = {one.name: one.typical for one in structure.parameters} | {"T_d": 0.045}
    count = len(structure.names)
    late = replace(ideal_tpp, model=Model(structure, structure.vector(values)), covariance=np.eye(count))
    document = late.to_json(tmp_path)
    assert document["structure"]["channels"] == ["delta_x", "delta_y", "r"]
    assert document["matrices"]["input_delay_s"] == pytest.approx([0.045, 0.045, 0.0])
    assert document["outside_matrices"] == ["transport_delay"]
    assert ideal_tpp.to_json(tmp_path)["matrices"]["input_delay_s"] == [0.0, 0.0]


def test_what_an_effect_gained_later_stands_where_it_was_taken_for_granted(ideal_tpp: Fit, tmp_path: Path) -> None:
    structure = compose("tpp", ["quadratic_damping"])
    values = structure.vector({one.name: one.typical for one in structure.parameters})
    count = len(structure.names)
    fit = replace(ideal_tpp, model=Model(structure, values), covariance=np.diag(np.arange(1.0, count + 1)))
    document = fit.to_json(tmp_path)
    del document["parameters"]["exponent"]
    with pytest.raises(ResultError, match="shape"):
        Fit.from_json(document, tmp_path)
    document["covariance"] = [row[:-1] for row in document["covariance"][:-1]]
    again = Fit.from_json(document, tmp_path)
    assert (again.model["exponent"], again.fixed) == (2.0, ("exponent",))
    np.testing.assert_array_equal(np.diag(again.covariance), [*range(1, count), 0])


def test_paths_are_relative_to_the_file(ideal_card: Card, tmp_path: Path) -> None:
    log = tmp_path / "flights" / "one.BIN"
    chirps = [
        Record(
            one.id,
            dict(one.channels),
            maneuver=one.maneuver,
            axis=one.axis,
            rate_source=one.rate_source,
            path=str(log),
            sha256="0" * 64,
            swept_band_hz=one.swept_band_hz,
        )
        for one in ideal_card[0]
    ]
    document = identify(CD, chirps).to_json(tmp_path / "fits")
    validate(document, FIT)
    assert document["records"][0]["path"] == "../flights/one.BIN"
    (tmp_path / "fits").mkdir()
    target = tmp_path / "fits" / "cd.json"
    target.write_text(json.dumps(document))
    assert Path(Fit.load(target).records[0].path).resolve() == log


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"format": "tippath.fit/9"}, "tippath.fit/9"),
        ({"parameters": {}}, "L_p"),
        ({"covariance": [[1.0]]}, "shape"),
        ({"records": 3}, r"Expected `array`, got `int` - at `\$.records`"),
        ({"covariance": [[10**400]]}, "a number that is not finite"),
        ({"warnings": ["\ud800"]}, "half a character"),
        *thorough(
            [
                ({"structure": {"base": "banana", "effects": []}}, "banana"),
                ({"covariance": [[1.0, 2.0], [3.0]]}, "its covariance is not square"),
                ({"covariance": [["1.0"]]}, r"got `str` - at `\$.covariance"),
                ({"covariance": [[float("inf")]]}, "a number that is not finite"),
                ({"band_hz": [15.0, 0.0]}, "a band of 15 to 0 Hz is none"),
                ({"more": json.loads("[" * 90 + "]" * 90)}, "nested more than 64 deep"),
            ]
        ),
    ],
)
def test_a_damaged_file_is_said(change: dict[str, object], says: str, ideal_cd: Fit, tmp_path: Path) -> None:
    document = ideal_cd.to_json(tmp_path) | change
    target = tmp_path / "cd.json"
    target.write_text(json.dumps(document))
    with pytest.raises(ResultError, match=says) as error:
        Fit.load(target)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("raw", "says"),
    [(b"[" * 200_000, "nested too deep"), (b"9" * 5000, "digits"), (b"\xff", "utf-8"), (b"[]", "not a tippath.fit/1")],
)
def test_what_is_no_document_is_said(raw: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "fit.json").write_bytes(raw)
    with pytest.raises(ResultError, match=says):
        Fit.load(tmp_path / "fit.json")


def test_code_of_a_changed_effect_file_does_not_run(ideal_card: Card, tmp_path: Path) -> None:
    own, ran = tmp_path / "own.py", tmp_path / "ran"
    own.write_text((Path(effects.__file__).parent / "servo_lag.py").read_text().replace('"servo_lag"', '"own_lag"'))
    document = identify(CD, ideal_card[0], effects=[str(own)]).to_json(tmp_path)
    target = tmp_path / "cd.json"
    target.write_text(json.dumps(document))
    assert Fit.load(target, [str(own)]).model.structure.effects == (str(own),)
    own.write_text(own.read_text() + f"\nopen({str(ran)!r}, 'w').close()\n")
    with pytest.raises(ResultError, match="has changed since this fit was made"):
        Fit.load(target, [str(own)])
    assert not ran.exists()


@pytest.mark.thorough
@pytest.mark.data
def test_the_quadrotor_s_honest_answer(shared_data: Path) -> None:
    """The measured flight: poor, unstable, late in the actuators, lag and delay not separable, feedback named."""
    table = np.genfromtxt(shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv", delimiter=",", names=True)
    one = Record("quad", {name: table[name] for name in ("t", "p", "q", "delta_x", "delta_y")})
    fit = identify(CD, [one], band_hz=(0.3, 15.0))
    assert fit.nrmse_percent["p"] == pytest.approx(31, abs=1.5)
    assert fit.nrmse_percent["q"] == pytest.approx(35, abs=1.5)
    assert not fit.stable
    said = " ".join(fit.warnings)
    assert "unstable" in said
    assert "controller in the loop" in said
    assert "a lag of about 40 ms would lift it to p 65 / q 69 %" in said
    assert "a delay of about 30 ms" in said
    assert "do not separate the two" in said


@pytest.mark.data
def test_the_helicopter_flown_by_strangers(shared_data: Path) -> None:
    """Real autopilot, somebody else's TPP with a servo delay: plain TPP lands where the README says."""
    from gcs.logs import resolve_runs

    logs = [str(shared_data / "ardupilot" / f"heli_{axis}_sweep.BIN") for axis in ("roll", "pitch")]
    runs = resolve_runs(logs)
    plain = identify(TPP, runs)
    assert plain.nrmse_percent["p"] == pytest.approx(55, abs=4)
    assert plain.nrmse_percent["q"] == pytest.approx(42, abs=6)
    assert any("a delay of about 50 ms" in text and "delay explains far more" in text for text in plain.warnings)
    late = identify(TPP, runs, effects=["transport_delay"])
    assert late.nrmse_percent["p"] == pytest.approx(98.8, abs=0.3)
    assert late.nrmse_percent["q"] == pytest.approx(99.3, abs=0.3)
    for name, truth in {"T_d": 0.0508, "tau_f": 0.068232, "L_b": 3588.6, "M_a": 617.5}.items():
        assert late.model[name] == pytest.approx(truth, rel=0.01), name
