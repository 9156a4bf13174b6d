"""The scan of the band's low edge: feedback moves the values, a clean flight does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from planted import fly_many
from planted_fits import records

from gcs.analysis.text.checks import check_text
from sysid.data.dataset import prepared
from sysid.data.record import Record
from sysid.fit.check_kinds import LowEdgeMoves, Move
from sysid.fit.checks import Check
from sysid.fit.estimate import estimate
from sysid.fit.low_edge import low_edges
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

BAND_HZ = (0.0, 15.0)


@pytest.fixture(scope="module")
def clean() -> list[Record]:
    (flight,) = fly_many(None, {}, seeds=[910], duration_s=10.0)
    return records(flight)


def test_a_clean_flight_stays(clean: list[Record]) -> None:
    bins = prepared(clean, BAND_HZ).viewed(TPP.inputs, TPP.outputs)
    found = low_edges(estimate(TPP, bins).model, bins, BAND_HZ)
    assert found is not None
    assert found.low_hz == (0.0, 0.3, 0.7, 1.0, 1.5, 2.0)
    assert found.values.shape == (6, 9)
    assert found.moved == ()
    assert np.all(found.times < 4)
    assert found.instrumented
    assert check_text(found.check) == "no parameter moves when the band begins at up to 2 Hz"


def test_one_step_comes_near_the_fit_of_the_narrower_band(clean: list[Record]) -> None:
    bins, narrow = (prepared(clean, band).viewed(TPP.inputs, TPP.outputs) for band in (BAND_HZ, (2.0, 15.0)))
    found = low_edges(estimate(TPP, bins).model, bins, BAND_HZ)
    again = estimate(TPP, narrow)
    assert found is not None
    assert np.all(np.abs(found.values[-1] - again.model.values) < np.sqrt(np.diag(again.covariance)))


def test_with_the_excitation_logged_it_is_not_the_feedback() -> None:
    moves = tuple(Move(name, "1/s", 1.0, 2.0) for name in ("L_p", "M_q", "L_q", "M_p"))
    found = check_text(Check("low edge of the band", False, LowEdgeMoves(moves, 0.5, 1.5, True)))
    assert found == (
        "L_p from 1 to 2 1/s, M_q from 1 to 2 1/s, L_q from 1 to 2 1/s, and 1 more when the band begins at up to "
        "1.5 Hz instead of 0.5: something is missing at low frequencies"
    )


def test_nothing_to_leave_out_is_no_scan(clean: list[Record]) -> None:
    band = (2.5, 15.0)
    bins = prepared(clean, band).viewed(TPP.inputs, TPP.outputs)
    model = Model(TPP, estimate(TPP, bins).model.values)
    assert low_edges(model, bins, band) is None
    assert low_edges(model, bins, (0.0, 1.0)) is None
    assert low_edges(model, bins, BAND_HZ, held=TPP.names) is None


@pytest.mark.data
def test_the_quadrotor_s_lag_moves_with_the_low_edge(shared_data: Path) -> None:
    """The answer that constant weights give from 0.3 Hz on is not to be believed, and that is said."""
    path = shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv"
    table = np.genfromtxt(path, delimiter=",", names=True)
    whole = Record("quad", {name: table[name] for name in ("t", "p", "q", "delta_x", "delta_y")})
    band = (0.3, 15.0)
    structure = compose("cd", ["servo_lag"])
    bins = prepared([whole.window(55.0, 90.0)], band).viewed(structure.inputs, structure.outputs)
    begin = estimate(compose("cd"), bins).model
    fit = estimate(structure, bins, begin, weights="constant")
    found = low_edges(fit.model, bins, band, (), "constant")
    assert found is not None
    assert found.moved[0] == "tau_s"
    finding = found.check.finding
    assert isinstance(finding, LowEdgeMoves)
    assert finding.moves[0].value == pytest.approx(0.0405, abs=0.001)
    assert finding.moves[0].other > 0.055
    assert check_text(found.check).startswith("tau_s from 0.0405 to 0.06")
    assert check_text(found.check).endswith(
        "when the band begins at up to 2 Hz instead of 0.3: feedback biases the fit; log the excitation, or raise "
        "the band's low edge"
    )
    document = found.to_json()
    assert document["low_hz"] == [0.3, 0.7, 1.0, 1.5, 2.0]
    assert len(document["values"]["tau_s"]) == 5
    assert document["moved"][0] == "tau_s"
