"""Other observers beside the paper's: slower and faster poles, and the Kalman filter for the noise that was flown in.

What the commands do not explain of the measured rates is taken apart in gusts, white angular accelerations on each
axis that went through the vehicle, and noise of the gyros, white too: four sizes that suit the spectra of both rates
best, none below nothing. The Kalman filter is that of these sizes. How much an observer stirs the commands is told by
the measured spectra themselves, vibration of the rotor included, with the loop closed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.control.bounds import margins_json
from sysid.control.judgement import Judgement, Limits, Role, judge
from sysid.control.over_costs import least_margins
from sysid.control.regulator import OBSERVER_POLES, DesignError, Gains, observer_gain
from sysid.control.stability import Margins, closed_loop, from_rates, rates_per_command
from sysid.data.dataset import prepared
from sysid.data.preprocess import ComplexArray
from sysid.data.record import RATES, Record
from sysid.data.stacks import stack
from sysid.fit.output_error import output_error
from sysid.model.structure import FloatArray, Model

PAPER, KALMAN = "paper", "kalman"
FACTORS = {"half": 0.5, PAPER: 1.0, "twice": 2.0, "four times": 4.0}
"""Of the paper's poles."""
OF_NYQUIST = 0.95
"""Beyond it a log's own filters end the spectrum."""
WINDOW_S = 2.0
LOWEST_HZ, HIGHEST_HZ, POINTS = 0.01, 100.0, 2000
"""Where gusts act."""
LEAST_SHARE = 1e-4
"""Of the largest spectral value: a smaller gyro noise would be no noise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RateNoise:
    """What commands do not explain of p and q."""

    frequency_hz: FloatArray
    """(f,)"""
    density: FloatArray
    """(f, 2), one-sided, (rad/s)^2/Hz."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WhiteNoise:
    """One-sided densities of what is taken for white."""

    gusts: FloatArray
    """(2,), on p' and q', (rad/s^2)^2/Hz;"""
    gyros: FloatArray
    """(2,), on p and q, (rad/s)^2/Hz."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WithObserver:
    """Gains with one observer."""

    name: str
    gains: Gains
    judgement: Judgement
    noise: FloatArray | None
    """(commands,), standard deviation that the measured noise gives each, of full command; None where none is known;"""
    gusts_left: FloatArray | None
    """(2,), what the loop leaves of what gusts do to p and q, of standard deviations; the same."""

    @property
    def least(self) -> Margins | None:
        return least_margins(self.judgement)

    def to_json(self) -> dict[str, Any]:
        fit = self.judgement.models[0]
        return {
            "observer": self.name,
            "observer_gain": self.gains.observer_gain.tolist(),
            "observer_poles": [
                {"real": float(one.real), "imag": float(one.imag)}
                for one in sorted(self.gains.observer_poles, key=lambda one: (one.real, one.imag))
            ],
            "verdict": self.judgement.verdict,
            "margins": None if self.least is None else margins_json(self.least),
            "overshoot": fit.overshoot,
            "coupling": fit.coupling,
            "command_noise": None if self.noise is None else self.noise.tolist(),
            "gusts_left": None if self.gusts_left is None else self.gusts_left.tolist(),
        }


def rate_noise(model: Model, records: Sequence[Record]) -> RateNoise:
    """By the residuals of runs, up to where the slowest log ends. Raises DesignError where none is long enough."""
    # heavier than NumPy itself to load: only where it is needed
    from scipy.signal import welch

    highest = OF_NYQUIST / 2 * min((1 / float(np.median(np.diff(one.t))) for one in records), default=0.0)
    structure = model.structure
    spectra = prepared(records, (0.0, highest)).viewed(structure.inputs, structure.outputs).spectra if records else ()
    at = [structure.outputs.index(name) for name in RATES]
    found: list[tuple[FloatArray, FloatArray, float]] = []
    for one in spectra:
        (residual,) = output_error(model, stack([one])).residuals
        rates = one.in_time(residual)[at]
        dt = float(np.median(np.diff(one.segment.t)))
        window = round(WINDOW_S / dt)
        if rates.shape[1] > 2 * window:
            f, density = welch(rates, 1 / dt, nperseg=window)
            found.append((f, density.T, rates.shape[1] * dt))
    if not found:
        raise DesignError(f"no run is {2 * WINDOW_S:g} s long: what noise the vehicle flies in is not known")
    f = found[0][0]
    f = f[(f > 0) & (f <= highest)]
    each = [np.stack([np.interp(f, at_hz, column) for column in density.T], axis=1) for at_hz, density, _ in found]
    return RateNoise(frequency_hz=f, density=np.average(each, axis=0, weights=[seconds for _, _, seconds in found]))


def white_noise(model: Model, noise: RateNoise) -> WhiteNoise:
    """Sizes of gusts and gyro noise by relative least squares, none negative."""
    from scipy.optimize import nnls

    s: ComplexArray = np.asarray(2j * np.pi * noise.frequency_hz, dtype=complex)
    through = np.abs(_rates_per_gust(model, s)) ** 2
    size = np.maximum(noise.density, LEAST_SHARE * np.max(noise.density))
    rows = [np.hstack([through[:, i], np.tile(np.eye(2)[i], (s.size, 1))]) / size[:, i, None] for i in (0, 1)]
    sizes, _ = nnls(np.concatenate(rows), np.ones(2 * s.size))
    floor = LEAST_SHARE * np.max(noise.density, axis=0)
    return WhiteNoise(gusts=sizes[:2], gyros=np.maximum(sizes[2:], floor))


def _rates_per_gust(model: Model, s: ComplexArray) -> ComplexArray:
    """(f, 2, 2): p and q per angular acceleration on each."""
    A, _, C, _ = (np.asarray(one, dtype=float) for one in model.matrices)
    on_rates = np.eye(len(A))[:, :2].astype(complex)
    return np.asarray(C @ np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, on_rates[None]))


def kalman_gain(model: Model, white: WhiteNoise) -> FloatArray:
    """(4, 2). Raises DesignError where there is none."""
    from scipy.linalg import solve_continuous_are

    A, _, C, _ = (np.asarray(one, dtype=float) for one in model.matrices)
    gusts = np.diag([*white.gusts, *(0.0,) * (len(A) - 2)])
    try:
        P = solve_continuous_are(A.T, C.T, gusts, np.diag(white.gyros))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f"no Kalman filter for this model and noise: {error}") from error
    return np.asarray(P @ C.T / white.gyros)


def with_poles(gains: Gains, poles: Sequence[float], vehicle: Model) -> Gains:
    """The gains with observer poles there, 1/s, in the loop with a vehicle. Raises DesignError where none do."""
    if len(poles) != len(gains.observer_gain) or not all(-np.inf < pole < 0 for pole in poles):
        raise DesignError(f"an observer of {len(gains.observer_gain)} states has as many poles, each negative")
    A, _, C, _ = (np.asarray(one, dtype=float) for one in gains.model.matrices)
    try:
        return with_gain(gains, observer_gain(A, C, poles), vehicle)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise DesignError(f"no observer has these poles (each at most twice): {error}") from error


def with_gain(gains: Gains, L: FloatArray, vehicle: Model) -> Gains:
    """The gains with another observer, in the loop with a vehicle."""
    A, _, C, _ = (np.asarray(one, dtype=float) for one in gains.model.matrices)
    found = replace(gains, observer_gain=L, observer_poles=np.linalg.eigvals(A - L @ C))
    return replace(found, loop=closed_loop(found, vehicle))


def command_noise(gains: Gains, vehicle: Model, noise: RateNoise) -> FloatArray:
    """(commands,): standard deviation of each in the loop with a vehicle, of full command."""
    s: ComplexArray = np.asarray(2j * np.pi * noise.frequency_hz, dtype=complex)
    controller = from_rates(gains, s)
    back = controller @ rates_per_command(vehicle, s, gains.commands)
    per_rate = np.linalg.solve(np.eye(len(gains.K)) + back, controller)
    density = np.einsum("fij,fj->fi", np.abs(per_rate) ** 2, noise.density)
    return np.asarray(np.sqrt(np.trapezoid(density, noise.frequency_hz, axis=0)))


def gusts_left(gains: Gains, vehicle: Model, white: WhiteNoise) -> FloatArray:
    """(2,): of what gusts do to each rate without the loop, what they do with it, as standard deviations."""
    f = np.geomspace(LOWEST_HZ, HIGHEST_HZ, POINTS)
    s: ComplexArray = np.asarray(2j * np.pi * f, dtype=complex)
    alone = _rates_per_gust(gains.model, s)
    back = rates_per_command(vehicle, s, gains.commands) @ from_rates(gains, s)
    powers = [
        np.trapezoid(np.abs(one) ** 2 @ white.gusts, f, axis=0)
        for one in (np.linalg.solve(np.eye(2) + back, alone), alone)
    ]
    return np.asarray(np.sqrt(powers[0] / np.maximum(powers[1], np.finfo(float).tiny)))


def over_observers(
    gains: Gains, models: Sequence[tuple[Role, Model]], noise: RateNoise | None, limits: Limits | None = None
) -> tuple[WithObserver, ...]:
    """The same K with each observer, judged on these models, the fit first; a Kalman filter where noise is known."""
    vehicle = models[0][1]
    white = None if noise is None else white_noise(gains.model, noise)
    each = {name: with_poles(gains, [f * pole for pole in OBSERVER_POLES], vehicle) for name, f in FACTORS.items()}
    if white is not None:
        each[KALMAN] = with_gain(gains, kalman_gain(gains.model, white), vehicle)
    found = []
    for name, one in each.items():
        stirred = left = None
        if noise is not None and white is not None and one.loop.stable:
            stirred = command_noise(one, vehicle, noise)
            left = gusts_left(one, vehicle, white)
        found.append(
            WithObserver(name=name, gains=one, judgement=judge(one, models, limits), noise=stirred, gusts_left=left)
        )
    return tuple(found)
