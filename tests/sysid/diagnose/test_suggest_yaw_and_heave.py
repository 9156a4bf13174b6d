"""What the catalogue has nothing for on yaw and heave alone is named as a simple term, as a file that fits."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from more_of_a_kind import thorough

import sysid
from gcs.analysis.diagnosis import diagnose_fit
from sysid.data.dataset import dataset
from sysid.data.record import FloatArray, Record
from sysid.diagnose.candidate_terms import candidate_terms
from sysid.diagnose.evidence import candidate
from sysid.diagnose.terms import Entry, Factor
from sysid.fit.estimate import estimate
from sysid.model.compose import compose
from sysid.model.effect import load

DT, PARTS = 0.005, 4
BAND_HZ = (0.3, 8.0)
T: FloatArray = np.asarray(DT * np.arange(8000), float)
CHIRP: FloatArray = np.sin(2 * np.pi * (0.3 * T + 0.09 * T**2)) * (T < 39)


def moved(
    command: str,
    output: str,
    size: float,
    rates: Callable[[FloatArray, float], FloatArray],
    states: int,
    row: int,
    *,
    seed: int,
) -> Record:
    """A vehicle by its equations, integrated in small steps; its row `row` is what is measured."""
    x, answer = np.zeros(states), np.zeros(T.size)
    for i, delta in enumerate(size * CHIRP):
        answer[i] = x[row]
        for _ in range(PARTS):
            half = x + 0.5 * DT / PARTS * rates(x, delta)
            x = x + DT / PARTS * rates(half, delta)
    rng = np.random.default_rng(seed)
    channels: dict[str, FloatArray] = {"t": T, "delta_x": 0 * T, "delta_y": 0 * T}
    channels |= {name: 0.01 * rng.standard_normal(T.size) for name in ("p", "q")}
    channels |= {command: size * CHIRP, f"excitation_{command[-1]}": size * CHIRP}
    channels[output] = answer + 0.02 * np.std(answer) * rng.standard_normal(T.size)
    axis = {"delta_r": "yaw", "delta_c": "thrust"}[command]
    return Record(axis, channels, maneuver="chirp", axis=axis, rate_source="SIDD", swept_band_hz=(0.3, 7.3))


def of_yaw(x: FloatArray, delta: float) -> FloatArray:
    return np.array([-1.0 * x[0] - 1.2 * x[0] * abs(x[0]) + 30.0 * delta])


def of_heave(x: FloatArray, delta: float) -> FloatArray:
    """w and az: a drag that grows with the square, and thrust behind a lag."""
    w, az = x
    return np.array([az, (-0.5 * w - 1.0 * w * abs(w) - 60.0 * delta - az) / 0.06])


def flown(base: str) -> list[Record]:
    if base == "yaw":
        return [moved("delta_r", "r", size, of_yaw, 1, 0, seed=1) for size in (0.03, 0.12)]
    return [moved("delta_c", "az", size, of_heave, 2, 1, seed=2) for size in (0.03, 0.08)]


@pytest.mark.parametrize(
    ("base", "row", "signal", "unit"),
    [("yaw", "r_dot", "r|r|", "-"), *thorough([("heave", "az_dot", "w|w|", "1/(m s)")])],
)
def test_a_drag_of_the_second_power_is_named_and_fits(
    base: str, row: str, signal: str, unit: str, tmp_path: Path
) -> None:
    runs = flown(base)
    fit = sysid.fit_model(runs, base, band_hz=BAND_HZ)
    found = diagnose_fit(fit, runs, suggesting=True)
    assert found.suggestion is not None
    term = found.suggestion.terms[0]
    named = [term.entry, *term.as_well]
    assert f"{row} += " in term.entry.equation
    assert any(one.equation.endswith(f" {signal}") and one.equation.startswith(row) for one in named)
    if signal in term.entry.equation:
        assert term.entry.units == (unit,)
    path = tmp_path / "term.py"
    path.write_text(found.suggestion.text)
    written = load(path)
    assert written.channels == ()
    with_it = sysid.fit_model(runs, base, [str(path)], band_hz=BAND_HZ)
    (output,) = fit.nrmse_percent
    assert with_it.nrmse_percent[output] > fit.nrmse_percent[output] + 1


def test_units_of_heave_have_metres() -> None:
    w, az, delta = Factor("w"), Factor("az"), Factor("delta_c")
    units = [Entry((("az_dot", one),)).units for one in ((w, w), (w,), (delta,), (az,), (az, az))]
    assert units == [("1/(m s)",), ("1/s^2",), ("m/s^3",), ("1/s",), ("s/m",)]


def test_a_collective_that_moves_in_a_roll_sweep_has_no_mirror_on_pitch() -> None:
    """Its term would have been looked for in q, which a base of roll alone does not have: a traceback."""
    run = moved("delta_r", "r", 0.1, of_yaw, 1, 0, seed=3)
    rolled = dict(run.channels) | {"p": run.channels["r"], "delta_x": run.channels["delta_r"]}
    rolled |= {"delta_c": 0.1 * np.sin(3 * T), "excitation_x": run.channels["delta_r"]}
    record = Record("roll", {name: rolled[name] for name in rolled if name != "excitation_r"}, axis="roll")
    on = dataset([record], BAND_HZ, outputs=("p",))
    structure = compose("roll", (), on.available)
    parent = candidate(estimate(structure, on.viewed(structure.inputs)), (), on)
    assert all(len(one.parts) == 1 for one in candidate_terms(parent).entries)
