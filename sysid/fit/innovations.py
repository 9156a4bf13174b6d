"""Outputs as rows in which only what is new counts: how a residual is asked where nothing keeps feedback out.

Where no excitation is logged, gusts reach the commands, and commands seem to explain gusts. A question to the residual
that knows its past is asked for no more than causes can answer: what a command did until now against what is new now.
So the rows are innovations: whitened by the noise's vector autoregression (as in `sysid.fit.prediction_error`), with
the past of what the model leaves taken out of every row, in each run for itself, for the air is another in each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import ComplexArray
from sysid.data.stacks import Stack
from sysid.fit.gauss_newton import NormalEquations, bounded_step
from sysid.fit.output_error import output_error
from sysid.fit.prediction_error import MEMORY_S, Equations, Noise, lags_of, lower
from sysid.fit.rows import orthonormal, rows
from sysid.fit.whitening import Whitening, jumps, weighed
from sysid.model.predict import respond
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import FloatArray, Model

STEPS = 4
"""Of the noise's numbers, and the model's with them, from where Yule and Walker put them."""
SETTLED = 0.5
"""Of what is left, in units of log likelihood: a step that gains less is the last."""
LEAST_FREE = 0.5
"""Of its rows, that a run must keep beside its noise's past."""
RANK = 1e-9


@dataclass(frozen=True, eq=False)
class Innovations(Whitening):
    """Rows of unit variance that no past noise foretells."""

    rate_hz: float
    """Of the noise's past."""
    model: Model
    """Where model and noise together predict best."""

    @property
    def seconds(self) -> float:
        """Of the runs, in samples of that rate: as many as there are rows of an output."""
        return float(2 * sum(group.Y.shape[1] for group in self.stacks) / self.rate_hz)

    @property
    def log_likelihood(self) -> float:
        """Of what its model leaves, but for what is the same of all on these bins: rows have unit variance."""
        return float(sum(np.sum(np.log(np.abs(np.linalg.det(one)) ** 2)) for one in self.whitener))

    def surprise(
        self, residual: FloatArray, J: FloatArray, commands: Sequence[str], youngest: int = 1
    ) -> tuple[float, int]:
        """Of the residual (N,) what the commands of the last MEMORY_S explain, none younger than so many samples,
        whatever the vehicle, less what the model's own parameters, sensitivities J (free, N), do: chi squared, and its
        degrees of freedom."""
        some = self([_past_commands(group, commands, self.rate_hz, youngest) for group in self.stacks])
        own = orthonormal(J) if len(J) else J
        basis = orthonormal(some - (some @ own.T) @ own, RANK)
        left = residual - (residual @ own.T) @ own
        return float(np.sum((basis @ left) ** 2)), len(basis)


def innovations(model: Model, on: Dataset, free: Sequence[str]) -> Innovations:
    """By the noise that a model leaves of runs whose bins reach beyond the band (`Dataset.wider`); its `free`
    parameters go with the noise's numbers to where both predict best."""
    rate_hz = 2 * on.band_hz[1]
    model, noise = _told(model, on.stacks, rate_hz, [model.structure.names.index(name) for name in free])
    v = _left(model, noise, on.stacks)
    for _ in range(2):  # whose unit is that of what is left beside the past
        ends = [_ends(model, noise, group, some) for group, some in zip(on.stacks, v, strict=True)]
        white = [noise.weights(group) / group.scale for group in on.stacks]
        made = Innovations(on.stacks, [one.transpose(2, 0, 1) for one in white], ends, rate_hz, model)
        noise = replace(noise, root=_scaled(noise, made, v, len(free)))
    return made


def _told(model: Model, stacks: Sequence[Stack], rate_hz: float, free: Sequence[int]) -> tuple[Model, Noise]:
    """Noise and model after a few steps of both; the model stays where it does not have a slope to follow."""
    noise = Noise.of(output_error(model, stacks), stacks, rate_hz)
    low, high = model.structure.bounds
    movable = np.isin(np.arange(model.values.size), free)
    try:
        with np.errstate(all="ignore"):
            here = Equations.at(model, noise, stacks)
            for _ in range(STEPS):
                step = NormalEquations(np.diag(here.new), *here.beside_past, [])
                move = bounded_step(step, movable, low - model.values, high - model.values)
                lags = here.noise_move(move).reshape(noise.lags.shape[0], *noise.root.shape)
                reached = lower(model, noise, stacks, here, move, lags)
                if reached is None:
                    break
                before = here.cost
                model, noise, here = reached
                if here.samples * (before - here.cost) < SETTLED:
                    break
    except (RelaxationError, np.linalg.LinAlgError):
        pass
    return model, noise


def _left(model: Model, noise: Noise, stacks: Sequence[Stack]) -> list[ComplexArray]:
    """For every stack (k, bins) of what the model leaves, end states taken out in the metric of what is new."""
    found = []
    for group in stacks:
        response, W = respond(model.structure, model.values, group, False), noise.weights(group)
        E = weighed(W, np.concatenate([response.E, jumps(group)]))
        left = weighed(W, (group.Y - response.Y)[None])
        each = []
        for part in group.slices:
            basis, some = orthonormal(rows(E[..., part])), rows(left[..., part])
            new = (some - (some @ basis.T) @ basis).view(complex).reshape(len(group.Y), -1)
            each.append(np.linalg.solve(W[..., part].transpose(2, 0, 1), new.T[..., None])[..., 0].T)
        found.append(np.concatenate(each, axis=1))
    return found


def _ends(model: Model, noise: Noise, group: Stack, v: ComplexArray) -> list[FloatArray]:
    """For every segment a basis of its end states and of the past of what it leaves."""
    response, W, k = respond(model.structure, model.values, group, False), noise.weights(group), len(group.Y)
    E = weighed(W, np.concatenate([response.E, jumps(group)]))
    late = noise.late(group)
    # (lag, output that is foretold, output that foretells, outputs, bins)
    past = np.einsum("lf,jf,oi->lijof", late, group.scale * v, noise.root).reshape(-1, k, v.shape[1])
    found = []
    for part in group.slices:
        most = int(2 * k * (part.stop - part.start) * (1 - LEAST_FREE) / (k * k))
        columns = np.concatenate([E[..., part], past[: k * k * most, ..., part]])
        found.append(orthonormal(rows(columns)))
    return found


def _scaled(noise: Noise, made: Innovations, v: Sequence[ComplexArray], free: int) -> FloatArray:
    """The root that makes what is left beside the past of unit variance."""
    k = noise.root.shape[0]
    power, count, known = np.zeros((k, k)), 0, free
    for group, white, ends, some in zip(made.stacks, made.whitener, made.ends, v, strict=True):
        e = np.einsum("fij,jf->if", white, group.scale * some)[None]
        for part, basis in zip(group.slices, ends, strict=True):
            row = rows(e[..., part])
            each = (row - (row @ basis.T) @ basis).reshape(k, -1)
            power += each @ each.T
            count += each.shape[1]
            known += len(basis)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(power / (count - known / k))) @ noise.root)


def _past_commands(group: Stack, commands: Sequence[str], rate_hz: float, youngest: int) -> ComplexArray:
    """Each command of each of the last samples, from so many back on, on each output, (columns, k, bins)."""
    k, u = len(group.Y), group.U[[group.inputs.index(name) for name in commands]]
    late = lags_of(group, max(youngest, round(MEMORY_S * rate_hz)), rate_hz)[youngest - 1 :]
    found = np.einsum("lf,cf,oi->lcoif", late, u, np.eye(k))
    return np.asarray(found.reshape(-1, k, u.shape[1]))
