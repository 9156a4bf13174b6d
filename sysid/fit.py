"""Output-error fits of linear structures in the Fourier domain, without start values.

The measured samples enter once, as Fourier bins up to 15 Hz. First the structure's equation error, linear in its
coefficients, reweighted by the last denominator (Sanathanan and Koerner), gives a start; then Gauss-Newton
steps with halving minimise the output error. Each segment's difference between first and last state is an extra
linear unknown, projected out, so that the bins are exact for records that are not periodic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import SysidError
from sysid.model import AnyArray, FloatArray, Model, Structure, discrete_sensitivities, discretise
from sysid.preprocess import ComplexArray, Spectrum

REWEIGHTINGS = 4
FIRST_SLOPES = (0.0, 1.0)
"""Powers of frequency that weigh the first equation error down: gusts ask for none, sensor noise for more."""
CORNER = 3.0  # rad/s
MAXIMUM_STEPS = 60
TOLERANCE = 1e-8
WEIGHING_ROUNDS = 8
STABILITY_PUSHES = (0.03, 0.3, 3.0, 30.0)
STABILITY_MARGIN = 0.1  # 1/s
SMOOTHING_HZ = 1.0
LEAST_COMMAND = 2e-4  # rms of full command in the band: one step of a 12-bit servo
LEAST_INDEPENDENT_SHARE = 0.002
LARGEST_RELATIVE_ERROR = 0.25


class FitError(SysidError):
    """The data cannot identify the structure; the message names the axis and what to do."""


@dataclass(frozen=True, eq=False)
class OutputError:
    """What a model leaves unexplained, end states projected out."""

    residuals: list[ComplexArray]
    """For every segment (bins, k)."""
    measured_power: FloatArray
    """(k,), summed over all bins of all segments."""
    residual_power: FloatArray
    """(k,)"""

    @property
    def nrmse_percent(self) -> FloatArray:
        """Eq. 10 per output, pooled over runs; 100 is perfect."""
        return 100 * (1 - np.sqrt(self.residual_power / self.measured_power))


@dataclass(frozen=True, eq=False)
class Estimate:
    """The best values, and how far the data bind them."""

    model: Model
    covariance: FloatArray
    """(parameters, parameters), honest under coloured residuals."""
    error: OutputError


def simulate_bins(model: Model, spectrum: Spectrum) -> tuple[ComplexArray, ComplexArray]:
    """Outputs and the response to end states, exact for commands held between samples.

    Returns Y (bins, k) and the columns of the end states (bins, k, n).
    """
    A, B, C, _ = model.matrices
    Ad, Bd = discretise(A, B, spectrum.dt)
    R = _resolvent(Ad, spectrum.z)
    X = (R @ (spectrum.U @ Bd.T)[:, :, None])[:, :, 0]
    return X @ C.T, spectrum.z[:, None, None] * (C @ R)


def _resolvent(Ad: AnyArray, z: ComplexArray) -> ComplexArray:
    return np.asarray(np.linalg.inv(z[:, None, None] * np.eye(Ad.shape[0]) - Ad))


def _real(x: ComplexArray) -> FloatArray:
    """(bins, k, ...) complex -> (2 bins k, ...) real."""
    flat = x.reshape(x.shape[0] * x.shape[1], *x.shape[2:])
    return np.concatenate([flat.real, flat.imag])


def _complex(x: FloatArray, shape: tuple[int, ...]) -> ComplexArray:
    half = x.shape[0] // 2
    return np.asarray((x[:half] + 1j * x[half:]).reshape(shape))


def output_error(model: Model, spectra: Sequence[Spectrum]) -> OutputError:
    """What the model leaves of each segment after its own trim and end states."""
    residuals = []
    for one in spectra:
        Y, ends = simulate_bins(model, one)
        basis, _ = np.linalg.qr(_real(ends))
        e = _real(one.Y - Y)
        residuals.append(_complex(e - basis @ (basis.T @ e), one.Y.shape))
    # every bin but zero stands for two of the full transform; 2/n^2 makes it a mean square, n weighs by samples
    scale = [2 / one.samples for one in spectra]
    power = sum(s * np.sum(np.abs(e) ** 2, axis=0) for s, e in zip(scale, residuals, strict=True))
    measured = sum(s * np.sum(np.abs(one.Y) ** 2, axis=0) for s, one in zip(scale, spectra, strict=True))
    return OutputError(residuals, np.asarray(measured), np.asarray(power))


def start(structure: Structure, spectra: Sequence[Spectrum]) -> Model:
    """A start from the data alone: equation error, reweighted by its own last denominator."""
    equation = structure.equation_error
    order, k = equation.order, len(structure.outputs)
    measured = np.sqrt(sum(np.sum(np.abs(one.Y) ** 2, axis=0) for one in spectra))
    blocks = []
    for one in spectra:
        s = 2j * np.pi * one.frequency_hz
        hold = np.sinc(one.frequency_hz * one.dt) * np.exp(-0.5 * s * one.dt)
        ends = np.zeros((s.size, k, k * order), dtype=complex)
        for power in range(order):
            for axis in range(k):
                ends[:, axis, power * k + axis] = s**power
        target = (s**order)[:, None] * one.Y
        blocks.append((s, equation.regressors(s, one.Y, one.U * hold[:, None]), ends, target, one.samples**-0.5))
    best: tuple[float, Model] | None = None
    for slope in FIRST_SLOPES:
        coefficients: FloatArray | None = None
        for _ in range(REWEIGHTINGS):
            rows, rights = [], []
            for s, regressors, ends, target, scale in blocks:
                if coefficients is None:
                    weight = np.eye(k) / (CORNER + np.abs(s[:, None, None])) ** slope
                else:
                    weight = np.linalg.inv(equation.denominator(s, coefficients))
                weight = weight * (scale / measured[:, None])
                basis, _ = np.linalg.qr(_real(weight @ ends))
                left, right = _real(weight @ regressors), _real((weight @ target[:, :, None])[:, :, 0])
                rows.append(left - basis @ (basis.T @ left))
                rights.append(right - basis @ (basis.T @ right))
            left = np.concatenate(rows)
            size = np.linalg.norm(left, axis=0)
            if np.any(size == 0) or not np.all(np.isfinite(size)):
                break
            coefficients = np.linalg.lstsq(left / size, np.concatenate(rights), rcond=None)[0] / size
            with np.errstate(all="ignore"):
                values = equation.to_parameters(coefficients)
            if not np.all(np.isfinite(values)):
                break
            model = Model(structure, values)
            cost = float(np.sum(np.log(output_error(model, spectra).residual_power)))
            if np.isfinite(cost) and (best is None or cost < best[0]):
                best = (cost, model)
    if best is None:
        raise FitError("the data do not determine the model: the commands hardly move, or move together")
    return best[1]


@dataclass(frozen=True, eq=False)
class _Linearised:
    residual: FloatArray
    jacobian: FloatArray
    parts: list[tuple[ComplexArray, ComplexArray]]
    """For every segment the residual (bins, k) and the Jacobian (bins, k, parameters), projected, unweighted scale."""


def _weighted(model: Model, spectra: Sequence[Spectrum], weights: Sequence[FloatArray], need: bool) -> _Linearised:
    """Residual and Jacobian of all segments with weights (bins, k), each segment's end states projected out."""
    structure, C = model.structure, model.matrices.C
    by_dt: dict[float, tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = {}
    residuals, jacobians, parts = [], [], []
    for one, weight in zip(spectra, weights, strict=True):
        if one.dt not in by_dt:
            by_dt[one.dt] = discrete_sensitivities(structure, model.values, one.dt)
        Ad, Bd, dAd, dBd = by_dt[one.dt]
        R = _resolvent(Ad, one.z)
        X = (R @ (one.U @ Bd.T)[:, :, None])[:, :, 0]
        CR = C @ R
        basis, _ = np.linalg.qr(_real(weight[:, :, None] * one.z[:, None, None] * CR))
        e = _real(weight * (one.Y - X @ C.T))
        e = e - basis @ (basis.T @ e)
        residuals.append(e)
        if need:
            known = np.hstack([X, one.U])
            changes = np.concatenate([dAd, dBd], axis=2).reshape(-1, known.shape[1])
            drive = (known @ changes.T).reshape(one.z.size, -1, Ad.shape[0]).transpose(0, 2, 1)
            J = _real(weight[:, :, None] * (CR @ drive))
            J = J - basis @ (basis.T @ J)
            jacobians.append(J)
            parts.append((_complex(e, one.Y.shape), _complex(J, (*one.Y.shape, model.values.size))))
    return _Linearised(np.concatenate(residuals), np.concatenate(jacobians) if need else np.zeros((0, 0)), parts)


def minimise(model: Model, spectra: Sequence[Spectrum], weights: Sequence[FloatArray]) -> Model:
    """Gauss-Newton with step halving on the weighted output error."""
    for _ in range(MAXIMUM_STEPS):
        here = _weighted(model, spectra, weights, True)
        cost = float(here.residual @ here.residual)
        size = np.linalg.norm(here.jacobian, axis=0)
        size[size == 0] = 1
        move = np.linalg.lstsq(here.jacobian / size, here.residual, rcond=1e-10)[0] / size
        length = 1.0
        while length > 1e-6:
            trial = Model(model.structure, model.values + length * move)
            if np.all(np.isfinite(trial.values)):
                there = _weighted(trial, spectra, weights, False).residual
                trial_cost = float(there @ there)
                if np.isfinite(trial_cost) and trial_cost < cost:
                    break
            length /= 2
        else:
            return model
        model = trial
        if cost - trial_cost < TOLERANCE * cost:
            return model
    return model


def estimate(structure: Structure, spectra: Sequence[Spectrum]) -> Estimate:
    """Fit a structure to the bins of all segments together.

    The criterion is the paper's least squares over the low-passed samples, each output weighed by its own residual
    power (repeated until that power has settled). Raises FitError where the data do not determine the parameters.
    """
    _refuse_still_channels(structure, spectra)
    model = _settle(start(structure, spectra), spectra)
    error = output_error(model, spectra)
    weights = _axis_weights(spectra, error.residual_power)
    found = Estimate(model, _covariance(_weighted(model, spectra, weights, True), spectra), error)
    _refuse_vague_axes(found)
    return found


def held_stable(free: Model, spectra: Sequence[Spectrum]) -> tuple[Model, OutputError]:
    """The best stable model found by pushing an unstable one's poles across the axis; for judging the free fit.

    A penalty on the poles' real parts grows until they have crossed; the outputs keep the free fit's weights.
    """
    from scipy.optimize import least_squares

    structure = free.structure
    weights = _axis_weights(spectra, output_error(free, spectra).measured_power)
    best: tuple[float, Model] | None = None
    for begin in (free.values, np.array(structure.uncoupled)):
        values = begin
        scale = np.maximum(np.abs(begin), 1.0)
        for push in STABILITY_PUSHES:

            def residuals(x: FloatArray, push: float = push) -> FloatArray:
                model = Model(structure, x)
                real = np.linalg.eigvals(model.matrices.A).real
                return np.concatenate(
                    [_weighted(model, spectra, weights, False).residual, push * np.maximum(real + STABILITY_MARGIN, 0)]
                )

            values = least_squares(residuals, values, x_scale=scale, max_nfev=40).x
        model = Model(structure, values)
        if model.stable:
            residual = _weighted(model, spectra, weights, False).residual
            cost = float(residual @ residual)
            if best is None or cost < best[0]:
                best = (cost, model)
    if best is None:
        raise FitError("no stable model was found near the data")
    return best[1], output_error(best[1], spectra)


def _settle(model: Model, spectra: Sequence[Spectrum]) -> Model:
    """Minimise, weigh the outputs by what is left of them, and again until their weights have settled."""
    power = output_error(model, spectra).residual_power
    for _ in range(WEIGHING_ROUNDS):
        model = minimise(model, spectra, _axis_weights(spectra, power))
        last, power = power, output_error(model, spectra).residual_power
        if np.all(np.abs(power - last) < 1e-4 * last):
            break
    return model


def _axis_weights(spectra: Sequence[Spectrum], power: FloatArray) -> list[FloatArray]:
    """One over the residual's standard deviation, in units that make every sample of every run count the same."""
    floor = 1e-12 * max(float(power.max()), 1e-300)
    scale = 1 / np.sqrt(np.maximum(power, floor))
    return [np.broadcast_to(scale * np.sqrt(2 / one.samples), one.Y.shape) for one in spectra]


def _covariance(here: _Linearised, spectra: Sequence[Spectrum]) -> FloatArray:
    """Covariance of the least-squares estimate when residuals are coloured and cross-correlated.

    H^-1 V H^-1 with H the curvature and V the variance of its gradient, from the residual spectrum smoothed over
    about 1 Hz; treating the residuals as white makes the bounds too small.
    """
    curvature = here.jacobian.T @ here.jacobian
    gradient = np.zeros_like(curvature)
    for one, (e, J) in zip(spectra, here.parts, strict=True):
        cross = e[:, :, None] * e[:, None, :].conj()
        S = smooth(cross.reshape(cross.shape[0], -1), one.frequency_hz).reshape(cross.shape)
        gradient += 0.5 * np.real(np.einsum("fka,fkl,flb->ab", J.conj(), S, J, optimize=True))
    size = np.sqrt(np.diag(curvature))
    if not np.all(np.isfinite(size)) or np.any(size == 0):
        raise FitError("the data do not determine the model: a parameter does not show in the response at all")
    correlation = curvature / np.outer(size, size)
    if np.linalg.cond(correlation) > 1e12:
        raise FitError("the data do not determine the model: some of its parameters act alike on these runs")
    inverse = np.linalg.inv(correlation) / np.outer(size, size)
    return np.asarray(inverse @ gradient @ inverse)


def smooth(values: ComplexArray, frequency_hz: FloatArray, width_hz: float = SMOOTHING_HZ) -> ComplexArray:
    """Moving average over frequency of (bins, columns), reflected at the ends."""
    from scipy.ndimage import uniform_filter1d

    step = float(frequency_hz[1] - frequency_hz[0]) if frequency_hz.size > 1 else width_hz
    bins = max(5, int(width_hz / step) | 1)
    real = uniform_filter1d(values.real, bins, axis=0, mode="reflect")
    if not np.iscomplexobj(values):
        return np.asarray(real)
    return np.asarray(real + 1j * uniform_filter1d(values.imag, bins, axis=0, mode="reflect"))


AXIS_OF = {
    "delta_x": "roll",
    "delta_y": "pitch",
    "delta_e": "elevator",
    "p": "roll",
    "q": "pitch",
}


def _refuse_still_channels(structure: Structure, spectra: Sequence[Spectrum]) -> None:
    """Say which axis has no excitation, or none of its own, before any number is made of it."""
    if not spectra:
        raise FitError("no run has 2 s of gap-free samples: nothing to fit")
    bins = sum(one.frequency_hz.size for one in spectra)
    count = len(structure.parameters)
    if bins < 2 * count:
        raise FitError(f"only {bins} frequencies in the band: too little data for {count} parameters")
    energy = sum(2 / one.samples * np.sum(np.abs(one.U) ** 2, axis=0) for one in spectra)
    rms_of_commands = np.sqrt(energy / sum(one.samples for one in spectra))
    for name, rms in zip(structure.inputs, rms_of_commands, strict=True):
        if rms < LEAST_COMMAND:
            raise FitError(
                f"{AXIS_OF[name]} axis not identifiable: {name} hardly moves ({rms:.1e} rms of full command); "
                f"fly a {AXIS_OF[name]} chirp and add its run"
            )
    for axis, name in enumerate(structure.outputs):
        if not any(np.any(one.Y[:, axis]) for one in spectra):
            raise FitError(
                f"{AXIS_OF[name]} axis not identifiable: {name} does not move at all; check the gyro's channel"
            )
    own = independent_share(spectra)
    for name, share in zip(structure.inputs, own, strict=True):
        if share < LEAST_INDEPENDENT_SHARE:
            raise FitError(
                f"{AXIS_OF[name]} axis not identifiable: {name} only follows the other command "
                f"({100 * share:.2g} % of its power is its own); fit it together with a {AXIS_OF[name]} chirp"
            )


def independent_share(spectra: Sequence[Spectrum]) -> FloatArray:
    """Share of each command's power, (m,), that the other commands do not explain linearly, pooled over all runs.

    With one noise-free sweep and a controller on, the other axis's command follows the swept one and this is near 0.
    """
    grid = np.arange(0.25, max(one.frequency_hz[-1] for one in spectra) + 0.25, 0.5)
    m = spectra[0].U.shape[1]
    cross = np.zeros((grid.size, m, m), dtype=complex)
    for one in spectra:
        band = np.minimum((one.frequency_hz / 0.5).astype(int), grid.size - 1)
        np.add.at(cross, band, one.U[:, :, None] * one.U[:, None, :].conj() / one.samples)
    own, whole = np.zeros(m), np.zeros(m)
    for j in range(m):
        others = [i for i in range(m) if i != j]
        for S in cross:
            power = float(S[j, j].real)
            explained = 0.0
            if others and power > 0:
                inner = S[np.ix_(others, others)]
                row = S[j, others]
                explained = float((row @ np.linalg.pinv(inner, rcond=1e-9, hermitian=True) @ row.conj()).real)
            own[j] += max(power - explained, 0.0)
            whole[j] += power
    return own / np.maximum(whole, 1e-300)


def _refuse_vague_axes(found: Estimate) -> None:
    """An axis whose control effectiveness is not known to a quarter of itself is not identified."""
    structure = found.model.structure
    B_of = structure.matrices
    base = B_of(found.model.values.astype(complex)).B
    for column, name in enumerate(structure.inputs):
        gradient = []
        for index in range(found.model.values.size):
            stepped = found.model.values.astype(complex)
            stepped[index] += 1e-30j
            gradient.append(B_of(stepped).B[:, column].imag / 1e-30)
        G = np.array(gradient).T
        spread = np.sqrt(np.maximum(np.diag(G @ found.covariance @ G.T), 0))
        values = np.abs(base[:, column].real)
        known = values > 0
        best = np.min(spread[known] / values[known]) if np.any(known) else np.inf
        if not best < LARGEST_RELATIVE_ERROR:
            raise FitError(
                f"{AXIS_OF[name]} axis not identifiable: the effect of {name} is known only to "
                f"{100 * best:.0f} % of itself; fly a {AXIS_OF[name]} chirp, longer or with more amplitude"
            )
