"""The vehicle flies the paper's card as fast as it computes and writes its .BIN; ingest and fit read what it wrote.

The issue's figures for both plants are proved here, through the files a user would have.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flying import CHIRP, DOUBLET, fly_maneuver, log_of
from more_of_a_kind import thorough

from gcs.analysis.fits import Identification, identify_flight, split_runs
from gcs.analysis.text.checks import check_text
from gcs.analysis.text.fit import another_band, identification_text, parameter_table
from gcs.logs import ingest, resolve_runs
from sitl.autopilot.parameters import BANK_ORDER, bank_crc
from sitl.autopilot.vehicle import make_vehicle
from sysid.control.regulator import design
from sysid.data.band import BandFrom

pytestmark = pytest.mark.usefixtures("logs_kept")
CHIRPS = [(10, 0.10, 30.0), (10, 0.10, 30.0), (11, 0.15, 30.0), (11, 0.15, 30.0)]
DOUBLETS = [(10, 0.10, 8.0), (11, 0.15, 8.0)]


@pytest.fixture(scope="module", params=[*thorough(["hover-ideal"]), "hover"])
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp(request.param)
    vehicle = make_vehicle(request.param, seed=11, directory=folder)
    for maneuver in CHIRPS:
        fly_maneuver(vehicle, CHIRP, *maneuver, rest_steps=1000)
    for maneuver in DOUBLETS:
        fly_maneuver(vehicle, DOUBLET, *maneuver, rest_steps=1000)
    return request.param, log_of(vehicle, folder)


@pytest.fixture(scope="module")
def found(flown: tuple[str, Path]) -> tuple[str, Identification]:
    chirps, doublets = split_runs(resolve_runs([str(flown[1])]))
    return flown[0], identify_flight(chirps, doublets)


def test_every_run_is_listed(flown: tuple[str, Path]) -> None:
    runs = ingest([flown[1]]).runs
    assert [(run.maneuver, run.axis) for run in runs] == [
        *[("chirp", "roll" if axis == 10 else "pitch") for axis, _, _ in CHIRPS],
        *[("doublet", "roll" if axis == 10 else "pitch") for axis, _, _ in DOUBLETS],
    ]
    for run in runs:
        assert run.usable, run.reasons
        assert not run.gaps
        assert run.rate_hz == pytest.approx(500.0, rel=1e-6)
        assert run.record is not None
        assert run.record.rate_source == "SIDD"
        assert {"excitation_x", "excitation_y", "delta_e", "omega"} <= set(run.record.channels)


def test_the_excitation_is_independent_on_every_axis(flown: tuple[str, Path]) -> None:
    record = ingest([flown[1]]).runs[0].record
    assert record is not None
    noise = np.stack([record.channels[name] for name in ("excitation_y", "excitation_e")])
    # 0.2 of the amplitude, times 0.243 by the low-pass at 500 Hz
    during = noise[:, 1000:14000]
    np.testing.assert_allclose(during.std(axis=1), 0.2 * 0.1 * 0.243, rtol=0.1)
    assert abs(np.corrcoef(during)[0, 1]) < 0.2


def test_the_issue_s_figures(found: tuple[str, Identification]) -> None:
    name, result = found
    tpp, cd = result.tpp.nrmse_percent, result.cd.nrmse_percent
    validation = result.tpp.validation_nrmse_percent
    assert validation is not None
    if name == "hover":
        assert 70 < tpp["p"] < 88
        assert 70 < tpp["q"] < 88
        assert cd["q"] < tpp["q"] - 20
        assert abs(validation["p"] - tpp["p"]) < 12
        assert abs(validation["q"] - tpp["q"]) < 12
    else:
        assert min(tpp.values()) > 90
        for mode, (frequency, damping) in zip(result.tpp.model.modes, ((1.64, 0.39), (5.04, 0.22)), strict=True):
            assert mode.frequency_hz == pytest.approx(frequency, rel=0.02)
            assert mode.damping_ratio == pytest.approx(damping, rel=0.10)
        assert 40 < cd["q"] < 55
    assert all(check.passed for check in result.checks), [check_text(check) for check in result.checks]


def test_tables_fit_a_terminal_and_show_the_paper(found: tuple[str, Identification]) -> None:
    text = identification_text(found[1])
    assert max(len(line) for line in text.splitlines()) <= 80
    for figure in ("77.8", "25.9", "5.04 Hz", "713.378", "paper 0.9 and 1.8 %"):
        assert figure in text
    lines = text.splitlines()
    head = next(line for line in lines if "± model" in line)
    assert head.split() == ["parameter", "value", "±", "std.", "err.", "(±", "model)", "unit", "paper"]
    error = found[1].tpp.model_errors["L_b"].total
    assert f"(± {float(f'{error:.2g}'):g})" in next(line for line in lines if "TPP L_b" in line)
    bare = replace(found[1], **{one: replace(getattr(found[1], one), model_errors={}) for one in ("tpp", "cd")})
    assert "± standard error" in parameter_table(bare)
    assert "(±" not in parameter_table(bare)


def test_the_paper_s_chirps_keep_the_paper_s_band_and_another_is_told(found: tuple[str, Identification]) -> None:
    result = found[1]
    assert (result.tpp.band_hz, result.tpp.band_from) == ((0.0, 15.0), BandFrom.NOISE)
    assert another_band(result.tpp) == []
    swept = replace(result, tpp=replace(result.tpp, band_hz=(0.5, 10.0), band_from=BandFrom.SWEPT))
    assert identification_text(swept).startswith("band 0.5 to 10 Hz: what was swept\n\nNRMSE fit")


def test_designed_gains_hold_the_vehicle_they_came_from(found: tuple[str, Identification], tmp_path: Path) -> None:
    """The LQR of the fit, on the plant that was fitted: a rate doublet is followed and hover is kept."""
    name, result = found
    gains = design(result.tpp.model)
    vehicle = make_vehicle(name, seed=12, directory=tmp_path, on_ground=True)
    bank = [*gains.K.ravel(), *gains.observer_gain.ravel(), *gains.prefilter.ravel(), *result.tpp.model.values]
    for parameter, value in zip(BANK_ORDER, bank, strict=True):
        assert vehicle.write_parameter(f"LQS_{parameter}", float(value)) is not None
    vehicle.write_parameter("LQR_COMMIT", bank_crc(bank))
    assert vehicle.take_off() is None
    for _ in range(4000):
        vehicle.step()
    assert vehicle.select_lqr(True) is None
    rates, leans = [], []
    for _ in range(2500):
        vehicle.step()
        rates.append((vehicle.plant.p, vehicle.plant.q))
        leans.append((vehicle.plant.phi, vehicle.plant.theta))
    assert np.abs(rates[500:]).max() < 0.3
    assert np.abs(leans[500:]).max() < 0.1
    vehicle.close()
