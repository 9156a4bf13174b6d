"""How fast a fit is, against peers in the same run. `make bench` prints the ratios; nothing here asserts a time."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import casadi_fit
import numpy as np
import pytest
from scipy.fft import rfft
from scipy.optimize import least_squares
from scipy.signal import lsim
from timing import best_of

from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.model.paper import TPP
from sysid.model.structure import Model

TRUTH = np.array([147.548, 713.378, 0.091, -1.338, 1.448, -0.282, 0.296, 0.524, -0.050])
RUNS = (12000, 14000, 16000, 18000)
REPEATS = 30
"""The shortest counts: others may load the machine."""


DT = 0.002  # s


def flown() -> list[tuple[np.ndarray, np.ndarray]]:
    """Commands and rates of every run, (n, 2), a fifth of the rates being noise."""
    rng = np.random.default_rng(1)
    matrices = tuple(Model(TPP, TRUTH).matrices)
    found = []
    for n in RUNS:
        u = np.cumsum(rng.normal(size=(n, 2)), axis=0) * 0.003
        u -= u.mean(axis=0)
        y = lsim(matrices, u, DT * np.arange(n), interp=False)[1]
        found.append((u, y + rng.normal(size=y.shape) * y.std(axis=0) * 0.2))
    return found


def recorded(number: int, u: np.ndarray, y: np.ndarray) -> Record:
    channels = {"t": DT * np.arange(len(u)), "p": y[:, 0], "q": y[:, 1], "delta_x": u[:, 0], "delta_y": u[:, 1]}
    return Record(f"#{number}", channels)


def bench_tpp_fit_of_60000_samples() -> None:
    runs = flown()
    records = [recorded(number, u, y) for number, (u, y) in enumerate(runs)]

    def transforms() -> None:
        for u, y in runs:
            rfft(u, axis=0)
            rfft(y, axis=0)

    def by_simulation() -> None:
        def residuals(values: np.ndarray) -> np.ndarray:
            simulated = tuple(Model(TPP, values).matrices)
            return np.concatenate(
                [(y - lsim(simulated, u, DT * np.arange(len(u)), interp=False)[1]).ravel() for u, y in runs]
            )

        least_squares(residuals, TRUTH * 1.1, x_scale=np.abs(TRUTH))

    transform_s = best_of(REPEATS, transforms)
    fit_s = best_of(REPEATS, lambda: identify(TPP, records))
    simulation_s = best_of(1, by_simulation)
    print(
        f"\nTPP fit, {sum(RUNS)} samples, no start values: {1000 * fit_s:.1f} ms\n"
        f"  {fit_s / transform_s:.1f} passes of scipy.fft.rfft over the same data ({1000 * transform_s:.2f} ms)\n"
        f"  {simulation_s / fit_s:.0f} times faster than least_squares over scipy.signal.lsim ({simulation_s:.1f} s)"
    )


def bench_against_casadi(tmp_path: Path) -> None:
    for needed, found in (("casadi", importlib.util.find_spec("casadi")), ("a C compiler, cc", shutil.which("cc"))):
        if found is None:
            pytest.skip(f"no comparison with CasADi: {needed} is not installed (pip install -e '.[bench]' has casadi)")
    import casadi

    runs = flown()
    records = [recorded(number, u, y) for number, (u, y) in enumerate(runs)]
    data = [casadi.DM(np.concatenate([u.T, y.T])) for u, y in runs]
    fit_s = best_of(REPEATS, lambda: identify(TPP, records))
    print()
    for way in (casadi_fit.by_example, casadi_fit.by_hand):
        compiled = way(casadi, TPP, DT, RUNS, tmp_path / way.__name__)
        found = casadi_fit.fit(compiled, data, TRUTH * 1.1)
        assert np.all(np.abs(found / TRUTH - 1) < 0.1)
        casadi_s = best_of(3, lambda compiled=compiled: casadi_fit.fit(compiled, data, TRUTH * 1.1))
        print(f"  {casadi_s / fit_s:.0f} times faster than CasADi {way.__name__} ({1000 * casadi_s:.0f} ms)")
