"""Diagnoses without a logged excitation: what a loop makes of gusts is no effect, and an effect is still named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import planted
import pytest
from numpy.typing import NDArray
from planted_fits import controlled, records
from scipy.linalg import expm
from strangers.asking import ask, fitted_runs
from strangers.flights import fly as fly_stranger

from sysid.data.chirp import Chirp
from sysid.data.dataset import dataset
from sysid.data.record import Record
from sysid.diagnose import refits
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.evidence import candidate, instrumental_step
from sysid.diagnose.verdict import Diagnosis
from sysid.fit.estimate import estimate
from sysid.fit.identify import identify, on_runs
from sysid.fit.innovations import Innovations
from sysid.fit.noise import divide
from sysid.fit.whitening import weighed
from sysid.model.paper import TPP
from sysid.model.structure import Model

EXCITATIONS = ("excitation_x", "excitation_y", "excitation_e")
BAND = (0.5, 10.0)
TRUTH = np.array([planted.TABLE_4[name] for name in TPP.names])


def fly(effect: str | None, sizes: Mapping[str, float], seed: int) -> list[Record]:
    """Four chirps of 12 s in doubled gusts, in a loop of double gain, their excitation not logged."""
    with controlled(loop=2):
        (flight,) = planted.fly_many(effect, sizes, seeds=range(seed, seed + 1), duration_s=12.0, gusts=2.0)
    return records(flight, *EXCITATIONS)


def asked(runs: Sequence[Record]) -> Diagnosis:
    return diagnose(TPP, runs, (), BAND, chains=False)


@pytest.fixture(scope="module")
def clean() -> list[Record]:
    return fly(None, {}, 9100)


def test_a_strong_loop_in_strong_gusts_is_no_alarm(clean: Sequence[Record]) -> None:
    runs = dataset(clean, BAND)
    parent = candidate(estimate(TPP, runs.viewed(TPP.inputs), weights="constant"), (), runs)
    ordinary = divide(parent.estimate.error, runs.stacks, runs.causes)
    assert ordinary.chi_squared - ordinary.degrees > 5 * (2 * ordinary.degrees) ** 0.5  # what the loop makes of it
    new = parent.division
    assert abs(new.chi_squared - new.degrees) < 3 * (2 * new.degrees) ** 0.5
    assert asked(clean).verdict == "complete"


def test_rows_are_white_and_of_unit_variance(clean: Sequence[Record]) -> None:
    runs = dataset(clean, BAND)
    parent = candidate(estimate(TPP, runs.viewed(TPP.inputs), weights="constant"), (), runs)
    assert isinstance(parent.metric, Innovations)
    left = instrumental_step(parent.asked_in(parent.metric), parent.metric).residual
    parts = np.array_split(left, 8)
    assert 0.85 < np.mean(left**2) < 1.05
    assert all(0.7 < np.mean(part**2) < 1.3 for part in parts)


def test_an_effect_is_still_named() -> None:
    found = asked(fly("angular_damping", {"L_p": -3.0, "M_q": -3.0}, 9101))
    assert (found.verdict, found.effect) == ("missing", "angular_damping")
    assert found.winner is not None
    assert found.winner.values["L_p"] == pytest.approx(-3.0, abs=3 * found.winner.standard_errors["L_p"])


def test_where_the_excitation_is_logged_nothing_is_asked_otherwise(clean: Sequence[Record]) -> None:
    logged = [replace(one, channels={**one.channels, **_still(one)}) for one in clean]
    runs = dataset(logged, BAND)
    assert not runs.in_a_loop
    parent = candidate(estimate(TPP, runs.viewed(TPP.inputs), weights="constant"), (), runs)
    assert parent.asked is parent


def _still(one: Record) -> dict[str, NDArray[np.float64]]:
    """Something that is not feedback in both excitations."""
    rng = np.random.default_rng(0)
    return {name: rng.standard_normal(one.t.size) for name in EXCITATIONS[:2]}


# ------------------------------------------------------------------------------------------------ a derivative


DT = 0.002
DERIVATIVE_HZ = 20.0


def with_derivative(seed: int, *, seconds: float = 15.0, corner_hz: float = 1.5, gusts: float = 1.0) -> list[Record]:
    """Four chirps on the paper's vehicle, whose controller also feeds back filtered accelerations, in gusts of
    so many times the usual size."""
    A, B, C, _ = Model(TPP, TRUTH).matrices
    n, m = B.shape
    whole = expm(np.block([[A, B, np.eye(n)], [np.zeros((m + n, n + m + n))]]) * DT)[:n]
    rng = np.random.default_rng(seed)
    found = []
    for number, axis in enumerate(("roll", "pitch") * 2):
        t = DT * np.arange(round((seconds + 2.0) / DT), dtype=np.float64)
        chirp = Chirp(axis=axis, law="tischler", f_start_hz=0.5, f_stop_hz=10.0, duration_s=seconds)
        r = np.zeros((t.size, 2))
        r[:, number % 2] = (0.10, 0.15)[number % 2] * chirp.wave(t - 1.0)
        found.append(_flown(whole, C, t, r, rng, f"#{number + 1}", corner_hz=corner_hz, gusts=gusts))
    return found


def _flown(
    whole: NDArray[np.float64],
    C: NDArray[np.float64],
    t: NDArray[np.float64],
    r: NDArray[np.float64],
    rng: np.random.Generator,
    id: str,
    *,
    corner_hz: float,
    gusts: float,
) -> Record:
    n, pole = whole.shape[0], np.exp(-2 * np.pi * corner_hz * DT)
    size = gusts * np.sqrt(1 - pole**2) * np.array([0.65, 2.8])
    rates = [TPP.states.index(name) for name in ("p", "q")]
    noise = 0.004 * rng.standard_normal((t.size, 2))
    x, gust, angle, slow, last = np.zeros(n), np.zeros(n), np.zeros(2), np.zeros(2), np.zeros(2)
    ys, us = np.empty((2, t.size, 2))
    share = 1 - np.exp(-2 * np.pi * DERIVATIVE_HZ * DT)
    for k in range(t.size):
        y = C @ x + noise[k]
        slow += share * ((y - last) / DT - slow)
        u = r[k] - 2 * planted.RATE_GAIN @ y - 2 * planted.ATTITUDE_GAIN @ angle - 0.02 * planted.RATE_GAIN @ slow
        ys[k], us[k], last, angle = y, u, y, angle + DT * y
        gust[rates] = pole * gust[rates] + size * rng.standard_normal(2)
        x = whole @ np.concatenate([x, u, gust])
    return Record(id, {"t": t, "p": ys[:, 0], "q": ys[:, 1], "delta_x": us[:, 0], "delta_y": us[:, 1]})


@pytest.mark.thorough
def test_a_controller_with_a_derivative_is_coped_with() -> None:
    runs = with_derivative(0)
    fit = identify(TPP, runs, band_hz=BAND)
    z = (fit.model.values - TRUTH) / fit.standard_errors
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.6
    found = asked(runs)
    assert found.verdict == "complete" or found.reason == "feedback"


def test_where_feedback_leads_least_squares_far_off_questions_begin_elsewhere() -> None:
    runs = dataset(with_derivative(1, seconds=22.0, corner_hz=0.3, gusts=4.0), (0.0, 15.0))
    parent = candidate(estimate(TPP, runs.viewed(TPP.inputs), weights="constant"), (), runs)
    assert parent.model["M_a"] > 1.15 * planted.TABLE_4["M_a"]
    assert parent.asked_in(parent.metric).model["M_a"] == pytest.approx(planted.TABLE_4["M_a"], rel=0.05)


def test_rows_are_weighed_by_all_of_a_matrix() -> None:
    """The past of one output foretells the other, in both directions."""
    rng = np.random.default_rng(3)
    W = rng.standard_normal((2, 2, 5)) + 1j * rng.standard_normal((2, 2, 5))
    columns = rng.standard_normal((3, 2, 5)) + 1j * rng.standard_normal((3, 2, 5))
    np.testing.assert_allclose(weighed(W, columns), np.einsum("ijf,cjf->cif", W, columns), rtol=1e-12)


LATE_MOTORS, LATE_AND_SLOWLY_LOGGED = 4076008, 4088217
"""Judged ones: motors that lag by 60 and by 17 ms, and no excitation logged."""


@pytest.mark.thorough
@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("motor_lag", "lag_per_axis")], indirect=True)
def test_late_motors_are_not_taken_for_others_that_are_late_for_a_second() -> None:
    """A lag of 0.98 s, and fast rates, was as good in the noise of a structure that is late itself."""
    runs = fitted_runs(fly_stranger(LATE_MOTORS))
    found = diagnose(on_runs("cd", (), runs, runs), runs, chains=False)
    assert (found.verdict, found.effect) == ("missing", "motor_lag")
    assert found.winner is not None
    assert found.winner.values["tau_m"] == pytest.approx(0.0604, rel=0.06)


@pytest.mark.thorough
def test_a_lag_of_all_motors_is_moved_on_where_a_lag_of_each_foretells_best_and_in_the_noise_that_this_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Least squares ended at twice the lag, and the mean of both axes there led nowhere."""
    flight = fly_stranger(LATE_AND_SLOWLY_LOGGED)
    found = ask(flight).first
    assert found.verdict == "missing"
    assert "motor_lag" in (found.effect, *found.indistinguishable)
    moved_on = refits.begun_at
    for instead in (None, lambda fit, _, values, **__: moved_on(fit, found.parent, values)):
        monkeypatch.setattr(refits, "begun_at", instead or (lambda *_, **__: None))
        other = ask(flight).first
        assert (other.effect, "motor_lag" in other.indistinguishable) == ("lag_per_axis", False)
