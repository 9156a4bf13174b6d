"""What the commands explain of a residual, and what is noise, on flights of an independent integrator."""

from __future__ import annotations

import numpy as np
import pytest
from planted import PLANTED, Run, fly_many
from planted_fits import records

from sysid.data.dataset import Bins, prepared
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.fit.estimate import estimate
from sysid.fit.noise import _Layout, _Span, divide
from sysid.fit.output_error import output_error
from sysid.model.compose import compose
from sysid.model.paper import TPP

COMMANDS = ("delta_x", "delta_y")
SEEDS = (71, 72, 73, 74)
SECONDS = 15.0


@pytest.fixture(scope="module")
def clean() -> list[list[Run]]:
    return fly_many(None, {}, seeds=SEEDS, duration_s=SECONDS)


def divided(flight: list[Run], *without: str):  # type: ignore[no-untyped-def]
    bins = prepared(records(flight, *without), DEFAULT_BAND_HZ).viewed(TPP.inputs, TPP.outputs)
    fit = estimate(TPP, bins)
    return divide(fit.error, bins.stacks, bins.causes(COMMANDS)), fit, bins.stacks


def test_where_nothing_is_missing_the_residual_is_noise(clean: list[list[Run]]) -> None:
    ratios = []
    for flight in clean:
        found, _, _ = divided(flight)
        assert found.measured
        assert np.all(found.noise_share > 0.95)
        ratios.append(found.chi_squared / found.degrees)
        np.testing.assert_allclose(np.sum(found.power), np.sum(found.explained) + np.sum(found.power - found.explained))
    # of 480 degrees of freedom: a standard deviation of 6.5 %
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.12)
    assert max(ratios) < 1.25


def test_what_is_explained_is_what_the_true_structure_takes_away() -> None:
    (flight,) = fly_many("servo_lag", PLANTED["servo_lag"], seeds=[75], duration_s=SECONDS)
    found, fit, stacks = divided(flight)
    true = compose("tpp", ["servo_lag"])
    least = output_error(
        estimate(true, Bins(tuple(one for group in stacks for one in group.spectra)), fit.model).model, stacks
    )
    taken = fit.error.residual_power - least.residual_power
    np.testing.assert_allclose(np.sum(found.explained, axis=0), taken, rtol=0.1)
    assert found.chi_squared > 50 * found.degrees
    # a number of NumPy's makes a truth of NumPy's of what is compared with it, and that no JSON can hold
    assert type(found.chi_squared) is float
    assert np.all(found.noise_share < 0.5)


def test_without_logged_excitation_the_commands_stand_for_themselves(clean: list[list[Run]]) -> None:
    found, _, _ = divided(clean[0], "excitation_x", "excitation_y", "excitation_e")
    assert not found.measured
    assert found.references == COMMANDS


def test_noise_keeps_the_spectrum_that_was_flown() -> None:
    """Gusts alone drive the rates: the spectrum at a few frequencies is the plant's answer to them."""
    (flight,) = fly_many(None, {}, seeds=[76], duration_s=30.0, noise=0.0)
    found, fit, _ = divided(flight)
    frequency = np.array([1.0, 2.0, 4.0])
    A, _, C, _ = fit.model.matrices
    expected = []
    for f in frequency:
        s = 2j * np.pi * f
        answer = C @ np.linalg.solve(s * np.eye(4) - A, np.eye(4)[:, :2])
        # first-order noise of 0.16 and 0.7 rad/s^2 with a corner at 1.5 Hz, two-sided density
        density = np.array([0.16, 0.7]) ** 2 * 2 * (2 * np.pi * 1.5) / ((2 * np.pi * 1.5) ** 2 + (2 * np.pi * f) ** 2)
        expected.append(np.real(np.diag(answer @ np.diag(density) @ answer.conj().T)))
    measured = np.real(np.einsum("fkk->fk", found.at(frequency))) * 0.002 / 2
    np.testing.assert_allclose(measured, np.array(expected), rtol=0.45)


def test_a_draw_that_was_interrupted_is_made_again_the_same(
    clean: list[list[Run]], monkeypatch: pytest.MonkeyPatch
) -> None:
    bins = prepared(records(clean[0]), DEFAULT_BAND_HZ).viewed(TPP.inputs, TPP.outputs)
    once, again = (_Layout.of(bins.stacks, bins.causes(COMMANDS), 0.5) for _ in range(2))
    made = _Span.of

    def ended(*_: object) -> _Span:
        raise KeyboardInterrupt

    monkeypatch.setattr(_Span, "of", ended)
    with pytest.raises(KeyboardInterrupt):
        next(again.late())
    monkeypatch.setattr(_Span, "of", made)
    assert np.array_equal(next(again.late()).basis, next(once.late()).basis)
