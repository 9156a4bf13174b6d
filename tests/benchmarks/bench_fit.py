"""How fast a fit is, against peers in the same run. `make bench` prints the ratios; nothing here asserts a time."""

from __future__ import annotations

import numpy as np
from scipy.fft import rfft
from scipy.optimize import least_squares
from scipy.signal import lsim
from timing import best_of

from sysid.identify import identify
from sysid.model import Model
from sysid.record import Record
from sysid.structures import TPP

TRUTH = np.array([147.548, 713.378, 0.091, -1.338, 1.448, -0.282, 0.296, 0.524, -0.050])
RUNS = (12000, 14000, 16000, 18000)


def bench_tpp_fit_of_60000_samples() -> None:
    rng = np.random.default_rng(1)
    matrices = tuple(Model(TPP, TRUTH).matrices)
    records, arrays = [], []
    for number, n in enumerate(RUNS):
        t = np.arange(n) * 0.002
        u = np.cumsum(rng.normal(size=(n, 2)), axis=0) * 0.003
        u -= u.mean(axis=0)
        y = lsim(matrices, u, t, interp=False)[1]
        y = y + rng.normal(size=y.shape) * y.std(axis=0) * 0.2
        arrays.append((t, u, y))
        channels = {"t": t, "p": y[:, 0], "q": y[:, 1], "delta_x": u[:, 0], "delta_y": u[:, 1]}
        records.append(Record(f"#{number}", channels))

    def transforms() -> None:
        for _, u, y in arrays:
            rfft(u, axis=0)
            rfft(y, axis=0)

    def by_simulation() -> None:
        def residuals(values: np.ndarray) -> np.ndarray:
            simulated = tuple(Model(TPP, values).matrices)
            return np.concatenate([(y - lsim(simulated, u, t, interp=False)[1]).ravel() for t, u, y in arrays])

        least_squares(residuals, TRUTH * 1.1, x_scale=np.abs(TRUTH))

    transform_s = best_of(5, transforms)
    fit_s = best_of(3, lambda: identify(TPP, records))
    simulation_s = best_of(1, by_simulation)
    print(
        f"\nTPP fit, {sum(RUNS)} samples, no start values: {1000 * fit_s:.0f} ms\n"
        f"  {fit_s / transform_s:.0f} passes of scipy.fft.rfft over the same data ({1000 * transform_s:.2f} ms)\n"
        f"  {simulation_s / fit_s:.0f} times faster than least_squares over scipy.signal.lsim ({simulation_s:.1f} s)"
    )
