"""Measured responses against systems known from outside: SciPy's simulation, the independent integrator's flights."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import control
import numpy as np
import pytest
from planted import TABLE_4, fly
from scipy.signal import lsim

from sysid.data.preprocess import spectra
from sysid.data.record import Record
from sysid.response.measure import measure
from sysid.response.values import Responses

COMMANDS = ("delta_x", "delta_y")
EXCITATION = ("excitation_x", "excitation_y", "excitation_e")
ROOM = 0.6
"""Coherence from which a response counts as measured."""


def tables_matrices() -> tuple[np.ndarray, ...]:
    """Table 4's TPP written out by hand."""
    N = TABLE_4
    tau = N["tau_f"]
    A = np.array(
        [
            [0, 0, 0, N["L_b"]],
            [0, 0, N["M_a"], 0],
            [0, -1, -1 / tau, N["A_b"] / tau],
            [-1, 0, N["B_a"] / tau, -1 / tau],
        ]
    )
    B = np.array([[0, 0], [0, 0], [N["A_lat"], N["A_lon"]], [N["B_lat"], N["B_lon"]]]) / tau
    return A, B, np.eye(2, 4), np.zeros((2, 2))


def truth(frequency_hz: np.ndarray) -> np.ndarray:
    return np.asarray(control.ss(*tables_matrices())(2j * np.pi * frequency_hz))


@cache
def flight(gusts: float) -> tuple[Record, ...]:
    axes = ("roll", "pitch", "roll", "pitch")
    runs = fly(None, {}, seed=7, gusts=gusts)
    return tuple(
        Record(f"#{i}", run, maneuver="chirp", axis=axis) for i, (run, axis) in enumerate(zip(runs, axes, strict=True))
    )


def without_excitation(records: Sequence[Record]) -> list[Record]:
    return [
        Record(
            one.id, {n: x for n, x in one.channels.items() if n not in EXCITATION}, maneuver=one.maneuver, axis=one.axis
        )
        for one in records
    ]


def measured(records: Sequence[Record]) -> Responses:
    return measure(spectra(records, COMMANDS, ("p", "q"))[0], COMMANDS)


def decibels(found: Responses) -> np.ndarray:
    """Measured over true, (k, m, f); NaN where not coherent."""
    with np.errstate(all="ignore"):
        error = 20 * np.log10(np.abs(found.H / truth(found.frequency_hz)))
    return np.where(found.partial_coherence >= ROOM, error, np.nan)


def noisy_open_loop(noise: float, seconds: float = 60.0, dt: float = 0.004) -> Record:
    rng = np.random.default_rng(3)
    t = np.arange(0, seconds, dt)
    u = 0.05 * rng.normal(size=(t.size, 2))
    y = lsim(tables_matrices(), u, t, interp=False)[1]
    y = y + noise * rng.normal(size=y.shape)
    return Record("open", {"t": t, "p": y[:, 0], "q": y[:, 1], "delta_x": u[:, 0], "delta_y": u[:, 1]})


def test_an_exact_system_comes_back() -> None:
    found = measured([noisy_open_loop(0.0)])
    clear = (found.frequency_hz > 0.4) & (found.frequency_hz < 12)
    expected = truth(found.frequency_hz)
    error = np.abs(found.H - expected) / np.max(np.abs(expected), axis=1, keepdims=True)
    assert np.max(error[..., clear]) < 0.08  # the run neither begins nor ends at rest
    weak = np.abs(found.H - expected) / found.error
    assert np.sqrt(np.mean(weak[..., clear] ** 2)) < 1.3
    assert np.nanmin(found.multiple_coherence[:, clear]) > 0.95
    assert found.references == COMMANDS
    assert not found.closed_loop_safe


def test_partial_coherence_is_what_one_command_explains() -> None:
    """White commands and white noise of known size: gamma^2 = |H|^2 S_u/(|H|^2 S_u + S_n)."""
    found = measured([noisy_open_loop(0.3, 240.0)])
    expected = np.abs(truth(found.frequency_hz)) ** 2 * 0.05**2
    expected = expected / (expected + 0.3**2)
    inside = (found.frequency_hz > 1) & (found.frequency_hz < 12)
    np.testing.assert_allclose(found.partial_coherence[..., inside], expected[..., inside], atol=0.16)
    assert expected[..., inside].max() > 0.2


def test_noise_alone_has_no_coherence() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(0, 60, 0.004)
    one = Record("noise", {"t": t, **{name: rng.normal(size=t.size) for name in ("p", "q", *COMMANDS)}})
    found = measured([one])
    assert np.nanmean(found.partial_coherence) < 0.05
    assert np.nanmax(found.multiple_coherence) < 0.5


def test_both_sweeps_together_give_the_right_responses() -> None:
    for records in (flight(1.0), without_excitation(flight(1.0))):
        error = decibels(measured(records))
        assert np.sum(np.isfinite(error)) > 150
        assert np.sqrt(np.nanmean(error**2)) < 0.5


def test_one_sweep_gives_no_response_rather_than_a_wrong_one() -> None:
    """The trap: the pitch command follows the roll sweep, and coherence near 1 says nothing."""
    roll = [one for one in without_excitation(flight(1.0)) if one.axis == "roll"]
    found = measured(roll)
    inside = found.frequency_hz < 7.5  # beyond, the roll noise on the pitch command separates the two
    assert np.all(np.isnan(found.H[..., inside]))
    assert np.nanmax(np.abs(decibels(found))) < 2.0


def test_the_logged_excitation_keeps_the_gusts_out() -> None:
    """In strong gusts the commands as their own reference lean; against the excitation they do not."""
    gusty = flight(4.0)
    safe, leaning = measured(gusty), measured(without_excitation(gusty))
    assert safe.closed_loop_safe
    assert safe.references == ("excitation_x", "excitation_y")
    bias = [float(np.nanmean(decibels(one)[[0, 1], [0, 1]])) for one in (safe, leaning)]
    assert abs(bias[0]) < 0.35
    assert bias[1] < bias[0] - 0.4


def test_an_excitation_that_stands_still_answers_nothing() -> None:
    records = [
        Record(one.id, {**one.channels, "excitation_y": np.zeros(one.t.size)}, maneuver=one.maneuver, axis=one.axis)
        for one in flight(1.0)
    ]
    assert not np.any(np.isfinite(measured(records).H))


def test_runs_of_different_rates_count_together() -> None:
    slow = [
        Record(
            one.id, {name: values[::4] for name, values in one.channels.items()}, maneuver=one.maneuver, axis=one.axis
        )
        for one in flight(1.0)[2:]
    ]
    mixed = decibels(measured([*flight(1.0)[:2], *slow]))
    assert np.sqrt(np.nanmean(mixed**2)) < 0.6


@pytest.mark.data
def test_the_trap_in_the_data_of_a_real_autopilot(shared_data: Path) -> None:
    """Roll and pitch sweep together, with and without the logged excitation, agree; one alone says nothing."""
    from gcs.logs import resolve_runs

    logs = [str(shared_data / "ardupilot" / f"heli_{axis}_sweep.BIN") for axis in ("roll", "pitch")]
    records = resolve_runs(logs)
    bare = [
        Record(
            one.id,
            {name: values for name, values in one.channels.items() if name not in EXCITATION},
            maneuver=one.maneuver,
            axis=one.axis,
            rate_source=one.rate_source,
            swept_band_hz=one.swept_band_hz,
        )
        for one in records
    ]
    both, unlogged = measured(records), measured(bare)
    assert np.mean(both.partial_coherence > 0.9) > 0.8
    assert np.nanmedian(np.abs(20 * np.log10(np.abs(both.H / unlogged.H)))) < 0.1
    for one in bare:
        alone = measured([one])
        assert np.mean(np.isnan(alone.H)) > 0.85
