"""Noise that comes in bursts: what it makes of tests that take it as steady."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from planted import fly_many
from planted_fits import records
from scipy.stats import chi2

from sysid.data.dataset import prepared
from sysid.data.instrument import Causes
from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.diagnose.evidence import Stepped
from sysid.diagnose.score import Score, along, in_bursts, log_chance
from sysid.fit.bursts import Envelope, as_known, as_steady, as_steady_by
from sysid.fit.noise import divide
from sysid.fit.output_error import OutputError
from sysid.fit.whitening import Whitening
from sysid.model.paper import TPP
from sysid.model.structure import FloatArray

COMMANDS = ("delta_x", "delta_y")
BURSTS = 0.02
"""Power between bursts, over that in them."""
DRAWS = 12


@pytest.fixture(scope="module")
def flown() -> tuple[tuple[Stack, ...], Causes]:
    (flight,) = fly_many(None, {}, seeds=[71], duration_s=10.0)
    bins = prepared(records(flight), (0.5, 12.0)).viewed(TPP.inputs, TPP.outputs)
    return bins.stacks, bins.causes(COMMANDS)


def noise(stacks: tuple[Stack, ...], seed: int, calm: float) -> list[ComplexArray]:
    """Of every segment (2, bins), white but that its power is `calm` outside one burst of a fifth of the time."""
    rng = np.random.default_rng(seed)
    found = []
    for one in (spectrum for group in stacks for spectrum in group.spectra):
        n = one.frequency_hz.size
        power = np.where((np.arange(n) / n - rng.random()) % 1 < 0.2, 1.0, calm)
        white = rng.standard_normal((2, n)) + 1j * rng.standard_normal((2, n))
        found.append(np.fft.fft(np.sqrt(power) * white, axis=1, norm="ortho"))
    return found


def deviations(flown: tuple[tuple[Stack, ...], Causes], calm: float) -> np.ndarray:
    """Of chi squared from its degrees, in its steady standard deviations, in some draws of noise alone."""
    stacks, causes = flown
    found = []
    for seed in range(DRAWS):
        left = noise(stacks, seed, calm)
        power = np.sum([np.sum(np.abs(one) ** 2, axis=1) for one in left], axis=0)
        division = divide(OutputError(left, power, power), stacks, causes)
        found.append((division.chi_squared - division.degrees) / np.sqrt(2 * division.degrees))
    return np.array(found)


def test_bursts_alone_explain_nothing(flown: tuple[tuple[Stack, ...], Causes], monkeypatch: pytest.MonkeyPatch) -> None:
    assert np.max(deviations(flown, BURSTS)) < 3.5
    monkeypatch.setattr("sysid.fit.noise.WORTH_A_LOOK", np.inf)  # taken as steady
    assert np.max(deviations(flown, BURSTS)) > 5


def test_the_order_in_which_logs_are_named_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysid.fit.noise.NO_CHANCE", np.inf)
    (flight,) = fly_many(None, {}, seeds=[71], duration_s=10.0)
    runs = [replace(one, sha256=f"{number}") for number, one in enumerate(records(flight))]
    found = []
    for named in (runs, runs[::-1]):
        bins = prepared(named, (0.5, 12.0)).viewed(TPP.inputs, TPP.outputs)
        segments = [one for group in bins.stacks for one in group.spectra]
        drawn = dict(zip([one.sha256 for one in runs], noise(bins.stacks, 0, BURSTS), strict=True))
        left = [drawn[one.segment.record.sha256] for one in segments]
        power = np.sum([np.sum(np.abs(one) ** 2, axis=1) for one in left], axis=0)
        found.append(divide(OutputError(left, power, power), bins.stacks, bins.causes(COMMANDS)).chi_squared)
    assert found[0] == pytest.approx(found[1], rel=1e-6)


def test_steady_noise_is_taken_as_it_was(flown: tuple[tuple[Stack, ...], Causes]) -> None:
    stacks, _ = flown
    for seed in range(DRAWS):
        rows = np.concatenate([np.ascontiguousarray(one).view(float).ravel() for one in noise(stacks, seed, 1.0)])
        assert not Envelope.of(rows, stacks).rough


def in_bins(rng: np.random.Generator, power: np.ndarray) -> ComplexArray:
    """Noise (2, bins) of this power over time."""
    white = rng.standard_normal((2, power.size)) + 1j * rng.standard_normal((2, power.size))
    return np.asarray(np.fft.fft(np.sqrt(power) * white, axis=1, norm="ortho"))


def test_inner_products_with_bursts_scatter_as_said(flown: tuple[tuple[Stack, ...], Causes]) -> None:
    stacks, _ = flown
    rows = np.concatenate([np.ascontiguousarray(one).view(float).ravel() for one in noise(stacks, 1, BURSTS)])
    envelope = Envelope.of(rows, stacks)
    assert envelope.rough
    burst = np.concatenate([np.ascontiguousarray(one).view(float).ravel() for one in noise(stacks, 1, 0.0)])
    asked = np.stack([burst, np.random.default_rng(2).standard_normal(rows.size)])
    rng, drawn = np.random.default_rng(0), []
    for _ in range(400):
        parts = [np.concatenate([in_bins(rng, power) for power in bands], axis=1) for bands in envelope.power]
        drawn.append(np.concatenate([part.view(float).ravel() for part in parts]))
    products = np.array(drawn) @ asked.T
    gram = envelope.gram(asked)
    np.testing.assert_allclose(np.diag(products.T @ products / len(drawn)), np.diag(gram), rtol=0.25)
    steady = np.sum(asked**2, axis=1)
    assert gram[0, 0] > 2 * steady[0], "it asks just when the noise is loud"
    assert gram[1, 1] == pytest.approx(steady[1], rel=0.2)


def test_a_burst_of_its_own_colour_is_loud_where_it_is(flown: tuple[tuple[Stack, ...], Causes]) -> None:
    stacks, _ = flown
    parts = noise(stacks, 1, 1.0)
    for left in parts:
        third = left.shape[1] // 3
        left[:, :third] = in_bins(np.random.default_rng(4), np.where(np.arange(third) < third // 5, 12.0, 0.2))
    envelope = Envelope.of(np.concatenate([one.view(float).ravel() for one in parts]), stacks)
    assert envelope.rough
    low, high = (max(float(bands[place].max()) for bands in envelope.power) for place in (0, -1))
    assert low > 4
    assert high < 3


def test_no_burst_explains_more_than_itself(flown: tuple[tuple[Stack, ...], Causes]) -> None:
    stacks, _ = flown
    rows = np.concatenate([one.view(float).ravel() for one in noise(stacks, 1, 0.001)])
    envelope = Envelope.of(rows, stacks)
    asked = rows[None]  # just what the noise did
    met = float((asked @ rows)[0])
    bursts = sum(len(bands) for bands in envelope.power)
    assert met**2 / envelope.gram(asked)[0, 0] > 100
    assert met**2 / envelope.covariance(asked, rows)[0, 0] < 3 * bursts
    elsewhere = np.random.default_rng(5).standard_normal((1, rows.size))
    assert envelope.covariance(elsewhere, 1e-6 * rows)[0, 0] == pytest.approx(envelope.gram(elsewhere)[0, 0], rel=1e-3)


def test_a_chi_squared_of_its_own_spread_stays_what_it_is() -> None:
    assert as_steady(500.0, 400, 400.0, np.sqrt(800.0)) == pytest.approx(500.0, rel=1e-6)
    wider = as_steady(500.0, 400, 440.0, 60.0)
    assert log_chance(wider, 400) > np.log(0.1)
    assert as_steady(100.0, 400, 440.0, 60.0) <= 100.0


def test_power_followed_over_little_time_is_known_badly(flown: tuple[tuple[Stack, ...], Causes]) -> None:
    stacks, _ = flown
    rows = np.concatenate([np.ascontiguousarray(one).view(float).ravel() for one in noise(stacks, 1, BURSTS)])
    envelope = Envelope.of(rows, stacks)
    in_the_burst = np.concatenate([np.ascontiguousarray(one).view(float).ravel() for one in noise(stacks, 1, 0.0)])
    everywhere = np.random.default_rng(2).standard_normal(rows.size)
    in_one, in_all = (envelope.surely(30.0, 1, one[None]) for one in (in_the_burst, everywhere))
    assert in_one < in_all < 30.0
    assert envelope.surely(1.0, 1, everywhere[None]) == pytest.approx(1.0, rel=0.05)


def test_estimated_noise_is_exceeded_as_often_as_f_says() -> None:
    assert as_known(30.0, 2, 1e7) == pytest.approx(30.0, rel=1e-4)
    draws = np.random.default_rng(3)
    estimated = draws.chisquare(2, 200_000) / (draws.chisquare(20, 200_000) / 20)
    limit = float(np.quantile(estimated, 0.999))
    assert as_known(limit, 2, 20.0) == pytest.approx(chi2.isf(0.001, 2), rel=0.06)


@pytest.mark.parametrize("spread", [1.0, 3.0])
def test_few_draws_say_what_all_would_and_near_a_limit_all_are_made(spread: float) -> None:
    degrees, all_draws, looks = 200, 60, []
    deviation = np.sqrt(2 * degrees)
    within, beyond = degrees + 2 * deviation, degrees + 5 * deviation
    for seed in range(20):
        by_chance = degrees + spread * (np.random.default_rng(seed).chisquare(degrees, all_draws) - degrees)
        for asked in np.linspace(3.0, 60.0, 20):
            chi_squared, made = degrees + asked * deviation, iter(by_chance.tolist())
            told = as_steady_by(made, chi_squared, degrees, within, beyond)
            looks.append(all_draws - len(list(made)))
            whole = as_steady(chi_squared, degrees, float(np.mean(by_chance)), float(np.std(by_chance)))
            assert (told < within, told >= beyond) == (whole < within, whole >= beyond)
            if looks[-1] == all_draws:
                assert told == whole
    assert min(looks) < all_draws / 4
    assert max(looks) == all_draws


def test_a_burst_is_no_excuse_for_what_no_burst_makes() -> None:
    little, much = (
        Score(effect="servo_lag", chi_squared=chi, degrees=1, tried=1, at={}, errors={}, at_least=chi, surely=2.0)
        for chi in (25.0, 60.0)
    )
    assert log_chance(25.0, 1) == little.log_p < little.log_p_surely == log_chance(2.0, 1)
    assert much.log_p_surely == much.log_p


def test_what_an_effect_does_at_one_moment_is_no_burst(flown: tuple[tuple[Stack, ...], Causes]) -> None:
    stacks, _ = flown

    def row(seed: int, calm: float) -> FloatArray:
        return np.concatenate([np.ascontiguousarray(one).view(float).ravel() for one in noise(stacks, seed, calm)])

    effect, other = row(1, 0.0), row(2, 0.0)
    white, nothing = np.random.default_rng(4).standard_normal(effect.size), np.empty((0, effect.size))
    whitening = cast("Whitening", SimpleNamespace(stacks=stacks))

    def told(asked: FloatArray, residual: FloatArray) -> tuple[float, float]:
        """Chi squared with all that is left followed over time, and with what is left beside the rows."""
        stepped = Stepped(residual=residual, imposed=residual, J=nothing, Z=nothing)
        envelopes = stepped.envelope(whitening), stepped.envelope_beside(asked, whitening)
        own, beside = (in_bursts(asked, residual, one) for one in envelopes)
        return own, beside

    # taken for a burst, the effect itself would explain next to nothing
    own, beside = told(effect[None], white + 3 * effect)
    assert own < 100 < 1000 < beside
    # a burst that shook the commands, too, stays one
    shaken, blowing = (0.3 * effect + other)[None], white + 30 * effect
    own, beside = told(shaken, blowing)
    assert beside < 2 * own < 100 < 1000 < along(shaken, blowing)[0]
