"""Fits judged by truth from outside sysid: the independent simulator, SciPy's simulations, planted faults."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from more_of_a_kind import thorough
from scipy.signal import dlsim, lsim

from gcs.analysis.fits import PAPER_PARAMETERS
from gcs.analysis.text.checks import check_text
from sysid.data.dataset import Bins
from sysid.data.preprocess import low_pass, spectra
from sysid.data.record import Record
from sysid.data.stacks import stack
from sysid.errors import FitError
from sysid.fit.axes import independent_share
from sysid.fit.checks import eigenfrequency_checks
from sysid.fit.estimate import estimate
from sysid.fit.identify import identify, judge
from sysid.fit.output_error import output_error
from sysid.fit.result import Fit
from sysid.model.paper import CD, TPP
from sysid.model.structure import Model, discretise

Card = tuple[list[Record], list[Record]]
TRUTH = np.array(PAPER_PARAMETERS["tpp"])
OUT = ("p", "q")


def record(channels: dict[str, np.ndarray], label: str = "made", **about: object) -> Record:
    return Record(label, channels, **about)  # type: ignore[arg-type]


def altered(one: Record, **changed: np.ndarray) -> Record:
    return Record(
        one.id, {**one.channels, **changed}, maneuver=one.maneuver, axis=one.axis, rate_source=one.rate_source
    )


def test_hover_ideal_gives_table_2_back(ideal_tpp: Fit, ideal_cd: Fit) -> None:
    fit = ideal_tpp
    assert min(fit.nrmse_percent.values()) > 90
    for mode, (frequency, damping) in zip(fit.model.modes, ((1.64, 0.39), (5.04, 0.22)), strict=True):
        assert mode.frequency_hz == pytest.approx(frequency, rel=0.02)
        assert mode.damping_ratio == pytest.approx(damping, rel=0.10)
    assert 40 < ideal_cd.nrmse_percent["q"] < 55
    # each parameter near the truth that flew; gusts in the loop bias a fit a little
    assert np.all(np.abs(fit.model.values - TRUTH) < 4 * fit.standard_errors)


@pytest.mark.thorough
def test_hover_lands_near_the_paper(hover_card: Card) -> None:
    chirps, doublets = hover_card
    tpp, cd = identify(TPP, chirps, doublets), identify(CD, chirps, doublets)
    assert tpp.validation_nrmse_percent is not None
    for axis in OUT:
        assert 70 < tpp.nrmse_percent[axis] < 88
        assert abs(tpp.validation_nrmse_percent[axis] - tpp.nrmse_percent[axis]) < 12
    assert cd.nrmse_percent["q"] < tpp.nrmse_percent["q"] - 20


@pytest.mark.parametrize("structure", [TPP, *thorough([CD])])
def test_nrmse_is_that_of_the_time_simulation(hover_card: Card, structure: object) -> None:
    """Eq. 10 of low-passed samples against SciPy's simulation with a fitted initial state, pooled over two runs."""
    chirps = hover_card[0][:2]
    fit = identify(structure, chirps)  # type: ignore[arg-type]
    A, B, C, D = fit.model.matrices
    error, whole = np.zeros(2), np.zeros(2)
    for one in chirps:
        t = one.t - one.t[0]
        dt = float(t[-1] / (t.size - 1))
        u = np.stack([one.channels[name] - one.channels[name].mean() for name in ("delta_x", "delta_y")], axis=1)
        Ad, Bd = discretise(A, B, dt)

        def simulated(
            u: np.ndarray, start: np.ndarray, dt: float = dt, Ad: np.ndarray = Ad, Bd: np.ndarray = Bd
        ) -> np.ndarray:
            return np.asarray(dlsim((Ad, Bd, C, D, dt), u, x0=start)[1])

        def passed(y: np.ndarray, dt: float = dt) -> np.ndarray:
            return np.stack([low_pass(y[:, i] - y[:, i].mean(), dt, 15.0) for i in range(2)], axis=1)

        y = passed(np.stack([one.channels[name] for name in OUT], axis=1))
        forced = passed(simulated(u, np.zeros(A.shape[0])))
        free = np.stack([passed(simulated(0 * u, e)).ravel() for e in np.eye(A.shape[0])], axis=1)
        start, *_ = np.linalg.lstsq(free, (y - forced).ravel(), rcond=None)
        rest = y - forced - (free @ start).reshape(y.shape)
        error += np.sum(rest**2, axis=0)
        whole += np.sum(y**2, axis=0)
    in_time = 100 * (1 - np.sqrt(error / whole))
    np.testing.assert_allclose([fit.nrmse_percent[name] for name in OUT], in_time, atol=1.0)


def exact_record(dt: float, seconds: float, seed: int, start: np.ndarray) -> Record:
    """Arithmetic only: data of the very model that is then fitted, by SciPy's hold simulation."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, dt)
    u = np.cumsum(rng.normal(size=(t.size, 2)), axis=0) * 0.01 + rng.normal(size=(t.size, 2)) * 0.05 + 0.1
    A, B, C, D = Model(TPP, TRUTH).matrices
    y = lsim((A, B, C, D), u, t, X0=start, interp=False)[1]
    return record({"t": t + 7, "p": y[:, 0], "q": y[:, 1], "delta_x": u[:, 0], "delta_y": u[:, 1]})


@pytest.mark.parametrize("dt", [0.001, 0.002, 0.02])
def test_hold_and_end_states_are_exact(dt: float) -> None:
    one = exact_record(dt, 12.0, 1, np.array([0.5, -0.3, 0.02, 0.01]))
    found, _ = spectra([one], TPP.inputs, TPP.outputs)
    assert np.all(output_error(Model(TPP, TRUTH), stack(found)).nrmse_percent > 100 - 1e-6)
    np.testing.assert_allclose(estimate(TPP, Bins(tuple(found))).model.values, TRUTH, rtol=1e-6)


@pytest.mark.thorough
def test_standard_errors_match_the_spread_over_flights(fly_chirps: Callable[..., list[Record]]) -> None:
    """Estimates of ten flights in different gusts scatter as their standard errors say."""
    fits = [identify(TPP, fly_chirps("hover-ideal", 100 + seed, 12.0, 2)) for seed in range(10)]
    z = np.array([(fit.model.values - TRUTH) / fit.standard_errors for fit in fits])
    assert 0.6 < z.std(axis=0).mean() < 1.5


def test_a_gap_splits_the_run_and_is_not_filled(ideal_card: Card) -> None:
    chirps, _ = ideal_card
    one = chirps[0]
    keep = (one.t < 10) | (one.t > 10.5)
    cut = Record(
        one.id, {name: values[keep] for name, values in one.channels.items()}, maneuver=one.maneuver, axis=one.axis
    )
    found, remarks = spectra([cut], TPP.inputs, TPP.outputs)
    assert [part.samples for part in found] == [np.sum(one.t < 10), np.sum(one.t > 10.5)]
    assert not remarks
    piece = (one.t < 10) | ((one.t > 10.5) & (one.t < 11.5)) | (one.t > 12)
    cut = Record(
        one.id, {name: values[piece] for name, values in one.channels.items()}, maneuver=one.maneuver, axis=one.axis
    )
    found, remarks = spectra([cut], TPP.inputs, TPP.outputs)
    assert len(found) == 2
    assert "shorter than 2 s" in remarks[0]


def test_a_still_command_is_named(ideal_card: Card) -> None:
    chirps, _ = ideal_card
    still = [altered(one, delta_y=np.zeros(one.t.size)) for one in chirps]
    with pytest.raises(FitError, match="pitch axis not identifiable: delta_y hardly moves"):
        identify(TPP, still)
    constant = [altered(one, delta_x=np.full(one.t.size, 0.3)) for one in chirps]
    with pytest.raises(FitError, match="roll axis"):
        identify(CD, constant)


def test_a_command_that_only_follows_is_named(ideal_card: Card) -> None:
    chirps, _ = ideal_card
    follows = [altered(one, delta_y=0.4 * one.channels["delta_x"]) for one in chirps]
    with pytest.raises(FitError, match="only follows the other command"):
        identify(TPP, follows)
    found, _ = spectra(chirps, TPP.inputs, TPP.outputs)
    assert np.all(independent_share(found) > 0.3)


def test_noise_alone_gives_no_numbers() -> None:
    rng = np.random.default_rng(2)
    t = np.arange(0, 20, 0.002)
    noise = {name: rng.normal(size=t.size) * 0.02 for name in ("p", "q", "delta_x", "delta_y")}
    for structure in (TPP, CD):
        with pytest.raises(FitError, match=r"not identifiable|do not determine"):
            identify(structure, [record({"t": t, **noise})])


def test_a_gyro_that_stands_still_is_named(ideal_card: Card) -> None:
    chirps, _ = ideal_card
    with pytest.raises(FitError, match="pitch axis not identifiable: q does not move"):
        identify(TPP, [altered(one, q=np.zeros(one.t.size)) for one in chirps])


def test_too_short_and_mixed_runs_are_refused(ideal_card: Card) -> None:
    chirps, _ = ideal_card
    with pytest.raises(FitError, match="2 s of gap-free samples"):
        identify(TPP, [chirps[0].window(5.0, 6.5)])
    other = Record("b", dict(chirps[1].channels), maneuver="chirp", axis="pitch", rate_source="RATE")
    with pytest.raises(FitError, match="RATE, SIDD"):
        identify(TPP, [chirps[0], other])


def test_the_wrong_sign_of_a_command_is_said(ideal_card: Card, ideal_tpp: Fit) -> None:
    chirps, _ = ideal_card
    turned = [altered(one, delta_y=-one.channels["delta_y"]) for one in chirps]
    fit = identify(TPP, turned)
    assert any("opposite sign" in text and "delta_y" in text for text in fit.warnings)
    assert not any("opposite sign" in text for text in ideal_tpp.warnings)


def test_eigenfrequency_check(ideal_card: Card, ideal_tpp: Fit) -> None:
    chirps, _ = ideal_card
    inside, rotor, agreement = eigenfrequency_checks(ideal_tpp.model, chirps)
    assert inside.passed
    assert rotor.passed
    assert "27.5 Hz" in check_text(rotor)
    assert agreement.passed
    assert "paper 0.9 and 1.8 %" in check_text(agreement)
    fast = Model(TPP, TRUTH * np.array([1, 12.0, 1, 1, 1, 1, 1, 1, 1]))
    outside, close, _ = eigenfrequency_checks(fast, chirps)
    assert outside.passed is False
    assert close.passed is False


def test_judging_estimates_nothing_of_the_model(ideal_card: Card) -> None:
    _, doublets = ideal_card
    worse = Model(TPP, TRUTH * np.array([1, 1.5, 1, 1, 1, 1, 1, 1, 1]))
    assert judge(worse, doublets)["q"] < judge(Model(TPP, TRUTH), doublets)["q"] - 10
