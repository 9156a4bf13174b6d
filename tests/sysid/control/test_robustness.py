"""Disk margins, bandwidth and disturbance rejection, against closed forms, python-control with SLICOT, and searches."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from planted import TABLE_4

from sysid.control.regulator import design
from sysid.control.robustness import bandwidth_of, disk_sizes, robustness, structured_singular_value
from sysid.control.stability import closed_loop, from_rates, rates_per_command
from sysid.model.compose import compose
from sysid.model.paper import TPP
from sysid.model.structure import Model

PAPER = Model(TPP, TPP.vector(TABLE_4))
LATE = compose("tpp", ["transport_delay"], TPP.inputs)
LATE_MODEL = Model(LATE, LATE.vector({**TABLE_4, "T_d": 0.020}))


def test_mu_of_two_is_what_a_search_over_scalings_and_phases_finds() -> None:
    """From above by scalings, from below by perturbations of size 1/mu that make I - M Delta singular."""
    rng = np.random.default_rng(1)
    M = rng.standard_normal((20, 2, 2)) + 1j * rng.standard_normal((20, 2, 2))
    found = structured_singular_value(M)
    d = np.exp(np.linspace(-4, 4, 4001))
    angles = np.exp(1j * np.linspace(0, 2 * np.pi, 721))
    for matrix, mu in zip(M, found, strict=True):
        scaled = np.array([[[matrix[0, 0], x * matrix[0, 1]], [matrix[1, 0] / x, matrix[1, 1]]] for x in d])
        assert mu == pytest.approx(np.linalg.norm(scaled, 2, axis=(1, 2)).min(), rel=1e-5)
        turned = matrix[None] * np.stack([np.ones_like(angles), angles], axis=1)[:, None, :]
        assert mu == pytest.approx(np.abs(np.linalg.eigvals(turned)).max(), rel=1e-3)


def test_a_loop_of_two_apart_has_the_disk_margin_of_the_worse() -> None:
    w = np.geomspace(0.1, 100, 400)
    s = 1j * w
    one, two = 25 / (s**3 + 10 * s**2 + 10 * s + 10), 4 / (s * (s + 2))
    L = np.zeros((w.size, 2, 2), dtype=complex)
    L[:, 0, 0], L[:, 1, 1] = one, two
    each = [control.disk_margins(control.tf(*x), w)[0] for x in (([25], [1, 10, 10, 10]), ([4], [1, 2, 0]))]
    assert disk_sizes(L).min() == pytest.approx(min(each), rel=1e-6)


def test_the_paper_s_loop_has_the_disk_margin_that_control_and_slicot_find() -> None:
    pytest.importorskip("slycot", reason="SLICOT has no wheel for this platform")
    gains = design(PAPER)
    A, B, C, D = (np.asarray(x, dtype=float) for x in PAPER.matrices)
    plant = control.ss(A, B[:, :2], C, D[:, :2])
    inner = A - gains.observer_gain @ C - B[:, :2] @ gains.K
    controller = control.ss(inner, gains.observer_gain, gains.K, np.zeros((2, 2)))
    size, gain_db, phase_deg = control.disk_margins(controller * plant, np.geomspace(0.1, 1000, 4000))
    found = robustness(gains, PAPER).disk
    assert found.size == pytest.approx(size, rel=1e-3)
    assert found.gain_db == pytest.approx(gain_db, rel=1e-3)
    assert found.phase_deg == pytest.approx(phase_deg, rel=1e-3)


@pytest.mark.thorough
def test_nothing_inside_the_disk_takes_the_loop_to_its_edge_and_something_on_it_does() -> None:
    """Gains and phases of each command inside the disk, searched at the frequency where it is least."""
    gains = design(LATE_MODEL)
    found = robustness(gains, LATE_MODEL).disk
    s = np.array([2j * np.pi * found.frequency_hz])
    L = (from_rates(gains, s) @ rates_per_command(LATE_MODEL, s))[0]
    delta = found.size * np.exp(1j * np.linspace(0, 2 * np.pi, 361))
    f = (1 + 0.5 * delta) / (1 - 0.5 * delta)
    closest = min(abs(np.linalg.det(np.eye(2) + L @ np.diag([a, b]))) for a in f for b in f)
    inside = (1 + 0.4 * delta) / (1 - 0.4 * delta)
    further = min(abs(np.linalg.det(np.eye(2) + L @ np.diag([a, b]))) for a in inside for b in inside)
    assert closest < 0.02 < 0.08 < further
    margins = closed_loop(gains, LATE_MODEL).margins
    assert margins is not None
    assert found.gain_db <= margins.gain_db
    assert found.phase_deg <= margins.phase_deg


def test_bandwidth_and_phase_delay_of_a_lag_and_a_delay_in_closed_form() -> None:
    """Rate answer e^(-s T)/(1 + s/a): attitude lags 90 + w T + atan(w/a)."""
    f = np.geomspace(0.02, 200, 3000)
    late, corner = 0.040, 12.0
    w = 2 * np.pi * f
    bandwidth, limited, delay = bandwidth_of(f, np.exp(-1j * w * late) / (1 + 1j * w / corner))
    grid = np.linspace(1, 100, 2_000_001)
    lag = grid * late + np.arctan(grid / corner)
    at_135, at_180 = grid[np.searchsorted(lag, math.pi / 4)], grid[np.searchsorted(lag, math.pi / 2)]
    size = 1 / (grid * np.sqrt(1 + (grid / corner) ** 2))
    six = size[np.searchsorted(grid, at_180)] * 10 ** (6 / 20)
    at_six = grid[np.flatnonzero(size >= six)[-1]]
    assert bandwidth == pytest.approx(min(at_135, at_six) / (2 * math.pi), rel=1e-3)
    assert limited == ("phase" if at_135 < at_six else "gain")
    twice = 2 * at_180
    assert delay == pytest.approx(1000 * (twice * late + math.atan(twice / corner) - math.pi / 2) / twice, rel=1e-2)
    assert bandwidth_of(f, np.ones(f.size, dtype=complex)) == (None, None, None)


def test_disturbance_rejection_is_control_s_sensitivity() -> None:
    gains = design(PAPER)
    A, B, C, D = (np.asarray(x, dtype=float) for x in PAPER.matrices)
    inner = A - gains.observer_gain @ C - B[:, :2] @ gains.K
    loop = control.ss(A, B[:, :2], C, D[:, :2]) * control.ss(inner, gains.observer_gain, gains.K, np.zeros((2, 2)))
    S = control.feedback(control.ss([], [], [], np.eye(2)), loop)
    w = np.geomspace(2 * np.pi * 0.02, 2 * np.pi * 200, 3000)
    for k, one in enumerate(robustness(gains, PAPER).handling):
        size = 20 * np.log10(np.abs(S(1j * w)[k, k]))
        assert one.rejection_peak_db == pytest.approx(size.max(), abs=1e-6)
        assert (one.rejection_hz is None) == (size[0] > -3)
