"""Weights by the spectrum of what is left: errors that they halve, and where they are not to be trusted."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from more_of_a_kind import thorough
from planted import TABLE_4, Run, fly_many
from planted_fits import records

from sysid.data.dataset import Bins, prepared
from sysid.data.instrument import Causes
from sysid.data.record import Record
from sysid.fit.estimate import Estimate, Weights, estimate
from sysid.fit.identify import identify
from sysid.fit.output_error import output_error
from sysid.fit.rows import project, rows
from sysid.fit.weights import spectral_weights
from sysid.fit.whitening import weighed
from sysid.model.compose import compose
from sysid.model.paper import CD, TPP
from sysid.model.predict import respond
from sysid.model.structure import FloatArray

BAND_HZ = (0.0, 15.0)
EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
SEEDS = range(900, 908)
SECONDS = 10.0
TRUTH = np.array([TABLE_4[name] for name in TPP.names])
KINDS: tuple[Weights, ...] = ("constant", "residual spectrum")


@cache
def flights() -> list[list[Run]]:
    return fly_many(None, {}, seeds=SEEDS, duration_s=SECONDS)


def bins(flight: list[Run], logged: bool) -> Bins:
    return prepared(records(flight, *(() if logged else EXCITATIONS)), BAND_HZ).viewed(TPP.inputs, TPP.outputs)


@cache
def estimates(kind: Weights, logged: bool) -> list[Estimate]:
    return [estimate(TPP, bins(flight, logged), weights=kind) for flight in flights()]


def errors(kind: Weights, logged: bool) -> FloatArray:
    """(flights, parameters)"""
    return np.array([one.model.values - TRUTH for one in estimates(kind, logged)])


@pytest.mark.parametrize("logged", [True, False])
def test_the_noise_s_spectrum_halves_the_errors_on_the_same_flights(logged: bool) -> None:
    """About 2 over many flights, by `tests/study/study_weights.py`; of these few at least 1.5."""
    before, after = (np.sqrt(np.mean(errors(kind, logged) ** 2, axis=0)) for kind in KINDS)
    assert np.exp(np.mean(np.log(before / after))) > 1.5
    assert all(one.weights == "residual spectrum" for one in estimates("residual spectrum", logged))


@pytest.mark.parametrize("logged", [True, False])
def test_standard_errors_are_those_of_the_weights(logged: bool) -> None:
    said = np.array([np.sqrt(np.diag(one.covariance)) for one in estimates("residual spectrum", logged)])
    z = errors("residual spectrum", logged) / said
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25
    least = np.array([np.sqrt(np.diag(one.covariance)) for one in estimates("constant", logged)])
    assert np.exp(np.mean(np.log(least / said))) > 1.5


def test_agreement_in_percent_hardly_changes() -> None:
    """Eq. 10 keeps its definition, and least squares is best in it."""
    for least, weighted in zip(estimates("constant", True), estimates("residual spectrum", True), strict=True):
        lost = least.error.nrmse_percent - weighted.error.nrmse_percent
        assert np.all(np.abs(lost) < 0.3)


@pytest.mark.parametrize("logged", [True, False])
def test_what_is_left_becomes_white(logged: bool) -> None:
    """Weighted, the residual has the same power at 1 to 3 Hz as at 6 to 12 Hz, and p nothing of q."""
    on, (one, *_) = bins(flights()[0], logged), estimates("residual spectrum", logged)
    by: Causes | None = on.causes(TPP.commands) if logged else None
    (group,), (weight,) = on.stacks, spectral_weights(output_error(one.model, on.stacks), on.stacks, by)
    response = respond(TPP, one.model.values, group, False)
    e, E = weighed(weight, (group.Y - response.Y)[None]), weighed(weight, response.E)
    white = np.concatenate(
        [project(rows(E[..., part]), rows(e[..., part])).view(complex).reshape(2, -1) for part in group.slices], axis=1
    )
    f = group.frequency_hz
    low, high = (white[:, (a < f) & (f < b)] for a, b in ((1, 3), (6, 12)))
    power = [np.mean(np.abs(one) ** 2, axis=1) for one in (low, high)]
    np.testing.assert_allclose(power[0] / power[1], 1, atol=0.35)
    across = np.abs(np.mean(white[0] * white[1].conj())) / np.sqrt(np.prod(np.mean(np.abs(white) ** 2, axis=1)))
    assert across < 0.1


def test_a_model_that_leaves_much_is_not_excused_where_it_fails() -> None:
    """Without an excitation its own residual would weigh it, and what it cannot do would not count."""
    runs = records(flights()[0], *EXCITATIONS)
    fit = identify(CD, runs)
    assert min(fit.nrmse_percent.values()) < 50
    assert fit.weights == "constant"
    assert identify(TPP, runs).weights == "residual spectrum"


def test_the_file_says_which_weights(tmp_path: Path) -> None:
    runs = records(flights()[0])
    assert identify(TPP, runs).to_json(tmp_path)["weights"] == "residual spectrum"
    constant = identify(TPP, runs, weights="constant")
    assert constant.to_json(tmp_path)["weights"] == "constant"
    assert type(constant).from_json(constant.to_json(tmp_path), tmp_path).weights == "constant"


@cache
def crazyflie(path: Path) -> Record:
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    names = path.read_text(encoding="utf-8").partition("\n")[0].strip().split(",")
    return Record("quad", dict(zip(names, table.T, strict=True))).window(55.0, 90.0)


@pytest.mark.data
@pytest.mark.parametrize("low_hz", [0.3, 2.0, *thorough([0.7, 1.0, 1.5])])
def test_the_quadrotor_s_motor_lag_from_every_low_edge(low_hz: float, shared_data: Path) -> None:
    """Its authors say about 70 ms; constant weights say 40, 49, 61, 71, 77 ms."""
    run = crazyflie(shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv")
    fit = identify(compose("cd"), [run], band_hz=(low_hz, 15.0), effects=["servo_lag"])
    assert fit.weights == "residual spectrum"
    assert 0.065 < fit.model["tau_s"] < 0.085
