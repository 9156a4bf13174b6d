"""Observers side by side: sizes of noise come back from flights with known ones, and time shows what was told."""

from __future__ import annotations

import control
import numpy as np
import pytest
from planted import TABLE_4
from scipy.linalg import expm

from gcs.analysis.lqr import parse_observer
from sysid.control.observers import (
    RateNoise,
    WhiteNoise,
    command_noise,
    gusts_left,
    kalman_gain,
    over_observers,
    rate_noise,
    white_noise,
    with_gain,
    with_poles,
)
from sysid.control.regulator import DesignError, Gains, design
from sysid.data.record import Record
from sysid.model.paper import TPP
from sysid.model.structure import Model

PAPER = Model(TPP, TPP.vector(TABLE_4))
DT, SECONDS = 0.004, 60.0
GUSTS, GYROS = np.array([0.02, 0.05]) ** 2, np.array([4e-4, 3e-4]) ** 2
"""One-sided densities."""


def flown(gains: Gains | None, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Measured rates and commands (n, 2), in white gusts with white gyro noise, step by step."""
    rng = np.random.default_rng(seed)
    A, B, C, _ = (np.asarray(one, dtype=float) for one in PAPER.matrices)
    n = round(SECONDS / DT)
    # of a white noise of one-sided density S, held over a sample, the variance is S / (2 dt)
    gusts = rng.standard_normal((n, 2)) * np.sqrt(GUSTS / (2 * DT))
    gyros = rng.standard_normal((n, 2)) * np.sqrt(GYROS / (2 * DT))
    plant = _held(A, np.hstack([B, np.eye(4, 2)]))
    K, L = (np.zeros((2, 4)), np.zeros((4, 2))) if gains is None else (gains.K, gains.observer_gain)
    observer = _held(A - L @ C, np.hstack([B, L]))
    excitation = (0.05 if gains is None else 0.0) * rng.standard_normal((n, 2))
    x, x_hat, rates, commands = np.zeros(4), np.zeros(4), [], []
    for k in range(n):
        y = C @ x + gyros[k]
        u = excitation[k] - K @ x_hat
        rates.append(y)
        commands.append(u)
        x = plant[0] @ x + plant[1] @ np.concatenate([u, gusts[k]])
        x_hat = observer[0] @ x_hat + observer[1] @ np.concatenate([u, y])
    return np.array(rates), np.array(commands)


def _held(A: np.ndarray, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n, m = B.shape
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = A * DT, B * DT
    step = expm(whole)
    return step[:n, :n], step[:n, n:]


@pytest.fixture(scope="module")
def noise() -> RateNoise:
    rates, commands = flown(None)
    channels = dict(zip(("p", "q", "delta_x", "delta_y"), (*rates.T, *commands.T), strict=True))
    return rate_noise(PAPER, [Record("r", {"t": np.linspace(0.0, SECONDS - DT, len(rates)), **channels})])


def test_sizes_of_gusts_and_gyro_noise_come_back(noise: RateNoise) -> None:
    found = white_noise(PAPER, noise)
    assert np.sqrt(found.gusts) == pytest.approx(np.sqrt(GUSTS), rel=0.15)
    assert np.sqrt(found.gyros) == pytest.approx(np.sqrt(GYROS), rel=0.10)
    assert noise.frequency_hz[-1] == pytest.approx(0.95 * 0.5 / DT, rel=0.01)


def test_the_filter_is_control_s() -> None:
    white = WhiteNoise(gusts=GUSTS, gyros=GYROS)
    A, _, C, _ = (np.asarray(one, dtype=float) for one in PAPER.matrices)
    expected, _, _ = control.lqe(A, np.eye(4, 2), C, np.diag(GUSTS), np.diag(GYROS))
    assert kalman_gain(PAPER, white) == pytest.approx(expected, rel=1e-6)


def test_noise_of_commands_and_gusts_that_are_left_are_what_time_shows(noise: RateNoise) -> None:
    gains = design(PAPER)
    white = white_noise(PAPER, noise)
    for one in (gains, with_gain(gains, kalman_gain(PAPER, white), PAPER)):
        rates, commands = flown(one, seed=2)
        assert command_noise(one, PAPER, noise) == pytest.approx(commands.std(axis=0), rel=0.15)
        moved = np.sqrt(rates.var(axis=0) - GYROS / (2 * DT))
        left = gusts_left(one, PAPER, white)
        assert left == pytest.approx(moved / np.sqrt(_gust_power(white)), rel=0.15)


def _gust_power(white: WhiteNoise) -> np.ndarray:
    """(2,): variance of p and q in gusts alone, by the Lyapunov equation."""
    A, _, C, _ = (np.asarray(one, dtype=float) for one in PAPER.matrices)
    P = control.lyap(A, np.eye(4, 2) @ np.diag(white.gusts / 2) @ np.eye(2, 4))
    return np.asarray(np.diag(C @ P @ C.T))


def test_the_kalman_filter_stirs_commands_less_and_holds_more_delay(noise: RateNoise) -> None:
    gains = design(PAPER)
    found = {one.name: one for one in over_observers(gains, [("fit", PAPER)], noise)}
    assert list(found) == ["half", "paper", "twice", "four times", "kalman"]
    paper, kalman = found["paper"], found["kalman"]
    assert paper.gains.observer_gain == pytest.approx(gains.observer_gain)
    assert paper.least == gains.loop.margins
    assert kalman.noise is not None
    assert paper.noise is not None
    assert np.all(kalman.noise < paper.noise)
    assert kalman.least is not None
    assert paper.least is not None
    assert kalman.least.delay_s > paper.least.delay_s
    stirred = [one.noise[0] for name, one in found.items() if name != "kalman" and one.noise is not None]
    assert stirred == sorted(stirred)
    bare = over_observers(gains, [("fit", PAPER)], None)
    assert [one.noise for one in bare] == [None] * 4


def test_poles_are_where_they_are_asked_for() -> None:
    poles = parse_observer("30,-30, 31,31")
    assert not isinstance(poles, str)
    found = with_poles(design(PAPER), poles, PAPER)
    assert sorted(found.observer_poles.real) == pytest.approx([-31, -31, -30, -30], abs=1e-3)
    assert found.loop.margins != design(PAPER).loop.margins
    assert parse_observer(" Kalman") == "kalman"
    assert parse_observer(None) == (-50.0, -50.0, -51.0, -51.0)


def test_a_noise_or_poles_that_make_no_observer_are_refused() -> None:
    short = {name: np.zeros(500) for name in ("p", "q", "delta_x", "delta_y")}
    with pytest.raises(DesignError, match="what noise the vehicle flies in is not known"):
        rate_noise(PAPER, [])
    with pytest.raises(DesignError, match="no run is 4 s long"):
        rate_noise(PAPER, [Record("r", {"t": np.linspace(0.0, 2.0, 500), **short})])
    for poles in ((-50.0,) * 3, (-50.0, -50.0, -51.0, 51.0), (-50.0, -50.0, -51.0, float("nan"))):
        with pytest.raises(DesignError, match="as many poles, each negative"):
            with_poles(design(PAPER), poles, PAPER)
    with pytest.raises(DesignError, match="each at most twice"):
        with_poles(design(PAPER), (-50.0,) * 4, PAPER)
    nothing = WhiteNoise(gusts=np.array([np.nan, 0.0]), gyros=GYROS)
    with pytest.raises(DesignError, match="no Kalman filter"):
        kalman_gain(PAPER, nothing)
